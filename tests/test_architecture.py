"""The architecture as it is described: floors, contracts of passes, and a page that names what is there."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
MODULES = sorted(path for path in (ROOT / "bgdsl").rglob("*.py") if not path.name.startswith("__"))
PASSES = ("modules", "flatten", "domains", "units", "scalar", "causality", "equations", "reduce_index", "sorting", "lower")


def test_a_module_imports_only_from_floors_below_it(monkeypatch: pytest.MonkeyPatch) -> None:
    cli = pytest.importorskip("importlinter.cli", reason="import-linter is a development tool")
    monkeypatch.chdir(ROOT)
    assert cli.lint_imports(no_cache=True) == 0


def test_the_page_of_the_architecture_names_every_module() -> None:
    page = (ROOT / "docs" / "architecture.md").read_text("utf-8")
    named = set(re.findall(r"\b(\w+)(?:\.py)?\b", page))
    assert not [str(path.relative_to(ROOT)) for path in MODULES if path.stem not in named]


@pytest.mark.parametrize("name", [*PASSES, "activity", "dependencies", "subgraphs", "freezing"])
def test_a_pass_states_its_contract(name: str) -> None:
    text = ast.get_docstring(ast.parse((ROOT / "bgdsl" / "passes" / f"{name}.py").read_text("utf-8"))) or ""
    heads = [line.split()[0] for line in text.splitlines() if re.match(r"(Input|Output|Establishes|Reports) ", line)]
    assert heads == ["Input", "Output", "Establishes", "Reports"]


def test_no_two_test_files_have_one_name() -> None:
    names = [path.name for path in (ROOT / "tests").rglob("test_*.py")]
    assert len(names) == len(set(names)), "pytest collects files of one name only once"
