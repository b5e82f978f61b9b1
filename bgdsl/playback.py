"""Models and partitioned models as they run: each partition on the recorded signals of those that drive it.

Partitions run one after the other, or at the same time, each in a process of its own: then the run is cut into slices, and a driven
partition works on one slice while its drivers are on the next.
"""

from __future__ import annotations

import json
import math
import multiprocessing
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bgdsl import pipeline
from bgdsl.diagnostics import BgError, Code, Diagnostic, Reporter
from bgdsl.pipeline import Model
from bgdsl.reduce import Scenario
from bgdsl.source import said

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

    import numpy as np
    from numpy.typing import NDArray

    from bgdsl.simulate.result import Run

    Floats = NDArray[np.float64]

NO_PARTITIONS = Code("BG745", "a folder holds no partitions")

PLAYBACK_POINTS = 20_000
"""A driving run is recorded at no fewer points than this, so that interpolating between them adds less than the integrator's error."""

START, GROWTH = 5e-6, 0.02
"""The first points of a driving run's record are so far apart (in shares of the run), and from there on farther by so much of the time
that has passed: a run that does not begin at rest begins with its quickest modes, and an impulse that is missed there rings on in the
driven part."""

STEPS = 4.0
"""A driven run's steps are at most so many times as long as its drivers' were on average: what moves the driven part is no quicker
than what it took to compute it."""

SLICES = 16
"""How finely a run is cut where partitions run at the same time: each cut restarts the integrators."""

OVERLAP = 100
"""Points of the slice before that a driven partition's splines see, so that they bend at a cut as they would without it."""


@dataclass(frozen=True, eq=False)
class Played:
    """A model as it was run: its signals by name, its size and its cost (s, right-hand side calls, steps)."""

    name: str
    time: Any
    signals: Mapping[str, Any]
    units: Mapping[str, str]
    states: int
    equations: int
    seconds: float
    rhs_calls: int
    steps: int

    def cost(self) -> dict[str, Any]:
        return {
            "model": self.name,
            "states": self.states,
            "equations": self.equations,
            "seconds": self.seconds,
            "rhs_calls": self.rhs_calls,
            "steps": self.steps,
        }


def play(path: Path, scenario: Scenario, *, model: str | None = None, search_in: Sequence[Path] = (), together: bool = False) -> Played:
    """Run a `.bg` file, or the partitions of a folder: one after the other, or (`together`) each in a process of its own."""
    if not path.is_dir():
        return played(path.name, pipeline.load(path, model, search=search_in), scenario)
    parts = _together(path, scenario, search_in) if together else _in_turn(path, scenario, search_in)
    return _joined(path.name, parts, together)


def played(name: str, model: Model, scenario: Scenario, wanted: Sequence[str] | None = None) -> Played:
    """Run one model and keep its outputs (its states where it has none)."""
    settings = dict(scenario.settings or {})
    if wanted is not None:
        settings["vars"] = wanted
    system = model.compile()
    run = system.simulate(scenario.experiment, scenario.parameters, progress=scenario.progress, **settings)
    return as_played(name, model, run)


def as_played(name: str, model: Model, run: Run) -> Played:
    """A run that is there already."""
    trajectory, sizes = run.trajectory, model.sizes()
    signals = dict(zip(trajectory.names, trajectory.values.T, strict=True))
    units = dict(zip(trajectory.names, trajectory.units, strict=True))
    cost = run.statistics
    return Played(name, run.time, signals, units, sizes["states"], sizes["equations"], cost.wall_time, cost.rhs_calls, cost.steps)


def _joined(name: str, parts: Sequence[Played], together: bool) -> Played:
    """The parts' outputs at the times of the finest record, their sizes and costs added up (at the same time: the longest)."""
    finest = max(parts, key=lambda part: len(part.time))
    signals = {signal: at(finest.time, part, signal) for part in parts for signal in part.signals}
    return Played(
        name,
        finest.time,
        signals,
        {signal: unit for part in parts for signal, unit in part.units.items()},
        sum(part.states for part in parts),
        sum(part.equations for part in parts),
        (max if together else sum)(part.seconds for part in parts),
        sum(part.rhs_calls for part in parts),
        sum(part.steps for part in parts),
    )


def at(time: Any, record: Played, name: str) -> Any:
    """A recorded signal at other times, by cubic splines where the record allows them."""
    import numpy as np

    if np.array_equal(record.time, time):
        return record.signals[name]
    if len(record.time) > 4 and np.all(np.diff(record.time) > 0):
        from scipy.interpolate import CubicSpline

        return CubicSpline(record.time, record.signals[name])(time)
    return np.interp(time, record.time, record.signals[name])


def _entries(folder: Path) -> list[dict[str, Any]]:
    """What `partition.json` says of each partition of a folder. BgError (BG745) where it says nothing."""
    file = folder / "partition.json"
    try:
        entries: list[dict[str, Any]] = json.loads(file.read_text("utf-8"))["partitions"]
        if all(wanted in entry for entry in entries for wanted in ("file", "drivers", "inputs", "outputs")):
            return entries
        found = "a partition lacks an entry"
    except (OSError, ValueError, TypeError, LookupError) as error:
        found = getattr(error, "strerror", None) or str(error)
    helps = ("name a folder that `bgc partition` wrote",)
    Reporter().fail(NO_PARTITIONS, f"{file} cannot be used: {found}", said(str(folder)), helps=helps)


def _settings(model: Model, scenario: Scenario, gives: bool) -> tuple[dict[str, Any], dict[str, Any], float]:
    """A partition's settings, the parameter changes that concern it, and the end of its run (s)."""
    settings = dict(scenario.settings or {})
    options = model.compile().options(
        scenario.experiment, {}, pipeline.settings_of({k: v for k, v in settings.items() if k != "inputs"}, None)[0]
    )
    settings["interval"] = min(options.interval, options.stop / PLAYBACK_POINTS) if gives else options.interval
    known = {name for parameter in model.graph.parameters for name in (parameter.name, *parameter.scalars())}
    return settings, {name: value for name, value in (scenario.parameters or {}).items() if name in known}, options.stop


def recording_times(stop: float, interval: float, until: float | None = None) -> Floats:
    """When a driving run to `stop` (s) is recorded: every `interval` or somewhat oftener, and as fine as that may need at its start.
    until: the end of a first slice of the run."""
    import numpy as np

    end, first = until or stop, min(START * stop, interval)
    grown = math.log(interval / first)
    begin = first / GROWTH * np.expm1(np.linspace(0.0, grown, math.ceil(grown / GROWTH), endpoint=False))
    reached = (interval - first) / GROWTH
    if reached >= end:
        return np.append(begin[begin < end - first / 2], end)
    return np.concatenate((begin, np.linspace(reached, end, math.ceil((end - reached) / interval * (1 - 1e-9)) + 1)))


# ------------------------------------------------------------------------------------------------------------ one by one


def _in_turn(folder: Path, scenario: Scenario, search_in: Sequence[Path]) -> list[Played]:
    parts: list[Played] = []
    for entry in _entries(folder):
        model = pipeline.load(folder / entry["file"], search=search_in)
        settings, changes, stop = _settings(model, scenario, bool(entry["outputs"]))
        if entry["inputs"]:
            settings["inputs"] = _inputs(entry["inputs"], parts)
            settings.setdefault("max_step", STEPS * stop / max(1, *(part.steps for part in parts)))
        if entry["outputs"]:
            settings["times"] = recording_times(stop, settings["interval"])
        run = model.compile().simulate(scenario.experiment, changes, progress=scenario.progress, **settings)
        parts.append(as_played(entry["file"], model, run))
    return parts


def _inputs(names: Sequence[str], parts: Sequence[Played]) -> dict[str, Any]:
    givers = [part for part in parts if not set(names).isdisjoint(part.signals)]
    time = givers[0].time
    return {"time": time, **{name: at(time, part, name) for part in givers for name in names if name in part.signals}}


# ------------------------------------------------------------------------------------------------------ at the same time


def _together(folder: Path, scenario: Scenario, search_in: Sequence[Path]) -> list[Played]:
    """One process a partition; a slice's signals go from drivers to driven as soon as they are there."""
    entries = _entries(folder)
    context = multiprocessing.get_context("spawn")
    plain = replace(scenario, progress=None)
    files = [entry["file"] for entry in entries]
    pipes = {(d, k): context.Pipe(duplex=False) for k, entry in enumerate(entries) for d in map(files.index, entry["drivers"])}
    results = [context.Pipe(duplex=False) for _ in entries]
    processes = []
    for k, entry in enumerate(entries):
        drivers = [pipe[0] for (_, reader), pipe in pipes.items() if reader == k]
        readers = [pipe[1] for (giver, _), pipe in pipes.items() if giver == k]
        task = (folder, entry, plain, tuple(search_in), drivers, readers, results[k][1])
        processes.append(context.Process(target=_work, args=task, daemon=True))
    for process in processes:
        process.start()
    # the workers hold their own ends: one that dies shows to the others as the end of a pipe
    for end in (*(end for pipe in pipes.values() for end in pipe), *(sender for _, sender in results)):
        end.close()
    try:
        return _collected([receiver for receiver, _ in results])
    finally:
        for process in processes:
            process.terminate()
            process.join()


def _collected(receivers: Sequence[Connection]) -> list[Played]:
    """What the workers send; BgError with the diagnostics of the one that failed."""
    found: list[Played] = []
    for receiver in receivers:
        try:
            what = receiver.recv()
        except EOFError:
            continue  # stopped because another one failed
        if not isinstance(what, Played):
            raise BgError(what)
        found.append(what)
    assert len(found) == len(receivers), "a partition's process died"
    return found


def _work(
    folder: Path,
    entry: Mapping[str, Any],
    scenario: Scenario,
    search_in: Sequence[Path],
    drivers: Sequence[Connection],
    readers: Sequence[Connection],
    result: Connection,
) -> None:
    """A partition's process: slice after slice, then its whole record to the parent (or the diagnostics that stopped it)."""
    try:
        result.send(_sliced(folder, entry, scenario, search_in, drivers, readers))
    except BgError as error:
        found: tuple[Diagnostic, ...] = error.diagnostics
        result.send(found)
    except (EOFError, BrokenPipeError):
        pass  # a driver or a reader has stopped, and tells why itself


def _sliced(
    folder: Path,
    entry: Mapping[str, Any],
    scenario: Scenario,
    search_in: Sequence[Path],
    drivers: Sequence[Connection],
    readers: Sequence[Connection],
) -> Played:
    model = pipeline.load(folder / entry["file"], search=search_in)
    system = model.compile()
    settings, changes, stop = _settings(model, scenario, bool(entry["outputs"]))
    interval = settings["interval"] = stop / SLICES / math.ceil(stop / SLICES / settings["interval"])
    system.native.rhs, system.native.jacobian  # noqa: B018  (compiled while the drivers work on their first slice)
    state, whole, heard = None, None, None
    for k in range(SLICES):
        begin, end = stop * k / SLICES, stop * (k + 1) / SLICES
        settings["times"] = recording_times(stop, interval, end) if k == 0 and entry["outputs"] else None
        if drivers:
            pieces = [driver.recv() for driver in drivers]
            heard_steps = [piece.pop("steps") for piece in pieces]
            heard = _extended(heard, pieces, OVERLAP)
            settings["inputs"] = heard
            settings["max_step"] = STEPS * (end - begin) / max(heard_steps)
        run = system.simulate(
            scenario.experiment, changes, state=state, **{**settings, "start": begin, "stop": end, "window": (begin, end)}
        )
        piece = as_played(entry["file"], model, run)
        for reader in readers:
            reader.send({"time": piece.time, "steps": piece.steps, **piece.signals})
        whole = piece if whole is None else _appended(whole, piece)
        assert run.trajectory.states is not None
        state = run.trajectory.states[-1]
    assert whole is not None
    return whole


def _extended(before: Mapping[str, Any] | None, pieces: Sequence[Mapping[str, Any]], overlap: int) -> dict[str, Any]:
    """The drivers' signals over this slice and the last points of the one before, at the first driver's times."""
    import numpy as np

    time = pieces[0]["time"]
    now = {"time": time, **{name: np.interp(time, piece["time"], v) for piece in pieces for name, v in piece.items() if name != "time"}}
    if before is None:
        return now
    return {name: np.concatenate([before[name][-overlap:-1], values]) for name, values in now.items()}


def _appended(whole: Played, piece: Played) -> Played:
    import numpy as np

    signals = {name: np.concatenate([values, piece.signals[name][1:]]) for name, values in whole.signals.items()}
    return replace(
        whole,
        time=np.concatenate([whole.time, piece.time[1:]]),
        signals=signals,
        seconds=whole.seconds + piece.seconds,
        rhs_calls=whole.rhs_calls + piece.rhs_calls,
        steps=whole.steps + piece.steps,
    )
