"""Ideal joints: the multipliers keep every constraint, at states of motion that are not near the start."""

from pathlib import Path

import numpy as np
from evaluate import Direct

import bgdsl
from bgdsl.ir.program import SolveLinear

MODELS = Path(__file__).parent.parent.parent / "models"


def test_ideal_joints_of_the_engine() -> None:
    program = bgdsl.load(MODELS / "engine_ideal.bg").program
    (solve,) = [step for step in program.steps if isinstance(step, SolveLinear)]
    assert len(solve.variables) <= 77, "one tear for a constraint or a dependent storage, no more"
    direct = Direct(program)
    start = direct.initial_state()
    roots = [value for value, _ in program.invariants]

    def residuals(x: np.ndarray, t: float) -> np.ndarray:
        known = direct.variables(x, t, roots)
        return np.array([direct._value(root, known, t) for root in roots])

    assert np.max(np.abs(residuals(start, 0.0))) < 1e-12
    x = start + 0.01 * np.random.default_rng(0).normal(size=len(start)) * (1.0 + np.abs(start))
    rate = direct.rhs(x, 0.1)
    h = 1e-6
    change = (residuals(x + h * rate, 0.1 + h) - residuals(x - h * rate, 0.1 - h)) / (2 * h)
    assert np.max(np.abs(change)) < 1e-10 * np.max(np.abs(rate))
