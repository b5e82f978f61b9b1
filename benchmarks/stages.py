"""Milliseconds of every stage from a file to machine code, with a warm cache of machine code and with none.

    python benchmarks/stages.py [FILE.bg MODEL] [--runs N]

Each run is a process of its own; printed is the least of each stage, so that other work on the machine shows little.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

MODELS = Path(__file__).parent.parent / "models"


def one(path: str, model: str) -> dict[str, float]:
    """Milliseconds of each stage, in this process."""
    found: dict[str, float] = {}

    def timed(name: str, run: Callable[[], Any]) -> Any:
        start = time.perf_counter()
        result = run()
        found[name] = 1e3 * (time.perf_counter() - start)
        return result

    timed("import", _imports)
    from bgdsl import pipeline
    from bgdsl.collecting import uncollected
    from bgdsl.diagnostics import Reporter
    from bgdsl.syntax.parser import read_source

    report = Reporter()
    with uncollected():
        library = timed("read and parse", lambda: pipeline.load_library(read_source(Path(path), report), (), report))
        graph = timed("flatten", lambda: pipeline.flatten(library, model, report, overrides={}))
        graph = timed("domains", lambda: pipeline.check_domains(graph, report))
        graph = timed("units", lambda: pipeline.check_units(graph, report))
        scalar = timed("scalar graph", lambda: pipeline.open_vectors(graph, report))
        causal = timed("causality", lambda: pipeline.assign_causality(scalar, report))
        system = timed("equations", lambda: pipeline.derive_equations(causal, report))
        system = timed("index reduction", lambda: pipeline.reduce_index(system, report))
        ordered = timed("sorting", lambda: pipeline.sort_equations(system, report))
        program = timed("lower", lambda: pipeline.lower(ordered, report))
    from bgdsl.backends.native.model import build

    native = build(program)
    timed("native right-hand side", lambda: native.rhs)
    timed("differentiate", lambda: program.jacobian)
    timed("native Jacobian", lambda: native.jacobian)
    return found


def _imports() -> None:
    import bgdsl.api
    import bgdsl.backends.native.model  # noqa: F401


def least(path: str, model: str, runs: int, cache: str) -> dict[str, float]:
    """The least of each stage over some processes."""
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    found: dict[str, float] = {}
    for _ in range(runs):
        done = subprocess.run(
            [sys.executable, __file__, "--one", path, model],
            env={**kept, "BGDSL_CACHE": cache},
            check=True,
            capture_output=True,
            text=True,
        )
        for name, value in json.loads(done.stdout).items():
            found[name] = min(value, found.get(name, value))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model", nargs="*", default=[str(MODELS / "engine.bg"), "Engine"])
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--one", nargs=2, help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.one:
        print(json.dumps(one(*chosen.one)))
        return
    path, model = chosen.model
    with tempfile.TemporaryDirectory() as folder:
        least(path, model, 1, folder)
        warm = least(path, model, chosen.runs, folder)
    cold = least(path, model, max(1, chosen.runs // 2), os.devnull)
    print(f"{model:<24} {'warm ms':>8} {'cold ms':>8}")
    for name, value in warm.items():
        print(f"{name:<24} {value:>8.0f} {cold[name]:>8.0f}")
    print(f"{'together':<24} {sum(warm.values()):>8.0f} {sum(cold.values()):>8.0f}")


if __name__ == "__main__":
    main()
