"""The scalar graph with causality: which term determines each junction's variable, which storages keep integral causality."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from bgdsl.ir.scalar import ScalarGraph


@dataclass(frozen=True, slots=True)
class Constrained:
    """A junction or source where no explicit assignment is possible: an unknown (the multiplier) and a balance or a source
    law that has to hold. `junction` is the scalar junction; `source` the Sf or Se that became a constraint, or None."""

    junction: int
    source: str | None


@dataclass(frozen=True, slots=True)
class CausalGraph:
    """determiner[j]: the term that sets junction j's variable, None where it is a multiplier (see `constrained`).
    strokes[bond][component] is `tail` or `head`: the end on which the effort acts. derivative: the states (`mass.p`) in
    derivative causality with the path of terms that forces it. loops: causal loops as tuples of junction indices."""

    scalar: ScalarGraph
    determiner: tuple[int | None, ...]
    strokes: dict[str, tuple[Literal["tail", "head"], ...]]
    derivative: dict[str, tuple[int, ...]]
    constrained: tuple[Constrained, ...]
    loops: tuple[tuple[int, ...], ...]
