"""Every singularity of random chains in 50 digits, and against the number of modes."""

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
from oracles.resting_links import exact_rest

from spherekit.completeness import Guarantee
from spherekit.positions.assembly_enumeration import enumerate_assemblies
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.singularities.input_output_relation import Type
from spherekit.singularities.single_freedom import SingleFreedomSingularities

CHAINS = (STEPHENSON, WATT, *EIGHT_BARS)
RESTING = 1e-28
"""Rates that vanish in 50 digits."""
INPUTS = 24
"""Inputs over a turn at which the modes are counted."""


def analysed(number):
    """Return a tracer, its configurations, and the analysis.

    Any pair is the input; the outputs are the last link relative to the ground, and
    links 5 and 3.
    """
    random = np.random.default_rng(200 + number)
    edges = parse_chain(CHAINS[number])
    a, b = edges[random.integers(len(edges))]
    axes = random_axes(random, len(edges))
    made = mechanism_from_chain(CHAINS[number], axes, f"p{a}_{b}", span=(-np.pi, np.pi))
    tracer = PositionAnalysis(made, samples=9)
    found = tracer.configurations
    curves = [item.curve for item in found.curves]
    analysis = SingleFreedomSingularities(
        tracer, curves, [(made.links[-1], "1"), ("5", "3")]
    )
    return tracer, found, analysis


def check_exact(tracer, analysis, points):
    """Solve for every point in 50 digits; compare places, types and rates."""
    made, solved = tracer.mechanism, {}
    for point in points:
        links = point.output if point.type == Type.I else analysis.input
        key = point.curve, point.s, links
        if key not in solved:
            along = analysis.curve_motions[point.curve]
            rates = along.links_at(np.array([point.s]))
            placed = rates.motion.rotations
            slope = rates.dw[0, links[0]] - rates.dw[0, links[1]]
            solved[key] = exact_rest(made, placed[0], rates.w[0], links, slope)
        exact = solved[key]
        assert exact.moved < 1e-12
        assert max(exact.left, exact.resting) < RESTING
        driven, output = (
            np.linalg.norm(exact.rates[a] - exact.rates[b])
            for a, b in (analysis.input, point.output)
        )
        rest = {Type.I: (output,), Type.II: (driven,), Type.SELF_MOTION: (driven, output)}
        assert max(rest[point.type]) < RESTING
        place, number = np.array([point.s]), analysis.outputs.index(point.output)
        at = analysis.evaluate_relations(point.curve, place, number)
        assert abs(driven - abs(at.input_rate[0])) < 1e-12
        assert abs(output - abs(at.output_rate[0])) < 1e-12
        if point.type != Type.SELF_MOTION:
            assert max(driven, output) > 1e-6


def check_counts(tracer, found, analysis, points):
    """Compare the modes at inputs over a turn with the dead centres between them.

    Where the input has a minimum on its curve, two modes appear as it grows; where it
    has a maximum, two vanish.
    """
    single = tracer.solver.input_variable
    dead = [p for p in points if p.output == analysis.outputs[0] and p.input_turns]
    places = np.array([p.values[single] for p in dead])
    slopes = np.array(
        [analysis.curve_motions[p.curve].curve.at(p.s).bends[0, single] for p in dead]
    )
    inputs = np.sort(np.random.default_rng(1).uniform(-np.pi, np.pi, INPUTS))
    modes = [enumerate_assemblies(tracer.solver, np.array([q])) for q in inputs]
    assert all(each.is_complete for each in modes)
    counts = [*(len(each.values) for each in modes), *found.counts.tolist()]
    for q, count in zip([*inputs, *found.inputs], counts, strict=True):
        passed, way = np.mod(
            [places - inputs[0], 0.0 * places + q - inputs[0]], 2.0 * np.pi
        )
        assert count - counts[0] == 2 * np.sum(np.sign(slopes[passed < way]))
    return len(places), len(set(counts))


def marked(number):
    """Some chains are asked by default, some are slow, all others take long."""
    marks = {0: (), 3: (), **dict.fromkeys((1, 4, 7, 10, 13), pytest.mark.slow)}
    return pytest.param(number, marks=marks.get(number, pytest.mark.long))


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize("number", [marked(k) for k in range(len(CHAINS))])
def test_singularities_of_random_chains_are_exact_and_all(number):
    tracer, found, analysis = analysed(number)
    assert found.guarantee is Guarantee.COMPLETE and not found.mismatches
    points = analysis.points
    assert not (
        analysis.crossings or analysis.resting_curves or analysis.notes or analysis.gaps
    )
    assert all(p.certain and not p.double for p in points)
    check_exact(tracer, analysis, points)
    dead, counts = check_counts(tracer, found, analysis, points)
    assert len(points) >= 8
    assert counts > 1 and dead >= 4 and dead % 2 == 0
