"""Tables as IR: the piece is found by arithmetic where the grid is uniform, else by bisection; the polynomial by Horner."""

from __future__ import annotations

import math
from collections.abc import Sequence

from bgdsl.backends.native.numbers import literal
from bgdsl.expr import Table


def table_text(name: str, table: Table, order: int) -> str:
    """A function `name` of one number: the table's derivative of that order."""
    x = table.x
    pieces = len(x) - 1
    kept = coefficients(table, order)
    data = [_array(f"{name}_x", x), *(_array(f"{name}_c{k}", row) for k, row in enumerate(kept))]
    wrap = _wrap(x[0], x[-1] - x[0]) if table.periodic else ("%at = fadd double %x, 0.0",)
    find = _by_arithmetic(name, x) if is_uniform(x) else _by_bisection(name, pieces)
    lines = [*wrap, *find, *_fetch("left", f"{name}_x", len(x)), "%d = fsub double %at, %left"]
    value = "0.0"
    for k in range(len(kept)):
        lines += _fetch(f"c{k}", f"{name}_c{k}", pieces)
        if k == 0:
            value = "%c0"
        else:
            lines += (f"%m{k} = fmul contract double {value}, %d", f"%v{k} = fadd contract double %m{k}, %c{k}")
            value = f"%v{k}"
    body = "\n".join(lines)
    return "\n".join((*data, f"define internal double {name}(double %x) #0 {{\nentry:\n{body}\nret double {value}\n}}"))


def coefficients(table: Table, order: int) -> tuple[tuple[float, ...], ...]:
    """The coefficients of the derivative of that order, highest power first."""
    degree = len(table.c) - 1
    rows = (tuple(math.perm(degree - k, order) * c for c in table.c[k]) for k in range(degree + 1 - order))
    return tuple(rows)


def is_uniform(x: Sequence[float]) -> bool:
    """Whether dividing by the mean step finds the piece to within one."""
    step = (x[-1] - x[0]) / (len(x) - 1)
    return all(abs(x[0] + i * step - value) < 0.25 * step for i, value in enumerate(x))


def _array(name: str, values: Sequence[float]) -> str:
    numbers = ", ".join(f"double {literal(value)}" for value in values)
    return f"{name} = private unnamed_addr constant [{len(values)} x double] [{numbers}]"


def _fetch(result: str, array: str, count: int, index: str = "%i") -> tuple[str, str]:
    return (
        f"%{result}_at = getelementptr inbounds [{count} x double], ptr {array}, i64 0, i64 {index}",
        f"%{result} = load double, ptr %{result}_at, align 8",
    )


def _wrap(start: float, period: float) -> tuple[str, ...]:
    """x brought into the table's period, as Python's remainder does."""
    return (
        f"%from = fsub double %x, {literal(start)}",
        f"%part = frem double %from, {literal(period)}",
        "%negative = fcmp olt double %part, 0.0",
        f"%lifted = fadd double %part, {literal(period)}",
        "%remainder = select i1 %negative, double %lifted, double %part",
        f"%at = fadd double %remainder, {literal(start)}",
    )


def _by_arithmetic(name: str, x: Sequence[float]) -> tuple[str, ...]:
    """The guess from the mean step is off by one at most; compare with the grid to mend it."""
    last = len(x) - 2
    return (
        f"%scaled_from = fsub double %at, {literal(x[0])}",
        f"%scaled = fmul double %scaled_from, {literal((len(x) - 1) / (x[-1] - x[0]))}",
        "%guess = call i64 @llvm.fptosi.sat.i64.f64(double %scaled)",
        *_clamp("near", "guess", last),
        *_fetch("lower", f"{name}_x", len(x), "%near"),
        "%below = fcmp olt double %at, %lower",
        "%down = sext i1 %below to i64",
        "%after = add i64 %near, 1",
        *_fetch("upper", f"{name}_x", len(x), "%after"),
        "%above = fcmp oge double %at, %upper",
        "%up = zext i1 %above to i64",
        "%moved_down = add i64 %near, %down",
        "%moved = add i64 %moved_down, %up",
        *_clamp("i", "moved", last),
    )


def _clamp(result: str, value: str, last: int) -> tuple[str, ...]:
    return (
        f"%{result}_low = call i64 @llvm.smax.i64(i64 %{value}, i64 0)",
        f"%{result} = call i64 @llvm.smin.i64(i64 %{result}_low, i64 {last})",
    )


def _by_bisection(name: str, pieces: int) -> tuple[str, ...]:
    return (
        "br label %search",
        "search:",
        "%low = phi i64 [ 0, %entry ], [ %new_low, %search ]",
        f"%high = phi i64 [ {pieces}, %entry ], [ %new_high, %search ]",
        "%sum = add i64 %low, %high",
        "%middle = lshr i64 %sum, 1",
        *_fetch("there", f"{name}_x", pieces + 1, "%middle"),
        "%right = fcmp oge double %at, %there",
        "%new_low = select i1 %right, i64 %middle, i64 %low",
        "%new_high = select i1 %right, i64 %high, i64 %middle",
        "%width = sub i64 %new_high, %new_low",
        "%more = icmp sgt i64 %width, 1",
        "br i1 %more, label %search, label %found",
        "found:",
        "%i = add i64 %new_low, 0",
    )
