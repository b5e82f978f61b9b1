"""Numbers that a program has before it runs: its parameters and the state in which it starts."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from bgdsl.backends.interpret import UnsolvableError, interpret
from bgdsl.backends.tape import Names, linearise, names
from bgdsl.ir.native import parameter_names
from bgdsl.ir.program import Program


def parameter_values(program: Program, changed: Mapping[str, float] | None = None) -> list[float]:
    """The value of every scalar parameter in the order of `parameter_names`; defaults follow what is changed before them."""
    changed = changed or {}
    meaning = names((), (), parameter_names(program), ())
    roots = [value for parameter in program.parameters for value in parameter.values]
    tape = linearise(meaning, program.tables, roots)
    values: list[float] = [math.nan] * len(roots)
    results: list[Any] = [math.nan] * len(tape.ops)
    done = 0
    for i, (name, root) in enumerate(zip(parameter_names(program), tape.roots, strict=True)):
        if root >= done:
            interpret(tape, range(done, root + 1), results, values)
            done = root + 1
        values[i] = float(changed[name]) if name in changed else float(results[root])
    return values


def start_values(program: Program, parameters: Sequence[float]) -> list[float]:
    """The initial state; NaN throughout where the initial equations have no solution."""
    meaning: Names = names((), (), parameter_names(program), program.initial_steps)
    tape = linearise(meaning, program.tables, program.starts)
    results: list[Any] = [math.nan] * len(tape.ops)
    try:
        interpret(tape, tape.order, results, parameters)
    except UnsolvableError:
        return [math.nan] * len(program.starts)
    return [float(results[k]) for k in tape.roots]
