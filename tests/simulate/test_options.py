"""Experiments, parameters and settings (BG610, BG611, BG612, BG613, BG614)."""

from __future__ import annotations

import pytest

from bgdsl.diagnostics import BgError, Reporter
from bgdsl.expr import TIME, const, param, var
from bgdsl.ir.graph import Experiment, Parameter
from bgdsl.ir.program import Program
from bgdsl.simulate.options import Options, Settings, resolve_options
from tests.simulate.models import HERE, make_program

ARRAY = Parameter("K", (2,), (const(1.0), param("k")), HERE, low=(const(0.0),))
SIZE = Parameter("n", (), (const(3.0),), HERE, structural=True, integer=True)
FIXED = Parameter("g", (), (const(9.81),), HERE, constant=True)
WHOLE = Parameter("count", (), (const(3.0),), HERE, integer=True)
KICK = Experiment(
    "kick", HERE, stop_time=20.0, interval=0.01, tolerance=1e-8, method="lsoda", window=(10.0, 20.0), changes={"k": const(7.0)}
)
PROGRAM = make_program(
    {"x": (1.0, -(param("double") * var("x")))},
    parameters={"k": 2.0, "double": 2.0 * param("k")},
    more_parameters=(ARRAY, SIZE, FIXED, WHOLE),
    experiments=(KICK,),
)


def resolve(experiment: str | None = None, changes: dict[str, object] | None = None, **settings: object) -> Options:
    return resolve_options(PROGRAM, experiment, changes, Settings(**settings), report=Reporter())  # type: ignore[arg-type]


def test_the_experiment_settles_what_is_not_said() -> None:
    found = resolve("kick", tolerance=1e-4)
    assert (found.stop, found.interval, found.rtol, found.atol, found.method) == (20.0, 0.01, 1e-4, 1e-4, "lsoda")
    assert found.window == (10.0, 20.0) and found.experiment == "kick"
    assert resolve() == resolve("kick"), "the only experiment is the default"


def test_dependent_defaults_follow() -> None:
    found = resolve("kick")
    assert (found.parameters["k"], found.parameters["double"], found.parameters["K[2]"]) == (7.0, 14.0, 7.0)
    found = resolve("kick", {"k": 3, "double": 1.0})
    assert (found.parameters["k"], found.parameters["double"], found.parameters["K[2]"]) == (3.0, 1.0, 3.0)


def test_arrays_whole_and_by_entry() -> None:
    assert resolve(changes={"K[2]": 5}).parameters["K[2]"] == 5.0
    found = resolve(changes={"K": (4, 5)}).parameters
    assert (found["K[1]"], found["K[2]"]) == (4.0, 5.0)
    assert resolve(changes={"K": 6.0}).parameters["K[1]"] == 6.0


@pytest.mark.parametrize(
    ("number", "arguments"),
    [
        ("BG610", {"experiment": "kik"}),
        ("BG611", {"changes": {"kk": 1.0}}),
        ("BG612", {"changes": {"K": (1.0, -1.0)}}),
        ("BG612", {"changes": {"K": (1.0, 2.0, 3.0)}}),
        ("BG612", {"changes": {"k": float("nan")}}),
        ("BG612", {"changes": {"k": "fast"}}),
        ("BG612", {"changes": {"g": 1.6}}),
        ("BG612", {"changes": {"count": 1.5}}),
        ("BG614", {"changes": {"n": 4}}),
        ("BG613", {"stop": -1.0}),
        ("BG613", {"stop": float("inf")}),
        ("BG613", {"interval": 0.0}),
        ("BG613", {"tolerance": 0.0}),
        ("BG613", {"tolerance": 1e-17}),
        ("BG613", {"method": "euler"}),
        ("BG613", {"window": (5.0, 25.0)}),
        ("BG613", {"max_step": 0.0}),
    ],
)
def test_what_is_refused(number: str, arguments: dict[str, object]) -> None:
    with pytest.raises(BgError) as caught:
        resolve(**arguments)  # type: ignore[arg-type]
    assert {d.code.number for d in caught.value.diagnostics} == {number}


def test_a_near_name_is_suggested() -> None:
    with pytest.raises(BgError) as caught:
        resolve(changes={"doubel": 1.0})
    assert caught.value.diagnostics[0].helps == ("did you mean `double`?",)


def test_several_experiments_need_a_name_or_a_stop_time() -> None:
    program = make_program({"x": (1.0, 0.0)}, experiments=(KICK, Experiment("other", HERE)))
    with pytest.raises(BgError) as caught:
        resolve_options(program, report=Reporter())
    assert caught.value.diagnostics[0].code.number == "BG610"
    assert resolve_options(program, settings=Settings(stop=3.0), report=Reporter()).experiment == ""


def test_what_drives_a_model_bounds_its_steps() -> None:
    driven = make_program({"x": (0.0, TIME - var("x"))})

    def longest(program: Program, **settings: float) -> float:
        return resolve_options(program, None, {}, Settings(stop=10.0, **settings), report=Reporter()).max_step

    assert longest(driven) == longest(driven, interval=1.0) == 0.02
    assert longest(driven, interval=0.005) == 0.005 and longest(driven, interval=1e-6) == 0.002
    assert longest(driven, max_step=3.0) == 3.0, "what the caller says holds"
    assert longest(PROGRAM) == float("inf")


def test_bounds_follow_what_they_read() -> None:
    bounded = Parameter("length", (), (const(1.0),), HERE, high=(param("limit"),))
    program = make_program({"x": (1.0, 0.0)}, parameters={"reach": 2.0, "limit": 2.0 * param("reach")}, more_parameters=(bounded,))
    assert resolve_options(program, changes={"reach": 0.5}, report=Reporter()).parameters["limit"] == 1.0
    with pytest.raises(BgError, match=r"above its max of 0\.8"):
        resolve_options(program, changes={"reach": 0.4}, report=Reporter())


def test_what_is_wrong_as_declared_may_be_put_right_by_a_run() -> None:
    ratio = Parameter("ratio", (), (const(1.0) / param("teeth"),), HERE)
    program = make_program({"x": (1.0, 0.0)}, parameters={"teeth": 0.0}, more_parameters=(ratio,))
    with pytest.raises(BgError, match="`ratio` has no value"):
        resolve_options(program, report=Reporter())
    assert resolve_options(program, changes={"teeth": 4.0}, report=Reporter()).parameters["ratio"] == 0.25
    with pytest.raises(BgError, match="`ratio` has no value"):
        resolve_options(program, report=Reporter())


def test_times_of_rows_cover_the_run() -> None:
    assert resolve("kick", stop=1.0, times=(0.0, 0.1, 1.0)).times == (0.0, 0.1, 1.0)
    for wrong in ((0.1, 1.0), (0.0, 0.9), (0.0, 0.5, 0.5, 1.0), (0.0,)):
        with pytest.raises(BgError, match="must increase from 0 s to 1 s"):
            resolve("kick", stop=1.0, times=wrong)
