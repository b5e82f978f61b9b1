"""Declarations with other classes, and with what acts in them: in place for most elements of an array, redeclared for the others.

    PartMTF v_to_block[6](each T = transpose(block.R), each acts = [2, 1; -1, 2]);
    redeclare PartMTF v_to_block[1](acts = [2, 1; 1, 1]);

Input        one form of a class, what is given in it, how the dropped terms of a matrix are told
Output       the edits of its text
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

from bgdsl.reductions.acts import Given, Names, Tree, elements, frozen_tree
from bgdsl.reductions.chosen import for_elements
from bgdsl.reductions.source_map import UnwritableError
from bgdsl.reductions.specialise import Variant
from bgdsl.reductions.statements import Acts, Index, Node, indent_at
from bgdsl.source import Edit, Source, Span, apply_edits
from bgdsl.syntax import ast

Tell = Callable[[str, Sequence[str]], Sequence[str]]
"""The lines about the dropped terms of a matrix: from the name it has where they stand, and its full names."""


@dataclass(slots=True)
class Kind:
    """Elements of a declared array that have one class and in which the same acts. The class is None where it is the declared one."""

    name: str | None
    tree: Tree
    indices: list[Index]


class Declared:
    """The edits of one form of a class."""

    def __init__(self, variant: Variant, given: Given, tell: Tell):
        self.variant, self.given, self.tell = variant, given, tell
        self.source: Source = variant.unit.model.span.source

    def edits(self) -> list[Edit]:
        """All edits of the text: its own, the names of its parts' and bases' classes, what acts in them, and its own name."""
        variant, model = self.variant, self.variant.unit.model
        edits = list(variant.edits)
        for item in model.items:
            match item:
                case ast.Declaration():
                    for declarator in item.declarators:
                        edits += self.redeclared_in(declarator.arguments, item, own=False)
                    edits = self.declaration(item, edits)
                case ast.Redeclaration():
                    edits += self.redeclaration(item)
                case ast.Extends():
                    if id(item) in variant.bases and variant.bases[id(item)].renamed:
                        edits.append(Edit(item.base.span, variant.bases[id(item)].name))
                    edits += self.redeclared_in(item.arguments, item)
        if variant.inserted:
            edits.append(self.new_parts())
        return edits + (self.renaming() if variant.renamed else [])

    # ------------------------------------------------------------------------------------------------------------ kinds

    def kinds(self, node: Node, component: str) -> list[Kind]:
        """What the elements of the component that a node declares need; what most of them do first."""
        variant = self.variant
        parts = variant.parts.get(node, {}) if isinstance(node, int) else {}
        trees = self.given.of.get((id(variant), node), {})
        found: dict[object, Kind] = {}
        for index in sorted({*parts, *trees}):
            part = parts.get(index)
            name = part.name if part is not None and part.renamed else None
            if isinstance(node, int):
                name = variant.retyped.get(node, name)
            tree = trees.get(index, {})
            found.setdefault((name, frozen_tree(tree)), Kind(name, tree, [])).indices.append(index)
        plain = [kind for kind in found.values() if kind.name is None and not kind.tree]
        base = plain[0] if plain else max(found.values(), key=lambda kind: len(kind.indices), default=None)
        if base is None:
            return []
        others = [kind for kind in found.values() if kind is not base]
        told = [self.told_all(node, component, base, other).tree.keys() for other in others]
        if not base.tree or (self.said_elsewhere(node, base) and all(base.tree.keys() <= names for names in told)):
            return [base, *others]
        # what is said of most elements would be said of others, too, that have nothing of the kind
        return [Kind(base.name, {}, base.indices), base, *others]

    def said_elsewhere(self, node: Node, base: Kind) -> bool:
        """Do all elements of an array that have their class from elsewhere get told, there, what the declaration says of the others?"""
        variant, names = self.variant, base.tree.keys()
        for other in self.given.mixed.get(node, ()) if isinstance(node, int) else ():
            trees = self.given.of.get((id(variant), other), {})
            if variant.parts.get(other, trees).keys() - trees.keys() or any(names - tree.keys() for tree in trees.values()) or not trees:
                return False
        return True

    def told_all(self, node: Node, name: str, base: Kind, kind: Kind) -> Kind:
        """A kind with all that the declaration, which goes for its elements too, says of the base."""
        path = next(iter(self.given.by.get((id(self.variant), node), self.variant.paths)))
        return Kind(kind.name, self.given.all_said(path, name, kind.indices[0], kind.tree, base.tree), kind.indices)

    def comments(self, node: Node, name: str, kind: Kind) -> list[str]:
        paths = self.given.by.get((id(self.variant), node), [])
        about: dict[Names, list[str]] = {}
        for path in paths:
            for index in kind.indices:
                for names, full in elements(path, (name,), index, kind.tree):
                    about.setdefault(names, []).extend(full)
        return [f"// {line}" for names, full in about.items() for line in self.tell(".".join((name, *names)), full)]

    def others(self, node: Node, name: str, kinds: Sequence[Kind], written: str) -> list[str]:
        """Redeclarations of the elements that are not as most are, with their comments."""
        lines: list[str] = []
        base, *others = kinds
        for kind in (self.told_all(node, name, base, other) for other in others):
            lines += self.comments(node, name, kind)
            for selection in selections(kind.indices):
                each = "" if selection.isdigit() else "each "
                arguments = ", ".join(_arguments(kind.tree, each))
                lines.append(f"redeclare {kind.name or written} {name}[{selection}]{f'({arguments})' if arguments else ''};")
        return lines

    # ------------------------------------------------------------------------------------------------------------ items

    def declaration(self, item: ast.Declaration, edits: list[Edit]) -> list[Edit]:
        """The edits with those of one declaration."""
        inside = [e for e in edits if item.span.start <= e.span.start and e.span.end <= item.span.end]
        bases: dict[int, Kind] = {}
        lines: list[str] = []
        above: list[str] = []
        new: list[Edit] = []
        for declarator in item.declarators:
            kinds = self.kinds(id(declarator), declarator.name)
            if not kinds:
                continue
            bases[id(declarator)] = kinds[0]
            above += self.comments(id(declarator), declarator.name, kinds[0])
            new += _given(declarator, kinds[0].tree, "each " if declarator.dims else "")
            lines += self.others(id(declarator), declarator.name, kinds, item.type.name.span.text)
        names = {id(d): bases[id(d)].name if id(d) in bases else None for d in item.declarators}
        if not bases or (not new and not lines and not any(names.values())):
            return edits
        kept = [d for d in item.declarators if not any(e.span.start <= d.span.start and d.span.end <= e.span.end for e in inside)]
        if not kept:
            return edits
        separator = "\n" + indent_at(self.source, item.span.start)
        if len({names[id(d)] for d in kept}) == 1:
            name = names[id(kept[0])]
            if name is not None:
                whole = any(id(d) in self.variant.retyped for d in kept)
                new.append(Edit(item.type.span if whole else item.type.name.span, name))
        else:
            edits = [e for e in edits if e not in inside]
            new = [Edit(item.span, separator.join(self.regrouped(item, kept, names, [*inside, *new])))]
        if lines:
            new.append(self.below(item.span, lines))
        if above:
            new.append(self.above(item.span, above))
        return edits + new

    def regrouped(
        self, item: ast.Declaration, kept: Sequence[ast.Declarator], names: Mapping[int, str | None], edits: Sequence[Edit]
    ) -> list[str]:
        """A declaration whose names no longer have one class: one declaration each class."""
        groups: dict[str | None, list[ast.Declarator]] = {}
        for declarator in kept:
            groups.setdefault(names[id(declarator)], []).append(declarator)
        before = self.source.text[item.span.start : item.type.span.start]
        after = self.source.text[item.type.span.end : item.declarators[0].span.start]
        tail = [e for e in edits if e.span.start >= item.span.end]
        lines = []
        for name, declarators in groups.items():
            whole = any(id(d) in self.variant.retyped for d in declarators)
            dims = self.source.text[item.type.name.span.end : item.type.span.end]
            shown = item.type.span.text if name is None else name if whole else name + dims
            texts = [spliced(d.span, [e for e in edits if d.span.start <= e.span.start and e.span.end <= d.span.end]) for d in declarators]
            lines.append(f"{before}{shown}{after}{', '.join(texts)};")
        return lines + [e.text.strip() for e in tail]

    def redeclaration(self, item: ast.Redeclaration) -> list[Edit]:
        """An item that redeclares: its own elements in place, split where they differ."""
        kinds = self.kinds(id(item), item.name)
        if not kinds:
            return []
        base, *others = kinds
        if not others:
            edits = self.in_place(item, base)
        else:
            every = sorted(index for kind in kinds for index in kind.indices)
            if item.arguments and any(len(index) != 1 for index in every):
                raise UnwritableError((), f"the elements of `{item.name}` differ, an array of several dimensions that is redeclared")
            first, *more = self.divided(item, base, every)
            edits = first
            lines = [spliced(item.span, one) for one in more]
            for kind in (self.told_all(id(item), item.name, base, other) for other in others):
                lines += self.comments(id(item), item.name, kind)
                lines += [spliced(item.span, one) for one in self.divided(item, kind, every)]
            edits.append(self.below(item.span, lines))
        comments = self.comments(id(item), item.name, base)
        return [*edits, self.above(item.span, comments)] if comments else edits

    def redeclared_in(self, arguments: Iterable[ast.Argument], clause: ast.Extends | ast.Declaration, own: bool = True) -> list[Edit]:
        """Redeclarations among the modifications of an `extends` clause; elements that differ are redeclared by items after it. own: of
        a declaration they are a part's, and cannot be told apart here."""
        edits: list[Edit] = []
        stack = [(argument, own) for argument in arguments]
        while stack:
            argument, own = stack.pop()
            if isinstance(argument, ast.Modifier):
                stack += [(inner, False) for inner in argument.nested]
                continue
            kinds = self.kinds(id(argument), argument.name)
            if not kinds:
                continue
            base, *others = kinds
            if others and not own:
                raise UnwritableError((), f"the elements of `{argument.name}` differ, which are redeclared from outside")
            edits += self.in_place(argument, base)
            lines = self.others(id(argument), argument.name, kinds, argument.type.span.text)
            if lines:
                edits.append(self.below(clause.span, lines))
            comments = self.comments(id(argument), argument.name, base)
            if comments:
                edits.append(self.above(clause.span, comments))
        return edits

    def in_place(self, item: ast.Redeclaration, kind: Kind) -> list[Edit]:
        one = len(kind.indices) == 1 and all(isinstance(subscript, ast.Number) for subscript in item.subscripts)
        return self.as_kind(item, kind, "" if one else "each ")

    def as_kind(self, item: ast.Redeclaration, kind: Kind, each: str) -> list[Edit]:
        edits = [] if kind.name is None else [Edit(item.type.span, kind.name)]
        return edits + _given(item, kind.tree, each)

    def divided(self, item: ast.Redeclaration, kind: Kind, every: Sequence[Index]) -> list[list[Edit]]:
        """The edits that make an item redeclare the elements of one kind only; one set of them for each text that this takes."""
        found = []
        for selection in selections(kind.indices):
            given = self.as_kind(item, kind, "" if selection.isdigit() else "each ")
            apart = [e for e in for_elements(item, every, kind.indices) if all(e.span != other.span for other in given)]
            found.append([*given, *apart, _subscripted(item, selection)])
        return found

    def new_parts(self) -> Edit:
        """The parts of bonds that are put in, before the first section."""
        model, source = self.variant.unit.model, self.source
        at = model.sections[0].span.start if model.sections else source.text.rfind("end", 0, model.span.end)
        line = source.text.rfind("\n", 0, at) + 1
        indent = indent_at(source, model.items[-1].span.start) if model.items else "  "
        lines: list[str] = []
        for name, part in self.variant.inserted.items():
            base, *_ = kinds = self.kinds(name, name)
            arguments = ", ".join(_arguments(base.tree, "each " if part.dims else ""))
            dims = f"[{', '.join(map(str, part.dims))}]" if part.dims else ""
            lines += [*self.comments(name, name, base), f"{part.kind} {name}{dims}({arguments});"]
            lines += self.others(name, name, kinds, part.kind)
        return Edit(Span(source, line, line), "".join(f"{indent}{text}\n" for text in lines))

    def above(self, span: Span, lines: Sequence[str]) -> Edit:
        """Lines before the one on which a span begins."""
        start = self.source.text.rfind("\n", 0, span.start) + 1
        indent = indent_at(self.source, span.start)
        return Edit(Span(self.source, start, start), "".join(f"{indent}{line}\n" for line in lines))

    def below(self, span: Span, lines: Sequence[str]) -> Edit:
        """Lines after what stands there; what follows it on its line comes after them."""
        text = self.source.text
        separator = "\n" + indent_at(self.source, span.start)
        line_end = text.find("\n", span.end)
        rest = text[span.end : line_end if line_end >= 0 else len(text)]
        if not rest.strip() or rest.lstrip().startswith("//"):
            end = span.end + (len(rest) if rest.strip() else 0)
            return Edit(Span(self.source, span.end, end), rest.rstrip() * (end > span.end) + "".join(separator + line for line in lines))
        end = span.end + len(rest) - len(rest.lstrip())
        return Edit(Span(self.source, span.end, end), "".join(separator + line for line in lines) + separator)

    def renaming(self) -> list[Edit]:
        """The class's own name, at its head and its end."""
        model = self.variant.unit.model
        text = model.span.text
        head = re.match(rf"(?:model|element)\s+({model.name})\b", text)
        tail = re.search(rf"\bend\s+({model.name})\s*;?\s*$", text)
        assert head is not None and tail is not None
        starts = ((model.span.start + match.start(1), model.span.start + match.end(1)) for match in (head, tail))
        return [Edit(Span(self.source, start, end), self.variant.name) for start, end in starts]


def spliced(span: Span, edits: Iterable[Edit]) -> str:
    """The text of a span with edits inside it."""
    part = Source(span.source.name, span.text)
    moved = [Edit(Span(part, edit.span.start - span.start, edit.span.end - span.start), edit.text) for edit in edits]
    return apply_edits(part, moved)


# ------------------------------------------------------------------------------------------------------------ arguments


def selections(indices: Sequence[Index]) -> list[str]:
    """Subscripts that choose elements of an array: a number, a range or a vector; of several dimensions one element each."""
    if any(len(index) != 1 for index in indices):
        return [", ".join(map(str, index)) for index in indices]
    chosen = [index[0] for index in indices]
    if len(chosen) == 1:
        return [str(chosen[0])]
    if len(chosen) > 2 and chosen == list(range(chosen[0], chosen[-1] + 1)):
        return [f"{chosen[0]}:{chosen[-1]}"]
    return [f"{{{', '.join(map(str, chosen))}}}"]


def matrix(acts: Acts) -> str:
    """As the language writes it: `[2, 1; -1, 2]`, `{2, 1}` for a bond, a number for a scalar."""
    if isinstance(acts, int | str):
        return str(acts)
    if acts and isinstance(acts[0], tuple):
        return f"[{'; '.join(', '.join(map(str, row)) for row in acts if isinstance(row, tuple))}]"
    return f"{{{', '.join(map(str, acts))}}}"


def _arguments(tree: Tree, each: str) -> Iterator[str]:
    """The modifications that give what acts in a component; each: of all elements of an array of them."""
    for name, inner in _by_name(tree).items():
        if name is None:
            yield f"{each}acts = {_value(inner[()])}"
        else:
            yield f"{each}{name}({', '.join(_arguments(inner, ''))})"


def _by_name(tree: Tree) -> dict[str | None, Tree]:
    groups: dict[str | None, Tree] = {}
    for names, acts in tree.items():
        groups.setdefault(names[0] if names else None, {})[names[1:]] = acts
    return groups


def _value(acts: Mapping[tuple[Index, ...], Acts]) -> str:
    """The value for a matrix; for arrays on the way to it, an array of values."""
    ((_, first),) = list(acts.items())[:1]
    if len(acts) == 1 and not any(next(iter(acts))):
        return matrix(first)
    rows = [len({tuple(indices[:k]) for indices in acts}) for k in range(1 + len(next(iter(acts))))]
    if any(after % before for before, after in pairwise(rows)):
        raise UnwritableError((), "some elements of an array inside an array are of another class")
    flat = sorted((tuple(i for index in indices for i in index), value) for indices, value in acts.items())
    return _nested([(index, matrix(value)) for index, value in flat])


def _nested(values: Sequence[tuple[Index, str]]) -> str:
    if len(values) == 1 and not values[0][0]:
        return values[0][1]
    groups: dict[int, list[tuple[Index, str]]] = {}
    for index, value in values:
        groups.setdefault(index[0], []).append((index[1:], value))
    return f"{{{', '.join(_nested(group) for group in groups.values())}}}"


def _given(item: ast.Declarator | ast.Redeclaration, tree: Tree, each: str) -> list[Edit]:
    """What acts, among the modifications that an item has."""
    if not tree:
        return []
    edits, new = _inserted(item.arguments, tree, each)
    if not new:
        return edits
    if item.arguments:
        end = item.arguments[-1].span.end
        return [*edits, Edit(Span(item.span.source, end, end), "".join(f", {text}" for text in new))]
    at = _after_name(item)
    return [*edits, Edit(Span(item.span.source, at, at), f"({', '.join(new)})")]


def _inserted(arguments: Sequence[ast.Argument], tree: Tree, each: str) -> tuple[list[Edit], list[str]]:
    """Edits inside modifications of the same parts, and what is left to be added."""
    edits: list[Edit] = []
    new: list[str] = []
    modifiers = {a.name.text: a for a in arguments if isinstance(a, ast.Modifier)}
    for name, inner in _by_name(tree).items():
        there = modifiers.get(name or "acts")
        if there is not None and name is None and there.value is not None:
            edits.append(Edit(there.value.span, _value(inner[()])))
        elif there is not None and there.nested:
            below, more = _inserted(there.nested, inner, "" if there.each else each)
            end = there.nested[-1].span.end
            edits += below
            if more:
                edits.append(Edit(Span(there.span.source, end, end), "".join(f", {text}" for text in more)))
        elif name is None:
            new.append(f"{each}acts = {_value(inner[()])}")
        else:
            new.append(f"{each}{name}({', '.join(_arguments(inner, ''))})")
    return edits, new


def _after_name(item: ast.Declarator | ast.Redeclaration) -> int:
    """Where the modifications of an item would begin: after its name and subscripts."""
    text, start = item.span.source.text, item.span.start
    subscripts = item.dims if isinstance(item, ast.Declarator) else item.subscripts
    if subscripts:
        return text.index("]", subscripts[-1].span.end) + 1
    if isinstance(item, ast.Declarator):
        return start + len(item.name)
    found = re.compile(rf"\b{item.name}\b").search(text, item.type.span.end)
    assert found is not None
    return found.end()


def _subscripted(item: ast.Redeclaration, selection: str) -> Edit:
    """The elements that a redeclaration is left with."""
    source = item.span.source
    if item.subscripts:
        return Edit(Span(source, item.subscripts[0].span.start, item.subscripts[-1].span.end), selection)
    at = _after_name(item)
    return Edit(Span(source, at, at), f"[{selection}]")
