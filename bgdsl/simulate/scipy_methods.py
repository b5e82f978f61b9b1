"""The integrators of SciPy as steppers: RK45, Radau and LSODA of `solve_ivp`, and VODE's Adams method."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from bgdsl.ir.native import CompiledModel
from bgdsl.simulate.inputs import InputSignals
from bgdsl.simulate.methods import Method
from bgdsl.simulate.options import Options
from bgdsl.simulate.stepper import Counters, Slopes, SparseJacobian

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

MANY_STATES = 60
"""From here on Radau factorises a sparse matrix."""


class ScipyStepper:
    """A solver class of `scipy.integrate` taken step by step."""

    def __init__(self, model: CompiledModel, method: Method, options: Options, inputs: InputSignals, t: float, x: Floats):
        self._slopes = Slopes(model, inputs)
        self._jacobian = SparseJacobian(model, inputs) if method.jacobian else None
        self._method, self._options = method, options
        self.counters = Counters()
        self._lu_before = 0
        self._sparse = method.key == "Radau" and len(x) > MANY_STATES
        self.restart(t, x)

    def restart(self, t: float, x: Floats) -> None:
        from scipy import integrate

        more: dict[str, Any] = {}
        if self._jacobian is not None:
            more["jac"] = self._jacobian.sparse if self._sparse else self._jacobian.dense
        self._lu_before = self.counters.factorisations
        self._solver = getattr(integrate, self._method.key)(
            self._slopes,
            t,
            x.copy(),
            self._options.stop,
            rtol=self._options.rtol,
            atol=self._options.atol,
            max_step=self._options.max_step,
            **more,
        )
        self.t = self.t_old = t
        self.x = x.copy()
        self._dense: Any = None

    def step(self) -> None:
        import numpy as np

        solver = self._solver
        if not np.isfinite(getattr(solver, "h_abs", 0.0)):  # it would try for ever to find a step that is small enough
            raise self._slopes.failure("the derivatives are not finite", self.t, self.x)
        try:
            with np.errstate(all="ignore"):  # what is not finite is told below
                message = solver.step()
        except ValueError as error:  # a Jacobian that is not finite
            raise self._slopes.failure(str(error), self.t, self.x) from error
        counters = self.counters
        counters.rhs = self._slopes.calls
        counters.jacobian = self._jacobian.calls if self._jacobian else 0
        counters.factorisations = self._lu_before + int(getattr(solver, "nlu", 0) or 0)
        if solver.status == "failed" or not _finite(solver.y):
            collapsed = solver.status == "failed"
            raise self._slopes.failure(
                "the step size fell below what the time resolves" if collapsed else str(message), self.t, self.x, collapsed=collapsed
            )
        counters.steps += 1
        self.t_old, self.t = float(solver.t_old), float(solver.t)
        self.x = solver.y.copy()
        self._dense = None

    def move(self, x: Floats) -> None:
        solver = self._solver
        if self._method.key == "LSODA":
            inner = solver._lsoda_solver
            inner._integrator.rwork[20 : 20 + len(x)] += x - self.x
            inner._y = x.copy()
        elif self._method.key == "RK45":
            solver.f = self._slopes(self.t, x)
        self.x = x
        solver.y = x.copy()

    def dense(self, times: Floats) -> Floats:
        if self._dense is None:
            self._dense = self._solver.dense_output()
        values: Floats = self._dense(times).T
        return values


class VodeStepper:
    """VODE (variable-coefficient Adams-Moulton, functional iteration), step by step; inside a step its own polynomial is read."""

    def __init__(self, model: CompiledModel, method: Method, options: Options, inputs: InputSignals, t: float, x: Floats):
        self._slopes = Slopes(model, inputs)
        self._options = options
        self.counters = Counters()
        self.restart(t, x)

    def restart(self, t: float, x: Floats) -> None:
        from scipy.integrate import ode

        options = self._options
        max_step = options.max_step if options.max_step < options.stop - options.start else 0.0
        solver = ode(self._slopes).set_integrator(
            "vode", method="adams", rtol=options.rtol, atol=options.atol, max_step=max_step, nsteps=2_000_000_000
        )
        solver.set_initial_value(x.copy(), t)
        self._integrator = solver._integrator
        self._integrator.rwork[0] = options.stop
        self._integrator.call_args[2] = 5  # one step at a time, never past rwork[0]
        self.t = self.t_old = t
        self.x = x.copy()

    def step(self) -> None:
        import warnings

        integrator = self._integrator
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            x, t = integrator.run(self._slopes, None, self.x, self.t, self._options.stop, (), ())
        self.counters.rhs = self._slopes.calls
        if not integrator.success or not _finite(x):
            reason = integrator.messages.get(integrator.istate, "VODE stopped").rstrip(".")
            collapsed = integrator.istate in (-4, -5)
            raise self._slopes.failure("the step size collapsed" if collapsed else reason, self.t, self.x, collapsed=collapsed)
        if t <= self.t:
            raise self._slopes.failure("the step size fell below what the time resolves", self.t, self.x, collapsed=True)
        self.counters.steps += 1
        self.t_old, self.t = self.t, float(t)
        self.x = x.copy()

    def move(self, x: Floats) -> None:
        self._integrator.rwork[20 : 20 + len(x)] += x - self.x
        self.x = x

    def dense(self, times: Floats) -> Floats:
        """VODE's Nordsieck array, scaled by the last step's size: columns h^j x^(j) / j!."""
        import numpy as np

        rwork, iwork = self._integrator.rwork, self._integrator.iwork
        order, size, reached = int(iwork[13]), float(rwork[10]), float(rwork[12])
        n = len(self.x)
        history = rwork[20 : 20 + n * (order + 1)].reshape(order + 1, n)
        powers = ((times - reached) / size)[:, None] ** np.arange(order + 1)
        values: Floats = powers @ history
        return values


def _finite(x: Floats) -> bool:
    import numpy as np

    return bool(np.isfinite(x).all())
