"""A program evaluated as it stands, in Python: slow, and obviously right.

It fixes initial values (which is done once), and stands in for compiled code in tests (`DirectModel` keeps the protocol of
`ir.native.CompiledModel`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, MutableMapping, Sequence
from typing import TYPE_CHECKING

from bgdsl.expr import FUNCTIONS, RELATIONS, Expr, Table, topological
from bgdsl.ir.native import parameter_names
from bgdsl.ir.program import OFFSETS, Assign, Program, SolveLinear, SolveNewton, Step

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Ints = NDArray[np.int32]


class StepFailureError(ArithmeticError):
    """A step that could not be solved: `index` counts in the steps given; residual is NaN for a singular linear block."""

    def __init__(self, index: int, residual: float):
        super().__init__(f"step {index} failed, residual {residual:g}")
        self.index = index
        self.residual = residual


_OPERATORS: Mapping[str, Callable[..., float]] = {
    "add": lambda *terms: sum(terms[1:], terms[0]),
    "mul": lambda a, b: a * b,
    "div": lambda a, b: a / b,
    "neg": lambda a: -a,
    "not": lambda a: float(not a),
    "if": lambda c, a, b: a if c else b,
    **RELATIONS,
    **FUNCTIONS,
}


def _power(a: float, b: float) -> float:
    value = a**b
    return value if isinstance(value, float) else float("nan")


class Tape:
    """Expressions as a list of operations on numbered places; places that have no real value are NaN."""

    def __init__(self, roots: Sequence[Expr], tables: Mapping[str, Table]):
        place: dict[Expr, int] = {}
        self._work: list[float] = []
        self._leaves: list[tuple[int, str]] = []
        self._times: list[int] = []
        self._code: list[tuple[int, Callable[..., float], tuple[int, ...]]] = []
        for node in topological(roots):
            place[node] = k = len(self._work)
            self._work.append(float(node.data) if node.op == "const" else 0.0)
            match node.op:
                case "const":
                    pass
                case "param" | "var":
                    self._leaves.append((k, node.data))
                case "time":
                    self._times.append(k)
                case _:
                    self._code.append((k, _operation(node, tables), tuple(place[arg] for arg in node.args)))
        self._roots = [place[root] for root in roots]

    def __call__(self, values: Mapping[str, float], time: float) -> list[float]:
        work = self._work
        for k, name in self._leaves:
            work[k] = values[name]
        for k in self._times:
            work[k] = time
        for k, function, args in self._code:
            try:
                work[k] = function(*[work[i] for i in args])
            except (ArithmeticError, ValueError):
                work[k] = float("nan")
        return [work[k] for k in self._roots]


def _operation(node: Expr, tables: Mapping[str, Table]) -> Callable[..., float]:
    if node.op == "pow":
        return _power
    if node.op == "table":
        name, order = node.data
        return lambda x: tables[name](x, order)
    return _OPERATORS[node.op]


class Steps:
    """The steps of a program, ready to be carried out on a dictionary of values."""

    def __init__(self, steps: Sequence[Step], tables: Mapping[str, Table]):
        self._solvers = [_solver(step, tables) for step in steps]

    def __call__(self, values: MutableMapping[str, float], time: float) -> None:
        """Define every variable of the steps in `values`. StepFailureError where one cannot be solved."""
        for index, solve in enumerate(self._solvers):
            residual = solve(values, time)
            if residual is not None:
                raise StepFailureError(index, residual)


def _solver(step: Step, tables: Mapping[str, Table]) -> Callable[[MutableMapping[str, float], float], float | None]:
    match step:
        case Assign():
            tape = Tape((step.value,), tables)

            def assign(values: MutableMapping[str, float], time: float) -> float | None:
                (values[step.variable],) = tape(values, time)
                return None

            return assign
        case SolveLinear():
            return _linear(step, tables)
        case SolveNewton():
            return _newton(step, tables)


def _linear(step: SolveLinear, tables: Mapping[str, Table]) -> Callable[[MutableMapping[str, float], float], float | None]:
    import numpy as np

    tape = Tape((*(value for _, _, value in step.entries), *step.right), tables)
    n = len(step.variables)
    rows, columns = [i for i, _, _ in step.entries], [j for _, j, _ in step.entries]

    def solve(values: MutableMapping[str, float], time: float) -> float | None:
        numbers = tape(values, time)
        matrix = np.zeros((n, n))
        matrix[rows, columns] = numbers[: len(rows)]
        try:
            found = np.linalg.solve(matrix, np.array(numbers[len(rows) :]))
        except np.linalg.LinAlgError:
            return float("nan")
        values.update(zip(step.variables, found.tolist(), strict=True))
        return None

    return solve


def _newton(step: SolveNewton, tables: Mapping[str, Table]) -> Callable[[MutableMapping[str, float], float], float | None]:
    """Damped Newton from the last solution, or from the guesses; ends where the correction is at round-off."""
    import numpy as np

    guesses = Tape(step.guesses, tables)
    inner = Steps(step.inner, tables)
    residuals = Tape(step.residuals, tables)
    entries = Tape(tuple(value for _, _, value in step.entries), tables)
    rows, columns = [i for i, _, _ in step.entries], [j for _, j, _ in step.entries]
    n = len(step.variables)
    last: list[Floats] = []

    def residual_at(z: Floats, values: MutableMapping[str, float], time: float) -> Floats:
        values.update(zip(step.variables, z.tolist(), strict=True))
        inner(values, time)
        return np.array(residuals(values, time))

    def attempt(z: Floats, values: MutableMapping[str, float], time: float) -> float | None:
        r = residual_at(z, values, time)
        for _ in range(100):
            if not r.any():  # solved, whatever the derivatives are here
                last[:] = [z]
                return None
            matrix = np.zeros((n, n))
            matrix[rows, columns] = entries(values, time)
            if not (np.isfinite(matrix).all() and np.isfinite(r).all()):
                return float("nan")
            try:
                move = np.linalg.solve(matrix, r)
            except np.linalg.LinAlgError:
                return float(np.abs(r).max())
            factor = 1.0
            while True:
                new = z - factor * move
                r_new = residual_at(new, values, time)
                if np.isfinite(r_new).all() and (factor < 1e-3 or np.abs(r_new).max() <= np.abs(r).max()):
                    break
                factor /= 2.0
                if factor < 1e-12:
                    return float(np.abs(r).max())
            z, r = new, r_new
            if np.abs(move).max() <= 1e-13 * max(1.0, float(np.abs(z).max())):
                last[:] = [z]
                return None
        return float(np.abs(r).max())

    def solve(values: MutableMapping[str, float], time: float) -> float | None:
        if last and attempt(last[0], values, time) is None:
            return None
        first = np.array(guesses(values, time))
        left = None
        for offset in OFFSETS:
            left = attempt(first + offset * (1.0 + np.abs(first)), values, time)
            if left is None:
                return None
        return left

    return solve


class DirectKernel:
    """`ir.native.Kernel` in Python; it has no address."""

    address = 0

    def __init__(self, model: DirectModel, expressions: Sequence[Expr]):
        program = model.program
        steps = program.needed(expressions)
        self._numbers = [program.steps.index(step) + 1 for step in steps]
        self._steps = Steps(steps, program.tables)
        self._tape = Tape(tuple(expressions), program.tables)
        self._model = model
        self.size = len(expressions)

    def __call__(self, t: float, x: Floats, u: Floats, out: Floats) -> int:
        model = self._model
        values = dict(model.parameters)
        values.update(zip(model.state_names, x.tolist(), strict=True))
        values.update(zip(model.input_names, u.tolist(), strict=True))
        try:
            self._steps(values, t)
        except StepFailureError as failure:
            model.residual = failure.residual
            return self._numbers[failure.index]
        out[:] = self._tape(values, t)
        return 0


class DirectModel:
    """`ir.native.CompiledModel` in Python. A Jacobian with solved blocks is given as a full matrix."""

    context = 0

    def __init__(self, program: Program):
        import numpy as np

        self.program = program
        self.parameters: dict[str, float] = {}
        self.residual = float("nan")
        self.state_names = [record.name for record in program.states]
        self.input_names = [record.name for record in program.inputs]
        self.rhs = DirectKernel(self, program.derivatives)
        self._jacobian: DirectJacobian | None = None
        self._np = np

    def set_parameters(self, values: Floats) -> int:
        self.parameters = dict(zip(parameter_names(self.program), values.tolist(), strict=True))
        return 0

    def variant(self, program: Program) -> DirectModel:
        """Another program, evaluated the same way."""
        return DirectModel(program)

    def evaluator(self, expressions: Sequence[Expr]) -> DirectKernel:
        return DirectKernel(self, expressions)

    @property
    def jacobian(self) -> DirectJacobian:
        if self._jacobian is None:
            self._jacobian = DirectJacobian(self)
        return self._jacobian

    @property
    def pattern(self) -> tuple[Ints, Ints]:
        return self.jacobian.pattern


class DirectJacobian:
    """The Jacobian's values in compressed columns, solved blocks eliminated."""

    address = 0

    def __init__(self, model: DirectModel):
        import numpy as np

        matrix = model.program.jacobian.matrix
        n = model.program.jacobian.states
        self._kernel = DirectKernel(model, tuple(value for _, _, value in matrix.entries))
        self._rows = [i for i, _, _ in matrix.entries]
        self._columns = [j for _, j, _ in matrix.entries]
        self._shape, self._n = matrix.shape, n
        if matrix.shape == (n, n):
            places = sorted(zip(self._columns, self._rows, strict=True))
        else:
            places = [(j, i) for j in range(n) for i in range(n)]
        self._places = tuple(np.array([place[k] for place in places], dtype=int) for k in (1, 0))
        counts = np.bincount(self._places[1], minlength=n) if places else np.zeros(n, dtype=int)
        self.pattern = (np.concatenate(([0], np.cumsum(counts))).astype(np.int32), self._places[0].astype(np.int32))
        self.size = len(places)

    def __call__(self, t: float, x: Floats, u: Floats, out: Floats) -> int:
        import numpy as np

        numbers = np.empty(self._kernel.size)
        status = self._kernel(t, x, u, numbers)
        if status:
            return status
        full = np.zeros(self._shape)
        full[self._rows, self._columns] = numbers
        n = self._n
        if full.shape != (n, n):
            full = full[:n, :n] - full[:n, n:] @ np.linalg.solve(full[n:, n:], full[n:, :n])
        out[:] = full[self._places[0], self._places[1]]
        return 0
