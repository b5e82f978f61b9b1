"""Invariants of a program (constraints that index reduction differentiated) kept by projection; the arithmetic is a kernel's.

Only storage states (momenta and displacements) are moved where that is enough: positions stay what the integrator makes them.
"""

from __future__ import annotations

import ctypes
from typing import TYPE_CHECKING, Any

from bgdsl.diagnostics import Code, Reporter
from bgdsl.ir.native import CompiledModel, Kernel
from bgdsl.simulate.addresses import Addresses
from bgdsl.simulate.failures import IntegrationError
from bgdsl.simulate.inputs import InputSignals
from bgdsl.simulate.kernels.compiler import KERNELS
from bgdsl.simulate.kernels.project import Projection
from bgdsl.simulate.options import Options

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

INCONSISTENT = Code("BG623", "the start violates a constraint")
MOST_AT_START = 1e-6
"""How far, relatively, a start may be from a constraint before it counts as wrong; what is less is moved onto it."""


class Invariants:
    """The projection of one run. `record` is what the kernels read and write."""

    def __init__(self, model: CompiledModel, options: Options, inputs: InputSignals):
        import numpy as np

        program = model.program
        self._model, self._inputs = model, inputs
        m, n = len(program.invariants), len(program.states)
        entries = sorted(program.invariant_slopes.entries, key=lambda entry: (entry[1], entry[0]))
        columns = np.array([j for _, j, _ in entries], dtype=int)
        self._arrays: dict[str, Any] = {
            "starts": np.concatenate(([0], np.cumsum(np.bincount(columns, minlength=n)))).astype(np.int32),
            "rows": np.array([i for i, _, _ in entries], dtype=np.int32),
            "chosen": np.array([_is_storage(record.name) for record in program.states], dtype=np.int32),
            **{name: np.zeros(size) for name, size in (("g", m), ("gradient", len(entries)), ("weights", n), ("sizes", m), ("move", m))},
            "matrix": np.zeros(m * m),
            "before": np.zeros(n),
        }
        if len(np.unique(self._arrays["rows"][self._arrays["chosen"][columns] > 0])) < m:
            self._arrays["chosen"][:] = 1
        self._addresses = Addresses(model)
        self._kernels: list[Kernel] = [
            model.evaluator([value for value, _ in program.invariants]),
            model.evaluator([value for _, _, value in entries]),
        ]
        self.record = Projection(count=m, entries=len(entries), rtol=options.rtol, atol=options.atol, tolerance=options.drift)
        self.record.link = ctypes.addressof(self._addresses.link(inputs))
        self.record.residuals, self.record.slopes = (self._addresses.call(kernel) for kernel in self._kernels)
        for name, array in self._arrays.items():
            setattr(self.record, name, array.ctypes.data)
        self._project = KERNELS.function("project_step")
        self._adjust = KERNELS.function("project")
        self._factorise = KERNELS.function("factorise")

    @property
    def moves(self) -> int:
        """How many accepted steps were looked at."""
        return int(self.record.moves)

    @property
    def drift(self) -> float:
        """The largest relative residual that was left."""
        return float(self.record.drift)

    def apply(self, t: float, x: Floats) -> None:
        """Move x (contiguous) in place. IntegrationError where the tolerance is not reached."""
        if self._project(ctypes.addressof(self.record), t, x.ctypes.data):
            raise self.failure(t, x)

    def adjust(self, t: float, x: Floats) -> None:
        """Move interpolated states as far as it goes."""
        self._adjust(ctypes.addressof(self.record), t, x.ctypes.data)

    def failure(self, t: float, x: Floats) -> IntegrationError:
        """What to raise when a projection failed."""
        return IntegrationError(f"the constraints cannot be kept: a relative residual of {self.record.worst:.3g} is left", t, x.copy())

    def begin(self, t: float, x: Floats, report: Reporter) -> None:
        """Check the start, and move it by the little that it may be off."""
        import numpy as np

        program = self._model.program
        self._factorise(ctypes.addressof(self.record), t, x.ctypes.data)
        residuals = np.zeros(len(program.invariants))
        self._kernels[0](t, x, self._inputs(t), residuals)
        shares = np.abs(residuals) / (self._arrays["sizes"] + self.record.atol)
        i = int(shares.argmax())
        if shares[i] > MOST_AT_START:
            report.fail(
                INCONSISTENT,
                f"the starts violate {int((shares > MOST_AT_START).sum())} constraint(s): the worst by {residuals[i]:.3g}",
                program.invariants[i][1].span,
                "this has to be zero at the start",
                helps=("choose the starts of the states so that it holds",),
            )
        self.apply(t, x)


def _is_storage(name: str) -> bool:
    """Whether a state is a momentum or displacement of a storage, by its name (`rod.p[2]`, `spring.q`)."""
    return (name[: name.rindex("[")] if name.endswith("]") else name).endswith((".p", ".q"))
