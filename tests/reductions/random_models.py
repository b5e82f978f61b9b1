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
