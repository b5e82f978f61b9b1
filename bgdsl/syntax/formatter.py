"""`bgc fmt`: the layout of a text made canonical, its words left alone.

Works on the tokens, so comments, number spellings and the author's line breaks between statements stay:
- indentation is two spaces a level; `equation`, `end` and the heads of definitions stand on lines of their own;
- statements that share a line go on sharing it; they, descriptions and the columns of tables keep the gaps that line them up;
- spaces inside statements are canonical; lines over `WIDTH` columns are broken; at most one blank line in a row.

`format_source` asserts, as Black does, that the tree and the comments are the same and that a second run changes nothing.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from bgdsl.diagnostics import Reporter
from bgdsl.source import Source
from bgdsl.syntax import ast
from bgdsl.syntax.lexer import Tokens
from bgdsl.syntax.parser import parse_tokens
from bgdsl.syntax.tables import tables

WIDTH = 140
INDENT = 2
CONTINUED = 2

Lead = Literal["line", "statement", "inside"]

_OPENING, _CLOSING = frozenset(["LPAR", "LSQB", "LBRACE"]), frozenset(["RPAR", "RSQB", "RBRACE"])
_TIGHT = frozenset(["TIMES", "DIVIDE", "POWER"])
_SPACED = frozenset(["RELATION", "DOT_PLUS", "DOT_MINUS", "DOT_TIMES", "DOT_DIVIDE", "DOT_POWER", "PLUS_MINUS", "EQUAL", "PERCENT"])
_SIGNS_SPACED = frozenset([":=", "->", "=>", "->|", "=>|", "|->", "|=>"])
_ENDERS = frozenset(["ELSE", "ELSEIF", "EQUATION", "INITIAL_EQUATION", "ALGORITHM", "END"])
_VALUES = frozenset(["NAME", "NUMBER", "STRING", "TRUE", "FALSE", "END_INDEX", "RPAR", "RSQB", "RBRACE"])


@dataclass(frozen=True, slots=True)
class Item:
    """A token or a comment, how it stands to the item before, and how far a line that starts with it is indented."""

    text: str
    kind: str
    lead: Lead
    level: int
    gap: str
    lines_before: int


def format_source(source: Source, report: Reporter) -> str:
    """The text in canonical layout. Syntax errors are reported and stop the work (`BgError`)."""
    tree, tokens = parse_tokens(source, report)
    report.stop_if_errors()
    text = _layout(source, tokens)
    for _ in range(3):  # a broken line may be broken further when it is seen as the author's
        again, tokens = parse_tokens(Source(source.name, text), Reporter())
        assert again == tree, "formatting has changed the tree"
        assert _comments(again) == _comments(tree), "formatting has changed the comments"
        before, text = text, _layout(again.span.source, tokens)
        if text == before:
            return text
    raise AssertionError("formatting does not come to rest")


def _comments(tree: ast.File) -> list[str]:
    return [comment.text.rstrip() for comment in tree.comments]


def _layout(source: Source, tokens: Tokens) -> str:
    return _Writer().write(list(_items(source, tokens)))


# -------------------------------------------------------------------------------------------------- what each token is


def _items(source: Source, tokens: Tokens) -> Iterator[Item]:
    """Tokens and comments in the order of the text."""
    text = source.text
    leads = _Reader(source, tokens).leads()
    gaps = _gaps(tokens)
    comments = iter([*tokens.comments, (len(text) + 1, len(text) + 1)])
    start, end = next(comments)
    last = 0
    for index, place in enumerate(tokens.starts):
        while start < place or (start <= len(text) and tokens.kinds[index] == "$END"):
            yield _comment(source, start, end, last, place, leads, index)
            last = end
            start, end = next(comments)
        if tokens.kinds[index] == "$END":
            return
        lead, level = leads[index]
        between = text[last:place]
        gap = gaps[index]
        if gap and not between.strip(" ") and (lead == "statement" or _may_line_up(tokens, index)):
            gap = " " * max(1, len(between))
        word = "initial equation" if tokens.kinds[index] == "INITIAL_EQUATION" else tokens.texts[index]
        yield Item(word, tokens.kinds[index], lead, level, gap, between.count("\n"))
        last = place + len(tokens.texts[index])


def _column(text: str, place: int) -> int:
    return place - text.rfind("\n", 0, place) - 1


def _comment(source: Source, start: int, end: int, last: int, place: int, leads: list[tuple[Lead, int]], index: int) -> Item:
    """A comment goes with the statement after it; before `end` or `equation` its column says whether it is of the body."""
    between = source.text[last:start]
    lead, level = leads[index]
    column, next_column = _column(source.text, start), _column(source.text, place)
    if lead == "line" and column > next_column:
        level += 1
    gap = " " * max(1, len(between)) if "\n" not in between and last else ""
    newlines = between.count("\n") if last else 0
    return Item(source.text[start:end].rstrip(), "COMMENT", "statement" if lead != "inside" else "inside", level, gap, newlines)


def _may_line_up(tokens: Tokens, index: int) -> bool:
    """Descriptions and the columns of tables may stand apart, to line up with the lines above and below."""
    before = tokens.kinds[index - 1] if index else ""
    return before in ("COMMA", "SEMICOLON") or (
        tokens.kinds[index] == "STRING" and before in _VALUES and tokens.kinds[index - 2] not in ("MODEL", "ELEMENT", "FUNCTION", "DOMAIN")
    )


@dataclass(slots=True)
class _Block:
    """An open construct; `loose` when its statements may share a line, as the first one shares the head's."""

    kind: str
    level: int
    loose: bool = False


class _Reader:
    """Follows the constructs of a text token by token."""

    def __init__(self, source: Source, tokens: Tokens):
        self.source = source
        self.tokens = tokens
        self.blocks: list[_Block] = []
        self.level = 0
        self.depth = 0
        self.nested = 0  # `if` expressions open in the current statement
        self.at_start = True
        self.after_head = True
        self.closing = False
        self.head_end = -1

    def leads(self) -> list[tuple[Lead, int]]:
        """For each token how it starts, and the level of its line."""
        return [self.lead(index, kind) for index, kind in enumerate(self.tokens.kinds)]

    def lead(self, index: int, kind: str) -> tuple[Lead, int]:
        starts = self.at_start
        level, lead = self.level, self.first(index, kind) if starts else "inside"
        if starts and self.heads_section(index, kind) and self.blocks:
            level = self.blocks[-1].level
        head = self.ends_head(index, kind, starts)
        if kind in ("IF", "ELSE") and not starts:
            self.nested += 1 if kind == "IF" else -1
        self.depth += (kind in _OPENING) - (kind in _CLOSING)
        self.at_start = head or (kind == "SEMICOLON" and not self.depth)
        self.after_head = head
        if head:
            self.enter(index, kind)
        elif self.at_start:
            self.leave()
        return lead, level

    def first(self, index: int, kind: str) -> Lead:
        """How the first token of a statement starts; opens what it opens."""
        self.nested = 0
        loose = bool(self.blocks) and self.blocks[-1].loose
        lead: Lead = "line" if self.after_head and not loose else "statement"
        kinds = self.tokens.kinds
        if kind in ("MODEL", "ELEMENT", "DOMAIN", "TEST") or (kind == "FUNCTION" and kinds[index + 2] != "LPAR"):
            self.blocks.append(_Block(kind, self.level))
            self.head_end = index + (2 if kind != "TEST" and kinds[index + 2] == "STRING" else 1)
            return "line"
        if kind in ("FOR", "IF"):
            self.blocks.append(_Block(kind, self.level))
        elif self.heads_section(index, kind) and self.blocks:
            self.closing = kind == "END"
            return "statement" if loose else "line"
        return lead

    def ends_head(self, index: int, kind: str, starts: bool) -> bool:
        """Whether statements follow this token."""
        if kind in ("LOOP", "THEN"):
            return not self.depth and self.nested <= 0 and bool(self.blocks) and self.blocks[-1].kind in ("FOR", "IF")
        return index == self.head_end or (starts and self.heads_section(index, kind) and kind not in ("ELSEIF", "END"))

    def heads_section(self, index: int, kind: str) -> bool:
        """Whether a statement's first token stands at the level of what it is in: `equation`, `end`, `protected` on a line of its own."""
        if kind != "PROTECTED":
            return kind in _ENDERS
        starts = self.tokens.starts
        return "\n" in self.source.text[starts[index] : starts[index + 1]]

    def enter(self, index: int, kind: str) -> None:
        block = self.blocks[-1]
        self.level = block.level + 1
        if kind in ("LOOP", "THEN"):
            text, starts = self.source.text, self.tokens.starts
            block.loose = "\n" not in text[starts[index] : starts[index + 1]]

    def leave(self) -> None:
        if self.closing and self.blocks:
            self.level = self.blocks.pop().level
        self.closing = False


# ------------------------------------------------------------------------------------------------------ spaces inside


def _gaps(tokens: Tokens) -> list[str]:
    """The space before each token, were it on the line of the one before."""
    spaced_signs = {tables().signs[sign] for sign in _SIGNS_SPACED} | _SPACED
    reader = _Spaces(tokens, frozenset(spaced_signs))
    return [" " if index and reader.wants_space(index) else "" for index in range(len(tokens.kinds))]


class _Spaces:
    """Which tokens stand apart."""

    def __init__(self, tokens: Tokens, spaced: frozenset[str]):
        self.kinds = tokens.kinds
        self.texts = tokens.texts
        self.spaced = spaced
        self.depth = 0
        self.first = 0
        self.unary = [self.is_unary(index) for index in range(len(self.kinds))]

    def is_unary(self, index: int) -> bool:
        return self.kinds[index] in ("PLUS", "MINUS") and (index == 0 or self.kinds[index - 1] not in _VALUES)

    def wants_space(self, index: int) -> bool:
        before, kind = self.kinds[index - 1], self.kinds[index]
        self.depth += (before in _OPENING) - (before in _CLOSING)
        if before == "SEMICOLON" and not self.depth:
            self.first = index
        if kind in ("SEMICOLON", "COMMA", "DOT") or kind in _CLOSING or before in ("DOT", *_OPENING):
            return False
        if before in ("SEMICOLON", "COMMA"):
            return True
        if "COLON" in (before, kind):
            return before == "COLON" and self.is_label(index - 1)
        return self.between(index, before, kind)

    def is_label(self, index: int) -> bool:
        """`b4: i -> winding;`: a name and a colon that start a statement."""
        starters = ("SEMICOLON", "EQUATION", "INITIAL_EQUATION", "LOOP", "THEN", "ELSE")
        return not self.depth and self.kinds[index - 1] == "NAME" and self.kinds[index - 2] in starters

    def between(self, index: int, before: str, kind: str) -> bool:
        if kind in _TIGHT or before in _TIGHT:
            return kind in _TIGHT and self.texts[index - 1].endswith(".")  # `2.*x` would be read as `2 .* x`
        if before in ("PLUS", "MINUS") and self.unary[index - 1]:
            return before == "PLUS" and kind == "MINUS"  # `+-` is one sign
        if kind in ("LPAR", "LSQB"):
            called = before in ("NAME", "RSQB", "RPAR", "RBRACE", "ANNOTATION")
            return not called
        return True


# ------------------------------------------------------------------------------------------------------------- writing


class _Writer:
    """Puts items on lines; continued rows of a matrix or array line up with the first, other continued lines are indented."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.line = ""
        self.base = 0
        self.brackets: list[int | None] = []

    def write(self, items: list[Item]) -> str:
        index = 0
        while index < len(items):
            stop = index + 1
            while stop < len(items) and not self.breaks(items[stop - 1], items[stop]):
                stop += 1
            self.physical_line(items[index:stop], first=index == 0)
            index = stop
        return "".join(f"{line}\n" for line in self.lines)

    def breaks(self, before: Item, item: Item) -> bool:
        return item.lead == "line" or item.lines_before > 0 or before.text.startswith("//")

    def physical_line(self, items: list[Item], *, first: bool) -> None:
        """A line of the author's, broken further while it is too long."""
        head = items[0]
        if head.lines_before > 1 and not first and self.lines and self.lines[-1] and head.lead != "inside":
            self.lines.append("")
        while items:
            count = self.fitting(items)
            self.emit(items[:count])
            items = items[count:]

    def indent(self, item: Item) -> int:
        """The column at which a line starts."""
        if item.lead != "inside":
            self.base = item.level * INDENT
            self.brackets.clear()
            return self.base
        if item.kind in _CLOSING:
            return self.base
        column = self.brackets[-1] if self.brackets else None
        return column if column is not None and column <= WIDTH // 2 else self.base + CONTINUED

    def fitting(self, items: list[Item]) -> int:
        """How many items the next line takes."""
        brackets, base = list(self.brackets), self.base
        column = self.indent(items[0])
        self.brackets, self.base = brackets, base
        depth, best, best_rank = 0, 0, -1000
        for index, item in enumerate(items):
            if index and item.kind != "COMMENT" and column <= WIDTH:
                rank = self.rank(items[index - 1], item, depth)
                if rank is not None and rank >= best_rank:
                    best, best_rank = index, rank
            column += len(item.gap) * (index > 0) + len(item.text.partition("\n")[0])
            if column > WIDTH and item.kind != "COMMENT" and best:
                return best
            depth += (item.kind in _OPENING) - (item.kind in _CLOSING)
        return len(items)

    def rank(self, before: Item, item: Item, depth: int) -> int | None:
        """How good it is to break between two items: None if not at all."""
        if item.lead != "inside":
            return 1000
        if item.kind == "STRING" and before.kind in _VALUES:
            return 600
        if before.kind == "EQUAL" and not depth:
            return 495
        if before.kind == "COMMA" or (before.kind == "SEMICOLON" and depth):
            return 500 - 10 * depth
        if item.kind in ("PLUS", "MINUS", "OR", "AND", "ELSE", "ELSEIF") and item.gap and before.kind in _VALUES:
            return 300 - 10 * depth
        return None

    def emit(self, items: list[Item]) -> None:
        column = self.indent(items[0])
        line = " " * column
        for index, item in enumerate(items):
            if index:
                line += item.gap
            if item.lead != "inside" and item.kind != "COMMENT":
                self.brackets.clear()
                self.base = items[0].level * INDENT if items[0].lead != "inside" else self.base
            line += item.text
            if item.kind in _OPENING:
                last = index + 1 == len(items)
                self.brackets.append(None if last or item.kind == "LPAR" else len(line) - line.rfind("\n") - 1)
            elif item.kind in _CLOSING and self.brackets:
                self.brackets.pop()
        self.lines.append(line.rstrip())
