"""Which text every class gets: edited in place where all its instances change alike, else copied under a clear name.

Input        SourceMap, the edits of every instance that changes
Output       Variants: for each class text the distinct forms its instances need, with the name of each
Establishes  instances that need the same text share one class, whatever acts in them (`acts.py` gives that where they are declared);
             a class of which some instance is unchanged stays as it is
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field

from bgdsl.reductions.source_map import ClassText, Site, SourceMap, UnwritableError
from bgdsl.reductions.statements import ClassEdits, Index, NewPart
from bgdsl.source import Edit

UnitKey = tuple[int, int]


@dataclass(slots=True, eq=False)
class Variant:
    """One form of a class text: its own edits, the variants of its parts (where their class is named, by index) and of its bases (by
    clause), the matrices that are parts of one (by declarator), the parts of bonds put in.

    paths: the instances that have this form.
    """

    unit: ClassText
    edits: tuple[Edit, ...]
    parts: dict[int, dict[Index, Variant]]
    bases: dict[int, Variant]
    retyped: Mapping[int, str]
    inserted: Mapping[str, NewPart]
    first: str
    changed: bool
    name: str = ""
    said: list[tuple[str, list[Said]]] = field(default_factory=list)
    """For each instance, the terms that its comments are about, in the order of the text."""

    @property
    def renamed(self) -> bool:
        return self.name != self.unit.model.name

    @property
    def paths(self) -> list[str]:
        return [path for path, _ in self.said]


@dataclass(slots=True)
class Variants:
    """The variants of every class text that some instance uses, in the order of the instances; `main` is the model's own."""

    main: Variant
    of: dict[UnitKey, list[Variant]]
    sites: Mapping[str, Site]
    """Where the class of each instance is named."""

    def __iter__(self) -> Iterator[Variant]:
        return (variant for variants in self.of.values() for variant in variants)


Said = tuple[int, ...]
"""The terms that one comment is about in one instance: the same in several turns of a loop."""

Describe = Callable[[list[tuple[str, Said]]], str]
"""The comment on one dropped term of a class, from (instance, terms) of each instance."""

TERM = re.compile("\x00([\\d,]+)\x01")
"""Stands in an edit for the comment on a term until it is known which instances share the text."""


def term_mark(term: int) -> str:
    """The mark of a term in a comment."""
    return f"\x00{term}\x01"


def specialise(texts: SourceMap, edits: Mapping[tuple[str, UnitKey], ClassEdits], describe: Describe) -> Variants:
    """The variants that the edits ask for."""
    sites = {path: texts.site(path) for path in texts.instances if path}
    named: dict[tuple[str, UnitKey], list[tuple[int, Index, str]]] = defaultdict(list)
    for path, site in sites.items():
        named[site.owner, site.unit.key].append((id(site.node), site.index, path))
    known: dict[tuple[object, ...], Variant] = {}
    found: dict[tuple[str, UnitKey], Variant] = {}
    order: dict[UnitKey, list[Variant]] = defaultdict(list)
    for path in sorted(texts.instances, key=lambda path: -path.count(".") if path else 1):
        for unit in reversed(texts.units(texts.class_of(path))):
            parts = named[path, unit.key]
            found[path, unit.key] = _variant(texts, edits.get((path, unit.key)), path, unit, parts, found, known)
    for path in texts.instances:
        for unit in texts.units(texts.class_of(path)):
            variant = found[path, unit.key]
            if variant not in order[unit.key]:
                order[unit.key].append(variant)
    result = Variants(found["", texts.class_of("").key], dict(order), sites)
    _name_all(result, texts)
    for variant in known.values():
        variant.edits = tuple(_described(variant, describe))
    return result


def _described(variant: Variant, describe: Describe) -> Iterator[Edit]:
    """The edits with their comments written out."""
    position = 0
    for edit in variant.edits:
        pieces = TERM.split(edit.text)
        for k in range(1, len(pieces), 2):
            pieces[k] = describe([(path, said[position]) for path, said in variant.said])
            position += 1
        yield Edit(edit.span, "".join(pieces))


def _variant(
    texts: SourceMap,
    changes: ClassEdits | None,
    path: str,
    unit: ClassText,
    named: Iterable[tuple[int, Index, str]],
    found: Mapping[tuple[str, UnitKey], Variant],
    known: dict[tuple[object, ...], Variant],
) -> Variant:
    own = changes.edits() if changes else ()
    retyped = changes.retyped if changes else {}
    inserted = changes.inserted if changes else {}
    parts: dict[int, dict[Index, Variant]] = defaultdict(dict)
    for node, index, child in named:
        made = found[child, texts.class_of(child).key]
        if parts[node].setdefault(index, made) is not made:
            raise UnwritableError((), f"the elements that are redeclared from outside differ: `{child}`")
    bases = {id(clause): found[path, base.key] for clause, base in texts.bases(unit)}
    key = (
        unit.key,
        tuple((edit.span.start, edit.span.end, TERM.sub("", edit.text)) for edit in own),
        tuple(sorted((d, i, id(v)) for d, of_node in parts.items() for i, v in of_node.items() if v.changed)),
        tuple(sorted((c, id(v)) for c, v in bases.items() if v.changed)),
        tuple(sorted(retyped.items())),
        tuple(sorted((name, part.kind, part.dims) for name, part in inserted.items())),
    )
    if key not in known:
        below = [*bases.values(), *(v for of_node in parts.values() for v in of_node.values())]
        changed = bool(own or retyped or inserted or (changes and changes.acts)) or any(v.changed for v in below)
        known[key] = Variant(unit, own, parts, bases, retyped, inserted, path, changed)
    variant = known[key]
    for node, of_node in parts.items():
        variant.parts.setdefault(node, {}).update(of_node)
    variant.said.append((path, [tuple(map(int, t.split(","))) for edit in own for t in TERM.findall(edit.text)]))
    return variant


def _name_all(variants: Variants, texts: SourceMap) -> None:
    taken = {definition for module in texts.library.modules.values() for definition in module.definitions}
    taken |= {cls.model.name for cls in texts.classes.values()}
    for of_unit in variants.of.values():
        of_unit.sort(key=lambda variant: variant is not variants.main)
        keeps = next((variant for variant in of_unit if not variant.changed), of_unit[0])
        for variant in of_unit:
            variant.name = variant.unit.model.name if variant is keeps else _fresh(_wanted(variant), taken)
            taken.add(variant.name)


def _wanted(variant: Variant) -> str:
    """After the class and its first instance; what only differs in what acts, and that in several places, is the part of its class."""
    name = variant.unit.model.name
    bases = {path.partition("[")[0] for path in variant.paths}
    if len(bases) > 1 and (variant.retyped or not variant.edits):
        return f"Part{name}"
    last = variant.first.rpartition(".")[2]
    shown = last.partition("[")[0] if len(variant.paths) > 1 else last
    return f"{name}_{re.sub(r'[^A-Za-z0-9]+', '_', shown).strip('_')}"


def _fresh(wanted: str, taken: set[str]) -> str:
    name, k = wanted, 2
    while name in taken:
        name, k = f"{wanted}_{k}", k + 1
    return name
