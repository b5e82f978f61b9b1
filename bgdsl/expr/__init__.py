"""Scalar expressions: the one form that flattening makes and every later floor reads.

An `Expr` is an immutable node of a shared graph. Equal expressions are one object (hash-consing), so common
subexpressions cost nothing to find, identity is equality, and dictionaries keyed by expressions are fast. The
constructors fold constants and drop neutral terms; they never reorder what the user wrote further than that.

Arrays are NumPy object arrays of `Expr`; they end where flattening ends. Booleans are 1.0 and 0.0.

`nodes` makes them, `walk` goes over them and rebuilds them, `evaluation` gives their numbers, `calculus` their derivatives, `text` their
spelling. Everything is imported from here.
"""

from bgdsl.expr.calculus import derivative, linear_parts, partials
from bgdsl.expr.evaluation import Table, evaluate
from bgdsl.expr.nodes import (
    FUNCTIONS,
    MINUS_ONE,
    ONE,
    RELATIONS,
    TIME,
    ZERO,
    Expr,
    add,
    binary,
    const,
    if_else,
    not_,
    param,
    relation,
    table,
    unary,
    var,
)
from bgdsl.expr.text import to_text
from bgdsl.expr.walk import leaves, rebuild, rewrite, substitute, topological, variables

__all__ = [
    "FUNCTIONS",
    "MINUS_ONE",
    "ONE",
    "RELATIONS",
    "TIME",
    "ZERO",
    "Expr",
    "Table",
    "add",
    "binary",
    "const",
    "derivative",
    "evaluate",
    "if_else",
    "leaves",
    "linear_parts",
    "not_",
    "param",
    "partials",
    "rebuild",
    "relation",
    "rewrite",
    "substitute",
    "table",
    "to_text",
    "topological",
    "unary",
    "var",
    "variables",
]
