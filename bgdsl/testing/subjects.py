"""What a test compares: models as it writes them, with modifications, and recorded files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from bgdsl import pipeline
from bgdsl.diagnostics import Reporter
from bgdsl.pipeline import Model
from bgdsl.source import Span
from bgdsl.syntax import ast
from bgdsl.syntax.library import Library

HEIR = " in test"
"""What ends the name of a model with a test's modifications."""


def modified(library: Library, model: ast.Reference, arguments: tuple[ast.Argument, ...], span: Span) -> Model:
    """The model as a test writes it: flattened from a nameless heir of it. BgError where it is wrong."""
    heir = ast.Model("model", f"{model.text}{HEIR}", None, (ast.Extends(model, arguments, span=span),), (), span=span)
    main = replace(library.main, tree=replace(library.main.tree, items=(*library.main.tree.items, heir)))
    modules = {key: main if module is library.main else module for key, module in library.modules.items()}
    return pipeline.instantiate(replace(library, main=main, modules=modules), heir.name, {}, Reporter())


@dataclass(frozen=True, eq=False)
class Record:
    """The columns (n,) of a file by name, looked at as a run is."""

    columns: Mapping[str, Any]

    @property
    def time(self) -> Any:
        return self.columns["time"]

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self.columns)

    def __getitem__(self, name: str) -> Any:
        return self.columns[name]


def record(path: Path) -> Record:
    """A recorded file: CSV, netCDF or Parquet. BgError (BG616) where it cannot be read."""
    from bgdsl.simulate.inputs import read_columns

    return Record(read_columns(path, Reporter()))
