"""Every file that a model reaches: the main file, what it imports, and the classes they define, by name.

Files stand in the order in which they were reached, the main one first. Nothing is resolved here beyond imports.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

from bgdsl.source import Source, Span
from bgdsl.syntax import ast


@dataclass(frozen=True, slots=True)
class Imported:
    """A name that an import brings into a file: where it points, and where it is written."""

    module: str
    name: str
    span: Span


@dataclass(frozen=True, eq=False)
class Module:
    """One file: `key` identifies it in its library; `imports` maps local names, `nested` those of imports inside classes by the
    class's `id`, `qualified` the dotted names used without an import."""

    key: str
    source: Source
    tree: ast.File
    imports: Mapping[str, Imported]
    nested: Mapping[int, Mapping[str, Imported]]
    qualified: Mapping[str, Imported]

    @cached_property
    def definitions(self) -> Mapping[str, ast.Definition]:
        """The file's definitions by name; of two with one name, the first. Tests have no name to be found by."""
        found: dict[str, ast.Definition] = {}
        for item in self.tree.items:
            if not isinstance(item, ast.Import | ast.Test):
                found.setdefault(item.name, item)
        return found


@dataclass(frozen=True, eq=False)
class Library:
    """The main module and every module reached from it, by key."""

    main: Module
    modules: Mapping[str, Module]

    @property
    def sources(self) -> tuple[Source, ...]:
        return tuple(module.source for module in self.modules.values())

    def models(self) -> Iterator[ast.Model]:
        """The models of the main file, in the order written."""
        return (item for item in self.main.tree.items if isinstance(item, ast.Model) and item.kind == "model")
