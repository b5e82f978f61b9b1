"""Why a run had to stop, said in the model's own terms: the time, the element and its line, the states that moved fastest.

Reports      BG630 not finite, BG631 the step size collapsed, BG632 a block of equations could not be solved,
             BG633 events without end, BG634 an assertion of the model does not hold, BG635 the integrator gave up
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NoReturn

from bgdsl.diagnostics import Code, Diagnostic, Label, RunError
from bgdsl.expr import to_text
from bgdsl.ir.graph import Origin
from bgdsl.ir.native import CompiledModel
from bgdsl.ir.program import Assign, SolveLinear

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


def explain(model: CompiledModel, error: IntegrationError, u: Floats) -> NoReturn:
    """Find out what went wrong at the place where the integrator stopped, and raise it as a `RunError`."""
    import numpy as np

    program = model.program
    slopes = np.full(len(program.states), np.nan)
    status = model.rhs(error.t, error.x, u, slopes) if len(slopes) else 0
    status = status or error.status
    notes = fastest(model, error.x, slopes)
    if status > 0:
        step = program.steps[status - 1]
        if isinstance(step, SolveLinear):
            what, residual = "are singular", ""
        else:
            what, residual = "did not converge", f", residual {model.residual:.3g}" if math.isfinite(model.residual) else ""
        name = step.variable if isinstance(step, Assign) else step.name
        message = f"the equations of {_tick(name)} {what} at t = {error.t:.9g} s{residual}"
        stop(UNSOLVED, message, step.origin, "these equations", error.t, notes)
    bad = np.flatnonzero(~np.isfinite(slopes))
    gone = np.flatnonzero(~np.isfinite(error.x))
    if len(bad) or len(gone):
        i = int(bad[0] if len(bad) else gone[0])
        number = slopes[i] if len(bad) else error.x[i]
        what = f"der({program.states[i].name})" if len(bad) else program.states[i].name
        message = f"`{what}` is {number} at t = {error.t:.9g} s"
        more = (f"{len(bad)} derivatives are not finite there",) if len(bad) > 1 else ()
        value = (f"der({program.states[i].name}) = {_short(to_text(program.derivatives[i]))}",) if len(bad) else ()
        stop(NOT_FINITE, message, program.derivative_origins[i], "of this", error.t, (*value, *more, *notes))
    code = COLLAPSED if error.collapsed else GAVE_UP
    order = _fastest(error.x, slopes)
    i = int(order[0]) if len(order) else 0
    helps = ("a law that jumps, or grows without bound, does this; a stiff model needs `cvode-bdf` or `radau`",) if error.collapsed else ()
    stop(code, f"{error.reason} at t = {error.t:.9g} s", program.derivative_origins[i], "the fastest state", error.t, notes, helps)


def fastest(model: CompiledModel, x: Floats, slopes: Floats, count: int = 3) -> tuple[str, ...]:
    """A note that names the states that change fastest, relative to their size."""
    names = [record.name for record in model.program.states]
    shown = [f"{names[i]} = {x[i]:.4g} (rate {slopes[i]:.3g}/s)" for i in _fastest(x, slopes)[:count]]
    return (f"fastest states: {', '.join(shown)}",) if shown else ()


def _fastest(x: Floats, slopes: Floats) -> list[int]:
    import numpy as np

    with np.errstate(all="ignore"):
        rate = np.abs(slopes) / (np.abs(x) + 1e-6 * (np.abs(x).max(initial=0.0) + 1.0))
    rate = np.where(np.isfinite(rate), rate, np.inf)
    return [int(i) for i in np.argsort(-rate, kind="stable")]


def _tick(name: str) -> str:
    return name if name.startswith("`") or " " in name else f"`{name}`"


def _short(text: str) -> str:
    return text if len(text) <= 100 else text[:100] + " ..."
