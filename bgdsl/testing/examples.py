"""Well-known bond graphs, made with `graphs.GraphBuilder`."""

from __future__ import annotations

from bgdsl.expr import unary, var
from bgdsl.ir.graph import BondGraph
from bgdsl.testing.graphs import GraphBuilder


def lever() -> BondGraph:
    """Two mass-spring-dampers coupled by a lever (Rideout, Stein and Louca 2008, section 2.3)."""
    g = GraphBuilder("Lever")
    for name in ("vA", "vB", "vkB"):
        g.junction(name, 1)
    g.junction("F2", 0)
    g.storage("massA", "I", 10.0, start=("f", 1.0))
    g.storage("springA", "C", 1e-3)
    g.resistor("damperA", 20.0)
    g.storage("massB", "I", 1.0)
    g.two_port("lever", "TF", 0.1)
    g.storage("springB", "C", 1e-2)
    g.resistor("damperB", 2.0)
    g.bonds_from("vA", "massA", "springA", "damperA")
    g.chain("vA", "lever", "F2")
    g.bonds_from("F2", "vkB", "vB")
    g.bonds_from("vkB", "springB", "damperB")
    g.bond("vB", "massB")
    return g.build()


def series_rlc() -> BondGraph:
    """Se - 1 - I, R, C with I = R = 1, C = 0.01."""
    g = GraphBuilder("Series")
    g.junction("i", 1)
    g.source("drive", "Se", 0.0)
    g.storage("coil", "I", 1.0, start=("p", -1.0))
    g.resistor("load", 1.0)
    g.storage("cap", "C", 0.01, start=("q", 10.0))
    g.bond("drive", "i")
    g.bonds_from("i", "coil", "load", "cap")
    return g.build()


def parallel_rlc() -> BondGraph:
    """Sf - 0 - I, R, C, all 1."""
    g = GraphBuilder("Parallel")
    g.junction("u", 0)
    g.source("drive", "Sf", 0.0)
    g.storage("coil", "I", 1.0)
    g.resistor("load", 1.0)
    g.storage("cap", "C", 1.0, start=("q", 1.0))
    g.bond("drive", "u")
    g.bonds_from("u", "coil", "load", "cap")
    return g.build()


def geared_masses(kind: str = "TF") -> BondGraph:
    """1-{I 2, C k=50, Se 10}, TF 3 to 1-{I 0.5}: the second mass depends on the first."""
    g = GraphBuilder("Geared")
    g.junction("v1", 1)
    g.junction("v2", 1)
    g.source("drive", "Se", 10.0)
    g.storage("m1", "I", 2.0)
    g.storage("spring", "C", 0.02)
    g.two_port("gear", kind, 3.0)
    g.storage("m2", "I", 0.5)
    g.bond("drive", "v1")
    g.bonds_from("v1", "m1", "spring")
    g.chain("v1", "gear", "v2", "m2")
    return g.build()


def euler_body() -> BondGraph:
    """A torque-free body with J = (1, 2, 3): 1[3] - I[3], EJS[3]."""
    g = GraphBuilder("Body")
    g.junction("w", 1, 3)
    g.storage("inertia", "I", 1.0, 2.0, 3.0, size=3)
    h = [var(f"inertia.p[{i}]") for i in (1, 2, 3)]
    g.euler("euler", [[0.0, h[2], -h[1]], [-h[2], 0.0, h[0]], [h[1], -h[0], 0.0]])
    g.bond("w", "inertia")
    g.bond("w", "euler")
    return g.build()


def matrix_arm() -> BondGraph:
    """A body-fixed point: v and w of a body, v + w x r through an MTF to a spring at the point."""
    g = GraphBuilder("Arm")
    g.junction("v", 1, 3)
    g.junction("w", 1, 3)
    g.junction("point", 0, 3)
    g.storage("mass", "I", 2.0, size=3)
    g.storage("inertia", "I", 1.0, 2.0, 3.0, size=3)
    x, y, z = (g.parameter(f"r{axis}", value) for axis, value in (("x", 0.1), ("y", 0.2), ("z", 0.3)))
    g.two_port("arm", "MTF", [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])
    g.storage("spring", "C", 0.01, size=3)
    g.bond("v", "mass")
    g.bond("w", "inertia")
    g.bond("v", "point")
    g.chain("w", "arm", "point", "spring")
    return g.build()


def pendulum(*, inertia: bool = True) -> BondGraph:
    """A point mass on a rod: w through (l cos phi, -l sin phi) to vx, vy with gravity on vy; `inertia`: the rod has some."""
    g = GraphBuilder("Pendulum")
    g.junction("w", 1)
    g.junction("vx", 1)
    g.junction("vy", 1)
    phi = g.signal("phi", rate=var("w.f"), start=0.5)
    if inertia:
        g.storage("rod", "I", 0.1)
    g.two_port("ax", "MTF", unary("cos", phi))
    g.two_port("ay", "MTF", unary("sin", phi))
    g.storage("mx", "I", 1.0)
    g.storage("my", "I", 1.0)
    g.source("gravity", "Se", -9.81)
    if inertia:
        g.bond("w", "rod")
    g.chain("w", "ax", "vx", "mx")
    g.chain("w", "ay", "vy", "my")
    g.bond("gravity", "vy")
    return g.build()


def rigid_rod() -> BondGraph:
    """A mass with vx and vy held on a circle by a rod: modulated transformers closed by Sf(f = 0)."""
    g = GraphBuilder("Rod")
    g.junction("vx", 1)
    g.junction("vy", 1)
    x = g.signal("x", rate=var("vx.f"), start=1.0)
    y = g.signal("y", rate=var("vy.f"))
    g.storage("mx", "I", 1.0)
    g.storage("my", "I", 1.0)
    g.source("gravity", "Se", -9.81)
    g.junction("v", 1, 2)
    g.two_port("along", "MTF", [[x, y]])
    g.source("rod", "Sf", 0.0, size=1)
    g.junction("stretch", 0, 1)
    g.bonds_from("vx", "mx")
    g.bonds_from("vy", "my")
    g.bond("gravity", "vy")
    g.bond("vx", "v", at_head=[0])
    g.bond("vy", "v", at_head=[1])
    g.chain("v", "along", "stretch")
    g.bond("rod", "stretch")
    return g.build()


EXAMPLES = {
    "lever": lever,
    "series": series_rlc,
    "parallel": parallel_rlc,
    "geared": geared_masses,
    "body": euler_body,
    "arm": matrix_arm,
    "pendulum": pendulum,
    "rod": rigid_rod,
}
