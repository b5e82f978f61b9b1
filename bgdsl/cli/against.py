"""`bgc compare`, `bgc verify`: reduced models held against the full one."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bgdsl.cli import arguments as arg
from bgdsl.cli import console
from bgdsl.cli.app import app
from bgdsl.cli.groups import RunGroup, grouped

if TYPE_CHECKING:
    from bgdsl.accuracy import Comparison
    from bgdsl.verification import Verification

Full = Annotated[Path, typer.Argument(metavar="FULL", help="The full model's file.", show_default=False)]
ReducedFiles = Annotated[list[Path], typer.Argument(metavar="REDUCED...", help="Reduced files, folders of partitions.", show_default=False)]
ReducedFile = Annotated[Path, typer.Argument(metavar="REDUCED", help="What `condition` or `partition` wrote.", show_default=False)]
Cycles = Annotated[int, typer.Option("--cycles", min=1, help="With --shaft: how many cycles at the end of the run.")]
Revolutions = Annotated[float, typer.Option("--revolutions", min=0.01, help="With --shaft: revolutions of a cycle.")]
Harmonics = Annotated[int, typer.Option("--harmonics", min=0, help="How many harmonics of each output.")]
Together = Annotated[bool, typer.Option("--together", help="Run the partitions of a folder at the same time, each in its own process.")]
FullFile = Annotated[Path | None, typer.Option("--full", metavar="FILE", help="The full model; otherwise looked for near REDUCED.")]


@app.command()
@grouped
def compare(
    full: Full,
    reduced: ReducedFiles,
    run: RunGroup,
    outputs: arg.Outputs = None,
    shaft: arg.Shaft = None,
    cycles: Cycles = 4,
    revolutions: Revolutions = 2.0,
    harmonics: Harmonics = 3,
    interval: arg.Interval = None,
    together: Together = False,
    format: arg.OutputFormat = arg.Format.TEXT,
) -> int:
    """Compare reduced models with the full one: means, harmonics, errors, cost."""
    from bgdsl import accuracy, playback, reduce

    of_interest = arg.names(outputs)
    with console.progress("comparing") as progress:
        scenario = reduce.Scenario(run.experiment, run.changes, run.settings(interval=interval), progress)
        whole = playback.play(full, scenario, search_in=run.folders)
        small = [playback.play(file, scenario, search_in=run.folders, together=together) for file in reduced]
        comparisons = [
            accuracy.compare(
                whole, one, outputs=of_interest, window=run.span, harmonics=harmonics, shaft=shaft, cycles=cycles, revolutions=revolutions
            )
            for one in small
        ]
    if format is arg.Format.JSON:
        console.out_json({"full": whole.cost(), "reduced": [comparison.as_dictionary() for comparison in comparisons]})
    else:
        console.out("\n\n".join(_comparison(comparison) for comparison in comparisons))
    return 0


def _comparison(comparison: Comparison) -> str:
    full, reduced = comparison.full, comparison.reduced
    costs = [(p.name, str(p.states), str(p.equations), str(p.steps), str(p.rhs_calls), f"{p.seconds:.3g}") for p in (full, reduced)]
    rows: list[tuple[str, ...]] = []
    for output in comparison.outputs:
        errors = (f"{100 * output.nrms:.3g} %", f"{100 * output.peak:.3g} %")
        rows.append((output.name, "mean", f"{output.mean[0]:.5g}", f"{output.mean[1]:.5g}", "", *errors))
        for one, other in output.harmonics:
            where = f"{one.frequency:.4g} Hz" if one.order is None else f"order {one.order:g}"
            change = f"{100 * (other.amplitude / one.amplitude - 1):+.3g} %" if one.amplitude else ""
            rows.append(("", where, f"{one.amplitude:.5g}", f"{other.amplitude:.5g}", change, "", ""))
    cost = console.table(("model", "states", "equations", "steps", "rhs calls", "seconds"), costs, right=range(1, 6))
    header = ("output", "", "full", "reduced", "change", "rms error", "peak error")
    return f"{cost}\n\n{console.table(header, rows, right=range(2, 7))}"


@app.command()
@grouped
def verify(
    reduced: ReducedFile,
    run: RunGroup,
    full: FullFile = None,
    format: arg.OutputFormat = arg.Format.TEXT,
) -> int:
    """Run the full model again, under other conditions, and say which dropped terms matter there; status 1 if any does."""
    from bgdsl import reduce, verification

    with console.progress("verifying") as progress:
        scenario = reduce.Scenario(run.experiment, run.changes, run.settings(window=run.span), progress)
        found = verification.verify_reduced(reduced, scenario, full=full, search_in=run.folders)
    if format is arg.Format.JSON:
        console.out_json(found.as_dictionary())
    else:
        console.out(_verdict(found))
    return int(not found.holds)


def _verdict(found: Verification) -> str:
    error = "" if found.error is None else f"its error is {100 * found.error:.3g} %, of {100 * (found.max_error or 0.0):.3g} % allowed"
    if found.holds:
        below = f"every dropped term stays below {100 * found.threshold:g} %"
        still = f"what was left out is not among what makes up {100 * (found.keep or 0.0):g} % of all activity"
        return f"{found.reduced} holds for {found.now}: {error or (below if found.keep is None else still)}"
    head = f"{found.reduced} does not hold for {found.now}{': ' if error else ''}{error}; "
    rows = [(t.junction, t.name, f"{100 * t.old:.3g} %", f"{100 * t.new:.3g} %", t.place) for t in found.terms]
    if not rows:
        return head + "no dropped term is much more active than it was"
    text = console.table(("junction", "term", "old rho", "new rho", ""), rows, right=(2, 3))
    return f"{head}{'more active than they were' if error else 'to reinstate'}:\n\n{text}"
