"""A model, or a part of one, written out flat: every junction, element and signal by itself, without classes and vectors.

Input        ScalarGraph, the dropped terms, the nodes wanted (all, or one partition's)
Output       text of one model in the language
Establishes  the text says the balances of the wanted junctions less the dropped terms, with every law, relation and signal
             equation that belongs to them; what they read of others is an `input`
Reports      nothing; UnwritableError where an element has no flat form

Paths become names (`cyl[2].rod.v` is `cyl_2_rod_v`); parameters, experiments, outputs and comments are kept. It is what is
written where classes and vectors would be cut through in the middle: a driving spin in a rigid body that is driven.
"""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from bgdsl.expr import Expr, const, evaluate, leaves, substitute, to_text, topological, var
from bgdsl.ir.graph import Element, Experiment, Parameter, Signal
from bgdsl.ir.scalar import ScalarGraph, Term
from bgdsl.reductions.condition import element_kinds, parameter_values
from bgdsl.reductions.source_map import UnwritableError

LONGEST = 400
"""Characters of an expression beyond which a parameter's default is written as its number."""


@dataclass(frozen=True, slots=True)
class FlatPart:
    """What to write. junctions, signals: the nodes wanted (scalar signals by name); gone: removed elements; frozen: the value
    that takes a signal's place, by (reader, signal): the reader is a term's index or an equation's left side. outputs: variables
    that others read, to be given as outputs; changed: parameters with new defaults."""

    junctions: frozenset[int]
    signals: frozenset[str]
    dropped: frozenset[int] = frozenset()
    gone: frozenset[str] = frozenset()
    frozen: Mapping[tuple[int | str, str], float] = field(default_factory=dict)
    outputs: tuple[str, ...] = ()
    changed: Mapping[str, float] = field(default_factory=dict)


def everything(scalar: ScalarGraph, dropped: frozenset[int], gone: frozenset[str]) -> FlatPart:
    """All of a model less its dropped terms."""
    signals = frozenset(name for signal in scalar.graph.signals for name in signal.scalars())
    return FlatPart(frozenset(range(len(scalar.junctions))), signals, dropped, gone)


def flat_text(
    scalar: ScalarGraph, part: FlatPart, annotation: str, comment: Mapping[int, str], *, folder: Path | None = None, name: str | None = None
) -> tuple[str, tuple[str, ...]]:
    """The text, and the names of its inputs. comment: what to say of each dropped term; folder: where the file goes (for paths
    of tables); name: of the model (its own)."""
    writer = _FlatWriter(scalar, part, comment, folder)
    text = writer.text(annotation, name or scalar.graph.model)
    return text, tuple(writer.inputs)


def flat_name(path: str) -> str:
    """A path or variable as one identifier."""
    return re.sub(r"[^A-Za-z0-9]+", "_", path).strip("_")


class _FlatWriter:
    def __init__(self, scalar: ScalarGraph, part: FlatPart, comment: Mapping[int, str], folder: Path | None):
        self.scalar, self.part, self.comment, self.folder = scalar, part, comment, folder
        self.graph = scalar.graph
        self.kinds = element_kinds(self.graph)
        self.elements = {element.name: element for element in self.graph.elements}
        self.taken: set[str] = {signal.name for signal in self.graph.signals if "." not in signal.name}
        self.taken |= {p.name for p in self.graph.parameters if "." not in p.name}
        self.names: dict[str, str] = {}
        self.inputs: dict[str, str] = {}
        self.parameters: dict[str, None] = {}
        self.tables: dict[str, None] = {}
        self.sources: set[str] = set()
        self.classes: list[str] = []
        self.held: dict[int | str, list[tuple[str, float]]] = {}
        for (reader, signal), held in part.frozen.items():
            self.held.setdefault(reader, []).append((signal, held))
        self.head: list[str] = []
        self.statements: list[str] = []
        self.junction_names = [self.name(j.name) for j in scalar.junctions]
        self.own = self.own_variables()
        self.parameter_of = {scalar: p for p in self.graph.parameters for scalar in p.scalars()}
        self.values = parameter_values(self.graph, part.changed)
        self.signal_of = {scalar: s for s in self.graph.signals for scalar in s.scalars()}

    def name(self, path: str) -> str:
        """The identifier of a thing, the same whenever it is asked for."""
        if path not in self.names:
            base = flat_name(path)
            unique, k = base, 2
            while unique in self.taken and unique != path:
                unique, k = f"{base}_{k}", k + 1
            self.taken.add(unique)
            self.names[path] = unique
        return self.names[path]

    # ------------------------------------------------------------------------------------------------------- variables

    def own_variables(self) -> dict[str, str]:
        """How the wanted part's variables are written: junctions, one-ports and signals."""
        own: dict[str, str] = {}
        for j in self.part.junctions:
            junction = self.scalar.junctions[j]
            own[junction.variable] = f"{self.junction_names[j]}.{'ef'[junction.kind]}"
        for term in self.one_port_terms():
            element = self.elements[term.element or ""]
            here = self.port_name(element, term)
            for letter in "efpq":
                own[element.ports[term.port].variable(element.name, letter, term.spot)] = self.port_variable(element, term, here, letter)
        for signal in self.graph.signals:
            whole = all(name in self.part.signals for name in signal.scalars())
            for name in signal.scalars():
                if name in self.part.signals:
                    suffix = name[len(signal.name) :]
                    own[name] = f"{self.name(signal.name)}{suffix}" if whole else self.name(name)
                    own[f"der({name})"] = f"der({own[name]})"
        return own

    def one_port_terms(self) -> Iterator[Term]:
        for term in self.scalar.terms:
            if term.other is None and term.junction in self.part.junctions and term.element not in self.part.gone:
                yield term

    def port_name(self, element: Element, term: Term) -> str:
        if element.kind == "field" or self.is_whole(element):
            return self.name(element.name)
        return self.name(f"{element.name}[{term.spot + 1}]" if element.ports[term.port].size is not None else element.name)

    def port_variable(self, element: Element, term: Term, here: str, letter: str) -> str:
        if element.kind == "field":
            return element.ports[term.port].variable(here, letter, term.spot)
        return f"{here}.{letter}[{term.spot + 1}]" if self.is_whole(element) else f"{here}.{letter}"

    def is_whole(self, element: Element) -> bool:
        """Must a vector element stay whole, since its components are tied together?"""
        if element.kind == "field":
            return False
        if element.ports[0].size is None:
            return False
        own = {element.ports[0].variable(element.name, x, i): i for x in "efpq" for i in range(element.ports[0].width)}
        return any(len({own[leaf.data] for leaf in leaves((law.left, law.right)) if leaf.data in own}) > 1 for law in element.laws)

    def read(self, *roots: Expr, readers: tuple[int | str, ...] = ()) -> tuple[str, ...]:
        """The texts of expressions in the new names; what is not there becomes an input. readers: who reads, as `frozen` knows it."""
        held = {var(signal): const(value) for reader in readers for signal, value in self.held.get(reader, ())}
        roots = substitute(roots, held) if held else roots
        roots = self.expanded(self.bound(roots))
        renamed: dict[Expr, Expr] = {}
        for node in topological(roots):
            if node.op == "var":
                renamed[node] = var(self.own.get(node.data) or self.input(node.data))
            elif node.op == "param":
                renamed[node] = var(self.parameter(node.data))
            elif node.op == "table":
                self.tables[node.data[0]] = None
        return tuple(to_text(root) for root in substitute(roots, renamed))

    def expanded(self, roots: tuple[Expr, ...]) -> tuple[Expr, ...]:
        """Aliases replaced by what they stand for."""
        while True:
            aliased = {
                leaf: self.scalar.aliases[leaf.data]
                for leaf in leaves(roots)
                if leaf.data not in self.own and leaf.data in self.scalar.aliases
            }
            if not aliased:
                return roots
            roots = substitute(roots, aliased)

    def bound(self, roots: tuple[Expr, ...]) -> tuple[Expr, ...]:
        """Parameters of elements replaced by what they are bound to: they stay parameters of the new elements."""
        while True:
            found: dict[Expr, Expr] = {}
            for leaf in leaves(roots, "param"):
                parameter = self.parameter_of[leaf.data]
                if parameter.name.rpartition(".")[0] in self.elements:
                    k = parameter.scalars().index(leaf.data)
                    changed = self.part.changed.get(leaf.data)
                    found[leaf] = parameter.values[k] if changed is None else const(changed)
            if not found:
                return roots
            roots = substitute(roots, found)

    def input(self, variable: str) -> str:
        if variable not in self.inputs:
            self.inputs[variable] = self.name(f"{variable}")
        return self.inputs[variable]

    def parameter(self, scalar: str) -> str:
        parameter = self.parameter_of[scalar]
        self.parameters[parameter.name] = None
        return self.name(parameter.name) + scalar[len(parameter.name) :]

    # ------------------------------------------------------------------------------------------------------- statements

    def write_junctions(self) -> None:
        for j in sorted(self.part.junctions):
            if any(t not in self.part.dropped for t in self.scalar.terms_at[j]):
                self.head.append(f"J{self.scalar.junctions[j].kind} {self.junction_names[j]};")

    def write_terms(self) -> None:
        whole: set[str] = set()
        for term in self.scalar.terms:
            if term.junction not in self.part.junctions:
                continue
            if term.other is None:
                self.write_one_port(term, whole)
            else:
                self.write_link(term, self.scalar.terms[term.other])

    def said(self, term: Term) -> None:
        if term.index in self.part.dropped and term.index in self.comment:
            self.statements.append(f"// {self.comment[term.index]}")

    def write_one_port(self, term: Term, whole: set[str]) -> None:
        self.said(term)
        element = self.elements[term.element or ""]
        if element.name in self.part.gone:
            return
        if element.kind == "field" and element.name not in whole:
            whole.add(element.name)
            self.write_field(element)
        here, junction = self.port_name(element, term), self.junction_names[term.junction]
        if element.kind == "field":
            port = element.ports[term.port]
            end = f"{here}.{port.name}" + (f"[{term.spot + 1}]" if port.size is not None else "")
        elif not self.is_whole(element):
            self.head.append(f"{element.kind} {here}({', '.join(self.law(element, term))}){_quoted(element.comment)};")
            end = here
        else:
            if element.name not in whole:
                whole.add(element.name)
                self.head.append(f"{element.kind}[{element.ports[0].width}] {here}({', '.join(self.matrix_law(element))});")
            end = f"{here}[{term.spot + 1}]"
        if term.index not in self.part.dropped:
            self.statements.append(f"{junction} -> {end};" if term.sign < 0 else f"{end} -> {junction};")
            return
        letter = "ef"[self.scalar.junctions[term.junction].kind]
        drive = self.name(f"{here}_drive")
        self.head.append(f"MS{letter} {drive}({letter} = {junction}.{letter});")
        if term.sign > 0:
            meeting = self.name(f"{here}_meeting")
            self.head.append(f"J{self.scalar.junctions[term.junction].kind} {meeting};")
            self.statements += [f"{end} -> {meeting};", f"{drive} -> {meeting};"]
        else:
            self.statements.append(f"{drive} -> {end};")

    def write_field(self, element: Element) -> None:
        """A user's element: its class, with what it reads as inputs and parameters, and the instance that binds them."""
        if any(term.element == element.name and term.junction not in self.part.junctions for term in self.scalar.terms):
            raise UnwritableError((), f"`{element.name}` would be cut in two")
        here = self.name(element.name)
        local = {
            port.variable(element.name, x, i): port.variable("", x, i)[1:]
            for port in element.ports
            for x in "ef"
            for i in range(port.width)
        }
        roots = self.bound(tuple(side for law in element.laws for side in (law.left, law.right)))
        bound: dict[Expr, Expr] = {}
        lines: list[str] = []
        arguments: list[str] = []
        for leaf in [node for node in topological(roots) if node.op in ("var", "param")]:
            if leaf.data in local:
                bound[leaf] = var(local[leaf.data])
                continue
            own = flat_name(leaf.data)
            bound[leaf] = var(own)
            lines.append(f"  {'parameter' if leaf.op == 'param' else 'input'} Real {own};")
            arguments.append(f"{own} = {self.read(leaf)[0]}")
        texts = [to_text(root) for root in substitute(roots, bound)]
        self.tables.update((node.data[0], None) for node in topological(roots) if node.op == "table")
        ports = [
            f"  port {'in' if port.inward else 'out'} Generic{'' if port.size is None else f'[{port.size}]'} {port.name};"
            for port in element.ports
        ]
        laws = [f"  {left} = {right};" for left, right in zip(texts[::2], texts[1::2], strict=True)]
        kind = f"{here}_element"
        self.classes.append("\n".join([f"element {kind}", *ports, *lines, "equation", *laws, f"end {kind};"]))
        self.head.append(f"{kind} {here}{f'({chr(44).join(arguments)})' if arguments else ''};")

    def law(self, element: Element, term: Term) -> list[str]:
        """The arguments of a scalar one-port: its law in its own letters, starts, flags."""
        port = element.ports[term.port]
        if element.linear is not None:
            parameter, rows = element.linear
            return [f"{parameter} = {self.read(rows[term.spot][term.spot])[0]}", *self.flags(element, term)]
        letters = {port.variable(element.name, letter, term.spot): letter for letter in "efpq"}
        own = {**self.own, **letters}
        law = next((law for law in element.laws if any(leaf.data in letters for leaf in leaves((law.left, law.right)))), None)
        if law is None or law.left.op != "var" or law.left.data not in letters:
            raise UnwritableError((term.index,), f"the law of `{element.name}` is not given for one variable")
        kept, self.own = self.own, own
        (right,) = self.read(law.right, readers=(term.index,))
        self.own = kept
        return [f"{letters[law.left.data]} = {right}", *self.flags(element, term)]

    def flags(self, element: Element, term: Term) -> Iterator[str]:
        """Starts, and whether it is parasitic."""
        for letter in "efpq":
            start = element.starts.get(element.ports[term.port].variable(element.name, letter, term.spot))
            if start is not None:
                yield f"{letter}(start = {self.short(start)})"
        if element.parasitic:
            yield "parasitic = true"

    def matrix_law(self, element: Element) -> list[str]:
        """The arguments of a vector one-port whose components are tied by a matrix."""
        if element.linear is None:
            raise UnwritableError((), f"the laws of `{element.name}` tie its components and are not linear")
        parameter, rows = element.linear
        matrix = "; ".join(", ".join(self.read(*row)) for row in rows)
        parts = [f"{parameter} = [{matrix}]"]
        port = element.ports[0]
        for letter in "efpq":
            names = [port.variable(element.name, letter, i) for i in range(port.width)]
            if any(name in element.starts for name in names):
                starts = [self.read(element.starts[name])[0] if name in element.starts else "0" for name in names]
                parts.append(f"{letter}(start = {{{', '.join(starts)}}})")
        return [*parts, "parasitic = true"] if element.parasitic else parts

    def write_link(self, term: Term, far: Term) -> None:
        """A bond or two-port: whole, or as a source at this end. (The other end writes its own.)"""
        dropped = self.part.dropped
        self.said(term)
        if term.index in dropped:
            return
        inside = far.junction in self.part.junctions
        if inside and far.index not in dropped:
            if term.modulus is not None and self.vanishes(term.modulus):
                self.write_source(term, far)
            elif term.index < far.index:
                self.write_two_way(term, far)
            return
        self.write_source(term, far)

    def write_two_way(self, term: Term, far: Term) -> None:
        tail, head = (term, far) if term.sign < 0 else (far, term)
        a, b = self.junction_names[tail.junction], self.junction_names[head.junction]
        if term.modulus is None:
            self.statements.append(f"{a} -> {b};")
            return
        kind = self.kinds[term.element or ""]
        first = min((term, far), key=lambda t: (t.port, t.spot)) if kind == "EJS" else min((term, far), key=lambda t: t.port)
        second = far if first is term else term
        assert first.modulus is not None
        (modulus,) = self.read(first.modulus, readers=(first.index, second.index))
        name = self.two_port_name(first)
        shown = {"TF": ("MTF", "m"), "MTF": ("MTF", "m")}.get(kind, ("MGY", "r"))
        self.head.append(f"{shown[0]} {name}({shown[1]} = {modulus});")
        a, b = self.junction_names[first.junction], self.junction_names[second.junction]
        self.statements.append(f"{a} -> {name} -> {b};")

    def vanishes(self, modulus: Expr) -> bool:
        """Is it zero for the parameters given? Then no transformer can be written, and the two terms stand as sources."""
        if any(node.op in ("var", "time") for node in topological((modulus,))):
            return False
        return evaluate(modulus, self.values, tables=self.graph.tables) == 0.0

    def two_port_name(self, term: Term) -> str:
        entry = f"[{term.entry[0] + 1},{term.entry[1] + 1}]" if term.entry is not None else ""
        return self.name(f"{term.element}{entry}")

    def write_source(self, term: Term, far: Term) -> None:
        """What is left of a link at the end where it still acts: a source that carries the far junction's variable."""
        kind, letter, value = imposed(self.scalar, self.kinds, term, far)
        conjugate = "ef"[1 - self.scalar.junctions[term.junction].kind]
        if letter == conjugate and term.sign < 0:
            value = -value
        (text,) = self.read(value, readers=(term.index, far.index))
        name = self.two_port_name(term) if term.modulus is not None else self.name(_bond_name(term))
        if name in self.sources:  # both ends of one bond are sources
            name = self.name(f"{name}_back")
        self.sources.add(name)
        self.head.append(f"{kind} {name}({letter} = {text});")
        self.statements.append(f"{name} -> {self.junction_names[term.junction]};")

    # ---------------------------------------------------------------------------------------------------------- signals

    def write_signals(self) -> list[str]:
        lines: list[str] = []
        for signal in self.graph.signals:
            mine = [name for name in signal.scalars() if name in self.part.signals]
            if not mine:
                continue
            whole = len(mine) == len(signal.scalars())
            prefix = "input " if signal.role == "input" else "output " if signal.output else ""
            if whole and signal.shape:
                dims = f"[{', '.join(map(str, signal.shape))}]"
                start = self.starts(signal, mine) if len(signal.shape) == 1 else []
                lines.append(
                    f"{prefix}Real {self.name(signal.name)}{dims}{_arguments(start, signal.unit, each=True)}{_quoted(signal.comment)};"
                )
            else:
                for name in mine:
                    start = self.starts(signal, [name])
                    own = "output " if name in self.part.outputs else prefix
                    lines.append(f"{own}Real {self.own[name]}{_arguments(start, signal.unit)}{_quoted(signal.comment)};")
        for equation in self.graph.equations:
            left = equation.left.data if equation.left.op == "var" else None
            target = left[4:-1] if left and left.startswith("der(") else left
            if target is None or target not in self.signal_of:
                raise UnwritableError((), "an equation that is not solved for a variable has no place in a part")
            if target in self.part.signals:
                assert left is not None
                (right,) = self.read(equation.right, readers=(left,))
                self.statements.append(f"{self.own[left]} = {right};")
        return lines

    def starts(self, signal: Signal, names: Sequence[str]) -> list[str]:
        if signal.starts is None:
            return []
        by_name = dict(zip(signal.scalars(), signal.starts, strict=True))
        texts = [self.short(by_name[name]) for name in names]
        return [f"start = {texts[0]}" if not signal.shape or len(names) < len(signal.scalars()) else f"start = {{{', '.join(texts)}}}"]

    def short(self, root: Expr) -> str:
        """An expression over parameters, as a number where it is long."""
        if _tree_size((root,)) <= LONGEST // 4:
            return self.read(root)[0]
        return _shown(evaluate(root, self.values, tables=self.graph.tables))

    # -------------------------------------------------------------------------------------------------------------- all

    def text(self, annotation: str, name: str) -> str:
        self.write_junctions()
        self.write_terms()
        signals = self.write_signals()
        initial = self.initial()
        given = {v: self.own[v] for v in self.part.outputs if v in self.own and self.own[v] != self.name(v)}
        outputs = [f"output Real {self.name(v)} = {text};" for v, text in given.items()]
        inputs = [f"input Real {text};" for text in self.inputs.values()]
        parameters = self.parameter_lines()
        experiments = [line for e in self.graph.experiments for line in self.experiment(e)]
        tables = [self.table(table) for table in self.tables]
        checks = self.checks()
        head = [annotation, *parameters, *tables, *inputs, *self.head, *signals, *outputs, *experiments]
        lines = [f"model {name}{_quoted(self.graph.comment)}", *(f"  {line}" for line in head), "equation"]
        lines += [f"  {line}" for line in (*self.statements, *checks)]
        if initial:
            lines += ["initial equation", *(f"  {line}" for line in initial)]
        classes = [f"\n{text}" for text in self.classes]
        return "\n".join([*lines, f"end {name};", *classes, ""])

    def initial(self) -> list[str]:
        lines = []
        for equation in self.graph.initial_equations:
            if all(self.is_own(leaf.data) for leaf in leaves(self.expanded((equation.left, equation.right)))):
                left, right = self.read(equation.left, equation.right)
                lines.append(f"{left} = {right};")
        return lines

    def checks(self) -> list[str]:
        lines = []
        for check in self.graph.checks:
            if all(self.is_own(leaf.data) for leaf in leaves(self.expanded((check.condition,)))):
                lines.append(f"assert({self.read(check.condition)[0]}, {_string(check.message)});")
        return lines

    def is_own(self, variable: str) -> bool:
        return variable in self.own

    def parameter_lines(self) -> list[str]:
        """The parameters that are read, and those that they read, in their order."""
        lines: dict[str, str] = {}
        done: set[str] = set()
        while pending := [name for name in self.parameters if name not in done]:
            for wanted in pending:
                done.add(wanted)
                parameter = next(p for p in self.graph.parameters if p.name == wanted)
                lines[wanted] = self.parameter_line(parameter)
        return [lines[p.name] for p in self.graph.parameters if p.name in lines]

    def parameter_line(self, parameter: Parameter) -> str:
        prefix = "constant" if parameter.constant else "parameter"
        type_name = "Integer" if parameter.integer else "Real"
        dims = f"[{', '.join(map(str, parameter.shape))}]" if parameter.shape else ""
        changed = [name in self.part.changed for name in parameter.scalars()]
        texts = [
            _shown(self.part.changed[name]) if new else self.short(value)
            for name, value, new in zip(parameter.scalars(), parameter.values, changed, strict=True)
        ]
        value = _nested(texts, parameter.shape)
        unit = _arguments([], parameter.unit, each=bool(dims))
        return f"{prefix} {type_name} {self.name(parameter.name)}{dims}{unit} = {value}{_quoted(parameter.comment)};"

    def table(self, name: str) -> str:
        span = self.graph.tables[name].span
        if span is None:
            raise UnwritableError((), f"where table `{name}` comes from is not known")
        text = span.text
        home = span.source.path.resolve().parent if span.source.path else None
        found = re.match(r'table\s*\(\s*"([^"]*)"', text)
        if found and home is not None and self.folder is not None and self.folder.resolve() != home:
            moved = Path(os.path.relpath(home / found.group(1), self.folder.resolve())).as_posix()
            text = text[: found.start(1)] + moved + text[found.end(1) :]
        return f"parameter Table {name} = {text};"

    def experiment(self, experiment: Experiment) -> Iterator[str]:
        settings = {"stopTime": experiment.stop_time, "interval": experiment.interval, "tolerance": experiment.tolerance}
        parts = [f"{name} = {_shown(value)}" for name, value in settings.items() if value is not None]
        if experiment.method is not None:
            parts.append(f'method = "{experiment.method}"')
        if experiment.window is not None:
            parts.append(f"window = {{{', '.join(map(_shown, experiment.window))}}}")
        for scalar, value in experiment.changes.items():
            if scalar in self.parameter_of and self.parameter_of[scalar].name in self.parameters:
                parts.append(f"{self.parameter(scalar)} = {self.read(value)[0]}")
        yield f"experiment {experiment.name}({', '.join(parts)}){_quoted(experiment.comment)};"


def imposed(scalar: ScalarGraph, kinds: Mapping[str, str], term: Term, far: Term) -> tuple[str, str, Expr]:
    """(class, letter, value) of the source that acts at `term`'s junction in the place of a link whose term `far` is gone."""
    junction = scalar.junctions[far.junction]
    variable = var(junction.variable)
    if term.modulus is None:
        letter = "ef"[junction.kind]
        return f"MS{letter}", letter, variable
    transformer = kinds[term.element or ""] in ("TF", "MTF")
    letter = "ef"[junction.kind] if transformer else "fe"[junction.kind]
    multiplies = (far.port == 0) == (junction.kind == 1) if transformer else junction.kind == 1
    return f"MS{letter}", letter, term.modulus * variable if multiplies else variable / term.modulus


def _bond_name(term: Term) -> str:
    return term.bond if term.component is None else f"{term.bond}[{term.component + 1}]"


def _tree_size(roots: Iterable[Expr]) -> int:
    sizes: dict[Expr, int] = {}
    total = 0
    for root in roots:
        for node in topological((root,)):
            sizes[node] = 1 + sum(sizes[arg] for arg in node.args)
        total += sizes[root]
    return total


def _shown(value: float) -> str:
    return str(int(value)) if value == int(value) and abs(value) < 1e15 else repr(float(value))


def _nested(texts: Sequence[str], shape: tuple[int, ...]) -> str:
    if not shape:
        return texts[0]
    if len(shape) == 1:
        return f"{{{', '.join(texts)}}}"
    step = len(texts) // shape[0]
    return f"{{{', '.join(_nested(texts[i * step : (i + 1) * step], shape[1:]) for i in range(shape[0]))}}}"


def _arguments(parts: Collection[str], unit: str, *, each: bool = False) -> str:
    shown = [*parts, *([f'{"each " if each else ""}unit = "{unit}"'] if unit else [])]
    return f"({', '.join(shown)})" if shown else ""


def _quoted(comment: str) -> str:
    return f" {_string(comment)}" if comment else ""


def _string(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
    return f'"{escaped}"'
