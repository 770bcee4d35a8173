"""Forward kinematics: modes that a caller states, and configurations not determined."""

import numpy as np
import pytest

import spherekit as sk
from spherekit.errors import SolveError
from spherekit.outputs.pose_solver import output_kinematics

MODES_THAT_ARE_NONE = [[], [()], [(1, 1)], [(0,)], [(2,)], [(1,), (1, -1)]]
"""Modes that a mechanism of one dyad does not have."""


@pytest.mark.parametrize("modes", MODES_THAT_ARE_NONE)
def test_modes_without_one_sign_for_each_dyad_are_refused(modes):
    """The five-bar has one dyad, so a mode is one sign, 1 or -1."""
    forward = sk.ForwardKinematics("five_bar")
    with pytest.raises(SolveError, match="1 or -1 for each of 1 dyad"):
        forward.at([[1.5, 1.0]], modes)


def test_configurations_that_are_not_determined_are_no_solutions():
    """Where both outer axes of a dyad coincide, the dyad turns freely about them.

    In a four-bar with four arcs of 90 deg, this occurs at the input 0. There are no
    solutions with numbers then, and some are missing. At 1 rad there are two.
    """
    arcs = dict.fromkeys("1234", 90.0)
    mechanism = sk.load("four_bar").with_sizes(angle_unit="deg", arcs=arcs)
    solutions = sk.ForwardKinematics(mechanism).solutions([[0.0], [1.0]])
    assert np.all(np.isfinite(solutions.values))
    assert solutions.row.tolist() == [1, 1]
    assert solutions.complete.tolist() == [False, True]


@pytest.mark.slow
def test_mid_plane_poses_are_not_called_complete():
    """The search of configurations finds more closed ones, some with other poses."""
    mechanism = sk.load("two_dof_spm")
    first_sample = sk.run(mechanism, samples=2).frame("motion").query("sample == 0")
    inputs = first_sample[["q_21", "q_61"]].to_numpy()[:1]
    solutions = output_kinematics(mechanism).forward(inputs)
    assert np.max(first_sample["residual"]) < 1e-12
    assert len(solutions.row) < len(first_sample)
    assert not np.any(solutions.complete)


def test_mid_plane_measures_have_no_warnings_at_special_directions():
    """In the home direction no mid-plane is determined; opposite to it, legs end short."""
    solver = output_kinematics(sk.load("two_dof_spm"))
    directions = np.concatenate([np.eye(3), -np.eye(3), np.full((1, 3), np.nan)])
    mode = solver.at(directions @ solver.form.frame.T, (1, -1, 1))
    with np.errstate(all="raise"):
        square = mode.type_1_square
    assert not np.any(np.isnan(square))
