"""Models as a user writes them: every compiled form agrees, and what is known of the motion holds."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import bgdsl
from bgdsl.pipeline import System
from bgdsl.simulate.result import Run

HERE = Path(__file__).parent
MODELS = sorted(path.stem for path in HERE.glob("*.bg"))
Floats = np.ndarray


@cache
def system(name: str, model: str | None = None) -> System:
    return bgdsl.load(HERE / f"{name}.bg", model).compile()


@cache
def module(name: str) -> ModuleType:
    made = ModuleType(name)
    exec(compile(system(name).source, f"{name}.py", "exec"), made.__dict__)
    return made


def simulate(name: str, stop: float, *variables: str, **more: object) -> Run:
    return system(name).simulate(stop=stop, interval=stop / 50, tolerance=1e-10, vars=variables, **more)


def points(name: str) -> list[tuple[float, Floats]]:
    """Some times and states: the start, and others near it."""
    generated = module(name)
    x0 = np.asarray(generated.initial_state(generated.parameters()))
    random = np.random.default_rng(1)
    return [(0.0, x0), *((0.13 * k, x0 + 1e-3 * (1 + abs(x0)) * random.normal(size=x0.shape)) for k in (1, 2))]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", MODELS)
def test_forms_agree(name: str) -> None:
    generated, native = module(name), system(name).native
    p, u = generated.parameters(), np.zeros(1)
    pointers, rows = native.pattern
    for t, x in points(name):
        rates, out, values = generated.rhs(t, x, p), np.zeros(len(x)), np.zeros(len(rows))
        assert native.rhs(t, x, u, out) == 0 and native.jacobian(t, x, u, values) == 0
        np.testing.assert_allclose(out, rates, rtol=1e-8, atol=1e-9 * (1 + abs(rates).max()))
        dense = np.zeros((len(x), len(x)))
        for j in range(len(x)):
            dense[rows[pointers[j] : pointers[j + 1]], j] = values[pointers[j] : pointers[j + 1]]
        exact = np.asarray(generated.jacobian(t, x, p))
        size = 1 + abs(exact).max()
        np.testing.assert_allclose(dense, exact, rtol=1e-7, atol=1e-9 * size)
        steps = 1e-6 * (1 + abs(x)) * np.eye(len(x))
        differences = [(generated.rhs(t, x + h, p) - generated.rhs(t, x - h, p)) / (2 * h.max()) for h in steps]
        np.testing.assert_allclose(exact, np.transpose(differences), rtol=1e-3, atol=1e-5 * size)


@pytest.mark.parametrize("name", MODELS)
def test_an_ensemble_is_its_members(name: str) -> None:
    generated = module(name)
    p = generated.parameters()
    (t, first), (_, second), (_, third) = points(name)
    together = np.stack([first, second, third], axis=1)
    for function in (
        generated.rhs,
        generated.outputs,
        lambda *given: generated.bonds(*given)[0],
        lambda *given: generated.bonds(*given)[1],
    ):
        each = np.stack([function(t, member, p) for member in together.T], axis=1)
        np.testing.assert_allclose(function(t, together, p), each, rtol=1e-9, atol=1e-9 * (1 + abs(each).max(initial=0.0)))


def test_slider_crank_keeps_its_energy() -> None:
    run = simulate("slider_crank", 2.0, "j.energy", "p.energy", "w.f")
    total = run["j.energy"] + run["p.energy"]
    np.testing.assert_allclose(total, total[0], rtol=1e-7)
    assert np.ptp(run["w.f"]) > 0.5, "the speed is uneven"


def test_four_bar_closes_and_keeps_its_energy() -> None:
    run = simulate("four_bar", 2.0, "a", "E", "gapx")
    np.testing.assert_allclose(run["E"], run["E"][0], atol=1e-6)
    np.testing.assert_allclose(run["gapx"], 0.0, atol=1e-7)
    # by Lagrange's equations in the angles with a multiplier, integrated at 1e-11
    assert run["a"][-1] == pytest.approx((-4.537753193, 0.246208343, 1.841412155), abs=2e-5)


def test_double_pendulum() -> None:
    run = simulate("double_pendulum", 2.0, "x1", "y1", "x2", "y2")
    # the equations of the two angles, integrated at 1e-11
    assert [run[name][-1] for name in ("x1", "y1", "x2", "y2")] == pytest.approx(
        (-0.257903737, -0.966170618, -0.904424623, -1.234518796), abs=2e-6
    )


@pytest.mark.parametrize("method", ["cvode-bdf", "cvode-adams", "rk45"])
def test_a_rectifier_charges(method: str) -> None:
    """From rest at the zero of its sine: no method takes the voltage for a constant zero."""
    run = system("diode_bridge").simulate(stop=0.05, interval=1e-3, tolerance=1e-8, method=method, vars=["c.e", "D1.f", "D3.f"])
    assert run["c.e"][-1] == pytest.approx(7.3562, abs=5e-4)
    assert run["c.e"].max() == pytest.approx(7.6481, abs=5e-4)
    assert min(run["D1.f"].min(), run["D3.f"].min()) >= -1.001e-9, "reverse current is the saturation current"


def test_iterations_begin_beside_a_singular_guess() -> None:
    run = simulate("root_loops", 1.0, "x", "y", "z")
    np.testing.assert_allclose(np.log(run["x"]) + run["x"], run["z"], atol=1e-12)
    np.testing.assert_allclose(1 / run["y"] + np.sqrt(run["y"]), 3 * run["z"] + 2, atol=1e-10)
