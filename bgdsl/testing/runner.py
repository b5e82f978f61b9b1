"""`bgc test`: carry out the `test` blocks of `.bg` files.

A test runs models, then asserts. A failing assertion shows its worst point: time, value, wanted, allowed.
Reports      BG650 an assertion fails, BG651 an expected error does not come, and BG652, BG653 of `expressions`
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from bgdsl import pipeline
from bgdsl.diagnostics import BgError, Code, Diagnostic, Reporter, did_you_mean
from bgdsl.explanations import titles
from bgdsl.syntax import ast
from bgdsl.syntax.library import Library
from bgdsl.syntax.parser import read_source
from bgdsl.testing.expressions import CANNOT, UNKNOWN, Evaluation, Recorded, UnavailableError
from bgdsl.testing.places import moved
from bgdsl.testing.subjects import modified, record
from bgdsl.testing.values import RELATIONS, Series, Value, combine

FAILED = Code("BG650", "an assertion of a test failed")
NOT_RAISED = Code("BG651", "an expected error was not reported")


@dataclass(frozen=True, slots=True)
class Worst:
    """Where an assertion fails most. `time` in s, None where time plays no part; `entry` of an array, from 1."""

    time: float | None
    entry: int | None
    value: float
    wanted: float
    allowed: float


@dataclass(frozen=True, slots=True)
class Outcome:
    """One test: passed if `findings` is empty; `error` marks a test that could not be carried out. `worst` goes with failed assertions."""

    file: Path
    name: str
    findings: tuple[Diagnostic, ...]
    seconds: float
    error: bool = False
    worst: Mapping[Diagnostic, Worst] = field(default_factory=dict)

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
    library = _library(path, search)
    return [_outcome(library, path, test) for test in tests_of(library) if only is None or only in test.name]


def run_test(path: Path, number: int) -> Outcome:
    """Carry out one test block of a file, by its number from 0."""
    library = _library(path, ())
    return _outcome(library, path, tests_of(library)[number])


def tests_of(library: Library) -> tuple[ast.Test, ...]:
    """The test blocks of a library's own file."""
    return tuple(item for item in library.main.tree.items if isinstance(item, ast.Test))


def _library(path: Path, search: Iterable[Path]) -> Library:
    report = Reporter()
    source = read_source(path, report)
    report.stop_if_errors()
    return pipeline.load_library(source, tuple(search), report)


def _outcome(library: Library, path: Path, test: ast.Test) -> Outcome:
    began = clock.perf_counter()
    under_way = _UnderWay(library, path.parent)
    for statement in test.statements:
        under_way.carry_out(statement)
    findings = tuple(dict.fromkeys(d for d in under_way.report.diagnostics if d.severity == "error"))
    return Outcome(path, test.name, findings, clock.perf_counter() - began, under_way.error, under_way.worst)


class _UnderWay:
    """A test under way: the runs made so far, and what was found. An error spoils its own statement and those that need its run."""

    def __init__(self, library: Library, folder: Path):
        self.library = library
        self.folder = folder
        self.report = Reporter()
        self.evaluation = Evaluation()
        self.error = False
        self.worst: dict[Diagnostic, Worst] = {}

    def carry_out(self, statement: ast.TestStatement) -> None:
        try:
            self._carry_out(statement)
        except BgError as error:
            self.report.diagnostics += moved(error.diagnostics, statement.span)
            self.error = True
            if isinstance(statement, ast.RunStatement):
                self.evaluation.failed.add(statement.name)
        except UnavailableError:
            pass

    def _carry_out(self, statement: ast.TestStatement) -> None:
        match statement:
            case ast.RunStatement():
                if statement.name in self.evaluation.runs or statement.name in self.evaluation.failed:
                    Reporter().fail(CANNOT, f"there is a run `{statement.name}` already", statement.span)
                self.evaluation.runs[statement.name] = self._run(statement)
            case ast.TestAssertion():
                self.evaluation.moments.clear()
                self._check(statement)
            case ast.ExpectError():
                self._expect(statement)

    # ------------------------------------------------------------------------------------------------------------- runs

    def _run(self, statement: ast.RunStatement) -> Recorded:
        if statement.file is not None:
            return self._record(statement, statement.file)
        options: dict[str, Any] = {}
        for name, value in statement.options:
            options["stop" if name == "for" else name] = self._text(value) if name == "method" else self.evaluation.number(value)
        if "tolerance" in options:
            options["tolerance"] = step_tolerance(options["tolerance"])
        model = modified(self.library, statement.model, statement.arguments, statement.span)
        return model.compile().simulate(experiment=statement.experiment, **options)

    def _text(self, value: ast.Expression) -> str:
        if not isinstance(value, ast.String):
            Reporter().fail(CANNOT, 'a method is named in quotes, such as `method "rk45"`', value.span)
        return value.value

    def _record(self, statement: ast.RunStatement, file: str) -> Recorded:
        found = record(self.folder / file)
        if "time" not in found.names:
            Reporter().fail(CANNOT, f"{file} has no column `time`", statement.span, notes=[f"its columns are {', '.join(found.names)}"])
        return found

    # ------------------------------------------------------------------------------------------------------- assertions

    def _check(self, statement: ast.TestAssertion) -> None:
        condition = statement.condition
        if isinstance(condition, ast.Binary) and condition.operator in RELATIONS:
            self._compare(statement, condition)
            return
        value = self.evaluation.value(condition)
        holds = np.asarray(value.values if isinstance(value, Series) else value)
        holds = np.array([bool(text) for text in holds.flat]) if holds.dtype.kind == "U" else (holds != 0) & ~np.isnan(holds)
        if holds.all():
            return
        when = ""
        if isinstance(value, Series):
            when = f", first at time {value.time[int(np.argmin(holds.reshape(len(value.time), -1).all(axis=1)))]:g}"
        self.report.add(FAILED, _title(statement), condition.span, "is false" + when)

    def _compare(self, statement: ast.TestAssertion, condition: ast.Binary) -> None:
        left, right = self.evaluation.value(condition.left), self.evaluation.value(condition.right)
        allowed: Value = 0.0
        try:
            if statement.tolerance is not None:
                allowed = self.evaluation.value(statement.tolerance)
            if statement.relative:
                allowed = combine(lambda share, wanted: share / 100 * np.abs(wanted), allowed, right)
            excess = combine(_EXCESS[condition.operator], left, right, allowed)
        except (TypeError, ValueError) as error:
            text = any(isinstance(value, str) for value in (left, right, allowed))
            Reporter().fail(CANNOT, "texts cannot be compared" if text else str(error), condition.span)
        worst = _worst(excess, left, right, allowed, self.evaluation.moments)
        if worst is None:
            return
        self.report.add(FAILED, _title(statement), condition.span, _told(worst, condition.operator))
        self.worst[self.report.diagnostics[-1]] = worst

    def _expect(self, statement: ast.ExpectError) -> None:
        if statement.code not in titles():
            helps = did_you_mean(statement.code, titles())
            Reporter().fail(UNKNOWN, f"there is no diagnostic {statement.code}", statement.span, helps=helps)
        try:
            model = modified(self.library, statement.model, statement.arguments, statement.span)
            warned = {d.code.number for d in model.check()}
        except BgError as error:
            found = sorted({d.code.number for d in error.diagnostics})
            if statement.code in found:
                return
            message = f"expected {statement.code}, found {', '.join(found)}"
            notes = [f"{d.code.number}: {d.message}" for d in error.diagnostics]
        else:
            message, notes = f"expected {statement.code}, and {'it is a warning' if statement.code in warned else 'the model is right'}", []
        self.report.add(NOT_RAISED, message, statement.span, notes=notes)


def step_tolerance(wanted: float) -> float:
    """The tolerance that a solver gets where a test asks for results good to `wanted`.

    A solver holds its tolerance over each step, and what the steps leave adds up along a run: by a factor of some thousand over the
    hundred swings of an undamped mass. What is written in a test is meant of the results, so the steps get a thousandth, down to
    1e-12, below which round-off rules.
    """
    return max(1e-3 * wanted, min(wanted, 1e-12)) if wanted > 0 else wanted


def _title(statement: ast.TestAssertion) -> str:
    return f"assertion failed: {statement.message}" if statement.message else "assertion failed"


_EXCESS: Mapping[str, Callable[..., Any]] = {
    "==": lambda a, b, tol: np.abs(a - b) - tol,
    "<>": lambda a, b, tol: np.where(a != b, 0.0, 1.0),
    "<": lambda a, b, tol: np.where(a < b + tol, 0.0, np.maximum(a - b - tol, np.finfo(float).tiny)),
    "<=": lambda a, b, tol: a - b - tol,
    ">": lambda a, b, tol: np.where(a > b - tol, 0.0, np.maximum(b - a - tol, np.finfo(float).tiny)),
    ">=": lambda a, b, tol: b - a - tol,
}
"""By how much a comparison fails: not positive where it holds."""


def _worst(excess: Value, left: Value, right: Value, allowed: Value, moments: Iterable[float]) -> Worst | None:
    """The point of the largest excess, None where none is positive. A value that is not a number is worst of all."""
    over_time = isinstance(excess, Series)
    values = np.asarray(excess.values if isinstance(excess, Series) else excess, float)
    ranked = np.where(np.isnan(values), np.inf, values)
    if not ranked.size or ranked.max() <= 0:
        return None
    place = np.unravel_index(int(np.argmax(ranked)), ranked.shape)
    when = float(excess.time[place[0]]) if isinstance(excess, Series) else None
    entry = int(place[-1]) if len(place) > over_time else None
    told = when if when is not None else next(iter(moments), None) if len(set(moments)) == 1 else None
    found = (_at(value, when, entry) for value in (left, right, allowed))
    return Worst(told, None if entry is None else entry + 1, *found)


def _at(value: Value, when: float | None, entry: int | None) -> float:
    if isinstance(value, Series):
        assert when is not None
        value = value.at(when)
    return float(np.ravel(value)[entry] if np.ndim(value) and entry is not None else value)  # type: ignore[arg-type]


def _told(worst: Worst, relation: str) -> str:
    where = [f"time {worst.time:.9g}"] if worst.time is not None else []
    where += [f"entry {worst.entry}"] if worst.entry is not None else []
    place = f"worst at {', '.join(where)}: " if where else ""
    return f"{place}value {worst.value:.12g}, wanted {relation} {worst.wanted:.12g}, allowed +- {worst.allowed:.12g}"
