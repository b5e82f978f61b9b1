"""The library as people use it from Python: models that can be compiled, measured and reduced; runs that know their activities.

model = bgdsl.load("models/lever.bg", model="Lever")
system = model.compile()
run = system.simulate(experiment="kick", mA=12.0)
run["vA.f"], run.time, run.activity()
reduced = model.condition(threshold=0.003, experiment="kick")
reduced.source, reduced.report
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bgdsl import pipeline
from bgdsl.pipeline import Value, settings_of
from bgdsl.simulate.result import Run as PlainRun

if TYPE_CHECKING:
    from bgdsl.ir.activity import ActivityReport
    from bgdsl.reduce import Partitioned, Reduced, Scenario


def load(
    path: str | Path, model: str | None = None, *, search: Sequence[str | Path] = (), overrides: Mapping[str, Value] | None = None
) -> Model:
    """Read, flatten and check a model of a file; arguments and errors as in `pipeline.load`."""
    return _wrapped(pipeline.load(path, model, search=search, overrides=overrides))


def loads(
    text: str,
    model: str | None = None,
    *,
    name: str = "<text>",
    search: Sequence[str | Path] = (),
    overrides: Mapping[str, Value] | None = None,
) -> Model:
    """As `load`, from text; imports are looked for in the working folder and in `search`."""
    return _wrapped(pipeline.loads(text, model, name=name, search=search, overrides=overrides))


def _wrapped(model: pipeline.Model) -> Model:
    return Model(model.library, model.graph, model.overrides, model.report)


def _scenario(experiment: str | None, parameters: Mapping[str, Any] | None, more: Mapping[str, Any]) -> Scenario:
    from bgdsl.reduce import Scenario

    settings, changes = settings_of(more, parameters)
    given = {name: value for name, value in more.items() if name not in changes}
    assert settings is not None
    return Scenario(experiment, changes, given)


@dataclass(frozen=True, eq=False)
class Model(pipeline.Model):
    """A checked model. Keywords that are no settings of a run (`stop`, `interval`, `tolerance`, `method`, `window`, ...) are parameters."""

    def compile(self) -> System:
        return System(self)

    def changed(self, overrides: Mapping[str, Value], experiment: str | None = None) -> Model:
        return _wrapped(super().changed(overrides, experiment))

    def activity(self, experiment: str | None = None, parameters: Mapping[str, Any] | None = None, **more: Any) -> ActivityReport:
        """Every term's activity along a run."""
        from bgdsl import reduce

        return reduce.measure(self, _scenario(experiment, parameters, more)).report

    def condition(
        self,
        threshold: float | None = None,
        *,
        max_error: float | None = None,
        experiment: str | None = None,
        parameters: Mapping[str, Any] | None = None,
        guard: bool = True,
        outputs: Sequence[str] | None = None,
        shaft: str | None = None,
        folder: str | Path | None = None,
        **more: Any,
    ) -> Reduced:
        """The model without terms below `threshold`, or the smallest whose `outputs` err by no more than `max_error` (at equal angles
        of `shaft`, if one is named).

        Both are fractions of one, a threshold up to 1. ValueError unless exactly one of the two is given, or where no reduction stays
        within the error.
        """
        from bgdsl import reduce
        from bgdsl.searching import smallest

        if (threshold is None) == (max_error is None):
            raise ValueError("give either threshold or max_error")
        _check_fraction(threshold)
        measured = reduce.measure(self, _scenario(experiment, parameters, more))
        place = None if folder is None else Path(folder)
        if threshold is not None:
            return reduce.condition(measured, threshold, guard=guard, folder=place)
        assert max_error is not None
        found = smallest(measured, max_error, guard=guard, outputs=outputs, folder=place, shaft=shaft).reduced
        if found is None:
            raise ValueError(f"no reduction stays within {100 * max_error:g} %")
        return found

    def partition(
        self,
        threshold: float,
        *,
        conditioned: bool = False,
        experiment: str | None = None,
        parameters: Mapping[str, Any] | None = None,
        guard: bool = True,
        stem: str | None = None,
        **more: Any,
    ) -> Partitioned:
        """The model taken apart at a threshold, a fraction up to 1; `.files` is empty where it holds together. ValueError for another."""
        from bgdsl import reduce

        _check_fraction(threshold)
        measured = reduce.measure(self, _scenario(experiment, parameters, more))
        return reduce.partition(measured, threshold, conditioned=conditioned, guard=guard, stem=stem or self.name.lower())


def _check_fraction(threshold: float | None) -> None:
    if threshold is not None and not 0 <= threshold <= 1:
        raise ValueError(f"a threshold is a fraction between 0 and 1, such as 0.003, not {threshold}")


class System(pipeline.System):
    """A compiled model."""

    def simulate(self, experiment: str | None = None, parameters: Mapping[str, Any] | None = None, **more: Any) -> Run:
        """Run it; arguments as in `pipeline.System.simulate`."""
        run = super().simulate(experiment, parameters, **more)
        hidden = ("output", "force", "quadratures", "progress", "say")
        scenario = _scenario(experiment, parameters, {name: value for name, value in more.items() if name not in hidden})
        return Run(run, self.model, scenario)


class Run(PlainRun):
    """A run: `run["vA.f"]`, `run.time`, `run.statistics`, `run.to_xarray()`, `run.save(path)`, `run.activity()`."""

    def __init__(self, run: PlainRun, model: pipeline.Model, scenario: Scenario):
        super().__init__(run.trajectory, run._model, run._regimes, run.path)
        self._source, self._scenario = model, scenario

    @cached_property
    def _activity(self) -> ActivityReport:
        from bgdsl import reduce

        return reduce.measure(self._source, self._scenario).report

    def activity(self) -> ActivityReport:
        """Every term's activity; integrated along the same run, made once more with the integrals."""
        return self._activity
