"""What a run makes of a program before it starts, made once: the next run of the same program finds it ready."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from functools import wraps
from typing import TypeVar

from bgdsl.ir.program import Program

Made = TypeVar("Made")


def once_for_program(make: Callable[[Program], Made]) -> Callable[[Program], Made]:
    """`make`, carried out once for each program and kept while that lives; what it makes may not hold the program itself."""
    kept: dict[int, Made] = {}

    @wraps(make)
    def found(program: Program) -> Made:
        key = id(program)
        if key not in kept:
            kept[key] = make(program)
            weakref.finalize(program, kept.pop, key, None)
        return kept[key]

    return found
