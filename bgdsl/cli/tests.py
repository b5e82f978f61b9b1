"""`bgc test`: carry out the `test` blocks of `.bg` files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bgdsl.cli import arguments as arg
from bgdsl.cli import console
from bgdsl.cli.app import app
from bgdsl.diagnostics import BgError, Diagnostic

if TYPE_CHECKING:
    from bgdsl.testing.runner import Outcome


@app.command()
def test(
    paths: Annotated[list[Path] | None, typer.Argument(metavar="[PATH...]", help="Files or folders; otherwise this folder.")] = None,
    only: Annotated[str | None, typer.Option("-k", metavar="TEXT", help="Only tests whose name contains TEXT.")] = None,
    path: arg.Search = None,
    format: arg.OutputFormat = arg.Format.TEXT,
) -> int:
    """Run the tests in .bg files; status 1 if one fails."""
    from bgdsl.testing.runner import collect, run_file

    outcomes: list[Outcome] = []
    unreadable: list[Diagnostic] = []
    for file in collect(paths or [Path()]):
        try:
            found = run_file(file, search=path or (), only=only)
        except BgError as error:
            unreadable += error.diagnostics
            continue
        outcomes += found
        if format is arg.Format.TEXT:
            for outcome in found:
                mark = "passed" if outcome.passed else "ERROR " if outcome.error else "FAILED"
                console.out(f"{mark}  {outcome.file}: {outcome.name}  ({outcome.seconds:.2f} s)")
                console.diagnostics(outcome.findings)
    failed = sum(not outcome.passed for outcome in outcomes)
    if format is arg.Format.JSON:
        console.out_json(_document(outcomes))
    else:
        console.out(f"{len(outcomes) - failed} passed, {failed} failed")
    console.diagnostics(unreadable)
    return 2 if unreadable else int(failed > 0)


def _document(outcomes: Sequence[Outcome]) -> dict[str, object]:
    return {
        "passed": sum(outcome.passed for outcome in outcomes),
        "failed": sum(not outcome.passed for outcome in outcomes),
        "tests": [
            {
                "file": str(outcome.file),
                "name": outcome.name,
                "passed": outcome.passed,
                "seconds": outcome.seconds,
                "findings": [_finding(d) for d in outcome.findings],
            }
            for outcome in outcomes
        ],
    }


def _finding(d: Diagnostic) -> dict[str, str]:
    return {"code": d.code.number, "message": d.message, "place": d.primary.span.place, "text": d.primary.text}
