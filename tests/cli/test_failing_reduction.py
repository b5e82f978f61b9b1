"""A reduced model that compiles and cannot be run: it is written, and said to fail."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from bgdsl import pipeline
from bgdsl.cli.app import run

TANK = """model Tank "drained a little faster than it is filled, while a pump pulsates on it"
  J0 level;  C volume(e = 1e3*sqrt(q), q(start = 1));
  Sf filling(f = 0.4), pump(f = 5*cos(20*time));  MSf drain(f = -0.5 - 1e-6*level.e);
  experiment day(stopTime = 4, interval = 0.1);
equation
  filling -> level;  drain -> level;  pump -> level;  level -> volume;
end Tank;
"""
COMMAND = ["condition", "tank.bg", "--threshold", "14%", "--no-guard", "-o", "dry.bg"]


@pytest.fixture(autouse=True)
def tank(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("tank.bg").write_text(TANK, "utf-8")


def test_the_file_is_there_and_its_failure_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(COMMAND) == 1
    out, err = capsys.readouterr()
    assert "1 of 4 terms dropped" in out
    assert "error[BG630]: `level.e` is nan" in err
    assert "dry.bg is written and compiles, but its run fails" in err
    assert "filling" not in {element.name for element in pipeline.load(Path("dry.bg")).graph.elements}


def test_the_document_is_whole(capsys: pytest.CaptureFixture[str]) -> None:
    assert run([*COMMAND, "--format", "json"]) == 1
    document = json.loads(capsys.readouterr().out)
    assert document["accuracy"] is None
    assert document["failure"][0]["code"] == "BG630"
    assert [term["term"] for term in document["dropped"]] == ["filling"]
