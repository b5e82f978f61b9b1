"""Random models as source: junctions with a storage each, joined by bonds, two-ports and parts with ports, scalar and vector."""

from __future__ import annotations

import random
from dataclasses import dataclass, field

PARTS = """
model Wire{n} "a resistor between two ports"
  port in Generic{d} a; port out Generic{d} b;
  parameter Real r = 1;
  J{k}{d} j; R{d} loss(R = r);
equation
  a {s} j; j {s} loss; j {s} b;
end Wire{n};

model Turn{n} "a transformer between two ports"
  port in Generic{d} a; port out Generic{d} b;
  parameter Real m{d}{d2} = {default};
  MTF{dd} arm({p} = m);
equation
  a {s} arm {s} b;
end Turn{n};
"""


@dataclass
class Text:
    declarations: list[str] = field(default_factory=list)
    statements: list[str] = field(default_factory=list)


def random_model(seed: int, nodes: int = 5, vectors: bool = True) -> str:
    """The text of a model `Net`, with the classes of its parts. Equal seeds give equal texts."""
    rng = random.Random(seed)
    size = rng.choice([None, 3]) if vectors else None
    d, s = (f"[{size}]", "=>") if size else ("", "->")
    text = Text()
    kinds = [rng.choice([0, 1]) for _ in range(nodes)]
    if len(set(kinds)) == 1:
        kinds[0] = 1 - kinds[0]
    for i, kind in enumerate(kinds):
        text.declarations.append(f"J{kind}{d} n{i};")
        storage = "I" if kind == 1 else "C"
        value = rng.uniform(0.5, 2.0)
        shown = f"diagonal({{{', '.join(f'{value * (k + 1):.3f}' for k in range(3))}}})" if size else f"{value:.3f}"
        text.declarations.append(f"{storage}{d} s{i}({storage} = {shown});")
        text.statements.append(f"n{i} {s} s{i};")
        if rng.random() < 0.6:
            text.declarations.append(f"R{d} r{i}(R = {rng.uniform(0.5, 2):.3f}{'*identity(3)' if size else ''});")
            text.statements.append(f"n{i} {s} r{i};")
        if kind == 1 and size and rng.random() < 0.5:
            text.declarations.append(f"EJS[3] g{i}(G = skew({{{', '.join(f'{rng.uniform(-1, 1):.3f}' for _ in range(3))}}}));")
            text.statements.append(f"n{i} => g{i};")
    for k in range(1, nodes):
        _join(rng, text, k, rng.randrange(k), kinds, size)
    for k in range(rng.randrange(3)):
        a, b = rng.sample(range(nodes), 2)
        _join(rng, text, a, b, kinds, size, extra=k)
    shuffled = text.statements[:]
    rng.shuffle(shuffled)
    default = "[1, 0.2, -0.3; 0.1, 2, 0.4; 0, -0.5, 0.7]" if size else "0.7"
    parts = "".join(
        PARTS.format(n=k, d=d, d2=", 3]" if size else "", dd="[3, 3]" if size else "", s=s, k=k, default=default, p="T" if size else "m")
        for k in (0, 1)
    ).replace("[3], 3]", "[3, 3]")
    lines = [f"  {line}" for line in text.declarations] + ["equation"] + [f"  {line}" for line in shuffled]
    return f"model Net\n{chr(10).join(lines)}\nend Net;\n{parts}"


def _join(rng: random.Random, text: Text, a: int, b: int, kinds: list[int], size: int | None, extra: int = -1) -> None:
    """A way of power from node a to node b."""
    s, d = ("=>", "[3]") if size else ("->", "")
    name = f"x{a}_{b}" + (f"_{extra}" if extra >= 0 else "")
    if kinds[a] != kinds[b]:
        way = rng.choice(["bond", "part", "turn", "pieces"])
        if kinds[a] == 0 and way == "turn":
            a, b = b, a  # multiplied, never divided
        if way == "bond":
            text.statements.append(f"n{a} {s} n{b};")
        elif way == "pieces" and size:
            text.statements += [f"n{a}[1] -> n{b}[2];", f"n{a}[2:3] => n{b}[2:3];"] if rng.random() < 0.5 else [f"n{a}[2] -> n{b}[1];"]
        elif way == "turn":
            text.declarations.append(f"Turn{a % 2} {name};")
            text.statements += [f"n{a} {s} {name}.a;", f"{name}.b {s} n{b};"]
        else:
            matrix = rng.choice(["skew({0.5, 0, -0.4})", "[1, 0, 0.3; 0, 0, 2; -1, 0.6, 0]"])
            if kinds[a] == 0:
                matrix = "[1, 0.2, 0.3; 0.1, 2, 0; -1, 0.6, 3]"
            text.declarations.append(f"MTF[3, 3] {name}(T = {matrix});" if size else f"TF {name}(m = {rng.uniform(0.3, 2):.3f});")
            if kinds[a] == 0 and size and rng.random() < 0.7:
                a, b = b, a  # else the ports meet junctions of the other kind, and have some of their own
            text.statements.append(f"n{a} {s} {name} {s} n{b};")
        return
    if rng.random() < 0.5:
        # through a part whose junction is of the other kind
        text.declarations.append(f"Wire{1 - kinds[a]} {name}(r = {rng.uniform(0.5, 2):.3f});")
        if rng.random() < 0.5 or size is None:
            text.statements += [f"n{a} {s} {name}.a;", f"{name}.b {s} n{b};"]
        else:
            text.statements += [f"n{a}[1] -> {name}.a[1];", f"n{a}[2:3] => {name}.a[2:3];", f"{name}.b {s} n{b};"]
        return
    if kinds[a] == 1:
        r = "[0.4, 0, 1; 0.2, 0.3, 0; 0, 0, 0.9]" if size else f"{rng.uniform(0.3, 2):.3f}"
        text.declarations.append(f"MGY[3, 3] {name}(G = {r});" if size else f"GY {name}(r = {r});")
        text.statements.append(f"n{a} {s} {name} {s} n{b};")
    else:
        text.declarations.append(f"J1{d} {name}; R{d} {name}_r(R = {'identity(3)' if size else '1.5'});")
        text.statements += [f"n{a} {s} {name};", f"{name} {s} {name}_r;", f"{name} {s} n{b};"]


CLASSES = """
model Node1 "a mass, or three, with losses"
  open J1{d} v;
  parameter Real m = 1;
  I{d} store(I = m{eye});  R{d} r(R = 0.7{eye});  R{d} loss(R = 0.2{eye});
equation
  v {s} store;  v {s} r, loss;
end Node1;

model Node0 "a spring, or three, with losses"
  open J0{d} u;
  parameter Real k = 1;
  C{d} store(k = k{eye});  R{d} loss(R = 3{eye});
equation
  u {s} store, loss;
end Node0;

model Arm "a transformer whose modulus is given from outside"
  port in Generic{d} a;
  port out Generic{d} b;
  MTF{dd} turn;
equation
  a {s} turn {s} b;
end Arm;

model Odd "an arm that loses something on the way"
  port in Generic{d} a;
  port out Generic{d} b;
  MTF{dd} turn;
  J1{d} before;  R{d} loss(R = 0.1{eye});
equation
  a {s} before;  before {s} turn;  turn {s} b;  before {s} loss;
end Odd;

model Point "a transformer of its own, and an arm after or beside it"
  port in Generic{d} a;
  port out Generic{d} b;
  parameter Real w = 1;
  J1{d} mid;  J0{d} gap;  R{d} soft(R = 2{eye});  Arm arm;
  TF{dd} own({p} = w{own});
equation
  a {s} mid;  mid {s} own {s} gap;  gap {s} soft;
  mid {s} arm.a;  arm.b {s} gap;  gap {s} b;
end Point;

model Frame "a gyrator inside a part of a part"
  port in Generic{d} a;
  port out Generic{d} b;
  parameter Real w = 1;
  extends Half(mass = 3);
  Point point[2](each w = w, each arm(turn({p} = {turn})));
  J1{d} start;  J0{d} end_;
equation
  a {s} start;  end_ {s} b;  start {s} near;
  for i in 1:2 loop
    start {s} point[i].a;  point[i].b {s} end_;
  end for;
end Frame;

model Half "what frames inherit"
  parameter Real mass;
  J1{d} near;  J1{d} far;  I{d} heavy(I = mass{eye});  R{d} loss(R = 0.1{eye});
  MGY{dd} side({g} = 0.3{own});
equation
  near {s} side {s} far;  far {s} heavy, loss;
end Half;
"""


def hierarchical_model(seed: int) -> str:
    """The text of a model `Net` of parts with parts in arrays, moduli from outside, arrays of two-ports and loops."""
    rng = random.Random(seed)
    vector, n = rng.random() < 0.6, rng.choice([2, 3, 4])
    d, s, dd, eye = ("[3]", "=>", "[3, 3]", "*identity(3)") if vector else ("", "->", "", "")
    p, g = ("T", "G") if vector else ("m", "r")
    matrix = "[1, 0.2, 0; 0.1*hub.store.p[1], 1, 0.4; 0, -0.5, 0.7]" if vector else "(1 + 0.1*hub.store.p)"
    inner = "[0.5, 0, 0.1; 0, 0, 0.3; 0.2, 0, 1]" if vector else "0.6"
    own = "*[1, 0, 0.5; 0, 1, 0; 0.25, 0, 1]" if vector else ""
    text = Text()
    masses = ", ".join(f"{rng.uniform(0.5, 2):.3f}" for _ in range(n))
    text.declarations += [
        f"Node1 p[{n}](m = {{{masses}}});  Node0 q[{n}](each k = 2);  Node1 hub(m = 3);  Node0 ring;",
        f"Arm x[{n}](each turn({p} = {matrix}));",
    ]
    loop = [f"p[i].v {s} x[i].a;  x[i].b {s} q[i].u;"]
    if rng.random() < 0.7:
        factor = rng.choice(["i*", "0.5*"])
        text.declarations.append(f"MTF{dd} y[{n}]({p} = {{{factor}{matrix} for i in 1:{n}}}), z({p} = {matrix});")
        loop.append(f"hub.v {s} y[i] {s} q[i].u;")
        text.statements.append(f"p[1].v {s} z {s} ring.u;")
    if rng.random() < 0.7:
        loop.append(f"q[i].u {s} hub.v;" if rng.random() < 0.5 else f"hub.v {s} q[i].u;")
    if rng.random() < 0.5:
        text.declarations.append(f"Frame frame[{n - 1}](w = {{{', '.join(['0.5', '0.7', '0.9'][: n - 1])}}});")
        text.statements.append(f"for i in 2:{n} loop\n    p[i].v {s} frame[i - 1].a;  frame[i - 1].b {s} ring.u;\n  end for;")
    if rng.random() < 0.5:
        text.declarations.append(f"Frame lone(w = 1.5);  GY{dd} g[{n}](each {g} = 0.4{own});")
        text.statements.append(f"hub.v {s} lone.a;  lone.b {s} q[1].u;")
        loop.append(f"hub.v {s} g[i] {s} p[i].v;")
    if rng.random() < 0.5:
        text.declarations.append(f"R{d} r[{n}](each R = 0.3{eye});")
        loop.append(f"p[i].v {s} r[i];")
    if vector and rng.random() < 0.5:
        text.declarations.append(f"EJS[3] e[{n}](each G = skew({{1, 0.5, hub.store.p[2]}}));")
        loop.append("p[i].v => e[i];")
    if vector and rng.random() < 0.5:
        loop.append("q[i].u[1:2] => hub.v[2:3];  q[i].u[3] -> hub.v[1];")
    if rng.random() < 0.4:  # an array of arrays' worth of parts, of which some are of another class
        text.declarations.append(f"Arm web[{n}, 2](each turn({p} = {inner}));")
        text.declarations.append(f"redeclare Odd web[1, 2](turn({p} = 2*{inner}));")
        text.statements.append(f"for i in 1:{n}, k in 1:2 loop\n    p[i].v {s} web[i, k].a;  web[i, k].b {s} q[i].u;\n  end for;")
    if rng.random() < 0.4:
        text.declarations.append(f"J1{d} far[{n - 1}];  I{d} stone[{n - 1}](each I = 2{eye});  R{d} rub[{n - 1}](each R = 0.4{eye});")
        text.statements.append(
            f"for i in 1:{n - 1} loop\n    far[i] {s} stone[i], rub[i];\n"
            f"    if i > 1 then\n      q[i + 1].u {s} far[i];\n    end if;\n  end for;\n  link: q[1].u {s} far[1];"
        )
    if rng.random() < 0.4 and any(" z(" in line for line in text.declarations):
        text.declarations.append(f"output Real felt = {'z.p1.e[1]' if vector else 'z.p1.e'};")
    text.statements += [f"ring.u {s} hub.v;", f"for i in 1:{n} loop\n    " + "\n    ".join(loop) + "\n  end for;"]
    lines = [f"  {line}" for line in text.declarations] + ["equation"] + [f"  {line}" for line in text.statements]
    classes = CLASSES.format(d=d, s=s, dd=dd, eye=eye, p=p, g=g, own=own, turn=inner)
    return f"model Net\n{chr(10).join(lines)}\nend Net;\n{classes}"
