"""The modifications of a redeclared array, for some of its elements: `redeclare Worn part[{2, 5}](wear = {0.1, 0.2})` for element 5.

Input        a redeclaration as written, the elements wanted
Output       edits of its text
Reports      UnwritableError where the elements' values are not written one by one
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from bgdsl.reductions.source_map import UnwritableError
from bgdsl.reductions.statements import Index
from bgdsl.source import Edit, Span
from bgdsl.syntax import ast


def for_elements(item: ast.Redeclaration, every: Sequence[Index], wanted: Sequence[Index]) -> list[Edit]:
    """What its modifications say of the wanted elements. every: all that it redeclares, ascending."""
    if not item.arguments:
        return []
    order = _order(item, every)
    return _of(item, item.arguments, [order.index(index) for index in wanted])


def _order(item: ast.Redeclaration, every: Sequence[Index]) -> list[Index]:
    """The redeclared elements in the order in which modifications without `each` are indexed."""
    match item.subscripts:
        case () | (ast.Colon(),):
            return list(every)
        case (ast.Number(value=value),):
            return [(int(value),)]
        case (ast.Range(start=ast.Number(value=first), step=None, stop=ast.Number(value=last)),):
            return [(i,) for i in range(int(first), int(last) + 1)]
        case (ast.Array(items=items),) if all(isinstance(i, ast.Number) for i in items):
            return [(int(i.value),) for i in items if isinstance(i, ast.Number)]
    raise _unwritable(item)


def _of(item: ast.Redeclaration, arguments: Sequence[ast.Argument], positions: Sequence[int]) -> list[Edit]:
    edits: list[Edit] = []
    for argument in arguments:
        if not isinstance(argument, ast.Modifier):
            raise _unwritable(item)
        if argument.each:
            edits += _without_each(argument) if len(positions) == 1 else []
            continue
        edits += _of(item, argument.nested, positions)
        if argument.value is not None:
            edits.append(Edit(argument.value.span, _picked(item, argument.value, positions)))
    return edits


def _without_each(argument: ast.Modifier) -> list[Edit]:
    """One element is no array: what was said of each is said of it."""
    source, start = argument.span.source, argument.span.start
    flags = source.text[start : argument.name.span.start]
    return [Edit(Span(source, start, argument.name.span.start), re.sub(r"\beach\s+", "", flags))]


def _picked(item: ast.Redeclaration, value: ast.Expression, positions: Sequence[int]) -> str:
    match value:
        case ast.Array(items=items):
            texts = [items[p].span.text for p in positions]
            return texts[0] if len(texts) == 1 else f"{{{', '.join(texts)}}}"
        case ast.Matrix(rows=rows) if all(_is_number(cell) for row in rows for cell in row):  # else a row may be several
            lines = [", ".join(cell.span.text for cell in rows[p]) for p in positions]
            return f"{{{lines[0]}}}" if len(lines) == 1 else f"[{'; '.join(lines)}]"
    raise _unwritable(item)


def _is_number(cell: ast.Expression) -> bool:
    return isinstance(cell.operand if isinstance(cell, ast.Unary) else cell, ast.Number)


def _unwritable(item: ast.Redeclaration) -> UnwritableError:
    return UnwritableError((), f"the elements of `{item.name}` differ, whose values are not given one by one where they are redeclared")
