"""The configuration curve in its own arc length: laps, dead points, ends, all curves."""

from functools import cache

import numpy as np
import pytest
from mechanism_examples.named_mechanisms import (
    ARM,
    DEGREE,
    GROUND,
    cam_with_follower,
    direction_at_colatitude,
    four_bar,
    open_cam,
)
from oracles.four_bar_singularities import count_configuration_curves

import spherekit as sk
from spherekit.errors import SolveError
from spherekit.mechanism.elements import Profile
from spherekit.mechanism.joint_construction import make_joints
from spherekit.positions.curve_continuation import follow_arc, follow_arcs
from spherekit.positions.loop_closure import Closure
from spherekit.positions.position_analysis import PositionAnalysis

NO_CRANK = np.radians([60.0, 75.0, 40.0, 50.0])
"""Shortest and longest link together exceed the others: no link turns fully."""


def closed_near(made, guess):
    """Return the curve through the configuration at a guessed one's input."""
    closure = Closure.of_mechanism(made, make_joints(made))
    return follow_arc(closure, closure.solve(np.array([guess]), fixed=[0]).values[0])


GUESSES = {
    "roller_cam": (0.5, -1.0, 0.9, 0.6),
    "shaped_cam": (0.5, -0.65, 0.9, 0.7),
    "planetary_bevel": (0.5, 2.6, -0.6, 1.9, 0.5),
}
"""Near closed configurations, so that no modes have to be searched for."""


@cache
def shipped(name):
    """Return a curve of a shipped mechanism."""
    if name in GUESSES:
        return closed_near(sk.load(name), GUESSES[name])
    tracer = PositionAnalysis(sk.load(name), search=False)
    return follow_arc(tracer.solver.closure, tracer.at(tracer.range[0] + 0.5).values[0])


def all_curves(made):
    """Return the configuration curves of a mechanism."""
    return [item.curve for item in PositionAnalysis(made).configurations.curves]


def loop_gap(arcs, values):
    """Return cos(angle of k_3, k_4) - cos(alpha_3) by eq. (22) of Di Gregorio 2024."""
    s1, s2, _, s4 = np.sin(arcs)
    c1, c2, c3, c4 = np.cos(arcs)
    q, p = values[:, 0], values[:, 3]
    k3 = np.stack(
        [np.sin(q) * s2, s1 * c2 - c1 * s2 * np.cos(q), c1 * c2 + s1 * s2 * np.cos(q)]
    )
    k4 = np.stack([np.sin(p) * s4, -np.cos(p) * s4, c4 + 0.0 * p])
    return np.sum(k3 * k4, axis=0) - c3


@pytest.fixture(scope="module")
def no_crank():
    (curve,) = all_curves(four_bar(NO_CRANK))
    return curve


def test_one_lap_of_a_four_bar_without_a_crank(no_crank):
    assert count_configuration_curves(NO_CRANK) == 1
    assert no_crank.closed and not np.any(no_crank.winding)
    s = np.linspace(0.0, no_crank.length, 2001)
    points = no_crank.at(s)
    assert np.max(points.residual) < 1e-14
    assert np.max(np.abs(loop_gap(NO_CRANK, points.values))) < 2e-15
    assert np.max(np.abs(points.values[0] - points.values[-1])) < 1e-13
    # the tangent, integrated over the lap, returns to the start too
    assert np.max(np.abs(np.mean(points.tangents[:-1], axis=0))) < 1e-14
    other = follow_arc(no_crank.closure, no_crank.at(3.0).values[0])
    assert other.length == pytest.approx(no_crank.length, abs=1e-13)


@pytest.mark.parametrize(
    ("name", "winding"),
    [
        ("stephenson", (1, 0, 0, -1, 0, 0, 0)),
        ("double_butterfly", (1, 0, -1, -1, 0, 0, 0, 0, 0, 0)),
        ("eight_bar_01", (0, 0, 1, 0, 0, 0, 0, 0, -1, 0)),
        ("roller_cam", (1, 0, -1, 0)),
        ("shaped_cam", (1, 0, -1, 0)),
    ],
)
def test_curves_of_shipped_mechanisms_close_after_one_lap(name, winding):
    """A closed curve of configurations is back at its start after one lap.

    The curve is in the space of all variables. Each variable grows by whole turns in a lap:
    its winding number times its period. The period of a variable is its growth (rad) after
    which the pair is in the same state, such as one revolution. The total growth in a lap
    is `curve.rise`. The curve may be followed in either direction, so the winding numbers
    are compared up to a common sign. Beyond its length the curve repeats itself, with
    variables that have grown by `curve.rise`.
    """
    curve = shipped(name)
    assert curve.closed
    assert curve.ends == (sk.Status.OK, sk.Status.OK)
    sign = np.sign(curve.winding @ np.array(winding))
    assert np.array_equal(sign * curve.winding, winding)
    points = curve.at(np.linspace(0.0, curve.length, 301))
    assert np.max(points.residual) < 1e-14
    s = 0.3
    first, a_lap_on, two_laps_back = curve.at(
        np.array([s, s + curve.length, s - 2 * curve.length])
    ).values
    assert np.max(np.abs(a_lap_on - first - curve.rise)) < 1e-12
    assert np.max(np.abs(two_laps_back - first + 2 * curve.rise)) < 1e-12


def test_cones_without_a_common_length_never_close():
    tracer = PositionAnalysis(sk.load("rolling_cones"), search=False)
    curve = follow_arc(tracer.solver.closure, tracer.at(0.5).values[0], longest=20.0)
    assert not curve.closed and curve.ends == (sk.Status.OK, sk.Status.OK)
    assert 40.0 <= curve.length < 41.0 and np.isinf(curve.periods[-1])


def test_a_curve_ends_exactly_where_the_contact_leaves_an_open_profile():
    curve = closed_near(open_cam(), [0.6, 0.77, 0.5, 1.27])
    assert curve.ends == (sk.Status.OFF_PROFILE, sk.Status.OFF_PROFILE)
    profile = curve.closure.joints[2].first
    ends = np.sort(curve.nodes.values[[0, -1], 2])
    assert np.max(np.abs(ends - [0.0, profile.length])) < 1e-12
    assert np.max(curve.at(np.linspace(0.0, curve.length, 200)).residual) < 1e-12
    assert np.all(np.isnan(curve.at([-0.1, curve.length + 0.1]).values))


def test_a_curve_ends_exactly_where_curvatures_are_equal():
    waisted = Profile("fourier", (0.0, 0.0, 1.0), cosines=(25 * DEGREE, 0.0, 9 * DEGREE))
    made = cam_with_follower(
        GROUND, waisted, Profile("circle", direction_at_colatitude(ARM), 30 * DEGREE)
    )
    curve = closed_near(made, [-0.6, -0.9, 1.5, 1.56])
    assert curve.ends == (sk.Status.CURVATURE, sk.Status.CURVATURE)
    cam_profile, roller = (curve.closure.joints[2].first, curve.closure.joints[2].second)
    ends = curve.nodes.values[[0, -1]]
    gap = cam_profile.evaluate(ends[:, 2]).curvature - roller.evaluate(ends[:, 3]).curvature
    assert np.max(np.abs(gap)) < 2e-9


def test_stops_end_a_curve_where_they_are(no_crank):
    given = no_crank.nodes.values[4]
    stops = {1: (given[1] - 0.2, given[1] + 0.3)}
    curve = follow_arc(no_crank.closure, given, stops)
    assert curve.ends == (sk.Status.OK, sk.Status.OK) and not curve.closed
    ends = np.sort(curve.nodes.values[[0, -1], 1])
    assert np.max(np.abs(ends - stops[1])) < 1e-14
    assert np.min(np.max(np.abs(curve.nodes.values - given), axis=1)) < 1e-14


def test_stops_more_than_a_turn_apart_end_a_curve_where_they_are():
    """A crank with stops more than one turn apart moves on an open curve between them.

    Without stops the curve of the four-bar is closed, because its configurations repeat
    after one turn of the crank. With stops 9 rad apart the crank can make this turn, but it
    cannot go on turning. So the curve has to end at the stops. `rise` is the growth of the
    variables in one round of a closed curve; it is zero on an open curve.
    """
    curve = shipped("four_bar")
    start = curve.nodes.values[0]
    crank_start = start[0]
    stops = {0: (crank_start - 7.0, crank_start + 2.0)}
    limited_curve = follow_arc(curve.closure, start, stops)
    assert not limited_curve.closed and not np.any(limited_curve.rise)
    ends = np.sort(limited_curve.nodes.values[[0, -1], 0])
    assert np.max(np.abs(ends - stops[0])) < 1e-13
    # Pair 3, the output, only swings. Stops outside the range of its swing have no effect.
    swing = curve.nodes.values[:, 3]
    free_curve = follow_arc(curve.closure, start, {3: (min(swing) - 1, max(swing) + 1)})
    assert free_curve.closed
    assert free_curve.length == pytest.approx(curve.length, abs=1e-12)


def test_a_start_in_a_crossing_is_singular_and_leaves_other_curves_alone():
    """Two curves of a parallelogram cross where all its axes are in one plane."""
    made = four_bar(np.radians([60.0, 40.0, 60.0, 40.0]))
    closure = Closure.of_mechanism(made, make_joints(made))
    crossing = np.array([0.0, np.pi, 0.0, 0.0])
    assert closure.linearise(crossing[None]).closure_residual[0] < 1e-15
    with pytest.raises(SolveError, match="is singular"):
        follow_arc(closure, crossing)
    (regular,) = closure.solve(np.array([[1.0, 2.8, 0.5, -1.0]]), fixed=[0]).values
    curves = follow_arcs(closure, np.stack([crossing, regular]), longest=50.0)
    assert curves[0] is None and curves[1].passes(regular[None]).all()


@pytest.mark.slow
def test_curves_of_a_parallelogram_end_at_their_crossings():
    """Configuration curves of a parallelogram end in the two poses in which it folds flat.

    The four-bar has arcs of 60-40-60-40 degrees. Four open curves meet in these poses: the
    axes of all pairs are in one plane, so the smallest singular value of their matrix
    vanishes. A curve cannot be started there.
    """
    curves = all_curves(four_bar(np.radians([60.0, 40.0, 60.0, 40.0])))
    assert len(curves) == 4
    for curve in curves:
        assert curve.ends == (sk.Status.AT_SINGULARITY, sk.Status.AT_SINGULARITY)
        for node in (0, -1):
            axes = curve.closure.linearise(curve.nodes.values[[node]]).axes[0]
            assert np.linalg.svd(axes, compute_uv=False)[-1] < 1e-4
        s = np.linspace(0.0, curve.length, 50)
        assert np.max(curve.at(s).residual) < 1e-13
    with pytest.raises(SolveError, match="is singular"):
        follow_arc(curves[0].closure, curves[0].at(0.0).values[0])


def test_starts_that_cannot_be_followed(no_crank):
    closure = no_crank.closure
    with pytest.raises(SolveError, match="does not close"):
        follow_arc(closure, no_crank.nodes.values[0] + [0.0, 0.0, 1.5, 0.7])
    given = no_crank.nodes.values[0]
    with pytest.raises(SolveError, match=r"0\.1 beyond the lowest value .* of variable 2"):
        follow_arc(closure, given, {2: (given[2] + 0.1, given[2] + 1.0)})
    with pytest.raises(SolveError, match="limits are close on both sides"):
        follow_arc(closure, given, {1: (given[1], given[1])})
    with pytest.raises(SolveError, match="is not finite"):
        follow_arc(closure, np.full(4, np.nan))


def test_modes_that_meet_at_dead_points_are_one_curve():
    """Both modes of a four-bar without a crank are pieces of one configuration curve.

    A mode is a way to assemble the links; at a dead point the input turns back. The pieces
    cover the whole curve. On each piece the configurations are those of its mode at the
    same input, and `find` returns their place on the curve.
    """
    position_analysis = PositionAnalysis(four_bar(NO_CRANK))
    (item,) = position_analysis.configurations.curves
    curve = item.curve
    assert {piece.assembly_mode for piece in item.pieces} == {0, 1}
    covered = sum(piece.stop - piece.start for piece in item.pieces)
    assert covered == pytest.approx(curve.length, abs=1e-9)
    for piece in item.pieces:
        s = np.linspace(piece.start, piece.stop, 9)[1:-1]
        values = curve.at(s).values
        q = np.mod(values[:, 0], 2 * np.pi)
        mode = position_analysis.assembly_modes[piece.assembly_mode]
        mode_values = position_analysis.solver.evaluate(mode, q[:, None]).values
        assert np.max(np.abs(curve.wrapped(mode_values - values))) < 1e-9
        values_at_place = curve.at(curve.find(mode_values)).values
        assert np.max(np.abs(curve.wrapped(values_at_place - mode_values))) < 1e-9


def test_a_curve_has_two_configurations_between_dead_points_and_one_at_each(no_crank):
    """A configuration curve has one place with a dead point's input, and two before it.

    A place is an arc length along the curve. `no_crank` is the closed curve of a four-bar
    whose input swings between two dead points. At a dead point the input turns back and two
    assembly modes (ways to assemble the links) meet in a double place. 1e-9 rad before it
    there are two configurations, and 1e-6 rad beyond it none. Whole turns of the input do
    not matter.
    """
    input_variable = 0
    dead_points = no_crank.dead_points(input_variable).places
    limits = no_crank.at(dead_points).values[:, input_variable]
    middle = float(np.mean(limits))
    highest = float(np.max(limits))

    places = no_crank.find_value(input_variable, middle + 4 * np.pi).places
    assert len(places) == 2
    inputs = no_crank.at(places).values[:, input_variable]
    assert np.max(np.abs(inputs - middle)) < 1e-14

    at_dead_point = no_crank.find_value(input_variable, highest)
    assert at_dead_point.double.tolist() == [True]
    assert np.min(np.abs(dead_points - at_dead_point.places)) < 1e-7
    assert len(no_crank.find_value(input_variable, highest + 1e-6).places) == 0
    assert len(no_crank.find_value(input_variable, highest - 1e-9).places) == 2


@pytest.mark.parametrize("name", ["stephenson", "double_butterfly", "shaped_cam"])
def test_derivatives_along_a_curve_are_limits_of_central_differences(name):
    """Derivatives of a configuration curve by its arc length are those of differences.

    First and second derivatives (`tangents`, `bends`) are compared at seven places. Central
    differences have an error of second order: it falls by 4 with half the step, and (4 fine
    - coarse) / 3 is right to fourth order (Richardson's extrapolation).
    """
    curve = shipped(name)
    s = np.linspace(0.1, curve.length, 7)
    points = curve.at(s)

    def central_differences(h):
        ahead = curve.at(s + h).values
        behind = curve.at(s - h).values
        return (ahead - behind) / (2 * h), (ahead - 2 * points.values + behind) / h**2

    coarse_tangents, coarse_bends = central_differences(4e-3)
    fine_tangents, fine_bends = central_differences(2e-3)
    for coarse, fine, exact in (
        (coarse_tangents, fine_tangents, points.tangents),
        (coarse_bends, fine_bends, points.bends),
    ):
        assert np.max(np.abs((4 * fine - coarse) / 3 - exact)) < 1e-7
        error_ratio = np.max(np.abs(coarse - exact)) / np.max(np.abs(fine - exact))
        assert error_ratio == pytest.approx(4.0, rel=0.02)
