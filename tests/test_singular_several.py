"""Singularities with several inputs: types, curves, aspects, surfaces."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from mechanism_examples.linkages import mechanism_from_chain, random_axes
from mechanism_examples.named_mechanisms import direction_at_colatitude, open_cam
from mechanism_examples.wide_five_bar import wide_five_bar
from oracles.four_bar_singularities import axes_at_configuration, count_configuration_curves
from oracles.velocity_equations import locked_rates, sine_between_lines
from scipy import ndimage

import spherekit as sk
from spherekit.completeness import Guarantee
from spherekit.mechanism.elements import (
    Input,
    LinkSizes,
    Output,
    Pair,
    Profile,
    SizeGeometry,
)
from spherekit.positions.motion import make_motion
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.singularities import aspects as aspects_module
from spherekit.singularities import curve_tracing, surface_front
from spherekit.singularities.aspects import aspects
from spherekit.singularities.curve_starts import (
    LocusPointSearch,
    closed_configurations,
    points_from,
    ranges_of,
)
from spherekit.singularities.curve_tracing import trace_curves
from spherekit.singularities.locus import SingularityLocus
from spherekit.singularities.several_inputs import RowType, coefficients
from spherekit.singularities.singular_curves import singular_curves
from spherekit.singularities.singular_surface import singular_surface
from spherekit.singularities.singularity_report import SingularityReport
from spherekit.singularities.slices import cut, solver_of
from spherekit.singularities.stationarity import InputsLocked, output_of
from spherekit.status import Status

LEGS = [(1, 2), (2, 3), (3, 8), (1, 4), (4, 5), (5, 8), (1, 6), (6, 7), (7, 8)]
"""Three legs of three pairs from link 1 to link 8, pair by pair."""
CRANKS = ("p1_2", "p1_4", "p1_6")


def unit(vector):
    return vector / np.linalg.norm(vector)


def three_legs(axes, driven=CRANKS):
    """Return a 3-RRR, its axes (9, 3) leg by leg in the reference pose."""
    made = mechanism_from_chain(LEGS, axes, driven=driven[0])
    return replace(
        made.with_inputs(*driven), outputs=(Output("platform", "8", "1"),), name="3-RRR"
    )


def at_reference(made, **options):
    """Return the coefficients at the reference pose, and the motion."""
    solver = solver_of(made)
    motion = make_motion(solver, solver.reference[None])
    return coefficients(motion, output_of(made), **options), motion


def in_plane(random, first, second):
    """Return a random unit vector in the plane of two others."""
    a, b = random.normal(size=2)
    return unit(a * first + b * second)


def through(random, line):
    """Return axes b, c of a leg in a random plane through a line."""
    other = unit(random.normal(size=3))
    return in_plane(random, line, other), in_plane(random, line, other)


@pytest.mark.slow
def test_superposition_gives_the_motion_of_all_inputs_together():
    """The velocity of a platform is the sum over its inputs (Di Gregorio 2015, equation 7).

    Let input i move alone at the rate q'_i, with the other inputs locked. The platform
    (link 8) then turns about its pole axis u_i at a rate w_i. The coefficients c_i and d_i
    of c_i w_i = d_i q'_i follow from pole axes. With all inputs moving, the angular
    velocity w of the platform is sum(w_i u_i), so

        prod(c) w = sum of d_i (product of the other c) q'_i u_i.

    The reference for w are the velocity equations (`locked_rates`), for all inputs together
    and for each alone.
    """
    random = np.random.default_rng(1)
    for _ in range(8):
        rows, motion = at_reference(three_legs(random_axes(random, 9)))
        # The only row is not singular; group 0 says the same.
        assert rows.type[0] == RowType.REGULAR
        assert rows.group[0] == 0
        input_pairs = motion.assembly.inputs
        input_rates = random.normal(size=3)
        rate_by_pair = dict(zip(input_pairs, input_rates, strict=True))
        # Angular velocities of all links at row 0, the only one.
        link_rates_together, _ = locked_rates(motion, 0, rate_by_pair)
        platform_rate = link_rates_together[7]

        c = rows.c[0]
        d = rows.d[0]
        u = rows.u[0]
        product_of_others = np.array([np.prod(np.delete(c, i)) for i in range(3)])
        right_side = (d * product_of_others * input_rates) @ u
        rounding = 1e-12 * np.linalg.norm(platform_rate)
        assert np.allclose(np.prod(c) * platform_rate, right_side, atol=rounding)

        for k, input_pair in enumerate(input_pairs):
            link_rates_alone, _ = locked_rates(motion, 0, input_pair)
            rate_alone = link_rates_alone[7]
            assert np.allclose(rows.w[0, k], rate_alone, rtol=1e-9, atol=1e-11)
            assert sine_between_lines(rows.u[0, k], rate_alone) < 1e-10
            # Rates of the output and of this input in the same motion, in which this input
            # moves alone. They have a common scale, so only their ratio is compared.
            ratio = rows.output_rate[0, k] / abs(rows.input_rate[0, k])
            assert ratio == pytest.approx(np.linalg.norm(rate_alone), rel=1e-9)


TWO_INPUTS_ON_ONE_LEG = ("p1_2", "p2_3", "p1_4")
"""Inputs at the first two pairs of one leg, and at the first pair of another one."""


def stretch_leg(axes, leg=0):
    """Bring the three axes of a leg in one plane."""
    axes[3 * leg + 1] = in_plane(np.random.default_rng(3), *axes[3 * leg : 3 * leg + 3 : 2])


def axes_through_common_line(random):
    """Return a line, and axes of which each leg's moving ones are in a plane through it."""
    line = unit(random.normal(size=3))
    axes = random_axes(random, 9)
    for leg in range(3):
        axes[3 * leg + 1 : 3 * leg + 3] = through(random, line)
    return line, axes


@pytest.mark.slow
@pytest.mark.parametrize("leg", range(3))
def test_statement_1_a_stretched_leg_is_type_one(leg):
    """The case study's first example: the three axes of a leg are coplanar."""
    axes = random_axes(np.random.default_rng(2 + leg), 9)
    stretch_leg(axes, leg)
    found, _ = at_reference(three_legs(axes))
    assert found.type[0] == RowType.I and found.group[0] == 1
    assert abs(found.d[0, leg]) < 1e-13 and found.output_rate[0, leg] < 1e-13
    others = np.delete(np.abs(found.d[0]), leg)
    assert np.all(others > 1e-3) and np.all(np.abs(found.c[0]) > 1e-3)


@pytest.mark.parametrize("seed", range(5))
def test_coincident_poles_of_a_three_rrr_are_type_two(seed):
    """Theorem 2 of Di Gregorio 2015: u_1, u_2, u_3 coincide, so all c_i vanish.

    The planes of the distal axes of all legs have a common line, which is that of the u_i.
    """
    line, axes = axes_through_common_line(np.random.default_rng(5 + seed))
    rows, _ = at_reference(three_legs(axes))
    assert rows.type[0] == RowType.II
    assert rows.group[0] == 1
    assert np.all(sine_between_lines(rows.u[0], line) < 1e-12)
    assert np.all(np.abs(rows.c[0]) < 1e-12)
    assert np.all(np.abs(rows.input_rate[0]) < 1e-12)
    assert np.all(np.abs(rows.d[0]) > 1e-6)
    assert rows.type_one[0] > 1e-6


@pytest.mark.parametrize("seed", range(5))
def test_coincident_poles_with_a_stretched_leg_are_type_three(seed):
    """Statement 3: the crank axis of leg 1 is in the plane of its other two axes, too."""
    _, axes = axes_through_common_line(np.random.default_rng(5 + seed))
    axes[0] = in_plane(np.random.default_rng(seed), axes[1], axes[2])
    rows, _ = at_reference(three_legs(axes))
    assert rows.type[0] == RowType.III
    assert rows.group[0] == 1


@pytest.mark.many
@pytest.mark.parametrize("seed", range(8))
def test_theorem_1_coplanar_poles_are_type_one_of_the_second_group(seed):
    """Coplanar poles of a platform are a singularity of type I of the second group.

    This is theorem 1 of Di Gregorio 2015. If input i moves alone at the rate q'_i, the
    platform turns about the pole axis u_i at a rate w_i with c_i w_i = d_i q'_i. At type I
    inputs can move while the platform rests, for one of two reasons:

    - First group: some d_i vanishes. Input i alone does not move the platform.
    - Second group: no d_i vanishes, but the three axes u_i are coplanar, so that their
      triple product vanishes. Several inputs together can leave the platform at rest.

    Two inputs are at pairs of one leg. While one input moves, the platform turns about the
    axes of this leg only. If the leg is stretched, these axes are coplanar, and so are the
    axes u_i. With a c_i of zero the platform could move while all inputs rest (type II).
    """
    axes = random_axes(np.random.default_rng(6 + seed), 9)
    rows, _ = at_reference(three_legs(axes, TWO_INPUTS_ON_ONE_LEG))
    assert rows.type[0] == RowType.REGULAR
    (triple_product,) = rows.triples[0]
    assert abs(triple_product) > 1e-6
    stretch_leg(axes)
    rows, _ = at_reference(three_legs(axes, TWO_INPUTS_ON_ONE_LEG))
    assert rows.type[0] == RowType.I
    assert rows.group[0] == 2
    (triple_product,) = rows.triples[0]
    assert abs(triple_product) < 1e-12
    assert np.all(np.abs(rows.c[0]) > 1e-4)
    assert np.all(np.abs(rows.d[0]) > 1e-4)


@pytest.mark.many
@pytest.mark.parametrize("seed", range(8))
def test_a_pose_can_be_of_type_three_without_a_vanishing_d(seed):
    """An exception to the "only if" of statement 3 of Di Gregorio 2015.

    In addition to the stretched leg, the third axis of that leg lies in the plane of the
    undriven axes of the leg with the third input.
    """
    axes = random_axes(np.random.default_rng(6 + seed), 9)
    stretch_leg(axes)
    axes[4] = in_plane(np.random.default_rng(seed), axes[2], axes[5])
    rows, _ = at_reference(three_legs(axes, TWO_INPUTS_ON_ONE_LEG))
    assert rows.type[0] == RowType.III
    assert np.all(np.abs(rows.c[0]) < 1e-12)
    assert np.all(np.abs(rows.d[0]) > 1e-4)
    assert np.all(rows.output_rate[0] > 1e-4)


def near_type_two(distance):
    """Return a 3-RRR whose locked cranks hardly hold it: a leg misses the others' line."""
    _, axes = axes_through_common_line(np.random.default_rng(9))
    axes[2] = unit(axes[2] + distance * np.cross(axes[1], axes[2]))
    return three_legs(axes)


@pytest.mark.parametrize("distance", [1e-3, 3e-5, 1e-5, 1e-7, 1e-9, 1e-12, 1e-14, 0.0])
def test_on_a_singularity_and_near_it_nothing_is_silently_lost(distance):
    found, _ = at_reference(near_type_two(distance))
    for array in (found.u, found.c, found.d, found.input_rate, found.output_rate):
        assert np.all(np.isfinite(array))
    assert 1e-3 * distance - 1e-15 < found.type_two[0] < 2.0 * distance + 1e-15
    singular = distance < 1e-6
    assert found.type[0] == (RowType.II if singular else RowType.REGULAR)
    # Rounding takes 1.2e-12 / distance^2 of the derivatives at most: from 1.1e-5 on that
    # is more than the part that may be lost, and rates are not given.
    assert np.all(np.isfinite(found.w)) == (distance > 1.1e-5)


@pytest.mark.parametrize("distance", [0.0, 1e-9, 1e-7, 1e-5, 1e-3])
def test_coefficients_and_axes_of_a_row_belong_together_at_singularities(distance):
    """c w = d q' holds for the rates in the motion in which an input moves alone.

    The rate w is that about the axis u of the same row, whatever its sense is. At
    singularities some axes are not those of the plan of poles.
    """
    found, _ = at_reference(near_type_two(distance))
    rate_about_axis = found.output_rate * np.vecdot(found.alone, found.u)
    assert np.allclose(np.abs(np.vecdot(found.alone, found.u)), 1.0, atol=1e-7)
    misfit = np.abs(found.c * rate_about_axis) - np.abs(found.d * found.input_rate)
    assert np.max(np.abs(misfit)) < 1e-9


def test_failed_rows_are_unknown_and_a_rigid_output_is_type_one():
    tracer = PositionAnalysis(with_full_turns(sk.load("five_bar")), samples=7)
    motion = tracer.motion()
    found = coefficients(motion, output_of(motion.mechanism))
    assert np.any(motion.failed) and not np.all(motion.failed)
    assert np.array_equal(found.type == RowType.UNKNOWN, motion.failed)
    assert np.all(np.isnan(found.type_two[motion.failed]))
    differential = PositionAnalysis(sk.load("bevel_differential"), samples=3)
    found = coefficients(
        differential.motion(), output_of(differential.mechanism), by_rank=True
    )
    assert np.all(found.type == RowType.I) and np.all(found.group == 2)


BASE_DEG = 80.0
FIRST_LEG_DEG = (70.0, 45.0)
SECOND_LEG_DEG = (60.0, 55.0)
"""Base arc of a five-bar, and crank and coupler arcs of both its legs."""


def five_bar():
    """Return the five-bar with the sizes above; its inputs run from 0.5 to 2.5 rad."""
    crank_1, coupler_1 = FIRST_LEG_DEG
    crank_2, coupler_2 = SECOND_LEG_DEG
    arcs = {"1": BASE_DEG, "2": crank_1, "3": coupler_1, "4": coupler_2, "5": crank_2}
    mechanism = sk.load("five_bar").with_sizes(angle_unit="deg", arcs=arcs)
    ranges = {"21": (0.5, 2.5), "51": (0.5, 2.5)}
    return mechanism.with_inputs(ranges=ranges, angle_unit="rad")


def with_full_turns(made):
    """Return a mechanism whose inputs run through a turn."""
    turn = {item.pair: (-np.pi, np.pi) for item in made.inputs}
    return made.with_inputs(ranges=turn, angle_unit="rad")


def four_bars_of_singular_curves(kind):
    """Return the arcs (rad) of the four-bars whose motions are the singular curves.

    In a singular configuration two links of the five-bar are in line, and may stay so. Then
    they act as one bar, and the motion of the remaining four-bar is a singular curve. Type
    I: a stretched or folded leg is one bar to the output point; stretched legs come first
    in the list. Type II: both couplers in line are one bar between the ends of the cranks.
    """
    base = np.radians(BASE_DEG)
    crank_1, coupler_1 = np.radians(FIRST_LEG_DEG)
    crank_2, coupler_2 = np.radians(SECOND_LEG_DEG)
    four_bars = []
    for sign in (1, -1):
        if kind == "II":
            four_bars.append((base, crank_1, abs(coupler_1 + sign * coupler_2), crank_2))
        else:
            leg_1 = abs(crank_1 + sign * coupler_1)
            leg_2 = abs(crank_2 + sign * coupler_2)
            four_bars.append((base, leg_1, coupler_2, crank_2))
            four_bars.append((base, leg_2, coupler_1, crank_1))
    return four_bars


@pytest.mark.slow
def test_type_one_curves_of_a_five_bar_are_the_borders_of_reach():
    """Along each type I curve of a five-bar, one leg stays stretched or folded.

    At type I inputs can move while the output rests. The output is the axis 43, which joins
    both legs. Let a be the crank and b the coupler of a leg. While the leg is in line, it
    acts as one bar of the arc a + b (stretched) or |a - b| (folded). The output then moves
    on a circle of this radius about the fixed axis of the leg. The mechanism then moves
    like a four-bar. The configurations of each motion of this four-bar form a curve of type
    I (`four_bars_of_singular_curves`).

    - Folded: each motion of a four-bar with a folded leg is a closed curve.
    - Stretched: there is one motion with the first leg stretched, and one with the second.
      Both motions meet in the two configurations with both legs stretched. There the search
      stops. So it finds each motion in two parts, four open curves in all.
    """
    mechanism = five_bar()
    # The search starts from singular points at which one input is locked at one of two
    # values (`slices_of_each`).
    result = singular_curves(
        with_full_turns(mechanism), "I", pointing="43", slices_of_each=2
    )
    four_bars = four_bars_of_singular_curves("I")  # first those with a stretched leg
    stretched_legs, folded_legs = four_bars[:2], four_bars[2:]
    closed_count = sum(count_configuration_curves(bars) for bars in folded_legs)
    assert sum(curve.closed for curve in result.curves) == closed_count
    assert [count_configuration_curves(bars) for bars in stretched_legs] == [1, 1]
    assert sum(not curve.closed for curve in result.curves) == 4
    # Stray points are singular points from which no curve could be followed.
    assert not len(result.stray)

    legs = (np.radians(FIRST_LEG_DEG), np.radians(SECOND_LEG_DEG))
    for curve in result.curves:
        values = curve.points.values
        assert np.max(curve.points.residual) < 1e-12
        axes = axes_at_configuration(mechanism, values)
        output = axes[:, 2]
        assert np.allclose(curve.points.pointing, output, atol=1e-13)
        # Pairs 0 and 4 are the fixed axes.
        leg_is_on_circle = []
        for fixed_axis, (crank, coupler) in zip((0, 4), legs, strict=True):
            radius = crank - coupler if curve.closed else crank + coupler
            cosine = np.sum(axes[:, fixed_axis] * output, axis=1)
            leg_is_on_circle.append(np.max(np.abs(cosine - np.cos(radius))) < 1e-13)
        # One leg is stretched or folded all along the curve, the other one is not.
        assert sum(leg_is_on_circle) == 1
        assert np.max(curve.points.output_rate) < 1e-12
        assert np.min(curve.points.input_rate) > 1e-12
        if not curve.closed:
            singular_ends = (Status.AT_SINGULARITY, Status.AT_SINGULARITY)
            _report, followed_curve = curve.traced
            assert followed_curve.ends == singular_ends
            # Both legs are stretched at the ends: the angles at both elbows (variables 1
            # and 3) are 0 or pi. The curve is not followed into the crossing itself but
            # ends within 1e-4 rad of it.
            values_at_ends = values[[0, -1]]
            elbow_angles = values_at_ends[:, [1, 3]]
            assert np.max(np.abs(np.sin(elbow_angles))) < 1e-4


@pytest.mark.slow
def test_type_two_curves_of_a_five_bar_have_coplanar_distal_axes():
    """Along each type II curve of a five-bar, both couplers stay in line.

    The output is the direction of the axis 43, which joins the couplers. The other ends of
    the couplers, at the cranks, are the elbows. A configuration is of type I if the inputs
    can move while the output rests. It is of type II if the output can move while the
    inputs are locked, and of type III if both hold. A type II curve is a curve of type II
    configurations in the space of the joint angles.

    Couplers in line act as one bar between the elbows, with the sum or the difference of
    their arcs. The five-bar then moves like a four-bar. The configurations of each motion
    of this four-bar form a curve of type II (`four_bars_of_singular_curves`).
    """
    mechanism = five_bar()
    # The search locks each input in turn at five values, and finds the singular points
    # there. From these points it follows the curves.
    result = singular_curves(
        with_full_turns(mechanism), "II", pointing="43", slices_of_each=5
    )
    four_bars = four_bars_of_singular_curves("II")
    assert len(result.curves) == sum(map(count_configuration_curves, four_bars))
    # Stray points are singular points from which no curve could be followed.
    assert not len(result.stray)

    # `both` has the points of a curve at which types I and II occur together.
    points_of_both_types = np.concatenate([curve.both.values for curve in result.curves])
    assert len(points_of_both_types)
    motion = make_motion(solver_of(mechanism), points_of_both_types)
    rows = coefficients(motion, output_of(mechanism, pointing="43"))
    assert np.all(rows.type == RowType.III)

    coupler_1, coupler_2 = np.radians([FIRST_LEG_DEG[1], SECOND_LEG_DEG[1]])
    cosines_in_line = np.cos([coupler_1 + coupler_2, coupler_1 - coupler_2])
    for curve in result.curves:
        assert curve.closed
        # Axes 1, 2 and 3 are the first elbow, the output and the second elbow. Couplers in
        # line have these axes in one plane.
        axes = axes_at_configuration(mechanism, curve.points.values)
        distal_axes = axes[:, 1:4]
        assert np.max(np.abs(np.linalg.det(distal_axes))) < 1e-12
        # With the inputs locked, the output moves at each point of the curve.
        assert np.min(curve.points.output_rate) > 0.1

        # Chords between successive points are hardly longer than the longest step of the
        # search, `MAX_CURVE_STEP_RAD`. The arc length is at least that of the chord.
        chords = np.linalg.norm(np.diff(curve.points.values, axis=0), axis=1)
        assert np.max(chords) < 0.31
        assert np.all(np.diff(curve.s) >= chords - 1e-12)

        # The first point says whether the couplers are stretched or folded on this curve.
        # The arc between the elbows, here from the inputs alone, must be that everywhere.
        first_cosine = axes[0, 1] @ axes[0, 3]
        nearest = np.argmin(np.abs(cosines_in_line - first_cosine))
        cosines = cosine_between_elbows(*curve.points.inputs.T)
        assert np.max(np.abs(cosines - cosines_in_line[nearest])) < 1e-13


def cosine_between_elbows(first_input, second_input):
    """Return the cosine of the arc between the elbows of a five-bar at two inputs in rad.

    The elbows are the free ends of both cranks. It is an independent formula. The first
    fixed axis is z; the second is in the y-z plane, on the side of y. At the input 0 each
    crank points along the base arc, towards the other fixed axis. From there it turns in
    the positive sense about its own axis: the first elbow towards -x, the second towards x.
    """
    base, crank_1, crank_2 = np.radians([BASE_DEG, FIRST_LEG_DEG[0], SECOND_LEG_DEG[0]])
    first_elbow = (
        -np.sin(crank_1) * np.sin(first_input),
        np.sin(crank_1) * np.cos(first_input),
        np.cos(crank_1),
    )
    # Components of the second elbow: on its axis (0, sin(base), cos(base)), and along the
    # base arc, which has the direction (0, -cos(base), sin(base)) there.
    on_axis = np.cos(crank_2)
    along_base = np.sin(crank_2) * np.cos(second_input)
    second_elbow = (
        np.sin(crank_2) * np.sin(second_input),
        on_axis * np.sin(base) - along_base * np.cos(base),
        on_axis * np.cos(base) + along_base * np.sin(base),
    )
    return sum(a * b for a, b in zip(first_elbow, second_elbow, strict=True))


@pytest.mark.slow
def test_the_inputs_rest_at_a_cusp_of_a_singular_curve(monkeypatch):
    """At a cusp of a singular curve in the plane of inputs, the inputs rest.

    The mechanism is a 3-RRR platform with one input locked. At a type II singularity the
    links can move while both inputs are locked. At a cusp the tangent of the singular curve
    has no component along the inputs either, so it has the direction of this motion.
    """
    mechanism = sk.load("three_rrr")
    third_input = mechanism.inputs[2]
    locked = sk.lock(mechanism, {third_input.pair: third_input.start}, angle_unit="rad")
    position_analysis = PositionAnalysis(locked, samples=3)
    motion = position_analysis.motion()
    driven = position_analysis.solver.driven
    values = motion.values[~motion.failed][0]
    closure = position_analysis.solver.closure
    # The configurations of type II: the links can move while the inputs are locked.
    locus = SingularityLocus(closure, degrees_of_freedom=2, constraint=InputsLocked(driven))
    # To save time, the curve is cut after 20 rad of arc length instead of 200.
    monkeypatch.setattr(curve_tracing, "MAX_SINGULAR_CURVE_LENGTH_RAD", 20.0)
    # The nearest singular configuration, and the curve through it.
    start = locus.project(values[None])
    (curve,) = trace_curves(locus, start)
    assert curve is not None
    cusps = curve.cusps()
    assert len(cusps) >= 2
    # (cusps, variables): the last axis has one tangent, as the locus is a curve.
    tangents = cusps.tangents[:, :, 0]
    assert np.max(np.abs(tangents[:, list(driven)])) < 1e-7
    # `motions` are the unit vectors of the motions with locked inputs.
    cosines = np.abs(np.sum(tangents * cusps.motions, axis=1))
    assert np.all(cosines > 1.0 - 1e-12)


def test_aspects_of_a_five_bar_are_regions_of_a_flood_fill():
    """The aspects of a five-bar are counted as by an image library.

    Aspects are the parts of the space of configurations that type II divides. At each pair
    of input angles the five-bar closes if the elbows are within reach of the couplers. It
    then has two configurations, with opposite signs of the determinant that vanishes at
    type II. So a connected region of the square of both inputs has two aspects. The library
    counts the regions on 241 x 241 points. The analysis uses every tenth point, so aspects
    of one or two points are not compared.
    """
    result = aspects(with_full_turns(five_bar()), 25)
    angles = np.linspace(-np.pi, np.pi, 241)
    first_input, second_input = np.meshgrid(angles, angles, indexing="ij")
    cosine = cosine_between_elbows(first_input, second_input)
    coupler_1, coupler_2 = FIRST_LEG_DEG[1], SECOND_LEG_DEG[1]
    stretched_cosine = np.cos(np.radians(coupler_1 + coupler_2))
    folded_cosine = np.cos(np.radians(coupler_1 - coupler_2))
    closes = (cosine > stretched_cosine) & (cosine < folded_cosine)
    # The library does not join regions across opposite borders of the square, which are the
    # same angles. This five-bar has one region, which is connected without that.
    _, region_count = ndimage.label(closes)

    is_large = result.sizes > 2
    assert np.sum(is_large) == 2 * region_count
    assert set(result.sign_two[is_large]) == {1, -1}
    # No aspect has two configurations at the same inputs.
    assert np.all(result.modes == 1)
    assert len(result.values) == 2 * np.sum(closes[::10, ::10])


def test_aspects_free_of_both_types_split_by_signs():
    found = aspects(wide_five_bar(), 11, ("I", "II"), pointing="43")
    assert found.free_of == ("II", "I")
    pairs = set(zip(found.sign_two.tolist(), found.sign_one.tolist(), strict=True))
    assert pairs == set(product((1, -1), repeat=2))
    assert len(found.sizes) == 8  # each leg bent to either side, for each sign of the dyad


def test_wheels_have_one_configuration_at_each_sample_of_aspects():
    """Inputs that differ by a turn are different positions of wheels, also for aspects.

    The samples are three quarters of a turn apart. Without another assembly mode there is
    one configuration at each of them.
    """
    cones = sk.load("rolling_cones").with_inputs(
        ranges={"arm_pivot": (0.0, 540.0)}, angle_unit="deg"
    )
    found = aspects(cones, 3)
    assert found.sizes.tolist() == [3]
    assert np.allclose(found.inputs, found.input_grid.q, rtol=0.0, atol=1e-12)


def test_aspects_say_how_many_paths_the_largest_number_leaves_out(monkeypatch):
    monkeypatch.setattr(aspects_module, "MAX_ASPECT_CONFIGURATIONS", 10)
    found = aspects(sk.load("five_bar"), 3)
    # Two assembly modes at each of nine samples.
    assert len(found.values) == 18
    assert "before paths from 18 of them" in found.note
    assert found.guarantee.endswith(found.note)


def test_aspects_free_of_type_two_need_no_output_with_as_many_freedoms():
    """A direction has two degrees of freedom, so it can always rest with three inputs."""
    found = aspects(sk.load("three_rrr"), 1, pointing="c1")
    assert len(found.sizes)
    assert set(found.sign_two) == {-1, 1}
    assert not np.any(found.sign_one)


@pytest.mark.slow
def test_a_singular_curve_ends_where_the_contact_leaves_an_open_profile():
    """The status of both ends is OFF_PROFILE.

    The roller of a rod (link 3) follows an open cam (link 2). A crank (link 4) carries the
    rod. Cam and crank are the inputs. On a curve of type II, the contact moves along the
    cam from one end of its profile to the other.
    """
    degree = np.pi / 180.0
    cam_profile, _ = open_cam().pairs[2].profiles
    roller = Profile("circle", direction_at_colatitude(25.0 * degree), 12.0 * degree)
    sizes = {
        "1": LinkSizes(("12", "14"), (60.0 * degree,)),
        "2": LinkSizes(("12",)),
        "3": LinkSizes(("43",)),
        "4": LinkSizes(("14", "43"), (30.0 * degree,)),
    }
    pairs = (
        Pair("12", "R", ("1", "2")),
        Pair("14", "R", ("1", "4")),
        Pair("43", "R", ("4", "3")),
        Pair("23", "Cs", ("2", "3"), (cam_profile, roller), "external"),
    )
    mechanism = sk.Mechanism(
        "driven_rod",
        "1",
        ("1", "2", "3", "4"),
        pairs,
        SizeGeometry(sizes),
        inputs=(Input("12", -np.pi, np.pi), Input("14", -np.pi, np.pi)),
    )
    solver = solver_of(mechanism)
    locus = SingularityLocus(solver.closure, 2, InputsLocked(solver.driven))
    random_values = closed_configurations(solver, 256, np.random.default_rng(1))
    starts = points_from(locus, random_values, solver.driven)
    (curve,) = trace_curves(locus, starts.rows(slice(1)))
    assert curve.ends == (Status.OFF_PROFILE, Status.OFF_PROFILE)
    ends = np.sort(curve.nodes.values[[0, -1], 3])
    cam_length = solver.closure.joints[3].first.length
    assert np.allclose(ends, [0.0, cam_length], rtol=0.0, atol=2e-6)


@pytest.mark.slow
def test_the_surface_of_type_two_of_a_three_rrr_is_a_sound_mesh(monkeypatch):
    """The mesh of the type II surface of a platform has right points and sound triangles.

    At type II the planes of the distal axes of all legs have a common line. The distal axes
    of a leg are its second and third pair axes, counted from the base. Each edge of the
    mesh belongs to two triangles, or to one at the border. A vertex is a configuration, and
    lengths are distances in the space of all pair angles. Edges are about 0.3 rad long, as
    asked for, and none is longer than 2.5 times that. The mesh stops at 80 vertices and
    says so.
    """
    mechanism = sk.load("three_rrr")
    monkeypatch.setattr(surface_front, "MAX_FRONT_VERTICES", 80)
    # Starting points are found on curves along which one input moves, the others locked at
    # one value each.
    mesh = singular_surface(with_full_turns(mechanism), "II", slices_of_each=1, side=0.3)
    assert str(mesh.claim).endswith("searched; stopped at 80 vertices")
    assert np.max(mesh.points.residual) < 1e-12

    axes = axes_at_configuration(mechanism, mesh.points.values)
    # (vertices, 3) normals of the planes of the distal axes of each leg.
    first_pairs = (0, 3, 6)
    normals = [np.cross(axes[:, k + 1], axes[:, k + 2]) for k in first_pairs]
    normals = np.stack(normals, axis=1)
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    assert np.max(np.abs(np.linalg.det(normals))) < 1e-12

    sides = [mesh.triangles[:, [a, b]] for a, b in ((0, 1), (1, 2), (2, 0))]
    sides = np.sort(np.concatenate(sides), axis=1)
    edges, triangle_counts = np.unique(sides, axis=0, return_counts=True)
    assert np.max(triangle_counts) == 2
    assert np.array_equal(edges[triangle_counts == 1], mesh.border)

    values = mesh.points.values
    differences = values[edges[:, 0]] - values[edges[:, 1]]
    differences -= 2.0 * np.pi * np.round(differences / (2.0 * np.pi))
    lengths = np.linalg.norm(differences, axis=1)
    assert np.max(lengths) < 0.75
    assert np.median(lengths) == pytest.approx(0.3, abs=0.06)


def test_a_negative_number_of_slices_is_refused():
    """No completeness is claimed for a search on fewer than no slices."""
    for function, name in ((singular_curves, "five_bar"), (singular_surface, "three_rrr")):
        with pytest.raises(sk.SpherekitError, match="has to be 0 or more"):
            function(sk.load(name), "II", slices_of_each=-1)


def test_a_surface_is_not_searched_with_edges_of_no_length():
    """No mesh can be made with such values, so an empty mesh would say nothing."""
    mechanism = sk.load("three_rrr")
    for side in (0.0, -0.15, np.nan, np.inf):
        with pytest.raises(sk.SpherekitError, match="side: found"):
            singular_surface(mechanism, "II", side=side)
    for halved in (-1, 1.5):
        with pytest.raises(sk.SpherekitError, match="halved"):
            singular_surface(mechanism, "II", halved=halved)


def test_surfaces_of_an_unknown_kind_are_refused():
    with pytest.raises(sk.SpherekitError, match='kind: found "IV"'):
        singular_surface(sk.load("three_rrr"), "IV")


def test_slices_at_no_value_are_refused():
    mechanism = sk.load("five_bar")
    for count in (0, -1, 2.5, np.nan):
        with pytest.raises(sk.SpherekitError, match="values_of_each: found"):
            cut(solver_of(mechanism), ranges_of(mechanism), count)


def test_a_pointing_vector_may_have_any_length():
    """The squares of these components are not numbers of float64."""
    for length in (5e-324, 1e-200, 1e200, 1e308):
        direction = output_of(sk.load("five_bar"), pointing=[length] * 3).pointing
        np.testing.assert_allclose(direction, [3.0**-0.5] * 3, rtol=1e-15)


def test_a_pointing_that_is_no_vector_of_numbers_is_refused():
    for pointing in (["a", "b", "c"], [1.0, 2.0, [3.0]], [1j, 0.0, 0.0]):
        with pytest.raises(sk.SpherekitError, match="pointing: found"):
            output_of(sk.load("five_bar"), pointing=pointing)


@pytest.mark.slow
def test_no_triangle_of_a_surface_spans_the_values_that_a_range_leaves_out(monkeypatch):
    """No triangle of a singularity surface bridges a narrow gap in the range of an input.

    The mesh of triangles is made for inputs that make full turns. Then the range of one
    input is narrowed: it leaves out 0.1 rad in the middle of the mesh. An edge of a
    triangle is about 0.3 rad long, so it could bridge this gap. `reported` cuts the mesh
    to the narrowed range. The vertices of a bridging triangle would be near both ends of
    the range, which are almost a turn apart.
    """
    mechanism = with_full_turns(sk.load("three_rrr"))
    monkeypatch.setattr(surface_front, "MAX_FRONT_VERTICES", 60)
    mesh = singular_surface(mechanism, "II", slices_of_each=0, side=0.3)
    middle = np.median(mesh.points.inputs[:, 0])
    narrow_range = {"a1": (middle + 0.05 - 2.0 * np.pi, middle - 0.05)}
    narrow = mechanism.with_inputs(ranges=narrow_range, angle_unit="rad")
    report = SingularityReport.for_output(solver_of(narrow), output_of(narrow), "II")
    reported = replace(mesh, view=report).reported()
    assert len(reported.triangles) > 10
    assert np.all(reported.points.inside)
    inputs = reported.points.inputs[:, 0][reported.triangles]
    assert np.max(np.ptp(inputs, axis=1)) < np.pi


@pytest.mark.slow
def test_surfaces_without_a_mesh_are_not_claimed_to_be_absent():
    """Triangles with edges of 2 rad do not fit on these surfaces, which exist.

    The slices lead to singular configurations. The claim has their number, and is not that
    the result is complete.
    """
    mechanism = with_full_turns(sk.load("three_rrr"))
    mesh = singular_surface(mechanism, "II", slices_of_each=1, side=2.0)
    assert len(mesh.triangles) == 0
    assert mesh.claim.guarantee is Guarantee.SAMPLED
    assert "no triangle with edges of 115 deg could be made" in str(mesh.claim)


def test_a_seed_without_a_triangle_does_not_count_as_covered(monkeypatch):
    """A mesh can start at a seed at which an earlier one made no triangle.

    A `SurfaceFront` covers a surface of singular configurations with triangles. A seed is a
    configuration at which a mesh starts. A seed near a vertex counts as covered, and no
    other mesh starts there. If the first triangle fails, the seed must therefore not remain
    as a vertex.
    """
    monkeypatch.setattr(surface_front, "MAX_FRONT_VERTICES", 10)
    search = LocusPointSearch(
        with_full_turns(sk.load("three_rrr")),
        input_count=3,
        kind="II",
        output=None,
        pointing=None,
        section=None,
        slices_of_each=0,
        time_limit=None,
    )
    points = next(search.batches())
    seed = points.rows(slice(1))
    front = surface_front.SurfaceFront(search, 0.3)
    with monkeypatch.context() as patch:
        # None for each of the other two corners of the first triangle: Newton's method
        # fails at both.
        patch.setattr(front, "_compute_vertices", lambda *_: [None, None])
        assert not front.mesh_surface(seed)
    assert len(front.vertices) == 0
    assert front.mesh_surface(seed)
    assert len(front.triangles) > 1


def test_singularities_of_a_link_relative_to_itself_are_refused():
    mechanism = sk.load("five_bar")
    (output,) = mechanism.outputs
    resting = replace(output, relative_to=output.link)
    mechanism = replace(mechanism, outputs=(resting,))
    with pytest.raises(sk.SpherekitError, match="relative to itself, which never moves"):
        singular_curves(mechanism, "II", slices_of_each=0)
