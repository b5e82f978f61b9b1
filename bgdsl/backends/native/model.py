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

from bgdsl.backends.native.emit import FIRST, INFO, WARM, Code, emit
from bgdsl.backends.interpret import UnsolvableError, interpret, matrix
from bgdsl.backends.native.jit import Loaded, machine_code, runtime
from bgdsl.backends.native.layout import factor_size
from bgdsl.backends.tape import Names, Tape, linearise, names
from bgdsl.expr import Expr
from bgdsl.ir.native import parameter_names
from bgdsl.ir.program import Program

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Ints = NDArray[np.int32]

_SIGNATURE = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_double, *(ctypes.c_void_p,) * 4)
_CAPACITY = 4096
LARGE = 60_000
"""Operations beyond which right sides are compiled without optimisation too."""


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

    def __init__(self, tape: Tape, code: Code, slot: int, level: int, context: Any) -> None:
        if "@bg_" in code.text:
            runtime()
        self.tape = tape
        self.code = code
        self.size = code.size
        self._context = context
        self._loaded = Loaded(machine_code(code.text, level))
        self.address = self._loaded.address("f")
        self._call = _SIGNATURE(self.address)
        self._order = parametric_order(tape, [*code.constants, *(k for block, _ in code.factors for _, _, k in block.entries)])
        self._constants = np.zeros(len(code.constants) + 1)
        self._work = np.zeros(code.work + 1)
        self._factors = np.zeros(sum(factor_size(block.size) for block, _ in code.factors) + 1)
        for place, array in enumerate((self._constants, self._work, self._factors)):
            context[FIRST + 3 * slot + place] = array.ctypes.data

    def set_parameters(self, values: Sequence[float]) -> int:
        """Compute the constants; the number (from 1) of a step that cannot be solved, or 0."""
        results: list[Any] = [math.nan] * len(self.tape.ops)
        try:
            interpret(self.tape, self._order, results, values)
        except UnsolvableError as failure:
            return failure.step + 1
        self._constants[:-1] = [results[k] for k in self.code.constants]
        for block, place in self.code.factors:
            n = block.size
            self._factors[place : place + n * n] = matrix(block, results).ravel()
            if _factor(n, self._factors[place:]):
                return block.step + 1
        return 0

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
        self._values: list[float] = default_parameters(program, self._meaning)

    @property
    def context(self) -> int:
        return ctypes.addressof(self._context)

    @property
    def residual(self) -> float:
        return float(self._info[0])

    def set_parameters(self, values: Floats) -> int:
        """Take new values of all scalar parameters and forget where iterations ended."""
        self._values = [float(value) for value in values]
        self._warm[:] = math.nan
        return max((kernel.set_parameters(self._values) for kernel in self._kernels), default=0)

    @cached_property
    def rhs(self) -> NativeKernel:
        return self._compile(self.program.derivatives, slot=0)

    @cached_property
    def jacobian(self) -> NativeKernel:
        """The values of d(rhs)/dx in the order of `pattern`."""
        matrix = self.program.jacobian.matrix
        if matrix.shape[0] > len(self.program.states):
            raise NotImplementedError("elimination of solved blocks")
        return self._compile([value for _, _, value in self._by_columns()], slot=1, level=0)

    @cached_property
    def pattern(self) -> tuple[Ints, Ints]:
        """Column pointers and row indices of the Jacobian."""
        entries = self._by_columns()
        columns = np.array([j for _, j, _ in entries], dtype=np.int64)
        pointers = np.searchsorted(columns, np.arange(len(self.program.states) + 1)).astype(np.int32)
        return pointers, np.array([i for i, _, _ in entries], dtype=np.int32)

    def _by_columns(self) -> list[tuple[int, int, Expr]]:
        return sorted(self.program.jacobian.matrix.entries, key=lambda entry: (entry[1], entry[0]))

    def evaluator(self, expressions: Sequence[Expr]) -> NativeKernel:
        """A kernel for these expressions; each call of this method makes a new one."""
        return self._compile(tuple(expressions), slot=2 + len(self._kernels))

    def _compile(self, roots: Sequence[Expr], *, slot: int, level: int = 1) -> NativeKernel:
        tape = linearise(self._meaning, self.program.tables, roots)
        if len(tape.ops) > LARGE:
            level = 0
        kernel = NativeKernel(tape, emit(tape, slot=slot), slot, level, self._context)
        kernel.set_parameters(self._values)
        self._kernels.append(kernel)
        return kernel


def default_parameters(program: Program, meaning: Names) -> list[float]:
    """The value of every scalar parameter where none is changed."""
    values: list[float] = []
    for parameter in program.parameters:
        tape = linearise(meaning, program.tables, parameter.values)
        results: list[Any] = [math.nan] * len(tape.ops)
        interpret(tape, range(len(tape.ops)), results, values)
        values += (float(results[k]) for k in tape.roots)
    return values
