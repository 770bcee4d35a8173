"""Mechanisms with several inputs: freedoms, motion over paths and grids, poles."""

import numpy as np
import pytest
from mechanism_examples.named_mechanisms import dixon_mechanism
from oracles.velocity_equations import locked_rates, sine_between_lines
from scipy.optimize import brentq

import spherekit as sk
from spherekit.planning.mobility import graph_mobility
from spherekit.planning.pole_plan import all_poles
from spherekit.positions.loop_tree import rank_mobility
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.status import Status
from spherekit.velocities.pole_evaluation import evaluate
from spherekit.velocities.pole_request import request

MOBILITIES = {
    # name: (mobility by counting on the graph, by the rank of the velocity equations)
    "five_bar": (2, 2),
    "bevel_differential": (0, 2),
    "two_dof_spm": (2, 2),
    "three_rrr": (3, 3),
    "agile_eye": (3, 3),
}


def evaluate_all_poles(position_analysis, motion):
    """Return one field of poles for each input, which moves while the others are locked."""
    mechanism = position_analysis.mechanism
    poles = all_poles(len(mechanism.links))
    fields = []
    for moving_input in position_analysis.inputs:
        pole_request = request(
            mechanism, moving_input, poles, rates=poles, by_rank=position_analysis.by_rank
        )
        fields.append(evaluate(motion, pole_request))
    return fields


@pytest.mark.parametrize("name", MOBILITIES)
def test_mobility_by_graph_and_by_rank(name):
    """Degrees of freedom by counting links and pairs, and by the rank at three samples."""
    position_analysis = PositionAnalysis(sk.load(name), samples=3)
    motion = position_analysis.motion()
    vectors = motion.vectors[~motion.failed]
    ranks = rank_mobility(position_analysis.solver.closure.tree, vectors)
    expected_by_graph, expected_by_rank = MOBILITIES[name]
    assert graph_mobility(position_analysis.mechanism) == expected_by_graph
    assert set(ranks) == {expected_by_rank}


@pytest.mark.many
@pytest.mark.parametrize("name", MOBILITIES)
def test_poles_with_one_moving_input_agree_with_the_velocity_equations(name):
    """Poles with one moving input agree with an independent solution, to 1e-9.

    A pole is the axis of the relative rotation of two links, and its coefficient the rate
    per rate of the input. The oracle `locked_rates` solves the velocity equations of all
    loops with the other inputs locked. It does not call spherekit's evaluation of poles.
    Rows (configurations) near a singularity are left out, where the ratio of the extreme
    singular values of the equations is below 1e-6. Links that do not turn relative to each
    other have no direction to compare.
    """
    position_analysis = PositionAnalysis(sk.load(name), samples=5)
    motion = position_analysis.motion()
    fields = evaluate_all_poles(position_analysis, motion)
    compared_count = 0
    for moving_input, field in zip(motion.assembly.inputs, fields, strict=True):
        for row in np.flatnonzero(field.status == Status.OK):
            # (links, 3) angular velocities of the links in ground axes
            w, singular_ratio = locked_rates(motion, row, moving_input)
            if singular_ratio < 1e-6:
                continue
            tolerance = 1e-9 * max(1.0, np.max(np.abs(w)))
            for i, j in all_poles(len(motion.mechanism.links)):
                relative_rate = w[j] - w[i]
                size = np.linalg.norm(relative_rate)
                coefficient = field.velocity_coefficient[i, j][row]
                direction = field.direction[i, j][row]
                if size < 1e-9:
                    assert abs(coefficient) < tolerance
                    continue
                compared_count += 1
                error = np.linalg.norm(coefficient * direction - relative_rate)
                assert error < tolerance
                if size > 1e-4:
                    assert sine_between_lines(direction, relative_rate) < 1e-9
    assert compared_count > 50


@pytest.mark.parametrize("name", ["five_bar", "two_dof_spm"])
def test_a_motion_over_a_grid_of_inputs_does_not_depend_on_the_size_of_blocks(name):
    """Blocks of 17 samples, joined, equal the motion in one block, bit by bit."""
    mechanism = sk.load(name)
    position_analysis = PositionAnalysis(mechanism, samples=[5] * len(mechanism.inputs))
    whole = position_analysis.motion()
    blocks = list(position_analysis.blocks(17))
    for assembly_mode in position_analysis.assembly_modes:
        number = assembly_mode.number
        parts = [block.values[block.assembly_mode == number] for block in blocks]
        expected = whole.values[whole.assembly_mode == number]
        assert np.array_equal(np.concatenate(parts), expected, equal_nan=True)


def rounded_configurations(motion, sample):
    """Return the set of configurations of a sample, as cosines and sines to 8 decimals."""
    values = motion.values[(motion.sample == sample) & ~motion.failed]
    return {tuple(np.round(np.exp(1j * row), 8)) for row in values}


@pytest.mark.parametrize("name", ["five_bar", "two_dof_spm"])
def test_a_grid_of_inputs_has_the_configurations_of_the_path_on_its_diagonal(name):
    """On the path, all inputs run from start to stop together, in 5 samples."""
    mechanism = sk.load(name)
    counts = [5] * len(mechanism.inputs)
    grid = PositionAnalysis(mechanism, samples=counts).motion()
    path = sk.trace(mechanism, samples=5)
    diagonal = np.ravel_multi_index([np.arange(5)] * len(counts), counts)
    for path_sample, grid_sample in enumerate(diagonal):
        on_path = rounded_configurations(path, path_sample)
        assert on_path <= rounded_configurations(grid, grid_sample)


def test_an_over_constrained_mechanism_moves_and_has_its_poles():
    """Dixon's framework K(3,3) moves although its mobility by counting is 0.

    The framework has three points on one great circle and three on another. Nine bars, the
    links, join each point of one to each point of the other. Its loops close at 11 samples.
    Relative rates of all 9 links at the middle of three samples agree with the velocity
    equations of all loops (`locked_rates`), which are well conditioned there (ratio of the
    extreme singular values above 1e-3).
    """
    mechanism = dixon_mechanism(np.random.default_rng(3))
    motion = sk.trace(mechanism, samples=11, search=False)
    assert graph_mobility(mechanism) == 0
    assert np.all(motion.status == Status.OK)
    assert np.max(motion.residual) < 1e-13

    position_analysis = PositionAnalysis(mechanism, samples=3, search=False)
    motion = position_analysis.motion()
    (field,) = evaluate_all_poles(position_analysis, motion)
    middle = 1
    (moving_input,) = position_analysis.assembly.inputs
    w, singular_ratio = locked_rates(motion, middle, moving_input)
    assert singular_ratio > 1e-3
    for i, j in all_poles(len(mechanism.links)):
        direction = field.direction[i, j][middle]
        coefficient = field.velocity_coefficient[i, j][middle]
        if field.pole_status[i, j][middle] == Status.NO_POLE:
            # Links at rest relative to each other have no axis; the direction is NaN.
            direction = np.zeros(3)
        relative_rate = coefficient * direction
        assert np.linalg.norm(relative_rate - (w[j] - w[i])) < 1e-9


def test_inputs_that_do_not_determine_the_pose_are_a_status():
    """Where both couplers of the five-bar are in line, no configuration has the status OK.

    The couplers are then stretched, so that the inputs cannot move independently. The
    status is AT_SINGULARITY, or OUT_OF_REACH if rounding puts the ends of the cranks a
    little too far apart. By symmetry both cranks have the same angle q. Their ends are then
    150 deg apart, the sum of both couplers of 75 deg; the cosine of this arc is an equation
    for q. The cranks' arcs are 75 deg too. Their axes are 90 deg apart, here along x and y.
    """
    sine = np.sin(np.radians(75.0))
    cosine = np.cos(np.radians(75.0))

    def excess_of_cosine(q):
        """Return the cosine of the arc between the cranks' ends, less that of 150 deg."""
        # With equal angles the cranks are on opposite sides of the plane z = 0.
        first_end = np.array([cosine, sine * np.cos(q), sine * np.sin(q)])
        second_end = np.array([sine * np.cos(q), cosine, -sine * np.sin(q)])
        return first_end @ second_end - np.cos(np.radians(150.0))

    q = brentq(excess_of_cosine, 0.5, 0.5 * np.pi, xtol=1e-15)
    regular_inputs = [1.0, 1.0]
    motion = sk.trace(sk.load("five_bar"), path=np.array([regular_inputs, [q, q]]))
    assert np.all(motion.status[motion.sample == 0] == Status.OK)
    status_in_line = {Status(code) for code in motion.status[motion.sample == 1]}
    assert status_in_line <= {Status.AT_SINGULARITY, Status.OUT_OF_REACH}
