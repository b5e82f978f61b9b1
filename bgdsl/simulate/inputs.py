"""Inputs along a run: recorded signals, interpolated by C2 cubic splines.

Reports      BG615 an input has no signal, BG616 the record cannot be used, BG617 the record does not cover the run
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bgdsl.diagnostics import Code, Reporter, did_you_mean, listed
from bgdsl.simulate.kernels import splines
from bgdsl.simulate.kernels.compiler import KERNELS
from bgdsl.source import said

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

NO_SIGNAL = Code("BG615", "an input has no signal")
BAD_RECORD = Code("BG616", "a recorded input cannot be used")
TOO_SHORT = Code("BG617", "a recorded input does not cover the run")


class InputSignals:
    """The inputs u at any time of the run: m signals, piecewise cubics on common breakpoints; where asked for (`with_rates`) their
    derivatives; then `settings`, which stay as they are until they are changed.

    breaks: (k,) times; values, slopes: (k, m), those of the signals and of their derivatives there. Without signals m and k are 0.
    """

    def __init__(self, breaks: Floats, values: Floats, slopes: Floats, settings: Floats, *, with_rates: bool = False):
        import numpy as np

        self.breaks, self.values, self.slopes, self.settings = (np.ascontiguousarray(a) for a in (breaks, values, slopes, settings))
        self.with_rates = with_rates
        self.signals = int(values.shape[1])
        self.count = self.signals * (2 if with_rates else 1) + len(settings)
        self._np = np

    @property
    def spacing(self) -> float:
        """The longest time (s) that an integrator may step over without missing what the inputs do."""
        return _feature(self.breaks, self.values) if self.signals else math.inf

    def __call__(self, t: float) -> Floats:
        u: Floats = self._np.empty(self.count)
        m = self.signals
        u[self.count - len(self.settings) :] = self.settings
        if not m:
            return u
        i = int(self._np.searchsorted(self.breaks, t, side="right")) - 1
        i = min(max(i, 0), len(self.breaks) - 2)
        h = self.breaks[i + 1] - self.breaks[i]
        p = (t - self.breaks[i]) / h
        q = 1.0 - p
        y, s = self.values[i : i + 2], self.slopes[i : i + 2]
        u[:m] = q * q * (1.0 + 2.0 * p) * y[0] + p * p * (1.0 + 2.0 * q) * y[1] + h * p * q * (q * s[0] - p * s[1])
        if self.with_rates:
            u[m : 2 * m] = 6.0 * p * q / h * (y[1] - y[0]) + q * (1.0 - 3.0 * p) * s[0] + p * (1.0 - 3.0 * q) * s[1]
        return u


def no_inputs() -> InputSignals:
    """For models without inputs."""
    import numpy as np

    return InputSignals(np.zeros(0), np.zeros((0, 0)), np.zeros((0, 0)), np.zeros(0))


def input_signals(
    names: Sequence[str], source: Path | Mapping[str, Any] | None, start: float, stop: float, report: Reporter
) -> InputSignals:
    """The signals of the inputs `names` from a file or from arrays by name (`time` among them). The derivative of one (`der(u)`) that
    is not given is the slope of the curve through its values."""
    if not names:
        if isinstance(source, Path | str) and not Path(source).exists():
            report.fail(BAD_RECORD, f"there is no file {source}", said(str(source)), notes=("the model has no inputs, and needs none",))
        return no_inputs()
    if source is None:
        where = said("inputs")
        report.fail(
            NO_SIGNAL,
            f"the model's inputs {listed(names, 6)} have no signals",
            where,
            helps=("give a file with `time` and the inputs' names: `--inputs FILE`",),
        )
    place = str(source) if isinstance(source, Path | str) else "inputs"
    columns = read_columns(Path(source), report) if isinstance(source, Path | str) else dict(source)
    return _splines(names, columns, place, start, stop, report)


def _splines(names: Sequence[str], columns: Mapping[str, Any], place: str, start: float, stop: float, report: Reporter) -> InputSignals:
    import numpy as np

    where = said(place)
    of = {name: name[4:-1] for name in names if name.startswith("der(") and name not in columns}
    missing = [name for name in dict.fromkeys(("time", *(of.get(name, name) for name in names))) if name not in columns]
    for name in missing:
        helps = did_you_mean(name, columns) or ((f"it has {listed(columns)}",) if columns else ())
        report.add(NO_SIGNAL, f"there is no column `{name}` in {place}", where, helps=helps)
    report.stop_if_errors()
    time = np.asarray(columns["time"], dtype=float)
    values = np.column_stack([np.asarray(columns[of.get(name, name)], dtype=float) for name in names])
    if len(time) < 2 or values.shape[0] != len(time):
        report.fail(BAD_RECORD, f"{place} has {len(time)} rows; at least 2 are needed", where)
    if not (np.diff(time) > 0).all():
        row = int(np.argmin(np.diff(time) > 0)) + 1
        report.fail(BAD_RECORD, f"the times in {place} do not increase at row {row + 1} ({time[row]:g} s)", where)
    if not (np.isfinite(values).all() and np.isfinite(time).all()):
        row, column = np.argwhere(~np.isfinite(values))[0]
        report.fail(BAD_RECORD, f"`{names[column]}` is {values[row, column]} at row {row + 1} of {place}", where)
    slack = 1e-9 * (stop - start)
    if time[0] > start + slack or time[-1] < stop - slack:
        report.fail(
            TOO_SHORT,
            f"{place} covers {time[0]:g} to {time[-1]:g} s, the run needs {start:g} to {stop:g} s",
            where,
            notes=("inputs are interpolated, never extrapolated",),
        )
    slopes = spline_slopes(time, values)
    derived = [k for k, name in enumerate(names) if name in of]
    if derived:
        values[:, derived] = slopes[:, derived]
        slopes[:, derived] = spline_slopes(time, np.ascontiguousarray(values[:, derived]))
    return InputSignals(time, values, slopes, np.zeros(0))


def spline_slopes(time: Floats, values: Floats) -> Floats:
    """The slopes (k, m) at the times (k,) of the C2 cubic splines through the columns of values (k, m), k > 1: not-a-knot at both
    ends, or natural with fewer than four times."""
    import numpy as np

    time, values = np.ascontiguousarray(time), np.ascontiguousarray(values)
    slopes, work = np.empty_like(values), np.empty(len(time))
    KERNELS.function(splines.spline_slopes.__name__)(*values.shape, *(array.ctypes.data for array in (time, values, slopes, work)))
    return slopes


def _feature(time: Floats, values: Floats, share: float = 0.01) -> float:
    """The spacing of the thinnest record that still tells what the inputs do: every second row goes as long as straight lines
    between the rest meet those that go within `share` of the input's range."""
    import numpy as np

    range_ = values.max(axis=0) - values.min(axis=0)
    range_[range_ == 0.0] = 1.0
    stride = 1
    while 4 * stride < len(time):
        left, middle, right = (slice(k * stride, None, 2 * stride) for k in range(3))
        count = len(time[right])
        weight = ((time[middle][:count] - time[left][:count]) / (time[right] - time[left][:count]))[:, None]
        line = values[left][:count] * (1 - weight) + values[right] * weight
        if (np.abs(values[middle][:count] - line) > share * range_).any():
            break
        stride *= 2
    return float(time[-1] - time[0]) / (len(time) - 1) * stride


def read_columns(path: Path, report: Reporter) -> dict[str, Any]:
    """The columns of a CSV, netCDF or Parquet file by name."""
    where = said(str(path))
    try:
        match path.suffix.lower():
            case ".nc":
                import h5netcdf

                with h5netcdf.File(path, "r") as file:
                    return {name: variable[...] for name, variable in file.variables.items() if variable.ndim == 1}
            case ".parquet":
                from pyarrow import parquet

                return {name: column.to_numpy() for name, column in zip(*_table(parquet.read_table(path)), strict=True)}
            case _:
                return _read_csv(path)
    except FileNotFoundError:
        report.fail(BAD_RECORD, f"there is no file {path}", where)
    except (OSError, ValueError) as error:
        report.fail(BAD_RECORD, f"{path} cannot be read: {getattr(error, 'strerror', None) or error}", where)


def _table(table: Any) -> tuple[list[str], list[Any]]:
    return table.column_names, table.columns


def _read_csv(path: Path) -> dict[str, Any]:
    import csv

    import numpy as np

    with path.open(encoding="utf-8-sig", newline="") as file:
        rows = csv.reader(line for line in file if line.strip() and not line.startswith("#"))
        header = [name.strip() for name in next(rows, [])]
        table = list(rows)
    for number, row in enumerate(table, start=2):
        if len(row) != len(header):
            raise ValueError(f"line {number} has {len(row)} fields, the header has {len(header)}")
    try:
        numbers = np.array(table, dtype=float).reshape(len(table), len(header))
    except ValueError:
        raise ValueError(_no_number(header, table)) from None
    return {name: numbers[:, i] for i, name in enumerate(header)}


def _no_number(header: Sequence[str], table: Sequence[Sequence[str]]) -> str:
    """Which field of a table is no number, in words."""
    for number, row in enumerate(table, start=1):
        for name, text in zip(header, row, strict=True):
            try:
                float(text)
            except ValueError:
                return f"`{text}` in column `{name}`, row {number}, is no number"
    return "it holds what is no number"
