"""The run itself, between two returns to Python: steps of CVODE, rows at the grid, integrals over each step."""

# mypy: ignore-errors
# (kernels are not Python: `kernels/compiler.py` gives their names a meaning)
from __future__ import annotations

from bgdsl.simulate.kernels.compiler import kernel
from bgdsl.simulate.kernels.kinds import Callee, Struct, places, real, reals, whole
from bgdsl.simulate.kernels.link import Link, call_model, set_inputs
from bgdsl.simulate.kernels.project import Projection, project, project_step
from bgdsl.simulate.kernels.sums import Sums, absorb

__all__ = ["Link", "Loop", "Projection", "Sums", "whole"]

Loop = Struct(
    "Loop",
    """Link link, place advance, place interpolate, place memory, places y, places scratch, reals clock,
    real t_old, real stop, whole steps, whole budget, whole flag, whole pending,
    whole row_next, whole row_count, real row_start, real row_interval, reals row_at, whole row_fill, whole row_capacity,
    reals row_times, reals rows, whole columns, place row_kernel, whole keep, reals states,
    Sums sums, real window_start, real window_stop, place integrands, whole parts, Projection projection""",
)
"""row_at: the rows' times, if these are given (else null). clock: the current time, one number. y, scratch: N_Vectors. pending: a
step is taken but not yet looked at. parts: into how many equal parts a step is divided by the nodes of the integrals, adapted to what
they need."""

call_cvode = Callee("int", ("place", "real", "place", "reals", "int"))
call_dky = Callee("int", ("place", "real", "int", "place"))

DONE = 1
ROOT = 2
FULL = 3
BROKEN = 4
DRIFTED = 5
COARSE = 1e-4
FINE = 1e-6
MOST_PARTS = 64
"""A step is divided further for the integrals when the estimated share of error rises above COARSE, less below FINE."""


@kernel
def dense_state(loop: Loop, t: real) -> int:
    """Put the states at t, inside the last step, into the scratch vector, and the inputs in place."""
    status = call_dky(loop.interpolate, loop.memory, t, 0, loop.scratch)
    set_inputs(loop.link, t)
    return status


@kernel
def record(loop: Loop) -> int:
    """The rows up to the current time. 0, FULL or BROKEN."""
    link = loop.link
    x = reals(places(loop.scratch[0])[1])
    while loop.row_next < loop.row_count:
        t = loop.stop
        if loop.row_at:
            t = loop.row_at[loop.row_next]
        elif loop.row_next < loop.row_count - 1:
            t = loop.row_start + loop.row_next * loop.row_interval
        if t > loop.clock[0]:
            return 0
        if loop.row_fill == loop.row_capacity:
            return FULL
        if dense_state(loop, t) != 0:
            return BROKEN
        if loop.projection and t < loop.clock[0]:
            project(loop.projection, t, x)
        k = loop.row_fill
        loop.row_times[k] = t
        link.status = call_model(loop.row_kernel, t, x, link.u, loop.rows + k * loop.columns, link.context)
        if link.status != 0:
            return BROKEN
        if loop.keep != 0:
            for i in range(link.n):
                loop.states[k * link.n + i] = x[i]
        loop.row_fill = k + 1
        loop.row_next += 1
    return 0


@kernel
def node(loop: Loop, t: real) -> int:
    """Evaluate the integrands at t and take them in. 0 or BROKEN."""
    link = loop.link
    sums = loop.sums
    x = reals(places(loop.y[0])[1])
    if t == loop.clock[0]:
        set_inputs(link, t)
    else:
        if dense_state(loop, t) != 0:
            return BROKEN
        x = reals(places(loop.scratch[0])[1])
    link.status = call_model(loop.integrands, t, x, link.u, sums.v3, link.context)
    if link.status != 0:
        return BROKEN
    absorb(sums, t)
    return 0


@kernel
def integrate(loop: Loop) -> int:
    """The last step's share of the integrals. 0 or BROKEN."""
    a = loop.t_old if loop.t_old > loop.window_start else loop.window_start
    b = loop.clock[0] if loop.clock[0] < loop.window_stop else loop.window_stop
    if b <= a:
        return 0
    sums = loop.sums
    sums.step_size = 0.0
    sums.step_error = 0.0
    parts = loop.parts
    if sums.known == 0:
        parts = 3 if parts < 3 else parts
        if node(loop, a) != 0:
            return BROKEN
    for k in range(1, parts + 1):
        t = b
        if k < parts:
            t = a + (b - a) * k / parts
        if node(loop, t) != 0:
            return BROKEN
    if sums.step_error > COARSE * sums.step_size:
        loop.parts = parts * 2 if parts * 2 <= MOST_PARTS else MOST_PARTS
    elif sums.step_error < FINE * sums.step_size and loop.parts > 1:
        loop.parts = loop.parts // 2
    return 0


@kernel
def travel(loop: Loop) -> int:
    """Go on until something is up: 0 the budget of steps is used, DONE, ROOT, FULL, BROKEN, DRIFTED; negative: what CVODE said."""
    while True:
        if loop.pending == 0:
            if loop.clock[0] >= loop.stop:
                return DONE
            if loop.budget == 0:
                return 0
            loop.budget -= 1
            loop.t_old = loop.clock[0]
            loop.flag = call_cvode(loop.advance, loop.memory, loop.stop, loop.y, loop.clock, 2)
            if loop.flag < 0:
                return loop.flag
            loop.steps += 1
            if loop.projection and project_step(loop.projection, loop.clock[0], reals(places(loop.y[0])[1])) != 0:
                return DRIFTED
            loop.pending = 1
        stopped = record(loop)
        if stopped != 0:
            return stopped
        if loop.sums and integrate(loop) != 0:
            return BROKEN
        loop.pending = 0
        if loop.flag == ROOT:
            return ROOT
    return 0
