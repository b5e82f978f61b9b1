"""In which direction the law of a resistor or user element works, and in which it is written."""

from __future__ import annotations

from bgdsl.expr import Expr, derivative, leaves, var
from bgdsl.ir.graph import Element
from bgdsl.ir.scalar import Term
from bgdsl.passes.moduli import Moduli


def only_direction(element: Element, term: Term, moduli: Moduli) -> str | None:
    """`e` or `f` where the laws of an element allow its port to give out only that, else None.

    A user element's port gives out what its laws read; if they read both, either may do. A resistor's law e = g(f) cannot be
    turned around where g is flat (`e = Fc*sign(f)`), nor, with a factor that depends on parameters only, where that is zero.
    """
    port = element.ports[term.port]
    effort, flow = (port.variable(element.name, letter, term.spot) for letter in "ef")
    if element.kind == "field":
        named = {leaf.data for law in element.laws for leaf in leaves((law.left, law.right))}
        return None if (effort in named) == (flow in named) else "e" if effort in named else "f"
    for out, into in ((effort, flow), (flow, effort)):
        for law in element.laws:
            if law.left is var(out) and _is_flat(law.right, var(into), moduli):
                return "e" if out == effort else "f"
    return None


def _is_flat(right: Expr, into: Expr, moduli: Moduli) -> bool:
    slope = derivative(right, into)
    return slope.is_zero or (moduli.can_vanish(slope) and not any(True for op in ("var", "time") for _ in leaves((slope,), op)))


def written_direction(element: Element, term: Term) -> str:
    """What a port gives out by the way its law is written: the variable that stands alone on the left; else effort."""
    port = element.ports[term.port]
    lefts = {law.left.data for law in element.laws if law.left.op == "var"}
    return "f" if port.variable(element.name, "f", term.spot) in lefts else "e"
