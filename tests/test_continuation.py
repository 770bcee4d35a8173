"""The contract of continuation, on curves whose points are known in closed form."""

from dataclasses import dataclass

import numpy as np
import pytest

from spherekit.conventions import Status
from spherekit.files.read import load
from spherekit.motion.closure import (
    STEP_PARTS,
    CurvePath,
    Verification,
    run_each,
    taylor,
)
from spherekit.motion.guides import follow, follow_each
from spherekit.motion.motion import Tracer


@dataclass(frozen=True)
class OnHelix:
    """A point of the helix (cos s, sin s, c s), s its angle."""

    s: float
    pitch: float

    @property
    def values(self):
        return np.array([np.cos(self.s), np.sin(self.s), self.pitch * self.s])

    @property
    def tangent(self):
        along = np.array([-np.sin(self.s), np.cos(self.s), self.pitch])
        return along / np.linalg.norm(along)

    @property
    def bend(self):
        inward = np.array([-np.cos(self.s), -np.sin(self.s), 0.0])
        return inward / (1.0 + self.pitch**2)


@dataclass
class Helix(CurvePath[OnHelix]):
    """The helix, which no step may carry beyond the angle `last`."""

    verification = Verification()
    smallest_step = 1e-9
    same = 1e-9
    most_nodes = 1000

    last: float = np.inf

    @staticmethod
    def steps_to(paths, ats, ways):
        return [
            path.one_step(at, way) for path, at, way in zip(paths, ats, ways, strict=True)
        ]

    def one_step(self, at, way):
        s = at.s
        for _ in range(20):
            there = OnHelix(s, at.pitch)
            speed = there.tangent * np.sqrt(1.0 + at.pitch**2)
            s -= (at.tangent @ (there.values - at.values) - way) / (at.tangent @ speed)
        there = OnHelix(s, at.pitch)
        point = (part[None] for part in (at.values, at.tangent, at.bend))
        guess = taylor(*point, way * STEP_PARTS[None])[1]
        first = np.max(np.abs(guess - there.values), keepdims=True)
        if s > self.last or not np.all(self.verification.corrected(first, first, way)):
            return None
        return there, float(1.0 - at.tangent @ there.tangent)

    def again(self, at, values):
        return OnHelix(at.s + np.max(np.abs(values - at.values)), at.pitch)

    def within(self, step, node):
        return node is not None

    def beyond(self):
        return Status.OUT_OF_REACH


@pytest.mark.parametrize("pitch", [0.0, 0.25])
def test_a_curve_closes_after_one_lap_of_its_periods(pitch):
    rise = 2.0 * np.pi * pitch
    periods = np.array([np.inf, np.inf, rise or np.inf])
    path = Helix(OnHelix(0.3, pitch), periods, 100.0, 0.4).run(0.1)
    assert path.closed
    assert path.end == Status.OK
    assert list(path.winding) == [0, 0, 1 if pitch else 0]
    chords = np.diff(
        [path.start.values, *(node.values for node in path.nodes[:-1])], axis=0
    )
    assert np.max(np.linalg.norm(chords, axis=1)) < 0.45
    assert np.all(np.diff([node.s for node in path.nodes[:-1]]) > 0.0)


def test_curves_of_several_lengths_are_followed_together_as_each_alone():
    paths = [
        Helix(OnHelix(0.3, 1.0), np.full(3, np.inf), longest, 0.4, last=last)
        for longest, last in ((3.0, np.inf), (100.0, 2.0), (20.0, np.inf))
    ]
    run_each(paths, 0.1)
    for path in paths:
        alone = Helix(path.start, path.periods, path.longest, 0.4, last=path.last).run(0.1)
        assert path.end == alone.end
        assert [node.s for node in path.nodes] == [node.s for node in alone.nodes]


def test_a_curve_ends_beside_what_no_step_passes():
    path = Helix(OnHelix(0.3, 1.0), np.full(3, np.inf), 100.0, 0.4, last=2.0).run(0.1)
    assert path.end == Status.OUT_OF_REACH
    assert not path.closed
    assert 0.0 <= 2.0 - path.nodes[-1].s < 1e-8


def test_a_curve_is_ended_after_its_greatest_length():
    path = Helix(OnHelix(0.3, 1.0), np.full(3, np.inf), 3.0, 0.4).run(0.1)
    assert path.end == Status.OK
    assert 3.0 <= path.way < 3.5


@pytest.mark.parametrize("name", ["four_bar", "roller_cam", "two_contacts"])
def test_the_bias_is_the_slope_of_the_jacobian_along_the_rates(name):
    tracer = Tracer(load(name), samples=5)
    motion = tracer.motion()
    closure, values = tracer.solver.closure, motion.values[~motion.failed]
    at = closure.at(values)
    rates = np.linalg.svd(at.jacobian)[2][:, -1]
    h = 1e-5
    ahead, back = (closure.at(values + s * rates).jacobian for s in (h, -h))
    slope = np.einsum("nij,nj->ni", (ahead - back) / (2.0 * h), rates)
    assert np.max(np.abs(at.bias(rates) - slope)) < 1e-7


def test_rows_keep_what_is_known_of_them():
    motion = Tracer(load("roller_cam"), samples=5).motion()
    at = motion.linearisation
    rows = np.flatnonzero(~motion.failed)[::-2]
    known = at.residual, at.jacobian
    part = at.take(rows)
    assert all(name in vars(part) for name in ("states", "frames", "jacobian", "residual"))
    fresh = motion.rows(np.isin(np.arange(len(motion)), rows)).linearisation
    for one, other in zip((part.residual, part.jacobian), known, strict=True):
        assert np.array_equal(one, other[rows])
    assert np.array_equal(part.vectors[::-1], fresh.vectors)


@pytest.mark.parametrize("name", ["single_flier", "shaped_cam"])
def test_curves_followed_side_by_side_are_those_of_each(name):
    tracer = Tracer(load(name))
    closure, driven = tracer.solver.closure, tracer.solver.driven[0]
    guides = [mode.guide for mode in tracer.assembly_modes]
    values = np.array([guide.values[len(guide.values) // 3] for guide in guides])
    together = follow_each(closure, driven, values, *tracer.range)
    for one, curve in zip(values, together, strict=True):
        alone = follow(closure, driven, one, *tracer.range)
        assert (curve.ends, curve.tried) == (alone.ends, alone.tried)
        assert np.max(np.abs(curve.values - alone.values)) < 1e-12
