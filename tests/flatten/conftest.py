"""Flatten a text, and look at what came out."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from bgdsl.diagnostics import Reporter
from bgdsl.expr import to_text
from bgdsl.ir.graph import BondGraph
from bgdsl.passes.flatten import flatten
from bgdsl.passes.modules import load_modules
from bgdsl.source import Source
from bgdsl.syntax.parser import parse

Flat = Callable[..., BondGraph]


def flat_text(
    text: str, model: str | None = None, *, path: Path | None = None, search: tuple[Path, ...] = (), **overrides: Any
) -> BondGraph:
    report = Reporter()
    library = load_modules(Source("test.bg", text, path), search, parse, report)
    report.stop_if_errors()
    return flatten(library, model, report, overrides=overrides)


@pytest.fixture
def flat() -> Flat:
    return flat_text


class Seen:
    """A flat graph as text, by name."""

    def __init__(self, graph: BondGraph):
        self.laws = {e.name: [f"{to_text(law.left)} = {to_text(law.right)}" for law in e.laws] for e in graph.elements}
        self.modulus = {e.name: [[to_text(x) for x in row] for row in e.modulus] for e in graph.elements if e.modulus is not None}
        self.parameters = {p.name: [to_text(x) for x in p.values] for p in graph.parameters}
        self.equations = [f"{to_text(e.left)} = {to_text(e.right)}" for e in graph.equations]
        self.bonds = {b.name: (b.tail.node, b.head.node) for b in graph.bonds}
        self.changes = {e.name: {name: to_text(x) for name, x in e.changes.items()} for e in graph.experiments}
        self.starts = {name: to_text(x) for e in graph.elements for name, x in e.starts.items()}


@pytest.fixture
def seen() -> Callable[..., Seen]:
    return lambda *args, **more: Seen(flat_text(*args, **more))
