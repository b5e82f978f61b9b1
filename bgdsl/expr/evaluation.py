"""The numbers that expressions are, one node after the other: for few expressions; programs have compiled backends."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Mapping
from dataclasses import dataclass, field

from bgdsl.expr.nodes import FUNCTIONS, RELATIONS, Expr
from bgdsl.expr.walk import topological
from bgdsl.source import Span


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
        case op if op in RELATIONS:
            return RELATIONS[op](args[0], args[1])
        case op:
            return float(FUNCTIONS[op](*args))
