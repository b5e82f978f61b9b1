"""Parasitic springs and dampers made as soft as they may be (Rideout and Stein 2003).

Input        a flat graph; how a run with given parameters deflects them and what share of activity they have (a callable)
Output       Tuning      new values of the parameters that the parasitic elements read
Establishes  in the last run every deflection and every group's share of activity stays below its limit
Reports      nothing

A soft joint violates its constraint by about force over stiffness, and a stiff one costs steps. One factor serves all instances of
one declared parameter (the six crank pins stay alike); it is moved until the largest deflection, or the group's activity,
comes close below its limit. Damping goes with the root of the stiffness beside it, which keeps the damping ratio.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field

from bgdsl.expr import Expr, leaves
from bgdsl.ir.graph import BondGraph, Element


@dataclass(frozen=True, slots=True)
class Group:
    """The parameters of one declaration (`cyl.crank_pin.K`) that parasitic elements of one kind (C or R) read, by scalar name."""

    name: str
    kind: str
    parameters: tuple[str, ...]
    elements: tuple[str, ...]
    states: tuple[str, ...]

    @property
    def parent(self) -> str:
        return self.name.rpartition(".")[0]


@dataclass(frozen=True, slots=True)
class Observed:
    """What a run shows of the parasitic elements: the largest deflection of each state, each element's share of all
    elements' activity."""

    deflection: Mapping[str, float]
    share: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class Tuned:
    """A group after tuning: the factor on its parameters, its largest deflection and its share of activity in the last run."""

    group: Group
    factor: float
    deflection: float
    share: float


@dataclass(frozen=True, slots=True)
class Tuning:
    """values: the new parameter values by scalar name; settled: all limits held in the last of `runs` runs."""

    groups: tuple[Tuned, ...]
    values: Mapping[str, float]
    runs: int
    settled: bool


def groups(graph: BondGraph) -> tuple[Group, ...]:
    """The groups of a model, springs first, in declaration order."""
    found: dict[tuple[str, str], _Members] = {}
    defaults = {name: value for p in graph.parameters for name, value in zip(p.scalars(), p.values, strict=True)}
    for element in graph.elements:
        if not element.parasitic or element.kind not in ("C", "R") or element.linear is None:
            continue
        for leaf in _parameters(element, defaults):
            key = re.sub(r"\[[\d,]+\]", "", leaf), element.kind
            members = found.setdefault(key, _Members())
            members.parameters.setdefault(leaf)
            members.elements.setdefault(element.name)
            members.states.update(dict.fromkeys(element.states))
    ordered = sorted(found.items(), key=lambda item: item[0][1] != "C")
    return tuple(Group(name, kind, tuple(m.parameters), tuple(m.elements), tuple(m.states)) for (name, kind), m in ordered)


@dataclass(slots=True)
class _Members:
    parameters: dict[str, None] = field(default_factory=dict)
    elements: dict[str, None] = field(default_factory=dict)
    states: dict[str, None] = field(default_factory=dict)


def _parameters(element: Element, defaults: Mapping[str, Expr]) -> Iterator[str]:
    """The parameters that the element's law reads, each followed through plain bindings (`C stiff(k = K)`) to where it is set."""
    assert element.linear is not None
    name, rows = element.linear
    if name in ("k", "R"):  # stiffness and damping; compliances and conductances go the other way and are left alone
        for leaf in leaves([entry for row in rows for entry in row], "param"):
            name = leaf.data
            while defaults[name].op == "param":
                name = defaults[name].data
            yield name


def tune(
    found: tuple[Group, ...],
    start: Mapping[str, float],
    observe: Callable[[Mapping[str, float]], Observed],
    limit: Callable[[str], float],
    most_share: float,
    *,
    runs: int = 10,
    slack: float = 0.1,
) -> Tuning:
    """Find the factors. start: parameter values by scalar name; observe: run with these values; limit: of a state's deflection.

    A factor is settled when its worst ratio to a limit lies between 1 - slack and 1.
    """
    factors = {group.name: 1.0 for group in found}
    springs = [group for group in found if group.kind == "C"]
    ratio: dict[str, float] = {}
    seen = Observed({}, {})
    made = 0
    for made in range(1, runs + 1):
        seen = observe(_values(found, factors, start))
        ratio = {group.name: max(_worst(group, seen, limit, most_share), 1e-6) for group in springs}
        if all(1 - slack <= r <= 1 for r in ratio.values()):
            break
        if made == runs:
            break
        for group in springs:
            if not 1 - slack <= ratio[group.name] <= 1:
                factors[group.name] *= min(1e3, max(1e-3, ratio[group.name] / (1 - slack / 2)))
        _follow(found, factors)
    tuned = tuple(_tuned(group, factors[group.name], seen) for group in found)
    return Tuning(tuned, _values(found, factors, start), made, all(r <= 1 for r in ratio.values()))


def _values(found: tuple[Group, ...], factors: Mapping[str, float], start: Mapping[str, float]) -> dict[str, float]:
    """The parameter values with the factors, to three digits: nobody believes in more."""
    return {name: float(f"{start[name] * factors[group.name]:.2e}") for group in found for name in group.parameters}


def _worst(group: Group, seen: Observed, limit: Callable[[str], float], most_share: float) -> float:
    deflection = max((seen.deflection[state] / limit(state) for state in group.states), default=0.0)
    return max(deflection, _share(group, seen) / most_share)


def _share(group: Group, seen: Observed) -> float:
    return sum(seen.share.get(name, 0.0) for name in group.elements)


def _follow(found: tuple[Group, ...], factors: dict[str, float]) -> None:
    """Dampers take the root of the factor of the springs in the same joint."""
    for group in found:
        if group.kind == "R":
            beside = [factors[g.name] for g in found if g.kind == "C" and g.parent == group.parent]
            factors[group.name] = math.sqrt(max(beside)) if beside else 1.0


def _tuned(group: Group, factor: float, seen: Observed) -> Tuned:
    deflection = max((seen.deflection.get(state, 0.0) for state in group.states), default=0.0)
    return Tuned(group, factor, deflection, _share(group, seen))


# ------------------------------------------------------------------------------------------------------------------ text


def heir_text(model: str, module: str, graph: BondGraph, values: Mapping[str, float], note: str) -> str:
    """A model that inherits everything and has the new values: `model EngineTuned extends Engine(cyl(each crank_pin(K = 2e9)))`."""
    shapes = {name: parameter.shape for parameter in graph.parameters for name in parameter.scalars()}
    tree: dict[str, object] = {}
    for scalar, value in values.items():
        shape = shapes[scalar]
        parts = (scalar.rpartition("[")[0] if shape else scalar).split(".")
        names = [
            ("each " if before.endswith("]") else "") + part.partition("[")[0] for before, part in zip(["", *parts], parts, strict=False)
        ]
        node = tree
        for name in names[:-1]:
            child = node.setdefault(name, {})
            assert isinstance(child, dict)
            node = child
        text = f"{value:g}"
        node[names[-1]] = text if not shape else f"fill({text}, {', '.join(str(n) for n in shape)})"
    return f"""{note}
import {module}.{model};

model {model}Tuned
  extends {model}({_arguments(tree)});
end {model}Tuned;
"""


def _arguments(tree: Mapping[str, object]) -> str:
    return ", ".join(f"{name}({_arguments(value)})" if isinstance(value, dict) else f"{name} = {value}" for name, value in tree.items())
