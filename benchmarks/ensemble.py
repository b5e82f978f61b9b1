"""The generated NumPy right side on an ensemble of 1,000 states against one call: the cost must stay below 20 times.

python benchmarks/ensemble.py [FILE.bg [MODEL]]
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import bgdsl.pipeline
from bgdsl.backends.numpy import write_module

MEMBERS = 1000


def best(call: Callable[[], Any], repeats: int) -> float:
    """The least seconds of some calls."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return min(times)


def main() -> None:
    models = Path(__file__).parent.parent / "models"
    cases = [sys.argv[1:]] if len(sys.argv) > 1 else [[str(models / "lever.bg"), "Lever"], [str(models / "engine.bg"), "Engine"]]
    print(f"{'model':<12} {'states':>6} {'one call us':>12} {f'{MEMBERS} states us':>15} {'ratio':>6}")
    for case in cases:
        program = bgdsl.pipeline.load(case[0], case[1] if len(case) > 1 else None).program
        space: dict[str, Any] = {}
        exec(compile(write_module(program, source_name=case[0]), "module.py", "exec"), space)
        p = space["parameters"]()
        x = space["initial_state"](p)
        states = x[:, np.newaxis] + 1e-6 * np.random.default_rng(1).normal(size=(len(x), MEMBERS))
        u = np.zeros(len(program.inputs))
        one = best(lambda: space["rhs"](0.0, x, p, u), 200)  # noqa: B023
        all_ = best(lambda: space["rhs"](0.0, states, p, u), 20)  # noqa: B023
        print(f"{program.model:<12} {len(x):>6} {one * 1e6:>12.0f} {all_ * 1e6:>15.0f} {all_ / one:>6.1f}")


if __name__ == "__main__":
    main()
