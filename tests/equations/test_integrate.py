"""The energy of a storage: derivative of the integral is the law, zero is at zero."""

import pytest

from bgdsl.expr import Expr, const, evaluate, if_else, param, relation, unary, var
from bgdsl.passes.integrate import integral

Q = var("q")
K = param("k")

LAWS = {
    "linear": K * Q,
    "cubic": K * Q + param("k3") * Q**3.0,
    "product": (Q + K) * (Q - 2.0) * Q,
    "square": K * Q * unary("abs", Q),
    "gap": if_else(relation("lt", Q, K), const(0.0), 50.0 * (Q - K)),
    "beyond": if_else(relation("lt", K, Q), K * Q + 10.0 * (Q - K), K * Q),
    "exponential": K * (unary("exp", Q / 3.0) - 1.0),
    "saturating": unary("tanh", Q / K),
    "sine": K * unary("sin", Q),
    "gas": K / (1.0 + 0.3 * Q) - K,
    "polytropic": K * (1.0 + 0.3 * Q) ** const(-1.4) - K,
    "stiffening": K * Q * (1.0 + Q * Q),
    "dead zone": unary("sign", Q) * (unary("abs", Q) + K) * K,
}


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("q", [-1.7, -0.4, 0.3, 0.7, 0.9, 2.3])
def test_derivative_is_the_law(name: str, q: float) -> None:
    whole = integral(LAWS[name], Q)
    assert isinstance(whole, Expr)
    values = {"k": 0.8, "k3": 2.5}
    h = 1e-5
    slope = (evaluate(whole, {"q": q + h, **values}) - evaluate(whole, {"q": q - h, **values})) / (2 * h)
    assert slope == pytest.approx(evaluate(LAWS[name], {"q": q, **values}), rel=1e-7, abs=1e-7)
    assert evaluate(whole, {"q": 0.0, **values}) == pytest.approx(0.0, abs=1e-15)


def test_unknown_integral_is_none() -> None:
    assert integral(unary("exp", Q * Q), Q) is None
