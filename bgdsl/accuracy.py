"""What a reduction costs and saves: full against reduced, again under other conditions, and the smallest model that is good enough."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from bgdsl import pipeline
from bgdsl.diagnostics import BgError, Code, Reporter, did_you_mean, listed
from bgdsl.playback import Played, as_played, at, played
from bgdsl.reduce import Measured, Reduced, Scenario, condition, measure, partition
from bgdsl.reductions.compare import OutputComparison, Shaft, compare_output
from bgdsl.reductions.search import Candidate, Search, search
from bgdsl.reductions.verify import Reinstated, verify
from bgdsl.source import Source, Span
from bgdsl.syntax import ast
from bgdsl.syntax.parser import parse, read_source

NOT_REDUCED = Code("BG740", "a file was not written by a reduction")
FULL_CHANGED = Code("BG741", "the full model is not the one that was reduced")
NO_FULL = Code("BG742", "the full model of a reduced file is not found")
NOTHING_TO_COMPARE = Code("BG743", "two models have no output in common")

# --------------------------------------------------------------------------------------------------------------- compare


@dataclass(frozen=True, eq=False)
class Comparison:
    """A reduced model beside the full one."""

    full: Played
    reduced: Played
    outputs: tuple[OutputComparison, ...]

    @property
    def worst(self) -> float:
        """The largest normalised RMS error of an output."""
        return max((output.nrms for output in self.outputs), default=0.0)

    def as_dictionary(self) -> dict[str, Any]:
        return {**self.reduced.cost(), "nrms": self.worst, "outputs": [output.as_dictionary() for output in self.outputs]}


def compare(
    full: Played,
    reduced: Played,
    *,
    outputs: Sequence[str] | None = None,
    window: tuple[float, float] | None = None,
    harmonics: int = 3,
    shaft: str | None = None,
    cycles: int = 4,
    revolutions: float = 2.0,
) -> Comparison:
    """Output by output, over the window, at the full run's times. shaft: the name of an output that is a shaft's angle (rad).

    BgError (BG743) where an output named, or any at all, is not in both.
    """
    import numpy as np

    for wanted in (*(outputs or ()), *([shaft] if shaft else ())):
        _check_common(wanted, full, reduced)
    names = [name for name in full.signals if name in reduced.signals and (outputs is None or name in _spread(full, outputs))]
    start, stop = window or (full.time[0], full.time[-1])
    inside = (full.time >= start) & (full.time <= min(stop, reduced.time[-1]))
    time = full.time[inside]
    if not names or len(time) < 2:
        Reporter().fail(
            NOTHING_TO_COMPARE,
            f"`{full.name}` and `{reduced.name}` have no output in common over the window",
            _said(reduced.name),
            notes=(f"the full model has {', '.join(list(full.signals)[:8])}", f"the reduced one {', '.join(list(reduced.signals)[:8])}"),
        )
    shafts = None
    if shaft is not None:
        angles = [np.interp(time, played.time, played.signals[shaft]) for played in (full, reduced)]
        shafts = Shaft(angles[0], cycles, revolutions), Shaft(angles[1], cycles, revolutions)
    rows = [
        compare_output(
            name,
            full.units.get(name, ""),
            time,
            full.signals[name][inside],
            at(time, reduced, name),
            harmonics=harmonics,
            shafts=shafts,
        )
        for name in names
        if name != shaft
    ]
    return Comparison(full, reduced, tuple(rows))


def _said(text: str) -> Span:
    """A place in what the caller wrote."""
    return Span(Source("<command line>", text), 0, len(text))


def _check_common(wanted: str, full: Played, reduced: Played) -> None:
    """BG743 where an output that was named is not recorded in both runs."""
    for run in (full, reduced):
        if not _spread(run, (wanted,)):
            helps = did_you_mean(wanted, run.signals) or (f"it has {listed(run.signals)}",)
            Reporter().fail(NOTHING_TO_COMPARE, f"`{run.name}` has no output `{wanted}`", _said(wanted), helps=helps)


def _spread(played: Played, outputs: Sequence[str]) -> set[str]:
    """The scalars recorded of the outputs named."""
    return {name for name in played.signals for wanted in outputs if name == wanted or name.startswith(f"{wanted}[")}


# ---------------------------------------------------------------------------------------------------------------- verify


@dataclass(frozen=True, eq=False)
class Verification:
    """terms: those that would have to come back, largest first; measured: the full model now."""

    reduced: str
    full: str
    threshold: float
    then: str
    now: str
    terms: tuple[Reinstated, ...]

    def as_dictionary(self) -> dict[str, Any]:
        return {
            "reduced": self.reduced,
            "full": self.full,
            "threshold": self.threshold,
            "then": self.then,
            "now": self.now,
            "reinstate": [
                {"junction": t.junction, "term": t.name, "old_rho": t.old, "new_rho": t.new, "place": t.place} for t in self.terms
            ],
        }


@dataclass(frozen=True, slots=True)
class Provenance:
    """What the annotation of a reduced file says."""

    kind: str
    source: str
    digest: str
    experiment: str | None
    window: tuple[float, float] | None
    threshold: float
    parameters: Mapping[str, float]
    span: Span


def provenance_of(path: Path) -> Provenance:
    """The annotation of a reduced file. BgError (BG740) where it has none."""
    report = Reporter()
    source = read_source(path, report)
    report.stop_if_errors()
    for item in parse(source, report).items:
        for inner in item.items if isinstance(item, ast.Model) else ():
            if isinstance(inner, ast.Annotation) and (found := _provenance(inner)) is not None:
                return found
    where = Span(source, 0, min(1, len(source.text)))
    report.fail(
        NOT_REDUCED, f"`{path.name}` carries no annotation of a reduction", where, helps=("name a file that `bgc condition` wrote",)
    )


def _provenance(annotation: ast.Annotation) -> Provenance | None:
    for argument in annotation.arguments:
        if isinstance(argument, ast.Modifier) and argument.name.text in ("conditioned", "partition"):
            said = {m.name.text: m.value for m in argument.nested if isinstance(m, ast.Modifier)}
            source, digest, experiment, window = (said.get(key) for key in ("source", "sha256", "experiment", "window"))
            threshold = said.get("threshold")
            times = [n.value for n in window.items if isinstance(n, ast.Number)] if isinstance(window, ast.Array) else []
            if isinstance(source, ast.String) and isinstance(digest, ast.String) and isinstance(threshold, ast.Number):
                return Provenance(
                    argument.name.text,
                    source.value,
                    digest.value,
                    experiment.value if isinstance(experiment, ast.String) else None,
                    (times[0], times[1]) if len(times) == 2 else None,
                    threshold.value,
                    _changes(said.get("parameters")),
                    annotation.span,
                )
    return None


def _changes(said: ast.Expression | None) -> dict[str, float]:
    """`"mA = 90, s = 0.9"` as a mapping."""
    pairs = (part.split(" = ") for part in said.value.split(", ")) if isinstance(said, ast.String) else ()
    return {name: float(value) for name, value in pairs}


def full_model_of(path: Path, origin: Provenance, full: Path | None) -> Path:
    """Where the full model is: as said, else a file of that name beside the reduced one or in a folder above. BG742 if nowhere,
    BG741 if its text is not the one that was reduced."""
    folders = [path.resolve().parent, *path.resolve().parent.parents]
    found = full or next((folder / origin.source for folder in folders if (folder / origin.source).is_file()), None)
    report = Reporter()
    if found is None:
        report.fail(
            NO_FULL,
            f"`{origin.source}`, from which this file was made, is neither beside it nor in a folder above",
            origin.span,
            helps=("say where it is: `--full FILE`",),
        )
    source = read_source(found, report)
    report.stop_if_errors()
    if source.digest != origin.digest:
        report.fail(
            FULL_CHANGED,
            f"`{found.name}` has changed since this file was made from it",
            origin.span,
            helps=("reduce it anew with `bgc condition`",),
        )
    return found


def verify_reduced(path: Path, scenario: Scenario, *, full: Path | None = None, search_in: Sequence[Path] = ()) -> Verification:
    """Run the full model again in another scenario and tell which dropped terms matter there.

    A scenario that names no experiment is that of the reduction, with its changes.
    """
    origin = provenance_of(path)
    scenario = replace(scenario, experiment=scenario.experiment or origin.experiment)
    source = full_model_of(path, origin, full)
    model = pipeline.load(source, search=search_in)
    settings = {"window": origin.window} if origin.window else {}
    then = measure(model, Scenario(origin.experiment, origin.parameters, settings, scenario.progress))
    now = measure(model, replace(scenario, parameters={**origin.parameters, **(scenario.parameters or {})}))
    if origin.kind == "partition":
        decision = partition(then, origin.threshold).found.decision
    else:
        decision = condition(then, origin.threshold, folder=path.parent).decision
    terms = verify(decision, then.report, now.report)
    told = ", ".join([scenario.experiment or "the model as it is", *(f"{k}={v}" for k, v in (scenario.parameters or {}).items())])
    return Verification(path.name, source.name, origin.threshold, origin.experiment or "the model as it is", told, terms)


# -------------------------------------------------------------------------------------------------------------- accuracy


def measured_accuracy(reduced: Reduced, file: Path) -> Comparison | None:
    """The reduced model beside the full one along the run that it was made from: a threshold bounds no error by itself.

    Where the model has no outputs, by the states that both have; None where no such state is left.
    """
    measured = reduced.measured
    small = pipeline.load_source(Source(file.name, reduced.source, file), measured.model.name)
    again = replace(measured.scenario, parameters=None)  # changed parameters are the reduced model's defaults
    names = None if measured.model.program.outputs else [n for n in measured.run.trajectory.names if n in small.program.values]
    if names == []:
        return None
    run = played(file.name, small, again, names)
    return compare(as_played(measured.model.name, measured.model, measured.run), run, window=measured.report.window)


# ---------------------------------------------------------------------------------------------------------------- search


@dataclass(frozen=True, eq=False)
class Searched:
    """The smallest model within the error, None where no reduction is; and every model tried, from full to smallest."""

    reduced: Reduced | None
    search: Search
    full: Played


def smallest(
    measured: Measured,
    allowed: float,
    *,
    guard: bool = True,
    outputs: Sequence[str] | None = None,
    folder: Path | None = None,
    file: str = "reduced.bg",
    shaft: str | None = None,
) -> Searched:
    """Search for the smallest conditioned model whose outputs of interest have normalised RMS errors of at most `allowed`. shaft: a
    variable that is a shaft's angle; errors are then taken at equal angles."""
    model, scenario = measured.model, measured.scenario
    if outputs is not None and shaft is not None:
        outputs = (*outputs, shaft)
    full = played(model.name, model, scenario, outputs)
    if shaft is not None:
        _check_common(shaft, full, full)
    made: dict[float, Reduced] = {}
    scenario = replace(scenario, parameters=None)  # changed parameters are the reduced model's defaults

    def attempt(threshold: float) -> Candidate:
        reduced = condition(measured, threshold, guard=guard, folder=folder)
        made[threshold] = reduced
        dropped = len(reduced.decision.dropped)
        try:
            small = pipeline.load_source(Source(file, reduced.source, (folder or Path()) / file), model.name)
            run = played(file, small, scenario, outputs)
            comparison = compare(full, run, window=measured.report.window, shaft=shaft)
        except BgError:
            return Candidate(threshold, dropped, 0, math.inf, math.inf)
        return Candidate(threshold, dropped, run.states, comparison.worst, run.seconds)

    found = search(measured.report, allowed, attempt)
    best = made[found.best.threshold] if found.best is not None else None
    return Searched(best, found, full)
