"""Expressions of a part over what is left of the model: aliases, held signals and parameters of elements are said by what they
stand for."""

from __future__ import annotations

from collections.abc import Iterable

from bgdsl.expr import Expr, const, evaluate, leaves, substitute, topological, var
from bgdsl.ir.scalar import ScalarGraph
from bgdsl.reductions.condition import parameter_values
from bgdsl.reductions.part import Part

LONGEST = 100
"""Nodes of an expression beyond which a parameter's default or a start is written as its number."""


class Wording:
    """How a part says the model's expressions."""

    def __init__(self, scalar: ScalarGraph, part: Part):
        self.graph, self.aliases, self.changed = scalar.graph, scalar.aliases, part.changed
        self.values = parameter_values(self.graph, part.changed)
        self.elements = frozenset(element.name for element in self.graph.elements)
        self.parameter_of = {name: p for p in self.graph.parameters for name in p.scalars()}
        self.held: dict[int | str, list[tuple[str, float]]] = {}
        for (reader, signal), held in part.frozen.items():
            self.held.setdefault(reader, []).append((signal, held))

    def prepared(self, roots: tuple[Expr, ...], readers: tuple[int | str, ...] = (), own: Iterable[str] = ()) -> tuple[Expr, ...]:
        """Expressions over junctions, one-ports, signals and the parameters of instances. readers: who reads, as `frozen` knows it;
        own: variables that stay as they are."""
        held = {var(signal): const(value) for reader in readers for signal, value in self.held.get(reader, ())}
        roots = self.bound(substitute(roots, held) if held else roots)
        own = frozenset(own)
        while True:
            aliased = {leaf: self.aliases[leaf.data] for leaf in leaves(roots) if leaf.data not in own and leaf.data in self.aliases}
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
                    changed = self.changed.get(leaf.data)
                    found[leaf] = parameter.values[k] if changed is None else const(changed)
            if not found:
                return roots
            roots = substitute(roots, found)

    def short(self, root: Expr) -> Expr:
        """An expression over parameters, as a number where it is long."""
        (root,) = self.bound((root,))
        if _tree_size(root) <= LONGEST:
            return root
        return const(evaluate(root, self.values, tables=self.graph.tables))

    def vanishes(self, modulus: Expr) -> bool:
        """Is it zero for the parameters given? Then no transformer can be written, and the two terms stand as sources."""
        if any(node.op in ("var", "time") for node in topological((modulus,))):
            return False
        return evaluate(modulus, self.values, tables=self.graph.tables) == 0.0


def _tree_size(root: Expr) -> int:
    sizes: dict[Expr, int] = {}
    for node in topological((root,)):
        sizes[node] = 1 + sum(sizes[arg] for arg in node.args)
    return sizes[root]
