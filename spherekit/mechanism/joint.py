"""Joints: the kinematics of each kind of pair.

An R pair has one variable, the angle about its axis. A rolling contact has one, the arc
length along both profiles. A sliding contact has two, the arc length along each profile.

A profile is a curve on the unit sphere. Its moving frame has the columns tangent t, normal
n and point p. With the geodesic curvature k, the derivatives with respect to the arc length
s are

    dp/ds = t,    dt/ds = k n - p,    dn/ds = -k t.
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
from spherekit.geometry.vectors import all_finite, cross

PairType = Literal["R", "Cr", "Cs"]
Ends = tuple[float, float]
Links = tuple[str, str]
Numbers = tuple[float, ...]

MAX_TEETH = 10_000
"""Largest denominator of a ratio of two wheels that counts as a ratio of whole numbers.

Larger: more pairs of wheels have a finite period, which can be very long. Smaller: wheels
with many teeth never return to the same configuration.
"""

TOOTH_RATIO_TOLERANCE = 1e-12
"""Largest relative difference of a ratio of lengths from a ratio of whole numbers.

Larger: wheels of irrational ratio can get a finite period. Smaller: rounding errors of the
lengths hide the ratio of the numbers of teeth.
"""


class PairStates(NamedTuple):
    """Frames and curvatures of pairs (joints), at n samples of their variables.

    Attributes
    ----------
    first, second
        (n, pairs, 3, 3) the frame of each pair, in the axes of its first and of its second
        link. The columns are unit vectors. At a contact, they are the tangent, the normal
        and the contact point. At an R pair (hinge), the last column is the axis.
    curvatures
        (n, pairs, 2) geodesic curvatures of the profiles (contact curves) of both links at
        the contact. Zero for R pairs.
    curvature_rates
        (n, pairs, 2) derivatives of the curvatures with respect to the arc length of their
        profile.
    inside
        (n, pairs) whether the contact point is on both profiles, not beyond their ends.
    """

    first: Floats
    second: Floats
    curvatures: Floats
    curvature_rates: Floats
    inside: Bools

    @staticmethod
    def blank(n: int, pairs: int) -> "PairStates":
        """Return states of n samples without profiles. Their frames are not set yet."""
        return PairStates(
            np.empty((n, pairs, 3, 3)),
            np.empty((n, pairs, 3, 3)),
            np.zeros((n, pairs, 2)),
            np.zeros((n, pairs, 2)),
            np.ones((n, pairs), dtype=bool),
        )

    def select_pairs(self, pairs: slice | list[int]) -> "PairStates":
        """Return the states of some of the pairs."""
        return PairStates._make(array[:, pairs] for array in self)

    def assign_pairs(self, pairs: slice | list[int], states: "PairStates") -> None:
        """Replace the states of some of the pairs, in place."""
        for array, new_values in zip(self, states, strict=True):
            array[:, pairs] = new_values


class ContactProfile(NamedTuple):
    """A profile (contact curve) of one link, and where the contact point is on it.

    The arc length (rad) of the contact point is the variable plus `start`.

    Attributes
    ----------
    curve
        The profile, in the axes of its link.
    variable
        Index of the variable among the variables of the joint.
    start
        Arc length (rad) at which the variable is zero.
    """

    curve: Curve
    variable: int
    start: float


class Joint(ABC):
    """A pair (joint) with its geometry, base class of all kinds of pairs.

    With the frames A_first and A_second (3, 3) of the pair in its two links, which depend
    on its variables, the orientations of the links are related by

        R_second = R_first A_first A_second^T,

    where R_link is the rotation from link axes to ground axes.

    The class and static methods evaluate m joints of one kind at n samples at once. Values
    have the shape (n, m, variables), frames (n, m, 3, 3) and curvatures (n, m, 2).
    """

    description: ClassVar[str]
    """Name of the kind of pair in messages."""
    variable_count: ClassVar[int]
    """Number of variables, which is the number of relative degrees of freedom, 1 or 2."""
    has_axis: ClassVar[bool]
    """Whether the variable is the angle about an axis that is fixed in both links.

    Only such pairs can be driven, and have torques and joint limits.
    """
    pole_line: ClassVar[str | None]
    """The line of the pair that is the pole of its two links: "axis" or "contact line".

    None if the pole depends on the motion, as in a sliding contact.
    """
    axis_column: ClassVar[int]
    """Column of the frame that holds the axis, the contact line, or the common tangent.

    Zero is the first column.
    """

    @staticmethod
    @abstractmethod
    def variable_names(pair: str, links: Links) -> list[str]:
        """Return the names of the variables of a pair with this name and these links."""

    @staticmethod
    @abstractmethod
    def variable_meanings(pair: str, links: Links) -> list[str]:
        """Return what each variable of a pair measures, in words for users."""

    @property
    @abstractmethod
    def periods(self) -> Numbers:
        """Period of each variable (rad), after which the pair returns to the same state.

        Infinite if it never does.
        """

    @property
    @abstractmethod
    def start_ranges(self) -> tuple[Ends, ...]:
        """The range (rad) of each variable from which random start values are drawn."""

    @property
    def contact_profiles(self) -> tuple[ContactProfile, ...]:
        """The profiles of both links. Empty for an R pair."""
        return ()

    @property
    def closed_lengths(self) -> Numbers:
        """Lengths (rad) of the closed profiles (contact curves) of a rolling contact.

        The variable is the rolled arc length. If it grows by the length of a closed
        profile, the wheel with this profile has rolled once around. Other joints have no
        such lengths.
        """
        return ()

    @property
    def rolling_variables(self) -> tuple[int, ...]:
        """Indices of the variables that count how far two profiles have rolled."""
        return ()

    @classmethod
    def evaluate_states(cls, joints: Sequence[Self], values: Floats) -> PairStates:
        """Return the frames and curvatures of m pairs of one kind at n samples.

        A contact is between two profiles (curves), one on each link. The states have the
        geodesic curvatures of both profiles and the derivatives of the curvatures with
        respect to arc length. `inside` tells whether the contact point is between the ends
        of both profiles.

        Parameters
        ----------
        joints
            The m contacts, all of this class.
        values
            (n, m, variables) the variables of each contact, rad. A variable that is not
            finite is replaced by a number. The states of this contact in that sample must
            not be used.
        """
        states = PairStates.blank(len(values), len(joints))
        frames = (states.first, states.second)
        finite_values = values if all_finite(values) else np.nan_to_num(values)
        for number, joint in enumerate(joints):
            # The profile of the first link is side 0, that of the second side 1. The frame
            # of the contact in each link has the columns tangent, normal and point.
            for side, profile in enumerate(joint.contact_profiles):
                # On each profile, the arc length of the contact point is a variable of the
                # joint plus a constant.
                variable_values = finite_values[:, number, profile.variable]
                arc_lengths = variable_values + profile.start
                point = profile.curve.evaluate(arc_lengths)
                frames[side][:, number] = point.frame
                states.curvatures[:, number, side] = point.curvature
                states.curvature_rates[:, number, side] = point.curvature_rate
                states.inside[:, number] &= point.inside
        return states

    @staticmethod
    @abstractmethod
    def velocity_vectors(frames: Floats, curvatures: Floats) -> Floats:
        """Return the velocity vector (n, m, variables, 3) of each variable.

        This is the angular velocity of the second link relative to the first per unit rate
        of the variable.

        Parameters
        ----------
        frames
            (n, m, 3, 3) frames of the pairs in any common axes, such as ground axes. The
            vectors are in the same axes.
        curvatures
            (n, m, 2) geodesic curvatures of the contact profiles (curves) of both links.
        """

    @staticmethod
    @abstractmethod
    def vector_rates(
        frames: Floats, states: PairStates, first_w: Floats, second_w: Floats
    ) -> Floats:
        """Return the time derivatives (n, m, variables, 3) of the velocity vectors.

        Each class of pairs (joints) implements this method for m pairs of its kind in n
        configurations. The velocity vector of a variable is the angular velocity of the
        second link relative to the first, per unit rate of the variable. This vector turns
        with the links. At a contact, the curvatures of the profiles also change the vector.

        Parameters
        ----------
        frames
            (n, m, 3, 3) frames of the pairs in any common axes, such as ground axes. The
            derivatives are in the same axes. The columns of a contact are the tangent, the
            normal and the contact point. The last column of an R pair (hinge) is its axis.
        states
            States of the pairs, with the geodesic curvatures of both profiles and their
            derivatives with respect to the arc length.
        first_w, second_w
            (n, m, 3) angular velocities (rad/s) of the first and the second links, in the
            same axes.
        """


@dataclass(frozen=True, eq=False)
class Revolute(Joint):
    """An R pair (hinge).

    The orientations of both links are related by R_second = R_first A_first A_second^T,
    with R from link axes to ground axes. The frames of the pair in its two links are
    A_first = first Z(v) and A_second = second. Z(v) is the rotation by the variable v (rad)
    about z.

    The axis is the third column of the frames (`axis_column`). The axis is the pole axis of
    the two links (`pole_line`), about which they turn relative to each other. Random start
    values of the variable are drawn from `start_ranges` (rad).

    Attributes
    ----------
    first, second
        (3, 3) frames of the pair in the axes of its first and its second link. The z column
        is the axis, and the x column is the zero direction of the variable.
    """

    description = "revolute"
    variable_count = 1
    has_axis = True
    pole_line = "axis"
    axis_column = 2

    first: Floats
    second: Floats

    periods = (2.0 * np.pi,)
    start_ranges = ((-np.pi, np.pi),)

    @staticmethod
    def variable_names(pair: str, links: Links) -> list[str]:
        return [f"theta_{pair}"]

    @staticmethod
    def variable_meanings(pair: str, links: Links) -> list[str]:
        return [f'angle of pair "{pair}"']

    @classmethod
    def evaluate_states(cls, joints: Sequence[Self], values: Floats) -> PairStates:
        """Return the frames of m R pairs in both of their links, at n samples.

        An R pair (hinge) has a constant frame in each link, with the axis of the pair as z
        axis. The frame in the first link is rotated about this axis by the variable v. Both
        frames then coincide in space if the loops are closed.

        Parameters
        ----------
        joints
            The m R pairs.
        values
            (n, m, 1) variables v of the pairs, rad.
        """
        states = PairStates.blank(len(values), len(joints))
        # x, y and axis (m, 3) are the columns of the constant frames in the first links.
        (x, y, axis), second = _stacked_frames(tuple(joints))
        c = np.cos(values)
        s = np.sin(values)
        states.first[..., 0] = c * x + s * y
        states.first[..., 1] = c * y - s * x
        states.first[..., 2] = axis
        states.second[:] = second
        return states

    @staticmethod
    def velocity_vectors(frames: Floats, curvatures: Floats) -> Floats:
        """Return the axis of each R pair (n, m, 1, 3), in the axes of `frames`."""
        return frames[:, :, None, :, 2]

    @staticmethod
    def vector_rates(
        frames: Floats, states: PairStates, first_w: Floats, second_w: Floats
    ) -> Floats:
        """Return the time derivative (n, m, 1, 3) of the axis of m R pairs at n samples.

        The axis is the velocity vector of an R pair (hinge): the relative angular velocity
        per unit rate. The axis turns with the first link, which has the angular velocity
        `first_w` (n, m, 3).
        """
        return cross(first_w, frames[..., 2])[:, :, None]


@dataclass(frozen=True, eq=False)
class Sliding(Joint):
    """A sliding contact of two profiles, whose tangents agree at the contact point.

    A profile is a curve on the unit sphere, fixed in a link. The variables are the arc
    lengths of the contact point along both profiles. The frame of the pair (joint) in each
    link has the tangent, the normal and the contact point as columns. The links are placed
    so that both frames coincide.

    Attributes
    ----------
    first, second
        Profiles of the first and the second link, each in the axes of its link.
    """

    description = "sliding contact"
    variable_count = 2
    has_axis = False
    pole_line = None
    axis_column = 0

    first: Curve
    second: Curve

    @staticmethod
    def variable_names(pair: str, links: Links) -> list[str]:
        return [f"s_{pair}_{link}" for link in links]

    @staticmethod
    def variable_meanings(pair: str, links: Links) -> list[str]:
        return [
            f'arc length (on the unit sphere) along the profile of link "{link}", from its '
            f'start to the contact point of pair "{pair}"'
            for link in links
        ]

    @cached_property
    def contact_profiles(self) -> tuple[ContactProfile, ...]:
        return ContactProfile(self.first, 0, 0.0), ContactProfile(self.second, 1, 0.0)

    @property
    def periods(self) -> Numbers:
        curves = (self.first, self.second)
        return tuple(curve.length if curve.closed else np.inf for curve in curves)

    @property
    def start_ranges(self) -> tuple[Ends, ...]:
        return (0.0, self.first.length), (0.0, self.second.length)

    @staticmethod
    def velocity_vectors(frames: Floats, curvatures: Floats) -> Floats:
        """Return the velocity vectors n + k1 p and -(n + k2 p) of both arc lengths.

        Two profiles (curves on the sphere) slide on each other; the variables are the arc
        lengths of the contact point along both. A velocity vector is the angular velocity
        of the second link relative to the first per unit rate of a variable. n is the
        normal and p the contact point, in the columns 1 and 2 of `frames`. k1 and k2 are
        the geodesic curvatures of the profiles.
        """
        normal, point = frames[..., 1], frames[..., 2]
        k1, k2 = curvatures[..., :1], curvatures[..., 1:]
        return np.stack([normal + k1 * point, -(normal + k2 * point)], axis=2)

    @staticmethod
    def vector_rates(
        frames: Floats, states: PairStates, first_w: Floats, second_w: Floats
    ) -> Floats:
        """Return the time derivatives of both velocity vectors of sliding contacts.

        The variables s1 and s2 are the arc lengths of the contact point p along the
        profiles (curves) of both links. The profiles have the common normal n and the
        geodesic curvatures k1 and k2. A velocity vector is the angular velocity of the
        second link relative to the first per unit rate of a variable. Primes denote time
        derivatives.

        1. The frame of tangent, normal and point moves along both profiles. The frame
           rotates relative to the first link with the angular velocity s1' (n + k1 p), and
           relative to the second link with s2' (n + k2 p). So the second link rotates
           relative to the first with w = s1' (n + k1 p) - s2' (n + k2 p). The velocity
           vectors are n + k1 p and -(n + k2 p).
        2. The scalar products of w with n and p give the rates
           s1' = (w . p - k2 w . n) / (k1 - k2) and s2' = (w . p - k1 w . n) / (k1 - k2).
        3. Along a profile dn/ds + k dp/ds = 0. A vector n + k p therefore changes only by
           the rotation of its link and by the change of the curvature, dk/ds s' p.

        Parameters
        ----------
        frames
            (samples, pairs, 3, 3) frames of the contacts, with the columns tangent, normal
            and contact point.
        states
            The geodesic curvatures of both profiles, and their derivatives with respect to
            arc length.
        first_w, second_w
            (samples, pairs, 3) angular velocities (rad/s) of the first and second links.

        Returns
        -------
        (samples, pairs, 2, 3) rates, axis 2 for both vectors.
        """
        normal, point = frames[..., 1], frames[..., 2]
        k1, k2 = states.curvatures[..., :1], states.curvatures[..., 1:]
        dk1, dk2 = states.curvature_rates[..., :1], states.curvature_rates[..., 1:]
        relative = second_w - first_w
        w_along_point = np.sum(relative * point, axis=-1, keepdims=True)
        w_along_normal = np.sum(relative * normal, axis=-1, keepdims=True)
        ds1 = (w_along_point - k2 * w_along_normal) / (k1 - k2)
        ds2 = (w_along_point - k1 * w_along_normal) / (k1 - k2)
        first_rate = cross(first_w, normal + k1 * point) + ds1 * dk1 * point
        second_rate = -cross(second_w, normal + k2 * point) - ds2 * dk2 * point
        return np.stack([first_rate, second_rate], axis=2)


@dataclass(frozen=True, eq=False)
class Rolling(Joint):
    """A rolling contact of two profiles, whose tangents agree at the contact point.

    A profile is a curve on the unit sphere, fixed in a link. The single variable is the
    rolled length: the arc length from `start`, equal along both profiles. A rolling contact
    is therefore a sliding contact in which both arc lengths change at the same rate.

    Attributes
    ----------
    first, second
        Profiles of the first and the second link, each in the axes of its link.
    start
        Arc lengths (rad) along both profiles at which the variable is zero.
    """

    description = "rolling contact"
    variable_count = 1
    has_axis = False
    pole_line = "contact line"
    axis_column = 2

    first: Curve
    second: Curve
    start: Ends

    rolling_variables = (0,)

    @staticmethod
    def variable_names(pair: str, links: Links) -> list[str]:
        return [f"s_{pair}"]

    @staticmethod
    def variable_meanings(pair: str, links: Links) -> list[str]:
        return [
            f'arc length (on the unit sphere) by which links "{links[0]}" and "{links[1]}" '
            f'have rolled on each other at pair "{pair}"'
        ]

    @cached_property
    def contact_profiles(self) -> tuple[ContactProfile, ...]:
        first_start, second_start = self.start
        return (
            ContactProfile(self.first, 0, first_start),
            ContactProfile(self.second, 0, second_start),
        )

    @property
    def closed_lengths(self) -> Numbers:
        return tuple(curve.length for curve in (self.first, self.second) if curve.closed)

    @property
    def periods(self) -> Numbers:
        """The rolled length (rad) after which both wheels are back, or infinity.

        After this length, both wheels have made whole numbers of revolutions. Such a length
        exists if the ratio of the circumferences is a ratio of numbers of teeth.
        """
        if len(self.closed_lengths) == 2:
            ratio = self.first.length / self.second.length
            tooth_ratio = Fraction(ratio).limit_denominator(MAX_TEETH)
            if abs(float(tooth_ratio) / ratio - 1.0) < TOOTH_RATIO_TOLERANCE:
                return (self.first.length * tooth_ratio.denominator,)
        return (np.inf,)

    @property
    def start_ranges(self) -> tuple[Ends, ...]:
        # As long as the longer profile.
        half = 0.5 * max(self.first.length, self.second.length)
        return ((-half, half),)

    @staticmethod
    def velocity_vectors(frames: Floats, curvatures: Floats) -> Floats:
        """Return the velocity vector (k1 - k2) p of m rolling contacts at n samples.

        This vector is the angular velocity of the second link relative to the first per
        unit rate of the rolled length. p is the contact point, and k1 and k2 are the
        geodesic curvatures of the profiles.
        """
        # The last column of a frame is the contact point.
        return ((curvatures[..., :1] - curvatures[..., 1:]) * frames[..., 2])[:, :, None]

    @staticmethod
    def vector_rates(
        frames: Floats, states: PairStates, first_w: Floats, second_w: Floats
    ) -> Floats:
        """Return the time derivative of the velocity vector of a rolling contact.

        A velocity vector is the relative angular velocity of the links per unit rate of a
        variable. In rolling, both arc lengths of a sliding contact grow at the same rate.
        The velocity vector is therefore the sum of both vectors of sliding.
        """
        sliding_rates = Sliding.vector_rates(frames, states, first_w, second_w)
        return np.sum(sliding_rates, axis=2, keepdims=True)


# The joints of a mechanism are evaluated again for every block of samples (samples that are
# computed together).
@lru_cache(maxsize=512)
def _stacked_frames(joints: tuple[Revolute, ...]) -> tuple[Floats, Floats]:
    """Return the constant frames of m R pairs as arrays.

    A frame has the axis of the pair as z column. The first array (3, m, 3) has the columns
    x, y, z of the frames in the axes of the first links. The second array (m, 3, 3) has the
    frames in the axes of the second links.
    """
    first = np.array([joint.first for joint in joints])
    columns = np.ascontiguousarray(np.moveaxis(first, 2, 0))
    return columns, np.array([joint.second for joint in joints])


Kind = type[Joint]
JOINT_KINDS: Mapping[str, Kind] = MappingProxyType(
    {"R": Revolute, "Cr": Rolling, "Cs": Sliding}
)
"""The joint classes by the letters of the pair type in files."""


def revolute(joint: Joint) -> Revolute:
    """Return the same joint after checking that it is an R pair.

    Raises
    ------
    ModelError
        If it is a contact.
    """
    if not isinstance(joint, Revolute):
        raise ModelError(
            f"a {joint.description} has no axis that is fixed in both its links"
        )
    return joint


def revolutes(joints: Iterable[Joint]) -> list[Revolute]:
    """Return the joints that are R pairs, in order."""
    return [joint for joint in joints if isinstance(joint, Revolute)]
