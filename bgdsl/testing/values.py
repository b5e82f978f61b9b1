"""Values of test expressions: numbers, texts and signals over time, and the arithmetic of the three.

A `Series` is a signal with its times; where two meet, the second is interpolated (cubic) to the times of the first that both cover.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Series:
    """A signal: `values[i]` at `time[i]`; `values` may have trailing axes for vectors."""

    time: Floats
    values: Floats

    def at(self, t: float) -> Any:
        """The value at time t, interpolated; ValueError outside the run."""
        slack = 1e-9 * (abs(t) + self.time[-1] - self.time[0])
        if not self.time[0] - slack <= t <= self.time[-1] + slack:
            raise ValueError(f"time {t:g} lies outside the run, {self.time[0]:g} to {self.time[-1]:g}")
        return _interpolate(self.time, self.values, np.array([t]))[0]

    def on(self, time: Floats) -> Floats:
        """The values at other times."""
        return self.values if time is self.time or np.array_equal(time, self.time) else _interpolate(self.time, self.values, time)


Value = float | str | Floats | Series


def _interpolate(time: Floats, values: Floats, wanted: Floats) -> Floats:
    """Cubic where the record has no doubled times (events double them), else linear."""
    hit = np.clip(np.searchsorted(time, wanted), 0, len(time) - 1)
    exact = time[hit] == wanted
    if exact.all():
        return np.asarray(values[hit], float)
    keep = np.concatenate(([True], np.diff(time) > 0))
    time, values = time[keep], values[keep]
    wanted = np.clip(wanted, time[0], time[-1])
    if len(time) < 4 or not keep.all():
        columns = values.reshape(len(time), -1)
        flat = np.stack([np.interp(wanted, time, column) for column in columns.T], axis=-1)
        return flat.reshape(len(wanted), *values.shape[1:])
    from scipy.interpolate import CubicSpline

    return np.asarray(CubicSpline(time, values)(wanted), float)


def combine(operation: Callable[..., Any], *values: Value) -> Value:
    """Apply a NumPy function to values, aligning signals in time."""
    series = [value for value in values if isinstance(value, Series)]
    if not series:
        return _plain(operation(*values))
    time = series[0].time
    start, stop = max(s.time[0] for s in series), min(s.time[-1] for s in series)
    if start > stop:
        raise ValueError("the two runs have no time in common")
    if (time[0], time[-1]) != (start, stop):
        time = time[(time >= start) & (time <= stop)]
    return Series(time, np.asarray(operation(*(v.on(time) if isinstance(v, Series) else v for v in values))))


def _plain(value: Any) -> Value:
    return value if isinstance(value, np.ndarray) and value.ndim else float(value)


BINARY: Mapping[str, Callable[..., Any]] = {
    "+": np.add,
    "-": np.subtract,
    "*": np.multiply,
    "/": np.divide,
    "^": np.power,
    "and": np.logical_and,
    "or": np.logical_or,
    ".+": np.add,
    ".-": np.subtract,
    ".*": np.multiply,
    "./": np.divide,
    ".^": np.power,
}

RELATIONS: Mapping[str, Callable[..., Any]] = {
    "==": np.equal,
    "<>": np.not_equal,
    "<": np.less,
    "<=": np.less_equal,
    ">": np.greater,
    ">=": np.greater_equal,
}

ELEMENTWISE: Mapping[str, Callable[..., Any]] = {
    **{
        name: getattr(np, name)
        for name in ("sin", "cos", "tan", "sinh", "cosh", "tanh", "exp", "log", "log10", "sqrt", "abs", "sign", "floor", "ceil")
    },
    "asin": np.arcsin,
    "acos": np.arccos,
    "atan": np.arctan,
    "atan2": np.arctan2,
}


def _mean(s: Series) -> Any:
    span = s.time[-1] - s.time[0]
    return np.trapezoid(s.values, s.time, axis=0) / span if span > 0 else s.values[0]


def _amplitude(s: Series, frequency: float) -> Any:
    """Amplitude of the harmonic of that frequency (Hz), by projection over the whole run."""
    phase = np.exp(-2j * np.pi * frequency * (s.time - s.time[0]))
    span = s.time[-1] - s.time[0]
    return 2 * abs(np.trapezoid(s.values * phase, s.time)) / span


OVER_TIME: Mapping[str, Callable[..., Any]] = {
    "max": lambda s: s.values.max(axis=0),
    "min": lambda s: s.values.min(axis=0),
    "mean": _mean,
    "rms": lambda s: np.sqrt(_mean(Series(s.time, s.values**2))),
    "integral": lambda s: np.trapezoid(s.values, s.time, axis=0),
    "amplitude": _amplitude,
}
"""Functions of a whole signal: the extremes, time mean, root mean square, integral over time, amplitude at a frequency in Hz."""
