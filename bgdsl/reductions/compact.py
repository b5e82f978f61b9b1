"""Statements that say the same of many things, said once: vectors, loops over arrays of components, fans.

Texts are compared by their skeletons: the numbers in brackets taken out (`pins[#].v -> cyl[#].crank`).
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from bgdsl.reductions.places import Shown, Spot

_BRACKETED = re.compile(r"\[\d+(?:,\d+)*\]")
_NUMBER = re.compile(r"\d+")
LETTERS = "ijklmn"


def skeleton(text: str) -> tuple[str, tuple[int, ...]]:
    """The text without the numbers in its brackets, and these."""
    found: list[int] = []

    def take(match: re.Match[str]) -> str:
        found.append(int(match.group()))
        return "#"

    return _BRACKETED.sub(lambda match: _NUMBER.sub(take, match.group()), text), tuple(found)


def filled(shape: str, numbers: Sequence[int | str]) -> str:
    """A skeleton with numbers, or the names of iterators, put in."""
    pieces = shape.split("#")
    return "".join(part for pair in zip(pieces, (*map(str, numbers), ""), strict=True) for part in pair)


def alike(texts: Sequence[str], values: Sequence[int]) -> tuple[str, str] | None:
    """(iterator, text with it) if the texts differ by numbers in brackets that run through `values`, or beside them (`i + 1`)."""
    shape, _ = skeleton(texts[0])
    rows = []
    for text in texts:
        other, numbers = skeleton(text)
        if other != shape:
            return None
        rows.append(numbers)
    letter = next((c for c in LETTERS if not re.search(rf"(?<![\w.]){c}(?!\w)", shape)), None)
    columns: list[int | str] = []
    for column in zip(*rows, strict=True):
        if len(set(column)) == 1:
            columns.append(column[0])
        elif letter is not None and len({i - value for i, value in zip(column, values, strict=True)}) == 1:
            beside = column[0] - values[0]
            columns.append(letter if not beside else f"{letter} {'-' if beside < 0 else '+'} {abs(beside)}")
        else:
            return None
    return (letter, filled(shape, columns)) if letter is not None and letter in columns else None


@dataclass(slots=True)
class Statement:
    """A bond statement: its ends, its arrow, and the positions of the links that it stands for."""

    ends: tuple[str, ...]
    arrow: str
    positions: list[int] = field(default_factory=list)

    @property
    def text(self) -> str:
        return f" {self.arrow} ".join(self.ends)


def statements(links: Sequence[tuple[Spot, ...]], shown: Shown, scope: str, notes: Mapping[int, Sequence[str]]) -> list[str]:
    """The links of one class as lines. notes: comments by the position of the link before which they stand."""
    made = _chained(_vectors(links, shown, scope))
    loops, single = _loops(made)
    first = {id(statement): min(statement.positions) for statement in made}
    blocks: list[tuple[int, list[str]]] = []
    for (letter, low, high), inside in loops.items():
        position = min(p for statement in inside for p in statement.positions)
        lines = [f"  {line}" for line in _fanned(inside, notes)]
        blocks.append((position, [f"for {letter} in {low}:{high} loop", *lines, "end for;"]))
    fans: dict[tuple[str, str], list[Statement]] = {}
    for statement in single:
        key = (statement.ends[0], statement.arrow) if len(statement.ends) == 2 else (statement.text, "")
        fans.setdefault(key, []).append(statement)
    for group in fans.values():
        blocks.append((min(first[id(statement)] for statement in group), _fanned(group, notes)))
    lines = [line for _, block in sorted(blocks, key=lambda block: block[0]) for line in block]
    return [*lines, *(f"// {note}" for note in notes.get(len(links), ()))]


def _vectors(links: Sequence[tuple[Spot, ...]], shown: Shown, scope: str) -> list[Statement]:
    """Bonds between all the components of vectors, or ranges of them, as one; other links as they are."""
    groups: dict[tuple[str, ...], list[tuple[tuple[int, ...], int]]] = defaultdict(list)
    made: list[Statement] = []
    widths: dict[tuple[str, ...], tuple[int, ...]] = {}
    for k, link in enumerate(links):
        if len(link) == 2 and all(spot.shape for spot in link):
            key = tuple(shown.text(Spot(s.owner, s.name, s.index, s.attribute), scope) for s in link)
            groups[key].append((tuple(spot.component[0] for spot in link), k))
            widths[key] = tuple(spot.shape[0] for spot in link)
        else:
            made.append(Statement(tuple(shown.text(spot, scope) for spot in link), "->", [k]))
    for key, rows in groups.items():
        for run in _runs(sorted(rows)):
            made.append(_vector(key, widths[key], run))
    return sorted(made, key=lambda statement: min(statement.positions))


def _runs(rows: Sequence[tuple[tuple[int, ...], int]]) -> list[list[tuple[tuple[int, ...], int]]]:
    runs: list[list[tuple[tuple[int, ...], int]]] = []
    for row in rows:
        if runs and row[0] == tuple(i + 1 for i in runs[-1][-1][0]):
            runs[-1].append(row)
        else:
            runs.append([row])
    return runs


def _vector(ends: tuple[str, ...], widths: tuple[int, ...], run: Sequence[tuple[tuple[int, ...], int]]) -> Statement:
    low, high = run[0][0], run[-1][0]
    positions = [k for _, k in run]
    if low == high and max(widths) > 1:
        return Statement(tuple(f"{end}[{i}]" for end, i in zip(ends, low, strict=True)), "->", positions)
    shown = tuple(end if (a, b) == (1, width) else f"{end}[{a}:{b}]" for end, a, b, width in zip(ends, low, high, widths, strict=True))
    return Statement(shown, "=>", positions)


def _chained(made: Sequence[Statement]) -> list[Statement]:
    """Bonds to one port of a two-port and from its other as one chain through it."""
    ends: dict[str, list[Statement]] = defaultdict(list)
    for statement in made:
        for end in (statement.ends[0], statement.ends[-1]):
            ends[end].append(statement)
    gone: set[int] = set()
    for statement in made:
        while id(statement) not in gone and statement.ends[-1].endswith(".p1"):
            base = statement.ends[-1][:-3]
            into, out = ends[f"{base}.p1"], ends[f"{base}.p2"]
            if len(into) > 1 or len(out) != 1 or out[0].ends[0] != f"{base}.p2" or out[0].arrow != statement.arrow:
                break
            following = out[0]
            gone.add(id(following))
            statement.ends = (*statement.ends[:-1], base, *following.ends[1:])
            statement.positions += following.positions
            ends[statement.ends[-1]] = [statement if s is following else s for s in ends[statement.ends[-1]]]
    return [statement for statement in made if id(statement) not in gone]


def _loops(made: Iterable[Statement]) -> tuple[dict[tuple[str, int, int], list[Statement]], list[Statement]]:
    """Statements that are alike for a run of indices, by iterator and range; and those that are not."""
    groups: dict[tuple[str, str], list[tuple[tuple[int, ...], Statement]]] = defaultdict(list)
    for statement in made:
        shape, numbers = skeleton(statement.text)
        groups[shape, statement.arrow].append((numbers, statement))
    loops: dict[tuple[str, int, int], list[Statement]] = {}
    single: list[Statement] = []
    for group in groups.values():
        rows = sorted(group, key=lambda row: row[0])
        running = [column for column in zip(*(numbers for numbers, _ in rows), strict=True) if len(set(column)) > 1]
        low = running[0][0] if running else 0
        values = range(low, low + len(rows))
        rule = alike([statement.text for _, statement in rows], values) if len(rows) > 1 else None
        if rule is None:
            single += [statement for _, statement in group]
            continue
        letter, text = rule
        positions = [p for _, statement in rows for p in statement.positions]
        arrow = group[0][1].arrow
        loops.setdefault((letter, low, low + len(rows) - 1), []).append(Statement(tuple(text.split(f" {arrow} ")), arrow, positions))
    return loops, single


def _fanned(made: Sequence[Statement], notes: Mapping[int, Sequence[str]]) -> list[str]:
    """Lines: bonds that start at one place as a fan, comments before them."""
    fans: dict[tuple[str, str], list[Statement]] = {}
    for statement in made:
        key = (statement.ends[0], statement.arrow) if len(statement.ends) == 2 else (statement.text, "")
        fans.setdefault(key, []).append(statement)
    lines: list[str] = []
    for group in fans.values():
        told = dict.fromkeys(note for statement in group for p in statement.positions for note in notes.get(p, ()))
        lines += [f"// {note}" for note in told]
        first = group[0]
        if len(first.ends) > 2:
            lines.append(f"{first.text};")
        else:
            lines.append(f"{first.ends[0]} {first.arrow} {', '.join(statement.ends[1] for statement in group)};")
    return lines
