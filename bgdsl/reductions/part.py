"""What of a model is to be written, and what takes the place of a link that is cut."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from bgdsl.expr import Expr, var
from bgdsl.ir.scalar import ScalarGraph, Term
from bgdsl.reductions.places import Spot


@dataclass(frozen=True, slots=True)
class Part:
    """What to write. junctions, signals: the nodes wanted (scalar signals by name); gone: removed elements; frozen: the value
    that takes a signal's place, by (reader, signal): the reader is a term's index or an equation's left side. outputs: variables
    that others read, to be given as outputs; passed: where variables stand that pass between parts; changed: parameters with new
    defaults."""

    junctions: frozenset[int]
    signals: frozenset[str]
    dropped: frozenset[int] = frozenset()
    gone: frozenset[str] = frozenset()
    frozen: Mapping[tuple[int | str, str], float] = field(default_factory=dict)
    outputs: tuple[str, ...] = ()
    passed: Mapping[str, Spot] = field(default_factory=dict)
    changed: Mapping[str, float] = field(default_factory=dict)


def everything(scalar: ScalarGraph, dropped: frozenset[int], gone: frozenset[str]) -> Part:
    """All of a model less its dropped terms."""
    signals = frozenset(name for signal in scalar.graph.signals for name in signal.scalars())
    return Part(frozenset(range(len(scalar.junctions))), signals, dropped, gone)


def imposed(scalar: ScalarGraph, kinds: Mapping[str, str], term: Term, far: Term) -> tuple[str, str, Expr]:
    """(class, letter, value) of the source that acts at `term`'s junction in the place of a link whose term `far` is gone."""
    junction = scalar.junctions[far.junction]
    variable = var(junction.variable)
    if term.modulus is None:
        letter = "ef"[junction.kind]
        return f"MS{letter}", letter, variable
    transformer = kinds[term.element or ""] in ("TF", "MTF")
    letter = "ef"[junction.kind] if transformer else "fe"[junction.kind]
    multiplies = (far.port == 0) == (junction.kind == 1) if transformer else junction.kind == 1
    return f"MS{letter}", letter, term.modulus * variable if multiplies else variable / term.modulus
