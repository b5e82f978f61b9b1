"""Who needs whom: the directed graph over junctions and signals that one-way coupling is read from.

Input        ScalarGraph, the dropped terms
Output       Dependencies
Establishes  a power bond with both terms is an edge each way; with one term dropped, one way only; a modulus, a modulated
             source, an element's law and a signal's equation give edges from what they read
Reports      nothing
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from bgdsl.expr import Expr, leaves
from bgdsl.ir.graph import Element, SignalEquation
from bgdsl.ir.partition import Dependencies, Edge
from bgdsl.ir.scalar import ScalarGraph, Term


def dependencies(scalar: ScalarGraph, dropped: frozenset[int] = frozenset()) -> Dependencies:
    """The graph of dependencies once the dropped terms are gone."""
    return _Reader(scalar, dropped).run()


class _Reader:
    def __init__(self, scalar: ScalarGraph, dropped: frozenset[int]):
        self.scalar = scalar
        self.dropped = dropped
        graph = scalar.graph
        self.elements = {element.name: element for element in graph.elements}
        self.signals = tuple(name for signal in graph.signals for name in signal.scalars())
        first = len(scalar.junctions)
        self.signal_node = {name: first + i for i, name in enumerate(self.signals)}
        self.junction_node = {junction.variable: j for j, junction in enumerate(scalar.junctions)}
        self.port_node: dict[tuple[str, int, int], int] = {}
        self.element_nodes: dict[str, set[int]] = {}
        for term in scalar.terms:
            if term.element is not None:
                self.port_node[term.element, term.port, term.spot] = term.junction
                self.element_nodes.setdefault(term.element, set()).add(term.junction)
        self.own: dict[str, int] = {}
        for (name, port, spot), node in self.port_node.items():
            for letter in "efpq":
                self.own[self.elements[name].ports[port].variable(name, letter, spot)] = node
        self.resolved: dict[str, tuple[int, ...]] = {}
        self.edges: dict[tuple[int, int, str, int | None], Edge] = {}

    def run(self) -> Dependencies:
        for term in self.scalar.terms:
            if term.index not in self.dropped:
                self.read_term(term)
        for element in self.elements.values():
            self.read_element(element)
        for equation in self.scalar.graph.equations:
            self.read_equation(equation)
        storing = frozenset(node for (name, _, _), node in self.port_node.items() if self.elements[name].states)
        return Dependencies(len(self.scalar.junctions), self.signals, tuple(self.edges.values()), storing)

    def add(self, source: int, reader: int, variable: str, term: int | None, modulating: bool) -> None:
        if source != reader:
            key = (source, reader, variable, term)
            if key not in self.edges:
                self.edges[key] = Edge(source, reader, variable, term, modulating)

    # ------------------------------------------------------------------------------------------------------------ terms

    def read_term(self, term: Term) -> None:
        """A term at J: the far junction, and what the modulus reads."""
        if term.other is not None:
            far = self.scalar.terms[term.other].junction
            self.add(far, term.junction, self.scalar.junctions[far].variable, term.index, False)
        for root in (term.modulus,) if term.modulus is not None else ():
            for name, node in self.read(root):
                self.add(node, term.junction, name, term.index, True)

    def read_element(self, element: Element) -> None:
        """The laws of a one-port or user element: they tie its own ports together, and read the rest one way."""
        acting = {(term.junction, term.index) for term in self.terms_of(element.name) if term.index not in self.dropped}
        prefix = element.name + "."
        for law in element.laws:
            ties: set[int] = set()
            foreign: list[tuple[str, int]] = []
            for leaf in leaves((law.left, law.right)):
                if leaf.data.startswith(prefix) and leaf.data in self.own:
                    ties.add(self.own[leaf.data])
                else:
                    foreign += self.named(leaf.data)
            for junction, term in acting:
                if junction in ties or not ties:
                    for name, node in foreign:
                        self.add(node, junction, name, term, True)
                    for other in ties:
                        self.add(other, junction, self.scalar.junctions[other].variable, term, False)

    def terms_of(self, name: str) -> Iterable[Term]:
        if not hasattr(self, "_terms_of"):
            self._terms_of: dict[str, list[Term]] = {}
            for term in self.scalar.terms:
                if term.element is not None and term.other is None:
                    self._terms_of.setdefault(term.element, []).append(term)
        return self._terms_of.get(name, ())

    # ---------------------------------------------------------------------------------------------------------- signals

    def read_equation(self, equation: SignalEquation) -> None:
        """x = expression: x reads the expression. Any other equation ties the signals in it together."""
        assigned = self.assigned(equation.left)
        if assigned is not None:
            for name, node in self.read(equation.right):
                self.add(node, assigned, name, None, True)
            return
        both = [*self.read(equation.left), *self.read(equation.right)]
        solved = {node for _, node in both if node >= len(self.scalar.junctions)}
        for reader in solved:
            for name, node in both:
                self.add(node, reader, name, None, True)

    def assigned(self, left: Expr) -> int | None:
        if left.op != "var":
            return None
        name = left.data
        return self.signal_node.get(name[4:-1] if name.startswith("der(") else name)

    # ------------------------------------------------------------------------------------------------------------ names

    def read(self, root: Expr) -> Iterator[tuple[str, int]]:
        for leaf in leaves((root,)):
            yield from self.named(leaf.data)

    def named(self, name: str) -> list[tuple[str, int]]:
        """The variable with every node that gives it."""
        return [(name, node) for node in self.nodes(name)]

    def nodes(self, name: str) -> tuple[int, ...]:
        found = self.resolved.get(name)
        if found is None:
            found = self.resolved[name] = self.resolve(name)
        return found

    def resolve(self, name: str) -> tuple[int, ...]:
        pending, seen, nodes = [name], {name}, set[int]()
        while pending:
            one = pending.pop()
            if one.startswith("der("):
                one = one[4:-1]
            node = self.signal_node.get(one, self.junction_node.get(one, self.own.get(one)))
            if node is not None:
                nodes.add(node)
            elif one in self.scalar.aliases:
                fresh = {leaf.data for leaf in leaves((self.scalar.aliases[one],))} - seen
                seen |= fresh
                pending += sorted(fresh)
            else:
                nodes |= self.element_nodes.get(one.rpartition(".")[0], set())
        return tuple(sorted(nodes))
