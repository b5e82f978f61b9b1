"""The engine against its reference numbers and against the paper: amplitudes of mount forces, energy, joints, sizes.

    python benchmarks/engine_study.py [--write]     prints the tables; with --write puts them into docs/engine.md

Amplitudes: the last four engine cycles, resampled evenly in time, by Fourier transform; order o is o oscillations a crank
revolution.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

import bgdsl
from bgdsl.expr import Expr, add
from bgdsl.simulate.quadrature import Quadratures

Array = NDArray[np.float64]

ROOT = Path(__file__).parent.parent
COMPONENTS = tuple(f"{mount}_force[{k}]" for mount in ("front_mount", "left_rear_mount", "right_rear_mount") for k in (1, 2, 3))
CYCLES, SAMPLES = 4, 8192

REFERENCE: dict[str, dict[str, tuple[float, ...]]] = {
    "balanced": {
        "DC": (526.59, -17.71, 6516.0, -301.72, 9.73, 4628.8, -224.88, 9.73, 4309.9, 64.9945),
        "3": (0.0530, 77.779, 5.360, 0.769, 53.744, 49.568, 0.715, 53.744, 51.741, 2.2625),
    },
    "misfire": {
        "DC": (527.92, -21.17, 6519.8, -297.11, 6.50, 4622.4, -225.55, 6.50, 4318.4, 53.6402),
        "0.5": (24.60, 1327.0, 74.29, 273.76, 610.20, 308.44, 309.06, 610.20, 323.02, 5.6439),
        "1": (4.887, 255.33, 43.86, 9.550, 248.96, 137.74, 11.612, 248.96, 149.64, 3.1638),
        "3": (0.070, 79.65, 6.081, 0.360, 56.12, 51.79, 0.290, 56.12, 53.94, 2.2293),
    },
}
"""Amplitudes in N of the nine force components and in rad/s of the speed, from a hand-written program run to 4 s."""

PAPER_ORDER_3 = (0.055, 78.0, 4.2, 0.81, 53.0, 60.0, 0.90, 53.0, 62.0)
"""The paper's Table 5: the balanced engine's third order in N."""

JOINTS = {
    "main bearing": ("main_a.spring.q", "main_b.spring.q"),
    "crank pin": tuple(f"cyl[{i}].crank_pin.spring.q" for i in range(1, 7)),
    "wrist pin": tuple(f"cyl[{i}].wrist_pin.spring.q" for i in range(1, 7)),
    "bore": tuple(f"bore[{i}].across.spring.q" for i in range(1, 7)),
}


@dataclass(frozen=True)
class Study:
    """One run: amplitudes by order (nine forces, then speed), the energy balance in J, deflections of the joints in m."""

    orders: dict[str, Array]
    exchanged: float
    unbalanced: float
    deflections: dict[str, float]
    steps: int
    seconds: float


def amplitudes(run: Any) -> dict[str, Array]:
    """Amplitude of each order over the last four whole cycles."""
    theta, time = np.asarray(run["crank_angle"]), np.asarray(run.time)
    last = int(theta[-1] // (4 * np.pi))
    begin, end = (float(CubicSpline(theta, time)(4 * np.pi * k)) for k in (last - CYCLES, last))
    grid = np.linspace(begin, end, SAMPLES, endpoint=False)
    columns = np.column_stack([np.asarray(run[name]) for name in (*COMPONENTS, "crank_speed")])
    spectrum = np.fft.rfft(CubicSpline(time, columns)(grid), axis=0) / SAMPLES
    found = {"DC": spectrum[0].real}
    for order in (0.5, 1.0, 1.5, 3.0, 6.0):
        found[f"{order:g}"] = 2 * np.abs(spectrum[round(2 * CYCLES * order)])
    return found


def works(values: Mapping[str, Expr]) -> tuple[Expr, ...]:
    """What leaves or enters the stored energy: gas and weight (in), mounts, bearing and joints (out)."""

    def power(name: str, n: int) -> Expr:
        if n == 0:
            return values[f"{name}.e"] * values[f"{name}.f"]
        return add(values[f"{name}.e[{k}]"] * values[f"{name}.f[{k}]"] for k in range(1, n + 1))

    bodies = ["block", "crank", *(f"cyl[{i}].{part}" for i in range(1, 7) for part in ("rod", "piston"))]
    mounts = ("front_mount", "left_rear_mount", "right_rear_mount")
    joints = [("main_a.damper", 3), ("main_b.damper", 2)]
    for i in range(1, 7):
        joints += [(f"cyl[{i}].crank_pin.damper", 3), (f"cyl[{i}].wrist_pin.damper", 3), (f"cyl[{i}].twist.damper", 1)]
        joints += [(f"bore[{i}].across.damper", 2), (f"bore[{i}].turn.damper", 3)]
    return (
        add(power(f"combustion[{i}]", 0) for i in range(1, 7)),
        add(power(f"{body}.weight", 1) for body in bodies),
        add(power(f"{mount}.damper", 3) for mount in mounts),
        power("bearing", 0),
        add(power(name, n) for name, n in joints),
    )


def study(system: Any, experiment: str, *, stop: float = 4.0, tolerance: float = 1e-8, joints: bool = True) -> Study:
    """Run an experiment of an engine and measure it."""
    quadratures = Quadratures(works(system.program.values)) if joints else None
    run = system.simulate(experiment, stop=stop, tolerance=tolerance, quadratures=quadratures)
    exchanged = unbalanced = 0.0
    deflections: dict[str, float] = {}
    if joints:
        gas, weight, *lost = (float(total) for total in run.trajectory.integrals.values)
        energy = np.asarray(run["energy.total"])
        exchanged, unbalanced = abs(gas), float(energy[-1] - energy[0] - gas - weight + sum(lost))
        deflections = {joint: max(float(np.max(np.abs(run[name]))) for name in names) for joint, names in JOINTS.items()}
    statistics = run.statistics
    return Study(amplitudes(run), exchanged, unbalanced, deflections, statistics.steps, statistics.wall_time)


def largest_error(found: Study, wanted: dict[str, tuple[float, ...]], *, floor: float = 1.0) -> tuple[float, float]:
    """The largest relative deviation of components above `floor` newtons, and of those below."""
    above, below = 0.0, 0.0
    for order, values in wanted.items():
        for value, mine in zip(values, found.orders[order], strict=True):
            error = abs(mine - value) / abs(value)
            if abs(value) >= floor:
                above = max(above, error)
            else:
                below = max(below, error)
    return above, below


# --------------------------------------------------------------------------------------------------------------- tables


def _row(label: str, values: Any) -> str:
    return f"| {label} | " + " | ".join(f"{value:.4g}" for value in values) + " |"


HEAD = "| | Front x | y | z | Left x | y | z | Right x | y | z | speed |\n|---|---|---|---|---|---|---|---|---|---|---|"


def amplitude_table(found: dict[str, Study]) -> str:
    """Amplitudes in N (speed in rad/s): ours, then the reference's."""
    lines = [HEAD]
    for experiment, one in found.items():
        for order, wanted in REFERENCE[experiment].items():
            lines += [_row(f"{experiment}, order {order}", one.orders[order]), _row("reference", wanted)]
            if experiment == "balanced" and order == "3":
                lines.append(_row("paper, Table 5", PAPER_ORDER_3)[:-2] + " | - |")
    return "\n".join(lines)


PAPER_SIZES = (
    ("paper: fully coupled", 5682, 6501, 279, "989618"),
    ("paper: conditioned", 4881, 5863, 294, "908492"),
    ("paper: driving partition", 1688, 1999, 77, "60973"),
    ("paper: driven partition", 3452, 4111, 197, "854084"),
)
"""The paper's Table 6: equations, variables, states, and VODE-Adams steps in one second at 1e-6."""

VARIANTS = (
    ("engine.bg", "Engine"),
    ("engine_revolute.bg", "EngineRevolute"),
    ("engine_ideal.bg", "EngineIdeal"),
    ("engine_owcm.bg", "EngineOneWay"),
)


def size_table() -> str:
    """Sizes of the four models, and steps and wall seconds of one balanced second with the default method and the paper's."""
    lines = [
        "| model | equations | variables | states | VODE-Adams steps | seconds | CVODE-BDF steps | seconds |",
        "|---|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {label} | {equations} | {variables} | {states} | {steps} | | | |" for label, equations, variables, states, steps in PAPER_SIZES
    ]
    for file, name in VARIANTS:
        system = bgdsl.load(ROOT / "models" / file, model=name).compile()
        sizes, cells = system.model.sizes(), []
        for method in ("vode-adams", "cvode-bdf"):
            statistics = system.simulate("balanced", method=method, tolerance=1e-6).statistics
            cells.append(f"{statistics.steps} | {statistics.wall_time:.2f}")
        variables = sizes["equations"] + sizes["states"]
        lines.append(f"| `{file}` | {sizes['equations']} | {variables} | {sizes['states']} | {' | '.join(cells)} |")
    return "\n".join(lines)


def ideal_table(springs: dict[str, Study]) -> str:
    """Ideal joints against springs: the largest deviation of components above 20 N, the largest gap at a pin or bearing."""
    system = bgdsl.load(ROOT / "models" / "engine_ideal.bg", model="EngineIdeal").compile()
    lines = ["| | components above 20 N | front z, order 1 | largest gap, m | steps (1e-6) | seconds |", "|---|---|---|---|---|---|"]
    for name, stiff in springs.items():
        worst, front, gap, statistics = ideal_errors(system, name, stiff)
        lines.append(
            f"| {name} | {100 * worst:.2f} % | {100 * front:.1f} % | {gap:.1e} | {statistics.steps} | {statistics.wall_time:.2f} |"
        )
    return "\n".join(lines)


def ideal_errors(system: Any, experiment: str, stiff: Study, *, tolerance: float = 1e-6) -> tuple[float, float, float, Any]:
    """Run an engine with ideal joints for 4 s: deviation from springs (front z at first order apart), gaps, statistics."""
    run = system.simulate(experiment, stop=4.0, tolerance=tolerance)
    found, worst, front = amplitudes(run), 0.0, 0.0
    for order in ("DC", "0.5", "1", "3", "6"):
        for k, component in enumerate(COMPONENTS):
            error = abs(found[order][k] - stiff.orders[order][k]) / abs(stiff.orders[order][k])
            if (component, order) == ("front_mount_force[3]", "1"):
                front = error
            elif abs(stiff.orders[order][k]) > 20:
                worst = max(worst, error)
    joints = ["main_a", "main_b", *(f"cyl[{i}].{pin}" for i in range(1, 7) for pin in ("crank_pin", "wrist_pin"))]
    gap = max(float(np.max(np.abs(run[f"{joint}.gap_now"]))) for joint in joints)
    return worst, front, gap, run.statistics


def check_table(found: dict[str, Study]) -> str:
    """Deviation from the reference, energy balance, deflection of the joints, cost (4 s, tolerance 1e-8)."""
    head = "| | above 1 N | below 1 N | energy error | " + " | ".join(f"{joint}, um" for joint in JOINTS) + " | steps | seconds |"
    lines = [head, "|" + "---|" * (len(JOINTS) + 6)]
    for name, one in found.items():
        above, below = largest_error(one, REFERENCE[name])
        joints = " | ".join(f"{1e6 * one.deflections[joint]:.1f}" for joint in JOINTS)
        energy = one.unbalanced / one.exchanged
        lines.append(f"| {name} | {100 * above:.3f} % | {100 * below:.2f} % | {energy:.1e} | {joints} | {one.steps} | {one.seconds:.1f} |")
    return "\n".join(lines)


def one_way_table(springs: dict[str, Study]) -> str:
    """The traditional one-way coupled model's amplitudes over the full model's, in percent."""
    system = bgdsl.load(ROOT / "models" / "engine_owcm.bg", model="EngineOneWay").compile()
    lines = [HEAD]
    for name, orders in (("balanced", ("3",)), ("misfire", ("0.5", "1", "3"))):
        one = study(system, name, joints=False)
        for order in orders:
            lines.append(_row(f"{name}, order {order}, % of full", 100 * one.orders[order] / springs[name].orders[order]))
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true")
    write = parser.parse_args().write
    system = bgdsl.load(ROOT / "models" / "engine.bg", model="Engine").compile()
    found = {name: study(system, name) for name in ("balanced", "misfire")}
    tables = {
        "amplitudes": amplitude_table(found),
        "checks": check_table(found),
        "ideal": ideal_table(found),
        "one way": one_way_table(found),
        "sizes": size_table(),
    }
    for name, table in tables.items():
        print(f"\n{name}\n{table}")
    if write:
        _write(tables)


def _write(tables: dict[str, str]) -> None:
    page = ROOT / "docs" / "engine.md"
    text = page.read_text("utf-8")
    for name, table in tables.items():
        text = re.sub(
            rf"(<!-- {name} -->\n).*?(<!-- end -->)", lambda match, table=table: f"{match[1]}{table}\n{match[2]}", text, flags=re.DOTALL
        )
    page.write_text(text, "utf-8")


if __name__ == "__main__":
    main()
