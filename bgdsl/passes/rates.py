"""Derivatives by time that the text asks for: `der(x)` of variables and of expressions.

Output       the variable `der(x)` of a signal, the flow or effort that is a storage's rate, or the chain rule over these
"""

from __future__ import annotations

from bgdsl.expr import TIME, ZERO, Expr, add, derivative, leaves, substitute, topological, var
from bgdsl.ir.graph import Origin, SignalEquation
from bgdsl.passes.parts import (
    Context,
    ElementPart,
    SignalPart,
)
from bgdsl.passes.references import pair_value
from bgdsl.source import Span


def total_derivative(x: Expr, span: Span, context: Context) -> Expr:
    """d/dt of an expression, by the chain rule."""
    if x.op == "var":
        return rate_of(x.data, span, context)
    terms = [derivative(x, leaf) * rate_of(leaf.data, span, context) for leaf in leaves((x,))]
    if any(node.op == "time" for node in topological((x,))):
        clock = var("time")
        (renamed,) = substitute((x,), {TIME: clock})
        (slope,) = substitute((derivative(renamed, clock),), {clock: TIME})
        terms.append(slope)
    return add(terms) if terms else ZERO


def rate_of(name: str, span: Span, context: Context) -> Expr:
    """The derivative of a variable: `der(x)` of a signal; a storage's displacement has its flow, its momentum its effort."""
    base, bracket, index = name.partition("[") if name not in context.build.nodes else (name, "", "")
    nodes = context.build.nodes
    if isinstance(nodes.get(name.rpartition("[")[0] if name.endswith("]") else name), SignalPart):
        return var(f"der({name})")
    owner, _, letter = base.rpartition(".")
    if not isinstance(nodes.get(owner), ElementPart) and name.endswith("]"):
        base, bracket, index = name.rpartition("[")
        owner, _, letter = base.rpartition(".")
    part = nodes.get(owner)
    if isinstance(part, ElementPart):
        match letter:
            case "q" | "p":
                return var(f"{owner}.{'fe'[letter == 'p']}{bracket}{index}")
            case "energy":
                power = pair_value(owner, part.sizes[0], "power")
                assert isinstance(power, Expr)
                return power
            case _:
                pass
    return _auxiliary(name, span, context)


def _auxiliary(name: str, span: Span, context: Context) -> Expr:
    """The rate of a junction's, element's or bond's variable: that of an auxiliary signal that equals it."""
    build = context.build
    if name not in build.rates:
        made = build.rates[name] = f"rate#{len(build.rates) + 1}"
        origin = Origin(context.path, span)
        build.solved.append((made, (), origin))
        build.extra.append(SignalEquation(var(made), var(name), origin))
    return var(f"der({build.rates[name]})")
