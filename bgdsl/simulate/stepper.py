"""What the run asks of an integrator: accepted steps one at a time, and the solution inside the last of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from bgdsl.ir.native import CompiledModel
from bgdsl.simulate.failures import IntegrationError
from bgdsl.simulate.inputs import InputSignals

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]


@dataclass(slots=True)
class Counters:
    """What has been spent so far."""

    steps: int = 0
    rejected: int = 0
    rhs: int = 0
    jacobian: int = 0
    factorisations: int = 0


class LastStep(Protocol):
    """An accepted step: from `t_old` to `t`, where the states are `x`."""

    @property
    def t(self) -> float: ...

    @property
    def t_old(self) -> float: ...

    @property
    def x(self) -> Floats: ...

    def dense(self, times: Floats) -> Floats:
        """The states (k, n) at times (k,) within the step."""
        ...


class Stepper(LastStep, Protocol):
    """An integrator at work; what it is as a `LastStep` is its last one."""

    @property
    def counters(self) -> Counters: ...

    def step(self) -> None:
        """Take one step, never past the stop time. IntegrationError where that cannot be done."""
        ...

    def move(self, x: Floats) -> None:
        """Go on from states that were moved by no more than the tolerance."""
        ...

    def restart(self, t: float, x: Floats) -> None:
        """Begin anew at other states, after an event."""
        ...


class Slopes:
    """The right-hand side as Python calls it; remembers the first place where it was not finite since it last was."""

    def __init__(self, model: CompiledModel, inputs: InputSignals):
        import numpy as np

        self.model = model
        self.inputs = inputs
        self.calls = 0
        self.trouble: tuple[float, Floats, int] | None = None
        self._n = len(model.program.states)
        self._kernel = model.rhs
        self._np = np

    def __call__(self, t: float, x: Floats) -> Floats:
        np = self._np
        self.calls += 1
        out: Floats = np.empty(self._n)
        x = np.ascontiguousarray(x)
        status = self._kernel(t, x, self.inputs(t), out)
        if status or not np.isfinite(out).all():
            if self.trouble is None:
                self.trouble = (t, x.copy(), status)
            if status:
                out.fill(np.nan)
        else:
            self.trouble = None
        return out

    def failure(self, reason: str, t: float, x: Floats, *, collapsed: bool = False) -> IntegrationError:
        """The error to raise: at the place of trouble if there was any, else where the integrator stands."""
        if self.trouble is not None:
            t, x, status = self.trouble
            return IntegrationError(reason, t, x, status)
        return IntegrationError(reason, t, x, collapsed=collapsed)


class SparseJacobian:
    """The exact Jacobian as Python calls it."""

    def __init__(self, model: CompiledModel, inputs: InputSignals):
        import numpy as np

        self.calls = 0
        self._kernel = model.jacobian
        self._inputs = inputs
        self._values = np.zeros(self._kernel.size)
        self._pointers, self._rows = model.pattern
        self._n = len(model.program.states)

    def dense(self, t: float, x: Floats) -> Floats:
        """As a full (n, n) matrix."""
        import numpy as np

        self.calls += 1
        self._kernel(t, np.ascontiguousarray(x), self._inputs(t), self._values)
        full: Floats = np.zeros((self._n, self._n))
        columns = np.repeat(np.arange(self._n), np.diff(self._pointers))
        full[self._rows, columns] = self._values
        return full

    def sparse(self, t: float, x: Floats):  # type: ignore[no-untyped-def]
        """As a scipy CSC matrix."""
        import numpy as np
        from scipy.sparse import csc_matrix

        self.calls += 1
        self._kernel(t, np.ascontiguousarray(x), self._inputs(t), self._values)
        return csc_matrix((self._values.copy(), self._rows, self._pointers), shape=(self._n, self._n))
