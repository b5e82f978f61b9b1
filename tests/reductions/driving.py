"""The order in which the reductions' parts work, for the tests: run, measure, decide, write, load again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from bgdsl import pipeline
from bgdsl.diagnostics import Reporter
from bgdsl.ir.activity import ActivityReport
from bgdsl.ir.rewrite import Rewrite
from bgdsl.passes.activity import activities, grounded, integrands
from bgdsl.reductions.condition import Decision, decide
from bgdsl.reductions.determined import reinstate
from bgdsl.reductions.rewrite_source import Provenance, rewrite
from bgdsl.simulate.direct import DirectModel
from bgdsl.simulate.options import Settings
from bgdsl.simulate.quadrature import Quadratures
from bgdsl.simulate.run import simulate

MODELS = Path(__file__).parents[2] / "models"


def measure(model: pipeline.Model, experiment: str | None = None, **more: Any) -> ActivityReport:
    """The activities of every term along a run."""
    wanted = integrands(model.scalar)
    options = model.compile().options(experiment, more.pop("changes", {}), Settings(method="rk45", **more))
    run = simulate(DirectModel(model.program), options, quadratures=Quadratures(grounded(wanted.expressions, model.program)))
    found = run.trajectory.integrals
    assert found is not None
    return activities(
        model.scalar, wanted, found.values, experiment=experiment, window=found.window, report=Reporter(), errors=found.errors
    )


def provenance(model: pipeline.Model, report: ActivityReport, threshold: float) -> Provenance:
    source = model.graph.sources[0]
    name = Path(source.name).name
    settings = (("threshold", repr(threshold)),)
    return Provenance(name, source.digest, model.name, report.experiment, report.window, "bgdsl 0.1.0", settings=settings)


def condition(model: pipeline.Model, report: ActivityReport, threshold: float, **more: Any) -> tuple[Rewrite, Decision]:
    decision = reinstate(model.scalar, report, decide(model.scalar, report, threshold, **more))
    return rewrite(model.library, model.scalar, report, decision, provenance(model, report, threshold))
