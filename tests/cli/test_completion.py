"""Completion of commands and options, as a shell asks for it."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

FAR = "from bgdsl.cli import main; main()"


def asked(**environment: str) -> str:
    done = subprocess.run([sys.executable, "-c", FAR], env={**os.environ, **environment}, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize(
    ("words", "completed"),
    [
        ("bgc sim", ["simulate"]),
        ("bgc simulate --me", ["--method"]),
        ("bgc show lever.bg --format ", ["text", "json"]),
        ("bgc activity lever.bg --format ", ["text", "json", "csv"]),
        ("bgc par", ["partition"]),
    ],
)
def test_bash(words: str, completed: list[str]) -> None:
    position = str(len(words.split()) - (0 if words.endswith(" ") else 1))
    assert asked(_BGC_COMPLETE="complete_bash", COMP_WORDS=words, COMP_CWORD=position).split() == completed


def test_zsh_shows_what_a_command_does() -> None:
    found = asked(_BGC_COMPLETE="complete_zsh", _TYPER_COMPLETE_ARGS="bgc veri")
    assert '"verify":"Run the full model again' in found


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_script_for_a_shell(shell: str) -> None:
    command = [sys.executable, "-m", "bgdsl", "--show-completion", shell]
    environment = {**os.environ, "_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0 and "_BGC_COMPLETE" in done.stdout
