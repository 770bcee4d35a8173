"""Time laws: exact rates and accelerations, their spans, and their keys in studies."""

import math

import numpy as np
import pytest
from helpers.refusals import TABLES, check_call, mechanism_text

from spherekit.errors import FileError, ModelError
from spherekit.files.study import Start
from spherekit.files.study_reader import load_study
from spherekit.files.time_law import (
    ConstantSpeed,
    Cycloidal,
    Polynomial,
    Tabulated,
    make_field_readers,
)

TIMES_S = np.array([0.0, 0.3, 0.7, 1.1, 1.2, 1.9, 2.5, 3.0])
"""Times of tables."""


@pytest.mark.parametrize(
    "law, times, expected",
    [
        (ConstantSpeed(-2.0, 0.5), [0.0, 1.5], [[0.5, -2.5], [-2.0, -2.0], [0.0, 0.0]]),
        (Polynomial((1.0, 2.0, 3.0)), [0.0, 1.0], [[1.0, 6.0], [2.0, 8.0], [6.0, 6.0]]),
        (Cycloidal(0.5, 2.0, 2.5), [-1.0, 2.5], [[0.5, 2.0], [0.0, 0.0], [0.0, 0.0]]),
        (Cycloidal(0.5, 2.0, 2.5), [0.0, 9.0], [[0.5, 2.0], [0.0, 0.0], [0.0, 0.0]]),
    ],
)
def test_laws_give_angles_rates_and_accelerations_computed_by_hand(law, times, expected):
    """`expected` has one row each for q (rad), dq/dt and d2q/dt2.

    A cycloidal law from 0.5 to 2.0 rad in 2.5 s rests before and after.
    """
    results = [values.tolist() for values in law.at([times])]
    assert results == [[row] for row in expected]


def test_cycloidal_law_has_the_derivatives_of_its_formula_in_forty_digits():
    """q = a + (b - a) (x - sin(2 pi x) / (2 pi)), x = t / T, differentiated by mpmath."""
    mp = pytest.importorskip("mpmath").mp
    law = Cycloidal(0.4, -1.1, 2.5)

    def exact_angle(t):
        x = t / mp.mpf(2.5)
        two_pi = 2 * mp.pi
        return 0.4 + (mp.mpf(-1.1) - 0.4) * (x - mp.sin(two_pi * x) / two_pi)

    with mp.workdps(40):
        for t in (0.0, 0.2, 1.25, 2.0, 2.4999):
            expected = [float(mp.diff(exact_angle, t, order)) for order in range(3)]
            np.testing.assert_allclose(law.at(t), expected, rtol=0, atol=4e-15)


def quintic_and_its_table():
    """Return a polynomial of degree five and the law of its values at `TIMES_S`."""
    quintic = np.polynomial.Polynomial((0.3, -1.0, 0.25, 2.0, -0.5, 0.125))
    return quintic, Tabulated(tuple(TIMES_S.tolist()), tuple(quintic(TIMES_S).tolist()))


def test_a_table_of_a_quintic_polynomial_reproduces_it_between_its_times():
    """Tables are interpolated by quintic splines, so the polynomial itself results."""
    quintic, law = quintic_and_its_table()
    times = np.linspace(0.0, 3.0, 41)
    angle, rate, acceleration = law.at(times)
    np.testing.assert_allclose(angle, quintic(times), rtol=0, atol=2e-11)
    np.testing.assert_allclose(rate, quintic.deriv(1)(times), rtol=0, atol=2e-11)
    np.testing.assert_allclose(acceleration, quintic.deriv(2)(times), rtol=0, atol=2e-11)


@pytest.mark.parametrize("time", [-0.1, [0.0, 3.1], math.nan])
def test_a_table_is_not_extrapolated(time):
    _, law = quintic_and_its_table()
    with pytest.raises(ModelError, match=r"times from 0 to 3 s, but .* are needed"):
        law.at(time)


@pytest.mark.parametrize("rest_at_ends", [False, True])
def test_rates_of_a_table_integrate_to_its_angles(rest_at_ends):
    """The rates of a law by a table are the derivatives of its angles.

    The law has a quintic polynomial between any two times of the table. Over each interval,
    the integral of the rate is the difference of the angles, and the integral of the
    acceleration that of the rate. Gauss's rule of four points integrates them exactly, as
    it does polynomials up to degree 7. With `rest_at_ends`, rate and acceleration are zero
    at both ends, otherwise they are not.
    """
    random = np.random.default_rng(5)
    angles = tuple(random.normal(size=TIMES_S.size).tolist())
    law = Tabulated(tuple(TIMES_S.tolist()), angles, rest_at_ends)
    np.testing.assert_allclose(law.at(TIMES_S)[0], angles, rtol=0, atol=1e-13)

    nodes, weights = np.polynomial.legendre.leggauss(4)
    start = TIMES_S[:-1, None]
    stop = TIMES_S[1:, None]
    half_duration = (stop - start) / 2
    gauss_times = (start + stop) / 2 + half_duration * nodes  # (intervals, 4)
    scale = float(np.max(np.abs(law.at(gauss_times)[2])))
    for lower, upper in ((0, 1), (1, 2)):  # orders of the derivatives
        integral = half_duration[:, 0] * (law.at(gauss_times)[upper] @ weights)
        change = np.diff(law.at(TIMES_S)[lower])
        np.testing.assert_allclose(integral, change, rtol=0, atol=1e-13 * scale)

    derivatives_at_ends = np.array(law.at(TIMES_S[[0, -1]])[1:])
    is_at_rest = np.max(np.abs(derivatives_at_ends)) < 1e-11 * scale
    assert bool(is_at_rest) is rest_at_ends


@pytest.mark.parametrize("call", TABLES["laws"])
def test_impossible_laws_are_refused_with_the_fault(call):
    check_call(call, globals(), TABLES["laws"][call])


STUDY = mechanism_text("laws_study.study")
CYCLOID = 'kind = "cycloidal"\nfrom = 0\nto = 90\nduration = 2'
CONSTANT = 'kind = "constant_speed"\nspeed = 90.0\nfrom = 10\n'
TABLE = 'kind = "table"\ntimes = [0, 1, 3]\nangles = [0, 90, 900]\nrest_at_ends = true\n'


def read_study(folder, text):
    """Write a study file and return it as read."""
    path = folder / "x.study.toml"
    path.write_text(text)
    return load_study(path)


@pytest.mark.parametrize(
    ("text", "law"),
    [
        (CONSTANT, ConstantSpeed(math.pi / 2, math.radians(10))),
        ('kind = "polynomial"\ncoefficients = [0, 180]', Polynomial((0.0, math.pi))),
        (CYCLOID, Cycloidal(0.0, math.pi / 2, 2.0)),
        (TABLE, Tabulated((0.0, 1.0, 3.0), (0.0, math.pi / 2, 5 * math.pi), True)),
    ],
)
def test_a_study_has_a_law_for_its_input_in_radians(tmp_path, text, law):
    """The text is the law of input 21 in degrees; the study states a duration of 2.5 s."""
    study = read_study(tmp_path, STUDY + text)
    assert study.laws == {"21": law}
    assert study.duration == 2.5
    assert study.start is None


def test_a_study_has_a_start_in_radians(tmp_path):
    without_law = STUDY.partition("[inputs.21.law]")[0]
    study = read_study(tmp_path, f"{without_law}[start]\nq = 90\ndq = 180\n")
    assert study.start == Start(math.pi / 2, math.pi)


def test_a_study_without_angles_needs_no_angle_unit(tmp_path):
    study = read_study(tmp_path, 'format = 1\nmechanism = "four_bar"\nduration = 1\n')
    assert study.laws == {}
    assert study.duration == 1.0
    assert study.start is None


def test_a_study_without_an_angle_unit_has_that_of_its_mechanism(tmp_path):
    """The mechanism of the study is in degrees, and so are its numbers without a unit."""
    text = STUDY.replace('angle_unit = "deg"\n', "")
    assert "angle_unit" not in text
    study_with_unit = read_study(tmp_path, STUDY + CONSTANT)
    assert read_study(tmp_path, text + CONSTANT) == study_with_unit
    with_start = text.partition("[inputs")[0] + "[start]\nq = 90\n"
    assert read_study(tmp_path, with_start).start.q == np.radians(90.0)


def test_large_coefficients_of_a_law_in_radians_are_allowed_but_a_large_start_is_not(
    tmp_path,
):
    """An angle of 90 rad looks like degrees; a coefficient of 40 rad/s2 does not."""
    text = STUDY.replace('"deg"', '"rad"').replace("720", "6")
    polynomial = 'kind = "polynomial"\ncoefficients = [0, 1, 40]\n'
    study = read_study(tmp_path, text + polynomial)
    assert study.laws["21"] == Polynomial((0.0, 1.0, 40.0))
    with pytest.raises(FileError, match=r"start\.q: found 90\.0 rad"):
        read_study(tmp_path, text + CONSTANT + "[start]\nq = 90\n")


@pytest.mark.parametrize("container", [list, np.array])
def test_laws_take_lists_and_arrays_as_they_take_tuples(container):
    coefficients = (0.5, 2.0)
    assert Polynomial(container(coefficients)) == Polynomial(coefficients)
    times, angles = (0.0, 1.0), (0.2, 0.5)
    law = Tabulated(container(times), container(angles), rest_at_ends=True)
    assert law == Tabulated(times, angles, rest_at_ends=True)
    assert law.angles == angles
    with pytest.raises(ModelError, match="coefficients: found nan"):
        Polynomial(container((0.5, float("nan"))))


def test_numbers_of_a_law_in_a_text_may_have_exponents():
    readers = make_field_readers("rad")
    assert readers["times"]("0+1e+1+2e1") == (0.0, 10.0, 20.0)
    assert readers["coefficients"]("+1+2e+0rad/s") == (1.0, 2.0)
