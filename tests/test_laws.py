"""Time laws: exact rates and accelerations, their spans, and their keys in studies."""

import math

import numpy as np
import pytest
from helpers.refusals import TABLES, check_call, mechanism_text

from spherekit.errors import FileError, ModelError
from spherekit.files.study import Start
from spherekit.files.study_reader import load_study
from spherekit.files.time_law import ConstantSpeed, Cycloidal, Polynomial, Tabulated

TIMES = np.array([0.0, 0.3, 0.7, 1.1, 1.2, 1.9, 2.5, 3.0])


@pytest.mark.parametrize(
    "law, t, rows",
    [
        (ConstantSpeed(-2.0, 0.5), [0.0, 1.5], [[0.5, -2.5], [-2.0, -2.0], [0.0, 0.0]]),
        (Polynomial((1.0, 2.0, 3.0)), [0.0, 1.0], [[1.0, 6.0], [2.0, 8.0], [6.0, 6.0]]),
        (Cycloidal(0.5, 2.0, 2.5), [-1.0, 2.5], [[0.5, 2.0], [0.0, 0.0], [0.0, 0.0]]),
        (Cycloidal(0.5, 2.0, 2.5), [0.0, 9.0], [[0.5, 2.0], [0.0, 0.0], [0.0, 0.0]]),
    ],
)
def test_laws_where_they_are_plain(law, t, rows):
    assert [each.tolist() for each in law.at([t])] == [[row] for row in rows]


def test_cycloidal_against_derivatives_of_forty_digits():
    mp = pytest.importorskip("mpmath").mp
    law = Cycloidal(0.4, -1.1, 2.5)

    def exact(t):
        x, turn = t / mp.mpf(2.5), 2 * mp.pi
        return 0.4 + (mp.mpf(-1.1) - 0.4) * (x - mp.sin(turn * x) / turn)

    with mp.workdps(40):
        for t in (0.0, 0.2, 1.25, 2.0, 2.4999):
            expected = [float(mp.diff(exact, t, n)) for n in range(3)]
            np.testing.assert_allclose(law.at(t), expected, rtol=0, atol=4e-15)


def test_a_table_of_a_quintic_is_that_quintic():
    exact = np.polynomial.Polynomial((0.3, -1.0, 0.25, 2.0, -0.5, 0.125))
    law = Tabulated(tuple(TIMES.tolist()), tuple(exact(TIMES).tolist()))
    t = np.linspace(0.0, 3.0, 41)
    for found, each in zip(law.at(t), (exact, exact.deriv(1), exact.deriv(2)), strict=True):
        np.testing.assert_allclose(found, each(t), rtol=0, atol=2e-11)
    for beyond in (-0.1, [0.0, 3.1], math.nan):
        with pytest.raises(ModelError, match=r"times from 0 to 3 s, but .* asked for"):
            law.at(beyond)


@pytest.mark.parametrize("rest_at_ends", [False, True])
def test_rates_of_a_table_are_exactly_those_of_its_spline(rest_at_ends):
    random = np.random.default_rng(5)
    angles = tuple(random.normal(size=TIMES.size).tolist())
    law = Tabulated(tuple(TIMES.tolist()), angles, rest_at_ends)
    np.testing.assert_allclose(law.at(TIMES)[0], angles, rtol=0, atol=1e-13)
    # Gauss's rule of four points is exact for the quintic pieces between knots.
    nodes, weights = np.polynomial.legendre.leggauss(4)
    start, stop = TIMES[:-1, None], TIMES[1:, None]
    inner = (start + stop) / 2 + (stop - start) / 2 * nodes
    scale = float(np.max(np.abs(law.at(inner)[2])))
    for lower, upper in ((0, 1), (1, 2)):
        rise = (stop - start)[:, 0] / 2 * (law.at(inner)[upper] @ weights)
        found = np.diff(law.at(TIMES)[lower])
        np.testing.assert_allclose(rise, found, rtol=0, atol=1e-13 * scale)
    ends = np.array(law.at(TIMES[[0, -1]])[1:])
    assert bool(np.max(np.abs(ends)) < 1e-11 * scale) is rest_at_ends


@pytest.mark.parametrize("call", TABLES["laws"])
def test_laws_that_are_none(call):
    check_call(call, globals(), TABLES["laws"][call])


STUDY = mechanism_text("laws_study.study")
CYCLOID = 'kind = "cycloidal"\nfrom = 0\nto = 90\nduration = 2'
CONSTANT = 'kind = "constant_speed"\nspeed = 90.0\nfrom = 10\n'
TABLE = 'kind = "table"\ntimes = [0, 1, 3]\nangles = [0, 90, 900]\nrest_at_ends = true\n'


def study(folder, text):
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
def test_a_study_has_laws_duration_and_start(tmp_path, text, law):
    read = study(tmp_path, STUDY + text)
    assert read.laws == {"21": law} and (read.duration, read.start) == (2.5, None)
    bare = STUDY.partition("[inputs.21.law]")[0]
    read = study(tmp_path, f"{bare}[start]\nq = 90\ndq = 180\n")
    assert read.start == Start(math.pi / 2, math.pi)


def test_laws_need_an_angle_unit_and_other_studies_do_not(tmp_path):
    bare = study(tmp_path, 'format = 1\nmechanism = "four_bar"\nduration = 1\n')
    assert (bare.laws, bare.duration, bare.start) == ({}, 1.0, None)
    text = STUDY.replace('angle_unit = "deg"\n', "").replace("from = 0\nto = 720\n", "")
    for more in (text + CONSTANT, text.partition("[inputs")[0] + "[start]\nq = 0\n"):
        with pytest.raises(FileError, match="the key angle_unit is missing"):
            study(tmp_path, more)


def test_turns_in_a_study_in_radians_are_not_taken_for_degrees(tmp_path):
    text = STUDY.replace('"deg"', '"rad"').replace("720", "6")
    read = study(tmp_path, text + 'kind = "polynomial"\ncoefficients = [0, 1, 40]\n')
    assert read.laws["21"] == Polynomial((0.0, 1.0, 40.0))
    with pytest.raises(FileError, match=r"start\.q: found 90\.0 rad"):
        study(tmp_path, text + CONSTANT + "[start]\nq = 90\n")
