"""The hand-written engine agrees with the published check values, so it may check the compiled one."""

import json
from pathlib import Path

import numpy as np
import pytest
from engine_reference import OUR_NAMES, rhs

CHECK = json.loads((Path(__file__).parent / "rhs_check.json").read_text())


@pytest.mark.parametrize("case", CHECK["cases"], ids=lambda case: case["name"])
def test_the_hand_written_derivatives_are_the_published_ones(case):
    gain = np.array([0.0 if case["misfire"] else 1.0] + [1.0] * 5)
    found, wanted = rhs(np.array(case["y"]), gain), np.array(case["dydt"])
    assert np.max(np.abs(found - wanted)) <= 1e-9 * np.max(np.abs(wanted))


def test_every_state_has_one_name_of_ours():
    assert len(CHECK["state_names"]) == len(OUR_NAMES) == len(set(OUR_NAMES)) == 261
