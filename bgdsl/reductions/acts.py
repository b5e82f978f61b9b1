"""Where it is said what is left of each matrix and bond: in its class if all instances agree, else where those that differ are declared.

Input        SourceMap, the edits of every instance, Variants
Output       Given       for each form of a class, by the component that is declared: what acts below it
Establishes  no class is copied for what acts alone; most instances find in their class what they need, and the others are given theirs
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from graphlib import TopologicalSorter

from bgdsl.reductions.source_map import SourceMap, UnwritableError, indexed
from bgdsl.reductions.specialise import UnitKey, Variant, Variants
from bgdsl.reductions.statements import Acts, ClassEdits, Index, Node
from bgdsl.syntax import ast

Names = tuple[str, ...]
"""The way from a component to a matrix inside it, without subscripts; () for the matrix itself."""

Tree = dict[Names, dict[tuple[Index, ...], Acts]]
"""What acts inside a component: by the matrix, then by the subscripts on the way to it."""


@dataclass(slots=True)
class Given:
    """of[variant, node][index]: what is said of a component where it is declared. by: the instances of the variant for which that is
    what acts; the others are given theirs further out. whole: all that acts below each instance. mixed: declarators of arrays of which
    some elements have their class from elsewhere (from these redeclarations), though the modifications of the declaration go for them
    too."""

    of: dict[tuple[int, Node], dict[Index, Tree]] = field(default_factory=dict)
    by: dict[tuple[int, Node], list[str]] = field(default_factory=dict)
    whole: Mapping[str, Tree] = field(default_factory=dict)
    mixed: dict[int, dict[int, None]] = field(default_factory=dict)

    def all_said(self, path: str, name: str, index: Index, tree: Tree, more: Iterable[Names]) -> Tree:
        """A tree with what others like it are told, too: what acts there in the component `name` of the instance `path`."""
        result = dict(tree)
        for names in more:
            if names not in result:
                acts = self.whole[path].get((name, *names), {})
                found = {indices[1:]: value for indices, value in acts.items() if indices[0] == index}
                result |= {names: found} if found else {}
        return result


def give(
    texts: SourceMap,
    edits: Mapping[tuple[str, UnitKey], ClassEdits],
    variants: Variants,
    odd: frozenset[str],
    levels: Mapping[str, int],
) -> Given:
    """What is said where. odd: instances of another structure than their class has by itself, which are never what it says. levels: of
    parts of which it is said already, the number of steps to the instance in whose text that is: it has to be said there again.

    An error if a redeclaration from afar would have to differ by element.
    """
    whole = registry(edits)
    pending: dict[str, Tree] = {}
    given = Given(whole=whole)
    children: dict[tuple[str, UnitKey], list[str]] = defaultdict(list)
    after: dict[UnitKey, dict[UnitKey, None]] = {key: {} for key in variants.of}
    for key, of_unit in variants.of.items():
        after[key] |= {base.key: None for _, base in texts.bases(of_unit[0].unit)}
    for path, site in variants.sites.items():
        children[site.owner, site.unit.key].append(path)
        if isinstance(site.node, ast.Redeclaration):
            parent, _, last = path.rpartition(".")
            member = texts.member(parent, indexed(last)[0])
            if member:
                given.mixed.setdefault(id(member[2]), {})[id(site.node)] = None
        after[site.unit.key] |= {unit.key: None for unit in texts.units(texts.class_of(path))}
    for key in TopologicalSorter(after).static_order():
        for variant in variants.of[key]:
            _settle(variant, edits, children, variants, pending, given, odd, levels)
    return given


def _settle(
    variant: Variant,
    edits: Mapping[tuple[str, UnitKey], ClassEdits],
    children: Mapping[tuple[str, UnitKey], list[str]],
    variants: Variants,
    pending: dict[str, Tree],
    given: Given,
    odd: frozenset[str],
    levels: Mapping[str, int],
) -> None:
    """What the form of a class says; what its instances that differ are still to be given."""
    values: dict[Node, dict[str, dict[Index, Tree]]] = defaultdict(dict)
    way: dict[Node, Names] = {}
    for path in variant.paths:
        own = edits.get((path, variant.unit.key))
        for (node, name), acts in own.acts.items() if own else ():
            way[node] = (name,)
            values[node][path] = {index: {(): {(): value}} for index, value in acts.items()}
        for child in children.get((path, variant.unit.key), ()):
            if child in pending:
                site = variants.sites[child]
                steps = child.removeprefix(f"{path}.").split(".")
                way[id(site.node)] = tuple(indexed(step)[0] for step in steps)
                of_path = values[id(site.node)].setdefault(path, {})
                if of_path.setdefault(site.index, dict(pending[child])) != pending[child]:
                    raise UnwritableError((), f"the elements that are redeclared from outside differ: `{child}`")
    for node, by_path in values.items():
        said_further_out = _taken_out(by_path, way[node], pending, given, levels) if levels else set()
        free = [path for path in variant.paths if path not in said_further_out]
        even = [path for path in free if path not in odd]
        common = _most_common([by_path.get(path, {}) for path in even or free]) if free else {}
        if free and not even:
            common = _all_both_ways(variant, node) or common
        given.of[id(variant), node] = common
        given.by[id(variant), node] = [path for path in variant.paths if by_path.get(path, {}) == common]
        for path in variant.paths:
            mine = by_path.get(path, {})
            if mine != common:
                wanted = {names for tree in (*mine.values(), *common.values()) for names in tree}
                for names in sorted(wanted):
                    full = (*way[node], *names)
                    if full in given.whole[path]:
                        pending.setdefault(path, {})[full] = given.whole[path][full]


def _all_both_ways(variant: Variant, node: Node) -> dict[Index, Tree]:
    """What a class says of its own matrix where no instance has the sizes that the class has by itself: nothing was dropped."""
    for item in variant.unit.model.items:
        if isinstance(item, ast.Declaration) and any(id(d) == node and not d.dims for d in item.declarators) and item.type.dims:
            rows, columns = item.type.dims[0].span.text, item.type.dims[-1].span.text
            return {(): {(): {(): f"2*ones({rows}, {columns})"}}}
    return {}


def _taken_out(
    by_path: dict[str, dict[Index, Tree]], way: Names, pending: dict[str, Tree], given: Given, levels: Mapping[str, int]
) -> set[str]:
    """Move what the text says further out than in these instances there; the instances concerned."""
    concerned: set[str] = set()
    for path, of_path in by_path.items():
        depth = path.count(".") + 1 if path else 0
        for index, tree in list(of_path.items()):
            for names, full in list(elements(path, way, index, tree)):
                if any(levels.get(part, depth) < depth for part in full):
                    concerned.add(path)
                    del tree[names]
                    whole = (*way, *names)
                    pending.setdefault(path, {})[whole] = given.whole[path][whole]
            if not tree:
                del of_path[index]
    return concerned


def _most_common(found: list[dict[Index, Tree]]) -> dict[Index, Tree]:
    counts = Counter(map(_frozen, found))
    best = max(counts.values())
    return next(value for value in found if counts[_frozen(value)] == best)


def _frozen(value: Mapping[Index, Tree]) -> tuple[object, ...]:
    return tuple((index, frozen_tree(tree)) for index, tree in sorted(value.items()))


def frozen_tree(tree: Tree) -> tuple[object, ...]:
    """The same for equal trees, to be a key."""
    return tuple((names, tuple(sorted(acts.items()))) for names, acts in sorted(tree.items()))


def registry(edits: Mapping[tuple[str, UnitKey], ClassEdits]) -> dict[str, Tree]:
    """What acts below each instance."""
    found: dict[str, Tree] = defaultdict(dict)
    for (path, _), own in edits.items():
        steps = [indexed(step) for step in path.split(".")] if path else []
        for (_, name), acts in own.acts.items():
            for index, value in acts.items():
                whole = [*steps, (name, index)]
                for k in range(len(whole)):
                    owner = ".".join(path.split(".")[:k])
                    names, indices = zip(*whole[k:], strict=True)
                    found[owner].setdefault(tuple(names), {})[tuple(indices)] = value
    return found


def elements(path: str, way: Names, index: Index, tree: Tree) -> Iterable[tuple[Names, list[str]]]:
    """The full names of the matrices that a tree is about, below the component `way` of the instance `path`, by the way to them."""
    head = ".".join(filter(None, (path, *way))) + shown(index)
    for names, acts in tree.items():
        yield names, [".".join((head, *(n + shown(i) for n, i in zip(names, indices, strict=True)))) for indices in acts]


def shown(index: Index) -> str:
    """Subscripts as paths have them."""
    return f"[{','.join(map(str, index))}]" if index else ""
