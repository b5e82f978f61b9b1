"""What is said about text that is not `.bg`: the codes BG1xx and the wording of their messages."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from bgdsl.diagnostics import Code, Reporter, listed
from bgdsl.source import Span
from bgdsl.syntax import ast

UNEXPECTED = Code("BG101", "something else should stand here")
FOREIGN = Code("BG102", "a sign that `.bg` does not have")
UNCLOSED_TEXT = Code("BG103", "a string or a comment is not closed")
END_MISMATCH = Code("BG104", "an `end` does not fit what it closes")
UNCLOSED_BRACKET = Code("BG105", "a bracket is not closed")
MISSING_SEMICOLON = Code("BG106", "a `;` is missing")
TOO_DEEP = Code("BG107", "nested too deep")
UNREADABLE = Code("BG108", "a file cannot be read")
NO_STATEMENT = Code("BG110", "an expression alone is no statement")
ARGUMENT_ORDER = Code("BG111", "an argument without a name follows one with a name")
NO_REDUCTION = Code("BG112", "only `sum`, `product`, `min` and `max` take `for`")
MISSPELT = Code("BG113", "a keyword is misspelt")
MISSING_END = Code("BG114", "an `end` is missing")
WRONG_EQUALS = Code("BG115", "`=`, `==` and `:=` are mixed up")
RUN_OPTION = Code("BG116", "a test's `run` has no such option")

RUN_OPTIONS = ("for", "interval", "tolerance", "method", "experiment")


def _kinds(names: str) -> frozenset[str]:
    return frozenset(names.split())


_OPERATORS = _kinds("OR AND RELATION PLUS MINUS TIMES DIVIDE POWER DOT_PLUS DOT_MINUS DOT_TIMES DOT_DIVIDE DOT_POWER PLUS_MINUS")
_EXPRESSION_STARTS = _kinds("NAME NUMBER STRING TRUE FALSE END_INDEX NOT PLUS MINUS LPAR LBRACE LSQB IF COLON")
_PREFIXES = _kinds("PARAMETER CONSTANT INPUT OUTPUT OPEN FINAL REPLACEABLE PROTECTED PORT")
_DEFINITIONS = _kinds("MODEL ELEMENT FUNCTION TYPE DOMAIN TEST IMPORT")
SIGNS_OF_BONDS = ("->", "=>", "->|", "=>|", "|->", "|=>")


def found(kind: str, text: str) -> str:
    """A token in words."""
    match kind:
        case "$END":
            return "the end of the file"
        case "NAME":
            return f"the name `{text}`"
        case "NUMBER":
            return f"the number `{text}`"
        case "STRING":
            return "a string" if len(text) > 30 or "\n" in text else f"the string `{text}`"
        case "END_INDEX":
            return "`end`"
        case _:
            return f"the word `{text}`" if text.isidentifier() else f"`{text}`"


def wanted(kinds: frozenset[str], shown: Mapping[str, str]) -> str:
    """What could stand somewhere, in words."""
    left = set(kinds)
    phrases: list[str] = []

    def group(words: str, members: Iterable[str]) -> None:
        phrases.append(words)
        left.difference_update(members)

    if "NUMBER" in left:
        group("an expression", _EXPRESSION_STARTS)
    if {"PARAMETER", "NAME"} <= left:
        items = _PREFIXES | {"NAME", "REDECLARE", "EXTENDS", "EXPERIMENT", "ANNOTATION"}
        group("a declaration", items | (_DEFINITIONS if "EQUATION" in left else set()))
    if {"MODEL", "FUNCTION"} <= left:
        group("a definition (`model`, `element`, `function`, `domain`, `type` or `test`)", _DEFINITIONS)
    if len(_OPERATORS & left) > 1:
        group("an operator", _OPERATORS)
    arrows = {kind for kind in left if shown.get(kind) in SIGNS_OF_BONDS}
    if arrows:
        group("a bond (`->` or `=>`)", arrows)
    if "NAME" in left:
        group("a name", ["NAME", "EACH", "FINAL", "REDECLARE"])
    if "STRING" in left:
        group("a description" if left - {"STRING"} else "a string", ["STRING"])
    if "INITIAL_EQUATION" in left:
        left.discard("INITIAL_EQUATION")
    closers = [f"`{shown.get(kind, kind.lower())}`" for kind in sorted(left) if kind != "$END"]
    last = ["the end of the file"] if "$END" in left else []
    return alternatives([*closers, *phrases, *last])


def alternatives(words: list[str]) -> str:
    """`a, b or c`."""
    return " or ".join(filter(None, [", ".join(words[:-1]), words[-1]])) if words else "nothing"


def end_mismatch(report: Reporter, at: Span, kind: str, name: str, end: Span, found: str) -> None:
    opening = Span(at.source, at.start, at.start + at.text.find(name) + len(name))
    report.add(
        END_MISMATCH,
        f"`end {found};` does not close {kind} `{name}`",
        end,
        f"should be `end {name};`",
        others=[(opening, f"{kind} `{name}` starts here")],
    )


def redeclared_prefix(report: Reporter, at: Span, prefix: str, name: str) -> None:
    helps = (f"a value is changed where the class is extended or used: `({name} = ...)`",) if prefix in ("parameter", "constant") else ()
    where = at.text.find(prefix)
    report.add(
        UNEXPECTED,
        f"`redeclare` changes the class of `{name}`; it cannot make it `{prefix}`",
        Span(at.source, at.start + where, at.start + where + len(prefix)),
        f"leave out `{prefix}`",
        helps=helps,
    )


def lone_expression(report: Reporter, value: Any) -> None:
    match value:
        case ast.Binary("==", left, right):
            report.add(
                WRONG_EQUALS,
                "an equation is written with `=`",
                Span(value.span.source, left.span.end, right.span.start),
                "`==` only compares",
                helps=[f"write `{left.span.text} = {right.span.text};`"],
            )
        case ast.Call(ast.Reference((ast.Part("assert"),))):
            report.add(NO_STATEMENT, "`assert` takes a condition and a message", value.span, 'write `assert(condition, "message");`')
        case ast.Call(ast.Reference((ast.Part("connect"),)), (a, b)):
            helps = [f"write `{a.span.text} -> {b.span.text};`"]
            report.add(NO_STATEMENT, "a bond is drawn with an arrow", value.span, "`connect` is not of this language", helps=helps)
        case _:
            report.add(
                NO_STATEMENT,
                "an expression alone is no statement",
                value.span,
                "what should it equal, or where does its bond go?",
                helps=["an equation is `x = expression;`, a bond is `a -> b;`"],
            )


def domain_variable_type(report: Reporter, at: Span, role: str, kind: str) -> None:
    report.add(UNEXPECTED, f"the {role} of a domain is a `Real`, not a `{kind}`", at, f"write `{role} Real name(unit = ...);`")


def positional_after_named(report: Reporter, arguments: Iterable[Any]) -> None:
    named: Any = None
    for argument in arguments:
        if isinstance(argument, tuple):
            named = named or argument
        elif named is not None:
            report.add(
                ARGUMENT_ORDER,
                f"an argument without a name follows `{named[0]} = ...`",
                argument.span,
                "this has no name",
                others=[(named[1].span, f"`{named[0]}` is given by name")],
            )
            return


def reduction(report: Reporter, function: ast.Reference, known: Iterable[str]) -> None:
    report.add(
        NO_REDUCTION,
        f"`{function.text}` cannot take `for`",
        function.span,
        "not a reduction",
        helps=[f"these can: {listed(known, 99)}; an array is `{{{function.text}(i) for i in ...}}`"],
    )


def run_option(report: Reporter, at: Span, name: str, close: tuple[str, ...]) -> None:
    report.add(
        RUN_OPTION,
        f"a run has no option `{name}`",
        at,
        "unknown option",
        notes=[f"a run's options are {listed(RUN_OPTIONS, 99)}"],
        helps=close,
    )


def option_twice(report: Reporter, at: Span, name: str) -> None:
    report.add(RUN_OPTION, f"a run's option `{name}` is given twice", at, "in this run")


def file_of_model(report: Reporter, at: Span, name: str) -> None:
    report.add(
        UNEXPECTED, f"`{name}` takes modifications, not a string", at, 'only `csv("file.csv")` reads a file', helps=["write `name = value`"]
    )


def percent(report: Reporter, condition: ast.Expression) -> None:
    report.add(UNEXPECTED, "`%` belongs to a tolerance", condition.span, "no tolerance here", helps=["write `assert x == wanted +- 2 %;`"])


def too_deep(report: Reporter, span: Span, limit: int) -> None:
    report.add(
        TOO_DEEP,
        "this nests too deep",
        span,
        f"more than {limit} levels of brackets, operators or statements",
        helps=["give parts of it names of their own"],
    )
