"""What measuring activities costs a run: one second of the engine with and without its integrals, in turns.

    python benchmarks/activity_cost.py

The integrals of |e f| of all terms are one line; with those of the squares, from which the effort guard has its rms values, another.
"""

from __future__ import annotations

from pathlib import Path

import bgdsl
from bgdsl.passes.activity import grounded, integrands
from bgdsl.simulate.quadrature import Quadratures

ROOT = Path(__file__).parent.parent
ROUNDS = 9


def main() -> None:
    model = bgdsl.load(ROOT / "models" / "engine.bg", model="Engine")
    system = model.compile()
    everything = grounded(integrands(model.scalar).expressions, model.program)
    powers = tuple(expression for expression in everything if expression.op == "abs")
    wanted = {"without": None, f"{len(powers)} powers": Quadratures(powers), f"and the squares: {len(everything)}": Quadratures(everything)}
    seconds: dict[str, list[float]] = {label: [] for label in wanted}
    for _ in range(ROUNDS):
        for label, quadratures in wanted.items():
            run = system.simulate("balanced", quadratures=quadratures)
            seconds[label].append(run.statistics.wall_time)
    for label, times in seconds.items():
        print(f"{label:24s} {min(times):.3f} s  {min(times) / min(seconds['without']):.2f} times")


if __name__ == "__main__":
    main()
