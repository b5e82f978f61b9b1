"""Run parts of a tape with Python floats: what reads parameters alone, once per parameter set.

Overflow and division by zero give what IEEE arithmetic gives (inf, nan), as the machine code and NumPy do.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from bgdsl.backends.tape import LinearSolve, NewtonSolve, Tape
from bgdsl.expr import FUNCTIONS, RELATIONS

_BINARY: Mapping[str, Callable[[float, float], float]] = {
    "mul": operator.mul,
    "div": operator.truediv,
    "pow": lambda a, b: math.pow(a, b),
    **RELATIONS,
    "atan2": math.atan2,
    "min": min,
    "max": max,
}
_UNARY: Mapping[str, Callable[[float], float]] = {
    "neg": operator.neg,
    "not": lambda a: float(not a),
    "square": lambda a: a * a,
    "cube": lambda a: a * a * a,
    "reciprocal": lambda a: 1.0 / a,
    **{name: function for name, function in FUNCTIONS.items() if name not in ("atan2", "min", "max")},
}


class UnsolvableError(ArithmeticError):
    """A block that has no solution at these values; `step` is its number, `residual` what an iteration left."""

    def __init__(self, step: int, residual: float = math.nan) -> None:
        super().__init__(f"step {step} has no solution")
        self.step = step
        self.residual = residual


def interpret(tape: Tape, order: Iterable[int], values: list[Any], parameters: Sequence[float]) -> None:
    """Fill `values[i]` for the operations of `order` (in order). UnsolvableError where a block cannot be solved."""
    ops, args, data = tape.ops, tape.args, tape.data
    for i in order:
        operands = args[i]
        op = ops[i]
        try:
            if op == "const":
                values[i] = data[i]
            elif op == "param":
                values[i] = parameters[data[i]]
            elif op == "sum":
                total = 0.0
                for k, negative in zip(operands, data[i], strict=True):
                    total = total - values[k] if negative else total + values[k]
                values[i] = total
            elif len(operands) == 2 and op in _BINARY:
                values[i] = _BINARY[op](values[operands[0]], values[operands[1]])
            elif op in _UNARY:
                values[i] = float(_UNARY[op](values[operands[0]]))
            else:
                values[i] = _special(tape, op, operands, data[i], values, parameters)
        except (ArithmeticError, ValueError) as error:
            if isinstance(error, UnsolvableError):
                raise
            values[i] = _ieee(op, [values[k] for k in operands])


def _special(tape: Tape, op: str, operands: tuple[int, ...], data: Any, values: list[Any], parameters: Sequence[float]) -> Any:
    match op:
        case "if":
            return values[operands[1]] if values[operands[0]] else values[operands[2]]
        case "table":
            return tape.tables[data[0]](values[operands[0]], data[1])
        case "linear":
            return _linear(data, values)
        case "newton":
            return _newton(tape, data, values, parameters)
        case "z":
            return values[operands[0]][data]
        case "time":
            return 0.0  # only starts are interpreted that read it
    raise AssertionError(op)


def _ieee(op: str, operands: list[float]) -> float:
    """The result where Python raises and IEEE arithmetic does not."""
    import numpy as np

    spelled: dict[str, Callable[..., Any]] = {
        "div": np.true_divide,
        "pow": np.power,
        "reciprocal": lambda a: np.true_divide(1.0, a),
        "square": np.square,
    }
    named: dict[str, Callable[..., Any]] = {"asin": np.arcsin, "acos": np.arccos, "atan": np.arctan, "cube": lambda a: a * a * a}
    with np.errstate(all="ignore"):
        function: Callable[..., Any] = spelled.get(op) or named.get(op) or getattr(np, op)
        return float(function(*(np.float64(value) for value in operands)))


def matrix(block: LinearSolve | NewtonSolve, values: Sequence[Any]) -> Any:
    """The block's matrix (or Jacobian), dense, (size, size)."""
    import numpy as np

    dense = np.zeros((block.size, block.size))
    for i, j, k in block.entries:
        dense[i, j] += values[k]
    return dense


def _solve(a: Any, b: Any, step: int) -> Any:
    import numpy as np

    try:
        z = np.linalg.solve(a, b)
    except np.linalg.LinAlgError:
        raise UnsolvableError(step) from None
    return z


def _linear(block: LinearSolve, values: list[Any]) -> list[float]:
    import numpy as np

    return [float(z) for z in _solve(matrix(block, values), np.array([values[k] for k in block.right]), block.step)]


def _newton(tape: Tape, block: NewtonSolve, values: list[Any], parameters: Sequence[float]) -> list[float]:
    """Damped Newton from the guesses, to round-off."""
    import numpy as np

    def residual(z: Any) -> Any:
        for place, value in zip(block.unknowns, z, strict=True):
            values[place] = float(value)
        interpret(tape, block.body, values, parameters)
        return np.array([values[k] for k in block.residuals])

    z = np.array([values[k] for k in block.guesses])
    f = residual(z)
    for _ in range(100):
        step = _solve(matrix(block, values), f, block.step)
        size = 1.0
        while True:
            new = z - size * step
            tried = residual(new)
            if np.linalg.norm(tried) <= (1 - 0.1 * size) * np.linalg.norm(f) or size < 1e-4:
                break
            size /= 2
        done = np.all(np.abs(new - z) <= 1e-13 * np.abs(new) + 1e-300) or not np.any(tried)
        stuck = size < 1e-4
        if stuck and np.all(np.abs(step) <= 1e-9 * (np.abs(z) + 1e-9)):
            residual(z)
            return [float(value) for value in z]
        if stuck:
            break
        z, f = new, tried
        if done:
            return [float(value) for value in z]
    raise UnsolvableError(block.step, float(np.max(np.abs(f))))
