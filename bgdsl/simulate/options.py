"""What a run is asked to do, worked out from the model's experiment and the caller's wishes.

Input        Program, the name of an experiment (or None), parameters to change, settings that override the experiment's
Output       Options
Establishes  every parameter has a finite value within its bounds; times, tolerances and method are usable
Reports      BG610 no such experiment, BG611 no such parameter, BG612 a parameter's value cannot be used,
             BG613 a setting of the run cannot be used, BG614 a structural parameter needs compiling again
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from bgdsl.diagnostics import BgError, Code, Reporter, did_you_mean, listed
from bgdsl.expr import Expr, evaluate, leaves
from bgdsl.ir.graph import Experiment, Parameter
from bgdsl.ir.program import Program
from bgdsl.simulate.methods import DEFAULT, METHODS
from bgdsl.simulate.once import once_for_program
from bgdsl.source import said

NO_EXPERIMENT = Code("BG610", "the experiment is not there, or not clear")
NO_PARAMETER = Code("BG611", "no such parameter")
BAD_VALUE = Code("BG612", "a parameter's value cannot be used")
BAD_SETTING = Code("BG613", "a setting of the run cannot be used")
STRUCTURAL = Code("BG614", "a structural parameter cannot change without compiling again")

Value = float | Sequence[Any]
"""A number, or (nested) sequences of numbers for an array parameter."""

DEFAULT_STOP = 1.0
DEFAULT_TOLERANCE = 1e-6
DEFAULT_POINTS = 500
FINEST = 5000
"""A model that functions of time drive takes at least DEFAULT_POINTS steps in a run; the grid may ask for up to this many."""


@dataclass(frozen=True, slots=True)
class Options:
    """A run, settled. Times in seconds. `parameters`: all scalar parameters in order (`ir.native.parameter_names`).

    variables: what to record (None: the outputs). tolerance of the projection onto invariants: `drift`, relative.
    most_steps: a run that takes (some) more is given up. times: of the rows, instead of one every `interval`.
    inputs: a file or arrays by name (with `time`). experiment: "" where none is used. max_step: where the caller says nothing
    (not `step_given`), bounded in models that functions of time drive.
    """

    experiment: str
    start: float
    stop: float
    interval: float
    rtol: float
    atol: float
    method: str
    window: tuple[float, float]
    parameters: Mapping[str, float]
    max_step: float = math.inf
    step_given: bool = False
    variables: tuple[str, ...] | None = None
    inputs: Path | Mapping[str, Any] | None = None
    drift: float = 1e-10
    most_steps: float = math.inf
    times: Sequence[float] | None = None


@dataclass(frozen=True, slots=True)
class Settings:
    """What the caller says beside parameters; None leaves it to the experiment, then to the defaults."""

    start: float | None = None
    stop: float | None = None
    interval: float | None = None
    tolerance: float | None = None
    rtol: float | None = None
    atol: float | None = None
    method: str | None = None
    max_step: float | None = None
    window: tuple[float, float] | None = None
    variables: tuple[str, ...] | None = None
    inputs: Path | Mapping[str, Any] | None = None
    drift: float = 1e-10
    most_steps: float = math.inf
    times: Sequence[float] | None = None


def resolve_options(
    program: Program,
    experiment: str | None = None,
    changes: Mapping[str, Value] | None = None,
    settings: Settings | None = None,
    *,
    report: Reporter,
) -> Options:
    """The options of a run. Without a name the model's only experiment is taken; a model with several needs the name, or a stop time."""
    settings = settings or Settings()
    chosen = _experiment(program, experiment, settings, report)
    parameters = parameter_values(program, chosen, changes or {}, report)
    options = _settled(chosen, settings, parameters)
    _check(options, report)
    report.stop_if_errors()
    if settings.max_step is None and program.is_driven:
        options = replace(options, max_step=_longest_step(options))
    return options


def _longest_step(options: Options) -> float:
    """The recording interval, within limits: an integrator that sees its first steps undisturbed would otherwise grow them beyond
    what drives the model, and step over a pulse, or from zero to zero of a sine."""
    span = options.stop - options.start
    return min(max(options.interval, span / FINEST), span / DEFAULT_POINTS)


def _experiment(program: Program, name: str | None, settings: Settings, report: Reporter) -> Experiment | None:
    known = {experiment.name: experiment for experiment in program.experiments}
    if name is not None:
        if name not in known:
            helps = did_you_mean(name, known) or ((f"it has {listed(known)}",) if known else (f"model `{program.model}` has none",))
            report.fail(NO_EXPERIMENT, f"model `{program.model}` has no experiment `{name}`", said(name), helps=helps)
        return _fitting(known[name], report)
    if len(known) == 1:
        return _fitting(next(iter(known.values())), report)
    if known and settings.stop is None:
        report.fail(
            NO_EXPERIMENT,
            f"model `{program.model}` has several experiments: {listed(known)}",
            next(iter(known.values())).origin.span,
            "the first of them",
            helps=("name one (`--experiment`), or give a stop time (`--stop`) to run the model as it is",),
        )
    return None


def _fitting(experiment: Experiment, report: Reporter) -> Experiment:
    """An experiment, unless it is for another structure of the model."""
    if not experiment.fits:
        report.fail(
            STRUCTURAL,
            f"experiment `{experiment.name}` changes the structure of the model, which has not been compiled for it",
            experiment.origin.span,
            "its changes fit another structure",
            helps=("`bgc simulate` and `simulate()` compile again for it",),
        )
    return experiment


def _settled(chosen: Experiment | None, settings: Settings, parameters: Mapping[str, float]) -> Options:
    def first(*candidates: Any) -> Any:
        return next((candidate for candidate in candidates if candidate is not None), None)

    start = first(settings.start, 0.0)
    stop = first(settings.stop, chosen and chosen.stop_time, start + DEFAULT_STOP)
    tolerance = first(settings.tolerance, chosen and chosen.tolerance, DEFAULT_TOLERANCE)
    window = first(settings.window, chosen and chosen.window)
    if window is None or (settings.window is None and settings.stop is not None and window[1] > stop):
        window = (start, stop)
    return Options(
        experiment=chosen.name if chosen else "",
        start=start,
        stop=stop,
        interval=first(settings.interval, chosen and chosen.interval, (stop - start) / DEFAULT_POINTS),
        rtol=first(settings.rtol, tolerance),
        atol=first(settings.atol, tolerance),
        method=first(settings.method, chosen and chosen.method, DEFAULT),
        window=window,
        parameters=parameters,
        max_step=first(settings.max_step, math.inf),
        step_given=settings.max_step is not None,
        variables=settings.variables,
        inputs=settings.inputs,
        drift=settings.drift,
        most_steps=settings.most_steps,
        times=settings.times,
    )


def _check(options: Options, report: Reporter) -> None:
    def bad(name: str, value: object, why: str, helps: Iterable[str] = ()) -> None:
        report.add(BAD_SETTING, f"{name} {value} cannot be used: {why}", said(f"{name} {value}"), helps=helps)

    if options.method not in METHODS:
        helps = (*did_you_mean(options.method, METHODS), f"there are {listed(METHODS)}")
        bad("method", options.method, "there is no such method", helps)
    if not (math.isfinite(options.start) and math.isfinite(options.stop) and options.stop > options.start):
        bad("stop", options.stop, f"it must be a finite time after the start ({options.start:g} s)")
    elif options.stop - options.start < max(1e-100, 1e-12 * max(abs(options.start), abs(options.stop))):
        bad("stop", options.stop, f"times so close to the start ({options.start:g} s) cannot be told apart")
    elif not 0.0 < options.interval < math.inf:
        bad("interval", options.interval, "it must be a positive time")
    elif (options.stop - options.start) / options.interval > 1e9:
        bad("interval", options.interval, "it would make more than 1e9 rows")
    same = options.rtol == options.atol or options.rtol != options.rtol  # one tolerance for both, not a number perhaps
    for name in ("rtol",) if same else ("rtol", "atol"):
        value = getattr(options, name)
        if not 0.0 < value < 1.0:
            bad("tolerance" if same else name, value, "it must lie between 0 and 1")
        elif name == "rtol" and value < 1e-14:
            bad("tolerance", value, "it is below what double precision resolves")
    if not options.max_step > 0.0:
        bad("max step", options.max_step, "it must be a positive time")
    if options.times is not None and not _covers(options.times, options):
        bad("times", f"({len(options.times)})", f"they must increase from {options.start:g} s to {options.stop:g} s, the run's ends")
    t1, t2 = options.window
    if options.stop > options.start and not options.start <= t1 < t2 <= options.stop * (1 + 1e-12):
        bad("window", f"{t1:g},{t2:g}", f"it must lie within the run, {options.start:g} to {options.stop:g} s, and not be empty")


def _covers(times: Sequence[float], options: Options) -> bool:
    """Whether these times increase from the run's start to its stop."""
    import numpy as np

    slack = 1e-9 * (options.stop - options.start)
    ends = len(times) > 1 and abs(times[0] - options.start) <= slack and abs(times[-1] - options.stop) <= slack
    return ends and bool((np.diff(times) > 0).all())


# ----------------------------------------------------------------------------------------------------------- parameters


def parameter_values(program: Program, chosen: Experiment | None, changes: Mapping[str, Value], report: Reporter) -> dict[str, float]:
    """Every scalar parameter's value: as changed by the caller, else by the experiment, else its default, which may read others."""
    declared = _declared(program)
    owner = declared.owner
    changed = _changed(program, chosen, changes, owner, report)
    report.stop_if_errors()
    affected = declared.affected(changed)
    known = {} if affected is None else {name: value for name, value in declared.values.items() if name not in affected}
    values = evaluated({**declared.formulas, **changed}, known, owner, report)
    report.stop_if_errors()
    _check_structural(program, changed, values, owner, report)
    _check_bounds(program.parameters if affected is None else declared.bounded(affected), values, report)
    report.stop_if_errors()
    return {name: values[name] for name in owner}


@dataclass(frozen=True, slots=True)
class _Declared:
    """A program's scalar parameters as declared: formulas, who owns them, their values (empty where something is wrong with
    these), and by name the scalars that read it and the parameters whose bounds do."""

    formulas: Mapping[str, Expr | float]
    owner: Mapping[str, Parameter]
    values: Mapping[str, float]
    readers: Mapping[str, Sequence[str]]
    bounds: Mapping[str, Sequence[Parameter]]

    def affected(self, changed: Iterable[str]) -> set[str] | None:
        """The scalars whose values may be others than declared when these are changed; None: look at all."""
        if not self.values:
            return None
        found: set[str] = set()
        open_ = list(changed)
        while open_:
            name = open_.pop()
            if name not in found:
                found.add(name)
                open_ += self.readers.get(name, ())
        return found

    def bounded(self, affected: set[str]) -> Iterable[Parameter]:
        """The parameters whose values or bounds may be others than declared."""
        found = {self.owner[name].name: self.owner[name] for name in self.owner if name in affected}
        return (found | {p.name: p for name in affected for p in self.bounds.get(name, ())}).values()


@once_for_program
def _declared(program: Program) -> _Declared:
    formulas: dict[str, Expr | float] = {}
    owner: dict[str, Parameter] = {}
    readers: dict[str, list[str]] = defaultdict(list)
    bounds: dict[str, list[Parameter]] = defaultdict(list)
    for parameter in program.parameters:
        names = parameter.scalars() if parameter.shape else (parameter.name,)
        for name, default in zip(names, parameter.values, strict=True):
            formulas[name] = default.data if default.op == "const" else default
            owner[name] = parameter
            for leaf in leaves((default,), "param"):
                readers[leaf.data].append(name)
        for leaf in leaves((*(parameter.low or ()), *(parameter.high or ())), "param"):
            bounds[leaf.data].append(parameter)
    quiet = Reporter()
    values: Mapping[str, float] = {}
    with suppress(BgError):
        values = evaluated(formulas, {}, owner, quiet)
        _check_bounds(program.parameters, values, quiet)
    return _Declared(formulas, owner, {} if quiet.diagnostics else values, readers, bounds)


def _changed(
    program: Program, chosen: Experiment | None, changes: Mapping[str, Value], owner: Mapping[str, Parameter], report: Reporter
) -> dict[str, Expr | float]:
    changed: dict[str, Expr | float] = dict(chosen.changes) if chosen else {}
    whole = {parameter.name: parameter for parameter in program.parameters}
    for name, value in changes.items():
        if name in owner and owner[name].shape == ():
            found: Mapping[str, Any] = {name: value}
        elif name in whole:
            found = _spread(whole[name], value, report)
        elif name in owner:
            found = {name: value}
        else:
            known = [*whole, *(scalar for scalar in owner if scalar not in whole)]
            report.add(
                NO_PARAMETER,
                f"model `{program.model}` has no parameter `{name}`",
                said(name),
                helps=did_you_mean(name, known) or (f"it has {listed(whole)}" if whole else "it has none",),
            )
            continue
        for scalar, number in found.items():
            changed[scalar] = _number(scalar, number, owner[scalar], report)
    return changed


def _spread(parameter: Parameter, value: Any, report: Reporter) -> dict[str, Any]:
    """An array parameter's value as its scalars; one number fills all."""
    flat: list[Any] = []
    if isinstance(value, int | float | bool) or not hasattr(value, "__iter__"):
        flat = [value] * len(parameter.scalars())
    else:
        stack = [value]
        while stack:
            top = stack.pop()
            if hasattr(top, "__iter__") and not isinstance(top, str):
                stack.extend(reversed(list(top)))
            else:
                flat.append(top)
    if len(flat) != len(parameter.scalars()):
        report.add(
            BAD_VALUE,
            f"`{parameter.name}` takes {len(parameter.scalars())} numbers, not {len(flat)}",
            parameter.origin.span,
            "declared here",
        )
        return {}
    return dict(zip(parameter.scalars(), flat, strict=True))


def _number(name: str, value: Any, parameter: Parameter, report: Reporter) -> float:
    if parameter.constant:
        report.add(BAD_VALUE, f"`{name}` is a constant and cannot be changed", parameter.origin.span, "declared here")
    try:
        return float(value)
    except (TypeError, ValueError):
        report.add(BAD_VALUE, f"`{value}` is no number for `{name}`", parameter.origin.span, "declared here")
        return math.nan


def evaluated(
    formulas: Mapping[str, Expr | float], known: Mapping[str, float], owner: Mapping[str, Parameter], report: Reporter
) -> dict[str, float]:
    """The formulas' values, each after those that it reads, the known ones as they are; a circle among changed ones is reported.
    `owner`: the parameters by scalar name."""
    values = dict(known)
    open_: set[str] = set()
    for root, number in formulas.items():
        if root in values:
            continue
        if isinstance(number, float):
            values[root] = number
            continue
        stack = [root]
        while stack:
            name = stack[-1]
            formula = formulas[name]
            if name in values:
                stack.pop()
                continue
            if isinstance(formula, float):
                values[name] = formula
                continue
            if formula.op == "param" and formula.data in values:
                values[name] = values[formula.data]
                continue
            with suppress(KeyError):  # nearly always all that it reads is known by now
                values[name] = _value(name, formula, values, owner, report)
                continue
            missing = [leaf.data for leaf in leaves((formula,), "param") if leaf.data not in values]
            if missing and name in open_:
                circle = " reads ".join(f"`{other}`" for other in (*missing[:1], name))
                report.fail(BAD_VALUE, f"the value of {circle} and the other way round", owner[name].origin.span, "declared here")
            open_.add(name)
            if missing:
                stack += missing
                continue
            values[name] = _value(name, formula, values, owner, report)
    return values


def _value(name: str, formula: Expr, values: Mapping[str, float], owner: Mapping[str, Parameter], report: Reporter) -> float:
    try:
        return evaluate(formula, values)
    except (ArithmeticError, ValueError) as error:
        report.add(BAD_VALUE, f"`{name}` has no value: {error}", owner[name].origin.span, "declared here")
        return math.nan


def _check_structural(
    program: Program, changed: Mapping[str, Expr | float], values: Mapping[str, float], owner: Mapping[str, Parameter], report: Reporter
) -> None:
    for name in changed:
        parameter = owner[name]
        if not parameter.structural:
            continue
        default = parameter.values[parameter.scalars().index(name)]
        if not (default.is_const and default.data == values[name]):
            report.add(
                STRUCTURAL,
                f"`{name}` shapes the model: it cannot become {values[name]:g} without compiling again",
                parameter.origin.span,
                "decides sizes or conditions",
                helps=("set it when the model is loaded",),
            )


def _check_bounds(parameters: Iterable[Parameter], values: Mapping[str, float], report: Reporter) -> None:
    for parameter in parameters:
        if (
            parameter.low is parameter.high is None
            and not parameter.integer
            and not parameter.shape
            and math.isfinite(values[parameter.name])
        ):
            continue
        for i, name in enumerate(parameter.scalars()):
            value = values[name]
            if not math.isfinite(value):
                report.add(BAD_VALUE, f"`{name}` is {value}, not a finite number", parameter.origin.span, "declared here")
                continue
            if parameter.integer and value != round(value):
                report.add(BAD_VALUE, f"`{name}` is an Integer and cannot be {value:g}", parameter.origin.span, "declared here")
            for bounds, sign, word in ((parameter.low, 1.0, "min"), (parameter.high, -1.0, "max")):
                if bounds is not None:
                    bound = evaluate(bounds[i if len(bounds) > 1 else 0], values)
                    if sign * value < sign * bound:
                        message = f"`{name}` = {value:g} is {'below its min' if word == 'min' else 'above its max'} of {bound:g}"
                        report.add(BAD_VALUE, message, parameter.origin.span, "declared here")


def parameter_array(values: Mapping[str, float]) -> Any:
    """All parameters, in order, as the array that `CompiledModel.set_parameters` takes."""
    import numpy as np

    return np.fromiter(values.values(), float, len(values))
