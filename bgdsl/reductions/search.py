"""The smallest model that is accurate enough: thresholds first, then what lies above them term by term.

Input        the levels at which terms fall, how a set of terms is tried (a callable), the largest error allowed
Output       Search      the best candidate, every one tried, and the terms that cost too much
Establishes  each candidate was run; none is accepted by extrapolation; the same trials are made every time

A threshold drops all below it, and one term that hurts ends that. So from the best threshold on, terms are added in the order of
their levels, in blocks that grow while they do no harm; a block that does is halved until the guilty are found, and these stay.
Like terms of an array's elements are one candidate, so that what is written needs few kinds of elements.
"""

from __future__ import annotations

import math
import re
from collections import defaultdict
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from bgdsl.ir.graph import Origin
from bgdsl.ir.scalar import ScalarGraph

LARGEST_BLOCK = 64
"""Families of terms that are tried at once, at most."""

PATIENCE = 32
"""So many families in a row that cost too much end the search: activity tells enough for the rest to be no better."""

LITTLE_PATIENCE, FEW = 4, 12
"""The same for those that are slow to try, and how many trials of them there are at most."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """A reduced model as measured. threshold: its terms lie below; terms: those dropped; states: how many are left; error: the
    largest of its outputs' errors (a fraction, infinite where it could not be run); seconds: what trying it took; spared: how many
    droppable terms below the threshold stay since they cost too much."""

    threshold: float
    terms: frozenset[int]
    states: int
    error: float
    seconds: float
    spared: int = 0

    @property
    def dropped(self) -> int:
        return len(self.terms)

    def as_dictionary(self) -> dict[str, Any]:
        numbers = {"threshold": self.threshold, "dropped": self.dropped, "spared": self.spared, "states": self.states}
        return {**numbers, "error": self.error, "seconds": self.seconds}


@dataclass(frozen=True, slots=True)
class Family:
    """Like terms of the elements of an array, or one term. level: the threshold above which all of them lie below."""

    terms: tuple[int, ...]
    level: float


@dataclass(frozen=True, slots=True)
class Guilty:
    """Terms that stay: dropped too, they (with others, if it was not tried alone) would have made the error `error`."""

    family: Family
    error: float


@dataclass(frozen=True, slots=True)
class Search:
    """best: the one with the most terms dropped within the error allowed; None where even the first step is too much. tried: those
    at thresholds and each further step that was accepted, from full to smallest. guilty: by level. ended: the level at which the
    search lost patience; None where it looked at all terms."""

    best: Candidate | None
    tried: tuple[Candidate, ...]
    guilty: tuple[Guilty, ...] = ()
    ended: float | None = None
    trials: int = 0


Attempt = Callable[[float, frozenset[int]], Candidate]
"""Try the model without these terms, which lie below a threshold."""


def above(level: float) -> float:
    """The least threshold at which a term of this level falls."""
    return math.nextafter(level, math.inf)


def smallest_within(
    levels: Mapping[int, float],
    families: Sequence[Family],
    allowed: float,
    attempt: Attempt,
    *,
    slow: Sequence[Family] = (),
    patience: int = PATIENCE,
    most: float = math.inf,
    progress: Callable[[float], None] | None = None,
) -> Search:
    """The whole search. levels: of every term that may fall; families: the same terms, like ones together, by level. slow: further
    ones, of which few are looked at last. most: so many trials are made (and the few that a block under way still needs, and the last)."""
    thresholds = sorted({above(level) for level in levels.values()})
    first = by_threshold(thresholds, allowed, lambda threshold: attempt(threshold, frozenset(t for t in levels if levels[t] < threshold)))
    growth = _Growth(allowed, attempt, first.best, trials=first.trials, most=most)
    dropped = first.best.terms if first.best is not None else frozenset()
    left = [family for family in families if not dropped.issuperset(family.terms)]
    ended = growth.run(left, patience, progress or (lambda share: None))
    growth.most = growth.trials + FEW
    growth.run(slow, LITTLE_PATIENCE, lambda share: None)
    tried: dict[frozenset[int], Candidate] = {}
    for candidate in sorted((*first.tried, *growth.steps), key=lambda c: (c.dropped, c.threshold)):
        tried.setdefault(candidate.terms, candidate)
    guilty = tuple(sorted(growth.guilty, key=lambda g: (g.family.level, g.family.terms)))
    return Search(growth.best and tried[growth.best.terms], tuple(tried.values()), guilty, ended, growth.trials)


def by_threshold(
    steps: Sequence[float], allowed: float, attempt: Callable[[float], Candidate], *, ladder: int = 8, narrow: int = 6
) -> Search:
    """Try `ladder` of the thresholds (ascending), spread over all, then halve `narrow` times between the last good and the next bad."""
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
    return Search(best, tuple(sorted(tried.values(), key=lambda c: (c.dropped, c.threshold))), trials=len(tried))


@dataclass(slots=True)
class _Growth:
    """The second part: families added to the best candidate so far, in blocks."""

    allowed: float
    attempt: Attempt
    best: Candidate | None
    trials: int
    most: float
    steps: list[Candidate] = field(default_factory=list)
    guilty: list[Guilty] = field(default_factory=list)
    in_a_row: int = 0

    def run(self, families: Sequence[Family], patience: int, progress: Callable[[float], None]) -> float | None:
        """Look at all families; the level at which patience or the trials ended, None if none did."""
        at, size, self.in_a_row = 0, 1, 0
        while at < len(families):
            if self.in_a_row >= patience or self.trials >= self.most:
                return families[at].level
            block = families[at : at + size]
            before = len(self.guilty)
            self.settle(block, None)
            at += len(block)
            progress(at / len(families))
            found = len(self.guilty) - before
            # after a failure the next block is as long as what lay between two guilty ones
            size = min(LARGEST_BLOCK, 2 * size) if not found else max(1, len(block) // (2 * found))
        return None

    def settle(self, block: Sequence[Family], error: float | None) -> bool:
        """Add what can be added of a block. error: what all of it would make, if that is known to be too much. Was all of it added?"""
        if error is None:
            candidate = self.tried(block)
            if candidate.error <= self.allowed:
                self.accept(candidate)
                return True
            error = candidate.error
        if len(block) == 1:
            self.guilty.append(Guilty(block[0], error))
            self.in_a_row += 1
            return False
        half = len(block) // 2
        whole = self.settle(block[:half], None)
        self.settle(block[half:], error if whole else None)  # what is left of a harmful block is harmful
        return False

    def tried(self, block: Sequence[Family]) -> Candidate:
        """The best candidate less the terms of a block."""
        before = self.best.terms if self.best is not None else frozenset()
        threshold = max(above(block[-1].level), self.best.threshold if self.best is not None else 0.0)
        self.trials += 1
        return self.attempt(threshold, before | {t for family in block for t in family.terms})

    def accept(self, candidate: Candidate) -> None:
        if candidate.dropped > (self.best.dropped if self.best is not None else 0):
            self.in_a_row = 0
            self.steps.append(candidate)
            self.best = candidate


# -------------------------------------------------------------------------------------------------------------- families


def families(scalar: ScalarGraph, levels: Mapping[int, float]) -> tuple[Family, ...]:
    """The terms of `levels`, like ones of an array's elements (`cyl[1]` to `cyl[6]`) together, by level."""
    found: dict[Hashable, list[int]] = defaultdict(list)
    for t in sorted(levels):
        found[_likeness(scalar, t)].append(t)
    made = (Family(tuple(terms), max(levels[t] for t in terms)) for terms in found.values())
    return tuple(sorted(made, key=lambda family: (family.level, family.terms)))


def _likeness(scalar: ScalarGraph, t: int) -> Hashable:
    """What a term shares with those that stand for it in the other elements of its array."""
    term = scalar.terms[t]
    junction = scalar.junctions[term.junction]
    seat = junction.members[0][1] if junction.members else junction.name.rpartition(".")[2]
    here = (_place(junction.origin), seat, junction.kind, term.sign)
    return (_place(term.origin), term.component, term.entry, term.port, term.spot, here)


def _place(origin: Origin) -> Hashable:
    """Where a thing is declared, whichever element of an array it is in."""
    span = origin.span
    return (re.sub(r"\[[\d,]+\]", "[]", origin.path), span.source.name, span.start, span.end, origin.link)


def spared(levels: Mapping[int, float], threshold: float, dropped: Iterable[int]) -> frozenset[int]:
    """The terms below a threshold that were not dropped."""
    return frozenset(t for t, level in levels.items() if level < threshold) - frozenset(dropped)
