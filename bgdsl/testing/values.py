"""Values of test expressions: numbers, texts and signals over time, and the arithmetic of the three.

A `Series` is a signal with its times; where two meet, the second is interpolated (cubic) to the times of the first that both cover.
Arrays have one axis: a matrix is its entries row by row.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
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
    """Cubic between events: where an event doubles a time, the signal may jump there, and each side is a curve of its own."""
    hit = np.clip(np.searchsorted(time, wanted), 0, len(time) - 1)
    exact = time[hit] == wanted
    result = np.asarray(values[hit], float)
    if exact.all():
        return result
    wanted = np.clip(wanted, time[0], time[-1])
    bounds = [0, *(np.flatnonzero(np.diff(time) <= 0) + 1), len(time)]
    for start, stop in pairwise(bounds):
        inside = ~exact & (wanted >= time[start]) & (wanted <= time[stop - 1])
        if inside.any():
            result[inside] = _curve(time[start:stop], values[start:stop], wanted[inside])
    return result


def _curve(time: Floats, values: Floats, wanted: Floats) -> Floats:
    """A cubic spline through four points and more, else straight lines."""
    if len(time) >= 4:
        from scipy.interpolate import CubicSpline

        return np.asarray(CubicSpline(time, values)(wanted), float)
    columns = values.reshape(len(time), -1)
    lines = np.stack([np.interp(wanted, time, column) for column in columns.T], axis=-1)
    return lines.reshape(len(wanted), *values.shape[1:])


def combine(operation: Callable[..., Any], *values: Value) -> Value:
    """Apply a NumPy function to values, aligning signals in time. ValueError where sizes or times do not fit together."""
    width = _common_width(values)
    series = [value for value in values if isinstance(value, Series)]
    with np.errstate(all="ignore"):
        if not series:
            return plain(operation(*values))
        time = series[0].time
        start, stop = max(s.time[0] for s in series), min(s.time[-1] for s in series)
        if start > stop:
            raise ValueError("the two runs have no time in common")
        if (time[0], time[-1]) != (start, stop):
            time = time[(time >= start) & (time <= stop)]
        return Series(time, np.asarray(operation(*(_aligned(v, time, width) for v in values))))


def _common_width(values: tuple[Value, ...]) -> int:
    """The number of entries of the arrays among the values, 0 if there are none."""
    shapes = [v.values.shape[1:] if isinstance(v, Series) else np.shape(v) for v in values]
    widths = sorted({shape[0] for shape in shapes if shape})
    if len(widths) > 1:
        raise ValueError(f"arrays of {widths[0]} and of {widths[1]} entries do not fit together")
    return widths[0] if widths else 0


def _aligned(value: Value, time: Floats, width: int) -> Any:
    """The value at the times; a scalar signal that meets an array stands for each of its entries."""
    if not isinstance(value, Series):
        return value
    found = value.on(time)
    return found[:, None] if width and found.ndim == 1 else found


def plain(value: Any) -> Value:
    """What NumPy gave, a number where it has no axes."""
    return value if isinstance(value, np.ndarray) and value.ndim else float(value)


UNARY: Mapping[str, Callable[..., Any]] = {"-": np.negative, "+": np.positive, "not": np.logical_not}

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
    span = s.time[-1] - s.time[0]
    if span <= 0:
        raise ValueError("a signal of one moment has no amplitude")
    phase = np.exp(-2j * np.pi * frequency * (s.time - s.time[0]))
    return 2 * np.abs(np.trapezoid((s.values.T * phase).T, s.time, axis=0)) / span


OVER_TIME: Mapping[str, Callable[..., Any]] = {
    "max": lambda s: s.values.max(axis=0),
    "min": lambda s: s.values.min(axis=0),
    "mean": _mean,
    "rms": lambda s: np.sqrt(_mean(Series(s.time, s.values**2))),
    "integral": lambda s: np.trapezoid(s.values, s.time, axis=0),
    "amplitude": _amplitude,
}
"""Functions of a whole signal: the extremes, time mean, root mean square, integral over time, amplitude at a frequency in Hz."""
