"""Which terms to drop at a threshold: the decision, before any text is written.

Input        ScalarGraph, ActivityReport, a threshold
Output       Decision    the dropped terms, and why the other inactive ones stay
Establishes  reduction.md's rules: what is never conditioned stays; a bond that is inactive at both ends goes whole
Reports      nothing: what it finds is in the Decision

To condition a term is to delete it from its junction's balance and to keep every other equation.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace

from bgdsl.expr import Expr, evaluate, leaves, topological
from bgdsl.ir.activity import ActivityReport
from bgdsl.ir.graph import BondGraph
from bgdsl.ir.scalar import ScalarGraph, Term

_EFFORT_SOURCES = ("Se", "MSe")
_FLOW_SOURCES = ("Sf", "MSf")


@dataclass(frozen=True, slots=True)
class Kept:
    """An inactive term that stays all the same."""

    term: int
    reason: str


@dataclass(frozen=True, slots=True)
class Decision:
    """dropped: terms to delete from their junctions' balances. kept: inactive terms that stay, with the reason.

    observers: elements whose term is dropped but whose variables are read: they stay, driven by a source.
    unexcited: scalar junctions without any activity, left as they are. reinstated: dropped terms taken back because a
    junction would have been left without determiner, or because the model did not compile without them: then `fault` says why.
    """

    threshold: float
    dropped: frozenset[int]
    kept: tuple[Kept, ...]
    observers: frozenset[str]
    unexcited: tuple[int, ...]
    reinstated: tuple[int, ...] = ()
    fault: str | None = None

    def without(self, terms: Iterable[int]) -> Decision:
        """The decision with some dropped terms taken back."""
        terms = tuple(t for t in terms if t in self.dropped)
        return replace(self, dropped=self.dropped - frozenset(terms), reinstated=(*self.reinstated, *terms))

    def restricted(self, terms: frozenset[int]) -> Decision:
        """The decision to drop no other terms than these."""
        return replace(self, dropped=self.dropped & terms)


# ---------------------------------------------------------------------------------------------------------------- decide


def decide(
    scalar: ScalarGraph,
    report: ActivityReport,
    threshold: float,
    *,
    guard: bool = True,
    among: Callable[[Term], bool] = lambda term: True,
    may_vanish: Callable[[Expr], bool] | None = None,
) -> Decision:
    """The terms below `threshold` that may be dropped. among: which terms are considered at all (a partition's boundary);
    may_vanish: can this modulus be zero (default: any that is not a constant or a parameter with a nonzero value)."""
    dropped: set[int] = set()
    kept: list[Kept] = []
    for term in considered(scalar, report, guard=guard, may_vanish=may_vanish):
        if term.rho < threshold and among(scalar.terms[term.index]):
            if term.reason is None and term.level < threshold:
                dropped.add(term.index)
            else:
                kept.append(Kept(term.index, term.reason or f"its rms is {100 * term.level:.2g} % of the largest at its junction"))
    unexcited = tuple(j.index for j in report.junctions if j.max_activity == 0.0 and j.terms)
    return settle(scalar, Decision(threshold, frozenset(dropped), tuple(kept), frozenset(), unexcited))


@dataclass(frozen=True, slots=True)
class Considered:
    """A term as conditioning sees it. level: it falls at thresholds above this, which is its rho or, guarded, the larger of that and
    its strength; reason: why it never does, else None."""

    index: int
    rho: float
    level: float
    reason: str | None


def considered(
    scalar: ScalarGraph, report: ActivityReport, *, guard: bool = True, may_vanish: Callable[[Expr], bool] | None = None
) -> Iterator[Considered]:
    """Every term that there is something to drop of, at junctions with any activity."""
    vanishes = may_vanish or _vanishing(scalar.graph)
    kinds = element_kinds(scalar.graph)
    parasitic = parasitic_terms(scalar)
    nothing = {law.left for element in scalar.graph.elements for law in element.laws if law.right.is_zero}
    for junction in report.junctions:
        guarded = guard and not _held_by_parasites(scalar, junction.index, parasitic)
        for activity in junction.terms if junction.max_activity > 0.0 else ():
            term = scalar.terms[activity.index]
            if term.conjugate.is_zero or (term.other is None and term.conjugate in nothing):
                continue  # there is nothing to drop: a source's component that is zero by its law
            reason = "parasitic" if term.index in parasitic else _never(scalar, term, kinds, vanishes)
            level = activity.strength if guarded and activity.strength > activity.rho else activity.rho  # (a strength may be NaN)
            yield Considered(term.index, activity.rho, level, reason)


def parasitic_terms(scalar: ScalarGraph) -> frozenset[int]:
    """The terms of parasitic elements, and the links that lead to nothing else: without them a joint would be rigid."""
    found = {term.index for term in scalar.terms if term.parasitic}
    left = [sum(t not in found for t in at) for at in scalar.terms_at]
    waiting = [j for j, at in enumerate(scalar.terms_at) if left[j] == 1 and len(at) > 1]
    while waiting:
        j = waiting.pop()
        for t in scalar.terms_at[j]:
            far = scalar.terms[t].other
            if t in found or far is None:
                continue
            found |= {t, far}
            beyond = scalar.terms[far].junction
            left[j], left[beyond] = left[j] - 1, left[beyond] - 1
            if left[beyond] == 1:
                waiting.append(beyond)
    return frozenset(found)


def _never(scalar: ScalarGraph, term: Term, kinds: Mapping[str, str], vanishes: Callable[[Expr], bool]) -> str | None:
    """Why a term is never conditioned; None if it may be."""
    kind = scalar.junctions[term.junction].kind
    if len(scalar.terms_at[term.junction]) <= 2:
        return "one of two terms, which are always equal"
    if term.other is None:
        element = kinds[term.element or ""]
        if kind == 1 and element in _FLOW_SOURCES:
            return "a flow source at a 1-junction"
        if kind == 0 and element in _EFFORT_SOURCES:
            return "an effort source at a 0-junction"
    if term.modulus is not None and divides(scalar, term, kinds) and vanishes(term.modulus):
        return "what took its place would divide by a modulus that can vanish"
    return None


def _held_by_parasites(scalar: ScalarGraph, j: int, parasitic: frozenset[int]) -> bool:
    """Is this a 0-junction of a joint? Its flows are velocities that parasitic stiffness keeps in step, not a store that a small
    steady flow would fill: the dual of the guard, which is for efforts on what has inertia, has nothing to protect there."""
    return scalar.junctions[j].kind == 0 and any(t in parasitic for t in scalar.terms_at[j])


def divides(scalar: ScalarGraph, term: Term, kinds: Mapping[str, str]) -> bool:
    """Would the source at the far side of this two-port's term carry the junction's variable divided by the modulus?

    A transformer multiplies flow from port 1 to port 2 and effort from port 2 to port 1; a gyrator multiplies flows only.
    """
    kind = scalar.junctions[term.junction].kind
    if kinds[term.element or ""] in ("TF", "MTF"):
        return kind == (0 if term.port == 0 else 1)
    return kind == 0


def element_kinds(graph: BondGraph) -> dict[str, str]:
    """The kind of every element by name."""
    return {element.name: element.kind for element in graph.elements}


def _vanishing(graph: BondGraph) -> Callable[[Expr], bool]:
    values = parameter_values(graph)

    def can(modulus: Expr) -> bool:
        if any(node.op in ("var", "time") for node in topological((modulus,))):
            return True
        try:
            return evaluate(modulus, values, tables=graph.tables) == 0.0
        except (KeyError, ArithmeticError, ValueError):
            return True

    return can


def parameter_values(graph: BondGraph, changes: Mapping[str, float] | None = None) -> dict[str, float]:
    """The value of every scalar parameter that can be evaluated, with changes by scalar name; others are left out."""
    values = dict(changes or {})
    defaults = {name: value for p in graph.parameters for name, value in zip(p.scalars(), p.values, strict=True)}
    for wanted in defaults:
        stack = [wanted]
        while stack:  # parameters may read parameters declared later
            name = stack[-1]
            needs = [] if name in values else [leaf.data for leaf in leaves((defaults[name],), "param")]
            missing = [need for need in needs if need not in values and need in defaults and need not in stack]
            if missing:
                stack += missing
                continue
            stack.pop()
            if name not in values:
                with suppress(KeyError, ArithmeticError, ValueError):
                    values[name] = evaluate(defaults[name], values, tables=graph.tables)
    return values


# ---------------------------------------------------------------------------------------------------------------- settle


def settle(scalar: ScalarGraph, decision: Decision) -> Decision:
    """The decision made consistent: chains through two-bond junctions go whole, elements of which something is needed stay as observers."""
    dropped = set(decision.dropped)
    kept = list(decision.kept)
    read = owners(read_names(scalar.graph))
    for chain in chains(scalar):
        if len(chain) == 2 or chain[0] not in dropped or chain[-1] not in dropped:
            continue
        inner = {scalar.terms[t].junction for t in chain[1:-1]}
        if all(_can_go(scalar, j, read) for j in inner):
            dropped.update(chain)
        else:  # two sources would meet there and leave it undetermined
            dropped.discard(chain[-1])
            kept.append(Kept(chain[-1], "what lies between it and the other inactive end is needed"))
    kinds = element_kinds(scalar.graph)
    acting = {term.element for term in scalar.terms if term.other is None and term.index not in dropped}
    for t in [t for t in dropped if scalar.terms[t].other is None]:
        term = scalar.terms[t]
        if term.element in acting | read and kinds[term.element or ""] == ("C", "I")[scalar.junctions[term.junction].kind]:
            # as an observer its own law would have to be differentiated
            dropped.discard(t)
            kept.append(Kept(t, "a storage of which something is needed"))
    touched = {scalar.terms[t].element for t in dropped if scalar.terms[t].other is None}
    acting = {term.element for term in scalar.terms if term.other is None and term.index not in dropped}
    observers = frozenset(name for name in touched & (acting | read) if name is not None)
    return replace(decision, dropped=frozenset(dropped), kept=tuple(kept), observers=observers)


def _can_go(scalar: ScalarGraph, j: int, read: frozenset[str]) -> bool:
    """Can a two-term junction be left out with its two terms?"""
    members = scalar.junctions[j].members
    return len(members) <= 1 and all(name not in read for name, _ in members)


def chains(scalar: ScalarGraph) -> Iterator[tuple[int, ...]]:
    """Links in a row through two-term junctions, as their terms from one outer end to the other. A single link is a chain of two."""
    done: set[int] = set()
    for term in scalar.terms:
        if term.other is None or term.index in done or _beyond(scalar, term.index) is not None:
            continue
        chain = [term.index, term.other]
        while (after := _beyond(scalar, chain[-1])) is not None:
            far = scalar.terms[after].other
            chain.append(after)
            if far is None:
                break
            chain.append(far)
        done.update(chain)
        yield tuple(chain)


def _beyond(scalar: ScalarGraph, term: int) -> int | None:
    """The other term of a two-term junction, None at any other junction."""
    at = scalar.terms_at[scalar.terms[term].junction]
    if len(at) != 2:
        return None
    return at[1] if at[0] == term else at[0]


def read_names(graph: BondGraph) -> frozenset[str]:
    """Every variable that a signal, an output, a modulus or another element's law reads."""
    roots: list[Expr] = [check.condition for check in graph.checks]
    for equation in (*graph.equations, *graph.initial_equations):
        roots += (equation.left, equation.right)
    roots += [value for element in graph.elements for row in element.modulus or () for value in row]
    found = {leaf.data for leaf in leaves(roots)}
    for element in graph.elements:
        own = element.name + "."
        sides = (side for law in element.laws for side in (law.left, law.right))
        found.update(leaf.data for leaf in leaves(sides) if not leaf.data.startswith(own))
    return frozenset(found)


def owners(names: Iterable[str]) -> frozenset[str]:
    """The things whose variables these are: `spring` of `spring.q[2]`; `lever` and `lever.p1` of `lever.p1.e`."""
    found: set[str] = set()
    for name in names:
        base = name.rpartition(".")[0]
        while base and base not in found:
            found.add(base)
            base = base.rpartition(".")[0]
    return frozenset(found)
