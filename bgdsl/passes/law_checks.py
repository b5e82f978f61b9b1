"""What must hold of the values of elements, whatever law they make.

Input        ElementPart, its value as rows of expressions
Output       nothing
Establishes  junction structures keep power, storage matrices are symmetric and positive definite, nothing that divides is zero
Reports      BG254 EJS not skew, BG255 not symmetric positive definite, BG256 zero
"""

from __future__ import annotations

import random

import numpy as np

from bgdsl.diagnostics import Code
from bgdsl.expr import Expr, evaluate, topological
from bgdsl.ir.elements import component
from bgdsl.passes.parts import Build, ElementPart, Fault, Reported
from bgdsl.passes.shapes import unknowns_of
from bgdsl.source import Span

NOT_SKEW = Code("BG254", "an Euler junction structure is not power-free")
NOT_DEFINITE = Code("BG255", "a storage matrix is not symmetric and positive definite")
ZERO_VALUE = Code("BG256", "an element's value is zero")

Rows = tuple[tuple[Expr, ...], ...]
"""The value of an element as a matrix, port 2 by port 1; of a one-port, square."""

MAY_VANISH = {("R", "R"), ("G", "R"), ("k", "C")}
"""The values, by their name and the element's kind, that may be zero."""


def check_rows(build: Build, part: ElementPart, name: str, rows: Rows, span: Span) -> None:
    """A value as it is written: not zero throughout, skew or definite where the kind asks for it; faults are raised."""
    if part.kind.name == "EJS":
        _check_skew(build, part, rows, span)
        return
    if all(entry.is_zero for row in rows for entry in row) and (name, part.kind.name) not in MAY_VANISH:
        raise zero_value(part, name, span)
    if len(rows) > 1 and part.kind.name in ("I", "C"):
        _check_definite(build, part, name, rows, span)


def zero_value(part: ElementPart, name: str, span: Span) -> Fault:
    """The fault of an element whose value is zero though its kind divides by it."""
    meaning = {
        "I": "an I without inertia fixes no flow: leave it out",
        "C": "a C without compliance is rigid: leave it out",
    }.get(part.kind.name, "it joins nothing: leave it out")
    return Fault(ZERO_VALUE, f"`{name}` of {part.kind.name} `{part.name}` is zero", span, "zero", helps=(meaning,))


def check_numbers(build: Build, part: ElementPart) -> None:
    """With every default known: no scalar inertia, compliance, modulus or ratio is zero."""
    for name in part.parameters:
        path = f"{part.name}.{name}"
        made = build.parameters.get(path)
        if made is None or (name, part.kind.name) in MAY_VANISH or not part.kind.inward:
            continue
        names = (path,) if not made.shape else tuple(component(path, i) for i in range(made.shape[0]))
        if any(build.numbers.get(scalar) == 0.0 for scalar in names) and (part.kind.ports == 1 or len(names) == 1):
            span = next((entry.nested[name].span for entry, _, _ in part.claims if name in entry.nested), part.member.span)
            build.fault(zero_value(part, name, span), part.origin.path)


def _check_skew(build: Build, part: ElementPart, rows: Rows, span: Span) -> None:
    for i, row in enumerate(rows):
        for j in range(i + 1):
            if not _vanishes(build, row[j] + rows[j][i]):
                where = f"[{i + 1},{j + 1}]"
                raise Fault(
                    NOT_SKEW,
                    f"`G` of EJS `{part.name}` is not skew: G{where} is not -G[{j + 1},{i + 1}]",
                    span,
                    "wants G = -transpose(G)",
                    notes=("an Euler junction structure neither makes nor takes power",),
                    helps=("write it with `skew(...)`", "what does take power is an R"),
                )


def _vanishes(build: Build, expression: Expr) -> bool:
    """Whether an expression is zero whatever its leaves are: by its form, else at a few random points."""
    if expression.is_zero:
        return True
    if expression.is_const:
        return False
    chance = random.Random(1)
    nodes = list(topological((expression,)))
    names = [node.data for node in nodes if node.op in ("var", "param")]
    tried = 0
    for _ in range(12):
        values = {name: chance.uniform(0.2, 1.4) for name in names}
        try:
            total = evaluate(expression, values, time=chance.uniform(0.2, 1.4), tables=build.tables)
        except (ArithmeticError, ValueError):
            continue
        if not abs(total) < 1e-9:
            return False
        tried += 1
        if tried == 4:
            break
    return tried > 0


def _check_definite(build: Build, part: ElementPart, name: str, rows: Rows, span: Span) -> None:
    for i, row in enumerate(rows):
        for j in range(i):
            if row[j] is not rows[j][i] and not _equal_by_default(build, row[j], rows[j][i], span):
                raise Fault(
                    NOT_DEFINITE,
                    f"`{name}` of `{part.name}` is not symmetric: [{i + 1},{j + 1}] is not [{j + 1},{i + 1}]",
                    span,
                    "not symmetric",
                    notes=("otherwise it would make energy out of nothing",),
                )
    if build.part or any(unknowns_of(entry) for row in rows for entry in row):
        return
    try:
        numbers = np.array([[build.number(entry, span, structural=False) for entry in row] for row in rows])
    except Reported:
        return
    least = float(np.linalg.eigvalsh(numbers)[0])
    floor = -1e-12 * float(np.abs(numbers).max()) if name == "k" else 0.0
    if least < floor or (least == 0.0 and name != "k"):
        raise Fault(
            NOT_DEFINITE,
            f"`{name}` of `{part.name}` is not positive definite: its smallest eigenvalue is {least:g}",
            span,
            "with the parameters' default values",
        )


def _equal_by_default(build: Build, a: Expr, b: Expr, span: Span) -> bool:
    if _vanishes(build, a - b):
        return True
    try:
        x, y = (build.number(value, span, structural=False) for value in (a, b))
    except (Reported, Fault):
        return False
    return abs(x - y) <= 1e-12 * max(abs(x), abs(y))
