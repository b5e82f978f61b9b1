"""Recording to files, and reading signals from them (BG615, BG616, BG617, BG618, BG619)."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from bgdsl.diagnostics import BgError, Reporter, RunError
from bgdsl.expr import TIME, const, relation, unary, var
from bgdsl.simulate import recorder
from bgdsl.simulate.columns import find_columns
from bgdsl.simulate.inputs import read_columns
from bgdsl.simulate.options import Settings, resolve_options
from bgdsl.simulate.recording import CsvSink, is_ours
from bgdsl.simulate.result import Run
from bgdsl.simulate.run import simulate
from tests.simulate.models import compiled, make_program, van_der_pol

KINDS = pytest.mark.parametrize("kind", [".csv", ".nc", ".parquet"])


def run(program, output: Path | None = None, *, stop: float = 2.0, force: bool = False, method: str = "cvode-bdf", **more) -> Run:  # type: ignore[no-untyped-def]
    options = resolve_options(program, None, {}, Settings(stop=stop, interval=0.01, method=method, **more), report=Reporter())
    return simulate(compiled(program), options, output=output, force=force)


def code(caught: pytest.ExceptionInfo[BgError]) -> str:
    return caught.value.diagnostics[0].code.number


@KINDS
@pytest.mark.parametrize("method", ["cvode-bdf", "rk45"])
def test_a_file_holds_what_memory_holds(kind: str, method: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    in_memory = run(van_der_pol(), method=method)
    monkeypatch.setattr(recorder, "CHUNK_NUMBERS", 60)  # many chunks
    path = tmp_path / f"run{kind}"
    streamed = run(van_der_pol(), path, method=method)
    found = read_columns(path, Reporter())
    assert list(found) == ["time", "x", "v"]
    for name in ("time", "x", "v"):
        np.testing.assert_array_equal(found[name], in_memory[name])
        np.testing.assert_array_equal(streamed[name], in_memory[name])
    assert streamed.statistics == in_memory.statistics
    assert [p.name for p in tmp_path.iterdir()] == [path.name], "no draft is left"


@KINDS
def test_only_our_own_files_are_replaced(kind: str, tmp_path: Path) -> None:
    path = tmp_path / f"run{kind}"
    run(van_der_pol(), path)
    assert is_ours(path)
    run(van_der_pol(), path, stop=1.0)
    path.write_text("name,value\nspring,3\n")
    with pytest.raises(BgError) as caught:
        run(van_der_pol(), path)
    assert code(caught) == "BG619" and path.read_text().startswith("name")
    run(van_der_pol(), path, force=True)
    assert is_ours(path)


def test_measured_signals_are_not_taken_for_ours(tmp_path: Path) -> None:
    path = tmp_path / "measured.csv"
    path.write_text("time,u\n0,1\n1,2.50\n")
    assert not is_ours(path)


def test_an_unknown_format_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BgError) as caught:
        run(van_der_pol(), tmp_path / "run.xlsx")
    assert code(caught) == "BG619"


@KINDS
def test_a_failed_run_leaves_its_rows_marked_partial(kind: str, tmp_path: Path) -> None:
    path = tmp_path / f"run{kind}"
    program = make_program({"x": (0.0, unary("sqrt", 1.0 - TIME))})
    with pytest.raises(RunError) as caught:
        run(program, path)
    assert any("partial" in note for note in caught.value.diagnostics[0].notes)
    found = read_columns(path, Reporter())
    assert 0.9 < found["time"][-1] <= 1.0
    if kind == ".csv":
        assert path.read_text().endswith("# partial\n")
    elif kind == ".nc":
        import h5netcdf

        with h5netcdf.File(path, "r") as file:
            assert file.attrs["status"] == "partial"
    else:
        from pyarrow import parquet

        assert parquet.ParquetFile(path).metadata.metadata[b"status"] == b"partial"


def test_an_interrupt_leaves_a_partial_file(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    program = van_der_pol()
    options = resolve_options(program, None, {}, Settings(stop=1e5, interval=1.0), report=Reporter())

    def progress(fraction: float) -> None:
        assert 0.0 <= fraction <= 1.0
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulate(compiled(program), options, output=path, progress=progress)
    assert path.read_text().endswith("# partial\n") and len(read_columns(path, Reporter())["time"]) > 1


@KINDS
def test_inputs_come_back_at_least_to_third_order(kind: str, tmp_path: Path) -> None:
    """A recorded signal drives a model like the formula does, and the error falls with the fourth power of the interval."""
    driven = make_program({"x": (0.0, var("u") - var("x"))}, inputs=("u",))
    exact = run(make_program({"x": (0.0, unary("sin", 3.0 * TIME) - var("x"))}), rtol=1e-11, atol=1e-11)["x"][-1]
    errors = []
    for interval in (0.1, 0.05):
        path = tmp_path / f"signal{interval}{kind}"
        source = make_program({"x": (0.0, 1.0)}, outputs={"u": unary("sin", 3.0 * TIME)})
        options = resolve_options(source, None, {}, Settings(stop=2.0, interval=interval), report=Reporter())
        simulate(compiled(source), options, output=path)
        errors.append(abs(run(driven, inputs=path, rtol=1e-11, atol=1e-11)["x"][-1] - exact))
    assert errors[0] < 2e-5 and errors[0] / errors[1] > 10


@pytest.mark.parametrize("method", ["cvode-bdf", "cvode-adams", "rk45", "vode-adams"])
def test_inputs_from_arrays(method: str) -> None:
    driven = make_program({"x": (0.0, var("u") + 2.0 * var("w"))}, inputs=("u", "w"))
    time = np.linspace(0, 2, 41)
    found = run(driven, method=method, rtol=1e-8, atol=1e-8, inputs={"time": time, "u": time**2, "w": np.ones(41)})
    assert found["x"][-1] == pytest.approx(8 / 3 + 4, rel=1e-6)
    np.testing.assert_allclose(found["u"], found.time**2, atol=1e-12)


@pytest.mark.parametrize(
    ("text", "number"),
    [
        ("time,w\n0.0,1.0\n3.0,1.0\n", "BG615"),
        ("time,u\n0.0,1.0\n0.0,1.0\n", "BG616"),
        ("time,u\n0.0,1.0\n3.0,x\n", "BG616"),
        ("time,u\n0.0,1.0\n3.0,nan\n", "BG616"),
        ("time,u\n0.0,1.0\n3.0\n", "BG616"),
        ("time,u\n0.0,1.0\n", "BG616"),
        ("time,u\n0.0,1.0\n1.5,1.0\n", "BG617"),
        ("time,u\n0.5,1.0\n3.0,1.0\n", "BG617"),
        (None, "BG616"),
    ],
)
def test_bad_records_are_refused(text: str | None, number: str, tmp_path: Path) -> None:
    path = tmp_path / "signal.csv"
    if text is not None:
        path.write_text(text)
    with pytest.raises(BgError) as caught:
        run(make_program({"x": (0.0, var("u"))}, inputs=("u",)), inputs=path)
    assert code(caught) == number


def test_missing_inputs_are_refused() -> None:
    with pytest.raises(BgError) as caught:
        run(make_program({"x": (0.0, var("u"))}, inputs=("u",)))
    assert code(caught) == "BG615"


def test_arrays_spread_over_their_entries_and_unknown_names_are_refused() -> None:
    values = {f"R[{i},{j}]": var("x") * float(10 * i + j) for i in (1, 2) for j in (1, 2)} | {
        f"v[{i}]": var("x") * float(i) for i in (1, 2, 3)
    }
    program = make_program({"x": (1.0, 0.0)}, values=values)
    assert [c.name for c in find_columns(program, ["v", "R", "x", "v[2]"], Reporter())] == [
        *("v[1]", "v[2]", "v[3]", "R[1,1]", "R[1,2]", "R[2,1]", "R[2,2]", "x")
    ]
    np.testing.assert_allclose(run(program)["v"][0], [1, 2, 3])
    with pytest.raises(BgError) as caught:
        find_columns(program, ["v[4]", "nothing"], Reporter())
    assert [d.code.number for d in caught.value.diagnostics] == ["BG618", "BG618"]


def test_to_xarray_and_save(tmp_path: Path) -> None:
    found = run(van_der_pol())
    data = found.to_xarray()
    np.testing.assert_array_equal(data["x"].values, found["x"])
    assert data.attrs["method"] == "cvode-bdf"
    found.save(tmp_path / "saved.csv")
    np.testing.assert_array_equal(read_columns(tmp_path / "saved.csv", Reporter())["v"], found["v"])


def test_relations_as_outputs() -> None:
    found = run(make_program({"x": (0.0, 1.0)}, outputs={"late": relation("lt", 1.0 + 0.0 * var("x"), TIME)}))
    np.testing.assert_array_equal(found["late"], found.time > 1.0)


@KINDS
def test_a_run_that_never_starts_leaves_no_file(kind: str, tmp_path: Path) -> None:
    with pytest.raises(BgError):
        run(make_program({"x": (0.0, unary("sqrt", const(-1.0) + 0.0 * var("x")))}), tmp_path / f"run{kind}")
    assert list(tmp_path.iterdir()) == []


def test_a_disk_that_fails_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(self: object, times: object, values: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(CsvSink, "write", full)
    with pytest.raises(BgError) as caught:
        run(van_der_pol(), tmp_path / "run.csv")
    assert code(caught) == "BG619" and "No space left" in caught.value.diagnostics[0].message


@pytest.mark.parametrize("kind", [".nc", ".parquet"])
def test_a_disk_that_fills_up_keeps_what_was_written_whole(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The second chunk finds no room: the first is kept, in a file that can be read."""
    free = iter([10**9, 10**9] if kind == ".nc" else [10**9])
    monkeypatch.setattr("bgdsl.simulate.recorder.CHUNK_NUMBERS", 120)
    monkeypatch.setattr("shutil.disk_usage", lambda path: SimpleNamespace(free=next(free, 0)))
    place = tmp_path / f"run{kind}"
    with pytest.raises(BgError) as caught:
        run(van_der_pol(), place)
    assert code(caught) == "BG619" and "No space left" in caught.value.diagnostics[0].message
    assert [path.name for path in tmp_path.iterdir()] == [place.name]
    assert 0 < len(read_columns(place, Reporter())["time"]) < 201


@pytest.mark.parametrize("method", ["cvode-bdf", "cvode-adams", "rk45", "lsoda"])
def test_a_short_pulse_of_an_input_is_not_stepped_over(method: str) -> None:
    driven = make_program({"x": (0.0, var("u") - var("x"))}, inputs=("u",))
    time = np.linspace(0, 10, 1001)
    found = run(driven, stop=10.0, method=method, inputs={"time": time, "u": np.where(abs(time - 5.0) < 0.015, 1.0, 0.0)})
    assert found["x"][500:520].max() == pytest.approx(0.03, rel=0.05)


def test_a_file_of_inputs_that_is_not_there_is_told_of_even_where_none_is_needed() -> None:
    with pytest.raises(BgError) as caught:
        run(van_der_pol(), inputs=Path("nowhere.csv"))
    assert code(caught) == "BG616"


def test_ctrl_c_leaves_the_rows_so_far(tmp_path: Path) -> None:
    """`bgc simulate` on its way to 1e6 s: the file says that it is partial, the exit status that the work was not done."""
    model, place = tmp_path / "swing.bg", tmp_path / "run.csv"
    model.write_text("model Swing\n  Real x(start = 1);  Real v;\nequation\n  der(x) = v;  der(v) = -x;\nend Swing;\n")
    process = subprocess.Popen(
        [sys.executable, "-m", "bgdsl", "simulate", model, "--stop", "1e6", "--interval", "1", "-o", place], stderr=subprocess.PIPE
    )
    for _ in range(600):
        if any(path.name.startswith(".run.csv") for path in tmp_path.iterdir()):
            break
        time.sleep(0.05)
    time.sleep(0.3)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 2 and b"stopped" in said
    assert place.read_text().endswith("# partial\n")
