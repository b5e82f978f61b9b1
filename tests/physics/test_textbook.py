"""Textbook models against closed forms and direct integrations, at the digits known, in NumPy and native form."""

from __future__ import annotations

import numpy as np
import pytest
from plant import plant

EVERY_METHOD = ("cvode-bdf", "cvode-adams", "lsoda", "radau", "rk45", "vode-adams")


def test_series_rlc_eigenvalues() -> None:
    assert plant("series_rlc.bg").eigenvalues() == pytest.approx([-0.5 - 9.98749218j, -0.5 + 9.98749218j], abs=5e-9)


@pytest.mark.parametrize(
    "time, name, value", [(1.0, "cap.q", -5.259690233766), (1.0, "coil.p", 32.894766173635), (10.0, "cap.q", 0.051746223921)]
)
def test_series_rlc_values(time: float, name: str, value: float) -> None:
    series = plant("series_rlc.bg")
    assert series.numpy_at(time, name) == pytest.approx(value, rel=2e-12, abs=2e-12)
    assert series.native(time, name)[name][-1] == pytest.approx(value, abs=2e-8)


@pytest.mark.parametrize("method", EVERY_METHOD)
def test_series_rlc_by_every_method(method: str) -> None:
    run = plant("series_rlc.bg").native(1.0, method=method, tolerance=1e-9)
    assert run["cap.q"][-1] == pytest.approx(-5.259690233766, abs=2e-5)
    assert run["coil.p"][-1] == pytest.approx(32.894766173635, abs=2e-4)


@pytest.mark.parametrize("current, value", [(0.0, 0.006737947), (2.0, 1.993262053)])
def test_rc(current: float, value: float) -> None:
    assert plant("rc.bg").numpy_at(5.0, "cap.q", current=current) == pytest.approx(value, abs=5e-10)
    assert plant("rc.bg").native(5.0, current=current)["cap.q"][-1] == pytest.approx(value, abs=1e-9)


def test_parallel_rlc_eigenvalues() -> None:
    root = 1j * np.sqrt(3.0) / 2
    assert plant("parallel_rlc.bg").eigenvalues() == pytest.approx([-0.5 - root, -0.5 + root], abs=1e-12)


def test_derivative_causality_through_a_transformer() -> None:
    geared = plant("geared_masses.bg")
    assert len(geared.states) == 2
    assert geared.eigenvalues() == pytest.approx([-2.773500981j, 2.773500981j], abs=5e-10)
    # der(p) = F m1/(m1 + n^2 m2) at rest: the effective mass is 6.5
    p = geared.module.parameters()
    rate = dict(zip(geared.states, geared.module.rhs(0.0, geared.module.initial_state(p), p), strict=True))
    assert 10.0 * 2.0 / rate["mass1.p"] == pytest.approx(6.5, rel=1e-14)
    for time, x in ((0.5, 0.163398286), (1.0, 0.386603146)):
        assert geared.numpy_at(time, "spring.q") == pytest.approx(x, abs=5e-10)
        assert geared.native(time)["spring.q"][-1] == pytest.approx(x, abs=2e-9)


@pytest.mark.parametrize("degrees, period", [(45.0, 2.086255873), (90.0, 2.367841948)])
def test_pendulum_period(degrees: float, period: float) -> None:
    pendulum = plant("pendulum.bg")
    start = np.radians(degrees)
    solution = pendulum.numpy(period, phi0=start)
    phi, w = (pendulum.states.index(name) for name in ("phi", "w.f"))
    # at a quarter of the period the angle is zero; the error of its time is phi over the speed there
    quarter = solution(period / 4)
    assert abs(quarter[phi] / quarter[w]) < 2e-10
    assert solution(period)[phi] == pytest.approx(start, abs=1e-9)
    run = pendulum.native(period, "phi", "w.f", points=4, phi0=start)
    assert abs(run["phi"][1] / run["w.f"][1]) < 1e-8


@pytest.mark.parametrize("degrees, period", [(45.0, 2.086255873), (90.0, 2.367841948)])
def test_pendulum_by_a_constraint(degrees: float, period: float) -> None:
    pendulum = plant("pendulum_constraint.bg")
    assert len(pendulum.model.program.invariants) == 1
    solution = pendulum.numpy(period, phi0=np.radians(degrees))
    x, px = (pendulum.states.index(name) for name in ("x", "mx.p"))
    quarter = solution(period / 4)
    assert abs(quarter[x] / quarter[px]) < 2e-9
    run = pendulum.native(period, "x", "y", "mx.p", points=4, phi0=np.radians(degrees))
    assert abs(run["x"][1] / run["mx.p"][1]) < 1e-7
    assert np.hypot(run["x"], run["y"]) == pytest.approx(np.ones(5), abs=1e-8)


def test_free_body() -> None:
    body = plant("body.bg")
    J = np.array([1.0, 2.0, 3.0])
    wanted = {10.0: (-0.874573438, 0.484996187, 0.505001221), 20.0: (-0.005813837, -1.000033099, 0.008827999)}
    solution = body.numpy(20.0)
    for time, w in wanted.items():
        assert solution(time) / J == pytest.approx(w, abs=2e-9)
    run = body.native(20.0, "w.f", "twice_energy", "spin", points=2)
    for k, w in enumerate(wanted.values(), 1):
        assert [run[f"w.f[{i}]"][k] for i in (1, 2, 3)] == pytest.approx(w, abs=1e-7)
    assert run["twice_energy"] == pytest.approx(2.0004 * np.ones(3), abs=1e-9)
    assert run["spin"] == pytest.approx(2.000249984 * np.ones(3), abs=1e-9)


@pytest.mark.parametrize("precession", [0.843152623, 26.869660298])
def test_heavy_top_precesses_steadily(precession: float) -> None:
    top = plant("top.bg")
    solution = top.numpy(1.0, precession=precession)
    up = [top.states.index(f"up[{i}]") for i in (1, 2, 3)]
    times = np.linspace(0.0, 1.0, 50)
    assert solution(times)[up[2]] == pytest.approx(np.cos(np.pi / 6) * np.ones(50), abs=2e-9)
    # nearby rates nutate
    other = top.numpy(1.0, precession=precession * 1.01)(times)[up[2]]
    assert np.ptp(other) > 1e-5
    run = top.native(1.0, "cosine", precession=precession)
    assert run["cosine"] == pytest.approx(np.cos(np.pi / 6) * np.ones(101), abs=1e-7)


def test_quarter_car() -> None:
    car = plant("quarter_car.bg")
    p = car.module.parameters()
    x0 = dict(zip(car.states, car.module.initial_state(p), strict=True))
    assert (x0["spring.q"], x0["tyre.q"]) == pytest.approx((0.248490203, 0.028990524), abs=5e-10)
    run = car.native(2.0, "tyre.q", "spring.q", "axle.p", "body.p", points=20000, tolerance=1e-12, method="cvode-bdf")
    at_one = [run[name][10000] for name in ("tyre.q", "spring.q", "axle.p", "body.p")]
    assert at_one == pytest.approx((0.026455148, 0.199773012, -39.556441840, -428.036564349), abs=2e-6)
    # the times known were read off a grid: an integration stopped at every kink, at 1e-12, has 1.290335872 and 0.748314873
    high, low = _extreme(run, "spring.q", np.argmax), _extreme(run, "spring.q", np.argmin)
    assert high == pytest.approx((0.349762739, 1.29032), abs=2e-5)
    assert low == pytest.approx((0.108347868, 0.74833), abs=2e-5)
    assert (high[0], low[0]) == pytest.approx((0.349762742306, 0.108347867284), abs=2e-8)
    assert (high[1], low[1]) == pytest.approx((1.290335872, 0.748314873), abs=1e-6)
    assert np.max(run["tyre.q"]) == pytest.approx(0.070146514, abs=2e-8)
    # the greatest upward speed; downward it reaches 1.3548 (at 1 s, above, it is 428.04/320 already)
    assert _extreme(run, "body.p", np.argmax)[0] / 320.0 == pytest.approx(0.990676893, abs=2e-8)


def _extreme(run, name: str, which) -> tuple[float, float]:  # type: ignore[no-untyped-def]
    """The greatest or least value (`which`: np.argmax or np.argmin), and its time: of a parabola through the samples there."""
    k = int(which(run[name]))
    around = slice(k - 2, k + 3)
    middle = float(run.time[k])
    a, b, c = np.polyfit(np.asarray(run.time)[around] - middle, np.asarray(run[name])[around], 2)
    return float(c - b * b / (4 * a)), middle - float(b / (2 * a))


def test_lever_eigenvalues() -> None:
    lever = plant("../../../models/lever_stiff.bg")
    wanted = [-0.98647 + 31.37389j, -5.06978 + 63.51377j]
    found = [value for value in lever.eigenvalues() if value.imag > 0]
    assert sorted(found, key=abs) == pytest.approx(wanted, abs=5e-6)


def test_rc_ladder() -> None:
    k = np.arange(1, 11)
    wanted = -2.0 * (1.0 - np.cos((2 * k - 1) * np.pi / 21))
    assert plant("rc_ladder.bg", "Ladder").eigenvalues().real == pytest.approx(np.sort(wanted), abs=1e-12)


def test_van_der_pol() -> None:
    """Start on the limit cycle (amplitude 2.008619861, at rest): a period later it is there again."""
    oscillator = plant("van_der_pol.bg")
    q, p = (oscillator.states.index(name) for name in ("cap.q", "coil.p"))
    period, amplitude = 6.663286859, 2.008619861
    solution = oscillator.numpy(20 * period, x0=amplitude)
    assert solution(20 * period)[q] == pytest.approx(amplitude, abs=1e-8)
    # at its greatest the flow is zero and falls by x: the time is off by p/x
    assert abs(solution(period)[p] / amplitude) < 1e-8
    run = oscillator.native(period, points=4, x0=amplitude)
    assert run["cap.q"][-1] == pytest.approx(amplitude, abs=1e-7)


def test_gyrator_makes_an_inertia_of_a_compliance() -> None:
    turned, direct = plant("gyrator.bg", "ThroughGyrator"), plant("gyrator.bg", "Direct")
    times = np.linspace(0.0, 10.0, 60)
    one = turned.numpy(10.0)(times)[turned.states.index("spring.q")]
    other = direct.numpy(10.0)(times)[direct.states.index("spring.q")]
    assert one == pytest.approx(other, abs=1e-10)


def test_activity_under_a_sinusoid() -> None:
    """Per period: R pi E F/w; I and C 2 E F/w, with the amplitudes E and F of effort and flow."""
    model = plant("sinusoid.bg")
    F, w, R, L, C = 3.0, 2.0, 5.0, 0.7, 0.2
    period = 2 * np.pi / w
    run = model.native(period, "load.power", "cap.power", "coil.power", points=20000)
    found = [np.trapezoid(np.abs(run[name]), run.time) for name in ("load.power", "cap.power", "coil.power")]
    # the capacitor's charge starts at 0 and stays on one side: its effort swings about F/(w C), so that |e f| is 2 F/(w C) F over half ...
    swing = F / (w * C)
    t = np.asarray(run.time)
    capacitor = np.trapezoid(np.abs(swing * (1 - np.cos(w * t)) * F * np.sin(w * t)), t)
    assert found[0] == pytest.approx(np.pi * R * F * F / w, rel=1e-6)
    assert found[1] == pytest.approx(capacitor, rel=1e-6)
    assert found[2] == pytest.approx(2 * w * L * F * F / w, rel=1e-6)
