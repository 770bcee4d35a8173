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
from spherekit.velocities.pole_evaluation import evaluate
from spherekit.velocities.pole_request import request


def _vector(field, pole, rows):
    return field.direction[pole][rows] * field.velocity_coefficient[pole][rows][:, None]


def test_universal_joint():
    """tan psi = tan theta / cos beta and its first two derivatives, to 1e-13."""
    made = sk.load("universal_joint")
    beta = np.radians(35.0)
    motion, field = evaluate_poles_of_motion(made)
    psi = np.arctan2(np.sin(motion.q), np.cos(beta) * np.cos(motion.q))
    turn = motion.values[:, motion.mechanism.pair_number["41"]] - psi
    opposite = motion.assembly_mode == motion.assembly_mode[np.argmax(np.cos(turn) < 0)]
    turn = np.where(opposite, turn - np.pi, turn)
    assert np.max(np.abs(np.sin(turn / 2.0))) < 1e-13
    below = 1.0 - np.sin(beta) ** 2 * np.cos(motion.q) ** 2
    first = np.cos(beta) / below
    second = -np.cos(beta) * np.sin(beta) ** 2 * np.sin(2 * motion.q) / below**2
    assert np.max(np.abs(field.velocity_coefficient[0, 3] - first)) < 1e-13
    assert np.max(np.abs(field.acceleration_coefficient[0, 3] - second)) < 1e-13
    assert abs(np.max(first) - 1 / np.cos(beta)) < 1e-15
    assert abs(np.max(field.velocity_coefficient[0, 3]) - 1 / np.cos(beta)) < 1e-13


def test_coefficient_where_the_published_formula_is_indeterminate():
    """Eq. (26a) is 0/0 where link 3 stands still on link 2; w31 = w21 is the limit.

    A drag-link four-bar (ground 15, then 60, 55, 70 degrees) passes there twice a turn.
    """
    made = four_bar(np.radians([15.0, 60.0, 55.0, 70.0]))
    tracer = PositionAnalysis(made)
    poles = all_poles(4)
    asked = request(tracer.mechanism, "21", poles, poles)
    for assembly_mode in range(2):
        one = PositionAnalysis(made, assembly_mode=assembly_mode)

        def still(q, one=one):
            return evaluate(one.at(q), asked).velocity_coefficient[1, 2][0]

        grid = np.linspace(0.0, 2 * np.pi, 100)
        values = evaluate(one.at(grid), asked).velocity_coefficient[1, 2]
        k = int(np.flatnonzero(values[1:] * values[:-1] < 0.0)[0])
        low, high = grid[k], grid[k + 1]
        root = brentq(still, low, high, xtol=1e-15)
        field = evaluate(one.at(root + np.array([-1e-7, 0.0, 1e-7])), asked)
        assert np.all(np.abs(field.velocity_coefficient[1, 2]) < 1e-6)
        total = _vector(field, (0, 1), slice(None)) + _vector(field, (1, 2), slice(None))
        assert np.max(np.abs(_vector(field, (0, 2), slice(None)) - total)) < 1e-13
        assert abs(abs(field.velocity_coefficient[0, 2][1]) - 1.0) < 1e-13


@pytest.mark.slow
def test_badly_conditioned_plan_falls_back_to_the_velocity_equations():
    """Many passes over random axes multiply rounding; the equations do not."""
    random = np.random.default_rng(5)
    taken = 0
    for chain in (*EIGHT_BARS, *[EIGHT_BARS[4]] * 6):
        made = mechanism_from_chain(chain, random_axes(random, 10))
        motion, field = evaluate_poles_of_motion(made, samples=3, search=False)
        w, gap = null_space(8, made.ends, motion.axes[1])
        taken += bool(field.is_quad_precision[1])
        a, b = made.ends[motion.assembly.inputs[0]]
        driven = np.linalg.norm(w[b] - w[a])
        for i, j in all_poles(8):
            vector = w[j] - w[i]
            size = np.linalg.norm(vector)
            distance = sine_between_lines(field.direction[i, j][1], vector)
            bound = max(field.direction_error[i, j][1], 1e-14 / (gap * size))
            assert distance < bound, (i, j, distance, bound)
            # In quad precision loops are closed first, beside the configuration of w.
            if field.is_quad_precision[1]:
                assert distance < 1e-13 / (gap * size)
            rate = abs(field.velocity_coefficient[i, j][1])
            bound = field.velocity_coefficient_error[i, j][1] + 1e-12 / (gap * driven)
            assert abs(rate - size / driven) < bound * (1.0 + rate), (i, j)
    assert 2 <= taken <= 4 + len(EIGHT_BARS)


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
