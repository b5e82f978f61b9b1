"""Matrices that are singular whatever their variables are, and those that only may be."""

from __future__ import annotations

import pytest

from bgdsl.expr import Expr, const, if_else, relation, unary, var
from bgdsl.ir.graph import BondGraph
from bgdsl.passes.moduli import Moduli
from bgdsl.passes.regularity import is_singular
from bgdsl.testing.examples import EXAMPLES

A, B, C, D = (var(name) for name in "abcd")
ONE, TWO = const(1.0), const(2.0)
COS, SIN = unary("cos", A), unary("sin", A)


@pytest.fixture
def graph() -> BondGraph:
    return EXAMPLES["lever"]()


@pytest.mark.parametrize(
    ("rows", "wanted"),
    [
        ([[A, B], [TWO * A, TWO * B]], True),
        ([[COS, SIN], [COS * COS, SIN * COS]], True),
        ([[COS, -SIN], [SIN, COS]], False),
        ([[(A + B) * (A - B) - A * A + B * B]], True),
        ([[const(1e-12) * A]], False),
        ([[A, B, A + B], [C, D, C + D], [TWO, A, TWO + A]], True),
        ([[A, B, A + B], [C, D, C + D], [TWO, A, ONE + A]], False),
        ([[const(1e12), A], [A, const(1e-12)]], False),
        ([[if_else(relation("lt", A, const(5.0)), const(0.0), ONE) * B]], False),
    ],
)
def test_verdicts(graph: BondGraph, rows: list[list[Expr]], wanted: bool) -> None:
    """Products that cancel are found; small numbers, differences of scale and what a condition may change are let through."""
    assert is_singular([dict(enumerate(row)) for row in rows], Moduli(graph)) is wanted


@pytest.mark.parametrize("size", [10, 20, 40])
def test_large_regular_matrices_raise_no_alarm(graph: BondGraph, size: int) -> None:
    """The bounds of round-off grow with every row that is taken off; the numbers do not."""
    rows = [{j: var(f"x{i},{j}") for j in range(size)} for i in range(size)]
    assert not is_singular(rows, Moduli(graph))
    last = {j: rows[0][j] + rows[1][j] for j in range(size)}
    assert is_singular([*rows[:-1], last], Moduli(graph))
