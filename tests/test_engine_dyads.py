"""Dyads between axes that nearly coincide or are nearly opposite, against 50 digits."""

import numpy as np
import pytest
from mechanism_examples.linkages import (
    FOUR_BAR,
    WATT,
    mechanism_from_chain,
    parse_chain,
    random_axes,
)

from spherekit.planning.assembly_plan import plan_assembly
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.proof.balls import Digits, centre_floats
from spherekit.proof.reference_rows import exact_rows
from spherekit.symbolic.expression_evaluation import array_function
from spherekit.tolerances import EPS
from spherekit.velocities.design_expressions import DesignExpressions

FIFTY = Digits(50)
NEAR = {"nearly coinciding": 1.0, "nearly opposite": -1.0}


def tilted(random, axis, angle):
    across = np.cross(axis, random.normal(size=3))
    across /= np.linalg.norm(across)
    return np.cos(angle) * axis + np.sin(angle) * across


def digits_lost(made):
    """Return the error of the links' rates, over roundoff times the condition."""
    tracer = PositionAnalysis(made, search=False, samples=3)
    motion = tracer.at(np.zeros(1))
    (driven,) = motion.assembly.inputs
    exact = exact_rows(motion, motion.sample >= 0, driven, FIFTY, order=1)
    links = tuple(range(1, len(made.links)))
    terms = DesignExpressions(tracer.mechanism, [made.pairs[driven].name], closed_form=True)
    names = [f"angular_velocity_{made.links[k]}_{axis}" for k in links for axis in "xyz"]
    columns = [terms.quantity(name) for name in names]
    function = array_function(
        columns, [*terms.sample_symbols[:1], *terms.configuration_symbols]
    )
    signs = np.array(tracer.assembly_modes[0].signs, dtype=float)
    rates = function(np.concatenate([[0.0], signs])[:, None]).reshape(len(links), 3)
    want = centre_floats(exact.w)[0]
    off = np.max(np.abs(rates - want[1:]))
    scale = max(1.0, np.max(np.abs(want)))
    return off / scale / (EPS * exact.condition[0])


@pytest.mark.parametrize("sense", NEAR.values(), ids=NEAR)
@pytest.mark.parametrize("pair", [1, 2], ids=["outer axes", "axes of one link"])
@pytest.mark.parametrize("angle", [1e-3, 1e-5])
def test_no_more_digits_are_lost_than_the_configuration_has_not(pair, sense, angle):
    """Twice as many were: 1 / sin^2 of the angle."""
    random, lost = np.random.default_rng(3), []
    for _ in range(4):
        axes = random_axes(random, 4)
        axes[pair] = sense * tilted(random, axes[3], angle)
        lost.append(digits_lost(mechanism_from_chain(FOUR_BAR, axes)))
    assert np.median(lost) < 10.0


@pytest.mark.parametrize("sense", NEAR.values(), ids=NEAR)
@pytest.mark.parametrize("which", [0, 1], ids=["axes of one body", "outer axes"])
def test_bodies_of_several_links(which, sense):
    """Watt's chain driven at 2-3, where a body of its dyads is several links."""
    random, lost = np.random.default_rng(4), []
    for _ in range(4):
        axes = random_axes(random, len(parse_chain(WATT)))
        made = mechanism_from_chain(WATT, axes, driven="p2_3")
        outer, other = outer_and_other(made, which)
        axes[other] = sense * tilted(random, axes[outer], 1e-3)
        lost.append(digits_lost(mechanism_from_chain(WATT, axes, driven="p2_3")))
    assert np.median(lost) < 10.0


def outer_and_other(made, which):
    """Return the outer pair of a body of several links, and its middle or far pair."""
    for group in plan_assembly(made).groups:
        near, middle, far = (group.pairs[k] for k in group.dyad_positions)
        if len(group.bodies[1]) > 1:
            return near, far if which else middle
        if len(group.bodies[2]) > 1:
            return far, near if which else middle
