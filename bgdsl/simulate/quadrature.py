"""Integrals of expressions along a run, following the integrator's own steps, in memory that does not grow with the run.

Each accepted step (its part inside the window) is a panel with the four Lobatto nodes; the integrands are evaluated on the
integrator's dense output. An integrand that is an absolute value is integrated through its signed argument: where that changes
sign between nodes, the cubic through the nodes is split at its roots, so kinks cost no accuracy. Every `STRIDE`-th panel is
done a second time in two halves; the difference, scaled up, estimates the quadrature error (that of the run itself is not in it).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from bgdsl.expr import Expr
from bgdsl.ir.native import CompiledModel
from bgdsl.ir.trajectory import Integrals
from bgdsl.simulate.inputs import InputSignals
from bgdsl.simulate.stepper import Stepper

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

STRIDE = 4

INNER = 5.0**-0.5
NODES = (-1.0, -INNER, INNER, 1.0)
WEIGHTS = (1.0 / 6.0, 5.0 / 6.0, 5.0 / 6.0, 1.0 / 6.0)


@dataclass(frozen=True, slots=True)
class Quadratures:
    """What to integrate; without a window, over the run's own (`Options.window`)."""

    expressions: tuple[Expr, ...]
    window: tuple[float, float] | None = None


class Quadrature:
    """The running integrals."""

    def __init__(self, model: CompiledModel, expressions: Sequence[Expr], window: tuple[float, float], inputs: InputSignals):
        import numpy as np

        signed = tuple(e.args[0] if e.op == "abs" else e for e in expressions)
        self.absolute = np.array([e.op == "abs" for e in expressions], dtype=np.uint8)
        self.kernel = model.evaluator(signed)
        self.window = window
        self._inputs = inputs
        count = len(signed)
        self.totals = np.zeros(count)
        self.errors = np.zeros(count)
        self.smallest = np.full(count, np.inf)
        self.largest = np.full(count, -np.inf)
        self.panels = 0
        self.evaluations = 0
        self._right: tuple[float, Floats] | None = None

    def take(self, stepper: Stepper) -> None:
        """Add the last step's share."""
        a, b = max(stepper.t_old, self.window[0]), min(stepper.t, self.window[1])
        if b <= a:
            return
        left = self._right[1] if self._right is not None and self._right[0] == a else self._values(stepper, [a])[0]
        whole, right = self._panel(stepper, a, b, left)
        if self.panels % STRIDE == 0:
            middle = (a + b) / 2
            first, between = self._panel(stepper, a, middle, left)
            second, _ = self._panel(stepper, middle, b, between)
            self.errors += STRIDE * abs(first + second - whole)
            whole = first + second
        self.totals += whole
        self.panels += 1
        self._right = (b, right)

    def forget(self) -> None:
        """The states were changed from outside: the value at the last step's end is no longer that at the next one's start."""
        self._right = None

    def result(self) -> Integrals:
        return Integrals(self.window, self.totals.copy(), self.errors.copy(), self.smallest.copy(), self.largest.copy(), self.evaluations)

    def _values(self, stepper: Stepper, times: Sequence[float]) -> Floats:
        import numpy as np

        values: Floats = np.empty((len(times), self.kernel.size))
        for t, x, row in zip(times, stepper.dense(np.array(times)), values, strict=True):
            self.kernel(t, np.ascontiguousarray(x), self._inputs(t), row)
        self.evaluations += len(times)
        seen = np.where(self.absolute, np.abs(values), values)
        np.minimum(self.smallest, seen.min(axis=0), out=self.smallest)
        np.maximum(self.largest, seen.max(axis=0), out=self.largest)
        return values

    def _panel(self, stepper: Stepper, a: float, b: float, left: Floats) -> tuple[Floats, Floats]:
        """The integrals over [a, b], and the signed values at b."""
        import numpy as np

        middle, half = (a + b) / 2, (b - a) / 2
        values = np.vstack((left, self._values(stepper, [middle - half * INNER, middle + half * INNER, b])))
        sums = np.array(WEIGHTS) @ values
        changing = self.absolute & (values.min(axis=0) < 0.0) & (values.max(axis=0) > 0.0)
        sums = np.where(self.absolute, np.abs(sums), sums)
        for k in np.flatnonzero(changing):
            sums[k] = absolute_cubic(values[:, k].tolist())
        return half * sums, values[3].copy()


def absolute_cubic(v: Sequence[float]) -> float:
    """The integral over [-1, 1] of |p|, p being the cubic with the values v at the Lobatto nodes."""
    even_out, even_in = (v[0] + v[3]) / 2, (v[1] + v[2]) / 2
    odd_out, odd_in = (v[3] - v[0]) / 2, (v[2] - v[1]) / (2 * INNER)
    c2 = (even_out - even_in) / 0.8
    c0 = even_out - c2
    c3 = (odd_out - odd_in) / 0.8
    c1 = odd_out - c3
    total = 0.0
    for i in range(3):
        a, b = NODES[i], NODES[i + 1]
        start = (((c3 / 4 * a + c2 / 3) * a + c1 / 2) * a + c0) * a
        end = (((c3 / 4 * b + c2 / 3) * b + c1 / 2) * b + c0) * b
        if v[i] * v[i + 1] >= 0.0:
            total += abs(end - start)
            continue
        low, high, r = a, b, a + (b - a) * v[i] / (v[i] - v[i + 1])
        for _ in range(30):
            p = ((c3 * r + c2) * r + c1) * r + c0
            if p * v[i] > 0.0:
                low = r
            else:
                high = r
            slope = (3 * c3 * r + 2 * c2) * r + c1
            step = p / slope if slope != 0.0 else 3.0
            r = r - step
            if abs(step) < 1e-14:
                break
            if not low < r < high:
                r = (low + high) / 2
        between = (((c3 / 4 * r + c2 / 3) * r + c1 / 2) * r + c0) * r
        total += abs(between - start) + abs(end - between)
    return total
