"""A decision written as source: the conditioned model in the language itself.

Input        Library, ScalarGraph, ActivityReport, Decision, Provenance
Output       Rewrite      the text of the new file, or the same text where nothing is dropped
Establishes  the new text says the full model's equations less the dropped terms; every byte that need not change stays
Reports      nothing: a term whose change cannot be written stays, with the reason, in `Rewrite.taken_back`
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from bgdsl.diagnostics import BgError
from bgdsl.ir.activity import ActivityReport
from bgdsl.ir.rewrite import Change, Rewrite
from bgdsl.ir.scalar import ScalarGraph
from bgdsl.reductions.acts import give
from bgdsl.reductions.again import fold, parts_of, write_again
from bgdsl.reductions.condition import Decision, owners, read_names, settle
from bgdsl.reductions.cuts import write_cuts
from bgdsl.reductions.declared import Tell
from bgdsl.reductions.defaults import settle_defaults
from bgdsl.reductions.determined import gone_elements
from bgdsl.reductions.documents import document
from bgdsl.reductions.one_way import write_parts
from bgdsl.reductions.part import everything
from bgdsl.reductions.plan import Plan, plan
from bgdsl.reductions.removals import write_removal
from bgdsl.reductions.source_map import SourceMap, UnwritableError, indexed, refuse
from bgdsl.reductions.specialise import Describe, specialise, term_mark
from bgdsl.reductions.structured_text import structured_text
from bgdsl.reductions.two_ports import in_sources, write_split
from bgdsl.reductions.writer import PortBonds, Writer
from bgdsl.source import Edit
from bgdsl.syntax.library import Library


@dataclass(frozen=True, slots=True)
class Provenance:
    """Where a reduced model comes from, as its annotation says; `settings` are further `name = value` texts."""

    source: str
    digest: str
    model: str
    experiment: str | None
    window: tuple[float, float]
    tool: str
    kind: str = "conditioned"
    settings: tuple[tuple[str, str], ...] = ()

    def annotation(self) -> str:
        """The annotation's text; it names no folder, no machine and no date."""
        parts = [f'source = "{self.source}"', f'sha256 = "{self.digest}"']
        if self.experiment is not None:
            parts.append(f'experiment = "{self.experiment}"')
        parts.append(f"window = {{{number(self.window[0])}, {number(self.window[1])}}}")
        parts += [f"{name} = {value}" for name, value in self.settings]
        parts.append(f'tool = "{self.tool}"')
        return f"annotation({self.kind}({', '.join(parts)}));"


def number(value: float) -> str:
    """A number as the language writes it: the shortest text that gives it back."""
    if value == int(value) and abs(value) < 1e15:
        return str(int(value))
    return repr(value)


def rewrite(
    library: Library,
    scalar: ScalarGraph,
    report: ActivityReport,
    decision: Decision,
    provenance: Provenance,
    *,
    folder: Path | None = None,
    more: tuple[Edit, ...] = (),
    changed: Mapping[str, float] | None = None,
    form: Literal["auto", "kept", "opened"] = "auto",
) -> tuple[Rewrite, Decision]:
    """The new text, and the decision as it was written: less the terms whose change cannot be written.

    folder: where the file goes, if not beside the model; more: further edits of the main file. form: `kept` keeps the classes, and
    takes back the terms that cannot be written so; `opened` puts the model together anew, its vectors opened where they are cut; `auto`
    does so where `kept` would have to take terms back. BG703 if the file cannot be put together at all.
    """
    if plan(scalar, decision).empty and not more and not changed:
        return Rewrite(library.main.source.text), decision
    if form == "opened":
        return _opened(scalar, report, decision, provenance, folder, changed or {}, {}), decision
    try:
        result, settled = _kept(library, scalar, report, decision, provenance, folder, more)
    except UnwritableError as problem:
        if form == "kept":
            refuse(scalar.graph, problem.reason)
        return _opened(scalar, report, decision, provenance, folder, changed or {}, {-1: problem.reason}), decision
    if form == "auto" and result.taken_back:
        with suppress(BgError):
            return _opened(scalar, report, decision, provenance, folder, changed or {}, result.taken_back), decision
    return result, settled


def _kept(
    library: Library,
    scalar: ScalarGraph,
    report: ActivityReport,
    decision: Decision,
    provenance: Provenance,
    folder: Path | None,
    more: tuple[Edit, ...],
) -> tuple[Rewrite, Decision]:
    """The model in its own classes; terms that cannot be written so are taken back, one problem after the other."""
    taken_back: dict[int, str] = {}
    while True:
        task = plan(scalar, decision)
        if task.empty and not more:
            return Rewrite(library.main.source.text, taken_back=taken_back), decision
        try:
            return _written(library, scalar, report, task, provenance, folder, more, taken_back), decision
        except UnwritableError as problem:
            back = [t for t in problem.terms if t in decision.dropped]
            if not back:
                raise
            taken_back.update((t, problem.reason) for t in back)
            decision = settle(scalar, decision.without(back))


def _opened(
    scalar: ScalarGraph,
    report: ActivityReport,
    decision: Decision,
    provenance: Provenance,
    folder: Path | None,
    changed: Mapping[str, float],
    reasons: Mapping[int, str],
) -> Rewrite:
    comments = term_comments(scalar, report)
    part = replace(everything(scalar, decision.dropped, gone_elements(scalar, decision)), changed=changed)
    try:
        new = structured_text(scalar, part, provenance.annotation(), describing(report), folder=folder)
    except UnwritableError as problem:
        refuse(scalar.graph, problem.reason)
    changes = tuple(Change(comments[t], scalar.terms[t].origin.span, (t,)) for t in sorted(decision.dropped))
    # one reason for all elements of an array
    told = tuple(dict.fromkeys(re.sub(r"\[[\d,]+\]", "", reason) for reason in reasons.values()))
    return Rewrite(new.text, changes, new.forward, opened=True, reasons=told)


def _written(
    library: Library,
    scalar: ScalarGraph,
    report: ActivityReport,
    task: Plan,
    provenance: Provenance,
    folder: Path | None,
    more: tuple[Edit, ...],
    taken_back: Mapping[int, str],
) -> Rewrite:
    texts = SourceMap(library, scalar.graph)
    writer = Writer(texts, scalar)
    before = parts_of(writer)
    whole_task, (task, lost) = task, fold(task, before, writer)
    comments = {term.index: term_mark(term.index) for term in scalar.terms}
    bonds = port_bonds(scalar)
    read = owners(read_names(scalar.graph))
    kinds = {term.index: scalar.junctions[term.junction].kind for term in scalar.terms}
    parts = [split for split in task.splits if not in_sources(writer, split, bonds, read)]
    write_parts(writer, parts, kinds, read)
    for split in task.splits:
        if split not in parts:
            write_split(writer, split, bonds, kinds, comments)
    write_cuts(writer, task.cuts, scalar, comments)
    gone = {removal.element.name for removal in task.removals if removal.gone}
    for removal in task.removals:
        path, _, last = removal.element.name.rpartition(".")
        whole = all(element.name in gone for element in writer.elements[path, indexed(last)[0]])
        write_removal(writer, removal, bonds, comments, whole)
    for name in task.junctions:
        writer.remove_junction(name)
    levels = write_again(writer, before, lost)
    odd = settle_defaults(writer)
    variants = specialise(texts, writer.edits, describing(report))
    given = give(texts, writer.edits, variants, odd, levels)
    text = document(texts, variants, given, telling(report, writer.told), provenance.annotation(), folder, more)
    specialised = {v.name: v.unit.model.name for v in variants if v.renamed}
    forward: dict[str, str | None] = {removal.element.name: None for removal in task.removals if removal.gone}
    forward |= dict.fromkeys(task.junctions)
    forward |= {split.element.name: f"{split.element.name}.both" for split in parts}
    return Rewrite(text, _changes(scalar, whole_task, term_comments(scalar, report)), forward, specialised, dict(taken_back))


def _changes(scalar: ScalarGraph, task: Plan, comments: Mapping[int, str]) -> tuple[Change, ...]:
    dropped = [t for cut in task.cuts for c, a in cut.actions.items() for t in _ends(cut.terms[c], a)]
    dropped += [t for s in task.splits for e in s.entries for t, gone in zip(e.terms, e.dropped, strict=True) if gone]
    dropped += [t for removal in task.removals for t in removal.terms]
    return tuple(Change(comments[t], scalar.terms[t].origin.span, (t,)) for t in sorted(dropped))


def _ends(pair: tuple[int, int], action: str) -> tuple[int, ...]:
    return pair if action == "both" else (pair[0],) if action == "tail" else (pair[1],)


def term_comments(scalar: ScalarGraph, report: ActivityReport) -> dict[int, str]:
    """What the new text says of a dropped term: what it was, where, and its rho."""
    comments: dict[int, str] = {}
    for junction in report.junctions:
        what = "effort" if junction.kind == 1 else "flow"
        for term in junction.terms:
            comments[term.index] = f"dropped at {junction.name}: {what} of {term.name}, {told(percent(term.rho))}"
    return comments


def describing(report: ActivityReport) -> Describe:
    """How the comment on a term is made that several instances of a class, or turns of a loop, may share: names within the class, the
    range of rho."""
    found = {term.index: (junction, term) for junction in report.junctions for term in junction.terms}

    def describe(instances: list[tuple[str, tuple[int, ...]]]) -> str:
        path, (first, *others) = instances[0]
        junction, term = found[first]
        share = shares([found[t][1].rho for _, terms in instances for t in terms])
        where, name = (text.removeprefix(f"{path}.") if path else text for text in (junction.name, term.name))
        for t in others:
            where, name = unlike(where, found[t][0].name), unlike(name, found[t][1].name)
        return f"dropped at {where}: {'effort' if junction.kind == 1 else 'flow'} of {name}, {told(share)}"

    return describe


def unlike(name: str, other: str) -> str:
    """A name with `i` for the subscripts in which another one differs."""
    mine, theirs = re.split(r"(\d+)", name), re.split(r"(\d+)", other)
    return "".join(a if a == b else "i" for a, b in zip(mine, theirs, strict=False)) if len(mine) == len(theirs) else name


def shares(rhos: Sequence[float]) -> str:
    """One share, or the range of several."""
    low, high = percent(min(rhos)), percent(max(rhos))
    return low if low == high else f"{low} to {high}" if min(rhos) >= LEAST_TOLD else f"up to {high}"


TOLD_WIDTH = 130


def telling(report: ActivityReport, fell: Mapping[str, Sequence[tuple[str, str, int]]]) -> Tell:
    """How the lines are made about what fell in a matrix or bond, in all of its instances that are told of together."""
    rho = {term.index: term.rho for junction in report.junctions for term in junction.terms}

    def tell(name: str, elements: Sequence[str]) -> list[str]:
        found: dict[str, dict[str, list[float]]] = {}
        for element in elements:
            for what, entry, term in fell.get(element, ()):
                found.setdefault(what, {}).setdefault(entry, []).append(rho[term])
        pieces: list[str] = []
        for what, entries in found.items():
            by_share: dict[str, list[str]] = {}
            for entry, rhos in sorted(entries.items()):
                by_share.setdefault(shares(rhos), []).append(entry)
            groups = [f"{' '.join([*filter(None, places), ''])}({told(share)})" for share, places in by_share.items()]
            pieces += [f"{what} {groups[0]}", *groups[1:]]
        unbroken = [piece.replace(" ", "\N{NO-BREAK SPACE}") for piece in pieces]
        lines = textwrap.wrap(f"dropped in {name}: {', '.join(unbroken)}", TOLD_WIDTH, subsequent_indent="  ") if pieces else []
        return [line.replace("\N{NO-BREAK SPACE}", " ") for line in lines]

    return tell


LEAST_TOLD = 1e-5
"""A relative activity below this is told as such: its digits would be those of the integrator's error."""


def percent(rho: float) -> str:
    """A share as people read it: three digits."""
    return f"{100 * rho:.3g} %" if rho >= LEAST_TOLD else f"below {100 * LEAST_TOLD:g} %"


def told(share: str) -> str:
    """What a comment says of a rho."""
    return f"rho {share}" if share.startswith(("below", "up to")) else f"rho = {share}"


def port_bonds(scalar: ScalarGraph) -> PortBonds:
    """The bond and its component at every component of every element's port."""
    found = {}
    for bond in scalar.graph.bonds:
        for end in (bond.tail, bond.head):
            for c, i in enumerate(end.components):
                found[end.node, end.port, i] = (bond, c)
    return found
