"""What a source-to-source reduction gives back: new text, and what became of what."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from bgdsl.source import Span


@dataclass(frozen=True, slots=True)
class Change:
    """One statement or declaration that changed: what was done, as its comment in the new text says, and where it stood."""

    text: str
    span: Span
    terms: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class Rewrite:
    """text: the whole new file. forward: flat paths that did not stay (new path, or None where the thing is gone); every other
    path is what it was. specialised: new class names with the class each was copied from. taken_back: terms that were to be
    dropped and stay, with the reason. opened: the model was put together anew, vectors opened where they are cut, for the `reasons`
    given."""

    text: str
    changes: tuple[Change, ...] = ()
    forward: Mapping[str, str | None] = field(default_factory=dict)
    specialised: Mapping[str, str] = field(default_factory=dict)
    taken_back: Mapping[int, str] = field(default_factory=dict)
    opened: bool = False
    reasons: tuple[str, ...] = ()
