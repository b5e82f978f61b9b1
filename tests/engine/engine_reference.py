"""The engine's equations written by hand in NumPy: 14 rigid bodies, joints as spring-dampers, mounts, gas forces.

Nothing here comes from the compiler. `rhs` is the right-hand side in the order of `rhs_check.json`; `OUR_NAMES` gives for
each of those states the name that the same state has in `models/engine.bg`.
"""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

Array = NDArray[np.float64]

HERE = Path(__file__).parent
TABLE = HERE.parent.parent / "models" / "combustion.csv"

G = 9.81
BODIES = 14
MASS = np.array([1207.0, 300.0] + [6.32] * 6 + [5.08] * 6)
INERTIA = np.array([[122.3, 238.6, 233.1], [4.23, 70.38, 70.38]] + [[0.0888, 0.0865, 0.0070]] * 6 + [[0.0120, 0.0120, 0.0095]] * 6)
BLOCK, CRANK = 0, 1
BLOCK_CG = np.array([0.4430, -0.0088, 0.2830])
CRANK_CG = np.array([0.4920, 0.0, 0.0])
MAIN_A = np.array([-0.0830, 0.0, 0.0])
MAIN_B = np.array([0.9085, 0.0, 0.0])
PINS = np.array(
    [
        [0, 0, 0.0800],
        [0.1651, 0.0693, -0.0400],
        [0.3302, -0.0693, -0.0400],
        [0.4953, -0.0693, -0.0400],
        [0.6604, 0.0693, -0.0400],
        [0.8255, 0, 0.0800],
    ]
)
ROD_C, ROD_D, PISTON_D = np.array([0, 0, -0.111]), np.array([0, 0, 0.158]), np.array([0, 0, -0.050])
MOUNT_POINTS = np.array([[-0.318, 0, -0.197], [1.000, -0.318, 0], [1.000, 0.318, 0]])
MOUNT_K = np.array([[193.1e3, 193.1e3, 1410e3], [314.5e3, 314.5e3, 157.0e3], [314.5e3, 314.5e3, 157.0e3]])
MOUNT_R = np.array([[2340.0, 2340, 6340], [2990, 2990, 2110], [2990, 2990, 2110]])
FIRING = np.array([0.0, 480, 240, 600, 120, 360])
BEARING_R = 30.0


def gas_table() -> CubicSpline:
    """The piston force over the cycle angle in degrees, periodic and twice continuously differentiable."""
    with TABLE.open() as file:
        rows = list(csv.reader(file))[1:]
    angle, force = (np.array([float(row[k]) for row in rows]) for k in (0, 1))
    return CubicSpline(angle, force, bc_type="periodic")


GAS = gas_table()


def cardan(angle: Array) -> Array:
    """Body to inertial: Rx(a) Ry(b) Rz(c)."""
    (sa, sb, sc), (ca, cb, cc) = np.sin(angle), np.cos(angle)
    return np.array(
        [
            [cb * cc, -cb * sc, sb],
            [ca * sc + sa * sb * cc, ca * cc - sa * sb * sc, -sa * cb],
            [sa * sc - ca * sb * cc, sa * cc + ca * sb * sc, ca * cb],
        ]
    )


def cardan_rate(angle: Array, w: Array) -> Array:
    (_, sb, sc), (_, cb, cc) = np.sin(angle), np.cos(angle)
    da = (cc * w[0] - sc * w[1]) / cb
    return np.array([da, sc * w[0] + cc * w[1], w[2] - sb * da])


def rhs(y: Array, gas_gain: Array | None = None, details: dict[str, Any] | None = None) -> Array:
    """The 261 state derivatives; `details` receives mount forces on the block."""
    gain = np.ones(6) if gas_gain is None else gas_gain
    momenta, poses = y[:84].reshape(BODIES, 6), y[84:168].reshape(BODIES, 6)
    p, h, angle = momenta[:, :3], momenta[:, 3:], poses[:, 3:]
    v, w = p / MASS[:, None], h / INERTIA
    R = np.array([cardan(a) for a in angle])
    force, moment = -np.cross(w, p), -np.cross(w, h)
    force += np.array([R[i].T @ np.array([0, 0, -MASS[i] * G]) for i in range(BODIES)])
    dy = np.zeros(261)

    def velocity(body: int, arm: Array) -> Array:
        return R[body] @ (v[body] + np.cross(w[body], arm))

    def push(body: int, arm: Array, f: Array) -> None:
        """A force f in N at a point of a body."""
        own = R[body].T @ f
        force[body] += own
        moment[body] += np.cross(arm, own)

    mount_forces = []
    for m in range(3):
        arm = MOUNT_POINTS[m] - BLOCK_CG
        dq = v[BLOCK] + np.cross(w[BLOCK], arm)
        dy[168 + 3 * m : 171 + 3 * m] = dq
        f = -(MOUNT_K[m] * y[168 + 3 * m : 171 + 3 * m] + MOUNT_R[m] * dq)
        mount_forces.append(f)
        force[BLOCK] += f
        moment[BLOCK] += np.cross(arm, f)

    def bearing(at: int, point: Array, axes: slice) -> None:
        rel = velocity(CRANK, point - CRANK_CG) - velocity(BLOCK, point - BLOCK_CG)
        n = axes.stop - axes.start
        dy[at : at + n] = rel[axes]
        e = np.zeros(3)
        e[axes] = 2e10 * y[at : at + n] + 1e6 * rel[axes]
        push(CRANK, point - CRANK_CG, -e)
        push(BLOCK, point - BLOCK_CG, e)

    bearing(177, MAIN_A, slice(0, 3))
    bearing(180, MAIN_B, slice(1, 3))
    x_block = R[BLOCK].T @ (R[CRANK] @ w[CRANK] - R[BLOCK] @ w[BLOCK])
    dy[182] = x_block[0]
    friction = np.array([BEARING_R * x_block[0], 0, 0])
    moment[BLOCK] += friction
    moment[CRANK] -= R[CRANK].T @ R[BLOCK] @ friction

    for i in range(6):
        rod, piston, s = 2 + i, 8 + i, 183 + 13 * i
        arm = PINS[i] - CRANK_CG
        for at, one, arm1, two, arm2 in ((s, CRANK, arm, rod, ROD_C), (s + 3, rod, ROD_D, piston, PISTON_D)):
            rel = velocity(one, arm1) - velocity(two, arm2)
            dy[at : at + 3] = rel
            e = 1e10 * y[at : at + 3] + 2e5 * rel
            push(one, arm1, -e)
            push(two, arm2, e)
        twist = (R[rod].T @ (R[piston] @ w[piston]) - w[rod])[2]
        dy[s + 6] = twist
        e = np.array([0, 0, 1e5 * y[s + 6] + 20 * twist])
        moment[rod] += e
        moment[piston] -= R[piston].T @ R[rod] @ e
        rel = R[BLOCK].T @ (R[piston] @ w[piston]) - w[BLOCK]
        dy[s + 7 : s + 10] = rel
        e = 5e7 * y[s + 7 : s + 10] + 500 * rel
        moment[BLOCK] += e
        moment[piston] -= R[piston].T @ R[BLOCK] @ e
        r_block = np.array([PINS[i][0], 0, y[s + 12]]) - BLOCK_CG
        rel = R[BLOCK].T @ (R[piston] @ v[piston]) - v[BLOCK] - np.cross(w[BLOCK], r_block)
        dy[s + 10 : s + 12] = rel[:2]
        dy[s + 12] = rel[2]
        gas = gain[i] * GAS((np.degrees(y[182]) - FIRING[i]) % 720.0)
        e = np.array([*(1e10 * y[s + 10 : s + 12] + 2e5 * rel[:2]), gas])
        force[BLOCK] += e
        moment[BLOCK] += np.cross(r_block, e)
        force[piston] -= R[piston].T @ R[BLOCK] @ e

    dy[:84] = np.hstack([force, moment]).ravel()
    for i in range(BODIES):
        dy[84 + 6 * i : 87 + 6 * i] = R[i] @ v[i]
        dy[87 + 6 * i : 90 + 6 * i] = cardan_rate(angle[i], w[i])
    if details is not None:
        details["mount_forces"] = np.array(mount_forces)
    return dy


def _our_names() -> tuple[str, ...]:
    bodies = ["block", "crank", *(f"cyl[{i}].rod" for i in range(1, 7)), *(f"cyl[{i}].piston" for i in range(1, 7))]
    names = [f"{body}.{part}.p[{k}]" for body in bodies for part in ("mass", "inertia") for k in (1, 2, 3)]
    names += [f"{body}.{part}[{k}]" for body in bodies for part in ("r", "angle") for k in (1, 2, 3)]
    names += [f"{mount}.spring.q[{k}]" for mount in ("front_mount", "left_rear_mount", "right_rear_mount") for k in (1, 2, 3)]
    names += [f"main_a.spring.q[{k}]" for k in (1, 2, 3)] + [f"main_b.spring.q[{k}]" for k in (1, 2)] + ["theta"]
    for i in range(1, 7):
        names += [f"cyl[{i}].{joint}.spring.q[{k}]" for joint in ("crank_pin", "wrist_pin") for k in (1, 2, 3)]
        names += [f"cyl[{i}].twist.spring.q[1]"]
        names += [f"bore[{i}].turn.spring.q[{k}]" for k in (1, 2, 3)] + [f"bore[{i}].across.spring.q[{k}]" for k in (1, 2)]
        names += [f"bore[{i}].d"]
    return tuple(names)


OUR_NAMES = _our_names()
"""The 261 names of the compiled model's states, in the order of the reference."""
