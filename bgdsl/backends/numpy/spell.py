"""Expressions and steps as lines of Python for NumPy.

Input        Program, Namespace
Output       Speller.lines: the lines of one function, in order
Establishes  each shared expression is computed once; lines are short; values may be numbers or rows of an ensemble
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from bgdsl.backends.numpy.names import Namespace, printable
from bgdsl.expr import Expr, Table, topological, var
from bgdsl.ir.graph import Origin
from bgdsl.ir.native import parameter_names
from bgdsl.ir.program import Assign, Program, SolveLinear, SolveNewton, Step, needed, read

WIDTH = 96
"""Characters after which an expression gets a name of its own instead of growing on."""

_FUNCTIONS: Mapping[str, str] = {
    "asin": "arcsin",
    "acos": "arccos",
    "atan": "arctan",
    "atan2": "arctan2",
    "min": "minimum",
    "max": "maximum",
    "and": "logical_and",
    "or": "logical_or",
    "not": "logical_not",
}
_SIGNS: Mapping[str, str] = {"lt": "<", "le": "<=", "eq": "==", "ne": "!="}
_RELATIONS = frozenset(("lt", "le", "eq", "ne", "and", "or", "not"))
_COMPARISON, _SUM, _PRODUCT, _SIGN, _ATOM = 1, 2, 3, 4, 9


def operands(node: Expr) -> Sequence[Expr]:
    """What the spelling of a node shows: a small whole power shows its base only."""
    if node.op == "pow" and node.args[1].op == "const" and node.args[1].data in (2.0, 3.0, -1.0, -2.0, 0.5):
        return node.args[:1]
    if node.op == "add":
        return [arg.args[0] if arg.op == "neg" else arg for arg in node.args]
    return node.args


@dataclass(slots=True)
class Names:
    """The Python names of a program's variables and parameters, the same in every function of the module."""

    namespace: Namespace
    parameters: Mapping[str, str]
    fetches: Mapping[str, str]
    variables: Mapping[str, str]
    tables: Mapping[str, str]

    @staticmethod
    def of(program: Program, taken: Iterable[str]) -> Names:
        space = Namespace(taken)
        scalars = parameter_names(program)
        variables = {record.name: space.take(record.name) for record in (*program.states, *program.inputs)}
        parameters = {name: space.take(name) for name in scalars}
        for step in (*program.initial_steps, *program.steps):
            for name in _all_names(step):
                if name not in variables:
                    variables[name] = space.take(name)
        first: dict[Table, str] = {}
        tables = {
            name: first.get(table) or first.setdefault(table, space.take(f"table_{name}")) for name, table in contents(program).items()
        }
        return Names(space, parameters, dict(_fetches(program)), variables, tables)


def contents(program: Program) -> Mapping[str, Table]:
    """The tables without their names: equal ones are written once."""
    return {name: replace(table, name="") for name, table in program.tables.items()}


def _fetches(program: Program) -> Iterator[tuple[str, str]]:
    """How the function finds each scalar parameter in `p`."""
    for parameter in program.parameters:
        for k, name in enumerate(parameter.scalars()):
            yield name, f"p[{parameter.name!r}]" + "".join(f"[{i}]" for i in _unravel(k, parameter.shape))


def _unravel(k: int, shape: Sequence[int]) -> list[int]:
    found: list[int] = []
    for size in reversed(shape):
        k, i = divmod(k, size)
        found.insert(0, i)
    return found


def _all_names(step: Step) -> Iterator[str]:
    match step:
        case Assign():
            yield step.variable
        case SolveLinear():
            yield from step.variables
        case SolveNewton():
            yield from step.variables
            yield from (assign.variable for assign in step.inner)


class Speller:
    """Writes one function: fetches, then steps, then whatever the caller asks to be stored."""

    def __init__(self, program: Program, names: Names, steps: Sequence[Step], roots: Sequence[Expr], *, comments: bool = True) -> None:
        self.program = program
        self.names = names
        self.steps = needed(steps, roots)
        self.roots = roots
        self.comments = comments
        self.space = names.namespace.copy()
        self.lines: list[str] = []
        self.texts: dict[Expr, tuple[str, int]] = {}
        self.plain: dict[Expr, bool] = {}
        self.place: tuple[str, str, int] | None = None
        self.defined = {name for step in self.steps for name in _all_names(step)}
        self.counts = self._count()

    def _count(self) -> Counter[Expr]:
        """How often each node is written if nothing is named."""
        counts: Counter[Expr] = Counter()
        seen: set[Expr] = set()
        stack = [*(value for step in self.steps for value in read(step)), *self.roots]
        counts.update(stack)
        while stack:
            node = stack.pop()
            if node in seen:
                continue
            seen.add(node)
            shown = operands(node)
            counts.update(shown)
            if node.op == "pow" and len(shown) == 1 and node.args[1].data in (2.0, 3.0, -2.0):
                counts[shown[0]] += 1
            stack += shown
        self.seen = seen
        return counts

    # ------------------------------------------------------------------------------------------------------ statements

    def fetch(self) -> None:
        """Give names to the parameters, states and inputs that are read."""
        used = {node.data for node in self.seen if node.op == "param"}
        for name, python in self.names.parameters.items():
            if name in used:
                self.lines.append(f"{python} = {self.names.fetches[name]}")
        read_names = {node.data for node in self.seen if node.op == "var"} - self.defined
        for array, records in (("x", self.program.states), ("u", self.program.inputs)):
            for i, record in enumerate(records):
                if record.name in read_names:
                    self.lines.append(f"{self.names.variables[record.name]} = {array}[{i}]")

    def run(self) -> None:
        """Write all steps."""
        for step in self.steps:
            self.comment(step.origin)
            match step:
                case Assign():
                    self.assign(step.variable, step.value)
                case SolveLinear():
                    self.linear(step)
                case SolveNewton():
                    self.newton(step)

    def assign(self, variable: str, value: Expr) -> None:
        """Name a value by its variable, now and wherever the same value comes again."""
        target = self.names.variables[variable]
        self.prepare(value)
        self.lines += f"{target} = {self.number(value, 0)}".split("\n")
        self.plain[var(variable)] = self.is_plain(value)
        if value.args:
            self.texts[value] = target, _ATOM

    def set(self, target: str, value: Expr, note: str = "") -> None:
        """Store a value; the note is a comment behind it, or before it where the line is long."""
        lines = f"{target} = {self.text(value)}".split("\n")
        if note and len(lines[-1]) + len(note) > WIDTH:
            self.lines.append(f"# {printable(note)}")
        elif note:
            lines[-1] += f"  # {printable(note)}"
        self.lines += lines

    def comment(self, origin: Origin) -> None:
        """The line of the source that what follows comes from, unless it is the one said last."""
        if not self.comments:
            return
        span = origin.span
        place = (origin.path, span.source.name, span.line)
        if place == self.place:
            return
        self.place = place
        inside = f" in {origin.path}" if origin.path else ""
        self.lines += ("", f"# {printable(f'{span.source.name}:{span.line}{inside}', 160)}: {printable(span.source.line(span.line))}")

    def linear(self, step: SolveLinear) -> None:
        n = len(step.variables)
        a, b = self.space.take("A"), self.space.take("b")
        self.lines += (f"{a} = np.zeros(({n}, {n}) + shape)", f"{b} = np.empty(({n},) + shape)")
        for i, j, value in step.entries:
            self.set(f"{a}[{i}, {j}]", value)
        for i, value in enumerate(step.right):
            self.set(f"{b}[{i}]", value)
        self.unpack(step.variables, f"_linear({a}, {b}, {step.name!r}, t)")

    def unpack(self, variables: Sequence[str], value: str) -> None:
        if len(variables) == 1:
            self.lines.append(f"{self.names.variables[variables[0]]} = {value}[0]")
            return
        z = self.space.take("z")
        self.lines.append(f"{z} = {value}")
        self.lines += (f"{self.names.variables[name]} = {z}[{i}]" for i, name in enumerate(variables))

    def newton(self, step: SolveNewton) -> None:
        """The iteration's residuals and Jacobian as a function inside this one; then what it assigned on the way."""
        n = len(step.variables)
        guesses = [self.text(guess) for guess in step.guesses]
        inner = self.nested()
        function, z, f, jacobian = (self.space.take(name) for name in ("loop", "z", "f", "J"))
        inner.lines += (f"{self.names.variables[name]} = {z}[{i}]" for i, name in enumerate(step.variables))
        for assign in step.inner:
            inner.assign(assign.variable, assign.value)
        inner.lines += (f"{f} = np.empty(({n},) + shape)", f"{jacobian} = np.zeros(({n}, {n}) + shape)")
        for i, value in enumerate(step.residuals):
            inner.set(f"{f}[{i}]", value)
        for i, j, value in step.entries:
            inner.set(f"{jacobian}[{i}, {j}]", value)
        self.lines += ("", f"def {function}({z}):", *(f"    {line}" for line in inner.lines), f"    return {f}, {jacobian}", "")
        self.unpack(step.variables, f"_newton({function}, [{', '.join(guesses)}], {step.name!r}, t, shape)")
        for assign in step.inner:
            self.assign(assign.variable, assign.value)

    def nested(self) -> Speller:
        """A speller for a function inside this one: it sees what is named here; what it names is its own."""
        made = object.__new__(Speller)
        made.__dict__.update(self.__dict__)
        made.lines = []
        made.texts = dict(self.texts)
        made.plain = dict(self.plain)
        made.comments = False
        return made

    # ----------------------------------------------------------------------------------------------------- expressions

    def text(self, root: Expr) -> str:
        """The expression as Python text; shared parts of it, itself included, are written out as lines first."""
        if root not in self.texts:
            self.prepare(root)
            if self.counts[root] > 1 and root.args:
                self.texts[root] = self.named(root, self.texts[root])
        return self.texts[root][0]

    def prepare(self, root: Expr) -> None:
        """Work out the text of a node, naming shared parts of it on the way."""
        texts = self.texts
        stack = [root]
        while stack:
            node = stack[-1]
            if node in texts:
                stack.pop()
                continue
            missing = [arg for arg in operands(node) if arg not in texts]
            if missing:
                missing.reverse()
                stack += missing
                continue
            stack.pop()
            texts[node] = self.named(node, self.spell(node)) if node.args and node is not root else self.spell(node)

    def named(self, node: Expr, spelled: tuple[str, int]) -> tuple[str, int]:
        """What to write for a node: its spelling, or the name of a line just written for it."""
        cheap = node.op == "neg" and not node.args[0].args
        if (self.counts[node] <= 1 or cheap) and len(spelled[0]) <= WIDTH:
            return spelled
        arg = node.args[0]
        hint = f"{node.op}_{self.texts[arg][0]}" if len(node.args) == 1 and self.texts[arg][0].isidentifier() else "s"
        name = self.space.take(hint if len(hint) < 40 else "s")
        self.lines += f"{name} = {spelled[0]}".split("\n")
        return name, _ATOM

    def is_plain(self, node: Expr) -> bool:
        """Whether a node is made of parameters alone, so that it may be a Python number."""
        known = self.plain
        for inner in topological((node,), known):
            known[inner] = inner.op not in ("var", "time") and all(known[arg] for arg in inner.args)
        return known[node]

    def wrapped(self, node: Expr, least: int) -> str:
        text, precedence = self.texts[node]
        return text if precedence >= least else f"({text})"

    def number(self, node: Expr, least: int) -> str:
        """An operand of arithmetic: truth values become numbers first."""
        if node.op in _RELATIONS:
            text = f"1.0*{self.wrapped(node, _ATOM)}"
            return text if least <= _PRODUCT else f"({text})"
        return self.wrapped(node, least)

    def spell(self, node: Expr) -> tuple[str, int]:
        """The text of a node whose operands have theirs, and how tightly it binds."""
        args = node.args
        match node.op:
            case "const":
                return _number(node.data)
            case "param":
                return self.names.parameters[node.data], _ATOM
            case "var":
                return self.names.variables[node.data], _ATOM
            case "time":
                return "t", _ATOM
            case "add":
                text = self.sum(node)
                return text, _ATOM if text.endswith("\n)") else _SUM
            case "mul":
                return f"{self.number(args[0], _PRODUCT)}*{self.number(args[1], _SIGN)}", _PRODUCT
            case "div":
                if self.is_plain(node):
                    return f"np.divide({self.number(args[0], 0)}, {self.number(args[1], 0)})", _ATOM
                return f"{self.number(args[0], _PRODUCT)}/{self.number(args[1], _SIGN)}", _PRODUCT
            case "neg":
                return f"-{self.number(args[0], _SIGN)}", _SIGN
            case "pow":
                return self.power(node)
            case "if":
                return f"np.where({self.flag(args[0])}, {self.number(args[1], 0)}, {self.number(args[2], 0)})", _ATOM
            case "table":
                name, order = node.data
                return f"_look_up({self.names.tables[name]}, {self.number(args[0], 0)}, {order})", _ATOM
            case op if op in _SIGNS:
                return f"{self.number(args[0], _SUM)} {_SIGNS[op]} {self.number(args[1], _SUM)}", _COMPARISON
            case "and" | "or" | "not" as op:
                return f"np.{_FUNCTIONS[op]}({', '.join(self.flag(arg) for arg in args)})", _ATOM
            case op:
                return f"np.{_FUNCTIONS.get(op, op)}({', '.join(self.number(arg, 0) for arg in args)})", _ATOM

    def flag(self, node: Expr) -> str:
        return self.texts[node][0] if node.op in _RELATIONS else f"{self.number(node, _SUM)} != 0.0"

    def sum(self, node: Expr) -> str:
        pieces: list[str] = []
        for k, arg in enumerate(node.args):
            minus = arg.op == "neg"
            text = self.number(arg.args[0], _PRODUCT) if minus else self.number(arg, _PRODUCT if k else _SUM)
            if not minus and k and text.startswith("-"):
                minus, text = True, text[1:]
            pieces.append(("- " if minus else "+ " if k else "") + text if k else f"-{text}" if minus else text)
        return self.broken(pieces)

    def broken(self, pieces: list[str]) -> str:
        """The terms of a sum on one line, or, in parentheses, on several."""
        if sum(len(piece) + 1 for piece in pieces) <= WIDTH + 20:
            return " ".join(pieces)
        lines, current = [], ""
        for piece in pieces:
            if current and len(current) + len(piece) > WIDTH:
                lines.append(current)
                current = ""
            current = f"{current} {piece}" if current else piece
        return "(\n    " + "\n    ".join((*lines, current)) + "\n)"

    def power(self, node: Expr) -> tuple[str, int]:
        base, exponent = node.args
        shown = self.number(base, _ATOM)
        if len(operands(node)) == 1:
            match exponent.data:
                case 2.0:
                    return f"{shown}*{shown}", _PRODUCT
                case 3.0:
                    return f"{shown}*{shown}*{shown}", _PRODUCT
                case 0.5:
                    return f"np.sqrt({self.number(base, 0)})", _ATOM
                case -1.0:
                    return f"np.divide(1.0, {self.number(base, 0)})", _ATOM
                case _:
                    return f"np.divide(1.0, {shown}*{shown})", _ATOM
        return f"np.power({self.number(base, 0)}, {self.number(exponent, 0)})", _ATOM


def _number(value: float) -> tuple[str, int]:
    if value - value != 0.0:
        return f"np.float64({str(value)!r})", _ATOM
    return repr(value), _ATOM if repr(value)[0] != "-" else _SIGN
