"""Why causality is what it is, told in sentences: from facts and choices, implication by implication, to what was asked."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from bgdsl.ir.causal import Reason
from bgdsl.ir.graph import Element
from bgdsl.ir.scalar import ScalarGraph, Term
from bgdsl.source import Span

LONGEST = 12
"""So many sentences are shown at most; the middle of a longer story is left out."""


@dataclass(frozen=True, slots=True)
class Step:
    """One term's value and the reason for it, at the moment the story is told of."""

    term: int
    value: int
    reason: Reason


def antecedents(scalar: ScalarGraph, reasons: Sequence[Reason], starts: Sequence[int], most: int = 100) -> tuple[int, ...]:
    """The terms from which the values of the start terms follow, nearest first, back to choices and facts (or so many)."""
    seen = dict.fromkeys(starts)
    queue = list(starts)
    for t in queue:
        if len(seen) >= most:
            break
        reason = reasons[t]
        if reason.term is not None:
            before = [reason.term]
        elif reason.cause == "last":
            before = [other for other in scalar.terms_at[scalar.terms[t].junction] if other != t]
        else:
            before = []
        for b in before:
            if b not in seen:
                seen[b] = None
                queue.append(b)
    return tuple(seen)


class Story:
    """Tells stories about one scalar graph."""

    def __init__(self, scalar: ScalarGraph):
        self.scalar = scalar
        self.elements: dict[str, Element] = {element.name: element for element in scalar.graph.elements}
        self.bonds = {bond.name: bond for bond in scalar.graph.bonds}

    def sentences(self, steps: Sequence[Step]) -> list[str]:
        """One sentence a step, causes before effects. The steps come nearest first, as a chain of reasons is followed."""
        told = list(dict.fromkeys(text for step in reversed(steps) if (text := self.sentence(step))))
        if len(told) <= LONGEST:
            return told
        half = LONGEST // 2
        return [*told[:half], f"... ({len(told) - 2 * half} more steps)", *told[-half:]]

    def sentence(self, step: Step) -> str:
        term = self.scalar.terms[step.term]
        sets = f"sets {self.variable(term.junction)}"
        match step.reason.cause:
            case "source":
                return f"{self.named(term)} gives its {self.given(term, step.value)}" + (f" and {sets}" if step.value else "")
            case "modulus":
                way = f"the modulus of {self.named(term)} may vanish, so it is not divided by"
                return f"{way}: `{term.element}` {sets}" if step.value else way
            case "law":
                return f"the law of {self.named(term)} gives its {self.given(term, step.value)} only"
            case "asserted":
                return f"the stroke of bond `{term.bond}` is asserted{self.line(term.origin.span)}"
            case "storage":
                return f"{self.named(term)} has integral causality and gives its {self.given(term, step.value)}" + (
                    f": it {sets}" if step.value else ""
                )
            case "derivative":
                return f"{self.named(term)} has derivative causality" + (f": it {sets}" if step.value else "")
            case "chosen":
                return f"{self.named(term)} is taken to give its {self.given(term, step.value)}"
            case "last":
                return f"nothing else is left to set {self.variable(term.junction)}, so {self.named(term)} does"
            case "far" if step.value:
                return f"so {self.named(term)} {sets}"
            case _:
                return ""

    def is_source(self, term: Term) -> bool:
        """Is this the term of an Se or Sf, modulated or not?"""
        return term.other is None and self.elements[term.element or ""].kind in ("Se", "Sf", "MSe", "MSf")

    def given(self, term: Term, value: int) -> str:
        """What a term gives out when it is (value 1) or is not its junction's determiner."""
        return "flow" if bool(value) == (self.scalar.junctions[term.junction].kind == 1) else "effort"

    def variable(self, j: int) -> str:
        junction = self.scalar.junctions[j]
        return f"the {'flow' if junction.kind else 'effort'} of `{junction.name}`"

    def named(self, term: Term) -> str:
        """An element or bond with its line."""
        if term.element is not None:
            return f"`{term.element}`{self.line(self.elements[term.element].origin.span)}"
        return f"bond `{term.bond}`{self.line(term.origin.span)}"

    def line(self, span: Span) -> str:
        """` (line 4)`, with the file's name where it is not the model's own."""
        own = not self.scalar.graph.sources or span.source is self.scalar.graph.sources[0]
        return f" (line {span.line})" if own else f" ({span.source.name}:{span.line})"

    def span(self, term: Term) -> Span:
        return self.elements[term.element].origin.span if term.element is not None else term.origin.span

    def places(self, terms: Iterable[int], text: str, besides: Span, most: int = 6) -> list[tuple[Span, str]]:
        """The places of elements and bonds along a chain, each once, for labels."""
        spans: dict[tuple[int, int, int], Span] = {}
        for t in terms:
            span = self.span(self.scalar.terms[t])
            if span != besides:
                spans.setdefault((id(span.source), span.start, span.end), span)
        return [(span, text) for span in list(spans.values())[:most]]
