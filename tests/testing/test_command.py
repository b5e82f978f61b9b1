"""`bgc test`: exit statuses, what is printed, JSON."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from bgdsl.cli.app import run

GOOD = 'test "one is positive" assert 1 > 0; end;\n'
BAD = 'test "one is negative" assert 1 < 0; end;\n'
WRONG = 'test "unknown" assert r.x < 0; end;\n'
BROKEN = 'test "broken" assert 1 >; end;\n'


@pytest.mark.parametrize(
    ("text", "status", "total"),
    [
        (GOOD, 0, "1 passed, 0 failed"),
        (GOOD + BAD, 1, "1 passed, 1 failed"),
        (GOOD + BAD + WRONG, 2, "1 passed, 1 failed, 1 could not be carried out"),
        (BROKEN, 2, "no tests"),
        ("model M end M;", 0, "no tests"),
    ],
)
def test_statuses(text: str, status: int, total: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "suite.bg").write_text(text)
    assert run(["test", str(tmp_path)]) == status
    streams = capsys.readouterr()
    assert streams.out.splitlines()[-1] == total
    assert ("error[BG" in streams.err) == (status > 0)


def test_a_file_that_is_not_there(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["test", "absent.bg"]) == 2
    assert "there is no file `absent.bg`" in capsys.readouterr().err


def test_only_some(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "suite.bg").write_text(GOOD + BAD)
    assert run(["test", "-k", "positive", str(tmp_path)]) == 0
    assert "one is positive" in capsys.readouterr().out


def test_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "suite.bg").write_text(GOOD + 'test "nan" assert 0*log(-1) == 1 +- 0.5; end;\n' + WRONG)
    (tmp_path / "test_broken.bg").write_text(BROKEN)
    assert run(["test", "--format", "json", str(tmp_path)]) == 2
    found = json.loads(capsys.readouterr().out, parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))
    assert (found["passed"], found["failed"], found["errors"]) == (1, 1, 1)
    assert [t["passed"] for t in found["tests"]] == [True, False, False]
    assert found["tests"][1]["findings"][0]["worst"] == {"time": None, "entry": None, "value": None, "wanted": 1.0, "allowed": 0.5}
    assert found["tests"][2]["findings"][0]["code"] == "BG652"
    assert [f["code"][:3] for f in found["unreadable"]] == ["BG1"]
