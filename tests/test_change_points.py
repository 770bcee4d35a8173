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
"""Crank angles (rad) from the change point, which is at the angle 0."""


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize("arcs", CHANGE_POINTS.values(), ids=CHANGE_POINTS)
def test_torques_beside_change_points_are_right_or_have_a_status(arcs):
    """Torques beside a change point are right, or their row has the status AT_SINGULARITY.

    At the change point, crank angle 0, all links are on a great circle and two modes (ways
    to assemble the links) cross. Rates are known to few digits nearby. Inverse dynamics
    gives the torque of the crank at the distances 1e-2 to 1e-9 rad from there.

    The crank moves by the law q + t + 0.3 t^2. So at t = 0 its angle is q, its rate 1 rad/s
    and its acceleration 0.6 rad/s^2. Without loads the torque is 0.6 B + 0.5 dB/dq. As a
    reference, B (the inertia reduced to the crank) and dB/dq are computed in 50 digits.

    Rows with the status OK may have relative errors of B up to 1e-3, and of the torque up
    to 5e-3. From a distance of 1e-3 rad on, those of the torque must be below 1e-6. The
    torque of all other rows must be missing (NaN).
    """
    masses = tuple(Mass(link, TENSOR) for link in "234")
    mechanism = replace(four_bar(np.radians(arcs)), masses=masses, loads=())
    position_analysis = PositionAnalysis(mechanism)
    statuses = set()
    for q in DISTANCES:
        solution = sk.inverse_dynamics(mechanism, sk.Polynomial((q, 1.0, 0.3)), [0.0])
        motion = position_analysis.at(np.array([q]))
        assert len(motion) == len(solution.status) == 2  # two modes
        is_ok = solution.status == sk.Status.OK
        statuses |= {sk.Status(code).name for code in solution.status}
        assert np.array_equal(np.isfinite(solution.tau), is_ok)
        if not np.any(is_ok):
            continue
        exact = sk.exact_rows(motion, is_ok, motion.assembly.input, Digits(50))
        assert np.all(exact.status == sk.Status.OK)
        inertia, inertia_dq = map(centre_floats, exact_inertia(exact))
        torque = 0.6 * inertia + 0.5 * inertia_dq
        # Torque errors are relative to the largest of torque, dB/dq and B.
        scale = np.maximum(np.maximum(np.abs(torque), np.abs(inertia_dq)), inertia)
        torque_error = np.max(np.abs(solution.tau[is_ok] - torque) / scale)
        assert np.max(np.abs(solution.B[is_ok] - inertia) / inertia) < 1e-3
        assert torque_error < 5e-3
        if q >= 1e-3:
            assert torque_error < 1e-6
    assert statuses == {"OK", "AT_SINGULARITY"}
