"""Does a reduction still hold under another experiment or other parameters? Which terms would have to come back?

Input        the terms that were dropped, the activities then and now, when a term matters (a callable)
Output       the terms that matter now, with their old and new rho, largest first
"""

from __future__ import annotations

from collections.abc import Callable, Container
from dataclasses import dataclass

from bgdsl.ir.activity import ActivityReport, TermActivity


@dataclass(frozen=True, slots=True)
class Reinstated:
    """A dropped term that is active again."""

    term: int
    junction: str
    name: str
    old: float
    new: float
    place: str


def verify(
    dropped: Container[int], then: ActivityReport, now: ActivityReport, matters: Callable[[TermActivity, TermActivity], bool]
) -> tuple[Reinstated, ...]:
    """The dropped terms that matter now, as told by their records then and now. Both reports are of the same full model."""
    before = then.by_index()
    found = [
        Reinstated(term.index, junction.name, term.name, before[term.index].rho, term.rho, f"{term.span.source.name}:{term.span.line}")
        for junction in now.junctions
        for term in junction.terms
        if term.index in dropped and matters(before[term.index], term)
    ]
    return tuple(sorted(found, key=lambda term: (-term.new, term.term)))
