"""What the annotation of a reduced model says: where it comes from, and how its terms were chosen.

Output       Choice      how terms are chosen, to be written into an annotation and read back, so that the choice can be made again
             Reduction   a whole annotation as read
Reports      nothing

A reduction is made once: what was measured was the full model, and its terms are the ones that the choice is about. So the same
choice, over the same run of the model that it wrote, changes nothing more; neither does a choice that would have dropped less.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

from bgdsl.source import Span
from bgdsl.syntax import ast


@dataclass(frozen=True, slots=True)
class Choice:
    """threshold: terms below it fall; guard: but not those of a large rms; elements: one-ports too. Of a search, max_error: what it
    allowed, of these outputs, at equal angles of this shaft; spared: terms (by index) that stay though they are below the threshold.
    keep: of element elimination, the share of activity that stays. inside: of partitions, also terms within them fell."""

    threshold: float
    guard: bool = True
    elements: bool = True
    keep: float | None = None
    max_error: float | None = None
    outputs: tuple[str, ...] | None = None
    shaft: str | None = None
    spared: frozenset[int] = field(default=frozenset())
    inside: bool = False

    def settings(self) -> dict[str, str]:
        """The annotation's entries, as name and text; what is as usual goes without saying."""
        said = {"threshold": repr(self.threshold)}
        said |= {} if self.guard else {"guard": "false"}
        said |= {} if self.elements else {"elements": "false"}
        said |= {} if self.keep is None else {"keep": repr(self.keep)}
        said |= {} if self.max_error is None else {"max_error": repr(self.max_error)}
        said |= {} if self.outputs is None else {"outputs": f'"{", ".join(name.replace(" ", "") for name in self.outputs)}"'}
        said |= {} if self.shaft is None else {"shaft": f'"{self.shaft}"'}
        said |= {"spared": f'"{ranges(self.spared)}"'} if self.spared else {}
        return said | ({"inside": "true"} if self.inside else {})

    def covers(self, other: Choice) -> bool:
        """Would the other choice drop nothing that this one did not?"""
        if self.keep is not None or other.keep is not None:
            return self.keep is not None and other.keep is not None and self.keep <= other.keep
        if self.max_error is not None or other.max_error is not None:
            asked = (self.outputs, self.shaft, self.guard) == (other.outputs, other.shaft, other.guard)
            return asked and self.max_error is not None and other.max_error is not None and self.max_error >= other.max_error
        wider = self.guard <= other.guard and self.elements >= other.elements
        return wider and self.threshold >= other.threshold


@dataclass(frozen=True, slots=True)
class Reduction:
    """kind: "conditioned" or "partition"; window in s; parameters: those that the run had changed, by scalar name."""

    kind: str
    source: str
    digest: str
    experiment: str | None
    window: tuple[float, float] | None
    choice: Choice
    parameters: Mapping[str, float]
    span: Span


def reductions_said(model: ast.Model) -> Iterator[Reduction]:
    """Every reduction that a model's annotations tell of, the last one first."""
    for item in model.items:
        for argument in item.arguments if isinstance(item, ast.Annotation) else ():
            if isinstance(argument, ast.Modifier) and argument.name.text in ("conditioned", "partition"):
                said = {m.name.text: _literal(m.value) for m in argument.nested if isinstance(m, ast.Modifier)}
                if (found := _reduction(argument.name.text, said, item.span)) is not None:
                    yield found


def reduced_before(model: ast.Model, choice: Choice, experiment: str | None, window: tuple[float, float]) -> bool:
    """Did a reduction over the same run leave nothing for this choice to drop?"""
    return any(
        (said.kind == "conditioned" or said.choice.inside)
        and (said.experiment, said.window) == (experiment, window)
        and said.choice.covers(choice)
        for said in reductions_said(model)
    )


def _reduction(kind: str, said: Mapping[str, object], span: Span) -> Reduction | None:
    match said:
        case {"source": str(source), "sha256": str(digest), "threshold": float(threshold)}:
            pass
        case _:
            return None
    experiment, window = said.get("experiment"), said.get("window")
    names, spared, shaft = said.get("outputs"), said.get("spared"), said.get("shaft")
    choice = Choice(
        threshold,
        said.get("guard") is not False,
        said.get("elements") is not False,
        _number(said.get("keep")),
        _number(said.get("max_error")),
        tuple(names.split(", ")) if isinstance(names, str) else None,
        shaft if isinstance(shaft, str) else None,
        numbers(spared) if isinstance(spared, str) else frozenset(),
        said.get("inside") is True,
    )
    times = window if isinstance(window, tuple) and len(window) == 2 else None
    told = experiment if isinstance(experiment, str) else None
    return Reduction(kind, source, digest, told, times, choice, _changes(said.get("parameters")), span)


def _literal(value: ast.Expression | None) -> object:
    match value:
        case ast.Number():
            return float(value.value)
        case ast.String() | ast.Boolean():
            return value.value
        case ast.Array():
            return tuple(_literal(item) for item in value.items)
        case _:
            return None


def _number(value: object) -> float | None:
    return value if isinstance(value, float) else None


def _changes(said: object) -> dict[str, float]:
    """`"mA = 90, s = 0.9"` as a mapping."""
    pairs = (part.split(" = ") for part in said.split(", ")) if isinstance(said, str) else ()
    return {name: float(value) for name, value in pairs}


def ranges(numbers: Iterable[int]) -> str:
    """`3, 7-9` for 3, 7, 8, 9."""
    found: list[list[int]] = []
    for n in sorted(numbers):
        if found and n == found[-1][-1] + 1:
            found[-1][1:] = [n]
        else:
            found.append([n])
    return ", ".join("-".join(map(str, pair)) for pair in found)


def numbers(text: str) -> frozenset[int]:
    """What `ranges` was made of; of what is no such text, what can be read."""
    found: set[int] = set()
    for part in text.split(","):
        first, _, last = part.strip().partition("-")
        if first.isdigit() and (last.isdigit() or not last):
            found.update(range(int(first), int(last or first) + 1))
    return frozenset(found)
