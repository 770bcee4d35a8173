"""Tracking of configurations and assembly modes from input to input."""

import numpy as np
import pytest

import spherekit as sk
from spherekit.designs.design_variables import design_variable
from spherekit.designs.homotopy import LONG_PATH_CONTRACTION, track_solutions
from spherekit.designs.mode_tracking import is_real
from spherekit.designs.path_kernel import PathKernel
from spherekit.designs.varied_mechanism import VariedMechanism
from spherekit.files.number_change import document_of


def test_a_lost_solution_is_not_real():
    """A NaN with an imaginary part of zero is no configuration."""
    solutions = np.array([[np.nan, 1.0, 1.0 + 1.0j, 2.0], [0.0, 1.0, 1.0, np.nan]], complex)
    assert is_real(solutions).tolist() == [False, True, False, False]


def test_a_rocker_is_tracked_away_from_a_dead_centre():
    """A four-bar is driven by its rocker, which starts 5e-5 rad from its limit.

    The expected angles are those of the same four-bar that is driven by its crank.
    """
    mechanism = sk.load("four_bar")
    document = document_of(mechanism)
    names = [pair.name for pair in mechanism.pairs]
    rocker = names.index("41")
    # With these sizes the rocker turns back where the crank is at 5.79449 rad.
    crank_angles = 5.79449 - np.array([0.01, 1.2])
    motion = sk.trace(mechanism, path=crank_angles)
    start, expected = motion.values[motion.assembly_mode == 0]

    varied = VariedMechanism(
        document,
        mechanism.with_inputs("41"),
        (design_variable(document, "links.2.arcs.0"),),
        ("41",),
    )
    kernel = PathKernel(varied.make_expressions(closed_form=False), compiled=False)
    sizes = np.array([[np.radians(20.0)]])
    ends, arrived = track_solutions(
        kernel,
        start[:, None],
        sizes=(sizes, sizes),
        inputs=(start[[[rocker]]], expected[[[rocker]]]),
        contraction=LONG_PATH_CONTRACTION,
    )
    assert arrived[0]
    assert np.cos(ends[:, 0] - expected) == pytest.approx(1.0, abs=1e-12)
