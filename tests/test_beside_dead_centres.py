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
from spherekit.files.mechanism_reader import loads
from spherekit.mechanism.elements import Input
from spherekit.positions.decimal_frames import decimal_frames
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.positions.quad_positions import QuadAssembly
from spherekit.proof.balls import Digits
from spherekit.proof.decimal_mechanism import read_decimals
from spherekit.status import Status
from spherekit.tolerances import MAX_SINGULAR_ANGLE_ERROR_RAD


def beside_folds(seed):
    """Return a special mechanism, and inputs (n, 1) rad at and beside multiples of 90 deg.

    Such mechanisms often fold at these inputs. Two inputs lie exactly there, the others
    1e-9 to 1e-16 rad beside.
    """
    _, mechanism, _ = special_mechanism(seed)
    random = np.random.default_rng(seed)
    folds = np.radians(90.0 * random.integers(0, 5, 12))
    signs = random.choice([-1.0, 1.0], 12)
    distances = signs * 10.0 ** -random.uniform(9.0, 16.0, 12)
    distances[:2] = 0.0
    return mechanism, np.unique(folds + distances)[:, None]


pytestmark = pytest.mark.filterwarnings("error::RuntimeWarning")

SLOW = pytest.param(range(6, 40), marks=pytest.mark.slow)


@pytest.mark.slow
@pytest.mark.parametrize("seeds", [range(6), SLOW])
def test_angles_beside_folds_are_within_their_bounds_or_missing(seeds):
    """Very near to folds, angles are within their error bounds or missing.

    A fold is an input at which links are in line. `beside_folds` returns a mechanism and
    inputs 1e-9 to 1e-16 rad beside such inputs. The reference is the solution of the
    closure equations in 50 digits (`deviations`). A row either has all angles, or none and
    a status that says so.
    """
    compared_rows = 0
    for seed in seeds:
        mechanism, path = beside_folds(seed)
        try:
            motion = PositionAnalysis(mechanism, path=path).motion()
        except SpherekitError:  # its loops close nowhere
            continue
        # No computed configuration has loops that stay open.
        assert not np.any(motion.status == Status.NOT_CLOSED)
        has_angles = np.all(np.isfinite(motion.values), axis=1)
        assert np.all(has_angles[motion.status == Status.OK])
        assert np.array_equal(has_angles, ~motion.failed)

        rows = motion.rows(np.flatnonzero(has_angles))
        errors = deviations(rows)  # NaN where the reference does not converge
        bounds = rows.configuration_error
        is_compared = np.isfinite(errors)
        assert np.all(np.isfinite(bounds))
        assert np.all(errors[is_compared] <= bounds[is_compared])
        assert np.all(bounds <= MAX_SINGULAR_ANGLE_ERROR_RAD)
        compared_rows += np.sum(is_compared)
    assert compared_rows > 10 * len(seeds)


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
    """Return the rates of the rocker per unit rate of the crank, in both assembly modes.

    The four-bar has the arcs `FOLDING`. The test compares its computed rates with these
    rates, which follow from another formula in many digits (mpmath). The diagonal is the
    arc between the end of the crank and the axis of the rocker. It divides the four-bar
    into two spherical triangles: one with frame and crank, the other with coupler and
    rocker. The rocker angle is the sum (first mode) or difference (second mode) of their
    angles at the axis of the rocker. Its derivative is numerical.
    """
    frame, crank, coupler, rocker = (mp.radians(mp.mpf(arc)) for arc in FOLDING)

    def rocker_angle(theta, sign):
        """Return the rocker angle from the crank angle theta and the sign of the mode.

        The diagonal is the arc from the end of the crank to the axis of the rocker. The
        angles between arcs are measured at this axis. Only theta is at the crank's axis.
        """
        cos_diagonal = mp.cos(frame) * mp.cos(crank)
        cos_diagonal += mp.sin(frame) * mp.sin(crank) * mp.cos(theta)
        diagonal = mp.acos(cos_diagonal)
        # The angle from the frame to the diagonal: its sine and cosine, both times
        # sin(diagonal).
        scaled_sine = mp.sin(crank) * mp.sin(theta)
        scaled_cosine = mp.cos(crank) * mp.sin(frame)
        scaled_cosine -= mp.sin(crank) * mp.cos(frame) * mp.cos(theta)
        frame_to_diagonal = mp.atan2(scaled_sine, scaled_cosine)
        # The angle between diagonal and rocker, opposite the coupler.
        cosine = mp.cos(coupler) - mp.cos(rocker) * mp.cos(diagonal)
        cosine /= mp.sin(rocker) * mp.sin(diagonal)
        diagonal_to_rocker = mp.acos(cosine)
        return frame_to_diagonal + sign * diagonal_to_rocker

    step = mp.mpf(10) ** -40
    return [
        mp.diff(lambda theta, sign=sign: rocker_angle(theta, sign), crank_angle, h=step)
        for sign in (1, -1)
    ]


@pytest.mark.parametrize("distance", [1e-9, 1e-12, 3e-13, 1e-13, 1e-14])
def test_a_folding_four_bar_has_rates_beside_its_dead_centre(distance):
    """Rates of the rocker just before a dead centre agree with a formula in 90 digits.

    `distance` is in rad. Both modes meet where coupler (30 degrees) and rocker (40 degrees)
    are in line, 70 degrees from the end of the crank to the rocker's axis. Beyond that
    crank angle there is no configuration. The rates of both modes are sorted, so the larger
    error bound is used for both.
    """
    with mp.workdps(90):
        frame, crank, *_ = (mp.radians(mp.mpf(arc)) for arc in FOLDING)
        cosine = mp.cos(mp.radians(70)) - mp.cos(frame) * mp.cos(crank)
        dead_centre = float(mp.acos(cosine / (mp.sin(frame) * mp.sin(crank))))
        exact_rates = _rocker_rates(mp.mpf(dead_centre - distance))
        exact_rates = sorted(abs(float(rate)) for rate in exact_rates)
    mechanism = replace(four_bar(FOLDING), inputs=(Input("21", 0.0, 6.0),))
    rows = sk.evaluate(mechanism, [dead_centre - distance, dead_centre + distance])
    is_ok = rows.status == Status.OK
    assert np.sum(is_ok) == 2  # both modes before the dead centre
    assert np.sum(rows.status == Status.OUT_OF_REACH) == 2  # none after it

    rates = sorted(np.abs(rows.velocity_coefficient("4/1")[is_ok]))
    bounds = rows.velocity_coefficient_error_bound("4/1")[is_ok]
    assert np.all(np.abs(np.subtract(rates, exact_rates)) <= np.max(bounds))
    if distance < 5e-13:
        # Float64 sizes would leave too few digits so close to the dead centre. The rows are
        # therefore computed from the decimal sizes (30 degrees), with a small bound.
        assert np.max(bounds) < 1e-10 * exact_rates[0]


def inputs_of_dead_centres(position_analysis):
    """Return the inputs (rad) at which modes begin after inputs that are out of reach.

    A mode is followed along a curve of configurations, its guide. The mechanism is at a
    dead centre where this curve begins, because it cannot be assembled before.
    """
    guides = [mode.guide for mode in position_analysis.assembly_modes]
    return [guide.inputs[0] for guide in guides if guide.ends[0] == Status.OUT_OF_REACH]


@pytest.mark.slow
def test_a_followed_group_has_rows_up_to_its_dead_centre():
    """Error bounds are right 1e-12 and 1e-14 rad beside the end of an assembly mode.

    The mechanism contains a triad (a group of four links without a closed form), whose
    modes are followed as curves. `judge_bounds` asserts that errors are within bounds in
    all rows with status OK.
    """
    random = np.random.default_rng(2)
    mechanism = grow_dyad_chain(random, links=8, triads=True)
    mechanism = replace(mechanism, inputs=(Input(mechanism.inputs[0].pair, -1.5, 1.5),))
    dead_centre = inputs_of_dead_centres(PositionAnalysis(mechanism, samples=5))[0]
    distances = np.array([1e-12, 1e-14])
    path = np.unique(dead_centre + np.concatenate([distances, -distances]))
    comparison = judge_bounds(mechanism, path[:, None])
    compared_rows = comparison.rows  # rows with status OK
    rows_with_another_status = comparison.failed_rows
    # Two modes meet at the dead centre. At the two inputs before it they have
    # configurations, which must be rows with status OK. At the two inputs beyond it they
    # are out of reach.
    assert rows_with_another_status <= compared_rows


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


@pytest.mark.parametrize("gap", [0.5, 0.01])
def test_rounding_of_the_input_reaches_a_dead_centre_through_the_dyad_before_it(gap):
    """At -360, 0 and 360 deg a mechanism with a dead centre at 0 is AT_SINGULARITY.

    Of these inputs only 0 is an exact float64 number of radians. At -360 and 360 deg the
    rounded input is beside the dead centre, and the dyad before it enlarges the rounding
    error.

    The first dyad consists of links 3 and 4, the second one of links 5 and 6. At input 0
    the crank arc lies on the ground arc from axis 21 to axis 41. So axis 32, at the end of
    the crank, is only `gap` (deg) from axis 41. All arcs of links 3 and 4 are 90 deg, so
    link 4 turns with the great circle through axes 32 and 41. A rounding error of the input
    therefore turns link 4 by up to 1 / sin(gap) times this error. At input 0 the axis 54 of
    link 4 is 100 deg from the axis 61 of the ground. This is the sum of the arcs of links 5
    and 6, which are then in line: the second dyad is at a dead centre.
    """
    mechanism = loads(
        f"""
        format = 1
        name = "two_dyads"
        angle_unit = "deg"
        ground = "1"
        links.1 = {{ axes = ["41", "21", "61"], arcs = [{60.0 + gap}, 90], angles = [30] }}
        links.2 = {{ axes = ["21", "32"], arcs = [60] }}
        links.3 = {{ axes = ["32", "43"], arcs = [90] }}
        links.4 = {{ axes = ["41", "43", "54"], arcs = [90, 90], angles = [40] }}
        links.5 = {{ axes = ["54", "65"], arcs = [60] }}
        links.6 = {{ axes = ["61", "65"], arcs = [40] }}
        pairs.21 = {{ type = "R", links = ["2", "1"] }}
        pairs.32 = {{ type = "R", links = ["3", "2"] }}
        pairs.43 = {{ type = "R", links = ["4", "3"] }}
        pairs.41 = {{ type = "R", links = ["4", "1"] }}
        pairs.54 = {{ type = "R", links = ["5", "4"] }}
        pairs.65 = {{ type = "R", links = ["6", "5"] }}
        pairs.61 = {{ type = "R", links = ["6", "1"] }}
        inputs.21 = {{ from = -360, to = 360 }}
        """
    )
    motion = sk.trace(mechanism, samples=3)
    modes = {mode.signs: mode.number for mode in motion.assembly_modes}
    rows = motion.rows(np.flatnonzero(motion.assembly_mode == modes[1, 1]))
    assert rows.status.tolist() == [Status.AT_SINGULARITY] * 3
    # The exact angles of the pairs 32, 43, 41, 54, 65 and 61, at all three inputs:
    # - The triangle of the axes 32, 43 and 41 has two sides of 90 deg, which meet at axis
    #   43, and the side `gap`. So its angle at 43 is `gap`, and both others are 90 deg.
    # - Links 5 and 6 are in line, so the angle of pair 65 is 180 deg.
    # - They lie on the great circle through axes 54 and 61. These axes are both 90 deg from
    #   axis 41. So this circle makes angles of 90 deg with the arcs from 41 to 54 and 61.
    passive_angles = np.radians([-90.0, gap, -90.0, -90.0, 180.0, 90.0])
    errors = np.sin(0.5 * (rows.values[:, 1:] - passive_angles))
    # With the small gap, the error bounds of the angles exceed
    # `MAX_SINGULAR_ANGLE_ERROR_RAD`, so the angles are NaN.
    has_angles = np.isfinite(rows.configuration_error)
    assert np.all(has_angles) == (gap > 0.1)
    bounds = rows.configuration_error[has_angles, None]
    assert np.all(2.0 * np.abs(errors[has_angles]) <= bounds)
    # The status is the same if the first dyad is closed by Newton's method, from `starts`.
    # The first argument of `place` has a number for each dyad. 1 or -1 selects one of its
    # two solutions in closed form, and 0 selects Newton's method. `determinants` can state
    # to which mode Newton's method must lead. It is empty here, so this is not checked.
    starts = np.column_stack([rows.inputs, np.tile(passive_angles, (3, 1))])
    quad_assembly = QuadAssembly(mechanism, motion.assembly)
    placed = quad_assembly.place([0, 1], determinants=(), q=rows.inputs, starts=starts)
    assert placed.status.tolist() == [Status.AT_SINGULARITY] * 3


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
