"""Pairs as chains of turns about axes fixed in links.

An R pair is one turn. A profile that is a circle is run along by turning about its
centre, so a contact of two circles is two turns. The variables of such pairs move links
about axes that are fixed in one link each, and their rates need no curvature.
"""

from dataclasses import dataclass
from typing import final

import numpy as np

from spherekit.engine.algebra import Exprs
from spherekit.engine.frames import DesignGeometry, revolute_frames
from spherekit.errors import EngineError
from spherekit.model.geometry import geometry_of
from spherekit.model.joints import Track, revolute
from spherekit.model.mechanism import Mechanism
from spherekit.motion.pairs import contact_tracks, numbered
from spherekit.sphere.profile import Curve
from spherekit.sphere.rotation import Floats, frame_from, transpose

Entries = Floats | Exprs
"""Numbers, or terms of the sizes of a design."""


@final
@dataclass(frozen=True)
class AxisRotation:
    """A turn about z by scale * variable + offset (rad)."""

    variable: int
    scale: float = 1.0
    offset: float = 0.0


@final
@dataclass(frozen=True)
class Chain:
    """R_second = R_first C_0 Z_1 C_1 ... Z_k C_k: constant rotations between turns."""

    constants: tuple[Entries, ...]
    turns: tuple[AxisRotation, ...]

    def reversed(self) -> "Chain":
        """Return the chain from the second link to the first."""
        back = [AxisRotation(t.variable, -t.scale, -t.offset) for t in self.turns]
        return Chain(
            tuple(each.T for each in reversed(self.constants)),
            tuple(reversed(back)),
        )


@final
@dataclass(frozen=True)
class AxisTerm:
    """A part of a variable's vector: `size` times an axis (3,) fixed in a link."""

    size: float
    link: int
    axis: Entries


@final
@dataclass(frozen=True)
class TurningPairs:
    """The pairs of a mechanism: `chains[pair]`, and `spins[variable]`.

    The vector of a variable, the angular velocity of its pair's second link relative to
    the first per unit rate, is the sum of its spins. An R pair's single spin may be
    taken in either link; `twin[variable]` is that in the second.
    """

    chains: tuple[Chain, ...]
    spins: tuple[tuple[AxisTerm, ...], ...]
    twin: dict[int, AxisTerm]


def turning_pairs(
    mechanism: Mechanism, design: DesignGeometry | None = None
) -> TurningPairs:
    """Return the pairs of a mechanism as turns, their sizes those of a design if given.

    Raises
    ------
    EngineError
        If a profile is neither a circle nor a great circle.
    """
    frames = revolute_frames(mechanism, design) if design else {}
    joints = geometry_of(mechanism).joints
    chains: list[Chain] = []
    spins: list[tuple[AxisTerm, ...]] = [()] * len(mechanism.variable_owners)
    twin: dict[int, AxisTerm] = {}
    tracks = dict(contact_tracks(joints))
    for number, at, joint in numbered(joints):
        a, b = mechanism.ends[number]
        if number in tracks:
            _need_circles(mechanism, number)
            chain = _along(*tracks[number])
        else:
            hinge = revolute(joint)
            name = mechanism.pairs[number].name
            one, other = frames.get(name, (hinge.first, hinge.second))
            chain = Chain((one, other.T), (AxisRotation(at),))
            twin[at] = AxisTerm(1.0, b, other[:, 2])
        chains.append(chain)
        axes = (a, chain.constants[0][:, 2]), (b, chain.constants[-1][2])
        for turn, (link, axis) in zip(chain.turns, axes, strict=False):
            spins[turn.variable] += (AxisTerm(turn.scale, link, axis),)
    return TurningPairs(tuple(chains), tuple(spins), twin)


def _along(one: Track, other: Track) -> Chain:
    """Return the turns that run along two circles."""
    (first, pace), (second, far_pace) = _circle(one.curve), _circle(other.curve)
    middle = transpose(_about(one.curve)) @ _about(other.curve)
    turns = (
        AxisRotation(one.variable, pace, pace * one.start),
        AxisRotation(other.variable, -far_pace, -far_pace * other.start),
    )
    return Chain((first, middle, transpose(second)), turns)


def _need_circles(mechanism: Mechanism, number: int) -> None:
    pair = mechanism.pairs[number]
    for link, profile in zip(pair.links, pair.profiles or (), strict=False):
        if profile.round_axis is None:
            raise EngineError(
                f"{mechanism.name}: pairs.{pair.name}.profiles.{link}: expressions are "
                f'written for circles and great circles, not "{profile.kind}"; use '
                'NumPy\'s simulate(engine="numpy") or rates.field.evaluate instead'
            )


def _about(curve: Curve) -> Floats:
    """Return, in the axes of a circle's moving frame, a frame about its centre."""
    k = float(curve.at(np.zeros(1)).curvature[0])
    centre = np.array([0.0, 1.0, k]) / np.hypot(1.0, k)
    return frame_from(centre, np.array([1.0, 0.0, 0.0]))


def _circle(curve: Curve) -> tuple[Floats, float]:
    """Return the frame at s = 0 about a circle's centre, and its angle per arc length.

    The moving frame A of a curve of constant curvature k turns about n + k p, which is
    fixed (from its derivative): A(s) = A(0) U Z(s sqrt(1 + k^2)) U^T.
    """
    start = curve.at(np.zeros(1))
    return start.frame[0] @ _about(curve), float(np.hypot(1.0, start.curvature[0]))
