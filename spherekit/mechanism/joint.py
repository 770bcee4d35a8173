"""The joints of pairs: all in which one kind of pair differs from another.

An R pair has one variable, the angle about its axis; a rolling contact one arc length
that runs along both profiles; a sliding contact one arc length for each profile. The
frame (tangent t, normal n, point p) of a profile with geodesic curvature k moves with its
arc length by dp/ds = t, dt/ds = k n - p, dn/ds = -k t.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property, lru_cache
from types import MappingProxyType
from typing import ClassVar, Literal, NamedTuple, Self

import numpy as np

from spherekit.arrays import Bools, Floats
from spherekit.errors import ModelError
from spherekit.geometry.profile_curve import Curve
from spherekit.geometry.rotation import all_finite, cross

PairType = Literal["R", "Cr", "Cs"]
Ends = tuple[float, float]
Links = tuple[str, str]
Numbers = tuple[float, ...]

MOST_TEETH = 10_000
"""Ratios of wheels are of whole numbers up to this, or none."""
SAME_RATIO = 1e-12
"""Ratios of two lengths that differ by less, relative, are the same."""


class PairStates(NamedTuple):
    """Pairs of n samples as their variables have them.

    `first`, `second`: (n, pairs, 3, 3) frames in the axes of the pair's two bodies, which
    coincide in space. `curvatures`, `curvature_rates`: (n, pairs, 2) of the two profiles
    and their derivatives by arc length, zero without profiles. `inside`: (n, pairs)
    whether the contact lies on both profiles.
    """

    first: Floats
    second: Floats
    curvatures: Floats
    curvature_rates: Floats
    inside: Bools

    @staticmethod
    def blank(n: int, pairs: int) -> "PairStates":
        """Return states without profiles whose frames are still to be set."""
        return PairStates(
            np.empty((n, pairs, 3, 3)),
            np.empty((n, pairs, 3, 3)),
            np.zeros((n, pairs, 2)),
            np.zeros((n, pairs, 2)),
            np.ones((n, pairs), dtype=bool),
        )

    def take(self, pairs: slice | list[int]) -> "PairStates":
        """Return the states of some of the pairs."""
        return PairStates._make(part[:, pairs] for part in self)

    def put(self, pairs: slice | list[int], part: "PairStates") -> None:
        """Replace the states of some of the pairs."""
        for mine, its in zip(self, part, strict=True):
            mine[:, pairs] = its


class Track(NamedTuple):
    """A profile of a contact, which lies on it at the variable plus `start` (rad).

    `variable` is the number of the variable, among those of the joint.
    """

    curve: Curve
    variable: int
    start: float


class Joint(ABC):
    """A pair with its geometry: R_second = R_first A_first A_second^T.

    A_first and A_second (3, 3) are the frames of the pair in its two links, which follow
    from its variables; R_link leads from link axes to ground axes. The static methods
    take m joints of one kind at n samples: values (n, m, variables), frames (n, m, 3, 3),
    curvatures (n, m, 2).
    """

    words: ClassVar[str]
    """What such a pair is called."""
    freedoms: ClassVar[int]
    """How many variables it has: the relative freedoms that it leaves, of three."""
    has_axis: ClassVar[bool]
    """Whether its variable is the angle about an axis that is fixed in both links: such a
    pair can be driven, and carry torques and joint limits."""
    pole_line: ClassVar[str | None]
    """What of it is the pole of its links; None where that is only known to lie in the
    plane of the contact."""
    axis: ClassVar[int]
    """Which column of its frame is its axis, contact line, or normal of the contact."""
    carriers: ClassVar[int]
    """How many of its links, from the first, its axis moves with."""

    @staticmethod
    @abstractmethod
    def variable_names(pair: str, links: Links) -> list[str]:
        """Return the names of the variables of a pair of this name."""

    @property
    @abstractmethod
    def periods(self) -> Numbers:
        """By how much each variable grows until all returns; infinite if it never does."""

    @property
    @abstractmethod
    def starts(self) -> tuple[Ends, ...]:
        """The range of each variable from which random starts are drawn."""

    @property
    def tracks(self) -> tuple[Track, ...]:
        """The profiles of both links, none where the pair has no contact."""
        return ()

    @property
    def laps(self) -> Numbers:
        """Lengths of wheels: a variable that grows by one counts a turn more of it."""
        return ()

    @property
    def rolled(self) -> tuple[int, ...]:
        """The variables, by number, that say how far wheels have rolled."""
        return ()

    @classmethod
    def states(cls, joints: Sequence[Self], values: Floats) -> PairStates:
        """Return the states (n, m) of joints at values (n, m, variables): of contacts."""
        made = PairStates.blank(len(values), len(joints))
        finite = values if all_finite(values) else np.nan_to_num(values)
        for k, joint in enumerate(joints):
            for side, track in enumerate(joint.tracks):
                point = track.curve.at(finite[:, k, track.variable] + track.start)
                (made.first, made.second)[side][:, k] = point.frame
                made.curvatures[:, k, side] = point.curvature
                made.curvature_rates[:, k, side] = point.curvature_rate
                made.inside[:, k] &= point.inside
        return made

    @staticmethod
    @abstractmethod
    def vectors(frames: Floats, curvatures: Floats) -> Floats:
        """Return the vectors (n, m, variables, 3) of the variables.

        A variable's vector is the angular velocity of the second link relative to the
        first per unit rate of the variable, in the axes of `frames`.
        """

    @staticmethod
    @abstractmethod
    def rates(
        frames: Floats, states: PairStates, first_w: Floats, second_w: Floats
    ) -> Floats:
        """Return how the vectors (n, m, variables, 3) change.

        `first_w`, `second_w` (n, m, 3) are angular velocities of the links in the axes of
        `frames`.
        """


@dataclass(frozen=True, eq=False)
class Revolute(Joint):
    """An R pair: its frame in both links, columns zero direction, its side, axis.

    A_first = first Z(v) with Z a rotation by the variable about z, A_second = second.
    """

    words = "revolute"
    freedoms = 1
    has_axis = True
    pole_line = "axis"
    axis = 2
    carriers = 1

    first: Floats
    second: Floats

    periods = (2.0 * np.pi,)
    starts = ((-np.pi, np.pi),)

    @staticmethod
    def variable_names(pair: str, links: Links) -> list[str]:
        return [f"theta_{pair}"]

    @classmethod
    def states(cls, joints: Sequence[Self], values: Floats) -> PairStates:
        made = PairStates.blank(len(values), len(joints))
        (x, y, axis), second = _still(tuple(joints))
        c, s = np.cos(values), np.sin(values)
        made.first[..., 0] = c * x + s * y
        made.first[..., 1] = c * y - s * x
        made.first[..., 2] = axis
        made.second[:] = second
        return made

    @staticmethod
    def vectors(frames: Floats, curvatures: Floats) -> Floats:
        return frames[:, :, None, :, 2]

    @staticmethod
    def rates(
        frames: Floats, states: PairStates, first_w: Floats, second_w: Floats
    ) -> Floats:
        return cross(first_w, frames[..., 2])[:, :, None]


@dataclass(frozen=True, eq=False)
class Sliding(Joint):
    """A sliding contact: the curves of both links, with tangents that agree.

    A_first and A_second are the moving frames of the curves, each with its own arc
    length.
    """

    words = "sliding contact"
    freedoms = 2
    has_axis = False
    pole_line = None
    axis = 0
    carriers = 2

    first: Curve
    second: Curve

    @staticmethod
    def variable_names(pair: str, links: Links) -> list[str]:
        return [f"s_{pair}_{link}" for link in links]

    @cached_property
    def tracks(self) -> tuple[Track, ...]:
        return Track(self.first, 0, 0.0), Track(self.second, 1, 0.0)

    @property
    def periods(self) -> Numbers:
        return tuple(x.length if x.closed else np.inf for x in (self.first, self.second))

    @property
    def starts(self) -> tuple[Ends, ...]:
        return (0.0, self.first.length), (0.0, self.second.length)

    @staticmethod
    def vectors(frames: Floats, curvatures: Floats) -> Floats:
        """Return n + k1 p and -(n + k2 p), with n the normal, p the point, k curvatures."""
        normal, point = frames[..., 1], frames[..., 2]
        k1, k2 = curvatures[..., :1], curvatures[..., 1:]
        return np.stack([normal + k1 * point, -(normal + k2 * point)], axis=2)

    @staticmethod
    def rates(
        frames: Floats, states: PairStates, first_w: Floats, second_w: Floats
    ) -> Floats:
        """See `Joint.rates`.

        The contact moves along the profiles at s1' = (w . p - k2 w . n) / (k1 - k2) and
        s2' = (w . p - k1 w . n) / (k1 - k2), w the relative angular velocity (derived
        from the frames' own derivatives); in rolling w . n = 0.
        """
        normal, point = frames[..., 1], frames[..., 2]
        k1, k2 = states.curvatures[..., :1], states.curvatures[..., 1:]
        dk1, dk2 = states.curvature_rates[..., :1], states.curvature_rates[..., 1:]
        relative = second_w - first_w
        along_p, along_n = (
            np.sum(relative * direction, axis=-1, keepdims=True)
            for direction in (point, normal)
        )
        s1 = (along_p - k2 * along_n) / (k1 - k2)
        s2 = (along_p - k1 * along_n) / (k1 - k2)
        vectors = [
            cross(first_w, normal + k1 * point) + s1 * dk1 * point,
            -cross(second_w, normal + k2 * point) - s2 * dk2 * point,
        ]
        return np.stack(vectors, axis=2)


@dataclass(frozen=True, eq=False)
class Rolling(Joint):
    """A rolling contact: the curves of both links, with tangents that agree.

    Both arc lengths run together from `start`: the variable moves the links as both of a
    sliding contact do together.
    """

    words = "rolling contact"
    freedoms = 1
    has_axis = False
    pole_line = "contact line"
    axis = 2
    carriers = 2

    first: Curve
    second: Curve
    start: Ends

    rolled = (0,)

    @staticmethod
    def variable_names(pair: str, links: Links) -> list[str]:
        return [f"s_{pair}"]

    @cached_property
    def tracks(self) -> tuple[Track, ...]:
        return tuple(map(Track, (self.first, self.second), (0, 0), self.start))

    @property
    def laps(self) -> Numbers:
        return tuple(curve.length for curve in (self.first, self.second) if curve.closed)

    @property
    def periods(self) -> Numbers:
        if len(self.laps) == 2:
            ratio = self.first.length / self.second.length
            whole = Fraction(ratio).limit_denominator(MOST_TEETH)
            if abs(float(whole) / ratio - 1.0) < SAME_RATIO:
                return (self.first.length * whole.denominator,)
        return (np.inf,)

    @property
    def starts(self) -> tuple[Ends, ...]:
        half = 0.5 * max(self.first.length, self.second.length)
        return ((-half, half),)

    @staticmethod
    def vectors(frames: Floats, curvatures: Floats) -> Floats:
        """Return (k1 - k2) p, with p the point and k1, k2 the curvatures."""
        return ((curvatures[..., :1] - curvatures[..., 1:]) * frames[..., 2])[:, :, None]

    @staticmethod
    def rates(
        frames: Floats, states: PairStates, first_w: Floats, second_w: Floats
    ) -> Floats:
        both = Sliding.rates(frames, states, first_w, second_w)
        return np.sum(both, axis=2, keepdims=True)


@lru_cache(maxsize=512)
def _still(joints: tuple[Revolute, ...]) -> tuple[Floats, Floats]:
    """Return columns (3, m, 3) of the frames in the first links, and frames (m, 3, 3)."""
    first = np.array([joint.first for joint in joints])
    columns = np.ascontiguousarray(np.moveaxis(first, 2, 0))
    return columns, np.array([joint.second for joint in joints])


Kind = type[Joint]
KINDS: Mapping[str, Kind] = MappingProxyType({"R": Revolute, "Cr": Rolling, "Cs": Sliding})
"""The kinds of pairs by the letters of their type."""


def revolute(joint: Joint) -> Revolute:
    """Return a joint that is an R pair.

    Raises
    ------
    ModelError
        If it is a contact.
    """
    if not isinstance(joint, Revolute):
        raise ModelError(f"a {joint.words} has no axis that is fixed in both its links")
    return joint


def revolutes(joints: Iterable[Joint]) -> list[Revolute]:
    """Return those joints that are R pairs."""
    return [joint for joint in joints if isinstance(joint, Revolute)]
