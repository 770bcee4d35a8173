"""Torque beside the points at which the modes of a four-bar cross, in 50 digits."""

from dataclasses import replace

import numpy as np
import pytest
from mechanism_examples.named_mechanisms import four_bar

import spherekit as sk
from spherekit.mechanism.inertia import Mass
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.proof.ball_forces import exact_inertia
from spherekit.proof.balls import Digits, centre_floats

CHANGE_POINTS = {
    "equal opposite arcs": (60.0, 40.0, 60.0, 40.0),
    "equal sums": (70.0, 40.0, 50.0, 80.0),
    "equal sums of neighbours": (40.0, 60.0, 65.0, 45.0),
}
TENSOR = ((2.0, 0.1, 0.0), (0.1, 1.5, 0.2), (0.0, 0.2, 1.0))
DISTANCES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize("arcs", CHANGE_POINTS.values(), ids=CHANGE_POINTS)
def test_no_wrong_torque_without_a_status(arcs):
    """At 1e-6 rad it was wrong by the hundredfold, and OK."""
    masses = tuple(Mass(link, TENSOR) for link in "234")
    made = replace(four_bar(np.radians(arcs)), masses=masses, loads=())
    tracer = PositionAnalysis(made)
    seen = set()
    for q in DISTANCES:
        solved = sk.inverse_dynamics(made, sk.Polynomial((q, 1.0, 0.3)), [0.0])
        motion = tracer.at(np.array([q]))
        assert len(motion) == len(solved.status) == 2
        good = solved.status == sk.Status.OK
        seen |= {sk.Status(code).name for code in solved.status}
        assert np.array_equal(np.isfinite(solved.tau), good)
        if not np.any(good):
            continue
        exact = sk.exact_rows(motion, good, motion.assembly.input, Digits(50))
        assert np.all(exact.status == sk.Status.OK)
        inertia, slope = map(centre_floats, exact_inertia(exact))
        torque = 0.6 * inertia + 0.5 * slope
        scale = np.maximum(np.maximum(np.abs(torque), np.abs(slope)), inertia)
        assert np.max(np.abs(solved.B[good] - inertia) / inertia) < 1e-3
        assert np.max(np.abs(solved.tau[good] - torque) / scale) < 5e-3
        if q >= 1e-3:
            assert np.max(np.abs(solved.tau[good] - torque) / scale) < 1e-6
    assert seen == {"OK", "AT_SINGULARITY"}
