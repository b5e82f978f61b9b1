"""Units of parameters, efforts, flows and signals agree.

Input        BondGraph   with domains; parameters and signals carry the unit strings they were declared with
Output       BondGraph   the same with inferred units filled in: of parameters and signals, and of states by name
Establishes  in every sum, binding and element law the known units agree, in dimension and in scale
Reports      BG302 units that do not agree, BG303 one quantity on two scales, BG304 a function of something with a unit,
             BG305 unknown unit string (a warning)

Efforts and flows have one unit in a region (see `ir.regions`), known from its domain or found from what is declared around it.
Every element law says what the ratio of two such units is, so a union-find with ratios finds all that can be known in one go.
Unknown units are silent.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction

from bgdsl.diagnostics import Code, Reporter
from bgdsl.expr import Expr, leaves, param, to_text
from bgdsl.ir.change import changed
from bgdsl.ir.dimensions import JOULE, NUMBER, SECOND, SI, Unit, UnitError, agree, over, parse_unit, power, spell, times
from bgdsl.ir.domains import DOMAINS, Domain
from bgdsl.ir.elements import KINDS
from bgdsl.ir.graph import BondGraph, Element, Law, Origin, Parameter, SignalEquation
from bgdsl.ir.regions import joined_regions
from bgdsl.passes.unit_rules import PURE, Rules
from bgdsl.source import Span

UNLIKE = Code("BG302", "units that do not agree")
SCALE = Code("BG303", "one quantity in two units")
NO_NUMBER = Code("BG304", "a function of a quantity that has a unit")
UNKNOWN = Code("BG305", "unknown unit", "warning")

# What a linear law says: unit of the first letter's slot over that of the second = unit of the parameter x s^n.
_RATIOS: Mapping[str, tuple[str, str, int]] = {
    "I": ("e", "f", -1),
    "C": ("f", "e", -1),
    "k": ("e", "f", 1),
    "R": ("e", "f", 0),
    "G": ("f", "e", 0),
}
_ROUNDS = 4
"""How often signals and laws are gone through for more that can be inferred."""


def check_units(graph: BondGraph, report: Reporter) -> BondGraph:
    """The graph with inferred units; disagreements are reported. A graph that declares no unit is returned as it is."""
    if any(p.unit for p in graph.parameters) or any(s.unit for s in graph.signals):
        return _Check(graph, report).run()
    return graph


@dataclass(slots=True)
class Slots:
    """Quantities with unknown units whose ratios are known: union-find, each node with its unit over that of its root.

    Slot 0 is a pure number: what is joined to it is known.
    """

    parents: list[int]
    ratios: list[Unit]

    def find(self, slot: int) -> tuple[int, Unit]:
        """The root of a slot, and the slot's unit over the root's."""
        path = []
        while self.parents[slot] != slot:
            path.append(slot)
            slot = self.parents[slot]
        ratio = NUMBER
        for node in reversed(path):
            ratio = times(self.ratios[node], ratio)
            self.parents[node], self.ratios[node] = slot, ratio
        return slot, ratio

    def join(self, one: int, other: int, ratio: Unit) -> Unit | None:
        """State that unit(one) / unit(other) = ratio; the ratio that was known before, if any (then nothing changes)."""
        (a, over_a), (b, over_b) = self.find(one), self.find(other)
        if a == b:
            return over(over_a, over_b)
        step = over(times(ratio, over_b), over_a)
        if a == 0:
            self.parents[b], self.ratios[b] = a, over(NUMBER, step)
        else:
            self.parents[a], self.ratios[a] = b, step
        return None

    def ratio(self, one: int, other: int) -> Unit | None:
        """unit(one) / unit(other) if it is known."""
        (a, over_a), (b, over_b) = self.find(one), self.find(other)
        return over(over_a, over_b) if a == b else None

    def unit(self, slot: int) -> Unit | None:
        return self.ratio(slot, 0)


@dataclass(frozen=True, slots=True)
class _Relation:
    """unit(one) / unit(other) = unit(value) x s^seconds, as an element says."""

    one: int
    other: int
    seconds: int
    value: Expr
    element: Element
    what: str


@dataclass
class _Check:
    """One run of the pass. `places` is where a variable's effort and flow live: (first place, width) by node name."""

    graph: BondGraph
    report: Reporter
    seen: set[tuple[Span, str]] = field(default_factory=set)

    def __post_init__(self) -> None:
        graph = self.graph
        self.regions = joined_regions(graph)
        self.domains: dict[str, Domain] = {**DOMAINS, **{domain.name: domain for domain in graph.domains}}
        self.parameters: dict[str, tuple[Parameter, int]] = {
            name: (parameter, i) for parameter in graph.parameters for i, name in enumerate(parameter.scalars())
        }
        self.places = dict(self._places())
        count = 1 + 2 * self.regions.count
        self.signals = {name: count + i for i, name in enumerate(n for s in graph.signals for n in s.scalars())}
        count += len(self.signals)
        self.slots = Slots(list(range(count)), [NUMBER] * count)
        self.declared_by: dict[int, str] = {}
        self.rules = Rules(self._leaf)

    def run(self) -> BondGraph:
        self._anchor()
        relations = [relation for element in self.graph.elements for relation in self._relations(element)]
        waiting = [relation for relation in relations if not self._relate(relation)]
        self._infer(waiting)
        self._check(relations)
        return self._filled(relations)

    # ------------------------------------------------------------------------------------------------------------ slots

    def _places(self) -> Iterator[tuple[str, int]]:
        """First place of everything that has an effort and a flow, by the name before the letter."""
        graph, regions = self.graph, self.regions
        for bond in graph.bonds:
            for name in (bond.name, *bond.aliases):
                yield name, regions.at(bond.tail)[0]
        for junction in graph.junctions:
            yield junction.name, regions.place(junction.name)
        for element in graph.elements:
            for k, port in enumerate(element.ports):
                yield f"{element.name}.{port.name}" if port.name else element.name, regions.place(element.name, k)

    def _slot(self, place: int, letter: str) -> int:
        return 1 + 2 * self.regions.find(place) + (letter == "f")

    def _variable(self, name: str) -> tuple[int, int] | None:
        """Slot of a variable and the power of seconds on top of it (`p` and `q` are efforts and flows integrated)."""
        if name in self.signals:
            return self.signals[name], 0
        if name.startswith("der("):
            inner = self._variable(name[4:-1])
            return inner and (inner[0], inner[1] - 1)
        base, _, index = name.partition("[") if name.endswith("]") else (name, "", "")
        component = 0
        if index and index[:-1].isdigit():
            component = int(index[:-1]) - 1
        elif index:
            base = name  # the bracket belongs to an instance's name
        node, _, letter = base.rpartition(".")
        if node not in self.places or letter not in ("e", "f", "p", "q"):
            return None
        return self._slot(self.places[node] + component, "e" if letter in "ep" else "f"), int(letter in "pq")

    def _leaf(self, node: Expr) -> Unit | None:
        if node.op == "param":
            return self._parameter(node.data)
        if (at := self._variable(node.data)) is None:
            return JOULE if node.data.endswith(".energy") else None
        unit = self.slots.unit(at[0])
        return unit and times(unit, _seconds(at[1]))

    def _parameter(self, name: str) -> Unit | None:
        """The declared unit of a parameter, else that of what it is bound to. Chains of parameters are followed by loop."""
        if name not in self.parameters:
            return None
        chain: list[str] = []
        while True:
            parameter, i = self.parameters[name]
            value = parameter.values[i]
            if parameter.unit:
                return self._parsed(parameter.unit, parameter.origin)
            if value.op != "param" or value.data not in self.parameters or value.data in chain:
                break
            chain.append(name)
            name = value.data
        if value.is_const or value.op == "param":
            return None
        waiting = [leaf for leaf in leaves((value,), "param") if leaf not in self.rules.known]
        if any(self.parameters.get(leaf.data, (parameter, 0))[0].unit == "" for leaf in waiting):
            return self._bound(name)
        return _declared(self.rules.unit(value))

    def _bound(self, name: str) -> Unit | None:
        """As `_parameter`, for a binding that reads parameters without declared unit: those first, with an explicit stack."""
        known, stack = self.rules.known, [name]
        while stack:
            current = stack[-1]
            parameter, i = self.parameters[current]
            value = parameter.values[i]
            missing = [
                leaf.data for leaf in leaves((value,), "param")
                if leaf not in known and leaf.data in self.parameters and leaf.data not in stack and leaf.data != current
            ]  # fmt: skip
            if missing and not parameter.unit:
                stack += missing
                continue
            stack.pop()
            unit = self._parsed(parameter.unit, parameter.origin) if parameter.unit else _declared(self.rules.unit(value))
            known[param(current)] = unit
        return known[param(name)]

    def _parsed(self, text: str, origin: Origin) -> Unit | None:
        try:
            return parse_unit(text)
        except UnitError as error:
            key = (origin.span, "unit")
            if key not in self.seen:
                self.seen.add(key)
                self.report.add(
                    UNKNOWN,
                    f'unit "{text}" is not understood: {error}',
                    origin.span,
                    "declared here",
                    helps=('write it like "kg.m2", "N.s/m", "J/(kg.K)" or "1"',),
                )
            return None

    # -------------------------------------------------------------------------------------------------------- inference

    def _anchor(self) -> None:
        """What is known from the start: efforts and flows of known domains, signals with a declared unit."""
        for element in self.graph.elements:
            for k, port in enumerate(element.ports):
                if port.domain != "Generic":
                    for i in range(port.width):
                        self._anchor_place(self.regions.place(element.name, k, i), port.domain, element.origin)
        for junction in self.graph.junctions:
            if junction.domain != "Generic":
                for i in range(junction.size or 1):
                    self._anchor_place(self.regions.place(junction.name, 0, i), junction.domain, junction.origin)
        for signal in self.graph.signals:
            if signal.unit and (unit := self._parsed(signal.unit, signal.origin)):
                for name in signal.scalars():
                    self.slots.join(self.signals[name], 0, unit)

    def _anchor_place(self, place: int, name: str, origin: Origin) -> None:
        root = self.regions.find(place)
        if root in self.declared_by or name not in self.domains:
            return
        domain = self.domains[name]
        self.declared_by[root] = name
        for letter, text in (("e", domain.effort_unit), ("f", domain.flow_unit)):
            if text and (unit := self._parsed(text, Origin("", domain.span) if domain.span else origin)):
                self.slots.join(self._slot(root, letter), 0, unit)

    def _relations(self, element: Element) -> Iterator[_Relation]:
        """What the element's linear law or modulus says about the units around it."""
        place = self.regions.place(element.name, 0)
        if element.linear is not None:
            what, rows = element.linear
            one, other, seconds = _RATIOS[what]
            for i, j, value in _entries(rows):
                yield _Relation(self._slot(place + i, one), self._slot(place + j, other), seconds, value, element, what)
        elif element.modulus is not None and element.kind == "EJS":
            for i, j, value in _entries(element.modulus):
                yield _Relation(self._slot(place + i, "e"), self._slot(place + j, "f"), 0, value, element, "G")
        elif element.modulus is not None:
            second = self.regions.place(element.name, 1)
            through = KINDS[element.kind].rule == "through"
            what = ("m" if through else "r") if len(element.modulus) == len(element.modulus[0]) == 1 else ("T" if through else "G")
            for i, j, value in _entries(element.modulus):
                one, other = ("f", "f") if through else ("e", "f")
                yield _Relation(self._slot(second + i, one), self._slot(place + j, other), 0, value, element, what)
                one, other = ("e", "e") if through else ("e", "f")
                yield _Relation(self._slot(place + j, one), self._slot(second + i, other), 0, value, element, what)

    def _relate(self, relation: _Relation) -> bool:
        """Learn from a relation whose value has a known unit; False if it has none yet."""
        unit = self.rules.unit(relation.value)
        if unit is None or unit is PURE:
            return unit is PURE
        self.slots.join(relation.one, relation.other, times(unit, _seconds(relation.seconds)))
        return True

    def _statements(self) -> Iterator[Law | SignalEquation]:
        for element in self.graph.elements:
            if element.linear is None:
                yield from element.laws
        yield from self.graph.equations

    def _infer(self, waiting: list[_Relation]) -> None:
        """Learn units from laws and equations until nothing more comes of it."""
        statements = [s for s in self._statements() if any(self._unknown(side) for side in (s.left, s.right))]
        for _ in range(_ROUNDS):
            before = len(waiting), len(statements)
            self.rules = Rules(self._leaf)
            statements = [s for s in statements if not self._learn(s.left, s.right) and not self._learn(s.right, s.left)]
            waiting = [relation for relation in waiting if not self._relate(relation)]
            if before == (len(waiting), len(statements)):
                break
        self.rules = Rules(self._leaf)

    def _unknown(self, side: Expr) -> bool:
        return side.op == "var" and self._leaf(side) is None

    def _learn(self, left: Expr, right: Expr) -> bool:
        """Learn the unit of a variable that equals something known, or the ratio of two variables."""
        if left.op != "var" or (at := self._variable(left.data)) is None:
            return False
        unit = self.rules.unit(right)
        if unit is not None and unit is not PURE:
            self.slots.join(at[0], 0, times(unit, _seconds(-at[1])))
            return True
        bare = right.args[0] if right.op == "neg" else right
        if bare.op == "var" and (other := self._variable(bare.data)) is not None:
            self.slots.join(at[0], other[0], _seconds(other[1] - at[1]))
            return True
        return False

    # ---------------------------------------------------------------------------------------------------------- checking

    def _check(self, relations: list[_Relation]) -> None:
        for relation in relations:
            self._check_relation(relation)
        for statement in self._statements():
            self._compare(statement.left, statement.right, statement.origin)
        for equation in self.graph.initial_equations:
            self._compare(equation.left, equation.right, equation.origin)
        for check in self.graph.checks:
            self._unit(check.condition, check.origin)
        for parameter in self.graph.parameters:
            if parameter.unit:
                unit = self._parsed(parameter.unit, parameter.origin)
                for value in (*parameter.values, *(parameter.low or ()), *(parameter.high or ())):
                    if not value.is_const:
                        self._bind(parameter.name, unit, value, parameter.origin)
        for experiment in self.graph.experiments:
            for name, value in experiment.changes.items():
                if not value.is_const:
                    self._bind(name, self._parameter(name), value, experiment.origin)
        for element in self.graph.elements:
            for name, value in element.starts.items():
                self._start(name, value, element.origin)
        for signal in self.graph.signals:
            for name, value in zip(signal.scalars(), signal.starts or (), strict=False):
                self._start(name, value, signal.origin)

    def _start(self, name: str, value: Expr, origin: Origin) -> None:
        if not value.is_const and (at := self._variable(name)) is not None and (unit := self.slots.unit(at[0])):
            self._bind(f"the start of {name}", times(unit, _seconds(at[1])), value, origin)

    def _unit(self, value: Expr, origin: Origin) -> Unit | None:
        """The unit of an expression; what is wrong inside it is reported at `origin`."""

        def disagree(node: Expr, one: Expr, unit: Unit, other: Expr | None, second: Unit | None) -> None:
            if other is not None and second is not None:
                verb = "add" if node.op == "add" else "compare"
                self._unlike(f"cannot {verb} {self._named(one, unit)} and {self._named(other, second)}", unit, second, (one, other), origin)
            else:
                self._no_number(node, one, unit, origin)

        self.rules.disagree = disagree
        return _declared(self.rules.unit(value))

    def _compare(self, left: Expr, right: Expr, origin: Origin) -> None:
        one, other = self._unit(left, origin), self._unit(right, origin)
        if one is not None and other is not None and not agree(one, other):
            message = f"{self._named(left, one)} cannot equal {self._named(right, other)}"
            self._unlike(message, one, other, (left, right), origin)

    def _bind(self, name: str, wanted: Unit | None, value: Expr, origin: Origin) -> None:
        unit = self._unit(value, origin)
        if wanted is not None and unit is not None and not agree(wanted, unit):
            text = self._shown(param(name), wanted)
            message = f"`{name}` is in {text}, but {self._named(value, unit)} is given"
            self._unlike(message, wanted, unit, (value,), origin)

    def _check_relation(self, relation: _Relation) -> None:
        unit = self._unit(relation.value, relation.element.origin)
        if unit is None or (known := self.slots.ratio(relation.one, relation.other)) is None:
            return
        wanted = over(known, _seconds(relation.seconds))
        if not agree(wanted, unit):
            name = f"{relation.element.name}.{relation.what}"
            source = self._source_of(relation.value)
            message = f"`{name}` should be in {spell(wanted)}, but {self._named(source, unit)} is given"
            self._unlike(message, wanted, unit, (source,), relation.element.origin, self._reasons(relation))

    def _reasons(self, relation: _Relation) -> tuple[str, ...]:
        """Where the wanted unit comes from: the domains around the element, or what else is joined to its places."""
        return tuple(dict.fromkeys(self._around(slot) for slot in (relation.one, relation.other)))

    def _around(self, slot: int) -> str:
        root = (slot - 1) // 2
        if name := self.declared_by.get(root):
            domain = self.domains[name]
            return f"{name}: effort is {domain.effort} in {domain.effort_unit or '?'}, flow is {domain.flow} in {domain.flow_unit or '?'}"
        for element in self.graph.elements:
            for other in self._relations(element):
                unit = self.rules.unit(other.value)
                if slot in (other.one, other.other) and _declared(unit) is not None:
                    shown = self._named(self._source_of(other.value), unit or NUMBER)
                    return f"on the same junctions, `{element.name}` has {other.what} = {shown}"
        return "the unit follows from what is joined here"

    # --------------------------------------------------------------------------------------------------------- reporting

    def _unlike(self, message: str, one: Unit, other: Unit, values: tuple[Expr, ...], origin: Origin, notes: tuple[str, ...] = ()) -> None:
        if (origin.span, "") in self.seen:
            return
        self.seen.add((origin.span, ""))
        scale = one.exponents == other.exponents
        helps = (
            (f"1 {spell(other)} is {other.factor / one.factor:.10g} of the other",) if scale and not (one.offset or other.offset) else ()
        )
        if origin.path:
            notes = (*notes, f"in `{origin.path}`")
        labels = self._origins(values)
        self.report.add(SCALE if scale else UNLIKE, message, origin.span, "here", others=labels, notes=notes, helps=helps)

    def _no_number(self, node: Expr, arg: Expr, unit: Unit, origin: Origin) -> None:
        if (origin.span, "") in self.seen:
            return
        self.seen.add((origin.span, ""))
        role = "the exponent" if node.op == "pow" else f"the argument of {node.op}"
        self.report.add(
            NO_NUMBER,
            f"{role} should be a pure number, but it is {self._named(arg, unit)}",
            origin.span,
            "here",
            others=self._origins((arg,)),
            helps=("divide by a reference value with the same unit",) if not unit.dimensionless else ("angles count in rad",),
        )

    def _source_of(self, value: Expr) -> Expr:
        """What an element's own parameter was bound to, where it is bound to another one: that is what the user wrote."""
        while value.op == "param" and value.data in self.parameters:
            parameter, i = self.parameters[value.data]
            if parameter.unit or parameter.values[i].op == "const":
                break
            value = parameter.values[i]
        return value

    def _named(self, value: Expr, unit: Unit) -> str:
        text = to_text(value)
        return f"`{text if len(text) <= 60 else text[:57] + '...'}` in {self._shown(value, unit)}"

    def _shown(self, value: Expr, unit: Unit) -> str:
        """The unit as the user declared it, where there is a declaration."""
        if value.op == "param" and value.data in self.parameters and self.parameters[value.data][0].unit:
            return self.parameters[value.data][0].unit
        if value.op == "var":
            base = value.data.partition("[")[0]
            declared = next((s.unit for s in self.graph.signals if s.unit and s.name in (value.data, base)), "")
            return declared or spell(unit)
        return spell(unit)

    def _origins(self, values: tuple[Expr, ...]) -> list[tuple[Span, str]]:
        """Places that declare the units of the leaves: at most two a value."""
        found: dict[Span, str] = {}
        for value in values:
            for leaf in [*leaves((value,), "param"), *leaves((value,))][:2]:
                if leaf.op == "param" and leaf.data in self.parameters and (p := self.parameters[leaf.data][0]).unit:
                    found[p.origin.span] = f"`{leaf.data}` is in {p.unit}"
                elif leaf.op == "var" and leaf.data in self.signals and (unit := self._leaf(leaf)):
                    signal = next(s for s in self.graph.signals if leaf.data in s.scalars())
                    found[signal.origin.span] = f"`{leaf.data}` is in {self._shown(leaf, unit)}"
        return list(found.items())

    # ------------------------------------------------------------------------------------------------------------ output

    def _filled(self, relations: list[_Relation]) -> BondGraph:
        """The graph with the units that were found."""
        wanted: dict[str, Unit] = {}
        for relation in relations:
            if relation.value.op == "param" and (known := self.slots.ratio(relation.one, relation.other)) is not None:
                wanted[relation.value.data] = over(known, _seconds(relation.seconds))
        states = {name: unit for element in self.graph.elements for name in element.states if (unit := self._state(name))}
        return replace(
            self.graph,
            parameters=tuple(self._with_unit(parameter, wanted) for parameter in self.graph.parameters),
            signals=tuple(
                changed(signal, "unit", self._common(signal.scalars())) if not signal.unit else signal for signal in self.graph.signals
            ),
            units=states,
        )

    def _state(self, name: str) -> str:
        """The unit of a storage's state. Where only effort over flow is known around it, their product is taken for power; that
        is good enough to show, and nothing is checked with it."""
        at = self._variable(name)
        if at is None:
            return ""
        slot, seconds = at
        unit = self.slots.unit(slot)
        other = 1 + (slot - 1 ^ 1)
        if unit is None and (ratio := self.slots.ratio(slot, other)) is not None:
            square = times(ratio, SI["W"])
            unit = power(square, Fraction(1, 2)) if not any(x.numerator % 2 for x in square.exponents) else None
        if unit is None:
            return ""
        text = spell(times(unit, _seconds(seconds)))
        return "J" if text == "N.m" and slot % 2 == 0 else text  # a displacement that is an energy is heat, no torque

    def _with_unit(self, parameter: Parameter, wanted: Mapping[str, Unit]) -> Parameter:
        if parameter.unit:
            return parameter
        found = {wanted.get(name) or self._parameter(name) for name in parameter.scalars()}
        unit = found.pop() if len(found) == 1 else None
        return parameter if unit is None else changed(parameter, "unit", spell(unit))

    def _common(self, names: tuple[str, ...]) -> str:
        found = {self.slots.unit(self.signals[name]) for name in names}
        unit = found.pop() if len(found) == 1 else None
        return spell(unit) if unit is not None else ""


def _entries(rows: tuple[tuple[Expr, ...], ...]) -> Iterator[tuple[int, int, Expr]]:
    return ((i, j, value) for i, row in enumerate(rows) for j, value in enumerate(row) if not value.is_zero)


def _declared(unit: Unit | None) -> Unit | None:
    """A unit that says something: not that of a written number."""
    return None if unit is PURE else unit


_SECONDS: Mapping[int, Unit] = {exponent: power(SECOND, Fraction(exponent)) for exponent in range(-3, 4)}


def _seconds(exponent: int) -> Unit:
    return _SECONDS[exponent]
