"""Simulate a chain of N mass-spring-damper components: this tool's runs against CasADi's CVODES-Adams on hand-written equations.

    python benchmarks/simulate_chain.py [N]        (N = 1000 unless given; CasADi: pip install casadi)

Fixed at one end, a step force of 1 N at the free end; m = 1, k = 100, b = 0.1; 10 s at rtol = atol = 1e-6. Everything but
compilation is counted: options, initial values, integration, recording. The best of five runs is printed, with the ratio.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

import numpy as np

from bgdsl import pipeline

TEXT = """
model Cell
  parameter Real m = 1;  parameter Real k = 100;  parameter Real b = 0.1;
  port in Translational left;  port out Translational right;
  J0 force;  J1 rel;  C spring(k = k);  R damper(R = b);  J1 v;  I mass(I = m);
equation
  left -> force;  force -> rel;  rel -> spring, damper;  force -> v;  v -> mass;  v -> right;
end Cell;
model Chain
  parameter Integer n = {n};
  Cell cell[n];
  Sf wall(f = 0);  J1 base;  J1 tip;  Se push(e = 1);
  output Real tip_speed = cell[n].v.f;
equation
  wall -> base;  base -> cell[1].left;
  for i in 1:n-1 loop cell[i].right -> cell[i+1].left; end for;
  cell[n].right -> tip;  push -> tip;
end Chain;
"""

STOP, TOLERANCE, ROWS = 10.0, 1e-6, 100


def best(run: Callable[[], float], repeats: int = 5) -> tuple[float, float]:
    """The shortest wall time in seconds, and the result."""
    times = []
    result = float("nan")
    for _ in range(repeats):
        began = time.perf_counter()
        result = run()
        times.append(time.perf_counter() - began)
    return min(times), result


def casadi_run(n: int) -> Callable[[], float]:
    """The same equations by hand, masses' velocities and springs' elongations, in CasADi's default CVODES with Adams."""
    import casadi

    v, q = casadi.SX.sym("v", n), casadi.SX.sym("q", n)
    rate = v - casadi.vertcat(0, v[:-1])
    force = 100 * q + 0.1 * rate
    slope = casadi.vertcat(-force + casadi.vertcat(force[1:], 1), rate)
    problem = {"x": casadi.vertcat(v, q), "ode": slope}
    options = {"linear_multistep_method": "adams", "nonlinear_solver_iteration": "functional", "reltol": TOLERANCE, "abstol": TOLERANCE}
    grid = np.linspace(0.0, STOP, ROWS + 1)
    integrator = casadi.integrator("chain", "cvodes", problem, 0.0, grid[1:].tolist(), options)
    start = np.zeros(2 * n)
    return lambda: float(integrator(x0=start)["xf"][n - 1, -1])


def main() -> None:
    n = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    began = time.perf_counter()
    system = pipeline.loads(TEXT.format(n=n), "Chain").compile()
    system.simulate(stop=STOP / 1000, tolerance=TOLERANCE, method="cvode-adams", interval=STOP / ROWS)
    print(f"N = {n}: {len(system.states)} states, source text to the end of a first short run in {time.perf_counter() - began:.2f} s")
    theirs: float | None = None
    try:
        theirs, speed = best(casadi_run(n))
        print(f"{'CasADi CVODES-Adams':24} {theirs * 1e3:8.1f} ms           tip {speed:.9f} m/s")
    except ImportError:
        print("CasADi is not installed: no comparison")
    for method in ("cvode-adams", "vode-adams", "cvode-bdf"):
        took, speed = best(
            lambda method=method: float(
                system.simulate(stop=STOP, tolerance=TOLERANCE, method=method, interval=STOP / ROWS)["tip_speed"][-1]
            )
        )
        ratio = f"{took / theirs:6.2f} x" if theirs else ""
        print(f"{method:24} {took * 1e3:8.1f} ms {ratio:>9} tip {speed:.9f} m/s")


if __name__ == "__main__":
    main()
