"""The flat bond graph: what remains of the classes once every instance is made, every port joined, every name resolved.

Flat things are named by their dotted path (`cyl[2].crankpin.spring`), the one identity that every later floor keeps.
Scalar variables are named `vA.f`, `F2.e` (junctions), `spring.e`, `spring.q[2]` (one-ports), `lever.p1.f` (two-ports),
`q1.b.e` (ports of user elements), `phi`, `block.R[1,2]` (signals); see `elements.component`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from bgdsl.expr import Expr, Table
from bgdsl.ir.domains import Domain
from bgdsl.ir.elements import component
from bgdsl.source import Source, Span


@dataclass(frozen=True, slots=True)
class Origin:
    """Where a flat thing comes from: the instance whose class wrote it ("" for the model itself) and the place in the text.

    Of a bond, so that a reduction finds the very link again: `link` is (number of the arrow in its chain, number of the end in
    its fan), both from 0, and `loop` the values of the iterators of the `for` statements around it, outermost first; `part`
    are the components of that link (from 0) which the bond has, None for all of them.
    """

    path: str
    span: Span
    link: tuple[int, int] | None = None
    loop: tuple[int, ...] = ()
    part: tuple[int, ...] | None = None


@dataclass(frozen=True, slots=True)
class Junction:
    """`kind` 0: common effort `name.e`; 1: common flow `name.f`. `size` None is scalar, n a vector of n components."""

    name: str
    kind: Literal[0, 1]
    size: int | None
    origin: Origin
    domain: str = "Generic"
    open: bool = False
    comment: str = ""

    def variable(self, i: int = 0) -> str:
        """The scalar name of the common variable of component i (from 0)."""
        return component(f"{self.name}.{'ef'[self.kind]}", i if self.size is not None else None)


@dataclass(frozen=True, slots=True)
class Port:
    """An element's port: `name` is "" for a one-port, `p1`, `p2` for a two-port, the user's name for a user element's.

    `inward`: power at this port is counted into the element.
    """

    name: str
    size: int | None
    inward: bool
    domain: str = "Generic"

    @property
    def width(self) -> int:
        return 1 if self.size is None else self.size

    def variable(self, element: str, letter: str, i: int = 0) -> str:
        """The scalar name of `e` or `f` (or a storage's `p`, `q`) at component i (from 0) of this port."""
        base = f"{element}.{self.name}.{letter}" if self.name else f"{element}.{letter}"
        return component(base, i if self.size is not None else None)


@dataclass(frozen=True, slots=True)
class Law:
    """left = right, between an element's own variables and what it reads; usually `left` is the variable it is written for."""

    left: Expr
    right: Expr
    origin: Origin


@dataclass(frozen=True, slots=True)
class Element:
    """A primitive, or a user `element` (kind "field").

    laws: sources `x.e = ...`; storages between f and p (I) or e and q (C), one law a component; R between e and f; a field's
    own. TF and GY have none: `modulus` is their n2 x n1 matrix (EJS: n x n), an entry that is identically zero is `expr.ZERO`.
    states: a storage's state variables in order (`spring.q[1]`, ...). starts: initial values by variable (`p`, `q`, or the
    co-energy variable `f`, `e`) as the user gave them; what is not given is 0.
    linear: for I, C and R the matrix of the linear law with the parameter it came from (`("k", rows)`), else None.
    """

    name: str
    kind: str
    ports: tuple[Port, ...]
    origin: Origin
    laws: tuple[Law, ...] = ()
    modulus: tuple[tuple[Expr, ...], ...] | None = None
    linear: tuple[str, tuple[tuple[Expr, ...], ...]] | None = None
    states: tuple[str, ...] = ()
    starts: Mapping[str, Expr] = field(default_factory=dict)
    parasitic: bool = False
    comment: str = ""


@dataclass(frozen=True, slots=True)
class End:
    """One end of a bond: a junction or an element's port (`port` is its index), with the components joined, from 0."""

    node: str
    port: int
    components: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Bond:
    """Positive power flows from `tail` to `head`. `size` None is scalar.

    A bond that runs through ports is the fusion of several statements: `name` is that of the statement nearest to its
    head, `aliases` are the other names, `origins` all the statements from tail to head. `declared`: the domain of each model
    port on the way, with the place of its declaration.
    """

    name: str
    tail: End
    head: End
    size: int | None
    origins: tuple[Origin, ...]
    aliases: tuple[str, ...] = ()
    stroke: Literal["tail", "head"] | None = None
    domain: str = "Generic"
    declared: tuple[tuple[str, Origin], ...] = ()

    @property
    def width(self) -> int:
        return 1 if self.size is None else self.size


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter or constant. `values` (row-major, one for a scalar) read other parameters only.

    structural: its value shaped the graph (a size, a condition), so changing it means to flatten again.
    """

    name: str
    shape: tuple[int, ...]
    values: tuple[Expr, ...]
    origin: Origin
    unit: str = ""
    comment: str = ""
    low: tuple[Expr, ...] | None = None
    high: tuple[Expr, ...] | None = None
    structural: bool = False
    constant: bool = False
    integer: bool = False

    def scalars(self) -> tuple[str, ...]:
        """The scalar names of its entries, row-major."""
        return scalar_names(self.name, self.shape)


@dataclass(frozen=True, slots=True)
class Signal:
    """A declared variable (`Real`), scalar or array; `starts` where given, row-major.

    role: `state` if some equation has its `der`, `input` for inputs, else `algebraic`. `output` marks outputs.
    """

    name: str
    shape: tuple[int, ...]
    role: Literal["state", "algebraic", "input"]
    origin: Origin
    starts: tuple[Expr, ...] | None = None
    output: bool = False
    unit: str = ""
    comment: str = ""

    def scalars(self) -> tuple[str, ...]:
        return scalar_names(self.name, self.shape)


def array_of_entry(name: str) -> str:
    """The array to which a scalar name belongs: of `a[1].n[2]` it is `a[1].n`; a scalar's own name where it is of none."""
    return name.rpartition("[")[0] if name.endswith("]") else name


def scalar_names(name: str, shape: tuple[int, ...]) -> tuple[str, ...]:
    """The scalar names of an array's entries, row-major: `R[1,1]`, `R[1,2]`, ...; a scalar's is its own name."""
    names = [""]
    for size in shape:
        names = [f"{before},{i + 1}" for before in names for i in range(size)]
    return tuple(f"{name}[{indices[1:]}]" if indices else name for indices in names)


@dataclass(frozen=True, slots=True)
class SignalEquation:
    """left = right between scalars. `der(x)` of a state x appears as the variable `der(x)`."""

    left: Expr
    right: Expr
    origin: Origin


@dataclass(frozen=True, slots=True)
class Check:
    """An `assert` of the model: the run stops where the condition is false."""

    condition: Expr
    message: str
    origin: Origin


@dataclass(frozen=True, slots=True)
class Experiment:
    """A named run. `changes` maps scalar parameter names to expressions over parameters; settings left out are None.

    window: the interval over which activity is measured, None for the whole run. fits: False where its other changes make sense only
    in the structure that it gives the model (entries of larger arrays, say): it is run after flattening for it. resized: new values of
    arrays without a declared size, `Integer n[:]`, that get another one: their new shapes and entries, row-major.
    """

    name: str
    origin: Origin
    stop_time: float | None = None
    interval: float | None = None
    tolerance: float | None = None
    method: str | None = None
    window: tuple[float, float] | None = None
    changes: Mapping[str, Expr] = field(default_factory=dict)
    comment: str = ""
    fits: bool = True
    resized: Mapping[str, tuple[tuple[int, ...], tuple[Expr, ...]]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Instance:
    """A component that is an instance of a model or element: its class's name, where that class is defined, and where the
    component is declared (None for the model itself). `class_span` identifies the definition in its source."""

    path: str
    class_name: str
    class_span: Span
    declared: Origin | None
    comment: str = ""


@dataclass(frozen=True, slots=True)
class BondGraph:
    """A flat model. Everything is in declaration order; names are unique.

    sources: every file read, the model's own first. domains: those that the model's files define.
    units: of storages' states by scalar name, as far as the unit check found them.
    """

    model: str
    comment: str
    sources: tuple[Source, ...]
    instances: tuple[Instance, ...]
    junctions: tuple[Junction, ...]
    elements: tuple[Element, ...]
    bonds: tuple[Bond, ...]
    parameters: tuple[Parameter, ...]
    signals: tuple[Signal, ...]
    equations: tuple[SignalEquation, ...]
    initial_equations: tuple[SignalEquation, ...] = ()
    checks: tuple[Check, ...] = ()
    tables: Mapping[str, Table] = field(default_factory=dict)
    experiments: tuple[Experiment, ...] = ()
    warnings: tuple[str, ...] = ()
    domains: tuple[Domain, ...] = ()
    units: Mapping[str, str] = field(default_factory=dict)

    def verify(self) -> None:
        """Assert the promise of this form: unique names, every bond joins existing ends of matching width, every component
        of every element port has exactly one bond."""
        names = [thing.name for things in (self.junctions, self.elements) for thing in things]
        assert len(names) == len(set(names)), "two nodes have one name"
        widths: dict[tuple[str, int], int] = {(j.name, 0): 1 if j.size is None else j.size for j in self.junctions}
        ports: set[tuple[str, int, int]] = set()
        for element in self.elements:
            for k, port in enumerate(element.ports):
                widths[element.name, k] = port.width
                ports |= {(element.name, k, i) for i in range(port.width)}
        junctions = {j.name for j in self.junctions}
        joined: set[tuple[str, int, int]] = set()
        for bond in self.bonds:
            for end in (bond.tail, bond.head):
                assert len(end.components) == bond.width, bond.name
                assert all(0 <= i < widths[end.node, end.port] for i in end.components), bond.name
                if end.node not in junctions:
                    spots = {(end.node, end.port, i) for i in end.components}
                    assert not spots & joined, f"{bond.name} ends where another bond does"
                    joined |= spots
        assert joined == ports, f"unjoined: {sorted(ports - joined)[:3]}"
