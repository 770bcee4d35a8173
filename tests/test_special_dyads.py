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
from spherekit.geometry.triangle import close_dyad, frame_toward
from spherekit.geometry.vectors import unit_rows
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
"""Arcs (deg) of ground, crank, coupler and rocker, and the rocker's angle (rad) where its
tip lies on the crank's axis or opposite to it."""


@pytest.mark.parametrize(("arcs", "folded_angle"), FOLDED.items())
def test_a_rocker_tip_on_the_axis_of_the_crank_is_a_singularity(arcs, folded_angle):
    """The position is undetermined where the driven rocker's tip is on the crank's axis.

    There crank and coupler can turn together about the crank's axis while the rocker rests.
    Their arcs are equal, or they add up to 180 deg and the tip is at the opposite end of
    the axis. The status must be AT_SINGULARITY, not OUT_OF_REACH. At two rocker angles
    beside it, the loop closes exactly if crank and coupler reach the tip. The arc from the
    crank's axis to the tip follows from the spherical law of cosines. `folded_angle` (rad)
    is the rocker angle at which the tip is on the axis; `arcs` are in degrees.
    """
    mechanism = four_bar(np.radians(arcs)).with_inputs("41")
    rocker_angle = np.array([folded_angle, folded_angle + 1e-3, folded_angle + 0.1])
    position_analysis = PositionAnalysis(mechanism)
    # Here the rocker angle is that between the arcs of ground and rocker. The variable of
    # pair 41 counts from the opposite side and in the opposite sense.
    motion = position_analysis.at(np.pi - rocker_angle)
    mode_count = len(motion.assembly_modes)
    status = motion.status.reshape(mode_count, -1)
    residual = motion.residual.reshape(mode_count, -1)
    assert np.all(status[:, 0] == Status.AT_SINGULARITY)
    assert np.all(residual[:, 0] < 1e-13)

    ground, crank, coupler, rocker = np.radians(arcs)
    cosine = np.cos(ground) * np.cos(rocker)
    cosine += np.sin(ground) * np.sin(rocker) * np.cos(rocker_angle)
    tip_distance = np.arccos(np.clip(cosine, -1.0, 1.0))
    # Crank and coupler reach the tip if its distance is between `shortest` and `longest`.
    longest = min(crank + coupler, 2.0 * np.pi - crank - coupler)
    shortest = abs(crank - coupler)
    margin = np.minimum(longest - tip_distance, tip_distance - shortest)
    closes = np.any(status == Status.OK, axis=0)
    assert np.array_equal(closes[1:], margin[1:] > 0.0)


def axes_at_dead_centre(chain, driven, random):
    """Return joint axes (pairs, 3) of a chain that is at a dead centre of the driven pair.

    At a dead centre the driven pair cannot move on. The determinant of the loop equations,
    without the column of the driven pair, is zero. All axes are random. One axis is moved
    along a great circle to a random goal, until the determinant is zero. If it does not
    change its sign on the way, other random axes are tried.
    """
    while True:
        axes = random_axes(random, len(chain.split()))
        moved = random.integers(len(axes))
        goal = random_axes(random, 1)[0]

        # The defaults bind the values of this pass of the loop, not of a later one.
        def axes_at(part, axes=axes, moved=moved, goal=goal):
            """Return the axes with the moved one some part of the way to its goal."""
            new_axes = axes.copy()
            new_axes[moved] = (1.0 - part) * axes[moved] + part * goal
            return new_axes / np.linalg.norm(new_axes, axis=1, keepdims=True)

        def determinant(part, axes_at=axes_at):
            mechanism = mechanism_from_chain(chain, axes_at(part), driven)
            jacobian = LoopTree.of_mechanism(mechanism).jacobian(axes_at(part)[None])[0]
            number = mechanism.pair_number[driven]
            return np.linalg.det(np.delete(jacobian, number, axis=1))

        if determinant(0.0) * determinant(1.0) < 0.0:
            return axes_at(brentq(determinant, 0.0, 1.0, xtol=1e-15, rtol=1e-15))


@pytest.mark.parametrize(
    ("chain", "driven"), [(FOUR_BAR, "p1_2"), (STEPHENSON, "p1_2"), (STEPHENSON, "p1_6")]
)
def test_a_reference_pose_at_a_dead_centre_is_singular_and_closes_on_one_side(
    chain, driven
):
    """A reference pose at a dead centre is singular, and the loop closes on one side only.

    `axes_at_dead_centre` returns random joint axes at a dead centre of the driven pair. The
    pose is a double root of the equations. An error of the equations then moves the root by
    about its square root. Rounding errors are 1e-16 or a few powers of ten larger, so the
    pose is found to 1e-6 rad only.
    """
    random = np.random.default_rng(11)
    for _ in range(2):
        axes = axes_at_dead_centre(chain, driven, random)
        mechanism = mechanism_from_chain(chain, axes, driven)
        inputs = np.array([0.0, -1e-4, 1e-4])
        motion = PositionAnalysis(mechanism, path=inputs, search=False).motion()
        assert motion.status[0] == Status.AT_SINGULARITY
        assert np.max(np.abs(motion.values[0])) < 1e-6
        assert sorted(motion.status[1:]) == [Status.OK, Status.OUT_OF_REACH]


def test_the_search_for_sign_changes_gives_up_a_function_that_is_noise():
    """It evaluates few points of sin(1e9 q), and reports the whole range as doubtful."""
    evaluated_counts = []

    def noise(q):
        evaluated_counts.append(len(q))
        return np.sin(1e9 * q)

    _, doubtful = find_sign_changes(noise, 0.0, 2.0 * np.pi, smooth_width=0.5 * np.pi)
    assert sum(evaluated_counts) < 39 * 64
    assert np.allclose(doubtful, [[0.0, 2.0 * np.pi]])


def test_all_sign_changes_of_a_smooth_function_of_many_periods_are_located():
    roots, doubtful = find_sign_changes(np.sin, 0.5, 200.0, smooth_width=0.5 * np.pi)
    assert not len(doubtful)
    expected = np.pi * np.arange(1, 64)
    assert np.allclose(roots, expected, rtol=0.0, atol=1e-12)


def test_roots_at_ends_of_search_intervals_are_located_once():
    """These round numbers are ends of intervals that are halved again and again."""
    expected = np.array([-1.5, -0.75, 0.0, 1.5, 2.25])

    def product(x):
        return np.prod(np.sin(0.5 * (x[:, None] - expected)), axis=1)

    roots, doubtful = find_sign_changes(product, -3.0, 3.0)
    assert roots == pytest.approx(expected, abs=1e-12)
    assert not len(doubtful)


@pytest.mark.slow
def test_a_search_of_modes_ends_after_its_limit_of_steps(monkeypatch):
    """The message states the modes and the steps along them; fewer modes result."""
    mechanism = sk.load("eight_bar_07")
    complete_search = PositionAnalysis(mechanism, samples=3)
    monkeypatch.setattr(modes_over_range, "MAX_STEPS_ALONG_MODES", 100)
    short_search = PositionAnalysis(mechanism, samples=3)
    count = len(short_search.assembly_modes)
    assert 0 < count < len(complete_search.assembly_modes)
    match = re.search(rf"stopped at {count} modes after (\d+) steps", short_search.search)
    assert match is not None
    assert int(match[1]) > 10 * count


@pytest.mark.parametrize("distance", [1e-14, 1e-13, 1e-12, 1e-10])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_frames_between_nearly_collinear_axes_are_orthonormal(distance, sign):
    """The axes nearly coincide, or are nearly opposite (`sign` -1)."""
    rng = np.random.default_rng(1)
    axes = unit_rows(rng.normal(size=(200, 3)))
    targets = sign * unit_rows(axes + distance * rng.normal(size=(200, 3)))
    frames = frame_toward(axes, targets)
    products = np.swapaxes(frames, 1, 2) @ frames
    assert np.allclose(products, np.eye(3), rtol=0.0, atol=1e-14)
    assert np.array_equal(frames[..., 2], axes)


@pytest.mark.parametrize("distance", [0.0, 1e-16, 1e-13, 1e-12])
def test_a_dyad_with_a_very_short_arc_has_proper_rotations(distance):
    """The other arc equals the base, so that the dyad closes."""
    rng = np.random.default_rng(2)
    first, second, outer = unit_rows(rng.normal(size=(3, 500, 3)))
    middle = unit_rows(outer + distance * rng.normal(size=(500, 3)))
    closure = close_dyad(
        first, second, (outer, middle), (second, first), sign=1.0, slack=1e-8
    )
    assert closure.closes.all()
    for rotation in (closure.first_rotation, closure.second_rotation):
        products = np.swapaxes(rotation, 1, 2) @ rotation
        assert np.allclose(products, np.eye(3), rtol=0.0, atol=1e-14)
        assert np.allclose(np.linalg.det(rotation), 1.0, rtol=0.0, atol=1e-14)
