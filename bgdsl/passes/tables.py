"""Tables: from points, in a CSV file or written out, to piecewise polynomials.

Input        `table(...)` as written: a path or points, the columns, the kind (`linear` or `cubic`), periodic or not
Output       expr.Table
Establishes  x increases, every number is finite; a cubic table is twice continuously differentiable, around the period too
Reports      BG290 table file not found or not readable, BG291 bad data of a table
"""

from __future__ import annotations

import csv
import math
import os
import struct
from collections.abc import Sequence
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import Any

from bgdsl.cache import keep, recall
from bgdsl.diagnostics import Code, did_you_mean, listed
from bgdsl.expr import Expr, Table, const
from bgdsl.passes.elaborate import evaluate
from bgdsl.passes.parts import Build, Context, Fault
from bgdsl.passes.shapes import TableName, Value, shape_of
from bgdsl.passes.values import kind_of
from bgdsl.source import Source, Span
from bgdsl.syntax import ast

FILE = Code("BG290", "the file of a table cannot be read")
DATA = Code("BG291", "the data of a table do not make a table")

Column = str | int
"""A column by its header or by its number from 1."""


def read_columns(path: Path, x: Column, y: Column, span: Span) -> tuple[list[float], list[float], list[Span]]:
    """Two columns of a CSV file with the place of each row in it. Empty lines and lines that begin with `#` are comments."""
    if not path.exists():
        path = Path(os.path.normpath(path))  # a text may be tried before its own folder is there, and climb out of it by `..`
    try:
        source = Source(path.name, path.read_bytes().decode("utf-8-sig"), path)
    except FileNotFoundError:
        near = [other.name for other in path.parent.glob("*.csv")] if path.parent.is_dir() else []
        helps = (f"there are {listed(sorted(near), 5)}",) if near else ()
        raise Fault(
            FILE,
            f"table file `{path}` is not found",
            span,
            "named here",
            notes=("the path is relative to the file that names it",),
            helps=helps,
        ) from None
    except (OSError, UnicodeDecodeError) as problem:
        raise Fault(FILE, f"table file `{path}` cannot be read: {problem}", span, "named here") from None
    rows = _rows(source)
    header = None if rows and _is_numbers(rows[0][0]) else (rows.pop(0)[0] if rows else None)
    columns = [_column(name, header, rows, path, span) for name in (x, y)]
    values: tuple[list[float], list[float]] = ([], [])
    for cells, where in rows:
        for column, kept in zip(columns, values, strict=True):
            kept.append(_cell(cells, column, where, span))
    return values[0], values[1], [where for _, where in rows]


def _rows(source: Source) -> list[tuple[list[str], Span]]:
    rows = []
    for start in source.line_starts:
        end = source.text.find("\n", start)
        end = len(source.text) if end < 0 else end
        line = source.text[start:end].strip()
        if line and not line.startswith(("#", "//")):
            separator = ";" if ";" in line and "," not in line else "\t" if "\t" in line and "," not in line else ","
            cells = next(csv.reader([line], delimiter=separator, skipinitialspace=True))
            rows.append(([cell.strip() for cell in cells], Span(source, start, end)))
    return rows


def _is_numbers(cells: Sequence[str]) -> bool:
    try:
        [float(cell) for cell in cells]
    except ValueError:
        return False
    return True


def _column(wanted: Column, header: list[str] | None, rows: Sequence[object], path: Path, span: Span) -> int:
    if isinstance(wanted, int):
        return wanted - 1
    if header is None:
        raise Fault(
            DATA, f"`{path.name}` has no header that could name column `{wanted}`", span, "named here", helps=("give the column's number",)
        )
    if wanted not in header:
        raise Fault(
            DATA,
            f"`{path.name}` has no column `{wanted}`",
            span,
            "named here",
            notes=(f"its columns are {listed(header, 12)}",),
            helps=did_you_mean(wanted, header),
        )
    return header.index(wanted)


def _cell(cells: Sequence[str], column: int, where: Span, span: Span) -> float:
    if not 0 <= column < len(cells):
        raise Fault(DATA, f"a row has no column {column + 1}", span, "the table", others=[(where, "this row")])
    try:
        return float(cells[column])
    except ValueError:
        raise Fault(
            DATA, f"`{cells[column]}` in line {where.line} is not a number", span, "the table", others=[(where, "in this row")]
        ) from None


def make_table(
    name: str, x: Sequence[float], y: Sequence[float], kind: str, periodic: bool, span: Span, rows: Sequence[Span] = ()
) -> Table:
    """The table through the points (x, y)."""
    _check(x, y, kind, periodic, span, rows)
    if kind == "linear":
        slopes = [(b - a) / (d - c) for a, b, c, d in zip(y, y[1:], x, x[1:], strict=False)]
        return Table(name, tuple(x), (tuple(slopes), tuple(y[:-1])), periodic)
    values = [*y[:-1], y[0]] if periodic else list(y)
    return Table(name, tuple(x), _cubic(tuple(x), tuple(values), periodic), periodic)


def _cubic(x: tuple[float, ...], y: tuple[float, ...], periodic: bool) -> tuple[tuple[float, ...], ...]:
    """The coefficients of the C2 spline, kept on disk: loading SciPy's splines takes longer than the rest of a small model."""
    packed = struct.pack(f"<{2 * len(x)}d", *x, *y)
    key = sha256(b"cubic spline 1, %d " % periodic + packed).hexdigest()
    size = 4 * (len(x) - 1)
    kept = recall(key)
    if kept is None or len(kept) != 8 * size:
        from scipy.interpolate import CubicSpline

        spline = CubicSpline(x, y, bc_type="periodic" if periodic else "not-a-knot")
        kept = struct.pack(f"<{size}d", *(float(c) for row in spline.c for c in row))
        keep(key, kept)
    flat = struct.unpack(f"<{size}d", kept)
    return tuple(flat[i : i + len(x) - 1] for i in range(0, size, len(x) - 1))


def _check(x: Sequence[float], y: Sequence[float], kind: str, periodic: bool, span: Span, rows: Sequence[Span]) -> None:
    def at(i: int) -> list[tuple[Span, str]]:
        return [(rows[i], "in this row")] if rows else []

    if kind not in ("linear", "cubic"):
        raise Fault(DATA, f"a table is `linear` or `cubic`, not `{kind}`", span, "here")
    if len(x) != len(y):
        raise Fault(DATA, f"a table has as many x as y, not {len(x)} and {len(y)}", span, "here")
    least = 4 if kind == "cubic" else 2
    if len(x) < least:
        raise Fault(DATA, f"a {kind} table wants at least {least} points, this has {len(x)}", span, "here")
    for i, (a, b) in enumerate(zip(x, y, strict=True)):
        if not (math.isfinite(a) and math.isfinite(b)):
            raise Fault(DATA, f"point {i + 1} of the table is not finite ({a:g}, {b:g})", span, "here", others=at(i))
        if i and a <= x[i - 1]:
            raise Fault(DATA, f"the x of a table have to increase; {a:g} comes after {x[i - 1]:g}", span, "here", others=at(i))
    size = max(abs(value) for value in y)
    if periodic and abs(y[-1] - y[0]) > 1e-9 * max(size, 1e-300):
        raise Fault(
            DATA,
            f"a periodic table ends with the value that it begins with; this goes from {y[0]:g} to {y[-1]:g}",
            span,
            "here",
            others=at(len(y) - 1),
            helps=("repeat the first value in a last row, one period later",),
        )


# ------------------------------------------------------------------------------------------------------------ as written


def table_value(build: Build, node: ast.Call, context: Context) -> TableName:
    """`table("file.csv", x = "angle", y = "force", kind = "cubic", periodic = true)` or `table({...}, {...}, kind = "linear")`."""
    options = {name: evaluate(value, context) for name, value in node.named}
    for name, value in node.named:
        if name not in ("x", "y", "kind", "periodic"):
            raise Fault(
                DATA,
                f"a table has no option `{name}`",
                value.span,
                "",
                helps=did_you_mean(name, ("x", "y", "kind", "periodic")) or ("x, y, kind, periodic",),
            )
    kind, periodic = options.get("kind", "linear"), options.get("periodic", const(0.0))
    given = [evaluate(argument, context) for argument in node.arguments]
    if not isinstance(kind, str) or not isinstance(periodic, Expr) or not periodic.is_const:
        raise Fault(DATA, "`kind` is a string and `periodic` true or false", node.span, "")
    source = node.span.source
    match given:
        case [str() as name]:
            folder = source.path.parent if source.path is not None else Path()
            path = folder / name
            columns = [_column_said(options.get(axis), axis, i, node.span) for i, axis in enumerate("xy")]
            xs, ys, rows = read_columns(path, columns[0], columns[1], node.span)
            key: tuple[Any, ...] = (str(path), *columns, kind, periodic.data)
        case [xs_value, ys_value] if "x" not in options and "y" not in options:
            xs, ys = (_points(build, value, node.span) for value in (xs_value, ys_value))
            rows = []
            key = (tuple(xs), tuple(ys), kind, periodic.data)
        case _:
            raise Fault(
                DATA,
                "a table is made of a file's name or of two vectors",
                node.span,
                "",
                helps=('write `table("file.csv", x = "a", y = "b")` or `table({0, 1}, {2, 3})`',),
            )
    if key not in build.table_keys:
        made = f"table{len(build.tables) + 1}"
        build.tables[made] = replace(make_table(made, xs, ys, kind, bool(periodic.data), node.span, rows), span=node.span)
        build.table_keys[key] = made
    return TableName(build.table_keys[key])


def _column_said(value: Value | None, axis: str, i: int, span: Span) -> Column:
    if value is None:
        return i + 1
    if isinstance(value, str):
        return value
    if isinstance(value, Expr) and value.is_const and float(value.data).is_integer():
        return int(value.data)
    raise Fault(DATA, f"`{axis}` is a column's name or number", span, "")


def _points(build: Build, value: Value, span: Span) -> list[float]:
    if len(shape_of(value)) != 1 or kind_of(value) != "number":
        raise Fault(DATA, "the points of a table are two vectors of numbers", span, "")
    return [build.number(item, span) for item in value]
