"""A reduction that does not compile is repaired: dropped terms come back, the most active first, until it does.

Input        a decision, how it is written (a callable), how its text is tried (a callable)
Output       the text that compiles, with the decision it was written from
Reports      BG703 where not even the full model's own text can be written
"""

from __future__ import annotations

from collections.abc import Callable

from bgdsl.ir.activity import ActivityReport
from bgdsl.ir.rewrite import Rewrite
from bgdsl.ir.scalar import ScalarGraph
from bgdsl.reductions.condition import Decision, settle
from bgdsl.reductions.source_map import UnwritableError, refuse

Write = Callable[[Decision], tuple[Rewrite, Decision]]
Try = Callable[[str], str | None]


def repaired(scalar: ScalarGraph, report: ActivityReport, decision: Decision, write: Write, trial: Try) -> tuple[Rewrite, Decision]:
    """Write the decision's model; where `trial` says what is wrong with the text, take back an eighth of the dropped terms, the
    most active first, and write again. What came back is in `Decision.reinstated`. BgError where nothing helps."""
    records = report.by_index()
    while True:
        try:
            result, settled = write(decision)
            problem = trial(result.text) if settled.dropped else None
        except UnwritableError as error:
            problem, settled = error.reason, decision
        else:
            if problem is None:
                return result, settled
        if not settled.dropped:
            refuse(scalar.graph, problem)
        order = sorted(settled.dropped, key=lambda t: (-records[t].rho, t))
        decision = settle(scalar, settled.without(order[: max(1, len(order) // 8)]))
