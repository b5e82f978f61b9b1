"""Can this expression vanish? Signs that an expression can take, from its form.

A parameter counts as nonzero if its default is (causality may divide by it; a run with it set to zero stops with a message); its
sign is known where its declared range tells it. States, signals and time can have any value.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

from bgdsl.expr import Expr, evaluate, leaves, topological
from bgdsl.ir.graph import BondGraph, Parameter

Signs = frozenset[int]
ANY: Signs = frozenset((-1, 0, 1))
POSITIVE: Signs = frozenset((1,))
NOT_NEGATIVE: Signs = frozenset((0, 1))
_KEEPS_SIGN = ("tan", "asin", "atan", "sinh", "tanh", "sign", "sqrt")


class Moduli:
    """Answers about the expressions of one graph; parameters' defaults are worked out once, when needed."""

    def __init__(self, graph: BondGraph):
        self._parameters: Mapping[str, tuple[Parameter, int]] = {
            name: (parameter, i) for parameter in graph.parameters for i, name in enumerate(parameter.scalars())
        }
        self._defaults: dict[str, float | None] = {}
        self._tables = graph.tables
        self._signs: dict[Expr, Signs] = {}

    def can_vanish(self, root: Expr) -> bool:
        """True unless the expression is nonzero for whatever its variables may be."""
        return 0 in self.signs(root)

    def signs(self, root: Expr) -> Signs:
        """The signs (-1, 0, 1) that the expression may take."""
        for node in topological((root,), self._signs):
            self._signs[node] = self._sign(node)
        found = self._signs[root]
        if len(found) > 1 and 0 in found and self._only_parameters(root):
            value = self._evaluate(root)
            return found - {0} if value else found
        return found

    def value(self, root: Expr) -> float | None:
        """The number that an expression over parameters has with their defaults; None where it reads anything else."""
        return self._evaluate(root) if self._only_parameters(root) else None

    @staticmethod
    def _only_parameters(root: Expr) -> bool:
        return not any(True for _ in leaves((root,), "var")) and not any(True for _ in leaves((root,), "time"))

    def default(self, name: str) -> float | None:
        """The default of a scalar parameter, None where it has no finite number."""
        stack = [name]
        while stack:
            wanted = stack[-1]
            if wanted in self._defaults or wanted not in self._parameters:
                stack.pop()
                continue
            parameter, i = self._parameters[wanted]
            open_ones = [leaf.data for leaf in leaves((parameter.values[i],), "param") if leaf.data not in self._defaults]
            if any(leaf in stack or leaf not in self._parameters for leaf in open_ones):
                self._defaults[wanted] = None
            elif open_ones:
                stack += open_ones
                continue
            else:
                self._defaults[wanted] = self._evaluate(parameter.values[i])
            stack.pop()
        return self._defaults.get(name)

    def _evaluate(self, root: Expr) -> float | None:
        values = {leaf.data: value for leaf in leaves((root,), "param") if (value := self._known(leaf.data)) is not None}
        try:
            return evaluate(root, values, tables=self._tables)
        except (KeyError, ArithmeticError, ValueError):
            return None

    def _known(self, name: str) -> float | None:
        return self._defaults[name] if name in self._defaults else self.default(name)

    def _sign(self, node: Expr) -> Signs:
        args = [self._signs[arg] for arg in node.args]
        match node.op:
            case "const":
                return frozenset(((node.data > 0) - (node.data < 0),))
            case "param":
                return self._parameter_signs(node.data)
            case "add":
                low, high = self._sum_range(node)
                return frozenset((1,)) if low > 0 else frozenset((-1,)) if high < 0 else _sum(args)
            case "mul" if node.args[0] is node.args[1]:
                return _square(args[0])
            case "mul":
                return frozenset(a * b for a in args[0] for b in args[1])
            case "div":
                return frozenset(a * b for a in args[0] for b in (args[1] - {0} or ANY))
            case "pow":
                return _power(args[0], node.args[1])
            case "neg":
                return frozenset(-a for a in args[0])
            case "exp" | "cosh":
                return POSITIVE
            case "abs":
                return _square(args[0])
            case op if op in _KEEPS_SIGN:
                return args[0] & NOT_NEGATIVE or NOT_NEGATIVE if op == "sqrt" else args[0]
            case "if":
                return args[1] | args[2]
            case "min" | "max":
                pick = min if node.op == "min" else max
                return frozenset(pick(a, b) for a in args[0] for b in args[1])
            case _:
                return ANY

    def _sum_range(self, node: Expr) -> tuple[float, float]:
        """Bounds of a sum as far as constants and functions of bounded range tell (`2 + cos(x)` lies from 1 to 3)."""
        ranges = [self._range(arg) for arg in node.args]
        return sum(low for low, _ in ranges), sum(high for _, high in ranges)

    def _range(self, node: Expr) -> tuple[float, float]:
        match node.op:
            case "const":
                return node.data, node.data
            case "sin" | "cos" | "tanh":
                return -1.0, 1.0
            case "neg":
                low, high = self._range(node.args[0])
                return -high, -low
            case "mul" if node.args[0].is_const:
                low, high = self._range(node.args[1])
                ends = (node.args[0].data * low, node.args[0].data * high)
                return min(ends), max(ends)
            case _:
                signs = self._signs[node]
                return (-math.inf if -1 in signs else 0.0), (math.inf if 1 in signs else 0.0)

    def _parameter_signs(self, name: str) -> Signs:
        value = self.default(name)
        if not value:
            return ANY
        parameter, i = self._parameters[name]
        low, high = (self._evaluate(bound[i]) if bound is not None else None for bound in (parameter.low, parameter.high))
        if parameter.constant or (low is not None and low >= 0) or (high is not None and high <= 0):
            return frozenset((1 if value > 0 else -1,))
        return frozenset((-1, 1))


def _sum(args: Iterable[Signs]) -> Signs:
    found: set[int] = {0}
    for signs in args:
        found = {c for a in found for b in signs for c in (((a or b),) if a * b >= 0 else (-1, 0, 1))}
    return frozenset(found)


def _square(signs: Signs) -> Signs:
    return frozenset(a * a for a in signs)


def _power(base: Signs, exponent: Expr) -> Signs:
    if not exponent.is_const:
        return POSITIVE if base == POSITIVE else ANY
    value = exponent.data
    if value.is_integer() and value % 2 == 0:
        return _square(base) if value > 0 else POSITIVE
    if value.is_integer():
        return base if value > 0 else base - {0} or ANY
    return base & NOT_NEGATIVE or NOT_NEGATIVE
