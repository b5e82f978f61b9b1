"""Which way equations that jump go on from g = 0: through, or along it, held there (friction that sticks).

A run goes by the program of `modes.py`, in which every switch is a mode that is kept between events; `Modes` chooses the modes at
each event. (Where there are too many, it begins with the equations as they stand, and makes modes only of those that it meets with
slopes that point at g = 0 from both sides.) With der(g) = b + A s
they solve a complementarity problem: a switch slides with -1 <= s <= 1 and der(g) = 0, or is held at the side to which der(g) points.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

from bgdsl.expr import Expr
from bgdsl.ir.native import CompiledModel, Kernel
from bgdsl.simulate.failures import IntegrationError
from bgdsl.simulate.inputs import InputSignals
from bgdsl.simulate.modes import SETTINGS, Held, Switch, find_switches, hold
from bgdsl.simulate.options import Options, parameter_array

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

SHARE = 1e-3
"""g counts as zero where so much of the states' tolerance makes a difference as large."""
LEAST = 1e-15
"""... and where it is this small in any case."""
MARGIN = 1e-14
"""Beyond round-off of g by the share of its terms: what g may be on the wrong side without an event, at least."""
NEGLIGIBLE = 1e-9
"""A jump of der(g) counts as none below this share of der(g) itself."""
RANK = 1e-10
"""Sliding switches of which one follows from others: pivots below this share."""
MOST_SWITCHES = 200
MOST_COPIES = 3
"""All switches are modes from the start if they are no more than so many and their probes no more than so many times the steps
(and MOST_SWITCHES steps); else only those along which the run would slide, each when it is first met."""


class SwitchSignals(InputSignals):
    """The inputs, their derivatives, and the settings of the switches, which stay constant between events."""

    def __init__(self, inputs: InputSignals, switches: int):
        import numpy as np

        settings = np.zeros(len(SETTINGS) * switches)
        super().__init__(inputs.breaks, inputs.values, inputs.slopes, settings, with_rates=True)

    def put(self, settings: Floats) -> None:
        """New settings (flat: all sides, all slides, all margins) from now on."""
        self.settings[:] = settings.ravel()


@dataclass(frozen=True, slots=True)
class Regime:
    """How variables are to be evaluated behind a time: by which model, with the switches set how. No `held`: as they stand."""

    time: float
    model: CompiledModel
    inputs: InputSignals
    held: Held | None = None
    settings: Floats | None = None

    def kernel(self, expressions: Sequence[Expr]) -> Kernel:
        """An evaluator of expressions of the original program. Signals are set as they were."""
        if self.held is not None and self.settings is not None:
            assert isinstance(self.inputs, SwitchSignals)
            self.inputs.put(self.settings)
        return self.model.evaluator(expressions if self.held is None else self.held.relax(expressions))


class Surfaces:
    """The switches of a model and what they look like at a place."""

    def __init__(self, model: CompiledModel, switches: tuple[Switch, ...]):
        self.switches = switches
        self.starts = [0]
        entries: list[Expr] = []
        for switch in switches:
            entries += [switch.value, *(entry for _, entry in switch.gradient)]
            self.starts.append(len(entries))
        self._kernel = model.evaluator(entries)
        self._n = len(model.program.states)

    def at(self, t: float, x: Floats, u: Floats) -> tuple[Floats, Floats]:
        """g (k,) and its gradients (k, n)."""
        import numpy as np

        numbers = np.full(self._kernel.size, np.nan)
        self._kernel(t, x, u, numbers)
        g = numbers[self.starts[:-1]]
        if not np.isfinite(g).all():
            raise IntegrationError("a switching function is not finite", t, x.copy())
        numbers[~np.isfinite(numbers)] = 0.0
        gradients: Floats = np.zeros((len(self.switches), self._n))
        for k, switch in enumerate(self.switches):
            first = self.starts[k] + 1
            gradients[k, [i for i, _ in switch.gradient]] = numbers[first : self.starts[k + 1]]
        return g, gradients


class Discovery:
    """Looks at the equations as they stand for surfaces along which they would slide."""

    def __init__(self, original: CompiledModel, model: CompiledModel, inputs: InputSignals, options: Options, known: Sequence[Switch] = ()):
        self._original, self._model, self._inputs, self._options = original, model, inputs, options
        self._surfaces: Surfaces | None = None
        self._known = tuple(known)

    def find(self, t: float, x: Floats) -> tuple[Switch, ...]:
        """The switches to make modes of, if the slopes on both sides of one point at it here."""
        import numpy as np

        if self._surfaces is None:
            taken = {switch.value for switch in self._known}
            self._surfaces = Surfaces(self._model, tuple(w for w in _switches(self._original) if w.value not in taken))
        surfaces = self._surfaces
        if not surfaces.switches:
            return ()
        x = np.ascontiguousarray(x)
        g, gradients = surfaces.at(t, x, self._inputs(t))
        near = tolerances(gradients, x, self._options)
        met = [k for k in np.flatnonzero(np.abs(g) <= near).tolist() if self._is_opposed(t, x, k, g[k], gradients[k], near[k])]
        if not met:
            return ()
        chosen = set(met)
        return (*self._known, *(surfaces.switches[k] for k in sorted(chosen)))

    def all(self) -> tuple[Switch, ...]:
        """Every switch, if they may all be modes from the start; else none."""
        switches = _switches(self._original)
        if not 0 < len(switches) <= MOST_SWITCHES:
            return ()
        held, _ = _held(self._original, switches)
        return switches if held.copied <= MOST_COPIES * len(self._original.program.steps) + MOST_SWITCHES else ()

    def _is_opposed(self, t: float, x: Floats, k: int, g: float, gradient: Floats, near: float) -> bool:
        """Whether der(g) is negative above and positive below, by a jump: one that stays as the sides come closer."""
        square = float(gradient @ gradient)
        if not square > 0.0:
            return False
        jumps = []
        for distance in (near, 0.01 * near):
            above, below = (self._speed(t, x + gradient * ((side * distance - g) / square), k) for side in (1.0, -1.0))
            if not above < 0.0 < below:
                return False
            jumps.append(below - above)
        return jumps[1] > 0.5 * jumps[0]

    def _speed(self, t: float, x: Floats, k: int) -> float:
        """der(g) there, by the gradient and a short difference in time."""
        import numpy as np

        assert self._surfaces is not None
        slopes = np.zeros(len(x))
        if self._model.rhs(t, x, self._inputs(t), slopes):
            return float("nan")
        short = 1e-7 * (self._options.stop - self._options.start)
        g, gradients = self._surfaces.at(t, x, self._inputs(t))
        later, _ = self._surfaces.at(t + short, x, self._inputs(t + short))
        return float(gradients[k] @ slopes + (later[k] - g[k]) / short)


class Modes:
    """The modes of one run's switches: chosen anew at each event, kept in between."""

    def __init__(self, model: CompiledModel, switches: tuple[Switch, ...], inputs: InputSignals, options: Options):
        import numpy as np

        self.held, self.model = _held(model, switches)
        self.model.set_parameters(parameter_array(options.parameters))
        count = len(switches)
        self.inputs = SwitchSignals(inputs, count)
        self._options = options
        self._surfaces = Surfaces(self.model, switches)
        self._places = tuple(self.held.matrix)
        self._kernel = self.model.evaluator([*self.held.rates, *self.held.matrix.values()])
        self._values = self.model.evaluator(self.held.values)
        self._side, self._slides, self._margin = (np.zeros(count) for _ in SETTINGS)
        self._last = np.zeros(count)

    @property
    def settings(self) -> Floats:
        """A copy: (3, switches)."""
        import numpy as np

        found: Floats = np.array([self._side, self._slides, self._margin])
        return found

    def begin(self, t: float, x: Floats) -> Floats:
        """Choose the first modes, by the signs that the functions have. The states to go on from."""
        import numpy as np

        g, gradients = self._surfaces.at(t, x, self.inputs(t))
        near = np.abs(g) <= tolerances(gradients, x, self._options)
        self._side[:] = np.where(near, 0.0, np.sign(g))
        return self._choose(t, x, set(np.flatnonzero(near).tolist()))

    def rising(self, event: int) -> bool | None:
        """Which way an event of this number goes that is due now; None where it is no switch's."""
        place = self.held.events[event]
        if place is None:
            return None
        k, orientation = place
        up = bool(self._last[k] > 0.0 if self._slides[k] else self._side[k] < 0.0)
        return up if orientation > 0 else not up

    def look(self, t: float, x: Floats) -> None:
        """Read the values of the switches at an event."""
        self._last = self._read(t, x)

    def change(self, t: float, x: Floats, events: Iterable[int]) -> Floats:
        """Choose the modes behind events. The states to go on from."""
        import numpy as np

        fired = {place[0] for event in events if (place := self.held.events[event]) is not None}
        g, gradients = self._surfaces.at(t, x, self.inputs(t))
        near = tolerances(gradients, x, self._options)
        open_ = set(np.flatnonzero(np.abs(g) <= 1.5 * near).tolist()) | fired
        missed = (self._side * g < -near) & (self._slides == 0.0)  # twice in one step, which an event cut in between
        missed[list(fired)] = False
        self._side[missed] = np.sign(g[missed])
        for k in fired:
            if self._slides[k]:  # it breaks loose: its value has reached a bound
                self._slides[k] = 0.0
                self._side[k] = np.sign(self._last[k])
                open_.discard(k)
            else:
                self._side[k] = -self._side[k]
        return self._choose(t, x, open_ | set(np.flatnonzero(self._slides).tolist()))

    def _read(self, t: float, x: Floats) -> Floats:
        import numpy as np

        values: Floats = np.full(len(self._side), np.nan)
        self._values(t, np.ascontiguousarray(x), self.inputs(t), values)
        return values

    def _choose(self, t: float, x: Floats, open_: set[int]) -> Floats:
        """Solve for the open switches, put the settings in force; sliding functions are moved to zero."""
        import numpy as np

        x = np.array(x)
        chosen = sorted(open_)
        self._slides[:] = 0.0
        self._slides[chosen] = 1.0
        rates, matrix = self._rates(t, x)
        able = [k for k in chosen if matrix[k, k] < -NEGLIGIBLE * abs(rates[k]) and np.isfinite(matrix[k]).all()]
        for k in chosen:
            if k not in able:  # what does not jump goes on as it goes
                self._slides[k] = 0.0
                self._side[k] = self._side[k] or np.sign(rates[k]) or 1.0
        if len(able) < len(chosen):
            rates, matrix = self._rates(t, x)
        values, sliding = complementary(matrix[np.ix_(able, able)], rates[able])
        kept = independent(matrix[np.ix_(able, able)], sliding)
        for place, k in enumerate(able):
            self._side[k] = values[place]
            self._slides[k] = float(kept[place])
        x = self._moved(t, x)
        self._put_margins(t, x)
        return x

    def _rates(self, t: float, x: Floats) -> tuple[Floats, Floats]:
        """b (k,) and A (k, k) with the settings at hand."""
        import numpy as np

        self.inputs.put(self.settings)
        numbers = np.full(self._kernel.size, np.nan)
        self._kernel(t, x, self.inputs(t), numbers)
        numbers[~np.isfinite(numbers)] = 0.0
        count = len(self._side)
        matrix: Floats = np.zeros((count, count))
        for (i, j), value in zip(self._places, numbers[count:].tolist(), strict=True):
            matrix[i, j] = value
        return numbers[:count], matrix

    def _moved(self, t: float, x: Floats) -> Floats:
        """The states with the sliding functions at zero, by the smallest move in the norm of the tolerances."""
        import numpy as np

        sliding = np.flatnonzero(self._slides)
        if not len(sliding):
            return x
        g, gradients = self._surfaces.at(t, x, self.inputs(t))
        scales = self._options.rtol * np.abs(x) + self._options.atol
        moves = np.linalg.lstsq(gradients[sliding] * scales, -g[sliding], rcond=None)[0] * scales
        found: Floats = x + moves
        return found

    def _put_margins(self, t: float, x: Floats) -> None:
        import numpy as np

        g, gradients = self._surfaces.at(t, x, self.inputs(t))
        noise = MARGIN * (np.abs(gradients) @ np.abs(x)) + LEAST
        self._margin[:] = np.maximum.reduce([SHARE * tolerances(gradients, x, self._options), noise, -2.0 * self._side * g])
        self.inputs.put(self.settings)


def tolerances(gradients: Floats, x: Floats, options: Options) -> Floats:
    """How far from zero functions with these gradients (k, n) may be and count as zero."""
    import numpy as np

    found: Floats = SHARE * (np.abs(gradients) @ (options.rtol * np.abs(x) + options.atol)) + LEAST
    return found


def complementary(matrix: Floats, rates: Floats) -> tuple[Floats, list[bool]]:
    """s within [-1, 1] such that r = b + A s is zero where s is inside, and has the sign of s at the bounds. (s, where inside)

    Active sets, from all inside: the one furthest out is held at its bound; held ones that pull back inside are let go again.
    Friction makes -A positive definite, or semidefinite where contacts share a motion: then the smallest s is taken.
    """
    import numpy as np

    count = len(rates)
    values: Floats = np.zeros(count)
    inside = np.ones(count, dtype=bool)
    seen: set[bytes] = set()
    while True:
        held = rates + matrix[:, ~inside] @ values[~inside]
        values[inside] = np.linalg.lstsq(matrix[np.ix_(inside, inside)], -held[inside], rcond=RANK)[0] if inside.any() else 0.0
        excess = np.where(inside, np.abs(values), 0.0)
        if excess.max(initial=0.0) > 1.0 - NEGLIGIBLE:
            k = int(excess.argmax())
            inside[k], values[k] = False, np.sign(values[k])
            continue
        pull = np.where(inside, 0.0, values * (rates + matrix @ values))
        if pull.min(initial=0.0) >= -10 * NEGLIGIBLE * (np.abs(rates).max(initial=0.0) + np.abs(matrix).max(initial=0.0)):
            return values, inside.tolist()
        state = inside.tobytes()
        if state in seen:  # no answer by active sets (A is not that of friction): the last one
            return values, inside.tolist()
        seen.add(state)
        inside[int(pull.argmin())] = True


def independent(matrix: Floats, sliding: Sequence[bool]) -> list[bool]:
    """Of the sliding switches those whose rows are independent: the others stay at their values, and at g = 0 by the rest."""
    import numpy as np

    kept = [False] * len(sliding)
    basis: list[Floats] = []
    columns = np.flatnonzero(sliding)
    for k in columns.tolist():
        row = matrix[k, columns].copy()
        size = float(np.linalg.norm(row))
        for other in basis:
            row -= (row @ other) * other
        rest = float(np.linalg.norm(row))
        if rest > RANK**0.5 * size:
            basis.append(row / rest)
            kept[k] = True
    return kept


_FOUND: WeakKeyDictionary[CompiledModel, tuple[Switch, ...]] = WeakKeyDictionary()
_HELD: WeakKeyDictionary[CompiledModel, dict[tuple[Switch, ...], tuple[Held, CompiledModel]]] = WeakKeyDictionary()
"""What was found and compiled for models that are still in use."""


def _switches(model: CompiledModel) -> tuple[Switch, ...]:
    if model not in _FOUND:
        _FOUND[model] = find_switches(model.program)
    return _FOUND[model]


def _held(model: CompiledModel, switches: tuple[Switch, ...]) -> tuple[Held, CompiledModel]:
    known: Mapping[tuple[Switch, ...], tuple[Held, CompiledModel]] = _HELD.setdefault(model, {})
    if switches not in known:
        held = hold(model.program, switches)
        _HELD[model][switches] = held, model.variant(held.program)
    return _HELD[model][switches]
