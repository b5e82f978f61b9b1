"""Units of parameters, efforts, flows and signals agree.

Input        BondGraph   with domains; parameters and signals carry the unit strings they were declared with
Output       BondGraph   the same with inferred units filled in: of parameters and signals, and of states by name
Establishes  in every sum, binding and element law the known units agree, in dimension and in scale
Reports      BG302 units that do not agree, BG303 one quantity on two scales, BG304 a function of something with a unit

Unknown units are silent; what is known is found in `unit_facts`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction

from bgdsl.diagnostics import Code, Reporter
from bgdsl.expr import Expr, leaves, param, to_text
from bgdsl.ir.change import changed
from bgdsl.ir.dimensions import NUMBER, SI, Unit, agree, over, power, spell, times
from bgdsl.ir.graph import BondGraph, Origin, Parameter
from bgdsl.passes.unit_facts import Facts, Relation, declared, seconds_to
from bgdsl.source import Span

UNLIKE = Code("BG302", "units that do not agree")
SCALE = Code("BG303", "one quantity in two units")
NO_NUMBER = Code("BG304", "a function of a quantity that has a unit")


def check_units(graph: BondGraph, report: Reporter) -> BondGraph:
    """The graph with inferred units; disagreements are reported. A graph that declares no unit is returned as it is."""
    if any(p.unit for p in graph.parameters) or any(s.unit for s in graph.signals):
        return _Check(Facts(graph, report), report).run()
    return graph


@dataclass
class _Check:
    """One run of the pass over what is known."""

    facts: Facts
    report: Reporter
    seen: set[Span] = field(default_factory=set)

    @property
    def graph(self) -> BondGraph:
        return self.facts.graph

    def run(self) -> BondGraph:
        relations = self.facts.learn()
        self._check(relations)
        return self._filled(relations)

    # ---------------------------------------------------------------------------------------------------------- checking

    def _check(self, relations: list[Relation]) -> None:
        for relation in relations:
            self._check_relation(relation)
        for statement in self.facts.statements():
            self._compare(statement.left, statement.right, statement.origin)
        for equation in self.graph.initial_equations:
            self._compare(equation.left, equation.right, equation.origin)
        for check in self.graph.checks:
            self._unit(check.condition, check.origin)
        for parameter in self.graph.parameters:
            if parameter.unit:
                unit = self.facts.parsed(parameter.unit, parameter.origin)
                for value in (*parameter.values, *(parameter.low or ()), *(parameter.high or ())):
                    if not value.is_const:
                        self._bind(parameter.name, unit, value, parameter.origin)
        for experiment in self.graph.experiments:
            for name, value in experiment.changes.items():
                if not value.is_const:
                    self._bind(name, self.facts.parameter(name), value, experiment.origin)
        for element in self.graph.elements:
            for name, value in element.starts.items():
                self._start(name, value, element.origin)
        for signal in self.graph.signals:
            for name, value in zip(signal.scalars(), signal.starts or (), strict=False):
                self._start(name, value, signal.origin)

    def _start(self, name: str, value: Expr, origin: Origin) -> None:
        if not value.is_const and (at := self.facts.variable(name)) is not None and (unit := self.facts.slots.unit(at[0])):
            self._bind(f"the start of {name}", times(unit, seconds_to(at[1])), value, origin)

    def _unit(self, value: Expr, origin: Origin) -> Unit | None:
        """The unit of an expression; what is wrong inside it is reported at `origin`."""

        def disagree(node: Expr, one: Expr, unit: Unit, other: Expr | None, second: Unit | None) -> None:
            if other is not None and second is not None:
                verb = "add" if node.op == "add" else "compare"
                self._unlike(f"cannot {verb} {self._named(one, unit)} and {self._named(other, second)}", unit, second, (one, other), origin)
            else:
                self._no_number(node, one, unit, origin)

        self.facts.rules.disagree = disagree
        return declared(self.facts.rules.unit(value))

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

    def _check_relation(self, relation: Relation) -> None:
        unit = self._unit(relation.value, relation.element.origin)
        if unit is None or (known := self.facts.slots.ratio(relation.one, relation.other)) is None:
            return
        wanted = over(known, seconds_to(relation.seconds))
        if not agree(wanted, unit):
            name = f"{relation.element.name}.{relation.what}"
            source = self._source_of(relation.value)
            message = f"`{name}` should be in {spell(wanted)}, but {self._named(source, unit)} is given"
            self._unlike(message, wanted, unit, (source,), relation.element.origin, self._reasons(relation))

    def _reasons(self, relation: Relation) -> tuple[str, ...]:
        """Where the wanted unit comes from: the domains around the element, or what else is joined to its places."""
        return tuple(dict.fromkeys(self._around(slot) for slot in (relation.one, relation.other)))

    def _around(self, slot: int) -> str:
        root = (slot - 1) // 2
        if name := self.facts.declared_by.get(root):
            domain = self.facts.domains[name]
            return f"{name}: effort is {domain.effort} in {domain.effort_unit or '?'}, flow is {domain.flow} in {domain.flow_unit or '?'}"
        for element in self.graph.elements:
            for other in self.facts.relations(element):
                unit = self.facts.rules.unit(other.value)
                if slot in (other.one, other.other) and declared(unit) is not None:
                    shown = self._named(self._source_of(other.value), unit or NUMBER)
                    return f"on the same junctions, `{element.name}` has {other.what} = {shown}"
        return "the unit follows from what is joined here"

    # --------------------------------------------------------------------------------------------------------- reporting

    def _unlike(self, message: str, one: Unit, other: Unit, values: tuple[Expr, ...], origin: Origin, notes: tuple[str, ...] = ()) -> None:
        if origin.span in self.seen:
            return
        self.seen.add(origin.span)
        scale = one.exponents == other.exponents
        helps = (self._converted(one, other, values),) if scale and not (one.offset or other.offset) else ()
        if origin.path:
            notes = (*notes, f"in `{origin.path}`")
        labels = self._origins(values)
        self.report.add(SCALE if scale else UNLIKE, message, origin.span, "here", others=labels, notes=notes, helps=helps)

    def _converted(self, one: Unit, other: Unit, values: tuple[Expr, ...]) -> str:
        """How many of the one unit the other is; `values` are of both, or of the other alone."""
        wanted = self._shown(values[0], one) if len(values) > 1 else spell(one)
        given = self._shown(values[-1], other)
        factor = "times " if wanted[0].isdigit() else ""
        return f"{'' if given[0].isdigit() else '1 '}{given} is {other.factor / one.factor:.10g} {factor}{wanted}"

    def _no_number(self, node: Expr, arg: Expr, unit: Unit, origin: Origin) -> None:
        if origin.span in self.seen:
            return
        self.seen.add(origin.span)
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
        while value.op == "param" and value.data in self.facts.parameters:
            parameter, i = self.facts.parameters[value.data]
            if parameter.unit or parameter.values[i].op == "const":
                break
            value = parameter.values[i]
        return value

    def _named(self, value: Expr, unit: Unit) -> str:
        text = to_text(value)
        return f"`{text if len(text) <= 60 else text[:57] + '...'}` in {self._shown(value, unit)}"

    def _shown(self, value: Expr, unit: Unit) -> str:
        """The unit as the user declared it, where there is a declaration."""
        if value.op == "param" and value.data in self.facts.parameters and self.facts.parameters[value.data][0].unit:
            return self.facts.parameters[value.data][0].unit
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
                if leaf.op == "param" and leaf.data in self.facts.parameters and (p := self.facts.parameters[leaf.data][0]).unit:
                    found[p.origin.span] = f"`{leaf.data}` is in {p.unit}"
                elif leaf.op == "var" and leaf.data in self.facts.signals and (unit := self.facts.leaf(leaf)):
                    signal = next(s for s in self.graph.signals if leaf.data in s.scalars())
                    found[signal.origin.span] = f"`{leaf.data}` is in {self._shown(leaf, unit)}"
        return list(found.items())

    # ------------------------------------------------------------------------------------------------------------ output

    def _filled(self, relations: list[Relation]) -> BondGraph:
        """The graph with the units that were found."""
        wanted: dict[str, Unit] = {}
        for relation in relations:
            if relation.value.op == "param" and (known := self.facts.slots.ratio(relation.one, relation.other)) is not None:
                wanted[relation.value.data] = over(known, seconds_to(relation.seconds))
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
        at = self.facts.variable(name)
        if at is None:
            return ""
        slot, seconds = at
        unit = self.facts.slots.unit(slot)
        other = 1 + (slot - 1 ^ 1)
        if unit is None and (ratio := self.facts.slots.ratio(slot, other)) is not None:
            square = times(ratio, SI["W"])
            unit = power(square, Fraction(1, 2)) if not any(x.numerator % 2 for x in square.exponents) else None
        if unit is None:
            return ""
        text = spell(times(unit, seconds_to(seconds)))
        return "J" if text == "N.m" and slot % 2 == 0 else text  # a displacement that is an energy is heat, no torque

    def _with_unit(self, parameter: Parameter, wanted: Mapping[str, Unit]) -> Parameter:
        if parameter.unit:
            return parameter
        found = {wanted.get(name) or self.facts.parameter(name) for name in parameter.scalars()}
        unit = found.pop() if len(found) == 1 else None
        return parameter if unit is None else changed(parameter, "unit", spell(unit))

    def _common(self, names: tuple[str, ...]) -> str:
        found = {self.facts.slots.unit(self.facts.signals[name]) for name in names}
        unit = found.pop() if len(found) == 1 else None
        return spell(unit) if unit is not None else ""
