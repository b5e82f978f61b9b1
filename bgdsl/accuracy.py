"""What a reduction costs and saves: a reduced model beside the full one, output by output."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from bgdsl import pipeline
from bgdsl.diagnostics import Code, Reporter, did_you_mean, listed
from bgdsl.playback import Played, as_played, at, played
from bgdsl.reduce import Reduced
from bgdsl.reductions.compare import OutputComparison, Shaft, compare_output, errors
from bgdsl.simulate.options import BAD_SETTING
from bgdsl.source import Source, said

MOST_STEPS = 30
"""A reduced model that takes so many times the steps of the full one is not run to its end."""

ROUND_OFF = 1e-13

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
    for wanted in (*(outputs or ()), *([shaft] if shaft else ())):
        check_common(wanted, full, reduced)
    common = _common(full, reduced, outputs, window)
    shafts = None if shaft is None else _shafts(common, shaft, cycles, revolutions)
    rows = [
        compare_output(
            name, full.units.get(name, ""), common.time, one, other, harmonics=harmonics, shafts=shafts, least=common.round_off(name)
        )
        for name, one, other in common.signals()
        if name != shaft
    ]
    return Comparison(full, reduced, tuple(rows))


def worst_error(full: Played, reduced: Played, *, window: tuple[float, float] | None = None, shaft: str | None = None) -> float:
    """`compare(...).worst`, without the rest of the comparison."""
    common = _common(full, reduced, None, window)
    shafts = None if shaft is None else _shafts(common, shaft, 1, 1.0)
    found = (errors(common.time, one, other, shafts, common.round_off(name))[0] for name, one, other in common.signals() if name != shaft)
    return max(found, default=0.0)


@dataclass(frozen=True, eq=False)
class _Common:
    """What two runs have in common: the names of signals, the full run's times (n,) within the window."""

    full: Played
    reduced: Played
    names: tuple[str, ...]
    inside: Any
    time: Any
    largest: Mapping[str, float]
    """The largest value of the full run's signals of each unit."""

    def signals(self) -> Iterator[tuple[str, Any, Any]]:
        """Name, full and reduced values (n,)."""
        for name in self.names:
            yield name, self.full.signals[name][self.inside], at(self.time, self.reduced, name)

    def round_off(self, name: str) -> float:
        """Below this a signal is no signal: a share of the largest of its unit. A sum that is zero by the model's own equations is
        computed as some 1e-16 of its terms, and an error is no share of that."""
        return ROUND_OFF * self.largest[self.full.units.get(name, "")]


def _common(full: Played, reduced: Played, outputs: Sequence[str] | None, window: tuple[float, float] | None) -> _Common:
    """BG743 where there is nothing."""
    import numpy as np

    wanted = full.signals if outputs is None else _spread(full, outputs)
    names = tuple(name for name in full.signals if name in reduced.signals and name in wanted)
    start, stop = window or (full.time[0], full.time[-1])
    slack = 1e-9 * (full.time[-1] - full.time[0])
    if not full.time[0] - slack <= start < stop <= full.time[-1] + slack:
        why = f"it must lie within the run, {full.time[0]:g} to {full.time[-1]:g} s"
        Reporter().fail(BAD_SETTING, f"window {start:g},{stop:g} cannot be used: {why}", said(f"window {start:g},{stop:g}"))
    inside = (full.time >= start) & (full.time <= min(stop, reduced.time[-1]))
    time = full.time[inside]
    if not names or len(time) < 2:
        Reporter().fail(
            NOTHING_TO_COMPARE,
            f"`{full.name}` and `{reduced.name}` have no output in common over the window",
            said(reduced.name),
            notes=(f"the full model has {', '.join(list(full.signals)[:8])}", f"the reduced one {', '.join(list(reduced.signals)[:8])}"),
        )
    largest: dict[str, float] = {}
    for name, values in full.signals.items():
        unit = full.units.get(name, "")
        largest[unit] = max(largest.get(unit, 0.0), float(np.abs(values[inside]).max()))
    return _Common(full, reduced, names, inside, time, largest)


def _shafts(common: _Common, shaft: str, cycles: int, revolutions: float) -> tuple[Shaft, Shaft]:
    import numpy as np

    one, other = (np.interp(common.time, played.time, played.signals[shaft]) for played in (common.full, common.reduced))
    return Shaft(one, cycles, revolutions), Shaft(other, cycles, revolutions)


def check_common(wanted: str, full: Played, reduced: Played) -> None:
    """BG743 where an output that was named is not recorded in both runs."""
    for run in (full, reduced):
        if not _spread(run, (wanted,)):
            helps = did_you_mean(wanted, run.signals) or (f"it has {listed(run.signals)}",)
            Reporter().fail(NOTHING_TO_COMPARE, f"`{run.name}` has no output `{wanted}`", said(wanted), helps=helps)


def _spread(played: Played, outputs: Sequence[str]) -> set[str]:
    """The scalars recorded of the outputs named."""
    return {name for name in played.signals for wanted in outputs if name == wanted or name.startswith(f"{wanted}[")}


# -------------------------------------------------------------------------------------------------------------- accuracy


def measured_accuracy(reduced: Reduced, file: Path) -> Comparison | None:
    """The reduced model beside the full one along the run that it was made from: a threshold bounds no error by itself.

    Where the model has no outputs, by the states that both have; None where no such state is left. BgError where it cannot be run, or
    takes so many more steps that it is no reduction.
    """
    measured = reduced.measured
    small = pipeline.load_source(Source(file.name, reduced.source, file), measured.model.name)
    settings = {**(measured.scenario.settings or {}), "most_steps": MOST_STEPS * max(1, measured.run.statistics.steps)}
    again = replace(measured.scenario, parameters=None, settings=settings)  # changed parameters are the reduced model's defaults
    names = None if measured.model.program.outputs else [n for n in measured.run.trajectory.names if n in small.program.values]
    if names == []:
        return None
    run = played(file.name, small, again, names)
    return compare(as_played(measured.model.name, measured.model, measured.run), run, window=measured.report.window)
