"""Programs made by hand, and random ones, to hold the backends against each other."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

from hypothesis import strategies as st

from bgdsl.expr import ONE, TIME, ZERO, Expr, Table, add, binary, const, derivative, if_else, not_, param, relation, table, unary, var
from bgdsl.ir.graph import Origin, Parameter
from bgdsl.ir.program import Assign, Program, Record, SolveLinear, SolveNewton, Step
from bgdsl.passes.differentiate import jacobian
from bgdsl.source import Source, Span

SOURCE = Source("made.bg", "model Made\n  R damper(R = 2);\nend Made;\n")
ORIGIN = Origin("", Span(SOURCE, 13, 29))

UNEVEN = Table("uneven", (0.0, 0.4, 1.5, 2.0), ((1.0, -2.0, 0.5), (0.5, 0.1, 0.2), (1.0, 2.0, -3.0), (0.3, 0.2, 0.1)), False)
EVEN = Table("even", tuple(0.25 * k for k in range(9)), (tuple(math.cos(k) for k in range(8)), tuple(math.sin(k) for k in range(8))), True)
TABLES: Mapping[str, Table] = {"uneven": UNEVEN, "even": EVEN}


def parameter(name: str, *values: Expr | float, shape: tuple[int, ...] = (), unit: str = "", comment: str = "") -> Parameter:
    """A parameter with these defaults."""
    lifted = tuple(value if isinstance(value, Expr) else const(value) for value in values)
    return Parameter(name, shape, lifted, ORIGIN, unit=unit, comment=comment)


def program(
    states: Mapping[str, Expr],
    *,
    steps: Sequence[Step] = (),
    starts: Sequence[Expr] | None = None,
    parameters: Iterable[Parameter] = (),
    inputs: Iterable[str] = (),
    outputs: Mapping[str, Expr] | None = None,
    name: str = "Made",
    **more: object,
) -> Program:
    """A program from the derivative of each state."""
    made = Program(
        model=name,
        comment="",
        digest="0" * 64,
        parameters=tuple(parameters),
        tables=TABLES,
        states=tuple(Record(state, "kg.m/s", "a state") for state in states),
        starts=tuple(starts) if starts is not None else (ZERO,) * len(states),
        inputs=tuple(Record(name) for name in inputs),
        steps=tuple(steps),
        derivatives=tuple(states.values()),
        derivative_origins=(ORIGIN,) * len(states),
        outputs=tuple((Record(name), value) for name, value in (outputs or {}).items()),
        bonds=(),
        values={},
        differentiate=jacobian,
        **more,  # type: ignore[arg-type]
    )
    made.verify()
    return made


def newton(
    variables: Sequence[str], inner: Mapping[str, Expr], residuals: Sequence[Expr], guesses: Sequence[Expr] | None = None
) -> SolveNewton:
    """An iteration whose inner assignments are plain names for expressions over the unknowns."""
    from bgdsl.expr import substitute

    whole = list(residuals)
    for name, value in reversed(inner.items()):
        whole = list(substitute(whole, {var(name): value}))
    slopes = ((i, j, derivative(value, var(z))) for i, value in enumerate(whole) for j, z in enumerate(variables))
    return SolveNewton(
        tuple(variables),
        tuple(Assign(name, value, ORIGIN) for name, value in inner.items()),
        tuple(residuals),
        tuple((i, j, slope) for i, j, slope in slopes if not slope.is_zero),
        tuple(guesses) if guesses is not None else (ZERO,) * len(variables),
        ORIGIN,
        ", ".join(variables),
    )


def loops() -> Program:
    """A linear block, one with a constant matrix, and an iteration that reads both, chained."""
    m, k = param("m"), param("k")
    x, v = var("x"), var("v")
    steps = (
        Assign("a", -(k * x) / m, ORIGIN),
        Assign("b", unary("sin", x) * var("a") + if_else(relation("lt", x, const(0.3)), x**2.0, table("even", x * 7.0)), ORIGIN),
        SolveLinear(("z1", "z2"), ((0, 0, m), (0, 1, ONE), (1, 0, x), (1, 1, const(2.0))), (v, var("b")), ORIGIN, "z1, z2"),
        SolveLinear(
            ("c1", "c2", "c3"),
            ((0, 0, m), (0, 1, ONE), (1, 0, ONE), (1, 1, k), (1, 2, m), (2, 1, m), (2, 2, k * m)),
            (var("z1"), v, x),
            ORIGIN,
            "c1, c2, c3",
        ),
        newton(
            ("w", "y"),
            {"e": var("w") ** 3.0 + var("w")},
            (var("e") - v - var("z1"), var("y") + unary("tanh", var("y") * var("w")) - var("c2")),
        ),
    )
    return program(
        {"x": v / m, "v": var("b") + var("z2") + var("w") + var("e") + var("c3") * var("y")},
        steps=steps,
        parameters=(parameter("m", 2.0), parameter("k", m * 3.0)),
        outputs={"power": var("e") * v, "m": m},
        starts=(ONE, m),
    )


_LEAVES = (var("x"), var("v"), var("h"), param("a"), param("b"), TIME, var("u"))
_BOUNDED = ("sin", "cos", "tanh", "atan", "abs", "sign")


def _combine(children: st.SearchStrategy[Expr]) -> st.SearchStrategy[Expr]:
    two = st.tuples(children, children)
    comparison = st.builds(lambda name, pair: relation(name, *pair), st.sampled_from(("lt", "le")), two)
    condition = st.one_of(
        comparison,
        comparison.map(not_),
        st.builds(lambda name, a, b: relation(name, a, b), st.sampled_from(("and", "or")), comparison, comparison),
    )
    return st.one_of(
        two.map(lambda pair: pair[0] + pair[1]),
        two.map(lambda pair: pair[0] - pair[1]),
        two.map(lambda pair: pair[0] * pair[1]),
        two.map(lambda pair: pair[0] / (ONE + pair[1] * pair[1])),
        st.lists(children, min_size=3, max_size=5).map(add),
        st.builds(unary, st.sampled_from(_BOUNDED), children),
        st.builds(lambda name, pair: binary(name, *pair), st.sampled_from(("min", "max")), two),
        children.map(lambda a: unary("sqrt", ONE + a * a)),
        children.map(lambda a: unary("exp", unary("sin", a))),
        children.map(lambda a: unary("log", ONE + unary("abs", a))),
        st.builds(lambda a, n: unary("sin", a) ** float(n), children, st.sampled_from((2, 3, 4, 5))),
        children.map(lambda a: (ONE + unary("abs", a)) ** -0.5),
        st.builds(lambda c, pair: if_else(c, *pair), condition, two),
        st.builds(lambda c, a: c * a, condition, children),
        st.builds(lambda name, a: table(name, unary("atan", a)), st.sampled_from(("even", "uneven")), children),
    )


expressions = st.recursive(st.one_of(st.sampled_from(_LEAVES), st.floats(-3, 3).map(const)), _combine, max_leaves=12)


@st.composite
def programs(draw: st.DrawFn) -> Program:
    """A program over states x and v, an input u and parameters a and b, with assignments, a linear block and an iteration."""
    first = draw(expressions)
    bounded = [unary("sin", draw(expressions)) for _ in range(6)]
    diagonal = const(3.0)
    linear = SolveLinear(
        ("p1", "p2"),
        tuple((i, j, bounded[2 * i + j] + (diagonal if i == j else ZERO)) for i in range(2) for j in range(2)),
        (bounded[4], draw(expressions)),
        ORIGIN,
        "p1, p2",
    )
    w = var("w")
    iteration = newton(("w",), {"f": w + w**3.0}, (var("f") + unary("sin", w) * 0.5 - bounded[5] - unary("tanh", var("p1")),))
    steps = (
        Assign("h", draw(st.sampled_from((var("x") * param("a"), var("v") + TIME))), ORIGIN),
        Assign("g", first, ORIGIN),
        linear,
        iteration,
    )
    return program(
        {"x": var("g") + w * var("p2"), "v": draw(expressions) + var("f")},
        steps=steps,
        parameters=(parameter("a", draw(st.floats(-2, 2))), parameter("b", param("a") * 2.0 + 1.0)),
        inputs=("u",),
        outputs={"one": draw(expressions), "two": param("a") / param("b")},
    )
