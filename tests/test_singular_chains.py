"""Every singularity of random chains in 50 digits, and against the number of modes.

At a singularity of type I the output rests while the input moves, at one of type II (a dead
centre) the input rests; at self-motion the mechanism moves while both rest.
"""

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
INPUT_COUNT = 24
"""Inputs over a turn at which the modes are counted."""


def analyse_random_chain(number):
    """Return position analysis, configuration curves and singularities of a random chain.

    Axes and the input pair are drawn at random; the input turns once. A configuration curve
    is a continuous motion of the mechanism. The outputs are the last link relative to the
    ground, and link 5 relative to link 3.

    Parameters
    ----------
    number
        Index of the chain in `CHAINS`.
    """
    random = np.random.default_rng(200 + number)
    edges = parse_chain(CHAINS[number])
    a, b = edges[random.integers(len(edges))]
    axes = random_axes(random, len(edges))
    chain = mechanism_from_chain(CHAINS[number], axes, f"p{a}_{b}", span=(-np.pi, np.pi))
    position_analysis = PositionAnalysis(chain, samples=9)
    configurations = position_analysis.configurations
    curves = [item.curve for item in configurations.curves]
    outputs = [(chain.links[-1], "1"), ("5", "3")]
    singularities = SingleFreedomSingularities(position_analysis, curves, outputs)
    return position_analysis, configurations, singularities


def solve_exactly(mechanism, singularities, point, links):
    """Return the configuration near a point at which two links rest, in 50 digits.

    The oracle solves loop closure together with the condition of rest by Newton's method,
    without spherekit's solver, from the rotations and rates at the point.
    """
    motion = singularities.curve_motions[point.curve]
    rates = motion.links_at(np.array([point.s]))
    relative_slope = rates.dw[0, links[0]] - rates.dw[0, links[1]]
    rotations = rates.motion.rotations[0]
    return exact_rest(mechanism, rotations, rates.w[0], links, relative_slope)


def check_points_in_50_digits(position_analysis, singularities):
    """Assert that each singularity agrees with its exact solution, in place and type.

    At type I the output rests while the input moves, at type II the input rests; at a
    self-motion both rest. `solve_exactly` finds the configuration in 50 digits, in which
    one relative rate is zero: that of the output at type I, else that of the input. This
    configuration must be within 1e-12 rad of the point. The rates of input and output agree
    with those of the analysis to 1e-12. In both results, rates are derivatives by the arc
    length of the configuration curve.
    """
    solution_by_point = {}
    for point in singularities.points:
        if point.type == Type.I:
            resting_links = point.output
        else:
            resting_links = singularities.input
        key = point.curve, point.s, resting_links
        if key not in solution_by_point:
            solution_by_point[key] = solve_exactly(
                position_analysis.mechanism, singularities, point, resting_links
            )
        exact = solution_by_point[key]
        # The rotation from the point to the exact configuration, the closure residual, and
        # the relative rate of the links that have to rest. `RESTING` is zero in 50 digits.
        assert exact.rotation_change < 1e-12
        assert exact.residual < RESTING
        assert exact.relative_rate < RESTING
        a, b = singularities.input
        input_rate = np.linalg.norm(exact.rates[a] - exact.rates[b])
        a, b = point.output
        output_rate = np.linalg.norm(exact.rates[a] - exact.rates[b])
        if point.type in (Type.II, Type.SELF_MOTION):
            assert input_rate < RESTING
        if point.type in (Type.I, Type.SELF_MOTION):
            assert output_rate < RESTING
        if point.type != Type.SELF_MOTION:
            assert max(input_rate, output_rate) > 1e-6

        output_number = singularities.outputs.index(point.output)
        relation = singularities.evaluate_relations(
            point.curve, np.array([point.s]), output_number
        )
        assert abs(input_rate - abs(relation.input_rate[0])) < 1e-12
        assert abs(output_rate - abs(relation.output_rate[0])) < 1e-12


def check_mode_counts(position_analysis, configurations, singularities):
    """Assert that numbers of modes change at dead centres only, and as they have to.

    A mode is a way to assemble the links. At a dead centre the input reverses along its
    configuration curve. Where the input has a minimum, two modes appear as the input grows;
    where it has a maximum, two vanish. Modes are enumerated at random inputs over a turn.
    The expected number of modes at an input is the number at the smallest random input,
    plus 2 for each minimum and minus 2 for each maximum between the two inputs.

    Parameters
    ----------
    position_analysis
        The mechanism.
    configurations
        Its configuration curves. Their attributes `inputs` and `counts` are further inputs
        and the numbers of modes there, which are checked too.
    singularities
        Its singularities, among which are the dead centres.

    Returns
    -------
    dead_centre_count, distinct_count
        Number of dead centres, and of different numbers of modes.
    """
    variable = position_analysis.solver.input_variable
    dead_centre_inputs = []
    curvatures = []  # of the input along the arc length of its curve
    for point in singularities.points:
        # `input_turns`: the input reverses. Each dead centre is listed for every output.
        if point.output == singularities.outputs[0] and point.input_turns:
            curve = singularities.curve_motions[point.curve].curve
            dead_centre_inputs.append(point.values[variable])
            # Second derivative of the input by the arc length: positive at a minimum.
            curvatures.append(curve.at(point.s).bends[0, variable])

    random_inputs = np.random.default_rng(1).uniform(-np.pi, np.pi, INPUT_COUNT)
    inputs = np.sort(random_inputs)
    counts = []
    for q in inputs:
        modes = enumerate_assemblies(position_analysis.solver, np.array([q]))
        assert modes.is_complete
        counts.append(len(modes.values))
    inputs = [*inputs, *configurations.inputs]
    counts += configurations.counts.tolist()

    turn = 2.0 * np.pi
    distances = np.mod(np.array(dead_centre_inputs) - inputs[0], turn)
    for q, count in zip(inputs, counts, strict=True):
        is_passed = distances < np.mod(q - inputs[0], turn)
        pairs_of_modes = np.sum(np.sign(np.array(curvatures)[is_passed]))
        assert count - counts[0] == 2 * pairs_of_modes
    return len(dead_centre_inputs), len(set(counts))


def chain_parameter(number):
    """Return the parameter of a chain: two quick ones, some slow, all others take long."""
    marks = {0: (), 3: (), **dict.fromkeys((1, 4, 7, 10, 13), pytest.mark.slow)}
    return pytest.param(number, marks=marks.get(number, pytest.mark.long))


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize("number", [chain_parameter(k) for k in range(len(CHAINS))])
def test_singularities_of_random_chains_are_exact_and_none_is_missing(number):
    """Each singularity is solved for in 50 digits, and none is missing.

    A chain with random axes has no special positions. Its configuration curves do not
    cross, and no link rests while others move along a curve. The analysis must be complete,
    without remarks on doubtful places (`mismatches`, `notes` and `gaps`).

    The number of assembly modes (ways to assemble the links) changes at dead centres only.
    So counted modes show whether a dead centre is missing. There have to be at least 8
    singularities and 4 dead centres, and two different numbers of modes, so that the test
    compares something.
    """
    position_analysis, configurations, singularities = analyse_random_chain(number)
    assert configurations.guarantee is Guarantee.COMPLETE
    assert not configurations.mismatches
    assert not singularities.crossings
    assert not singularities.resting_curves
    assert not singularities.notes
    assert not singularities.gaps
    assert len(singularities.points) >= 8
    assert all(point.certain and not point.double for point in singularities.points)
    check_points_in_50_digits(position_analysis, singularities)
    # The number of modes is compared at random inputs. The second result is how many
    # different numbers occur.
    dead_centre_count, different_numbers = check_mode_counts(
        position_analysis, configurations, singularities
    )
    assert different_numbers > 1
    assert dead_centre_count >= 4
    assert dead_centre_count % 2 == 0
