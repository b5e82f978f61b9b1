"""Hypothesis strategies of syntax trees: everything that the parser can make, in small.

`files()` makes whole files, `expressions()` expressions. The trees mean nothing; they are for the printer, the parser and the
formatter. Names are also taken from keywords, which are names wherever the grammar does not ask for the keyword.
"""

from __future__ import annotations

from typing import Any

from hypothesis import strategies as st

from bgdsl.source import Source, Span
from bgdsl.syntax import ast

NOWHERE = Span(Source("made", ""), 0, 0)
_S = st.just(NOWHERE)

NAMES = st.sampled_from(
    ["x", "y2", "_z", "e", "f", "in", "out", "method", "run", "error", "experiment", "input", "port", "flow", "sum", "type"]
)
CLASSES = st.sampled_from(["Real", "J1", "MTF", "Cylinder", "R"])
TEXTS = st.text(st.sampled_from('ab "\\\n\t/*é'), max_size=6)
_MAYBE_TEXT = st.none() | TEXTS


def _node(kind: type[Any], *arguments: st.SearchStrategy[Any], **named: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    return st.builds(kind, *arguments, **named, span=_S)


def _some(of: st.SearchStrategy[Any], least: int = 0, most: int = 2) -> st.SearchStrategy[tuple[Any, ...]]:
    return st.lists(of, min_size=least, max_size=most).map(tuple)


NUMBERS = st.sampled_from(["0", "1", "12", "0.5", "2.", "1e-3", "6.02E23", "3.e4"]).map(lambda t: ast.Number(float(t), t, span=NOWHERE))
_OPERATORS = st.sampled_from(["+", "-", "*", "/", "^", ".+", ".-", ".*", "./", ".^", "==", "<>", "<", "<=", ">", ">=", "and", "or"])
_RELATIONS = st.sampled_from(["==", "<>", "<", "<=", ">", ">="])


def references(subscripts: st.SearchStrategy[Any] | None = None) -> st.SearchStrategy[ast.Reference]:
    """Dotted names, with subscripts if they are given."""
    dims = st.just(()) if subscripts is None else st.just(()) | _some(subscripts, 1)
    return _node(ast.Reference, _some(_node(ast.Part, NAMES, dims), 1, 3))


def _larger(inner: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    subscript = inner | _node(ast.Colon) | _node(ast.End)
    iterators = _some(_node(ast.Iterator, NAMES, inner), 1)
    return st.one_of(
        references(subscript),
        _node(ast.Call, references(), _some(inner | _node(ast.End)), _some(st.tuples(NAMES, inner))),
        _node(ast.Subscripted, inner, _some(subscript, 1)),
        _node(ast.Unary, st.sampled_from(["+", "-", "not"]), inner),
        _node(ast.Binary, _OPERATORS, inner, inner),
        _node(ast.Binary, _OPERATORS, inner, inner),
        _node(ast.If, _some(st.tuples(inner, inner), 1), inner),
        _node(ast.Range, inner, st.none() | inner, inner),
        _node(ast.Array, _some(inner, 0, 3)),
        _node(ast.Matrix, _some(_some(inner, 1), 1)),
        _node(ast.Comprehension, st.sampled_from([None, "sum", "product", "min", "max"]), inner, iterators),
    )


def expressions(size: int = 8) -> st.SearchStrategy[Any]:
    """Expressions of all kinds."""
    leaves = st.one_of(NUMBERS, references(), _node(ast.String, TEXTS), _node(ast.Boolean, st.booleans()))
    return st.recursive(leaves, _larger, max_leaves=size)


EXPRESSIONS = expressions()
DIMS = _some(EXPRESSIONS | _node(ast.Colon))
TYPES = _node(ast.TypeName, _node(ast.Reference, _some(_node(ast.Part, CLASSES), 1)), DIMS)


def _arguments(depth: int = 2) -> st.SearchStrategy[tuple[ast.Argument, ...]]:
    nested = _arguments(depth - 1) if depth else st.just(())
    flags = {"each": st.booleans(), "final": st.booleans()}
    modifier = _node(ast.Modifier, references(EXPRESSIONS), nested, st.none() | EXPRESSIONS, **flags)
    redeclaration = _node(ast.Redeclaration, TYPES, NAMES, DIMS, nested, comment=_MAYBE_TEXT, **flags)
    return _some(modifier | redeclaration)


ARGUMENTS = _arguments()
_PREFIXES = _some(
    st.sampled_from(["parameter", "constant", "input", "output", "open", "final", "replaceable", "protected", "port in", "port out"])
)
_DECLARATOR = _node(ast.Declarator, NAMES, DIMS, ARGUMENTS, st.none() | EXPRESSIONS, st.none() | EXPRESSIONS, _MAYBE_TEXT)
DECLARATIONS = _node(ast.Declaration, _PREFIXES, TYPES, _some(_DECLARATOR, 1))


@st.composite
def bond_chains(draw: st.DrawFn) -> ast.BondChain:
    """Chains with a fan at their end."""
    count = draw(st.integers(1, 3))
    arrow = _node(ast.Arrow, st.booleans(), st.sampled_from([None, "tail", "head"]))
    arrows = tuple(draw(arrow) for _ in range(count))
    ends = [(draw(references(EXPRESSIONS)),) for _ in range(count)]
    fan = draw(_some(references(EXPRESSIONS), 1, 3))
    return ast.BondChain(draw(st.none() | NAMES), (*ends, fan), arrows, draw(_MAYBE_TEXT), span=NOWHERE)


def _statements(depth: int = 2) -> st.SearchStrategy[Any]:
    plain = st.one_of(
        bond_chains(),
        _node(ast.Equation, EXPRESSIONS, EXPRESSIONS, _MAYBE_TEXT),
        _node(ast.Assertion, EXPRESSIONS, EXPRESSIONS),
    )
    if not depth:
        return plain
    body = _some(_statements(depth - 1))
    iterators = _some(_node(ast.Iterator, NAMES, EXPRESSIONS), 1)
    return plain | _node(ast.For, iterators, body) | _node(ast.IfStatement, _some(st.tuples(EXPRESSIONS, body), 1), body)


SECTIONS = _node(ast.Section, st.booleans(), _some(_statements()))
_ASSIGN = _node(ast.Assign, references(EXPRESSIONS), EXPRESSIONS)
_ALGORITHM = _some(_ASSIGN | _node(ast.ForAssign, _some(_node(ast.Iterator, NAMES, EXPRESSIONS), 1), _some(_ASSIGN)))


@st.composite
def imports(draw: st.DrawFn) -> ast.Import:
    """The three forms of an import."""
    path = draw(_some(NAMES, 0, 2))
    name, alias = draw(CLASSES), draw(CLASSES)
    several = tuple((other, other) for other in draw(_some(CLASSES, 2, 3))) if path else ()
    return ast.Import(path, draw(st.sampled_from([((name, name),), ((name, alias),), several or ((name, name),)])), span=NOWHERE)


def definitions(depth: int = 1) -> st.SearchStrategy[Any]:
    """Definitions other than tests; models nest."""
    variables = _node(ast.DomainVariable, st.sampled_from(["effort", "flow"]), NAMES, ARGUMENTS, _MAYBE_TEXT)
    others = st.one_of(
        _node(ast.ShortFunction, NAMES, _some(_node(ast.Declarator, NAMES, DIMS)), EXPRESSIONS, _MAYBE_TEXT),
        _node(ast.LongFunction, NAMES, _MAYBE_TEXT, _some(DECLARATIONS), _ALGORITHM),
        _node(ast.TypeDefinition, CLASSES, TYPES, ARGUMENTS, _MAYBE_TEXT),
        _node(ast.Domain, CLASSES, _MAYBE_TEXT, _some(variables)),
    )
    items = st.one_of(
        DECLARATIONS,
        _node(ast.Redeclaration, TYPES, NAMES, DIMS, ARGUMENTS, final=st.booleans(), comment=_MAYBE_TEXT),
        _node(ast.Extends, references(), ARGUMENTS),
        _node(ast.Experiment, NAMES, st.none() | NAMES, ARGUMENTS, _MAYBE_TEXT),
        _node(ast.Annotation, ARGUMENTS),
        imports(),
        definitions(depth - 1) if depth else others,
    )
    kinds = st.sampled_from(["model", "element"])
    return others | _node(ast.Model, kinds, CLASSES, _MAYBE_TEXT, _some(items, 0, 3), _some(SECTIONS))


@st.composite
def runs(draw: st.DrawFn) -> ast.RunStatement:
    """Runs of models, and references read from files."""
    if draw(st.booleans()):
        csv = ast.Reference((ast.Part("csv", span=NOWHERE),), span=NOWHERE)
        return ast.RunStatement(draw(NAMES), csv, file=draw(TEXTS), span=NOWHERE)
    names = draw(st.lists(st.sampled_from(["for", "interval", "tolerance", "method"]), unique=True, max_size=3))
    options = tuple((name, draw(EXPRESSIONS)) for name in names)
    return ast.RunStatement(draw(NAMES), draw(references()), draw(ARGUMENTS), draw(st.none() | NAMES), options, span=NOWHERE)


_WANTED = _node(ast.TestAssertion, _node(ast.Binary, _RELATIONS, EXPRESSIONS, EXPRESSIONS), EXPRESSIONS, st.booleans(), _MAYBE_TEXT)
_ASSERTED = _node(ast.TestAssertion, EXPRESSIONS, message=_MAYBE_TEXT)
_EXPECTED = _node(ast.ExpectError, st.sampled_from(["BG401", "BG203"]), references(), ARGUMENTS)
TESTS = _node(ast.Test, TEXTS, _some(st.one_of(runs(), _WANTED, _ASSERTED, _EXPECTED), 0, 3))


def files() -> st.SearchStrategy[ast.File]:
    """Whole files."""
    return _node(ast.File, _some(st.one_of(imports(), definitions(), TESTS), 0, 3))
