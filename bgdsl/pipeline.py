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
from typing import TYPE_CHECKING, Any, TypeVar

from bgdsl.collecting import uncollected
from bgdsl.diagnostics import BgError, Diagnostic, Reporter, listed
from bgdsl.ir.causal import CausalGraph
from bgdsl.ir.graph import BondGraph, array_of_entry
from bgdsl.ir.program import Assign, Program, Record, defined
from bgdsl.ir.scalar import ScalarGraph
from bgdsl.ir.system import SortedSystem
from bgdsl.passes.causality import assign_causality
from bgdsl.passes.choice import is_part
from bgdsl.passes.domains import check_domains
from bgdsl.passes.equations import derive_equations
from bgdsl.passes.flatten import flatten
from bgdsl.passes.lower import lower
from bgdsl.passes.modules import load_modules
from bgdsl.passes.reduce_index import reduce_index
from bgdsl.passes.scalar import open_vectors
from bgdsl.passes.sorting import sort_equations
from bgdsl.passes.units import check_units
from bgdsl.passes.weights import weighed
from bgdsl.source import Source, Span
from bgdsl.syntax.library import Library
from bgdsl.syntax.parser import parse, read_source

if TYPE_CHECKING:
    from bgdsl.backends.native.model import NativeModel
    from bgdsl.simulate.options import Options, Settings
    from bgdsl.simulate.quadrature import Quadratures
    from bgdsl.simulate.result import Run

Before = TypeVar("Before")
After = TypeVar("After")

Value = float | bool | str | tuple[Any, ...]
"""What a parameter can be set to: a number, a truth value, a string, or (nested) tuples of numbers."""


def load(
    path: str | Path, model: str | None = None, *, search: Sequence[str | Path] = (), overrides: Mapping[str, Value] | None = None
) -> Model:
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


def load_source(source: Source, model: str | None = None, *, search: Sequence[str | Path] = ()) -> Model:
    """As `load`, from a text at hand; imports are looked for beside the source's path."""
    return _front(source, model, search, None, Reporter())


def load_library(source: Source, search: Sequence[str | Path], report: Reporter) -> Library:
    """The file and everything that it imports."""
    library = load_modules(source, tuple(Path(folder) for folder in search), parse, report)
    report.stop_if_errors()
    return library


@uncollected()
def _front(
    source: Source, model: str | None, search: Sequence[str | Path], overrides: Mapping[str, Value] | None, report: Reporter
) -> Model:
    return instantiate(load_library(source, search, report), model, overrides or {}, report)


@uncollected()
def instantiate(
    library: Library, model: str | None, overrides: Mapping[str, Value], report: Reporter, *, experiment: str | None = None
) -> Model:
    """Flatten and check one model of a library, perhaps with the structure that an experiment wants."""
    graph = flatten(library, model, report, overrides=overrides, experiment=experiment)
    report.stop_if_errors()
    graph = check_units(check_domains(graph, report), report)
    report.stop_if_errors()
    return Model(library, graph, dict(overrides), report)


@dataclass(frozen=True, eq=False)
class Model:
    """A checked model. `graph` is its flat bond graph; `overrides` are the parameters that were set when it was flattened; `weighed`:
    terms that a run of it can delete from their balances."""

    library: Library
    graph: BondGraph
    overrides: Mapping[str, Value]
    report: Reporter
    weighed: frozenset[int] = frozenset()

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
        causal = self._stage(assign_causality, self.scalar)
        return weighed(causal, self.weighed) if self.weighed else causal

    @cached_property
    def sorted(self) -> SortedSystem:
        return self._stage(sort_equations, self._stage(reduce_index, self._stage(derive_equations, self.causal)))

    @cached_property
    def program(self) -> Program:
        return self._stage(lower, self.sorted)

    @uncollected()
    def _stage(self, run: Callable[[Before, Reporter], After], data: Before) -> After:
        result = run(data, self.report)
        self.report.stop_if_errors()
        return result

    def check(self) -> tuple[Diagnostic, ...]:
        """Everything short of code; the warnings. BgError where the model is wrong."""
        _ = self.program
        return self.warnings

    def changed(self, overrides: Mapping[str, Value], experiment: str | None = None) -> Model:
        """The same model flattened again with other values for (structural) parameters, perhaps those of an experiment."""
        kept = {
            name: value for name, value in self.overrides.items() if array_of_entry(name) == name or array_of_entry(name) not in overrides
        }
        return instantiate(self.library, self.name, {**kept, **overrides}, Reporter(), experiment=experiment)

    def sizes(self) -> dict[str, int]:
        """How large the model is: bonds, equations, states, loops (blocks that have to be solved)."""
        steps = self.program.steps
        loops = sum(not isinstance(step, Assign) for step in steps)
        equations = sum(len(defined(step)) for step in steps) + len(self.program.states)
        return {
            "bonds": sum(bond.width for bond in self.graph.bonds),
            "equations": equations,
            "states": len(self.program.states),
            "loops": loops,
        }

    def module_text(self) -> str:
        """The model as a standalone NumPy module."""
        from bgdsl.backends.numpy.module import write_module

        return write_module(self.program, source_name=Path(self.graph.sources[0].name).name)

    def compile(self) -> System:
        """The model with its machine code (compiled when first run)."""
        return System(self)


@dataclass(frozen=True, eq=False)
class System:
    """A compiled model: what it computes, and the means to run it."""

    model: Model

    @property
    def program(self) -> Program:
        return self.model.program

    @property
    def states(self) -> tuple[Record, ...]:
        return self.program.states

    @property
    def outputs(self) -> tuple[Record, ...]:
        return tuple(record for record, _ in self.program.outputs)

    @property
    def inputs(self) -> tuple[Record, ...]:
        return self.program.inputs

    @property
    def bonds(self) -> tuple[Record, ...]:
        return tuple(record for record, _, _ in self.program.bonds)

    @property
    def parameters(self) -> dict[str, float]:
        """Every scalar parameter with its default value."""
        from bgdsl.simulate.options import parameter_values

        return parameter_values(self.program, None, {}, Reporter())

    @cached_property
    def source(self) -> str:
        """The text of the generated NumPy module."""
        return self.model.module_text()

    @cached_property
    def native(self) -> NativeModel:
        from bgdsl.backends.native.model import build

        return build(self.program)

    def simulate(
        self,
        experiment: str | None = None,
        parameters: Mapping[str, Any] | None = None,
        *,
        output: str | Path | None = None,
        force: bool = False,
        quadratures: Quadratures | None = None,
        state: Any = None,
        progress: Callable[[float], None] | None = None,
        say: Callable[[str], None] | None = None,
        **more: Any,
    ) -> Run:
        """Run an experiment, or the model as it stands.

        parameters: changes by dotted path; as keywords too (`mA=12.0`). Settings of the run: stop, interval, tolerance (or rtol,
        atol), method, max_step, most_steps, times (of the rows), window, vars, inputs. `state` (n,) replaces the initial state. With
        `output` the rows go to that file (CSV, netCDF, Parquet).
        A structural parameter has the model flattened and compiled again, and `say` is told.
        """
        from bgdsl.simulate import run

        settings, changes = settings_of(more, parameters)
        system = self._restructured(experiment, changes, say)
        if quadratures is not None and system is not self:
            _refuse_measuring(experiment, [name for name in system.model.overrides if name not in self.model.overrides])
        options = system.options(experiment, changes, settings)
        return run.simulate(
            system.native,
            options,
            quadratures=quadratures,
            start=state,
            output=None if output is None else Path(output),
            force=force,
            progress=progress,
        )

    def options(self, experiment: str | None, changes: Mapping[str, Any], settings: Settings) -> Options:
        """What a run with these settings is, all defaults settled."""
        from bgdsl.simulate.options import resolve_options

        return resolve_options(self.program, experiment, changes, settings, report=Reporter())

    def _restructured(self, experiment: str | None, changes: Mapping[str, Any], say: Callable[[str], None] | None) -> System:
        """This system, or one compiled anew where the run changes structural parameters."""
        graph = self.model.graph
        if not any(parameter.structural for parameter in graph.parameters):
            return self
        from bgdsl.simulate.structure import structural_changes

        wanted = structural_changes(graph.parameters, graph.experiments, experiment, changes)
        alone = experiment is None and len(graph.experiments) == 1  # then it is run without being named
        chosen = next((item for item in graph.experiments if alone or item.name == experiment), None)
        if not wanted and (chosen is None or chosen.fits):
            return self
        if say is not None:
            say(f"compiling again for {', '.join(wanted)}")
        return self.model.changed(wanted, None if chosen is None else chosen.name).compile()


def _refuse_measuring(experiment: str | None, shaped: Sequence[str]) -> None:
    """Terms are measured, and reduced, of the model as it is written: other sizes would have other terms."""
    from bgdsl.simulate.options import STRUCTURAL

    what = f"experiment `{experiment}`" if experiment else "this run"
    span = Span(Source("<run>", experiment or "run"), 0, len(experiment or "run"))
    Reporter().fail(
        STRUCTURAL,
        f"{what} gives the model other sizes or conditions, so other terms than those to be measured",
        span,
        listed(shaped),
        helps=("write a model that has them, `model Large extends Small(n = 4); end Large;`, and measure that",),
    )


_SETTINGS = (
    *("start", "stop", "interval", "times", "tolerance", "rtol", "atol", "method", "max_step", "window", "inputs", "drift"),
    "most_steps",
)


def settings_of(more: Mapping[str, Any], parameters: Mapping[str, Any] | None) -> tuple[Settings, dict[str, Any]]:
    """Keywords sorted into settings of the run and changed parameters."""
    from bgdsl.simulate.options import Settings

    given = {name: value for name, value in more.items() if name in _SETTINGS and value is not None}
    variables = more.get("vars")
    if variables is not None:
        given["variables"] = (variables,) if isinstance(variables, str) else tuple(variables)
    changes = {name: value for name, value in more.items() if name not in _SETTINGS and name != "vars"}
    return Settings(**given), {**(parameters or {}), **changes}


# --------------------------------------------------------------------------------------------------------------- checks


def check_file(
    path: Path, *, model: str | None = None, search: Sequence[str | Path] = (), overrides: Mapping[str, Value] | None = None
) -> list[Diagnostic]:
    """Every finding in a file: of the model named, or of each of its models."""
    report = Reporter()
    try:
        source = read_source(path, report)
        report.stop_if_errors()
    except BgError as error:
        return list(error.diagnostics)
    return check_source(source, model=model, search=search, overrides=overrides)


def check_source(
    source: Source, *, model: str | None = None, search: Sequence[str | Path] = (), overrides: Mapping[str, Value] | None = None
) -> list[Diagnostic]:
    """As `check_file`, for a text at hand (an editor's, say)."""
    report = Reporter()
    try:
        library = load_library(source, search, report)
    except BgError:
        return _distinct(report)
    names: Sequence[str | None] = [model] if model is not None or overrides else [item.name for item in library.models()]
    for name in names:
        own = Reporter()
        try:
            if name is not None and not overrides and is_part(library, name):
                check_units(check_domains(flatten(library, name, own, part=True), own), own)
            else:
                checked = instantiate(library, name, overrides or {}, own)
                checked.check()
                _check_structures(checked, own)
        except BgError as error:
            own.diagnostics += error.diagnostics
        report.diagnostics += own.diagnostics
    return _distinct(report)


def _check_structures(model: Model, report: Reporter) -> None:
    """What is wrong with the model in the structures that its experiments give it, and with what they change there."""
    from bgdsl.simulate.structure import structural_changes

    graph = model.graph
    if not any(parameter.structural for parameter in graph.parameters):
        return
    for experiment in graph.experiments:
        try:
            wanted = structural_changes(graph.parameters, graph.experiments, experiment.name, {})
            if wanted or not experiment.fits:
                model.changed(wanted, experiment.name).check()
        except BgError as error:
            report.diagnostics += error.diagnostics


def _distinct(report: Reporter) -> list[Diagnostic]:
    """The findings in the order made; what two models of a file share is said once."""
    return list(dict.fromkeys(report.diagnostics))


def is_generated_module(text: str) -> bool:
    """Whether a text is a module that this tool generated."""
    return "\n# tool    bgdsl" in text
