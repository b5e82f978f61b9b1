"""The built-in functions of the language, on values.

Each takes its evaluated arguments and the place of the call. What needs the evaluator itself (`der`, tables, user functions)
is in `elaborate`.
Reports      BG234 wrong arguments of a function
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import reduce
from typing import Any

import numpy as np

from bgdsl.diagnostics import Code
from bgdsl.expr import ONE, ZERO, Expr, add, binary, const, topological, unary, var
from bgdsl.ir.graph import Origin, SignalEquation
from bgdsl.passes.parts import Build, Context, Fault
from bgdsl.passes.shapes import LARGEST_ARRAY, Value, array_of, entries, leaves_of, shape_of, shown_shape
from bgdsl.passes.values import diagonal, elementwise, full, identity, kind_of, matmul
from bgdsl.source import Span

ARGUMENTS = Code("BG234", "wrong arguments of a function")

Arguments = list[Value]
Function = Callable[[Arguments, Span, Context], Value]

CONSTANTS: Mapping[str, float] = {
    "pi": math.pi,
    "inf": math.inf,
    "eps": 2.220446049250313e-16,
    "Modelica.Constants.pi": math.pi,
    "Modelica.Constants.e": math.e,
    "Modelica.Constants.g_n": 9.80665,
    "Modelica.Constants.inf": 1.7976931348623157e308,
    "Modelica.Constants.eps": 2.220446049250313e-16,
    "Modelica.Constants.small": 2.2250738585072014e-308,
    "Modelica.Constants.R": 8.31446261815324,
    "Modelica.Constants.c": 299792458.0,
    "Modelica.Constants.sigma": 5.670374419e-8,
    "Modelica.Constants.mu_0": 1.25663706212e-6,
    "Modelica.Constants.epsilon_0": 8.8541878128e-12,
    "Modelica.Constants.D2R": math.pi / 180.0,
    "Modelica.Constants.R2D": 180.0 / math.pi,
}
"""Constants by name. `e` is none of them: in laws it is the effort."""


def wrong(message: str, span: Span, label: str = "", *helps: str) -> Fault:
    """A fault in the arguments of a function."""
    return Fault(ARGUMENTS, message, span, label, helps=helps)


def _unary(name: str) -> Function:
    return lambda args, span, context: elementwise(lambda x: unary(name, x), args[0])


def _integer(value: Value, span: Span, context: Context) -> int:
    """A size or count, decided now."""
    if not isinstance(value, Expr):
        raise wrong("a size is a whole number", span, shown_shape(shape_of(value)))
    number = context.build.number(value, span)
    if not float(number).is_integer():
        raise wrong(f"a size is a whole number, this is {number:g}", span)
    return int(number)


def _square(value: Value, span: Span, what: str) -> np.ndarray[Any, Any]:
    shape = shape_of(value)
    if len(shape) != 2 or shape[0] != shape[1]:
        raise wrong(f"`{what}` wants a square matrix, this is {shown_shape(shape)}", span)
    return np.asarray(value)


def _vector(value: Value, span: Span, what: str, size: int | None = None) -> np.ndarray[Any, Any]:
    shape = shape_of(value)
    if len(shape) != 1 or (size is not None and shape[0] != size):
        wanted = "a vector" if size is None else f"a vector of {size}"
        raise wrong(f"`{what}` wants {wanted}, this is {shown_shape(shape)}", span)
    return np.asarray(value)


def _minmax(name: str) -> Function:
    def function(args: Arguments, span: Span, context: Context) -> Value:
        if len(args) == 1:
            items = entries(args[0])
            if not items:
                raise wrong(f"`{name}` of nothing", span)
            return reduce(lambda a, b: binary(name, a, b), items)
        return elementwise(lambda a, b: binary(name, a, b), *args)

    return function


def _sum(args: Arguments, span: Span, context: Context) -> Value:
    return add(entries(args[0]))


def _product(args: Arguments, span: Span, context: Context) -> Value:
    return reduce(lambda a, b: a * b, entries(args[0]), ONE)


def _modulo(args: Arguments, span: Span, context: Context) -> Value:
    return elementwise(lambda x, y: x - unary("floor", x / y) * y, *args)


def _remainder(args: Arguments, span: Span, context: Context) -> Value:
    return elementwise(lambda x, y: x - unary("trunc", x / y) * y, *args)


def _quotient(args: Arguments, span: Span, context: Context) -> Value:
    return elementwise(lambda x, y: unary("trunc", x / y), *args)


def _cross(args: Arguments, span: Span, context: Context) -> Value:
    a, b = (_vector(arg, span, "cross", 3) for arg in args)
    return matmul(_skew([a], span, context), b)


def _skew(args: Arguments, span: Span, context: Context) -> Value:
    x, y, z = _vector(args[0], span, "skew", 3)
    return array_of([ZERO, -z, y, z, ZERO, -x, -y, x, ZERO], (3, 3))


def _transpose(args: Arguments, span: Span, context: Context) -> Value:
    if len(shape_of(args[0])) != 2:
        raise wrong(f"`transpose` wants a matrix, this is {shown_shape(shape_of(args[0]))}", span)
    return args[0].T


def _size(args: Arguments, span: Span, context: Context) -> Value:
    shape = shape_of(args[0])
    if len(args) == 1:
        return array_of([const(n) for n in shape], (len(shape),))
    k = _integer(args[1], span, context)
    if not 1 <= k <= len(shape):
        raise wrong(f"there is no dimension {k}", span, shown_shape(shape))
    return const(shape[k - 1])


def _filled(value: Expr) -> Function:
    return lambda args, span, context: full(_extents(args, span, context), value)


def _extents(args: Arguments, span: Span, context: Context) -> tuple[int, ...]:
    """The sizes of an array to be made."""
    return _checked(tuple(_integer(arg, span, context) for arg in args), span)


def _checked(sizes: tuple[int, ...], span: Span) -> tuple[int, ...]:
    """The sizes of an array that can be made."""
    if min(sizes) < 0:
        raise wrong(f"an array cannot have {min(sizes)} entries", span)
    if math.prod(sizes) > LARGEST_ARRAY:
        shown = " x ".join(f"{size:g}" for size in sizes)
        raise wrong(f"an array of {shown} entries is too large", span, f"at most {LARGEST_ARRAY}")
    return sizes


def _fill(args: Arguments, span: Span, context: Context) -> Value:
    return full(_extents(args[1:], span, context), args[0])


def _linspace(args: Arguments, span: Span, context: Context) -> Value:
    n = _integer(args[2], span, context)
    if n < 2:
        raise wrong("`linspace` wants at least two points", span)
    _checked((n,), span)
    start, stop = args[:2]
    return array_of([start + (stop - start) * (i / (n - 1)) for i in range(n)], (n,))


def _outer(args: Arguments, span: Span, context: Context) -> Value:
    a, b = (_vector(arg, span, "outerProduct") for arg in args)
    _checked((len(a), len(b)), span)
    return matmul(a.reshape(-1, 1), b.reshape(1, -1))


def _identity(args: Arguments, span: Span, context: Context) -> Value:
    n = _integer(args[0], span, context)
    return identity(_checked((n, n), span)[0])


def _diagonal(args: Arguments, span: Span, context: Context) -> Value:
    vector = _vector(args[0], span, "diagonal")
    _checked((len(vector), len(vector)), span)
    return diagonal(vector)


def _symmetric(args: Arguments, span: Span, context: Context) -> Value:
    a = _square(args[0], span, "symmetric")
    n = len(a)
    return array_of([a[min(i, j), max(i, j)] for i in range(n) for j in range(n)], (n, n))


def _cat(args: Arguments, span: Span, context: Context) -> Value:
    k = _integer(args[0], span, context)
    try:
        return np.concatenate(args[1:], axis=k - 1)
    except ValueError:
        shapes = " and ".join(shown_shape(shape_of(arg)) for arg in args[1:])
        raise wrong(f"`cat` cannot join {shapes} along dimension {k}", span) from None


def _to_scalar(args: Arguments, span: Span, context: Context) -> Value:
    items = entries(args[0])
    if len(items) != 1:
        raise wrong(f"`scalar` wants an array of one entry, this is {shown_shape(shape_of(args[0]))}", span)
    return items[0]


def _to_vector(args: Arguments, span: Span, context: Context) -> Value:
    return array_of(entries(args[0]), (len(entries(args[0])),))


def _to_matrix(args: Arguments, span: Span, context: Context) -> Value:
    items = entries(args[0])
    shape = shape_of(args[0])
    return args[0] if len(shape) == 2 else array_of(items, (len(items), 1))


def _first(args: Arguments, span: Span, context: Context) -> Value:
    return args[0]


def _last(args: Arguments, span: Span, context: Context) -> Value:
    return args[-1]


def determinant(a: np.ndarray[Any, Any]) -> Expr:
    """The determinant of a matrix of up to three rows."""
    match len(a):
        case 1:
            return a[0, 0]  # type: ignore[no-any-return]
        case 2:
            return a[0, 0] * a[1, 1] - a[0, 1] * a[1, 0]  # type: ignore[no-any-return]
        case _:
            return add(a[0, j] * _cofactor(a, 0, j) for j in range(3))


def _cofactor(a: np.ndarray[Any, Any], i: int, j: int) -> Expr:
    """The signed minor of a matrix of three rows."""
    r, s = [k for k in range(3) if k != i]
    c, d = [k for k in range(3) if k != j]
    minor: Expr = a[r, c] * a[s, d] - a[r, d] * a[s, c]
    return minor if (i + j) % 2 == 0 else -minor


def adjugate(a: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """The transposed matrix of cofactors of a matrix of up to three rows."""
    n = len(a)
    match n:
        case 1:
            return identity(1)
        case 2:
            return array_of([a[1, 1], -a[0, 1], -a[1, 0], a[0, 0]], (2, 2))
        case _:
            return array_of([_cofactor(a, j, i) for i in range(3) for j in range(3)], (3, 3))


def _is_diagonal(a: np.ndarray[Any, Any]) -> bool:
    return all(a[i, j].is_zero for i in range(len(a)) for j in range(len(a)) if i != j)


def solve(a: np.ndarray[Any, Any], b: np.ndarray[Any, Any], span: Span, context: Context) -> Value:
    """inv(a) b: by formula up to three rows or where only parameters are read, else through auxiliary unknowns that the equations
    solve with pivoting."""
    n = len(a)
    if _is_diagonal(a):
        return array_of([b[i] / a[i, i] for i in range(n)], (n,))
    if n <= 3:
        whole = determinant(a)
        return array_of([entry / whole for entry in matmul(adjugate(a), b)], (n,))
    build: Build = context.build
    if not any(leaf.op in ("var", "time") for leaf in topological((*a.flat, *b.flat))):
        return _eliminate(a, b, span, build)
    name = f"solve#{sum(known.startswith('solve') for known, _, _ in build.solved) + 1}"
    origin = Origin(context.path, span)
    build.solved.append((name, (n,), origin))
    x = leaves_of(var, name, (n,))
    for left, right in zip(matmul(a, x), b, strict=True):
        build.extra.append(SignalEquation(left, right, origin))
    return x


def _eliminate(a: np.ndarray[Any, Any], b: np.ndarray[Any, Any], span: Span, build: Build) -> Value:
    """inv(a) b for parameters, as formulas: Gaussian elimination, with the pivots that the parameters' defaults choose."""
    n = len(a)
    rows = [[*a[i], b[i]] for i in range(n)]
    numbers = np.array([[build.number(entry, span, structural=False) for entry in row] for row in rows])
    scale = float(np.max(np.abs(numbers[:, :n]))) or 1.0
    for k in range(n):
        best = k + int(np.argmax(np.abs(numbers[k:, k])))
        if abs(numbers[best, k]) <= 1e-14 * scale:
            raise wrong("the matrix of `solve` is singular", span)
        rows[k], rows[best] = rows[best], rows[k]
        numbers[[k, best]] = numbers[[best, k]]
        for i in range(k + 1, n):
            if rows[i][k].is_zero:
                continue
            factor = rows[i][k] / rows[k][k]
            rows[i] = [x - factor * y for x, y in zip(rows[i], rows[k], strict=True)]
            numbers[i] -= numbers[i, k] / numbers[k, k] * numbers[k]
    x: list[Expr] = [ZERO] * n
    for k in reversed(range(n)):
        x[k] = (rows[k][n] - add(rows[k][j] * x[j] for j in range(k + 1, n))) / rows[k][k]
    return array_of(x, (n,))


def _solve(args: Arguments, span: Span, context: Context) -> Value:
    a = _square(args[0], span, "solve")
    b = np.asarray(args[1])
    if len(shape_of(args[1])) not in (1, 2) or len(b) != len(a):
        raise wrong(
            f"`solve` wants as many right-hand sides as the matrix has rows ({len(a)}), this is {shown_shape(shape_of(args[1]))}", span
        )
    if b.ndim == 1:
        return solve(a, b, span, context)
    return np.stack([solve(a, column, span, context) for column in b.T], axis=1)


def _inverse(args: Arguments, span: Span, context: Context) -> Value:
    a = _square(args[0], span, "inverse")
    return _solve([a, identity(len(a))], span, context)


def _norm(args: Arguments, span: Span, context: Context) -> Value:
    items = _vector(args[0], span, "norm")
    return unary("sqrt", add(x * x for x in items))


_ELEMENTARY = (
    "sin",
    "cos",
    "tan",
    "asin",
    "acos",
    "atan",
    "sinh",
    "cosh",
    "tanh",
    "exp",
    "log",
    "log10",
    "sqrt",
    "abs",
    "sign",
    "floor",
    "ceil",
)

BUILT_INS: Mapping[str, tuple[int, int, Function]] = {
    **{name: (1, 1, _unary(name)) for name in _ELEMENTARY},
    "integer": (1, 1, _unary("floor")),
    "atan2": (2, 2, lambda args, span, context: elementwise(lambda y, x: binary("atan2", y, x), *args)),
    "min": (1, 2, _minmax("min")),
    "max": (1, 2, _minmax("max")),
    "mod": (2, 2, _modulo),
    "rem": (2, 2, _remainder),
    "div": (2, 2, _quotient),
    "sum": (1, 1, _sum),
    "product": (1, 1, _product),
    "cross": (2, 2, _cross),
    "skew": (1, 1, _skew),
    "transpose": (1, 1, _transpose),
    "identity": (1, 1, _identity),
    "diagonal": (1, 1, _diagonal),
    "zeros": (1, 9, _filled(ZERO)),
    "ones": (1, 9, _filled(ONE)),
    "fill": (2, 9, _fill),
    "size": (1, 2, _size),
    "ndims": (1, 1, lambda args, span, context: const(len(shape_of(args[0])))),
    "linspace": (3, 3, _linspace),
    "outerProduct": (2, 2, _outer),
    "symmetric": (1, 1, _symmetric),
    "cat": (2, 99, _cat),
    "scalar": (1, 1, _to_scalar),
    "vector": (1, 1, _to_vector),
    "matrix": (1, 1, _to_matrix),
    "solve": (2, 2, _solve),
    "inverse": (1, 1, _inverse),
    "norm": (1, 1, _norm),
    "noEvent": (1, 1, _first),
    "smooth": (2, 2, _last),
    "Real": (1, 1, _first),
    "Integer": (1, 1, _first),
}
"""Every built-in function with the least and the largest number of its arguments."""


def call(name: str, args: Arguments, span: Span, context: Context) -> Value:
    """The built-in function `name` of its arguments."""
    least, most, function = BUILT_INS[name]
    if not least <= len(args) <= most:
        wanted = str(least) if least == most else f"{least} to {most}"
        raise wrong(f"`{name}` takes {wanted} argument{'s' if wanted != '1' else ''}, not {len(args)}", span)
    if name not in ("fill", "size", "ndims", "noEvent", "vector") and any(kind_of(arg) != "number" for arg in args):
        raise wrong(f"`{name}` wants numbers", span)
    if name in ("mod", "rem", "div", "atan2", "min", "max") and len({shape_of(arg) for arg in args} - {()}) > 1:
        raise wrong(f"the arguments of `{name}` differ in shape", span)
    return function(args, span, context)
