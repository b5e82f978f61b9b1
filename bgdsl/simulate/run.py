"""A run: a compiled model and options in, a trajectory out.

Input        CompiledModel, Options
Output       Run (a Trajectory and the means to evaluate more of it)
Establishes  rows at every time of the grid; integrals over the window; events located; invariants kept; statistics of the cost
Reports      run errors (`failures.py`), with the time, the element and its line
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from bgdsl.diagnostics import Reporter, RunError
from bgdsl.ir.native import CompiledModel
from bgdsl.ir.program import defined
from bgdsl.ir.trajectory import Crossing, Statistics, Status, Trajectory
from bgdsl.simulate.columns import find_columns, output_columns
from bgdsl.simulate.cvode import CvodeLoop, CvodeStepper
from bgdsl.simulate.events import Watch
from bgdsl.simulate.failures import IntegrationError, explain, missing
from bgdsl.simulate.initial import initial_state
from bgdsl.simulate.inputs import InputSignals, input_signals
from bgdsl.simulate.methods import METHODS, Method
from bgdsl.simulate.modes import Switch, original_name
from bgdsl.simulate.options import Options, parameter_array
from bgdsl.simulate.projection import Invariants
from bgdsl.simulate.quadrature import Quadrature, Quadratures
from bgdsl.simulate.recorder import Grid, Recorder
from bgdsl.simulate.recording import MemorySink, Sink, cannot_write, open_sink
from bgdsl.simulate.result import Run
from bgdsl.simulate.scipy_methods import ScipyStepper, VodeStepper
from bgdsl.simulate.sliding import Discovery, Modes, Regime
from bgdsl.simulate.sparse import SparseLU
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
    program = model.program
    columns = output_columns(program) if options.variables is None else find_columns(program, options.variables, report)
    inputs = input_signals([record.name for record in program.inputs], options.inputs, options.start, options.stop, report)
    if not options.step_given:  # not over a pulse that a recording holds
        options = replace(options, max_step=min(options.max_step, inputs.spacing))
    model.set_parameters(parameter_array(options.parameters))
    u0 = dict(zip((record.name for record in program.inputs), inputs(options.start).tolist(), strict=True))
    x0 = start if start is not None else initial_state(program, options.parameters, u0, options.start, report)
    grid = Grid(options.start, options.stop, options.interval, options.times)
    keep = output is None and grid.count * max(1, len(program.states)) <= KEPT_STATES
    memory, states = MemorySink(len(columns)), MemorySink(len(program.states))
    recorder = Recorder(model, columns, memory, states if keep else None, grid, inputs)
    quadrature = None if quadratures is None else Quadrature(model, quadratures.expressions, quadratures.window or options.window, inputs)
    journey = Journey(model, options, inputs, recorder, quadrature, progress, report)
    _make_ready(model, METHODS[options.method])
    began = clock.perf_counter()
    sink: Sink = memory
    if output is not None:
        sink = recorder.sink = open_sink(output, columns, program.model, program.digest, force=force, report=report)
    status = _carry_out(journey, x0, recorder, sink, output, report)
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
        crossings=tuple(journey.crossings),
        status=status,
        digest=program.digest,
    )
    return Run(trajectory, model, tuple(journey.regimes), output)


def _make_ready(model: CompiledModel, method: Method) -> None:
    """Have the machine code made that the integrator will call (the first run's price, not the run's)."""
    if model.program.states:
        _ = model.rhs
        if method.jacobian:
            _ = model.jacobian
            if method.engine == "cvode":
                SparseLU(*model.pattern)


def _carry_out(
    journey: Journey,
    x0: Floats,
    recorder: Recorder,
    sink: Sink,
    output: Path | None,
    report: Reporter,
) -> Status:
    """Travel, and leave the sink closed whatever happens: what was recorded is kept, marked partial; nothing where there is nothing."""
    status: Status = "partial"
    try:
        journey.travel(x0)
        recorder.flush()
        sink.close("complete")
        status = "complete"
    except (IntegrationError, RunError) as error:
        failure = error if isinstance(error, RunError) else journey.explain(error)
        written = output is not None and recorder.next > 1
        raise (_with_note(failure, f"the rows up to there are in {output}, marked partial") if written else failure) from None
    except OSError as error:
        cannot_write(output, error, report)
    finally:
        if status == "partial":
            with suppress(Exception):  # what went wrong first is what is told
                recorder.flush()
            with suppress(Exception):
                sink.close("partial") if recorder.next > 1 else sink.discard()
    return status


def _with_note(error: RunError, note: str) -> RunError:
    first, *others = error.diagnostics
    return RunError([replace(first, notes=(*first.notes, note)), *others], error.time)


class Journey:
    """One run under way: the integrator and those who look at each of its steps.

    `model` and `inputs` are those in force: the model as compiled, or, once equations have been met that slide, the one with modes.
    """

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
        self.model, self._options, self.inputs = model, options, inputs
        self._original, self._plain = model, inputs
        self._recorder, self._quadrature, self._progress, self._report = recorder, quadrature, progress, report
        self.crossings: list[Crossing] = []
        self.regimes = [Regime(options.start, model, inputs)]
        self._modes: Modes | None = None
        self._spent: list[Counters] = []
        self._corrections: list[Invariants] = []
        self._told = 0.0
        self._look_anew()

    def _look_anew(self) -> None:
        """Watch, project and discover by the model in force."""
        model, options = self.model, self._options
        self.watch = Watch(model, self.inputs, options.start, options.stop, self.crossings)
        self.watch.sense = self._modes.rising if self._modes is not None else None
        self._discovery = Discovery(self._original, model, self.inputs, options, self._modes.held.switches if self._modes else ())
        if model.program.invariants:
            self._corrections.append(Invariants(model, options, self.inputs))
            self._recorder.adjust = self._corrections[-1].adjust

    @property
    def _invariants(self) -> Invariants | None:
        return self._corrections[-1] if self._corrections else None

    def travel(self, x: Floats) -> None:
        """From the start to the stop. IntegrationError where the integrator cannot go on."""
        t, stop = self._options.start, self._options.stop
        if self._invariants is not None:
            x = x.copy()
            self._invariants.begin(t, x, self._report)
        if not self.watch.idle:
            if len(x):
                x = self._hold(t, x, self._discovery.all())
                x = self._behind(t, x, [])
            self.watch.begin(t, x)
        self._recorder.first(t, x)
        if not len(x):
            self._without_states()
            return
        method = METHODS[self._options.method]
        go = self._with_cvode if method.engine == "cvode" else self._with_steps
        while t < stop:
            t, x = go(method, t, x)

    def _with_steps(self, method: Method, t: float, x: Floats) -> tuple[float, Floats]:
        """One step after another, to the stop or to where another model takes over."""
        model, stop = self.model, self._options.stop
        stepper = make_stepper(model, self._options, self.inputs, t, x)
        self._spent.append(stepper.counters)
        while stepper.t < stop and self.model is model:
            stepper.step()
            if self._invariants is not None:
                x = stepper.x.copy()
                self._invariants.apply(stepper.t, x)
                stepper.move(x)
            self._look(stepper)
            self.watch.pace(stepper.t, stepper.x, stepper.counters.steps)
            self._limit(stepper)
            self._tell(stepper.t)
        return stepper.t, stepper.x

    def _with_cvode(self, method: Method, t: float, x: Floats) -> tuple[float, Floats]:
        """CVODE's own loop, to the stop or to where another model takes over; Python is told of events only."""
        model, options = self.model, self._options
        try:
            libraries()
        except OSError as error:
            missing(f"the method `{method.name}` needs SUNDIALS: {error}", self._report)
        stepper = CvodeStepper(model, method, options, self.inputs, t, x, None if self.watch.idle else self.watch.kernel)
        self._spent.append(stepper.counters)
        try:
            loop = CvodeLoop(stepper, options, self._recorder, self._quadrature, self._invariants)
            while self.model is model and (what := loop.go()) != "done":
                if what == "root":
                    stepper.restart(stepper.t, self._event(stepper.t, stepper.x.copy(), stepper.roots(self.watch.kernel.size)))
                self.watch.pace(stepper.t, stepper.x, stepper.counters.steps)
                self._limit(stepper)
                self._tell(stepper.t)
        finally:
            stepper.finish()
            t, x = stepper.t, stepper.x.copy()
            stepper.close()
        return t, x

    def _limit(self, stepper: Stepper | CvodeStepper) -> None:
        """Give up where the caller would not wait longer."""
        if stepper.counters.steps > self._options.most_steps:
            raise IntegrationError(f"the run takes more than {self._options.most_steps:g} steps", stepper.t, stepper.x.copy())

    def _look(self, stepper: Stepper) -> None:
        """What an accepted step is looked at for: events first, since they cut it."""
        import numpy as np

        event = None if self.watch.idle else self.watch.find(stepper)
        if event is None:
            self._observe(stepper)
            return
        t, changed = event
        x = np.ascontiguousarray(stepper.dense(np.array([t]))[0])
        self._observe(Piece(stepper.t_old, t, x, stepper.dense))
        stepper.restart(t, self._event(t, x, changed))

    def _event(self, t: float, x: Floats, changed: Sequence[int]) -> Floats:
        """Take note of event functions that changed sign (k rising, ~k falling). The states to go on from."""
        if self._modes is not None:
            self._modes.look(t, x)
        events = [k if k >= 0 else ~k for k in changed]
        for k, signed in zip(events, changed, strict=True):
            if k < self.watch.count:
                self.watch.note(t, k, signed >= 0)
        x = self._behind(t, x, events)
        self.watch.begin(t, x)
        if self._quadrature is not None:
            self._quadrature.forget()
        return x

    def _behind(self, t: float, x: Floats, events: Sequence[int]) -> Floats:
        """Choose how the equations go on from an event, in another model if need be. The states to go on from."""
        if self._modes is not None:
            x = self._modes.change(t, x, events)
        x = self._hold(t, x, self._discovery.find(t, x))
        if self._modes is not None:
            if self.regimes[-1].time == t == self._options.start:
                self.regimes.pop()
            self.regimes.append(Regime(t, self.model, self.inputs, self._modes.held, self._modes.settings))
        return x

    def _hold(self, t: float, x: Floats, switches: tuple[Switch, ...]) -> Floats:
        """Go on with the model in which these switches are modes. The states to go on from."""
        if not switches:
            return x
        self._modes = modes = Modes(self._original, switches, self._plain, self._options)
        x = modes.begin(t, x)
        self.model, self.inputs = modes.model, modes.inputs
        self._recorder.follow(modes.model, modes.held.relax, modes.inputs)
        if self._quadrature is not None:
            self._quadrature.follow(modes.model, modes.held.relax, modes.inputs)
        self._look_anew()
        return x

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

    def explain(self, error: IntegrationError) -> RunError:
        """What went wrong, in the terms of the model as it was written: switches made modes have steps of their own."""
        if self.model is not self._original and error.status > 0:
            name = original_name(defined(self.model.program.steps[error.status - 1])[0])
            steps = [k for k, step in enumerate(self._original.program.steps, 1) if name in defined(step)]
            error.status = steps[0] if steps else 0
        return explain(self._original, error, self._plain, self._options.parameters)

    def statistics(self) -> Statistics:
        def total(name: str) -> int:
            return sum(getattr(counters, name) for counters in self._spent)

        return Statistics(
            method=self._options.method,
            steps=total("steps"),
            rejected=total("rejected"),
            rhs_calls=total("rhs"),
            jacobian_calls=total("jacobian"),
            factorisations=total("factorisations"),
            events=len(self.crossings),
            projections=sum(one.moves for one in self._corrections),
            drift=max((one.drift for one in self._corrections), default=0.0),
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
