"""The nodes: each made once, by constructors that fold constants and drop neutral terms."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from sys import getrefcount
from typing import Any


class Expr:
    """One node. `op` names it, `args` are its operands, `data` is a constant's value, a leaf's name or a table's (name, order).

    Leaves: `const`, `param` (a parameter's scalar name), `var` (any unknown or state by its scalar name), `time`.
    Operators: `add` (n-ary), `mul`, `div`, `pow`, `neg`; `lt le eq ne and or not if`; `table`; and the names in FUNCTIONS.
    """

    __slots__ = ("args", "data", "op")

    op: str
    args: tuple[Expr, ...]
    data: Any

    def __init__(self) -> None:
        raise TypeError("expressions are made by the functions of this module")

    def __repr__(self) -> str:
        from bgdsl.expr.text import to_text

        return f"Expr({to_text(self)})"

    def __reduce__(self) -> tuple[Any, ...]:
        return _make, (self.op, self.args, self.data)

    @property
    def is_const(self) -> bool:
        return self.op == "const"

    @property
    def is_zero(self) -> bool:
        return self.op == "const" and self.data == 0.0

    def __neg__(self) -> Expr:
        return neg(self)

    def __add__(self, other: Expr | float) -> Expr:
        return add((self, _lift(other)))

    def __radd__(self, other: Expr | float) -> Expr:
        return add((_lift(other), self))

    def __sub__(self, other: Expr | float) -> Expr:
        return add((self, neg(_lift(other))))

    def __rsub__(self, other: Expr | float) -> Expr:
        return add((_lift(other), neg(self)))

    def __mul__(self, other: Expr | float) -> Expr:
        return mul(self, _lift(other))

    def __rmul__(self, other: Expr | float) -> Expr:
        return mul(_lift(other), self)

    def __truediv__(self, other: Expr | float) -> Expr:
        return div(self, _lift(other))

    def __rtruediv__(self, other: Expr | float) -> Expr:
        return div(_lift(other), self)

    def __pow__(self, other: Expr | float) -> Expr:
        return power(self, _lift(other))


_table: dict[tuple[Any, ...], Expr] = {}
_LEAST = 200_000
_limit = _LEAST


def _make(op: str, args: tuple[Expr, ...], data: Any = None) -> Expr:
    key = (op, data, args)
    node = _table.get(key)
    if node is None:
        if len(_table) >= _limit:
            _sweep()
        node = _new(Expr)
        node.op = op
        node.args = args
        node.data = data
        _table[key] = node
    return node


_new = object.__new__


def _sweep() -> None:
    """Forget the nodes that nothing but the table holds. Doing so whenever the table has doubled makes nodes twice as fast as a
    table of weak references does. The newest come first: a node is younger than its operands, which it may be the last to hold."""
    global _limit
    keys = list(_table)
    while keys:
        key = keys.pop()
        node = _table[key]
        if getrefcount(node) == _UNUSED:
            del _table[key]
    _limit = max(_LEAST, 2 * len(_table))


_UNUSED = 3
"""References to a node that only the table holds, as counted in `_sweep`: the table's, a local one, the count's own argument."""


def const(value: float) -> Expr:
    """The constant `value` (booleans become 1.0 and 0.0)."""
    return _make("const", (), float(value))


ZERO = const(0.0)
ONE = const(1.0)
MINUS_ONE = const(-1.0)
_SWITCH = (ZERO, ONE)
TIME = _make("time", ())


def param(name: str) -> Expr:
    """The parameter with this scalar name (`rod.r[2]`)."""
    return _make("param", (), name)


def var(name: str) -> Expr:
    """The state, junction, bond or signal variable with this scalar name (`spring.q[1]`)."""
    return _make("var", (), name)


def _lift(value: Expr | float) -> Expr:
    return value if isinstance(value, Expr) else const(value)


# --------------------------------------------------------------------------------------------------------- constructors


def add(terms: Iterable[Expr]) -> Expr:
    """The sum of the terms, in their order; constants are gathered at the end. No terms make zero."""
    kept: list[Expr] = []
    total = 0.0
    for term in terms:
        if term.op == "const":
            total += term.data
        else:
            kept.append(term)
    if len(kept) == 2 and _cancel(kept[0], kept[1]):
        kept = []
    if total != 0.0 or not kept:
        kept.append(const(total))
    if len(kept) == 1:
        return kept[0]
    return _make("add", tuple(kept))


def _cancel(a: Expr, b: Expr) -> bool:
    """Whether one is the negation of the other."""
    return (a.op == "neg" and a.args[0] is b) or (b.op == "neg" and b.args[0] is a)


def neg(a: Expr) -> Expr:
    """-a."""
    if a.op == "const":
        return const(-a.data)
    if a.op == "neg":
        return a.args[0]
    if a.op == "mul" and a.args[0].op == "const":
        return mul(const(-a.args[0].data), a.args[1])
    return _make("neg", (a,))


def mul(a: Expr, b: Expr) -> Expr:
    """a b; a constant factor stands first."""
    if b.op == "const":
        a, b = b, a
    if a.op == "const":
        value = a.data
        if b.op == "const":
            return const(value * b.data)
        if value == 0.0:
            return ZERO
        if value == 1.0:
            return b
        if value == -1.0:
            return neg(b)
        if b.op == "neg":
            return mul(const(-value), b.args[0])
        if b.op == "mul" and b.args[0].op == "const":
            return mul(const(value * b.args[0].data), b.args[1])
        return _make("mul", (a, b))
    for one, other in ((a, b), (b, a)):
        if one.op == "if" and one.args[1] in _SWITCH and one.args[2] in _SWITCH:
            # a derivative's switch: what is switched off may be infinite there, and 0 times that is not 0
            return if_else(one.args[0], other if one.args[1] is ONE else ZERO, other if one.args[2] is ONE else ZERO)
    if a.op == "neg":
        return mul(a.args[0], b.args[0]) if b.op == "neg" else neg(mul(a.args[0], b))
    if b.op == "neg":
        return neg(mul(a, b.args[0]))
    return _make("mul", (a, b))  # as written: which of a*b and b*a was there first must not show in what is generated


def div(a: Expr, b: Expr) -> Expr:
    """a/b; by a constant zero it stays as written, and fails when it is evaluated."""
    if b.op == "const" and b.data != 0.0:
        if a.op == "const":
            return const(a.data / b.data)
        if b.data == 1.0:
            return a
        if b.data == -1.0:
            return neg(a)
    if a.is_zero and not b.is_zero:
        return ZERO
    if a is b and not b.is_const:
        return ONE
    if a.op == "neg":
        return neg(div(a.args[0], b))
    if b.op == "neg":
        return neg(div(a, b.args[0]))
    return _make("div", (a, b))


def power(a: Expr, b: Expr) -> Expr:
    """a to the power of b."""
    if b.op == "const":
        if b.data == 0.0:
            return ONE
        if b.data == 1.0:
            return a
        if a.op == "const":
            try:
                value = a.data**b.data
            except (ArithmeticError, ValueError):
                return _make("pow", (a, b))
            if isinstance(value, float):
                return const(value)
    return _make("pow", (a, b))


def _trunc(x: float) -> float:
    return float(math.trunc(x))


FUNCTIONS: Mapping[str, Callable[..., float]] = {
    "sin": math.sin,
    "cos": math.cos,
    "tan": math.tan,
    "asin": math.asin,
    "acos": math.acos,
    "atan": math.atan,
    "atan2": math.atan2,
    "sinh": math.sinh,
    "cosh": math.cosh,
    "tanh": math.tanh,
    "exp": math.exp,
    "log": math.log,
    "log10": math.log10,
    "sqrt": math.sqrt,
    "abs": abs,
    "sign": lambda x: float((x > 0) - (x < 0)),
    "floor": lambda x: float(math.floor(x)),
    "ceil": lambda x: float(math.ceil(x)),
    "trunc": _trunc,
    "min": min,
    "max": max,
}
"""The elementary functions with their meaning on floats: `atan2`, `min`, `max` take two arguments, the others one."""

RELATIONS: Mapping[str, Callable[[float, float], float]] = {
    "lt": lambda a, b: float(a < b),
    "le": lambda a, b: float(a <= b),
    "eq": lambda a, b: float(a == b),
    "ne": lambda a, b: float(a != b),
    "and": lambda a, b: float(bool(a) and bool(b)),
    "or": lambda a, b: float(bool(a) or bool(b)),
}
"""The relations with their meaning on floats: 1.0 where they hold, else 0.0."""


def unary(name: str, a: Expr) -> Expr:
    """An elementary function of one argument."""
    if a.op == "const":
        try:
            return const(FUNCTIONS[name](a.data))
        except (ArithmeticError, ValueError):
            pass  # outside its domain: left as written, found when it is evaluated
    elif a.op == "neg":
        if name in ("sin", "tan", "asin", "atan", "sinh", "tanh", "sign"):
            return neg(unary(name, a.args[0]))
        if name in ("cos", "cosh", "abs"):
            return unary(name, a.args[0])
    return _make(name, (a,))


def binary(name: str, a: Expr, b: Expr) -> Expr:
    """`atan2`, `min` or `max`."""
    if a.op == "const" and b.op == "const":
        return const(FUNCTIONS[name](a.data, b.data))
    if a is b and name != "atan2":
        return a
    return _make(name, (a, b))


def relation(name: str, a: Expr, b: Expr) -> Expr:
    """`lt`, `le`, `eq`, `ne`, `and` or `or`."""
    if a.op == "const" and b.op == "const":
        return const(RELATIONS[name](a.data, b.data))
    if name in ("and", "or"):
        for one, other in ((a, b), (b, a)):
            if one.op == "const":
                return other if bool(one.data) == (name == "and") else one
    return _make(name, (a, b))


def not_(a: Expr) -> Expr:
    """Logical negation."""
    if a.op == "const":
        return const(float(not a.data))
    return a.args[0] if a.op == "not" else _make("not", (a,))


def if_else(condition: Expr, yes: Expr, no: Expr) -> Expr:
    """`yes` where the condition holds, else `no`."""
    if condition.op == "const":
        return yes if condition.data else no
    return yes if yes is no else _make("if", (condition, yes, no))


def table(name: str, x: Expr, order: int = 0) -> Expr:
    """The table called `name` at x, or its derivative of that order."""
    return _make("table", (x,), (name, order))
