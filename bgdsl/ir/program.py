"""The lowered program: what every backend spells and every simulation runs. No target is known here.

Evaluation: states, parameters, inputs and time are given; `steps` define variables one after another; everything else
(`derivatives`, `outputs`, `bonds`, `events`, ...) is an expression over those. A backend keeps of the steps what the wanted
expressions need, computes what reads parameters only once per parameter set, and shares equal nodes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

from bgdsl.collecting import uncollected
from bgdsl.expr import Expr, Table, leaves, topological, variables
from bgdsl.ir.graph import Check, Experiment, Origin, Parameter


@dataclass(frozen=True, slots=True)
class Assign:
    """variable := value."""

    variable: str
    value: Expr
    origin: Origin


@dataclass(frozen=True, slots=True)
class SolveLinear:
    """The variables z with A z = b: `entries` are A's structurally nonzero (row, column, value), `right` is b."""

    variables: tuple[str, ...]
    entries: tuple[tuple[int, int, Expr], ...]
    right: tuple[Expr, ...]
    origin: Origin
    name: str
    symmetric: bool = False


@dataclass(frozen=True, slots=True)
class SolveNewton:
    """The variables z with residuals(z) = 0: `inner` assigns in order what the residuals read beside z; `entries` is the exact
    Jacobian of the residuals by z (row, column, value); `guesses` start the iteration where no earlier solution is at hand."""

    variables: tuple[str, ...]
    inner: tuple[Assign, ...]
    residuals: tuple[Expr, ...]
    entries: tuple[tuple[int, int, Expr], ...]
    guesses: tuple[Expr, ...]
    origin: Origin
    name: str


Step = Assign | SolveLinear | SolveNewton

OFFSETS = (0.0, 0.01, -0.01, 1.0, -1.0)
"""How far from the guesses iterations begin, in shares of 1 + abs(guess): the next where one fails. A law may have no derivative, or
no value, at the guess itself, as sqrt(x) and log(x) at 0."""


@dataclass(frozen=True, slots=True)
class Record:
    """A named scalar of the model's surface: a state, an output, an input, a bond."""

    name: str
    unit: str = ""
    comment: str = ""


@dataclass(frozen=True, slots=True)
class Sparse:
    """A matrix by its structurally nonzero entries, sorted by (row, column)."""

    shape: tuple[int, int]
    entries: tuple[tuple[int, int, Expr], ...]


@dataclass(frozen=True, slots=True)
class Jacobian:
    """Exact derivatives with solved blocks cut out.

    The columns are the n states, then every variable z of the SolveLinear and SolveNewton steps that the derivatives need
    (`Program.needed(derivatives)`), in order; the rows are the n derivatives, then every residual of those steps in order (A z - b
    for linear ones). With F the first n rows and G the rest,
    dxdot/dx = F_x - F_z inv(G_z) G_x; G_z is block lower triangular. Without loops it is F_x, ready to use.
    The entries may read the program's variables.
    """

    matrix: Sparse
    states: int


@dataclass(frozen=True, slots=True)
class Event:
    """A function of the state that changes sign where the equations change form."""

    value: Expr
    origin: Origin


@dataclass(frozen=True)
class Program:
    """A compiled model, ready to be spelled.

    parameters: in order, with defaults over earlier ones. starts: initial states over parameters (and over the variables of
    `initial_steps`, which solve initial equations; they read parameters, time and what they define themselves, the other
    states included). outputs: (record, value). bonds: (record, effort, flow), one per scalar
    component of each flat bond, efforts and flows positive from tail to head. values: every variable that can be asked for by
    its scalar name, states included. invariants: expressions that stay zero (constraints), dependent: (name, the value its
    start must have, the start the user gave or None). unstarted: the states that the user gave no start. terms: (effort, flow)
    expressions for activity are built by that pass.

    `differentiate` makes the Jacobian of a program (`passes/differentiate.py`). Read it as `program.jacobian`: it is computed
    when first asked for and kept, since a run with an Adams method, or a listing, has no need of it.
    """

    model: str
    comment: str
    digest: str
    parameters: tuple[Parameter, ...]
    tables: Mapping[str, Table]
    states: tuple[Record, ...]
    starts: tuple[Expr, ...]
    inputs: tuple[Record, ...]
    steps: tuple[Step, ...]
    derivatives: tuple[Expr, ...]
    derivative_origins: tuple[Origin, ...]
    outputs: tuple[tuple[Record, Expr], ...]
    bonds: tuple[tuple[Record, Expr, Expr], ...]
    values: Mapping[str, Expr]
    differentiate: Callable[[Program], Jacobian]
    initial_steps: tuple[Step, ...] = ()
    events: tuple[Event, ...] = ()
    checks: tuple[Check, ...] = ()
    invariants: tuple[tuple[Expr, Origin], ...] = ()
    unstarted: frozenset[str] = frozenset()
    dependent: tuple[tuple[str, Expr, Expr | None], ...] = ()
    experiments: tuple[Experiment, ...] = ()
    sizes: Mapping[str, int] = field(default_factory=dict)

    @cached_property
    def jacobian(self) -> Jacobian:
        """The exact derivatives of the state derivatives and of the solved blocks."""
        with uncollected():
            return self.differentiate(self)

    @cached_property
    def invariant_slopes(self) -> Sparse:
        """The exact derivatives of the invariants by the states, a row each. They read no solved blocks."""
        with uncollected():
            matrix = self.differentiate(replace(self, derivatives=tuple(value for value, _ in self.invariants))).matrix
        assert matrix.shape == (len(self.invariants), len(self.states)), "invariants read no solved blocks"
        return matrix

    @cached_property
    def is_driven(self) -> bool:
        """Whether the states are moved by functions of time."""
        roots = [*self.derivatives, *(value for step in self.needed(self.derivatives) for value in read(step))]
        return any(True for _ in leaves(roots, "time"))

    @cached_property
    def has_upright_roots(self) -> bool:
        """Whether the derivatives hold roots that may come to stand upright: `sqrt(abs(x))`, `if x > 0 then x^0.3 else 0`."""
        nodes = list(topological([*self.derivatives, *(value for step in self.needed(self.derivatives) for value in read(step))]))
        signed = {arg for node in nodes if node.op in ("lt", "le") for arg in node.args}
        return any(
            node.op == "sqrt" or (node.op == "pow" and node.args[1].is_const and 0.0 < node.args[1].data < 1.0)
            for node in nodes
            if node.args and (node.args[0].op in ("abs", "max") or not signed.isdisjoint((node.args[0], -node.args[0])))
        )

    def needed(self, roots: Iterable[Expr]) -> tuple[Step, ...]:
        """The steps that the roots need, in order."""
        return needed(self.steps, roots)

    def verify(self) -> None:
        """Assert: each variable is defined once, before it is read."""
        known = {record.name for record in (*self.states, *self.inputs)}
        for step in self.steps:
            own = {assign.variable for assign in step.inner} if isinstance(step, SolveNewton) else set()
            if not isinstance(step, Assign):
                own |= set(step.variables) if isinstance(step, SolveNewton) else set()
            for leaf in leaves(read(step)):
                assert leaf.data in known or leaf.data in own, f"{leaf.data} is read before it is defined"
            assert known.isdisjoint(defined(step)), f"{defined(step)} is defined twice"
            known |= set(defined(step))
        for leaf in leaves(self.derivatives):
            assert leaf.data in known, leaf.data


def needed(steps: Sequence[Step], roots: Iterable[Expr]) -> tuple[Step, ...]:
    """Those of the steps that the roots need, in order."""
    wanted = set(variables(roots))
    kept: list[Step] = []
    for step in reversed(steps):
        if not wanted.isdisjoint(defined(step)):
            kept.append(step)
            wanted.update(variables(read(step)))
    return tuple(reversed(kept))


def defined(step: Step) -> tuple[str, ...]:
    """The variables that a step defines."""
    match step:
        case Assign():
            return (step.variable,)
        case SolveLinear():
            return step.variables
        case SolveNewton():
            return (*step.variables, *(assign.variable for assign in step.inner))


def read(step: Step) -> tuple[Expr, ...]:
    """Every expression of a step."""
    match step:
        case Assign():
            return (step.value,)
        case SolveLinear():
            return (*(value for _, _, value in step.entries), *step.right)
        case SolveNewton():
            inner = tuple(assign.value for assign in step.inner)
            return (*inner, *step.residuals, *(value for _, _, value in step.entries), *step.guesses)


Target = Literal["numpy", "native"]
