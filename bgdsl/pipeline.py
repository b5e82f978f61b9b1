"""The order of the passes, and the objects that people hold: `Model`, `System`, `Run`.

    source text -> tree -> library -> flat graph -> domains, units -> scalar graph -> causality
                -> equations -> reduced index -> sorted blocks -> program -> NumPy module | machine code -> run

Every step is computed once, when somebody asks for it. This is the one file that knows the order; it computes nothing itself.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bgdsl.diagnostics import Diagnostic, Reporter
from bgdsl.ir.causal import CausalGraph
from bgdsl.ir.graph import BondGraph
from bgdsl.ir.library import Library
from bgdsl.ir.program import Program
from bgdsl.ir.scalar import ScalarGraph
from bgdsl.ir.system import SortedSystem
from bgdsl.passes.causality import assign_causality
from bgdsl.passes.domains import check_domains
from bgdsl.passes.equations import derive_equations
from bgdsl.passes.flatten import flatten
from bgdsl.passes.lower import lower
from bgdsl.passes.modules import load_modules
from bgdsl.passes.reduce_index import reduce_index
from bgdsl.passes.scalar import open_vectors
from bgdsl.passes.sorting import sort_equations
from bgdsl.passes.units import check_units
from bgdsl.source import Source
from bgdsl.syntax.parser import parse, read_source

if TYPE_CHECKING:
    from bgdsl.simulate.run import Run

Value = float | bool | str | tuple[Any, ...]
"""What a parameter can be set to: a number, a truth value, a string, or (nested) tuples of numbers."""


def load(path: str | Path, model: str | None = None, *, search: Sequence[str | Path] = (), overrides: Mapping[str, Value] | None = None) -> Model:
    """Read, flatten and check model `model` of the file (or its only one).

    search: folders where imports are looked for after the file's own; overrides: parameters by dotted path, structural ones
    included. BgError with every finding if the model is wrong.
    """
    report = Reporter()
    return _front(read_source(Path(path), report), model, search, overrides, report)


def loads(
    text: str,
    model: str | None = None,
    *,
    name: str = "<text>",
    search: Sequence[str | Path] = (),
    overrides: Mapping[str, Value] | None = None,
) -> Model:
    """As `load`, from text; imports are looked for in the working folder and in `search`."""
    return _front(Source(name, text), model, search, overrides, Reporter())


def load_library(source: Source, search: Sequence[str | Path], report: Reporter) -> Library:
    """The file and everything that it imports."""
    library = load_modules(source, tuple(Path(folder) for folder in search), parse, report)
    report.stop_if_errors()
    return library


def _front(
    source: Source, model: str | None, search: Sequence[str | Path], overrides: Mapping[str, Value] | None, report: Reporter
) -> Model:
    return instantiate(load_library(source, search, report), model, overrides or {}, report)


def instantiate(library: Library, model: str | None, overrides: Mapping[str, Value], report: Reporter) -> Model:
    """Flatten and check one model of a library."""
    graph = flatten(library, model, report, overrides=overrides)
    report.stop_if_errors()
    graph = check_units(check_domains(graph, report), report)
    report.stop_if_errors()
    return Model(library, graph, dict(overrides), report)


@dataclass(frozen=True, eq=False)
class Model:
    """A checked model. `graph` is its flat bond graph; `overrides` are the parameters that were set when it was flattened."""

    library: Library
    graph: BondGraph
    overrides: Mapping[str, Value]
    report: Reporter

    @property
    def name(self) -> str:
        return self.graph.model

    @property
    def source(self) -> str:
        """The `.bg` text of the model's own file."""
        return self.graph.sources[0].text

    @property
    def warnings(self) -> tuple[Diagnostic, ...]:
        return tuple(d for d in self.report.diagnostics if d.severity == "warning")

    @cached_property
    def scalar(self) -> ScalarGraph:
        return self._stage(open_vectors, self.graph)

    @cached_property
    def causal(self) -> CausalGraph:
        return self._stage(assign_causality, self.scalar)

    @cached_property
    def sorted(self) -> SortedSystem:
        return self._stage(sort_equations, self._stage(reduce_index, self._stage(derive_equations, self.causal)))

    @cached_property
    def program(self) -> Program:
        return self._stage(lower, self.sorted)

    def _stage(self, run: Callable[..., Any], data: Any) -> Any:
        result = run(data, self.report)
        self.report.stop_if_errors()
        return result

    def check(self) -> tuple[Diagnostic, ...]:
        """Everything short of code; the warnings. BgError where the model is wrong."""
        _ = self.program
        return self.warnings

    def changed(self, overrides: Mapping[str, Value]) -> Model:
        """The same model flattened again with other values for (structural) parameters."""
        return instantiate(self.library, self.name, {**self.overrides, **overrides}, Reporter())
