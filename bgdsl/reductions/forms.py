"""How vectors and matrices of expressions are written: as what they are, where that can be seen.

`{r[1], r[2], r[3]}` is `r`, the transposed entries of R are `transpose(R)`, an antisymmetric 3 x 3 matrix is `skew(...)`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from bgdsl.expr import Expr


@dataclass(frozen=True, slots=True)
class Seen:
    """An entry of an array as it can be read: the array's text and its name in the model, the entry (from 1), the array's shape."""

    text: str
    name: str
    entry: tuple[int, ...]
    shape: tuple[int, ...]


Show = Callable[[Expr], str]
Look = Callable[[Expr], Seen | None]
Entry = Callable[[tuple[int, ...]], tuple[int, ...]]


def array_form(roots: Sequence[Expr], shape: tuple[int, ...], look: Look, fixed: Mapping[str, float], show: Show) -> str | None:
    """The text of an array, None if it has to be written out. roots: row-major; fixed: the values of constants by scalar name;
    show: a scalar expression's text."""
    found = _part_of(roots, shape, look, fixed)
    if found is None and shape == (3, 3):
        vector = (roots[7], roots[2], roots[3])
        if all(roots[k].is_zero for k in (0, 4, 8)) and all(roots[k] is -v for k, v in zip((5, 6, 1), vector, strict=True)):
            return _skew(vector, look, fixed, show)
    return found if found is not None else _multiple(roots, shape, look, fixed, show)


def _skew(vector: Sequence[Expr], look: Look, fixed: Mapping[str, float], show: Show) -> str:
    """The matrix of a cross product, its factor before it."""
    text = _part_of(vector, (3,), look, fixed)
    factor, rest = _factored(vector)
    inner = _part_of(rest, (3,), look, fixed) if text is None and factor is not None else None
    if factor is not None and inner is not None and not inner.startswith("-"):
        return f"{_factor_text(show(factor))}*skew({inner})"
    if text is None:
        return f"skew({{{', '.join(map(show, vector))}}})"
    return f"-skew({text[1:]})" if text.startswith("-") else f"skew({text})"


def _multiple(roots: Sequence[Expr], shape: tuple[int, ...], look: Look, fixed: Mapping[str, float], show: Show) -> str | None:
    factor, rest = _factored(roots)
    text = _part_of(rest, shape, look, fixed) if factor is not None else None
    return f"{_factor_text(show(factor))}*{text}" if factor is not None and text is not None and not text.startswith("-") else None


def _factored(roots: Sequence[Expr]) -> tuple[Expr | None, list[Expr]]:
    """What all entries are multiplied with, and the rest of them."""
    factor = roots[0].args[0] if roots[0].op == "mul" else None
    if factor is None or any(root.op != "mul" or root.args[0] is not factor for root in roots):
        return None, []
    return factor, [root.args[1] for root in roots]


def _factor_text(text: str) -> str:
    return text if re.fullmatch(r"[\w.\[\],]+", text) else f"({text})"


def _part_of(roots: Sequence[Expr], shape: tuple[int, ...], look: Look, fixed: Mapping[str, float]) -> str | None:
    """An array, a slice of one, the same transposed or negative."""
    negative = any(root.op == "neg" for root in roots)
    bare = [(root.args[0] if root.op == "neg" else -root if root.is_const else None) if negative else root for root in roots]
    spots = _positions(shape)
    leaf = next(((p, root) for p, root in zip(spots, bare, strict=True) if root is not None and root.op in ("var", "param")), None)
    anchor = look(leaf[1]) if leaf is not None else None
    if leaf is None or anchor is None or None in bare:
        return None
    for pattern, text in _patterns(leaf[0], anchor, shape):
        if all(_fits(root, anchor, pattern(p), look, fixed) for p, root in zip(spots, bare, strict=True) if root is not None):
            return f"-{text}" if negative else text
    return None


def _positions(shape: tuple[int, ...]) -> list[tuple[int, ...]]:
    spots: list[tuple[int, ...]] = [()]
    for size in shape:
        spots = [(*before, i) for before in spots for i in range(size)]
    return spots


def _patterns(at: tuple[int, ...], anchor: Seen, shape: tuple[int, ...]) -> Iterator[tuple[Entry, str]]:
    """Which entry stands at which position, and how that is written, seen from one that is known."""
    base, full, first = anchor.text, anchor.shape, anchor.entry
    match len(shape), len(full):
        case 1, 1:
            low = first[0] - at[0]
            yield (lambda p: (low + p[0],)), _sliced(base, [(low, shape[0])], full)
        case 1, 2:
            column = first[1] - at[0]
            yield (lambda p: (first[0], column + p[0])), f"{base}[{first[0]}, {_range(column, shape[0], full[1])}]"
            row = first[0] - at[0]
            yield (lambda p: (row + p[0], first[1])), f"{base}[{_range(row, shape[0], full[0])}, {first[1]}]"
        case 2, 2:
            r, c = first[0] - at[0], first[1] - at[1]
            yield (lambda p: (r + p[0], c + p[1])), _sliced(base, [(r, shape[0]), (c, shape[1])], full)
            a, b = first[0] - at[1], first[1] - at[0]
            yield (lambda p: (a + p[1], b + p[0])), f"transpose({_sliced(base, [(a, shape[1]), (b, shape[0])], full)})"


def _sliced(base: str, ranges: Sequence[tuple[int, int]], full: tuple[int, ...]) -> str:
    shown = [_range(low, count, size) for (low, count), size in zip(ranges, full, strict=True)]
    return base if all(text == ":" for text in shown) else f"{base}[{', '.join(shown)}]"


def _range(low: int, count: int, size: int) -> str:
    return ":" if (low, count) == (1, size) else f"{low}:{low + count - 1}"


def _fits(root: Expr, anchor: Seen, entry: tuple[int, ...], look: Look, fixed: Mapping[str, float]) -> bool:
    if not all(1 <= i <= n for i, n in zip(entry, anchor.shape, strict=True)):
        return False
    if root.is_const:
        return fixed.get(f"{anchor.name}[{','.join(map(str, entry))}]") == float(root.data)
    if root.op not in ("var", "param"):
        return False
    seen = look(root)
    return seen is not None and seen.text == anchor.text and seen.entry == entry
