"""Derivatives of expressions, exact, and the two parts of linear ones."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from bgdsl.expr.nodes import MINUS_ONE, ONE, ZERO, Expr, add, const, if_else, relation, table, unary
from bgdsl.expr.walk import substitute, topological


def partials(node: Expr) -> tuple[Expr, ...]:
    """The derivative of `node` with respect to each of its operands; at a kink, the derivative of the side taken."""
    args = node.args
    match node.op:
        case "add":
            return (ONE,) * len(args)
        case "neg":
            return (MINUS_ONE,)
        case "mul":
            return args[1], args[0]
        case "div":
            return ONE / args[1], -(node / args[1])
        case "pow":
            base, exponent = args
            by_exponent = ZERO if exponent.op == "const" else node * unary("log", base)
            return exponent * base ** (exponent - 1.0), by_exponent
        case "if":
            condition, _, _ = args
            return ZERO, if_else(condition, ONE, ZERO), if_else(condition, ZERO, ONE)
        case "min":
            return if_else(relation("le", *args), ONE, ZERO), if_else(relation("le", *args), ZERO, ONE)
        case "max":
            return if_else(relation("lt", *args), ZERO, ONE), if_else(relation("lt", *args), ONE, ZERO)
        case "atan2":
            y, x = args
            square = x * x + y * y
            return x / square, -(y / square)
        case "table":
            return (table(node.data[0], args[0], node.data[1] + 1),)
        case "lt" | "le" | "eq" | "ne" | "and" | "or" | "not":
            return (ZERO,) * len(args)
        case _:
            return (_UNARY_DERIVATIVES[node.op](args[0], node),)


_UNARY_DERIVATIVES: Mapping[str, Callable[[Expr, Expr], Expr]] = {
    "sin": lambda x, y: unary("cos", x),
    "cos": lambda x, y: -unary("sin", x),
    "tan": lambda x, y: ONE + y * y,
    "asin": lambda x, y: ONE / unary("sqrt", ONE - x * x),
    "acos": lambda x, y: -(ONE / unary("sqrt", ONE - x * x)),
    "atan": lambda x, y: ONE / (ONE + x * x),
    "sinh": lambda x, y: unary("cosh", x),
    "cosh": lambda x, y: unary("sinh", x),
    "tanh": lambda x, y: ONE - y * y,
    "exp": lambda x, y: y,
    "log": lambda x, y: ONE / x,
    "log10": lambda x, y: const(1.0 / math.log(10.0)) / x,
    "sqrt": lambda x, y: const(0.5) / y,
    "abs": lambda x, y: unary("sign", x),
    "sign": lambda x, y: ZERO,
    "floor": lambda x, y: ZERO,
    "ceil": lambda x, y: ZERO,
    "trunc": lambda x, y: ZERO,
}


def derivative(root: Expr, wrt: Expr) -> Expr:
    """The derivative of `root` with respect to the leaf `wrt`, every other leaf held."""
    slope: dict[Expr, Expr] = {}
    for node in topological((root,)):
        if node is wrt:
            slope[node] = ONE
        elif any(slope[arg] is not ZERO for arg in node.args):
            slope[node] = add(p * slope[arg] for p, arg in zip(partials(node), node.args, strict=True) if slope[arg] is not ZERO)
        else:
            slope[node] = ZERO
    return slope[root]


def linear_parts(root: Expr, wrt: Expr) -> tuple[Expr, Expr] | None:
    """(a, b) with root = a wrt + b and neither reading `wrt`; None where `root` is not linear in it."""
    a = derivative(root, wrt)
    if any(node is wrt for node in topological((a,))):
        return None
    (b,) = substitute((root,), {wrt: ZERO})
    return a, b
