"""`bgc activity`, `condition`, `partition`, `compare`, `verify`: what matters in a model, and the model without the rest."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bgdsl.cli import arguments as arg
from bgdsl.cli import console
from bgdsl.cli.app import app

if TYPE_CHECKING:
    from bgdsl.accuracy import Comparison
    from bgdsl.reduce import Measured, Partitioned, Reduced

Threshold = Annotated[str | None, typer.Option("--threshold", metavar="EPS", help="Terms of lower relative activity fall: 0.003 or 0.3%.")]
MaxError = Annotated[str | None, typer.Option("--max-error", metavar="E", help="Find the smallest model with output errors up to E (8%).")]
ShaftName = Annotated[
    str | None,
    typer.Option("--shaft", metavar="NAME", help="An output that is a shaft's angle: harmonics by order, errors at equal angles."),
]
Keep = Annotated[str | None, typer.Option("--keep", metavar="SHARE", help="Remove elements; those that stay have this share of activity.")]
Outputs = Annotated[str | None, typer.Option("--outputs", metavar="A,B", help="The outputs of interest; otherwise all.")]
Guard = Annotated[
    bool, typer.Option("--guard/--no-guard", metavar="", help="Keep a term whose rms effort (flow) is above the threshold all the same.")
]


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
    format: arg.TableOutputFormat = arg.TableFormat.TEXT,
) -> int:
    """Print the activity of every term, and how it compares with the largest at its junction."""
    from bgdsl.cli.files import write
    from bgdsl.passes import activity as pass_

    found = measured(file, model, experiment, set_, window, path, stop=stop, tolerance=tolerance, method=method).report
    if format is arg.TableFormat.JSON:
        text = pass_.to_json(found)
    elif format is arg.TableFormat.CSV:
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


def _is_conditioned(start: str) -> bool:
    return "annotation(conditioned(" in start


def _is_partition(start: str) -> bool:
    return "annotation(partition(" in start


@app.command()
def condition(
    file: arg.File,
    output: Annotated[Path, typer.Option("-o", "--output", metavar="OUT.bg", help="Where to write the conditioned model.")],
    threshold: Threshold = None,
    max_error: MaxError = None,
    keep: Keep = None,
    outputs: Outputs = None,
    shaft: ShaftName = None,
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
    from bgdsl.accuracy import measured_accuracy
    from bgdsl.cli.files import write

    if sum(given is not None for given in (threshold, max_error, keep)) != 1:
        raise typer.BadParameter("say what may fall: one of --threshold 0.3%, --max-error 8%, --keep 98%", param_hint="--threshold")
    eps = arg.fraction(threshold, "--threshold") if threshold else 0.0
    allowed = arg.fraction(max_error, "--max-error", most=1e3) if max_error else None
    found = measured(file, model, experiment, set_, window, path, stop=stop, tolerance=tolerance, method=method)
    if allowed is not None:
        return _searched(found, allowed, output, arg.names(outputs), shaft, guard, force, format)
    if keep is not None:
        reduced = reduce.eliminate_elements(found, min(1.0, arg.fraction(keep, "--keep")), folder=output.parent)
    else:
        reduced = reduce.condition(found, eps, guard=guard, folder=output.parent)
    write(output, reduced.source, ours=_is_conditioned, force=force)
    _told(reduced, output, measured_accuracy(reduced, output) if reduced.decision.dropped else None, format)
    return 0


def _told(reduced: Reduced, output: Path, accuracy: Comparison | None, format: arg.Format) -> None:
    decision, report, scalar = reduced.decision, reduced.report, reduced.measured.model.scalar
    records = report.by_index()
    names = {term.index: junction.name for junction in report.junctions for term in junction.terms}

    def listed(terms: Iterable[int]) -> list[dict[str, Any]]:
        return [{"junction": names[t], "term": records[t].name, "rho": records[t].rho} for t in sorted(terms)]

    if format is arg.Format.JSON:
        document = {"model": report.model, "output": str(output), "threshold": decision.threshold, "terms": len(scalar.terms)}
        kept = [{**entry, "reason": k.reason} for k in decision.kept for entry in listed([k.term])]
        found = {"dropped": listed(decision.dropped), "reinstated": listed(decision.reinstated), "kept": kept}
        console.out_json({**document, **found, "accuracy": accuracy and accuracy.as_dictionary()})
        return
    console.out(f"{output}: {len(decision.dropped)} of {len(scalar.terms)} terms dropped at {100 * decision.threshold:g} %")
    if decision.reinstated:
        back = ", ".join(records[t].name for t in decision.reinstated)
        console.out(f"taken back, since a junction would have been left undetermined: {back}")
    for reason in reduced.rewrite.reasons:
        console.message(f"written as one flat model: {reason}")
    if accuracy is not None:
        rows = [(o.name, f"{100 * o.nrms:.3g} %", f"{100 * o.peak:.3g} %") for o in accuracy.outputs]
        console.out(console.table(("output", "rms error", "peak error"), rows, right=(1, 2)))


def _searched(
    found: Measured,
    allowed: float,
    output: Path,
    outputs: tuple[str, ...] | None,
    shaft: str | None,
    guard: bool,
    force: bool,
    format: arg.Format,
) -> int:
    from bgdsl.accuracy import smallest
    from bgdsl.cli.files import write

    result = smallest(found, allowed, guard=guard, outputs=outputs, folder=output.parent, file=output.name, shaft=shaft)
    best = result.search.best
    text = result.reduced.source if result.reduced is not None else found.model.source
    write(output, text, ours=_is_conditioned, force=force)
    if format is arg.Format.JSON:
        models = [asdict(candidate) for candidate in result.search.tried]
        level = None if best is None else best.threshold
        console.out_json({"model": found.model.name, "output": str(output), "max_error": allowed, "best": level, "models": models})
        return 0
    full = result.full
    lines = [("full", "0", str(full.states), "0", f"{full.seconds:.3g}", "")]
    for candidate in result.search.tried:
        mark = "<- written" if candidate is best else ""
        numbers = (f"{100 * candidate.threshold:.4g} %", str(candidate.dropped), str(candidate.states), f"{100 * candidate.error:.3g} %")
        lines.append((*numbers, f"{candidate.seconds:.3g}", mark))
    console.out(console.table(("threshold", "dropped", "states", "error", "seconds", ""), lines, right=range(5)))
    if best is None:
        console.message(f"no reduction stays within {100 * allowed:g} %: the full model was written")
    return 0


@app.command()
def partition(
    file: arg.File,
    output: Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="The folder for the partitions' files.")],
    threshold: Threshold = None,
    conditioned: Annotated[
        bool, typer.Option("--conditioned", metavar="", help="Drop every term below the threshold, inside the partitions too.")
    ] = False,
    model: arg.ModelName = None,
    experiment: arg.ExperimentName = None,
    set_: arg.Set = None,
    window: arg.Window = None,
    guard: Guard = True,
    outputs: Annotated[
        str | None, typer.Option("--outputs", metavar="A,B", help="Variables of interest: what feeds none of them is left out.")
    ] = None,
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
    result = reduce.partition(found, eps, conditioned=conditioned, guard=guard, stem=file.stem, folder=output, outputs=arg.names(outputs))
    if format is arg.Format.JSON:
        console.out(result.document)
    if not result.files:
        if format is not arg.Format.JSON:
            console.out(_misses(result, eps))
        return 1
    for written in result.files:
        write(output / written.file, written.text, ours=_is_partition, force=force)
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


Full = Annotated[Path, typer.Argument(metavar="FULL", help="The full model's file.", show_default=False)]
ReducedFiles = Annotated[list[Path], typer.Argument(metavar="REDUCED...", help="Reduced files, folders of partitions.", show_default=False)]
ReducedFile = Annotated[Path, typer.Argument(metavar="REDUCED", help="What `condition` or `partition` wrote.", show_default=False)]
Cycles = Annotated[int, typer.Option("--cycles", min=1, help="With --shaft: how many cycles at the end of the run.")]
Revolutions = Annotated[float, typer.Option("--revolutions", min=0.01, help="With --shaft: revolutions of a cycle.")]
Harmonics = Annotated[int, typer.Option("--harmonics", min=0, help="How many harmonics of each output.")]
Together = Annotated[bool, typer.Option("--together", help="Run the partitions of a folder at the same time, each in its own process.")]
FullFile = Annotated[Path | None, typer.Option("--full", metavar="FILE", help="The full model; otherwise looked for near REDUCED.")]


def _given(**settings: Any) -> dict[str, Any]:
    return {name: value for name, value in settings.items() if value is not None}


@app.command()
def compare(
    full: Full,
    reduced: ReducedFiles,
    experiment: arg.ExperimentName = None,
    set_: arg.Set = None,
    outputs: Outputs = None,
    shaft: ShaftName = None,
    cycles: Cycles = 4,
    revolutions: Revolutions = 2.0,
    harmonics: Harmonics = 3,
    window: arg.Window = None,
    stop: arg.Stop = None,
    interval: arg.Interval = None,
    tolerance: arg.Tolerance = None,
    method: arg.Method = None,
    together: Together = False,
    path: arg.Search = None,
    format: arg.OutputFormat = arg.Format.TEXT,
) -> int:
    """Compare reduced models with the full one: means, harmonics, errors, cost."""
    from bgdsl import accuracy, playback, reduce

    settings = _given(stop=stop, interval=interval, tolerance=tolerance, method=method)
    of_interest, span = arg.names(outputs), arg.window(window)
    with console.progress("comparing") as progress:
        scenario = reduce.Scenario(experiment, arg.settings(set_), settings, progress)
        whole = playback.play(full, scenario, search_in=path or ())
        small = [playback.play(file, scenario, search_in=path or (), together=together) for file in reduced]
        comparisons = [
            accuracy.compare(
                whole, one, outputs=of_interest, window=span, harmonics=harmonics, shaft=shaft, cycles=cycles, revolutions=revolutions
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
def verify(
    reduced: ReducedFile,
    full: FullFile = None,
    experiment: arg.ExperimentName = None,
    set_: arg.Set = None,
    window: arg.Window = None,
    stop: arg.Stop = None,
    tolerance: arg.Tolerance = None,
    method: arg.Method = None,
    path: arg.Search = None,
    format: arg.OutputFormat = arg.Format.TEXT,
) -> int:
    """Run the full model again, under other conditions, and say which dropped terms matter there; status 1 if any does."""
    from bgdsl import accuracy, reduce

    settings = _given(stop=stop, tolerance=tolerance, method=method, window=arg.window(window))
    with console.progress("verifying") as progress:
        scenario = reduce.Scenario(experiment, arg.settings(set_), settings, progress)
        found = accuracy.verify_reduced(reduced, scenario, full=full, search_in=path or ())
    if format is arg.Format.JSON:
        console.out_json(found.as_dictionary())
    elif not found.terms:
        console.out(f"{found.reduced} holds for {found.now}: every dropped term stays below {100 * found.threshold:g} %")
    else:
        rows = [(t.junction, t.name, f"{100 * t.old:.3g} %", f"{100 * t.new:.3g} %", t.place) for t in found.terms]
        console.out(f"{found.reduced} does not hold for {found.now}; to reinstate:\n\n")
        console.out(console.table(("junction", "term", "old rho", "new rho", ""), rows, right=(2, 3)))
    return int(bool(found.terms))


Violation = Annotated[float, typer.Option("--violation", metavar="M", min=1e-15, help="Largest deflection of a parasitic spring, in m.")]
Twist = Annotated[float, typer.Option("--twist", metavar="RAD", min=1e-15, help="The same between rotations, in rad.")]
Share = Annotated[str, typer.Option("--activity", metavar="SHARE", help="Largest share of all activity for one kind of joint.")]
TunedFile = Annotated[Path, typer.Option("-o", "--output", metavar="OUT.bg", help="Where to write the model with the new values.")]


@app.command()
def tune(
    file: arg.File,
    output: TunedFile,
    violation: Violation = 2.5e-5,
    twist: Twist = 1e-4,
    activity: Share = "0.1%",
    model: arg.ModelName = None,
    experiment: arg.ExperimentName = None,
    set_: arg.Set = None,
    stop: arg.Stop = None,
    tolerance: arg.Tolerance = None,
    method: arg.Method = None,
    path: arg.Search = None,
    force: arg.Force = False,
    format: arg.OutputFormat = arg.Format.TEXT,
) -> int:
    """Find the softest parasitic springs and dampers that keep their limits; status 1 where none was found."""
    from bgdsl import pipeline, reduce, tuning
    from bgdsl.cli.files import write

    loaded = pipeline.load(file, model, search=path or ())
    share = arg.fraction(activity, "--activity")
    with console.progress(f"tuning {loaded.name}") as progress:
        scenario = reduce.Scenario(experiment, arg.settings(set_), _given(stop=stop, tolerance=tolerance, method=method), progress)
        found = tuning.tune_parasitics(loaded, scenario, violation=violation, twist=twist, activity=share)
    write(output, found.source, ours=lambda start: start.startswith("// Parasitic values of "), force=force)
    rows = [(t.group.name, f"{t.factor:.3g}", f"{t.deflection:.3g}", f"{100 * t.share:.3g} %") for t in found.tuning.groups]
    if format is arg.Format.JSON:
        groups = [
            {"parameter": t.group.name, "factor": t.factor, "deflection": t.deflection, "share": t.share} for t in found.tuning.groups
        ]
        document = {"model": loaded.name, "output": str(output), "runs": found.tuning.runs, "settled": found.tuning.settled}
        console.out_json({**document, "groups": groups, "values": dict(found.tuning.values)})
    else:
        console.out(console.table(("parameter", "factor", "deflection", "activity"), rows, right=(1, 2, 3)))
    if not found.tuning.settled:
        console.message(f"no values were found within the limits in {found.tuning.runs} runs; the last ones were written")
    return int(not found.tuning.settled)
