"""Events: places where an expression of the model changes sign and the equations change form.

The functions are watched along the integrator's accepted steps; a change of sign is located on the dense output to round-off of
the time, the step is cut there, and the integration starts anew behind it. Assertions of the model are watched with them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from bgdsl.expr import ONE, if_else
from bgdsl.ir.native import CompiledModel
from bgdsl.ir.trajectory import Crossing
from bgdsl.simulate.failures import CHATTERING, VIOLATED, IntegrationError, stop
from bgdsl.simulate.inputs import InputSignals
from bgdsl.simulate.stepper import LastStep

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

CROWD = 200
"""So many events of one function ..."""
CROWDED = 1e-4
"""... within this share of the run are no honest events any more."""


STANDSTILL = 1e-4
"""Less progress than this share of the run in `PATIENCE` steps, of which one in `SPARSE` ends at an event, is chattering; ..."""
COLLAPSE = 1e-7
"""... and less than this in any model is a collapse of the step size."""
PATIENCE = 100_000
SPARSE = 100


class Watch:
    """The event functions of a model, their last values and the crossings found."""

    def __init__(self, model: CompiledModel, inputs: InputSignals, start: float, stop: float, crossings: list[Crossing]):
        import numpy as np

        program = model.program
        self._program = program
        self.count = len(program.events)
        checks = [if_else(check.condition, ONE, -ONE) for check in program.checks]
        self.kernel = model.evaluator([*(event.value for event in program.events), *checks])
        self._inputs = inputs
        self._span = stop - start
        self._values = np.zeros(self.kernel.size)
        self._recent: list[list[float]] = [[] for _ in program.events]
        self.crossings = crossings
        self.sense: Callable[[int], bool | None] | None = None
        self._milestone = (start, 0, len(crossings))

    @property
    def idle(self) -> bool:
        return self.kernel.size == 0

    def begin(self, t: float, x: Floats) -> None:
        """Take the signs at the start, or after an event."""
        self._values = self._at(t, x)
        self._assert(t)

    def find(self, stepper: LastStep) -> tuple[float, list[int]] | None:
        """The earliest time in the last step at which functions changed sign, and which (k rising, ~k falling); None if none did."""
        import numpy as np

        before, after = self._values, self._at(stepper.t, stepper.x)
        changed = np.flatnonzero(before[: self.count] * after[: self.count] < 0.0)
        if not len(changed):
            # a function that was exactly zero takes its sign from where it went
            self._values = after
            self._assert(stepper.t)
            return None
        found = [(self._locate(stepper, int(k), before[k]), int(k)) for k in changed]
        t = min(time for time, _ in found)
        return t, [k if before[k] < 0.0 else ~k for time, k in sorted(found) if time <= t + 1e-12 * self._span]

    def note(self, t: float, k: int, rising: bool) -> None:
        """Record a crossing; RunError when this function's events crowd."""
        sense = self.sense(k) if self.sense is not None else None
        rising = rising if sense is None else sense
        self.crossings.append(Crossing(float(t), k, rising))
        recent = self._recent[k]
        recent.append(t)
        if len(recent) > CROWD:
            del recent[0]
            if recent[-1] - recent[0] < CROWDED * self._span:
                self._chatters(t, k, f"{CROWD} within {recent[-1] - recent[0]:.3g} s")

    def pace(self, t: float, x: Floats, steps: int) -> None:
        """Stop a run that hardly moves: RunError where it chatters about an event, IntegrationError otherwise."""
        import numpy as np

        since, before, crossed = self._milestone
        if steps - before < PATIENCE:
            return
        progress = (t - since) / self._span
        self._milestone = (t, steps, len(self.crossings))
        if progress < STANDSTILL and len(self.crossings) - crossed > (steps - before) / SPARSE:
            self._chatters(t, int(np.abs(self._at(t, x)[: self.count]).argmin()), f"{steps - before} steps within {t - since:.3g} s")
        if progress < COLLAPSE:
            raise IntegrationError("the step size collapsed", t, x.copy(), collapsed=True)

    def _chatters(self, t: float, k: int, how: str) -> None:
        event = self._program.events[k]
        stop(
            CHATTERING,
            f"events follow each other without end at t = {t:.9g} s: {how}",
            event.origin,
            "changes form here",
            t,
            helps=("the law jumps back and forth; replace the jump by a steep but continuous law, `tanh(v/v0)` for `sign(v)`",),
        )

    def _at(self, t: float, x: Floats) -> Floats:
        import numpy as np

        values: Floats = np.empty(self.kernel.size)
        status = self.kernel(t, np.ascontiguousarray(x), self._inputs(t), values)
        if status:
            raise IntegrationError("the event functions cannot be evaluated", t, x, status)
        return values

    def _assert(self, t: float) -> None:
        for check, value in zip(self._program.checks, self._values[self.count :], strict=True):
            if value < 0.0:
                stop(VIOLATED, f"{check.message} (t = {t:.9g} s)", check.origin, "does not hold", t)

    def _locate(self, stepper: LastStep, k: int, before: float) -> float:
        """Bisection with secant steps (Illinois) on the dense output; the time just behind the change."""
        import numpy as np

        def value(t: float) -> float:
            return float(self._at(t, stepper.dense(np.array([t]))[0])[k])

        a, b = stepper.t_old, stepper.t
        fa, fb = before, value(b)
        if fa * fb > 0.0:
            return b
        for _ in range(100):
            if b - a <= 4e-16 * max(abs(a), abs(b), self._span):
                break
            t = b - fb * (b - a) / (fb - fa)
            if not a < t < b:
                t = (a + b) / 2
            ft = value(t)
            if ft * before > 0.0:
                a, fa = t, ft
                fb /= 2
            else:
                b, fb = t, ft
                fa /= 2
                if ft == 0.0:
                    break
        return b
