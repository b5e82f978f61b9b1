"""CVODE at work on a model without Python in between: its callbacks are kernels that call the model's machine code.

`CvodeStepper` is a stepper like the others (one step at a time); `travel` hands the whole loop over steps, rows and integrals to
the kernel of `kernels/loop.py`, which comes back for events, full buffers and trouble only.
"""

from __future__ import annotations

import ctypes
from typing import TYPE_CHECKING

from bgdsl.ir.native import CompiledModel, Kernel
from bgdsl.simulate import sundials
from bgdsl.simulate.addresses import Addresses, array_at
from bgdsl.simulate.failures import IntegrationError
from bgdsl.simulate.inputs import InputSignals
from bgdsl.simulate.kernels.compiler import KERNELS
from bgdsl.simulate.kernels.loop import BROKEN, DONE, DRIFTED, FULL, ROOT, Loop
from bgdsl.simulate.methods import Method
from bgdsl.simulate.options import Options
from bgdsl.simulate.projection import Invariants
from bgdsl.simulate.quadrature import Quadrature
from bgdsl.simulate.recorder import Recorder
from bgdsl.simulate.sparse import SparseLU
from bgdsl.simulate.stepper import Counters

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

MOST_REPIVOTINGS = 20
MARK = 0.7123456789012345e-77
"""A number that fills the states while CVODE sets up, to be recognised."""
BUDGET = 2000
"""Steps between two looks at the keyboard and the progress bar."""


class CvodeStepper:
    """CVODE, backward differences with a sparse direct solver or Adams by functional iteration."""

    def __init__(
        self, model: CompiledModel, method: Method, options: Options, inputs: InputSignals, t: float, x: Floats, events: Kernel | None
    ):
        import numpy as np

        self._library = sundials.libraries()
        self._model, self._method, self._options = model, method, options
        self.counters = Counters()
        self.addresses = Addresses(model)
        self._repivotings = 0
        n = len(x)
        self._state = np.array(x, dtype=float)
        self._dense_state = np.zeros(n)
        self.clock = np.array([t])
        self.t_old = t
        self.link = self.addresses.link(inputs)
        if events is not None:
            self.link.events = self.addresses.call(events)
        if method.jacobian:
            self.link.jacobian = self.addresses.call(model.jacobian)
            self.link.entries = self.addresses.keep(np.zeros(max(1, model.jacobian.size)))
            self._lu = SparseLU(*model.pattern)
            self.link.factors = self._lu.address
        lib = self._library
        self.y = lib.N_VMake_Serial(n, self._state.ctypes.data, lib.context)
        self.scratch = lib.N_VMake_Serial(n, self._dense_state.ctypes.data, lib.context)
        self._solver: int | None = None
        self._matrix: int | None = None
        self._fixed_point: int | None = None
        self.memory = self._make_memory(0 if events is None else events.size)

    def _make_memory(self, roots: int) -> int:
        lib, options = self._library, self._options
        memory: int = lib.CVodeCreate(sundials.BDF if self._method.key == "bdf" else sundials.ADAMS, lib.context)
        self.history = self._initialise(memory)
        lib.check(lib.CVodeSStolerances(memory, options.rtol, options.atol), "CVodeSStolerances")
        lib.check(lib.CVodeSetUserData(memory, ctypes.addressof(self.link)), "CVodeSetUserData")
        lib.check(lib.CVodeSetMaxOrd(memory, self._method.order), "CVodeSetMaxOrd")
        lib.check(lib.CVodeSetMaxHnilWarns(memory, -1), "CVodeSetMaxHnilWarns")
        lib.check(lib.CVodeSetMaxErrTestFails(memory, 20), "CVodeSetMaxErrTestFails")
        lib.check(lib.CVodeSetMaxConvFails(memory, 40), "CVodeSetMaxConvFails")
        if options.max_step < options.stop - options.start:
            lib.check(lib.CVodeSetMaxStep(memory, options.max_step), "CVodeSetMaxStep")
        lib.check(lib.CVodeSetStopTime(memory, options.stop), "CVodeSetStopTime")
        if self._method.jacobian:
            self._attach_solver(memory)
        else:
            self._fixed_point = lib.SUNNonlinSol_FixedPoint(self.y, 0, lib.context)
            lib.check(lib.CVodeSetNonlinearSolver(memory, self._fixed_point), "CVodeSetNonlinearSolver")
        if roots:
            lib.check(lib.CVodeRootInit(memory, roots, KERNELS.address("cv_root")), "CVodeRootInit")
            lib.check(lib.CVodeSetNoInactiveRootWarn(memory), "CVodeSetNoInactiveRootWarn")
        return memory

    def _initialise(self, memory: int) -> int:
        """CVodeInit; the address of the states in CVODE's own history, the one clone of y that it fills with y.

        Projections have to move that as well, and CVODE has no call for it. So its cloning of vectors is watched while it sets up.
        """
        lib = self._library
        start = self._state.copy()
        self._state[:] = MARK
        table = sundials.words(sundials.words(self.y)[1])
        slot = next(k for k in range(20) if table[k] == lib.address("N_VClone_Serial"))
        clones: list[int] = []

        def clone(vector: int) -> int | None:
            made: int | None = lib.N_VClone_Serial(vector)
            if made:
                clones.append(made)
            return made

        watcher = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_void_p)(clone)
        table[slot] = ctypes.cast(watcher, ctypes.c_void_p).value
        flag = lib.CVodeInit(memory, KERNELS.address("cv_rhs"), float(self.clock[0]), self.y)
        for vector in (self.y, *clones):
            sundials.words(sundials.words(vector)[1])[slot] = lib.address("N_VClone_Serial")
        lib.check(flag, "CVodeInit")
        data = [lib.N_VGetArrayPointer(vector) for vector in clones]
        n = len(self._state)
        found = [place for place in data if (array_at(place, n) == MARK).all()]
        self._state[:] = start
        lib.check(lib.CVodeReInit(memory, float(self.clock[0]), self.y), "CVodeReInit")
        if len(found) != 1 or not (array_at(found[0], n) == start).all():
            raise OSError("CVODE's history of the states is not where it was expected")
        return int(found[0])

    def _attach_solver(self, memory: int) -> None:
        """A linear solver and a matrix of our own: empty shells whose operations are kernels."""
        lib = self._library
        self._solver = solver = lib.SUNLinSolNewEmpty(lib.context)
        sundials.words(solver)[0] = ctypes.addressof(self.link)
        for name, kernel in (("GetType", "ls_kind"), ("Setup", "ls_setup"), ("Solve", "ls_solve")):
            lib.set_operation(solver, name, KERNELS.address(kernel))
        self._matrix = matrix = lib.SUNMatNewEmpty(lib.context)
        lib.set_operation(matrix, "GetID", KERNELS.address("matrix_kind"))
        lib.check(lib.CVodeSetLinearSolver(memory, solver, matrix), "CVodeSetLinearSolver")
        lib.check(lib.CVodeSetLinSysFn(memory, KERNELS.address("cv_linsys")), "CVodeSetLinSysFn")
        if self._model.program.has_upright_roots:
            # with an old Jacobian from beside zero, far too steep, corrections come out small, and pass for convergence
            lib.check(lib.CVodeSetLSetupFrequency(memory, 1), "CVodeSetLSetupFrequency")
            lib.check(lib.CVodeSetJacEvalFrequency(memory, 1), "CVodeSetJacEvalFrequency")

    def close(self) -> None:
        """Free what CVODE holds."""
        lib = self._library
        if self.memory:
            lib.CVodeFree(ctypes.byref(ctypes.c_void_p(self.memory)))
            self.memory = 0
            if self._fixed_point is not None:
                lib.SUNNonlinSolFree(self._fixed_point)
            if self._solver is not None:
                lib.SUNLinSolFreeEmpty(self._solver)
                lib.SUNMatFreeEmpty(self._matrix)
            lib.N_VDestroy(self.y)
            lib.N_VDestroy(self.scratch)

    # a stepper

    @property
    def t(self) -> float:
        """The current time."""
        return float(self.clock[0])

    @property
    def x(self) -> Floats:
        """The current states (CVODE's own array)."""
        return self._state

    def dense(self, times: Floats) -> Floats:
        import numpy as np

        values: Floats = np.empty((len(times), len(self._state)))
        for t, row in zip(times.tolist(), values, strict=True):
            self._library.CVodeGetDky(self.memory, t, 0, self.scratch)
            row[:] = self._dense_state
        return values

    def restart(self, t: float, x: Floats) -> None:
        self._count()
        self._state[:] = x
        self.clock[0] = self.t_old = t
        self._library.check(self._library.CVodeReInit(self.memory, t, self.y), "CVodeReInit")

    def _count(self) -> None:
        """Take over what CVODE has counted since its last start."""
        number = ctypes.c_long()
        for read in (self._library.CVodeGetNumErrTestFails, self._library.CVodeGetNumNonlinSolvConvFails):
            read(self.memory, ctypes.byref(number))
            self.counters.rejected += number.value

    def finish(self) -> Counters:
        """The final counts."""
        self._count()
        self.counters.rhs = self.link.rhs_calls
        self.counters.jacobian = self.link.jacobian_calls
        self.counters.factorisations = self.link.factorisations
        return self.counters

    def roots(self, count: int) -> list[int]:
        """The root functions that changed sign at the root just returned: k rising, ~k falling."""
        found = (ctypes.c_int * count)()
        self._library.CVodeGetRootInfo(self.memory, found)
        return [k if sign > 0 else ~k for k, sign in enumerate(found) if sign]

    def recover(self, flag: int) -> None:
        """Deal with a step that could not be taken: a new pivot order if that was it; IntegrationError otherwise."""
        link = self.link
        if link.repivot and self._repivotings < MOST_REPIVOTINGS:
            self._repivotings += 1
            link.repivot = 0
            self._pivot_anew()
            self._library.CVodeGetDky(self.memory, self.t, 0, self.y)
            self.restart(self.t, self._state.copy())
            return
        reason = sundials.FLAGS.get(flag, f"CVODE says {flag}")
        if link.troubled:
            x = array_at(link.trouble_state, link.n).copy()
            raise IntegrationError(reason, link.trouble_time, x, link.status)
        raise IntegrationError(reason, self.t, self._state.copy(), collapsed=flag in sundials.COLLAPSED)

    def _pivot_anew(self) -> None:
        link = self.link
        values = array_at(link.entries, self._model.jacobian.size)
        try:
            self._lu = SparseLU(*self._model.pattern, (values.copy(), link.gamma))
        except RuntimeError as error:  # singular even with pivoting
            raise IntegrationError("the iteration matrix is singular", self.t, self._state.copy(), collapsed=True) from error
        link.factors = self._lu.address


class CvodeLoop:
    """The kernel loop around a `CvodeStepper`, tied to the arrays of a recorder and a quadrature."""

    def __init__(
        self, stepper: CvodeStepper, options: Options, recorder: Recorder, quadrature: Quadrature | None, invariants: Invariants | None
    ):
        self.stepper, self._recorder, self._invariants = stepper, recorder, invariants
        lib = sundials.libraries()
        loop = self.record = Loop()
        keep = stepper.addresses.keep
        loop.link = ctypes.addressof(stepper.link)
        loop.advance, loop.interpolate = lib.address("CVode"), lib.address("CVodeGetDky")
        loop.memory, loop.y, loop.scratch = stepper.memory, stepper.y, stepper.scratch
        loop.clock, loop.stop = keep(stepper.clock), options.stop
        grid = recorder.grid
        loop.row_count, loop.row_start, loop.row_interval = grid.count, grid.start, grid.interval
        loop.row_at = None if grid.given is None else keep(grid.given)
        loop.row_capacity, loop.columns = recorder.capacity, recorder.rows.shape[1]
        loop.row_times, loop.rows, loop.states = keep(recorder.times), keep(recorder.rows), keep(recorder.state_rows)
        loop.keep = len(recorder.state_rows) > 0
        loop.row_kernel = stepper.addresses.call(recorder.kernel)
        if quadrature is not None:
            loop.sums, loop.parts = ctypes.addressof(quadrature.record), quadrature.parts
            loop.window_start, loop.window_stop = quadrature.window
            loop.integrands = stepper.addresses.call(quadrature.kernel)
        if invariants is not None:
            loop.projection = ctypes.addressof(invariants.record)
            invariants.record.history = stepper.history
        self._travel = KERNELS.function("travel")

    def go(self) -> str:
        """Go on until something is up: "budget", "done", "root". Full buffers and new pivot orders are dealt with here."""
        loop, recorder, stepper = self.record, self._recorder, self.stepper
        loop.budget = BUDGET
        while True:
            loop.row_next, loop.row_fill = recorder.next, recorder.fill
            status = self._travel(ctypes.addressof(loop))
            recorder.next, recorder.fill = loop.row_next, loop.row_fill
            stepper.counters.steps, stepper.t_old = loop.steps, loop.t_old
            match status:
                case 0:
                    return "budget"
                case s if s == DONE:
                    return "done"
                case s if s == ROOT:
                    return "root"
                case s if s == FULL:
                    recorder.flush()
                case s if s == DRIFTED:
                    assert self._invariants is not None
                    raise self._invariants.failure(stepper.t, stepper.x)
                case s if s == BROKEN:
                    raise IntegrationError("what is recorded cannot be evaluated", stepper.t, stepper.x.copy(), stepper.link.status)
                case _:
                    stepper.recover(status)
