"""Special geometry: coincident axes, change points, links that do not move, tiny arcs."""

import warnings

import numpy as np
import pytest
from mechanism_examples.linkages import mechanism_from_chain, random_axes
from mechanism_examples.named_mechanisms import four_bar

import spherekit as sk
from spherekit.errors import SolveError

DIRECTION_DERIVATIVE_COLUMNS = ["dux_dq", "duy_dq", "duz_dq", "direction_dq_error_bound"]
"""Derivative du/dq of a pole direction u by the input q, and its error bound."""
MAX_DIRECTION_DERIVATIVE_ERROR = 1e-6
"""`spherekit` leaves out du/dq if a bound of its error exceeds this number."""


def assert_direction_derivatives_are_whole(rows):
    """Assert that du/dq and its bound are all there, or all missing, in each row."""
    is_missing = rows[DIRECTION_DERIVATIVE_COLUMNS].isna()
    assert is_missing.any(axis=1).equals(is_missing.all(axis=1))


def assert_direction_derivatives_are_uncertain(rows):
    """Assert that the derivative du/dq of pole directions would have a large error.

    Only then may it be missing in these rows. Let v be the relative angular velocity per
    unit rate of the input. The direction is u = v / |v|. So du/dq is the part of dv/dq
    perpendicular to u, divided by |v|. Its error is about the sum of three errors, divided
    by |v|: those of v, of dv/dq, and of u times |dv/dq|.

    The table has no |dv/dq|. Instead, its part along u is used, the acceleration
    coefficient. This part is at most as large, so the error is not overestimated.
    """
    velocity_size = rows["velocity_coefficient"].abs()  # |v|
    velocity_error = rows["velocity_coefficient_error_bound"].abs()
    derivative_error = rows["acceleration_coefficient_error_bound"]
    direction_error = rows["error_bound"]
    derivative_size = rows["acceleration_coefficient"].abs()  # instead of |dv/dq|
    error_sum = velocity_error + derivative_error + direction_error * derivative_size
    assert (error_sum >= MAX_DIRECTION_DERIVATIVE_ERROR * velocity_size).all()


def run(mechanism, samples=7, search=False):
    """Run the analysis `poles` with warnings as errors, check its table, and return it.

    Rows with status OK have no NaN. Only the derivative du/dq of a pole direction u by the
    input q, and its error bound, may be missing. They are missing only where the error of
    the derivative would be large. Rows out of reach have no coefficient. `search` is
    whether to search assembly modes other than that of the reference pose.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        result = sk.run(mechanism, "poles", samples=samples, search=search)
    assert not result.failures
    frame = result.frame()
    ok_rows = frame[frame["status"] == "OK"]
    assert not ok_rows.drop(columns=DIRECTION_DERIVATIVE_COLUMNS).isna().any().any()
    # All components of du/dq and its bound are there, or all are missing.
    assert_direction_derivatives_are_whole(ok_rows)
    has_no_derivative = ok_rows["direction_dq_error_bound"].isna()
    assert_direction_derivatives_are_uncertain(ok_rows[has_no_derivative])
    out_of_reach_rows = frame[frame["status"] == "OUT_OF_REACH"]
    assert out_of_reach_rows["velocity_coefficient"].isna().all()
    return frame


CHANGING = (60, 40, 60, 40), (60,) * 4, (40, 60, 40, 60), (90,) * 4, (60, 20, 40, 40)


@pytest.mark.many
@pytest.mark.parametrize("arcs", [*CHANGING, (60, 120, 70, 130)])
def test_change_points_have_a_status_and_no_garbage(arcs):
    frame = run(four_bar(np.radians(arcs)), samples=37)
    counts = frame["status"].value_counts()
    assert 0 < counts["OK"] < len(frame)
    assert set(counts[counts > 0].index) <= {"OK", "AT_SINGULARITY", "OUT_OF_REACH"}
    assert frame.loc[frame["status"] == "OK", "velocity_coefficient"].abs().max() < 10.0


@pytest.mark.parametrize("crank", [0.0, 1e-9])
def test_a_crank_of_no_length_moves_nothing(crank):
    frame = run(four_bar(np.array([1.0, crank, 1.0, 0.7])), samples=13)
    still = frame[(frame["link"] == "3") & (frame["relative_to"] == "1")]
    unknown = still["status"] == "ILL_CONDITIONED"  # an axis of 1e-9 over rounding
    assert ((still["velocity_coefficient"].abs() < 1e-8) | unknown).all()
    if crank == 0.0:
        # pairs 21 and 32 are coaxial: their axis is the pole of any motion there could be
        assert (still["status"] == "OK").all()
        assert (still["velocity_coefficient"] == 0.0).all()


@pytest.mark.parametrize("size", [1e-3, 1e-5, 1e-7])
def test_tiny_arcs_keep_their_coefficients(size):
    """Scaled down, the coefficients keep to those of a ten times larger mechanism."""
    shape = np.array([1.0, 0.4, 1.1, 0.8])
    small, large = (run(four_bar(shape * s), samples=13) for s in (size, size * 10))
    both = small.merge(large, on=["sample", "assembly_mode", "link", "relative_to"])
    pairs = both[(both["link"] == "4") & (both["relative_to"] == "1")]
    gap = (pairs["velocity_coefficient_x"] - pairs["velocity_coefficient_y"]).abs()
    assert gap.max() < 1e2 * size**2 + 1e-14 / size


@pytest.mark.parametrize("arcs", [(179.9999, 60, 179, 70), (180, 20, 70, 40)])
def test_impossible_extremes_are_refused_in_words(arcs):
    with pytest.raises(SolveError, match="arcs cannot close"):
        run(four_bar(np.radians(arcs)))


def test_bars_without_length_that_close_are_singular():
    """Crank and coupler cover each other at every input; the rocker can spin."""
    motion = sk.trace(four_bar(np.radians((0, 20, 20, 0))), samples=7)
    assert np.all(motion.status == sk.Status.AT_SINGULARITY)
    assert np.all(np.isnan(motion.values).any(axis=1))  # any angle closes the loop


@pytest.mark.slow
def test_a_link_of_a_triad_with_coincident_axes_is_no_traceback():
    edges = [(1, 2), (2, 3), (3, 4), (1, 4), (2, 5), (5, 8), (3, 6), (6, 8), (4, 7), (7, 8)]
    axes = random_axes(np.random.default_rng(1), 13)
    axes[5] = axes[4]
    made = mechanism_from_chain([*edges, (1, 9), (9, 10), (8, 10)], axes)
    assert np.all(sk.trace(made, samples=3).status != sk.Status.OK)
