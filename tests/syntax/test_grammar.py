"""The grammar file is the whole truth: lark itself reads with it what the parser reads; its tables are kept safely."""

from __future__ import annotations

import json
import os
import stat
from multiprocessing import get_context
from pathlib import Path

import pytest
from lark import Lark
from lark.exceptions import UnexpectedInput

from bgdsl.diagnostics import Reporter
from bgdsl.source import Source
from bgdsl.syntax import builder, tables
from bgdsl.syntax.lexer import RESERVED
from bgdsl.syntax.parser import parse

ROOT = Path(__file__).parent.parent.parent
GRAMMAR = Path(tables.__file__).with_name("grammar.lark").read_text("utf-8")


@pytest.fixture(scope="module")
def lark() -> Lark:
    return Lark(GRAMMAR, parser="lalr", lexer="contextual", start="file")


FILES = sorted([*(ROOT / "models").glob("*.bg"), *(ROOT / "bgdsl/library").rglob("*.bg"), *(ROOT / "tests/cases/syntax").glob("*.bg")])


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_lark_agrees(path: Path, lark: Lark) -> None:
    """What the parser takes without complaint lark takes too, and what lark refuses the parser reports."""
    text = path.read_text("utf-8")
    report = Reporter()
    parse(Source(path.name, text), report)
    try:
        lark.parse(text)
    except UnexpectedInput:
        assert report.errors
    else:
        assert not [d for d in report.errors if d.code.number in ("BG101", "BG105", "BG106", "BG113")]


def test_every_rule_has_its_method() -> None:
    for rule in tables.tables().rules:
        if rule.action:
            assert callable(getattr(builder.TreeBuilder, rule.action)), rule


def test_reserved_words_are_keywords_and_nothing_else_is_reserved() -> None:
    words = tables.tables().words
    assert set(words) >= RESERVED
    for word in sorted(set(words) - RESERVED):
        report = Reporter()
        parse(Source("word.bg", f"model M\n  parameter Real {word} = 1;\n  R r(k = 2*{word});\nend M;\n"), report)
        assert not report.errors, word
    for word in sorted(RESERVED):
        report = Reporter()
        parse(Source("word.bg", f"model M\n  parameter Real {word} = 1;\nend M;\n"), report)
        assert report.errors, word


def _fresh(folder: str) -> int:
    os.environ["XDG_CACHE_HOME"] = folder
    tables.tables.cache_clear()
    return len(tables.tables().states)


def test_tables_are_kept_and_a_damaged_file_is_built_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    before = tables.tables()
    try:
        tables.tables.cache_clear()
        assert tables.tables() == before
        (kept,) = (tmp_path / "bgdsl").glob("grammar-*.json")
        for damage in ("", "{}", "[1, 2]", kept.read_text()[:1000], json.dumps({"states": []})):
            kept.write_text(damage)
            tables.tables.cache_clear()
            assert tables.tables() == before
        assert json.loads(kept.read_text())["end"] == before.end
    finally:
        tables.tables.cache_clear()


def test_a_folder_that_cannot_be_written_is_no_harm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    monkeypatch.setenv("XDG_CACHE_HOME", str(blocked))
    tables.tables.cache_clear()
    try:
        assert tables.tables().rules
    finally:
        tables.tables.cache_clear()


def test_runs_at_once_share_the_folder(tmp_path: Path) -> None:
    with get_context("spawn").Pool(2) as pool:
        sizes = set(pool.map(_fresh, [str(tmp_path)] * 4, chunksize=1))
    assert len(sizes) == 1
    assert [path.suffix for path in (tmp_path / "bgdsl").iterdir()] == [".json"]
    assert stat.S_ISREG(next((tmp_path / "bgdsl").iterdir()).stat().st_mode)
