"""Recorded signals between their rows: splines, their rates, settings; the kernel against Python."""

from __future__ import annotations

import ctypes

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from bgdsl import pipeline
from bgdsl.simulate.addresses import Addresses
from bgdsl.simulate.direct import DirectModel
from bgdsl.simulate.inputs import InputSignals, spline_slopes
from bgdsl.simulate.kernels.compiler import KERNELS
from tests.simulate.models import make_program

PIECES = st.lists(st.floats(0.01, 10.0), min_size=1, max_size=30)


def recorded(pieces: list[float], columns: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    time = np.concatenate(([-1.0], -1.0 + np.cumsum(pieces)))
    return time, np.random.default_rng(seed).normal(size=(len(time), columns))


@given(PIECES, st.integers(1, 5), st.integers(0, 10))
def test_slopes_are_those_of_a_cubic_spline(pieces: list[float], columns: int, seed: int) -> None:
    time, values = recorded(pieces, columns, seed)
    spline = CubicSpline(time, values, bc_type="not-a-knot" if len(time) > 3 else "natural")
    slopes, theirs = spline_slopes(time, values), spline(time, 1)
    assert np.abs(slopes - theirs).max() <= 1e-10 * np.abs(theirs).max()


@pytest.mark.parametrize("count", [2, 3, 4, 12])
def test_between_the_rows_the_kernel_and_python_follow_the_spline(count: int) -> None:
    time, values = recorded([0.3, 0.1, 0.7] * 4, 7)
    time, values = time[:count], values[:count]
    spline = CubicSpline(time, values, bc_type="not-a-knot" if count > 3 else "natural")
    settings = np.array([3.0, 4.0])
    inputs = InputSignals(time, values, spline_slopes(time, values), settings, with_rates=True)
    addresses = Addresses(DirectModel(make_program({"x": (1.0, 0.0)})))
    link = addresses.link(inputs)
    u = np.ctypeslib.as_array(ctypes.cast(link.u, ctypes.POINTER(ctypes.c_double)), (16,))
    put = KERNELS.function("set_inputs")
    for t in (*np.linspace(time[0], time[-1], 50), time[1], time[0]):  # back again too
        put(ctypes.addressof(link), t)
        settings[0] += 1.0  # as an event does
        inputs.settings[:] = settings
        expected = np.concatenate([spline(t), spline(t, 1)])
        assert u[:14] == pytest.approx(expected, rel=1e-11, abs=1e-11) and inputs(t)[:14] == pytest.approx(expected, rel=1e-11, abs=1e-11)
        assert u[14] == settings[0] - 1.0 and tuple(inputs(t)[14:]) == tuple(settings)


def test_a_mass_that_an_input_moves_feels_the_slope_of_the_record() -> None:
    system = pipeline.loads(
        """model Shaker
          input Real v;  MSf drive(f = v);  J1 table;  I mass(I = 2);
          output Real force = mass.e;
        equation
          drive -> table;  table -> mass;
        end Shaker;"""
    ).compile()
    assert [record.name for record in system.inputs] == ["v", "der(v)"]
    time = np.linspace(0, 2, 201)
    record = {"time": time, "v": np.sin(3 * time)}
    run = system.simulate(stop=2, interval=0.013, tolerance=1e-8, inputs=record)
    assert np.abs(run["force"] - 6 * np.cos(3 * run.time)).max() < 2e-5  # the spline's error: h^3 in the slope
    told = system.simulate(stop=2, interval=0.01, tolerance=1e-8, inputs={**record, "der(v)": np.full(201, 7.0)})
    assert told["force"] == pytest.approx(14.0)  # what is given is believed
