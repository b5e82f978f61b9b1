"""Parasitic elements of a model made as soft as their limits allow, measured run by run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from bgdsl.diagnostics import Code, Reporter
from bgdsl.expr import unary, var
from bgdsl.pipeline import Model
from bgdsl.reduce import Scenario, measure, tidy
from bgdsl.reductions.parasitics import Observed, Tuning, groups, heir_text, tune
from bgdsl.source import Span
from bgdsl.version import VERSION

NO_PARASITICS = Code("BG744", "a model has no parasitic springs to tune")


@dataclass(frozen=True, eq=False)
class TunedModel:
    """source: the text of a model that inherits the given one with the new values."""

    source: str
    tuning: Tuning


def tune_parasitics(
    model: Model, scenario: Scenario, *, violation: float = 2.5e-5, twist: float = 1e-4, activity: float = 1e-3, runs: int = 10
) -> TunedModel:
    """Find the most compliant parasitic stiffness and damping.

    violation: largest deflection allowed of a parasitic spring (m); twist: of one between rotations (rad); activity: the largest
    share of all elements' activity that the parasitic elements of one declaration may have. BG744 where there is nothing to tune.
    """
    found = groups(model.graph)
    if not any(group.kind == "C" for group in found):
        source = model.graph.sources[0]
        Reporter().fail(
            NO_PARASITICS,
            f"model `{model.name}` has no parasitic C with a stiffness `k` that reads a parameter",
            Span(source, 0, 1),
            helps=("mark the springs that only keep the equations explicit: `C spring(k = K, parasitic = true)`",),
        )
    turning = {e.name for e in model.graph.elements if any(port.domain == "Rotational" for port in e.ports)}
    system = model.compile()
    start = system.parameters

    def limit(state: str) -> float:
        return twist if state.rpartition(".")[0] in turning else violation

    def observe(values: Mapping[str, float]) -> Observed:
        there = replace(scenario, parameters={**(scenario.parameters or {}), **values})
        return Observed(_deflections(model, there), _shares(model, there))

    tuning = tune(found, start, observe, limit, activity, runs=runs)
    module = model.library.main.source.path
    stem = module.stem if module is not None else model.name.lower()
    note = (
        f"// Parasitic values of {model.name}, as soft as a violation of {violation:g} m, {twist:g} rad and an activity of"
        f" {100 * activity:g} % allow (bgdsl {VERSION})"
    )
    return TunedModel(tidy(heir_text(model.name, stem, model.graph, tuning.values, note)), tuning)


def _deflections(model: Model, scenario: Scenario) -> dict[str, float]:
    from bgdsl.simulate.quadrature import Quadratures

    states = [state for e in model.graph.elements if e.parasitic and e.kind == "C" for state in e.states]
    settings: dict[str, Any] = dict(scenario.settings or {})
    run = model.compile().simulate(
        scenario.experiment,
        scenario.parameters,
        quadratures=Quadratures(tuple(unary("abs", var(state)) for state in states)),
        progress=scenario.progress,
        **settings,
    )
    assert run.trajectory.integrals is not None
    return dict(zip(states, run.trajectory.integrals.largest.tolist(), strict=True))


def _shares(model: Model, scenario: Scenario) -> dict[str, float]:
    """The activity index of each parasitic element: its share of the activity of all elements. (At its own junction a joint's
    spring meets only its damper, and a joint at rest passes no power on: there is nothing local to compare with.)"""
    parasitic = {e.name for e in model.graph.elements if e.parasitic}
    return {e.name: e.index for e in measure(model, scenario).report.elements if e.name in parasitic}
