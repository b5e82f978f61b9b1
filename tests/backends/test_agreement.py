"""Machine code, the NumPy module and direct evaluation give the same numbers."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bgdsl.backends.native import NativeModel, build
from bgdsl.backends.numpy import write_module
from bgdsl.expr import evaluate
from bgdsl.ir.program import Assign, Program
from tests.backends import programs

numbers = st.floats(-2, 2)


def module_of(program: Program) -> SimpleNamespace:
    """The program's NumPy module, run."""
    space: dict[str, object] = {}
    exec(compile(write_module(program, source_name="made.bg"), "made.py", "exec"), space)
    return SimpleNamespace(**space)


def dense(model: NativeModel, t: float, x: np.ndarray, u: np.ndarray) -> np.ndarray:
    """The machine code's Jacobian as a full matrix."""
    pointers, rows = model.pattern
    values = np.zeros(len(rows))
    assert model.jacobian(t, x, u, values) == 0
    full = np.zeros((len(x), len(x)))
    for j in range(len(x)):
        full[rows[pointers[j] : pointers[j + 1]], j] = values[pointers[j] : pointers[j + 1]]
    return full


def close(a: np.ndarray, b: np.ndarray, tolerance: float = 1e-12) -> bool:
    """Equal to round-off of the largest; not-a-numbers in the same places."""
    a, b = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    finite = np.isfinite(a) & np.isfinite(b)
    scale = max(1.0, np.abs(a[finite]).max(initial=0.0))
    return bool((np.isnan(a) == np.isnan(b)).all() and (np.abs(a[finite] - b[finite]) <= tolerance * scale).all())


@settings(max_examples=30, deadline=None, suppress_health_check=list(HealthCheck))
@given(programs.programs(), st.lists(st.tuples(numbers, numbers), min_size=3, max_size=3), numbers, st.floats(0, 5))
def test_random_programs(program: Program, points: list[tuple[float, float]], u: float, t: float) -> None:
    module, model = module_of(program), build(program)
    p = module.parameters()
    inputs = np.array([u])
    ensemble = np.array(points).T
    together = module.rhs(t, ensemble, p, [u])
    slopes = module.jacobian(t, ensemble, p, {"u": u})
    outputs = model.evaluator([value for _, value in program.outputs])
    for k, point in enumerate(points):
        x = np.array(point)
        native, given_out = np.zeros(2), np.zeros(2)
        assert model.rhs(t, x, inputs, native) == 0
        assert outputs(t, x, inputs, given_out) == 0
        single = module.rhs(t, list(point), p, [u])
        assert close(native, single), (native, single)
        assert close(together[:, k], single)
        assert close(given_out, module.outputs(t, x, p, [u]))
        full = module.jacobian(t, x, p, [u])
        assert close(dense(model, t, x, inputs), full, 1e-10)
        assert close(slopes[..., k], full, 1e-10)


def test_against_direct_evaluation() -> None:
    program = programs.loops()
    model = build(program)
    x = np.array([0.7, 1.0])
    values = {"m": 2.0, "k": 6.0, "x": 0.7, "v": 1.0}
    for step in program.steps[:2]:
        assert isinstance(step, Assign)
        values[step.variable] = evaluate(step.value, values, tables=program.tables)
    z = np.linalg.solve([[2.0, 1.0], [0.7, 2.0]], [1.0, values["b"]])
    c = np.linalg.solve([[2.0, 1.0, 0.0], [1.0, 6.0, 2.0], [0.0, 2.0, 12.0]], [z[0], 1.0, 0.7])
    w = next(r.real for r in np.roots([1, 0, 1, -(1.0 + z[0])]) if abs(r.imag) < 1e-12)
    low, high = -10.0, 10.0
    for _ in range(200):
        middle = (low + high) / 2
        low, high = (middle, high) if middle + math.tanh(middle * w) - c[1] < 0 else (low, middle)
    wanted = [0.5, values["b"] + z[1] + w + w**3 + w + c[2] * low]
    out = np.zeros(2)
    assert model.rhs(0.0, x, x, out) == 0
    assert out == pytest.approx(wanted, rel=1e-13)
    assert module_of(program).rhs(0.0, x, {"m": 2.0, "k": 6.0}) == pytest.approx(wanted, rel=1e-13)


def test_jacobian_is_the_derivative_of_rhs() -> None:
    program = programs.loops()
    model, module = build(program), module_of(program)
    p = module.parameters()
    x, h = np.array([0.7, 1.0]), 1e-6
    differences = np.array([(module.rhs(0.0, x + h * e, p) - module.rhs(0.0, x - h * e, p)) / (2 * h) for e in np.eye(2)]).T
    assert dense(model, 0.0, x, x) == pytest.approx(differences, rel=1e-7)
    assert module.jacobian(0.0, x, p) == pytest.approx(dense(model, 0.0, x, x), rel=1e-12)


def test_parameters_change_both_alike() -> None:
    program = programs.loops()
    model, module = build(program), module_of(program)
    x, out = np.array([0.2, -1.0]), np.zeros(2)
    for m in (1.0, 5.0):
        p = module.parameters(m=m)
        assert p == {"m": m, "k": 3 * m}
        assert model.set_parameters(np.array([m, 3 * m])) == 0
        assert model.rhs(0.0, x, x, out) == 0
        assert out == pytest.approx(module.rhs(0.0, x, p), rel=1e-12)
        assert dense(model, 0.0, x, x) == pytest.approx(module.jacobian(0.0, x, p), rel=1e-11)
