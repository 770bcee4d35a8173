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

FIFTY_DIGITS = Digits(50)
SENSES = {"nearly coinciding": 1.0, "nearly opposite": -1.0}
"""Sign of the axis beside which another axis is placed."""
MAX_DIGIT_LOSS = 10.0
"""Largest median error, in units of roundoff times condition number. An error that grows
with 1 / sin^2 of the angle between the axes, not with 1 / sin, exceeds it many times."""


def tilt_axis(random, axis, angle):
    """Return a unit vector (3,) at `angle` (rad) from `axis`, in a random direction."""
    across = np.cross(axis, random.normal(size=3))
    across /= np.linalg.norm(across)
    return np.cos(angle) * axis + np.sin(angle) * across


def relative_digit_loss(mechanism):
    """Return the error of link rates in units of roundoff times the condition number.

    The condition number is that of the velocity equations with the input locked. A result
    of about 1 means that no more digits are lost than the problem itself demands.
    The rates are the angular velocities of all links per unit rate of the input, in the
    reference pose. They are computed in float64 by the closed-form expressions of dyads
    (two links joined by a pair). The reference solves the velocity equations in 50 digits.
    """
    # Without a search there is one assembly mode, that of the reference pose.
    position_analysis = PositionAnalysis(mechanism, search=False, samples=3)
    motion = position_analysis.at(np.zeros(1))
    (driven,) = motion.assembly.inputs
    every_row = np.ones(len(motion), dtype=bool)
    exact = exact_rows(motion, every_row, driven, FIFTY_DIGITS, order=1)

    expressions = DesignExpressions(
        position_analysis.mechanism, [mechanism.pairs[driven].name], closed_form=True
    )
    moving_links = mechanism.links[1:]
    columns = [
        expressions.quantity(f"angular_velocity_{link}_{axis}")
        for link in moving_links
        for axis in "xyz"
    ]
    # The arguments are the input angle (0 in this pose), and the sign of each dyad, which
    # distinguishes the two ways to assemble it. The other sample symbols are not needed.
    input_symbol = expressions.sample_symbols[0]
    arguments = [input_symbol, *expressions.configuration_symbols]
    evaluate_columns = array_function(columns, arguments)
    signs = np.array(position_analysis.assembly_modes[0].signs, dtype=float)
    values = evaluate_columns(np.concatenate([[0.0], signs])[:, None])
    rates = values.reshape(len(moving_links), 3)

    # `exact.w` has numbers with error bounds; their middles are used. The shape is
    # (links, 3), with the ground as link 0.
    exact_rates = centre_floats(exact.w)[0]
    error = np.max(np.abs(rates - exact_rates[1:]))
    scale = max(1.0, np.max(np.abs(exact_rates)))
    return error / scale / (EPS * exact.condition[0])


@pytest.mark.parametrize("sense", SENSES.values(), ids=SENSES)
@pytest.mark.parametrize("pair", [1, 2], ids=["outer axes", "axes of one link"])
@pytest.mark.parametrize("angle", [1e-3, 1e-5])
def test_four_bar_rates_lose_no_more_digits_than_the_condition_number(pair, sense, angle):
    """The axis of `pair` is at `angle` (rad) from the last axis, or from its opposite.

    Pair 1 and the last pair are the outer axes of the dyad; pair 2 is its middle axis.
    """
    random = np.random.default_rng(3)
    losses = []
    for _ in range(4):
        axes = random_axes(random, 4)
        axes[pair] = sense * tilt_axis(random, axes[3], angle)
        losses.append(relative_digit_loss(mechanism_from_chain(FOUR_BAR, axes)))
    assert np.median(losses) < MAX_DIGIT_LOSS


@pytest.mark.parametrize("sense", SENSES.values(), ids=SENSES)
@pytest.mark.parametrize("is_far_pair", [0, 1], ids=["axes of one body", "outer axes"])
def test_watt_rates_lose_no_more_digits_than_the_condition_number(is_far_pair, sense):
    """Watt's chain is driven at 2-3, so that a body of one of its dyads is several links.

    Two axes of this dyad are 1e-3 rad from each other, or from opposite directions.
    """
    random = np.random.default_rng(4)
    losses = []
    for _ in range(4):
        axes = random_axes(random, len(parse_chain(WATT)))
        mechanism = mechanism_from_chain(WATT, axes, driven="p2_3")
        outer_pair, near_pair = pairs_of_composite_body(mechanism, is_far_pair)
        axes[near_pair] = sense * tilt_axis(random, axes[outer_pair], 1e-3)
        losses.append(relative_digit_loss(mechanism_from_chain(WATT, axes, driven="p2_3")))
    assert np.median(losses) < MAX_DIGIT_LOSS


def pairs_of_composite_body(mechanism, is_far_pair):
    """Return the numbers of two pairs of a dyad of which one body is several links.

    The first is the outer pair of this body. The second is the outer pair of the second
    body if `is_far_pair`, else the middle pair of the dyad.
    """
    for group in plan_assembly(mechanism).groups:
        first_outer, middle, second_outer = (group.pairs[k] for k in group.dyad_positions)
        if len(group.bodies[1]) > 1:
            return first_outer, second_outer if is_far_pair else middle
        if len(group.bodies[2]) > 1:
            return second_outer, first_outer if is_far_pair else middle
    raise AssertionError("no body of a dyad is several links")
