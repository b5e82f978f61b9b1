"""How fast the engine compiles and runs; every ratio is of two numbers measured in this one run.

    python benchmarks/engine_speed.py [--write]

- from text to machine code of right-hand side and Jacobian, with an empty cache and with a warm one, each in a process of its own
- the machine-code right-hand side against the engine written by hand in C (engine_reference.c, compiled by gcc -O3)
- one second of the balanced engine at 1e-6: the default method against VODE-Adams, which the paper used, and against BDF to order 3
- the same with ideal joints
- where the time goes: of these, and with a misfire in the full and in the conditioned model
"""

from __future__ import annotations

import argparse
import ctypes
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import bgdsl
from bgdsl.expr import const
from bgdsl.simulate.cvode import CvodeLoop
from bgdsl.simulate.kernels.compiler import KERNELS
from bgdsl.simulate.sparse import SparseLU

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT / "tests" / "engine"))
from engine_reference import GAS, OUR_NAMES  # noqa: E402

REPEAT = 40_000
FLAGS = ("-O3", "-march=native", "-shared", "-fPIC")

CALLER = """
typedef int (*rhs_t)(double, const double *, const double *, double *, void *);
void repeat(int n, int m, int size, rhs_t f, const double *y, double *dy, void *context)
{ for (int i = 0; i < n; i++) f(0.0, y + (i % m) * size, 0, dy, context); }
void engine_rhs(const double *, const double *, const double *, double *);
void repeat_by_hand(int n, int m, int size, const double *y, const double *gain, const double *coef, double *dy)
{ for (int i = 0; i < n; i++) engine_rhs(y + (i % m) * size, gain, coef, dy); }
"""

START = """
import time; start = time.perf_counter()
import bgdsl
system = bgdsl.load({path!r}, model={model!r}).compile()
native = system.native; native.rhs; native.jacobian
print(time.perf_counter() - start)
"""


def _pointer(array: Any) -> Any:
    return array.ctypes.data_as(ctypes.POINTER(ctypes.c_double))


def start_times(path: Path, model: str) -> tuple[float, float]:
    """Seconds from the interpreter's first line to machine code: with an empty cache, and again (the best of five)."""
    code = START.format(path=str(path), model=model)
    with tempfile.TemporaryDirectory() as cache:
        kept = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}  # as installed packages have it
        environment = {**kept, "XDG_CACHE_HOME": cache, "HOME": cache}
        first, *again = (
            float(subprocess.run([sys.executable, "-c", code], env=environment, check=True, capture_output=True, text=True).stdout)
            for _ in range(6)
        )
    return first, min(again)


def rhs_times(system: Any) -> tuple[float, float]:
    """Microseconds a right-hand side: ours, by hand in C. Both are called from a loop in C over several states in turn."""
    cases = json.loads((ROOT / "tests" / "engine" / "rhs_check.json").read_text())["cases"]
    y = np.array([case["y"] for case in cases[:2]])
    y = np.vstack([y, 0.5 * (y[0] + y[1])])
    names = [state.name for state in system.states]
    x = np.empty_like(y)
    x[:, [names.index(name) for name in OUR_NAMES]] = y
    gain, coef, dy, dx = np.ones(6), np.ascontiguousarray(GAS.c.T), np.empty(261), np.empty(261)
    with tempfile.TemporaryDirectory() as folder:
        caller = Path(folder) / "caller.c"
        caller.write_text(CALLER)
        library = Path(folder) / "engine.so"
        subprocess.run(["gcc", *FLAGS, "-o", library, caller, ROOT / "benchmarks" / "engine_reference.c", "-lm"], check=True)
        code = ctypes.CDLL(str(library))
        rhs = ctypes.c_void_p(system.native.rhs.address)
        context = ctypes.c_void_p(system.native.context)

        def ours() -> None:
            code.repeat(REPEAT, len(x), 261, rhs, _pointer(x), _pointer(dx), context)

        def by_hand() -> None:
            code.repeat_by_hand(REPEAT, len(y), 261, _pointer(y), _pointer(gain), _pointer(coef), _pointer(dy))

        rounds = [(_seconds(ours), _seconds(by_hand)) for _ in range(10)]  # in turn, so that other work on the machine meets both
        return 1e6 * min(ours for ours, _ in rounds) / REPEAT, 1e6 * min(theirs for _, theirs in rounds) / REPEAT


def _seconds(run: Any) -> float:
    start = time.process_time()
    run()
    return time.process_time() - start


def run_time(system: Any, method: str | None = None, repeat: int = 5) -> tuple[float, int]:
    """Processor seconds (the best) and steps of one second of the balanced engine, by the experiment's own method if none is named."""
    best, steps = np.inf, 0
    for _ in range(repeat):
        start = time.process_time()
        run = system.simulate("balanced", method=method)
        best, steps = min(best, time.process_time() - start), run.statistics.steps
    return best, steps


def shares(system: Any, experiment: str = "balanced") -> list[tuple[str, float]]:
    """Where the seconds of a run go: counted calls times their measured cost, the time outside CVODE's loop, and what is left over."""
    runs = []
    for _ in range(8):
        began = time.process_time()
        with inside_loop() as spent:
            run = system.simulate(experiment, stop=1.0, tolerance=1e-6)
        runs.append((time.process_time() - began, spent[0]))
    wall, loop = min(runs)
    statistics, native = run.statistics, system.native
    x, none = run.trajectory.states[len(run.time) // 2].copy(), np.empty(0)

    def cost(call: Any) -> float:
        return min(_seconds(lambda: [call() for _ in range(100)]) for _ in range(50)) / 100

    def of(kernel: Any) -> float:
        out = np.empty(kernel.size)
        return cost(lambda: kernel(0.0, x, none, out))

    trivial = of(native.evaluator([const(0.0)]))  # what a call from Python costs
    parts = [(f"right-hand side, {statistics.rhs_calls} calls", statistics.rhs_calls * (of(native.rhs) - trivial))]
    if statistics.jacobian_calls:
        lu, values, solution = SparseLU(*native.pattern), np.empty(native.jacobian.size), np.empty(len(x))
        native.jacobian(0.0, x, none, values)
        full = np.random.default_rng(1).normal(size=len(x))  # as a residual is: what is zero would be passed over
        right, left, numbers = full.ctypes.data, solution.ctypes.data, values.ctypes.data
        bare = cost(partial(KERNELS.function("ls_kind"), None))  # which returns at once
        factor, solve = KERNELS.function("lu_factor"), KERNELS.function("lu_solve")
        parts += [
            (f"Jacobian, {statistics.jacobian_calls} calls", statistics.jacobian_calls * (of(native.jacobian) - trivial)),
            (
                f"factorisation, {statistics.factorisations} times",
                statistics.factorisations * (cost(lambda: factor(lu.address, numbers, 1e-5)) - bare),
            ),
            ("substitution, one a right-hand side", statistics.rhs_calls * (cost(lambda: solve(lu.address, right, left)) - bare)),
        ]
    rest = loop - sum(seconds for _, seconds in parts)
    last = "projection, CVODE's own arithmetic, rows" if system.program.invariants else "CVODE's own arithmetic, rows"
    return [*parts, (last, rest), ("Python: parameters, starts, tables of results", wall - loop)]


@contextmanager
def inside_loop() -> Iterator[list[float]]:
    """The processor seconds spent in CVODE's loop meanwhile."""
    spent, go = [0.0], CvodeLoop.go

    def timed(self: CvodeLoop) -> str:
        start = time.process_time()
        try:
            return go(self)
        finally:
            spent[0] += time.process_time() - start

    CvodeLoop.go = timed  # type: ignore[method-assign]
    try:
        yield spent
    finally:
        CvodeLoop.go = go  # type: ignore[method-assign]


def measured() -> list[tuple[str, str]]:
    """The lines of the report: what, and how much."""
    path = ROOT / "models" / "engine.bg"
    cold, warm = start_times(path, "Engine")
    lines = [("text to machine code", f"{cold:.2f} s; again, with a warm cache, {warm:.2f} s")]
    system = bgdsl.load(path, model="Engine").compile()
    if shutil.which("gcc"):
        ours, by_hand = rhs_times(system)
        lines.append(("right-hand side", f"{ours:.2f} us; by hand in C {by_hand:.2f} us: ratio {ours / by_hand:.2f}"))
    default, steps = run_time(system, "cvode-bdf")
    lines.append(("1 s balanced, cvode-bdf", f"{default:.2f} s, {steps} steps: {1 / default:.1f} times real time"))
    third, steps = run_time(system, "cvode-bdf3")
    lines.append(("1 s balanced, cvode-bdf3", f"{third:.2f} s, {steps} steps: {default / third:.1f} times as fast"))
    adams, steps = run_time(system, "vode-adams", repeat=1)
    lines.append(("1 s balanced, vode-adams", f"{adams:.2f} s, {steps} steps: {adams / default:.1f} times as long"))
    ideal = bgdsl.load(ROOT / "models" / "engine_ideal.bg", model="EngineIdeal").compile()
    seconds, steps = run_time(ideal)
    lines.append(("1 s balanced, ideal joints", f"{seconds:.2f} s, {steps} steps: {default / seconds:.1f} times as fast as with springs"))
    conditioned = bgdsl.load(ROOT / "models" / "reduced" / "engine_misfire_conditioned.bg").compile()
    runs = (("springs", system, "balanced"), ("ideal joints", ideal, "balanced"), ("misfire", system, "misfire"))
    for name, compiled, experiment in (*runs, ("misfire, conditioned", conditioned, "misfire")):
        whole = shares(compiled, experiment)
        total = sum(seconds for _, seconds in whole)
        lines += [(f"{name}: {label}", f"{100 * seconds / total:.0f} %") for label, seconds in whole]
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="put the table into docs/engine.md")
    write = parser.parse_args().write
    lines = measured()
    for label, value in lines:
        print(f"{label:80s} {value}")
    if write:
        page = ROOT / "docs" / "engine.md"
        table = "\n".join(["| | |", "|---|---|", *(f"| {label} | {value} |" for label, value in lines)])
        text = re.sub(r"(<!-- speed -->\n).*?(<!-- end -->)", lambda m: f"{m[1]}{table}\n{m[2]}", page.read_text("utf-8"), flags=re.DOTALL)
        page.write_text(text, "utf-8")


if __name__ == "__main__":
    main()
