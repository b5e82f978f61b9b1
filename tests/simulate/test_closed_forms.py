"""Every method against solutions known in closed form, or to many digits."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bgdsl import pipeline
from bgdsl.diagnostics import Reporter
from bgdsl.expr import TIME, param, unary, var
from bgdsl.ir.program import Program
from bgdsl.simulate.methods import METHODS
from bgdsl.simulate.options import Settings, resolve_options
from bgdsl.simulate.quadrature import Quadratures
from bgdsl.simulate.result import Run
from bgdsl.simulate.run import simulate
from tests.simulate.models import compiled, decay, make_program, oscillator, van_der_pol

EVERY = pytest.mark.parametrize("method", METHODS)
ABOVE_THREE = pytest.mark.parametrize("method", [name for name, method in METHODS.items() if method.order > 3])
"""Methods that many digits can be asked of."""


def run(program: Program, method: str = "cvode-bdf", *, stop: float, points: int = 100, tolerance: float = 1e-8, **more: object) -> Run:
    quadratures = more.pop("quadratures", None)
    settings = Settings(stop=stop, interval=stop / points, tolerance=tolerance, method=method)
    options = resolve_options(program, None, more, settings, report=Reporter())  # type: ignore[arg-type]
    return simulate(compiled(program), options, quadratures=quadratures)  # type: ignore[arg-type]


@EVERY
def test_decay(method: str) -> None:
    found = run(decay(), method, stop=5.0, k=2.0)
    assert found.time.shape == (101,) and found.time[-1] == 5.0
    np.testing.assert_allclose(found["y"], 2 * np.exp(-2 * found.time), atol=5e-7)


@EVERY
def test_rows_at_given_times(method: str) -> None:
    times = np.concatenate((np.linspace(0.0, 0.01, 30, endpoint=False), np.linspace(0.01, 3.0, 50)))
    options = resolve_options(
        oscillator(), None, {}, Settings(stop=3.0, tolerance=1e-8, method=method, times=times.tolist()), report=Reporter()
    )
    found = simulate(compiled(oscillator()), options)
    assert found.time.tolist() == times.tolist()
    np.testing.assert_allclose(found["q"], np.cos(2 * found.time), atol=5e-6)


@ABOVE_THREE
def test_oscillator(method: str) -> None:
    found = run(oscillator(), method, stop=10.0)
    np.testing.assert_allclose(found["q"], np.cos(2 * found.time), atol=5e-6)


@EVERY
def test_van_der_pol_period_and_amplitude(method: str) -> None:
    found = run(van_der_pol(), method, stop=40.0, points=40_000, tolerance=1e-9)
    x, t = found["x"], found.time
    rising = np.flatnonzero((x[:-1] < 0) & (x[1:] >= 0))
    crossings = t[rising] - x[rising] * (t[rising + 1] - t[rising]) / (x[rising + 1] - x[rising])
    assert np.diff(crossings)[-1] == pytest.approx(6.663286859, abs=2e-6)
    assert x[t > 20].max() == pytest.approx(2.008619861, abs=2e-6)


@EVERY
def test_activity_of_elements_under_a_sinusoid(method: str) -> None:
    """Per period, a resistor's activity is pi E F / w and a storage's 2 E F / w."""
    w, effort, flow = 3.0, 2.0, 0.5
    resistor = unary("abs", effort * unary("sin", w * TIME) * (flow * unary("sin", w * TIME)))
    storage = unary("abs", effort * unary("sin", w * TIME) * (flow * unary("cos", w * TIME)))
    found = run(oscillator(), method, stop=2 * np.pi / w * 4, quadratures=Quadratures((resistor, storage)))
    integrals = found.trajectory.integrals
    assert integrals is not None
    exact = 4 * effort * flow / w * np.array([np.pi, 2.0])
    np.testing.assert_allclose(integrals.values, exact, rtol=5e-5)
    assert (abs(integrals.values - exact) <= integrals.errors + 1e-7).all(), "the estimate covers the error"
    np.testing.assert_allclose(integrals.largest, [effort * flow, effort * flow / 2], rtol=1e-2)


def test_the_window_limits_integrals() -> None:
    program = decay()
    settings = Settings(stop=4.0, interval=0.1, tolerance=1e-9, window=(1.0, 3.0))
    options = resolve_options(program, None, {}, settings, report=Reporter())
    found = simulate(compiled(program), options, quadratures=Quadratures((var("x"),)))
    assert found.trajectory.integrals is not None
    assert found.trajectory.integrals.values[0] == pytest.approx(np.exp(-1) - np.exp(-3), rel=1e-6)


@EVERY
def test_equal_runs_are_equal(method: str) -> None:
    first, second = run(van_der_pol(), method, stop=5.0), run(van_der_pol(), method, stop=5.0)
    assert first.statistics == second.statistics
    assert (first["x"] == second["x"]).all()


def test_a_stiff_model_takes_few_steps_with_bdf() -> None:
    x, y = var("x"), var("y")
    program = make_program({"x": (1.0, -1e6 * (x - unary("cos", y))), "y": (0.0, param("one"))}, parameters={"one": 1.0})
    found = run(program, "cvode-bdf", stop=10.0, tolerance=1e-6)
    assert found.statistics.steps < 1500
    np.testing.assert_allclose(found["x"][1:], np.cos(found["y"][1:]), atol=1e-5)


def test_a_model_without_states() -> None:
    program = make_program({}, outputs={"y": 2.0 * TIME})
    found = run(program, stop=1.0, points=4)
    np.testing.assert_allclose(found["y"], [0.0, 0.5, 1.0, 1.5, 2.0])


def test_the_last_row_is_the_stop_time() -> None:
    program = decay()
    options = resolve_options(program, None, {}, Settings(stop=1.0, interval=0.3), report=Reporter())
    np.testing.assert_allclose(simulate(compiled(program), options).time, [0.0, 0.3, 0.6, 0.9, 1.0])


def test_any_variable_can_be_looked_at_after_the_run() -> None:
    program = make_program(
        {"x": (1.0, -var("x"))}, outputs={"y": var("x")}, values={"power": 3.0 * var("x") * param("a")}, parameters={"a": 2.0}
    )
    found = run(program, stop=1.0, a=5.0)
    np.testing.assert_allclose(found["power"], 15 * found["y"])
    np.testing.assert_allclose(found["a"], 5.0)


@EVERY
def test_a_source_that_is_zero_at_the_start_is_not_stepped_over(method: str) -> None:
    """y' = cos(w t) - 1 over whole periods: at the start and at the stop nothing seems to happen."""
    pulse = unary("cos", 20 * math.pi * TIME) - 1.0
    found = run(make_program({"y": (0.0, pulse)}), method, stop=10.0)
    np.testing.assert_allclose(found["y"], np.sin(20 * np.pi * found.time) / (20 * np.pi) - found.time, atol=1e-4)


def test_order_three_takes_longer_steps_where_higher_orders_are_unstable() -> None:
    """A stiff spring that rings at 1.6 kHz, a tenth of critically damped, and is moved slowly."""
    text = """
model Ringing
  parameter Real w = 1e4;
  Real q(start = 0);  Real v(start = 20);
equation
  der(q) = v;  der(v) = w^2*(sin(20*time) - q) - 0.2*w*v;
end Ringing;
"""
    system = pipeline.loads(text).compile()
    settings = {"stop": 2.0, "interval": 1e-2, "tolerance": 1e-6, "max_step": 1.0}
    five, three = (system.simulate(method=method, **settings) for method in ("cvode-bdf", "cvode-bdf3"))
    assert three.statistics.steps < 0.4 * five.statistics.steps
    np.testing.assert_allclose(three["q"], np.sin(20 * three.time), atol=5e-4)  # it lags by 2 * 0.1 * 20 / w
