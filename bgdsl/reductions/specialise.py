"""Which text every class gets: edited in place where all its instances change alike, else copied under a clear name.

Input        SourceMap, the edits of every instance that changes
Output       Variants: for each class text the distinct forms its instances need, with the name of each
Establishes  instances that need the same text share one class; a class of which some instance is unchanged stays as it is
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field

from bgdsl.reductions.source_map import ClassText, SourceMap, UnwritableError
from bgdsl.reductions.statements import ClassEdits
from bgdsl.source import Edit, Source, Span, apply_edits
from bgdsl.syntax import ast

UnitKey = tuple[int, int]


@dataclass(slots=True, eq=False)
class Variant:
    """One form of a class text: its own edits, the variants of its parts (by declarator) and of its bases (by clause)."""

    unit: ClassText
    edits: tuple[Edit, ...]
    parts: dict[int, Variant]
    bases: dict[int, Variant]
    first: str
    changed: bool
    name: str = ""
    said: list[tuple[str, list[int]]] = field(default_factory=list)
    """For each instance, the terms that its comments are about, in the order of the text."""

    @property
    def renamed(self) -> bool:
        return self.name != self.unit.model.name


@dataclass(slots=True)
class Variants:
    """The variants of every class text that some instance uses, in the order of the instances; `main` is the model's own."""

    main: Variant
    of: dict[UnitKey, list[Variant]] = field(default_factory=dict)

    def __iter__(self):  # type: ignore[no-untyped-def]
        return (variant for variants in self.of.values() for variant in variants)


Describe = Callable[[list[tuple[str, int]]], str]
"""The comment on one dropped term of a class, from (instance, term) of each instance."""

TERM = re.compile("\x00(\\d+)\x01")
"""Stands in an edit for the comment on a term until it is known which instances share the text."""


def term_mark(term: int) -> str:
    """The mark of a term in a comment."""
    return f"\x00{term}\x01"


def specialise(
    texts: SourceMap, edits: Mapping[tuple[str, UnitKey], ClassEdits], terms: Mapping[str, Iterable[int]], describe: Describe
) -> Variants:
    """The variants that the edits ask for. terms: the dropped terms written in each instance, for what cannot be written."""
    children: dict[str, list[str]] = defaultdict(list)
    for path in texts.instances:
        if path:
            children[path.rpartition(".")[0]].append(path)
    known: dict[tuple[object, ...], Variant] = {}
    found: dict[tuple[str, UnitKey], Variant] = {}
    order: dict[UnitKey, list[Variant]] = defaultdict(list)
    for path in sorted(texts.instances, key=lambda path: -path.count(".") if path else 1):
        own = texts.class_of(path)
        for unit in reversed(texts.units(own)):
            variant = _variant(texts, edits, terms, path, unit, children[path], found, known)
            found[path, unit.key] = variant
    for path in texts.instances:
        for unit in texts.units(texts.class_of(path)):
            variant = found[path, unit.key]
            if variant not in order[unit.key]:
                order[unit.key].append(variant)
    result = Variants(found["", texts.class_of("").key], dict(order))
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
    edits: Mapping[tuple[str, UnitKey], ClassEdits],
    terms: Mapping[str, Iterable[int]],
    path: str,
    unit: ClassText,
    children: list[str],
    found: Mapping[tuple[str, UnitKey], Variant],
    known: dict[tuple[object, ...], Variant],
) -> Variant:
    own = edits[path, unit.key].edits() if (path, unit.key) in edits else ()
    declarators = {d.name: d for item in unit.model.items if isinstance(item, ast.Declaration) for d in item.declarators}
    parts: dict[int, Variant] = {}
    for child in children:
        declarator = declarators.get(child.rpartition(".")[2].partition("[")[0])
        if declarator is None:
            continue
        variant = found[child, texts.class_of(child).key]
        before = parts.setdefault(id(declarator), variant)
        if before is not variant:
            alike = [t for c in children if c.partition("[")[0] == child.partition("[")[0] for t in _below(terms, c)]
            raise UnwritableError(tuple(alike), f"the elements of the array `{child.partition('[')[0]}` differ")
    bases = {id(clause): found[path, base.key] for clause, base in texts.bases(unit)}
    key = (
        unit.key,
        tuple((edit.span.start, edit.span.end, TERM.sub("", edit.text)) for edit in own),
        tuple(sorted((d, id(v)) for d, v in parts.items())),
        tuple(sorted((c, id(v)) for c, v in bases.items())),
    )
    if key not in known:
        changed = bool(own) or any(v.changed for v in (*parts.values(), *bases.values()))
        known[key] = Variant(unit, own, parts, bases, path, changed)
    known[key].said.append((path, [int(t) for edit in own for t in TERM.findall(edit.text)]))
    return known[key]


def _below(terms: Mapping[str, Iterable[int]], path: str) -> list[int]:
    return [t for where, some in terms.items() if where == path or where.startswith(path + ".") for t in some]


def _name_all(variants: Variants, texts: SourceMap) -> None:
    taken = {definition for module in texts.library.modules.values() for definition in module.definitions}
    taken |= {cls.model.name for cls in texts.classes.values()}
    for of_unit in variants.of.values():
        of_unit.sort(key=lambda variant: variant is not variants.main)
        keeps = next((variant for variant in of_unit if not variant.changed), of_unit[0])
        for variant in of_unit:
            name = variant.unit.model.name
            if variant is not keeps:
                base = f"{name}_{re.sub(r'[^A-Za-z0-9]+', '_', variant.first.rpartition('.')[2]).strip('_')}"
                name, k = base, 2
                while name in taken:
                    name, k = f"{base}_{k}", k + 1
                taken.add(name)
            variant.name = name


# ----------------------------------------------------------------------------------------------------------------- text


def class_edits(variant: Variant) -> list[Edit]:
    """All edits of a variant's text: its own, the names of its parts' and bases' classes, and its own name."""
    edits = list(variant.edits)
    model = variant.unit.model
    for item in model.items:
        if isinstance(item, ast.Declaration):
            inside = [e for e in edits if item.span.start <= e.span.start and e.span.end < item.span.end]
            retyped = _retyped(item, variant, inside)
            if retyped and retyped[0].span == item.span:
                edits = [e for e in edits if e not in inside]
            edits += retyped
        elif isinstance(item, ast.Extends) and id(item) in variant.bases and variant.bases[id(item)].renamed:
            edits.append(Edit(item.base.span, variant.bases[id(item)].name))
    if variant.renamed:
        source, text = model.span.source, model.span.text
        head = re.match(rf"(?:model|element)\s+({model.name})\b", text)
        tail = re.search(rf"\bend\s+({model.name})\s*;?\s*$", text)
        assert head is not None and tail is not None
        for match in (head, tail):
            edits.append(Edit(Span(source, model.span.start + match.start(1), model.span.start + match.end(1)), variant.name))
    return edits


def spliced(span: Span, edits: Iterable[Edit]) -> str:
    """The text of a span with edits inside it."""
    part = Source(span.source.name, span.text)
    moved = [Edit(Span(part, edit.span.start - span.start, edit.span.end - span.start), edit.text) for edit in edits]
    return apply_edits(part, moved)


def _retyped(item: ast.Declaration, variant: Variant, inside: list[Edit]) -> list[Edit]:
    """The declaration with other class names: in place if all its declarators agree, else (with the edits inside it) in
    declarations of their own."""
    groups: dict[str | None, list[ast.Declarator]] = {}
    for declarator in item.declarators:
        part = variant.parts.get(id(declarator))
        groups.setdefault(part.name if part is not None and part.renamed else None, []).append(declarator)
    if set(groups) == {None}:
        return []
    if len(groups) == 1:
        (name,) = groups
        assert name is not None
        return [Edit(item.type.name.span, name)]
    source, span = item.span.source, item.span
    start = source.text.rfind("\n", 0, span.start) + 1
    indent = source.text[start : len(source.text)][: len(source.text[start:]) - len(source.text[start:].lstrip(" \t"))]
    before = source.text[span.start : item.type.name.span.start]
    after = source.text[item.type.name.span.end : item.declarators[0].span.start]
    lines = []
    for name, declarators in groups.items():
        shown = name or item.type.name.span.text
        texts = [spliced(d.span, [e for e in inside if d.span.start <= e.span.start and e.span.end <= d.span.end]) for d in declarators]
        lines.append(f"{before}{shown}{after}{', '.join(texts)};")
    return [Edit(span, f"\n{indent}".join(lines))]
