"""Experiments: named runs with changed parameters, built on one another.

Input        the experiments of the model's class
Output       ir.graph.Experiment
Establishes  every change names a parameter of the flat model; settings are numbers in range
Reports      BG280 unknown base or circle, BG281 bad setting, BG282 what is changed is no parameter
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

from bgdsl.diagnostics import Code, did_you_mean
from bgdsl.expr import Expr
from bgdsl.ir.graph import Experiment, Origin, array_of_entry, scalar_names
from bgdsl.passes.claims import chosen_entries, claimed_value, element_claims, element_name
from bgdsl.passes.elaborate import evaluate
from bgdsl.passes.modifications import Modification
from bgdsl.passes.names import UNKNOWN_TARGET
from bgdsl.passes.parameters import spread
from bgdsl.passes.parts import (
    Absent,
    ArrayPart,
    Broken,
    Build,
    Claim,
    Context,
    ElementPart,
    Fault,
    Instance,
    ParameterPart,
    Reported,
    SignalPart,
)
from bgdsl.passes.shapes import entries, shape_of, shown_shape, unknowns_of
from bgdsl.passes.values import kind_of
from bgdsl.source import Span
from bgdsl.syntax import ast

NO_BASE = Code("BG280", "an experiment builds on one that does not exist")
SETTING = Code("BG281", "a setting of an experiment is not valid")
NO_PARAMETER = Code("BG282", "an experiment changes what is no parameter")

SETTINGS = ("stopTime", "startTime", "interval", "tolerance", "method", "window")


@dataclass
class _Run:
    settings: dict[str, tuple[Any, Span]] = field(default_factory=dict)
    changes: dict[str, Expr] = field(default_factory=dict)
    faults: dict[str, Fault | Reported] = field(default_factory=dict)
    resized: dict[str, _Resized] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class _Resized:
    """A new value of another size for an array that declares none; `fault` is what to say where no structure depends on it."""

    value: Any
    fault: Fault


_Change = tuple[str, Expr | _Resized]
"""A parameter's scalar name with its new value, or an array's name with one of another size."""


def make_experiments(root: Instance, running: str | None) -> tuple[Experiment, ...]:
    """The experiments of the model in the order written; a base need not stand before what builds on it. running: the one for
    which the model is flattened, with the structure that it wants."""
    made: list[Experiment] = []
    for name, (node, _) in root.cls.experiments.items():
        try:
            made.append(_make(name, node, root, running))
        except Fault as fault:
            root.build.fault(fault)
        except Reported:
            pass
    return tuple(made)


def _make(name: str, node: ast.Experiment, root: Instance, running: str | None) -> Experiment:
    run = _Run()
    for step in reversed(_chain(node, root)):
        _read(step, root.context(root.cls.experiments[step.name][1]), run, root)
    resized = {path: found for path, found in run.resized.items() if path not in root.build.overrides}
    elsewhere = name != running and (running is not None or _shapes(root.build, (*run.changes, *resized)))
    wrong = [*run.faults.values(), *(found.fault for found in resized.values())]
    for fault in () if elsewhere else wrong:
        if isinstance(fault, Fault):
            root.build.fault(fault)
    return Experiment(
        name,
        Origin("", node.span),
        _positive(run, "stopTime"),
        _positive(run, "interval"),
        _positive(run, "tolerance"),
        _method(run),
        _window(run),
        run.changes,
        node.comment or "",
        not (elsewhere and wrong),
        {name: (shape_of(found.value), entries(found.value)) for name, found in resized.items() if elsewhere},
    )


def _shapes(build: Build, changes: Iterable[str]) -> bool:
    """Whether changes of these parameters give the model another structure."""
    return any(build.parameter_of(name)[0].structural for name in changes)


def _chain(node: ast.Experiment, root: Instance) -> list[ast.Experiment]:
    """The experiment and those it builds on."""
    chain = [node]
    while chain[-1].base is not None:
        base = chain[-1].base
        known = root.cls.experiments
        if base not in known:
            raise Fault(NO_BASE, f"there is no experiment `{base}`", chain[-1].span, "builds on it", helps=did_you_mean(base, known))
        following = known[base][0]
        if any(following is step for step in chain):
            names = " -> ".join([*(step.name for step in chain), following.name])
            raise Fault(NO_BASE, f"experiments build on each other in a circle: {names}", chain[-1].span, "closes the circle")
        chain.append(following)
    return chain


def _read(node: ast.Experiment, context: Context, run: _Run, root: Instance) -> None:
    for name, entry in context.build.names.table(node.arguments).items():
        if name in SETTINGS and name not in root.cls.members:
            run.settings[name] = (_setting(name, entry, context), entry.span)
        else:
            if entry.value is not None:  # whatever the experiments below say of it
                run.faults.pop(name, None)
            try:
                for changed, new in _changes(root, name, ((entry, context, ()),)):
                    _note(run, changed, new)
            except (Fault, Reported) as fault:
                run.faults.setdefault(name, fault)


def _note(run: _Run, name: str, new: Expr | _Resized) -> None:
    """What is said last of a parameter holds, of an array as a whole or by its entries."""
    if isinstance(new, Expr):
        run.resized.pop(array_of_entry(name), None)
        run.changes[name] = new
    else:
        run.changes = {other: value for other, value in run.changes.items() if array_of_entry(other) != name}
        run.resized[name] = new


def _setting(name: str, entry: Modification, context: Context) -> Any:
    if entry.value is None:
        raise Fault(SETTING, f"`{name}` has no value", entry.span, "")
    value = evaluate(entry.value, context)
    if isinstance(value, str):
        return value
    numbers = [context.build.number(item, entry.span, structural=False) for item in entries(value)]
    return tuple(numbers) if shape_of(value) else numbers[0]


def _positive(run: _Run, name: str) -> float | None:
    if name not in run.settings:
        return None
    value, span = run.settings[name]
    if not isinstance(value, float) or not value > 0:
        raise Fault(SETTING, f"`{name}` is a positive number", span, f"{value}")
    return value


def _method(run: _Run) -> str | None:
    if "method" not in run.settings:
        return None
    value, span = run.settings["method"]
    if not isinstance(value, str):
        raise Fault(SETTING, "`method` is a string", span, "", helps=('for example `method = "cvode-bdf"`',))
    return value


def _window(run: _Run) -> tuple[float, float] | None:
    if "startTime" in run.settings and run.settings["startTime"][0] != 0.0:
        raise Fault(
            SETTING, "runs start at time 0", run.settings["startTime"][1], "", helps=("use `window = {t1, t2}` for what is measured",)
        )
    if "window" not in run.settings:
        return None
    value, span = run.settings["window"]
    if not isinstance(value, tuple) or len(value) != 2 or not 0 <= value[0] < value[1]:
        raise Fault(SETTING, "`window` is two times, {t1, t2} with 0 <= t1 < t2", span, "")
    return value[0], value[1]


# -------------------------------------------------------------------------------------------------------------- changes


def _changes(instance: Instance, name: str, claims: tuple[Claim, ...]) -> Iterator[_Change]:
    """(scalar parameter, new value) for everything that the claims say about this member and what is inside it."""
    span = claims[0][0].span
    part = instance.part(name)
    if part is None:
        known = [*instance.cls.members, *(SETTINGS if not instance.path else ())]
        raise Fault(UNKNOWN_TARGET, f"{instance.shown} has no `{name}`", span, "nothing to change", helps=did_you_mean(name, known))
    yield from _of_part(part, claims, span)


def _of_part(part: Any, claims: tuple[Claim, ...], span: Span) -> Iterator[_Change]:
    match part:
        case ArrayPart():
            for item, (_, inner) in zip(part.items, element_claims(claims, part.shape), strict=True):
                yield from _of_part(item, inner, span)
        case Instance():
            names = list(dict.fromkeys(name for entry, _, _ in claims for name in entry.nested))
            for name in names:
                found = tuple(
                    (entry.nested[name], author, () if entry.nested[name].each else index)
                    for entry, author, index in claims
                    if name in entry.nested
                )
                yield from _changes(part, name, found)
        case ElementPart():
            yield from _of_element(part, claims)
        case ParameterPart():
            yield from _of_parameter(part, claims, span)
        case Absent() | Broken():
            raise Reported
        case SignalPart() if any("start" in entry.nested for entry, _, _ in claims):
            raise _initial(part.name, span, part.origin.span)
        case _:
            raise Fault(
                NO_PARAMETER,
                f"`{part.name}` is no parameter",
                span,
                "cannot be changed",
                helps=("make what changes a parameter of the model",),
            )


def _initial(name: str, span: Span, declared: Span) -> Fault:
    return Fault(
        NO_PARAMETER,
        f"the initial value of `{name}` is no parameter",
        span,
        "cannot be changed by an experiment",
        others=[(declared, "declared here")],
        helps=("give it by a parameter, `start = x0`, and change that",),
    )


def _of_element(part: ElementPart, claims: tuple[Claim, ...]) -> Iterator[_Change]:
    for entry, author, index in reversed(claims):
        for name, inner in entry.nested.items():
            made = author.build.parameters.get(f"{part.name}.{name}")
            if made is None and "start" in inner.nested:
                raise _initial(part.name, inner.span, part.member.span)
            if made is None:
                given = ", ".join(f"`{known}`" for known in part.parameters) or "a law"
                raise Fault(
                    NO_PARAMETER,
                    f"`{part.name}.{name}` is no parameter",
                    inner.span,
                    f"`{part.name}` is given by {given}",
                    others=[(part.member.span, "declared here")],
                    helps=("make what changes a parameter of the model, and use it in the element",),
                )
            yield from _of_parameter(made, ((inner, author, () if inner.each else index),), inner.span)


def _of_parameter(part: ParameterPart, claims: tuple[Claim, ...], span: Span) -> Iterator[_Change]:
    if part.constant or (part.member is not None and any(entry.final for entry, _, _ in part.claims)):
        word = "constant" if part.constant else "final"
        raise Fault(NO_PARAMETER, f"`{part.name}` is {word}", span, "cannot be changed", others=[(part.origin.span, "declared here")])
    names = scalar_names(part.name, part.shape)
    for claim in reversed(claims):
        entry = claim[0]
        if entry.value is not None:
            yield from _whole(part, claim, names, span)
        for spot, value in chosen_entries(claim, part.shape):
            _check_constant(value, entry.parts[0][1].span)
            yield element_name(part.name, spot), value


def _whole(part: ParameterPart, claim: Claim, names: tuple[str, ...], span: Span) -> Iterator[_Change]:
    value = claimed_value(claim)
    if kind_of(value) != "number" or (shape_of(value) and shape_of(value) != part.shape):
        what = shown_shape(shape_of(value)) if kind_of(value) == "number" else "no number"
        message = f"`{part.name}` is {shown_shape(part.shape)}, its new value {what}"
        fault = Fault(NO_PARAMETER, message, span, what, others=[(part.origin.span, "declared here")])
        if not part.open_shape or kind_of(value) != "number" or len(shape_of(value)) != len(part.shape):
            raise fault
        _check_constant(value, span)
        yield part.name, _Resized(value, fault)
        return
    _check_constant(value, span)
    yield from zip(names, spread(value, part.shape, span, part.name) or (), strict=True)


def _check_constant(value: Any, span: Span) -> None:
    for item in entries(value):
        for leaf in unknowns_of(item):
            raise Fault(NO_PARAMETER, f"the new value reads `{leaf.data or 'time'}`", span, "changes during a run")
