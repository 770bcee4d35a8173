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

SHIPPED = {
    # name: (mobility by the graph, by rank)
    "five_bar": (2, 2),
    "bevel_differential": (0, 2),
    "two_dof_spm": (2, 2),
    "three_rrr": (3, 3),
    "agile_eye": (3, 3),
}


def fields_of(tracer, motion):
    made, poles = tracer.mechanism, all_poles(len(motion.mechanism.links))
    asked = [request(made, x, poles, poles, by_rank=tracer.by_rank) for x in tracer.inputs]
    return [evaluate(motion, item) for item in asked]


@pytest.mark.parametrize("name", SHIPPED)
def test_mobility_by_graph_and_by_rank(name):
    tracer = PositionAnalysis(sk.load(name), samples=3)
    motion = tracer.motion()
    rank = rank_mobility(tracer.solver.closure.tree, motion.vectors[~motion.failed])
    by_graph, by_rank = SHIPPED[name]
    assert (graph_mobility(tracer.mechanism), set(rank)) == (by_graph, {by_rank})


@pytest.mark.many
@pytest.mark.parametrize("name", SHIPPED)
def test_poles_of_every_single_freedom_mechanism(name):
    """Each input moved alone: the velocity equations with the other inputs locked."""
    tracer = PositionAnalysis(sk.load(name), samples=5)
    motion = tracer.motion()
    judged = 0
    for moved, field in zip(motion.assembly.inputs, fields_of(tracer, motion), strict=True):
        for row in np.flatnonzero(field.status == Status.OK):
            w, gap = locked_rates(motion, row, moved)
            if gap < 1e-6:
                continue
            scale = max(1.0, np.max(np.abs(w)))
            for i, j in all_poles(len(motion.mechanism.links)):
                vector = w[j] - w[i]
                size = np.linalg.norm(vector)
                coefficient = field.velocity_coefficient[i, j][row]
                if size < 1e-9:
                    assert abs(coefficient) < 1e-9 * scale
                    continue
                judged += 1
                ours = coefficient * field.direction[i, j][row]
                assert np.linalg.norm(ours - vector) < 1e-9 * scale
                if size > 1e-4:
                    assert sine_between_lines(field.direction[i, j][row], vector) < 1e-9
    assert judged > 50


@pytest.mark.parametrize("name", ["five_bar", "two_dof_spm"])
def test_a_grid_holds_every_path_and_blocks_do_not_matter(name):
    made = sk.load(name)
    counts = [5] * len(made.inputs)
    tracer = PositionAnalysis(made, samples=counts)
    whole = tracer.motion()
    parts = list(tracer.blocks(17))
    for assembly_mode in tracer.assembly_modes:
        joined = np.concatenate(
            [p.values[p.assembly_mode == assembly_mode.number] for p in parts]
        )
        ours = whole.values[whole.assembly_mode == assembly_mode.number]
        assert np.array_equal(joined, ours, equal_nan=True)
    diagonal = np.ravel_multi_index([np.arange(5)] * len(counts), counts)
    along = sk.trace(made, samples=5)
    for k in range(5):
        there = {
            tuple(np.round(np.exp(1j * v), 8))
            for v in whole.values[(whole.sample == diagonal[k]) & ~whole.failed]
        }
        here = along.values[(along.sample == k) & ~along.failed]
        assert {tuple(np.round(np.exp(1j * v), 8)) for v in here} <= there


def test_an_over_constrained_mechanism_moves():
    """Dixon's K(3,3): mobility 0 by the graph, 1 by rank; bars keep their lengths."""
    made = dixon_mechanism(np.random.default_rng(3))
    motion = sk.trace(made, samples=11, search=False)
    assert graph_mobility(made) == 0
    assert np.all(motion.status == Status.OK)
    assert np.max(motion.residual) < 1e-13
    tracer = PositionAnalysis(made, samples=3, search=False)
    (field,) = fields_of(tracer, tracer.motion())
    w, gap = locked_rates(tracer.motion(), 1, tracer.assembly.inputs[0])
    assert gap > 1e-3
    for i, j in all_poles(9):
        ours = field.velocity_coefficient[i, j][1] * np.nan_to_num(field.direction[i, j][1])
        assert np.linalg.norm(ours - (w[j] - w[i])) < 1e-9


def test_inputs_that_do_not_determine_the_pose_are_a_status():
    """Where the couplers of a 5R line up, the inputs are not independent freedoms."""

    def stretched(q):
        s, c = np.sin(np.radians(75.0)), np.cos(np.radians(75.0))
        return -((s * np.sin(q)) ** 2) + 2 * s * c * np.cos(q) - np.cos(np.radians(150.0))

    q = brentq(stretched, 0.5, 0.5 * np.pi, xtol=1e-15)
    motion = sk.trace(sk.load("five_bar"), path=np.array([[1.0, 1.0], [q, q]]))
    assert np.all(motion.status[motion.sample == 0] == Status.OK)
    lost = {Status(code) for code in motion.status[motion.sample == 1]}
    assert lost <= {Status.AT_SINGULARITY, Status.OUT_OF_REACH}
