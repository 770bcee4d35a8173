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
    """The proof says that nothing is proven at inputs at which no root is found.

    A proof counts the modes (ways to assemble the links), which are the real roots of the
    loop equations. It needs approximations of all roots by Newton's method. At the first
    two inputs of the Agile Eye, Newton's method converges to no root. All eight modes are
    real at the third input. They must be proven although the other inputs fail in the same
    call.
    """
    decimal_mechanism = read_decimals(sk.load("agile_eye"))
    construction = find_construction(decimal_mechanism.structure)
    # Each box of inputs is a single point, since its half widths are zero.
    centres = np.radians([[0.0, 0.0, 0.0], [45.0, 0.0, 180.0], [10.0, 20.0, 30.0]])
    with working_precision(80):
        systems = list_systems(ArcEquations(decimal_mechanism, construction))
        is_proven, mode_counts = count_modes(
            systems, centres, cosines_and_sines(centres), half=0.0 * centres
        )
    assert is_proven.tolist() == [False, False, True]
    assert mode_counts[2] == 8
