"""Bond statements rewritten link by link, and declarations added and removed, in the text of one class as one instance needs it.

A statement whose links change is written anew, as one statement a piece; every other byte of the class stays. Statements in
a `for` loop whose turns change differently leave the loop and are written out turn by turn.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from bgdsl.reductions.source_map import ClassText, Place, written
from bgdsl.source import Edit, Source, Span
from bgdsl.syntax import ast

Link = tuple[int, int]
"""(number of the arrow in its chain, number of the end in its fan), from 0."""


@dataclass(slots=True)
class LinkEdit:
    """What becomes of one link. `pieces` replace it (None: it stays as it is). `tail`, `head`: junctions put before a matrix port,
    which are now the ends of the bond, and their kinds; `extra` follows."""

    pieces: list[str] | None = None
    extra: list[str] = field(default_factory=list)
    comments: list[str] = field(default_factory=list)
    tail: str | None = None
    head: str | None = None
    tail_kind: int = 0
    head_kind: int = 0


Turn = tuple[int, ...]
"""The values of the iterators around a statement."""


class ClassEdits:
    """The edits of one class text for one instance."""

    def __init__(self, cls: ClassText, taken: set[str]):
        self.cls = cls
        self.taken = taken
        self.links: dict[int, tuple[Place, dict[Turn, dict[Link, LinkEdit]]]] = {}
        self.turns: dict[int, list[Turn]] = {}
        self.removed: set[int] = set()
        self.added: dict[int, list[str]] = {}
        self.new: list[str] = []
        self.others: list[Edit] = []

    def fresh(self, wanted: str) -> str:
        """A name like the one wanted that nothing in the class has; it is taken from now on."""
        base = re.sub(r"\W+", "_", wanted).strip("_")
        name, k = base, 2
        while name in self.taken:
            name, k = f"{base}_{k}", k + 1
        self.taken.add(name)
        return name

    def link(self, place: Place, turn: Turn, link: Link) -> LinkEdit:
        """The edit of one link, made if there was none."""
        by_turn = self.links.setdefault(id(place.statement), (place, {}))[1]
        return by_turn.setdefault(turn, {}).setdefault(link, LinkEdit())

    def declare(self, text: str, after: ast.Declaration | None = None) -> None:
        """Add a declaration: after another one, or at the end of all."""
        if after is None:
            self.new.append(text)
        else:
            self.added.setdefault(id(after), []).append(text)

    def remove(self, declarator: ast.Declarator) -> None:
        self.removed.add(id(declarator))

    def replace(self, span: Span, text: str) -> None:
        """Put a text where a span of the class stands."""
        self.others.append(Edit(span, text))

    @property
    def empty(self) -> bool:
        return not (self.links or self.removed or self.added or self.new or self.others)

    # ----------------------------------------------------------------------------------------------------------- result

    def edits(self) -> tuple[Edit, ...]:
        """All edits, in the order of the text."""
        model = self.cls.model
        edits = list(self.others)
        for item in model.items:
            if isinstance(item, ast.Declaration):
                edits += self._declaration(item)
        if self.new:
            edits.append(self._insertion(model))
        for place, turns in self.links.values():
            edits += self._statement(place, turns)
        return _apart(sorted(edits, key=lambda edit: (edit.span.start, edit.span.end)))

    def _insertion(self, model: ast.Model) -> Edit:
        """New declarations, before the first section."""
        source = model.span.source
        at = model.sections[0].span.start if model.sections else source.text.rfind("end", 0, model.span.end)
        line = source.text.rfind("\n", 0, at) + 1
        indent = _indent(source, model.items[-1].span.start if model.items else at) if model.items else "  "
        return Edit(Span(source, line, line), "".join(f"{indent}{text}\n" for text in self.new))

    def _declaration(self, item: ast.Declaration) -> list[Edit]:
        gone = [d for d in item.declarators if id(d) in self.removed]
        new = self.added.get(id(item), [])
        source, span = item.span.source, item.span
        separator = "\n" + _indent(source, span.start)
        if len(gone) == len(item.declarators):
            if new:
                return [Edit(span, separator.join(new))]
            return [Edit(_with_line(span), "")]
        edits = _without(item, self.removed)
        if new:
            edits.append(Edit(Span(source, span.end, span.end), "".join(separator + text for text in new)))
        return edits

    def _statement(self, place: Place, turns: Mapping[Turn, Mapping[Link, LinkEdit]]) -> list[Edit]:
        statement = place.statement
        if not place.loops:
            (edits,) = turns.values()
            return [_replacement(statement.span, rendered(statement, edits, {}))]
        names = [iterator.name for loop in place.loops for iterator in loop.iterators]
        lines: list[str] = []
        for turn in self.turns[id(statement)]:
            lines += rendered(statement, turns.get(turn, {}), dict(zip(names, turn, strict=True)))
        outer = place.loops[0]
        alone = len(place.loops) == 1 and len(outer.body) == 1
        if alone:
            return [_replacement(outer.span, lines)]
        end = Span(outer.span.source, outer.span.end, outer.span.end)
        indent = _indent(outer.span.source, outer.span.start)
        return [Edit(_with_line(statement.span), ""), Edit(end, "".join(f"\n{indent}{line}" for line in lines))]


def rendered(statement: ast.BondChain, edits: Mapping[Link, LinkEdit], env: Mapping[str, int]) -> list[str]:
    """The lines (statements and comments) that take the place of a statement."""
    lines: list[str] = []
    label = f"{statement.name}: " if statement.name else ""

    def flush(text: str, arrows: int) -> None:
        nonlocal label
        if arrows:
            lines.append(f"{label}{text};")
            label = ""

    chain, arrows = written(statement.ends[0][0], env), 0
    for k, arrow in enumerate(statement.arrows):
        tail = written(statement.ends[k][0], env)
        texts = [written(end, env) for end in statement.ends[k + 1]]
        found = [edits.get((k, f)) for f in range(len(texts))]
        fan = [text for text, edit in zip(texts, found, strict=True) if edit is None]
        if fan:
            chain, arrows = f"{chain} {arrow.text} {', '.join(fan)}", arrows + 1
        else:
            flush(chain, arrows)
            chain, arrows = texts[-1], 0
        for text, edit in zip(texts, found, strict=True):
            if edit is not None:
                lines += [f"// {comment}" for comment in edit.comments]
                kept = edit.pieces if edit.pieces is not None else [f"{edit.tail or tail} {arrow.text} {edit.head or text}"]
                lines += [f"{label if i == 0 else ''}{piece};" for i, piece in enumerate(kept)]
                label = "" if kept else label
                lines += [f"{piece};" for piece in edit.extra]
    flush(chain, arrows)
    return lines


def _replacement(span: Span, lines: Sequence[str]) -> Edit:
    """Lines in the place of a span: on lines of their own unless the span stands alone on its line."""
    source, text = span.source, span.source.text
    indent = _indent(source, span.start)
    line_start = text.rfind("\n", 0, span.start) + 1
    line_end = text.find("\n", span.end)
    rest = text[span.end : line_end if line_end >= 0 else len(text)]
    new = f"\n{indent}".join(lines)
    start, end = span.start, span.end
    if text[line_start:start].strip():
        start = line_start + len(text[line_start:start].rstrip())
        new = f"\n{indent}{new}"
    if rest.strip() and ((lines and lines[-1].startswith("//")) or (len(lines) > 1 and not rest.lstrip().startswith("//"))):
        end += len(rest) - len(rest.lstrip())
        new = f"{new}\n{indent}"
    return Edit(Span(source, start, end), new)


def _apart(edits: Sequence[Edit]) -> tuple[Edit, ...]:
    """Edits in order, where neighbours do not both take the blanks between them."""
    apart: list[Edit] = []
    for edit in edits:
        if apart and edit.span.start < apart[-1].span.end:
            before = apart.pop()
            apart.append(Edit(Span(before.span.source, before.span.start, edit.span.start), before.text.rstrip()))
        apart.append(edit)
    return tuple(apart)


def _without(item: ast.Declaration, removed: set[int]) -> list[Edit]:
    """The removal of some declarators, not all, with their commas."""
    source, all_of = item.span.source, item.declarators
    kept = [k for k, declarator in enumerate(all_of) if id(declarator) not in removed]
    edits = [
        Edit(Span(source, declarator.span.start, all_of[k + 1].span.start), "")
        for k, declarator in enumerate(all_of[: kept[-1]])
        if id(declarator) in removed
    ]
    if kept[-1] + 1 < len(all_of):
        edits.append(Edit(Span(source, all_of[kept[-1]].span.end, all_of[-1].span.end), ""))
    return edits


def _with_line(span: Span) -> Span:
    """The span, with its whole line where nothing else stands on it, else with the blanks that follow."""
    text = span.source.text
    start = text.rfind("\n", 0, span.start) + 1
    end = text.find("\n", span.end)
    end = len(text) if end < 0 else end + 1
    if not text[start : span.start].strip() and not text[span.end : end].strip():
        return Span(span.source, start, end)
    after = span.end
    while after < len(text) and text[after] in " \t":
        after += 1
    if after < len(text) and text[after] == "\n":
        return Span(span.source, len(text[: span.start].rstrip(" \t")), span.end)
    return Span(span.source, span.start, after)


def _indent(source: Source, offset: int) -> str:
    start = source.text.rfind("\n", 0, offset) + 1
    line = source.text[start:offset]
    return line[: len(line) - len(line.lstrip())]
