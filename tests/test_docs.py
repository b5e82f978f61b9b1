"""Every code block in the README and in docs/ is run.

A page is a story: its blocks run in order in one folder. ```bg blocks are files (`// file: name.bg` as first line names them)
and must pass `bgc check`, or report what `// error: BG230` at their head says; ```python blocks run; in ```console blocks the lines
after `$ ` are commands (`bgc`, `cat`, `diff`), and what they print must match what the page shows, where a line `...` stands for any
lines, `...` in a line for any text, `~1.2` for any number, and two spaces for two or more.
"""

from __future__ import annotations

import importlib
import io
import re
import shlex
import shutil
import subprocess
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import pytest

from bgdsl import pipeline
from bgdsl.cli.app import run
from bgdsl.testing.runner import run_file

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```", re.MULTILINE | re.DOTALL)
SHOWN = {"text", "json", "toml", "sh"}  # pictures and shapes, not to be run


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_page(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    shutil.copytree(ROOT / "models", tmp_path / "models")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)  # as in an interpreter that is started there
    names: dict[str, object] = {}
    text_of_page = page.read_text("utf-8")
    for i, match in enumerate(BLOCK.finditer(text_of_page)):
        language, text = match[1], match[2]
        if language == "bg":
            named = re.match(r"// file: (\S+)\n", text)
            file = tmp_path / (named[1] if named else f"block{i}.bg")
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text, "utf-8")
            wanted = re.match(r"(?:// file: .*\n)?// error: (BG\d+)\n", text)
            found = {d.code.number: d.message for d in pipeline.check_file(file) if d.severity == "error"}
            assert set(found) == ({wanted[1]} if wanted else set()), found
            if "$ bgc test" not in text_of_page and not wanted:  # a page that shows how tests fail runs them itself
                assert [outcome.name for outcome in run_file(file) if not outcome.passed] == []
        elif language == "python":
            importlib.invalidate_caches()  # a command may have written a module just now
            exec(compile(text, f"{page.name} block {i}", "exec"), names)
            capsys.readouterr()
        elif language == "console":
            _console(text)
        else:
            assert language in SHOWN, f"a block in `{language}` is neither run nor known to be a picture"


def _console(text: str) -> None:
    for command, shown in re.findall(r"^\$ (.*)\n((?:(?!\$ ).*\n?)*)", text, re.MULTILINE):
        words = shlex.split(command, comments=True)
        if words[0] in ("cat", "diff"):
            printed = subprocess.run(words, capture_output=True, text=True).stdout
        else:
            assert words[0] == "bgc", command
            terminal = io.StringIO()
            with redirect_stdout(terminal), redirect_stderr(terminal):
                run(words[1:])
            printed = terminal.getvalue()
        assert re.fullmatch(_pattern(shown), printed.strip() + "\n"), f"$ {command}\n{printed}"


def _pattern(shown: str) -> str:
    lines = []
    for line in shown.strip().splitlines():
        if line.strip() == "...":
            lines.append(r"(?:.*\n)*?")
        elif set(line) <= set("- ") and "-" in line:  # the rule below the heads of a table is as wide as its numbers
            lines.append(r"[- ]+\n")
        else:
            text = re.sub(NUMBER, r"[-+\\d.e]+", re.escape(line.rstrip()).replace(r"\~", "~"))
            lines.append(re.sub(r"(?:\\ ){2,}", " {2,}", text).replace(r"\.\.\.", ".*") + r" *\n")
    return "".join(lines) or r"(?:.*\n)*"


NUMBER = re.compile(r"~(?:\\-)?(?:\\?[\d.])+(?:e(?:\\[-+])?\d+)?")
"""`~` and a number, escaped for a regular expression."""


@pytest.mark.parametrize("page", [*PAGES, ROOT / "CHANGES.md"], ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    text = re.sub(r"^```.*?^```", "", page.read_text("utf-8"), flags=re.MULTILINE | re.DOTALL)
    text = re.sub(r"`[^`]+`", "", text)  # code is no link: `cyl[1](m = 2)`
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        path, _, anchor = target.partition("#")
        if "://" in target:
            continue
        found = page.parent / path if path else page
        assert found.exists(), f"{page.name} links to {target}"
        if anchor:
            heads = [
                re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in re.findall(r"^#+ (.*)$", found.read_text("utf-8"), re.M)
            ]
            assert anchor in heads, f"{page.name} links to {target}"
