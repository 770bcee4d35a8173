"""Rows within rounding of a dead centre: angles, rates and bounds, against 60 digits."""

from dataclasses import replace

import mpmath as mp
import numpy as np
import pytest
from helpers.error_bound_checks import judge_bounds
from mechanism_examples.linkages import grow_dyad_chain
from mechanism_examples.special_mechanisms import four_bar, special_mechanism
from oracles.exact_configurations import deviations

import spherekit as sk
from spherekit.errors import SpherekitError
from spherekit.mechanism.elements import Input
from spherekit.positions.decimal_frames import decimal_frames
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.proof.balls import Digits
from spherekit.proof.decimal_mechanism import read_decimals
from spherekit.status import Status
from spherekit.tolerances import MAX_SINGULAR_ANGLE_ERROR_RAD


def beside_folds(seed):
    """Return a mechanism, and inputs 1e-9 to 1e-16 rad beside multiples of 90 degrees."""
    _, made, _ = special_mechanism(seed)
    random = np.random.default_rng(seed)
    folds = np.radians(90.0 * random.integers(0, 5, 12))
    off = random.choice([-1.0, 1.0], 12) * 10.0 ** -random.uniform(9.0, 16.0, 12)
    off[:2] = 0.0
    return made, np.unique(folds + off)[:, None]


pytestmark = pytest.mark.filterwarnings("error::RuntimeWarning")

SLOW = pytest.param(range(6, 40), marks=pytest.mark.slow)


@pytest.mark.slow
@pytest.mark.parametrize("seeds", [range(6), SLOW])
def test_angles_beside_folds_are_right_or_left_out(seeds):
    judged = 0
    for seed in seeds:
        made, path = beside_folds(seed)
        try:
            motion = PositionAnalysis(made, path=path).motion()
        except SpherekitError:  # arcs that close nowhere
            continue
        assert not np.any(motion.status == Status.NOT_CLOSED)
        known = np.all(np.isfinite(motion.values), axis=1)
        assert np.all(known[motion.status == Status.OK])
        assert np.array_equal(known, ~motion.failed)
        rows = motion.rows(np.flatnonzero(known))
        away = deviations(rows)
        bound = rows.configuration_error
        assert np.all(np.isfinite(bound))
        is_judged = np.isfinite(away)
        assert np.all(away[is_judged] <= bound[is_judged])
        assert np.all(bound <= MAX_SINGULAR_ANGLE_ERROR_RAD)
        judged += np.sum(np.isfinite(away))
    assert judged > 10 * len(seeds)


@pytest.mark.parametrize(
    "seeds", [range(4), pytest.param(range(4, 25), marks=pytest.mark.long)]
)
def test_rates_beside_folds_are_within_their_bounds(seeds):
    rows = 0
    for seed in seeds:
        rows += judge_bounds(*beside_folds(seed)).rows
    assert rows > 20


FOLDING = [60.0, 50.0, 30.0, 40.0]
"""Arcs (deg) of frame, crank, coupler and rocker, which get in line."""


def _rocker_rates(crank_angle):
    """Return how fast the rocker turns in both modes, by spherical triangles."""
    frame, crank, coupler, rocker = (mp.radians(mp.mpf(arc)) for arc in FOLDING)

    def rocker_angle(theta, sign):
        cosine = mp.cos(frame) * mp.cos(crank)
        cosine += mp.sin(frame) * mp.sin(crank) * mp.cos(theta)
        diagonal = mp.acos(cosine)
        beside = mp.cos(crank) * mp.sin(frame)
        beside -= mp.sin(crank) * mp.cos(frame) * mp.cos(theta)
        base = mp.atan2(mp.sin(crank) * mp.sin(theta), beside)
        corner = mp.cos(coupler) - mp.cos(rocker) * mp.cos(diagonal)
        corner /= mp.sin(rocker) * mp.sin(diagonal)
        return base + sign * mp.acos(corner)

    at = mp.mpf(crank_angle)
    return [
        mp.diff(lambda theta, sign=sign: rocker_angle(theta, sign), at, h=mp.mpf(10) ** -40)
        for sign in (1, -1)
    ]


@pytest.mark.parametrize("off", [1e-9, 1e-12, 3e-13, 1e-13, 1e-14])
def test_a_folding_four_bar_has_rates_beside_its_dead_centre(off):
    """Both modes meet where coupler and rocker are in line: an arc of 70 degrees."""
    with mp.workdps(90):
        frame, crank, *_ = (mp.radians(mp.mpf(arc)) for arc in FOLDING)
        cosine = mp.cos(mp.radians(70)) - mp.cos(frame) * mp.cos(crank)
        edge = float(mp.acos(cosine / (mp.sin(frame) * mp.sin(crank))))
        expected = sorted(abs(float(rate)) for rate in _rocker_rates(edge - off))
    made = replace(four_bar(FOLDING), inputs=(Input("21", 0.0, 6.0),))
    at = sk.evaluate(made, [edge - off, edge + off])
    good = at.status == Status.OK
    assert np.sum(good) == 2  # both modes on one side, none on the other
    assert np.sum(at.status == Status.OUT_OF_REACH) == 2
    rates = sorted(np.abs(at.velocity_coefficient("4/1")[good]))
    bounds = at.velocity_coefficient_error_bound("4/1")[good]
    assert np.all(np.abs(np.subtract(rates, expected)) <= np.max(bounds))
    if off < 5e-13:  # by the decimals of the file; else of rounded sizes
        assert np.max(bounds) < 1e-10 * expected[0]


@pytest.mark.slow
def test_a_followed_group_has_rows_up_to_its_dead_centre():
    """A triad beside the end of its mode, which the nodes of the curve do not reach."""
    random = np.random.default_rng(2)
    made = grow_dyad_chain(random, 8, True)
    made = replace(made, inputs=(Input(made.inputs[0].pair, -1.5, 1.5),))
    guides = [mode.guide for mode in PositionAnalysis(made, samples=5).assembly_modes]
    ends = [guide.inputs[0] for guide in guides if guide.ends[0] == Status.OUT_OF_REACH]
    off = np.array([1e-12, 1e-14])
    path = np.unique(ends[0] + np.concatenate([off, -off]))
    found = judge_bounds(made, path[:, None])
    assert found.marked <= found.rows


@pytest.mark.parametrize("arcs", [(40, 40, 70, 70), (60, 60, 60, 60), (90, 90, 90, 90)])
def test_a_dyad_that_can_turn_about_a_line_has_no_angles(arcs):
    """Both outer axes coincide at input 0: the dyad can stand anywhere."""
    made = four_bar([float(arc) for arc in arcs])
    motion = PositionAnalysis(made, path=np.array([[0.0], [1.0]])).motion()
    at_fold = motion.inputs[:, 0] == 0.0
    if not np.any(motion.status[at_fold] == Status.AT_SINGULARITY):
        pytest.skip("this fold is at another input")
    assert np.all(np.isnan(motion.values[at_fold]).any(axis=1) == motion.failed[at_fold])
    assert np.all(motion.status[~at_fold] == Status.OK)


def test_sizes_are_the_decimals_of_the_file():
    """64.02 degrees, and not the float64 number of radians next to it."""
    made = four_bar([64.02, 60.1, 80.3, 70.7])
    first, second = decimal_frames(made)[made.pair_number["21"]]
    with Digits(40).within():
        exact = read_decimals(made).revolute_frames()["21"]
        for frame, rows in zip((first, second), exact, strict=True):
            text = np.array(
                [[str(x.mid().str(36, radius=False)) for x in y] for y in rows.T]
            )
            away = frame - text.ravel().astype(frame.dtype).reshape(3, 3)
            assert np.max(np.abs(away.astype(float))) < 1e-32
