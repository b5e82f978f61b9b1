"""Partitions run one after the other and at the same time, and give what the conditioned model gives."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from bgdsl import pipeline
from bgdsl.diagnostics import BgError
from bgdsl.playback import GROWTH, START, at, play, recording_times
from bgdsl.reduce import Scenario, condition, measure, partition

MODELS = Path(__file__).parents[2] / "models"
LEVER = MODELS / "lever_stiff.bg"
ENGINE = MODELS / "reduced" / "engine_balanced"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("lever")
    found = partition(measure(pipeline.load(LEVER), Scenario("kick")), 0.025, stem="lever")
    assert [file.partition.role for file in found.files] == ["driving", "driven"]
    for file in found.files:
        (place / file.file).write_text(file.text)
    (place / "partition.json").write_text(found.document)
    return place


@pytest.fixture(scope="module")
def conditioned() -> np.ndarray:
    reduced = condition(measure(pipeline.load(LEVER), Scenario("kick")), 0.025)
    run = pipeline.loads(reduced.source).compile().simulate("kick", vars=["massB.p"], tolerance=1e-10)
    return np.array([run.time, run["massB.p"]])


@pytest.mark.parametrize("together", [False, True], ids=["in turn", "together"])
def test_the_driven_partition_follows_the_recorded_drive(folder: Path, conditioned: np.ndarray, together: bool) -> None:
    result = play(folder, Scenario("kick"), together=together)
    assert result.states == 4
    found = np.interp(conditioned[0], result.time, result.signals["massB.p"])
    assert np.abs(found - conditioned[1]).max() < 2e-4 * np.abs(conditioned[1]).max()


def test_a_process_that_fails_says_why(folder: Path, tmp_path: Path) -> None:
    for file in folder.iterdir():
        (tmp_path / file.name).write_text(file.read_text().replace("I massB(I = mB);", "I massB(I = 0*mB);"))
    with pytest.raises(BgError, match="massB"):
        play(tmp_path, Scenario("kick"), together=True)


def test_at_the_same_time_the_start_of_a_drive_is_recorded_as_finely() -> None:
    """The engine does not begin at rest: what its quickest modes do in the first ms rings on in the mounts, by 0.3 % where the record
    misses it. What is left here comes from the cuts, at which the integrators start anew."""
    settings = {"stop": 1.0, "tolerance": 1e-8, "interval": 2e-4}
    in_turn, together = (play(ENGINE, Scenario("balanced", None, settings), together=each) for each in (False, True))
    for result in (in_turn, together):
        assert np.diff(result.time)[:10].max() < 1.3 * START
    for name in ("front_mount_force[1]", "right_rear_mount_force[1]"):
        one = in_turn.signals[name]
        assert np.abs(at(in_turn.time, together, name) - one).max() < 5e-4 * np.abs(one).max()


@pytest.mark.parametrize(("stop", "interval", "until"), [(1.0, 4e-4, None), (5.0, 1e-2, 0.3125), (1.0, 4e-4, 0.01), (2.0, 1e-6, None)])
def test_a_record_begins_fine_and_goes_on_at_the_interval(stop: float, interval: float, until: float | None) -> None:
    times = recording_times(stop, interval, until)
    steps = np.diff(times)
    assert times[0] == 0.0 and times[-1] == (until or stop) and steps.min() > 0.0
    assert steps[0] <= 1.02 * START * stop and steps.max() <= 1.001 * interval
    early = times[1:] < 0.5 * (interval - START * stop) / GROWTH
    assert (steps[early] <= 1.05 * (START * stop + GROWTH * times[1:][early])).all()
    assert len(times) < times[-1] / interval + math.log(max(1.0, interval / (START * stop))) / GROWTH + 3
