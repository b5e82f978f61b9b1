"""Random models with classes in classes, arrays of them, moduli and parameters given from outside, ports, and elements of users."""

from __future__ import annotations

import random

CLASSES = """
element Turner "a gyrator whose ratio is read"
  port in Generic y;  port in Generic z;
  input Real ratio;
equation
  y.f = ratio*z.e;  z.f = -ratio*y.e;
end Turner;

model Mass "a body that is dragged and turned"
  parameter Real m = 1.5 "mass";
  parameter Real d[3] = {0.1, 0.2, 0.3};
  open J1[3] v;
  I[3] mass(I = m*identity(3));  R[3] rdrag(R = diagonal(d));
  EJS[3] euler(G = m*skew(x));
  Real x[3](each start = 0.1) "way";
equation
  v => mass, rdrag, euler;
  der(x) = v.f;
end Mass;

model Link "a spring between two points, the first seen in other axes"
  port in Generic[3] a;  port out Generic[3] b;
  parameter Real k = 2;
  MTF[3, 3] axes "to the axes of the spring";
  J0[3] gap;  C[3] spring(k = k*identity(3));
equation
  a => axes => gap;  gap => b;  gap => spring;
end Link;

model Twist "springs on two components that are coupled"
  port in Generic[2] a;
  input Real s = 0.3;
  J0 y;  C cy(k = 1.1);  J0 z;  C cz(k = 0.7);
  J1 fy, fz;  R ry(R = 0.4), rz(R = 0.6);
  Turner turner(ratio = s);
equation
  a[1] -> fy;  fy -> ry, y;  y -> cy, turner.y;
  a[2] -> fz;  fz -> rz, z;  z -> cz, turner.z;
end Twist;

model Pair "two bodies and what is between them"
  parameter Real stiff = 3;
  Mass one(m = stiff/2), two;
  Link link(k = stiff, axes(T = {matrix}));
equation
  one.v => link.a;  link.b => two.v;
end Pair;
"""

MATRICES = (
    "[1, one.x[2], 0; 0, 1, 0.5; two.x[1], 0, 1]",
    "identity(3)",
    "transpose([1, 0.2, 0; 0.1, 1, one.x[3]; 0, 0, 1])",
    "-skew(two.x) + identity(3)",
)


def random_hierarchy(seed: int) -> str:
    """The text of a model `Net` with its classes. Equal seeds give equal texts."""
    rng = random.Random(seed)
    n = rng.choice([2, 3])
    lines = [f"parameter Real k0 = {rng.uniform(1, 3):.3f};"]
    stiff = rng.choice([f"each stiff = {rng.uniform(1, 4):.3f}", f"stiff = {{{', '.join(f'{rng.uniform(1, 4):.3f}' for _ in range(n))}}}"])
    lines.append(f"Pair pair[{n}]({stiff}{rng.choice(['', ', two(each m = 2.5)', f', two(m = {{k0*i for i in 1:{n}}})'])});")
    axes = rng.choice(
        ["each axes(T = [1, k0, 0; 0, 1, 0; 0, 0.2, 1])", f"axes(T = {{[1, 0, pair[i].one.x[1]; 0, 1, 0; 0, 0, 1] for i in 1:{n - 1}}})"]
    )
    lines.append(f"Link tie[{n - 1}](each k = k0, {axes});")
    statements = [f"for i in 1:{n - 1} loop pair[i].two.v => tie[i].a; tie[i].b => pair[i + 1].one.v; end for;"]
    if rng.random() < 0.6:
        where = rng.randrange(n) + 1
        lines.append(f"Twist twist{rng.choice(['', '(s = pair[1].two.x[1])'])};")
        statements.append(f"pair[{where}].one.v[{rng.choice(['1:2', '2:3'])}] => twist.a;")
    if rng.random() < 0.6:
        lines.append(f"MTF[1, 3] sum(T = [1, {rng.uniform(-1, 1):.3f}, k0]);  J0[1] at;  C[1] soft(k = 0.8);")
        statements.append("pair[1].one.v => sum => at;  at => soft;")
    if rng.random() < 0.6:
        lines.append(f"GY gyre(r = {rng.uniform(0.5, 1.5):.3f});  J1 far;  I wheel(I = k0);  R rwheel[2](R = {{0.2, 0.3}});")
        statements.append(f"pair[{n}].two.v[{rng.randrange(3) + 1}] -> gyre -> far;  far -> wheel, rwheel[1], rwheel[2];")
    if rng.random() < 0.5:
        lines.append("J1 node[3];  I mnode[3](I = {1, 2, 3});  J0 hook[3];  C chook[3](each k = 1.3);")
        statements.append("for i in 1:3 loop node[i] -> mnode[i]; pair[1].one.v[i] -> hook[i]; hook[i] -> node[i], chook[i]; end for;")
    lines.append("output Real way = pair[1].one.x[1] + pair[1].link.spring.e[1];")
    classes = CLASSES.replace("{matrix}", rng.choice(MATRICES))
    body = "\n".join(f"  {line}" for line in [*lines, "equation", *statements])
    return f"model Net\n{body}\nend Net;\n{classes}"
