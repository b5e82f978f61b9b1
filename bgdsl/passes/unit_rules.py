"""The unit of an expression from the units of its leaves.

A leaf whose unit nobody declared makes everything it multiplies unknown; nothing is said about unknown units. A written number
may stand for a quantity in products (`9.81*m`, `2*f^2`) and takes any unit in sums, `time` likewise (`sin(3*time)`); only a
sign (`-1`) is pure.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from fractions import Fraction

from bgdsl.expr import Expr, topological
from bgdsl.ir.dimensions import NUMBER, Unit, agree, over, power, times

PURE = Unit(NUMBER.exponents)
"""Stands for a pure number that was written down; told from `NUMBER`, which was declared or follows, by identity."""

_SAME = frozenset(("add", "min", "max", "lt", "le", "eq", "ne"))
_ANGLES = frozenset(("sin", "cos", "tan", "exp", "log", "log10", "sinh", "cosh", "tanh", "asin", "acos", "atan"))
_KEEPING = frozenset(("neg", "abs", "floor", "ceil", "trunc"))
_NUMBERS = frozenset(("and", "or", "not", "sign"))

Disagreement = Callable[[Expr, Expr, Unit, Expr | None, Unit | None], None]
"""Called with the node, its operand and that operand's unit, and a second operand with another unit; where there is none, the
operand should have been dimensionless."""


@dataclass(slots=True)
class Rules:
    """`leaf` gives the unit of a parameter or variable by name, None if unknown. `disagree` hears of each wrong node once.

    Results are kept, so a shared subexpression costs once; `forget` drops them when more has become known.
    """

    leaf: Callable[[Expr], Unit | None]
    disagree: Disagreement | None = None
    known: dict[Expr, Unit | None] = field(default_factory=dict)

    def unit(self, root: Expr) -> Unit | None:
        """The unit of the expression; `PURE` or None as the module says."""
        for node in topological((root,), self.known):
            self.known[node] = self._combine(node)
        return self.known[root]

    def _combine(self, node: Expr) -> Unit | None:
        units = [self.known[arg] for arg in node.args]
        match node.op:
            case "const":
                return PURE if _bare(node.data) else None
            case "param" | "var":
                return self.leaf(node)
            case "time":
                return None  # `sin(3*time)` and `f = 0.1*time` are fine: the number carries what is missing
            case "mul":
                return _product(units[0], units[1], times)
            case "div":
                return _product(units[0], units[1], over)
            case "pow":
                return self._power(node, units[0], units[1])
            case "sqrt":
                return units[0] if units[0] in (None, PURE) else power(units[0], Fraction(1, 2))
            case "if":
                return self._same(node, node.args[1:], units[1:])
            case "atan2":
                self._same(node, node.args, units)
                return PURE
            case "add" if _is_shifted(units):
                return None  # `T + 273.15` changes the scale, `T - T0` is a difference
            case op if op in _SAME:
                common = self._same(node, node.args, units)
                return common if op in ("add", "min", "max") else PURE
            case op if op in _KEEPING:
                return units[0]
            case op if op in _ANGLES:
                self._number(node, node.args[0], units[0])
                return PURE
            case op if op in _NUMBERS:
                return PURE
            case _:
                return None

    def _same(self, node: Expr, args: tuple[Expr, ...], units: list[Unit | None]) -> Unit | None:
        """The one unit of operands that are added or compared."""
        found = [(arg, unit) for arg, unit in zip(args, units, strict=True) if unit is not None and unit is not PURE]
        if not found:
            return PURE if None not in units else None
        first, common = found[0]
        for arg, unit in found[1:]:
            if not agree(unit, common):
                if self.disagree:
                    self.disagree(node, first, common, arg, unit)
                return None
        return common

    def _number(self, node: Expr, arg: Expr, unit: Unit | None) -> None:
        if unit is not None and unit is not PURE and not agree(unit, NUMBER) and self.disagree:
            self.disagree(node, arg, unit, None, None)

    def _power(self, node: Expr, base: Unit | None, exponent: Unit | None) -> Unit | None:
        self._number(node, node.args[1], exponent)
        if base is None or base is PURE:
            return base
        last = node.args[1]
        if last.op != "const":
            return base if base.dimensionless and base.factor == 1.0 else None
        return power(base, Fraction(last.data).limit_denominator(1000))


def _is_shifted(units: list[Unit | None]) -> bool:
    """Whether one is a temperature with its own zero, and the others could be added to it."""
    found = [unit for unit in units if unit is not None and unit is not PURE]
    return any(unit.offset for unit in found) and len({unit.exponents for unit in found}) == 1


def _bare(value: float) -> bool:
    """Whether a written number is a mere sign, so that no unit can hide in it: in `9.81*m` and in `2*f^2` one does."""
    return abs(value) == 1.0 or value == 0.0


def _product(a: Unit | None, b: Unit | None, combine: Callable[[Unit, Unit], Unit]) -> Unit | None:
    if a is None or b is None:
        return None
    if a is PURE or b is PURE:
        known = b if a is PURE else a
        if known is PURE or (known.dimensionless and known.factor == 1.0):
            return PURE
    return combine(NUMBER if a is PURE else a, NUMBER if b is PURE else b)
