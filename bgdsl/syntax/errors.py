"""What is said about text that is not `.bg`: the codes BG1xx and the wording of their messages."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from bgdsl.diagnostics import Code, Reporter
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
NOT_TEXT = Code("BG109", "a file is not UTF-8 text")
NO_STATEMENT = Code("BG110", "an expression alone is no statement")
ARGUMENT_ORDER = Code("BG111", "an argument without a name follows one with a name")
NO_REDUCTION = Code("BG112", "only `sum`, `product`, `min` and `max` take `for`")
MISSPELT = Code("BG113", "a keyword is misspelt")
MISSING_END = Code("BG114", "an `end` is missing")
WRONG_EQUALS = Code("BG115", "`=`, `==` and `:=` are mixed up")
RUN_OPTION = Code("BG116", "a test's `run` has no such option")

RUN_OPTIONS = ("for", "interval", "tolerance", "method", "experiment")


def end_mismatch(report: Reporter, at: Span, kind: str, name: str, end: Span, found: str) -> None:
    opening = Span(at.source, at.start, at.start + at.text.find(name) + len(name))
    report.add(
        END_MISMATCH,
        f"`end {found};` does not close {kind} `{name}`",
        end,
        f"should be `end {name};`",
        others=[(opening, f"{kind} `{name}` starts here")],
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
        helps=[f"these can: {', '.join(f'`{name}`' for name in known)}; an array is `{{{function.text}(i) for i in ...}}`"],
    )


def run_option(report: Reporter, at: Span, name: str, close: tuple[str, ...]) -> None:
    known = ", ".join(f"`{option}`" for option in RUN_OPTIONS)
    report.add(RUN_OPTION, f"a run has no option `{name}`", at, "unknown option", notes=[f"a run's options are {known}"], helps=close)


def option_twice(report: Reporter, at: Span, name: str) -> None:
    report.add(RUN_OPTION, f"a run's option `{name}` is given twice", at, "in this run")


def file_of_model(report: Reporter, at: Span, name: str) -> None:
    report.add(
        UNEXPECTED, f"`{name}` takes modifications, not a string", at, 'only `csv("file.csv")` reads a file', helps=["write `name = value`"]
    )


def percent(report: Reporter, condition: ast.Expression) -> None:
    report.add(UNEXPECTED, "`%` belongs to a tolerance", condition.span, "no tolerance here", helps=["write `assert x == wanted +- 2 %;`"])
