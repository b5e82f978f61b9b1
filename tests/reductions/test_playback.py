"""Partitions run one after the other and at the same time, and give what the conditioned model gives."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bgdsl import pipeline
from bgdsl.diagnostics import BgError
from bgdsl.playback import play
from bgdsl.reduce import Scenario, condition, measure, partition

LEVER = Path(__file__).parents[2] / "models" / "lever_stiff.bg"


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
