"""Where runs begin: starts by state, by co-energy, by dependent storages, by initial equations."""

from typing import Any

import pytest
from evaluate import Direct

import bgdsl
from bgdsl.diagnostics import BgError


def starts(text: str, **changed: float) -> dict[str, float]:
    program = bgdsl.loads(text).program
    values = Direct(program, **changed).initial_state()
    return dict(zip((r.name for r in program.states), values.tolist(), strict=True))


def oscillator(mass: str, spring: str, more: str = "") -> str:
    return f"""
model Oscillator
  J1 v;  I m({mass});  C s({spring});  Se weight(e = -9.81);
equation
  weight -> v;  v -> m, s;
{more}
end Oscillator;
"""


def test_given_as_state_or_co_energy() -> None:
    assert starts(oscillator("I = 2, p(start = 3)", "k = 10")) == {"m.p": 3.0, "s.q": 0.0}
    assert starts(oscillator("I = 2, f(start = 3)", "k = 10, e(start = 5)")) == {"m.p": 6.0, "s.q": 0.5}
    assert starts(oscillator("I = 2, f(start = 3)", "C = 10, e(start = 5)")) == {"m.p": 6.0, "s.q": 50.0}


def test_co_energy_of_nonlinear_laws() -> None:
    assert starts(oscillator("I = 2", "e = 10*q*abs(q), e(start = -40)"))["s.q"] == pytest.approx(-2.0, rel=1e-14)
    found = starts(oscillator("I = 2", "e = 10*q + 3*q^3, e(start = 13)"))
    assert found["s.q"] == pytest.approx(1.0, rel=1e-12)


def test_full_matrices() -> None:
    text = """
model Field
  J1[2] v;  I[2] m(I = [2, 1; 1, 3], f(start = {1, 2}));  C[2] s(k = [2, 1; 1, 3], e(start = {4, 7}));
equation
  v => m, s;
end Field;
"""
    found = starts(text)
    assert [found[f"m.p[{i}]"] for i in (1, 2)] == pytest.approx([4.0, 7.0])
    assert [found[f"s.q[{i}]"] for i in (1, 2)] == pytest.approx([1.0, 2.0])


def test_initial_equations() -> None:
    rest = "initial equation\n  der(m.p) = 0;"
    assert starts(oscillator("I = 2, p(start = 1)", "k = 10", rest)) == pytest.approx({"m.p": 1.0, "s.q": -0.981})
    found = starts(oscillator("I = 2", "e = 10*q + 3*q^3", rest + "\n  v.f = 4;"))
    assert found["m.p"] == pytest.approx(8.0)
    assert 10 * found["s.q"] + 3 * found["s.q"] ** 3 == pytest.approx(-9.81, rel=1e-12)


@pytest.mark.parametrize(
    ("start", "wanted"), [("x", 3.0), ("2*v.f", 10.0), ("m.p + z", 19.0), ("time + 1", 1.0), ("z", 9.0)], ids=lambda value: str(value)
)
def test_a_start_that_reads_variables(start: str, wanted: float) -> None:
    text = f"""
model Following
  J1 v;  I m(I = 2, f(start = 5));  R damper(R = 1);
  Real y(start = {start});  Real x(start = 3);  Real z = x^2;
equation
  v -> m, damper;  der(x) = v.f;  der(y) = x;
end Following;
"""
    assert starts(text) == pytest.approx({"m.p": 10.0, "y": wanted, "x": 3.0})
    module: dict[str, Any] = {}
    exec(bgdsl.loads(text).module_text(), module)
    found = module["initial_state"](module["parameters"]())
    assert dict(zip((s.name for s in module["STATES"]), found, strict=True)) == pytest.approx({"m.p": 10.0, "y": wanted, "x": 3.0})


def test_a_start_that_reads_itself() -> None:
    with pytest.raises(BgError, match="BG506"):
        starts(oscillator("I = 2", "k = 10").replace("J1 v;", "J1 v;  Real y(start = y);").replace("m, s;", "m, s;  der(y) = 1;"))


def geared(first: str, second: str) -> str:
    return f"""
model Geared
  J1 a;  I m1(I = 2{first});  TF gear(m = 3);  J1 b;  I m2(I = 0.5{second});
equation
  a -> m1;  a -> gear -> b;  b -> m2;
end Geared;
"""


def test_start_of_a_dependent_storage_reaches_the_state_it_follows() -> None:
    assert starts(geared("", ", f(start = 6)")) == pytest.approx({"m1.p": 4.0})
    assert starts(geared(", f(start = 2)", ", f(start = 6)")) == pytest.approx({"m1.p": 4.0})


def test_starts_that_disagree_are_refused() -> None:
    system = bgdsl.loads(geared(", f(start = 2)", ", f(start = 5)")).compile()
    with pytest.raises(BgError) as caught:
        system.simulate(stop=1.0)
    assert [d.code.number for d in caught.value.diagnostics] == ["BG622"]


def test_a_velocity_that_only_dependent_storages_follow() -> None:
    text = """
model Pendulum
  J1 w;  MTF across(m = cos(phi));  MTF up(m = sin(phi));  J1 vx;  I mx(I = 2, f(start = 3));  J1 vy;  I my(I = 2);
  Real phi(start = 0);
equation
  der(phi) = w.f;
  w -> across -> vx;  vx -> mx;  w -> up -> vy;  vy -> my;
end Pendulum;
"""
    assert starts(text) == pytest.approx({"phi": 0.0, "w.f": 3.0})
