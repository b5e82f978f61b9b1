"""Single laws turned around: the value found satisfies the law; what has no unique inverse is refused."""

import pytest

from bgdsl.expr import Expr, const, evaluate, leaves, param, unary, var
from bgdsl.passes.invert import Refusal, solve_for

E, F = var("e"), var("f")
R, V = param("R"), param("V")


def never(root: Expr) -> bool:
    return any(True for _ in leaves((root,)))


def power(root: Expr, exponent: float) -> Expr:
    return root ** const(exponent)


LAWS = {
    "linear": R * F,
    "offset": 3.0 - F / R + V,
    "turbulent": R * F * unary("abs", F),
    "signed square": unary("sign", F) * power(F, 2.0) * R,
    "signed root": R * unary("sign", F) * unary("sqrt", unary("abs", F)),
    "orifice": R * unary("sign", F) * unary("sqrt", 2.0 * unary("abs", F) / V),
    "orifice as a power": unary("sign", F) * power(unary("abs", F) * 2.0 / V, 0.5) / R,
    "a quotient in a product": R * (V / (F + 10.0)),
    "signed power": R * F * power(unary("abs", F), 0.75),
    "cube": R * power(F, 3.0),
    "diode": R * (unary("exp", F / V) - 1.0),
    "saturation": R * unary("tanh", F / V),
    "hyperbolic": R * unary("sinh", V * F),
    "log": unary("log", F + 10.0),
    "inverse": R / (F + 10.0),
    "arc": unary("atan", F / V),
}


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("f", [-1.3, 0.2, 2.5])
def test_inverse(name: str, f: float) -> None:
    value = solve_for(E, LAWS[name], F, never)
    assert isinstance(value, Expr)
    known = {"R": 0.7, "V": 1.6}
    e = evaluate(LAWS[name], {"f": f, **known})
    assert evaluate(value, {"e": e, **known}) == pytest.approx(f, rel=1e-12)


@pytest.mark.parametrize("law", [R * power(F, 2.0), unary("abs", F), R * unary("cos", F), F * F * R, unary("abs", F) * F * F])
def test_refused(law: Expr) -> None:
    assert isinstance(solve_for(E, law, F, never), Refusal)


@pytest.mark.parametrize("law", [R * F + V * power(F, 3.0), var("m") * F, F + unary("exp", F)])
def test_left_to_numbers(law: Expr) -> None:
    assert solve_for(E, law, F, never) is None
