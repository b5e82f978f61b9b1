"""Flatten a model: every instance made, every modification applied, every port fused, every name resolved.

Input        Library, the name of a model (or None for its only one), parameters to set
Output       BondGraph
Establishes  what `BondGraph.verify` asserts; expressions read parameters and variables of the flat graph only
Reports      each neighbour reports what it finds

The neighbours: `choice` (which model), `names` (classes), `modifications`, `parts` (what an instance is made of), `claims`
(modifications applied), `component_classes` (redeclarations), `instantiate` (parts made), `elaborate` with `evaluation`, `references`,
`inline`, `rates`, `shapes`, `values`, `functions` (expressions), `parameters`, `tables`, `laws` and `law_checks` (elements),
`statements` (loops, equations), `connect` with `ends` and `fuse` (bonds), `experiments`.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from typing import Any

from bgdsl.collecting import uncollected
from bgdsl.diagnostics import Reporter
from bgdsl.expr import Expr, substitute, var
from bgdsl.ir.domains import Domain
from bgdsl.ir.elements import component
from bgdsl.ir.graph import (
    BondGraph,
    Check,
    Element,
    Junction,
    Law,
    Signal,
    SignalEquation,
)
from bgdsl.passes import fuse, law_checks, laws, statements
from bgdsl.passes.choice import choose_model
from bgdsl.passes.experiments import make_experiments
from bgdsl.passes.inline import RECURSIVE
from bgdsl.passes.instantiate import expand, make_part
from bgdsl.passes.names import Names, Resolved, head
from bgdsl.passes.parameters import evaluate_parameter, finish_parameters
from bgdsl.passes.parts import (
    Build,
    ElementPart,
    Fault,
    Instance,
    JunctionPart,
    ParameterPart,
    PortPart,
    Reported,
    SignalPart,
)
from bgdsl.passes.tables import table_value
from bgdsl.syntax import ast
from bgdsl.syntax.library import Library

DEPTH = 20_000

Override = float | bool | str | tuple[Any, ...]


def flatten(
    library: Library,
    model: str | None,
    report: Reporter,
    *,
    overrides: Mapping[str, Override] | None = None,
    experiment: str | None = None,
    part: bool = False,
) -> BondGraph:
    """The flat bond graph of one model; BgError with everything found if it has errors.

    experiment: the one whose structural changes are among the overrides; its other changes have to fit.
    part: check a model that others are made of. Its own ports stay open (bonds to them are left out of the graph, so `verify`
    does not hold) and parameters without a value count as 1.
    """
    names = Names(library, report)
    for module in library.modules.values():
        names.file_scope(module)
    node = choose_model(library, model, report)
    try:
        with uncollected(), _deep():
            return _flatten(library, node, names, report, dict(overrides or {}), experiment, part)
    except RecursionError:
        report.fail(RECURSIVE, "functions or constants call each other too deep", head(node.span), "in this model")


@contextmanager
def _deep() -> Iterator[None]:
    """Expressions as deep as the parser lets through, in functions that call functions, want more frames than Python's thousand."""
    limit = sys.getrecursionlimit()
    sys.setrecursionlimit(max(limit, DEPTH))
    try:
        yield
    finally:
        sys.setrecursionlimit(limit)


# ------------------------------------------------------------------------------------------------------------ the steps


def _flatten(
    library: Library, node: ast.Model, names: Names, report: Reporter, overrides: dict[str, Any], experiment: str | None, part: bool
) -> BondGraph:
    cls = names.make(Resolved(node.name, node, names.file_scope(library.main)))
    report.stop_if_errors()
    assert cls is not None
    build = _new_build(names, report, overrides)
    build.part = part
    root = Instance("", cls, (), build, None, node.comment or "")
    lines = statements.Lines()
    expand(root)
    for instance in build.instances:
        statements.walk(instance, lines)
    if not report.errors:  # else bonds may be missing that were written
        fuse.check_connected(build, root)
    for instance in build.instances:
        if instance.cls.is_element:
            list(statements.ports_of(instance))
    bonds = fuse.fuse(build)
    _settle_parameters(build)
    _declared_equations(build, lines)
    statements.settle_lines(lines, build)
    junctions = tuple(_junction(part) for part, _ in build.parts if isinstance(part, JunctionPart))
    elements = _elements(build, lines)
    signals = _signals(build, lines)
    experiments = make_experiments(root, experiment)
    parameters = finish_parameters(build, _ordered(build), head(node.span))
    if part:
        _leave_to_users(build, node.name in _extended(library))
    else:
        for item, _ in build.parts:
            if isinstance(item, ElementPart):
                law_checks.check_numbers(build, item)
    report.stop_if_errors()
    if not part:
        fuse.warn_single(build, (item for item, _ in build.parts if isinstance(item, JunctionPart) and not item.open), bonds)
    graph = BondGraph(
        node.name,
        node.comment or "",
        library.sources,
        tuple(build.flat_instances),
        junctions,
        elements,
        bonds,
        parameters,
        signals,
        (*lines.equations, *build.extra),
        tuple(lines.initial),
        tuple(lines.checks),
        build.tables,
        experiments,
        domains=_domains(library),
    )
    if build.renamed:
        graph = _with_fused_names(graph, build)
    if part:
        return _without_loose_bonds(graph)
    graph.verify()
    return graph


def _without_loose_bonds(graph: BondGraph) -> BondGraph:
    """A part without the bonds to elements whose values its users give."""
    there = {item.name for items in (graph.junctions, graph.elements) for item in items}
    return replace(graph, bonds=tuple(bond for bond in graph.bonds if bond.tail.node in there and bond.head.node in there))


_OF_SIZES = frozenset(("BG222", "BG225", "BG231", "BG232", "BG233", "BG244", "BG253", "BG255", "BG256", "BG261", "BG264", "BG272"))
"""What may be found wrong only because a size or value is not known yet."""


def _leave_to_users(build: Build, is_base: bool) -> None:
    """What the users of a part give (values, sizes; in a base class, bonds), cannot be found missing in it."""
    theirs = {laws.MISSING.number}
    if is_base:
        theirs.add(fuse.UNCONNECTED.number)
    if any(item.nominal and item.structural for item in build.parameters.values()):
        theirs |= _OF_SIZES
    build.report.diagnostics[:] = [found for found in build.report.diagnostics if found.code.number not in theirs]


def _extended(library: Library) -> set[str]:
    """The classes that models of the main file extend."""
    return {item.base.parts[-1].name for model in library.models() for item in model.items if isinstance(item, ast.Extends)}


def _new_build(names: Names, report: Reporter, overrides: dict[str, Any]) -> Build:
    build = Build(names, report, overrides, make_part, lambda part: None, lambda part, name, span: None, lambda node, context: None)
    build.evaluate_parameter = partial(evaluate_parameter, build)
    build.element_parameter = partial(laws.element_parameter, build)
    build.make_table = partial(table_value, build)
    return build


def _settle_parameters(build: Build) -> None:
    for part, owner in build.parts:
        match part:
            case ParameterPart():
                evaluate_parameter(build, part)
            case ElementPart():
                try:
                    laws.settle(build, part)
                except Fault as fault:
                    build.fault(fault, owner.path)
                    part.broken = True
                except Reported:
                    part.broken = True


def _declared_equations(build: Build, lines: statements.Lines) -> None:
    for part, owner in build.parts:
        if isinstance(part, SignalPart):
            try:
                statements.declared_equation(part, lines, build)
            except Fault as fault:
                build.fault(fault, owner.path)
            except Reported:
                pass


def _junction(part: JunctionPart) -> Junction:
    return Junction(part.name, part.kind, part.size, part.origin, open=part.open, comment=part.comment)  # type: ignore[arg-type]


def _elements(build: Build, lines: statements.Lines) -> tuple[Element, ...]:
    made: list[Element] = []
    for part, owner in build.parts:
        try:
            match part:
                case ElementPart() if not part.broken:
                    made.append(laws.make_element(build, part))
                case Instance():
                    made.append(statements.make_field(part, lines))
                case _:
                    pass
        except Fault as fault:
            build.fault(fault, owner.path)
        except Reported:
            pass
    return tuple(made)


def _signals(build: Build, lines: statements.Lines) -> tuple[Signal, ...]:
    read = statements.names_read([*lines.equations, *lines.initial, *build.extra])
    made: list[Signal] = []
    undefined: list[tuple[SignalPart, Signal]] = []
    for part, owner in build.parts:
        if not isinstance(part, SignalPart):
            continue
        if part.role == "input" and any(name in lines.defined for name in part.scalars()):
            part.role = "algebraic"
        try:
            signal = statements.make_signal(part, read)
        except Fault as fault:
            build.fault(fault, owner.path)
            continue
        except Reported:
            continue
        if not build.report.errors:  # else its equation may be among those that failed
            undefined.append((part, signal))
        made.append(signal)
    for part, signal in undefined:
        statements.check_defined(part, signal, read, lines, build)
    for name, shape, origin in build.solved:
        role = "state" if f"der({name})" in read else "algebraic"
        made.append(Signal(name, shape, role, origin))  # type: ignore[arg-type]
    return tuple(made)


def _ordered(build: Build) -> Iterator[ParameterPart]:
    """Every parameter in the order of declaration, elements' own at the place of the element."""
    for part, _ in build.parts:
        match part:
            case ParameterPart():
                yield part
            case ElementPart():
                for name in part.parameters:
                    made = build.parameters.get(f"{part.name}.{name}")
                    if made is not None:
                        yield made
            case _:
                pass


def _domains(library: Library) -> tuple[Domain, ...]:
    found = []
    for module in library.modules.values():
        stack: list[object] = list(reversed(module.tree.items))
        while stack:
            item = stack.pop()
            if isinstance(item, ast.Domain):
                found.append(_domain(item))
            elif isinstance(item, ast.Model):
                stack.extend(reversed(item.items))
    return tuple(found)


def _domain(node: ast.Domain) -> Domain:
    said = {"effort": ("effort", ""), "flow": ("flow", "")}
    for variable in node.variables:
        unit = ""
        for argument in variable.arguments:
            if isinstance(argument, ast.Modifier) and argument.name.text == "unit" and isinstance(argument.value, ast.String):
                unit = argument.value.value
        said[variable.role] = (variable.name, unit)
    return Domain(node.name, *said["effort"], *said["flow"], node.span, node.comment or "")


# -------------------------------------------------------------------------------------------------------- fused variables


def _with_fused_names(graph: BondGraph, build: Build) -> BondGraph:
    """Bonds that run through ports have one name; what was read under another (or as a port's variable) is renamed."""
    names = _renamings(build)
    if not names:
        return graph
    table = {var(old): var(new) for old, new in names.items()}

    def one(expression: Expr) -> Expr:
        return substitute((expression,), table)[0]

    def many(expressions: Sequence[Expr]) -> tuple[Expr, ...]:
        return substitute(expressions, table)

    def law(old: Law) -> Law:
        return Law(one(old.left), one(old.right), old.origin)

    def equation(old: SignalEquation) -> SignalEquation:
        return SignalEquation(one(old.left), one(old.right), old.origin)

    def element(old: Element) -> Element:
        modulus = None if old.modulus is None else tuple(many(row) for row in old.modulus)
        linear = None if old.linear is None else (old.linear[0], tuple(many(row) for row in old.linear[1]))
        return replace(old, laws=tuple(law(item) for item in old.laws), modulus=modulus, linear=linear)

    return replace(
        graph,
        elements=tuple(element(item) for item in graph.elements),
        equations=tuple(equation(item) for item in graph.equations),
        initial_equations=tuple(equation(item) for item in graph.initial_equations),
        checks=tuple(Check(one(item.condition), item.message, item.origin) for item in graph.checks),
    )


def _renamings(build: Build) -> dict[str, str]:
    found: dict[str, str] = {}
    for raw in build.raws:
        for at, (name, j) in raw.flat.items():
            _rename(found, raw.name, None if raw.size is None else at, name, j)
    for part, owner in build.parts:
        if isinstance(part, PortPart) and not owner.cls.is_element:
            for c, (raw, at) in (part.inside or part.outside).items():
                if at in raw.flat:
                    _rename(found, part.name, None if part.size is None else c, *raw.flat[at])
    return found


def _rename(found: dict[str, str], old: str, i: int | None, new: str, j: int | None) -> None:
    if (old, i) != (new, j):
        for letter in "ef":
            found[component(f"{old}.{letter}", i)] = component(f"{new}.{letter}", j)
