"""Integrate the law of a storage in closed form: the energy it holds.

Input        an expression over one variable and parameters
Output       its integral from zero to that variable; None where no formula is known
Establishes  the derivative of the result is the expression, kinks included: springs with gaps, stops and absolute values are exact
Reports      nothing
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from bgdsl.expr import (
    ONE,
    ZERO,
    Expr,
    add,
    binary,
    const,
    derivative,
    if_else,
    leaves,
    linear_parts,
    rebuild,
    relation,
    substitute,
    topological,
    unary,
)

HIGHEST_DEGREE = 12


def integral(root: Expr, x: Expr) -> Expr | None:
    """The integral of `root` over the leaf x from 0 to x."""
    whole = _antiderivative(_lifted(root, x), x)
    if whole is None:
        return None
    (start,) = substitute((whole,), {x: ZERO})
    return whole - start


def _free(root: Expr, x: Expr) -> bool:
    return all(leaf is not x for leaf in leaves((root,)))


def _antiderivative(root: Expr, x: Expr) -> Expr | None:
    if _free(root, x):
        return root * x
    if root.op in ("add", "neg"):
        parts = [_antiderivative(arg, x) for arg in root.args]
        return None if any(part is None for part in parts) else rebuild(root, tuple(part for part in parts if part is not None))
    if root.op == "if":
        condition, yes, no = root.args
        return _piecewise(condition, yes, no, x)
    if root.op == "mul":
        for one, other in (root.args, root.args[::-1]):
            if _free(one, x):
                inner = _antiderivative(other, x)
                return None if inner is None else one * inner
    if root.op == "div" and _free(root.args[1], x):
        inner = _antiderivative(root.args[0], x)
        return None if inner is None else inner / root.args[1]
    polynomial = _polynomial(root, x)
    return polynomial if polynomial is not None else _function_of_linear(root, x)


def _polynomial(root: Expr, x: Expr) -> Expr | None:
    """sum c_k x^(k+1)/(k+1), from the derivatives at zero; None if they do not end."""
    if not all(_is_polynomial(node, x) for node in topological((root,))):
        return None
    terms: list[Expr] = []
    slope = root
    for k in range(HIGHEST_DEGREE + 1):
        (coefficient,) = substitute((slope,), {x: ZERO})
        terms.append(coefficient * x ** const(k + 1.0) / const(float(math.factorial(k + 1))))
        slope = derivative(slope, x)
        if slope.is_zero:
            return add(term for term in terms if not term.is_zero)
    return None


def _is_polynomial(node: Expr, x: Expr) -> bool:
    """Whether the node keeps its operands a polynomial in x."""
    if node.op in ("add", "mul", "neg", "var", "param", "const", "time"):
        return True
    if node.op == "pow":
        exponent = node.args[1]
        whole = exponent.is_const and exponent.data.is_integer() and 0 < exponent.data <= HIGHEST_DEGREE
        return whole or _free(node, x)
    return _free(node if node.op != "div" else node.args[1], x)


_FUNCTIONS: Mapping[str, Callable[[Expr, Expr], Expr]] = {
    "exp": lambda u, y: y,
    "sin": lambda u, y: -unary("cos", u),
    "cos": lambda u, y: unary("sin", u),
    "sinh": lambda u, y: unary("cosh", u),
    "cosh": lambda u, y: unary("sinh", u),
    "tanh": lambda u, y: unary("log", unary("cosh", u)),
    "tan": lambda u, y: -unary("log", unary("abs", unary("cos", u))),
    "log": lambda u, y: u * y - u,
    "sqrt": lambda u, y: const(2.0 / 3.0) * u * y,
    "atan": lambda u, y: u * y - const(0.5) * unary("log", ONE + u * u),
}


def _function_of_linear(root: Expr, x: Expr) -> Expr | None:
    """f(a x + b), (a x + b)^n and c/(a x + b)."""
    if root.op in _FUNCTIONS:
        parts = linear_parts(root.args[0], x)
        return None if parts is None else _FUNCTIONS[root.op](root.args[0], root) / parts[0]
    if root.op == "pow" and _free(root.args[1], x):
        base, exponent = root.args
        parts = linear_parts(base, x)
        return None if parts is None or (exponent + ONE).is_zero else base ** (exponent + ONE) / ((exponent + ONE) * parts[0])
    if root.op == "div" and _free(root.args[0], x):
        parts = linear_parts(root.args[1], x)
        return None if parts is None else root.args[0] * unary("log", unary("abs", root.args[1])) / parts[0]
    return None


def _piecewise(condition: Expr, yes: Expr, no: Expr, x: Expr) -> Expr | None:
    """if a x + b < 0 then f else g: F up to the threshold and G from it, or the other way round."""
    if condition.op not in ("lt", "le"):
        return None
    parts = linear_parts(condition.args[0] - condition.args[1], x)
    first, second = _antiderivative(yes, x), _antiderivative(no, x)
    if parts is None or first is None or second is None or not parts[0].is_const or parts[0].is_zero:
        return None
    threshold = -parts[1] / parts[0]
    below, above = (first, second) if parts[0].data > 0 else (second, first)
    (low,) = substitute((below,), {x: binary("min", x, threshold)})
    (high,) = substitute((above,), {x: binary("max", x, threshold)})
    return low + high


def _lifted(root: Expr, x: Expr) -> Expr:
    """The expression with `abs`, `sign`, `min` and `max` as conditions, and conditions brought to the outside of products."""
    if _free(root, x) or not root.args or root.op in ("lt", "le", "eq", "ne", "and", "or", "not"):
        return root
    args = tuple(_lifted(arg, x) for arg in root.args)
    match root.op:
        case "abs" | "sign":
            (u,) = args
            return _chosen(u, ZERO, -u if root.op == "abs" else -ONE, u if root.op == "abs" else ONE)
        case "min" | "max":
            u, v = args
            return _chosen(u, v, *((u, v) if root.op == "min" else (v, u)))
        case "mul" | "div" | "pow":
            for k, arg in enumerate(args):
                if arg.op == "if":
                    branches = [_lifted(rebuild(root, (*args[:k], branch, *args[k + 1 :])), x) for branch in arg.args[1:]]
                    return if_else(arg.args[0], *branches)
    return rebuild(root, args)


def _chosen(u: Expr, v: Expr, yes: Expr, no: Expr) -> Expr:
    return if_else(relation("lt", u, v), yes, no)
