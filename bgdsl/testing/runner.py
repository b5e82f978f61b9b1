"""`bgc test`: carry out the `test` blocks of `.bg` files.

A test runs models, then asserts. A failing assertion shows its worst point: time, value, wanted, allowed.
"""

from __future__ import annotations

import operator
import time as clock
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from bgdsl import pipeline
from bgdsl.diagnostics import BgError, Code, Diagnostic, Reporter, did_you_mean
from bgdsl.ir.library import Library
from bgdsl.source import Span
from bgdsl.syntax import ast
from bgdsl.syntax.parser import read_source
from bgdsl.testing.values import BINARY, ELEMENTWISE, OVER_TIME, RELATIONS, Series, Value, combine

FAILED = Code("BG650", "an assertion of a test failed")
NOT_RAISED = Code("BG651", "an expected error was not reported")
UNKNOWN = Code("BG652", "a name in a test is not known")
CANNOT = Code("BG653", "an expression of a test has no value")


@dataclass(frozen=True, slots=True)
class Outcome:
    """One test: passed if `findings` is empty; `error` marks a test that could not be carried out."""

    file: Path
    name: str
    findings: tuple[Diagnostic, ...]
    seconds: float
    error: bool = False

    @property
    def passed(self) -> bool:
        return not self.findings


def collect(paths: Iterable[Path]) -> list[Path]:
    """The files named, and the `.bg` files in the folders named, that hold the word `test`."""
    files: list[Path] = []
    for path in paths:
        files += sorted(path.rglob("*.bg")) if path.is_dir() else [path]
    return [file for file in files if not file.is_file() or "test" in file.read_text("utf-8", errors="replace")]


def run_file(path: Path, *, search: Iterable[Path] = (), only: str | None = None) -> list[Outcome]:
    """Carry out every test block of a file whose name contains `only`. BgError if the file itself cannot be read."""
    report = Reporter()
    source = read_source(path, report)
    report.stop_if_errors()
    library = pipeline.load_library(source, tuple(search), report)
    tests = [item for item in library.main.tree.items if isinstance(item, ast.Test)]
    return [_outcome(library, path, test) for test in tests if only is None or only in test.name]


def _outcome(library: Library, path: Path, test: ast.Test) -> Outcome:
    began = clock.perf_counter()
    context = _Context(library, path.parent)
    error = False
    try:
        for statement in test.statements:
            context.carry_out(statement)
        findings = tuple(context.report.diagnostics)
    except BgError as failure:
        findings = tuple(dict.fromkeys((*context.report.diagnostics, *failure.diagnostics)))
        error = True
    findings = tuple(d for d in findings if d.severity == "error")
    return Outcome(path, test.name, findings, clock.perf_counter() - began, error)


Source = Any
"""A run or a reference file: anything with `time` and `series(name) -> Series`."""


@dataclass
class _Context:
    """A test under way: the runs made so far, and what was found."""

    library: Library
    folder: Path
    runs: dict[str, Source] = field(default_factory=dict)
    report: Reporter = field(default_factory=Reporter)

    def carry_out(self, statement: ast.TestStatement) -> None:
        match statement:
            case ast.RunStatement(file=str() as file):
                self.runs[statement.name] = pipeline.reference(self.folder / file, statement.span, self.report)
            case ast.RunStatement():
                self.runs[statement.name] = self._run(statement)
            case ast.TestAssertion():
                self._check(statement)
            case ast.ExpectError():
                self._expect(statement)

    def _run(self, statement: ast.RunStatement) -> Source:
        model = pipeline.instantiate_modified(self.library, statement.model, statement.arguments, statement.span, Reporter())
        options: dict[str, Any] = {}
        for name, value in statement.options:
            option = {"for": "stop"}.get(name, name)
            given = value.value if isinstance(value, ast.String) else self.value(value)
            options[option] = given
        return model.compile().simulate(experiment=statement.experiment, **options)

    # ------------------------------------------------------------------------------------------------- assertions

    def _check(self, statement: ast.TestAssertion) -> None:
        condition = statement.condition
        if isinstance(condition, ast.Binary) and condition.operator in RELATIONS:
            self._compare(statement, condition)
            return
        value = self.value(condition)
        if not np.all(value.values if isinstance(value, Series) else value):
            self.report.add(FAILED, self._title(statement), condition.span, "is false" + self._first_false(value))

    @staticmethod
    def _first_false(value: Value) -> str:
        if not isinstance(value, Series):
            return ""
        return f", first at time {value.time[int(np.argmin(value.values))]:g}"

    def _compare(self, statement: ast.TestAssertion, condition: ast.Binary) -> None:
        left, right = self.value(condition.left), self.value(condition.right)
        allowed: Value = 0.0
        if statement.tolerance is not None:
            allowed = self.value(statement.tolerance)
            if statement.relative:
                allowed = combine(lambda share, wanted: share / 100 * np.abs(wanted), allowed, right)
        try:
            excess = combine(_EXCESS[condition.operator], left, right, allowed)
        except ValueError as error:
            self.report.fail(CANNOT, str(error), condition.span)
        worst, when = _worst(excess)
        if worst <= 0 and not np.isnan(worst):
            return
        pieces = [f"value {_at(left, when)}", f"wanted {condition.operator} {_at(right, when)}"]
        if statement.tolerance is not None:
            pieces.append(f"allowed +- {_at(allowed, when)}")
        place = "" if when is None else f"worst at time {when:.9g}: "
        self.report.add(FAILED, self._title(statement), condition.span, place + ", ".join(pieces))

    @staticmethod
    def _title(statement: ast.TestAssertion) -> str:
        return f"assertion failed: {statement.message}" if statement.message else "assertion failed"

    def _expect(self, statement: ast.ExpectError) -> None:
        try:
            model = pipeline.instantiate_modified(self.library, statement.model, statement.arguments, statement.span, Reporter())
            model.check()
        except BgError as error:
            found = sorted({d.code.number for d in error.diagnostics})
            if statement.code in found:
                return
            message = f"expected {statement.code}, found {', '.join(found)}"
        else:
            message = f"expected {statement.code}, and the model is right"
        self.report.add(NOT_RAISED, message, statement.span)

    # ------------------------------------------------------------------------------------------------------ values

    def value(self, node: ast.Expression) -> Value:
        """The value of an expression. BgError (BG652, BG653) where it has none."""
        match node:
            case ast.Number() | ast.String() | ast.Boolean():
                return node.value
            case ast.Unary("not", operand):
                return combine(np.logical_not, self.value(operand))
            case ast.Unary(sign, operand):
                return combine(operator.neg if sign == "-" else operator.pos, self.value(operand))
            case ast.Binary(sign, left, right):
                return self._apply(BINARY.get(sign) or RELATIONS[sign], node.span, self.value(left), self.value(right))
            case ast.Array(items):
                return np.array([self.value(item) for item in items], float)
            case ast.Reference():
                return self._reference(node)
            case ast.Call():
                return self._call(node)
            case _:
                self.report.fail(CANNOT, "this cannot stand in a test", node.span)

    def _apply(self, function: Callable[..., Any], span: Span, *values: Value) -> Value:
        try:
            return combine(function, *values)
        except (TypeError, ValueError) as error:
            self.report.fail(CANNOT, str(error), span)

    def _call(self, node: ast.Call) -> Value:
        name = node.function.text
        if node.function.parts[0].name in self.runs:
            return self._moment(node)
        values = [self.value(argument) for argument in node.arguments]
        try:
            if name in OVER_TIME and values and isinstance(values[0], Series):
                result = OVER_TIME[name](*values)
                return result if isinstance(result, np.ndarray) and result.ndim else float(result)
            if name in ("max", "min") and len(values) == 2:
                return combine(np.maximum if name == "max" else np.minimum, *values)
            if name in ELEMENTWISE:
                return combine(ELEMENTWISE[name], *values)
        except (TypeError, ValueError) as error:
            self.report.fail(CANNOT, str(error), node.span)
        self.report.fail(
            UNKNOWN,
            f"`{name}` is neither a run nor a function",
            node.function.span,
            helps=did_you_mean(name, (*self.runs, *ELEMENTWISE, *OVER_TIME)),
        )

    def _moment(self, node: ast.Call) -> Value:
        """`r.x(2.5)`, `r.x(end)`: a signal at one time."""
        series = self._reference(node.function)
        if not isinstance(series, Series) or len(node.arguments) != 1:
            self.report.fail(CANNOT, "a signal takes one time", node.span)
        argument = node.arguments[0]
        t = series.time[-1] if isinstance(argument, ast.End) else self._number(argument)
        try:
            moment = series.at(t)
        except (TypeError, ValueError) as error:
            self.report.fail(CANNOT, str(error), argument.span)
        return moment if isinstance(moment, np.ndarray) and moment.ndim else float(moment)

    def _number(self, node: ast.Expression) -> float:
        value = self.value(node)
        if not isinstance(value, float | int):
            self.report.fail(CANNOT, "a number is needed here", node.span)
        return float(value)

    def _reference(self, node: ast.Reference) -> Value:
        head, *rest = node.parts
        if head.name == "pi" and not rest:
            return float(np.pi)
        if head.name not in self.runs:
            self.report.fail(UNKNOWN, f"`{head.name}` is not a run of this test", node.span, helps=did_you_mean(head.name, self.runs))
        name = ".".join(part.name + _subscripts(part, self.value) for part in rest)
        run = self.runs[head.name]
        if name == "time":
            return Series(run.time, run.time)
        try:
            return Series(run.time, np.asarray(run[name], float))
        except KeyError as error:
            known = getattr(run, "names", ())
            self.report.fail(UNKNOWN, f"the run has no variable `{name}`", node.span, notes=_notes(error), helps=did_you_mean(name, known))


def _notes(error: KeyError) -> tuple[str, ...]:
    return tuple(str(a) for a in error.args[1:])


def _subscripts(part: ast.Part, value: Callable[[ast.Expression], Value]) -> str:
    return f"[{','.join(f'{value(s):.0f}' for s in part.subscripts)}]" if part.subscripts else ""


_EXCESS: Mapping[str, Callable[..., Any]] = {
    "==": lambda a, b, tol: np.abs(a - b) - tol,
    "<>": lambda a, b, tol: np.where(a != b, 0.0, 1.0),
    "<": lambda a, b, tol: np.where(a < b + tol, 0.0, np.maximum(a - b - tol, np.finfo(float).tiny)),
    "<=": lambda a, b, tol: a - b - tol,
    ">": lambda a, b, tol: np.where(a > b - tol, 0.0, np.maximum(b - a - tol, np.finfo(float).tiny)),
    ">=": lambda a, b, tol: b - a - tol,
}
"""By how much a comparison fails: not positive where it holds."""


def _worst(excess: Value) -> tuple[float, float | None]:
    """The largest excess and its time (None where time plays no part). A value that is not a number is worst of all."""
    values = np.asarray(excess.values if isinstance(excess, Series) else excess, float)
    if np.isnan(values).any():
        flat = np.isnan(values)
        worst = float("nan")
    else:
        worst = float(values.max(initial=-np.inf))
        flat = values == worst
    if not isinstance(excess, Series):
        return worst, None
    return worst, float(excess.time[int(np.argmax(flat.reshape(len(excess.time), -1).any(axis=1)))])


def _at(value: Value, when: float | None) -> str:
    if isinstance(value, Series):
        value = value.at(when if when is not None else value.time[-1])
    return np.array2string(value, precision=9) if isinstance(value, np.ndarray) and value.ndim else f"{value:.12g}"
