"""The same mechanism described otherwise gives the same result."""

from dataclasses import replace

import numpy as np
import pytest
from chains import EIGHT_BARS, mechanism, random_axes
from oracles import off_axis

import spherekit as sk
from spherekit.engine.fields import evaluate
from spherekit.model.parts import PoseGeometry
from spherekit.motion.motion import PositionAnalysis
from spherekit.planning.poles import all_poles
from spherekit.rates.request import request

CHAIN = EIGHT_BARS[4]


def rows(made, q, search=False):
    """Return pole vectors by link names, {(link, relative to): (n, 3)}, and directions."""
    tracer = PositionAnalysis(made, search=search)
    poles = all_poles(len(made.links))
    driven = tracer.mechanism.inputs[0].pair
    field = evaluate(tracer.at(q), request(tracer.mechanism, driven, poles, poles))
    names = made.links
    vectors, lines = {}, {}
    for i, j in poles:
        w = field.direction[i, j] * field.velocity_coefficient[i, j][:, None]
        vectors[names[j], names[i]] = w
        vectors[names[i], names[j]] = -w
        lines[names[j], names[i]] = lines[names[i], names[j]] = field.direction[i, j]
    return vectors, lines


@pytest.fixture
def random():
    return np.random.default_rng(11)


Q = np.array([-1e-3, 0.0, 1e-3])


def same(one, other, tolerance=1e-10):
    assert one.keys() == other.keys()
    for key, value in one.items():
        scale = max(1.0, np.nanmax(np.abs(value)))
        assert np.allclose(
            value, other[key], rtol=0, atol=tolerance * scale, equal_nan=True
        ), key


def test_another_ground_gives_the_same_relative_motions(random):
    """Only the axes in which directions are given change: those of the new ground."""
    axes = random_axes(random, 10)
    made = mechanism(CHAIN, axes)
    vectors, _ = rows(made, np.zeros(1))
    other, _ = rows(replace(made, ground="5"), np.zeros(1))
    same(vectors, other)


def test_flipping_an_axis(random):
    for pair in range(10):
        axes = random_axes(random, 10)
        made = mechanism(CHAIN, axes)
        vectors, lines = rows(made, Q)
        flipped = axes.copy()
        flipped[pair] *= -1.0
        again, flipped_lines = rows(mechanism(CHAIN, flipped), Q if pair else -Q)
        sign = -1.0 if pair == 0 else 1.0
        same(vectors, {key: sign * value for key, value in again.items()})
        for key, line in lines.items():
            assert np.nanmax(off_axis(line, flipped_lines[key])) < 1e-10


def test_sizes_and_reference_pose_describe_the_same_motion():
    """The Stephenson of the shipped file, given again by its axes at some input."""
    sized = sk.load("stephenson")
    tracer = PositionAnalysis(sized)
    start = tracer.at(np.array([0.7]))
    first = start.assembly_mode == 2
    axes = {p.name: tuple(start.axes[first][0, k]) for k, p in enumerate(sized.pairs)}
    value = {p.name: float(start.values[first][0, k]) for k, p in enumerate(sized.pairs)}
    posed = replace(sized, geometry=PoseGeometry(axes, value))
    q = np.linspace(0.0, 6.0, 13)
    motion = tracer.at(q)
    other = PositionAnalysis(posed).at(q)
    ours, theirs = motion.assembly_mode == 2, other.assembly_mode == 0
    turned = np.exp(1j * motion.values[ours]) - np.exp(1j * other.values[theirs])
    assert np.nanmax(np.abs(turned)) < 1e-13
    assert np.nanmax(np.abs(motion.axes[ours] - other.axes[theirs])) < 1e-13
