"""A reduction that does not compile is repaired: dropped terms come back, the most active first, until it does.

Input        a decision, how it is written (a callable), how its text is tried (a callable)
Output       the text that compiles, with the decision it was written from
Reports      BG703 where not even the full model's own text can be written
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

from bgdsl.ir.activity import ActivityReport
from bgdsl.ir.rewrite import Rewrite
from bgdsl.ir.scalar import ScalarGraph
from bgdsl.reductions.condition import Decision, settle
from bgdsl.reductions.source_map import UnwritableError, refuse

Write = Callable[[Decision], Iterable[tuple[Rewrite, Decision]]]
"""The texts of a decision, the best form first, each with the decision as it was written."""

Try = Callable[[str], str | None]


def repaired(scalar: ScalarGraph, report: ActivityReport, decision: Decision, write: Write, trial: Try) -> tuple[Rewrite, Decision]:
    """The decision's model in the best form that compiles. Where `trial` finds a fault in every form, an eighth of the dropped terms
    come back, the most active first, and it is written again: they are in `Decision.reinstated`, the fault in `Decision.fault`.
    BgError where nothing helps."""
    records = report.by_index()
    while True:
        fault, settled = None, decision
        try:
            for result, settled in write(decision):
                found = trial(result.text) if settled.dropped else None
                if found is None:
                    return (result if fault is None else replace(result, reasons=(fault,))), settled
                fault = fault or found
        except UnwritableError as error:
            fault = fault or error.reason
        if fault is None or not settled.dropped:
            refuse(scalar.graph, fault or "it has no form")
        order = sorted(settled.dropped, key=lambda t: (-records[t].rho, t))
        decision = replace(settle(scalar, settled.without(order[: max(1, len(order) // 8)])), fault=fault)
