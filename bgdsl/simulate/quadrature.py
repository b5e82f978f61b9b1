"""Integrals of expressions along a run, following the integrator's own steps, in memory that does not grow with the run.

The nodes are the ends of the accepted steps (of those inside the window), where the states are at hand; a step is divided into
equal parts, with nodes on the dense output, where the estimated error asks for it. The arithmetic is that of `kernels/sums.py`. An
integrand that is an absolute value is integrated through its signed argument, so that kinks cost no accuracy. The error estimates
are of the quadrature alone: those of the run itself are not in them.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from bgdsl.expr import Expr
from bgdsl.ir.native import CompiledModel
from bgdsl.ir.trajectory import Integrals
from bgdsl.simulate.failures import IntegrationError
from bgdsl.simulate.inputs import InputSignals
from bgdsl.simulate.kernels.compiler import KERNELS
from bgdsl.simulate.kernels.loop import COARSE, FINE, MOST_PARTS
from bgdsl.simulate.kernels.sums import Sums
from bgdsl.simulate.stepper import LastStep

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Quadratures:
    """What to integrate; without a window, over the run's own (`Options.window`)."""

    expressions: tuple[Expr, ...]
    window: tuple[float, float] | None = None


class Quadrature:
    """The running integrals; `record` is what the kernels read and write."""

    def __init__(self, model: CompiledModel, expressions: Sequence[Expr], window: tuple[float, float], inputs: InputSignals):
        import numpy as np

        order = sorted(range(len(expressions)), key=lambda k: expressions[k].op != "abs")  # as the kernels want them
        self._places = np.argsort(order)
        signed = tuple(expressions[k].args[0] if expressions[k].op == "abs" else expressions[k] for k in order)
        count = len(signed)
        self._signed = signed
        self.kernel = model.evaluator(signed)
        self.window = window
        self.parts = 4
        self._inputs = inputs
        self._arrays: dict[str, Any] = {
            "totals": np.zeros(count),
            "errors": np.zeros(count),
            "largest": np.full(count, -np.inf),
            **{name: np.zeros(count) for name in ("added", "doubts", "v0", "v1", "v2", "v3")},
        }
        self._values = np.zeros(count)
        absolutes = sum(e.op == "abs" for e in expressions)
        self.record = Sums(terms=count, absolutes=absolutes, **{name: array.ctypes.data for name, array in self._arrays.items()})
        self._absorb: Any = KERNELS.function("absorb")

    def take(self, stepper: LastStep) -> None:
        """Add the last step's share."""
        import numpy as np

        a, b = max(stepper.t_old, self.window[0]), min(stepper.t, self.window[1])
        if b <= a:
            return
        record = self.record
        record.step_size = record.step_error = 0.0
        parts = self.parts
        fractions = np.arange(1, parts + 1) / parts
        if record.known == 0:
            parts = max(3, parts)
            fractions = np.arange(parts + 1) / parts
        times = a + (b - a) * fractions
        times[-1] = b
        for t, x in zip(times.tolist(), stepper.dense(times), strict=True):
            self._node(t, np.ascontiguousarray(x))
        if record.step_error > COARSE * record.step_size:
            self.parts = min(2 * parts, MOST_PARTS)
        elif record.step_error < FINE * record.step_size:
            self.parts = max(1, self.parts // 2)

    def _node(self, t: float, x: Floats) -> None:
        status = self.kernel(t, x, self._inputs(t), self._values)
        if status:
            raise IntegrationError("the integrands cannot be evaluated", t, x, status)
        ctypes.memmove(self.record.v3, self._values.ctypes.data, self._values.nbytes)
        self._absorb(ctypes.addressof(self.record), t)

    def follow(self, model: CompiledModel, relax: Callable[[Iterable[Expr]], Sequence[Expr]], inputs: InputSignals) -> None:
        """Evaluate by another model from here on, in which expressions read as `relax` says."""
        self.kernel, self._inputs = model.evaluator(relax(self._signed)), inputs

    def forget(self) -> None:
        """The states were changed from outside: start a new row of nodes."""
        self.record.known = 0

    def result(self) -> Integrals:
        values, errors, largest = (self._arrays[name][self._places] for name in ("totals", "errors", "largest"))
        return Integrals(self.window, values, errors, largest, evaluations=int(self.record.evaluations))
