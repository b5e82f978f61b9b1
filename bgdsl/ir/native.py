"""What an integrator needs of a compiled model, as a protocol: backends provide it, simulation uses it, neither knows the other.

All functions of a model have one C signature, so that integrators call them without Python in between:

    int32_t f(double t, const double *x, const double *u, double *out, void *context)

x: the states (n); u: the inputs in the order of `program.inputs` (may be null where there are none); out: the results;
context: the model's own memory (parameters, constants made of them, warm starts), one per `CompiledModel`, so that two
models never share state. Results are not checked for being finite: that is the integrator's work.

Status: 0 done; k > 0: `program.steps[k - 1]` could not be solved there (a singular linear block, an iteration that did not
converge), a failure that a smaller step may cure.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol

from bgdsl.expr import Expr
from bgdsl.ir.program import Program

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Ints = NDArray[np.int32]


class Kernel(Protocol):
    """One compiled function t, x, u -> out of `size` numbers. It keeps its machine code alive."""

    @property
    def size(self) -> int: ...

    @property
    def address(self) -> int:
        """Where the C function is; 0 where there is none (then it must be called as Python, see `__call__`)."""
        ...

    def __call__(self, t: float, x: Floats, u: Floats, out: Floats) -> int:
        """Fill `out` (contiguous float64) and return the status."""
        ...


class CompiledModel(Protocol):
    """A program as machine code (or anything that acts alike)."""

    @property
    def program(self) -> Program: ...

    @property
    def context(self) -> int:
        """The address to pass as `context`; fixed for the life of the model."""
        ...

    def set_parameters(self, values: Floats) -> int:
        """Take new values of all scalar parameters (`parameter_names(program)`), redo what depends on them alone; a status."""
        ...

    @property
    def rhs(self) -> Kernel:
        """dx/dt, n numbers."""
        ...

    @property
    def jacobian(self) -> Kernel:
        """The values of the sparse Jacobian of `rhs` by x in the order of `pattern`; compiled when first asked for."""
        ...

    @property
    def pattern(self) -> tuple[Ints, Ints]:
        """The Jacobian's structure in compressed columns: (column pointers (n + 1), row indices, ascending in a column)."""
        ...

    def evaluator(self, expressions: Sequence[Expr]) -> Kernel:
        """A function that gives these expressions (over parameters, states, inputs, time and the steps' variables)."""
        ...

    def variant(self, program: Program) -> CompiledModel:
        """Another program, compiled by the same means."""
        ...

    @property
    def residual(self) -> float:
        """The largest residual left by the iteration that failed last; NaN where that says nothing."""
        ...


def parameter_names(program: Program) -> tuple[str, ...]:
    """The scalar names of all parameters and constants in order, arrays row-major: the order of `set_parameters`."""
    return tuple(name for p in program.parameters for name in (p.scalars() if p.shape else (p.name,)))


__all__ = ["CompiledModel", "Kernel", "parameter_names"]
