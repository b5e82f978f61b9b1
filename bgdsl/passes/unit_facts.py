"""What is known about the units of a model: of places, signals and parameters, declared or found.

Efforts and flows have one unit in a region (see `ir.regions`). Every element law says what the ratio of two such units is, so a
union-find with ratios finds all that can be known in one go.
Reports      BG305 unknown unit string (a warning)
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from fractions import Fraction

from bgdsl.diagnostics import Code, Reporter
from bgdsl.expr import Expr, leaves, param
from bgdsl.ir.dimensions import JOULE, NUMBER, SECOND, Unit, UnitError, over, parse_unit, power, times
from bgdsl.ir.domains import DOMAINS, Domain
from bgdsl.ir.elements import KINDS
from bgdsl.ir.graph import BondGraph, Element, Law, Origin, Parameter, SignalEquation
from bgdsl.ir.regions import joined_regions
from bgdsl.passes.unit_rules import PURE, Rules
from bgdsl.source import Span

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
class Relation:
    """unit(one) / unit(other) = unit(value) x s^seconds, as an element says."""

    one: int
    other: int
    seconds: int
    value: Expr
    element: Element
    what: str


@dataclass
class Facts:
    """`places`: where a variable's effort and flow live, by the name before its letter. `slots`: region r has its effort at slot 1 + 2 r
    and its flow behind it; signals follow."""

    graph: BondGraph
    report: Reporter
    seen: set[Span] = field(default_factory=set)

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
        self.rules = Rules(self.leaf)

    def learn(self) -> list[Relation]:
        """Find out all that can be known; what the elements' linear laws and moduli say, to be checked against it."""
        self._anchor()
        relations = [relation for element in self.graph.elements for relation in self.relations(element)]
        waiting = [relation for relation in relations if not self._relate(relation)]
        self._infer(waiting)
        return relations

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

    def variable(self, name: str) -> tuple[int, int] | None:
        """Slot of a variable and the power of seconds on top of it (`p` and `q` are efforts and flows integrated)."""
        if name in self.signals:
            return self.signals[name], 0
        if name.startswith("der("):
            inner = self.variable(name[4:-1])
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

    def leaf(self, node: Expr) -> Unit | None:
        if node.op == "param":
            return self.parameter(node.data)
        if (at := self.variable(node.data)) is None:
            return JOULE if node.data.endswith(".energy") else None
        unit = self.slots.unit(at[0])
        return unit and times(unit, seconds_to(at[1]))

    def parameter(self, name: str) -> Unit | None:
        """The declared unit of a parameter, else that of what it is bound to. Chains of parameters are followed by loop."""
        if name not in self.parameters:
            return None
        chain: list[str] = []
        while True:
            parameter, i = self.parameters[name]
            value = parameter.values[i]
            if parameter.unit:
                return self.parsed(parameter.unit, parameter.origin)
            if value.op != "param" or value.data not in self.parameters or value.data in chain:
                break
            chain.append(name)
            name = value.data
        if value.is_const or value.op == "param":
            return None
        waiting = [leaf for leaf in leaves((value,), "param") if leaf not in self.rules.known]
        if any(self.parameters.get(leaf.data, (parameter, 0))[0].unit == "" for leaf in waiting):
            return self._bound(name)
        return declared(self.rules.unit(value))

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
            unit = self.parsed(parameter.unit, parameter.origin) if parameter.unit else declared(self.rules.unit(value))
            known[param(current)] = unit
        return known[param(name)]

    def parsed(self, text: str, origin: Origin) -> Unit | None:
        try:
            return parse_unit(text)
        except UnitError as error:
            if origin.span not in self.seen:
                self.seen.add(origin.span)
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
            if signal.unit and (unit := self.parsed(signal.unit, signal.origin)):
                for name in signal.scalars():
                    self.slots.join(self.signals[name], 0, unit)

    def _anchor_place(self, place: int, name: str, origin: Origin) -> None:
        root = self.regions.find(place)
        if root in self.declared_by or name not in self.domains:
            return
        domain = self.domains[name]
        self.declared_by[root] = name
        for letter, text in (("e", domain.effort_unit), ("f", domain.flow_unit)):
            if text and (unit := self.parsed(text, Origin("", domain.span) if domain.span else origin)):
                self.slots.join(self._slot(root, letter), 0, unit)

    def relations(self, element: Element) -> Iterator[Relation]:
        """What the element's linear law or modulus says about the units around it."""
        place = self.regions.place(element.name, 0)
        if element.linear is not None:
            what, rows = element.linear
            one, other, seconds = _RATIOS[what]
            for i, j, value in _entries(rows):
                yield Relation(self._slot(place + i, one), self._slot(place + j, other), seconds, value, element, what)
        elif element.modulus is not None and element.kind == "EJS":
            for i, j, value in _entries(element.modulus):
                yield Relation(self._slot(place + i, "e"), self._slot(place + j, "f"), 0, value, element, "G")
        elif element.modulus is not None:
            second = self.regions.place(element.name, 1)
            through = KINDS[element.kind].rule == "through"
            what = ("m" if through else "r") if len(element.modulus) == len(element.modulus[0]) == 1 else ("T" if through else "G")
            for i, j, value in _entries(element.modulus):
                one, other = ("f", "f") if through else ("e", "f")
                yield Relation(self._slot(second + i, one), self._slot(place + j, other), 0, value, element, what)
                one, other = ("e", "e") if through else ("e", "f")
                yield Relation(self._slot(place + j, one), self._slot(second + i, other), 0, value, element, what)

    def _relate(self, relation: Relation) -> bool:
        """Learn from a relation whose value has a known unit; False if it has none yet."""
        unit = self.rules.unit(relation.value)
        if unit is None or unit is PURE:
            return unit is PURE
        self.slots.join(relation.one, relation.other, times(unit, seconds_to(relation.seconds)))
        return True

    def statements(self) -> Iterator[Law | SignalEquation]:
        for element in self.graph.elements:
            if element.linear is None:
                yield from element.laws
        yield from self.graph.equations

    def _infer(self, waiting: list[Relation]) -> None:
        """Learn units from laws and equations until nothing more comes of it."""
        statements = [s for s in self.statements() if any(self._unknown(side) for side in (s.left, s.right))]
        for _ in range(_ROUNDS):
            before = len(waiting), len(statements)
            self.rules = Rules(self.leaf)
            statements = [s for s in statements if not self._learn(s.left, s.right) and not self._learn(s.right, s.left)]
            waiting = [relation for relation in waiting if not self._relate(relation)]
            if before == (len(waiting), len(statements)):
                break
        self.rules = Rules(self.leaf)

    def _unknown(self, side: Expr) -> bool:
        return side.op == "var" and self.leaf(side) is None

    def _learn(self, left: Expr, right: Expr) -> bool:
        """Learn the unit of a variable that equals something known, or the ratio of two variables."""
        if left.op != "var" or (at := self.variable(left.data)) is None:
            return False
        unit = self.rules.unit(right)
        if unit is not None and unit is not PURE:
            self.slots.join(at[0], 0, times(unit, seconds_to(-at[1])))
            return True
        bare = right.args[0] if right.op == "neg" else right
        if bare.op == "var" and (other := self.variable(bare.data)) is not None:
            self.slots.join(at[0], other[0], seconds_to(other[1] - at[1]))
            return True
        return False


def _entries(rows: tuple[tuple[Expr, ...], ...]) -> Iterator[tuple[int, int, Expr]]:
    return ((i, j, value) for i, row in enumerate(rows) for j, value in enumerate(row) if not value.is_zero)


def declared(unit: Unit | None) -> Unit | None:
    """A unit that says something: not that of a written number."""
    return None if unit is PURE else unit


_SECONDS: Mapping[int, Unit] = {exponent: power(SECOND, Fraction(exponent)) for exponent in range(-3, 4)}


def seconds_to(exponent: int) -> Unit:
    """The unit s^exponent."""
    return _SECONDS[exponent]
