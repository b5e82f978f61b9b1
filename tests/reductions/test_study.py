"""The reduced models that are committed are those that the commands write, and say what the study says of them."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bgdsl import pipeline
from bgdsl.accuracy import compare
from bgdsl.diagnostics import Reporter
from bgdsl.passes.weights import weights_in
from bgdsl.playback import play
from bgdsl.reduce import Measured, Partitioned, Scenario, condition, decision_for, measure, partition, reduced, tidy
from bgdsl.reductions.provenance import Choice
from bgdsl.verification import reduction_of

ROOT = Path(__file__).parent.parent.parent
sys.path.insert(0, str(ROOT / "benchmarks"))
import reduction_study as study  # noqa: E402

REDUCED = ROOT / "models" / "reduced"


def assert_written(found: Partitioned, folder: Path) -> None:
    """Same files, same bytes."""
    assert {written.file: written.text for written in found.files} == {path.name: path.read_text("utf-8") for path in folder.glob("*.bg")}
    assert json.loads(found.document) == json.loads((folder / "partition.json").read_text("utf-8"))


@pytest.fixture(scope="module")
def small() -> dict[study.Small, Measured]:
    return {one: study.measured(one.file, one.model, one.experiment) for one in study.SMALL}


def test_small_structures_are_written_as_committed(small: dict[study.Small, Measured]) -> None:
    for one, found in small.items():
        name = f"{one.file.removesuffix('.bg')}_{one.experiment}"
        reduced, apart = condition(found, one.threshold, folder=REDUCED), study.small_partitions(found, one)
        if reduced.decision.dropped:
            assert reduced.source == (REDUCED / f"{name}.bg").read_text("utf-8")
        else:
            assert reduced.source == found.model.source
        if apart.files:
            assert_written(apart, REDUCED / name)
        else:
            assert not (REDUCED / name).exists()


def roles(found: Measured, threshold: float) -> list[tuple[str, set[str]]]:
    return [(p.role, set(p.states)) for p in partition(found, threshold).found.partitions.partitions]


def of(small: dict[study.Small, Measured], file: str, experiment: str) -> Measured:
    return next(found for one, found in small.items() if (one.file, one.experiment) == (file, experiment))


def test_a_balanced_car_falls_into_two_that_share_nothing(small: dict[study.Small, Measured]) -> None:
    found = of(small, "half_car.bg", "bump")
    assert [term.activity for junction in found.report.junctions for term in junction.terms if term.name == "arm"] == [0.0, 0.0]
    assert roles(found, 0.003) == [("driving", {"inertia.p", "pitch_spring.q", "theta"}), ("driving", {"mass.p", "spring.q", "z"})]


def test_a_car_out_of_balance_is_one(small: dict[study.Small, Measured]) -> None:
    apart = partition(of(small, "half_car.bg", "soft_rear"), 0.003).found
    assert len(apart.partitions.partitions) == 1
    assert [(miss.junction, miss.name) for miss in apart.misses] == [("pitch", "arm")]
    assert apart.misses[0].rho == pytest.approx(0.193, abs=0.001)


def test_the_alternator_is_driven_and_the_fan_too(small: dict[study.Small, Measured]) -> None:
    belt = roles(of(small, "drive_line.bg", "pull"), 0.01)
    assert [role for role, _ in belt] == ["driving", "driven"]
    assert belt[1][1] == {"belt_spring.q", "rotor.p"}
    fan = roles(of(small, "dc_motor.bg", "run_up"), 0.003)
    assert fan == [("driving", {"inductance.p", "inertia.p"}), ("driven", {"spring.q", "fan_inertia.p"})]


def test_a_heavy_load_is_felt(small: dict[study.Small, Measured]) -> None:
    assert len(roles(of(small, "dc_motor.bg", "heavy"), 0.003)) == 1


def test_the_supply_drives_the_servo(small: dict[study.Small, Measured]) -> None:
    supply, servo = roles(of(small, "hydraulic_servo.bg", "follow"), 0.02)
    assert supply == ("driving", {"accumulator.q"})
    assert servo[0] == "driven"


@pytest.mark.parametrize(
    ("file", "experiment", "outputs", "shaft", "allowed"),
    [
        ("half_car", "bump", None, None, 1e-6),
        ("drive_line", "pull", ["car_speed", "shaft_torque", "belt_torque", "engine_speed"], "crank_angle", 0.02),
        ("dc_motor", "run_up", None, None, 0.005),
        ("hydraulic_servo", "follow", ["position", "pressure"], None, 0.01),
    ],
)
def test_partitions_do_what_the_whole_does(
    file: str, experiment: str, outputs: list[str] | None, shaft: str | None, allowed: float
) -> None:
    model = next(one.model for one in study.SMALL if one.file == f"{file}.bg")
    whole = play(ROOT / "models" / f"{file}.bg", Scenario(experiment), model=model)
    parts = play(REDUCED / f"{file}_{experiment}", Scenario(experiment))
    wanted = [*(outputs or whole.signals), *([shaft] if shaft else [])]
    comparison = compare(whole, parts, outputs=wanted, shaft=shaft)
    assert {output.name for output in comparison.outputs} == set(wanted) - {shaft}
    assert comparison.worst <= allowed


@pytest.mark.parametrize("folder", sorted(path.parent for path in REDUCED.glob("*/partition.json")), ids=lambda path: path.name)
def test_what_one_part_reads_another_gives(folder: Path) -> None:
    entries = json.loads((folder / "partition.json").read_text("utf-8"))["partitions"]
    given: set[str] = set()
    for entry in entries:
        assert set(entry["inputs"]) <= given
        program = pipeline.load(folder / entry["file"]).program
        assert sorted(record.name for record in program.inputs) == sorted(entry["inputs"])
        outputs = {record.name for record, _ in program.outputs}
        assert set(entry["outputs"]) <= outputs
        given |= set(entry["outputs"])


@pytest.mark.parametrize("path", sorted(REDUCED.rglob("*.bg")), ids=lambda path: path.stem)
def test_what_is_committed_checks_without_errors(path: Path) -> None:
    """All classes of the file, each by itself, as `bgc check` does it."""
    assert [found.message for found in pipeline.check_file(path) if found.severity == "error"] == []
    assert tidy(path.read_text("utf-8")) == path.read_text("utf-8")


def test_the_balanced_engine_is_written_as_committed() -> None:
    """The paper's partitions: crank spin, rods in their plane and piston strokes drive; block, crank and pistons across are driven."""
    found = study.engine_partitions(study.measured("engine.bg", "Engine", "balanced_settled"))
    assert_written(found, REDUCED / "engine_balanced")
    driving, driven, *_ = found.found.partitions.partitions
    assert len(driving.states) == 57 + 6
    kinds = {"crank.inertia.p[1]", "crank.angle[1]", "theta"} | {
        f"cyl[{i}].{state}"
        for i in range(1, 7)
        for state in (
            *("rod.mass.p[2]", "rod.mass.p[3]", "rod.inertia.p[1]", "rod.angle[1]", "piston.mass.p[3]"),
            *("crank_pin.spring.q[2]", "crank_pin.spring.q[3]", "wrist_pin.spring.q[2]", "wrist_pin.spring.q[3]"),
        )
    }
    assert set(driving.states) == kinds | {f"bore[{i}].d" for i in range(1, 7)}
    assert {f"block.mass.p[{k}]" for k in (1, 2, 3)} <= set(driven.states)


def test_the_misfiring_engine_holds_together_and_is_conditioned_as_committed() -> None:
    found = study.measured("engine.bg", "Engine", "misfire_settled")
    assert condition(found, study.CONDITIONED_AT, folder=REDUCED).source == (REDUCED / "engine_misfire_conditioned.bg").read_text("utf-8")
    apart = partition(found, study.THRESHOLD)
    assert apart.files == ()
    assert len(apart.found.partitions.partitions) == 1
    assert apart.found.misses


def test_the_smallest_misfiring_engine_is_written_as_committed_and_keeps_its_promise() -> None:
    """The file's annotation says which terms were spared: the same choice writes the same bytes, and the error is what was allowed.

    (The search that found them is too long for a test; `benchmarks/reduction_study.py --files` makes it again.)
    """
    path = REDUCED / study.EIGHT
    choice = reduction_of(path).choice
    assert (choice.max_error, choice.outputs, choice.shaft) == (study.ALLOWED, study.FORCES, "crank_angle")
    found = study.measured("engine.bg", "Engine", "misfire_settled")
    written = reduced(found, choice, folder=REDUCED)
    assert written.source == path.read_text("utf-8")
    by_threshold = decision_for(found, Choice(study.CONDITIONED_AT))
    assert len(written.decision.dropped) > len(by_threshold.dropped) + 100
    whole, run = (play(file, Scenario("misfire_settled")) for file in (ROOT / "models" / "engine.bg", path))
    found_error = compare(whole, run, outputs=[*study.FORCES, "crank_angle"], window=found.report.window, shaft="crank_angle").worst
    assert 0.0 < found_error <= study.ALLOWED


def derivatives(system: pipeline.System, states: dict[str, float]) -> np.ndarray:
    """der(x) (n,) of a compiled model, in the order of `states`."""
    names = [state.name for state in system.states]
    found = np.empty(len(names))
    system.native.rhs(0.0, np.array([states[name] for name in names]), np.empty(0), found)
    by_name = dict(zip(names, found, strict=True))
    return np.array([by_name[name] for name in states])


@pytest.mark.parametrize("file", ["engine_misfire_conditioned.bg", study.EIGHT])
def test_the_conditioned_engine_has_the_full_ones_equations_less_the_dropped_terms(file: str) -> None:
    """The text, compiled, against the full model with weights of zero on these terms, which no text was written for."""
    found = study.measured("engine.bg", "Engine", "misfire_settled")
    dropped = decision_for(found, reduction_of(REDUCED / file).choice).dropped
    less = replace(found.model, weighed=dropped, report=Reporter())
    assert frozenset(weights_in(less.causal.scalar)) == dropped
    written, deleted, full = pipeline.load(REDUCED / file).compile(), less.compile(), found.model.compile()
    random = np.random.default_rng(1)
    moved = np.zeros(len(full.states), dtype=bool)
    for state in found.run.trajectory.states[::500]:
        at = state * (1 + 0.01 * random.normal(size=len(state))) + 1e-9 * random.normal(size=len(state))
        states = dict(zip((state.name for state in full.states), at.tolist(), strict=True))
        ours, theirs, whole = (derivatives(system, states) for system in (written, deleted, full))
        nothing = 1e-10 * (np.abs(theirs) + np.abs(whole)) + 1e-16 * np.abs(whole).max()
        assert (np.abs(ours - theirs) <= nothing).all()
        moved |= np.abs(theirs - whole) > 1e6 * nothing
    assert moved.sum() > 50  # what was dropped does matter somewhere


def test_the_smallest_misfiring_engine_is_not_searched_again() -> None:
    path = REDUCED / study.EIGHT
    found = measure(pipeline.load(path), Scenario("misfire_settled"))
    again = study.smallest_engine(found, path)
    assert again.search.trials == 0
    assert again.reduced is not None
    assert again.reduced.source == path.read_text("utf-8")


def test_the_smallest_engine_with_ideal_joints_is_written_as_committed() -> None:
    path = REDUCED / study.IDEAL_EIGHT
    written = reduced(study.ideal_misfire(), reduction_of(path).choice, folder=REDUCED)
    assert written.source == path.read_text("utf-8")
    assert not written.decision.reinstated
