"""Where a run begins: the states at its start, from the parameters and the initial equations.

Input        Program, values of all parameters, inputs and time at the start
Output       the state vector (n,)
Establishes  every start is finite; initial equations hold; starts of dependent storages agree with the states they follow
Reports      BG620 the initial equations cannot be solved, BG621 a start value is no number, BG622 a dependent start disagrees
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from bgdsl.diagnostics import Code, Reporter, listed
from bgdsl.expr import to_text
from bgdsl.ir.program import Program, SolveNewton, Step
from bgdsl.simulate.direct import StepFailureError, Steps, Tape
from bgdsl.simulate.once import once_for_program

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

UNSOLVED = Code("BG620", "the initial equations cannot be solved")
NO_START = Code("BG621", "a start value is no number")
DISAGREES = Code("BG622", "the start of a dependent storage disagrees")

AGREEMENT = 1e-9
"""How far (relative to the larger of 1 and itself) a dependent start may be from the value it must have."""


def initial_state(program: Program, parameters: Mapping[str, float], inputs: Mapping[str, float], time: float, report: Reporter) -> Floats:
    """The states at `time`. BgError where they cannot be found."""
    import numpy as np

    values: dict[str, float] = {**parameters, **inputs}
    if program.initial_steps:
        _solve(program, values, time, report)
    numbers = _starts(program)(values, time)
    for record, number, start, origin in zip(program.states, numbers, program.starts, program.derivative_origins, strict=True):
        if not math.isfinite(number):
            report.add(NO_START, f"`{record.name}` cannot start at {number}: {to_text(start)[:80]}", origin.span, f"`{record.name}`")
    report.stop_if_errors()
    values.update(zip((record.name for record in program.states), numbers, strict=True))
    _check_dependent(program, values, time, report)
    report.stop_if_errors()
    return np.array(numbers, dtype=float)


@once_for_program
def _starts(program: Program) -> Tape:
    return Tape(program.starts, program.tables)


@once_for_program
def _must(program: Program) -> tuple[Sequence[str], Steps, Tape]:
    """The dependent storages with starts: their names, the steps that their values read, and value and start of each in turn."""
    given = [(name, value, start) for name, value, start in program.dependent if start is not None]
    steps = Steps(program.needed([value for _, value, _ in given]), program.tables)
    return [name for name, _, _ in given], steps, Tape([each for _, value, start in given for each in (value, start)], program.tables)


def _solve(program: Program, values: dict[str, float], time: float, report: Reporter) -> None:
    try:
        Steps(program.initial_steps, program.tables)(values, time)
    except StepFailureError as failure:
        step = program.initial_steps[failure.index]
        report.fail(
            UNSOLVED,
            f"the initial values of {_names(step)} cannot be found from the initial equations",
            step.origin.span,
            "here",
            notes=_residual_notes(step, failure.residual),
            helps=("give the states starts near the solution (`start = ...`)",),
        )


def _names(step: Step) -> str:
    names = step.variables if not hasattr(step, "variable") else (step.variable,)
    return listed(names, 4)


def _residual_notes(step: Step, residual: float) -> tuple[str, ...]:
    if not isinstance(step, SolveNewton):
        return ("they are singular",)
    shown = tuple(f"residual: {to_text(expression)[:100]}" for expression in step.residuals[:4])
    return (f"the largest residual left is {residual:.3g}", *shown)


def _check_dependent(program: Program, values: Mapping[str, float], time: float, report: Reporter) -> None:
    """Dependent starts are compared with what the states make of them; steps that those read are carried out first."""
    names, steps, tape = _must(program)
    if not names:
        return
    values = dict(values)
    steps(values, time)
    numbers = iter(tape(values, time))
    for name in names:
        must, start = next(numbers), next(numbers)
        if not abs(start - must) <= AGREEMENT * max(1.0, abs(must)):
            report.add(
                DISAGREES,
                f"`{name}` starts at {start:.9g}, but the states that it depends on make it {must:.9g}",
                program.derivative_origins[0].span,
                "among the states here",
                helps=(f"leave out the start of `{name}`, or give {must:.9g}",),
            )
