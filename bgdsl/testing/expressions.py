"""Expressions of tests: what `r.vA.f(end) - 2*r.x` is worth, given the runs of a test.

Input        syntax tree of an expression; runs and recorded files by name
Output       numbers, truth values, texts, arrays, signals over time (`values.Value`)
Reports      BG652 a name is not known, BG653 an expression has no value
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any, NoReturn

import numpy as np

from bgdsl.diagnostics import BgError, Code, Reporter, did_you_mean
from bgdsl.source import Span
from bgdsl.syntax import ast
from bgdsl.testing.places import moved
from bgdsl.testing.values import BINARY, ELEMENTWISE, OVER_TIME, RELATIONS, UNARY, Series, Value, combine, plain

UNKNOWN = Code("BG652", "a name in a test is not known")
CANNOT = Code("BG653", "an expression of a test has no value")

Recorded = Any
"""A run or a reference file: anything with `time`, `names` and `[name]`."""


class UnavailableError(Exception):
    """An expression needs a run that could not be made; the run itself has been reported."""


@dataclass
class Evaluation:
    """Evaluates expressions. `failed`: names of runs that could not be made; `moments`: times asked for since it was last cleared."""

    runs: dict[str, Recorded] = field(default_factory=dict)
    failed: set[str] = field(default_factory=set)
    moments: set[float] = field(default_factory=set)

    def value(self, node: ast.Expression) -> Value:
        """The value of an expression. BgError (BG652, BG653) where it has none."""
        match node:
            case ast.Number() | ast.String() | ast.Boolean():
                return node.value
            case ast.Unary(sign, operand):
                return self._apply(UNARY[sign], node.span, self.value(operand))
            case ast.Binary():
                return self._chain(node)
            case ast.If(branches, otherwise):
                return self._choice(branches, otherwise, node.span)
            case ast.Array(items):
                return np.array([self.number(item) for item in items])
            case ast.Matrix(rows):
                return np.array([self.number(item) for row in rows for item in row])
            case ast.Reference():
                return self._reference(node)
            case ast.Call():
                return self._call(node)
            case _:
                _refuse(CANNOT, "this cannot stand in a test", node.span)

    def _chain(self, node: ast.Binary) -> Value:
        """Operators one after the other lean left and may be many."""
        steps = [node]
        while isinstance(steps[-1].left, ast.Binary):
            steps.append(steps[-1].left)
        value = self.value(steps[-1].left)
        for step in reversed(steps):
            sign = step.operator
            value = self._apply(BINARY.get(sign) or RELATIONS[sign], step.span, value, self.value(step.right))
        return value

    def number(self, node: ast.Expression) -> float:
        """The value of an expression that has to be one number."""
        value = self.value(node)
        if not isinstance(value, float | int):
            _refuse(CANNOT, "a number is needed here", node.span)
        return float(value)

    def _apply(self, function: Callable[..., Any], span: Span, *values: Value) -> Value:
        try:
            return combine(function, *values)
        except (TypeError, ValueError) as error:
            text = isinstance(error, TypeError) and any(isinstance(value, str) for value in values)
            _refuse(CANNOT, "a text is not a number" if text else str(error), span)

    def _choice(self, branches: tuple[tuple[ast.Expression, ast.Expression], ...], otherwise: ast.Expression, span: Span) -> Value:
        result = self.value(otherwise)
        for condition, then in reversed(branches):
            result = self._apply(np.where, span, self.value(condition), self.value(then), result)
        return result

    # ------------------------------------------------------------------------------------------------------------ calls

    def _call(self, node: ast.Call) -> Value:
        name = node.function.text
        if "." in name or name in self.runs or name in self.failed:
            return self._moment(node)
        values = [self.value(argument) for argument in node.arguments]
        if name in ("max", "min") and len(values) == 2:
            return self._apply(np.maximum if name == "max" else np.minimum, node.span, *values)
        if name in OVER_TIME:
            return self._over_time(name, values, node.span)
        if name in ELEMENTWISE:
            return self._apply(ELEMENTWISE[name], node.span, *values)
        helps = did_you_mean(name, (*self.runs, *ELEMENTWISE, *OVER_TIME))
        _refuse(UNKNOWN, f"`{name}` is neither a run nor a function of tests", node.function.span, helps=helps)

    def _over_time(self, name: str, values: list[Value], span: Span) -> Value:
        if not values or not isinstance(values[0], Series) or any(isinstance(value, Series | str) for value in values[1:]):
            _refuse(CANNOT, f"`{name}` is of a signal of a run, such as `{name}(r.x)`", span)
        try:
            return plain(OVER_TIME[name](*values))
        except (TypeError, ValueError) as error:
            many = isinstance(error, TypeError)
            _refuse(CANNOT, f"`{name}` does not take {len(values)} values" if many else str(error), span)

    def _moment(self, node: ast.Call) -> Value:
        """`r.x(2.5)`, `r.x(end)`: a signal at one time."""
        series = self._reference(node.function)
        if not isinstance(series, Series) or len(node.arguments) != 1:
            _refuse(CANNOT, "a signal takes one time, such as `r.x(2.5)` or `r.x(end)`", node.span)
        (argument,) = node.arguments
        time = float(series.time[-1]) if isinstance(argument, ast.End) else self.number(argument)
        self.moments.add(time)
        try:
            return plain(series.at(time))
        except ValueError as error:
            _refuse(CANNOT, str(error), argument.span)

    # ------------------------------------------------------------------------------------------------------------ names

    def _reference(self, node: ast.Reference) -> Value:
        head, *rest = node.parts
        if head.name in self.failed:
            raise UnavailableError
        if head.name == "pi" and not rest:
            return float(np.pi)
        if head.name not in self.runs:
            helps = did_you_mean(head.name, self.runs)
            _refuse(UNKNOWN, f"`{head.name}` is not a run of this test", node.span, helps=helps)
        if not rest:
            _refuse(CANNOT, f"`{head.name}` is a run; a variable of it is `{head.name}.x`", node.span)
        run = self.runs[head.name]
        name = ".".join(part.name + self._subscripts(part) for part in rest)
        return Series(run.time, run.time) if name == "time" else Series(run.time, self._recorded(run, name, node.span))

    def _recorded(self, run: Recorded, name: str, span: Span) -> Any:
        try:
            return np.asarray(run[name], float)
        except BgError as error:
            raise BgError(moved(error.diagnostics, span)) from None
        except KeyError:
            helps = did_you_mean(name, run.names)
            _refuse(UNKNOWN, f"the record has no column `{name}`", span, helps=helps)

    def _subscripts(self, part: ast.Part) -> str:
        return f"[{','.join(self._subscript(node) for node in part.subscripts)}]" if part.subscripts else ""

    def _subscript(self, node: ast.Expression) -> str:
        if isinstance(node, ast.Colon | ast.Range | ast.End) or (number := self.number(node)) != int(number):
            _refuse(CANNOT, "a subscript in a test is one whole number", node.span)
        return str(int(number))


def _refuse(code: Code, message: str, span: Span, helps: Iterable[str] = ()) -> NoReturn:
    Reporter().fail(code, message, span, helps=helps)
