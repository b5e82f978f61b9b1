"""pytest collects test blocks where it is asked to, and other projects never notice the plugin."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

SUITE = """\
model Decay
  J1 v;  I mass(I = 1, f(start = 1));  R damper(R = 1);
equation
  v -> mass, damper;
end Decay;

test "starts at one"
  run r = Decay for 0.1;
  assert r.v.f(0) == 1;
end;

test "starts at two"
  run r = Decay for 0.1;
  assert r.v.f(0) == 2;
end;

test "starts at two"
  run r = Decay for 0.1;
  assert r.v.f(0) > 0;
end;
"""


def pytest_in(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=100)


@pytest.fixture
def suite(tmp_path: Path) -> Path:
    (tmp_path / "suite.bg").write_text(SUITE)
    (tmp_path / "pytest.ini").write_text("[pytest]\nbg_tests = true\n")
    return tmp_path


def test_blocks_are_tests(suite: Path) -> None:
    done = pytest_in(suite)
    assert done.returncode == 1
    assert "1 failed, 2 passed" in done.stdout
    assert "error[BG650]" in done.stdout and "wanted == 2" in done.stdout
    assert "Traceback" not in done.stdout and "runtest" not in done.stdout


def test_a_file_that_cannot_be_read(suite: Path) -> None:
    (suite / "suite.bg").write_text('test "x" assert 1 >; end;')
    done = pytest_in(suite)
    assert done.returncode == 2
    assert "error[BG1" in done.stdout and "Traceback" not in done.stdout


def test_other_projects_are_left_alone(tmp_path: Path) -> None:
    (tmp_path / "notes.bg").write_text("no bond graph at all {")
    (tmp_path / "test_it.py").write_text("import sys\ndef test_it(): assert not [m for m in sys.modules if m.startswith('bgdsl.p')]\n")
    done = pytest_in(tmp_path, "--strict-config", "-W", "error")
    assert done.returncode == 0, done.stdout
    assert "1 passed" in done.stdout
