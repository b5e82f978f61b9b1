"""Direct evaluation of a program, expression by expression: the plainest meaning of its steps, as an oracle for backends."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from bgdsl.expr import Expr, evaluate
from bgdsl.ir.graph import Parameter
from bgdsl.ir.program import Assign, Program, SolveLinear, SolveNewton, Step


class Direct:
    """A program with the values of its parameters, evaluated at states and times."""

    def __init__(self, program: Program, **changed: float):
        self.program = program
        self.parameters = parameter_values(program.parameters, changed, program.tables)

    def initial_state(self) -> np.ndarray:
        """The initial state, initial equations solved."""
        known: dict[str, float] = {}
        self._run(self.program.initial_steps, known, 0.0)
        return np.array([self._value(start, known, 0.0) for start in self.program.starts])

    def variables(self, x: Sequence[float], t: float = 0.0, roots: Iterable[Expr] | None = None) -> dict[str, float]:
        """Every variable of the steps that the roots (by default: all steps) need, states included."""
        known = {r.name: float(v) for r, v in zip(self.program.states, x, strict=True)}
        self._run(self.program.steps if roots is None else self.program.needed(roots), known, t)
        return known

    def rhs(self, x: Sequence[float], t: float = 0.0) -> np.ndarray:
        known = self.variables(x, t, self.program.derivatives)
        return np.array([self._value(d, known, t) for d in self.program.derivatives])

    def value(self, root: Expr | str, x: Sequence[float], t: float = 0.0) -> float:
        """The value of an expression, or of the variable with this name."""
        root = self.program.values[root] if isinstance(root, str) else root
        return self._value(root, self.variables(x, t, (root,)), t)

    def jacobian(self, x: Sequence[float], t: float = 0.0) -> np.ndarray:
        """The exact Jacobian, solved blocks eliminated."""
        jacobian = self.program.jacobian
        known = self.variables(x, t)
        full = np.zeros(jacobian.matrix.shape)
        for i, j, value in jacobian.matrix.entries:
            full[i, j] = self._value(value, known, t)
        n = jacobian.states
        outer = full[:n, :n]
        return outer if full.shape[0] == n else outer - full[:n, n:] @ np.linalg.solve(full[n:, n:], full[n:, :n])

    def _value(self, root: Expr, known: Mapping[str, float], t: float) -> float:
        return evaluate(root, known, time=t, tables=self.program.tables, parameters=self.parameters)

    def _run(self, steps: Iterable[Step], known: dict[str, float], t: float) -> None:
        for step in steps:
            match step:
                case Assign():
                    known[step.variable] = self._value(step.value, known, t)
                case SolveLinear():
                    matrix = np.zeros((len(step.variables), len(step.variables)))
                    for i, j, value in step.entries:
                        matrix[i, j] = self._value(value, known, t)
                    right = [self._value(value, known, t) for value in step.right]
                    known |= dict(zip(step.variables, np.linalg.solve(matrix, right).tolist(), strict=True))
                case SolveNewton():
                    self._newton(step, known, t)

    def _newton(self, step: SolveNewton, known: dict[str, float], t: float) -> None:
        z = np.array([self._value(guess, known, t) for guess in step.guesses])
        for _ in range(100):
            known |= dict(zip(step.variables, z.tolist(), strict=True))
            self._run(step.inner, known, t)
            residual = np.array([self._value(value, known, t) for value in step.residuals])
            matrix = np.zeros((len(z), len(z)))
            for i, j, value in step.entries:
                matrix[i, j] = self._value(value, known, t)
            change = np.linalg.solve(matrix, residual)
            z = z - change
            if np.max(np.abs(change)) <= 1e-14 * (1.0 + np.max(np.abs(z))):
                known |= dict(zip(step.variables, z.tolist(), strict=True))
                return self._run(step.inner, known, t)
        raise ArithmeticError(f"{step.name}: no convergence, residual {residual}")


def parameter_values(parameters: Iterable[Parameter], changed: Mapping[str, float], tables: Mapping[str, object]) -> dict[str, float]:
    """Every scalar parameter by name, defaults evaluated in order."""
    known: dict[str, float] = {}
    for parameter in parameters:
        for name, value in zip(parameter.scalars(), parameter.values, strict=True):
            known[name] = changed[name] if name in changed else evaluate(value, known, tables=tables)  # type: ignore[arg-type]
    return known
