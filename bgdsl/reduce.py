"""The order in which a model is measured and reduced; `pipeline.py` is the order in which it is compiled and run.

run with integrals -> activities -> decision -> rewritten source -> compiled again, and run for its accuracy
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bgdsl.diagnostics import Reporter
from bgdsl.ir.activity import ActivityReport, Integrands
from bgdsl.ir.rewrite import Rewrite
from bgdsl.passes.activity import activities, grounded, integrands
from bgdsl.pipeline import Model
from bgdsl.reductions.condition import Decision, decide
from bgdsl.reductions.rewrite_source import Provenance, rewrite
from bgdsl.version import VERSION

if TYPE_CHECKING:
    from bgdsl.simulate.result import Run


@dataclass(frozen=True, eq=False)
class Scenario:
    """How a model is run when it is measured: an experiment, changed parameters, settings of the run (`System.simulate`)."""

    experiment: str | None = None
    parameters: Mapping[str, Any] | None = None
    settings: Mapping[str, Any] | None = None
    progress: Callable[[float], None] | None = None


@dataclass(frozen=True, eq=False)
class Measured:
    """A model's activities along a run of it."""

    model: Model
    run: Run
    wanted: Integrands
    report: ActivityReport


def measure(model: Model, scenario: Scenario) -> Measured:
    """Run the model and integrate the power of every term. RunError, BG701 or BG702 where that does not work out."""
    from bgdsl.simulate.quadrature import Quadratures

    wanted = integrands(model.scalar)
    quadratures = Quadratures(grounded(wanted.expressions, model.program))
    run = model.compile().simulate(
        scenario.experiment, scenario.parameters, quadratures=quadratures, progress=scenario.progress, **(scenario.settings or {})
    )
    found = run.trajectory.integrals
    assert found is not None
    report = activities(
        model.scalar,
        wanted,
        found.values.tolist(),
        experiment=run.experiment or None,
        window=found.window,
        report=Reporter(),
        errors=found.errors.tolist(),
    )
    return Measured(model, run, wanted, report)


@dataclass(frozen=True, eq=False)
class Reduced:
    """A reduced model: `source` is its text; `report`, `decision` and `rewrite` tell what was measured, chosen and written."""

    source: str
    measured: Measured
    decision: Decision
    rewrite: Rewrite

    @property
    def report(self) -> ActivityReport:
        return self.measured.report


def provenance(measured: Measured, settings: Mapping[str, str], kind: str = "conditioned") -> Provenance:
    """What the annotation of a reduced file says."""
    source = measured.model.graph.sources[0]
    report = measured.report
    return Provenance(
        Path(source.name).name,
        source.digest,
        measured.model.name,
        report.experiment,
        report.window,
        f"bgdsl {VERSION}",
        kind=kind,
        settings=tuple(settings.items()),
    )


def condition(measured: Measured, threshold: float, *, guard: bool = True, folder: Path | None = None) -> Reduced:
    """Drop every term whose relative activity is below `threshold`, and write the model anew. `folder`: where the file will be."""
    model = measured.model
    decision = decide(model.scalar, measured.report, threshold, guard=guard)
    head = provenance(measured, {"threshold": repr(threshold)})
    written, decision = rewrite(model.library, model.scalar, measured.report, decision, head, folder=folder)
    return Reduced(written.text, measured, decision, written)
