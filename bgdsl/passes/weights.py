"""Weights on the terms of a model's balances, so that one compiled model can be run with any of them deleted.

Input        CausalGraph, the terms that may be deleted
Output       CausalGraph of which a new array parameter weighs those terms: 1 a term counts, 0 it is deleted
Establishes  a run with all weights 1 is the model's own; what is not weighed stays as it was
Reports      nothing

A term that determines its junction's variable is never weighed: without it another one would have to, which is another
structure. The weights' defaults are 0, since what is divided by must not vanish: nothing may be divided by a weight.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

from bgdsl.expr import ZERO, Expr, add, param
from bgdsl.ir.causal import CausalGraph
from bgdsl.ir.elements import component
from bgdsl.ir.graph import Parameter
from bgdsl.ir.scalar import InnerBond, ScalarGraph, Term

WEIGHTS = "weights of terms"
"""The name of the array parameter; no source can have one with spaces."""


def weighed(causal: CausalGraph, terms: Iterable[int]) -> CausalGraph:
    """The graph with weights on these terms, in their order the entries of the parameter; none on a determiner."""
    scalar = causal.scalar
    chosen = tuple(sorted(set(terms) - set(causal.determiner)))
    if not chosen:
        return causal
    parameter = Parameter(WEIGHTS, (len(chosen),), (ZERO,) * len(chosen), scalar.terms[0].origin)
    weight = {t: param(name) for t, name in zip(chosen, parameter.scalars(), strict=True)}
    graph = replace(scalar.graph, parameters=(*scalar.graph.parameters, parameter))
    made = tuple(replace(term, weight=weight[term.index]) if term.index in weight else term for term in scalar.terms)
    aliases = {**scalar.aliases, **_carried(scalar, made, weight)}
    return replace(causal, scalar=replace(scalar, graph=graph, terms=made, aliases=aliases))


def weights_in(scalar: ScalarGraph) -> tuple[int, ...]:
    """The weighed terms, in the order of the parameter's entries."""
    return tuple(term.index for term in scalar.terms if term.weight is not None)


def _carried(scalar: ScalarGraph, terms: tuple[Term, ...], weight: Mapping[int, Expr]) -> dict[str, Expr]:
    """What bonds inside junctions bring, anew where terms beyond them are weighed."""
    found: dict[str, Expr] = {}
    for inner in scalar.inner:
        beyond = terms[inner.start : inner.stop]
        if not inner.loop and any(term.index in weight for term in beyond):
            found[_conjugate(scalar, inner)] = add(_brought(term, inner.side == "tail") for term in beyond)
    return found


def _conjugate(scalar: ScalarGraph, inner: InnerBond) -> str:
    return component(f"{inner.bond}.{'e' if scalar.junctions[inner.junction].kind else 'f'}", inner.component)


def _brought(term: Term, forward: bool) -> Expr:
    return term.balanced if (term.sign > 0) == forward else -term.balanced
