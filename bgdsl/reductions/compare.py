"""How a reduced model's outputs differ from the full model's: means, harmonics, errors.

Input        signals of two runs at common times
Output       OutputComparison a signal
Establishes  harmonics are those that dominate the full model; both models are measured at the same frequencies
Reports      nothing

With a shaft angle the harmonics are orders (per revolution) over whole cycles at the end of the run, resampled uniformly in time;
without one they are the peaks of the full model's spectrum, their amplitudes fitted by least squares over the window.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

RESAMPLED = 8192
"""Points over the cycles from which orders are taken."""


@dataclass(frozen=True, slots=True)
class Harmonic:
    """frequency in Hz; amplitude in the signal's unit; phase in rad of `amplitude*cos(2 pi frequency t + phase)`, t from the window's
    start; order per revolution, None where no shaft is named."""

    frequency: float
    amplitude: float
    phase: float
    order: float | None = None


@dataclass(frozen=True, slots=True)
class OutputComparison:
    """One output of the full and of a reduced model over the window.

    nrms: root mean square of the difference over that of the full signal's fluctuation (of the signal itself where it has
    none); peak: largest difference over the full signal's largest deviation from its mean. Both are 0 for equal signals.
    """

    name: str
    unit: str
    mean: tuple[float, float]
    harmonics: tuple[tuple[Harmonic, Harmonic], ...]
    nrms: float
    peak: float

    def as_dictionary(self) -> dict[str, Any]:
        return {
            "output": self.name,
            "unit": self.unit,
            "mean": {"full": self.mean[0], "reduced": self.mean[1]},
            "harmonics": [
                {
                    "frequency": full.frequency,
                    "order": full.order,
                    "amplitude": {"full": full.amplitude, "reduced": reduced.amplitude},
                    "phase": {"full": full.phase, "reduced": reduced.phase},
                }
                for full, reduced in self.harmonics
            ],
            "nrms": self.nrms,
            "peak": self.peak,
        }


@dataclass(frozen=True, slots=True)
class Shaft:
    """Cycles of a shaft: `angle` (rad) at the recorded times; the last `cycles` whole cycles of `revolutions` each are taken, or as
    many as there are."""

    angle: Floats
    cycles: int = 4
    revolutions: float = 2.0


def compare_output(
    name: str,
    unit: str,
    time: Floats,
    full: Floats,
    reduced: Floats,
    *,
    harmonics: int = 3,
    shafts: tuple[Shaft, Shaft] | None = None,
    least: float = 0.0,
) -> OutputComparison:
    """Compare two signals at the same times. shafts: of the full and of the reduced run, each with its own angle; RMS and peak error
    are then taken at equal angles, so that a speed that is a little off is told as what it is and not as an error of all signals.
    least: what is smaller than this is round-off; errors are no shares of it."""
    nrms, peak = errors(time, full, reduced, shafts, least)
    if shafts is None:
        pairs = _by_frequency(time, full, reduced, harmonics)
        mean = _mean(time, full), _mean(time, reduced)
    else:
        pairs, mean = _by_order(time, full, reduced, harmonics, shafts)
    return OutputComparison(name, unit, mean, pairs, nrms, peak)


def errors(
    time: Floats, full: Floats, reduced: Floats, shafts: tuple[Shaft, Shaft] | None = None, least: float = 0.0
) -> tuple[float, float]:
    """Normalised RMS and peak error, as in `OutputComparison`; at equal angles of the shafts if there are any."""
    import numpy as np

    difference = reduced - full if shafts is None else _at_angles(shafts, reduced) - full
    swing = full - _mean(time, full)
    size = _rms(time, swing)
    size = max(least, size if size > 1e-12 * _rms(time, full) else _rms(time, full))
    height = max(least, float(np.abs(swing).max()) or float(np.abs(full).max()))
    nrms = _rms(time, difference) / size if size else float(_rms(time, difference) > 0)
    return nrms, float(np.abs(difference).max()) / height if height else float(np.abs(difference).max() > 0)


def _mean(time: Floats, values: Floats) -> float:
    import numpy as np

    return float(np.trapezoid(values, time) / (time[-1] - time[0]))


def _rms(time: Floats, values: Floats) -> float:
    return math.sqrt(max(0.0, _mean(time, values * values)))


def _at_angles(shafts: tuple[Shaft, Shaft], reduced: Floats) -> Floats:
    """The reduced signal where its shaft has the angle of the full one's; where it never gets there, at its nearest."""
    import numpy as np

    full, own = shafts[0].angle, shafts[1].angle
    if len(own) < 4 or not (np.diff(own) > 0).all():
        return reduced
    from scipy.interpolate import CubicSpline

    values: Floats = CubicSpline(own, reduced)(np.clip(full, own[0], own[-1]))
    return values


# ----------------------------------------------------------------------------------------------------------- by frequency


def _by_frequency(time: Floats, full: Floats, reduced: Floats, count: int) -> tuple[tuple[Harmonic, Harmonic], ...]:
    frequencies = peaks(time, full, count)
    if not frequencies:
        return ()
    return tuple(zip(fit(time, full, frequencies), fit(time, reduced, frequencies), strict=True))


def peaks(time: Floats, values: Floats, count: int) -> list[float]:
    """The frequencies (Hz) of the largest peaks of the spectrum, largest first; those below a thousandth of the largest are left out."""
    import numpy as np

    n = len(time)
    span = time[-1] - time[0]
    uniform = np.interp(np.linspace(time[0], time[-1], n), time, values)
    spectrum = np.abs(np.fft.rfft((uniform - uniform.mean()) * np.hanning(n)))
    if n < 8 or not spectrum.max() > 1e-12 * n * max(1e-300, float(np.abs(values).max())):
        return []
    inner = spectrum[1:-1]
    tops = 1 + np.flatnonzero((inner > spectrum[:-2]) & (inner >= spectrum[2:]) & (inner > 1e-3 * spectrum.max()))
    best = sorted(tops.tolist(), key=lambda k: -spectrum[k])[:count]
    return [(k + _vertex(*np.log(spectrum[k - 1 : k + 2] + 1e-300))) * (n - 1) / n / span for k in best]


def _vertex(a: float, b: float, c: float) -> float:
    """Where between -1/2 and 1/2 the parabola through three points has its top."""
    bend = a - 2 * b + c
    return float(min(0.5, max(-0.5, (a - c) / (2 * bend)))) if bend else 0.0


def fit(time: Floats, values: Floats, frequencies: Sequence[float]) -> tuple[Harmonic, ...]:
    """Amplitude and phase at the given frequencies, all at once, by least squares beside a mean."""
    import numpy as np

    phases = 2 * np.pi * np.outer(time - time[0], frequencies)
    basis = np.column_stack([np.ones(len(time)), np.cos(phases), np.sin(phases)])
    solution = np.linalg.lstsq(basis, values, rcond=None)[0][1:]
    cosines, sines = np.split(solution, 2)
    return tuple(
        Harmonic(float(f), float(math.hypot(c, s)), float(math.atan2(-s, c))) for f, c, s in zip(frequencies, cosines, sines, strict=True)
    )


# --------------------------------------------------------------------------------------------------------------- by order


def orders(time: Floats, values: Floats, shaft: Shaft, cycles: int) -> tuple[float, list[Harmonic]]:
    """The mean and the harmonics by order, in steps of one per window, over the shaft's last whole cycles: so many, at least one."""
    import numpy as np
    from scipy.interpolate import CubicSpline

    cycle = 2 * np.pi * shaft.revolutions
    last = math.floor(shaft.angle[-1] / cycle)
    start, stop = np.interp([cycle * (last - cycles), cycle * last], shaft.angle, time)
    uniform = CubicSpline(time, values)(start + (stop - start) * np.arange(RESAMPLED) / RESAMPLED)
    spectrum = np.fft.rfft(uniform) / RESAMPLED
    turns = cycles * shaft.revolutions
    found = [
        Harmonic(k / (stop - start), 2 * abs(spectrum[k]), float(np.angle(spectrum[k])), k / turns) for k in range(1, int(40 * turns) + 1)
    ]
    return float(spectrum[0].real), found


def whole_cycles(shaft: Shaft) -> int:
    """How many whole cycles the shaft goes through."""
    cycle = 2 * math.pi * shaft.revolutions
    return max(0, math.floor(float(shaft.angle[-1]) / cycle) - math.ceil(float(shaft.angle[0]) / cycle))


def _by_order(
    time: Floats, full: Floats, reduced: Floats, count: int, shafts: tuple[Shaft, Shaft]
) -> tuple[tuple[tuple[Harmonic, Harmonic], ...], tuple[float, float]]:
    cycles = min(shafts[0].cycles, *map(whole_cycles, shafts))
    if not cycles:
        return (), (_mean(time, full), _mean(time, reduced))
    mean_full, of_full = orders(time, full, shafts[0], cycles)
    mean_reduced, of_reduced = orders(time, reduced, shafts[1], cycles)
    best = sorted(range(len(of_full)), key=lambda k: -of_full[k].amplitude)[:count]
    return tuple((of_full[k], of_reduced[k]) for k in best), (mean_full, mean_reduced)
