"""`bgc activity`, `condition`, `partition`, `tune`: what matters in a model, and the model without the rest."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bgdsl.cli import arguments as arg
from bgdsl.cli import console
from bgdsl.cli.app import app
from bgdsl.cli.groups import RunGroup, grouped
from bgdsl.diagnostics import BgError, as_records

if TYPE_CHECKING:
    from bgdsl.accuracy import Comparison
    from bgdsl.ir.activity import ActivityReport
    from bgdsl.reduce import Measured, Partitioned, Reduced
    from bgdsl.reductions.search import Candidate, Search
    from bgdsl.searching import Searched

Threshold = Annotated[str | None, typer.Option("--threshold", metavar="EPS", help="Terms of lower relative activity fall: 0.003 or 0.3%.")]
MaxError = Annotated[str | None, typer.Option("--max-error", metavar="E", help="Find the smallest model with output errors up to E (8%).")]
Tries = Annotated[int | None, typer.Option("--tries", metavar="N", min=1, help="With --max-error: about so many models are tried.")]
Keep = Annotated[str | None, typer.Option("--keep", metavar="SHARE", help="Remove elements; those that stay have this share of activity.")]
Guard = Annotated[
    bool, typer.Option("--guard/--no-guard", metavar="", help="Keep a term whose rms effort (flow) is above the threshold all the same.")
]
Conditioned = Annotated[bool, typer.Option("--conditioned", metavar="", help="Drop every term below EPS, inside the partitions too.")]
OfInterest = Annotated[str | None, typer.Option("--outputs", metavar="A,B", help="Variables of interest: what feeds none is left out.")]
OutputFile = Annotated[Path, typer.Option("-o", "--output", metavar="OUT.bg", help="Where to write the conditioned model.")]
OutputFolder = Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="The folder for the partitions' files.")]


def measured(file: Path, model: str | None, run: RunGroup) -> Measured:
    """The activities of a file's model."""
    from bgdsl import pipeline, reduce

    loaded = pipeline.load(file, model, search=run.folders)
    with console.progress(f"measuring {loaded.name}") as progress:
        return reduce.measure(loaded, reduce.Scenario(run.experiment, run.changes, run.settings(window=run.span), progress))


@app.command()
@grouped
def activity(
    file: arg.File,
    run: RunGroup,
    model: arg.ModelName = None,
    threshold: Threshold = None,
    output: arg.Output = None,
    force: arg.Force = False,
    format: arg.TableOutputFormat = arg.TableFormat.TEXT,
) -> int:
    """Print the activity of every term, and how it compares with the largest at its junction."""
    from bgdsl.cli.files import write
    from bgdsl.passes import activity as pass_

    found = measured(file, model, run).report
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


def _table(report: ActivityReport, threshold: float) -> str:
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
@grouped
def condition(
    file: arg.File,
    output: OutputFile,
    run: RunGroup,
    threshold: Threshold = None,
    max_error: MaxError = None,
    keep: Keep = None,
    outputs: arg.Outputs = None,
    shaft: arg.Shaft = None,
    tries: Tries = None,
    model: arg.ModelName = None,
    guard: Guard = True,
    force: arg.Force = False,
    format: arg.OutputFormat = arg.Format.TEXT,
) -> int:
    """Write the model without the terms whose relative activity is below a threshold, or as small as an error allows."""
    from bgdsl import reduce
    from bgdsl.accuracy import measured_accuracy
    from bgdsl.cli.files import write

    if sum(given is not None for given in (threshold, max_error, keep)) != 1:
        raise typer.BadParameter("say what may fall: one of --threshold 0.3%, --max-error 8%, --keep 98%", param_hint="--threshold")
    eps = arg.fraction(threshold, "--threshold") if threshold else 0.0
    allowed = arg.fraction(max_error, "--max-error") if max_error else None
    if allowed is None and (outputs or shaft):
        raise typer.BadParameter("it says whose error may be how large, and goes with --max-error", param_hint="--outputs/--shaft")
    found = measured(file, model, run)
    if allowed is not None:
        how = {"guard": guard, "outputs": arg.names(outputs), "shaft": shaft, "most": tries or math.inf}
        result = _searched(found, allowed, output, how)
        text = result.reduced.source if result.reduced is not None else found.model.source
        write(output, text, ours=_is_conditioned, force=force)
        if format is arg.Format.JSON:
            console.out_json(_search_document(found, result, allowed, output))
        else:
            _search_told(result, allowed, output)
        return 0
    if keep is not None:
        reduced = reduce.eliminate_elements(found, min(1.0, arg.fraction(keep, "--keep")), folder=output.parent)
    else:
        reduced = reduce.condition(found, eps, guard=guard, folder=output.parent)
    write(output, reduced.source, ours=_is_conditioned, force=force)
    accuracy, failure = None, None
    try:
        accuracy = measured_accuracy(reduced, output) if reduced.decision.dropped else None
    except BgError as error:  # it compiles, and is worth a look: what was dropped kept it in bounds
        failure = error
    _told(reduced, output, accuracy, failure, format)
    return 0 if failure is None else 1


TAKEN_BACK_SHOWN = 8
"""So many terms are named; JSON names all."""


def _told(reduced: Reduced, output: Path, accuracy: Comparison | None, failure: BgError | None, format: arg.Format) -> None:
    if format is arg.Format.JSON:
        console.out_json({**_document(reduced, output, accuracy), "failure": failure and as_records(failure.diagnostics)})
        return
    decision, records = reduced.decision, reduced.report.by_index()
    terms = len(reduced.measured.model.scalar.terms)
    console.out(f"{output}: {len(decision.dropped)} of {terms} terms dropped at {100 * decision.threshold:g} %")
    if decision.reinstated:
        shown, more = decision.reinstated[:TAKEN_BACK_SHOWN], len(decision.reinstated) - TAKEN_BACK_SHOWN
        back = ", ".join(records[t].name for t in shown) + (f" and {more} more" if more > 0 else "")
        why = "a junction would have been left undetermined" if decision.fault is None else f"else it does not compile ({decision.fault})"
        console.out(f"taken back, since {why}: {back}")
    for reason in reduced.rewrite.reasons:
        console.message(f"written with its vectors opened: {reason}")
    if accuracy is not None:
        console.out(_accuracy(accuracy))
    if failure is not None:
        console.diagnostics(failure.diagnostics)
        console.message(f"{output} is written and compiles, but its run fails")


def _accuracy(accuracy: Comparison) -> str:
    rows = [(o.name, f"{100 * o.nrms:.3g} %", f"{100 * o.peak:.3g} %") for o in accuracy.outputs]
    return console.table(("output", "rms error", "peak error"), rows, right=(1, 2))


def _document(reduced: Reduced, output: Path, accuracy: Comparison | None) -> dict[str, Any]:
    """What JSON says of a reduction."""
    decision, report = reduced.decision, reduced.report
    listed = _listed(report)
    return {
        "model": report.model,
        "output": str(output),
        "threshold": decision.threshold,
        "terms": len(reduced.measured.model.scalar.terms),
        "dropped": listed(decision.dropped),
        "reinstated": listed(decision.reinstated),
        "kept": [{**entry, "reason": k.reason} for k in decision.kept for entry in listed([k.term])],
        "accuracy": accuracy and accuracy.as_dictionary(),
    }


def _listed(report: ActivityReport) -> Callable[[Iterable[int]], list[dict[str, Any]]]:
    """How JSON lists terms."""
    records = report.by_index()
    names = {term.index: junction.name for junction in report.junctions for term in junction.terms}
    return lambda terms: [{"junction": names[t], "term": records[t].name, "rho": records[t].rho} for t in sorted(terms)]


# ---------------------------------------------------------------------------------------------------------------- search


def _searched(found: Measured, allowed: float, output: Path, how: dict[str, Any]) -> Searched:
    from bgdsl.searching import smallest

    with console.progress("looking for the smallest") as progress:
        return smallest(found, allowed, folder=output.parent, file=output.name, progress=progress, **how)


def _search_document(found: Measured, result: Searched, allowed: float, output: Path) -> dict[str, Any]:
    best, listed = result.search.best, _listed(found.report)
    written = None if result.reduced is None else _document(result.reduced, output, result.accuracy)
    return {
        "model": found.model.name,
        "output": str(output),
        "max_error": allowed,
        "best": None if best is None else best.threshold,
        "models": [candidate.as_dictionary() for candidate in result.search.tried],
        "trials": result.search.trials,
        "ended": result.search.ended,
        "costly": [{"error": g.error, "terms": listed(g.family.terms)} for g in result.search.guilty],
        "written": written,
    }


COSTLY_SHOWN = 12
"""Lines of the table of terms that stay."""

DIFFERS = 0.05
"""By such a share of the error allowed may what was tried and what was written differ, and it is not worth a word."""


def _search_told(result: Searched, allowed: float, output: Path) -> None:
    search, full = result.search, result.full
    if result.reduced is not None and search.best is None:
        console.out(f"{output}: this model was found so already; nothing more falls")
        return
    lines = [("full", "0", "0", str(full.states), "0 %", "")]
    for candidate in search.tried:
        mark = _mark(candidate, search.best, allowed)
        counts = (str(candidate.dropped), str(candidate.spared), str(candidate.states))
        lines.append((_percent(candidate.threshold), *counts, _percent(candidate.error), mark))
    console.out(console.table(("threshold", "dropped", "spared", "states", "error", ""), lines, right=range(5)))
    if result.reduced is None or result.accuracy is None:
        console.message(f"no term can go within {100 * allowed:g} %: the model is written as it is")
        return
    if search.guilty:
        console.out(f"\n{_costly(result.reduced.report, search)}")
    terms = len(result.reduced.measured.model.scalar.terms)
    console.out(f"\n{output}: {len(result.reduced.decision.dropped)} of {terms} terms dropped, {search.trials} models tried")
    for reason in result.reduced.rewrite.reasons:
        console.message(f"written with its vectors opened: {reason}")
    if search.best is not None and abs(search.best.error - result.accuracy.worst) > DIFFERS * allowed:
        console.message(f"tried at a looser tolerance its error was {_percent(search.best.error)}")
    console.out(_accuracy(result.accuracy))
    console.out(_saved(result.accuracy))


def _mark(candidate: Candidate, best: Candidate | None, allowed: float) -> str:
    """What became of a candidate, where its line alone does not say it."""
    if candidate is best:
        return "<- written"
    if candidate.error > allowed:
        return "too much"
    return "" if best is not None and candidate.dropped <= best.dropped else "not so when written"


def _costly(report: ActivityReport, search: Search) -> str:
    """The terms that stay though they are small, least active first."""
    listed = _listed(report)
    rows = []
    for guilty in search.guilty[:COSTLY_SHOWN]:
        first, *others = sorted(listed(guilty.family.terms), key=lambda term: -term["rho"])
        more = f" and {len(others)} alike" if others else ""
        rows.append((first["junction"], f"{first['term']}{more}", _percent(first["rho"]), _percent(guilty.error)))
    left = len(search.guilty) - len(rows)
    head = "spared, since without them the error would be:"
    text = console.table(("junction", "term", "rho", "error"), rows, right=(2, 3))
    tail = [f"and {left} more (`--format json` lists them)"] if left else []
    if search.ended is not None:
        tail.append(f"above {_percent(search.ended)} nothing was tried any more")
    return "\n".join([head, text, *tail])


def _saved(accuracy: Comparison) -> str:
    one, other = accuracy.full, accuracy.reduced
    rows = [(p.name, str(p.states), str(p.equations), str(p.steps), f"{p.seconds:.3g}") for p in (one, other)]
    return console.table(("model", "states", "equations", "steps", "seconds"), rows, right=range(1, 5))


def _percent(share: float) -> str:
    """A share with four digits; what no measurement could tell from nothing is nothing."""
    return "0 %" if share < 1e-12 else f"{100 * share:.4g} %"


@app.command()
@grouped
def partition(
    file: arg.File,
    output: OutputFolder,
    run: RunGroup,
    threshold: Threshold = None,
    conditioned: Conditioned = False,
    model: arg.ModelName = None,
    guard: Guard = True,
    outputs: OfInterest = None,
    force: arg.Force = False,
    format: arg.OutputFormat = arg.Format.TEXT,
) -> int:
    """Take a model apart into driving and driven models; status 1 and the nearest misses where it holds together."""
    from bgdsl import reduce
    from bgdsl.cli.files import write

    if threshold is None:
        raise typer.BadParameter("say what may fall: --threshold 0.3%", param_hint="--threshold")
    eps = arg.fraction(threshold, "--threshold")
    found = measured(file, model, run)
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


Violation = Annotated[float, typer.Option("--violation", metavar="M", min=1e-15, help="Largest deflection of a parasitic spring, in m.")]
Twist = Annotated[float, typer.Option("--twist", metavar="RAD", min=1e-15, help="The same between rotations, in rad.")]
Share = Annotated[str, typer.Option("--activity", metavar="SHARE", help="Largest share of all activity for one kind of joint.")]
TunedFile = Annotated[Path, typer.Option("-o", "--output", metavar="OUT.bg", help="Where to write the model with the new values.")]


@app.command()
@grouped
def tune(
    file: arg.File,
    output: TunedFile,
    run: RunGroup,
    violation: Violation = 2.5e-5,
    twist: Twist = 1e-4,
    activity: Share = "0.1%",
    model: arg.ModelName = None,
    force: arg.Force = False,
    format: arg.OutputFormat = arg.Format.TEXT,
) -> int:
    """Find the softest parasitic springs and dampers that keep their limits; status 1 where none was found."""
    from bgdsl import pipeline, reduce, tuning
    from bgdsl.cli.files import write

    loaded = pipeline.load(file, model, search=run.folders)
    share = arg.fraction(activity, "--activity")
    with console.progress(f"tuning {loaded.name}") as progress:
        scenario = reduce.Scenario(run.experiment, run.changes, run.settings(window=run.span), progress)
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
