"""The reduced file put together: the model's own file edited, with the classes it needs from files that it may not rely on.

Classes of files beside the model are copied in, changed or not; of the shipped library only those that changed are, the
others stay imported. Relative paths of tables are written anew for the folder the file goes to.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from pathlib import Path

from bgdsl.diagnostics import Reporter
from bgdsl.reductions.acts import Given
from bgdsl.reductions.again import ONE_WAY
from bgdsl.reductions.declared import Declared, Tell, spliced
from bgdsl.reductions.source_map import ClassText, SourceMap, UnwritableError, walk
from bgdsl.reductions.specialise import Variant, Variants
from bgdsl.reductions.statements import with_line
from bgdsl.source import Edit, Source, Span, apply_edits
from bgdsl.syntax import ast
from bgdsl.syntax.library import Library, Module

SHIPPED = Path(__file__).parent.parent / "library"

Target = tuple[str, str]
"""(module key, name) of a definition."""


def shipped_path(module: Module) -> tuple[str, ...] | None:
    """The import path of a file of the shipped library; None for any other file."""
    path = module.source.path
    if path is None or not path.resolve().is_relative_to(SHIPPED.resolve()):
        return None
    return path.resolve().relative_to(SHIPPED.resolve()).with_suffix("").parts


def document(
    texts: SourceMap, variants: Variants, given: Given, tell: Tell, annotation: str, folder: Path | None, more: Iterable[Edit] = ()
) -> str:
    """The text of the reduced file. given, tell: what acts in its matrices and how that is told; annotation: put at the head of the
    model; folder: where the file goes (None: stays beside)."""
    return _Document(texts, variants, given, tell, folder).text(annotation, tuple(more))


class _Document:
    def __init__(self, texts: SourceMap, variants: Variants, given: Given, tell: Tell, folder: Path | None):
        self.given, self.tell = given, tell
        self.texts = texts
        self.library: Library = texts.library
        self.variants = variants
        self.folder = folder
        self.main = texts.library.main
        self.imports: dict[Target, str] = {}
        self.by_model = {id(v.unit.model): [] for v in variants}  # type: dict[int, list[Variant]]
        for variant in variants:
            self.by_model[id(variant.unit.model)].append(variant)

    def text(self, annotation: str, more: tuple[Edit, ...]) -> str:
        inlined, imported = self.closure()
        edits = [*self.file_edits(self.main), *more]
        edits += self.import_edits(imported)
        edits += [Edit(self.with_comment(item), "") for item in self.main.tree.items if isinstance(item, ast.Test)]
        edits.append(self.annotated(annotation))
        text = apply_edits(self.main.source, edits).rstrip("\n") + "\n"
        for module, definition in inlined:
            text += f"\n{self.definition(module, definition)}\n"
        return self.laid_out(text)

    def laid_out(self, text: str) -> str:
        """In the canonical layout, if that is what the author's files are in; else untouched lines stay as they are."""
        from bgdsl.syntax.formatter import format_source

        report = Reporter()
        modules = [m for m in self.library.modules.values() if shipped_path(m) is None]
        if all(format_source(module.source, report) == module.source.text for module in modules):
            return format_source(Source("reduced.bg", text), report)
        return text

    # -------------------------------------------------------------------------------------------------- what is needed

    def closure(self) -> tuple[list[tuple[Module, ast.Definition]], list[Target]]:
        """Definitions to copy in, in the order of their files, and shipped ones to import."""
        wanted: set[Target] = set()
        copied: set[Target] = set()
        imported: set[Target] = set()
        stack = [target for item in self.main.tree.items for target in self.needs(self.main, item)]
        for variant in self.variants:
            if variant.renamed and variant.unit.module is not self.main:
                # the copy stands where its class would, and needs what that needs
                copied.add((variant.unit.module.key, variant.unit.model.name))
                stack += self.needs(variant.unit.module, variant.unit.model)
        while stack:
            target = stack.pop()
            module = self.library.modules[target[0]]
            if module is self.main or target in wanted or target in imported:
                continue
            definition = module.definitions[target[1]]
            if shipped_path(module) is not None and not self.replaces(definition):
                imported.add(target)
            else:
                wanted.add(target)
                stack += self.needs(module, definition)
        order = {key: k for k, key in enumerate(self.library.modules)}
        inlined = sorted(wanted | copied, key=lambda t: (order[t[0]], self.library.modules[t[0]].definitions[t[1]].span.start))
        self.check_names(inlined)
        definitions = [(self.library.modules[key], self.library.modules[key].definitions[name]) for key, name in inlined]
        return definitions, sorted(imported, key=lambda t: (order[t[0]], t[1]))

    def replaces(self, definition: ast.Definition) -> bool:
        """Is the shipped class under its own name one that changed?"""
        return any(v.changed and not v.renamed for v in self.by_model.get(id(definition), []))

    def needs(self, module: Module, item: ast.Node) -> Iterator[Target]:
        """The definitions outside its own text that an item names."""
        for node in walk(item):
            if isinstance(node, ast.Import):
                continue
            if isinstance(node, ast.Reference):
                yield from self.named(module, node)

    def named(self, module: Module, node: ast.Reference) -> Iterator[Target]:
        first = node.parts[0].name
        if node.text in module.qualified:
            target = module.qualified[node.text]
            yield target.module, target.name
        elif first in module.definitions:
            yield module.key, first
        else:
            tables = [module.imports, *module.nested.values()]
            for target in (table[first] for table in tables if first in table):
                if target.name != first and shipped_path(self.library.modules[target.module]) is None:
                    raise UnwritableError((), f"`{first}` is another name for `{target.name}`, which would have to be copied")
                yield target.module, target.name

    def check_names(self, inlined: list[Target]) -> None:
        seen = dict.fromkeys(self.main.definitions, self.main.key)
        for key, name in inlined:
            if seen.setdefault(name, key) != key:
                raise UnwritableError((), f"two files define `{name}`, and both would have to stand in one file")

    # ------------------------------------------------------------------------------------------------------------ text

    def file_edits(self, module: Module) -> list[Edit]:
        """The edits of the main file: classes changed in place, copies beside their originals, paths of tables."""
        edits: list[Edit] = []
        for variant in self.variants:
            if variant.unit.module is not module:
                continue
            if not variant.renamed:
                edits += self.class_edits(variant)
            else:
                end = variant.unit.model.span.end
                edits.append(Edit(Span(module.source, end, end), f"\n\n{self.class_text(variant)}"))
        for item in module.tree.items:
            if not isinstance(item, ast.Test):
                edits += self.table_edits(module, item)
        return edits

    def class_edits(self, variant: Variant) -> list[Edit]:
        return Declared(variant, self.given, self.tell).edits()

    def class_text(self, variant: Variant) -> str:
        if variant.unit.outer:
            raise UnwritableError((), f"`{variant.unit.model.name}` is defined inside another class and would have to be copied")
        model = variant.unit.model
        return spliced(model.span, [*self.class_edits(variant), *self.table_edits(variant.unit.module, model)])

    def definition(self, module: Module, definition: ast.Definition) -> str:
        """A definition of another file: its variants if it is a class that instances use, else its text."""
        variants = self.by_model.get(id(definition), [])
        shipped = shipped_path(module) is not None
        texts = [self.class_text(v) for v in variants if v.changed or not shipped]
        if not texts:
            texts = [spliced(definition.span, self.table_edits(module, definition))]
        return self.comment_before(definition) + "\n\n".join(texts)

    def with_comment(self, test: ast.Test) -> Span:
        """A test, which is about the full model, with its lines and the comment lines right above it."""
        own = with_line(test.span)
        source, number = test.span.source, own.line
        while number > 1 and source.line(number - 1).startswith("//"):
            number -= 1
        return Span(source, min(own.start, source.line_starts[number - 1]), own.end)

    def comment_before(self, definition: ast.Definition) -> str:
        """The comment lines right above a definition go with it."""
        source, start = definition.span.source, definition.span.start
        lines: list[str] = []
        number = source.position(start)[0] - 1
        while number >= 1 and source.line(number).startswith("//"):
            lines.append(source.line(number))
            number -= 1
        return "".join(f"{line}\n" for line in reversed(lines))

    def table_edits(self, module: Module, item: ast.Node) -> list[Edit]:
        """Paths of tables, relative to where the file goes."""
        home = module.source.path.resolve().parent if module.source.path else None
        target = self.folder.resolve() if self.folder else (self.main.source.path.resolve().parent if self.main.source.path else None)
        if home is None or target is None or home == target:
            return []
        edits = []
        for node in walk(item):
            if isinstance(node, ast.Call) and node.function.text == "table" and node.arguments:
                first = node.arguments[0]
                if isinstance(first, ast.String) and not os.path.isabs(first.value):
                    moved = Path(os.path.relpath(home / first.value, target)).as_posix()
                    edits.append(Edit(first.span, f'"{moved}"'))
        return edits

    def import_edits(self, imported: list[Target]) -> list[Edit]:
        """Imports of what is copied in go; what the copies need of the shipped library comes, beside what is imported from there."""
        items = [item for item in self.main.tree.items if isinstance(item, ast.Import)]
        kept = {id(item): [(name, local) for name, local in item.names if self.stays(local)] for item in items}
        present = {(item.path, name) for item in items for name, _ in kept[id(item)]}
        new: dict[tuple[str, ...], list[str]] = {}
        for path, name in [*self.shipped(imported), *self.parts()]:
            if (path, name) not in present and not any(name == target.name for target in self.main.qualified.values()):
                new.setdefault(path, []).append(name)
        edits: list[Edit] = []
        for item in items:
            more = [] if any(name != local for name, local in kept[id(item)]) else new.pop(item.path, [])
            names = [*kept[id(item)], *((name, name) for name in more)]
            lines = [self.import_text(item.path, names)] if names else []
            if item is items[-1]:
                lines += [self.import_text(path, [(name, name) for name in some]) for path, some in new.items()]
            if len(lines) == 1 and names == list(item.names):
                continue
            edits.append(Edit(item.span, "\n".join(lines)) if lines else Edit(with_line(item.span), ""))
        if new and not items:
            at = self.main.tree.items[0].span.start
            lines = [self.import_text(path, [(name, name) for name in some]) for path, some in new.items()]
            edits.append(Edit(Span(self.main.source, at, at), "\n".join(lines) + "\n\n"))
        return edits

    def shipped(self, imported: list[Target]) -> Iterator[tuple[tuple[str, ...], str]]:
        for key, name in imported:
            path = shipped_path(self.library.modules[key])
            assert path is not None
            yield path, name

    def parts(self) -> Iterator[tuple[tuple[str, ...], str]]:
        """The classes that stand for what is left of two-ports and bonds."""
        names = {name for v in self.variants for name in v.retyped.values()}
        names |= {part.kind for v in self.variants for part in v.inserted.values()}
        own = {definition for module in self.library.modules.values() for definition in module.definitions if module.source.path != ONE_WAY}
        for name in sorted(names):
            if name in own:
                raise UnwritableError((), f"the model has a `{name}` of its own")
            yield ("bonds", "one_way"), name

    def stays(self, local: str) -> bool:
        target = self.main.imports.get(local)
        if target is None:
            return True
        module = self.library.modules[target.module]
        return shipped_path(module) is not None and not self.replaces(module.definitions[target.name])

    def import_text(self, path: tuple[str, ...], names: list[tuple[str, str]]) -> str:
        dotted = ".".join(path)
        if len(names) == 1:
            name, local = names[0]
            return f"import {dotted}.{name};" if name == local else f"import {local} = {dotted}.{name};"
        return f"import {dotted}.{{{', '.join(name for name, _ in names)}}};"

    def annotated(self, annotation: str) -> Edit:
        """The annotation, at the head of the model; the one of an earlier reduction goes on standing below it."""
        model = self.variants.main.unit.model
        source = model.span.source
        first = min((item.span.start for item in (*model.items, *model.sections)), default=model.span.end)
        line = source.text.rfind("\n", 0, first) + 1
        start = line if line > model.span.start else first
        return Edit(Span(source, start, start), f"  {annotation}\n")


__all__ = ["ClassText", "document", "shipped_path"]
