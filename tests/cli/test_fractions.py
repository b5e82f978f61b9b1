"""Shares of one on the command line: fractions and percentages."""

import pytest
import typer

from bgdsl.cli.arguments import fraction


@pytest.mark.parametrize(
    ("text", "value"), [("0.35%", 0.0035), ("8%", 0.08), ("0.3%", 0.003), ("1e-3%", 1e-5), ("0.003", 0.003), ("100%", 1.0)]
)
def test_a_percentage_is_the_fraction_that_a_person_would_write(text: str, value: float) -> None:
    assert fraction(text, "--threshold") == value


@pytest.mark.parametrize("text", ["nan", "nan%", "inf", "-1%", "-0.1", "x%", "1%%", "", "%", "101%", "3"])
def test_what_is_no_share_is_refused(text: str) -> None:
    with pytest.raises(typer.BadParameter):
        fraction(text, "--threshold")
