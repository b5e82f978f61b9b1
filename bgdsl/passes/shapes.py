"""What expressions evaluate to: single expressions, or NumPy object arrays of them, and the leaves that names stand for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bgdsl.expr import Expr, leaves, topological, var
from bgdsl.ir.elements import component
from bgdsl.ir.graph import scalar_names


@dataclass(frozen=True, slots=True)
class TableName:
    """A table as a value: its name in the graph's tables."""

    name: str


Value = Any
"""What an expression is: an `Expr`, a `str`, a `TableName`, or a NumPy object array of these."""


def parameters_of(root: Expr) -> tuple[str, ...]:
    """The scalar names of the parameters that an expression reads."""
    if root.op == "const":
        return ()
    if root.op == "param":
        return (root.data,)
    return tuple(leaf.data for leaf in leaves((root,), "param"))


def unknowns_of(root: Expr) -> tuple[Expr, ...]:
    """The leaves of an expression that change during a run: variables and time."""
    if root.op in ("const", "param"):
        return ()
    return tuple(node for node in topological((root,)) if node.op in ("var", "time"))


def leaves_of(make: Any, name: str, shape: tuple[int, ...]) -> Value:
    """The leaves of a named array as an object array, or the one leaf of a scalar; `make` is `expr.param` or `expr.var`."""
    if not shape:
        return make(name)
    return array_of([make(scalar) for scalar in scalar_names(name, shape)], shape)


LARGEST_ARRAY = 10_000_000
"""Arrays with more entries are refused rather than tried."""


def array_of(items: Sequence[Any], shape: tuple[int, ...]) -> np.ndarray[Any, Any]:
    """An object array of that shape (one dimension at least) from its entries, row-major."""
    assert shape
    made = np.empty(len(items), dtype=object)
    for i, item in enumerate(items):
        made[i] = item
    return made.reshape(shape)


def shape_of(value: Value) -> tuple[int, ...]:
    """The shape of a value; a scalar has the empty one."""
    return value.shape if isinstance(value, np.ndarray) else ()


def entries(value: Value) -> tuple[Any, ...]:
    """The entries of a value, row-major; a scalar is its own one entry."""
    return tuple(value.flat) if isinstance(value, np.ndarray) else (value,)


def vector(name: str, size: int | None) -> Value:
    """The variable `name` of a port or junction: a leaf, or a vector of leaves."""
    if size is None:
        return var(name)
    return array_of([var(component(name, i)) for i in range(size)], (size,))


def shown_shape(shape: tuple[int, ...]) -> str:
    """A shape in words."""
    match shape:
        case ():
            return "a scalar"
        case (n,):
            return f"a vector of {n}"
        case _:
            return f"an array of {' x '.join(map(str, shape))}"
