"""Singularities of one input: closed forms, 50 digits, and the velocity equations."""

from itertools import permutations, product

import numpy as np
import pytest
from mechanism_examples.linkages import (
    EIGHT_BARS,
    STEPHENSON,
    WATT,
    mechanism_from_chain,
    parse_chain,
    random_axes,
)
from mechanism_examples.named_mechanisms import four_bar

from spherekit.planning.pole_plan import all_poles, pole_of
from spherekit.planning.pole_planner import plan
from spherekit.positions.curve_continuation import follow_arc
from spherekit.positions.curve_crossing import find_crossing, find_outgoing_points
from spherekit.positions.curve_segment import curve_points
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.singularities.curve_velocities import OTHER_PROJECTIONS, PROJECTION
from spherekit.singularities.geometric_conditions import compare_with_rates
from spherekit.singularities.input_output_relation import FourLinks, Type, make_relation
from spherekit.singularities.single_freedom import (
    InputOutputRests,
    SingleFreedomSingularities,
    explain_doubts,
)
from spherekit.status import Status
from spherekit.velocities.pole_evaluation import evaluate
from spherekit.velocities.pole_request import request
from spherekit.velocities.pole_sequence import PlannedPoles

TURN = 2.0 * np.pi


def all_curves(position_analysis):
    """Return the configuration curves of a mechanism with one freedom."""
    return [item.curve for item in position_analysis.configurations.curves]


@pytest.mark.slow
def test_a_double_zero_of_an_output_rate_is_one_singularity():
    """A double zero of an output rate is one singularity, without a reversal.

    Link 2 drives link 4 through a four-bar, and link 4 drives link 6 through a second one.
    In the reference pose both transmission ratios, w41 / w21 and w61 / w41, are zero and
    change their sign. So link 4 reverses there. The rate of link 6 is the product of both
    ratios: it has a double zero, and link 6 does not reverse.

    With link 4 as the input and link 6 as the output, both rest there while link 2 moves.
    That is a self-motion, at which the input reverses and the output does not. `report_at`
    returns the singularities in the reference pose for an output and an input. At type I
    the output rests while the input moves.
    """
    axes = random_axes(np.random.default_rng(4), 7)
    # Axes 0 to 3 belong to the first four-bar, axes 3 to 6 to the second one. Crank and
    # coupler of each are in line (three axes in one plane), so that its output rests.
    axes[0] = axes[1] + 0.7 * axes[2]
    axes[3] = axes[4] - 0.4 * axes[5]
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    mechanism = mechanism_from_chain(WATT, axes, span=(-0.3, 0.3))
    position_analysis = PositionAnalysis(mechanism, samples=31)
    # The configuration curve through the reference pose, where all variables are zero.
    curve = follow_arc(position_analysis.solver.closure, np.zeros(7))

    # A double zero is located to 1e-7 only, the square root of rounding.
    (simple_zero,) = report_at(position_analysis, curve, "4/1", "2/1")
    (double_zero,) = report_at(position_analysis, curve, "6/1", "2/1")
    for point, is_double, accuracy in (
        (simple_zero, False, 1e-13),
        (double_zero, True, 1e-7),
    ):
        assert point.type == Type.I
        assert point.double == is_double
        assert point.output_turns == (not is_double)  # whether it reverses its sense
        assert point.certain
        assert np.max(np.abs(point.values)) < accuracy

    (both_rest,) = report_at(position_analysis, curve, "6/1", "4/1")
    assert both_rest.type == Type.SELF_MOTION
    assert both_rest.input_turns
    assert not both_rest.output_turns

    # An output that is the input, or its reverse, rests with it without doubt, although the
    # double zero is inaccurate.
    for output in ("6/1", "1/6"):
        (input_rests,) = report_at(position_analysis, curve, output, "6/1")
        assert input_rests.type == Type.SELF_MOTION
        assert input_rests.error > 1e-7
        assert input_rests.certain


@pytest.mark.parametrize("start", [0.0, 1.5])
def test_doubts_do_not_depend_on_where_a_closed_curve_begins(start):
    """Two points that may be one get a note wherever the arc length of a curve begins.

    At a singularity the rate of the input or of the output is zero: it rests. If the input
    and the output rest at points near each other, these may be one point at which both
    rest. The types of both points are then in doubt, and `explain_doubts` returns a note
    for each.

    The closed curve has the length 3 rad. Near the arc length 1.5 rad, the input and the
    output rest 1e-11 rad apart, with errors of 1e-12 rad. The input also rests at 0.5 rad,
    without a doubt. If the curve starts at 1.5 rad, the near points are its first and its
    last one. On an open curve these are no neighbours and get no note.
    """
    lap = 3.0
    # Arc lengths measured from the start of the curve.
    s = (np.array([0.5, 1.5 - 0.5e-11, 1.5 + 0.5e-11]) - start) % lap
    is_input = np.array([True, True, False])
    order = np.argsort(s)
    rests = InputOutputRests(
        s=s[order],
        errors=np.full(3, 1e-12),
        distances=np.zeros(3),
        input_rests=is_input[order],
        output_rests=~is_input[order],
        input_is_double=np.zeros(3, dtype=bool),
        output_is_double=np.zeros(3, dtype=bool),
    )
    types = [Type.II if input_rests else Type.I for input_rests in rests.input_rests]
    # The output is another one than the input (`is_input`).
    notes = explain_doubts(rests, types, is_input=False, lap=lap)
    # Back in the order in which the points are written above.
    assert [bool(notes[k]) for k in np.argsort(order)] == [False, True, True]
    notes_of_open_curve = explain_doubts(rests, types, is_input=False, lap=np.inf)
    assert sum(map(bool, notes_of_open_curve)) == (2 if start == 0.0 else 0)


def report_at(position_analysis, curve, output, given):
    """Return the singular points of an output by an input pole in the reference pose."""
    report = SingleFreedomSingularities(position_analysis, [curve], [output], given)
    distances = [np.max(np.abs(curve.wrapped(point.values))) for point in report.points]
    return [
        point
        for point, distance in zip(report.points, distances, strict=True)
        if distance < 1e-6
    ]


FOLDING = [(60, 40, 60, 40), (60, 50, 70, 40), (60, 60, 40, 40), (50, 50, 50, 50)]


@pytest.mark.many
@pytest.mark.parametrize("degrees", FOLDING)
def test_curves_of_folding_four_bars_cross_in_type_three_with_two_tangents(degrees):
    """Where a four-bar lies flat, two configuration curves cross in a type III singularity.

    All angles are 0 or pi there. Four points lead out of the crossing, two along each
    tangent.

    The rates of the output 4/1 and of the input satisfy a relation c w_out = d w_in. It is
    stated in two forms, which compute c and d from different pole axes:

    - Form i takes the pole axes between ground, input link and output link. If neither c
      nor d is zero, the relation is regular (its type is None). Then it must hold for the
      rates along the tangent.
    - Form ii also takes the axes of a fourth link. Here c and d are both zero, which is
      type III. The reason is that all axes are in one plane (the condition III.a).
    """
    position_analysis = PositionAnalysis(four_bar(np.radians(degrees)))
    curves = all_curves(position_analysis)
    report = SingleFreedomSingularities(position_analysis, curves, ["4/1"])
    assert report.crossings
    closure = position_analysis.solver.closure
    input_variable = 0
    output_variable = 3
    for point in report.crossings:
        crossing = point.crossing
        assert point.certain, point.note
        assert crossing.freedoms == 2  # four variables less the rank 2 of the equations
        assert len(crossing.tangents) == 2
        assert crossing.miss < 1e-15  # how far the configuration is from a crossing
        assert np.max(np.abs(np.sin(crossing.values))) < 1e-14

        outgoing = find_outgoing_points(closure, crossing.values)
        assert len(outgoing) == 4
        directions = outgoing - crossing.values
        points, _ = curve_points(closure, outgoing, directions)
        assert np.max(points.residual) < 1e-13
        # The second derivatives of the variables along the curve (`bends`) stay finite.
        assert np.all(np.abs(points.bends) < 10.0)

        # Forms i and ii of the first tangent, then of the second one.
        relations_i = point.relations[::2]
        relations_ii = point.relations[1::2]
        for tangent, relation_i, relation_ii in zip(
            crossing.tangents, relations_i, relations_ii, strict=True
        ):
            assert relation_ii.type == Type.III
            assert relation_ii.agrees  # geometric conditions and rates give one type
            assert any(x.label == "III.a" and x.certain for x in relation_ii.conditions)
            is_regular = relation_i.type is None
            if is_regular:
                # The tangent has the rates of all variables.
                output_term = relation_i.c * tangent[output_variable]
                input_term = relation_i.d * tangent[input_variable]
                assert abs(output_term - input_term) < 1e-12
                assert relation_i.residual < 1e-12
        is_parallelogram = degrees == (60, 40, 60, 40)
        if is_parallelogram:
            # Some of the other four-bars have curves along which the input or the output
            # rests all the time. The parallelogram has none.
            assert report.resting_curves == []


def test_curves_of_two_four_bars_that_fold_at_once_cross_with_four_tangents():
    """Where both loops of a Watt chain lie flat, curves cross with four tangents.

    The chain consists of two four-bars in a row: pairs 0 to 3, and pairs 3 to 6. The
    equations of a loop have the rank 3, and only 2 where the loop is flat. So 7 variables
    less the rank 4 of both loops leave 3 freedoms. From the flat configuration each loop
    can move on along two curves. The slopes of each four-bar alone (output angle per
    input angle) give the four combinations that the crossing of the whole chain must have.
    """
    common_axis = np.array([1.0, 0.0, 0.0])

    def axes_in_plane(degrees, across):
        """Return unit vectors at angles (deg) from the common axis in one plane."""
        angles = np.radians(degrees)[:, None]
        return np.cos(angles) * common_axis + np.sin(angles) * np.array(across)

    p12, p23, p34 = axes_in_plane([60.0, 100.0, 40.0], [0.0, 1.0, 0.0])
    p16, p56, p45 = axes_in_plane([50.0, 85.0, 35.0], [0.0, 0.6, 0.8])
    axes = np.array([p12, p23, p34, common_axis, p45, p56, p16])

    def closure_of(chain, chain_axes):
        mechanism = mechanism_from_chain(chain, chain_axes, span=(-1.0, 1.0))
        return PositionAnalysis(mechanism, samples=3).solver.closure

    closure = closure_of(WATT, axes)
    crossing = find_crossing(closure, np.full(7, 1e-6))
    assert crossing.freedoms == 3
    assert np.max(np.abs(crossing.values)) < 1e-15
    # (tangents, 2) slopes of both four-bars along each tangent.
    slopes_of_chain = crossing.tangents[:, [3, 6]] / crossing.tangents[:, [0, 3]]

    slopes_of_four_bars = []
    for four_bar_axes in (axes[:4], axes[3:]):
        four_bar_closure = closure_of("1-2 2-3 3-4 1-4", four_bar_axes)
        tangents = find_crossing(four_bar_closure, np.full(4, 1e-6)).tangents
        slopes_of_four_bars.append(tangents[:, 3] / tangents[:, 0])
    expected = np.array(list(product(*slopes_of_four_bars)))
    # Both lists are brought in one order; rounding errors must not decide on it.
    sorted_slopes = slopes_of_chain[np.lexsort(np.round(slopes_of_chain, 9).T)]
    sorted_expected = expected[np.lexsort(np.round(expected, 9).T)]
    assert np.max(np.abs(sorted_slopes - sorted_expected)) < 1e-12

    outgoing = find_outgoing_points(closure, crossing.values)
    assert len(outgoing) == 8  # in both directions along each tangent
    points, _ = curve_points(closure, outgoing, outgoing - crossing.values)
    assert np.max(points.residual) < 1e-13


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize(("chain", "seed"), [(STEPHENSON, 3), (EIGHT_BARS[0], 1)])
def test_rest_points_of_all_poles_are_where_relative_rates_vanish(chain, seed):
    """Rest points of two links are exactly where their relative rate is zero.

    A rest point of two links is a point of a configuration curve at which they do not
    rotate relative to each other. The relative rate of the links, a vector, is sampled at
    1501 points of the curve. Its zeros are sought in the steps in which its direction turns
    by 90 degrees or more. There it is sampled at 201 finer points. If its size falls below
    2 % of the larger size at the ends of the step, the rate is zero within the step.

    A pole is the axis of the relative rotation of two links. `signed_rate` is the component
    of the relative rate along the pole axis, whose unit vector does not jump. It must
    change its sign as often as the rate is zero. Links are numbered from 0.
    """
    axes = random_axes(np.random.default_rng(seed), len(parse_chain(chain)))
    mechanism = mechanism_from_chain(chain, axes, span=(-np.pi, np.pi))
    position_analysis = PositionAnalysis(mechanism, samples=41)
    curves = all_curves(position_analysis)[:1]  # one curve is enough
    no_outputs = []
    singularities = SingleFreedomSingularities(position_analysis, curves, no_outputs)
    curve_motion = singularities.curve_motions[0]
    s = np.linspace(0.0, curve_motion.curve.length, 1501)
    w = curve_motion.links_at(s).w
    for i, j in all_poles(len(mechanism.links)):
        relative_rate = w[:, j] - w[:, i]
        rest_points = curve_motion.rest_points((i, j)).s
        products = np.sum(relative_rate[1:] * relative_rate[:-1], axis=1)
        zero_count = 0
        for k in np.flatnonzero(products <= 0.0):
            fine_w = curve_motion.links_at(np.linspace(s[k], s[k + 1], 201)).w
            size = np.linalg.norm(fine_w[:, j] - fine_w[:, i], axis=1)
            if np.min(size) > 0.02 * max(size[0], size[-1]):
                continue  # the direction turns fast, but the rate does not vanish
            zero_count += 1
            is_between = (rest_points > s[k] - 1e-9) & (rest_points < s[k + 1] + 1e-9)
            assert np.any(is_between)
        assert zero_count == len(rest_points)
        signed_rate, _ = curve_motion.signed_rate(s, (i, j))
        assert np.sum(signed_rate[1:] * signed_rate[:-1] < 0.0) == zero_count
        if len(rest_points):
            w_at_rest = curve_motion.links_at(rest_points).w
            assert np.max(np.abs(w_at_rest[:, j] - w_at_rest[:, i])) < 1e-12


@pytest.mark.parametrize("normal", OTHER_PROJECTIONS)
def test_no_singularity_is_lost_if_the_output_axis_is_normal_to_the_projection(normal):
    """A four-bar has two singularities of its output on a curve, however it is turned.

    Zeros of the output rate are first located by its component along `PROJECTION`. Here the
    fixed axis of the output is at right angles to `PROJECTION`, so this component is zero
    on the whole curve. The component along one of the two other directions is zero as well.
    """
    # The axes of the pairs 12, 23, 34 and 14 in the frame of the output axis 14. The arcs
    # of the links 1 to 4 are 60, 20, 66 and 40 degrees: a crank-rocker with crank 2.
    crank_angle, coupler_angle, rocker_angle = np.radians([60.0, 80.0, 40.0])
    x = np.cos(rocker_angle)
    y = (np.cos(np.radians(66.0)) - x * np.cos(coupler_angle)) / np.sin(coupler_angle)
    axes = np.array(
        [
            [np.cos(crank_angle), np.sin(crank_angle), 0.0],
            [np.cos(coupler_angle), np.sin(coupler_angle), 0.0],
            [x, y, np.sqrt(1.0 - x**2 - y**2)],
            [1.0, 0.0, 0.0],
        ]
    )
    # The frame is turned as a whole. Its first axis becomes the one at right angles to both
    # directions.
    output_axis = np.cross(PROJECTION, normal)
    axes = axes @ np.array([output_axis, PROJECTION, np.cross(output_axis, PROJECTION)])

    mechanism = mechanism_from_chain("1-2 2-3 3-4 1-4", axes)
    position_analysis = PositionAnalysis(mechanism, samples=7)
    # The configuration curve through the reference pose, where all variables are zero.
    curve = follow_arc(position_analysis.solver.closure, np.zeros(4))
    report = SingleFreedomSingularities(position_analysis, [curve], ["4/1"])
    assert [point.type for point in report.points] == [Type.I, Type.I]
    assert all(point.output_turns and point.certain for point in report.points)


@pytest.mark.parametrize("chain", [EIGHT_BARS[1], EIGHT_BARS[10]])
def test_input_output_relations_hold_for_rates_by_velocity_equations(chain):
    """Relations c w_out = d w_in hold for 55 quadruples of links of an eight-bar.

    A quadruple is four links i, r, o and s. The input rate w_in is that of link i relative
    to r. There are two forms of the relation:

    - Form i: w_out is the rate of o relative to s.
    - Form ii: w_out is the rate of o relative to r. The pole axes of the fourth link s are
      used to compute c and d. Any link s will do, but o may be neither r nor i.

    The coefficients c and d come from pole axes, which a plan computes as intersections of
    great circles. The rates come from the evaluation of all links. The gap may be ten times
    the error bound of an axis, because c and d have three axes each.
    """
    random = np.random.default_rng(11)
    axes = random_axes(random, len(parse_chain(chain)))
    mechanism = mechanism_from_chain(chain, axes, span=(-0.3, 0.3))
    motion = PositionAnalysis(mechanism, samples=7).motion()
    motion = motion.rows(motion.status == Status.OK)
    field = evaluate(motion, request(mechanism, mechanism.inputs[0].pair, ()))
    planned = PlannedPoles(plan(mechanism), motion)

    def direction(pole):
        """Return the planned direction of a pole."""
        return planned.directions[pole].T

    def rate(link, reference_link):
        """Return the angular velocity of a link relative to another, along their pole."""
        relative_velocity = field.w[link] - field.w[reference_link]
        pole = pole_of(link, reference_link)
        return np.sum(relative_velocity * direction(pole), axis=1)

    all_quadruples = list(permutations(range(8), 4))
    chosen = random.choice(len(all_quadruples), 50, replace=False)
    quadruples = [all_quadruples[k] for k in chosen]
    # Quadruples in which a link occurs twice.
    quadruples += [(2, 0, 5, 0), (2, 0, 2, 5), (2, 0, 0, 5), (2, 0, 5, 2), (2, 0, 0, 2)]
    for quadruple in quadruples:
        links = FourLinks(*quadruple)
        poles = [pole_of(a, b) for a in quadruple for b in quadruple if a != b]
        error_bound = np.max([planned.errors[pole] for pole in poles], axis=0)
        for form in ("i", "ii"):
            if form == "ii" and links.o in (links.r, links.i):
                continue
            relation = make_relation(form, links, direction)
            output_rate = rate(*relation.output)  # of o relative to s, or to r in form ii
            input_rate = rate(links.i, links.r)
            gap = relation.residual(output_rate, input_rate)
            assert np.all(gap <= 1e-12 + 10.0 * error_bound), (quadruple, form)


@pytest.mark.slow
def test_form_ii_of_an_output_that_is_relative_to_a_coupler_says_which_rate_it_has():
    """Form ii of output 3/4 has the rate of 3/1, which moves where 3/4 rests.

    The relation c y' = d q' between the rates of output and input has two forms. In form i,
    y' is the rate of the output link relative to its own reference link, here of 3/4. It
    agrees with type I, at which this rate is 0. In form ii, y' is the rate of the output
    link relative to the reference link of the input, here of 3/1. It is not 0, so neither c
    nor d vanishes. The note says so, and does not say that c and d are doubtful.
    """
    position_analysis = PositionAnalysis(four_bar(np.radians([60.0, 20.0, 70.0, 40.0])))
    curves = all_curves(position_analysis)
    report = SingleFreedomSingularities(position_analysis, curves, ["3/4"])
    assert report.points
    for point in report.points:
        form_i, form_ii = point.relations
        assert point.type == Type.I
        assert form_i.agrees
        assert form_ii.residual < 1e-12
        assert min(abs(form_ii.c), abs(form_ii.d)) > 0.1
        assert "y' is the rate of 3/1 in form ii, which is not the output" in form_ii.note


def compare_four_links(velocities, kind, resting_poles):
    """Return the relation c y' = d q' of four links at one singularity, with its note.

    q' is the rate of the input, link 0 relative to link 1. y' is the rate of the output,
    link 2 relative to link 3. This is form "i" of the relation, in which y' is relative to
    the output's own reference link. c and d follow from the pole axes. A pole axis is the
    axis of the relative rotation of two links. `compare_with_rates` compares the relation
    with the rates at the singularity, and explains a difference in the note. Tests check
    the type and the note of the relation.

    Parameters
    ----------
    velocities
        (4, 3) angular velocities of links 0 to 3, which give the pole axes. The axis of two
        links with equal velocities is NaN.
    kind
        Type of the singularity according to the rates.
    resting_poles
        Pairs of links (a, b) that are stated to rest relative to each other.
    """

    def pole_axis(pole):
        relative = np.subtract(velocities[pole[1]], velocities[pole[0]])[None]
        size = np.linalg.norm(relative)
        return relative / size if size > 0.0 else np.full((1, 3), np.nan)

    links = FourLinks(i=0, r=1, o=2, s=3)
    (relation,) = compare_with_rates(
        make_relation("i", links, pole_axis),
        names="abcd",
        output_rate=np.ones(1),
        input_rate=np.zeros(1),
        axis_errors=np.zeros(1),
        output=(2, 3),
        types_by_rates=[kind],
        is_resting={pole: np.array([pole in resting_poles]) for pole in links.poles},
    )
    return relation


def test_an_input_at_rest_is_not_named_as_the_cause_of_two_vanishing_coefficients():
    """If the input rests, only c vanishes. Here c = d = 0, as all axes are in one plane."""
    in_one_plane = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [2.0, 3.0, 0.0], [-1.0, 2.0, 0.0]]
    relation = compare_four_links(in_one_plane, Type.II, resting_poles={(0, 1)})
    assert relation.type == Type.III
    assert "lie in one plane" in relation.note
    assert "stand still" not in relation.note


def test_a_note_does_not_say_that_unknown_coefficients_do_not_vanish():
    """Links a and c move together, so their pole is unknown, and c and d are NaN."""
    velocities = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    relation = compare_four_links(velocities, Type.SELF_MOTION, resting_poles={(0, 2)})
    assert np.isnan(relation.c)
    assert np.isnan(relation.d)
    assert relation.type is None
    assert relation.note.startswith("c and d are unknown")
