"""Events, constraints, and the arithmetic under them."""

from __future__ import annotations

import ctypes

import numpy as np
import pytest

from bgdsl import pipeline
from bgdsl.diagnostics import Reporter
from bgdsl.expr import Expr, const, param, unary, var
from bgdsl.simulate.direct import DirectModel
from bgdsl.simulate.kernels import loop  # noqa: F401  (declares all kernels)
from bgdsl.simulate.kernels.compiler import KERNELS
from bgdsl.simulate.kernels.sums import Sums
from bgdsl.simulate.methods import METHODS
from bgdsl.simulate.options import Settings, resolve_options
from bgdsl.simulate.run import simulate
from bgdsl.simulate.sparse import SparseLU
from tests.simulate.models import ball, compiled, friction, make_program
from tests.simulate.test_closed_forms import run

ABOVE_THREE = pytest.mark.parametrize("method", [name for name, method in METHODS.items() if method.order > 3])


@ABOVE_THREE
def test_a_ball_on_a_one_sided_spring(method: str) -> None:
    """Free fall from 1 m, half an oscillation about the spring's sag, and up again: the times are known in closed form."""
    g, k = 9.81, 1e4
    fall = np.sqrt(2 / g)
    w, speed = np.sqrt(k), g * fall
    contact = 2 * (np.pi - np.arctan2(speed * w, g)) / w
    found = run(ball(), method, stop=3.0, points=300, tolerance=1e-9)
    times = [crossing.time for crossing in found.trajectory.crossings]
    assert times[0] == pytest.approx(fall, abs=1e-6)
    assert times[1] - times[0] == pytest.approx(contact, abs=1e-6)
    assert times[2] - times[1] == pytest.approx(2 * fall, abs=5e-6)
    assert [c.rising for c in found.trajectory.crossings[:3]] == [False, True, False]
    assert found.statistics.events == len(times) == 6
    energy = found["v"] ** 2 / 2 + g * found["x"] + k / 2 * np.minimum(found["x"], 0) ** 2
    np.testing.assert_allclose(energy, g, rtol=2e-6)


@pytest.mark.parametrize("method", ["cvode-bdf", "cvode-adams"])
def test_coulomb_friction_slips_and_sticks(method: str) -> None:
    """v' = cos t - sign(v)/2: slips until sin t = t/2, then sticks until the push exceeds the friction at 2 pi/3."""
    found = run(friction(), method, stop=4.0, points=400, tolerance=1e-6)
    t, v = found.time, found["v"]
    stop = 1.895494267
    slipping = t < stop
    np.testing.assert_allclose(v[slipping], np.sin(t[slipping]) - t[slipping] / 2, atol=2e-5)
    sticking = (t > stop + 0.01) & (t < 2 * np.pi / 3)
    assert abs(v[sticking]).max() < 5e-5
    again = t > 2 * np.pi / 3
    np.testing.assert_allclose(v[again], np.sin(t[again]) - np.sin(2 * np.pi / 3) + (t[again] - 2 * np.pi / 3) / 2, atol=5e-5)


def test_rows_are_recorded_on_both_sides_of_an_event() -> None:
    found = run(ball(), stop=1.0, points=1000)
    before = found.time < np.sqrt(2 / 9.81)
    np.testing.assert_allclose(found["x"][before], 1 - 9.81 / 2 * found.time[before] ** 2, atol=1e-7)
    assert (found["F"][before] == 0).all() and found["F"].max() > 100


@ABOVE_THREE
def test_a_constraint_does_not_drift(method: str) -> None:
    """A pendulum in two coordinates, held by a rod: its speed along the rod stays zero, and its length stays."""
    text = """
model Pendulum
  parameter Real m = 1;  parameter Real l = 1;  parameter Real g = 9.81;  parameter Real phi0 = pi/4;
  J1 vx;  I mx(I = m);  J1 vy;  I my(I = m);  Se weight(e = -m*g);
  MTF along_x(m = x/l);  MTF along_y(m = y/l);  J0 stretch;  Sf rod(f = 0);
  Real x(start = l*sin(phi0));  Real y(start = -l*cos(phi0));
equation
  der(x) = vx.f;  der(y) = vy.f;
  vx -> mx;  weight -> vy;  vy -> my;  vx -> along_x -> stretch;  vy -> along_y -> stretch;  rod -> stretch;
end Pendulum;
"""
    system = pipeline.loads(text).compile()
    found = system.simulate(stop=20.0, interval=0.01, tolerance=1e-8, method=method)
    x, y, vx, vy = (found[name] for name in ("x", "y", "vx.f", "vy.f"))
    assert abs(x * vx + y * vy).max() < 1e-8
    assert found.statistics.drift <= 1e-10 and found.statistics.projections >= found.statistics.steps
    assert abs(np.hypot(x, y) - 1).max() < 2e-6
    swings = found.time[:-1][(x[:-1] < 0) & (x[1:] >= 0)]
    assert np.diff(swings).mean() == pytest.approx(2.086255873, abs=2e-3)


# ------------------------------------------------------------------------------------------------------- the arithmetic


@pytest.mark.parametrize("pivoted", [False, True])
@pytest.mark.parametrize(("n", "density"), [(1, 1.0), (7, 0.3), (60, 0.05), (200, 0.02)])
def test_sparse_lu_solves(n: int, density: float, pivoted: bool) -> None:
    from scipy.sparse import random

    jacobian = random(n, n, density, format="csc", random_state=n)
    jacobian.sort_indices()
    values, gamma = jacobian.data.copy(), 0.3
    pointers, rows = jacobian.indptr.astype(np.int32), jacobian.indices.astype(np.int32)
    factors = SparseLU(pointers, rows, (values, gamma) if pivoted else None)
    right = np.random.default_rng(0).random(n)
    solution = np.zeros(n)
    for scale in (1.0, -2.0):  # the pattern serves any numbers
        scaled = values * scale
        assert KERNELS.function("lu_factor")(factors.address, scaled.ctypes.data, gamma) == 0
        KERNELS.function("lu_solve")(factors.address, right.ctypes.data, solution.ctypes.data)
        np.testing.assert_allclose((np.eye(n) - gamma * scale * jacobian.toarray()) @ solution, right, atol=1e-9)


def test_a_vanishing_pivot_is_told_and_cured_by_another_order() -> None:
    """I - J = [0 1; 1 0]: no pivot on the diagonal; partial pivoting finds the order."""
    values, pointers, rows = np.array([1.0, -1.0, -1.0, 1.0]), np.array([0, 2, 4], dtype=np.int32), np.array([0, 1, 0, 1], dtype=np.int32)
    factor, right, solution = KERNELS.function("lu_factor"), np.array([2.0, 3.0]), np.zeros(2)
    assert factor(SparseLU(pointers, rows).address, values.ctypes.data, 1.0) != 0
    pivoted = SparseLU(pointers, rows, (values, 1.0))
    assert factor(pivoted.address, values.ctypes.data, 1.0) == 0
    KERNELS.function("lu_solve")(pivoted.address, right.ctypes.data, solution.ctypes.data)
    np.testing.assert_allclose(solution, [3.0, 2.0])


def test_integrals_of_absolute_cubics_are_exact() -> None:
    """The sums integrate the cubic through four nodes exactly, split at its root, whatever the distances."""
    times = [0.0, 0.3, 0.7, 1.2, 1.5]
    count = 1
    arrays = {name: np.zeros(count) for name in ("totals", "errors", "largest", "added", "doubts", "v0", "v1", "v2", "v3")}
    sums = Sums(terms=count, absolutes=count, **{name: array.ctypes.data for name, array in arrays.items()})
    for t in times:
        ctypes.cast(sums.v3, ctypes.POINTER(ctypes.c_double))[0] = (t - 0.5) * (t + 1) * (t - 2)
        KERNELS.function("absorb")(ctypes.addressof(sums), t)

    def integral(t: float) -> float:
        return t**4 / 4 - 0.5 * t**3 - 1.5 * t**2 / 2 * 1.0 + t  # of (t - 1/2)(t + 1)(t - 2) = t^3 - 1.5 t^2 - 1.5 t + 1

    exact = abs(integral(0.5) - integral(0.0)) + abs(integral(1.5) - integral(0.5))
    assert arrays["totals"][0] == pytest.approx(exact, rel=1e-13)


def test_direct_evaluation_runs_like_machine_code() -> None:
    x: Expr = var("x")
    program = make_program({"x": (0.2, unary("sin", x) * param("a") - x * x * const(0.3))}, parameters={"a": 2.0})
    options = resolve_options(program, None, {}, Settings(stop=3.0, interval=0.1), report=Reporter())
    by_hand, native = simulate(DirectModel(program), options), simulate(compiled(program), options)
    assert by_hand.statistics == native.statistics
    np.testing.assert_allclose(by_hand["x"], native["x"], rtol=1e-12)
