"""Pole axes and coefficients against closed forms, 50 digits and the null space."""

import numpy as np
import pytest
from helpers.analysis_runs import evaluate_poles_of_motion
from helpers.refusals import mechanism_text
from mechanism_examples.linkages import EIGHT_BARS, mechanism_from_chain, random_axes
from mechanism_examples.named_mechanisms import four_bar
from oracles.velocity_equations import null_space, sine_between_lines
from scipy.optimize import brentq

import spherekit as sk
from spherekit.files.mechanism_reader import loads
from spherekit.planning.pole_plan import all_poles
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.velocities.direction_signs import (
    ComparedRows,
    SignContinuation,
    continue_signs,
)
from spherekit.velocities.pole_evaluation import evaluate
from spherekit.velocities.pole_request import request


def _vector(field, pole, rows):
    """Return angular velocity vectors (rows, 3) per unit rate of the input.

    They are those of the second link of a pole relative to the first one. `rows` is an
    index of the rows of the field.
    """
    return field.direction[pole][rows] * field.velocity_coefficient[pole][rows][:, None]


def test_coefficients_of_a_universal_joint_are_the_derivatives_of_its_closed_form():
    """Poles of a universal joint have the coefficients of its closed form, to 1e-13.

    The angle of the output shaft is psi with tan psi = sin(q) / (cos(beta) cos(q)), and the
    shafts are at beta = 35 deg. The velocity and acceleration coefficients of the output
    are the first and second derivative of psi by the input q. They belong to the pole (axis
    of relative rotation) of the links 0 and 3, by number.
    """
    made = sk.load("universal_joint")
    beta = np.radians(35.0)
    motion, field = evaluate_poles_of_motion(made)
    psi = np.arctan2(np.sin(motion.q), np.cos(beta) * np.cos(motion.q))
    error = motion.values[:, motion.mechanism.pair_number["41"]] - psi
    # In one of the two assembly modes the angle differs from psi by half a turn, because
    # the driven yoke is mounted the other way round.
    is_opposite = np.cos(error) < 0.0
    assert len(np.unique(motion.assembly_mode[is_opposite])) == 1
    error = np.where(is_opposite, error - np.pi, error)
    assert np.max(np.abs(np.sin(error / 2.0))) < 1e-13

    denominator = 1.0 - np.sin(beta) ** 2 * np.cos(motion.q) ** 2
    first = np.cos(beta) / denominator
    second = -np.cos(beta) * np.sin(beta) ** 2 * np.sin(2 * motion.q) / denominator**2
    velocity_coefficient = field.velocity_coefficient[0, 3]
    assert np.max(np.abs(velocity_coefficient - first)) < 1e-13
    assert np.max(np.abs(field.acceleration_coefficient[0, 3] - second)) < 1e-13
    # The greatest ratio of speeds of a universal joint is 1 / cos(beta).
    assert abs(np.max(first) - 1 / np.cos(beta)) < 1e-15
    assert abs(np.max(velocity_coefficient) - 1 / np.cos(beta)) < 1e-13


def test_coefficient_where_the_published_formula_is_indeterminate():
    """A velocity coefficient is right where the published formula is 0/0.

    A velocity coefficient is the relative rate of two links per rate of the input. Eq.
    (26a) of Di Gregorio (2024) for w31 / w21 is 0/0 where link 3 stands still relative to
    link 2. The limit is w31 = w21. A drag-link four-bar (ground 15, then 60, 55, 70
    degrees) has such a configuration twice a turn. Links have the numbers 1 to 4 in the
    equation, and 0 to 3 in the code.
    """
    made = four_bar(np.radians([15.0, 60.0, 55.0, 70.0]))
    tracer = PositionAnalysis(made)
    poles = all_poles(4)
    # The directions of all poles, and their velocity coefficients.
    asked = request(tracer.mechanism, "21", poles, rates=poles)
    for assembly_mode in range(2):
        one = PositionAnalysis(made, assembly_mode=assembly_mode)

        def relative_rate(q, one=one):
            """Return the velocity coefficient of link 3 relative to link 2 at an input."""
            return evaluate(one.at(q), asked).velocity_coefficient[1, 2][0]

        # A sign change on the grid brackets the configuration where link 3 stands still.
        grid = np.linspace(0.0, 2 * np.pi, 100)
        values = evaluate(one.at(grid), asked).velocity_coefficient[1, 2]
        k = int(np.flatnonzero(values[1:] * values[:-1] < 0.0)[0])
        root = brentq(relative_rate, grid[k], grid[k + 1], xtol=1e-15)
        # The configuration, and one on each side of it.
        field = evaluate(one.at(root + np.array([-1e-7, 0.0, 1e-7])), asked)
        assert np.all(np.abs(field.velocity_coefficient[1, 2]) < 1e-6)
        # The angular velocities add up: w31 = w21 + w32.
        all_rows = slice(None)
        total = _vector(field, (0, 1), all_rows) + _vector(field, (1, 2), all_rows)
        assert np.max(np.abs(_vector(field, (0, 2), all_rows) - total)) < 1e-13
        # Only the size: the sense of a pole axis is a choice, and so is this sign.
        assert abs(abs(field.velocity_coefficient[0, 2][1]) - 1.0) < 1e-13


@pytest.mark.slow
def test_poles_of_badly_conditioned_eight_bars_match_the_null_space_of_velocities():
    """Poles of eight-bars with random axes agree with a null space, within stated errors.

    A pole is the axis of the relative rotation of two links. The independent result `w`
    (links, 3) has the angular velocities of the links: the null space of the velocity
    equations of all pairs. `gap` is the smallest singular value of these equations that is
    not zero.

    Poles are computed one from another. If this multiplies rounding too much, quad
    precision is used. Some of these mechanisms need it, and some do not. The fifth chain of
    the list needs it with some axes, so it is used six more times with other axes.

    The null space has errors too: rounding errors of float64 (1e-16), divided by `gap`.
    Many such errors add up, so the limits allow for a multiple of them.
    """
    random = np.random.default_rng(5)
    quad_count = 0
    chains = [*EIGHT_BARS, *[EIGHT_BARS[4]] * 6]
    for chain in chains:
        made = mechanism_from_chain(chain, random_axes(random, 10))
        motion, field = evaluate_poles_of_motion(made, samples=3, search=False)
        middle = 1  # of three samples
        w, gap = null_space(8, made.ends, motion.axes[middle])
        is_quad = bool(field.is_quad_precision[middle])
        quad_count += is_quad
        a, b = made.ends[motion.assembly.inputs[0]]
        input_rate = np.linalg.norm(w[b] - w[a])
        for i, j in all_poles(8):
            relative_velocity = w[j] - w[i]
            speed = np.linalg.norm(relative_velocity)
            distance = sine_between_lines(field.direction[i, j][middle], relative_velocity)
            # The error of a direction in the null space: at most 100 rounding errors,
            # divided by the speed too.
            null_space_error = 1e-14 / (gap * speed)
            bound = max(field.direction_error[i, j][middle], null_space_error)
            assert distance < bound, (i, j, distance, bound)
            # The stated error can be large. In quad precision the pole must be accurate
            # whatever is stated. Ten times `null_space_error` is allowed, since the
            # configuration in quad precision differs a little from that of `w`.
            if is_quad:
                assert distance < 1e-13 / (gap * speed)
            rate = abs(field.velocity_coefficient[i, j][middle])
            expected_rate = speed / input_rate  # per rate of the input
            stated_error = field.velocity_coefficient_error[i, j][middle]
            bound = stated_error + 1e-12 / (gap * input_rate)
            # The error may be absolute for small coefficients, and relative for large ones.
            assert abs(rate - expected_rate) < bound * (1.0 + rate), (i, j)
    # At least two of the mechanisms need quad precision, and at least two do not.
    assert 2 <= quad_count <= len(chains) - 2


def test_links_that_rest_for_a_moment_are_known_as_well_as_others():
    """Bounds along an axis that relative rates leave open are those of the plan's axis."""
    result = sk.run(loads(mechanism_text("odd_six")), "poles", samples=3, verify=4)
    rows = result.frame()
    assert np.min(np.abs(rows["velocity_coefficient"])) < 1e-15
    assert np.all(rows["status"] == "OK") and not result.summary["warnings"]
    bounds = rows.filter(like="error_bound")
    turned = bounds.pop("direction_dq_error_bound")
    assert bounds.to_numpy().max() < 1e-9
    # A direction of links that rest follows from the plan, and has no derivative.
    assert np.array_equal(np.isnan(turned), np.isnan(rows["dux_dq"]))


def test_a_first_direction_has_the_side_of_the_axes_whichever_poles_come_before_it():
    """The sum of all axes at the first sample decides the sign of each pole direction.

    A pole is the axis of the relative rotation of two links. Its direction is known up to
    its sign. Where a pole is first known, `continue_signs` turns its direction to the side
    of the sum of all pair axes. This is always the sum at the first sample, even if some
    pole is not known before a later sample.

    Here the first pole is known at the second sample only. The direction of the second pole
    is constant. Its scalar product with the sum of the axes is positive at the first
    sample, and negative at the second. So the sign of the second pole must be 1.
    """
    motion = sk.trace("watt", samples=4).rows(slice(2))
    axis_sums = [np.sum(motion.rows([k]).frames[0, :, :, 2], axis=0) for k in range(2)]
    first_sum, second_sum = (x / np.linalg.norm(x) for x in axis_sums)
    difference = first_sum - second_sum
    directions = np.empty((3, 2, 2))  # components, poles, rows
    directions[...] = (difference / np.linalg.norm(difference))[:, None, None]
    directions[:, 0, 0] = np.nan  # the first pole at the first sample

    def evaluate_poles(_rows):
        """Return directions, relative angular velocities, and their derivatives (zero).

        The velocities are set equal to the directions.
        """
        return directions, directions, np.zeros_like(directions)

    # Two poles, each named by the indices of its two links.
    poles = [(0, 4), (3, 5)]
    # Both rows belong to the mode with the index 0. A direction may reverse between them.
    mode = 0
    compared_rows = ComparedRows(np.arange(2), may_reverse=np.ones(1, dtype=bool))
    find_signs = continue_signs(
        motion, poles, {mode: compared_rows}, evaluate_poles, SignContinuation()
    )
    signs = find_signs(directions, np.arange(2), mode)
    assert np.array_equal(signs[1], [1, 1])
