"""Renaming things and reordering statements changes the flat graph by names and order only."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from hypothesis import given, settings
from hypothesis import strategies as st

from bgdsl.expr import to_text
from bgdsl.ir.graph import BondGraph
from tests.flatten.conftest import flat_text

DECLARATIONS = (
    "parameter Real {m} = 2*{k};",
    "parameter Real {k} = 3;",
    "parameter Integer {n} = 2;",
    "J1 {v};",
    "I {mass}(I = {m}, f(start = 1));",
    "Cell {cell}[{n}](a = {{{k}, {m}}});",
    "TF {lever}(m = 0.5);",
    "J0 {node};",
    "C {spring}(k = {k});",
    "Real {x}(start = 0);",
    "output Real {y} = {x}*{spring}.e;",
)
STATEMENTS = (
    "{v} -> {mass};",
    "{v} -> {lever} -> {node};",
    "{node} -> {spring};",
    "for i in 1:{n} loop {v} -> {cell}[i].p; end for;",
    "der({x}) = {v}.f;",
)
CELL = ("parameter Real a;", "port in Translational p;", "R r(R = a);")
NAMES = ("m", "k", "n", "v", "mass", "cell", "lever", "node", "spring", "x", "y")
SAME = {name: name for name in NAMES}


def flat(
    names: Mapping[str, str] = SAME,
    declarations: Sequence[str] = DECLARATIONS,
    statements: Sequence[str] = STATEMENTS,
    cell: Sequence[str] = CELL,
) -> BondGraph:
    inner = f"model Cell\n{' '.join(cell)}\nequation\n p -> r;\nend Cell;\n"
    own, lines = ("\n".join(item.format_map(names) for item in items) for items in (declarations, statements))
    return flat_text(f"{inner}model Top\n{own}\nequation\n{lines}\nend Top;\n", "Top")


def content(graph: BondGraph) -> tuple[object, ...]:
    """The graph without its order."""
    return (
        {j.name: (j.kind, j.size) for j in graph.junctions},
        {e.name: (e.kind, tuple((to_text(law.left), to_text(law.right)) for law in e.laws), tuple(e.starts)) for e in graph.elements},
        {b.name: (b.tail, b.head, b.size, b.aliases) for b in graph.bonds},
        {p.name: tuple(to_text(x) for x in p.values) for p in graph.parameters},
        {tuple(sorted((to_text(e.left), to_text(e.right)))) for e in graph.equations},
    )


REFERENCE = content(flat())


@settings(max_examples=40, deadline=None)
@given(st.permutations(DECLARATIONS), st.permutations(STATEMENTS), st.permutations(CELL))
def test_reordering(declarations: list[str], statements: list[str], cell: list[str]) -> None:
    assert content(flat(SAME, declarations, statements, cell)) == REFERENCE


@settings(max_examples=40, deadline=None)
@given(st.lists(st.from_regex(r"[a-z_]{1,3}X[0-9]{1,3}", fullmatch=True), min_size=len(NAMES), max_size=len(NAMES), unique=True))
def test_renaming(fresh: list[str]) -> None:
    names = dict(zip(NAMES, fresh, strict=True))
    old, new = flat(), flat(names)

    def renamed(path: str) -> str:
        head, bracket, rest = path.partition("[")
        first, dot, more = head.partition(".")
        return f"{names[first]}{dot}{more}{bracket}{rest}"

    assert [j.name for j in new.junctions] == [renamed(j.name) for j in old.junctions]
    assert [(e.name, e.kind) for e in new.elements] == [(renamed(e.name), e.kind) for e in old.elements]
    assert [p.name for p in new.parameters] == [renamed(p.name) for p in old.parameters]
    assert [(b.tail.node, b.head.node) for b in new.bonds] == [(renamed(b.tail.node), renamed(b.head.node)) for b in old.bonds]
    assert len(new.equations) == len(old.equations)
