"""Text to tree: an LALR parser driven by the tables of `grammar.lark`.

Input        a Source
Output       ast.File; where a statement has an error it is left out, so the tree is whole only when nothing was reported
Establishes  spans nest; expressions and statements nest at most `MAX_DEPTH` deep; time and memory linear in the text
Reports      BG101 ... BG116, see `errors.py`
"""

from __future__ import annotations

import os
from pathlib import Path

from bgdsl.collecting import uncollected
from bgdsl.diagnostics import Reporter, did_you_mean
from bgdsl.source import Source, Span
from bgdsl.syntax import ast, errors
from bgdsl.syntax.builder import TreeBuilder
from bgdsl.syntax.lexer import Tokens, tokenize
from bgdsl.syntax.machine import Machine
from bgdsl.syntax.recovery import Recovery


def parse(source: Source, report: Reporter) -> ast.File:
    """The tree of a text. Errors are added to `report`; what stands beside them is still in the tree."""
    return parse_tokens(source, report)[0]


def parse_tokens(source: Source, report: Reporter) -> tuple[ast.File, Tokens]:
    """The tree, and the tokens it is made of: words that serve as names are of kind `NAME`."""
    tokens = tokenize(source.text)
    machine = Machine(source, tokens, TreeBuilder(source, report).action)
    with uncollected():
        tree: ast.File | None = machine.run(Recovery(report))
        comments = tuple(ast.Comment(source.text[a:b], span=Span(source, a, b)) for a, b in tokens.comments)
    items = tree.items if tree else ()
    return ast.File(items, comments, span=Span(source, 0, len(source.text))), tokens


def read_source(path: Path | str, report: Reporter) -> Source:
    """The text of a file. A file that cannot be read, or is no UTF-8 text, is reported, and the work stops (`BgError`)."""
    path = Path(path)
    name = os.fspath(path)
    nowhere = Span(Source(name, "", path), 0, 0)
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        beside = did_you_mean(path.name, (other.name for other in path.parent.glob("*.bg")))
        report.fail(errors.UNREADABLE, f"there is no file `{name}`", nowhere, "looked for here", helps=beside)
    except IsADirectoryError:
        report.fail(errors.UNREADABLE, f"`{name}` is a folder, not a file", nowhere, helps=("name one of its files",))
    except (OSError, ValueError) as problem:
        report.fail(errors.UNREADABLE, f"`{name}` cannot be read: {getattr(problem, 'strerror', None) or problem}", nowhere)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as problem:
        before = data[: problem.start].decode("utf-8-sig", "replace")
        shown = Source(name, before + data[problem.start :].decode("utf-8", "replace"), path)
        where = Span(shown, len(before), len(before) + 1)
        report.fail(errors.UNREADABLE, f"`{name}` is not UTF-8 text", where, f"byte 0x{data[problem.start]:02x} is not UTF-8")
    if "\0" in text:
        at = text.index("\0")
        report.fail(errors.UNREADABLE, f"`{name}` is not text", Span(Source(name, text, path), at, at + 1), "a NUL byte")
    return Source(name, text, path)
