"""Programs made by hand: states, derivatives and what else a run needs, without a front end."""

from __future__ import annotations

from collections.abc import Mapping

from bgdsl.expr import TIME, ZERO, Expr, Table, add, const, derivative, if_else, leaves, param, relation, substitute, unary, var
from bgdsl.ir.graph import Check, Experiment, Origin, Parameter
from bgdsl.ir.program import Assign, Event, Jacobian, Program, Record, Sparse, Step
from bgdsl.source import Source, Span

SOURCE = Source("hand.bg", "model Hand\n  Real x;\nend Hand;\n")
HERE = Origin("", Span(SOURCE, 13, 20))


def _differentiate(program: Program) -> Jacobian:
    """Plain differentiation, assignments substituted (test programs have no solved blocks where it is used)."""
    meaning: dict[Expr, Expr] = {}
    for step in program.steps:
        assert isinstance(step, Assign)
        (meaning[var(step.variable)],) = substitute((step.value,), meaning)
    entries = []
    for i, slope in enumerate(substitute(program.derivatives, meaning)):
        read = {leaf.data for leaf in leaves((slope,))}
        for j, state in enumerate(program.states):
            if state.name in read:
                entries.append((i, j, derivative(slope, var(state.name))))
    n = len(program.states)
    return Jacobian(Sparse((n, n), tuple(entries)), n)


def make_program(
    states: Mapping[str, tuple[Expr | float, Expr | float]],
    *,
    parameters: Mapping[str, Expr | float] | None = None,
    outputs: Mapping[str, Expr] | None = None,
    inputs: tuple[str, ...] = (),
    steps: tuple[Step, ...] = (),
    events: tuple[Expr, ...] = (),
    checks: tuple[tuple[Expr, str], ...] = (),
    invariants: tuple[Expr, ...] = (),
    experiments: tuple[Experiment, ...] = (),
    tables: Mapping[str, Table] | None = None,
    values: Mapping[str, Expr] | None = None,
    more_parameters: tuple[Parameter, ...] = (),
) -> Program:
    """A program with these states: name -> (start, derivative)."""

    def lift(value: Expr | float) -> Expr:
        return value if isinstance(value, Expr) else const(value)

    outputs = outputs or {}
    names = {name: var(name) for name in (*states, *inputs)}
    return Program(
        model="Hand",
        comment="",
        digest="0" * 64,
        parameters=(*(Parameter(name, (), (lift(value),), HERE) for name, value in (parameters or {}).items()), *more_parameters),
        tables=tables or {},
        states=tuple(Record(name) for name in states),
        starts=tuple(lift(start) for start, _ in states.values()),
        inputs=tuple(Record(name) for name in inputs),
        steps=steps,
        derivatives=tuple(lift(slope) for _, slope in states.values()),
        derivative_origins=(HERE,) * len(states),
        outputs=tuple((Record(name), value) for name, value in outputs.items()),
        bonds=(),
        values={**names, **outputs, **(values or {})},
        differentiate=_differentiate,
        events=tuple(Event(value, HERE) for value in events),
        checks=tuple(Check(condition, message, HERE) for condition, message in checks),
        invariants=tuple((value, HERE) for value in invariants),
        experiments=experiments,
    )


def decay() -> Program:
    """x' = -k x, x(0) = 1."""
    return make_program({"x": (1.0, -(param("k") * var("x")))}, parameters={"k": 1.0}, outputs={"y": var("x") * 2.0})


def oscillator() -> Program:
    """m x'' + k x = 0 from x = 1: x = cos(w t)."""
    return make_program({"q": (1.0, var("p") / param("m")), "p": (0.0, -(param("k") * var("q")))}, parameters={"m": 1.0, "k": 4.0})


def van_der_pol() -> Program:
    x, v = var("x"), var("v")
    return make_program({"x": (2.0, v), "v": (0.0, param("mu") * (1.0 - x * x) * v - x)}, parameters={"mu": 1.0})


def ball() -> Program:
    """A ball on a stiff one-sided spring: k acts below x = 0; without damping the energy stays."""
    x, v = var("x"), var("v")
    force = if_else(relation("lt", x, ZERO), -(param("k") * x), ZERO)
    return make_program({"x": (1.0, v), "v": (0.0, add((force, const(-9.81))))}, parameters={"k": 1e4}, events=(x,), outputs={"F": force})


def friction() -> Program:
    """A block pushed by cos(t), with Coulomb friction of 0.5."""
    return make_program({"v": (0.0, unary("cos", TIME) - 0.5 * unary("sign", var("v")))}, events=(var("v"),))


def compiled(program: Program):  # type: ignore[no-untyped-def]
    """The program as machine code."""
    from bgdsl.backends.native import build

    return build(program)
