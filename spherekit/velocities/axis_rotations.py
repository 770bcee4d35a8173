"""Pairs as chains of turns about axes fixed in links.

An R pair is one turn. A profile that is a circle is run along by turning about its
centre, so a contact of two circles is two turns. The variables of such pairs move links
about axes that are fixed in one link each, and their rates need no curvature. Of other
profiles the moving frame and the curvature are columns that are handed in.

Profiles other than circles for terms: columns that are handed in with the variables.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from spherekit.arrays import Array, Floats
from spherekit.errors import EngineError
from spherekit.geometry.profile_series import ProfileSeries
from spherekit.geometry.rotation import transpose
from spherekit.geometry.triangle import frame_from
from spherekit.mechanism.elements import Pair
from spherekit.mechanism.joint import Track, revolute
from spherekit.mechanism.joint_frames import joints_of
from spherekit.mechanism.mechanism import Mechanism
from spherekit.positions.pair_states import contact_tracks, numbered
from spherekit.symbolic.expression_graph import (
    WITHOUT_EXPRESSIONS,
    Expr,
    ExpressionNode,
    symbols,
)
from spherekit.symbolic.frame_expressions import DesignGeometry, cross, revolute_frames
from spherekit.symbolic.vector_algebra import Exprs, vector

PARTS = ("tx", "ty", "tz", "px", "py", "pz", "k", "dk")
"""The tangent, the point, the curvature and its derivative by the arc length."""
LAST = "d2k"
"""The second derivative of the curvature, where derivatives of all columns are wanted."""


def with_columns(
    values: Array, profiles: Sequence["ProfileSide"], base: Floats | None = None
) -> Array:
    """Return variables (variables, n) with the columns of profiles below them.

    Near variables `base` by the derivatives of the columns there.
    """
    if not profiles:
        return values
    count, n = values.shape
    made = np.empty((count + len(PARTS) * len(profiles), n), dtype=values.dtype)
    made[:count] = values
    columns = made[count:].reshape(len(profiles), len(PARTS), n)
    for profile, rows in zip(profiles, columns, strict=True):
        _, at, start = profile.track
        place = (values if base is None else base)[at]
        rows[:] = profile.series.at(place + start)
        if base is not None:
            rows += profile.series.slopes(place + start) * (values[at] - place)
    return made


Entries = Floats | Exprs
"""Numbers, or terms of the sizes of a design."""


@dataclass(frozen=True)
class AxisRotation:
    """A turn about z by scale * variable + offset (rad)."""

    variable: int
    scale: float = 1.0
    offset: float = 0.0


Turn = AxisRotation | Exprs
"""A turn, or a rotation (3, 3) of terms: the frame of a profile which is no circle."""


@dataclass(frozen=True)
class JointTransform:
    """R_second = R_first C_0 Z_1 C_1 ... Z_k C_k: constant rotations between turns."""

    constants: tuple[Entries, ...]
    turns: tuple[Turn, ...]

    def reversed(self) -> "JointTransform":
        """Return the chain from the second link to the first."""
        return JointTransform(
            tuple(frame.T for frame in reversed(self.constants)),
            tuple(
                AxisRotation(turn.variable, -turn.scale, -turn.offset)
                if isinstance(turn, AxisRotation)
                else turn.T
                for turn in reversed(self.turns)
            ),
        )


@dataclass(frozen=True)
class ProfileSide:
    """A profile of a contact: the `chain` from its link to its moving frame there.

    `curvature` and `slope`, its derivative by the arc length, are numbers of circles. Of
    others the `terms` of `PARTS` are handed in, these two among them, and `last`, by which
    the last of these changes.
    """

    track: Track
    chain: JointTransform
    curvature: Expr
    slope: Expr
    terms: tuple[ExpressionNode, ...] = ()
    last: Expr = 0.0

    @cached_property
    def series(self) -> ProfileSeries:
        """What rows read the terms from."""
        return ProfileSeries.of(self.track.curve)

    @property
    def along(self) -> list[Expr]:
        """The derivatives of the terms by the arc length."""
        tangent, normal, point = _frame(self.terms).T
        return [*(normal * self.curvature - point), *tangent, self.slope, self.last]


@dataclass(frozen=True)
class TurningPairs:
    """The pairs of a mechanism: `chains[pair]`.

    `sides[pair]` are the profiles of a contact; the angle of an R pair that follows from
    those of the inputs is their sum times `followers[pair]`, but for the last of these,
    which is added.
    """

    chains: tuple[JointTransform, ...]
    sides: dict[int, tuple[ProfileSide, ProfileSide]]
    followers: Mapping[int, Sequence[Expr]] = field(default_factory=dict)

    def axes(self, pair: int) -> tuple[Entries, Entries]:
        """Return the axis (3,) of an R pair in the axes of its first and second link."""
        chain = self.chains[pair]
        return chain.constants[0][:, 2], chain.constants[-1][2]

    @property
    def handed_in(self) -> tuple[ProfileSide, ...]:
        """The profiles of which terms are handed in, in their order."""
        return tuple(side for both in self.sides.values() for side in both if side.terms)


def turning_pairs(
    mechanism: Mechanism,
    design: DesignGeometry | None = None,
    any_profile: bool = False,
    as_columns: bool = False,
) -> TurningPairs:
    """Return the pairs of a mechanism as turns, their sizes those of a design if given.

    With `any_profile`, what profiles other than circles are is handed in as columns; with
    `as_columns` what all profiles are.

    Raises
    ------
    EngineError
        If a profile is neither a circle nor a great circle, where it has to be.
    """
    frames = revolute_frames(mechanism, design) if design else {}
    joints = joints_of(mechanism)
    chains: list[JointTransform] = []
    tracks = dict(contact_tracks(joints))
    sides: dict[int, tuple[ProfileSide, ProfileSide]] = {}
    for number, at, joint in numbered(joints):
        if number in tracks:
            pair = mechanism.pairs[number]
            one_side, other_side = (
                _side(mechanism, pair, place, track, any_profile, as_columns)
                for place, track in enumerate(tracks[number])
            )
            sides[number] = one_side, other_side
            near, far = one_side.chain, other_side.chain.reversed()
            (first, after), (before, last) = near.constants, far.constants
            turns = (*near.turns, *far.turns)
            chains.append(JointTransform((first, after @ before, last), turns))
        else:
            hinge, name = revolute(joint), mechanism.pairs[number].name
            one, other = frames.get(name, (hinge.first, hinge.second))
            chains.append(JointTransform((one, other.T), (AxisRotation(at),)))
    return TurningPairs(tuple(chains), sides)


def _side(
    mechanism: Mechanism,
    pair: Pair,
    place: int,
    track: Track,
    any_profile: bool,
    as_column: bool,
) -> ProfileSide:
    profile, link = (pair.profiles or ())[place], pair.links[place]
    if as_column or profile.round_axis is None:
        if not (as_column or any_profile):
            raise EngineError(
                f"{mechanism.name}: pairs.{pair.name}.profiles.{link}: expressions are "
                f'written for circles and great circles, not "{profile.kind}"',
                WITHOUT_EXPRESSIONS,
            )
        *terms, last = symbols(
            [f"profile_{pair.name}_{link}_{part}" for part in (*PARTS, LAST)]
        )
        chain = JointTransform((np.eye(3), np.eye(3)), (_frame(terms),))
        return ProfileSide(track, chain, terms[6], terms[7], tuple(terms), last)
    # The moving frame A of a curve of constant curvature k turns about n + k p, which is
    # fixed (from its derivative): A(s) = A(0) U Z(s sqrt(1 + k^2)) U^T.
    start = track.curve.at(np.zeros(1))
    k = float(start.curvature[0])
    size = float(np.hypot(1.0, k))
    centre = frame_from(np.array([0.0, 1.0, k]) / size, np.array([1.0, 0.0, 0.0]))
    turn = AxisRotation(track.variable, size, size * track.start)
    chain = JointTransform((start.frame[0] @ centre, transpose(centre)), (turn,))
    return ProfileSide(track, chain, k, 0.0)


def _frame(terms: Sequence[Expr]) -> Exprs:
    """Return (3, 3) the tangent, the normal and the point of a profile, in link axes."""
    tangent, point = vector(terms[:3]), vector(terms[3:6])
    return np.stack([tangent, cross(point, tangent), point], axis=1)
