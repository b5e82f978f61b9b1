"""Random well-formed bond graphs: Hypothesis strategies for sketches, and sketches as flat graphs and as `.bg` text.

A `Sketch` says what is joined to what; every scalar bond graph of the language's linear elements can be said. `graph_of` makes
the BondGraph, `source_of` the text of a model that flattens to the same graph, `dual` exchanges effort and flow.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

from hypothesis import strategies as st

from bgdsl.expr import Expr, param, unary, var
from bgdsl.ir.graph import BondGraph
from bgdsl.testing.graphs import GraphBuilder

ElementKind = Literal["I", "C", "R", "Se", "Sf"]
LinkKind = Literal["bond", "TF", "GY", "MTF", "MGY"]
DUAL: dict[ElementKind, ElementKind] = {"I": "C", "C": "I", "R": "R", "Se": "Sf", "Sf": "Se"}


@dataclass(frozen=True, slots=True)
class OnePort:
    """An element with its value at junction `at`; `inverse`: an R given as a conductance."""

    name: str
    kind: ElementKind
    at: int
    value: float
    inverse: bool = False


@dataclass(frozen=True, slots=True)
class Link:
    """A bond or two-port from junction `tail` to junction `head`; the modulus of MTF and MGY is value * cos(phi)."""

    name: str
    kind: LinkKind
    tail: int
    head: int
    value: float


@dataclass(frozen=True, slots=True)
class Sketch:
    """Junction kinds, one-ports, links. `size` None is scalar, n makes every junction and element a vector of n."""

    junctions: tuple[Literal[0, 1], ...]
    ports: tuple[OnePort, ...]
    links: tuple[Link, ...]
    size: int | None = None

    @property
    def modulated(self) -> bool:
        return any(link.kind in ("MTF", "MGY") for link in self.links)


def _common(sketch: Sketch, j: int) -> str:
    return f"j{j}.{'ef'[sketch.junctions[j]]}" + ("" if sketch.size is None else "[1]")


def graph_of(sketch: Sketch) -> BondGraph:
    """The sketch as a flat graph. Vector two-ports are diagonal."""
    g, n = GraphBuilder("Sketch"), sketch.size
    for j, kind in enumerate(sketch.junctions):
        g.junction(f"j{j}", kind, n)
    if sketch.modulated:
        g.signal("phi", rate=var(_common(sketch, 0)), start=0.4)
    for port in sketch.ports:
        _add_port(g, port, n)
    for link in sketch.links:
        if link.kind == "bond":
            g.bond(f"j{link.tail}", f"j{link.head}", name=link.name)
        else:
            g.two_port(link.name, link.kind, _modulus(g, link, n))
            g.bond(f"j{link.tail}", link.name, name=f"j{link.tail}_{link.name}")
            g.bond(link.name, f"j{link.head}", name=f"{link.name}_j{link.head}")
    for port in sketch.ports:
        source = port.kind in ("Se", "Sf")
        ends = (port.name, f"j{port.at}") if source else (f"j{port.at}", port.name)
        g.bond(*ends)
    return g.build()


def _add_port(g: GraphBuilder, port: OnePort, n: int | None) -> None:
    values = (port.value,) * (n or 1)
    match port.kind:
        case "I" | "C":
            g.storage(port.name, port.kind, *values, size=n)
        case "R":
            g.resistor(port.name, *values, size=n, conductance=port.inverse)
        case _:
            g.source(port.name, port.kind, *values, size=n)


def _modulus(g: GraphBuilder, link: Link, n: int | None) -> Expr | float | list[list[Expr | float]]:
    modulated = link.kind.startswith("M")
    if not modulated and n is None:
        return link.value
    name = f"{link.name}.{'m' if 'TF' in link.kind else 'r'}" if n is None else f"{link.name}_m"
    g.parameter(name, link.value)
    value = param(name) * unary("cos", var("phi")) if modulated else param(name)
    return value if n is None else [[value if i == j else 0.0 for j in range(n)] for i in range(n)]


def source_of(sketch: Sketch, name: str = "Sketch") -> str:
    """The sketch as a model in the language."""
    n = sketch.size
    shape = "" if n is None else f"[{n}]"
    arrow = "->" if n is None else "=>"
    lines = [f"model {name}"]
    lines += [f"  J{kind}{shape} j{j};" for j, kind in enumerate(sketch.junctions)]
    if sketch.modulated:
        lines.append("  Real phi(start = 0.4);")
    for port in sketch.ports:
        letter = {"Se": "e", "Sf": "f", "R": "G" if port.inverse else "R"}.get(port.kind, port.kind)
        value = repr(port.value)
        if n is not None:
            value = f"{{{', '.join([value] * n)}}}" if port.kind in ("Se", "Sf") else f"{value}*identity({n})"
        lines.append(f"  {port.kind}{shape} {port.name}({letter} = {value});")
    for link in sketch.links:
        if link.kind != "bond":
            value = repr(link.value) + ("*cos(phi)" if link.kind.startswith("M") else "")
            letter = "m" if "TF" in link.kind else "r"
            square = "" if n is None else f"[{n}, {n}]"
            given = f"{letter} = {value}" if n is None else f"{'T' if letter == 'm' else 'G'} = {value}*identity({n})"
            lines.append(f"  {link.kind}{square} {link.name}({given});")
    lines.append("equation")
    if sketch.modulated:
        lines.append(f"  der(phi) = {_common(sketch, 0)};")
    for link in sketch.links:
        through = f"{link.name}: j{link.tail} {arrow} j{link.head};"
        lines.append(f"  {through if link.kind == 'bond' else f'j{link.tail} {arrow} {link.name} {arrow} j{link.head};'}")
    for port in sketch.ports:
        ends = (port.name, f"j{port.at}") if port.kind in ("Se", "Sf") else (f"j{port.at}", port.name)
        lines.append(f"  {ends[0]} {arrow} {ends[1]};")
    lines.append(f"end {name};")
    return "\n".join(lines) + "\n"


def dual(sketch: Sketch) -> Sketch:
    """Effort and flow exchanged: 0 for 1, I for C, Se for Sf, R for 1/R, a transformer turned around, a gyrator inverted."""
    flipped: dict[Literal[0, 1], Literal[0, 1]] = {0: 1, 1: 0}
    return Sketch(
        tuple(flipped[kind] for kind in sketch.junctions),
        tuple(replace(port, kind=DUAL[port.kind], inverse=port.kind == "R" and not port.inverse) for port in sketch.ports),
        tuple(
            replace(link, tail=link.head, head=link.tail) if "TF" in link.kind else replace(link, value=1.0 / link.value)
            for link in sketch.links
        ),
        sketch.size,
    )


@st.composite
def sketches(
    draw: st.DrawFn,
    *,
    most: int = 6,
    loops: int = 2,
    modulated: bool = True,
    gyrators: bool = True,
    sources: bool = True,
    sizes: tuple[int | None, ...] = (None,),
) -> Sketch:
    """Random connected sketches of up to `most` junctions, with up to `loops` links more than a tree has.

    No junction gets two sources that fix one variable; whether causality can be assigned at all is left open.
    """
    kinds: list[LinkKind] = ["bond", "bond", "bond", "TF"]
    kinds += ["GY"] if gyrators else []
    kinds += ["MTF"] if modulated else []
    kinds += ["MGY"] if modulated and gyrators else []
    n = draw(st.integers(1, most))
    zero_or_one: st.SearchStrategy[Literal[0, 1]] = st.sampled_from((0, 1))
    junctions = tuple(draw(st.lists(zero_or_one, min_size=n, max_size=n)))
    value = st.sampled_from((0.5, 1.0, 1.5, 2.0, 3.0))
    pairs = [(draw(st.integers(0, j - 1)), j) for j in range(1, n)]
    if n > 1:
        extra: Any = st.tuples(st.integers(0, n - 1), st.integers(0, n - 1)).filter(lambda pair: pair[0] != pair[1])
        pairs += draw(st.lists(extra, max_size=loops))
    links = tuple(
        Link(f"l{i}", draw(st.sampled_from(kinds)), *(pair if draw(st.booleans()) else pair[::-1]), draw(value))
        for i, pair in enumerate(pairs)
    )
    ports: list[OnePort] = []
    for j, kind in enumerate(junctions):
        choices: list[ElementKind] = ["I", "C", "R"]
        choices += ["Se", "Sf"] if sources else []
        chosen = draw(st.lists(st.sampled_from(choices), min_size=1, max_size=3))
        fixing: ElementKind = "Sf" if kind else "Se"
        for k, element in enumerate(chosen):
            if element == fixing and fixing in chosen[:k]:
                continue
            ports.append(OnePort(f"{element.lower()}{j}_{k}", element, j, draw(value), element == "R" and draw(st.booleans())))
    return Sketch(junctions, tuple(ports), links, draw(st.sampled_from(sizes)))
