"""The smallest reduced model that is as accurate as wanted, measured run by run.

The full model is compiled once with a weight on every term that may fall (`passes/weights.py`), so that trying a set of terms costs
a run. A set that takes a junction's determiner away is another structure: it is written and compiled to be tried. What is found is
written, and its accuracy is measured on what was written.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from bgdsl import pipeline
from bgdsl.accuracy import Comparison, check_common, compare, worst_error
from bgdsl.diagnostics import BgError, Reporter, RunError
from bgdsl.passes.weights import WEIGHTS, weights_in
from bgdsl.playback import Played, as_played, played
from bgdsl.reduce import Measured, Reduced, Scenario, reduced, reduced_already, written
from bgdsl.reductions.condition import Decision, considered, settle
from bgdsl.reductions.determined import Structure, gone_elements, reinstate
from bgdsl.reductions.provenance import Choice
from bgdsl.reductions.search import Candidate, Search, families, smallest_within, spared
from bgdsl.source import Source

LOOSER = (1e3, 1e2, 1e1)
"""Factors of the tolerance at which sets are tried: the first one that changes the full model little enough."""

LOOSEST = 1e-4
NOISE = 0.05
"""What a looser tolerance may change, as a share of the error allowed."""

MOST_STEPS = 4
"""A trial that takes so many times the steps of the full model is given up."""


@dataclass(frozen=True, eq=False)
class Searched:
    """reduced: the smallest model within the error, None where no reduction is; accuracy: of it, measured on what was written.
    search: every model tried; full: the full model's run. choice: how the terms of the model written were chosen."""

    reduced: Reduced | None
    accuracy: Comparison | None
    search: Search
    full: Played
    choice: Choice | None = None


def smallest(
    measured: Measured,
    allowed: float,
    *,
    guard: bool = True,
    outputs: Sequence[str] | None = None,
    folder: Path | None = None,
    file: str = "reduced.bg",
    shaft: str | None = None,
    most: float = math.inf,
    progress: Callable[[float], None] | None = None,
) -> Searched:
    """Search for the smallest conditioned model whose outputs of interest have normalised RMS errors of at most `allowed`. shaft: a
    variable that is a shaft's angle; errors are then taken at equal angles. most: how many models may be tried (about)."""
    named = None if outputs is None else tuple(name.replace(" ", "") for name in outputs)
    asked = Choice(0.0, guard, max_error=allowed, outputs=named, shaft=shaft)
    if reduced_already(measured, asked):
        run = as_played(measured.model.name, measured.model, measured.run)
        return Searched(reduced(measured, asked, folder=folder), None, Search(None, ()), run)
    trials = _Trials(measured, asked, (folder or Path()) / file)
    quick = {t: level for t, level in trials.levels.items() if t in trials.weighed}
    slow = {t: level for t, level in trials.levels.items() if t not in trials.weighed}
    like, others = (families(measured.model.scalar, levels) for levels in (quick, slow))
    found = smallest_within(quick, like, allowed, trials.attempt, slow=others, most=most, progress=progress)
    best = Searched(None, None, replace(found, best=None), trials.full)
    for candidate in sorted(found.tried, key=lambda c: (-c.dropped, c.error)):
        if candidate.dropped <= (len(best.reduced.decision.dropped) if best.reduced is not None else 0):
            break
        if candidate.error <= allowed:
            choice = trials.choice(candidate)
            made = reduced(measured, choice, folder=folder)
            accuracy = trials.accuracy(made)
            more = best.reduced is None or len(made.decision.dropped) > len(best.reduced.decision.dropped)
            if more and accuracy is not None and accuracy.worst <= allowed:
                best = Searched(made, accuracy, replace(found, best=candidate), trials.full, choice)
    return best


class _Trials:
    """Sets of terms, tried. levels: of every term that may fall; weighed: those that have weights; full: the full model's run, at
    its own tolerance."""

    def __init__(self, measured: Measured, asked: Choice, file: Path):
        model, scenario = measured.model, measured.scenario
        self._measured, self._asked, self._file = measured, asked, file
        terms = considered(model.scalar, measured.report, guard=asked.guard)
        self.levels = {term.index: term.level for term in terms if term.reason is None and term.level < 1.0}
        self._structure = Structure(model.scalar)
        self._known: dict[frozenset[int], Candidate] = {}
        self._names = None if asked.outputs is None else (*asked.outputs, *([asked.shaft] if asked.shaft else []))
        self.full = played(model.name, model, replace(scenario, progress=None), self._names)
        if asked.shaft is not None:
            check_common(asked.shaft, self.full, self.full)
        self._weighed = replace(model, weighed=frozenset(self.levels), report=Reporter())
        self._order = weights_in(self._weighed.causal.scalar)
        self.weighed = frozenset(self._order)
        self._settings = self._trial_settings()

    def _trial_settings(self) -> dict[str, Any]:
        """Those of the run, at a tolerance as loose as the error allowed lets it be, and with an end to hopeless trials."""
        scenario = self._measured.scenario
        given = {name: value for name, value in (scenario.settings or {}).items() if name != "tolerance"}
        options = self._measured.options()
        for factor in LOOSER:
            loose = {**given, "rtol": options.rtol * factor, "atol": options.atol * factor}
            if max(loose["rtol"], loose["atol"]) <= LOOSEST:
                run = self._run(frozenset(), loose)
                if self._error(run) <= NOISE * (self._asked.max_error or 0.0):
                    return {**loose, "most_steps": MOST_STEPS * run.steps}
        return {**given, "rtol": options.rtol, "atol": options.atol, "most_steps": MOST_STEPS * self.full.steps}

    # ------------------------------------------------------------------------------------------------------------ choosing

    def choice(self, candidate: Candidate) -> Choice:
        """How a candidate's terms were chosen."""
        left = spared(self.levels, candidate.threshold, candidate.terms)
        return replace(self._asked, threshold=candidate.threshold, spared=left)

    def attempt(self, threshold: float, terms: frozenset[int]) -> Candidate:
        """The model without these terms, which lie below a threshold."""
        scalar = self._measured.model.scalar
        decision = settle(scalar, Decision(threshold, terms, (), frozenset(), ()))
        decision = reinstate(scalar, self._measured.report, decision, self._structure)
        if decision.dropped not in self._known:
            self._known[decision.dropped] = self._tried(decision)
        candidate = self._known[decision.dropped]
        return replace(candidate, threshold=threshold, spared=len(spared(self.levels, threshold, candidate.terms)))

    # -------------------------------------------------------------------------------------------------------------- trying

    def _tried(self, decision: Decision) -> Candidate:
        """A decision run: by weights where these can say it, else, or if that cannot start, as it would be written."""
        ways = [self._by_weights, self._as_written] if self._can_be_weighed(decision) else [self._as_written]
        for way in ways:
            try:
                run, dropped = way(decision)
            except BgError as problem:
                if isinstance(problem, RunError) and problem.time > self.full.time[0]:
                    break  # it comes to grief in whatever form
                continue
            error = self._error(run)
            return Candidate(decision.threshold, dropped, run.states, error if error >= 0.0 else math.inf, run.seconds)
        return Candidate(decision.threshold, decision.dropped, 0, math.inf, 0.0)

    def _can_be_weighed(self, decision: Decision) -> bool:
        """Has every dropped term a weight, or a junction of which nothing is left?"""
        scalar = self._measured.model.scalar
        loose = (t for t in decision.dropped if t not in self.weighed)
        return all(decision.dropped.issuperset(scalar.terms_at[scalar.terms[t].junction]) for t in loose)

    def _by_weights(self, decision: Decision) -> tuple[Played, frozenset[int]]:
        run = self._run(decision.dropped, self._settings)
        gone = gone_elements(self._measured.model.scalar, decision)
        states = sum(len(element.states) for element in self._measured.model.graph.elements if element.name in gone)
        return replace(run, states=run.states - states), decision.dropped

    def _run(self, dropped: frozenset[int], settings: dict[str, Any]) -> Played:
        """The weighed model without these terms."""
        scenario = self._measured.scenario
        weights = tuple(0.0 if t in dropped else 1.0 for t in self._order)
        parameters = {**(scenario.parameters or {}), **({WEIGHTS: weights} if weights else {})}
        names = self._names if self._names is not None else tuple(self.full.signals)
        return played(self._file.name, self._weighed, Scenario(scenario.experiment, parameters, settings), names)

    def _as_written(self, decision: Decision) -> tuple[Played, frozenset[int]]:
        """The run, and the terms that fell: some may have had to be taken back."""
        made = written(self._measured, decision, folder=self._file.parent)
        return self._of_text(made.source, self._settings), made.decision.dropped

    def _of_text(self, text: str, settings: dict[str, Any] | None) -> Played:
        model = pipeline.load_source(Source(self._file.name, text, self._file), self._measured.model.name)
        names = self._names
        if names is None:  # the outputs, or of a model without any the states that are left
            names = tuple(name for name in self.full.signals if name in model.program.values)
        # changed parameters are the reduced model's defaults
        return played(self._file.name, model, Scenario(self._measured.scenario.experiment, None, settings), names)

    def _error(self, run: Played) -> float:
        return worst_error(self.full, run, window=self._measured.report.window, shaft=self._asked.shaft)

    def accuracy(self, made: Reduced) -> Comparison | None:
        """A written model beside the full one, at the full one's tolerance; None where it cannot be run."""
        try:
            run = self._of_text(made.source, dict(self._measured.scenario.settings or {}))
            return compare(self.full, run, window=self._measured.report.window, shaft=self._asked.shaft)
        except BgError:
            return None
