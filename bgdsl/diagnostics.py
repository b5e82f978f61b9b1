"""What the compiler has to say to the user: codes, labels, diagnostics, and how they are shown.

A `Code` is declared in the module that reports it; its explanation is the page `explanations/<number>.md`.
Numbers: BG1 syntax, 2 names and flattening, 3 domains and units, 4 causality, 5 equations, 6 code and simulation, 7 reductions.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from typing import Literal, NoReturn

from bgdsl.source import Span

Severity = Literal["error", "warning"]


@dataclass(frozen=True, slots=True)
class Code:
    """A kind of diagnostic. `title` says in a phrase what went wrong, with no detail of the case at hand."""

    number: str
    title: str
    severity: Severity = "error"

    def __post_init__(self) -> None:
        if self.number in CODES:
            raise ValueError(f"diagnostic code {self.number} is declared twice")
        CODES[self.number] = self


CODES: dict[str, Code] = {}
"""Every declared code by its number, filled as modules are imported."""


@dataclass(frozen=True, slots=True)
class Label:
    """A place and what stands there."""

    span: Span
    text: str = ""


@dataclass(frozen=True, slots=True)
class Diagnostic:
    """One finding: the primary label is where to look first, `others` are places that matter too."""

    code: Code
    message: str
    primary: Label
    others: tuple[Label, ...] = ()
    notes: tuple[str, ...] = ()
    helps: tuple[str, ...] = ()

    @property
    def severity(self) -> Severity:
        return self.code.severity


class BgError(Exception):
    """The work could not be done; `diagnostics` says why (at least one)."""

    def __init__(self, diagnostics: Sequence[Diagnostic]):
        assert diagnostics
        self.diagnostics = tuple(diagnostics)
        super().__init__(render(self.diagnostics))


class RunError(BgError):
    """A run that had to stop (not finite, not converged, singular); `time` is the model's time then."""

    def __init__(self, diagnostics: Sequence[Diagnostic], time: float):
        self.time = time
        super().__init__(diagnostics)


@dataclass
class Reporter:
    """Collects findings while passes go on; `stop_if_errors` ends the work once a pass has said all it has to say."""

    diagnostics: list[Diagnostic] = field(default_factory=list)

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
        self.diagnostics.append(
            Diagnostic(
                code,
                message,
                Label(span, label),
                tuple(Label(where, text) for where, text in others),
                tuple(notes),
                tuple(helps),
            )
        )

    def fail(self, code: Code, message: str, span: Span, label: str = "", **more: Iterable[object]) -> NoReturn:
        """Add an error and stop at once."""
        self.add(code, message, span, label, **more)  # type: ignore[arg-type]
        raise BgError([d for d in self.diagnostics if d.severity == "error"])

    @property
    def errors(self) -> tuple[Diagnostic, ...]:
        return tuple(d for d in self.diagnostics if d.severity == "error")

    def stop_if_errors(self) -> None:
        if self.errors:
            raise BgError(self.errors)


def did_you_mean(name: str, known: Iterable[str]) -> tuple[str, ...]:
    """A help line naming the closest known name, or nothing."""
    close = get_close_matches(name, list(known), n=1, cutoff=0.6)
    return (f"did you mean `{close[0]}`?",) if close else ()


def listed(names: Iterable[str], most: int = 8) -> str:
    """Names in a sentence: "`a`, `b` and 3 more"."""
    names = list(names)
    shown = ", ".join(f"`{name}`" for name in names[:most])
    return f"{shown} and {len(names) - most} more" if len(names) > most else shown


def counted(number: int, noun: str) -> str:
    """A number of things in a sentence: "1 state", "2 states"."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


# ---------------------------------------------------------------------------------------------------------------- shown


_STYLES = {"error": "1;31", "warning": "1;33", "rule": "1;34", "bold": "1", "second": "1;34", "help": "1;32"}


def _painter(colour: bool) -> Callable[[str, str], str]:
    def paint(text: str, style: str) -> str:
        return f"\x1b[{_STYLES[style]}m{text}\x1b[0m" if colour and text else text

    return paint


def render(diagnostics: Iterable[Diagnostic], *, colour: bool = False) -> str:
    """The diagnostics as text, in the shape of rustc's: code, place, line with carets, notes, help."""
    return "\n\n".join(_render_one(diagnostic, colour) for diagnostic in diagnostics)


def _render_one(diagnostic: Diagnostic, colour: bool) -> str:
    paint = _painter(colour)
    labels = [diagnostic.primary, *diagnostic.others]
    width = max(len(str(label.span.line)) for label in labels)
    head = paint(f"{diagnostic.severity}[{diagnostic.code.number}]", diagnostic.severity)
    lines = [f"{head}: {paint(diagnostic.message, 'bold')}"]
    by_source: dict[int, list[Label]] = {}
    for label in labels:
        by_source.setdefault(id(label.span.source), []).append(label)
    for group in by_source.values():
        arrow = "-->" if group[0] is diagnostic.primary else ":::"
        lines.append(f"{' ' * width}{paint(arrow, 'rule')} {group[0].span.place}")
        if not group[0].span.source.text:
            continue  # nothing to show of an empty file, or of none
        before: int | None = None
        for label in sorted(group, key=lambda label: label.span.start):
            number, column = label.span.source.position(label.span.start)
            text = label.span.source.line(number)
            if number != before:
                if before is not None and number > before + 1:
                    lines.append(f"{' ' * width}{paint('...', 'rule')}")
                lines.append(f"{paint(f'{number:>{width}} |', 'rule')} {_tidy(text)}")
                before = number
            mark = "^" if label is diagnostic.primary else "-"
            room = max(1, len(text) - column + 1)
            marks = mark * max(1, min(label.span.end - label.span.start, room))
            pad = _tidy(text[: column - 1], blank=True)
            style = diagnostic.severity if label is diagnostic.primary else "second"
            shown = paint(f"{marks} {label.text}".rstrip(), style)
            lines.append(f"{paint(' ' * width + ' |', 'rule')} {pad}{shown}")
    for note in diagnostic.notes:
        lines.append(f"{' ' * width} {paint('=', 'rule')} {paint('note', 'bold')}: {note}")
    for text in diagnostic.helps:
        lines.append(f"{' ' * width} {paint('=', 'rule')} {paint('help', 'help')}: {text}")
    return "\n".join(lines)


def _tidy(text: str, *, blank: bool = False) -> str:
    """A line as it can be printed: tabs as four spaces, control characters replaced, very long lines cut."""
    shown = "".join("    " if c == "\t" else " " if blank else c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in text)
    return shown if len(shown) <= 200 else shown[:200] + ("" if blank else " ...")


def to_json(diagnostics: Iterable[Diagnostic]) -> str:
    """The diagnostics as one JSON document: a list of objects with stable keys."""
    return json.dumps(as_records(diagnostics), indent=2)


def as_records(diagnostics: Iterable[Diagnostic]) -> list[dict[str, object]]:
    """The diagnostics as plain data, as JSON has them."""

    def place(label: Label) -> dict[str, object]:
        source = label.span.source
        line, column = source.position(label.span.start)
        end_line, end_column = source.position(label.span.end)
        return {"file": source.name, "line": line, "column": column, "end_line": end_line, "end_column": end_column, "text": label.text}

    return [
        {
            "code": d.code.number,
            "severity": d.severity,
            "message": d.message,
            "primary": place(d.primary),
            "others": [place(label) for label in d.others],
            "notes": list(d.notes),
            "helps": list(d.helps),
        }
        for d in diagnostics
    ]
