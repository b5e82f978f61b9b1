"""The certificate of a conditioned model: its power balance leaks exactly the powers of the deleted terms.

Input        ScalarGraph, the dropped terms
Output       expressions over the model's own variables, to be integrated along a run of the conditioned model (kept form)
Establishes  d(stored)/dt = given by sources - taken by resistors + leak
"""

from __future__ import annotations

from collections.abc import Collection

from bgdsl.expr import Expr, add, unary, var
from bgdsl.ir.scalar import ScalarGraph, Term


def leak(scalar: ScalarGraph, dropped: Collection[int]) -> Expr:
    """The power that one-way bonds make out of nothing: what the term that stayed brings in and the deleted one no longer takes out."""
    gone = frozenset(dropped)
    one_way = (t for t in scalar.terms if t.other is not None and t.index not in gone and t.other in gone)
    return add(power(scalar, term) for term in one_way)


def exchanged(scalar: ScalarGraph, dropped: Collection[int]) -> Expr:
    """The power that all elements together give and take, for the leak to be compared with: half the sum of their absolute values."""
    gone = frozenset(dropped)
    acting = (t for t in scalar.terms if t.other is None and t.index not in gone)
    return 0.5 * add(unary("abs", power(scalar, term)) for term in acting)


def power(scalar: ScalarGraph, term: Term) -> Expr:
    """What a term brings into its junction: sign x common x conjugate."""
    value = var(scalar.junctions[term.junction].variable) * term.conjugate
    return value if term.sign > 0 else -value
