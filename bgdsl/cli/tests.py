"""`bgc test`: carry out the `test` blocks of `.bg` files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

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
    """Run the tests in .bg files; status 1 if one fails, 2 if one could not be carried out."""
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
                _tell(outcome)
    if only is not None and not outcomes and not unreadable:
        raise typer.BadParameter(f"no test's name contains `{only}`", param_hint="-k")
    if format is arg.Format.JSON:
        console.out_json(_document(outcomes, unreadable))
    else:
        console.diagnostics(unreadable)
        console.out(_total(outcomes))
    if unreadable or any(outcome.error for outcome in outcomes):
        return 2
    return int(not all(outcome.passed for outcome in outcomes))


def _tell(outcome: Outcome) -> None:
    console.out(f"{_mark(outcome)}  {outcome.file}: {outcome.name}  ({outcome.seconds:.2f} s)")
    console.diagnostics(outcome.findings)


def _mark(outcome: Outcome) -> str:
    return "passed" if outcome.passed else "ERROR " if outcome.error else "FAILED"


def _total(outcomes: Sequence[Outcome]) -> str:
    if not outcomes:
        return "no tests"
    errors = sum(outcome.error for outcome in outcomes)
    passed = sum(outcome.passed for outcome in outcomes)
    text = f"{passed} passed, {len(outcomes) - passed - errors} failed"
    return text + (f", {errors} could not be carried out" if errors else "")


def _document(outcomes: Sequence[Outcome], unreadable: Sequence[Diagnostic]) -> dict[str, object]:
    errors = sum(outcome.error for outcome in outcomes)
    passed = sum(outcome.passed for outcome in outcomes)
    return {
        "passed": passed,
        "failed": len(outcomes) - passed - errors,
        "errors": errors,
        "tests": [
            {
                "file": str(outcome.file),
                "name": outcome.name,
                "passed": outcome.passed,
                "error": outcome.error,
                "seconds": outcome.seconds,
                "findings": [_finding(d, outcome) for d in outcome.findings],
            }
            for outcome in outcomes
        ],
        "unreadable": [_finding(d, None) for d in unreadable],
    }


def _finding(d: Diagnostic, outcome: Outcome | None) -> dict[str, Any]:
    worst = outcome.worst.get(d) if outcome else None
    point = {"worst": asdict(worst)} if worst else {}
    return {"code": d.code.number, "message": d.message, "place": d.primary.span.place, "text": d.primary.text, **point}
