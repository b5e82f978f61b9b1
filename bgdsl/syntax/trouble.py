"""What has been found wrong in one text so far; repairs report through it, and count."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from bgdsl.diagnostics import Code, Reporter
from bgdsl.source import Span

MAX_ERRORS = 50
"""After so many errors the rest of the text is not read: it is no `.bg`."""


@dataclass(slots=True)
class Trouble:
    """`relexed`: how often text was read anew after a string without an end; `closed_at`: where constructs left open at one place
    were closed, which is said once; `said`: what is said once for each section, with its place."""

    report: Reporter
    errors: int = 0
    relexed: int = 0
    closed_at: int = -1
    said: set[tuple[str, int]] = field(default_factory=set)

    @property
    def enough(self) -> bool:
        """Whether there is no use in reading on."""
        return self.errors > MAX_ERRORS

    def add(
        self,
        code: Code,
        message: str,
        span: Span,
        label: str = "",
        *,
        others: Iterable[tuple[Span, str]] = (),
        notes: Iterable[str] = (),
        helps: Iterable[str] = (),
    ) -> None:
        """Report an error; the last one before giving up says so."""
        self.errors += 1
        if self.enough:
            notes = [*notes, f"there are more than {MAX_ERRORS} errors: the rest is not read"]
        self.report.add(code, message, span, label, others=others, notes=notes, helps=helps)
