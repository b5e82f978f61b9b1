"""Element elimination by activity (Louca and Stein's MORA): keep the elements that make up a share of all activity.

Input        ScalarGraph, ActivityReport, the share to keep
Output       Decision    that drops every term of the elements with the least activity
Establishes  the kept elements' indices add up to at least the share; parasitic elements stay
"""

from __future__ import annotations

from bgdsl.ir.activity import ActivityReport
from bgdsl.ir.scalar import ScalarGraph
from bgdsl.reductions.condition import Decision, parasitic_terms, settle
from bgdsl.reductions.determined import reinstate


def least_active(report: ActivityReport, share: float) -> tuple[str, ...]:
    """The elements that may go while those that stay make up `share` (0 to 1) of the total activity, least active first."""
    gone: list[str] = []
    left = 1.0
    for element in sorted(report.elements, key=lambda element: (element.index, element.name)):
        if left - element.index < share - 1e-12:
            break
        left -= element.index
        gone.append(element.name)
    return tuple(gone)


def eliminate(scalar: ScalarGraph, report: ActivityReport, share: float) -> Decision:
    """The decision to remove the least active elements. What is read stays as an observer; what has to determine a junction comes back."""
    names = set(least_active(report, share))
    stay = parasitic_terms(scalar)
    dropped = frozenset(t.index for t in scalar.terms if t.element in names and t.other is None and t.index not in stay)
    decision = settle(scalar, Decision(1.0 - share, dropped, (), frozenset(), ()))
    return reinstate(scalar, report, decision)
