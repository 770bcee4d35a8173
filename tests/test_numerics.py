"""Interpolants with measured error, and all zeros of a function."""

import numpy as np
import pytest

from spherekit.numerics.angles import wrap
from spherekit.numerics.bracketed_zeros import find_bracketed_zeros
from spherekit.numerics.chebyshev import PiecewiseChebyshev, find_real_zeros
from spherekit.numerics.least_squares import minimize_squares
from spherekit.numerics.local_polynomials import make_local_polynomials
from spherekit.numerics.minima import find_local_minima, minimize_in_brackets
from spherekit.numerics.sign_changes import FIRST_EDGES, find_sign_changes
from spherekit.numerics.tensor_chebyshev import TensorChebyshev
from spherekit.numerics.zeros import find_zeros


def bumps(s):
    """Two analytic functions of period 3, the second growing by 2 in it."""
    x = 2.0 * np.pi * s / 3.0
    return np.stack([1.0 / (1.3 + np.cos(x)), np.sin(x + np.cos(x)) + 2.0 * s / 3.0], 1)


def bump_rates(s):
    x, rate = 2.0 * np.pi * s / 3.0, 2.0 * np.pi / 3.0
    first = rate * np.sin(x) / (1.3 + np.cos(x)) ** 2
    second = rate * np.cos(x + np.cos(x)) * (1.0 - np.sin(x)) + 2.0 / 3.0
    return np.stack([first, second], 1)


def test_piecewise_chebyshev_reaches_what_it_says():
    fitted = PiecewiseChebyshev.fit(bumps, -1.0, 4.0)
    assert fitted.error < 1e-13
    s = np.random.default_rng(6).uniform(-1.0, 4.0, 10_000)
    assert np.max(np.abs(fitted.evaluate(s) - bumps(s))) < 1e-12
    assert np.max(np.abs(fitted.derivative.evaluate(s) - bump_rates(s))) < 1e-9
    kink = PiecewiseChebyshev.fit(lambda s: np.abs(s - 0.3)[:, None], 0.0, 1.0, max_cells=8)
    assert kink.error > 1e-6
    edges = np.array([0.0, 0.3, 0.31, 1.0])
    parted = PiecewiseChebyshev.fit(bumps, 0.0, 1.0, first_cells=edges)
    assert set(edges) <= set(parted.edges) <= set(parted.spread_positions(4))
    s = np.random.default_rng(1).uniform(0.0, 1.0, 400)
    assert np.max(np.abs(parted.evaluate(s).T - parted.evaluate_pointwise(s))) < 1e-13


def test_local_polynomials_give_functions_at_single_places():
    def functions(s):
        return np.column_stack([bumps(s), 1e-3 * np.tanh(40.0 * (s - 1.0)), 0.0 * s])

    size = np.array([4.0, 5.0, 1e-3, 1.0])
    series = PiecewiseChebyshev.fit(
        functions, -1.0, 4.0, scales=size, rounding_tolerance=1e-10
    )
    local = make_local_polynomials(series, size)
    places = np.random.default_rng(4).uniform(-1.0, 4.0, 2000)
    places[:3] = -1.0, 4.0, series.edges[5]
    found = np.array([local(float(s)) for s in places])
    assert np.max(np.abs(found - functions(places)) / size) < 4e-13
    assert np.max(np.abs(found - series.evaluate(places)) / size) < 3e-14


def test_minima_far_from_zero_end_at_the_spacing_of_numbers():
    """At 70 rad, neighbouring numbers are 1.4e-14 apart, more than the default width."""
    calls = []

    def decreasing(x):
        calls.append(len(x))
        assert len(calls) < 100, "the search does not end"
        return -x

    (position,) = minimize_in_brackets(decreasing, np.array([70.0]), np.array([71.3]))
    assert abs(position - 71.3) <= 4.0 * np.spacing(71.3)


@pytest.mark.parametrize("zero", [-1.005, 0.3, 1.005])
def test_zeros_of_a_series_are_found_up_to_the_limit(zero):
    """Beyond 1 the polynomials exceed 1: x - 1.005 has its zero outside, inside 1.01."""
    assert find_real_zeros(np.array([-zero, 1.0]), 1.01) == pytest.approx([zero])


def polynomial(roots):
    coefficients = np.poly(roots)
    slopes = np.polyder(coefficients)
    return lambda s: (np.polyval(coefficients, s), np.polyval(slopes, s))


def test_zeros_of_polynomials_simple_double_and_close():
    roots = np.array([0.1, 0.25, 0.2501, 0.6, 0.6, 0.9])
    found = find_zeros(polynomial(roots), np.linspace(0.0, 1.0, 8))
    assert np.allclose(found.places, [0.1, 0.25, 0.2501, 0.6, 0.9], rtol=0, atol=1e-9)
    assert found.double.tolist() == [False, False, False, True, False]


def test_zeros_on_the_grid_and_at_its_ends_are_found_once():
    found = find_zeros(lambda s: (np.sin(s), np.cos(s)), np.linspace(0.0, 4 * np.pi, 17))
    assert np.allclose(found.places, np.arange(5) * np.pi, rtol=0, atol=1e-14)
    assert not np.any(found.double)
    none = find_zeros(lambda s: (2.0 + np.sin(s), np.cos(s)), np.linspace(0.0, 6.0, 9))
    assert len(none.places) == 0


def test_a_zero_that_touches_at_an_end_is_double():
    """s**2 + a s touches zero at the end s = 0, for slopes a within rounding of zero."""
    for slope in (1e-9, -1e-9, 0.0):
        zeros = find_zeros(
            lambda s, a=slope: (s * s + a * s, 2.0 * s + a), np.linspace(0.0, 1.0, 8)
        )
        assert zeros.places.tolist() == [0.0]
        assert zeros.double.tolist() == [True]


def test_a_triple_zero_takes_few_evaluations():
    """(s - 0.3)**3 exp(s) has one zero; rounding limits its accuracy to about 1e-5."""
    evaluations = []

    def triple(s):
        evaluations.append(len(s))
        value = (s - 0.3) ** 3 * np.exp(s)
        derivative = (s - 0.3) ** 2 * (s + 2.7) * np.exp(s)
        return value, derivative

    zeros = find_zeros(triple, np.linspace(0.0, 1.0, 8))
    assert len(zeros.places) == 1
    assert abs(zeros.places[0] - 0.3) < 1e-5
    assert len(evaluations) < 40


def test_random_trigonometric_polynomials_lose_no_zero():
    """All zeros of random trigonometric polynomials Re sum a_k exp(i k s) are found.

    The reference are eigenvalues of a companion matrix (`np.roots`). With z = exp(i s) the
    function is a polynomial of degree 10 in z, and its zeros in s are the arguments of the
    roots on the unit circle. 60 polynomials of order 5 have random coefficients.
    """
    random = np.random.default_rng(8)
    orders = np.arange(6)
    for _ in range(60):
        a = random.normal(size=6) + 1j * random.normal(size=6)
        a[0] = a[0].real
        coefficients = np.concatenate([np.conj(a[:0:-1]), [2 * a[0]], a[1:]])
        roots = np.roots(coefficients[::-1])
        is_on_circle = np.abs(np.abs(roots) - 1.0) < 1e-7
        expected = np.sort(np.mod(np.angle(roots[is_on_circle]), 2 * np.pi))

        def function(s, a=a):
            terms = np.exp(1j * np.outer(s, orders)) * a
            value = np.sum(terms, 1).real
            derivative = np.sum(1j * orders * terms, 1).real
            return value, derivative

        zeros = find_zeros(function, np.linspace(0.0, 2 * np.pi, 13)).places
        assert len(zeros) == len(expected)
        assert np.max(np.abs(zeros - expected), initial=0.0) < 1e-9


def test_zeros_of_many_functions_within_brackets_are_exact_to_rounding():
    """Zeros of 50 functions are found together, each in its bracket, to rounding.

    cos x = level has the zero arccos(level) between 0 and 3. On average fewer than 14
    evaluations are needed. The second result is the end of the last bracket beyond the
    zero, where the function is not positive.
    """
    levels = np.linspace(-0.9, 0.9, 50)
    evaluation_counts = []

    def function(x, indices):
        evaluation_counts.append(len(x))
        return np.cos(x) - levels[indices]

    low = np.zeros(50)
    high = np.full(50, 3.0)
    indices = np.arange(50)
    values_at_low = function(low, indices)
    values_at_high = function(high, indices)
    zeros, beyond = find_bracketed_zeros(function, low, high, values_at_low, values_at_high)
    assert np.abs(zeros - np.arccos(levels)).max() < 1e-15
    assert sum(evaluation_counts) < 50 * 14
    assert np.all(function(beyond, indices) <= 0.0)


def test_jumps_within_brackets():
    places = np.array([0.1, 1.0, 1.9])

    def function(x, which):
        return np.where(x < places[which], 1e9, -1.0)

    ends = np.full(3, 1e9), np.full(3, -1.0)
    zero, outside = find_bracketed_zeros(function, np.zeros(3), np.full(3, 2.0), *ends)
    assert np.abs(zero - places).max() < 1e-14 and np.all(outside >= places)
    rough, _ = find_bracketed_zeros(function, np.zeros(3), np.full(3, 2.0), *ends, 1e-3)
    assert 1e-9 < np.abs(rough - places).max() < 1e-3


@pytest.mark.parametrize("sense", [1.0, -1.0])
@pytest.mark.parametrize("off", [-3e-14, -1e-16, 0.0, 1e-16, 3e-14])
def test_a_zero_at_the_seam_of_a_lap_is_there_once(sense, off):
    """Rounding puts it behind the start, before the end, or on both."""
    grid = np.linspace(0.0, 2.0 * np.pi, 12)
    found = find_zeros(lambda s: (sense * np.sin(s) + off, sense * np.cos(s)), grid)
    once = found.merge_seam(2.0 * np.pi).places
    assert once == pytest.approx([0.0, np.pi], abs=1e-13)


def test_least_squares_keep_to_limits_and_leave_them_for_less():
    """x + y = 3 and x - y = 2 meet at (2.5, 0.5); with x at most 1 the best y is 0.5."""

    def residuals(values, _):
        x, y = values.T
        slope = np.array([[1.0, 1.0], [1.0, -1.0]])
        return np.stack([x + y - 3.0, x - y - 2.0], axis=1), np.tile(slope, (len(x), 1, 1))

    for high, wanted in ((1.0, (1.0, 0.5)), (9.0, (2.5, 0.5))):
        start = np.array([[high, 0.0], [-4.0, 7.0]])
        values, squares = minimize_squares(residuals, start, high=np.array([high, np.inf]))
        assert values == pytest.approx(np.tile(wanted, (2, 1)), abs=1e-7)
        assert squares == pytest.approx(np.full(2, 2.0 * (2.5 - wanted[0]) ** 2), abs=1e-9)


def test_a_minimum_midway_between_two_samples_is_found():
    """The samples are 1/16 apart, and two of them are equally far from the minimum."""
    middle = 0.5 + 1.0 / 32.0
    ends = np.array([0.0, 1.0])
    for least in (0.0, 0.01):
        minima = find_local_minima(lambda x, y=least: (x - middle) ** 2 + y, ends)
        assert minima == (pytest.approx([middle]), pytest.approx([least]))


def test_cells_are_halved_up_to_their_greatest_number():
    """Of 5 cells only that with the kink is halved, so 9 cells allow 4 halvings."""
    kink = PiecewiseChebyshev.fit(
        lambda s: np.abs(s - 0.33)[:, None], 0.0, 1.0, first_cells=5, max_cells=9
    )
    assert len(kink.coefficients) == 9


def test_a_double_zero_that_rounding_lifts_is_real():
    """The series 1 + T_2 is 2 x^2. The next larger constant lifts it off zero."""
    lifted = np.array([1.0 + 2.0**-52, 0.0, 1.0])
    assert find_real_zeros(lifted) == pytest.approx([0.0, 0.0], abs=1e-7)


def test_wrapped_angles_are_in_the_interval():
    """Odd multiples of pi are rounded, on either side of the ends of the interval."""
    wrapped = wrap(np.arange(-41, 42, 2) * np.pi)
    assert np.all((wrapped > -np.pi) & (wrapped <= np.pi))


@pytest.mark.parametrize("offset", [-1e-9, -1e-10, -1e-12, 0.0, 1e-12, 1e-10, 1e-9])
def test_a_sign_change_near_an_edge_of_a_cell_is_located_once(offset):
    """The polynomials of the two cells have their zeros on either side of the edge."""
    for centre in np.linspace(-0.4, 0.4, 9):
        for edge in FIRST_EDGES[1:-1]:
            zero = 4.0 * edge + offset

            def function(x, zero=zero, centre=centre):
                return (x - zero) / ((x - zero - centre) ** 2 + 0.35**2)

            found, doubtful = find_sign_changes(function, 0.0, 4.0)
            assert found == pytest.approx([zero], abs=1e-13)
            assert not len(doubtful)


def test_a_pole_at_a_sample_is_in_a_doubtful_interval():
    """The value at the low end is infinite, and there is one sign change, at 0.5."""

    def function(x):
        with np.errstate(divide="ignore", invalid="ignore"):
            return (x - 0.5) / x

    found, ((start, stop),) = find_sign_changes(function, 0.0, 1.0)
    assert found == pytest.approx([0.5], abs=1e-13)
    assert start == 0.0 < stop < 1e-3


def test_a_double_zero_beyond_the_range_is_not_doubtful():
    for sense in (1.0, -1.0):
        low, high = np.sort([0.0, sense])
        found, doubtful = find_sign_changes(
            lambda x, s=sense: (x + 1e-3 * s) ** 2, float(low), float(high)
        )
        assert not len(found)
        assert not len(doubtful)


@pytest.mark.parametrize("is_mirrored", [False, True])
def test_a_zero_within_rounding_of_an_end_is_located_once(is_mirrored):
    """At the distance 1e-9 from the end the slope is 1e-6, so the end value is 1e-15."""

    def function(s):
        t = 1.0 - s if is_mirrored else s
        slope = 1e-6 + 2.0 * t
        return 1e-6 * (t - 1e-9) + t * t, -slope if is_mirrored else slope

    found = find_zeros(function, np.linspace(0.0, 1.0, 9))
    assert found.places == pytest.approx([float(is_mirrored)], abs=2e-8)
    assert found.double.tolist() == [False]


@pytest.mark.parametrize("scale", [1e-280, 1e-200, 1.0, 1e200, 1e280])
def test_zeros_do_not_depend_on_the_scale_of_the_function(scale):
    found = find_zeros(
        lambda s: (scale * np.sin(s), scale * np.cos(s)), np.linspace(0.0, 4 * np.pi, 17)
    )
    assert np.allclose(found.places, np.arange(5) * np.pi, rtol=0, atol=1e-14)
    assert not np.any(found.double)


def test_a_box_with_integer_corners_is_cut_in_the_middle():
    def function(x):
        return np.sin(9.0 * x)

    series = TensorChebyshev.fit(function, np.array([0]), np.array([3]), 1e-9, np.ones(1))
    assert series.covered_fraction == pytest.approx(1.0)
    x = np.linspace(0.0, 3.0, 50)[:, None]
    assert np.max(np.abs(series.evaluate(x) - function(x))) < 1e-8


def test_the_limit_of_tensor_cells_can_be_reached():
    """The function is cut into 8 cells, which are as many as are allowed."""
    low, high, scales = np.zeros(1), np.ones(1), np.ones(1)
    series = TensorChebyshev.fit(
        lambda x: np.sin(30.0 * x), low, high, 1e-7, scales, max_cells=8
    )
    assert len(series.bounds) == 8
    fewer = TensorChebyshev.fit(
        lambda x: np.sin(30.0 * x), low, high, 1e-7, scales, max_cells=7
    )
    assert len(fewer.bounds) <= 7
