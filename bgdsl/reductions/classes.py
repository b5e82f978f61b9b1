"""Which class each instance of a part gets, and where the things in it are given their values.

Input        Contents, the instances of the model
Output       Classes     a Kind for every class to be written, innermost first
Establishes  instances that contain the same share a class; what all its instances give alike stands in the class, what differs or
             reads things outside stands with the instance, as a modification
Reports      nothing; UnwritableError where something cannot be read
"""

from __future__ import annotations

import math
import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from bgdsl.expr import Expr, substitute, table, to_text, topological, var
from bgdsl.ir.graph import Instance
from bgdsl.reductions.compact import alike
from bgdsl.reductions.forms import Seen, array_form
from bgdsl.reductions.places import OUTPUT, PARAMETER, SIGNAL, Body, Contents, Key, Piece, Shown, Spot, Value, split, within
from bgdsl.reductions.source_map import UnwritableError

Steps = tuple[str, ...]
"""The path of a modification: `("rod", "mass_3", "f", "start")`."""

EMPTY = -1
"""The number of the kind of instances that have nothing in the part."""


@dataclass(frozen=True, slots=True)
class Given:
    """What a modification says, as text; `each`: to all elements of an array."""

    text: str
    each: bool = False
    final: bool = False


@dataclass(slots=True, eq=False)
class Bundle:
    """What the elements of an array of components are given, by index; one value under `()` where there is no array."""

    values: dict[tuple[int, ...], Value]
    default: str | None = None
    """What the class says already."""
    final: bool = False


@dataclass(slots=True, eq=False)
class Child:
    """A component that is an instance, or an array of them. kinds: the number of the class of each element, by index."""

    name: str
    kinds: dict[tuple[int, ...], int]
    comment: str = ""

    @property
    def several(self) -> bool:
        return len(set(self.kinds.values())) > 1


@dataclass(slots=True, eq=False)
class Kind:
    """A class to be written. members: its instances, the first of which stands for all. given: what its own pieces and its children
    are given in it: by (None or child's name, number of the child's kind, steps)."""

    number: int
    instance: Instance
    members: list[str]
    children: list[Child]
    given: dict[tuple[str | None, int, Steps], Given] = field(default_factory=dict)
    inputs: set[Steps] = field(default_factory=set)
    """Signals whose value comes from outside."""
    tables: dict[str, None] = field(default_factory=dict)


@dataclass(slots=True, eq=False)
class Classes:
    """kinds: by number, innermost first; the last is the model itself. of: the number of each instance's kind."""

    contents: Contents
    shown: Shown
    kinds: list[Kind]
    of: dict[str, int]
    tables: Mapping[str, str]

    def text(self, value: Value, scope: str) -> str | None:
        """A value as it is written in the class of `scope`, None if that cannot read all of it."""
        texts = self.texts(value, scope)
        if texts is None or not value.shape:
            return None if texts is None else texts[0]
        if value.diagonal and len(set(texts)) == 1:
            factor = texts[0] if re.fullmatch(r"[\w.\[\],]+", texts[0]) else f"({texts[0]})"
            return f"{factor}*identity({len(texts)})"
        shown = self.array(value.roots, value.shape, scope) or _written(texts, value.shape)
        return f"diagonal({shown})" if value.diagonal else shown

    def array(self, roots: Sequence[Expr], shape: tuple[int, ...], scope: str) -> str | None:
        """An array as what it is, where that can be seen."""

        def show(root: Expr) -> str:
            texts = self.texts(Value((root,)), scope)
            assert texts is not None
            return texts[0]

        return array_form(roots, shape, lambda leaf: self.seen(leaf, scope), self.contents.fixed, show)

    def said(self, value: Value, scope: str) -> str:
        """A value that has to be said in the class of `scope`."""
        text = self.text(value, scope)
        if text is None:
            raise UnwritableError(
                (), f"an equation of `{scope}` reads what is in no part" if scope else "an equation reads what is in no part"
            )
        return text

    def spot(self, variable: str, scope: str) -> Spot | None:
        """The place at which a variable can be read in the class of `scope`."""
        return next((spot for spot in self.contents.readings.get(variable, ()) if within(spot.owner, scope)), None)

    def seen(self, leaf: Expr, scope: str) -> Seen | None:
        """An entry of an array, as it is read in the class of `scope`."""
        spot = self.spot(leaf.data, scope)
        if spot is None or not spot.component or spot.rate:
            return None
        return Seen(self.shown.text(replace(spot, component=()), scope), leaf.data.rpartition("[")[0], spot.component, spot.shape)

    def texts(self, value: Value, scope: str) -> list[str] | None:
        """Its entries, row-major."""
        renamed: dict[Expr, Expr] = {}
        for node in topological(value.roots):
            if node.op in ("var", "param") and node.data not in value.letters:
                spot = self.spot(node.data, scope)
                if spot is None:
                    return None
                renamed[node] = var(self.shown.text(spot, scope))
            elif node.op in ("var", "param"):
                renamed[node] = var(value.letters[node.data])
            elif node.op == "table":
                renamed[node] = table(self.tables[node.data[0]], substitute(node.args, renamed)[0], node.data[1])
            elif node.is_const and node.data == math.pi and not self.contents.shadowed:
                renamed[node] = var("pi")
        return [to_text(root) for root in substitute(value.roots, renamed)]

    def given(self, bundle: Bundle, scope: str) -> Given | None:
        """What is written in the class of `scope` for all of a bundle."""
        texts = {index: self.text(value, scope) for index, value in bundle.values.items()}
        if any(text is None for text in texts.values()):
            return None
        shown = [text or "" for text in texts.values()]
        if () in texts:
            return Given(shown[0], final=bundle.final)
        if len(set(shown)) == 1:
            return Given(shown[0], each=True, final=bundle.final)
        whole = self.as_one(bundle, scope)
        return Given(whole or listed({index: text or "" for index, text in texts.items()}), final=bundle.final)

    def as_one(self, bundle: Bundle, scope: str) -> str | None:
        """All of a bundle as one array that is there."""
        order = sorted(bundle.values)
        sizes = tuple(len({index[k] for index in order}) for k in range(len(order[0])))
        first = bundle.values[order[0]]
        if first.diagonal or len(sizes) > 1:
            return None
        roots = [root for index in order for root in bundle.values[index].roots]
        return self.array(roots, (*sizes, *first.shape), scope)


def classify(contents: Contents, instances: Iterable[Instance], tables: Mapping[str, str]) -> Classes:
    """The classes. tables: the names of tables as they are written."""
    work = Classes(contents, Shown(whole_arrays(contents)), [], {}, tables)
    _number(work, tuple(instances))
    _place(work)
    return work


def whole_arrays(contents: Contents) -> set[Key]:
    """The arrays of elements and junctions that stay: all of their elements are there and alike."""
    found: dict[Key, list[Piece]] = defaultdict(list)
    for path, body in contents.bodies.items():
        for piece in body.pieces.values():
            if piece.spot.index:
                found[path, piece.spot.name].append(piece)
    whole: set[Key] = set()
    for key, pieces in found.items():
        size = 1
        for n in contents.extents.get(key, (0,)):
            size *= n
        if len(pieces) == size and len({piece.shape for piece in pieces}) == 1 and all(piece.law is None for piece in pieces):
            whole.add(key)
    return whole


def nested(texts: Sequence[str], shape: tuple[int, ...]) -> str:
    """An array of these entries as it is written."""
    if not shape:
        return texts[0]
    if len(shape) == 1:
        return f"{{{', '.join(texts)}}}"
    step = len(texts) // shape[0]
    return f"{{{', '.join(nested(texts[i * step : (i + 1) * step], shape[1:]) for i in range(shape[0]))}}}"


def _written(texts: Sequence[str], shape: tuple[int, ...]) -> str:
    """An array written out, by a rule if its entries have one."""
    rule = alike(texts, range(1, len(texts) + 1)) if len(shape) == 1 and len(texts) > 1 else None
    if rule is not None:
        return f"{{{rule[1]} for {rule[0]} in 1:{len(texts)}}}"
    if len(shape) == 2:
        rows = [", ".join(texts[r * shape[1] : (r + 1) * shape[1]]) for r in range(shape[0])]
        return f"[{'; '.join(rows)}]"
    return nested(texts, shape)


def listed(texts: Mapping[tuple[int, ...], str]) -> str:
    """What differs from element to element of an array, as a list or by a rule."""
    order = sorted(texts)
    sizes = tuple(len({index[k] for index in order}) for k in range(len(order[0])))
    low, high = order[0][0], order[-1][0]
    if len(sizes) == 1 and high - low == len(order) - 1:
        rule = alike([texts[index] for index in order], range(low, high + 1))
        if rule is not None:
            return f"{{{rule[1]} for {rule[0]} in {low}:{high}}}"
    return nested([texts[index] for index in order], sizes)


# --------------------------------------------------------------------------------------------------------------- kinds


def _number(work: Classes, instances: tuple[Instance, ...]) -> None:
    """The kind of every instance, innermost first."""
    below: dict[str, dict[str, Child]] = defaultdict(dict)
    known: dict[tuple[object, ...], Kind] = {}
    for instance in reversed([one for one in instances if one.path in work.contents.bodies]):
        path = instance.path
        children = [c for c in reversed(below[path].values()) if any(kind != EMPTY for kind in c.kinds.values())]
        body = work.contents.bodies[path]
        if body.empty and not children and path:
            number = EMPTY
        else:
            for child in children:
                child.kinds = dict(reversed(child.kinds.items()))
            key = (instance.class_span.source.name, instance.class_span.start, *_shape(work, path, body, children))
            if key not in known:
                known[key] = Kind(len(work.kinds), instance, [], children)
                work.kinds.append(known[key])
            known[key].members.append(path)
            number = known[key].number
        work.of[path] = number
        if path:
            spot = split(path)
            below[spot.owner].setdefault(spot.name, Child(spot.name, {}, instance.comment)).kinds[spot.index] = number
    for kind in work.kinds:
        kind.members.reverse()


def _shape(work: Classes, path: str, body: Body, children: Sequence[Child]) -> Iterator[object]:
    for (name, index), piece in sorted(body.pieces.items(), key=lambda item: item[1].rank):
        yield name, index, piece.shape
        if piece.law is not None:
            yield piece.law[0], work.text(piece.law[1], path)
        if piece.rank in (SIGNAL, OUTPUT) and () in piece.values:
            yield work.text(piece.values[()], path)
    for child in children:
        yield child.name, child.comment, tuple(child.kinds.items())
    for link in body.links:
        yield tuple(work.shown.text(spot, path) for spot in link)
    for left, value in body.equations:
        yield work.shown.text(left, path), work.text(value, path)


# --------------------------------------------------------------------------------------------------------------- values

_Raised = dict[tuple[str | None, int, Steps], Bundle]


def _place(work: Classes) -> None:
    """Put every value where it can be said: in the class, or with the instance, as far out as it has to be."""
    raised: dict[str, _Raised] = defaultdict(dict)
    for kind in work.kinds:
        for path in kind.members:
            raised[path] = {**_own(work, path), **raised[path]}
        for key in raised[kind.members[0]]:
            _settle(work, kind, key, {path: raised[path][key] for path in kind.members}, raised)
    for kind in work.kinds:
        for value in _inside(work.contents.bodies[kind.members[0]]):
            kind.tables |= dict.fromkeys(_tables(Bundle({(): value})))


def _settle(
    work: Classes, kind: Kind, key: tuple[str | None, int, Steps], bundles: Mapping[str, Bundle], raised: dict[str, _Raised]
) -> None:
    """Say one thing in the class, or hand it to the instances around."""
    first = kind.members[0]
    piece = work.contents.bodies[first].pieces.get((key[2][0], ())) if key[0] is None and len(key[2]) == 1 else None
    parameter = piece is not None and piece.rank == PARAMETER
    told = [work.given(bundle, path) for path, bundle in bundles.items()]
    here = told[0] if len(set(told)) == 1 else None
    if here is not None and not (parameter and piece is not None and not piece.default and first):
        if here.text != bundles[first].default:
            kind.given[key] = here
            kind.tables |= dict.fromkeys(_tables(bundles[first]))
        return
    if not first:
        raise UnwritableError((), f"`{'.'.join(key[2])}` reads what is in no part")
    if piece is not None:
        kind.inputs.add(key[2])
    default = _usual(told) if parameter and piece is not None and piece.default and not piece.final else None
    if default is not None:
        kind.given[key] = Given(default)
    for path, bundle in bundles.items():
        bundle.default = default or bundle.default
        _raise(work, raised, path, key, bundle)


def _usual(told: Iterable[Given | None]) -> str | None:
    """The numbers that most instances are given, if any are."""
    numbers = Counter(given.text for given in told if given is not None and re.fullmatch(r"(?:[-+\d.{}, ]|\de[-+]?\d)+", given.text))
    return numbers.most_common(1)[0][0] if numbers else None


def _own(work: Classes, path: str) -> _Raised:
    """What an instance's own pieces are given."""
    found: _Raised = {}
    for (name, index), piece in work.contents.bodies[path].pieces.items():
        array = (path, name) in work.shown.arrays
        shown = name if array else work.shown.name(piece.spot)
        for steps, value in piece.values.items():
            bundle = found.setdefault((None, EMPTY, (shown, *steps)), Bundle({}, final=piece.final))
            bundle.values[index if array else ()] = value
    return found


def _raise(work: Classes, raised: dict[str, _Raised], path: str, key: tuple[str | None, int, Steps], bundle: Bundle) -> None:
    """Hand a bundle to the instance around this one."""
    child, _, steps = key
    spot = split(path)
    number = work.of[path]
    kinds = next((c for c in work.kinds[number].children if c.name == child), None)
    inner: dict[Steps, dict[tuple[int, ...], Value]] = defaultdict(dict)
    for index, value in bundle.values.items():
        if child is None:
            inner[()][index] = value
        elif kinds is None or not kinds.several:
            inner[child,][index] = value
        else:  # elements of differing kinds are modified one by one
            n = len(next(iter(kinds.kinds)))
            inner[f"{child}[{','.join(map(str, index[:n]))}]",][index[n:]] = value
    for before, values in inner.items():
        target = raised[spot.owner].setdefault((spot.name, number, (*before, *steps)), Bundle({}, bundle.default, bundle.final))
        target.values.update({(*spot.index, *index): value for index, value in values.items()})


def _tables(bundle: Bundle) -> Iterator[str]:
    for node in topological([root for value in bundle.values.values() for root in value.roots]):
        if node.op == "table":
            yield node.data[0]


def _inside(body: Body) -> Iterator[Value]:
    """Values that stand in a class whatever happens."""
    yield from (piece.law[1] for piece in body.pieces.values() if piece.law is not None)
    yield from (value for _, value in body.equations)
    yield from (value for _, value in body.lines)
    yield from (value for pair in body.starts for value in pair)


__all__ = ["EMPTY", "Bundle", "Child", "Classes", "Given", "Kind", "classify", "nested"]
