"""Bond statements rewritten link by link, and declarations added and removed, in the text of one class as one instance needs it.

A statement whose links change is written anew, as one statement a piece; every other byte of the class stays. In a `for` loop an
edit belongs to all turns (it is written with the iterators, and the statement stays in the loop) or to one of them: then the
statement leaves the loop and is written out turn by turn.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from bgdsl.reductions.source_map import ClassText, Place, written
from bgdsl.source import Edit, Source, Span
from bgdsl.syntax import ast

Link = tuple[int, int]
"""(number of the arrow in its chain, number of the end in its fan), from 0."""


@dataclass(slots=True)
class LinkEdit:
    """What becomes of one link. `pieces` replace it (None: it stays as it is). `tail`, `head`: ports of a part, which are now the
    ends of the bond; `extra` follows."""

    pieces: list[str] | None = None
    extra: list[str] = field(default_factory=list)
    comments: list[str] = field(default_factory=list)
    tail: str | None = None
    head: str | None = None


Turn = tuple[int, ...]
"""The values of the iterators around a statement."""

ALL: Turn = (-1,)
"""All turns of a loop: the texts of such an edit name the iterators."""

Index = tuple[int, ...]
"""Subscripts of an element of an array, from 1; () of what is no array."""

Acts = int | tuple[int, ...] | tuple[tuple[int, ...], ...] | str
"""What is left of a scalar two-port, a bond (by component) or a matrix (by row): 2 both ways, 1 forth, -1 back, 0 nothing. Or an
expression for it, where the sizes are not known by number."""

Node = int | str
"""A declarator or a redeclaration (by id), or the name of a part of a bond that was put in."""


@dataclass(frozen=True, slots=True)
class NewPart:
    """A part of a bond put into the class: its class and its dimensions."""

    kind: str
    dims: tuple[int, ...]


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
        self.retyped: dict[int, str] = {}
        self.inserted: dict[str, NewPart] = {}
        self.acts: dict[tuple[Node, str], dict[Index, Acts]] = {}

    def fresh(self, wanted: str) -> str:
        """A name like the one wanted that nothing in the class has; it is taken from now on."""
        base = re.sub(r"[\W_]+", "_", wanted).strip("_")
        name, k = base, 2
        while name in self.taken:
            name, k = f"{base}_{k}", k + 1
        self.taken.add(name)
        return name

    def link(self, place: Place, turn: Turn, link: Link) -> LinkEdit:
        """The edit of one link, made if there was none."""
        by_turn = self.links.setdefault(id(place.statement), (place, {}))[1]
        return by_turn.setdefault(turn, {}).setdefault(link, LinkEdit())

    def found(self, place: Place, turn: Turn, link: Link) -> LinkEdit | None:
        """The edit of one link, if there is one."""
        _, by_turn = self.links.get(id(place.statement), (place, {}))
        return by_turn.get(turn, {}).get(link)

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

    def retype(self, node: ast.Declarator | ast.Redeclaration, kind: str) -> None:
        """Let a matrix be a part of one (`PartMTF`), whose `acts` are given."""
        self.retyped[id(node)] = kind

    def insert(self, name: str, kind: str, dims: tuple[int, ...]) -> None:
        """Declare a part of a bond (`Bond10`), or an array of them, whose `acts` are given."""
        self.inserted[name] = NewPart(kind, dims)

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
        indent = indent_at(source, model.items[-1].span.start if model.items else at) if model.items else "  "
        return Edit(Span(source, line, line), "".join(f"{indent}{text}\n" for text in self.new))

    def _declaration(self, item: ast.Declaration) -> list[Edit]:
        gone = [d for d in item.declarators if id(d) in self.removed]
        new = self.added.get(id(item), [])
        source, span = item.span.source, item.span
        separator = "\n" + indent_at(source, span.start)
        if len(gone) == len(item.declarators):
            if new:
                return [Edit(span, separator.join(new))]
            return [Edit(with_line(span), "")]
        edits = _without(item, self.removed)
        if new:
            edits.append(Edit(Span(source, span.end, span.end), "".join(separator + text for text in new)))
        return edits

    def _statement(self, place: Place, turns: Mapping[Turn, Mapping[Link, LinkEdit]]) -> list[Edit]:
        statement = place.statement
        if set(turns) <= {(), ALL}:
            (edits,) = turns.values()
            return _in_place(place, rendered(statement, edits, {}))
        names = [iterator.name for loop in place.loops for iterator in loop.iterators]
        lines: list[str] = []
        for turn in self.turns[id(statement)]:
            env = dict(zip(names, turn, strict=True))
            lines += rendered(statement, merged(turns.get(ALL, {}), turns.get(turn, {}), env), env)
        outer = place.loops[0]
        alone = len(place.loops) == 1 and len(outer.body) == 1
        if alone:
            return [_replacement(outer.span, lines)]
        end = Span(outer.span.source, outer.span.end, outer.span.end)
        indent = indent_at(outer.span.source, outer.span.start)
        return [Edit(with_line(statement.span), ""), Edit(end, "".join(f"\n{indent}{line}" for line in lines))]


def _in_place(place: Place, lines: Sequence[str]) -> list[Edit]:
    """Lines for a statement where it stands; with the last statement of a loop its loop goes."""
    span = place.statement.span
    if lines:
        return [_replacement(span, lines)]
    for loop in reversed(place.loops):
        if len(loop.body) > 1:
            break
        span = loop.span
    return [Edit(with_line(span), "")]


def merged(every: Mapping[Link, LinkEdit], own: Mapping[Link, LinkEdit], env: Mapping[str, int]) -> dict[Link, LinkEdit]:
    """The edits of one turn: its own, and those of all turns with the iterators' values."""
    result = {link: _at(edit, env) for link, edit in every.items()}
    for link, edit in own.items():
        before = result.get(link)
        if before is None or edit.pieces is not None:
            result[link] = edit
        else:
            before.extra += edit.extra
            before.comments += edit.comments
    return result


def _at(edit: LinkEdit, env: Mapping[str, int]) -> LinkEdit:
    def valued(text: str | None) -> str | None:
        return None if text is None else at_values(text, env)

    pieces = None if edit.pieces is None else [at_values(piece, env) for piece in edit.pieces]
    extra = [at_values(piece, env) for piece in edit.extra]
    return replace(edit, pieces=pieces, extra=extra, tail=valued(edit.tail), head=valued(edit.head))


def at_values(text: str, env: Mapping[str, int]) -> str:
    """A text with the values of iterators in the place of their names."""
    if not env:
        return text
    return re.sub(r"(?<![\w.])(?:" + "|".join(env) + r")(?!\w)", lambda match: str(env[match[0]]), text)


WIDE = 120
"""Statements that take the place of one stand on one line up to this width."""


def rendered(statement: ast.BondChain, edits: Mapping[Link, LinkEdit], env: Mapping[str, int]) -> list[str]:
    """The lines (statements and comments) that take the place of a statement."""
    lines: list[str] = []
    label = f"{statement.name}: " if statement.name else ""

    def put(text: str, named: bool = True) -> None:
        nonlocal label
        line = f"{label if named else ''}{text};"
        label = "" if named else label
        if lines and not lines[-1].startswith("//") and len(lines[-1]) + len(line) < WIDE:
            lines[-1] += f"  {line}"
        else:
            lines.append(line)

    chain, arrows = written(statement.ends[0][0], env), 0
    for k, arrow in enumerate(statement.arrows):
        tail = written(statement.ends[k][0], env)
        texts = [written(end, env) for end in statement.ends[k + 1]]
        found = [edits.get((k, f)) for f in range(len(texts))]
        fan = [text for text, edit in zip(texts, found, strict=True) if edit is None]
        if fan:
            chain, arrows = f"{chain} {arrow.text} {', '.join(fan)}", arrows + 1
        else:
            if arrows:
                put(chain)
            chain, arrows = texts[-1], 0
        for text, edit in zip(texts, found, strict=True):
            if edit is not None:
                lines += [f"// {comment}" for comment in edit.comments]
                kept = edit.pieces if edit.pieces is not None else [f"{edit.tail or tail} {arrow.text} {edit.head or text}"]
                for piece in kept:
                    put(piece)
                for piece in edit.extra:
                    put(piece, named=False)
    if arrows:
        put(chain)
    return lines


def _replacement(span: Span, lines: Sequence[str]) -> Edit:
    """Lines in the place of a span: on lines of their own unless the span stands alone on its line."""
    source, text = span.source, span.source.text
    indent = indent_at(source, span.start)
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


def with_line(span: Span) -> Span:
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


def indent_at(source: Source, offset: int) -> str:
    start = source.text.rfind("\n", 0, offset) + 1
    line = source.text[start:offset]
    return line[: len(line) - len(line.lstrip())]
