"""Does a reduced file still hold under other conditions? The full model is measured again, and its dropped terms are looked at."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from bgdsl import pipeline
from bgdsl.accuracy import compare
from bgdsl.diagnostics import Code, Reporter
from bgdsl.ir.activity import TermActivity
from bgdsl.playback import played
from bgdsl.reduce import Measured, Scenario, decision_for, measure, partition, reduced
from bgdsl.reductions.condition import Decision
from bgdsl.reductions.provenance import Reduction, reductions_said
from bgdsl.reductions.verify import Reinstated, verify
from bgdsl.source import Span
from bgdsl.syntax import ast
from bgdsl.syntax.parser import parse, read_source

NOT_REDUCED = Code("BG740", "a file was not written by a reduction")
FULL_CHANGED = Code("BG741", "the full model is not the one that was reduced")
NO_FULL = Code("BG742", "the full model of a reduced file is not found")


@dataclass(frozen=True, eq=False)
class Verification:
    """terms: those that would have to come back, largest first. keep: of element elimination, the share of activity that was kept;
    of a model found by the error that it makes, max_error: what was allowed, error: what it makes now; else None."""

    reduced: str
    full: str
    threshold: float
    then: str
    now: str
    terms: tuple[Reinstated, ...]
    keep: float | None = None
    max_error: float | None = None
    error: float | None = None

    @property
    def holds(self) -> bool:
        """Is the reduced model as good as it was meant to be?"""
        if self.error is None or self.max_error is None:
            return not self.terms
        return self.error <= self.max_error

    def as_dictionary(self) -> dict[str, Any]:
        measured = {} if self.error is None else {"max_error": self.max_error, "error": self.error}
        return {
            "reduced": self.reduced,
            "full": self.full,
            "threshold": self.threshold,
            **measured,
            "holds": self.holds,
            "then": self.then,
            "now": self.now,
            "reinstate": [
                {"junction": t.junction, "term": t.name, "old_rho": t.old, "new_rho": t.new, "place": t.place} for t in self.terms
            ],
        }


def reduction_of(path: Path) -> Reduction:
    """The annotation of a reduced file. BgError (BG740) where it has none."""
    report = Reporter()
    source = read_source(path, report)
    report.stop_if_errors()
    for item in parse(source, report).items:
        for found in reductions_said(item) if isinstance(item, ast.Model) else ():
            return found
    where = Span(source, 0, min(1, len(source.text)))
    report.fail(
        NOT_REDUCED, f"`{path.name}` carries no annotation of a reduction", where, helps=("name a file that `bgc condition` wrote",)
    )


def full_model_of(path: Path, origin: Reduction, full: Path | None) -> Path:
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

    A scenario that names no experiment is that of the reduction, with its changes. A term of a threshold matters if it is not below
    it; one of an eliminated element if that would stay. A model that was found by its error is run too, and holds if its error is
    still within what was allowed; if not, the terms that may be to blame are those whose activity has risen.
    """
    origin = reduction_of(path)
    scenario = replace(scenario, experiment=scenario.experiment or origin.experiment)
    source = full_model_of(path, origin, full)
    model = pipeline.load(source, search=search_in)
    settings = {"window": origin.window} if origin.window else {}
    then = measure(model, Scenario(origin.experiment, origin.parameters, settings, scenario.progress))
    changed = scenario.parameters or {}
    now = measure(model, replace(scenario, parameters={**origin.parameters, **changed}))
    decision = _dropped(origin, then, path.parent)
    terms = verify(decision.dropped, then.report, now.report, _matters(origin, then, now))
    told = ", ".join([scenario.experiment or "the model as it is", *(f"{k}={v}" for k, v in changed.items())])
    before = origin.experiment or "the model as it is"
    found = Verification(path.name, source.name, origin.choice.threshold, before, told, terms, origin.choice.keep)
    allowed = origin.choice.max_error
    if allowed is None:
        return found
    error = _error(path, origin, now, changed, search_in)
    return replace(found, max_error=allowed, error=error, terms=terms if error > allowed else ())


def _dropped(origin: Reduction, then: Measured, folder: Path) -> Decision:
    """What the file was written from, decided again."""
    choice = origin.choice
    if origin.kind == "partition":
        return partition(then, choice.threshold, guard=choice.guard, conditioned=choice.inside).found.decision
    return reduced(then, choice, folder=folder).decision


def _matters(origin: Reduction, then: Measured, now: Measured) -> Callable[[TermActivity, TermActivity], bool]:
    """Whether a dropped term, as it was and as it is, would have to come back."""
    choice = origin.choice
    if choice.keep is not None:
        still = decision_for(now, choice).dropped
        return lambda old, new: new.index not in still
    if choice.max_error is not None:
        records = then.report.by_index()
        harmless = min((records[t].rho for t in choice.spared if t in records), default=choice.threshold)
        return lambda old, new: new.rho >= max(harmless, 2 * old.rho)
    return lambda old, new: new.rho >= choice.threshold


def _error(path: Path, origin: Reduction, now: Measured, changed: Any, search_in: Sequence[Path]) -> float:
    """The error that the reduced model makes now, measured as it was when it was sought."""
    choice, scenario = origin.choice, now.scenario
    names = None if choice.outputs is None else (*choice.outputs, *((choice.shaft,) if choice.shaft else ()))
    whole = played(now.model.name, now.model, scenario, names)
    small = pipeline.load(path, search=search_in)
    again = played(path.name, small, replace(scenario, parameters=changed), names)  # the origin's changes are its defaults
    return compare(whole, again, window=now.report.window, shaft=choice.shaft).worst
