"""The library that ships with the package: its own tests pass, its files check clean, everything in it says what it is."""

from __future__ import annotations

from pathlib import Path

import pytest

import bgdsl
from bgdsl import pipeline
from bgdsl.diagnostics import Reporter, render
from bgdsl.syntax import ast
from bgdsl.syntax.parser import parse, read_source
from bgdsl.testing.runner import run_file

LIBRARY = Path(bgdsl.__file__).parent / "library"
FILES = sorted(LIBRARY.rglob("*.bg"))
EACH_FILE = pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(LIBRARY)))


def tree(path: Path) -> ast.File:
    report = Reporter()
    parsed = parse(read_source(path, report), report)
    report.stop_if_errors()
    return parsed


def test_there_is_a_library():
    assert {path.parent.name for path in FILES} == {"mechanics", "electrical", "hydraulic", "thermal"}


@EACH_FILE
def test_checks_clean(path: Path):
    assert render(pipeline.check_file(path)) == ""


@EACH_FILE
def test_own_tests_pass(path: Path):
    outcomes = run_file(path)
    assert [f"{outcome.name}: {render(outcome.findings)}" for outcome in outcomes if not outcome.passed] == []
    assert outcomes or path.name == "rigid.bg"  # tested by rigid_examples.bg


@EACH_FILE
def test_models_are_described(path: Path):
    items = [item for item in tree(path).items if isinstance(item, ast.Model | ast.ShortFunction)]
    assert [item.name for item in items if not item.comment] == []


@EACH_FILE
def test_models_are_formatted_and_read_the_same_again(path: Path):
    from bgdsl.source import Source
    from bgdsl.syntax.formatter import format_source

    report = Reporter()
    text = format_source(read_source(path, report), report)
    assert parse(Source("again", text), report).items == tree(path).items


@EACH_FILE
def test_the_page_lists_every_model_with_its_description(path: Path):
    page = (Path(__file__).parent.parent.parent / "docs" / "library.md").read_text("utf-8")
    assert f"## `{'.'.join(path.relative_to(LIBRARY).with_suffix('').parts)}`" in page
    items = [item for item in tree(path).items if isinstance(item, ast.Model | ast.ShortFunction)]
    assert [item.name for item in items if f"| `{item.name}` | {item.comment} |" not in page] == []
