"""What goes to the two streams: results to stdout, messages to stderr; colours and progress only on a terminal."""

from __future__ import annotations

import json
import math
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from bgdsl.diagnostics import Diagnostic, render

debug = False
"""Set by `--debug`: tracebacks are shown."""


class RefusedError(Exception):
    """What was asked for is not done; the message says why."""


def colour(stream: Any) -> bool:
    """Whether to write colours to the stream: a terminal, and NO_COLOR not set."""
    return bool(stream.isatty()) and "NO_COLOR" not in os.environ


def out(text: str) -> None:
    """A result."""
    sys.stdout.write(text if text.endswith("\n") else text + "\n")


def out_json(document: object) -> None:
    """A result as one JSON document. JSON has no infinity and nothing that is not a number: null stands for them."""
    try:
        text = json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False)
    except ValueError:
        text = json.dumps(_finite(document), indent=2, ensure_ascii=False)
    out(text)


def _finite(value: Any) -> Any:
    match value:
        case float() if not math.isfinite(value):
            return None
        case dict():
            return {key: _finite(entry) for key, entry in value.items()}
        case list() | tuple():
            return [_finite(entry) for entry in value]
        case _:
            return value


def message(text: str) -> None:
    """Something said beside the result, after what the result has so far: the two streams may be one file."""
    sys.stdout.flush()
    sys.stderr.write(text if text.endswith("\n") else text + "\n")


def diagnostics(found: Iterable[Diagnostic]) -> None:
    """Findings, on stderr."""
    found = tuple(found)
    if found:
        message(render(found, colour=colour(sys.stderr)))


def table(header: Sequence[str], rows: Sequence[Sequence[str]], *, right: Iterable[int] = ()) -> str:
    """Aligned columns; those numbered in `right` are flush right."""
    flush = set(right)
    widths = [max(len(row[i]) for row in [header, *rows]) for i in range(len(header))]

    def line(row: Sequence[str]) -> str:
        cells = (cell.rjust(w) if i in flush else cell.ljust(w) for i, (cell, w) in enumerate(zip(row, widths, strict=True)))
        return "  ".join(cells).rstrip()

    return "\n".join([line(header), "  ".join("-" * w for w in widths).rstrip(), *(line(row) for row in rows)])


@contextmanager
def progress(what: str) -> Iterator[Callable[[float], None] | None]:
    """A progress bar on stderr fed with fractions 0..1; None, and nothing shown, where stderr is no terminal."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(what, total=1.0)
        yield lambda fraction: bar.update(task, completed=fraction)
