"""A program whose switches are held: `sign(g)`, `abs(g)`, conditions on g, `min` and `max` keep their form between events.

Input        Program, Switches (functions g of states, inputs and time at whose sign the equations jump)
Output       Held: a Program in which the value s of each switch is +1 or -1 as held, or slides
Establishes  held, a right-hand side goes on smoothly across g = 0, so that no step is spoilt by what lies behind; sliding, s in
             [-1, 1] is what keeps der(g) = 0 (the equivalent control of Filippov and Utkin: friction at rest takes the force it balances)
Reports      nothing

der(g) is affine in s wherever efforts enter linearly. It is evaluated at s = 0 and at each unit value (`probes`: copies of just those
steps that depend on it), which gives the matrix A of der(g) = b + A s; the rows of sliding switches say A s = -b, those of held
ones s = side. Switches that do not touch each other are solved apart, so that many contacts cost as much as their couplings.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from bgdsl.expr import (
    ONE,
    TIME,
    ZERO,
    Expr,
    add,
    const,
    derivative,
    if_else,
    leaves,
    rebuild,
    relation,
    rewrite,
    substitute,
    topological,
    unary,
    var,
)
from bgdsl.ir.graph import Origin
from bgdsl.ir.program import Assign, Event, Program, Record, SolveLinear, SolveNewton, Step, defined, needed, read

SETTINGS = ("side", "slides", "margin")
"""What each switch is told through inputs: its value where held; 1 where it slides; how far g may go back before that is an event."""
PROBE = " (probe "
ROUND_OFF = 1e-12
SWITCHING = ("sign", "abs", "lt", "le", "min", "max")
PARTIAL = ("sqrt", "log", "log10", "asin", "acos", "pow")
"""What is not defined everywhere: forms that hold it are left behind g = 0 where they have no value."""
STEEP = (*PARTIAL, "exp", "sinh", "cosh", "tan", "div")
"""What may explode behind g = 0 if an `abs` within goes on as before."""
LARGEST = 1e300


@dataclass(frozen=True, slots=True)
class Switch:
    """A function at whose sign the equations may jump: `value` as the program says it, with the states it depends on.

    gradient: (state's number, derivative by it); rate: the part of der(value) that inputs and time make, over the inputs'
    derivatives (`rate_name`).
    """

    value: Expr
    gradient: tuple[tuple[int, Expr], ...]
    rate: Expr
    origin: Origin


@dataclass(frozen=True, slots=True)
class Held:
    """The program with modes. `events[i]`: the switch (and +1, or -1 where the event watches its negative) of event i, or None.

    rates: b; matrix: A by (row, column), as expressions of the program that hold for those switches that slide. copied: how many
    steps the probes made twice or more.
    """

    program: Program
    switches: tuple[Switch, ...]
    events: tuple[tuple[int, int] | None, ...]
    values: tuple[Expr, ...]
    rates: tuple[Expr, ...]
    matrix: Mapping[tuple[int, int], Expr]
    sheltered: frozenset[Expr]
    copied: int

    def relax(self, expressions: Iterable[Expr]) -> tuple[Expr, ...]:
        """Expressions of the original program as they read here."""
        return Relaxation(self.switches, self.sheltered).apply(expressions)


def original_name(name: str) -> str:
    """The variable of which a probe's variable is a copy."""
    return name.partition(PROBE)[0]


def rate_name(name: str) -> str:
    """What the derivative of an input is called among the inputs."""
    return f"der({name})"


def setting_name(setting: str, k: int) -> str:
    """What a setting of switch k is called among the inputs."""
    return f"switch {k}: {setting}"


def find_switches(program: Program) -> tuple[Switch, ...]:
    """The switches of what the derivatives need, as far as they can be held: functions of states, inputs and time alone."""
    steps = program.needed(program.derivatives)
    roots = [*(value for step in steps for value in read(step)), *program.derivatives]
    found: dict[Expr, None] = {}
    for node in topological(roots):
        if node.op in SWITCHING:
            value, _ = _orient(_switching(node), found)
            found[value] = None
    origins = {event.value: event.origin for event in program.events}
    closed = _closed(program, steps, tuple(found))
    return tuple(
        switch
        for value, whole in zip(found, closed, strict=True)
        if (origin := origins.get(value) or origins.get(_opposite(value))) is not None
        and (switch := _switch(program, value, whole, origin)) is not None
    )


def _switching(node: Expr) -> Expr:
    return node.args[0] if node.op in ("sign", "abs") else node.args[0] - node.args[1]


def _orient(value: Expr, known: Iterable[Expr]) -> tuple[Expr, int]:
    """The one of value and -value that is known (else the plainer one), and its sign."""
    if value in known:
        return value, 1
    opposite = _opposite(value)
    if opposite in known or value.op == "neg":
        return opposite, -1
    return value, 1


def _opposite(value: Expr) -> Expr:
    """The negative, with the signs of a difference exchanged: b - a for a - b."""
    if value.op == "add" and len(value.args) == 2 and value.args[1].op == "neg":
        return value.args[1].args[0] - value.args[0]
    return -value


def _closed(program: Program, steps: Sequence[Step], values: tuple[Expr, ...]) -> tuple[Expr, ...]:
    """The values with assigned variables written out."""
    meaning: dict[Expr, Expr] = {}
    for step in needed(steps, values):
        if isinstance(step, Assign):
            (meaning[var(step.variable)],) = rewrite((step.value,), meaning)
    return rewrite(values, meaning)


def _switch(program: Program, value: Expr, closed: Expr, origin: Origin) -> Switch | None:
    """None for what is no smooth function of states, inputs and time."""
    states = {record.name: i for i, record in enumerate(program.states)}
    inputs = {record.name for record in program.inputs}
    names = list(dict.fromkeys(leaf.data for leaf in leaves((closed,))))
    if any(name not in states and name not in inputs for name in names):
        return None
    if any(node.op in ("sign", "if", "floor", "ceil", "trunc") for node in topological((closed,))):
        return None
    gradient = tuple((states[name], derivative(closed, var(name))) for name in names if name in states)
    rates = [derivative(closed, var(name)) * var(rate_name(name)) for name in names if name in inputs]
    return Switch(value, gradient, add([derivative(closed, TIME), *rates]), origin)


# -------------------------------------------------------------------------------------------------------------- expressions


class Relaxation:
    """Rewrites expressions: `sign(g)` becomes s, `if` with a condition on g a blend of its two forms by s; kinks go on as they were."""

    def __init__(self, switches: Sequence[Switch], sheltered: frozenset[Expr]) -> None:
        self._sheltered = sheltered
        self._places = {switch.value: k for k, switch in enumerate(switches)}
        self._done: dict[Expr, Expr] = {}

    def apply(self, expressions: Iterable[Expr]) -> tuple[Expr, ...]:
        """The expressions over the values `s(k)`."""
        roots = tuple(expressions)
        for node in topological(roots, self._done):
            if node.op == "sign" and (place := self.place(node)) is not None:
                self._done[node] = s(place[0]) if place[1] > 0 else -s(place[0])
            elif node.op in ("abs", "min", "max") and node not in self._sheltered and (place := self.place(node)) is not None:
                self._done[node] = self._straight(node, *place)
            elif node.op == "if" and (k := self._condition(node.args[0])) is not None:
                self._done[node] = self._blend(node, k)
        return rewrite(roots, self._done)

    def place(self, node: Expr) -> tuple[int, int] | None:
        """The switch of a `sign` or relation, and its orientation."""
        return self.of(_switching(node))

    def of(self, value: Expr) -> tuple[int, int] | None:
        """The switch of this function or of its negative, and its orientation."""
        known, sign = _orient(value, self._places)
        return (self._places[known], sign) if known in self._places else None

    def _condition(self, condition: Expr) -> int | None:
        """The first switch that a condition reads."""
        places = (self.place(node) for node in topological((condition,)) if node.op in ("lt", "le", "sign"))
        return next((place[0] for place in places if place is not None), None)

    def _blend(self, node: Expr, k: int) -> Expr:
        """(1 + s)/2 of the form above g = 0 and (1 - s)/2 of that below; just one of them where s is held, since the other may be
        undefined there."""
        above, below = self.apply((self._forced(node, k, 1), self._forced(node, k, -1)))
        value, held = s(k), is_held(k)
        between = above * (0.5 * (ONE + value)) + below * (0.5 * (ONE - value))
        lower = if_else(relation("and", held, relation("le", value, const(-1.0))), below, between)
        blend = if_else(relation("and", held, relation("le", ONE, value)), above, lower)
        if not any(part.op in PARTIAL for part in topological((node,))):
            return blend
        plain = if_else(node.args[0], *rewrite(node.args[1:], self._done))
        return if_else(relation("le", unary("abs", blend), const(LARGEST)), blend, plain)

    def _straight(self, node: Expr, k: int, orientation: int) -> Expr:
        """`abs`, `min` or `max` as on the side where they are held."""
        side = var(setting_name("side", k))
        args = self.apply(node.args)
        if node.op == "abs":
            return if_else(is_held(k), side * args[0] if orientation > 0 else -(side * args[0]), unary("abs", args[0]))
        lower = (node.op == "min") == (orientation > 0)
        first, second = args if lower else args[::-1]
        return if_else(is_held(k), if_else(relation("lt", side, ZERO), first, second), rebuild(node, args))

    def _forced(self, node: Expr, k: int, side: int) -> Expr:
        """The node as it is on one side of g = 0."""
        forced: dict[Expr, Expr] = {}
        for part in topological((node,)):
            if part.op in ("lt", "le", "sign") and (place := self.place(part)) is not None and place[0] == k:
                sign = side * place[1]
                forced[part] = const(float(sign)) if part.op == "sign" else const(float(sign < 0))
        return substitute((node,), forced)[0]


def is_held(k: int) -> Expr:
    """The condition that switch k does not slide."""
    return relation("lt", var(setting_name("slides", k)), const(0.5))


def s(k: int) -> Expr:
    """The value of switch k: its sign where that is held, what holds g at zero where it slides."""
    return var(f"switch {k}")


# ------------------------------------------------------------------------------------------------------------------ program


def hold(program: Program, switches: Sequence[Switch]) -> Held:
    """The program with modes for these switches."""
    sheltered = _sheltered(program)
    relaxation = Relaxation(switches, sheltered)
    relaxed = [_relaxed(step, relaxation) for step in program.steps]
    derivatives = relaxation.apply(program.derivatives)
    count = len(switches)
    moved = _dependents(relaxed, {s(k).data for k in range(count)})
    first, last = ([step for step, own in zip(relaxed, moved, strict=True) if own is wanted] for wanted in (False, True))
    probes, slopes = _probes(relaxed, derivatives, switches)
    rates = tuple(_rate(switch, slopes[0]) for switch in switches)
    matrix = {
        (i, k): entry
        for k in range(count)
        for i, switch in enumerate(switches)
        if not (entry := _rate(switch, slopes[k + 1]) - rates[i]).is_zero
    }
    steps = (*first, *probes, *_solved(switches, rates, matrix), *last)
    places = tuple(relaxation.of(event.value) for event in program.events)
    events = tuple(
        event if place is None else Event(_watched(place[0], switches[place[0]]), event.origin)
        for event, place in zip(program.events, places, strict=True)
    )
    settings = [Record(setting_name(setting, k)) for setting in SETTINGS for k in range(count)]
    held = replace(
        program,
        inputs=(*program.inputs, *(Record(rate_name(record.name)) for record in program.inputs), *settings),
        steps=steps,
        derivatives=derivatives,
        outputs=tuple((record, relaxation.apply((value,))[0]) for record, value in program.outputs),
        events=events,
        checks=tuple(replace(check, condition=relaxation.apply((check.condition,))[0]) for check in program.checks),
        invariants=tuple((relaxation.apply((value,))[0], origin) for value, origin in program.invariants),
    )
    return Held(held, tuple(switches), places, tuple(s(k) for k in range(count)), rates, matrix, sheltered, len(probes))


def _sheltered(program: Program) -> frozenset[Expr]:
    """The `abs`, `min` and `max` that keep something else defined: `sqrt(abs(x))` must not become `sqrt(-x)`."""
    roots = [*(value for step in program.steps for value in read(step)), *program.derivatives]
    under = [arg for node in topological(roots) if node.op in STEEP for arg in node.args[node.op == "div" :]]
    assigned = {step.variable: step.value for step in program.steps if isinstance(step, Assign)}
    seen: dict[Expr, None] = {}
    while under:
        found = list(topological(under, seen))
        seen.update((node, None) for node in found)
        under = [assigned[node.data] for node in found if node.op == "var" and node.data in assigned and assigned[node.data] not in seen]
    return frozenset(node for node in seen if node.op in ("abs", "min", "max"))


def _rate(switch: Switch, slopes: Mapping[int, Expr]) -> Expr:
    return add([*(entry * slopes[i] for i, entry in switch.gradient), switch.rate])


def _watched(k: int, switch: Switch) -> Expr:
    """What is positive as long as the mode of switch k may stay."""
    side, slides, margin = (var(setting_name(setting, k)) for setting in SETTINGS)
    value = s(k)
    return if_else(relation("lt", slides, const(0.5)), side * switch.value + margin, const(1.0 + ROUND_OFF) - value * value)


def _relaxed(step: Step, relaxation: Relaxation) -> Step:
    match step:
        case Assign():
            return replace(step, value=relaxation.apply((step.value,))[0])
        case SolveLinear():
            entries = relaxation.apply(value for _, _, value in step.entries)
            return replace(
                step,
                entries=tuple((i, j, value) for (i, j, _), value in zip(step.entries, entries, strict=True)),
                right=relaxation.apply(step.right),
            )
        case SolveNewton():
            entries = relaxation.apply(value for _, _, value in step.entries)
            return replace(
                step,
                inner=tuple(replace(a, value=relaxation.apply((a.value,))[0]) for a in step.inner),
                residuals=relaxation.apply(step.residuals),
                entries=tuple((i, j, value) for (i, j, _), value in zip(step.entries, entries, strict=True)),
                guesses=relaxation.apply(step.guesses),
            )


def _dependents(steps: Sequence[Step], names: set[str]) -> list[bool]:
    """For each step whether it depends on one of the names, directly or through earlier ones."""
    moved = set(names)
    found = []
    for step in steps:
        own = any(leaf.data in moved for leaf in leaves(read(step)))
        if own:
            moved |= set(defined(step))
        found.append(own)
    return found


def _probes(steps: Sequence[Step], derivatives: Sequence[Expr], switches: Sequence[Switch]) -> tuple[list[Step], list[Mapping[int, Expr]]]:
    """Copies of what the switches' rates need: all sliding values zero, then each of them one. For each copy the states' derivatives."""
    wanted = sorted({i for switch in switches for i, _ in switch.gradient})
    roots = [derivatives[i] for i in wanted]
    chain = needed(steps, roots)
    copies: list[Step] = []
    results: list[Mapping[int, Expr]] = []
    base: dict[Expr, Expr] = {}
    for probe in range(len(switches) + 1):
        names = {s(k).data for k in range(len(switches))} if probe == 0 else {s(probe - 1).data}
        own: dict[Expr, Expr] = {var(name): _trial(name, k == probe - 1) for k, name in _places(names, len(switches))}
        tag = f"{PROBE}{probe})"
        moved = [step for step, moves in zip(chain, _dependents(chain, names), strict=True) if moves]
        own.update((var(name), var(name + tag)) for step in moved for name in defined(step))
        if probe == 0:
            base = own
        meaning = {**base, **own}
        copies.extend(_copy(step, meaning, tag) for step in moved)
        results.append(dict(zip(wanted, substitute(roots, meaning), strict=True)))
    return copies, results


def _places(names: set[str], count: int) -> Iterator[tuple[int, str]]:
    return ((k, s(k).data) for k in range(count) if s(k).data in names)


def _trial(name: str, unit: bool) -> Expr:
    """The value of a switch in a probe: as held, or else 0 or 1."""
    held = relation("lt", var(f"{name}: slides"), const(0.5))
    return if_else(held, var(f"{name}: side"), ONE if unit else ZERO)


def _copy(step: Step, meaning: Mapping[Expr, Expr], tag: str) -> Step:
    """The step under other names, reading what `meaning` says."""

    def put(values: Iterable[Expr]) -> tuple[Expr, ...]:
        return substitute(tuple(values), meaning)

    match step:
        case Assign():
            return Assign(step.variable + tag, put((step.value,))[0], step.origin)
        case SolveLinear():
            entries = tuple((i, j, put((value,))[0]) for i, j, value in step.entries)
            return replace(step, variables=tuple(name + tag for name in step.variables), entries=entries, right=put(step.right))
        case SolveNewton():
            return SolveNewton(
                tuple(name + tag for name in step.variables),
                tuple(Assign(a.variable + tag, put((a.value,))[0], a.origin) for a in step.inner),
                put(step.residuals),
                tuple((i, j, put((value,))[0]) for i, j, value in step.entries),
                put(step.guesses),
                step.origin,
                step.name,
            )


def _solved(switches: Sequence[Switch], rates: Sequence[Expr], matrix: Mapping[tuple[int, int], Expr]) -> Iterator[Step]:
    """The values s: A s = -b for sliding switches, s = side for held ones, one block for each group that is coupled."""
    for group in _groups(len(switches), matrix):
        places = {k: place for place, k in enumerate(group)}
        entries, right = [], []
        for k in group:
            side, held = var(setting_name("side", k)), is_held(k)
            right.append(if_else(held, side, -rates[k]))
            row = {j: if_else(held, ZERO, matrix[k, j]) for j in group if (k, j) in matrix}
            row[k] = if_else(held, ONE, matrix.get((k, k), ZERO))
            entries += [(places[k], places[j], value) for j, value in sorted(row.items())]
        origin = switches[group[0]].origin
        free = tuple(f"{s(k).data}, sliding" for k in group)
        if len(group) == 1:
            yield Assign(free[0], right[0] / entries[0][2], origin)
        else:
            yield SolveLinear(free, tuple(entries), tuple(right), origin, "the sticking contacts")
        for k, name in zip(group, free, strict=True):
            held = is_held(k)
            yield Assign(s(k).data, if_else(held, var(setting_name("side", k)), var(name)), origin)


def _groups(count: int, matrix: Iterable[tuple[int, int]]) -> list[list[int]]:
    """The switches in groups that the matrix couples."""
    heads = list(range(count))

    def head(k: int) -> int:
        while heads[k] != k:
            heads[k] = heads[heads[k]]
            k = heads[k]
        return k

    for i, j in matrix:
        heads[max(head(i), head(j))] = min(head(i), head(j))
    groups: dict[int, list[int]] = {}
    for k in range(count):
        groups.setdefault(head(k), []).append(k)
    return list(groups.values())
