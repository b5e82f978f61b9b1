"""Every file under tests/cases says in its first line what checking it must find: `// ok`, `// error: BG401` or `// warning: BG410`.

Several codes are separated by commas; the file must report these and no other.
"""

from __future__ import annotations

import importlib
import pkgutil
import re
from pathlib import Path

import pytest

import bgdsl
from bgdsl import pipeline
from bgdsl.diagnostics import CODES, Diagnostic
from bgdsl.explanations import explanation, titles

CASES = Path(__file__).parent / "cases"
EXPECTATION = re.compile(r"//\s*(ok|error|warning)\b:?\s*([A-Z0-9, ]*)")


def expected(text: str) -> tuple[str, set[str]]:
    match = EXPECTATION.match(text)
    assert match, "the first line must say what is expected"
    return match[1], {code.strip() for code in match[2].split(",") if code.strip()}


def found(path: Path) -> list[Diagnostic]:
    return pipeline.check_file(path)


@pytest.mark.parametrize("path", sorted(CASES.rglob("*.bg")), ids=lambda path: str(path.relative_to(CASES)))
def test_case(path: Path) -> None:
    text = path.read_text("utf-8", errors="replace")
    if text.startswith("// part"):
        pytest.skip("imported by another case")
    kind, codes = expected(text)
    diagnostics = found(path)
    shown = {d.code.number for d in diagnostics if kind == "ok" or d.severity == kind or d.severity == "error"}
    assert shown == codes, [f"{d.code.number}: {d.message}" for d in diagnostics]


def test_every_code_has_a_case_and_a_page() -> None:
    for module in pkgutil.walk_packages(bgdsl.__path__, "bgdsl."):  # codes are declared as modules are imported
        importlib.import_module(module.name)
    pages = titles()
    cases = "\n".join(path.read_text("utf-8", errors="replace").partition("\n")[0] for path in CASES.rglob("*.bg"))
    run_time = {number for number in CODES if number.startswith(("BG6", "BG7"))}  # found by running, tested where they are raised
    tested = "\n".join(path.read_text("utf-8") for path in Path(__file__).parent.rglob("test_*.py"))
    assert sorted(set(CODES) - set(pages)) == [], "codes without a page"
    assert sorted(set(pages) - set(CODES)) == [], "pages of codes that do not exist"
    assert sorted(number for number in set(CODES) - run_time if number not in cases and number not in tested) == [], "codes without a case"
    assert sorted(number for number in run_time if number not in cases and number not in tested) == [], "codes without a test"


def blocks(number: str) -> list[str]:
    page = explanation(number)
    assert page is not None
    return re.findall(r"^```bg\n(.*?)^```", page, re.MULTILINE | re.DOTALL)


ABOUT_FILES = {"BG108"}  # said of a file that cannot be read, and where a command needs a model and the file has none


@pytest.mark.parametrize("number", sorted(number for number in titles() if number < "BG6" and number not in ABOUT_FILES))
def test_the_examples_of_a_page(number: str, tmp_path: Path) -> None:
    examples = blocks(number)
    assert len(examples) >= 1, "a page shows a wrong example, and where there is a cure the corrected one"
    for i, text in enumerate(examples):
        path = tmp_path / f"example{i}.bg"
        path.write_text(text, "utf-8")
        codes = {d.code.number for d in found(path)}
        if i == 0:
            assert number in codes, "the first example must be wrong in this way"
        else:
            assert number not in codes, "the other examples must not be wrong in this way"
