"""What profiles are where contacts touch them, by any number of the file."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from itertools import pairwise

import numpy as np

from spherekit.arrays import Floats, Indices
from spherekit.designs.design_variables import ACTIONS, DesignVariable, designed, slope_by
from spherekit.designs.homotopy import Profiles
from spherekit.errors import DesignError, SpherekitError
from spherekit.files.toml_document import Document
from spherekit.geometry.curve_variation import (
    CurveDerivative,
    differentiate_fourier,
    differentiate_spline,
)
from spherekit.geometry.vectors import all_finite, nans
from spherekit.mechanism.elements import PoseGeometry, Profile
from spherekit.mechanism.joint import ContactProfile
from spherekit.mechanism.joint_construction import PROFILE_GAP_RAD, make_joints
from spherekit.mechanism.mechanism import Mechanism
from spherekit.positions.pair_states import iterate_contact_profiles

STEPS = 2.0 ** -np.array([5.0, 9.0, 13.0])
"""Differences of numbers of the file that are tried until all of them are allowed."""
APART = 0.2
"""Profiles of a reference pose that deviations take off each other by less (rad) touch
where they are nearest."""


def has_other_profiles(mechanism: Mechanism) -> bool:
    """Return whether a profile is no circle: then what profiles are is handed in."""
    return any(
        profile.round_axis is None
        for pair in mechanism.pairs
        for profile in pair.profiles or ()
    )


class ProfileNumbers:
    """The columns of all profiles of a mechanism, and their derivatives by its numbers.

    Columns (9, n) of a profile are its tangent, its point, the curvature and the first and
    second derivative of that by the arc length, at a place that its pair variable says.
    """

    def __init__(
        self,
        document: Document,
        variables: Sequence[DesignVariable],
        values: Floats,
        mechanism: Mechanism | None = None,
    ) -> None:
        """Take them at numbers (variables,) of the file; `mechanism` is that, if known.

        Raises
        ------
        FileError, ModelError
            If there is no such mechanism.
        """
        self.document, self.variables, self.values = document, variables, values
        self.mechanism = mechanism or designed(document, variables, values)
        self.tracks = tracks_of(self.mechanism)

    def columns(self, values: Floats) -> Floats:
        """Return the columns (9 profiles, n) at pair variables (n, w)."""
        return columns_of(self.tracks, values)

    def towards(self, deviations: Floats) -> Profiles:
        """Return the profiles on the ways to deviating designs (variables, draws).

        Draw by draw at each row. On the way they are between those at its ends.
        """
        drawn = [self._tracks(self.values + deviation) for deviation in deviations.T]

        def profiles(now: Floats, rows: Indices, ahead: Floats) -> Floats:
            there = nans((9 * len(self.tracks), len(rows)))
            draws = rows % len(drawn)
            order = np.argsort(draws, kind="stable")
            for some in np.split(order, np.flatnonzero(np.diff(draws[order])) + 1):
                tracks = drawn[draws[some[0]]] if len(some) else None
                if tracks is not None:
                    there[:, some] = columns_of(tracks, now[:, some].T, last=False)
            some = np.flatnonzero(ahead < 1.0)
            if len(some):
                nominal = columns_of(self.tracks, now[:, some].T, last=False)
                there[:, some] = _between(nominal, there[:, some], ahead[some])
            return there

        return profiles

    def _tracks(self, values: Floats) -> list[ContactProfile] | None:
        """Return the profiles of a design (variables,), None if there is no such design."""
        try:
            return tracks_of(designed(self.document, self.variables, values), APART)
        except SpherekitError:
            return None

    def slopes(self, values: Floats) -> Floats:
        """Return the derivatives (variables, 8 profiles, n) of all but the last columns.

        The pair variables (n, w) held.

        Raises
        ------
        DesignError
            If the mechanism does not allow other values of a variable.
        """
        made = np.zeros((len(self.variables), len(self.tracks), 8, len(values)))
        along = _along(self.columns(values))
        for k, curves in enumerate(self._varied):
            for place, curve in curves.items():
                track = self.tracks[place]
                made[k, place] = curve(values[:, track.variable] + track.start)
            for place, moved in self._starts(curves).items():
                made[k, place] += moved * along[place]
        return np.concatenate(np.moveaxis(made, 1, 0), axis=1)

    def _starts(self, curves: Mapping[int, CurveDerivative]) -> dict[int, float]:
        """Return how the starts of profiles move that roll from a reference pose."""
        made: dict[int, float] = {}
        for first, second in pairwise(range(len(self.tracks))):
            both = self.tracks[first], self.tracks[second]
            changed = curves.get(first), curves.get(second)
            rolling = both[0].variable == both[1].variable and any(changed)
            if rolling and isinstance(self.mechanism.geometry, PoseGeometry):
                made |= zip((first, second), _nearest(both, changed), strict=True)
        return made

    @cached_property
    def _varied(self) -> list[dict[int, CurveDerivative]]:
        """Return for each variable the profiles that change with it, by their numbers."""
        profiles = profiles_of(self.mechanism)
        ends = np.cumsum([len(numbers_of(profile)) for profile, _ in profiles])
        made: list[dict[int, CurveDerivative]] = []
        for k, variable in enumerate(self.variables):
            made.append({})
            if variable.slot is not None or variable.path[0] in ACTIONS:
                continue
            changes = slope_by(self._numbers, self.values, k, STEPS)
            if changes is None:
                raise DesignError(
                    f"{self.document.name}: the file allows no other {variable.key}; vary "
                    "a number that may change on its own"
                )
            for place, change in enumerate(np.split(changes, ends[:-1])):
                if np.any(change):
                    made[-1][place] = varied(*profiles[place], change)
        return made

    def _numbers(self, values: Floats) -> Floats:
        """Return the numbers of all profiles of a design; raise if there is none."""
        made = designed(self.document, self.variables, values)
        return np.concatenate([numbers_of(profile) for profile, _ in profiles_of(made)])


def tracks_of(mechanism: Mechanism, apart: float = PROFILE_GAP_RAD) -> list[ContactProfile]:
    """Return the profiles of all contacts.

    They have the order of `PairRotations.sides_with_columns`.
    """
    joints = make_joints(mechanism, apart)
    return [track for _, tracks in iterate_contact_profiles(joints) for track in tracks]


def profiles_of(mechanism: Mechanism) -> list[tuple[Profile, bool]]:
    """Return the profiles in the order of `tracks_of`, and which run backwards."""
    return [
        (profile, side == 1 and pair.contact == "external")
        for pair in mechanism.pairs
        for side, profile in enumerate(pair.profiles or ())
    ]


def numbers_of(profile: Profile) -> Floats:
    """Return what a profile is made from: centre, radius, points, cosines and sines."""
    radius = () if profile.radius is None else (profile.radius,)
    points = np.ravel(profile.points)
    return np.concatenate(
        [profile.centre or (), radius, points, profile.cosines, profile.sines]
    )


def varied(profile: Profile, backwards: bool, change: Floats) -> CurveDerivative:
    """Return a profile with its derivatives, `change` being that of its numbers."""
    if profile.points:
        return differentiate_spline(
            profile.points, change.reshape(-1, 3), profile.closed, backwards
        )
    centre = np.array(profile.centre), change[:3]
    if profile.round_axis is not None:
        radius = 0.5 * np.pi
        longer = 0.0
        if profile.radius is not None:
            radius = profile.radius
            longer = change[3]
        return differentiate_fourier(centre, ([radius], [longer]), backwards=backwards)
    cosines, sines = np.split(change[3:], [len(profile.cosines)])
    return differentiate_fourier(
        centre, (profile.cosines, cosines), (profile.sines, sines), backwards
    )


def _along(columns: Floats) -> Floats:
    """Return how columns change along profiles, (profiles, 8, n), from columns of these."""
    columns = columns.reshape(-1, 9, columns.shape[1])
    tangent, point, curvature, rates = np.split(columns, [3, 6, 7], axis=1)
    return np.concatenate(
        [curvature * np.cross(point, tangent, axis=1) - point, tangent, rates], axis=1
    )


def _nearest(
    tracks: tuple[ContactProfile, ContactProfile],
    curves: tuple[CurveDerivative | None, CurveDerivative | None],
) -> Floats:
    """Return how the places (2,) move where two profiles are nearest, as these change.

    By least squares, from how far their frames turn from each other.
    """
    columns = []
    turned = np.zeros(3)
    for track, curve, sign in zip(tracks, curves, (1.0, -1.0), strict=True):
        start = np.array([track.start])
        there = track.curve.evaluate(start)
        tangent, normal, point = there.frame[0].T
        columns.append(sign * (normal + there.curvature[0] * point))
        if curve is not None:
            change = curve(start)[:, 0]
            leaning = -change[3:6] @ normal
            running = change[3:6] @ tangent
            swinging = change[:3] @ normal
            turned += sign * (leaning * tangent + running * normal + swinging * point)
    return np.linalg.lstsq(np.stack(columns, axis=1), -turned, rcond=None)[0]


def columns_of(
    tracks: Sequence[ContactProfile], values: Floats, last: bool = True
) -> Floats:
    """Return the columns (9 profiles, n) of profiles at pair variables (n, w).

    With the `last` of each, or NaN there; NaN where variables are.
    """
    made = nans((9 * len(tracks), len(values)))
    finite = np.flatnonzero(all_finite(values, 1))
    for k, track in enumerate(tracks):
        arcs = values[finite, track.variable] + track.start
        there = track.curve.evaluate(arcs)
        column = nans((9, len(finite)))
        column[:3], column[3:6] = there.frame[:, :, 0].T, there.frame[:, :, 2].T
        column[6], column[7] = there.curvature, there.curvature_rate
        if last:
            column[8] = track.curve.curvature_second(arcs)
        column[:, ~there.inside] = np.nan
        made[9 * k : 9 * k + 9, finite] = column
    return made


def _between(one: Floats, other: Floats, part: Floats) -> Floats:
    """Return columns (9 profiles, n) at parts (n,) between two: frames stay frames."""
    made = one + part * (other - one)
    for k in range(0, len(made), 9):
        tangent = made[k : k + 3]
        point = made[k + 3 : k + 6]
        point /= np.linalg.norm(point, axis=0)
        tangent -= np.sum(tangent * point, axis=0) * point
        tangent /= np.linalg.norm(tangent, axis=0)
    return made
