"""Configurations at dead centres, of mechanisms that cannot be written as files."""

from dataclasses import replace

import numpy as np
import pytest
from mechanism_examples.special_mechanisms import four_bar

from spherekit.mechanism.load_kinds import PairTorque
from spherekit.positions.position_analysis import PositionAnalysis

CHANGES = {
    "torque": {"loads": (PairTorque("motor", "21", lambda t, q, dq: 1.0),)},
    "user": {"user": {"part": object()}},
}


@pytest.mark.parametrize("change", CHANGES)
def test_loads_and_user_data_do_not_change_configurations_at_dead_centres(change):
    mechanism = four_bar([60.0, 50.0, 30.0, 40.0])  # folds at 0 deg
    path = np.array([[0.0], [1e-10], [0.3]])
    expected = PositionAnalysis(mechanism, path=path).motion()
    changed = replace(mechanism, **CHANGES[change])
    motion = PositionAnalysis(changed, path=path).motion()
    assert np.array_equal(motion.status, expected.status)
    assert np.array_equal(motion.values, expected.values, equal_nan=True)
