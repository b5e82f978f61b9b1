"""From source text to a runnable native right side with Jacobian, for a chain of N mass-spring-damper components.

    python benchmarks/compile_chain.py [N ...]          both compilers, each size in a process of its own
    python benchmarks/compile_chain.py --profile N      where the time goes

The N masses (m = 1, k = 100, b = 0.1) are fixed at one end; a force of 1 N acts on the free end. The same chain is compiled
by rumoca from Modelica text, components and connectors alike. The disk cache is off. Printed are seconds, the ratio
(rumoca's until its first shortest run, since only then is its model runnable; `load` is its compiler alone), the largest
memory, the exponent of growth between the first and the last size, and the cost of a nonlinear chain of 5,000 equations.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import os
import resource
import subprocess
import sys
import time

BG = """
model Cell "a mass, and the spring and damper towards the wall"
  parameter Real m(unit = "kg") = 1;
  parameter Real k(unit = "N/m") = 100;
  parameter Real b(unit = "N.s/m") = 0.1;
  port in Translational wall;
  port out Translational free;
  J0 F;
  J1 rel;  C spring(k = k);  R damper(R = b);
  J1 v;  I mass(I = m);
equation
  wall -> F;
  F -> rel;  rel -> spring, damper;
  F -> v;  v -> mass;
  v -> free;
end Cell;

model Chain
  parameter Integer n = {n};
  Sf wall(f = 0);
  Cell cell[n];
  J1 tip;
  Se force(e = 1);
equation
  wall -> cell[1].wall;
  for i in 2:n loop
    cell[i-1].free -> cell[i].wall;
  end for;
  cell[n].free -> tip;
  force -> tip;
end Chain;
"""

NONLINEAR = (
    ("C spring(k = k);", "C spring(e = k*q*(1 + (q/q0)^2) + F0*sin(q/q0));"),
    ("R damper(R = b);", "R damper(e = b*f*(1 + abs(f)/v0) + F0*tanh(f/v0));"),
    (
        "  port in",
        '  constant Real q0(unit = "m") = 1;\n  constant Real v0(unit = "m/s") = 1;\n  constant Real F0(unit = "N") = 1;\n  port in',
    ),
)
"""What makes the chain a nonlinear one: hardening springs, quadratic and dry friction."""

MODELICA = """
connector Flange
  Real v;
  flow Real f;
end Flange;

model Cell
  parameter Real m = 1;
  parameter Real k = 100;
  parameter Real b = 0.1;
  Flange free;
  Flange wall;
  Real v(start = 0);
  Real q(start = 0);
  Real F;
equation
  v = free.v;
  der(q) = v - wall.v;
  F = k*q + b*(v - wall.v);
  m*der(v) = free.f - F;
  wall.f = -F;
end Cell;

model Force
  Flange tip;
equation
  tip.f = -1;
end Force;

model Wall
  Flange base;
equation
  base.v = 0;
end Wall;

model Chain
  parameter Integer n = {n};
  Cell cell[n];
  Force force;
  Wall wall;
equation
  connect(force.tip, cell[n].free);
  for i in 2:n loop
    connect(cell[i].wall, cell[i-1].free);
  end for;
  connect(cell[1].wall, wall.base);
end Chain;
"""


def source(n: int, *, nonlinear: bool = False) -> str:
    """The chain as `.bg` text."""
    text = BG.replace("{n}", str(n))
    for old, new in NONLINEAR if nonlinear else ():
        text = text.replace(old, new, 1)
    return text


def ours(n: int, *, nonlinear: bool = False) -> dict[str, float]:
    """Seconds of each stage, source text to native right side and Jacobian, run once."""
    import numpy as np

    import bgdsl.pipeline
    from bgdsl.backends.native import build

    marks = [("", time.perf_counter())]

    def mark(name: str) -> None:
        marks.append((name, time.perf_counter()))

    model = bgdsl.pipeline.loads(source(n, nonlinear=nonlinear), "Chain")
    mark("front")
    _ = model.causal
    mark("causality")
    _ = model.sorted
    mark("equations")
    program = model.program
    mark("lower")
    native = build(program)
    rhs = native.rhs
    mark("native rhs")
    _ = program.jacobian
    mark("differentiate")
    jacobian = native.jacobian
    x, u = np.zeros(len(program.states)), np.zeros(0)
    out, values = np.zeros(len(x)), np.zeros(jacobian.size)
    assert rhs(0.0, x, u, out) == 0 and jacobian(0.0, x, u, values) == 0
    assert np.count_nonzero(out) == 1 and abs(out).max() == 1.0, "only the last mass is pushed"
    mark("native jacobian")
    stages = {name: end - start for (_, start), (name, end) in itertools.pairwise(marks)}
    return {"seconds": marks[-1][1] - marks[0][1], "states": len(x), "size": program.sizes["equations"], **stages}


def theirs(n: int) -> dict[str, float]:
    """Seconds of rumoca for the same: to a compiled model (`load`), and until a first, shortest run has made it runnable."""
    import rumoca

    start = time.perf_counter()
    session = rumoca.Session()
    model = session.loads(MODELICA.replace("{n}", str(n)), model="Chain")
    loaded = time.perf_counter()
    model.simulate(t=(0, 1e-6), dt=1e-6)
    return {"seconds": time.perf_counter() - start, "load": loaded - start}


def measured(which: str, n: int) -> dict[str, float]:
    """One compilation in a fresh process, with its largest memory in MiB."""
    done = subprocess.run(
        [sys.executable, __file__, "--one", which, str(n)], capture_output=True, text=True, env={**os.environ, "BGDSL_CACHE": os.devnull}
    )
    if done.returncode:
        print(done.stderr, file=sys.stderr)
        return {"seconds": math.nan, "MiB": math.nan, "load": math.nan}
    return dict(json.loads(done.stdout.splitlines()[-1]))


def one(which: str, n: int) -> None:
    found = theirs(n) if which == "theirs" else ours(n, nonlinear=which == "nonlinear")
    found["MiB"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(json.dumps(found))


NOT_STAGES = ("seconds", "MiB", "states", "size")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sizes", type=int, nargs="*", default=[500, 1000, 2000, 5000])
    parser.add_argument("--one", nargs=2, help=argparse.SUPPRESS)
    parser.add_argument("--profile", type=int)
    parser.add_argument("--theirs-up-to", type=int, default=1000, help="the largest size given to rumoca")
    chosen = parser.parse_args()
    if chosen.one:
        one(chosen.one[0], int(chosen.one[1]))
    elif chosen.profile:
        profile(chosen.profile)
    else:
        compare(chosen.sizes, chosen.theirs_up_to)


def profile(n: int) -> None:
    import cProfile
    import pstats

    os.environ["BGDSL_CACHE"] = os.devnull
    with cProfile.Profile() as run:
        print(ours(n))
    pstats.Stats(run).sort_stats("tottime").print_stats(40)


def compare(sizes: list[int], limit: int) -> None:
    print(f"{'N':>6} {'bgdsl s':>9} {'rumoca s':>9} {'ratio':>7} {'load s':>7} {'MiB':>6}   stages of bgdsl")
    found = []
    for n in sizes:
        mine = measured("ours", n)
        other = measured("theirs", n) if n <= limit else {"seconds": math.nan, "load": math.nan}
        found.append((n, mine["seconds"]))
        stages = ", ".join(f"{name} {value:.2f}" for name, value in mine.items() if name not in NOT_STAGES)
        ratio = other["seconds"] / mine["seconds"]
        print(
            f"{n:>6} {mine['seconds']:>9.2f} {other['seconds']:>9.2f} {ratio:>7.1f} {other['load']:>7.2f} {mine['MiB']:>6.0f}   {stages}",
            flush=True,
        )
    n = 5000 * sizes[0] // max(1, round(measured("ours", sizes[0])["size"]))
    mine = measured("nonlinear", n)
    stages = ", ".join(f"{name} {value:.2f}" for name, value in mine.items() if name not in NOT_STAGES)
    print(f"nonlinear, {mine['size']:.0f} equations: {mine['seconds']:.2f} s, {mine['MiB']:.0f} MiB   {stages}")
    (first, least), (last, most) = found[0], found[-1]
    if last > first:
        print(f"growth from {first} to {last}: exponent {math.log(most / least) / math.log(last / first):.2f}")


if __name__ == "__main__":
    main()
