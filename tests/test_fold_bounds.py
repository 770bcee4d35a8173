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

from spherekit.errors import SpherekitError
from spherekit.positions.fold_bounds import bound_by_kantorovich
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
    """Check the angles of rows at singularities against 50 digits; count these rows.

    `path` holds the inputs (rad). Rows with the status AT_SINGULARITY have angles, or NaN
    if their error bound would be too large. The deviation of angles from the exact solution
    must not exceed the bound. If the exact equations have no solution at the input of a
    row, the nearest input with a solution replaces it. The result is the number of rows
    with angles (at most `MAX_JUDGED_ROWS`).
    """
    motion = PositionAnalysis(mechanism, path=path).motion()
    is_singular = motion.status == Status.AT_SINGULARITY
    row_numbers = np.flatnonzero(is_singular & ~motion.failed)[:MAX_JUDGED_ROWS]
    if not len(row_numbers):
        return 0
    rows = motion.rows(row_numbers)
    bound = rows.configuration_error
    assert np.all(bound <= MAX_SINGULAR_ANGLE_ERROR_RAD)
    # Deviations from the exact solution at the input of the row, infinite if there is none.
    deviation = deviations(rows)
    has_root = np.isfinite(deviation)
    assert np.all(deviation[has_root] <= bound[has_root])
    if not np.all(has_root):
        # The same from the solution at the nearest input that has one, and the distance of
        # this input in units of its rounding error. If it is larger, the loops of the row
        # must be closed as well as the rounding of the sizes allows.
        rootless_rows = rows.rows(~has_root)
        deviation, roundings = deviations_with_free_inputs(rootless_rows)
        assert np.all(deviation <= bound[~has_root])
        loop_roundings = closure_residuals(rootless_rows) / EPS
        is_nearest_input = roundings <= MOST_ROUNDINGS
        assert np.all(is_nearest_input | (loop_roundings <= MOST_LOOP_ROUNDINGS))
    return len(row_numbers)


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
    """Inputs are placed beside folds of random mechanisms.

    At a fold links are in line, and two assembly modes meet. `least_rows` is a lower limit
    on the number of compared rows, so that the test cannot pass by leaving out all angles.
    """
    compared_rows = 0
    for seed in seeds:
        kind, mechanism = folding_mechanism(seed)
        # Special mechanisms with a cam beside them have hundreds of modes, which would take
        # long. Most of these modes are alike.
        if kind == "contact":
            continue
        try:
            path = inputs_beside_folds(mechanism, seed)
            compared_rows += check_angles_at_singularities(mechanism, path)
        except SpherekitError:  # arcs that close nowhere
            continue
    assert compared_rows >= least_rows


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
    """Linear equations whose residuals are all g, in the direction of the least s.

    Their norm is sqrt(3 L) g, so that the solution is sqrt(3 L) g / s away. The Frobenius
    norm of the inverse is hardly more than 1 / s.
    """
    count = 3 * loop_count
    least = 1e-3
    gap = 1e-12
    direction = np.full(count, 1.0 / np.sqrt(count))
    jacobian = np.eye(count) - (1.0 - least) * np.outer(direction, direction)
    distance = np.linalg.norm(np.linalg.solve(jacobian, np.full(count, gap)))
    assert distance == pytest.approx(np.sqrt(count) * gap / least)
    sensitivity = np.linalg.norm(np.linalg.inv(jacobian))
    bound = bound_by_kantorovich(
        np.array([gap]), np.array([sensitivity]), np.zeros(1), loop_count
    )
    assert distance <= bound[0] <= 1.01 * distance


@pytest.mark.parametrize("loop_count", [2, 6])
def test_newton_bounds_are_infinite_if_loops_together_may_have_no_solution(loop_count):
    """Each loop opens by x - k x^2 / 2 - g of one shared variable, each with the same k.

    All loops are alike, so that one of them decides: it closes for g up to 1 / (2 k). The
    bound must be infinite for larger gaps, and may be so for smaller ones.
    """
    curvature = 0.1
    gaps = np.array([0.01, 0.5, 1.0, 1.01]) / (2.0 * curvature)
    sensitivity = np.full(len(gaps), 1.0 / np.sqrt(loop_count))
    bounds = bound_by_kantorovich(
        gaps, sensitivity, np.full(len(gaps), curvature), loop_count
    )
    roots = (1.0 - np.sqrt(np.maximum(1.0 - 2.0 * curvature * gaps, 0.0))) / curvature
    assert np.isfinite(bounds[0])
    assert np.isinf(bounds[-1])
    assert np.all(roots[:-1] <= bounds[:-1])
