"""The command line as scripts rely on it: exit statuses, streams, files, JSON."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from bgdsl.cli.app import run

MODELS = Path(__file__).parents[2] / "models"
LEVER = str(MODELS / "lever.bg")


@dataclass(frozen=True)
class Result:
    status: int
    out: str
    err: str


@pytest.fixture
def bgc(capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Result]:
    monkeypatch.chdir(tmp_path)

    def call(*arguments: object) -> Result:
        capsys.readouterr()
        status = run([str(a) for a in arguments])
        streams = capsys.readouterr()
        return Result(status, streams.out, streams.err)

    return call


def test_version(bgc: Callable[..., Result]) -> None:
    result = bgc("--version")
    assert result.status == 0 and result.out.startswith("bgc 0.")


def test_as_a_module() -> None:
    done = subprocess.run([sys.executable, "-m", "bgdsl", "--version"], capture_output=True, text=True, check=True)
    assert done.stdout.startswith("bgc 0.")


@pytest.mark.parametrize(
    "arguments",
    [
        ("check", "absent.bg"),
        ("check", "."),
        ("compile", "absent.bg"),
        ("simulate", LEVER, "--experiment", "kik"),
        ("simulate", LEVER, "--set", "mAA=2"),
        ("simulate", LEVER, "--set", "mA"),
        ("simulate", LEVER, "--method", "euler"),
        ("simulate", LEVER, "--stop", "-1"),
        ("simulate", LEVER, "--stop", "nan"),
        ("simulate", LEVER, "--vars", "vA.e"),
        ("simulate", LEVER, "-o", "out.xyz"),
        ("activity", LEVER, "--window", "3,1"),
        ("condition", LEVER, "-o", "out.bg"),
        ("condition", LEVER, "--threshold", "-1", "-o", "out.bg"),
        ("show", LEVER, "--what", "colours"),
        ("show", LEVER, "--model", "Leverr"),
        ("explain", "BG999"),
        ("check", "empty"),
        ("fmt", "empty"),
        ("check", LEVER, "--path", "nowhere"),
        ("check", LEVER, "--set", "mA=nan"),
        ("check", LEVER, "--set", "springA.k=abc"),
        ("check", LEVER, "--set", "springA.k={1,2}"),
        ("check", LEVER, "--set", "mA={1,{2}}"),
        ("check", LEVER, "--set", "mA=[1,2;3,4]"),
        ("simulate", LEVER, "--vars", ""),
        ("compile", LEVER, "-o", "empty"),
        ("compile", LEVER, "-o", "notes.txt/lever.py"),
        ("compile", LEVER, "-o", "/proc/lever.py"),
        ("condition", LEVER, "--threshold", "5", "-o", "out.bg"),
        ("condition", LEVER, "--keep", "150%", "-o", "out.bg"),
        ("partition", LEVER, "--threshold", "100%", "-o", "notes.txt"),
        ("test", "-k", "zzz", LEVER),
        ("check", ""),
        ("fmt", ""),
        ("condition", LEVER, "--threshold", "1%", "--outputs", "massA.p", "-o", "out.bg"),
        ("compare", LEVER, LEVER, "--window", "3,99"),
        ("nonsense",),
    ],
    ids=" ".join,
)
def test_what_cannot_be_done_says_so(bgc: Callable[..., Result], arguments: tuple[str, ...], tmp_path: Path) -> None:
    if arguments == ("check", "."):
        Path("broken.bg").write_text("model")
    Path("empty").mkdir()
    Path("notes.txt").write_text("notes\n")
    before = sorted(tmp_path.iterdir())
    result = bgc(*arguments)
    assert result.status == 2
    assert result.err.strip() and "Traceback" not in result.err and "fault of bgc" not in result.err
    assert sorted(tmp_path.iterdir()) == before, "no half-written file"


def test_a_misspelt_file_is_found_by_its_neighbours(bgc: Callable[..., Result]) -> None:
    Path("lever.bg").write_text("model A\n  J1 v;\nend A;\n")
    message = bgc("show", "levr.bg").err
    assert "did you mean `lever.bg`?" in message and "|" not in message, "there is no line to show"


def test_what_cannot_be_written_is_named_as_the_user_named_it(bgc: Callable[..., Result]) -> None:
    assert "/proc/lever.py cannot be written" in bgc("compile", LEVER, "-o", "/proc/lever.py").err
    Path("notes.txt").write_text("notes\n")
    assert "notes.txt is a file, not a folder" in bgc("compile", LEVER, "-o", "notes.txt/lever.py").err


def test_each_mistake_is_told_once(bgc: Callable[..., Result]) -> None:
    assert bgc("simulate", LEVER, "--stop", "-1").err.count("error[") == 1, "the window is not to blame"


def test_a_result_file_without_an_ending(bgc: Callable[..., Result]) -> None:
    message = bgc("simulate", LEVER, "-o", "out").err
    assert "`out` does not say in what format to write" in message and ".csv, .nc, .parquet" in message


def test_inputs_for_a_model_without_any(bgc: Callable[..., Result]) -> None:
    Path("record.csv").write_text("time,u\n0,0\n1,1\n")
    result = bgc("simulate", LEVER, "--stop", "0.1", "--inputs", "record.csv")
    assert result.status == 0 and "Lever has no inputs: record.csv is not read" in result.err


@pytest.mark.parametrize(
    ("arguments", "error", "codes"),
    [
        (("simulate", LEVER, "--experiment", "kik"), "no experiment `kik`", ["BG610"]),
        (("simulate", LEVER, "--set", "mA=-1"), "`massA.e` is", ["BG630"]),
        (("compile", "absent.bg"), "no file `absent.bg`", ["BG108"]),
        (("simulate", LEVER, "--set", "mA"), "`mA` is not PATH=VALUE", []),
        (("test", LEVER, "-k", "nothing of this name"), "no test's name", []),
        (("simulate",), "FILE", []),
    ],
)
@pytest.mark.parametrize("form", [("--format", "json"), ("--format=json",)])
def test_what_cannot_be_done_is_a_document_too(
    bgc: Callable[..., Result], arguments: tuple[str, ...], error: str, codes: list[str], form: tuple[str, ...]
) -> None:
    result = bgc(*arguments, *form)
    assert result.status == 2 and result.err
    document = json.loads(result.out)
    assert error in document["error"]
    assert [found["code"] for found in document["diagnostics"]] == codes
    assert bgc(*arguments).out == ""


ARRAYS = """model A
  parameter Real g[2] = {1, 2};
  parameter Real T[2,2] = [1, 0; 0, 1];
  J1[2] v;  I[2] m(I = g);  R[2] r(R = T);
  output Real first = m.I[1] + T[2,1];
  output Real second = m.I[2];
equation
  v => m, r;
end A;
"""


@pytest.mark.parametrize(
    ("given", "first", "second"),
    [("g={3,4}", 3, 4), ("g[2]=5", 1, 5), ("m.I=7", 7, 7), ("m.I[2]=9", 1, 9), ("T=[1,2;3,4]", 4, 2), ("T[2,1]=6", 7, 2)],
)
def test_arrays_are_set_whole_or_entry_by_entry(bgc: Callable[..., Result], given: str, first: float, second: float) -> None:
    Path("arrays.bg").write_text(ARRAYS)
    found = json.loads(bgc("simulate", "arrays.bg", "--stop", "0.01", "--set", given, "--format", "json").out)
    assert [row["end"] for row in found["summary"]] == [first, second]
    bgc("compile", "arrays.bg", "--set", given, "-o", "arrays.py")
    import numpy as np

    module: dict[str, object] = {}
    exec(Path("arrays.py").read_text(), module)
    p = module["parameters"]()  # type: ignore[operator]
    x = module["initial_state"](p)  # type: ignore[operator]
    assert np.allclose(module["outputs"](0.0, x, p), [first, second])  # type: ignore[operator]


def test_check_reports_as_json(bgc: Callable[..., Result], tmp_path: Path) -> None:
    Path("wrong.bg").write_text("model A\n  J1 v;\nequation\n  v -> nothing;\nend A;\n")
    result = bgc("check", "wrong.bg", "--format", "json")
    assert result.status == 2
    (finding, *_) = json.loads(result.out)
    assert finding["severity"] == "error" and finding["primary"]["line"] == 4
    assert set(finding) == {"code", "severity", "message", "primary", "others", "notes", "helps"}


def test_fmt_check_is_one_where_a_file_is_not_formatted(bgc: Callable[..., Result]) -> None:
    Path("ugly.bg").write_text("model   A  J1 v;equation end A;")
    assert bgc("fmt", "--check", "ugly.bg").status == 1
    assert bgc("fmt", "ugly.bg").status == 0
    assert bgc("fmt", "--check", "ugly.bg").status == 0


def test_compile_replaces_only_its_own_files(bgc: Callable[..., Result]) -> None:
    assert bgc("compile", LEVER, "-o", "lever.py").status == 0
    assert bgc("compile", LEVER, "-o", "lever.py").status == 0
    Path("mine.py").write_text("print('mine')\n")
    assert bgc("compile", LEVER, "-o", "mine.py").status == 2
    assert Path("mine.py").read_text() == "print('mine')\n"
    assert bgc("compile", LEVER, "-o", "mine.py", "--force").status == 0


def test_compile_is_deterministic(bgc: Callable[..., Result]) -> None:
    bgc("compile", LEVER, "-o", "a.py")
    command = [sys.executable, "-m", "bgdsl", "compile", LEVER, "-o", "b.py"]
    subprocess.run(command, capture_output=True, check=True, env={"PYTHONHASHSEED": "7", "PATH": "/usr/bin:/bin"})
    assert Path("a.py").read_bytes() == Path("b.py").read_bytes()


@pytest.mark.parametrize("ending", ["csv", "nc", "parquet"])
def test_simulate_writes_columns(bgc: Callable[..., Result], ending: str) -> None:
    result = bgc("simulate", LEVER, "--stop", 1, "--interval", 0.25, "--vars", "vA.f,springA.q", "-o", f"out.{ending}")
    assert result.status == 0, result.err
    assert Path(f"out.{ending}").stat().st_size > 0
    if ending == "csv":
        lines = Path("out.csv").read_text().splitlines()
        assert lines[0] == "time,vA.f,springA.q" and len(lines) == 6


def test_simulate_sets_parameters(bgc: Callable[..., Result]) -> None:
    light = json.loads(bgc("simulate", LEVER, "--set", "mA=1", "--vars", "vA.f", "--format", "json").out)
    heavy = json.loads(bgc("simulate", LEVER, "--set", "mA=100", "--vars", "vA.f", "--format", "json").out)
    assert light["summary"][0]["mean"] != heavy["summary"][0]["mean"]
    assert light["statistics"]["steps"] > 0


def test_explain_lists_and_explains(bgc: Callable[..., Result]) -> None:
    listed = bgc("explain").out.splitlines()
    assert len(listed) > 30
    number = listed[0].split()[0]
    assert bgc("explain", number.lower()).out.startswith("#")


def test_debug_shows_the_traceback(bgc: Callable[..., Result]) -> None:
    assert "Traceback" in bgc("--debug", "compile", "absent.bg").err
    assert "Traceback" in bgc("compile", "absent.bg", "--debug").err
    assert "Traceback" not in bgc("compile", "absent.bg").err


def test_a_file_without_a_model_can_be_checked_but_not_compiled(bgc: Callable[..., Result]) -> None:
    Path("functions.bg").write_text("function twice(x) = 2*x;\n")
    assert bgc("check", "functions.bg").status == 0
    assert "BG609" in bgc("compile", "functions.bg").err


SIZED = """
model Sized
  parameter Integer n = 2;  parameter Integer m = 2;
  J1 v[n];  I mass[n](each I = 1, each f(start = 1));  R r[n](each R = 1);
  experiment many(stopTime = 1, n = 2*m);
equation
  for i in 1:n loop v[i] -> mass[i], r[i]; end for;
end Sized;
"""


@pytest.mark.parametrize(("arguments", "states"), [((), 4), (("-e", "many"), 4), (("-e", "many", "--set", "m=3"), 6)])
def test_an_experiment_may_change_the_structure_by_other_parameters(
    bgc: Callable[..., Result], arguments: tuple[str, ...], states: int
) -> None:
    Path("sized.bg").write_text(SIZED)
    result = bgc("simulate", "sized.bg", *arguments, "--format", "json")
    assert result.status == 0, result.err
    assert len(json.loads(result.out)["summary"]) == states
