"""Tree to text in one canonical layout: two spaces of indent, one statement a line, no parentheses but those needed.

`parse(print_tree(tree)) == tree` for every tree that the parser can make. Numbers keep their spelling. Comments are in no
node: the formatter, not this printer, is for text that a person wrote.
"""

from __future__ import annotations

from collections.abc import Iterable

from bgdsl.syntax import ast

INDENT = "  "

# How tightly an expression holds together, as the grammar's rules are nested.
_EXPRESSION, _SIMPLE, _AND, _NOT, _RELATION, _SUM, _PRODUCT, _SIGNED, _POWER, _PRIMARY = range(10)

_LEVELS = (
    dict.fromkeys(("or",), _SIMPLE)
    | dict.fromkeys(("and",), _AND)
    | dict.fromkeys(("==", "<>", "<", "<=", ">", ">="), _RELATION)
    | dict.fromkeys(("+", "-", ".+", ".-", "+-"), _SUM)
    | dict.fromkeys(("*", "/", ".*", "./"), _PRODUCT)
    | dict.fromkeys(("^", ".^"), _POWER)
)
_TIGHT = ("*", "/", "^")
_ESCAPED = {"\\": "\\", '"': '"', "\n": "n", "\t": "t", "\r": "r", "\a": "a", "\b": "b", "\f": "f", "\v": "v"}
_ESCAPES = str.maketrans({character: "\\" + letter for character, letter in _ESCAPED.items()})


def print_tree(node: ast.Node) -> str:
    """The text of a node; definitions and files end with a line end, smaller things do not."""
    match node:
        case ast.File(items):
            return _file(items)
        case ast.Model() | ast.LongFunction() | ast.Domain() | ast.Test():
            return "".join(f"{line}\n" for line in _lines(node, ""))
        case ast.Section() | ast.For() | ast.IfStatement() | ast.ForAssign():
            return "\n".join(_lines(node, ""))
        case ast.Modifier() | ast.Redeclaration():
            return _argument(node)
        case ast.Part() | ast.TypeName() | ast.Declarator() | ast.Iterator() | ast.Arrow() | ast.Comment():
            return _piece(node)
        case _ if type(node) in _SIMPLE_STATEMENTS:
            return _statement(node)
        case _:
            return print_expression(node)


# ---------------------------------------------------------------------------------------------------------- expressions


def print_expression(node: ast.Node, least: int = _EXPRESSION) -> str:
    """An expression, in parentheses if it holds less tightly than the place wants (`least`)."""
    level, text = _expression(node)
    return text if level >= least else f"({text})"


def _expression(node: ast.Node) -> tuple[int, str]:
    match node:
        case ast.Number(_, text):
            return _PRIMARY, text
        case ast.String(value):
            return _PRIMARY, quoted(value)
        case ast.Boolean(value):
            return _PRIMARY, "true" if value else "false"
        case ast.Colon():
            return _PRIMARY, ":"
        case ast.End():
            return _PRIMARY, "end"
        case ast.Reference(parts):
            return _PRIMARY, ".".join(map(_piece, parts))
        case ast.Unary(operator, operand):
            return _unary(operator, operand)
        case ast.Binary():
            return _binary(node)
        case ast.If(branches, otherwise):
            return _EXPRESSION, _if(branches, otherwise)
        case ast.Range(start, step, stop):
            return _EXPRESSION, ":".join(print_expression(part, _SIMPLE) for part in (start, step, stop) if part is not None)
        case _:
            return _PRIMARY, _bracketed(node)


def _bracketed(node: ast.Node) -> str:
    match node:
        case ast.Call(function, arguments, named):
            given = [*map(print_expression, arguments), *(f"{name} = {print_expression(value)}" for name, value in named)]
            return f"{print_expression(function)}({', '.join(given)})"
        case ast.Subscripted(value, subscripts):
            indexable = isinstance(value, ast.Call | ast.Subscripted | ast.Array | ast.Comprehension | ast.Matrix)
            text = print_expression(value)
            return (text if indexable else f"({text})") + _subscripts(subscripts)
        case ast.Array(items):
            return f"{{{', '.join(map(print_expression, items))}}}"
        case ast.Matrix(rows):
            return f"[{'; '.join(', '.join(map(print_expression, row)) for row in rows)}]"
        case ast.Comprehension(function, body, iterators):
            text = print_expression(body)
            if text.endswith("end"):  # `end for` would close a loop
                text = f"({text})"
            inner = f"{text} for {', '.join(map(_piece, iterators))}"
            return f"{{{inner}}}" if function is None else f"{function}({inner})"
        case _:
            raise TypeError(f"{type(node).__name__} cannot be printed as an expression")


def _unary(operator: str, operand: ast.Node) -> tuple[int, str]:
    if operator == "not":
        return _NOT, f"not {print_expression(operand, _NOT)}"
    text = print_expression(operand, _SIGNED)
    return _SIGNED, f"{operator} {text}" if operator == "+" and text.startswith("-") else operator + text


def _exponent(node: ast.Node) -> str:
    match node:
        case ast.Unary("+" | "-" as operator, operand):
            text = _exponent(operand)
            return f"{operator} {text}" if operator == "+" and text.startswith("-") else operator + text
        case _:
            return print_expression(node, _PRIMARY)


def _binary(node: ast.Binary) -> tuple[int, str]:
    """A chain of operators leans left and may be long: its spine is walked, not recursed into."""
    level = _LEVELS[node.operator]
    tail: list[str] = []
    left: ast.Node = node
    while isinstance(left, ast.Binary) and _LEVELS[left.operator] == level:
        right = _exponent(left.right) if level == _POWER else print_expression(left.right, level + 1)
        tail.append(f"{left.operator}{right}" if left.operator in _TIGHT else f" {left.operator} {right}")
        left = left.left
        if level in (_RELATION, _POWER):  # these do not chain
            break
    first = print_expression(left, {_RELATION: _SUM, _POWER: _PRIMARY}.get(level, level))
    if first.endswith(".") and tail[-1][0] != " ":  # `2.*x` would be read as `2 .* x`
        first += " "
    return level, first + "".join(reversed(tail))


def _if(branches: Iterable[tuple[ast.Node, ast.Node]], otherwise: ast.Node) -> str:
    tests = " elseif ".join(f"{print_expression(condition)} then {print_expression(value)}" for condition, value in branches)
    return f"if {tests} else {print_expression(otherwise)}"


def quoted(value: str) -> str:
    """A string as it is written."""
    return f'"{value.translate(_ESCAPES)}"'


def _subscripts(subscripts: Iterable[ast.Node]) -> str:
    inner = ", ".join(map(print_expression, subscripts))
    return f"[{inner}]" if inner else ""


# --------------------------------------------------------------------------------------------------- pieces of statements


def _piece(node: ast.Node) -> str:
    match node:
        case ast.Part(name, subscripts):
            return name + _subscripts(subscripts)
        case ast.TypeName(name, dims):
            return print_expression(name) + _subscripts(dims)
        case ast.Iterator(name, over):
            return f"{name} in {print_expression(over)}"
        case ast.Arrow() | ast.Comment():
            return node.text
        case ast.Declarator(name, dims, arguments, value, condition, comment):
            bound = f" = {print_expression(value)}" if value is not None else ""
            given = f" if {print_expression(condition)}" if condition is not None else ""
            return name + _subscripts(dims) + _arguments(arguments) + bound + given + _comment(comment)
        case _:
            raise TypeError(f"{type(node).__name__} cannot be printed as part of a statement")


def _comment(comment: str | None) -> str:
    return "" if comment is None else f" {quoted(comment)}"


def _arguments(arguments: Iterable[ast.Argument]) -> str:
    inner = ", ".join(map(_argument, arguments))
    return f"({inner})" if inner else ""


def _argument(node: ast.Argument) -> str:
    flags = ("each " if node.each else "") + ("final " if node.final else "")
    match node:
        case ast.Modifier(name, nested, value):
            inner = ", ".join(map(_argument, nested))
            bound = "" if value is None else f" = {print_expression(value)}"
            return flags + print_expression(name) + (f"({inner})" if nested or value is None else "") + bound
        case ast.Redeclaration():
            return f"{flags}redeclare {_redeclared(node)}"


def _redeclared(node: ast.Redeclaration) -> str:
    return f"{_piece(node.type)} {node.name}{_subscripts(node.subscripts)}{_arguments(node.arguments)}{_comment(node.comment)}"


# ----------------------------------------------------------------------------------------------------------- statements

_SIMPLE_STATEMENTS = (
    ast.Declaration, ast.Extends, ast.Experiment, ast.Annotation, ast.BondChain, ast.Equation, ast.Assertion, ast.Assign,
    ast.ShortFunction, ast.TypeDefinition, ast.DomainVariable, ast.RunStatement, ast.TestAssertion, ast.ExpectError, ast.Import,
)  # fmt: skip


def _statement(node: ast.Node) -> str:
    """A statement of one line, with its semicolon."""
    match node:
        case ast.Declaration(prefixes, of, declarators):
            return f"{' '.join((*prefixes, _piece(of)))} {', '.join(map(_piece, declarators))};"
        case ast.Redeclaration():
            return f"redeclare {'final ' if node.final else ''}{_redeclared(node)};"
        case ast.Extends(base, arguments):
            return f"extends {print_expression(base)}{_arguments(arguments)};"
        case ast.Experiment(name, parent, arguments, comment):
            of_parent = f" extends {parent}" if parent is not None else ""
            return f"experiment {name}{of_parent}{_arguments(arguments)}{_comment(comment)};"
        case ast.Annotation(arguments):
            return f"annotation({', '.join(map(_argument, arguments))});"
        case ast.BondChain(name, ends, arrows, comment):
            return f"{f'{name}: ' if name else ''}{_chain(ends, arrows)}{_comment(comment)};"
        case ast.Equation(left, right, comment):
            return f"{print_expression(left, _SIMPLE)} = {print_expression(right)}{_comment(comment)};"
        case ast.Assertion(condition, message):
            return f"assert({print_expression(condition)}, {print_expression(message)});"
        case ast.Assign(target, value):
            return f"{print_expression(target)} := {print_expression(value)};"
        case _:
            return _definition(node)


def _definition(node: ast.Node) -> str:
    match node:
        case ast.ShortFunction(name, inputs, body, comment):
            return f"function {name}({', '.join(map(_piece, inputs))}) = {print_expression(body)}{_comment(comment)};"
        case ast.TypeDefinition(name, of, arguments, comment):
            return f"type {name} = {_piece(of)}{_arguments(arguments)}{_comment(comment)};"
        case ast.DomainVariable(role, name, arguments, comment):
            return f"{role} Real {name}{_arguments(arguments)}{_comment(comment)};"
        case ast.Import(path, names):
            return _import(path, names)
        case _:
            return _test_statement(node)


def _import(path: tuple[str, ...], names: tuple[tuple[str, str], ...]) -> str:
    start = "".join(f"{part}." for part in path)
    match names:
        case ((name, alias),):
            return f"import {'' if name == alias else f'{alias} = '}{start}{name};"
        case _:
            return f"import {start}{{{', '.join(name for name, _ in names)}}};"


def _test_statement(node: ast.Node) -> str:
    match node:
        case ast.RunStatement(name, model, arguments, experiment, options, file):
            given = f"({quoted(file)})" if file is not None else _arguments(arguments)
            kick = f" experiment {experiment}" if experiment is not None else ""
            rest = "".join(f" {option} {print_expression(value, _SIMPLE)}" for option, value in options)
            return f"run {name} = {print_expression(model)}{given}{kick}{rest};"
        case ast.TestAssertion(condition, tolerance, relative, message):
            allowed = "" if tolerance is None else f" +- {print_expression(tolerance, _PRODUCT)}{' %' if relative else ''}"
            return f"assert {print_expression(condition)}{allowed}{_comment(message)};"
        case ast.ExpectError(code, model, arguments):
            return f"expect error {code} in {print_expression(model)}{_arguments(arguments)};"
        case _:
            raise TypeError(f"{type(node).__name__} cannot be printed as a statement")


def _chain(ends: tuple[tuple[ast.Reference, ...], ...], arrows: tuple[ast.Arrow, ...]) -> str:
    texts = [", ".join(map(print_expression, group)) for group in ends]
    return texts[0] + "".join(f" {arrow.text} {text}" for arrow, text in zip(arrows, texts[1:], strict=True))


# ------------------------------------------------------------------------------------------------------- many lines


def _file(items: tuple[ast.Node, ...]) -> str:
    lines: list[str] = []
    for before, item in zip((None, *items), items, strict=False):
        short = type(item) in _SIMPLE_STATEMENTS and type(before) is type(item)
        if before is not None and not short:
            lines.append("")
        lines += _lines(item, "")
    return "".join(f"{line}\n" for line in lines)


def _lines(node: ast.Node, indent: str) -> list[str]:
    """The lines of a statement or definition; nesting is limited by the parser."""
    inner = indent + INDENT
    match node:
        case ast.Model(kind, name, comment, items, sections):
            body = [line for item in items for line in _lines(item, inner)]
            body += [line for section in sections for line in _lines(section, indent)]
            return [f"{indent}{kind} {name}{_comment(comment)}", *body, f"{indent}end {name};"]
        case ast.Section(initial, statements):
            return [f"{indent}{'initial ' if initial else ''}equation", *_body(statements, inner)]
        case ast.For(iterators, body) | ast.ForAssign(iterators, body):
            head = f"{indent}for {', '.join(map(_piece, iterators))} loop"
            return [head, *_body(body, inner), f"{indent}end for;"]
        case ast.IfStatement(branches, otherwise):
            lines: list[str] = []
            for condition, statements in branches:
                lines.append(f"{indent}{'elseif' if lines else 'if'} {print_expression(condition)} then")
                lines += _body(statements, inner)
            if otherwise:
                lines += [f"{indent}else", *_body(otherwise, inner)]
            return [*lines, f"{indent}end if;"]
        case ast.LongFunction(name, comment, declarations, algorithm):
            head = f"{indent}function {name}{_comment(comment)}"
            steps = [f"{indent}algorithm", *_body(algorithm, inner)] if algorithm else []
            return [head, *_body(declarations, inner), *steps, f"{indent}end {name};"]
        case ast.Domain(name, comment, variables):
            return [f"{indent}domain {name}{_comment(comment)}", *_body(variables, inner), f"{indent}end {name};"]
        case ast.Test(name, statements):
            return [f"{indent}test {quoted(name)}", *_body(statements, inner), f"{indent}end;"]
        case _:
            return [indent + _statement(node)]


def _body(nodes: Iterable[ast.Node], indent: str) -> list[str]:
    return [line for node in nodes for line in _lines(node, indent)]
