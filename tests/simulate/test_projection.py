"""States moved onto constraints: the smallest move in the norm of the tolerances, of storages alone where these are enough."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bgdsl.diagnostics import Reporter
from bgdsl.expr import Expr, add, const, var
from bgdsl.passes.differentiate import jacobian
from bgdsl.simulate.direct import DirectModel
from bgdsl.simulate.inputs import no_inputs
from bgdsl.simulate.options import resolve_options
from bgdsl.simulate.projection import Invariants
from tests.simulate.models import make_program


def constrained(matrix: np.ndarray, names: list[str], quadratic: float = 0.0) -> Invariants:
    """Constraints G x + quadratic * (G x)^2 = 0 on states of these names, tolerances of 1e-3."""
    rows: list[Expr] = []
    for row in matrix:
        total = add([const(float(g)) * var(name) for g, name in zip(row, names, strict=True) if g != 0.0])
        rows.append(total + const(quadratic) * total * total if quadratic else total)
    program = make_program(dict.fromkeys(names, (0.0, 0.0)), invariants=tuple(rows))
    model = DirectModel(replace(program, differentiate=jacobian))
    options = resolve_options(model.program, report=Reporter())
    return Invariants(model, replace(options, rtol=1e-3, atol=1e-3), no_inputs())


def coupled(seed: int, storages: int = 34) -> tuple[np.ndarray, list[str]]:
    """Twelve constraints in four groups, one storage that most of them read, and some states that are no storages."""
    random = np.random.default_rng(seed)
    matrix = np.where(random.random((12, storages + 4)) < 0.12, random.normal(size=(12, storages + 4)), 0.0)
    for i in range(12):
        matrix[i, i], matrix[i, 12 + i // 3] = 2.0 + random.random(), random.normal()
    matrix[:, storages - 1] = random.normal(size=12)
    matrix[0, storages - 1] = 0.0
    return matrix, [*(f"body[{j}].p" for j in range(storages)), *(f"angle[{j}]" for j in range(4))]


@pytest.mark.parametrize("seed", range(5))
def test_the_move_is_the_smallest(seed: int) -> None:
    matrix, names = coupled(seed)
    invariants = constrained(matrix, names)
    x = np.random.default_rng(seed + 100).normal(size=len(names))
    moved = x.copy()
    invariants.apply(0.0, moved)
    weights = (1e-3 * np.abs(x) + 1e-3) ** 2
    weights[34:] = 0.0  # angles stay
    expected = x - weights * (matrix.T @ np.linalg.solve(matrix * weights @ matrix.T, matrix @ x))
    assert moved == pytest.approx(expected, rel=1e-9, abs=1e-12)
    assert np.abs(matrix @ moved).max() < 1e-9 and invariants.drift <= 1e-10


def test_factors_that_have_aged_are_made_anew() -> None:
    matrix, names = coupled(1)
    invariants = constrained(matrix, names, quadratic=0.3)
    random = np.random.default_rng(3)
    for k in range(20):
        x = 0.02 * (1 + k % 4) * random.normal(size=len(names))
        invariants.apply(0.1 * k, x)
        left = matrix @ x
        assert np.abs(left + 0.3 * left**2).max() <= 1e-9
    assert invariants.drift <= 1e-10


def test_where_storages_are_not_enough_all_states_move() -> None:
    matrix = np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 2.0]])
    invariants = constrained(matrix, ["one.p", "two.p", "angle"])
    x = np.array([1.0, 2.0, 3.0])
    invariants.apply(0.0, x)
    assert np.abs(matrix @ x).max() < 1e-9 and x[2] == pytest.approx(0.0, abs=1e-9)


def test_a_constraint_said_twice_is_passed_over() -> None:
    matrix = np.array([[1.0, -1.0, 0.0], [2.0, -2.0, 0.0], [0.0, 1.0, 1.0]])
    invariants = constrained(matrix, ["one.p", "two.p", "three.p"])
    x = np.array([1.0, 2.0, 3.0])
    invariants.apply(0.0, x)
    assert np.abs(matrix @ x).max() < 1e-9
