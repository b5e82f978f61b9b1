"""How long machine code takes to make and to run: right side and Jacobian, at LLVM's levels 0 and 1.

    python benchmarks/native_rhs.py [FILE.bg [MODEL]]

Run times are those of the C functions called from a compiled loop, without Python between calls. The disk cache is off.
"""

from __future__ import annotations

import ctypes
import os
import sys
import time
from pathlib import Path

import numpy as np

os.environ["BGDSL_CACHE"] = os.devnull

import bgdsl.pipeline
from bgdsl.backends.initial import parameter_values, start_values
from bgdsl.backends.native import NativeKernel, NativeModel, build
from bgdsl.backends.native.emit import emit
from bgdsl.backends.native.jit import Loaded, machine_code
from bgdsl.backends.tape import linearise
from bgdsl.ir.program import Program

LOOP = """
define void @loop(ptr %f, i64 %n, double %t, ptr %x, ptr %u, ptr %o, ptr %c) {
entry:
  br label %again
again:
  %i = phi i64 [ 0, %entry ], [ %next, %again ]
  %r = call i32 %f(double %t, ptr %x, ptr %u, ptr %o, ptr %c)
  %next = add i64 %i, 1
  %more = icmp ult i64 %next, %n
  br i1 %more, label %again, label %done
done:
  ret void
}
"""


class Timer:
    """Calls a kernel many times from machine code."""

    def __init__(self) -> None:
        self.code = Loaded(machine_code(LOOP, 1))
        self.loop = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int64, ctypes.c_double, *(ctypes.c_void_p,) * 4)(
            self.code.address("loop")
        )

    def microseconds(self, kernel: NativeKernel, model: NativeModel, x: np.ndarray, u: np.ndarray, calls: int = 200) -> float:
        out = np.zeros(kernel.size)
        times = []
        for _ in range(20):
            start = time.perf_counter()
            self.loop(kernel.address, calls, 0.01, x.ctypes.data, u.ctypes.data, out.ctypes.data, model.context)
            times.append((time.perf_counter() - start) / calls * 1e6)
        return min(times)


def report(program: Program, timer: Timer) -> None:
    x = np.array(start_values(program, parameter_values(program)))
    u = np.zeros(len(program.inputs))
    print(f"{program.model}: {len(x)} states")
    for level in (0, 1):
        model = build(program)
        start = time.perf_counter()
        tape = linearise(model._meaning, program.tables, program.derivatives)
        listed = time.perf_counter()
        code = emit(tape, slot=0)
        written = time.perf_counter()
        kernel = NativeKernel(tape, code, 0, level, model._context)
        compiled = time.perf_counter()
        kernel.set_parameters(parameter_values(program))
        print(
            f"  rhs, level {level}: {len(tape.ops)} operations, list {listed - start:.3f} s, write {written - listed:.3f} s, "
            f"LLVM {compiled - written:.3f} s, run {timer.microseconds(kernel, model, x, u):.2f} us"
        )
    model = build(program)
    start = time.perf_counter()
    _ = program.jacobian
    differentiated = time.perf_counter()
    jacobian = model.jacobian
    compiled = time.perf_counter()
    print(
        f"  Jacobian: {len(jacobian.tape.ops)} operations, {jacobian.size} values, differentiate {differentiated - start:.3f} s, "
        f"compile {compiled - differentiated:.3f} s, run {timer.microseconds(jacobian, model, x, u, 20):.2f} us"
    )


def main() -> None:
    models = Path(__file__).parent.parent / "models"
    cases = [sys.argv[1:]] if len(sys.argv) > 1 else [[str(models / "engine.bg")], [str(models / "engine_ideal.bg"), "EngineIdeal"]]
    timer = Timer()
    for case in cases:
        report(bgdsl.pipeline.load(case[0], case[1] if len(case) > 1 else None).program, timer)


if __name__ == "__main__":
    main()
