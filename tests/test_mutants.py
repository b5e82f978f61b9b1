"""Models with a few words exchanged, dropped or replaced: whatever they have become, the compiler says it in diagnostics."""

from __future__ import annotations

from pathlib import Path
from random import Random

import pytest

from bgdsl import pipeline
from bgdsl.source import Source
from bgdsl.syntax.lexer import tokenize

ROOT = Path(__file__).parent
FILES = sorted(
    path
    for folder in (ROOT / "cases", ROOT / "models", ROOT / "physics" / "models", ROOT.parent / "models")
    for path in folder.rglob("*.bg")
    if path.stat().st_size < 3000
)
WORDS = (
    *("C", "I", "R", "Se", "Sf", "MSf", "TF", "MTF", "GY", "J0", "J1", "Real", "Integer", "time", "der", "x"),
    *("0", "-1", "1e300", "1/0", "sqrt(-1)", "{1, 2}", "[1, 2; 3, 4]", "true", '"a"', "(2)", "[1]", ".e", "", "", ""),
    *("+", "*", "/", "^", ".*", "->", "=>", "=", "==", ",", ";"),
)


def mutant(text: str, random: Random) -> str:
    """The text with one of its tokens replaced: by nothing, by another of its own, or by a word of the language."""
    tokens = tokenize(text)
    at = random.randrange(len(tokens.texts))
    start, old = tokens.starts[at], tokens.texts[at]
    new = random.choice(WORDS if random.random() < 0.5 else tokens.texts)
    return text[:start] + new + text[start + len(old) :]


@pytest.mark.parametrize("part", range(4))
def test_mutants_give_diagnostics_only(part: int) -> None:
    for path in FILES[part::4]:
        random = Random(path.name)  # a new file changes nothing for the others
        for changes in (1, 2, 3):
            text = path.read_text("utf-8")
            for _ in range(changes):
                text = mutant(text, random)
            try:
                pipeline.check_source(Source(path.name, text, path))
            except Exception as error:
                pytest.fail(f"{type(error).__name__}: {error}, from {path.name} as\n{text}")
