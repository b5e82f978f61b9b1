"""A model of this folder in its two compiled forms, as the tests of textbook answers drive it."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

import bgdsl
from bgdsl.pipeline import Model, System

MODELS = Path(__file__).parent / "models"


class Plant:
    """One model: its generated NumPy module and its native runs."""

    def __init__(self, file: str, name: str | None = None, text: str | None = None):
        self.model: Model = bgdsl.load(MODELS / file, name) if text is None else bgdsl.loads(text, name)
        self.system: System = self.model.compile()
        self.module = ModuleType("generated")
        exec(compile(self.system.source, "generated.py", "exec"), self.module.__dict__)
        self.states = [record.name for record in self.model.program.states]

    def numpy(self, stop: float, **changed: Any):  # type: ignore[no-untyped-def]
        """The solution by the NumPy form, dense, at 1e-12."""
        from scipy.integrate import solve_ivp

        p = self.module.parameters(**changed)
        x0 = self.module.initial_state(p)
        return solve_ivp(
            lambda t, x: self.module.rhs(t, x, p), (0.0, stop), x0, method="DOP853", rtol=1e-12, atol=1e-13, dense_output=True
        ).sol

    def numpy_at(self, time: float, variable: str, **changed: Any) -> float:
        return float(self.numpy(time, **changed)(time)[self.states.index(variable)])

    def native(
        self, stop: float, *variables: str, method: str = "cvode-adams", tolerance: float = 1e-11, points: int = 100, **changed: Any
    ):  # type: ignore[no-untyped-def]
        """The run by the native form, recorded at `points` equal intervals."""
        return self.system.simulate(
            stop=stop, interval=stop / points, tolerance=tolerance, method=method, vars=variables or tuple(self.states), **changed
        )

    def jacobian(self, **changed: Any) -> np.ndarray:
        """df/dx at the initial state, from the NumPy form."""
        p = self.module.parameters(**changed)
        return np.asarray(self.module.jacobian(0.0, self.module.initial_state(p), p))

    def eigenvalues(self, **changed: Any) -> np.ndarray:
        return np.sort_complex(np.linalg.eigvals(self.jacobian(**changed)))


@cache
def plant(file: str, name: str | None = None) -> Plant:
    return Plant(file, name)
