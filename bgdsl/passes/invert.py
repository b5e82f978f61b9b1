"""Solve one equation for one variable in closed form, where its real solution is unique.

Input        left = right, and the variable wanted
Output       its value; a Refusal where there is provably no unique one; None where no formula is known
Establishes  no division by what may vanish: every divisor passes the caller's test
Reports      nothing: the caller knows what the equation means

What is linear is divided; else the operations around the variable are undone one by one, from the outside in. A law in which
the variable stands in several places (k q + k3 q^3) is left to a numeric solution.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from bgdsl.expr import ONE, ZERO, Expr, add, const, linear_parts, rebuild, unary, variables


@dataclass(frozen=True, slots=True)
class Refusal:
    """Why the equation has no unique solution. several: there are many; else the variable is not in it at all."""

    reason: str
    several: bool = True


def solve_for(left: Expr, right: Expr, wanted: Expr, can_vanish: Callable[[Expr], bool]) -> Expr | Refusal | None:
    """The value of the leaf `wanted` that makes left = right; `can_vanish` says which divisors are not allowed."""
    if left is wanted and not reads(right, wanted):
        return right
    parts = linear_parts(left - right, wanted)
    if parts is not None:
        slope, rest = parts
        if slope.is_zero:
            return Refusal("the equation does not depend on it", several=False)
        return None if can_vanish(slope) else divide(-rest, slope)
    return _undo(left - right, ZERO, wanted, can_vanish)


def reads(root: Expr, wanted: Expr) -> bool:
    """Whether the variable `wanted` stands anywhere in the expression."""
    return not root.is_const and wanted.data in variables((root,))


def divide(a: Expr, b: Expr) -> Expr:
    """a/b, with a division by a quotient written as a product."""
    if b.op == "neg":
        return -divide(a, b.args[0])
    if b.op == "div":
        numerator, denominator = b.args
        return divide(a * denominator, numerator)
    return a / b


# ----------------------------------------------------------------------------------------- undoing one operation at a time


def _undo(node: Expr, target: Expr, wanted: Expr, can_vanish: Callable[[Expr], bool]) -> Expr | Refusal | None:
    """The wanted leaf from node = target."""
    while node is not wanted:
        step = _step(node, target, wanted, can_vanish)
        if step is None or isinstance(step, Refusal):
            return step
        node, target = step
    return target


def _step(node: Expr, target: Expr, wanted: Expr, can_vanish: Callable[[Expr], bool]) -> tuple[Expr, Expr] | Refusal | None:
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
            return _undo_product(node, target, wanted, can_vanish)
        case "div" if not holds[1]:
            return node.args[0], target * node.args[1]
        case "div" if not holds[0] and not can_vanish(node.args[0]):
            return node.args[1], node.args[0] / target
        case "pow" if not holds[1]:
            return _undo_power(node.args[0], node.args[1], target)
        case "pow" if not holds[0]:
            return node.args[1], unary("log", target) / unary("log", node.args[0])
        case "abs" | "cos" | "cosh" | "sin" | "tan" | "sign" | "floor" | "ceil" | "trunc":
            return Refusal(f"{node.op} takes the same value at several points")
    inverse = _INVERSES.get(node.op)
    return (node.args[0], inverse(target)) if inverse is not None else None


def _undo_product(node: Expr, target: Expr, wanted: Expr, can_vanish: Callable[[Expr], bool]) -> tuple[Expr, Expr] | Refusal | None:
    factors = _factors(node, wanted)
    held = [factor for factor, _ in factors if reads(factor, wanted)]
    for factor, is_below in factors:
        if is_below and not reads(factor, wanted):
            target = target * factor
        elif not reads(factor, wanted):
            if can_vanish(factor):
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


def _factors(node: Expr, wanted: Expr) -> list[tuple[Expr, bool]]:
    """The factors of a product of products, quotients and roots, and whether each stands below the line; those that read `wanted`
    never do."""
    found: list[tuple[Expr, bool]] = []
    stack = [(node, False)]
    while stack:
        node, is_below = stack.pop()
        if node.op == "mul":
            stack += [(arg, is_below) for arg in reversed(node.args)]
        elif node.op == "div" and not reads(node.args[1], wanted):
            stack += [(node.args[1], not is_below), (node.args[0], is_below)]
        elif (parts := _split_root(node, wanted)) is not None:
            stack += [(part, is_below) for part in parts]
        else:
            found.append((node, is_below))
    return found


def _split_root(node: Expr, wanted: Expr) -> tuple[Expr, Expr] | None:
    """A root (or power) of c |x| as the root of c times that of |x|, which it is wherever it is real."""
    if not (node.op == "sqrt" or (node.op == "pow" and node.args[1].is_const)) or not reads(node, wanted):
        return None
    inner = _factors(node.args[0], wanted)
    held = [factor for factor, _ in inner if reads(factor, wanted)]
    if len(inner) == 1 or len(held) != 1 or held[0].op != "abs":
        return None
    rest: Expr = ONE
    for factor, is_below in inner:
        if factor is not held[0]:
            rest = divide(rest, factor) if is_below else rest * factor
    return rebuild(node, (rest, *node.args[1:])), rebuild(node, (held[0], *node.args[1:]))


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
