"""Which expressions may vanish."""

from __future__ import annotations

import pytest

from bgdsl.expr import TIME, Expr, const, param, unary, var
from bgdsl.passes.moduli import Moduli
from bgdsl.testing.graphs import GraphBuilder

x, y = var("x"), var("y")
one, two, zero, sum_of = param("one"), param("two"), param("zero"), param("sum_of")


@pytest.fixture
def moduli() -> Moduli:
    g = GraphBuilder()
    g.parameter("one", 1.0)
    g.parameter("two", param("one") + param("one"))
    g.parameter("zero", 0.0)
    g.parameter("sum_of", param("one") - param("one"))
    return Moduli(g.build())


@pytest.mark.parametrize(
    "expression",
    [
        one,
        two,
        const(-3.0),
        one * two,
        unary("exp", x),
        x * x + 1.0,
        2.0 + unary("cos", x),
        one * unary("exp", TIME),
        1.0 / two,
        -one,
        unary("cosh", x),
        unary("abs", x) + 0.5,
        x ** const(2.0) + 1e-06,
        unary("sqrt", x * x + 4.0),
        one - 3.0,
    ],
    ids=repr,
)
def test_never_vanishes(moduli: Moduli, expression: Expr) -> None:
    assert not moduli.can_vanish(expression)


@pytest.mark.parametrize(
    "expression",
    [
        zero,
        sum_of,
        x,
        unary("cos", x),
        one * unary("sin", x),
        x * x,
        1.0 + unary("cos", x),
        one + unary("cos", x),
        TIME,
        x + y,
        unary("exp", x) - 1.0,
        one - one * 1.0,
        two - 2.0,
        param("unknown"),
    ],
    ids=repr,
)
def test_may_vanish(moduli: Moduli, expression: Expr) -> None:
    assert moduli.can_vanish(expression)


def test_a_cycle_of_parameters_has_no_value() -> None:
    g = GraphBuilder()
    g.parameter("a", param("b") + 1.0)
    g.parameter("b", param("a") + 1.0)
    assert Moduli(g.build()).default("a") is None
