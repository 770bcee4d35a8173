"""Directions of the curves at a crossing that nearly coincide."""

import numpy as np
import pytest
from mechanism_examples.special_mechanisms import four_bar

from spherekit.planning.assembly_plan import plan_assembly
from spherekit.positions.curve_crossing import find_crossing
from spherekit.positions.position_solver import PositionSolver


@pytest.mark.parametrize("crank", [1e-3, 1e-5, 1e-6, 3e-7, 1e-7])
def test_two_directions_that_nearly_coincide_are_two_or_unresolved(crank):
    """The flat four-bar has two curves, at an angle like the root of the crank's arc."""
    mechanism = four_bar([60.0, crank, 50.0, 10.0 + crank])
    closure = PositionSolver(mechanism, plan_assembly(mechanism)).closure
    crossing = find_crossing(closure, np.array([0.0, np.pi, 0.0, np.pi]))
    assert crossing.freedoms == 2
    assert len(crossing.tangents) == (2 if crossing.resolved else 0)
    assert crossing.resolved or crank < 1e-5
