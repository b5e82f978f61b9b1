"""Does a reduction still hold under another experiment or other parameters? Which terms would have to come back?

Input        the decision the reduced model was written from, the activities then and now
Output       the terms that are active now, with their old and new rho, largest first
"""

from __future__ import annotations

from dataclasses import dataclass

from bgdsl.ir.activity import ActivityReport
from bgdsl.reductions.condition import Decision


@dataclass(frozen=True, slots=True)
class Reinstated:
    """A dropped term that is active again."""

    term: int
    junction: str
    name: str
    old: float
    new: float
    place: str


def verify(decision: Decision, then: ActivityReport, now: ActivityReport) -> tuple[Reinstated, ...]:
    """The terms dropped at the decision's threshold whose rho is not below it now. Both reports are of the same full model."""
    before = then.by_index()
    found = [
        Reinstated(term.index, junction.name, term.name, before[term.index].rho, term.rho, f"{term.span.source.name}:{term.span.line}")
        for junction in now.junctions
        for term in junction.terms
        if term.index in decision.dropped and term.rho >= decision.threshold
    ]
    return tuple(sorted(found, key=lambda term: (-term.new, term.term)))
