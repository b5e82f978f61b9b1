"""The order in which a model is measured and reduced; `pipeline.py` is the order in which it is compiled and run.

run with integrals -> activities -> decision -> rewritten source -> compiled again, and run for its accuracy
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from bgdsl.diagnostics import BgError, Reporter
from bgdsl.expr import leaves
from bgdsl.ir.activity import ActivityReport, Integrands
from bgdsl.ir.partition import Dependencies, Edge, Frozen
from bgdsl.ir.rewrite import Rewrite
from bgdsl.ir.scalar import Term
from bgdsl.passes import freezing
from bgdsl.passes.activity import activities, grounded, integrands
from bgdsl.passes.dependencies import dependencies
from bgdsl.passes.subgraphs import partitions
from bgdsl.pipeline import Model, load_source, settings_of
from bgdsl.reductions.condition import Decision, decide
from bgdsl.reductions.determined import reinstate
from bgdsl.reductions.mora import eliminate
from bgdsl.reductions.partition import Partitioning, Written, find_partitions, partition_json, partitions_for, write_partitions
from bgdsl.reductions.provenance import Choice, reduced_before
from bgdsl.reductions.repair import repaired
from bgdsl.reductions.rewrite_source import Provenance, number, rewrite
from bgdsl.reductions.source_map import refuse
from bgdsl.source import Edit, Source, Span
from bgdsl.syntax import ast
from bgdsl.syntax.formatter import format_source
from bgdsl.version import VERSION

if TYPE_CHECKING:
    from bgdsl.simulate.options import Options
    from bgdsl.simulate.result import Run


@dataclass(frozen=True, eq=False)
class Scenario:
    """How a model is run when it is measured: an experiment, changed parameters, settings of the run (`System.simulate`)."""

    experiment: str | None = None
    parameters: Mapping[str, Any] | None = None
    settings: Mapping[str, Any] | None = None
    progress: Callable[[float], None] | None = None


@dataclass(frozen=True, eq=False)
class Measured:
    """A model's activities along a run of it."""

    model: Model
    scenario: Scenario
    run: Run
    wanted: Integrands
    report: ActivityReport

    def options(self) -> Options:
        """What the run was, all defaults settled."""
        settings = settings_of(self.scenario.settings or {}, None)[0]
        return self.model.compile().options(self.scenario.experiment, self.scenario.parameters or {}, settings)

    @property
    def changed(self) -> dict[str, float]:
        """The scalar parameters that the run had set away from their defaults."""
        from bgdsl.simulate.options import parameter_values

        defaults = parameter_values(self.model.program, None, {}, Reporter())
        wanted = self.scenario.parameters or {}
        asked = {name for name in defaults if name in wanted or name.partition("[")[0] in wanted}
        arrays = {name.partition("[")[0] for name in asked if "[" in name}
        return {name: self.run.parameters[name] for name in defaults if name in asked or name.partition("[")[0] in arrays}


def measure(model: Model, scenario: Scenario) -> Measured:
    """Run the model and integrate the power of every term. RunError, BG701 or BG702 where that does not work out."""
    from bgdsl.simulate.quadrature import Quadratures

    wanted = integrands(model.scalar)
    quadratures = Quadratures(grounded(wanted.expressions, model.program))
    run = model.compile().simulate(
        scenario.experiment, scenario.parameters, quadratures=quadratures, progress=scenario.progress, **(scenario.settings or {})
    )
    found = run.trajectory.integrals
    assert found is not None
    report = activities(
        model.scalar,
        wanted,
        found.values.tolist(),
        experiment=run.experiment or None,
        window=found.window,
        report=Reporter(),
        errors=found.errors.tolist(),
    )
    return Measured(model, scenario, run, wanted, report)


@dataclass(frozen=True, eq=False)
class Reduced:
    """A reduced model: `source` is its text; `report`, `decision` and `rewrite` tell what was measured, chosen and written."""

    source: str
    measured: Measured
    decision: Decision
    rewrite: Rewrite

    @property
    def report(self) -> ActivityReport:
        return self.measured.report


def provenance(measured: Measured, settings: Mapping[str, str], kind: str = "conditioned") -> Provenance:
    """What the annotation of a reduced file says."""
    source = measured.model.graph.sources[0]
    report = measured.report
    if measured.changed:
        told = ", ".join(f"{name} = {number(value)}" for name, value in measured.changed.items())
        settings = {**settings, "parameters": f'"{told}"'}
    return Provenance(
        Path(source.name).name,
        source.digest,
        measured.model.name,
        report.experiment,
        report.window,
        f"bgdsl {VERSION}",
        kind=kind,
        settings=tuple(settings.items()),
    )


def condition(measured: Measured, threshold: float, *, guard: bool = True, elements: bool = True, folder: Path | None = None) -> Reduced:
    """Drop every term whose relative activity is below `threshold`, and write the model anew. `folder`: where the file will be.
    elements: may a storage, resistor or source fall, or only what joins junctions?"""
    return reduced(measured, Choice(threshold, guard, elements), folder=folder)


def eliminate_elements(measured: Measured, share: float, *, folder: Path | None = None) -> Reduced:
    """Remove the least active elements while those that stay make up `share` of all activity (MORA, Louca and Stein)."""
    return reduced(measured, Choice(1.0 - share, keep=share), folder=folder)


def reduced(measured: Measured, choice: Choice, *, folder: Path | None = None) -> Reduced:
    """The model written anew without the terms that fall by a choice; the identical text where that was done before."""
    decision = decision_for(measured, choice)
    if reduced_already(measured, choice):
        decision = decision.restricted(frozenset())
    return _written(measured, decision, provenance(measured, choice.settings()), folder)


def reduced_already(measured: Measured, choice: Choice) -> bool:
    """Does the model's annotation say that over this run nothing is left for a choice to drop?"""
    model, report = measured.model, measured.report
    definition = next(item for item in model.library.models() if item.name == model.name)
    return not measured.changed and reduced_before(definition, choice, report.experiment, report.window)


def written(measured: Measured, decision: Decision, *, folder: Path | None = None) -> Reduced:
    """A decision as source, to be tried; its own decision is less what had to be taken back."""
    return _written(measured, decision, provenance(measured, Choice(decision.threshold).settings()), folder)


def decision_for(measured: Measured, choice: Choice) -> Decision:
    """The terms that fall by a choice."""
    scalar, report = measured.model.scalar, measured.report
    if choice.keep is not None:
        return eliminate(scalar, report, choice.keep)

    def among(term: Term) -> bool:
        return (choice.elements or term.other is not None) and term.index not in choice.spared

    return reinstate(scalar, report, decide(scalar, report, choice.threshold, guard=choice.guard, among=among))


def _written(measured: Measured, decision: Decision, head: Provenance, folder: Path | None) -> Reduced:
    """A decision as source that compiles, in the layout of the model's own file."""
    model = measured.model
    edits = new_defaults(model, measured.changed)

    def in_form(form: Literal["auto", "opened"], chosen: Decision) -> tuple[Rewrite, Decision]:
        texts, more = (model.library, model.scalar, measured.report, chosen, head), edits or ()
        return rewrite(*texts, folder=folder, more=more, changed=measured.changed, form=form)

    def write(chosen: Decision) -> Iterator[tuple[Rewrite, Decision]]:
        if edits is None:
            yield in_form("opened", chosen)
            return
        yield (best := in_form("auto", chosen))
        if not best[0].opened:
            with suppress(BgError):  # then what is wrong with the first is told
                yield in_form("opened", chosen)

    written, decision = repaired(model.scalar, measured.report, decision, write, lambda text: fault_of(model, text, folder))
    original = model.library.main.source
    as_formatted = written.opened or tidy(original.text) == original.text
    return Reduced(tidy(written.text) if as_formatted else written.text, measured, decision, written)


def fault_of(model: Model, text: str, folder: Path | None, name: str | None = None) -> str | None:
    """What keeps a reduced text from compiling, None if nothing does. It is compiled as if it stood where it is to go. name: of its
    model, if that is another."""
    own = model.library.main.source
    home = folder if folder is not None else own.path.parent if own.path is not None else None
    path = home / "reduced.bg" if home is not None else None
    try:
        load_source(Source("<reduced>", text, path), name or model.name).check()
    except BgError as error:
        return error.diagnostics[0].message
    return None


def tidy(text: str) -> str:
    """The text in the canonical layout, in which reduced files are written where the model's own file is in it."""
    report = Reporter()
    formatted = format_source(Source("<reduced>", text), report)
    report.stop_if_errors()
    return formatted


def new_defaults(model: Model, changed: Mapping[str, float]) -> tuple[Edit, ...] | None:
    """Edits that write changed parameters as new defaults where the model itself declares them; None where one is a part's."""
    values: dict[str, dict[str, float]] = {}
    for name, value in changed.items():
        values.setdefault(name.partition("[")[0], {})[name] = value
    definition = next(item for item in model.library.models() if item.name == model.name)
    declared = {
        declarator.name: declarator for item in definition.items if isinstance(item, ast.Declaration) for declarator in item.declarators
    }
    parameters = {parameter.name: parameter for parameter in model.graph.parameters}
    if any(name not in declared or len(parameters[name].shape) > 1 for name in values):
        return None
    edits = []
    for name, new in values.items():
        declarator, parameter = declared[name], parameters[name]
        if parameter.shape and set(parameter.scalars()) != set(new):
            return None
        text = ", ".join(number(new[scalar]) for scalar in parameter.scalars())
        text = f"{{{text}}}" if parameter.shape else text
        if declarator.value is not None:
            edits.append(Edit(declarator.value.span, text))
        else:
            end = Span(declarator.span.source, declarator.span.end, declarator.span.end)
            edits.append(Edit(end, f" = {text}"))
    return tuple(edits)


# ----------------------------------------------------------------------------------------------------------- partitions


@dataclass(frozen=True, eq=False)
class Partitioned:
    """files: one a partition, driving ones first; empty where the model does not come apart, and then `found.misses` says how
    far it is from that. document: the text of `partition.json`."""

    found: Partitioning
    files: tuple[Written, ...]
    document: str


def partition(
    measured: Measured,
    threshold: float,
    *,
    conditioned: bool = False,
    guard: bool = True,
    stem: str = "model",
    folder: Path | None = None,
    outputs: Sequence[str] | None = None,
) -> Partitioned:
    """Take the model apart where terms below `threshold` fall: into driving and driven models, one file each.

    Signals that modulate against the driving direction are held where a second run shows that this changes little.
    outputs: variables of interest; a partition that feeds none of them is left out. BG618 for one that the model does not have.
    """
    model, scalar, report = measured.model, measured.model.scalar, measured.report
    found = find_partitions(
        scalar,
        report,
        threshold,
        lambda dropped: dependencies(scalar, dropped),
        lambda needs, ignored: partitions(scalar, needs, ignored),
        conditioned=conditioned,
        guard=guard,
        freezable=holdable(measured, threshold, guard=guard),
    )
    if len(found.partitions.partitions) < 2:
        return Partitioned(found, (), partition_json(scalar, report, found, ()))
    head = provenance(measured, Choice(threshold, guard, inside=conditioned).settings(), "partition")
    wanted = None if outputs is None else partitions_for(scalar, found, _scalars(model, outputs))
    files = tuple(
        replace(written, text=tidy(written.text))
        for written in write_partitions(scalar, report, found, head, stem, folder=folder, changed=measured.changed, wanted=wanted)
    )
    for written in files:
        role = f"{model.name}_{written.partition.number + 1}_{written.partition.role}"
        if (fault := fault_of(model, written.text, folder, role)) is not None:
            refuse(model.graph, f"`{written.file}`: {fault}")
    return Partitioned(found, files, partition_json(scalar, report, found, files))


def _scalars(model: Model, names: Sequence[str]) -> list[str]:
    """The scalar variables that these names stand for. BG618 where there is none."""
    from bgdsl.simulate.columns import find_columns

    columns = find_columns(model.program, names, Reporter())
    return [name for column in columns for name in (column.name, *(leaf.data for leaf in leaves((column.value,))))]


def holdable(measured: Measured, threshold: float, *, guard: bool = True) -> dict[Edge, Frozen]:
    """What holding each modulating signal would change, measured by a second run with shadow states (reduction.md, section 4)."""
    from bgdsl.backends.native.model import build
    from bgdsl.simulate.quadrature import Quadratures
    from bgdsl.simulate.run import simulate

    model, scalar, report = measured.model, measured.model.scalar, measured.report
    dropped = reinstate(scalar, report, decide(scalar, report, threshold, guard=guard)).dropped
    needs: Dependencies = dependencies(scalar, dropped)
    made = freezing.trials(scalar, needs, report, dropped, measured.run.parameters)
    if not made:
        return {}
    program = freezing.with_shadows(model.program, made, grounded)
    integrals = Quadratures(grounded(freezing.integrands(made), program))
    run = simulate(build(program), measured.options(), quadratures=integrals, progress=measured.scenario.progress)
    assert run.trajectory.integrals is not None
    return freezing.frozen(made, run.trajectory.integrals.values.tolist())
