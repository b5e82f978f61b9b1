"""Source text, places in it, and edits of it.

A `Span` carries its source, so it can print itself anywhere; line and column are worked out only when shown.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from hashlib import sha256
from pathlib import Path


@dataclass(frozen=True, eq=False)
class Source:
    """A text and the name under which messages show it; `path` is where it was read, if from a file."""

    name: str
    text: str
    path: Path | None = None

    @cached_property
    def line_starts(self) -> tuple[int, ...]:
        starts = [0]
        position = self.text.find("\n")
        while position >= 0:
            starts.append(position + 1)
            position = self.text.find("\n", position + 1)
        return tuple(starts)

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the text, in hexadecimal."""
        return sha256(self.text.encode("utf-8", "surrogatepass")).hexdigest()

    def position(self, offset: int) -> tuple[int, int]:
        """Line and column of a character, both counted from 1."""
        line = bisect_right(self.line_starts, offset)
        return line, offset - self.line_starts[line - 1] + 1

    def line(self, number: int) -> str:
        """The text of line `number` (from 1) without its line end."""
        start = self.line_starts[number - 1]
        end = self.text.find("\n", start)
        return self.text[start : end if end >= 0 else len(self.text)].rstrip("\r")


@dataclass(frozen=True, slots=True)
class Span:
    """Characters `start` to `end` (exclusive) of a source."""

    source: Source
    start: int
    end: int

    @property
    def text(self) -> str:
        return self.source.text[self.start : self.end]

    @property
    def line(self) -> int:
        return self.source.position(self.start)[0]

    @property
    def column(self) -> int:
        return self.source.position(self.start)[1]

    @property
    def place(self) -> str:
        """`file:line:column`."""
        line, column = self.source.position(self.start)
        return f"{self.source.name}:{line}:{column}"

    def to(self, other: Span) -> Span:
        """The span from the start of this one to the end of the other."""
        return Span(self.source, self.start, max(self.end, other.end))

    def __repr__(self) -> str:
        return f"<{self.place}>"


def said(text: str) -> Span:
    """A place in what was said outside of any file, on a command line or in an argument, for messages about it."""
    return Span(Source("<command line>", text), 0, len(text))


@dataclass(frozen=True, slots=True)
class Edit:
    """Put `text` where `span` stands; an empty span inserts."""

    span: Span
    text: str


def apply_edits(source: Source, edits: Iterable[Edit]) -> str:
    """The text of `source` with the edits spliced in; every other character stays. Overlapping edits raise ValueError."""
    pieces: list[str] = []
    position = 0
    for edit in sorted(edits, key=lambda edit: (edit.span.start, edit.span.end)):
        if edit.span.source is not source:
            raise ValueError(f"the edit at {edit.span.place} is of another source than {source.name}")
        if edit.span.start < position:
            raise ValueError(f"two edits overlap at {edit.span.place}")
        pieces += (source.text[position : edit.span.start], edit.text)
        position = edit.span.end
    pieces.append(source.text[position:])
    return "".join(pieces)
