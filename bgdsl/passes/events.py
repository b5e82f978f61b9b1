"""Find where the equations change form: conditions, absolute values, signs, minima and maxima.

Input        the steps of a program and the expressions wanted of it
Output       Events: one function for each switch, which changes sign where it switches
Establishes  only what the wanted expressions use is watched, and only what moves with state, input or time. Roots that
             stand upright, `sign(x)*sqrt(abs(x))`, are not: nothing jumps there, and what comes to rest in finite time along
             one (tanks that level out through an orifice) would cross zero without end
Reports      nothing
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from bgdsl.expr import Expr, topological
from bgdsl.ir.graph import Origin
from bgdsl.ir.program import Event, Record, SolveNewton, Step, defined, needed, read
from bgdsl.ir.system import State


def collect_events(
    steps: Sequence[Step], roots: Sequence[Expr], states: Sequence[State], inputs: Iterable[Record] = ()
) -> tuple[Event, ...]:
    """The events of the steps that the roots need, and of the roots; `roots` are given with the states' derivatives first."""
    used = needed(steps, roots)
    if not used and not roots:
        return ()
    moving = {s.name for s in states} | {r.name for r in inputs}
    moves: dict[Expr, bool] = {}
    found: dict[Expr, Origin] = {}
    for step in used:
        for value in _watched(read(step), moves, moving):
            found.setdefault(value, step.origin)
        if any(moves[value] for value in read(step)) or isinstance(step, SolveNewton):
            moving |= set(defined(step))
    origins = [s.origin for s in states]
    for k, root in enumerate(roots):
        for value in _watched((root,), moves, moving):
            found.setdefault(value, origins[min(k, len(origins) - 1)] if origins else used[-1].origin)
    upright = _upright([*(value for step in used for value in read(step)), *roots])
    return tuple(Event(value, origin) for value, origin in found.items() if value not in upright)


def _watched(roots: Iterable[Expr], moves: dict[Expr, bool], moving: set[str]) -> Iterator[Expr]:
    """The switching functions under the roots that were not met before; `moves` notes which nodes change in a run."""
    for node in topological(roots, moves):
        moves[node] = node.op == "time" or (node.op == "var" and node.data in moving) or any(moves[arg] for arg in node.args)
        if moves[node]:
            value = _switch(node)
            if value is not None:
                yield value


def _switch(node: Expr) -> Expr | None:
    """The function whose sign the node's form depends on."""
    match node.op:
        case "lt" | "le" | "eq" | "ne" | "min" | "max":
            return node.args[0] - node.args[1]
        case "abs" | "sign":
            return node.args[0]
    return None


# --------------------------------------------------------------------------------------------------------------------- roots


def _upright(roots: Sequence[Expr]) -> set[Expr]:
    """The functions g of which only roots like `sqrt(abs(g))` and `sign(g)*abs(g)^(1/3)` depend on the sign."""
    found: set[Expr] = set()
    other: set[Expr] = set()
    products = {root for root in roots if root.op == "mul"}
    for node in topological(roots):
        if node.op in ("abs", "sign"):
            found.add(node.args[0])
        elif (value := _switch(node)) is not None:
            other.add(value)
        if node.op == "mul":
            continue
        products.update(arg for arg in node.args if arg.op == "mul")
        other.update(arg.args[0] for arg in node.args if arg.op == "sign" or (arg.op == "abs" and not _is_root(node)))
    for product in products:
        factors = _factors(product)
        vanishing = {factor.args[0].args[0] for factor in factors if _is_root(factor) and factor.args[0].op == "abs"}
        other.update(factor.args[0] for factor in factors if factor.op == "sign" and factor.args[0] not in vanishing)
        other.update(factor.args[0] for factor in factors if factor.op == "abs")
    return found - other - {root.args[0] for root in roots if root.op in ("abs", "sign")}


def _is_root(node: Expr) -> bool:
    return node.op == "sqrt" or (node.op == "pow" and node.args[1].is_const and 0.0 < node.args[1].data < 1.0)


def _factors(product: Expr) -> list[Expr]:
    found, stack = [], [product]
    while stack:
        node = stack.pop()
        if node.op == "mul":
            stack += node.args
        else:
            found.append(node)
    return found
