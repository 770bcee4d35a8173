"""Rows at folds of contacts and of redundant loops: their angles are right, or left out.

They are judged by the closure equations in 50 digits with the decimal sizes of the file
(`exact_configurations`).
"""

import numpy as np
import pytest
from mechanism_examples import linkages as chains
from mechanism_examples.folding_mechanisms import folding_mechanism, inputs_beside_folds
from oracles.exact_configurations import (
    closure_residuals,
    deviations,
    deviations_with_free_inputs,
)

import spherekit as sk
from spherekit.errors import SpherekitError
from spherekit.positions.fold_bounds import bound_by_kantorovich, curvature_bound
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.status import Status
from spherekit.tolerances import EPS, MAX_SINGULAR_ANGLE_ERROR_RAD

pytestmark = pytest.mark.filterwarnings("error::RuntimeWarning")

MOST_ROUNDINGS = 8.0
"""Largest distance, in roundings of the input, to the nearest input at which loops close.
A row at a dead centre can be beyond it by the rounding of the sizes, so that nothing
closes at the input of the row itself."""
MOST_LOOP_ROUNDINGS = 8.0
"""Largest exact closure residual of the other rows, in roundings of sizes of about 1 rad.
An input q near 0 turns a folded four-bar by q, but opens its loop by about q^2 only. The
rounding of the sizes then moves the dead centre by many roundings of the input."""
MAX_JUDGED_ROWS = 60
"""Rows of one mechanism that are compared with 50 digits."""


def check_angles_at_singularities(mechanism, path):
    """Compare the angles of rows at singularities with 50 digits, and count these rows.

    A row is one sample in one assembly mode (way to assemble the links). `path` has the
    inputs (rad). Rows with the status AT_SINGULARITY have angles, or NaN if their error
    bound would be too large. The result is the number of rows with angles (at most
    `MAX_JUDGED_ROWS`).
    """
    motion = PositionAnalysis(mechanism, path=path).motion()
    is_singular = motion.status == Status.AT_SINGULARITY
    has_angles = ~motion.failed
    row_numbers = np.flatnonzero(is_singular & has_angles)[:MAX_JUDGED_ROWS]
    if not len(row_numbers):
        return 0
    rows = motion.rows(row_numbers)
    assert np.all(rows.configuration_error <= MAX_SINGULAR_ANGLE_ERROR_RAD)
    # Deviations from the exact solution at the input of the row. At a dead centre rounding
    # can move the input to where no solution exists; the deviation is NaN there.
    deviation = deviations(rows)
    has_solution = np.isfinite(deviation)
    assert np.all(deviation[has_solution] <= rows.configuration_error[has_solution])
    if not np.all(has_solution):
        check_rows_beyond_a_dead_centre(rows.rows(~has_solution))
    return len(row_numbers)


def check_rows_beyond_a_dead_centre(rows):
    """Check the angles of rows at whose input the exact equations have no solution.

    The nearest input with a solution replaces the input of the row. The deviation from this
    solution must not exceed the error bound. The distance of both inputs must be a rounding
    of the input (`MOST_ROUNDINGS`), or a rounding of the sizes of the mechanism: the loops
    of the row are then closed as well as this rounding allows (`MOST_LOOP_ROUNDINGS`).
    """
    deviation, distance_in_roundings = deviations_with_free_inputs(rows)
    assert np.all(deviation <= rows.configuration_error)
    is_rounding_of_input = distance_in_roundings <= MOST_ROUNDINGS
    residual_in_roundings = closure_residuals(rows) / EPS
    is_rounding_of_sizes = residual_in_roundings <= MOST_LOOP_ROUNDINGS
    assert np.all(is_rounding_of_input | is_rounding_of_sizes)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seeds", "least_rows"),
    [
        ((0,), 6),  # a cam
        pytest.param((5, 9, 20), 30, marks=pytest.mark.slow),
        pytest.param(range(25), 300, marks=pytest.mark.long),
        pytest.param(range(25, 60), 300, marks=pytest.mark.long),
    ],
)
def test_angles_at_folds_are_within_their_bounds_or_missing(seeds, least_rows):
    """Angles beside folds of random mechanisms are within their error bounds or missing.

    At a fold links are in line, and two assembly modes meet.
    `check_angles_at_singularities` compares the angles with 50 digits. `least_rows` is a
    lower limit on the number of compared rows, so that the test cannot pass by leaving out
    all angles.
    """
    compared_rows = 0
    for seed in seeds:
        kind, mechanism = folding_mechanism(seed)
        # A mechanism of this kind is a four-bar with a cam on one of its links. Some have
        # hundreds of modes, most of them alike, which would take long.
        if kind == "contact":
            continue
        try:
            path = inputs_beside_folds(mechanism, seed)
            compared_rows += check_angles_at_singularities(mechanism, path)
        except SpherekitError:  # it cannot be assembled at any input
            continue
    assert compared_rows >= least_rows


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize("seed", range(3))
def test_rows_of_a_chain_of_sixty_links_are_ok_within_their_bounds(seed):
    """Rows of a long chain are OK by the error bound of the whole mechanism.

    The bounds of its 28 dyads in quad precision multiply and are then useless, although the
    loops as a whole are well conditioned. The reference is the same chain in 50 digits.
    """
    mechanism = chains.grow_dyad_chain(np.random.default_rng(seed), 60, False)
    motion = PositionAnalysis(mechanism, samples=12, search=False).motion()
    assert not np.any(motion.status == Status.AT_SINGULARITY)
    rows = motion.rows(np.flatnonzero(motion.status == Status.OK)[:2])
    assert len(rows) == 2
    assert np.all(rows.configuration_error < 1e-9)
    assert np.all(deviations(rows) <= rows.configuration_error)


@pytest.mark.parametrize("loop_count", [1, 2, 6])
def test_newton_bounds_hold_if_all_loops_are_open_in_the_weakest_direction(loop_count):
    """The error bound of a solution is close for the most unfavourable linear equations.

    The bound is that of Kantorovich's theorem for Newton's method. L loops have 3 L
    residuals, each equal to g. The least singular value s of the Jacobian J belongs to the
    direction (1, ..., 1) of these residuals; all others are 1. The norm of the residuals is
    sqrt(3 L) g, so the solution is at the distance sqrt(3 L) g / s. The Frobenius norm of
    the inverse, which the bound contains, is hardly more than 1 / s, so the bound may
    exceed the distance by 1 % only.
    """
    residual_count = 3 * loop_count
    residual = 1e-12
    least_singular_value = 1e-3
    weakest_direction = np.full(residual_count, 1.0 / np.sqrt(residual_count))
    projection = np.outer(weakest_direction, weakest_direction)
    jacobian = np.eye(residual_count) - (1.0 - least_singular_value) * projection
    step = np.linalg.solve(jacobian, np.full(residual_count, residual))
    distance = np.linalg.norm(step)
    expected_distance = np.sqrt(residual_count) * residual / least_singular_value
    assert distance == pytest.approx(expected_distance)

    inverse_norm = np.linalg.norm(np.linalg.inv(jacobian))
    no_curvature = np.zeros(1)
    bound = bound_by_kantorovich(
        np.array([residual]), np.array([inverse_norm]), no_curvature, loop_count
    )
    assert distance <= bound[0] <= 1.01 * distance


@pytest.mark.parametrize("loop_count", [2, 6])
def test_newton_bounds_are_infinite_if_loops_together_may_have_no_solution(loop_count):
    """The error bound of a solution is infinite if the equations have no solution.

    The bound is that of Kantorovich's theorem for Newton's method. The residual of each of
    L loops is the same function of one variable x,

        k x^2 / 2 - x + g,

    with the residual g at x = 0 and the curvature k. Its zero next to 0 is x = (1 - sqrt(1
    - 2 k g)) / k, for g up to 1 / (2 k). For a larger g the bound must be infinite. For a
    smaller g it must be at least x, and may be infinite.

    The Jacobian has one derivative for each loop, all -1 at x = 0: a column of L numbers.
    Its pseudo-inverse is a row of L numbers -1 / L, which has the norm 1 / sqrt(L).

    `bound_by_kantorovich` gets g and k of a single loop, but the theorem needs the norms of
    all loops together. So the function multiplies k by sqrt(L) and g by sqrt(3 L), for
    three residuals in each loop. Without these factors the bound would be finite for some g
    without a zero.
    """
    curvature = 0.1
    largest_closing_residual = 1.0 / (2.0 * curvature)
    # Four cases; each is the residual g of every loop.
    residuals = np.array([0.01, 0.5, 1.0, 1.01]) * largest_closing_residual
    inverse_norms = np.full(len(residuals), 1.0 / np.sqrt(loop_count))
    curvatures = np.full(len(residuals), curvature)
    bounds = bound_by_kantorovich(residuals, inverse_norms, curvatures, loop_count)

    discriminant = np.maximum(1.0 - 2.0 * curvature * residuals, 0.0)
    zeros = (1.0 - np.sqrt(discriminant)) / curvature
    assert np.isfinite(bounds[0])
    assert np.isinf(bounds[-1])  # 1.01 times the largest residual that closes
    assert np.all(zeros[:-1] <= bounds[:-1])


def small_bevel_gears():
    """Return two bevel gears whose shafts meet at 1 degree."""
    return sk.build(
        "small_gears",
        angle_unit="deg",
        ground="frame",
        links={
            "frame": {"axes": ["left", "right"], "arcs": [1.0]},
            "a": {"axes": ["left"]},
            "b": {"axes": ["right"]},
        },
        pairs={
            "left": {"type": "R", "links": ["frame", "a"]},
            "right": {"type": "R", "links": ["frame", "b"]},
            "mesh": {
                "type": "Cr",
                "links": ["a", "b"],
                "teeth": [20, 40],
                "axes": ["left", "right"],
            },
        },
        inputs={"left": {}},
    )


@pytest.mark.parametrize("name", ["four_bar", "shaped_cam", "two_contacts", "small gears"])
def test_bounds_of_the_change_of_the_jacobian_hold_for_wheels_and_cams(name):
    """The change per radian of each variable, by finite differences, is within the bound.

    Velocity vectors at the contact of small gears are long, and turn with their own
    variable.
    """
    mechanism = small_bevel_gears() if name == "small gears" else sk.load(name)
    position_analysis = PositionAnalysis(mechanism, samples=7)
    motion = position_analysis.motion()
    closure = position_analysis.solver.closure
    values = motion.values[motion.status == Status.OK]
    bound = curvature_bound(closure.linearise(values))
    step = 1e-6
    for variable in range(values.shape[1]):
        shift = step * np.eye(values.shape[1])[variable]
        change = (
            closure.linearise(values + shift).jacobian
            - closure.linearise(values - shift).jacobian
        ) / (2.0 * step)
        # The rows of each loop: (n, loops, 3, variables).
        loops = change.reshape(len(values), -1, 3, values.shape[1])
        norms = np.linalg.norm(loops, ord=2, axis=(2, 3))
        assert np.all(np.max(norms, axis=1) <= bound * (1.0 + 1e-6))
