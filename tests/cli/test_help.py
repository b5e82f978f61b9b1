"""Help: every command has its place on a panel, and its paragraph in the page of the commands."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import typer

from bgdsl.cli.app import PANELS, app, run

PAGE = Path(__file__).parents[2] / "docs" / "commands.md"


@pytest.fixture(scope="module")
def commands() -> dict[str, Any]:
    run(["explain"])  # registers the commands
    group: Any = typer.main.get_command(app)
    return dict(group.commands)


def test_every_command_is_on_a_panel(commands: dict[str, Any]) -> None:
    assert sorted(commands) == sorted(name for names in PANELS.values() for name in names)


def test_every_command_has_its_paragraph(commands: dict[str, Any]) -> None:
    page = PAGE.read_text("utf-8")
    assert [name for name in commands if f"**`bgc {name}" not in page] == []


def test_every_option_is_told(commands: dict[str, Any]) -> None:
    page = PAGE.read_text("utf-8")
    options = {option for command in commands.values() for p in command.params for option in p.opts if option.startswith("--")}
    assert sorted(option for option in options - {"--help"} if not re.search(rf"{option}\b", page)) == []


def test_help_shows_the_panels_in_order(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["--help"]) == 0
    shown = capsys.readouterr().out
    places = [shown.index(panel) for panel in PANELS]
    assert places == sorted(places)
