"""Coulomb friction that sticks, breaks loose and slips, against closed forms; kinks and jumps located by every method."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from bgdsl import pipeline
from bgdsl.expr import const, if_else, param, relation, unary, var
from bgdsl.simulate.direct import DirectModel
from bgdsl.simulate.methods import METHODS
from bgdsl.simulate.modes import find_switches, hold
from bgdsl.simulate.sliding import complementary, independent
from tests.simulate.models import friction, make_program

EVERY = pytest.mark.parametrize("method", METHODS)
ABOVE_THREE = pytest.mark.parametrize("method", [name for name, method in METHODS.items() if method.order > 3])

BLOCK = """
model Block
  parameter Real m = 2;  parameter Real Fc = 3;  parameter Real v0 = 5;  parameter Real rate = 0;
  J1 v;  I mass(I = m, p(start = m*v0));  R table(e = LAW);  Se push(e = rate*time);
  output Real speed = v.f;  output Real friction = table.e;
equation
  push -> v;  v -> mass;  v -> table;
end Block;
"""
LAWS = ("Fc*sign(f)", "if f > 0 then Fc else -Fc", "if f > 0 then Fc else if f < 0 then -Fc else 0", "noEvent(Fc)*sign(f)")


@pytest.fixture(scope="module", params=LAWS)
def block(request: pytest.FixtureRequest) -> pipeline.System:
    return pipeline.loads(BLOCK.replace("LAW", request.param)).compile()


@EVERY
def test_a_sliding_block_stops_and_stays(block: pipeline.System, method: str) -> None:
    """It stops at m v0/Fc = 10/3 s, and then nothing has to be balanced."""
    run = block.simulate(stop=8.0, interval=0.1, method=method)
    stopped = run.time > 10 / 3
    np.testing.assert_allclose(run["speed"], np.maximum(5 - 1.5 * run.time, 0), atol=2e-6)
    assert abs(run["speed"][stopped]).max() < 1e-12 and abs(run["friction"][stopped]).max() < 1e-9
    assert (run["friction"][~stopped] == 3.0).all()
    assert {round(crossing.time, 7) for crossing in run.trajectory.crossings} == {round(10 / 3, 7)}
    assert run.statistics.steps < 1000


@EVERY
def test_a_pushed_block_breaks_loose_at_the_friction_force(block: pipeline.System, method: str) -> None:
    """Under a force of t it rests until t = Fc = 3, the friction being t; then m v = (t - 3)^2/2."""
    run = block.simulate(stop=8.0, interval=0.1, method=method, v0=0.0, rate=1.0)
    np.testing.assert_allclose(run["friction"], np.minimum(run.time, 3.0), atol=1e-9)
    np.testing.assert_allclose(run["table.e"], run["friction"], atol=1e-12)  # evaluated afterwards, from states and modes
    np.testing.assert_allclose(run["speed"], np.maximum(run.time - 3, 0) ** 2 / 4, atol=2e-5)
    assert all(crossing.time == pytest.approx(3.0, abs=1e-9) for crossing in run.trajectory.crossings)
    assert run.statistics.steps < 1000


@EVERY
def test_a_block_on_a_belt_sticks_and_slips(method: str) -> None:
    """Static friction Fs, sliding friction Fc: slips last 2 (pi - atan((Fs - Fc) w/(k v)))/w, sticks 2 (Fs - Fc)/(k v). (The law
    changes over at 1e-8 m/s, which it takes another 1e-4 s to reach.)"""
    text = """
model StickSlip
  parameter Real m = 1;  parameter Real k = 4;  parameter Real Fs = 3;  parameter Real Fc = 2;  parameter Real v = 0.5;
  J1 block;  I mass(I = m);  C spring(C = 1/k);  J0 contact;  Sf belt(f = v);  J1 rub;
  R friction(e = sign(f)*(if abs(f) < 1e-8 then Fs else Fc));
  output Real force = friction.e;
equation
  belt -> contact;  contact -> rub -> friction;  contact -> block;  block -> mass;  block -> spring;
end StickSlip;
"""
    run = pipeline.loads(text).compile().simulate(stop=20.0, interval=0.1, method=method, tolerance=1e-8)
    index = next(k for k, event in enumerate(run._model.program.events) if event.value.op != "add")  # type: ignore[union-attr]
    times = [c.time for c in run.trajectory.crossings if c.event == index]
    stops, starts = times[2::2], times[1::2]
    assert np.subtract(stops[:4], starts[:4]) == pytest.approx(2 * (math.pi - math.atan(1.0)) / 2, abs=3e-4)
    assert np.subtract(starts[1:5], stops[:4]) == pytest.approx(1.0, abs=3e-4)
    assert run["force"].max() == pytest.approx(3.0, abs=0.2)
    assert run.statistics.steps < 2000


def test_three_blocks_on_a_table_between_springs() -> None:
    """The methods agree while contacts stick and slip in turn, and no friction exceeds its bound."""
    text = """
model Three
  parameter Real F[3] = {1, 2, 3};
  J1 a;  J1 b;  J1 c;  I ma(I = 1);  I mb(I = 1);  I mc(I = 1);
  R ra(e = F[1]*sign(f));  R rb(e = F[2]*sign(f));  R rc(e = F[3]*sign(f));
  J0 ab;  J0 bc;  C sab(C = 0.1);  C sbc(C = 0.1);  Se push(e = 8*sin(time));
  output Real f[3] = {ra.e, rb.e, rc.e};  output Real v[3] = {a.f, b.f, c.f};
equation
  push -> a;  a -> ma;  a -> ra;  a -> ab -> b;  ab -> sab;  b -> mb;  b -> rb;  b -> bc -> c;  bc -> sbc;  c -> mc;  c -> rc;
end Three;
"""
    system = pipeline.loads(text).compile()
    runs = [system.simulate(stop=8.0, interval=0.05, tolerance=1e-9, method=method) for method in ("cvode-bdf", "cvode-adams", "rk45")]
    for run in runs:
        assert run.statistics.events == runs[0].statistics.events > 10
        assert run.statistics.steps < 4000
        assert (abs(run["f"]) <= np.array([1, 2, 3]) + 1e-8).all()
        np.testing.assert_allclose(run["v"], runs[0]["v"], atol=2e-6)
    sticking = abs(runs[0]["v"]) < 1e-9
    assert sticking.any(axis=0).all()
    assert len(np.unique(np.round(runs[0]["f"][sticking], 3))) > 10  # at rest the force is what it has to be, not the bound


def test_stacked_blocks_slip_on_each_other_while_the_lower_one_sticks() -> None:
    """The upper block never pulls hard enough to move the lower one: the floor takes just what the upper contact gives."""
    text = """
model Stack
  J1 a;  J1 b;  I ma(I = 1);  I mb(I = 2);  R floor(e = 2*sign(f));  J0 between;  J1 rub;
  R inner(e = if f > 0 then 1.5 else -1.5);  Se push(e = 6*sin(time));
  output Real va = a.f;  output Real vb = b.f;  output Real below = floor.e;  output Real above = inner.e;
equation
  push -> a;  a -> ma;  a -> between;  between -> b;  between -> rub -> inner;  b -> mb;  b -> floor;
end Stack;
"""
    run = pipeline.loads(text).compile().simulate(stop=10.0, interval=0.1)
    assert abs(run["vb"]).max() < 1e-12
    np.testing.assert_allclose(run["below"], run["above"], atol=1e-9)
    loose = math.asin(1.5 / 6)
    early = run.time < 3
    slip = np.where(run.time > loose, 6 * (math.cos(loose) - np.cos(run.time)) - 1.5 * (run.time - loose), 0.0)
    np.testing.assert_allclose(run["va"][early], slip[early], atol=2e-5)


def test_two_brakes_on_one_motion_break_loose_together() -> None:
    """How they share the load is not determined, but they hold until the load exceeds both: at t = 2 + 2*1."""
    text = """
model Two
  J1 a;  I ma(I = 1);  R r1(e = 2*sign(f));  TF t(m = 2);  R r2(e = sign(f));  J1 w;  Se push(e = time);
  output Real v = a.f;  output Real held = r1.e + 2*r2.e;
equation
  push -> a;  a -> ma;  a -> r1;  a -> t -> w -> r2;
end Two;
"""
    run = pipeline.loads(text).compile().simulate(stop=6.0, interval=0.1)
    np.testing.assert_allclose(run["v"], np.maximum(run.time - 4, 0) ** 2 / 2, atol=1e-5)
    np.testing.assert_allclose(run["held"], np.minimum(run.time, 4), atol=1e-8)


def test_runs_of_one_system_do_not_know_of_each_other(block: pipeline.System) -> None:
    first = block.simulate(stop=5.0, interval=0.1)
    other = block.simulate(stop=5.0, interval=0.1, v0=0.0, rate=2.0)
    again = block.simulate(stop=5.0, interval=0.1)
    assert first.statistics == again.statistics
    assert (first.trajectory.values == again.trajectory.values).all()
    np.testing.assert_allclose(other["table.e"], other["friction"], atol=1e-12)  # though another run came in between
    np.testing.assert_allclose(first["table.e"], first["friction"], atol=1e-12)


KINKS = {
    "abs": ("abs(x)", lambda x: np.abs(x)),
    "max": ("max(x, -2*x)", lambda x: np.maximum(x, -2 * x)),
    "min": ("min(x, 3*x)", lambda x: np.minimum(x, 3 * x)),
    "if": ("if x < 0 then -5*x else x", lambda x: np.where(x < 0, -5 * x, x)),
    "jump": ("if x < 0 then 2 else 1", lambda x: np.where(x < 0, 2, 1)),
}


@pytest.mark.parametrize("tolerance", [1e-6, 1e-10])
@pytest.mark.parametrize("kink", KINKS)
@ABOVE_THREE
def test_kinks_and_jumps_cost_no_accuracy(method: str, kink: str, tolerance: float) -> None:
    """x = cos 3t drives y through the kink, eight times."""
    formula, exact = KINKS[kink]
    text = f"""
model Kink
  Real x(start = 1);  Real y(start = 0);
equation
  der(x) = -3*sin(3*time);  der(y) = {formula};
end Kink;
"""
    run = pipeline.loads(text).compile().simulate(stop=8.0, interval=1.0, method=method, tolerance=tolerance)
    crossings = math.pi / 6 + math.pi / 3 * np.arange(8)
    assert [c.time for c in run.trajectory.crossings] == pytest.approx(list(crossings[crossings < 8]), abs=100 * tolerance)
    nodes, weights = np.polynomial.legendre.leggauss(20)
    for end, found in zip(run.time[1:], run["y"][1:], strict=True):
        bounds = [0.0, *crossings[crossings < end], end]
        wanted = sum((b - a) / 2 * (weights @ exact(np.cos(3 * ((a + b) / 2 + (b - a) / 2 * nodes)))) for a, b in pairwise(bounds))
        assert found == pytest.approx(wanted, abs=2000 * tolerance)  # a restart begins at order one


@EVERY
def test_forms_that_end_at_the_switch_are_left_there(method: str) -> None:
    """sqrt(h) has no value below h = 0, where the held form would be asked for it. Empty at 2 (1 - log 2)."""
    text = """
model Tank
  Real h(start = 1);
equation
  der(h) = if h > 0 then -1 - sqrt(h) else -0.5;
end Tank;
"""
    run = pipeline.loads(text).compile().simulate(stop=1.0, interval=0.1, method=method, tolerance=1e-8)
    empty = 2 * (1 - math.log(2))
    assert run.trajectory.crossings[0].time == pytest.approx(empty, abs=2e-6)
    assert run["h"][-1] == pytest.approx(-0.5 * (1 - empty), abs=2e-6)


def test_the_program_with_modes_is_the_program() -> None:
    """Held at the signs that the functions have, it gives the same derivatives."""
    x, v = var("x"), var("v")
    force = unary("sign", v) * 2.0 + if_else(relation("lt", x, const(0.0)), param("k") * x, unary("abs", v))
    program = make_program({"x": (1.0, v), "v": (0.0, -force)}, parameters={"k": 3.0}, events=(v, x))
    held = hold(program, find_switches(program))
    held.program.verify()
    plain, modal = DirectModel(program), DirectModel(held.program)
    for model in (plain, modal):
        model.set_parameters(np.array([3.0]))
    sides = {"v": 0, "x": 1} if held.switches[0].value is v else {"v": 1, "x": 0}
    for state in ((1.0, 2.0), (-1.0, 2.0), (1.0, -2.0), (-0.5, -0.1)):
        side = np.zeros(6)
        side[sides["x"]], side[sides["v"]] = np.sign(state)
        one, other = np.zeros(2), np.zeros(2)
        assert plain.rhs(0.0, np.array(state), np.zeros(0), one) == modal.rhs(0.0, np.array(state), side, other) == 0
        np.testing.assert_allclose(one, other)
    assert [switch.value for switch in find_switches(friction())] == [v]


def test_complementary_values() -> None:
    """One contact within and beyond its bound; two that share a motion; three coupled ones."""
    for load, expected in ((0.5, 0.5), (2.0, 1.0), (-3.0, -1.0)):
        values, inside = complementary(np.array([[-1.0]]), np.array([load]))
        assert values[0] == pytest.approx(expected) and inside == [abs(load) < 1]
    shared = np.array([[-2.0, -2.0], [-4.0, -4.0]])
    values, inside = complementary(shared, np.array([3.0, 6.0]))
    assert values == pytest.approx([0.75, 0.75]) and independent(shared, inside) == [True, False]
    rng = np.random.default_rng(3)
    for _ in range(200):
        root = rng.normal(size=(3, 3))
        matrix, rates = -(root @ root.T + 0.1 * np.eye(3)), 3 * rng.normal(size=3)
        values, inside = complementary(matrix, rates)
        left = rates + matrix @ values
        assert (np.abs(values) <= 1 + 1e-9).all()
        for value, slope, free in zip(values, left, inside, strict=True):
            assert abs(slope) < 1e-8 if free else (abs(value) == 1 and slope * value > -1e-7)
