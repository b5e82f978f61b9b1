"""Small bond graphs made in Python, for tests of the passes behind flattening.

    g = GraphBuilder("Lever")
    g.junction("vA", 1)
    g.storage("massA", "I", 100.0, start=("f", 1.0))
    g.bond("vA", "massA")
    graph = g.build()

Everything gets a line of its own in a made-up source, so that messages have places to show.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Literal

from bgdsl.expr import ZERO, Expr, const, param, var
from bgdsl.ir.elements import KINDS, component
from bgdsl.ir.graph import Bond, BondGraph, Element, End, Instance, Junction, Law, Origin, Parameter, Port, Signal, SignalEquation
from bgdsl.source import Source, Span

Modulus = Sequence[Sequence[Expr | float]]


def _expr(value: Expr | float) -> Expr:
    return value if isinstance(value, Expr) else const(value)


class GraphBuilder:
    """Collects junctions, elements, bonds, parameters and signals; `build` gives the BondGraph, verified.

    A number given for a parameter of an element becomes the flat parameter `element.parameter` with that default.
    """

    def __init__(self, name: str = "Test"):
        self.name = name
        self.lines: list[str] = []
        self.junctions: list[Junction] = []
        self.elements: list[Element] = []
        self.bonds: list[Bond] = []
        self.parameters: list[Parameter] = []
        self.signals: list[Signal] = []
        self.equations: list[SignalEquation] = []
        self.places: dict[int, int] = {}

    # ------------------------------------------------------------------------------------------------------ declarations

    def origin(self, text: str) -> Origin:
        """The next line of the made-up source."""
        start = sum(len(line) + 1 for line in self.lines)
        self.lines.append(text)
        return Origin("", Span(_PENDING, start, start + len(text)))

    def parameter(self, name: str, value: Expr | float, *, constant: bool = False) -> Expr:
        """A scalar parameter; its leaf is returned."""
        origin = self.origin(f"parameter Real {name} = ...;")
        self.parameters.append(Parameter(name, (), (_expr(value),), origin, constant=constant))
        return param(name)

    def junction(self, name: str, kind: Literal[0, 1], size: int | None = None) -> str:
        shape = f"[{size}]" if size is not None else ""
        self.junctions.append(Junction(name, kind, size, self.origin(f"J{kind}{shape} {name};")))
        return name

    def source(self, name: str, kind: str, *values: Expr | float, size: int | None = None) -> str:
        """Se, Sf, MSe or MSf with the given value of each component (missing ones are 0)."""
        letter = KINDS[kind].parameters[0]
        port = Port("", size, inward=False)
        origin = self.origin(f"{kind} {name}({letter} = ...);")
        laws = tuple(
            Law(var(port.variable(name, letter, i)), self._value(name, letter, i, size, values), origin) for i in range(port.width)
        )
        return self._element(Element(name, kind, (port,), origin, laws))

    def _value(self, name: str, letter: str, i: int, size: int | None, values: Sequence[Expr | float]) -> Expr:
        value = values[i] if i < len(values) else 0.0
        if isinstance(value, Expr):
            return value
        return self._hidden(component(f"{name}.{letter}", None if size is None else i), value)

    def _hidden(self, name: str, value: float) -> Expr:
        """A parameter that stands on its element's line."""
        self.parameters.append(Parameter(name, (), (const(value),), Origin("", Span(_PENDING, 0, 0))))
        return param(name)

    def storage(
        self, name: str, kind: Literal["I", "C"], *values: float, size: int | None = None, start: tuple[str, float] | None = None
    ) -> str:
        """I or C with f_i = p_i / I_i or e_i = q_i / C_i; `start` is for component 1."""
        state, out = ("p", "f") if kind == "I" else ("q", "e")
        port = Port("", size, inward=True)
        origin = self.origin(f"{kind} {name}({kind} = ...);")
        states = tuple(port.variable(name, state, i) for i in range(port.width))
        scale = [
            self._hidden(component(f"{name}.{kind}", None if size is None else i), values[min(i, len(values) - 1)])
            for i in range(port.width)
        ]
        laws = tuple(Law(var(port.variable(name, out, i)), var(states[i]) / scale[i], origin) for i in range(port.width))
        starts = {} if start is None else {port.variable(name, start[0], 0): const(start[1])}
        rows = tuple(tuple(scale[i] if i == j else ZERO for j in range(port.width)) for i in range(port.width))
        return self._element(Element(name, kind, (port,), origin, laws, None, (kind, rows), states, starts))

    def resistor(self, name: str, *values: float, size: int | None = None, conductance: bool = False) -> str:
        """R with e_i = R_i f_i, or with `conductance` f_i = G_i e_i."""
        port = Port("", size, inward=True)
        letter, left, right = ("G", "f", "e") if conductance else ("R", "e", "f")
        origin = self.origin(f"R {name}({letter} = ...);")
        scale = [
            self._hidden(component(f"{name}.{letter}", None if size is None else i), values[min(i, len(values) - 1)])
            for i in range(port.width)
        ]
        laws = tuple(
            Law(var(port.variable(name, left, i)), scale[i] * var(port.variable(name, right, i)), origin) for i in range(port.width)
        )
        rows = tuple(tuple(scale[i] if i == j else ZERO for j in range(port.width)) for i in range(port.width))
        return self._element(Element(name, "R", (port,), origin, laws, None, (letter, rows)))

    def two_port(self, name: str, kind: str, modulus: Expr | float | Modulus) -> str:
        """TF, MTF, GY or MGY; a number or expression is a scalar one, rows make a matrix one."""
        letter = "m" if "TF" in kind else "r"
        origin = self.origin(f"{kind} {name}({letter} = ...);")
        if isinstance(modulus, (int, float, Expr)):
            value = modulus if isinstance(modulus, Expr) else self._hidden(f"{name}.{letter}", float(modulus))
            rows, sizes = ((value,),), (None, None)
        else:
            rows = tuple(tuple(_expr(value) for value in row) for row in modulus)  # type: ignore[assignment]
            sizes = (len(rows[0]), len(rows))  # type: ignore[assignment]
        ports = (Port("p1", sizes[0], inward=True), Port("p2", sizes[1], inward=False))
        return self._element(Element(name, kind, ports, origin, (), rows))

    def euler(self, name: str, matrix: Modulus) -> str:
        """An Euler junction structure e = G f."""
        rows = tuple(tuple(_expr(value) for value in row) for row in matrix)
        return self._element(
            Element(name, "EJS", (Port("", len(rows), inward=True),), self.origin(f"EJS[{len(rows)}] {name}(G = ...);"), (), rows)
        )

    def field(self, name: str, ports: Sequence[tuple[str, bool]], laws: Sequence[tuple[Expr, Expr]]) -> str:
        """A user element with scalar ports (name, inward) and laws (left, right)."""
        origin = self.origin(f"Field {name};")
        made = tuple(Port(port, None, inward) for port, inward in ports)
        return self._element(Element(name, "field", made, origin, tuple(Law(left, right, origin) for left, right in laws)))

    def _element(self, element: Element) -> str:
        self.elements.append(element)
        return element.name

    def signal(self, name: str, value: Expr | None = None, *, rate: Expr | None = None, start: float = 0.0) -> Expr:
        """A scalar signal given by an equation (`value`), by its derivative (`rate`), or, with neither, an input."""
        role: Literal["state", "algebraic", "input"] = "state" if rate is not None else "algebraic" if value is not None else "input"
        origin = self.origin(f"Real {name};")
        self.signals.append(Signal(name, (), role, origin, (const(start),)))
        if rate is not None:
            self.equations.append(SignalEquation(var(f"der({name})"), rate, origin))
        if value is not None:
            self.equations.append(SignalEquation(var(name), value, origin))
        return var(name)

    # -------------------------------------------------------------------------------------------------------------- bonds

    def bond(
        self,
        tail: str,
        head: str,
        *,
        name: str | None = None,
        stroke: Literal["tail", "head"] | None = None,
        at_tail: Sequence[int] | None = None,
        at_head: Sequence[int] | None = None,
    ) -> str:
        """Bond two nodes: `j`, `element`, `two_port` (port 1 as a head, port 2 as a tail) or `field.port`.

        `at_tail`, `at_head` choose components, from 0; the bond is a vector bond if either end is a vector and more than one is joined,
        or if the whole of a vector end is.
        """
        from_node, from_port, from_size = self._end(tail, True)
        to_node, to_port, to_size = self._end(head, False)
        tails = tuple(at_tail if at_tail is not None else range(from_size or 1))
        heads = tuple(at_head if at_head is not None else range(to_size or 1))
        assert len(tails) == len(heads), f"{tail} and {head} differ in width"
        scalar = len(tails) == 1 and (from_size is None or at_tail is not None) and (to_size is None or at_head is not None)
        label = name or self._free_name(f"{from_node}_{to_node}")
        arrow = {None: "->", "head": "->|", "tail": "|->"}[stroke]
        origin = self.origin(f"{label}: {tail} {arrow} {head};")
        size = None if scalar else len(tails)
        self.bonds.append(Bond(label, End(from_node, from_port, tails), End(to_node, to_port, heads), size, (origin,), (), stroke))
        return label

    def bonds_from(self, tail: str, *heads: str) -> None:
        """A fan: one bond to each head."""
        for head in heads:
            self.bond(tail, head)

    def chain(self, *nodes: str) -> None:
        """Bonds one after another: `chain("vA", "lever", "F2")`."""
        for tail, head in pairwise(nodes):
            self.bond(tail, head)

    def _free_name(self, base: str) -> str:
        taken = {bond.name for bond in self.bonds}
        name, n = base, 2
        while name in taken:
            name, n = f"{base}_{n}", n + 1
        return name

    def _end(self, text: str, tail: bool) -> tuple[str, int, int | None]:
        for junction in self.junctions:
            if junction.name == text:
                return text, 0, junction.size
        for element in self.elements:
            if element.name == text:
                k = 1 if tail and len(element.ports) == 2 and element.kind != "field" else 0
                return text, k, element.ports[k].size
            for k, port in enumerate(element.ports):
                if port.name and f"{element.name}.{port.name}" == text:
                    return element.name, k, port.size
        raise AssertionError(f"no node {text}")

    def build(self) -> BondGraph:
        source = Source(f"{self.name}.bg", "\n".join(self.lines))

        def placed(origin: Origin) -> Origin:
            return Origin(origin.path, Span(source, origin.span.start, origin.span.end))

        graph = BondGraph(
            model=self.name,
            comment="",
            sources=(source,),
            instances=(Instance("", self.name, Span(source, 0, 0), None),),
            junctions=tuple(replace(j, origin=placed(j.origin)) for j in self.junctions),
            elements=tuple(
                replace(e, origin=placed(e.origin), laws=tuple(replace(law, origin=placed(law.origin)) for law in e.laws))
                for e in self.elements
            ),
            bonds=tuple(replace(b, origins=tuple(placed(o) for o in b.origins)) for b in self.bonds),
            parameters=tuple(replace(p, origin=placed(p.origin)) for p in self.parameters),
            signals=tuple(replace(s, origin=placed(s.origin)) for s in self.signals),
            equations=tuple(replace(q, origin=placed(q.origin)) for q in self.equations),
        )
        graph.verify()
        return graph


_PENDING = Source("pending", "")
