"""`models/engine.bg` against the hand-written engine: states, initial values, derivatives, and four seconds of running."""

from __future__ import annotations

import csv
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from engine_reference import OUR_NAMES

import bgdsl
from bgdsl.backends.numpy import write_module
from bgdsl.ir.native import parameter_names

HERE = Path(__file__).parent
MODELS = HERE.parent.parent / "models"
sys.path.insert(0, str(HERE.parent.parent / "benchmarks"))
import engine_study  # noqa: E402

CASES = json.loads((HERE / "rhs_check.json").read_text())["cases"]
EACH_CASE = pytest.mark.parametrize("case", CASES, ids=lambda case: case["name"])


@pytest.fixture(scope="module")
def system() -> Any:
    return bgdsl.load(MODELS / "engine.bg", model="Engine").compile()


@pytest.fixture(scope="module")
def order(system: Any) -> list[int]:
    """Where each state of the reference stands in the compiled model."""
    names = [state.name for state in system.states]
    assert sorted(names) == sorted(OUR_NAMES)
    return [names.index(name) for name in OUR_NAMES]


@pytest.fixture(scope="module")
def module(system: Any) -> dict[str, Any]:
    namespace: dict[str, Any] = {}
    exec(compile(write_module(system.program, source_name="engine.bg"), "engine.py", "exec"), namespace)
    return namespace


def test_nothing_is_implicit(system: Any):
    sizes = system.model.sizes()
    assert (sizes["states"], sizes["loops"]) == (261, 0)


def test_initial_values(module: dict[str, Any], order: list[int]):
    with (HERE / "initial_state.csv").open() as file:
        wanted = np.array([float(row["initial_value"]) for row in csv.DictReader(file)])
    found = module["initial_state"](module["parameters"]())[order]
    assert np.allclose(found, wanted, rtol=1e-12, atol=1e-15 * np.max(np.abs(wanted)))


@EACH_CASE
def test_derivatives_of_the_numpy_module(module: dict[str, Any], order: list[int], case: dict[str, Any]):
    x = np.empty(261)
    x[order] = case["y"]
    p = module["parameters"](**({"gas_gain[1]": 0.0} if case["misfire"] else {}))
    wanted = np.array(case["dydt"])
    assert np.max(np.abs(module["rhs"](0.0, x, p)[order] - wanted)) <= 1e-9 * np.max(np.abs(wanted))


@EACH_CASE
def test_derivatives_of_the_machine_code(system: Any, order: list[int], case: dict[str, Any]):
    values = {**system.parameters, **({"gas_gain[1]": 0.0} if case["misfire"] else {})}
    native = system.native
    assert native.set_parameters(np.array([values[name] for name in parameter_names(system.program)])) == 0
    x, found = np.empty(261), np.empty(261)
    x[order] = case["y"]
    assert native.rhs(0.0, x, np.empty(0), found) == 0
    wanted = np.array(case["dydt"])
    assert np.max(np.abs(found[order] - wanted)) <= 1e-9 * np.max(np.abs(wanted))


def test_mount_preload_follows_stiffness_and_ignores_damping(module: dict[str, Any], order: list[int]):
    at = [order[OUR_NAMES.index(f"front_mount.spring.q[{k}]")] for k in (1, 2, 3)]
    start = module["initial_state"](module["parameters"]())[at]
    damped = module["initial_state"](module["parameters"](**{"front_mount.R[3]": 1e5}))[at]
    stiff = module["initial_state"](module["parameters"](**{"front_mount.K[3]": 2 * 1410e3}))[at]
    assert np.array_equal(start, damped)
    assert start == pytest.approx([-2.7270286855554556e-3, 9.48358056e-5, -4.62127357e-3], rel=1e-8)
    assert abs(stiff[2] / start[2] - 0.5) < 0.2


@pytest.fixture(scope="module")
def studies(system: Any) -> dict[str, engine_study.Study]:
    return {experiment: engine_study.study(system, experiment) for experiment in ("balanced", "misfire")}


@pytest.mark.parametrize("experiment", ["balanced", "misfire"])
def test_four_seconds(studies: dict[str, engine_study.Study], experiment: str):
    """Speed within 0.01 %, amplitudes within 0.2 % (2 % below 1 N), energy to 1e-7, no joint opens by 0.025 mm."""
    found = studies[experiment]
    wanted = engine_study.REFERENCE[experiment]
    assert found.orders["DC"][-1] == pytest.approx(wanted["DC"][-1], rel=1e-4)
    above, below = engine_study.largest_error(found, wanted)
    assert above < 2e-3
    assert below < 2e-2
    assert abs(found.unbalanced) < 1e-7 * found.exchanged
    assert max(found.deflections.values()) < 2.5e-5


@pytest.fixture(scope="module")
def ideal() -> Any:
    return bgdsl.load(MODELS / "engine_ideal.bg", model="EngineIdeal").compile()


@pytest.mark.parametrize("experiment", ["balanced", "misfire"])
def test_ideal_joints(ideal: Any, studies: dict[str, engine_study.Study], experiment: str):
    """Components above 20 N within 0.5 % of the springs' (front z at first order of the misfire within 3 %), gaps below 1e-7 m."""
    worst, front, gap, _ = engine_study.ideal_errors(ideal, experiment, studies[experiment])
    assert worst < 5e-3
    assert gap < 1e-7
    if experiment == "misfire":
        assert front < 3e-2


def test_ideal_joints_leave_seven_degrees_of_freedom(ideal: Any):
    """84 velocities; 66 constraints are kept by multipliers, 11 momenta depend on others: 7 are free."""
    causal = ideal.model.causal
    assert 14 * 6 - len(ideal.program.invariants) - len(causal.derivative) == 7


def test_revolute_joints_have_the_papers_279_states(system: Any):
    revolute = bgdsl.load(MODELS / "engine_revolute.bg", model="EngineRevolute").compile()
    assert len(revolute.states) == 279
    one, other = (engine.simulate("balanced", stop=0.2, tolerance=1e-7) for engine in (system, revolute))
    assert one["crank_speed"] == pytest.approx(other["crank_speed"], abs=5e-3)
    assert one["front_mount_force"] == pytest.approx(other["front_mount_force"], abs=2.0)  # of 6.5 kN


def test_the_one_way_coupled_model_is_accurate_for_the_balanced_engine(studies: dict[str, engine_study.Study]):
    one_way = bgdsl.load(MODELS / "engine_owcm.bg", model="EngineOneWay").compile()
    ratio = engine_study.study(one_way, "balanced", joints=False).orders["3"] / studies["balanced"].orders["3"]
    assert min(ratio) > 0.9
    assert max(ratio) < 1.1
