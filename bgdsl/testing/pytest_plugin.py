"""pytest plugin: `.bg` files that hold `test` blocks are collected like Python test files; each block is one test."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addini("bg_tests", "collect test blocks of .bg files", type="bool", default=False)


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> pytest.Collector | None:
    if file_path.suffix != ".bg" or not parent.config.getini("bg_tests"):
        return None
    return BgFile.from_parent(parent, path=file_path)


class BgFile(pytest.File):
    """A `.bg` file; its tests are run together when the first is asked for, since they share what is parsed."""

    def collect(self) -> Iterator[pytest.Item]:
        from bgdsl.diagnostics import Reporter
        from bgdsl.syntax import ast
        from bgdsl.syntax.parser import parse, read_source

        report = Reporter()
        for item in parse(read_source(self.path, report), report).items:
            if isinstance(item, ast.Test):
                yield BgTest.from_parent(self, name=item.name)


class BgTest(pytest.Item):
    """One `test` block."""

    def runtest(self) -> None:
        from bgdsl.diagnostics import render
        from bgdsl.testing.runner import run_file

        (outcome,) = (o for o in run_file(self.path, only=self.name) if o.name == self.name)
        if not outcome.passed:
            raise AssertionError(render(outcome.findings))

    def reportinfo(self) -> tuple[Path, int | None, str]:
        return self.path, None, self.name
