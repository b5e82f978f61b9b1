"""Physical domains along every bond.

Input        BondGraph   ports, and bonds that ran through ports, carry the domains declared there
Output       BondGraph   every junction, port and bond carries its domain; `Generic` where nothing says
Establishes  what a transformer, gyrator or user element does not separate has one domain
Reports      BG301 two domains joined
"""

from __future__ import annotations

from dataclasses import replace

from bgdsl.diagnostics import Code, Reporter
from bgdsl.ir.change import changed
from bgdsl.ir.domains import GENERIC
from bgdsl.ir.graph import Bond, BondGraph, Element, Origin
from bgdsl.ir.regions import Regions

JOINED = Code("BG301", "two physical domains joined without a transformer or gyrator")

Claim = tuple[str, Origin]
"""A domain and the place that declares it."""


def check_domains(graph: BondGraph, report: Reporter) -> BondGraph:
    """The graph with the domain of every junction, port and bond, inferred from what ports declare.

    Two domains in one region are reported at the bond that joins them, with both declarations.
    """
    if not _declares(graph):
        return graph
    regions = Regions(graph)
    claims: dict[int, Claim] = {}
    for element in graph.elements:
        for k, port in enumerate(element.ports):
            if port.domain != GENERIC:
                for i in range(port.width):
                    claims[regions.place(element.name, k, i)] = (port.domain, element.origin)
    for bond in graph.bonds:
        _join(bond, regions, claims, report)
    return _with_domains(graph, regions, {regions.find(place): domain for place, (domain, _) in claims.items()})


def _declares(graph: BondGraph) -> bool:
    """Whether any port declares a domain; most small models declare none."""
    return any(bond.declared for bond in graph.bonds) or any(port.domain != GENERIC for element in graph.elements for port in element.ports)


def _join(bond: Bond, regions: Regions, claims: dict[int, Claim], report: Reporter) -> None:
    """Unite what the bond joins; where that brings two domains together, say so once and leave the sides apart."""
    reported = False
    for tail, head in zip(regions.at(bond.tail), regions.at(bond.head), strict=True):
        one, other = regions.find(tail), regions.find(head)
        found = [claims[one]] if one in claims else []
        found += [claim for claim in bond.declared if claim[0] != GENERIC]
        found += [claims[other]] if other in claims and other != one else []
        clash = next((claim for claim in found if claim[0] != found[0][0]), None)
        if clash is not None:
            if not reported:
                _report(bond, found[0], clash, report)
            reported = True
            continue
        joined = regions.join(one, other)
        if found:
            claims[joined] = found[0]


def _report(bond: Bond, one: Claim, other: Claim, report: Reporter) -> None:
    place = min(bond.origins, key=lambda origin: origin.path.count(".") + bool(origin.path)).span  # the outermost statement
    report.add(
        JOINED,
        f"bond `{bond.name}` joins the {one[0]} and the {other[0]} domain",
        place,
        "joined here",
        others=[(claim[1].span, f"{claim[0]} by this") for claim in (one, other) if claim[1].span != place],
        notes=["effort and flow of different domains cannot be summed or set equal"],
        helps=["put a TF, a GY or an `element` with a port of each domain between them"],
    )


def _with_domains(graph: BondGraph, regions: Regions, domains: dict[int, str]) -> BondGraph:
    """The graph with domains written in; a vector whose components differ is `Generic` as a whole."""

    def common(places: list[int]) -> str:
        if len(places) == 1:
            return domains.get(regions.find(places[0]), GENERIC)
        found = {domains.get(regions.find(place), GENERIC) for place in places}
        return found.pop() if len(found) == 1 else GENERIC

    def around(node: str, port: int, width: int) -> str:
        first = regions.place(node, port)
        return common([first + i for i in range(width)])

    def in_place(element: Element) -> Element:
        ports = tuple(changed(port, "domain", around(element.name, k, port.width)) for k, port in enumerate(element.ports))
        return changed(element, "ports", ports)

    return replace(
        graph,
        junctions=tuple(changed(j, "domain", around(j.name, 0, j.size or 1)) for j in graph.junctions),
        elements=tuple(in_place(element) for element in graph.elements),
        bonds=tuple(changed(bond, "domain", common(regions.at(bond.tail))) for bond in graph.bonds),
    )
