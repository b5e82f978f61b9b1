"""Matrices, and two-ports of arrays, written as what is left of them: `PartMTF` and its like of the library file bonds/one_way.bg.

    v => arm => p          becomes   v => arm.p1;  arm.p2 => p;
    MTF[3, 3] arm(T = R)             PartMTF arm(T = R, acts = [2, 1, 1; -1, 2, 1; 0, 0, 2])

The modulus stays where it was given, in the declaration or from outside, and a loop stays a loop: every element of an array becomes
a part of a two-port, whatever it lost. So do all instances of a class that lost something, the same matrices in each; what acts in
which instance is said by `acts`.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence

from bgdsl.expr import leaves
from bgdsl.ir.graph import Element
from bgdsl.reductions.plan import Entry, Split
from bgdsl.reductions.source_map import ClassText, Place, Site, UnwritableError, indexed
from bgdsl.reductions.statements import ALL, Acts, Link, LinkEdit
from bgdsl.reductions.writer import Writer
from bgdsl.syntax import ast

SCALAR = {"TF": "OneTF", "MTF": "OneMTF", "GY": "OneGY", "MGY": "OneMGY"}
MATRIX = {"TF": "PartTF", "MTF": "PartMTF", "GY": "PartGY", "MGY": "PartMGY", "EJS": "PartEJS"}
NAMES = {"OneTF": "m", "OneMTF": "m", "OneGY": "r", "OneMGY": "r"}

NATURAL = {"TF": (1, 0), "MTF": (1, 0), "GY": (1, 1), "MGY": (1, 1), "EJS": (1, 1)}
"""The junction kinds at port 1 and 2 at which the entries of a row or column meet."""


def write_parts(writer: Writer, splits: Sequence[Split], kinds: Mapping[int, int], read: frozenset[str]) -> None:
    """Write the splits as parts of two-ports. kinds: of the junction of every term; read: owners of variables that something reads."""
    chosen: dict[tuple[int, int], dict[str, None]] = defaultdict(dict)
    touched: dict[str, dict[tuple[int, int], None]] = defaultdict(dict)
    entries = {split.element.name: split.entries for split in splits}
    sites: dict[str, Site] = {}
    for split in splits:
        terms = tuple(t for entry in split.entries for t, gone in zip(entry.terms, entry.dropped, strict=True) if gone)
        path, _, last = split.element.name.rpartition(".")
        site = _site(writer, split.element, terms)
        _check(split, kinds, read, terms)
        sites[split.element.name] = site
        chosen[site.unit.key][indexed(last)[0]] = None
        touched[path][site.unit.key] = None
        writer.tell(split.element.name, fell_in(split))
    for path, units in _siblings(writer, touched):
        touched[path] |= units
    flavours = _flavours(writer, chosen, touched)
    for path, units in touched.items():
        names: set[str] = set()
        for key in units:
            for name in chosen[key]:
                kind = flavours[key, name]
                found = writer.elements.get((path, name), ())
                names.add(name)
                for element in found:
                    site = sites.get(element.name) or _site(writer, element, ())
                    edits = writer.of(path, site.unit)
                    edits.retype(site.node, kind)
                    of_node = edits.acts.setdefault((id(site.node), name), {})
                    of_node[indexed(element.name.rpartition(".")[2])[1]] = _acts(element, entries.get(element.name), kind)
                if not found:  # not there in this instance, and the class has to be one with the others'
                    member = writer.texts.member(path, name)
                    assert member is not None
                    writer.of(path, member[0]).retype(member[2], kind)
        _rejoin(writer, path, names)


def _siblings(writer: Writer, touched: Mapping[str, Mapping[tuple[int, int], None]]) -> list[tuple[str, dict[tuple[int, int], None]]]:
    """What the other elements of an array have to be for it to have one class."""
    alike: dict[str, list[str]] = defaultdict(list)
    for path in writer.texts.instances:
        if "[" in path:
            alike[re.sub(r"\[[^]]*\]", "", path)].append(path)
    found: dict[str, dict[tuple[int, int], None]] = defaultdict(dict)
    for path, units in touched.items():
        if "[" in path:
            found[re.sub(r"\[[^]]*\]", "", path)] |= units
    result = []
    for plain, units in found.items():
        for path in alike[plain]:
            there = {unit.key for unit in writer.texts.units(writer.texts.class_of(path))}
            result.append((path, {key: None for key in units if key in there}))
    return result


def _site(writer: Writer, element: Element, terms: tuple[int, ...]) -> Site:
    path = element.name.rpartition(".")[0]
    site = writer.texts.site(element.name)
    if site.owner != path or site.afar:
        raise UnwritableError(terms, f"`{element.name}` is redeclared from outside")
    return site


def _check(split: Split, kinds: Mapping[int, int], read: frozenset[str], terms: tuple[int, ...]) -> None:
    """What cannot be said so: an entry alone at a junction that is not of the kind its row or column meets at."""
    element = split.element
    for entry in split.entries:
        for k, (term, gone) in enumerate(zip(entry.terms, entry.dropped, strict=True)):
            if gone and kinds[term] != NATURAL[element.kind][k]:
                raise UnwritableError(terms, f"`{element.name}` would be divided by")
    if element.kind == "EJS" and element.name in read:
        raise UnwritableError(terms, f"the variables of `{element.name}` are read")


def _flavours(
    writer: Writer, chosen: Mapping[tuple[int, int], Iterable[str]], touched: Mapping[str, Mapping[tuple[int, int], None]]
) -> dict[tuple[tuple[int, int], str], str]:
    """The class of every matrix that is to be one of these; one for all instances of a class: a modulus that varies in one is a signal."""
    result: dict[tuple[tuple[int, int], str], str] = {}
    for path, units in touched.items():
        for key in units:
            for name in chosen[key]:
                for element in writer.elements.get((path, name), ()):
                    kind = _class_of(element)
                    before = result.setdefault((key, name), kind)
                    if before != kind:
                        result[key, name] = before if "M" in before else kind
    return result


def _class_of(element: Element) -> str:
    assert element.modulus is not None
    scalar = element.kind != "EJS" and all(port.size is None for port in element.ports)
    kind = element.kind
    values = [value for row in element.modulus for value in row]
    if kind in ("MTF", "MGY") and not any(True for op in ("var", "time") for _ in leaves(values, op)):
        kind = kind[1:]
    return (SCALAR if scalar else MATRIX)[kind]


def _acts(element: Element, entries: Sequence[Entry] | None, kind: str) -> Acts:
    """What is left of an element; all of it where nothing was dropped."""
    assert element.modulus is not None
    rows = [[0] * len(element.modulus[0]) for _ in element.modulus]
    for i, row in enumerate(element.modulus):
        for j, value in enumerate(row):
            there = not (value.is_zero and (element.kind != "EJS" or element.modulus[j][i].is_zero))
            rows[i][j] = 2 if there and not (element.kind == "EJS" and i == j) else 0
    for entry in entries or ():
        i, j = entry.row, entry.column
        if element.kind == "EJS":
            rows[i][j], rows[j][i] = (2, 2) if entry.two_way else (int(not entry.dropped[0]), int(not entry.dropped[1]))
        else:
            rows[i][j] = 2 if entry.two_way else 0 if entry.gone else 1 if entry.dropped[0] else -1
    return rows[0][0] if kind in NAMES else tuple(map(tuple, rows))


def fell_in(split: Split) -> list[tuple[str, str, int]]:
    """What fell in an element: effort or flow, the entry, the term."""
    kind = split.element.kind
    scalar = all(port.size is None for port in split.element.ports)
    fell: list[tuple[str, str, int]] = []
    for entry in split.entries:
        at = "" if scalar else f"[{entry.row + 1},{entry.column + 1}]"
        turned = f"[{entry.column + 1},{entry.row + 1}]"
        places = (at, turned) if kind == "EJS" else (at, at)
        what = ("effort", "flow") if NATURAL[kind][1] == 0 else ("effort", "effort") if kind == "EJS" else ("effort at p1", "effort at p2")
        found = zip(what, places, entry.terms, entry.dropped, strict=True)
        fell += [(letter, place, term) for letter, place, term, gone in found if gone]
    return fell


def _rejoin(writer: Writer, path: str, names: set[str]) -> None:
    """Let the bonds of these elements of an instance end at the ports of the parts: port 1 where a chain enters, port 2 where it leaves."""
    for unit in writer.texts.units(writer.texts.class_of(path)):
        for place in writer.texts.statements(unit):
            statement = place.statement
            for k in range(len(statement.arrows)):
                for end in statement.ends[k]:
                    if _local(end, names):
                        for f in range(len(statement.ends[k + 1])):
                            _edit(writer, path, unit, place, (k, f)).tail = _port(writer, path, end, "p2")
                for f, end in enumerate(statement.ends[k + 1]):
                    if _local(end, names):
                        _edit(writer, path, unit, place, (k, f)).head = _port(writer, path, end, "p1")


def _edit(writer: Writer, path: str, unit: ClassText, place: Place, link: Link) -> LinkEdit:
    return writer.of(path, unit).link(place, ALL if place.loops else (), link)


def _local(reference: ast.Reference, names: set[str]) -> bool:
    return len(reference.parts) == 1 and reference.parts[0].name in names


def _port(writer: Writer, path: str, reference: ast.Reference, port: str) -> str:
    """A reference to an element as one to a port of its part: `turn[i, 1:2]` is `turn[i].p1[1:2]`."""
    (part,) = reference.parts
    member = writer.texts.member(path, part.name)
    count = len(member[2].dims) if member else 0
    texts = [subscript.span.text for subscript in part.subscripts]
    index, components = texts[:count], texts[count:]
    brackets = [f"[{', '.join(some)}]" if some else "" for some in (index, components)]
    return f"{part.name}{brackets[0]}.{port}{brackets[1]}"
