"""What causality has to report, with the chain of implications behind it.

Reports      BG401 effort fixed twice, BG402 flow fixed twice, BG403 a junction that nothing can set, BG404 a stroke that cannot
             be honoured, BG405 a law that works in one direction only, BG420 derivative causality (warning)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from bgdsl.diagnostics import Code, Reporter, listed
from bgdsl.ir.causal import Constrained
from bgdsl.ir.graph import Bond
from bgdsl.ir.scalar import Term
from bgdsl.passes.causal_story import Step, Story

TWO_EFFORTS = Code("BG401", "two sources fix one effort")
TWO_FLOWS = Code("BG402", "two sources fix one flow")
NOTHING_SETS = Code("BG403", "nothing can set a junction's variable")
STROKE = Code("BG404", "an asserted causal stroke cannot be honoured")
ONE_WAY = Code("BG405", "a law works in the other direction only")
DEPENDENT = Code("BG420", "a storage has derivative causality", "warning")


def two_sources(story: Story, report: Reporter, first: Term, second: Term) -> None:
    """Two sources of one kind on one junction."""
    junction = story.scalar.junctions[first.junction]
    kind, word = junction.kind, "flow" if junction.kind else "effort"
    report.add(
        TWO_FLOWS if kind else TWO_EFFORTS,
        f"two {word} sources fix the {word} of {kind}-junction `{junction.name}`",
        story.span(second),
        "second source, here",
        others=[(story.span(first), "first source")],
        notes=[f"a {kind}-junction has one {word}; only one bond may set it"],
        helps=[f"put a {1 - kind}-junction with an R between one source and `{junction.name}`"],
    )


def sources_only(story: Story, report: Reporter, place: Constrained, sources: Sequence[Term], ways: Sequence[Sequence[int]]) -> None:
    """A constraint that no state and no resistor can satisfy: everything in it comes from sources along these ways (terms)."""
    if place.term is None:
        _nothing_sets(story, report, place, sources, ways)
    else:
        _fixed_twice(story, report, place, sources, ways)


def _nothing_sets(story: Story, report: Reporter, place: Constrained, sources: Sequence[Term], ways: Sequence[Sequence[int]]) -> None:
    junction = story.scalar.junctions[place.junction]
    word, given = ("flow", "effort") if junction.kind else ("effort", "flow")
    span = junction.origin.span
    shown = {source.element or "": source for source in sources}
    notes = [f"every {given} at a {junction.kind}-junction is given here, and their sum has to be zero whatever the {word} is"]
    if not sources:
        notes = [f"`{junction.name}` has no bond to an element" if ways else f"`{junction.name}` has no bonds"]
    report.add(
        NOTHING_SETS,
        f"nothing can set the {word} of {junction.kind}-junction `{junction.name}`",
        span,
        f"its {word} is not determined",
        others=[
            *((story.span(source), f"fixes its {given}") for source in shown.values()),
            *story.places((t for way in ways for t in way if story.scalar.terms[t].element not in shown), "on the way", span),
        ],
        notes=[*notes, *_chain(story, ways)],
        helps=[f"bond an element to `{junction.name}` that gives its {word}: {'an I or R' if junction.kind else 'a C or R'}"]
        if sources
        else [],
    )


def _fixed_twice(story: Story, report: Reporter, place: Constrained, sources: Sequence[Term], ways: Sequence[Sequence[int]]) -> None:
    junction = story.scalar.junctions[place.junction]
    word = "flow" if junction.kind else "effort"
    last = sources[0] if sources else story.scalar.terms[place.term or 0]
    names = {source.element or "": source for source in sources[1:]}
    report.add(
        TWO_FLOWS if junction.kind else TWO_EFFORTS,
        f"the {word} of {junction.kind}-junction `{junction.name}` is fixed more than once" + (" by sources" if names else ""),
        story.span(last),
        "this source, and" if names else "this fixes it, and something else does",
        others=[
            *((story.span(source), "this one") for source in names.values()),
            *story.places(
                (t for way in ways for t in way if story.scalar.terms[t].element not in {*names, last.element}),
                "on the way",
                story.span(last),
            ),
        ],
        notes=[f"a {junction.kind}-junction has one {word}; only one bond may set it", *_chain(story, ways)],
        helps=["put an element that gives way between them: an R, or a C or I"],
    )


def _chain(story: Story, ways: Sequence[Sequence[int]]) -> list[str]:
    """The chain of junctions, bonds and elements from one source, over the place where they meet, to another, in one line.

    A way is a list of terms from that place to a source.
    """
    pairs = [
        [(f"`{story.scalar.junctions[term.junction].name}`", story.named(term)) for t in way if (term := story.scalar.terms[t])]
        for way in ways
    ]
    inward = [name for junction, named in reversed(pairs[0]) for name in (named, junction)] if pairs else []
    outward = [name for way in pairs[1:2] for pair in way for name in pair]
    names = list(dict.fromkeys([*inward, *outward]))
    if len(names) > 16:
        names = [*names[:8], "...", *names[-7:]]
    return [f"the chain: {' - '.join(names)}"] if len(names) > 3 else []


def refused_stroke(story: Story, report: Reporter, bond: Bond, steps: Sequence[Step]) -> None:
    """An asserted stroke that contradicts what is fixed."""
    other = {"tail": "head", "head": "tail"}[bond.stroke or "head"]
    arrow = {"tail": "|-> (|=>)", "head": "->| (=>|)"}
    span = bond.origins[-1].span
    report.add(
        STROKE,
        f"the causal stroke of bond `{bond.name}` cannot be honoured",
        span,
        f"effort cannot act on the {'end' if bond.stroke == 'head' else 'start'} of this bond",
        others=story.places((step.term for step in steps), "this takes part", span),
        notes=story.sentences(
            [step for step in steps if step.reason.cause != "asserted" or story.scalar.terms[step.term].bond != bond.name]
        ),
        helps=[f"write `{arrow[other]}`, or leave the stroke to the compiler: `->` (`=>`)"],
    )


def needless_derivative(story: Story, report: Reporter, bond: Bond, state: str, term: Term) -> None:
    """An asserted stroke that gives an independent storage derivative causality."""
    report.add(
        STROKE,
        f"the causal stroke of bond `{bond.name}` cannot be honoured: `{state}` is an independent state",
        bond.origins[-1].span,
        f"with this stroke `{term.element}` would have derivative causality",
        others=[(story.span(term), "no other state determines this")],
        notes=["a storage can have derivative causality only where other states or sources determine what it stores"],
        helps=["leave the stroke to the compiler: `->` (`=>`)"],
    )


def one_way_law(story: Story, report: Reporter, term: Term, value: int, steps: Sequence[Step]) -> None:
    """A law that would have to be turned around and cannot."""
    element = story.elements[term.element or ""]
    law = element.laws[min(term.spot, len(element.laws) - 1)]
    gives, wanted = (story.given(term, value), story.given(term, 1 - value))
    junction, giver = (1, "an I, parasitic perhaps") if gives == "effort" else (0, "a C, parasitic perhaps")
    report.add(
        ONE_WAY,
        f"the law of `{element.name}` gives its {gives}, and its {wanted} is needed",
        law.origin.span,
        f"this cannot be solved for the {wanted}",
        others=story.places((step.term for step in steps), "this takes part", law.origin.span),
        notes=story.sentences(steps),
        helps=[f"put `{element.name}` on a {junction}-junction whose {wanted} something else sets: {giver}"],
    )


def dependent_storages(story: Story, report: Reporter, derivative: Mapping[str, tuple[int, ...]], first: Sequence[Step]) -> None:
    """One warning for all storages in derivative causality; the first one's story is told."""
    terms = [story.scalar.terms[path[0]] for path in derivative.values()]
    states = list(derivative)
    elements = dict.fromkeys(term.element or "" for term in terms)
    span = story.span(terms[0])
    more = [story.span(story.scalar.terms[path[0]]) for path in derivative.values()]
    others = list(dict.fromkeys((s.source, s.start, s.end) for s in more if s != span))
    spans = [next(s for s in more if (s.source, s.start, s.end) == key) for key in others[:5]]
    count = f"{len(elements)} storages have" if len(elements) > 1 else f"`{terms[0].element}` has"
    report.add(
        DEPENDENT,
        f"{count} derivative causality: {listed(states, 4)} {'are' if len(states) > 1 else 'is'} given by other states or sources",
        span,
        "not independent",
        others=[(s, "nor is this") for s in spans],
        notes=story.sentences(first),
        helps=["nothing has to be done: the equations are exact; a C or an R between the parts would make them independent"],
    )
