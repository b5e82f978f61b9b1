"""A program as machine code: `ir.native.CompiledModel` by LLVM.

Input        Program
Output       NativeModel, whose kernels are compiled when first asked for
Establishes  kernels have the C signature of `ir.native`; what reads parameters alone is computed when parameters are set
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from bgdsl.backends.initial import parameter_values
from bgdsl.backends.interpret import UnsolvableError, interpret, matrix
from bgdsl.backends.native.elimination import Elimination, eliminate
from bgdsl.backends.native.emit import FIRST, INFO, POINTERS, WARM, Code, emit
from bgdsl.backends.native.jit import Loaded, machine_code, runtime
from bgdsl.backends.native.layout import factor_size
from bgdsl.backends.tape import Names, Tape, linearise, names
from bgdsl.collecting import uncollected
from bgdsl.expr import Expr
from bgdsl.ir.native import parameter_names
from bgdsl.ir.program import Program

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Ints = NDArray[np.int32]

_SIGNATURE = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_double, *(ctypes.c_void_p,) * 4)
_CAPACITY = 1 << 15
LARGE = 5_000
"""Operations beyond which code is compiled without LLVM's optimisations: five times as fast to compile, and, measured on the
engine and on chains, 1.0 to 1.5 times as slow to run."""


@uncollected()
def build(program: Program) -> NativeModel:
    """The program, ready to be compiled piece by piece; its parameters have their defaults."""
    return NativeModel(program)


def parametric_order(tape: Tape, roots: Sequence[int]) -> list[int]:
    """The operations that give these parametric ones, operands first."""
    needed: set[int] = set()
    stack = list(roots)
    while stack:
        k = stack.pop()
        if k not in needed:
            needed.add(k)
            stack += tape.args[k]
    return sorted(needed)


class NativeKernel:
    """One compiled function of a model: its machine code, its constants and its work array."""

    def __init__(self, tape: Tape, code: Code, slot: int, level: int, context: Any, elimination: Elimination | None = None) -> None:
        if code.calls_runtime:
            runtime()
        self.tape = tape
        self.code = code
        self.size = code.size
        self.status = 0
        self._context = context
        self._loaded = Loaded(machine_code(code.text, level))
        self.address = self._loaded.address("f")
        self._call = _SIGNATURE(self.address)
        self._order = parametric_order(tape, [*code.constants, *(k for block, _ in code.factors for _, _, k in block.entries)])
        self._constants = np.zeros(len(code.constants) + 1)
        self._work = np.zeros(code.work + 1)
        self._factors = np.zeros(sum(factor_size(block.size) for block, _ in code.factors) + 1)
        self._array = np.zeros(1 if elimination is None else elimination.size)
        self._plan = np.zeros(1, dtype=np.int32) if elimination is None else elimination.plan
        addresses = (array.ctypes.data for array in (self._constants, self._work, self._factors, self._array))
        for place, address in enumerate((*addresses, self._plan.ctypes.data)):
            context[FIRST + POINTERS * slot + place] = address

    def set_parameters(self, values: Sequence[float]) -> None:
        """Compute the constants. `status` is 0 then, or the number (from 1) of a step that cannot be solved, and results are NaN."""
        self.status = self._computed(values)

    def _computed(self, values: Sequence[float]) -> int:
        results: list[Any] = [math.nan] * len(self.tape.ops)
        try:
            interpret(self.tape, self._order, results, values)
            self._constants[:-1] = [results[k] for k in self.code.constants]
            for block, place in self.code.factors:
                n = block.size
                self._factors[place : place + n * n] = matrix(block, results).ravel()
                if _factor(n, self._factors[place:]):
                    raise UnsolvableError(block.step)
        except UnsolvableError as failure:
            self._constants[:] = math.nan
            self._spoil_factors()
            return failure.step + 1
        return 0

    def _spoil_factors(self) -> None:
        """NaN on the diagonals; the pivots, which are indices, stay in range."""
        for block, place in self.code.factors:
            n = block.size
            self._factors[place : place + factor_size(n)] = 0.0
            self._factors[place : place + n * n : n + 1] = math.nan

    def __call__(self, t: float, x: Floats, u: Floats, out: Floats) -> int:
        return int(self._call(t, x.ctypes.data, u.ctypes.data, out.ctypes.data, ctypes.addressof(self._context)))


def _factor(n: int, array: Floats) -> int:
    routine = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_int64, ctypes.c_void_p, ctypes.c_void_p)(runtime().address("bg_factor"))
    return int(routine(n, array.ctypes.data, array[n * n :].ctypes.data))


class NativeModel:
    """A program, its memory, and its kernels."""

    def __init__(self, program: Program) -> None:
        self.program = program
        self._context = (ctypes.c_void_p * _CAPACITY)()
        self._meaning: Names = names(
            (record.name for record in program.states),
            (record.name for record in program.inputs),
            parameter_names(program),
            program.steps,
        )
        self._info = np.full(4, math.nan)
        self._warm = np.full(self._meaning.iterated + 1, math.nan)
        self._context[INFO] = self._info.ctypes.data
        self._context[WARM] = self._warm.ctypes.data
        self._kernels: list[NativeKernel] = []
        self._evaluators: dict[tuple[Expr, ...], NativeKernel] = {}
        self._values: list[float] = parameter_values(program)

    def variant(self, program: Program) -> NativeModel:
        """Another program as machine code."""
        return build(program)

    @property
    def context(self) -> int:
        return ctypes.addressof(self._context)

    @property
    def residual(self) -> float:
        return float(self._info[0])

    def set_parameters(self, values: Floats) -> int:
        """Take new values of all scalar parameters and forget where iterations ended."""
        new = [float(value) for value in values]
        self._warm[:] = math.nan
        if new != self._values:
            self._values = new
            for kernel in self._kernels:
                kernel.set_parameters(new)
        return max((kernel.status for kernel in self._kernels), default=0)

    @cached_property
    def rhs(self) -> NativeKernel:
        return self._compile(self.program.derivatives, slot=0)

    @cached_property
    def jacobian(self) -> NativeKernel:
        """The values of d(rhs)/dx in the order of `pattern`."""
        with uncollected():
            entries = self.program.jacobian.matrix.entries
            elimination = self._elimination
            if not elimination.blocks:
                return self._compile([value for _, _, value in sorted(entries, key=_column_first)], slot=1, level=0)
            return self._compile([value for _, _, value in entries], slot=1, level=0, elimination=elimination)

    @cached_property
    def _elimination(self) -> Elimination:
        return eliminate(self.program)

    @property
    def pattern(self) -> tuple[Ints, Ints]:
        """Column pointers and row indices of the Jacobian."""
        return self._elimination.pointers, self._elimination.rows

    def evaluator(self, expressions: Sequence[Expr]) -> NativeKernel:
        """A kernel for these expressions; the same ones are compiled once."""
        wanted = tuple(expressions)
        if wanted not in self._evaluators:
            self._evaluators[wanted] = self._compile(wanted, slot=2 + len(self._kernels))
        return self._evaluators[wanted]

    @uncollected()
    def _compile(self, roots: Sequence[Expr], *, slot: int, level: int = 1, elimination: Elimination | None = None) -> NativeKernel:
        tape = linearise(self._meaning, self.program.tables, roots)
        if len(tape.ops) > LARGE:
            level = 0
        kernel = NativeKernel(tape, emit(tape, slot=slot, elimination=elimination), slot, level, self._context, elimination)
        kernel.set_parameters(self._values)
        self._kernels.append(kernel)
        return kernel


def _column_first(entry: tuple[int, int, Expr]) -> tuple[int, int]:
    return entry[1], entry[0]
