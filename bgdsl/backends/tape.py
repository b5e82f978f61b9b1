"""Expressions and the steps they need, as one numbered list of operations.

Input        Program's steps, and the expressions wanted (roots)
Output       Tape: operations in an order in which each reads earlier ones only, roots by number
Establishes  every operation is listed once; only what the roots need is listed; each knows whether it is the same for all
             states (`PARAMETRIC`: a constant, or made of parameters alone) or not (`VARYING`)
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from bgdsl.expr import FUNCTIONS, Expr, Table, topological, var
from bgdsl.ir.program import Assign, SolveLinear, SolveNewton, Step, read

PARAMETRIC = 1
VARYING = 2

LEAVES = frozenset(("x", "u", "time", "const", "param"))
RELATIONS = frozenset(("lt", "le", "eq", "ne", "and", "or", "not"))


@dataclass(slots=True)
class LinearSolve:
    """A z = b: (row, column, operation) of A's entries, operations of b. `factored`: A is parametric while b is not.

    The unknowns are in the order of `sparse_first`, not in the step's.
    """

    step: int
    size: int
    entries: tuple[tuple[int, int, int], ...]
    right: tuple[int, ...]
    factored: bool


@dataclass(slots=True)
class NewtonSolve:
    """residuals(z) = 0: `body` are the operations to do anew for each z, `unknowns` the operations that stand for z.

    `offset` is where z is among all iterated unknowns of the program, so that different tapes share their starts.
    """

    step: int
    size: int
    offset: int
    unknowns: tuple[int, ...]
    body: tuple[int, ...]
    residuals: tuple[int, ...]
    entries: tuple[tuple[int, int, int], ...]
    guesses: tuple[int, ...]


@dataclass(slots=True)
class Tape:
    """Operation i is `ops[i]` of the operations `args[i]`, with `data[i]`; `levels[i]` is PARAMETRIC or VARYING.

    Operations beside those of `Expr`: `x` and `u` (a state, an input: data is its index), `sum` (data: the sign of each
    operand), `linear` and `newton` (data: the block), `z` (component `data` of the block it reads), `cube`, `square`.
    `order` lists all but the bodies of iterations.
    """

    tables: Mapping[str, Table]
    ops: list[str] = field(default_factory=list)
    args: list[tuple[int, ...]] = field(default_factory=list)
    data: list[Any] = field(default_factory=list)
    levels: list[int] = field(default_factory=list)
    order: list[int] = field(default_factory=list)
    roots: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class Names:
    """What variables mean: states, inputs and parameters by index; others by the expression that defines them (`values`) or by
    the number of the step that solves for them and their place in it (`solved`).

    offsets: for an iterated step, where its unknowns are among those of all iterations (there are `iterated` in all).
    """

    states: Mapping[str, int]
    inputs: Mapping[str, int]
    parameters: Mapping[str, int]
    steps: Sequence[Step]
    values: Mapping[str, Expr]
    solved: Mapping[str, tuple[int, int]]
    offsets: Mapping[int, int]
    iterated: int


def names(states: Iterable[str], inputs: Iterable[str], parameters: Iterable[str], steps: Sequence[Step]) -> Names:
    """The meaning of every variable of a program with these steps."""
    values: dict[str, Expr] = {}
    solved: dict[str, tuple[int, int]] = {}
    offsets: dict[int, int] = {}
    total = 0
    for k, step in enumerate(steps):
        if isinstance(step, Assign):
            values[step.variable] = step.value
            continue
        solved |= {name: (k, i) for i, name in enumerate(step.variables)}
        if isinstance(step, SolveNewton):
            values |= {assign.variable: assign.value for assign in step.inner}
            offsets[k] = total
            total += len(step.variables)
    return Names(_index(states), _index(inputs), _index(parameters), steps, values, solved, offsets, total)


def _index(names: Iterable[str]) -> Mapping[str, int]:
    return {name: i for i, name in enumerate(names)}


def linearise(meaning: Names, tables: Mapping[str, Table], roots: Sequence[Expr]) -> Tape:
    """The operations that give the roots."""
    builder = _Builder(meaning, Tape(tables))
    for root in roots:
        builder.visit(root)
    builder.tape.roots = tuple(builder.ids[root] for root in roots)
    return builder.tape


class _Builder:
    """Depth first with an explicit stack: an operation comes soon after its operands, so values are used while at hand."""

    def __init__(self, meaning: Names, tape: Tape) -> None:
        self.meaning = meaning
        self.tape = tape
        self.ids: dict[Expr, int] = {}
        self.blocks: dict[int, int] = {}
        self.bodies: dict[int, _Body] = {}
        self.ranks: dict[int, Sequence[int]] = {}

    def visit(self, root: Expr) -> None:
        """Place what the root needs, then the root. The plain case is written out here: this loop sees every node there is."""
        ids = self.ids
        ops, all_args, data, levels, order = self.tape.ops, self.tape.args, self.tape.data, self.tape.levels, self.tape.order
        stack = [root]
        while stack:
            node = stack[-1]
            if node in ids:
                stack.pop()
                continue
            is_plain = node.op in _PLAIN
            wanted = node.args if is_plain else self.operands(node)
            missing = [child for child in wanted if child not in ids]
            if missing:
                missing.reverse()
                stack += missing
                continue
            stack.pop()
            if not is_plain:
                ids[node] = self.place(node, wanted)
                continue
            args = tuple([ids[child] for child in wanted])
            ids[node] = len(ops)
            order.append(len(ops))
            ops.append(node.op)
            all_args.append(args)
            data.append(node.data)
            level = PARAMETRIC
            for arg in args:
                if levels[arg] == VARYING:
                    level = VARYING
            levels.append(level)

    def operands(self, node: Expr) -> Sequence[Expr]:
        return self.read_by(node.data) if node.op == "var" else operands(node)

    def read_by(self, name: str) -> Sequence[Expr]:
        """What has to be known before a variable is."""
        if name in self.meaning.values:
            return (self.meaning.values[name],)
        number, _ = self.meaning.solved.get(name, (None, 0))
        if number is None or number in self.blocks:
            return ()
        step = self.meaning.steps[number]
        return self.body(number, step).outside if isinstance(step, SolveNewton) else read(step)

    def body(self, number: int, step: SolveNewton) -> _Body:
        if number not in self.bodies:
            self.bodies[number] = _split(step)
        return self.bodies[number]

    def emit(self, op: str, args: tuple[int, ...], data: Any, level: int, *, listed: bool = True) -> int:
        tape = self.tape
        number = len(tape.ops)
        tape.ops.append(op)
        tape.args.append(args)
        tape.data.append(data)
        tape.levels.append(level)
        if listed:
            tape.order.append(number)
        return number

    def place(self, node: Expr, operands: Sequence[Expr], ids: Mapping[Expr, int] | None = None, *, listed: bool = True) -> int:
        """The new operation for a node whose operands are placed."""
        known = self.ids if ids is None else ids
        op = node.op
        if op == "var":
            return self.place_variable(node.data)
        args = tuple([known[child] for child in operands])
        levels = self.tape.levels
        level = PARAMETRIC
        for arg in args:
            if levels[arg] == VARYING:
                level = VARYING
        data = node.data
        match op:
            case "add":
                op, data = "sum", tuple([arg.op == "neg" for arg in node.args])
            case "param":
                data = self.meaning.parameters[node.data]
            case "time":
                level = VARYING
            case "pow" if len(args) == 1:
                return self.place_power(args[0], node.args[1].data, level, listed)
            case _:
                pass
        return self.emit(op, args, data, level, listed=listed)

    def place_power(self, base: int, exponent: float, level: int, listed: bool) -> int:
        for op in _POWERS[exponent]:
            base = self.emit(op, (base,), None, level, listed=listed)
        return base

    def place_variable(self, name: str) -> int:
        meaning = self.meaning
        if name in meaning.states:
            return self.emit("x", (), meaning.states[name], VARYING)
        if name in meaning.inputs:
            return self.emit("u", (), meaning.inputs[name], VARYING)
        if name in meaning.values:
            return self.ids[meaning.values[name]]
        number, place = meaning.solved[name]
        if number not in self.blocks:
            self.blocks[number] = self.place_block(number, meaning.steps[number])
        block = self.blocks[number]
        ranks = self.ranks.get(number)
        return self.emit("z", (block,), place if ranks is None else ranks[place], self.tape.levels[block])

    def place_block(self, number: int, step: Step) -> int:
        assert not isinstance(step, Assign)
        return self.place_linear(number, step) if isinstance(step, SolveLinear) else self.place_newton(number, step)

    def place_linear(self, number: int, step: SolveLinear) -> int:
        ids, levels = self.ids, self.tape.levels
        ranks = self.ranks[number] = sparse_first([(i, j) for i, j, _ in step.entries], len(step.right))
        entries = tuple((i, ranks[j], ids[value]) for i, j, value in step.entries)
        right = tuple(ids[value] for value in step.right)
        matrix = max(levels[k] for _, _, k in entries)
        level = max(matrix, *(levels[k] for k in right))
        block = LinearSolve(number, len(right), entries, right, matrix < level)
        return self.emit("linear", (*(k for _, _, k in entries), *right), block, level)

    def place_newton(self, number: int, step: SolveNewton) -> int:
        body = self.body(number, step)
        level = max((self.tape.levels[self.ids[node]] for node in body.outside), default=PARAMETRIC)
        first = len(self.tape.ops)
        ids: dict[Expr, int] = _Chained(self.ids)
        unknowns = []
        for k, variable in enumerate(body.unknowns):
            ids[variable] = self.emit("unknown", (), k, level, listed=False)
            unknowns.append(ids[variable])
        for node in body.inside:
            if node.op == "var":
                ids[node] = ids[body.values[node]]
            else:
                place = self.place(node, operands(node), ids, listed=False)
                self.tape.levels[place] = level
                ids[node] = place
        block = NewtonSolve(
            number,
            len(step.variables),
            self.meaning.offsets[number],
            tuple(unknowns),
            tuple(range(first + len(unknowns), len(self.tape.ops))),
            tuple(ids[value] for value in step.residuals),
            tuple((i, j, ids[value]) for i, j, value in step.entries),
            tuple(ids[value] for value in step.guesses),
        )
        return self.emit("newton", tuple(sorted({ids[node] for node in body.outside})), block, level)


def operands(node: Expr) -> Sequence[Expr]:
    """What an operation reads: signs are taken into sums, small exponents into the operation."""
    if node.op == "add":
        return [arg.args[0] if arg.op == "neg" else arg for arg in node.args]
    if node.op == "pow" and node.args[1].op == "const" and node.args[1].data in _POWERS:
        return node.args[:1]
    return node.args


def sparse_first(entries: Iterable[tuple[int, int]], size: int) -> Sequence[int]:
    """For each column of a matrix its place in an order in which columns with few entries come first.

    Elimination in that order fills in little: for the multipliers of an engine's joints it does a sixth of the work.
    """
    counts = [0] * size
    for _, j in entries:
        counts[j] += 1
    ranks = [0] * size
    for rank, j in enumerate(sorted(range(size), key=lambda j: (counts[j], j))):
        ranks[j] = rank
    return ranks


class _Chained(dict[Expr, int]):
    """A dictionary that looks into an outer one for what it lacks."""

    def __init__(self, outer: Mapping[Expr, int]) -> None:
        super().__init__()
        self.outer = outer

    def __missing__(self, key: Expr) -> int:
        return self.outer[key]


_PLAIN = frozenset(("const", "mul", "div", "neg", "if", "table", *RELATIONS, *FUNCTIONS))
"""Operations that are listed as they are."""

_POWERS: Mapping[float, tuple[str, ...]] = {
    2.0: ("square",),
    3.0: ("cube",),
    4.0: ("square", "square"),
    -1.0: ("reciprocal",),
    -2.0: ("square", "reciprocal"),
    -3.0: ("cube", "reciprocal"),
    0.5: ("sqrt",),
    -0.5: ("sqrt", "reciprocal"),
}
"""Powers with a cheaper spelling."""


@dataclass(frozen=True, slots=True)
class _Body:
    """The nodes of an iteration that depend on its unknowns, operands first, and what they read from outside."""

    unknowns: tuple[Expr, ...]
    inside: tuple[Expr, ...]
    outside: tuple[Expr, ...]
    values: Mapping[Expr, Expr]


def _split(step: SolveNewton) -> _Body:
    unknowns = tuple(var(name) for name in step.variables)
    values = {var(assign.variable): assign.value for assign in step.inner}
    depends = set(unknowns)
    seen: set[Expr] = set(unknowns)
    inside: list[Expr] = []
    outside: dict[Expr, None] = {}
    roots = (*step.residuals, *(value for _, _, value in step.entries))
    for root in (*(root for pair in values.items() for root in reversed(pair)), *roots):
        for node in topological((root,)):
            if node in seen:
                continue
            seen.add(node)
            reads = (values[node],) if node in values else operands(node)
            if any(arg in depends for arg in reads):
                depends.add(node)
                inside.append(node)
                outside.update((arg, None) for arg in reads if arg not in depends)
    outside.update((root, None) for root in (*roots, *step.guesses) if root not in depends)
    return _Body(unknowns, tuple(inside), tuple(outside), values)
