"""pytest plugin: with `bg_tests = true` in its configuration, pytest collects `.bg` files that hold `test` blocks; each block is one test.

Without that line it does nothing, and imports nothing of the compiler.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addini("bg_tests", "collect test blocks of .bg files", type="bool", default=False)


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> pytest.Collector | None:
    if file_path.suffix != ".bg" or not parent.config.getini("bg_tests"):
        return None
    return BgFile.from_parent(parent, path=file_path)


class BgFile(pytest.File):
    """A `.bg` file with its test blocks."""

    def collect(self) -> Iterator[pytest.Item]:
        from bgdsl.diagnostics import BgError, Reporter, render
        from bgdsl.syntax import ast
        from bgdsl.syntax.parser import parse, read_source

        report = Reporter()
        try:
            tree = parse(read_source(self.path, report), report)
            report.stop_if_errors()
        except BgError as error:
            raise self.CollectError(render(error.diagnostics)) from None
        tests = [item for item in tree.items if isinstance(item, ast.Test)]
        for number, test in enumerate(tests):
            yield BgTest.from_parent(self, name=test.name, number=number, line=test.span.line)


class FailedTestError(Exception):
    """A test block that did not pass; the message is what `bgc test` would print."""


class BgTest(pytest.Item):
    """One `test` block: the file's `number`th, from 0, which begins on `line`."""

    def __init__(self, *, number: int, line: int, **more: Any):
        super().__init__(**more)
        self.number, self.line = number, line

    def runtest(self) -> None:
        from bgdsl.diagnostics import BgError, render
        from bgdsl.testing.runner import run_test

        try:
            outcome = run_test(self.path, self.number)
        except BgError as error:
            raise FailedTestError(render(error.diagnostics)) from None
        if not outcome.passed:
            raise FailedTestError(render(outcome.findings))

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        return str(excinfo.value) if isinstance(excinfo.value, FailedTestError) else super().repr_failure(excinfo, style)

    def reportinfo(self) -> tuple[Path, int | None, str]:
        return self.path, self.line - 1, self.name
