"""A run: a compiled model and options in, a trajectory out.

Input        CompiledModel, Options
Output       Run (a Trajectory and the means to evaluate more of it)
Establishes  rows at every time of the grid; integrals over the window; events located; invariants kept; statistics of the cost
Reports      run errors (`failures.py`), with the time, the element and its line
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from bgdsl.diagnostics import Reporter, RunError
from bgdsl.ir.native import CompiledModel
from bgdsl.ir.trajectory import Statistics, Status, Trajectory
from bgdsl.simulate.columns import find_columns, output_columns
from bgdsl.simulate.cvode import CvodeLoop, CvodeStepper
from bgdsl.simulate.events import Watch
from bgdsl.simulate.failures import IntegrationError, explain, missing
from bgdsl.simulate.initial import initial_state
from bgdsl.simulate.inputs import InputSignals, input_signals
from bgdsl.simulate.methods import METHODS, Method
from bgdsl.simulate.options import Options, parameter_array
from bgdsl.simulate.projection import Invariants
from bgdsl.simulate.quadrature import Quadrature, Quadratures
from bgdsl.simulate.recorder import Grid, Recorder
from bgdsl.simulate.recording import MemorySink, Sink, cannot_write, open_sink
from bgdsl.simulate.result import Run
from bgdsl.simulate.scipy_methods import ScipyStepper, VodeStepper
from bgdsl.simulate.stepper import Counters, LastStep, Stepper
from bgdsl.simulate.sundials import libraries

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

KEPT_STATES = 50_000_000
"""In memory the states are kept at the grid up to so many numbers, so that any variable can be looked at afterwards."""

Progress = Callable[[float], None]


def simulate(
    model: CompiledModel,
    options: Options,
    *,
    quadratures: Quadratures | None = None,
    output: Path | None = None,
    force: bool = False,
    start: Floats | None = None,
    progress: Progress | None = None,
    report: Reporter | None = None,
) -> Run:
    """Run the model. With `output` the rows go to that file, else they stay in memory (with the states). `start` replaces
    the model's own initial states. BgError before the run, RunError within it; on an interrupt the file is closed as partial."""
    report = report or Reporter()
    began = clock.perf_counter()
    program = model.program
    columns = output_columns(program) if options.variables is None else find_columns(program, options.variables, report)
    inputs = input_signals([record.name for record in program.inputs], options.inputs, options.start, options.stop, report)
    options = replace(options, max_step=min(options.max_step, inputs.spacing))  # not over a pulse that a recording holds
    model.set_parameters(parameter_array(program, options.parameters))
    u0 = dict(zip((record.name for record in program.inputs), inputs(options.start).tolist(), strict=True))
    x0 = start if start is not None else initial_state(program, options.parameters, u0, options.start, report)
    grid = Grid(options.start, options.stop, options.interval)
    keep = output is None and grid.count * max(1, len(program.states)) <= KEPT_STATES
    memory, states = MemorySink(len(columns)), MemorySink(len(program.states))
    recorder = Recorder(model, columns, memory, states if keep else None, grid, inputs)
    quadrature = None if quadratures is None else Quadrature(model, quadratures.expressions, quadratures.window or options.window, inputs)
    journey = Journey(model, options, inputs, recorder, quadrature, progress, report)
    sink: Sink = memory
    if output is not None:
        sink = recorder.sink = open_sink(output, columns, program.model, program.digest, force=force, report=report)
    status = _carry_out(journey, x0, recorder, sink, output, lambda error: explain(model, error, inputs, options.parameters), report)
    times, values = memory.rows()
    trajectory = Trajectory(
        model=program.model,
        experiment=options.experiment,
        time=times,
        names=tuple(column.name for column in columns),
        units=tuple(column.unit for column in columns),
        values=values,
        statistics=replace(journey.statistics(), wall_time=clock.perf_counter() - began),
        parameters=options.parameters,
        states=states.rows()[1] if keep else None,
        inputs=None,
        integrals=quadrature.result() if quadrature is not None else None,
        crossings=tuple(journey.watch.crossings),
        status=status,
        digest=program.digest,
    )
    return Run(trajectory, model, inputs, output)


def _carry_out(
    journey: Journey,
    x0: Floats,
    recorder: Recorder,
    sink: Sink,
    output: Path | None,
    explained: Callable[[IntegrationError], RunError],
    report: Reporter,
) -> Status:
    """Travel, and leave the sink closed whatever happens: what was recorded is kept, marked partial; nothing where there is nothing."""
    status: Status = "partial"
    try:
        journey.travel(x0)
        recorder.flush()
        status = "complete"
    except (IntegrationError, RunError) as error:
        failure = error if isinstance(error, RunError) else explained(error)
        raise (failure if output is None else _with_note(failure, f"the rows up to there are in {output}, marked partial")) from None
    except OSError as error:
        cannot_write(output, error, report)
    finally:
        with suppress(OSError):
            if status == "partial":
                recorder.flush()
            if status == "complete" or recorder.next > 1:
                sink.close(status)
            else:
                sink.discard()
    return status


def _with_note(error: RunError, note: str) -> RunError:
    first, *others = error.diagnostics
    return RunError([replace(first, notes=(*first.notes, note)), *others], error.time)


class Journey:
    """One run under way: the integrator and those who look at each of its steps."""

    def __init__(
        self,
        model: CompiledModel,
        options: Options,
        inputs: InputSignals,
        recorder: Recorder,
        quadrature: Quadrature | None,
        progress: Progress | None,
        report: Reporter,
    ):
        self._model, self._options, self._inputs = model, options, inputs
        self._recorder, self._quadrature, self._progress, self._report = recorder, quadrature, progress, report
        self.watch = Watch(model, inputs, options.start, options.stop)
        self._spent = Counters()
        self._invariants = Invariants(model, options, inputs) if model.program.invariants else None
        self._told = 0.0

    def travel(self, x0: Floats) -> None:
        """From the start to the stop. IntegrationError where the integrator cannot go on."""
        options = self._options
        if self._invariants is not None:
            x0 = x0.copy()
            self._invariants.begin(options.start, x0, self._report)
            self._recorder.adjust = self._invariants.adjust
        self._recorder.first(options.start, x0)
        if not self.watch.idle:
            self.watch.begin(options.start, x0)
        if not len(x0):
            self._without_states()
            return
        method = METHODS[options.method]
        if method.engine == "cvode":
            self._with_cvode(method, x0)
            return
        stepper = make_stepper(self._model, options, self._inputs, options.start, x0)
        self._spent = stepper.counters
        while stepper.t < options.stop:
            stepper.step()
            if self._invariants is not None:
                x = stepper.x.copy()
                self._invariants.apply(stepper.t, x)
                stepper.move(x)
            self._look(stepper)
            self.watch.pace(stepper.t, stepper.x, stepper.counters.steps)
            self._tell(stepper.t)

    def _with_cvode(self, method: Method, x0: Floats) -> None:
        """CVODE's own loop; Python is told of events only."""
        options, watch = self._options, self.watch
        events = None if watch.idle else watch.kernel
        try:
            libraries()
        except OSError as error:
            missing(f"the method `{method.name}` needs SUNDIALS: {error}", self._report)
        stepper = CvodeStepper(self._model, method, options, self._inputs, options.start, x0, events)
        self._spent = stepper.counters
        try:
            loop = CvodeLoop(stepper, options, self._recorder, self._quadrature, self._invariants)
            while (what := loop.go()) != "done":
                if what == "root":
                    x = stepper.x.copy()
                    watch.cross(stepper.t, stepper.roots(watch.kernel.size))
                    stepper.restart(stepper.t, x)
                    watch.begin(stepper.t, x)
                    if self._quadrature is not None:
                        self._quadrature.forget()
                watch.pace(stepper.t, stepper.x, stepper.counters.steps)
                self._tell(stepper.t)
        finally:
            stepper.finish()
            stepper.close()

    def _look(self, stepper: Stepper) -> None:
        """What an accepted step is looked at for: events first, since they cut it."""
        import numpy as np

        event = None if self.watch.idle else self.watch.find(stepper)
        if event is None:
            self._observe(stepper)
            return
        x = np.ascontiguousarray(stepper.dense(np.array([event]))[0])
        self._observe(Piece(stepper.t_old, event, x, stepper.dense))
        if self._quadrature is not None:
            self._quadrature.forget()
        stepper.restart(event, x)
        self.watch.begin(event, x)

    def _observe(self, stepper: LastStep) -> None:
        self._recorder.take(stepper)
        if self._quadrature is not None:
            self._quadrature.take(stepper)

    def _without_states(self) -> None:
        """A model without states: its algebra alone, along the grid."""
        import numpy as np

        self._observe(Piece(self._options.start, self._options.stop, np.zeros(0), lambda times: np.zeros((len(times), 0))))

    def _tell(self, t: float) -> None:
        if self._progress is not None and clock.perf_counter() - self._told > 0.05:
            self._told = clock.perf_counter()
            self._progress((t - self._options.start) / (self._options.stop - self._options.start))

    def statistics(self) -> Statistics:
        method = self._options.method
        spent = self._spent
        return Statistics(
            method=method,
            steps=spent.steps,
            rejected=spent.rejected,
            rhs_calls=spent.rhs,
            jacobian_calls=spent.jacobian,
            factorisations=spent.factorisations,
            events=len(self.watch.crossings),
            projections=self._invariants.moves if self._invariants else 0,
            drift=self._invariants.drift if self._invariants else 0.0,
        )


@dataclass(frozen=True, slots=True)
class Piece:
    """A step that was cut at an event, or the only one of a model without states."""

    t_old: float
    t: float
    x: Floats
    dense: Callable[[Floats], Floats]


def make_stepper(model: CompiledModel, options: Options, inputs: InputSignals, t: float, x: Floats) -> Stepper:
    """The integrator that the method names, at its start."""
    method = METHODS[options.method]
    match method.engine:
        case "scipy":
            return ScipyStepper(model, method, options, inputs, t, x)
        case "vode":
            return VodeStepper(model, method, options, inputs, t, x)
        case engine:
            raise AssertionError(engine)


__all__ = ["Journey", "Progress", "Run", "simulate"]
