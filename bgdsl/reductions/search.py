"""The smallest model that is accurate enough: thresholds tried from small to large, then narrowed down.

Input        the activities, how a model at a threshold is made and measured (a callable), the largest error allowed
Output       Search      the best candidate and every one tried, ordered from full to smallest
Establishes  each candidate was run; none is accepted by extrapolation
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from bgdsl.ir.activity import ActivityReport


@dataclass(frozen=True, slots=True)
class Candidate:
    """A reduced model as measured. error: the largest of its outputs' errors (a fraction, infinite where it could not be run);
    seconds: wall time of its run."""

    threshold: float
    dropped: int
    states: int
    error: float
    seconds: float


@dataclass(frozen=True, slots=True)
class Search:
    """best: the one with the most terms dropped within the error allowed; None where even the first step is too much."""

    best: Candidate | None
    tried: tuple[Candidate, ...]


def levels(report: ActivityReport) -> list[float]:
    """The thresholds at which another term falls, ascending: just above each rho."""
    rhos = {term.rho for junction in report.junctions for term in junction.terms if 0.0 <= term.rho < 1.0}
    return [math.nextafter(rho, 2.0) for rho in sorted(rhos)]


def search(report: ActivityReport, allowed: float, attempt: Callable[[float], Candidate], *, ladder: int = 8, narrow: int = 6) -> Search:
    """Try `ladder` thresholds spread over all levels, then halve `narrow` times between the last good one and the next bad one."""
    steps = levels(report)
    tried: dict[int, Candidate] = {}

    def good(k: int) -> bool:
        if k not in tried:
            tried[k] = attempt(steps[k])
        return tried[k].error <= allowed

    if not steps:
        return Search(None, ())
    rungs = sorted({round(i * (len(steps) - 1) / max(1, ladder - 1)) for i in range(ladder)})
    low, high = -1, len(steps)
    for k in rungs:
        if good(k):
            low = k
        else:
            high = k
            break
    for _ in range(narrow):
        if high - low <= 1:
            break
        middle = (low + high) // 2
        low, high = (middle, high) if good(middle) else (low, middle)
    within = [candidate for candidate in tried.values() if candidate.error <= allowed]
    best = max(within, key=lambda c: (c.dropped, -c.error), default=None)
    return Search(best, tuple(sorted(tried.values(), key=lambda c: (c.dropped, c.threshold))))
