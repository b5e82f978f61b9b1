"""Where the findings of a test are shown: at its own statements.

Runs report what concerns their settings as said on a command line, and models under a made-up name; a test has lines of its own.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from bgdsl.diagnostics import Diagnostic, Label
from bgdsl.source import Span
from bgdsl.testing.subjects import HEIR


def moved(found: Iterable[Diagnostic], span: Span) -> tuple[Diagnostic, ...]:
    """The findings with `span` in place of the command line, and beside the places of a model."""
    return tuple(_moved(d, span) for d in found)


def _plain(text: str) -> str:
    """A message with the model's own name in place of the one that a test's modifications gave it."""
    return text.replace(f"{HEIR}`", "`")


def _moved(d: Diagnostic, span: Span) -> Diagnostic:
    primary = Label(d.primary.span, _plain(d.primary.text))
    d = replace(d, message=_plain(d.message), primary=primary)
    if primary.span.source.path is None:
        return replace(d, primary=Label(span, primary.text))
    if primary.span.source is span.source and span.start <= primary.span.start <= primary.span.end <= span.end:
        return d
    return replace(d, others=(*d.others, Label(span, "needed here")))
