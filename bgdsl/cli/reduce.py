"""`bgc activity`, `condition`, `partition`, `compare`, `verify`: what matters in a model, and the model without the rest."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bgdsl.cli import arguments as arg
from bgdsl.cli import console
from bgdsl.cli.app import app

if TYPE_CHECKING:
    from bgdsl.reduce import Measured, Partitioned

Threshold = Annotated[str | None, typer.Option("--threshold", metavar="EPS", help="Terms of lower relative activity fall: 0.003 or 0.3%.")]
Guard = Annotated[bool, typer.Option("--guard/--no-guard", help="Keep a term whose rms effort (flow) is above the threshold all the same.")]


def measured(
    file: Path,
    model: str | None,
    experiment: str | None,
    set_: list[str] | None,
    window: str | None,
    path: list[Path] | None,
    **settings: Any,
) -> Measured:
    """The activities of a file's model."""
    from bgdsl import pipeline, reduce

    loaded = pipeline.load(file, model, search=path or ())
    given = {name: value for name, value in settings.items() if value is not None}
    with console.progress(f"measuring {loaded.name}") as progress:
        scenario = reduce.Scenario(experiment, arg.settings(set_), {**given, "window": arg.window(window)}, progress)
        return reduce.measure(loaded, scenario)


@app.command()
def activity(
    file: arg.File,
    model: arg.ModelName = None,
    experiment: arg.ExperimentName = None,
    set_: arg.Set = None,
    window: arg.Window = None,
    threshold: Threshold = None,
    stop: arg.Stop = None,
    tolerance: arg.Tolerance = None,
    method: arg.Method = None,
    output: arg.Output = None,
    path: arg.Search = None,
    force: arg.Force = False,
    format: arg.OutputFormat = arg.Format.TEXT,
) -> int:
    """Print the activity of every term, and how it compares with the largest at its junction."""
    from bgdsl.cli.files import write
    from bgdsl.passes import activity as pass_

    found = measured(file, model, experiment, set_, window, path, stop=stop, tolerance=tolerance, method=method).report
    if format is arg.Format.JSON:
        text = pass_.to_json(found)
    elif format is arg.Format.CSV:
        text = pass_.to_csv(found)
    else:
        text = _table(found, arg.fraction(threshold, "--threshold") if threshold else 0.01)
    if output is None:
        console.out(text)
    else:
        write(output, text, ours=lambda start: start.startswith(('{"model"', '{\n  "model"', "junction,")), force=force)
    return 0


def _table(report: Any, threshold: float) -> str:
    from bgdsl.passes.activity import table_rows

    rows = table_rows(report, threshold)
    text = console.table(("junction", "term", "activity / J", "rho", ""), rows, right=(2, 3))
    if console.colour(sys.stdout):
        text = "\n".join(f"\x1b[2m{line}\x1b[0m" if line.rstrip().endswith("below") else line for line in text.split("\n"))
    elements = [(e.name, e.kind, f"{e.activity:.5g}", f"{100 * e.index:.2f} %") for e in report.elements]
    head = f"window {report.window[0]:g} to {report.window[1]:g} s" + (f", experiment {report.experiment}" if report.experiment else "")
    return f"{head}\n\n{text}\n\n" + console.table(("element", "kind", "activity / J", "index"), elements, right=(2, 3))


def _is_reduced(start: str) -> bool:
    return "annotation(conditioned(" in start or "annotation(partition(" in start


@app.command()
def condition(
    file: arg.File,
    output: Annotated[Path, typer.Option("-o", "--output", metavar="OUT.bg", help="Where to write the conditioned model.")],
    threshold: Threshold = None,
    model: arg.ModelName = None,
    experiment: arg.ExperimentName = None,
    set_: arg.Set = None,
    window: arg.Window = None,
    guard: Guard = True,
    stop: arg.Stop = None,
    tolerance: arg.Tolerance = None,
    method: arg.Method = None,
    path: arg.Search = None,
    force: arg.Force = False,
    format: arg.OutputFormat = arg.Format.TEXT,
) -> int:
    """Write the model without the terms whose relative activity is below a threshold."""
    from bgdsl import reduce
    from bgdsl.cli.files import write

    if threshold is None:
        raise typer.BadParameter("say what may fall: --threshold 0.3%, or --max-error 8%", param_hint="--threshold")
    eps = arg.fraction(threshold, "--threshold")
    found = measured(file, model, experiment, set_, window, path, stop=stop, tolerance=tolerance, method=method)
    reduced = reduce.condition(found, eps, guard=guard, folder=output.parent)
    write(output, reduced.source, ours=_is_reduced, force=force)
    console.out(f"{output}: {len(reduced.decision.dropped)} terms dropped of {len(found.model.scalar.terms)}")
    return 0


@app.command()
def partition(
    file: arg.File,
    output: Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="The folder for the partitions' files.")],
    threshold: Threshold = None,
    conditioned: Annotated[
        bool, typer.Option("--conditioned", help="Drop every term below the threshold, inside the partitions too.")
    ] = False,
    model: arg.ModelName = None,
    experiment: arg.ExperimentName = None,
    set_: arg.Set = None,
    window: arg.Window = None,
    guard: Guard = True,
    stop: arg.Stop = None,
    tolerance: arg.Tolerance = None,
    method: arg.Method = None,
    path: arg.Search = None,
    force: arg.Force = False,
    format: arg.OutputFormat = arg.Format.TEXT,
) -> int:
    """Take a model apart into driving and driven models; status 1 and the nearest misses where it holds together."""
    from bgdsl import reduce
    from bgdsl.cli.files import write

    if threshold is None:
        raise typer.BadParameter("say what may fall: --threshold 0.3%", param_hint="--threshold")
    eps = arg.fraction(threshold, "--threshold")
    found = measured(file, model, experiment, set_, window, path, stop=stop, tolerance=tolerance, method=method)
    result = reduce.partition(found, eps, conditioned=conditioned, guard=guard, stem=file.stem, folder=output)
    if format is arg.Format.JSON:
        console.out(result.document)
    if not result.files:
        if format is not arg.Format.JSON:
            console.out(_misses(result, eps))
        return 1
    for written in result.files:
        write(output / written.file, written.text, ours=_is_reduced, force=force)
    write(output / "partition.json", result.document + "\n", ours=lambda start: '"partitions"' in start, force=force)
    if format is not arg.Format.JSON:
        console.out(_files(result, output))
    return 0


def _files(result: Partitioned, folder: Path) -> str:
    header = ("file", "role", "states", "inputs", "outputs")
    rows = [
        (str(folder / w.file), w.partition.role, *(str(len(x)) for x in (w.partition.states, w.inputs, w.outputs))) for w in result.files
    ]
    return console.table(header, rows, right=(2, 3, 4))


def _misses(result: Partitioned, eps: float) -> str:
    head = f"the model holds together at {100 * eps:g} %"
    if result.found.apart_at is not None:
        head += f"; it would come apart at {100 * result.found.apart_at:.3g} %"
    rows = [(m.junction, m.name, f"{100 * m.rho:.4g} %") for m in result.found.misses]
    return head + ("\n\n" + console.table(("junction", "term", "rho"), rows, right=(2,)) if rows else "")
