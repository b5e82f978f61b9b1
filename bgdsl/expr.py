"""Scalar expressions: the one form that flattening makes and every later floor reads.

An `Expr` is an immutable node of a shared graph. Equal expressions are one object (hash-consing), so common
subexpressions cost nothing to find, identity is equality, and dictionaries keyed by expressions are fast. The
constructors fold constants and drop neutral terms; they never reorder what the user wrote further than that.

Arrays are NumPy object arrays of `Expr`; they end where flattening ends. Booleans are 1.0 and 0.0.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from sys import getrefcount
from typing import Any

from bgdsl.source import Span

__all__ = [
    "FUNCTIONS",
    "ONE",
    "TIME",
    "ZERO",
    "Expr",
    "Table",
    "add",
    "binary",
    "const",
    "derivative",
    "evaluate",
    "if_else",
    "leaves",
    "linear_parts",
    "not_",
    "param",
    "partials",
    "relation",
    "rewrite",
    "substitute",
    "table",
    "to_text",
    "topological",
    "unary",
    "var",
    "variables",
]


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
        return _neg(self)

    def __add__(self, other: Expr | float) -> Expr:
        return add((self, _lift(other)))

    def __radd__(self, other: Expr | float) -> Expr:
        return add((_lift(other), self))

    def __sub__(self, other: Expr | float) -> Expr:
        return add((self, _neg(_lift(other))))

    def __rsub__(self, other: Expr | float) -> Expr:
        return add((_lift(other), _neg(self)))

    def __mul__(self, other: Expr | float) -> Expr:
        return _mul(self, _lift(other))

    def __rmul__(self, other: Expr | float) -> Expr:
        return _mul(_lift(other), self)

    def __truediv__(self, other: Expr | float) -> Expr:
        return _div(self, _lift(other))

    def __rtruediv__(self, other: Expr | float) -> Expr:
        return _div(_lift(other), self)

    def __pow__(self, other: Expr | float) -> Expr:
        return _pow(self, _lift(other))


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


def _neg(a: Expr) -> Expr:
    if a.op == "const":
        return const(-a.data)
    if a.op == "neg":
        return a.args[0]
    if a.op == "mul" and a.args[0].op == "const":
        return _mul(const(-a.args[0].data), a.args[1])
    return _make("neg", (a,))


def _mul(a: Expr, b: Expr) -> Expr:
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
            return _neg(b)
        if b.op == "neg":
            return _mul(const(-value), b.args[0])
        if b.op == "mul" and b.args[0].op == "const":
            return _mul(const(value * b.args[0].data), b.args[1])
        return _make("mul", (a, b))
    for one, other in ((a, b), (b, a)):
        if one.op == "if" and one.args[1] in _SWITCH and one.args[2] in _SWITCH:
            # a derivative's switch: what is switched off may be infinite there, and 0 times that is not 0
            return if_else(one.args[0], other if one.args[1] is ONE else ZERO, other if one.args[2] is ONE else ZERO)
    if a.op == "neg":
        return _mul(a.args[0], b.args[0]) if b.op == "neg" else _neg(_mul(a.args[0], b))
    if b.op == "neg":
        return _neg(_mul(a, b.args[0]))
    return _make("mul", (a, b))  # as written: which of a*b and b*a was there first must not show in what is generated


def _div(a: Expr, b: Expr) -> Expr:
    if b.op == "const" and b.data != 0.0:
        if a.op == "const":
            return const(a.data / b.data)
        if b.data == 1.0:
            return a
        if b.data == -1.0:
            return _neg(a)
    if a.is_zero and not b.is_zero:
        return ZERO
    if a is b and not b.is_const:
        return ONE
    if a.op == "neg":
        return _neg(_div(a.args[0], b))
    if b.op == "neg":
        return _neg(_div(a, b.args[0]))
    return _make("div", (a, b))


def _pow(a: Expr, b: Expr) -> Expr:
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

_RELATIONS: Mapping[str, Callable[[float, float], bool]] = {
    "lt": lambda a, b: a < b,
    "le": lambda a, b: a <= b,
    "eq": lambda a, b: a == b,
    "ne": lambda a, b: a != b,
    "and": lambda a, b: bool(a) and bool(b),
    "or": lambda a, b: bool(a) or bool(b),
}


def unary(name: str, a: Expr) -> Expr:
    """An elementary function of one argument."""
    if a.op == "const":
        try:
            return const(FUNCTIONS[name](a.data))
        except (ArithmeticError, ValueError):
            pass  # outside its domain: left as written, found when it is evaluated
    elif a.op == "neg":
        if name in ("sin", "tan", "asin", "atan", "sinh", "tanh", "sign"):
            return _neg(unary(name, a.args[0]))
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
        return const(float(_RELATIONS[name](a.data, b.data)))
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


@dataclass(frozen=True)
class Table:
    """A table as a piecewise polynomial: on [x[i], x[i+1]) its value is sum_k c[k][i] (x - x[i])^(K-k), as in scipy's PPoly.

    Beyond the ends it continues periodically (period x[-1] - x[0]) or holds the last polynomial.
    """

    name: str
    x: tuple[float, ...]
    c: tuple[tuple[float, ...], ...]
    periodic: bool
    span: Span | None = field(default=None, compare=False, repr=False)
    """Where the model makes the table."""

    def __call__(self, x: float, order: int = 0) -> float:
        from bisect import bisect_right

        if self.periodic:
            x = self.x[0] + (x - self.x[0]) % (self.x[-1] - self.x[0])
        i = min(max(bisect_right(self.x, x) - 1, 0), len(self.x) - 2)
        d = x - self.x[i]
        degree = len(self.c) - 1
        value = 0.0
        for k in range(degree + 1 - order):
            factor = float(math.perm(degree - k, order))
            value = value * d + factor * self.c[k][i]
        return value


# -------------------------------------------------------------------------------------------------------------- walking


def topological(roots: Iterable[Expr], done: Container[Expr] = ()) -> Iterator[Expr]:
    """Every node under the roots once, operands before users, in an order fixed by the roots alone.

    Nodes in `done`, and what only they reach, are left out; the caller may add to it what was yielded.
    """
    seen: set[Expr] = set()
    for root in roots:
        if not root.args:  # a leaf, as very many roots are
            if root not in seen and root not in done:
                seen.add(root)
                yield root
            continue
        stack = [root]
        while stack:
            node = stack[-1]
            if node in seen or node in done:
                stack.pop()
                continue
            missing = [arg for arg in node.args if arg not in seen and arg not in done]
            if missing:
                missing.reverse()
                stack += missing
            else:
                stack.pop()
                seen.add(node)
                yield node


def variables(roots: Iterable[Expr]) -> list[str]:
    """The names of the variables under the roots, each once, in the order in which they are met from left to right."""
    seen: set[Expr] = set()
    names: list[str] = []
    stack = [*roots][::-1]
    while stack:
        node = stack.pop()
        if node in seen:
            continue
        seen.add(node)
        if node.args:
            stack += node.args[::-1]
        elif node.op == "var":
            names.append(node.data)
    return names


def leaves(roots: Iterable[Expr], op: str = "var") -> Iterator[Expr]:
    """The leaves of one kind (`var`, `param`, `time`) under the roots, each once."""
    return (node for node in topological(roots) if node.op == op)


_BUILD: Mapping[str, Callable[..., Expr]] = {
    "add": lambda *args: add(args),
    "mul": _mul,
    "div": _div,
    "pow": _pow,
    "neg": _neg,
    "not": not_,
    "if": if_else,
    **{name: (lambda a, b, name=name: relation(name, a, b)) for name in _RELATIONS},
    **{
        name: (lambda a, b, name=name: binary(name, a, b)) if name in ("atan2", "min", "max") else (lambda a, name=name: unary(name, a))
        for name in FUNCTIONS
    },
}


def rebuild(node: Expr, args: tuple[Expr, ...]) -> Expr:
    """The node with other operands, simplified anew."""
    if all(new is old for new, old in zip(args, node.args, strict=True)):
        return node
    return table(node.data[0], args[0], node.data[1]) if node.op == "table" else _BUILD[node.op](*args)


def substitute(roots: Iterable[Expr], replacement: Mapping[Expr, Expr]) -> tuple[Expr, ...]:
    """The roots with every node that is a key replaced by its value (values are not searched again)."""
    return rewrite(roots, dict(replacement))


def rewrite(roots: Iterable[Expr], done: dict[Expr, Expr]) -> tuple[Expr, ...]:
    """As `substitute`; every node met is added to `done`, so that later calls with the same one go on from there."""
    roots = tuple(roots)
    for node in topological(roots, done):
        done[node] = rebuild(node, tuple(done[arg] for arg in node.args)) if node.args else node
    return tuple(done[root] for root in roots)


def evaluate(
    root: Expr,
    values: Mapping[str, float] | None = None,
    *,
    time: float = 0.0,
    tables: Mapping[str, Table] | None = None,
    parameters: Mapping[str, float] | None = None,
) -> float:
    """The number that `root` is, given the values of its `param` and `var` leaves by name.

    A parameter and a variable may share a name (`drive.e`): then `parameters` holds those of parameters; without it `values`
    serves both. KeyError for a leaf without value, ArithmeticError or ValueError outside a function's domain.
    """
    known: dict[Expr, float] = {}
    values = values or {}
    parameters = values if parameters is None else parameters
    for node in topological((root,)):
        if node.op == "param":
            known[node] = parameters[node.data]
        else:
            known[node] = _value(node, [known[arg] for arg in node.args], values, time, tables or {})
    return known[root]


def _value(node: Expr, args: list[float], values: Mapping[str, float], time: float, tables: Mapping[str, Table]) -> float:
    match node.op:
        case "const":
            return float(node.data)
        case "var":
            return values[node.data]
        case "time":
            return time
        case "add":
            return math.fsum(args) if len(args) > 2 else args[0] + args[1]
        case "mul":
            return args[0] * args[1]
        case "div":
            return args[0] / args[1]
        case "pow":
            value = args[0] ** args[1]
            if isinstance(value, complex):
                raise ValueError("fractional power of a negative number")
            return float(value)
        case "neg":
            return -args[0]
        case "not":
            return float(not args[0])
        case "if":
            return args[1] if args[0] else args[2]
        case "table":
            return tables[node.data[0]](args[0], node.data[1])
        case op if op in _RELATIONS:
            return float(_RELATIONS[op](args[0], args[1]))
        case op:
            return float(FUNCTIONS[op](*args))


# ------------------------------------------------------------------------------------------------------ differentiation


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


# ----------------------------------------------------------------------------------------------------------------- text


_PRECEDENCE = {"or": 1, "and": 2, "not": 3, "lt": 4, "le": 4, "eq": 4, "ne": 4, "add": 5, "neg": 5, "mul": 6, "div": 6, "pow": 7}
_SIGNS = {"or": " or ", "and": " and ", "lt": " < ", "le": " <= ", "eq": " == ", "ne": " <> ", "mul": "*", "div": "/", "pow": "^"}


def to_text(root: Expr) -> str:
    """The expression in the language's own notation, with no more parentheses than it needs."""
    shown: dict[Expr, tuple[str, int]] = {}

    def wrapped(node: Expr, least: int) -> str:
        text, precedence = shown[node]
        return text if precedence >= least else f"({text})"

    for node in topological((root,)):
        own = _PRECEDENCE.get(node.op, 8)
        args = node.args
        match node.op:
            case "const":
                text = repr(int(node.data)) if node.data.is_integer() and abs(node.data) < 1e15 else repr(node.data)
                own = 5 if node.data < 0 else 8
            case "param" | "var":
                text = node.data
            case "time":
                text = "time"
            case "add":
                text = wrapped(args[0], 5)
                for arg in args[1:]:
                    if arg.op == "neg":
                        text += f" - {wrapped(arg.args[0], 6)}"
                    elif shown[arg][0].startswith("-"):
                        text += f" - {shown[arg][0][1:]}" if shown[arg][1] >= 5 else f" + {wrapped(arg, 6)}"
                    else:
                        text += f" + {wrapped(arg, 6)}"
            case "neg":
                text = f"-{wrapped(args[0], 6)}"
            case "not":
                text = f"not {wrapped(args[0], 4)}"
            case "if":
                text = f"if {shown[args[0]][0]} then {shown[args[1]][0]} else {shown[args[2]][0]}"
                own = 0
            case "table":
                text = f"{node.data[0]}{chr(39) * node.data[1]}({shown[args[0]][0]})"
            case op if op in _SIGNS:
                right = own + 1 if op in ("div", "pow", "lt", "le", "eq", "ne", "mul") else own
                left = own + 1 if op in ("pow", "lt", "le", "eq", "ne") else own
                text = _SIGNS[op].join((wrapped(args[0], left), wrapped(args[1], right)))
                if op == "mul" and text.startswith("-"):
                    own = 5
            case op:
                text = f"{op}({', '.join(shown[arg][0] for arg in args)})"
        shown[node] = (text, own)
    return shown[root][0]
