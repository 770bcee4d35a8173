"""Dyads whose outer axes come to one line, and the ways out of where curves cross."""

import re
import warnings

import numpy as np
import pytest
from mechanism_examples.linkages import (
    FOUR_BAR,
    STEPHENSON,
    mechanism_from_chain,
    random_axes,
)
from mechanism_examples.named_mechanisms import four_bar
from scipy.optimize import brentq

import spherekit as sk
from spherekit.numerics.sign_changes import find_sign_changes
from spherekit.positions import modes_over_range
from spherekit.positions.loop_tree import LoopTree
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.status import Status


@pytest.fixture(autouse=True)
def no_warning():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


FOLDED = {(60, 40, 40, 60): 0, (33, 71, 71, 33): 0, (90,) * 4: 0, (60, 40, 140, 120): np.pi}


@pytest.mark.parametrize(("arcs", "folded"), FOLDED.items())
def test_two_bars_that_can_turn_together_are_singular_and_not_out_of_reach(arcs, folded):
    """The tip of the rocker lies on the crank's axis, or opposite to it."""
    made = four_bar(np.radians(arcs)).with_inputs("41")
    gap = np.array([folded, folded + 1e-3, folded + 0.1])
    motion = PositionAnalysis(made).at(np.pi - gap)  # the file counts 41 from there
    status = motion.status.reshape(len(motion.assembly_modes), -1)
    assert np.all(status[:, 0] == Status.AT_SINGULARITY)
    assert np.all(motion.residual.reshape(len(motion.assembly_modes), -1)[:, 0] < 1e-13)
    # independently: the tip's arc from the crank's axis, by the law of cosines
    ground, crank, coupler, rocker = np.radians(arcs)
    cosine = np.cos(ground) * np.cos(rocker) + np.sin(ground) * np.sin(rocker) * np.cos(gap)
    away = np.arccos(np.clip(cosine, -1.0, 1.0))
    reach = min(crank + coupler, 2.0 * np.pi - crank - coupler) - away
    reach = np.minimum(reach, away - abs(crank - coupler))
    held = np.any(status == Status.OK, axis=0)
    assert np.array_equal(held[1:], reach[1:] > 0.0)


def dead_pose(chain, driven, random):
    """Return random axes of a chain at a dead centre of a pair: a determinant is zero."""
    while True:
        axes = random_axes(random, len(chain.split()))
        moved, goal = random.integers(len(axes)), random_axes(random, 1)[0]

        def at(part, axes=axes, moved=moved, goal=goal):
            new = axes.copy()
            new[moved] = (1.0 - part) * axes[moved] + part * goal
            return new / np.linalg.norm(new, axis=1, keepdims=True)

        def determinant(part, at=at):
            made = mechanism_from_chain(chain, at(part), driven)
            jacobian = LoopTree.of_mechanism(made).jacobian(at(part)[None])[0]
            number = made.pair_number[driven]
            return np.linalg.det(np.delete(jacobian, number, axis=1))

        if determinant(0.0) * determinant(1.0) < 0.0:
            return at(brentq(determinant, 0.0, 1.0, xtol=1e-15, rtol=1e-15))


@pytest.mark.parametrize(
    ("chain", "driven"), [(FOUR_BAR, "p1_2"), (STEPHENSON, "p1_2"), (STEPHENSON, "p1_6")]
)
def test_a_pose_at_a_dead_centre_is_there_and_has_a_way_on(chain, driven):
    """With a triad nothing but the pose was: both sides were OUT_OF_REACH."""
    random = np.random.default_rng(11)
    for _ in range(2):
        made = mechanism_from_chain(chain, dead_pose(chain, driven, random), driven)
        path = np.array([0.0, -1e-4, 1e-4])
        motion = PositionAnalysis(made, path=path, search=False).motion()
        assert motion.status[0] == Status.AT_SINGULARITY
        assert np.max(np.abs(motion.values[0])) < 1e-6  # a double root
        assert sorted(motion.status[1:]) == [Status.OK, Status.OUT_OF_REACH]


def test_a_function_of_rounding_only_is_given_up_early():
    """It was halved up to 400 cells of 39 samples, here and at every group of a chain."""
    asked = []

    def noise(q):
        asked.append(len(q))
        return np.sin(1e9 * q)

    _, doubtful = find_sign_changes(noise, 0.0, 2.0 * np.pi, smooth_width=0.5 * np.pi)
    assert sum(asked) < 39 * 64
    assert np.allclose(doubtful, [[0.0, 2.0 * np.pi]])
    # a smooth function of many periods is not
    places, doubtful = find_sign_changes(np.sin, 0.5, 200.0, smooth_width=0.5 * np.pi)
    assert not len(doubtful)
    assert np.allclose(places, np.pi * np.arange(1, 64), rtol=0.0, atol=1e-12)
    roots = np.array([-1.5, -0.75, 0.0, 1.5, 2.25])  # round places, each of them once

    def product(x):
        return np.prod(np.sin(0.5 * (x[:, None] - roots)), axis=1)

    places, doubtful = find_sign_changes(product, -3.0, 3.0)
    assert places == pytest.approx(roots, abs=1e-12) and not len(doubtful)


def test_steps_of_following_end_the_search_of_modes(monkeypatch):
    """As the claim says, with the steps along its modes; others were followed beside."""
    made = sk.load("eight_bar_07")
    every = PositionAnalysis(made, samples=3)
    monkeypatch.setattr(modes_over_range, "MAX_STEPS_ALONG_MODES", 100)
    few = PositionAnalysis(made, samples=3)
    assert 0 < len(few.assembly_modes) < len(every.assembly_modes)
    count = len(few.assembly_modes)
    said = re.search(rf"stopped at {count} modes after (\d+) steps", few.search)
    assert said is not None and int(said[1]) > 10 * count
