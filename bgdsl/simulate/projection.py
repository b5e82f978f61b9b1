"""Invariants of a program (constraints that index reduction differentiated) kept by projection; the arithmetic is a kernel's.

Only storage states (momenta and displacements) are moved where that is enough: positions stay what the integrator makes them.
"""

from __future__ import annotations

import ctypes
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import TYPE_CHECKING, Any

from bgdsl.diagnostics import Code, Reporter
from bgdsl.expr import Expr
from bgdsl.ir.native import CompiledModel, Kernel
from bgdsl.ir.program import Program, Sparse
from bgdsl.simulate.addresses import Addresses
from bgdsl.simulate.failures import IntegrationError
from bgdsl.simulate.inputs import InputSignals
from bgdsl.simulate.kernels.compiler import KERNELS
from bgdsl.simulate.kernels.project import Projection
from bgdsl.simulate.once import once_for_program
from bgdsl.simulate.options import Options
from bgdsl.simulate.sparse import elimination_order

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Ints = NDArray[np.int32]

INCONSISTENT = Code("BG623", "the start violates a constraint")
MOST_AT_START = 1e-6
"""How far, relatively, a start may be from a constraint before it counts as wrong; what is less is moved onto it."""
SETTLING = 8
"""Newton steps towards a start on the constraints, of which most are linear in what moves."""
ROUNDING = 1e-12
"""What the terms of the largest constraint may leave in one of which all terms should vanish."""


class Invariants:
    """The projection of one run. `record` is what the kernels read and write."""

    def __init__(self, model: CompiledModel, options: Options, inputs: InputSignals):
        import numpy as np

        program = model.program
        self._model, self._inputs = model, inputs
        layout = _layout(program)
        m, n, entries = len(program.invariants), len(program.states), len(layout.slopes)
        numbers = {"values": m, "g": m, "gradient": entries, "weights": len(layout.arrays["states"]), "matrix": m * m}
        numbers |= {"sizes": m, "move": m, "spread": m, "before": n}
        self._arrays: dict[str, Any] = {**layout.arrays, **{name: np.zeros(size) for name, size in numbers.items()}}
        self._addresses = Addresses(model)
        self._kernels: list[Kernel] = [model.evaluator(layout.values), model.evaluator(layout.slopes)]
        self.record = Projection(count=m, columns=numbers["weights"], rtol=options.rtol, atol=options.atol, tolerance=options.drift)
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
        """Move the start onto the constraints: by the little that it may be off, or as far as it takes where states that the user
        gave no start can do it alone. BG623 where they cannot."""
        program = self._model.program
        residuals, shares = self._at_start(t, x)
        if shares.max() > MOST_AT_START and program.unstarted:
            self._settle(t, x)
            residuals, shares = self._at_start(t, x)
        i = int(shares.argmax())
        if shares[i] > MOST_AT_START:
            report.fail(
                INCONSISTENT,
                f"the starts violate {int((shares > MOST_AT_START).sum())} constraint(s): the worst by {residuals[i]:.3g}",
                program.invariants[i][1].span,
                "this has to be zero at the start",
                helps=("choose the starts of the states so that it holds, or leave out some of them: what has no start is solved for",),
            )
        self.apply(t, x)

    def _at_start(self, t: float, x: Floats) -> tuple[Floats, Floats]:
        """The residuals of the invariants, and what share of the sizes of their terms they are."""
        import numpy as np

        self._factorise(ctypes.addressof(self.record), t, x.ctypes.data)
        residuals = np.zeros(len(self._model.program.invariants))
        self._kernels[0](t, x, self._inputs(t), residuals)
        sizes = np.empty_like(residuals)
        sizes[self._arrays["order"]] = self._arrays["sizes"]
        shares = np.abs(residuals) / (sizes + self.record.atol)
        shares[np.abs(residuals) <= ROUNDING * sizes.max()] = 0.0
        return residuals, shares

    def _settle(self, t: float, x: Floats) -> None:
        """Newton steps of least size in the states without a start of their own."""
        import numpy as np

        program = self._model.program
        free = [i for i, record in enumerate(program.states) if record.name in program.unstarted]
        entries = program.invariant_slopes.entries
        kernel = self._model.evaluator([value for _, _, value in entries])
        numbers, residuals = np.zeros(len(entries)), np.zeros(len(program.invariants))
        for _ in range(SETTLING):
            self._kernels[0](t, x, self._inputs(t), residuals)
            kernel(t, x, self._inputs(t), numbers)
            slopes = np.zeros((len(residuals), len(x)))
            for (i, j, _), number in zip(entries, numbers, strict=True):
                slopes[i, j] = number
            if not (np.isfinite(slopes).all() and np.isfinite(residuals).all()):
                return
            x[free] -= np.linalg.lstsq(slopes[:, free], residuals, rcond=1e-10)[0]


@dataclass(frozen=True, slots=True)
class _Layout:
    """What the projection of a program asks for, and the integer arrays of its `Projection`."""

    values: tuple[Expr, ...]
    slopes: tuple[Expr, ...]
    arrays: Mapping[str, Ints]


@once_for_program
def _layout(program: Program) -> _Layout:
    import numpy as np

    m = len(program.invariants)
    columns = _columns([_is_storage(record.name) for record in program.states], program.invariant_slopes)
    if len({i for column in columns.values() for i, _ in column}) < m:
        columns = _columns([True] * len(program.states), program.invariant_slopes)
    coupled: list[set[int]] = [set() for _ in range(m)]
    for column in columns.values():
        rows = {i for i, _ in column}
        for i in rows:
            coupled[i] |= rows
    order = elimination_order(coupled)
    place = {i: k for k, i in enumerate(order)}
    entries = [sorted((place[i], value) for i, value in column) for column in columns.values()]
    arrays = {
        "states": [*columns],
        "starts": [0, *accumulate(map(len, entries))],
        "rows": [row for column in entries for row, _ in column],
        "order": order,
    }
    return _Layout(
        tuple(value for value, _ in program.invariants),
        tuple(value for column in entries for _, value in column),
        {name: np.array(numbers, dtype=np.int32) for name, numbers in arrays.items()},
    )


def _columns(chosen: Sequence[bool], slopes: Sparse) -> Mapping[int, list[tuple[int, Expr]]]:
    """The columns of the chosen states: (invariant, slope)."""
    found: dict[int, list[tuple[int, Expr]]] = defaultdict(list)
    for i, j, value in slopes.entries:
        if chosen[j]:
            found[j].append((i, value))
    return found


def _is_storage(name: str) -> bool:
    """Whether a state is a momentum or displacement of a storage, by its name (`rod.p[2]`, `spring.q`)."""
    return (name[: name.rindex("[")] if name.endswith("]") else name).endswith((".p", ".q"))
