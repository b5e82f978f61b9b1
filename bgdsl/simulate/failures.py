"""Why a run had to stop, said in the model's own terms: the time, the element and its line, the states that moved fastest.

Reports      BG630 not finite, BG631 the step size collapsed, BG632 a block of equations could not be solved,
             BG633 events without end, BG634 an assertion of the model does not hold, BG635 the integrator gave up,
             BG636 a library for this method is missing
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, NoReturn

from bgdsl.diagnostics import Code, Diagnostic, Label, Reporter, RunError
from bgdsl.expr import Expr, leaves, to_text
from bgdsl.ir.graph import Origin
from bgdsl.ir.native import CompiledModel
from bgdsl.ir.program import Assign, SolveLinear
from bgdsl.simulate.direct import StepFailureError, Steps
from bgdsl.simulate.inputs import InputSignals
from bgdsl.source import said

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

NOT_FINITE = Code("BG630", "a value is not finite")
COLLAPSED = Code("BG631", "the step size collapsed")
UNSOLVED = Code("BG632", "equations could not be solved")
CHATTERING = Code("BG633", "events follow each other without end")
VIOLATED = Code("BG634", "an assertion of the model does not hold")
GAVE_UP = Code("BG635", "the integrator gave up")


MISSING = Code("BG636", "a library for this method is missing")


class IntegrationError(Exception):
    """What an integrator raises: `reason` for people, the time and states it had reached, the model's last status."""

    def __init__(self, reason: str, t: float, x: Floats, status: int = 0, *, collapsed: bool = False):
        super().__init__(reason)
        self.reason = reason
        self.t = t
        self.x = x
        self.status = status
        self.collapsed = collapsed


def stop(
    code: Code, message: str, origin: Origin, label: str, time: float, notes: tuple[str, ...] = (), helps: tuple[str, ...] = ()
) -> NoReturn:
    """Raise the run's error."""
    raise RunError([Diagnostic(code, message, Label(origin.span, label), (), notes, helps)], time)


def missing(message: str, report: Reporter) -> NoReturn:
    """Stop for a library that is not there."""
    where = said("method")
    report.fail(
        MISSING, message, where, helps=("install it (`pip install scikit-sundae`), or take `lsoda`, `radau`, `rk45` or `vode-adams`",)
    )


def explain(model: CompiledModel, error: IntegrationError, inputs: InputSignals, parameters: Mapping[str, float]) -> RunError:
    """What went wrong at the place where the integrator stopped, or just beyond it."""
    try:
        _explain(model, error, inputs, parameters)
    except RunError as found:
        return found


def _explain(model: CompiledModel, error: IntegrationError, inputs: InputSignals, parameters: Mapping[str, float]) -> NoReturn:
    import numpy as np

    slopes = np.full(len(model.program.states), np.nan)
    status = model.rhs(error.t, error.x, inputs(error.t), slopes) if len(slopes) else 0
    notes = fastest(model, error.x, slopes)
    _unsolved(model, status or error.status, error.t, notes)
    _not_finite(model, error.t, error.x, slopes, inputs, parameters, notes)
    if error.collapsed:
        step = 1e-6 * max(abs(error.t), 1e-3)
        with np.errstate(all="ignore"):
            beyond = error.x + step * slopes
        ahead = np.full(len(slopes), np.nan)
        status = model.rhs(error.t + step, beyond, inputs(error.t + step), ahead)
        _unsolved(model, status, error.t + step, notes)
        _not_finite(model, error.t + step, beyond, ahead, inputs, parameters, notes)
    code = COLLAPSED if error.collapsed else GAVE_UP
    order = _fastest(error.x, slopes)
    i = int(order[0]) if len(order) else 0
    helps = ("a law that jumps, or grows without bound, does this; a stiff model needs `cvode-bdf` or `radau`",) if error.collapsed else ()
    stop(code, f"{error.reason} at t = {error.t:.9g} s", model.program.derivative_origins[i], "the fastest state", error.t, notes, helps)


def _unsolved(model: CompiledModel, status: int, t: float, notes: tuple[str, ...]) -> None:
    """Stop for a failed step of the program, if the status names one."""
    if status <= 0:
        return
    step = model.program.steps[status - 1]
    if isinstance(step, SolveLinear):
        what, residual = "are singular", ""
    else:
        what, residual = "did not converge", f", residual {model.residual:.3g}" if math.isfinite(model.residual) else ""
    name = step.variable if isinstance(step, Assign) else step.name
    stop(UNSOLVED, f"the equations of {_tick(name)} {what} at t = {t:.9g} s{residual}", step.origin, "these equations", t, notes)


def _not_finite(
    model: CompiledModel,
    t: float,
    x: Floats,
    slopes: Floats,
    inputs: InputSignals,
    parameters: Mapping[str, float],
    notes: tuple[str, ...],
) -> None:
    """Stop if a state or a derivative is not finite: at the first variable, in the order of evaluation, that is not."""
    import numpy as np

    program = model.program
    gone = np.flatnonzero(~np.isfinite(x))
    if len(gone):
        i = int(gone[0])
        stop(NOT_FINITE, f"`{program.states[i].name}` is {x[i]} at t = {t:.9g} s", program.derivative_origins[i], "not finite", t, notes)
    bad = np.flatnonzero(~np.isfinite(slopes))
    if not len(bad):
        return
    more = (f"{len(bad)} derivatives are not finite there",) if len(bad) > 1 else ()
    values = {**parameters, **dict(zip((r.name for r in program.states), x.tolist(), strict=True))}
    values.update(zip((r.name for r in program.inputs), inputs(t).tolist(), strict=True))
    for step in program.needed([program.derivatives[i] for i in bad]):
        try:
            Steps((step,), program.tables)(values, t)
        except StepFailureError:
            break
        if isinstance(step, Assign) and not math.isfinite(values[step.variable]):
            law = (f"{step.variable} = {_short(to_text(step.value))}", _operands(step.value, values))
            message = f"`{step.variable}` is {values[step.variable]} at t = {t:.9g} s"
            stop(NOT_FINITE, message, step.origin, "not finite", t, (*law, *more, *notes))
    i = int(bad[0])
    name = program.states[i].name
    message = f"`der({name})` is {slopes[i]} at t = {t:.9g} s"
    stop(
        NOT_FINITE,
        message,
        program.derivative_origins[i],
        "not finite",
        t,
        (f"der({name}) = {_short(to_text(program.derivatives[i]))}", *more, *notes),
    )


def _operands(value: Expr, values: Mapping[str, float]) -> str:
    """`with a = 1, b = 2`: what the expression reads."""
    names = sorted({leaf.data for op in ("var", "param") for leaf in leaves((value,), op)})
    return "with " + ", ".join(f"{name} = {values[name]:.6g}" for name in names[:6])


def fastest(model: CompiledModel, x: Floats, slopes: Floats, count: int = 3) -> tuple[str, ...]:
    """A note that names the states that change fastest, relative to their size."""
    import numpy as np

    names = [record.name for record in model.program.states]
    if not np.isfinite(slopes).any():
        return ()
    shown = [f"{names[i]} = {x[i]:.4g} (rate {slopes[i]:.3g}/s)" for i in _fastest(x, slopes)[:count]]
    return (f"fastest states: {', '.join(shown)}",) if shown else ()


def _fastest(x: Floats, slopes: Floats) -> list[int]:
    import numpy as np

    with np.errstate(all="ignore"):
        rate = np.abs(slopes) / (np.abs(x) + 1e-6 * (np.abs(x).max(initial=0.0) + 1.0))
    rate = np.where(np.isfinite(rate), rate, -1.0)
    return [int(i) for i in np.argsort(-rate, kind="stable")]


def _tick(name: str) -> str:
    return name if name.startswith("`") or " " in name else f"`{name}`"


def _short(text: str) -> str:
    return text if len(text) <= 100 else text[:100] + " ..."
