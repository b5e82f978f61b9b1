"""The nodes of the tree from the rules of the grammar: one method for each rule, named like it.

A method receives the span of the rule and its kept children (None for what an optional part left out). Rules that only
collect return tuples. What a rule of the grammar cannot say (an `end` with another name, a positional argument after a
named one) is checked here and reported; the parse goes on.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from typing import Any, Literal, NamedTuple

from bgdsl.diagnostics import Reporter, did_you_mean
from bgdsl.source import Source, Span
from bgdsl.syntax import ast
from bgdsl.syntax import errors as say
from bgdsl.syntax.limits import MAX_DEPTH

REDUCTIONS = ("sum", "product", "min", "max")
_ESCAPES = {"n": "\n", "t": "\t", "r": "\r", "a": "\a", "b": "\b", "f": "\f", "v": "\v"}
_STROKES: dict[str, Literal["tail", "head"] | None] = {
    "->": None, "=>": None, "->|": "head", "=>|": "head", "|->": "tail", "|=>": "tail",
}  # fmt: skip


_CHECKED = frozenset(
    (
        *("declaration", "redeclare", "extends", "experiment", "annotation", "short_function", "assign", "type_definition"),
        *("domain_variable", "bonds", "equation", "lone_expression", "iterator", "if_statement", "else_branch"),
        *("run", "test_assertion", "expect_error"),
    )
)
"""The rules whose children are looked through for expressions that nest too deep: each expression is under one of them."""


class Ended(NamedTuple):
    """`end Name`: what the name of a definition is compared with."""

    name: str
    span: Span


def unescape(text: str) -> str:
    """The value of a string as written, with its quotes."""
    inner = text[1:-1]
    return re.sub(r"\\(.)", lambda m: _ESCAPES.get(m[1], m[1]), inner, flags=re.DOTALL) if "\\" in inner else inner


def _string(text: str | None) -> str | None:
    return None if text is None else unescape(text)


_CHAINS = {
    operator: words[0]
    for words in (("or",), ("and",), ("+", "-", ".+", ".-", "+-"), ("*", "/", ".*", "./"))
    for operator in words
}  # fmt: skip
"""Operators that are written one after the other without parentheses: by each, the first of its kind."""


def too_deep(children: Iterable[Any]) -> ast.Node | None:
    """The node at which the nesting passes `MAX_DEPTH`, if it does. A chain, `a + b - c`, is as deep as its deepest term."""
    left: list[tuple[Any, int]] = [(child, 0) for child in children]
    while left:
        node, depth = left.pop()
        if isinstance(node, tuple):
            left += [(item, depth) for item in node]
        elif isinstance(node, ast.Node):
            if depth > MAX_DEPTH:
                return node
            if isinstance(node, ast.Binary):
                inner = node.left
                chained = isinstance(inner, ast.Binary) and _CHAINS.get(inner.operator) == _CHAINS.get(node.operator, node)
                left += [(inner, depth if chained else depth + 1), (node.right, depth + 1)]
            else:
                left += [(getattr(node, name), depth + 1) for name in type(node).__slots__]
    return None


class TreeBuilder:
    """Builds the tree of one source."""

    def __init__(self, source: Source, report: Reporter):
        self.source = source
        self.report = report
        self.in_test = False

    def action(self, name: str) -> Callable[..., Any]:
        """The method for a rule; that of a statement first looks how deep its expressions nest."""
        found: Callable[..., Any] = getattr(self, name)
        if name not in _CHECKED:
            return found

        def checked(at: Span, *children: Any) -> Any:
            if at.end - at.start > MAX_DEPTH and (deep := too_deep(children[:1] if name == "if_statement" else children)):
                say.too_deep(self.report, deep.span, MAX_DEPTH)
                return None
            return found(at, *children)

        return checked

    # -------------------------------------------------------------------------------------------------- collections

    def collected(self, _: Span, *items: Any) -> tuple[Any, ...]:
        """The items of a list; a statement with an error has left None in its place."""
        return tuple(item for item in items if item is not None) if None in items else items

    items = sections = declarations = algorithm = domain_variables = prefixes = flags = collected
    statements = else_branches = test_statements = run_options = elseifs = row = fan = collected
    iterators = subscripts = arguments = parameters = collected

    def passed(self, _: Span, item: Any) -> Any:
        return item

    kind = role = condition = flag = base = label = passed

    def file(self, at: Span, *items: Any) -> ast.File:
        return ast.File(self.collected(at, *items), span=Span(self.source, 0, len(self.source.text)))

    # ---------------------------------------------------------------------------------------------------- definitions

    def import_(self, at: Span, path: list[str], names: tuple[str, ...] | None) -> ast.Import:
        if names is None:
            return ast.Import(tuple(path[:-1]), ((path[-1], path[-1]),), span=at)
        return ast.Import(tuple(path), tuple((name, name) for name in names), span=at)

    def import_as(self, at: Span, alias: str, path: list[str]) -> ast.Import:
        return ast.Import(tuple(path[:-1]), ((path[-1], alias),), span=at)

    def path(self, _: Span, *parts: Any) -> list[str]:
        if len(parts) == 1:
            return [parts[0]]
        parts[0].append(parts[1])
        return parts[0]  # type: ignore[no-any-return]

    def import_list(self, _: Span, *names: str) -> tuple[str, ...]:
        return names

    def end_name(self, at: Span, name: str) -> Ended:
        return Ended(name, at)

    def closed(self, at: Span, kind: str, name: str, end: Ended) -> None:
        if name != end.name:
            say.end_mismatch(self.report, at, kind, name, end.span, end.name)

    def model(self, at: Span, kind: Any, name: str, comment: str | None, items: Any, sections: Any, end: Ended) -> ast.Model:
        self.closed(at, kind, name, end)
        late = tuple(s for s in sections if isinstance(s, ast.Annotation))
        sections = tuple(s for s in sections if isinstance(s, ast.Section))
        return ast.Model(kind, name, _string(comment), items + late, sections, span=at)

    def equations(self, at: Span, initial: bool, statements: Any) -> ast.Section:
        return ast.Section(initial, statements, span=at)

    def section_equation(self, _: Span) -> bool:
        return False

    def section_initial(self, _: Span, __: str) -> bool:
        return True

    def extends(self, at: Span, base: ast.Reference, arguments: Any, _comment: str | None) -> ast.Extends:
        return ast.Extends(base, arguments or (), span=at)

    def experiment(self, at: Span, name: str, base: str | None, arguments: Any, comment: str | None) -> ast.Experiment:
        return ast.Experiment(name, base, arguments or (), _string(comment), span=at)

    def annotation(self, at: Span, arguments: Any) -> ast.Annotation:
        return ast.Annotation(arguments, span=at)

    def short_function(
        self, at: Span, name: str, inputs: Any, before: str | None, body: ast.Expression, after: str | None
    ) -> ast.ShortFunction:
        return ast.ShortFunction(name, inputs, body, _string(before if after is None else after), span=at)

    def parameter(self, at: Span, name: str, dims: Any) -> ast.Declarator:
        return ast.Declarator(name, dims or (), span=at)

    def long_function(self, at: Span, name: str, comment: str | None, declarations: Any, algorithm: Any, end: Ended) -> ast.LongFunction:
        self.closed(at, "function", name, end)
        return ast.LongFunction(name, _string(comment), declarations, algorithm or (), span=at)

    def assign(self, at: Span, target: ast.Reference, value: ast.Expression) -> ast.Assign:
        return ast.Assign(target, value, span=at)

    def for_assign(self, at: Span, iterators: Any, body: Any) -> ast.ForAssign:
        return ast.ForAssign(iterators, body, span=at)

    def type_definition(self, at: Span, name: str, of: ast.TypeName, arguments: Any, comment: str | None) -> ast.TypeDefinition:
        return ast.TypeDefinition(name, of, arguments or (), _string(comment), span=at)

    def domain(self, at: Span, name: str, comment: str | None, variables: Any, end: Ended) -> ast.Domain:
        self.closed(at, "domain", name, end)
        return ast.Domain(name, _string(comment), variables, span=at)

    def domain_variable(self, at: Span, role: Any, kind: str, name: str, arguments: Any, comment: str | None) -> ast.DomainVariable:
        if kind != "Real":
            say.domain_variable_type(self.report, at, role, kind)
        return ast.DomainVariable(role, name, arguments or (), _string(comment), span=at)

    # ---------------------------------------------------------------------------------------------------- declarations

    def declaration(self, at: Span, prefixes: Any, of: ast.TypeName, *declarators: ast.Declarator) -> ast.Declaration:
        return ast.Declaration(prefixes, of, declarators, span=at)

    def prefix(self, _: Span, *words: str) -> str:
        return " ".join(words)

    def type_name(self, at: Span, name: ast.Reference, dims: Any) -> ast.TypeName:
        return ast.TypeName(name, dims or (), span=at)

    def reference_plain(self, at: Span, *names: str) -> ast.Reference:
        if len(names) == 1:
            return ast.Reference((ast.Part(names[0], span=at),), span=at)
        return ast.Reference(tuple(ast.Part(name, span=at) for name in names), span=at)

    def declarator(self, at: Span, name: str, dims: Any, arguments: Any, value: Any, condition: Any, comment: str | None) -> ast.Declarator:
        return ast.Declarator(name, dims or (), arguments or (), value, condition, _string(comment), span=at)

    def modifier(self, at: Span, flags: Any, name: ast.Reference, nested: Any, value: Any) -> ast.Modifier:
        return ast.Modifier(name, nested, value, "each" in flags, "final" in flags, span=at)

    def modifier_value(self, at: Span, flags: Any, name: ast.Reference, value: Any) -> ast.Modifier:
        return ast.Modifier(name, (), value, "each" in flags, "final" in flags, span=at)

    def redeclaration(
        self, at: Span, before: Any, after: Any, of: ast.TypeName, name: str, subscripts: Any, arguments: Any, comment: str | None
    ) -> ast.Redeclaration:
        flags = before + after
        said = _string(comment)
        return ast.Redeclaration(of, name, subscripts or (), arguments or (), "each" in flags, "final" in flags, said, span=at)

    def redeclare(
        self, at: Span, prefixes: Any, of: ast.TypeName, name: str, subscripts: Any, arguments: Any, comment: str | None
    ) -> ast.Redeclaration:
        wrong = [prefix for prefix in prefixes if prefix not in ("final", "replaceable")]
        if wrong:
            say.redeclared_prefix(self.report, at, wrong[0], name)
        said, final = _string(comment), "final" in prefixes
        return ast.Redeclaration(of, name, subscripts or (), arguments or (), final=final, comment=said, span=at)

    # ------------------------------------------------------------------------------------------------------ statements

    def bonds(self, at: Span, name: str | None, chain: Any, fan: Any, comment: str | None) -> ast.BondChain:
        ends, arrows = chain
        groups = [(end,) for end in ends]
        if fan:
            groups[-1] += fan
        return ast.BondChain(name, tuple(groups), tuple(arrows), _string(comment), span=at)

    def chain(self, _: Span, tail: ast.Reference, arrow: ast.Arrow, head: ast.Reference) -> tuple[list[Any], list[Any]]:
        return [tail, head], [arrow]

    def longer_chain(self, _: Span, chain: Any, arrow: ast.Arrow, head: ast.Reference) -> tuple[list[Any], list[Any]]:
        chain[0].append(head)
        chain[1].append(arrow)
        return chain  # type: ignore[no-any-return]

    def arrow(self, at: Span, sign: str) -> ast.Arrow:
        return ast.Arrow("=" in sign, _STROKES[sign], span=at)

    def equation(self, at: Span, left: ast.Expression, right: ast.Expression, comment: str | None) -> ast.Equation:
        return ast.Equation(left, right, _string(comment), span=at)

    def lone_expression(self, at: Span, value: ast.Expression) -> ast.Assertion | None:
        match value:
            case ast.Call(ast.Reference((ast.Part("assert", ()),)), (condition, message), ()):
                return ast.Assertion(condition, message, span=at)
        said = self.report.diagnostics[-1:]
        if not (said and said[0].primary.span.source is self.source and at.start <= said[0].primary.span.start < at.end):
            say.lone_expression(self.report, value)
        return None

    def for_statement(self, at: Span, iterators: Any, body: Any) -> ast.For:
        return ast.For(iterators, body, span=at)

    def if_statement(self, at: Span, condition: Any, then: Any, branches: Any, otherwise: Any) -> ast.IfStatement:
        return ast.IfStatement(((condition, then), *branches), otherwise or (), span=at)

    def else_branch(self, _: Span, condition: Any, then: Any) -> tuple[Any, Any]:
        return condition, then

    elseif = else_branch

    def iterator(self, at: Span, name: str, over: ast.Expression) -> ast.Iterator:
        return ast.Iterator(name, over, span=at)

    # ----------------------------------------------------------------------------------------------------------- tests

    def test_name(self, _: Span, name: str) -> str:
        self.in_test = True
        return unescape(name)

    def test(self, at: Span, name: str, statements: Any) -> ast.Test:
        self.in_test = False
        return ast.Test(name, statements, span=at)

    def run(self, at: Span, name: str, model: ast.Reference, arguments: Any, options: Any) -> ast.RunStatement:
        file = arguments if isinstance(arguments, str) else None
        modifiers = () if file is not None else arguments or ()
        if file is not None and model.text != "csv":
            say.file_of_model(self.report, at, model.text)
        experiments = [option.name for option in options if isinstance(option, Ended)]
        rest = tuple(option for option in options if not isinstance(option, Ended))
        self.once(at, [option[0] for option in rest] + ["experiment"] * len(experiments))
        return ast.RunStatement(name, model, modifiers, experiments[0] if experiments else None, rest, file, span=at)

    def once(self, at: Span, names: list[str]) -> None:
        for name in sorted({name for name in names if names.count(name) > 1}):
            say.option_twice(self.report, at, name)

    def run_arguments(self, _: Span, arguments: Any) -> Any:
        return arguments

    def reference_file(self, _: Span, file: str) -> str:
        return unescape(file)

    def run_experiment(self, at: Span, name: str) -> Ended:
        return Ended(name, at)

    def run_for(self, _: Span, value: ast.Expression) -> tuple[str, ast.Expression]:
        return "for", value

    def run_option(self, at: Span, name: str, value: ast.Expression) -> tuple[str, ast.Expression]:
        if name not in say.RUN_OPTIONS:
            say.run_option(self.report, at, name, did_you_mean(name, say.RUN_OPTIONS))
        return name, value

    def test_assertion(self, at: Span, condition: Any, percent: str | None, message: str | None) -> ast.TestAssertion:
        match condition:
            case ast.Binary(relation, left, ast.Binary("+-", wanted, tolerance)):
                compared = ast.Binary(relation, left, wanted, span=left.span.to(wanted.span))
                return ast.TestAssertion(compared, tolerance, percent is not None, _string(message), span=at)
        if percent is not None:
            say.percent(self.report, condition)
        return ast.TestAssertion(condition, None, False, _string(message), span=at)

    def expect_error(self, at: Span, code: str, model: ast.Reference, arguments: Any) -> ast.ExpectError:
        return ast.ExpectError(code, model, arguments or (), span=at)

    # ----------------------------------------------------------------------------------------------------- expressions

    def range(self, at: Span, start: Any, second: Any, third: Any) -> ast.Range:
        return ast.Range(start, None, second, span=at) if third is None else ast.Range(start, second, third, span=at)

    def if_expression(self, at: Span, condition: Any, then: Any, branches: Any, otherwise: Any) -> ast.If:
        return ast.If(((condition, then), *branches), otherwise, span=at)

    def binary(self, at: Span, left: Any, operator: str, right: Any) -> ast.Binary:
        if operator == "+-" and not self.in_test:
            start = at.start + at.text.index("+-", left.span.end - at.start) + 1
            return ast.Binary("+", left, ast.Unary("-", right, span=Span(self.source, start, at.end)), span=at)
        return ast.Binary(operator, left, right, span=at)

    def unary(self, at: Span, operator: str, operand: Any) -> ast.Unary:
        return ast.Unary(operator, operand, span=at)

    def number(self, at: Span, text: str) -> ast.Number:
        return ast.Number(float(text), text, span=at)

    def string(self, at: Span, text: str) -> ast.String:
        return ast.String(unescape(text), span=at)

    def true(self, at: Span, _: str) -> ast.Boolean:
        return ast.Boolean(True, span=at)

    def false(self, at: Span, _: str) -> ast.Boolean:
        return ast.Boolean(False, span=at)

    def end(self, at: Span, _: str) -> ast.End:
        return ast.End(span=at)

    def colon(self, at: Span) -> ast.Colon:
        return ast.Colon(span=at)

    def array(self, at: Span, *items: ast.Expression) -> ast.Array:
        return ast.Array(items, span=at)

    def comprehension(self, at: Span, body: ast.Expression, iterators: Any) -> ast.Comprehension:
        return ast.Comprehension(None, body, iterators, span=at)

    def reduction(self, at: Span, function: ast.Reference, body: ast.Expression, iterators: Any) -> ast.Comprehension:
        if function.text not in REDUCTIONS or any(part.subscripts for part in function.parts):
            say.reduction(self.report, function, REDUCTIONS)
        return ast.Comprehension(function.text, body, iterators, span=at)

    def matrix(self, at: Span, *rows: tuple[ast.Expression, ...]) -> ast.Matrix:
        return ast.Matrix(rows, span=at)

    def subscripted(self, at: Span, value: Any, subscripts: Any) -> ast.Subscripted:
        return ast.Subscripted(value, subscripts, span=at)

    def call(self, at: Span, function: ast.Reference, *arguments: Any) -> ast.Call:
        positional = tuple(a for a in arguments if not isinstance(a, tuple))
        if len(positional) == len(arguments):
            return ast.Call(function, positional, span=at)
        named = tuple(a for a in arguments if isinstance(a, tuple))
        if arguments[: len(positional)] != positional:
            say.positional_after_named(self.report, arguments)
        return ast.Call(function, positional, named, span=at)

    def named_argument(self, _: Span, name: str, value: ast.Expression) -> tuple[str, ast.Expression]:
        return name, value

    def reference(self, at: Span, *parts: ast.Part) -> ast.Reference:
        return ast.Reference(parts, span=at)

    def part(self, at: Span, name: str, subscripts: Any) -> ast.Part:
        return ast.Part(name, subscripts or (), span=at)
