"""Singularities of one input: closed forms, 50 digits, and the velocity equations."""

from itertools import permutations

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
from spherekit.singularities.input_output_relation import FourLinks, Type, make_relation
from spherekit.singularities.single_freedom import SingleFreedomSingularities
from spherekit.status import Status
from spherekit.velocities.pole_evaluation import evaluate
from spherekit.velocities.pole_request import request
from spherekit.velocities.pole_sequence import PlannedPoles

TURN = 2.0 * np.pi


def all_curves(tracer):
    return [each.curve for each in tracer.configurations.curves]


def test_a_tangential_zero_of_an_output_is_one_double_point():
    """Two four-bars in a row, both with a dead point of the output in the pose given.

    w61 is a product of two functions that vanish there; w41 is one of them.
    """
    axes = random_axes(np.random.default_rng(4), 7)
    axes[0], axes[3] = axes[1] + 0.7 * axes[2], axes[4] - 0.4 * axes[5]
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    tracer = PositionAnalysis(
        mechanism_from_chain(WATT, axes, span=(-0.3, 0.3)), samples=31
    )
    curve = follow_arc(tracer.solver.closure, np.zeros(7))
    (simple,), (double,) = (
        report_at(tracer, curve, output, "2/1") for output in ("4/1", "6/1")
    )
    for point, touches, near in ((simple, False, 1e-13), (double, True, 1e-7)):
        assert (point.type, point.double, point.output_turns) == (
            Type.I,
            touches,
            not touches,
        )
        assert point.certain and np.max(np.abs(point.values)) < near
    (both,) = report_at(tracer, curve, "6/1", "4/1")
    assert both.type == Type.SELF_MOTION
    assert (both.input_turns, both.output_turns) == (True, False)


def report_at(tracer, curve, output, given):
    """Return the real singular points in the reference pose."""
    points = SingleFreedomSingularities(tracer, [curve], [output], given).points
    return [p for p in points if np.max(np.abs(curve.wrapped(p.values))) < 1e-6]


FOLDING = [(60, 40, 60, 40), (60, 50, 70, 40), (60, 60, 40, 40), (50, 50, 50, 50)]


@pytest.mark.many
@pytest.mark.parametrize("degrees", FOLDING)
def test_folding_four_bars_cross_in_type_3_with_two_branches(degrees):
    tracer = PositionAnalysis(four_bar(np.radians(degrees)))
    report = SingleFreedomSingularities(tracer, all_curves(tracer), ["4/1"])
    assert report.crossings
    q, y = 0, 3
    for point in report.crossings:
        crossing = point.crossing
        assert point.certain, point.note
        assert (crossing.freedoms, len(crossing.tangents)) == (2, 2)
        assert crossing.miss < 1e-15
        assert np.max(np.abs(np.sin(crossing.values))) < 1e-14
        closure = tracer.solver.closure
        starts = find_outgoing_points(closure, crossing.values)
        assert len(starts) == 4
        ahead, _ = curve_points(closure, starts, starts - crossing.values)
        assert np.max(ahead.residual) < 1e-13
        assert np.all(np.abs(ahead.bends) < 10.0)
        assembly_modes = point.relations[::2], point.relations[1::2]
        for tangent, three, four in zip(crossing.tangents, *assembly_modes, strict=True):
            assert four.type == Type.III
            assert four.agrees
            assert any(h.label == "III.a" and h.certain for h in four.conditions)
            if three.type is None:
                gap = three.c * tangent[y] - three.d * tangent[q]
                assert abs(gap) < 1e-12
                assert three.residual < 1e-12
        if degrees == (60, 40, 60, 40):
            assert report.resting_curves == []


def test_two_four_bars_that_fold_at_once_cross_in_four_branches():
    """Both loops of a Watt chain lie flat, and each goes on in two ways."""
    common = np.array([1.0, 0.0, 0.0])

    def flat(degrees, side):
        angles = np.radians(degrees)[:, None]
        return np.cos(angles) * common + np.sin(angles) * np.array(side)

    p12, p23, p34 = flat([60.0, 100.0, 40.0], [0.0, 1.0, 0.0])
    p16, p56, p45 = flat([50.0, 85.0, 35.0], [0.0, 0.6, 0.8])
    both = np.array([p12, p23, p34, common, p45, p56, p16])
    closure = PositionAnalysis(
        mechanism_from_chain(WATT, both, span=(-1.0, 1.0)), samples=3
    ).solver.closure
    crossing = find_crossing(closure, np.full(7, 1e-6))
    assert crossing.freedoms == 3
    assert np.max(np.abs(crossing.values)) < 1e-15
    found = crossing.tangents[:, [3, 6]] / crossing.tangents[:, [0, 3]]
    slopes = []
    for axes in (both[:4], both[3:]):
        one = mechanism_from_chain("1-2 2-3 3-4 1-4", axes, span=(-1.0, 1.0))
        closed = PositionAnalysis(one, samples=3).solver.closure
        alone = find_crossing(closed, np.full(4, 1e-6))
        slopes.append(alone.tangents[:, 3] / alone.tangents[:, 0])
    wanted = np.array([[a, b] for a in slopes[0] for b in slopes[1]])
    order = [np.lexsort(np.round(each, 9).T) for each in (found, wanted)]
    assert np.max(np.abs(found[order[0]] - wanted[order[1]])) < 1e-12
    starts = find_outgoing_points(closure, crossing.values)
    assert len(starts) == 8
    ahead, _ = curve_points(closure, starts, starts - crossing.values)
    assert np.max(ahead.residual) < 1e-13


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize(("chain", "seed"), [(STEPHENSON, 3), (EIGHT_BARS[0], 1)])
def test_rest_points_of_all_poles_are_where_relative_rates_vanish(chain, seed):
    """A pole rests where the relative rate of its links is zero along a curve.

    The relative rate is sampled at 1501 points of the curve. Where it reverses its
    direction, 201 finer points decide whether its size really goes to zero. There must be a
    listed rest point, and no other ones. The signed rate changes its sign as often.
    """
    axes = random_axes(np.random.default_rng(seed), len(parse_chain(chain)))
    mechanism = mechanism_from_chain(chain, axes, span=(-np.pi, np.pi))
    position_analysis = PositionAnalysis(mechanism, samples=41)
    curves = all_curves(position_analysis)[:1]
    singularities = SingleFreedomSingularities(position_analysis, curves, [])
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


@pytest.mark.parametrize("chain", [EIGHT_BARS[1], EIGHT_BARS[10]])
def test_input_output_relations_hold_for_rates_by_velocity_equations(chain):
    """Relations c w_out = d w_in of both forms, for 55 quadruples of links of an eight-bar.

    A quadruple names output o, its reference s, input i and its reference r. The
    coefficients come from planned poles, the rates from the evaluation of all links. Gaps
    are within ten times the error bound of the poles.
    """
    random = np.random.default_rng(11)
    axes = random_axes(random, len(parse_chain(chain)))
    mechanism = mechanism_from_chain(chain, axes, span=(-0.3, 0.3))
    motion = PositionAnalysis(mechanism, samples=7).motion()
    motion = motion.rows(motion.status == Status.OK)
    field = evaluate(motion, request(mechanism, mechanism.inputs[0].pair, ()))
    planned = PlannedPoles(plan(mechanism), motion)

    def direction(pole):
        """Return the planned direction (3, n) of a pole."""
        return planned.directions[pole].T

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
            rates = []
            for a, b in (relation.output, (links.i, links.r)):
                relative_rate = field.w[a] - field.w[b]
                rates.append(np.sum(relative_rate * direction(pole_of(a, b)), axis=1))
            output_rate, input_rate = rates
            gap = relation.residual(output_rate, input_rate)
            assert np.all(gap <= 1e-12 + 10.0 * error_bound), (quadruple, form)
