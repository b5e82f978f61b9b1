"""Rows at the grid of the run: taken from the integrator's dense output, so that recording never limits its steps."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING

from bgdsl.expr import Expr
from bgdsl.ir.native import CompiledModel
from bgdsl.simulate.columns import Column
from bgdsl.simulate.failures import IntegrationError
from bgdsl.simulate.inputs import InputSignals
from bgdsl.simulate.recording import Sink
from bgdsl.simulate.stepper import LastStep

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

CHUNK_NUMBERS = 1_000_000


class Grid:
    """The times start, start + interval, ...; the stop time is the last, whether it fits or not. Or those `given`, from start to stop."""

    def __init__(self, start: float, stop: float, interval: float, given: Sequence[float] | None = None):
        import numpy as np

        self.start, self.stop, self.interval = start, stop, interval
        self.given: Floats | None = None
        if given is not None:
            self.given = np.array(given, dtype=float)
            self.given[[0, -1]] = start, stop
            self.count = len(given)
            return
        whole = math.floor((stop - start) / interval * (1 + 1e-12) + 1e-9)
        self.count = whole + 1 if start + whole * interval >= stop - 1e-9 * interval else whole + 2

    def __getitem__(self, k: int) -> float:
        if self.given is not None:
            return float(self.given[k])
        return self.stop if k >= self.count - 1 else self.start + k * self.interval


class Recorder:
    """Evaluates the columns (and keeps the states where asked to) at each time of the grid, and passes rows on in chunks.

    `adjust` moves interpolated states onto the model's invariants.
    """

    def __init__(self, model: CompiledModel, columns: Sequence[Column], sink: Sink, states: Sink | None, grid: Grid, inputs: InputSignals):
        import numpy as np

        self._values = tuple(column.value for column in columns)
        self.kernel = model.evaluator(self._values)
        self.grid = grid
        self.next = 0
        self.fill = 0
        self.sink, self._states, self._inputs = sink, states, inputs
        self.adjust: Callable[[float, Floats], object] | None = None
        n = len(model.program.states)
        self.capacity = max(2, min(grid.count, CHUNK_NUMBERS // max(1, len(columns) + n)))
        self.times = np.empty(self.capacity)
        self.rows = np.empty((self.capacity, len(columns)))
        self.state_rows = np.empty((self.capacity, n)) if states is not None else np.empty((0, n))

    def follow(self, model: CompiledModel, relax: Callable[[Iterable[Expr]], Sequence[Expr]], inputs: InputSignals) -> None:
        """Evaluate by another model from here on, in which expressions read as `relax` says."""
        self.kernel, self._inputs = model.evaluator(relax(self._values)), inputs

    def first(self, t: float, x: Floats) -> None:
        """The row at the start."""
        self._put(t, x)
        self.next = 1

    def take(self, stepper: LastStep) -> None:
        """The rows within the last step."""
        import numpy as np

        grid = self.grid
        end = self.next
        while end < grid.count and grid[end] <= stepper.t:
            end += 1
        while self.next < end:
            some = min(end, self.next + 1000)
            times = np.array([grid[k] for k in range(self.next, some)])
            for t, x in zip(times.tolist(), stepper.dense(times), strict=True):
                if self.adjust is not None and t < stepper.t:
                    x = np.array(x)
                    self.adjust(t, x)
                self._put(t, x)
            self.next = some

    def _put(self, t: float, x: Floats) -> None:
        import numpy as np

        if self.fill == self.capacity:
            self.flush()
        x = np.ascontiguousarray(x)
        self.times[self.fill] = t
        status = self.kernel(t, x, self._inputs(t), self.rows[self.fill])
        if status:
            raise IntegrationError("what is recorded cannot be evaluated", t, x, status)
        if self._states is not None:
            self.state_rows[self.fill] = x
        self.fill += 1

    def flush(self) -> None:
        """Pass on what has gathered."""
        if not self.fill:
            return
        times, rows, states = (array[: self.fill] for array in (self.times, self.rows, self.state_rows))
        if self.next < self.grid.count:  # what has gathered will be written over
            times, rows, states = times.copy(), rows.copy(), states.copy()
        self.sink.write(times, rows)
        if self._states is not None:
            self._states.write(times, states)
        self.fill = 0
