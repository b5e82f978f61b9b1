"""How close a reduced model's outputs come to the full model's: means, harmonics, normalised errors.

Input        two runs as columns over time (s), the outputs to compare, the name of a shaft angle (rad) if there is one
Output       Comparison per output
Establishes  both are looked at on one uniform grid of the common interval (cubic interpolation)
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

POINTS = 8192
CYCLE = 4.0 * math.pi
"""A shaft's cycle: two revolutions, as of a four-stroke engine, so that half orders are seen."""


@dataclass(frozen=True, slots=True)
class Harmonic:
    """A line of the spectrum: frequency (Hz), order per revolution (NaN without a shaft), amplitudes and phases (rad) of both."""

    frequency: float
    order: float
    amplitude: float
    amplitude_reduced: float
    phase: float
    phase_reduced: float

    @property
    def error(self) -> float:
        """Relative error of the amplitude."""
        return (self.amplitude_reduced - self.amplitude) / self.amplitude if self.amplitude else math.nan


@dataclass(frozen=True, slots=True)
class Comparison:
    """One output. nrms: rms of the difference over the rms of the output about its mean; peak: largest difference over the
    largest excursion from the mean."""

    name: str
    mean: float
    mean_reduced: float
    nrms: float
    peak: float
    harmonics: tuple[Harmonic, ...]


def compare(
    full: Mapping[str, Floats],
    reduced: Mapping[str, Floats],
    names: Sequence[str],
    *,
    angle: str | None = None,
    cycles: int = 4,
    lines: int = 3,
) -> tuple[Comparison, ...]:
    """Compare outputs over the common time of two runs; with a shaft `angle`, over its last whole `cycles`. Columns include `time`."""
    import numpy as np

    start = max(float(full["time"][0]), float(reduced["time"][0]))
    stop = min(float(full["time"][-1]), float(reduced["time"][-1]))
    revolutions = math.nan
    if angle is not None:
        start, stop, revolutions = _whole_cycles(full["time"], full[angle], start, stop, cycles)
    grid = np.linspace(start, stop, POINTS, endpoint=False)
    return tuple(
        compare_output(
            name,
            resampled(full["time"], full[name], grid),
            resampled(reduced["time"], reduced[name], grid),
            stop - start,
            revolutions,
            lines,
        )
        for name in names
    )


def resampled(time: Floats, values: Floats, grid: Floats) -> Floats:
    """The values on another grid, by a cubic spline; times that occur twice (events) count once."""
    import numpy as np
    from scipy.interpolate import CubicSpline

    keep = np.concatenate(([True], np.diff(time) > 0))
    if keep.sum() < 4:
        return np.asarray(np.interp(grid, time[keep], values[keep]))
    return np.asarray(CubicSpline(time[keep], values[keep])(grid))


def _whole_cycles(time: Floats, angle: Floats, start: float, stop: float, cycles: int) -> tuple[float, float, float]:
    """The interval of the last whole cycles, and its revolutions; the whole interval where there is no whole cycle."""
    import numpy as np

    last = math.floor(float(np.interp(stop, time, angle)) / CYCLE)
    first = max(last - cycles, math.ceil(float(np.interp(start, time, angle)) / CYCLE))
    if last <= first:
        turned = float(np.interp(stop, time, angle) - np.interp(start, time, angle))
        return start, stop, turned / (2.0 * math.pi)
    a, b = (float(np.interp(k * CYCLE, angle, time)) for k in (first, last))
    return a, b, (last - first) * CYCLE / (2.0 * math.pi)


def compare_output(name: str, full: Floats, reduced: Floats, length: float, revolutions: float, lines: int) -> Comparison:
    """Compare one output given on one uniform grid over `length` seconds and so many revolutions."""
    import numpy as np

    mean, mean_reduced = float(full.mean()), float(reduced.mean())
    swing = full - mean
    rms, most = float(np.sqrt(np.mean(swing**2))), float(np.abs(swing).max())
    difference = reduced - full
    error, worst = float(np.sqrt(np.mean(difference**2))), float(np.abs(difference).max())
    return Comparison(
        name,
        mean,
        mean_reduced,
        error / rms if rms else (0.0 if error == 0.0 else math.inf),
        worst / most if most else (0.0 if worst == 0.0 else math.inf),
        _harmonics(swing, reduced - mean_reduced, length, revolutions, lines),
    )


def _harmonics(full: Floats, reduced: Floats, length: float, revolutions: float, lines: int) -> tuple[Harmonic, ...]:
    """The strongest lines of the full model's spectrum, largest first; without a shaft a window keeps them apart."""
    import numpy as np

    shaft = not math.isnan(revolutions)
    window = np.ones(len(full)) if shaft else np.hanning(len(full))
    gain = 2.0 / window.sum()
    a, b = gain * np.fft.rfft(full * window), gain * np.fft.rfft(reduced * window)
    strength = np.abs(a)
    if not strength.max():
        return ()
    found: list[int] = []
    for k in np.argsort(-strength):
        k = int(k)
        apart = all(abs(k - other) > (0 if shaft else 2) for other in found)
        if k > 0 and apart and strength[k] > 1e-6 * strength.max():
            found.append(k)
        if len(found) == lines:
            break
    return tuple(
        Harmonic(
            k / length,
            k / revolutions if shaft else math.nan,
            float(abs(a[k])),
            float(abs(b[k])),
            float(np.angle(a[k])),
            float(np.angle(b[k])),
        )
        for k in found
    )
