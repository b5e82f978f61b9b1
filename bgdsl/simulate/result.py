"""The run as people hold it: arrays by name, statistics, and ways to other formats."""

from __future__ import annotations

import dataclasses
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bgdsl.diagnostics import Reporter
from bgdsl.expr import ZERO
from bgdsl.ir.native import CompiledModel
from bgdsl.ir.trajectory import Statistics, Trajectory
from bgdsl.simulate.columns import Column, find_columns
from bgdsl.simulate.inputs import read_columns
from bgdsl.simulate.options import parameter_array
from bgdsl.simulate.recording import open_sink
from bgdsl.simulate.sliding import Regime

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]


class Run:
    """`run["vA.f"]` is that variable at `run.time`: as recorded, else evaluated from the states that were kept.

    An array's name gives (rows, entries). BgError (BG618) for a name that the model does not have.
    """

    def __init__(
        self, trajectory: Trajectory, model: CompiledModel | None = None, regimes: tuple[Regime, ...] = (), path: Path | None = None
    ):
        self.trajectory = trajectory
        self.path = path
        self._model, self._regimes = model, regimes

    @property
    def experiment(self) -> str:
        return self.trajectory.experiment

    @property
    def statistics(self) -> Statistics:
        return self.trajectory.statistics

    @property
    def parameters(self) -> dict[str, float]:
        return dict(self.trajectory.parameters)

    @property
    def names(self) -> tuple[str, ...]:
        """The recorded variables."""
        return self.trajectory.names

    @cached_property
    def _recorded(self) -> dict[str, Floats]:
        if self.path is not None:
            return read_columns(self.path, Reporter())
        trajectory = self.trajectory
        return {"time": trajectory.time, **dict(zip(trajectory.names, trajectory.values.T, strict=True))}

    @property
    def time(self) -> Floats:
        """The recorded times (rows,), in seconds."""
        return self._recorded["time"]

    def __contains__(self, name: str) -> bool:
        try:
            self[name]
        except Exception:
            return False
        return True

    def __getitem__(self, name: str) -> Floats:
        if name in self._recorded:
            return self._recorded[name]
        if self._model is None:
            raise KeyError(name)
        columns = find_columns(self._model.program, [name], Reporter())
        found = self.evaluate(columns)
        return found[:, 0] if columns[0].name == name else found

    def evaluate(self, columns: tuple[Column, ...]) -> Floats:
        """(rows, columns): recorded ones as they are, others from the states. LookupError where no states were kept."""
        import numpy as np

        trajectory, model = self.trajectory, self._model
        if all(column.name in self._recorded for column in columns):
            return np.column_stack([self._recorded[column.name] for column in columns])
        if trajectory.states is None or model is None or not self._regimes:
            names = ", ".join(column.name for column in columns if column.name not in self._recorded)
            raise LookupError(f"{names} was not recorded, and the states were not kept")
        expressions = [column.value for column in columns]
        values: Floats = np.empty((len(trajectory.time), len(columns)))
        bounds = [
            0,
            *np.searchsorted(trajectory.time, [one.time for one in self._regimes[1:]], side="right").tolist(),
            len(trajectory.time),
        ]
        for regime, first, last in zip(self._regimes, bounds, bounds[1:], strict=False):
            if first < last:
                regime.model.set_parameters(parameter_array(trajectory.parameters))
                kernel = regime.kernel(expressions)
            for k in range(first, last):
                t = float(trajectory.time[k])
                kernel(t, trajectory.states[k], regime.inputs(t), values[k])
        return values

    def summary(self) -> list[dict[str, Any]]:
        """One row a recorded variable: its start, end, extremes and mean over time."""
        import numpy as np

        time = self.time
        rows = []
        for name, unit in zip(self.trajectory.names, self.trajectory.units, strict=True):
            values = self._recorded[name]
            mean = float(np.trapezoid(values, time) / (time[-1] - time[0])) if len(time) > 1 else float(values[0])
            numbers = {"start": values[0], "end": values[-1], "min": values.min(), "max": values.max(), "mean": mean}
            rows.append({"variable": name, "unit": unit, **{key: float(value) for key, value in numbers.items()}})
        return rows

    def to_xarray(self) -> Any:
        """An `xarray.Dataset` over `time`; units and the run's facts as attributes."""
        import xarray

        trajectory = self.trajectory
        data = {
            name: ("time", self._recorded[name], {"units": unit} if unit else {})
            for name, unit in zip(trajectory.names, trajectory.units, strict=True)
        }
        facts = {"model": trajectory.model, "experiment": trajectory.experiment, "status": trajectory.status, "digest": trajectory.digest}
        statistics = dataclasses.asdict(self.statistics)
        return xarray.Dataset(data, coords={"time": ("time", self.time, {"units": "s"})}, attrs={**facts, **statistics})

    def save(self, path: str | Path, *, force: bool = False) -> None:
        """Write the recorded columns to a CSV, netCDF or Parquet file."""
        import numpy as np

        trajectory = self.trajectory
        columns = [Column(name, ZERO, unit) for name, unit in zip(trajectory.names, trajectory.units, strict=True)]
        sink = open_sink(Path(path), columns, trajectory.model, trajectory.digest, force=force, report=Reporter())
        values = np.column_stack([self._recorded[name] for name in trajectory.names]) if columns else np.zeros((len(self.time), 0))
        sink.write(self.time, values)
        sink.close(trajectory.status)
