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
@pytest.mark.parametrize(("text", "seed"), [(STEPHENSON, 3), (EIGHT_BARS[0], 1)])
def test_no_zero_of_any_pole_is_missed_or_invented(text, seed):
    """A relative rate reverses between two of many samples, and in finer ones vanishes."""
    axes = random_axes(np.random.default_rng(seed), len(parse_chain(text)))
    tracer = PositionAnalysis(
        mechanism_from_chain(text, axes, span=(-np.pi, np.pi)), samples=41
    )
    along = SingleFreedomSingularities(tracer, all_curves(tracer)[:1], []).curve_motions[0]
    every = all_poles(len(tracer.mechanism.links))
    s = np.linspace(0.0, along.curve.length, 1501)
    w = along.links_at(s).w
    for i, j in every:
        rate = w[:, j] - w[:, i]
        zeros = along.rest_points((i, j)).s
        (cells,) = np.nonzero(np.sum(rate[1:] * rate[:-1], axis=1) <= 0.0)
        resting = 0
        for k in cells:
            fine = along.links_at(np.linspace(s[k], s[k + 1], 201)).w
            size = np.linalg.norm(fine[:, j] - fine[:, i], axis=1)
            if np.min(size) > 0.02 * max(size[0], size[-1]):
                continue
            resting += 1
            assert np.any((zeros > s[k] - 1e-9) & (zeros < s[k + 1] + 1e-9))
        assert resting == len(zeros)
        signed, _ = along.signed_rate(s, (i, j))
        assert np.sum(signed[1:] * signed[:-1] < 0.0) == resting
        if len(zeros):
            there = along.links_at(zeros).w
            assert np.max(np.abs(there[:, j] - there[:, i])) < 1e-12


@pytest.mark.parametrize("text", [EIGHT_BARS[1], EIGHT_BARS[10]])
def test_relations_of_random_quadruples_of_links_hold_for_the_velocity_equations(text):
    random = np.random.default_rng(11)
    made = mechanism_from_chain(
        text, random_axes(random, len(parse_chain(text))), span=(-0.3, 0.3)
    )
    motion = PositionAnalysis(made, samples=7).motion()
    motion = motion.rows(motion.status == Status.OK)
    rates = evaluate(motion, request(made, made.inputs[0].pair, ()))
    planned = PlannedPoles(plan(made), motion)

    def direction(pole):
        return planned.directions[pole].T

    every = list(permutations(range(8), 4))
    quadruples = [every[k] for k in random.choice(len(every), 50, replace=False)]
    quadruples += [(2, 0, 5, 0), (2, 0, 2, 5), (2, 0, 0, 5), (2, 0, 5, 2), (2, 0, 0, 2)]
    for numbers in quadruples:
        links = FourLinks(*numbers)
        poles = [pole_of(a, b) for a in numbers for b in numbers if a != b]
        error = np.max([planned.errors[pole] for pole in poles], axis=0)
        for form in ("i", "ii"):
            if form == "ii" and links.o in (links.r, links.i):
                continue
            relation = make_relation(form, links, direction)
            output, driven = (
                np.sum((rates.w[a] - rates.w[b]) * direction(pole_of(a, b)), axis=1)
                for a, b in (relation.output, (links.i, links.r))
            )
            gap = relation.residual(output, driven)
            assert np.all(gap <= 1e-12 + 10.0 * error), (numbers, relation.form)
