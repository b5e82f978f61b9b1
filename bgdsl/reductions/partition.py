"""Partitions of a model at a threshold: found, reported, and written one file each.

Input        ScalarGraph, ActivityReport, a threshold; how dependencies and partitions are found (callables)
Output       Partitioning; the text of each partition, and what passes between them
Establishes  a partition reads earlier ones only; by default only terms by which a partition feels a later one are dropped
Reports      nothing: where there is one partition only, `Partitioning.misses` says which terms stand in the way
"""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from bgdsl.ir.activity import ActivityReport
from bgdsl.ir.partition import Dependencies, Edge, Frozen, Partition, Partitions
from bgdsl.ir.scalar import ScalarGraph
from bgdsl.reductions.condition import Decision, decide, settle
from bgdsl.reductions.determined import gone_elements, reinstate
from bgdsl.reductions.part import Part
from bgdsl.reductions.passed import passed_names
from bgdsl.reductions.rewrite_source import LEAST_TOLD, Provenance, describing
from bgdsl.reductions.source_map import UnwritableError, refuse
from bgdsl.reductions.structured_text import needed, structured_text

Needs = Callable[[frozenset[int]], Dependencies]
Split = Callable[[Dependencies, Collection[Edge]], Partitions]


NOTHING = 1e-12
"""A relative activity that is nothing: rounding of what cancels."""


@dataclass(frozen=True, slots=True)
class Miss:
    """A term that would have to fall for the model to come apart, and its rho."""

    term: int
    junction: str
    name: str
    rho: float


@dataclass(frozen=True, slots=True)
class Partitioning:
    """decision: what is dropped, inside the partitions too if they are to be conditioned. misses: nearest first, if there is one
    partition only; apart_at: the threshold at which they would fall, None if at none."""

    decision: Decision
    partitions: Partitions
    frozen: tuple[Frozen, ...] = ()
    misses: tuple[Miss, ...] = ()
    apart_at: float | None = None


def find_partitions(
    scalar: ScalarGraph,
    report: ActivityReport,
    threshold: float,
    needs: Needs,
    split: Split,
    *,
    conditioned: bool = False,
    guard: bool = True,
    freezable: Mapping[Edge, Frozen] | None = None,
) -> Partitioning:
    """The partitions at a threshold. freezable: modulating edges whose signal may be held, with what that changes; those below
    the threshold are held where they would close a loop between partitions."""
    holding = {edge: frozen for edge, frozen in (freezable or {}).items() if frozen.change < threshold}
    decision = reinstate(scalar, report, decide(scalar, report, threshold, guard=guard))
    found, frozen = _apart(needs(decision.dropped), split, holding)
    if len(found.partitions) < 2:
        misses, apart_at = nearest_misses(scalar, report, threshold, needs, split, guard=guard, freezable=freezable or {})
        return Partitioning(decision, found, (), misses, apart_at)
    if not conditioned:
        decision = boundary(scalar, report, decision, found, needs(frozenset()))
        found, frozen = _apart(needs(decision.dropped), split, holding)
    return Partitioning(decision, found, frozen)


def boundary(scalar: ScalarGraph, report: ActivityReport, decision: Decision, found: Partitions, full: Dependencies) -> Decision:
    """The decision restricted to terms by which a partition would feel a later one: the far side's variable, or a modulus that reads
    it. At the other end of such a bond the term stays, since what drives may be felt, unless nothing at all passes there. full:
    dependencies of the whole model."""
    against = {edge.term for edge in full.edges if found.of_node[edge.source] > found.of_node[edge.reader]}
    idle = {term.index for junction in report.junctions for term in junction.terms if term.rho <= NOTHING}
    apart = {t for t in decision.dropped & idle if _crosses(scalar, found, t)}
    return settle(scalar, decision.restricted(frozenset(t for t in decision.dropped if t in against or t in apart)))


def _crosses(scalar: ScalarGraph, found: Partitions, t: int) -> bool:
    far = scalar.terms[t].other
    return far is not None and found.of_node[scalar.terms[far].junction] != found.of_node[scalar.terms[t].junction]


def _apart(needs: Dependencies, split: Split, holding: Mapping[Edge, Frozen]) -> tuple[Partitions, tuple[Frozen, ...]]:
    """Partitions with as many signals held as it takes: those against the order found when all are."""
    edges = [edge for edge in needs.edges if edge in holding]
    found = split(needs, edges)
    against = [edge for edge in edges if found.of_node[edge.source] > found.of_node[edge.reader]]
    return split(needs, against), tuple(holding[edge] for edge in against)


def nearest_misses(
    scalar: ScalarGraph,
    report: ActivityReport,
    threshold: float,
    needs: Needs,
    split: Split,
    *,
    guard: bool,
    freezable: Mapping[Edge, Frozen],
    most: int = 12,
) -> tuple[tuple[Miss, ...], float | None]:
    """The terms that would have to fall beside those below the threshold, nearest first, and the threshold that fells them."""
    levels = sorted({term.rho for junction in report.junctions for term in junction.terms if threshold <= term.rho < 1.0})
    levels += sorted({f.change for f in freezable.values() if threshold <= f.change < 1.0})
    levels.sort()

    def at(level: float) -> tuple[Decision, Partitions]:
        eps = level * (1 + 1e-12) + 1e-300
        decision = decide(scalar, report, eps, guard=guard)
        holding = {edge: frozen for edge, frozen in freezable.items() if frozen.change < eps}
        return decision, _apart(needs(decision.dropped), split, holding)[0]

    low, high = 0, len(levels)
    while low < high:
        middle = (low + high) // 2
        if len(at(levels[middle])[1].partitions) >= 2:
            high = middle
        else:
            low = middle + 1
    if low == len(levels):
        return (), None
    decision, found = at(levels[low])
    between = boundary(scalar, report, decision, found, needs(frozenset())).dropped
    records = report.by_index()
    names = {term.index: junction.name for junction in report.junctions for term in junction.terms}
    misses = [Miss(t, names[t], records[t].name, records[t].rho) for t in between if records[t].rho >= threshold]
    return tuple(sorted(misses, key=lambda miss: (miss.rho, miss.term))[:most]), levels[low]


# -------------------------------------------------------------------------------------------------------------- written


@dataclass(frozen=True, slots=True)
class Written:
    """One partition's file: its name, its text, the variables it reads and gives with the names they have there, and where flat paths
    of the model have gone (None: not here)."""

    file: str
    text: str
    partition: Partition
    inputs: Mapping[str, str]
    outputs: Mapping[str, str]
    forward: Mapping[str, str | None]


def write_partitions(
    scalar: ScalarGraph,
    report: ActivityReport,
    result: Partitioning,
    provenance: Provenance,
    stem: str,
    *,
    folder: Path | None = None,
    changed: Mapping[str, float] | None = None,
    wanted: Collection[int] | None = None,
) -> tuple[Written, ...]:
    """The file of each partition (or of those wanted). changed: parameters that get new defaults. BG703 if one cannot be written."""
    try:
        return _all_written(scalar, report, result, provenance, stem, folder, changed or {}, wanted)
    except UnwritableError as problem:
        refuse(scalar.graph, problem.reason)


def _all_written(
    scalar: ScalarGraph,
    report: ActivityReport,
    result: Partitioning,
    provenance: Provenance,
    stem: str,
    folder: Path | None,
    changed: Mapping[str, float],
    wanted: Collection[int] | None,
) -> tuple[Written, ...]:
    parts = [_part(scalar, result, partition, changed) for partition in result.partitions.partitions]
    asked = [needed(scalar, part) for part in parts]
    asked = [inputs if wanted is None or k in wanted else () for k, inputs in enumerate(asked)]
    homes = _homes(scalar, result.partitions)
    passed = passed_names(scalar.graph, asked, lambda v: homes.get(v, -1))
    written = []
    for partition, part in zip(result.partitions.partitions, parts, strict=True):
        if wanted is not None and partition.number not in wanted:
            continue
        gives = tuple(v for v in passed if homes.get(v) == partition.number)
        model = f"{report.model}_{partition.number + 1}_{partition.role}"
        part = replace(part, outputs=gives, passed=passed)
        new = structured_text(scalar, part, provenance.annotation(), describing(report), folder=folder, name=model)
        file = f"{stem}_{partition.number + 1}_{partition.role}.bg"
        written.append(Written(file, new.text, partition, new.inputs, new.outputs, new.forward))
    return tuple(written)


def _homes(scalar: ScalarGraph, found: Partitions) -> dict[str, int]:
    """The partition that has each variable: of junctions, signals, and elements at their junctions."""
    homes = {scalar.junctions[j].variable: p.number for p in found.partitions for j in p.junctions}
    homes |= {signal: p.number for p in found.partitions for signal in p.signals}
    elements = {element.name: element for element in scalar.graph.elements}
    for term in scalar.terms:
        if term.element is not None and (term.other is None or term.modulus is not None):
            port = elements[term.element].ports[term.port]
            for letter in "efpq":
                homes.setdefault(port.variable(term.element, letter, term.spot), found.of_node[term.junction])
    return homes


def partitions_for(scalar: ScalarGraph, result: Partitioning, variables: Iterable[str]) -> frozenset[int]:
    """The partitions that give these variables, and all that drive them."""
    found, homes = result.partitions.partitions, _homes(scalar, result.partitions)
    waiting = [homes[v] for v in variables if v in homes]
    wanted: set[int] = set()
    while waiting:
        number = waiting.pop()
        if number not in wanted:
            wanted.add(number)
            waiting += found[number].drivers
    return frozenset(wanted)


def _part(scalar: ScalarGraph, result: Partitioning, partition: Partition, changed: Mapping[str, float]) -> Part:
    frozen = {(f.reader, f.signal): f.value for f in result.frozen}
    gone = gone_elements(scalar, result.decision)
    return Part(frozenset(partition.junctions), frozenset(partition.signals), result.decision.dropped, gone, frozen, changed=changed)


def _figure(share: float) -> float:
    """Three digits, or one where the others would be those of the integrator's error: the document is to be compared."""
    return float(f"{share:.3g}" if share >= LEAST_TOLD else f"{share:.0e}")


def partition_json(scalar: ScalarGraph, report: ActivityReport, result: Partitioning, written: Sequence[Written]) -> str:
    """`partition.json`: the files with their sizes, the signals between them, the dropped terms, the signals held."""
    records = report.by_index()
    names = {term.index: junction.name for junction in report.junctions for term in junction.terms}
    files = {w.partition.number: w.file for w in written}
    giver = {v: w.partition.number for w in written for v in w.outputs}
    return json.dumps(
        {
            "model": report.model,
            "experiment": report.experiment,
            "window": list(report.window),
            "threshold": result.decision.threshold,
            "partitions": [
                {
                    "file": w.file,
                    "role": w.partition.role,
                    "states": len(w.partition.states),
                    "drivers": [files[d] for d in w.partition.drivers if d in files],
                    "inputs": list(w.inputs.values()),
                    "outputs": list(w.outputs.values()),
                    "state_names": list(w.partition.states),
                }
                for w in written
            ],
            "signals": [
                {"variable": v, "name": name, "from": files[giver[v]], "to": w.file}
                for w in written
                for v, name in w.inputs.items()
                if v in giver
            ],
            "terms": [
                {"term": records[t].name, "junction": names[t], "rho": _figure(records[t].rho)} for t in sorted(result.decision.dropped)
            ],
            "frozen": [
                {
                    "signal": f.signal,
                    "reader": f.reader if isinstance(f.reader, str) else records[f.reader].name,
                    "value": f.value,
                    "change": _figure(f.change),
                }
                for f in result.frozen
            ],
        },
        indent=2,
    )
