"""Points, frames and curvatures of contact profiles, and their derivatives by a file.

Kernels of designs whose profiles are not circles take the *columns* of all profiles as
arguments. Each profile has nine of them at a point: the tangent (3), the point (3), the
geodesic curvature, and its first and second derivative by the arc length.
"""

from collections.abc import Mapping, Sequence
from functools import cached_property
from itertools import pairwise

import numpy as np

from spherekit.arrays import Floats, Indices
from spherekit.designs.design_variables import (
    ACTIONS,
    DesignVariable,
    differentiate_by_variable,
    make_design,
)
from spherekit.designs.homotopy import ProfileColumns
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

PROFILE_DIFFERENCE_STEPS = 2.0 ** -np.array([5.0, 9.0, 13.0])
"""Steps of difference quotients by a number of the file, in its unit.

They are tried in this order until the file allows all numbers of a quotient.
"""

DEVIATING_PROFILE_GAP_RAD = 0.2
"""Largest gap (rad) between the profiles of a contact in a deviating reference pose.

The contact is then where the profiles are nearest to each other. Larger: designs far from
that of the file are allowed. Smaller: large deviations have no mechanism.
"""

COLUMN_COUNT = 9
"""Number of columns of a profile: tangent, point, and curvature with two derivatives."""


def has_shaped_profiles(mechanism: Mechanism) -> bool:
    """Return whether a profile of a mechanism is not a circle."""
    return any(
        profile.round_axis is None
        for pair in mechanism.pairs
        for profile in pair.profiles or ()
    )


class DesignProfiles:
    """The profiles of all contacts of a design, and their derivatives by its variables.

    Parameters
    ----------
    document
        The mechanism file whose numbers are varied.
    variables
        The numbers that are varied.
    values
        (variables,) their values in this design, in the units of the file.
    mechanism
        The mechanism of the design, if it is known.

    Attributes
    ----------
    profiles
        The profiles of all contacts, see `make_contact_profiles`.

    Raises
    ------
    FileError, ModelError
        If there is no such mechanism.
    """

    def __init__(
        self,
        document: Document,
        variables: Sequence[DesignVariable],
        values: Floats,
        mechanism: Mechanism | None = None,
    ) -> None:
        """Make the mechanism of the design, if it is not given, and its profiles."""
        self.document = document
        self.variables = variables
        self.values = values
        self.mechanism = mechanism or make_design(document, variables, values)
        self.profiles = make_contact_profiles(self.mechanism)

    def evaluate_columns(self, values: Floats) -> Floats:
        """Return the columns (9 profiles, n) at pair variables (n, variables of pairs)."""
        return evaluate_profile_columns(self.profiles, values)

    def interpolate_to(self, deviations: Floats) -> ProfileColumns:
        """Return the columns of profiles on paths from this design to deviating designs.

        Path k leads to deviation k, modulo their number. On the way the columns are
        interpolated between those of both designs.

        Parameters
        ----------
        deviations
            (variables, draws) deviations of the variables, in the units of the file.

        Returns
        -------
        A function of variables (variables, m), numbers (m,) of the paths and path
        parameters (m,), 0 at this design and 1 at the deviating one.
        """
        profiles_of_draw = [
            self._deviating_profiles(self.values + deviation) for deviation in deviations.T
        ]

        def evaluate(values: Floats, paths: Indices, parameters: Floats) -> Floats:
            """Return the columns (9 profiles, m) at points of paths, see `ProfileColumns`.

            They are NaN if the deviating design is impossible.
            """
            columns = nans((COLUMN_COUNT * len(self.profiles), len(paths)))
            draws = paths % len(profiles_of_draw)
            # Rows of the same draw are evaluated together.
            order = np.argsort(draws, kind="stable")
            draw_starts = np.flatnonzero(np.diff(draws[order])) + 1
            for rows in np.split(order, draw_starts):
                profiles = profiles_of_draw[draws[rows[0]]] if len(rows) else None
                if profiles is not None:
                    columns[:, rows] = evaluate_profile_columns(
                        profiles, values[:, rows].T, with_second_derivative=False
                    )
            on_the_way = np.flatnonzero(parameters < 1.0)
            if len(on_the_way):
                nominal = evaluate_profile_columns(
                    self.profiles, values[:, on_the_way].T, with_second_derivative=False
                )
                columns[:, on_the_way] = _interpolate_columns(
                    nominal, columns[:, on_the_way], parameters[on_the_way]
                )
            return columns

        return evaluate

    def _deviating_profiles(self, values: Floats) -> list[ContactProfile] | None:
        """Return the profiles of a design (variables,), or None if it is impossible."""
        try:
            mechanism = make_design(self.document, self.variables, values)
            return make_contact_profiles(mechanism, DEVIATING_PROFILE_GAP_RAD)
        except SpherekitError:
            return None

    def differentiate_columns(self, values: Floats) -> Floats:
        """Return the derivatives of all columns but the last of each profile.

        The nine columns of a profile are the tangent (3), the point (3), the geodesic
        curvature, and its first and second derivative by the arc length.

        Parameters
        ----------
        values
            (n, variables of pairs) pair variables (rad), which are held.

        Returns
        -------
        (variables, 8 profiles, n) derivatives, by the variables in the units of the file.

        Raises
        ------
        DesignError
            If the file does not allow another value of a variable.
        """
        profile_count = len(self.profiles)
        slopes = np.zeros((len(self.variables), profile_count, 8, len(values)))
        # A variable changes the curve itself, and the arc length at which it starts.
        along_profile = _differentiate_by_arc_length(self.evaluate_columns(values))
        for k, curve_derivatives in enumerate(self._curve_derivatives):
            for index, curve_derivative in curve_derivatives.items():
                profile = self.profiles[index]
                arc_lengths = values[:, profile.variable] + profile.start
                slopes[k, index] = curve_derivative(arc_lengths)
            for index, start_rate in self._start_rates(curve_derivatives).items():
                slopes[k, index] += start_rate * along_profile[index]
        return np.concatenate(np.moveaxis(slopes, 1, 0), axis=1)

    def _start_rates(
        self, curve_derivatives: Mapping[int, CurveDerivative]
    ) -> dict[int, float]:
        """Return how the start arc lengths of rolling profiles change with a variable.

        In a reference pose, rolling profiles start where they are nearest to each other.

        Parameters
        ----------
        curve_derivatives
            The derivatives of the profiles that change, by their index.

        Returns
        -------
        The derivative of the start (rad) by the variable, by index of the profile.
        """
        if not isinstance(self.mechanism.geometry, PoseGeometry):
            return {}
        rates: dict[int, float] = {}
        for first, second in pairwise(range(len(self.profiles))):
            both_profiles = self.profiles[first], self.profiles[second]
            both_derivatives = curve_derivatives.get(first), curve_derivatives.get(second)
            # The two profiles of a rolling contact share one variable.
            is_rolling = both_profiles[0].variable == both_profiles[1].variable
            if is_rolling and any(both_derivatives):
                start_rates = _nearest_point_rates(both_profiles, both_derivatives)
                rates |= zip((first, second), start_rates, strict=True)
        return rates

    @cached_property
    def _curve_derivatives(self) -> list[dict[int, CurveDerivative]]:
        """For each variable the derivatives of the profiles that change with it, by index.

        Difference quotients give the derivatives of the numbers that define the profiles,
        from which those of the curves follow exactly.

        Raises
        ------
        DesignError
            If the file does not allow another value of a variable.
        """
        # The numbers of all profiles are in one array; `ends` are the ends of each profile.
        profiles = list_profiles(self.mechanism)
        ends = np.cumsum([len(profile_numbers(profile)) for profile, _ in profiles])
        derivatives: list[dict[int, CurveDerivative]] = []
        for k, variable in enumerate(self.variables):
            derivatives.append({})
            if variable.slot is not None or variable.path[0] in ACTIONS:
                continue  # sizes of links, masses and loads change no profile
            slopes = differentiate_by_variable(
                self._all_profile_numbers, self.values, k, PROFILE_DIFFERENCE_STEPS
            )
            if slopes is None:
                raise DesignError(
                    f"{self.document.name}: the file allows no other {variable.key}; vary "
                    "a number that may change on its own"
                )
            for index, profile_slopes in enumerate(np.split(slopes, ends[:-1])):
                if np.any(profile_slopes):
                    profile, runs_backwards = profiles[index]
                    derivatives[-1][index] = differentiate_profile(
                        profile, runs_backwards, profile_slopes
                    )
        return derivatives

    def _all_profile_numbers(self, values: Floats) -> Floats:
        """Return the numbers of all profiles of a design (variables,); raise if none."""
        mechanism = make_design(self.document, self.variables, values)
        return np.concatenate(
            [profile_numbers(profile) for profile, _ in list_profiles(mechanism)]
        )


def make_contact_profiles(
    mechanism: Mechanism, max_gap: float = PROFILE_GAP_RAD
) -> list[ContactProfile]:
    """Return the profiles of all contacts, two for each contact.

    They have the order of `PairRotations.sides_with_columns`.

    Parameters
    ----------
    mechanism
        The mechanism.
    max_gap
        Largest gap (rad) between the profiles of a contact in the reference pose.
    """
    joints = make_joints(mechanism, max_gap)
    return [
        profile for _, profiles in iterate_contact_profiles(joints) for profile in profiles
    ]


def list_profiles(mechanism: Mechanism) -> list[tuple[Profile, bool]]:
    """Return the profiles in the order of `make_contact_profiles`.

    Each is listed with whether it is run backwards, as the second profile of an external
    contact is.
    """
    return [
        (profile, side == 1 and pair.contact == "external")
        for pair in mechanism.pairs
        for side, profile in enumerate(pair.profiles or ())
    ]


def profile_numbers(profile: Profile) -> Floats:
    """Return the numbers that define a profile: centre, radius, points and series."""
    radius = () if profile.radius is None else (profile.radius,)
    points = np.ravel(profile.points)
    return np.concatenate(
        [profile.centre or (), radius, points, profile.cosines, profile.sines]
    )


def differentiate_profile(
    profile: Profile, runs_backwards: bool, slopes: Floats
) -> CurveDerivative:
    """Return the derivative of a profile by a variable.

    Parameters
    ----------
    profile
        A circle, a series, or a curve through points.
    runs_backwards
        Whether the curve is run backwards.
    slopes
        Derivatives of its `profile_numbers` by the variable: of the points, or of the
        centre (3) and then of the radius or of the coefficients.

    Returns
    -------
    A function of arc lengths (n,) that returns derivatives of the columns.
    """
    if profile.points:
        return differentiate_spline(
            profile.points,
            change=slopes.reshape(-1, 3),
            closed=profile.closed,
            backwards=runs_backwards,
        )
    # Each of the following is a value with its derivative.
    centre = np.array(profile.centre), slopes[:3]
    if profile.round_axis is not None:
        # A circle without a radius is a great circle.
        radius = 0.5 * np.pi
        radius_slope = 0.0
        if profile.radius is not None:
            radius = profile.radius
            radius_slope = slopes[3]
        return differentiate_fourier(
            centre, cosines=([radius], [radius_slope]), backwards=runs_backwards
        )
    cosine_slopes, sine_slopes = np.split(slopes[3:], [len(profile.cosines)])
    return differentiate_fourier(
        centre,
        cosines=(profile.cosines, cosine_slopes),
        sines=(profile.sines, sine_slopes),
        backwards=runs_backwards,
    )


def _differentiate_by_arc_length(columns: Floats) -> Floats:
    """Return the derivatives (profiles, 8, n) of columns (9 profiles, n) by arc length.

    On the unit sphere the tangent changes by k (p x t) - p, where p is the point, t the
    tangent and k the geodesic curvature.
    """
    columns = columns.reshape(-1, COLUMN_COUNT, columns.shape[1])
    tangent, point, curvature, curvature_derivatives = np.split(columns, [3, 6, 7], axis=1)
    tangent_derivative = curvature * np.cross(point, tangent, axis=1) - point
    return np.concatenate([tangent_derivative, tangent, curvature_derivatives], axis=1)


def _nearest_point_rates(
    profiles: tuple[ContactProfile, ContactProfile],
    derivatives: tuple[CurveDerivative | None, CurveDerivative | None],
) -> Floats:
    """Return how the arc lengths of the nearest points of two profiles change.

    The frames of both curves at these points must rotate alike. This gives three equations
    for the two arc lengths, which are solved by least squares.

    Parameters
    ----------
    profiles
        The profiles, each of which starts at its nearest point.
    derivatives
        Their derivatives by a variable, None for a profile that does not change.

    Returns
    -------
    (2,) derivatives of the arc lengths (rad) by the variable.
    """
    # The rotation of the first frame less that of the second must be zero; the signs are
    # those of the two profiles in this difference.
    rotation_by_arc_length = []
    rotation_by_variable = np.zeros(3)
    for profile, derivative, sign in zip(profiles, derivatives, (1.0, -1.0), strict=True):
        start = np.array([profile.start])
        curve_point = profile.curve.evaluate(start)
        tangent, normal, point = curve_point.frame[0].T
        # Along a curve its frame rotates about the normal and, by the curvature, about the
        # point.
        rotation = normal + curve_point.curvature[0] * point
        rotation_by_arc_length.append(sign * rotation)
        if derivative is not None:
            # The rotation of the frame with the variable, about each of its axes.
            change = derivative(start)[:, 0]
            tangent_change = change[:3]
            point_change = change[3:6]
            about_tangent = -point_change @ normal
            about_normal = point_change @ tangent
            about_point = tangent_change @ normal
            rotation_by_variable += sign * (
                about_tangent * tangent + about_normal * normal + about_point * point
            )
    matrix = np.stack(rotation_by_arc_length, axis=1)
    return np.linalg.lstsq(matrix, -rotation_by_variable, rcond=None)[0]


def evaluate_profile_columns(
    profiles: Sequence[ContactProfile],
    values: Floats,
    with_second_derivative: bool = True,
) -> Floats:
    """Return the columns of profiles at pair variables.

    Parameters
    ----------
    profiles
        The profiles of all contacts.
    values
        (n, variables) pair variables (rad).
    with_second_derivative
        Whether the last column of each profile is computed; otherwise it is NaN.

    Returns
    -------
    (9 profiles, n) columns; NaN if variables are NaN or outside an open profile. The nine
    of a profile are the tangent (3), the point (3), the geodesic curvature, and its first
    and second derivative by the arc length.
    """
    columns = nans((COLUMN_COUNT * len(profiles), len(values)))
    finite = np.flatnonzero(all_finite(values, 1))
    for k, profile in enumerate(profiles):
        arc_lengths = values[finite, profile.variable] + profile.start
        curve_points = profile.curve.evaluate(arc_lengths)
        profile_columns = nans((COLUMN_COUNT, len(finite)))
        profile_columns[:3] = curve_points.frame[:, :, 0].T
        profile_columns[3:6] = curve_points.frame[:, :, 2].T
        profile_columns[6] = curve_points.curvature
        profile_columns[7] = curve_points.curvature_rate
        if with_second_derivative:
            profile_columns[8] = profile.curve.curvature_second(arc_lengths)
        profile_columns[:, ~curve_points.inside] = np.nan
        columns[COLUMN_COUNT * k : COLUMN_COUNT * (k + 1), finite] = profile_columns
    return columns


def _interpolate_columns(start: Floats, end: Floats, fractions: Floats) -> Floats:
    """Return columns between two, with orthonormal tangents and points.

    Parameters
    ----------
    start, end
        (9 profiles, n) columns.
    fractions
        (n,) fractions of the way from 0 to 1.

    Returns
    -------
    (9 profiles, n) columns.
    """
    columns = start + fractions * (end - start)
    for k in range(0, len(columns), COLUMN_COUNT):
        tangent = columns[k : k + 3]
        point = columns[k + 3 : k + 6]
        point /= np.linalg.norm(point, axis=0)
        tangent -= np.sum(tangent * point, axis=0) * point
        tangent /= np.linalg.norm(tangent, axis=0)
    return columns
