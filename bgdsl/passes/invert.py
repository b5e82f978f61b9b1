"""Solve one equation for one variable in closed form, where its real solution is unique.

Input        left = right, and the variable wanted
Output       its value; a Refusal where there is provably no unique one; None where no formula is known
Establishes  no division by what may vanish: a divisor is a constant, a parameter, or provably nonzero
Reports      nothing: the caller knows what the equation means

What is linear is divided; else the operations around the variable are undone one by one, from the outside in. A law in which
the variable stands in several places (k q + k3 q^3) is left to a numeric solution.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from bgdsl.expr import ONE, ZERO, Expr, add, const, leaves, linear_parts, topological, unary


@dataclass(frozen=True, slots=True)
class Refusal:
    """Why the equation has no unique solution. several: there are many; else the variable is not in it at all."""

    reason: str
    several: bool = True


def solve_for(left: Expr, right: Expr, wanted: Expr) -> Expr | Refusal | None:
    """The value of the leaf `wanted` that makes left = right."""
    if left is wanted and not reads(right, wanted):
        return right
    parts = linear_parts(left - right, wanted)
    if parts is not None:
        slope, rest = parts
        if slope.is_zero:
            return Refusal("the equation does not depend on it", several=False)
        return divide(-rest, slope) if nonvanishing(slope) else None
    return _undo(left - right, ZERO, wanted)


def reads(root: Expr, wanted: Expr) -> bool:
    """Whether the leaf stands anywhere in the expression."""
    return any(node is wanted for node in topological((root,)))


def divide(a: Expr, b: Expr) -> Expr:
    """a/b, with a division by a quotient written as a product."""
    if b.op == "neg":
        return -divide(a, b.args[0])
    if b.op == "div":
        numerator, denominator = b.args
        return divide(a * denominator, numerator)
    return a / b


def nonvanishing(root: Expr) -> bool:
    """Whether the expression can be divided by: constants, parameters, products and powers of such, exponentials, sums of
    one sign. A parameter set to zero later is a division by zero that the run reports."""
    return _sign(root) is not None


def _sign(root: Expr) -> int | None:
    """1 or -1 if the expression is of that sign, 0 if it is not zero but of unknown sign, None if it may be zero."""
    found: dict[Expr, int | None] = {}
    for node in topological((root,)):
        found[node] = _sign_of(node, [found[arg] for arg in node.args])
    return found[root]


def _sign_of(node: Expr, signs: list[int | None]) -> int | None:
    match node.op:
        case "const":
            return None if node.data == 0.0 or not math.isfinite(node.data) else int(math.copysign(1.0, node.data))
        case "param":
            return 0
        case "neg":
            return None if signs[0] is None else -signs[0]
        case "mul" | "div":
            if node.op == "mul" and node.args[0] is node.args[1] and signs[0] is not None:
                return 1
            return None if signs[0] is None or signs[1] is None else signs[0] * signs[1]
        case "exp" | "cosh":
            return 1
        case "abs" if signs[0] is not None:
            return 1
        case "sqrt" | "sign" if signs[0] is not None:
            return signs[0]
        case "pow" if signs[0] is not None:
            exponent = node.args[1]
            return 1 if signs[0] == 1 or (exponent.is_const and exponent.data % 2 == 0) else 0
        case "add":
            return _sign_of_sum(node.args, signs)
        case "if" if signs[1] is not None and signs[2] is not None:
            return signs[1] if signs[1] == signs[2] else 0
        case "atan" | "asin" | "sinh" | "tanh":
            return signs[0]
    return None


def _sign_of_sum(terms: Iterable[Expr], signs: list[int | None]) -> int | None:
    """A sum of terms none of which has the other sign, one of them strict, is of that sign."""
    for wanted in (1, -1):
        strict = [sign == wanted for sign in signs]
        if any(strict) and all(sure or _never(-wanted, term) for sure, term in zip(strict, terms, strict=True)):
            return wanted
    return None


def _never(sign: int, term: Expr) -> bool:
    """Whether the term is certainly not of the sign given: squares, even powers, absolute values, and their negatives."""
    if term.op == "neg":
        return _never(-sign, term.args[0])
    if term.op == "mul" and term.args[0].is_const:
        return _never(sign if term.args[0].data > 0 else -sign, term.args[1])
    square = (term.op == "mul" and term.args[0] is term.args[1]) or (
        term.op == "pow" and term.args[1].is_const and term.args[1].data % 2 == 0
    )
    return sign < 0 and (square or term.op in ("abs", "sqrt", "exp", "cosh"))


# ----------------------------------------------------------------------------------------- undoing one operation at a time


def _undo(node: Expr, target: Expr, wanted: Expr) -> Expr | Refusal | None:
    """The wanted leaf from node = target."""
    while node is not wanted:
        step = _step(node, target, wanted)
        if step is None or isinstance(step, Refusal):
            return step
        node, target = step
    return target


def _step(node: Expr, target: Expr, wanted: Expr) -> tuple[Expr, Expr] | Refusal | None:
    """One operation undone: (inner node, new target)."""
    holds = [reads(arg, wanted) for arg in node.args]
    match node.op:
        case "neg":
            return node.args[0], -target
        case "add":
            rest = add(arg for arg, held in zip(node.args, holds, strict=True) if not held)
            inner = [arg for arg, held in zip(node.args, holds, strict=True) if held]
            return (inner[0], target - rest) if len(inner) == 1 else None
        case "mul":
            return _undo_product(node, target, wanted)
        case "div" if not holds[1]:
            return node.args[0], target * node.args[1]
        case "div" if not holds[0] and nonvanishing(node.args[0]):
            return node.args[1], node.args[0] / target
        case "pow" if not holds[1]:
            return _undo_power(node.args[0], node.args[1], target)
        case "pow" if not holds[0]:
            return node.args[1], unary("log", target) / unary("log", node.args[0])
        case "abs" | "cos" | "cosh" | "sin" | "tan" | "sign" | "floor" | "ceil" | "trunc":
            return Refusal(f"{node.op} takes the same value at several points")
    inverse = _INVERSES.get(node.op)
    return (node.args[0], inverse(target)) if inverse is not None else None


def _undo_product(node: Expr, target: Expr, wanted: Expr) -> tuple[Expr, Expr] | Refusal | None:
    factors = _factors(node)
    held = [factor for factor in factors if reads(factor, wanted)]
    for factor in factors:
        if not reads(factor, wanted):
            if not nonvanishing(factor):
                return None
            target = divide(target, factor)
    if len(held) == 1:
        return held[0], target
    return _undo_signed_power(held, target)


def _undo_signed_power(factors: list[Expr], target: Expr) -> tuple[Expr, Expr] | Refusal | None:
    """x |x|^n, x x^2, sign(x) x^2 and their like: odd functions of x, growing with it if the total power is positive."""
    bases = {_base(factor)[0] for factor in factors}
    if len(bases) != 1:
        return None
    base = bases.pop()
    power = sum(_base(factor)[1] for factor in factors)
    odd = sum(_base(factor)[2] for factor in factors) % 2 == 1
    if not odd:
        return Refusal("the law takes the same value at two points of opposite sign")
    return (base, _signed_root(target, power)) if power > 0 else None


def _base(factor: Expr) -> tuple[Expr, float, int]:
    """(x, n, parity) of a factor that is |x|^n or sign(x) |x|^n: parity is 0 for the even, 1 for the odd."""
    match factor.op:
        case "abs":
            return factor.args[0], 1.0, 0
        case "sign":
            return factor.args[0], 0.0, 1
        case "sqrt" if factor.args[0].op == "abs":
            return factor.args[0].args[0], 0.5, 0
        case "pow" if factor.args[1].is_const:
            power = factor.args[1].data
            base, n, parity = _base(factor.args[0])
            if parity == 0 and factor.args[0].op == "abs":
                return base, n * power, 0
            if power == int(power) and n == 1.0:
                return base, power, int(power) % 2
    return factor, 1.0, 1


def _undo_power(base: Expr, exponent: Expr, target: Expr) -> tuple[Expr, Expr] | Refusal | None:
    if not exponent.is_const:
        return base, target ** (ONE / exponent)
    power = exponent.data
    if power == int(power) and int(power) % 2 == 0:
        return Refusal("an even power takes the same value at two points of opposite sign")
    if power == int(power) and power > 0:
        return base, _signed_root(target, power)
    return base, target ** const(1.0 / power)


def _signed_root(target: Expr, power: float) -> Expr:
    size = unary("abs", target)
    root = unary("sqrt", size) if power == 2.0 else size ** const(1.0 / power)
    return unary("sign", target) * root


def _factors(node: Expr) -> list[Expr]:
    """The factors of a product of products."""
    found: list[Expr] = []
    stack = [node]
    while stack:
        node = stack.pop()
        if node.op == "mul":
            stack += reversed(node.args)
        else:
            found.append(node)
    return found


_INVERSES: Mapping[str, Callable[[Expr], Expr]] = {
    "exp": lambda y: unary("log", y),
    "log": lambda y: unary("exp", y),
    "log10": lambda y: const(10.0) ** y,
    "sqrt": lambda y: y * y,
    "sinh": lambda y: unary("log", y + unary("sqrt", y * y + ONE)),
    "tanh": lambda y: const(0.5) * unary("log", (ONE + y) / (ONE - y)),
    "atan": lambda y: unary("tan", y),
    "asin": lambda y: unary("sin", y),
    "acos": lambda y: unary("cos", y),
}


def unknown_leaves(root: Expr, among: Mapping[str, object]) -> list[str]:
    """The names of the variables of `among` that the expression reads, each once."""
    return [leaf.data for leaf in leaves((root,)) if leaf.data in among]
