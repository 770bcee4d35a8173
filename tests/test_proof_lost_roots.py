"""Proofs at inputs at which no homotopy converges to a root of the equations."""

import numpy as np
import pytest

import spherekit as sk
from spherekit.proof.arc_equations import ArcEquations
from spherekit.proof.balls import cosines_and_sines, working_precision
from spherekit.proof.construction import find_construction
from spherekit.proof.decimal_mechanism import read_decimals
from spherekit.proof.modes_over_boxes import count_modes, list_systems


@pytest.mark.slow
def test_nothing_is_proven_at_inputs_at_which_all_roots_are_lost():
    """At these inputs (deg), Newton's method converges to no root of the Agile Eye.

    So the modes (ways to assemble it) are not counted. A third box of inputs, at which all
    eight modes are real, does not depend on the others.
    """
    decimal_mechanism = read_decimals(sk.load("agile_eye"))
    construction = find_construction(decimal_mechanism.structure)
    centres = np.radians([[0.0, 0.0, 0.0], [45.0, 0.0, 180.0], [10.0, 20.0, 30.0]])
    with working_precision(80):
        systems = list_systems(ArcEquations(decimal_mechanism, construction))
        is_proven, mode_counts = count_modes(
            systems, centres, cosines_and_sines(centres), half=0.0 * centres
        )
    assert is_proven.tolist() == [False, False, True]
    assert mode_counts[2] == 8
