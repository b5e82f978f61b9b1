"""Trees made at random: printed, they are read back as they were; formatting keeps them and every comment."""

from __future__ import annotations

import random

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bgdsl.diagnostics import Reporter, render
from bgdsl.source import Source
from bgdsl.syntax import ast
from bgdsl.syntax.formatter import format_source
from bgdsl.syntax.lexer import tokenize
from bgdsl.syntax.parser import parse
from bgdsl.syntax.printer import print_tree
from bgdsl.testing import trees

SLOW = settings(deadline=None, max_examples=60, suppress_health_check=list(HealthCheck))


def read(text: str) -> ast.File:
    report = Reporter()
    tree = parse(Source("made.bg", text), report)
    assert not report.diagnostics, render(report.diagnostics) + "\n" + text
    return tree


@SLOW
@given(trees.files())
def test_a_printed_tree_is_read_back(tree: ast.File) -> None:
    assert read(print_tree(tree)) == tree


@SLOW
@given(trees.expressions(20))
def test_a_printed_expression_is_read_back(node: ast.Expression) -> None:
    (model,) = read(f"model M\nequation\n  x = {print_tree(node)};\nend M;\n").items
    assert isinstance(model, ast.Model)
    (statement,) = model.sections[0].statements
    assert isinstance(statement, ast.Equation)
    assert statement.right == node


def test_the_property_can_fail() -> None:
    """A printer without parentheses would be caught."""
    assert read("model M equation x = (a + b)*c; end M;") != read("model M equation x = a + b*c; end M;")


@SLOW
@given(trees.files(), st.randoms(use_true_random=False))
def test_formatting_keeps_tree_and_comments(tree: ast.File, rng: random.Random) -> None:
    text = scrambled(print_tree(tree), rng)
    report = Reporter()
    formatted = format_source(Source("made.bg", text), report)
    again = read(formatted)
    assert again == tree
    wanted = [comment.text.rstrip() for comment in read(text).comments]
    assert [comment.text for comment in again.comments] == wanted
    assert format_source(Source("made.bg", formatted), Reporter()) == formatted
    assert not any(line.endswith(" ") for line in formatted.split("\n") if '"' not in line and "*" not in line)


def scrambled(text: str, rng: random.Random) -> str:
    """The same tokens with other spaces, line breaks and comments between them."""
    tokens = tokenize(text)
    pieces: list[str] = []
    for number, token in enumerate(tokens.texts):
        if number and tokens.kinds[number] == "NAME" and tokens.kinds[number - 1] == "INITIAL_EQUATION":
            pieces.append(" ")
        pieces.append(token)
        pieces.append(rng.choice([" ", " ", " ", "  ", "\t", "\n", "\n\n\n", f" // note {number}\n", f" /* part {number} */ ", "\r\n"]))
    return "".join(pieces)


@pytest.mark.parametrize("spelling", ["1", "1.0", "1e0", "10e-1"])
def test_numbers_keep_their_spelling(spelling: str) -> None:
    tree = read(f"model M Real x = {spelling}; end M;")
    assert f"x = {spelling};" in print_tree(tree)
