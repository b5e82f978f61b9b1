"""What `bgc compare` and `bgc verify` refuse."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from bgdsl.cli.app import run

LEVER = Path(__file__).parents[2] / "models" / "lever_stiff.bg"


@pytest.fixture
def reduced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("lever_stiff.bg").write_text(LEVER.read_text())
    assert run(["condition", "lever_stiff.bg", "-e", "kick", "--threshold", "2.5%", "-o", "out/reduced.bg"]) == 0
    return Path("out/reduced.bg")


def refused(capsys: pytest.CaptureFixture[str], code: str, *arguments: str) -> bool:
    capsys.readouterr()
    return run(arguments) == 2 and f"error[{code}]" in capsys.readouterr().err


def test_the_full_model_in_a_folder_above(reduced: Path) -> None:
    assert run(["verify", str(reduced)]) == 0


def test_a_file_that_no_reduction_wrote(reduced: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert refused(capsys, "BG740", "verify", "lever_stiff.bg")


def test_the_full_model_has_changed(reduced: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("lever_stiff.bg").write_text(LEVER.read_text() + "// later\n")
    assert refused(capsys, "BG741", "verify", str(reduced))


def test_the_full_model_is_nowhere(reduced: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("lever_stiff.bg").rename("lever_full.bg")
    assert refused(capsys, "BG742", "verify", str(reduced))
    assert run(["verify", str(reduced), "--full", "lever_full.bg"]) == 0


def test_nothing_to_compare(reduced: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("other.bg").write_text("model Other J1 a; I b(I = 1); R c(R = 1); experiment kick(stopTime = 5); equation a -> b, c; end Other;")
    assert refused(capsys, "BG743", "compare", "lever_stiff.bg", "other.bg", "-e", "kick")


def test_an_output_that_is_not_there(reduced: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for option in ("--outputs", "--shaft"):
        assert refused(capsys, "BG743", "compare", "lever_stiff.bg", str(reduced), "-e", "kick", option, "massA.p,massC.p")
    assert refused(capsys, "BG743", "condition", "lever_stiff.bg", "-e", "kick", "--max-error", "9%", "--shaft", "crank", "-o", "x.bg")
    assert not Path("x.bg").exists()


@pytest.mark.parametrize("limit", [("--threshold", "100%"), ("--keep", "0")], ids=" ".join)
def test_states_that_fall_are_not_compared(reduced: Path, capsys: pytest.CaptureFixture[str], limit: tuple[str, str]) -> None:
    assert run(["condition", "lever_stiff.bg", "-e", "kick", *limit, "-o", "small.bg"]) == 0
    assert "massA.p" in capsys.readouterr().out


@pytest.mark.parametrize("text", [None, "{", '{"partitions": 3}', '{"partitions": [{"file": "a.bg"}]}'])
def test_a_folder_that_holds_no_partitions(reduced: Path, capsys: pytest.CaptureFixture[str], text: str | None) -> None:
    Path("parts").mkdir()
    if text is not None:
        Path("parts/partition.json").write_text(text)
    assert refused(capsys, "BG745", "compare", "lever_stiff.bg", "parts", "-e", "kick")


ZERO = """model Zero "a gear whose speeds obey their ratio"
  J1 a;  I ma(I = 2, f(start = 1));  C ka(k = 100);  R ra(R = 1e-4);
  TF gear(m = 3.1);
  J1 b;  I mb(I = 0.1);  R rb(R = 0.2);
  output Real speed = a.f;
  output Real zero = b.f - 0.7*a.f - 2.4*a.f;
  experiment swing(stopTime = 5);
equation
  a -> ma, ka, ra;  a -> gear -> b;  b -> mb, rb;
end Zero;
"""


def test_what_is_zero_but_for_round_off_has_no_error_of_its_own(reduced: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("zero.bg").write_text(ZERO)
    assert run(["condition", "zero.bg", "--threshold", "1%", "-o", "small.bg"]) == 0
    capsys.readouterr()
    assert run(["compare", "zero.bg", "small.bg", "--format", "json"]) == 0
    rows = {row["output"]: row["nrms"] for row in json.loads(capsys.readouterr().out)["reduced"][0]["outputs"]}
    assert 0 < rows["speed"] < 1e-3
    assert rows["zero"] < 1e-2
