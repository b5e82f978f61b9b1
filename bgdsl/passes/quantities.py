"""Every variable of the flat graph by its scalar name; powers and stored energies are computed where they are read.

Input        CausalGraph
Output       Values  over states, unknowns and inputs: what else has a name is an alias, or made of these
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

from bgdsl.expr import Expr, add, const, leaves, var
from bgdsl.ir.causal import CausalGraph
from bgdsl.ir.elements import KINDS, component
from bgdsl.ir.graph import Bond, BondGraph, Element
from bgdsl.ir.values import Values
from bgdsl.passes.integrate import integral

HALF = const(0.5)


def values_of(causal: CausalGraph) -> Values:
    """Every variable of the flat graph by its scalar name, over states, unknowns and inputs; powers and stored energies too."""
    scalar = causal.scalar
    graph = scalar.graph
    known = dict.fromkeys(j.variable for j in scalar.junctions)
    known |= dict.fromkeys(scalar.unknowns)
    known |= dict.fromkeys(name for element in graph.elements for name in element.states)
    known |= dict.fromkeys(name for signal in graph.signals for name in signal.scalars())
    return Values(known, scalar.aliases, dict(_made(graph)))


def _made(graph: BondGraph) -> Iterator[tuple[str, Callable[[], Expr]]]:
    storages = [element for element in graph.elements if element.states]
    for element in graph.elements:
        if len(element.ports) == 1:
            yield f"{element.name}.power", partial(_power, element)
    energies = {f"{element.name}.energy": energy for element in storages if (energy := _energy(element)) is not None}
    yield from energies.items()
    if len(energies) == len(storages):
        yield "energy.total", lambda: add(map(var, energies))
    for bond in graph.bonds:
        yield f"{bond.name}.power", partial(_bond_power, bond)
        if bond.size is not None:
            for i in range(bond.size):
                yield component(f"{bond.name}.power", i), partial(_bond_power, bond, (i,))


def _power(element: Element) -> Expr:
    """The power of a one-port: into a passive element, out of a source."""
    port = element.ports[0]
    return add(var(port.variable(element.name, "e", i)) * var(port.variable(element.name, "f", i)) for i in range(port.width))


def _energy(element: Element) -> Callable[[], Expr] | None:
    """How the energy stored in a storage is computed: half the sum of state times co-energy variable where its law is linear,
    else the integral of a scalar law. None where no formula is known."""
    if element.linear is not None:
        return partial(_quadratic_energy, element)
    if len(element.states) != 1 or len(element.laws) != 1:
        return None
    state = var(element.states[0])
    law = element.laws[0]
    if any(leaf is not state for leaf in leaves((law.right,))) or law.left.data == element.states[0]:
        return None
    whole = integral(law.right, state)
    return None if whole is None else lambda: whole


def _quadratic_energy(element: Element) -> Expr:
    port = element.ports[0]
    letter = "f" if KINDS[element.kind].state == "p" else "e"
    return HALF * add(var(name) * var(port.variable(element.name, letter, i)) for i, name in enumerate(element.states))


def _bond_power(bond: Bond, components: tuple[int, ...] | None = None) -> Expr:
    if bond.size is None:
        return var(f"{bond.name}.e") * var(f"{bond.name}.f")
    chosen = range(bond.size) if components is None else components
    return add(var(component(f"{bond.name}.e", i)) * var(component(f"{bond.name}.f", i)) for i in chosen)
