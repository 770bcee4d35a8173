"""Points, tangents and curvatures of contact profiles, and their size derivatives.

These numbers are the *columns* of a profile. A profile has nine columns at a point: the
tangent (3), the point (3), the geodesic curvature, and the first and second derivative of
the curvature with respect to arc length. Kernels, which evaluate many designs at once, take
the columns as arguments if profiles are not circles. The columns are differentiated with
respect to numbers of the mechanism file.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

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
"""Steps of difference quotients for a number of the file, in the unit of the number.

They are tried in this order until the file allows all numbers of a quotient.
"""

DEVIATING_PROFILE_GAP_RAD = 0.2
"""Largest gap (rad) between the profiles of a contact in a deviating reference pose.

The contact is then where the profiles are nearest to each other. Larger: designs far from
that of the file are allowed. Smaller: large deviations have no mechanism.
"""

_KEYS_OF_R_PAIRS = frozenset({"axes", "phase"})
"""Keys of contacts whose values name R pairs on which the profiles or the start depend."""

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
    """The contact profiles of a design, with derivatives with respect to design variables.

    A profile is the curve on a link that touches the curve of another link.

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
        """Return numbers that describe all contact profiles at n configurations.

        The result is (9 * profiles, n). The nine numbers (columns) of a profile are its
        tangent (3), point (3), geodesic curvature and the first two derivatives of the
        curvature with respect to arc length, at the point of contact. `values` (n,
        variables) are the pair variables (rad), some of which are arc lengths on profiles.
        """
        return evaluate_profile_columns(self.profiles, values)

    def interpolate_to(self, deviations: Floats) -> ProfileColumns:
        """Return a function for the profiles of designs that lie between two designs.

        A profile is the curve along which a link touches another link. The second design is
        called a draw here. In a tolerance analysis, a draw differs from this design by
        random deviations. The sizes change step by step from this design to the draw, which
        gives a path of designs. At each step, Newton's method computes the configuration of
        the next design on the path, and needs the profiles of this design.

        Parameters
        ----------
        deviations
            (variables, draws) deviations of the design variables, in the units of the file.

        Returns
        -------
        A function of pair variables, indices of paths, and positions on these paths (0 at
        this design, 1 at the draw). It returns the geometry of the profiles at their
        contact points, see `ProfilesTowardsDraws.evaluate_columns`.
        """
        profiles_of_draws = [
            self._deviating_profiles(self.values + deviation) for deviation in deviations.T
        ]
        return ProfilesTowardsDraws(self.profiles, profiles_of_draws).evaluate_columns

    def _deviating_profiles(self, values: Floats) -> list[ContactProfile] | None:
        """Return the profiles of a design (variables,), or None if it is impossible."""
        try:
            mechanism = make_design(self.document, self.variables, values)
            return make_contact_profiles(mechanism, DEVIATING_PROFILE_GAP_RAD)
        except SpherekitError:
            return None

    def differentiate_columns(self, values: Floats) -> Floats:
        """Return how the contact profiles change with each design variable.

        A profile is the curve along which a link touches another link. Eight numbers
        (columns) describe it at the point of contact: the tangent (3), the point (3), the
        geodesic curvature and its derivative with respect to arc length.

        The arc length of the point of contact is a pair variable plus a constant, the start
        of the profile. The start is 0 if the contact slides. If the contact rolls and the
        file has a reference pose (known configuration), the pair variable is the length
        rolled from this pose, and the start is the arc length of the contact point in this
        pose. A design variable that changes one of both profiles then changes the start,
        too. If the contact rolls and the file has no such pose, the file states the start.
        For two wheels it can state the angles of their shafts instead (the key ``phase``),
        from which the start follows. Then sizes that move the axes of the wheels change
        the start, too.

        Parameters
        ----------
        values
            (n, pair variables) pair variables (rad), which do not change with the design.

        Returns
        -------
        (design variables, 8 * profiles, n) derivatives of the columns with respect to the
        design variables in the units of the file. Each profile has 8 successive columns.

        Raises
        ------
        DesignError
            If the file does not allow another value of a variable.
        """
        # (profiles, 8, n)
        arc_length_derivatives = _differentiate_by_arc_length(self.evaluate_columns(values))
        # (design variables, profiles, 8, n)
        derivatives = np.zeros((len(self.variables), *arc_length_derivatives.shape))
        # For each design variable, `curve_derivatives` has a function for the index of each
        # profile that changes. The function of the arc length returns the derivatives of
        # the columns with respect to the design variable.
        for k, curve_derivatives in enumerate(self._curve_derivatives):
            # 1. The curve changes, at a fixed arc length.
            for index, curve_derivative in curve_derivatives.items():
                profile = self.profiles[index]
                arc_lengths = values[:, profile.variable] + profile.start
                derivatives[k, index] = curve_derivative(arc_lengths)
            # 2. The start of the profile moves, and the arc length changes with it. The
            # rate of the start is the derivative of the start with respect to the design
            # variable.
            if isinstance(self.mechanism.geometry, PoseGeometry):
                start_rates = self._start_rates_in_pose(curve_derivatives)
            else:
                start_rates = self._start_rates_without_pose(k)
            for index, start_rate in start_rates.items():
                derivatives[k, index] += start_rate * arc_length_derivatives[index]
        # Join the axes of profiles and of their columns.
        variable_count, profile_count, column_count, n = derivatives.shape
        return derivatives.reshape(variable_count, profile_count * column_count, n)

    def _start_rates_in_pose(
        self, curve_derivatives: Mapping[int, CurveDerivative]
    ) -> dict[int, float]:
        """Return how the starts of rolling profiles change with a design variable.

        A profile is the curve along which a link touches another link. Its start is the arc
        length of the contact point where the pair variable is 0. Here the file states a
        reference pose, and the pair variable is the length rolled from this pose. So the
        start is the arc length of the point at which the two profiles touch in this pose.
        This point moves if one of the two profiles changes.

        Parameters
        ----------
        curve_derivatives
            For the index of each profile that changes with the design variable, the
            derivative of the profile.

        Returns
        -------
        For the index of a profile, the derivative of the start (rad) with respect to the
        design variable. Profiles whose start does not change are left out.
        """
        rates: dict[int, float] = {}
        # The two profiles of a contact have successive indices.
        for index in self._rolling_contacts:
            next_index = index + 1
            profiles = self.profiles[index], self.profiles[next_index]
            derivatives = curve_derivatives.get(index), curve_derivatives.get(next_index)
            if any(derivatives):
                start_rates = _nearest_point_rates(profiles, derivatives)
                rates |= zip((index, next_index), start_rates, strict=True)
        return rates

    @property
    def _rolling_contacts(self) -> list[int]:
        """Indices of the first profiles of all rolling contacts."""
        # The two profiles of a rolling contact are neighbours in the list, and have the
        # same pair variable.
        return [
            index
            for index, (profile, next_profile) in enumerate(pairwise(self.profiles))
            if profile.variable == next_profile.variable
        ]

    def _start_rates_without_pose(self, k: int) -> dict[int, float]:
        """Return how the starts of rolling profiles change with design variable k.

        A profile is the curve along which a link touches another link. Its start is the arc
        length of the contact point where the pair variable is 0. Here the file has no
        reference pose. It states the start, or the angles of the shafts of two wheels (the
        key ``phase``) from which the start follows.

        The start s may jump by a circumference between two designs, but the point p of the
        profile at the start does not jump. Therefore p is differentiated by comparing
        designs. It changes with the design variable v because the curve changes, and
        because the start moves along the unit tangent t of the curve:

            dp/dv = (partial p/partial v at constant s) + t ds/dv.

        The scalar product of this equation with t gives the result ds/dv.

        Returns
        -------
        For the index of a profile, the derivative of the start (rad) with respect to the
        design variable.
        """
        slopes = self._number_slopes[k]
        if slopes is None:
            return {}
        # `slopes` are the derivatives of the numbers of `_all_profile_numbers`. These end
        # with the points (3 each) at the starts of all profiles.
        point_slopes = slopes[-3 * len(self.profiles) :].reshape(-1, 3)
        rates: dict[int, float] = {}
        for first_index in self._rolling_contacts:
            for index in (first_index, first_index + 1):
                frame = _contact_frame(self.profiles[index])
                point_rate = point_slopes[index]
                curve_derivative = self._curve_derivatives[k].get(index)
                # The change of the curve at constant arc length. Of its columns, 3 to 5 are
                # the point.
                if curve_derivative is not None:
                    columns = curve_derivative(np.array([frame.arc_length]))
                    point_rate = point_rate - columns[3:6, 0]
                rates[index] = float(frame.tangent @ point_rate)
        return rates

    @cached_property
    def _number_slopes(self) -> list[Floats | None]:
        """For each design variable, the derivatives of the numbers of all profiles.

        A profile is a contact curve, which numbers such as a radius define. The derivatives
        of the curves follow from those of these numbers. The order of the numbers is that
        of `_all_profile_numbers`. The item is None for a variable that changes no profile.

        Raises
        ------
        DesignError
            If the file does not allow another value of a variable.
        """
        return [
            self._differentiate_numbers(k)
            if _can_change_profiles(self.document, variable)
            else None
            for k, variable in enumerate(self.variables)
        ]

    @cached_property
    def _curve_derivatives(self) -> list[dict[int, CurveDerivative]]:
        """For each design variable, the derivatives of the profile curves that it changes.

        An item of the list maps the index of a profile to the derivative of its curve.

        Raises
        ------
        DesignError
            If the file does not allow another value of a variable.
        """
        return [
            {} if slopes is None else self._differentiate_curves(slopes)
            for slopes in self._number_slopes
        ]

    def _differentiate_curves(self, slopes: Floats) -> dict[int, CurveDerivative]:
        """Return the derivatives of all contact profiles with respect to a design variable.

        A profile is a curve that is defined by numbers, such as the radius of a circle.
        Derivatives of these numbers give the derivative of the curve by the chain rule.

        Parameters
        ----------
        slopes
            Derivatives of the numbers of all profiles, one profile after another.

        Returns
        -------
        For the index of each profile that changes, the derivative of the profile.
        """
        curve_derivatives: dict[int, CurveDerivative] = {}
        start = 0
        for index, directed_profile in enumerate(list_profiles(self.mechanism)):
            profile = directed_profile.profile
            end = start + len(profile_numbers(profile))
            slopes_of_profile = slopes[start:end]
            start = end
            if np.any(slopes_of_profile):
                # The arc length of a curve may be counted against the direction in which
                # the mechanism file describes the curve.
                curve_derivatives[index] = differentiate_profile(
                    profile, directed_profile.runs_backwards, slopes_of_profile
                )
        return curve_derivatives

    def _differentiate_numbers(self, k: int) -> Floats:
        """Return derivatives of the numbers of profiles with respect to design variable k.

        A profile is a contact curve, which numbers such as a radius define. From the
        derivatives of the numbers, `_differentiate_curves` derives those of the curves.

        The derivatives are difference quotients. For these, the variable is changed by one
        of `PROFILE_DIFFERENCE_STEPS`, and the mechanism file with the changed variable is
        read again.

        Raises
        ------
        DesignError
            If the file does not allow another value of the variable.
        """
        slopes = differentiate_by_variable(
            self._all_profile_numbers, self.values, k, PROFILE_DIFFERENCE_STEPS
        )
        if slopes is None:
            raise DesignError(
                f"{self.document.name}: {self.variables[k].key} cannot be varied alone, "
                "because the file allows no other value of it while all other numbers "
                "stay; vary a number that can change on its own"
            )
        return slopes

    def _all_profile_numbers(self, values: Floats) -> Floats:
        """Return the numbers that define all contact profiles of a design, in one array.

        The array is differentiated by comparing designs. A profile is a contact curve.
        Examples of its numbers are a radius or coefficients. The start of a profile is the
        arc length at which the variable of a rolling contact is 0. With a reference pose,
        the derivative of the start follows from those of the profiles. Without one, the
        array also has the point of each profile at its start (3 numbers, in link axes).

        Parameters
        ----------
        values
            (variables,) values of the design variables, in the units of the file.

        Raises
        ------
        SpherekitError
            If the design is impossible.
        """
        mechanism = make_design(self.document, self.variables, values)
        numbers = [profile_numbers(item.profile) for item in list_profiles(mechanism)]
        if not isinstance(mechanism.geometry, PoseGeometry):
            profiles = make_contact_profiles(mechanism)
            numbers += [_contact_frame(profile).point for profile in profiles]
        return np.concatenate(numbers)


def make_contact_profiles(
    mechanism: Mechanism, max_gap: float = PROFILE_GAP_RAD
) -> list[ContactProfile]:
    """Return the profiles (curves) of all contacts, two for each contact.

    A profile is the curve along which a link touches another link. The profiles are in the
    order of the contact pairs, and of the two links of each pair.

    Parameters
    ----------
    mechanism
        The mechanism with the contacts.
    max_gap
        Largest gap (rad) between the profiles of a contact in the reference pose. A larger
        gap is an error.
    """
    joints = make_joints(mechanism, max_gap)
    return [
        profile for _, profiles in iterate_contact_profiles(joints) for profile in profiles
    ]


def _can_change_profiles(document: Document, variable: DesignVariable) -> bool:
    """Return whether a design variable can change contact profiles (touching curves).

    Derivatives of the curves are computed only for these variables. Masses, loads and
    directions of outputs do not change the curves. Angles of links and pairs change them
    only if a contact refers to R pairs: by the axes of gears or cones, by the axis of a
    roller, or by the angles of shafts at which wheels mesh (the key ``phase``).
    """
    # `path[0]` is the table of the file in which the number is. `ACTIONS` are the tables of
    # masses and loads.
    table = variable.path[0]
    if table == "outputs" or table in ACTIONS:
        return False
    # Numbers that are not angles of links, pairs or outputs are numbers of contacts.
    if not variable.is_angle:
        return True
    for pair in document.data["pairs"].values():
        has_gears_cones_or_phase = not _KEYS_OF_R_PAIRS.isdisjoint(pair)
        has_roller_about_axis = "axis" in pair.get("follower", {})
        if has_gears_cones_or_phase or has_roller_about_axis:
            return True
    return False


@dataclass(frozen=True)
class ProfilesTowardsDraws:
    """The contact profiles between a nominal design and the draws of a tolerance analysis.

    A draw is a design with random deviations. Configurations of a draw are computed along a
    path: the sizes change step by step from the nominal design to the draw. Several paths
    can lead to the same draw: path k leads to draw k modulo the number of draws.

    Attributes
    ----------
    nominal
        Profiles of the nominal design.
    draws
        Profiles of each draw, None for an impossible design.
    """

    nominal: Sequence[ContactProfile]
    draws: Sequence[Sequence[ContactProfile] | None]

    def evaluate_columns(
        self, values: Floats, paths: Indices, parameters: Floats
    ) -> Floats:
        """Return the geometry of contact profiles at points of paths between designs.

        A draw is a design with random deviations from the nominal design. A path leads from
        a configuration of the nominal design to one of a draw, and the design changes along
        it. Newton's method closes the loops at points of the path, and needs the profiles
        there. Nine numbers describe a profile at the point of contact. The numbers of both
        designs are computed at the same pair variables and interpolated. So no profiles of
        designs in between have to be computed.

        Parameters
        ----------
        values
            (variables, m) pair variables (rad) of the points.
        paths
            (m,) index of the path of each point.
        parameters
            (m,) path parameter of each point: 0 at the nominal design, 1 at the draw.

        Returns
        -------
        (9 * profiles, m) numbers: for each profile the tangent (3), the point (3), the
        geodesic curvature and its first two derivatives with respect to arc length. The
        numbers are NaN if the draw is an impossible design. The second derivative is not
        needed for closing the loops, and is always NaN.
        """
        # `columns` are the nine numbers of each profile. Here they are rows of the array.
        # Paths start at several configurations of the nominal design. From each of them,
        # one path leads to each draw, in the order of the draws.
        draws_of_points = paths % len(self.draws)
        columns = self._columns_of_draws(values, draws_of_points)
        # At path parameter 1 the columns are the columns of the draw.
        inner_points = np.flatnonzero(parameters < 1.0)
        if len(inner_points):
            nominal_columns = evaluate_profile_columns(
                self.nominal, values[:, inner_points].T, with_second_derivative=False
            )
            columns[:, inner_points] = _interpolate_columns(
                nominal_columns, columns[:, inner_points], parameters[inner_points]
            )
        return columns

    def _columns_of_draws(self, values: Floats, draws: Indices) -> Floats:
        """Return the numbers that describe the contact profiles of draws, at m points.

        A draw is a design with random deviations from the nominal design. Nine numbers
        describe a profile at the point of contact: the tangent (3), the point (3) on the
        unit sphere, the geodesic curvature, and the first two derivatives of the curvature
        with respect to arc length. They are called columns, but each is a row of the array
        here.

        Parameters
        ----------
        values
            (variables, m) pair variables (rad) of the points.
        draws
            (m,) index of the draw of each point.

        Returns
        -------
        (9 * profiles, m) numbers, NaN for impossible designs. The ninth number of each
        profile is always NaN, because closing the loops of links does not need it.
        """
        columns = nans((COLUMN_COUNT * len(self.nominal), len(draws)))
        for draw, points in _points_by_draw(draws).items():
            profiles = self.draws[draw]
            # None: the design is impossible.
            if profiles is not None:
                columns[:, points] = evaluate_profile_columns(
                    profiles, values[:, points].T, with_second_derivative=False
                )
        return columns


def _points_by_draw(draws: Indices) -> dict[int, Indices]:
    """Return the indices of the points of each draw; `draws` has the draw of each point."""
    if not len(draws):
        return {}
    points_sorted_by_draw = np.argsort(draws, kind="stable")
    different_draws, starts = np.unique(draws[points_sorted_by_draw], return_index=True)
    points_of_draws = np.split(points_sorted_by_draw, starts[1:])
    return dict(zip(different_draws.tolist(), points_of_draws, strict=True))


class DirectedProfile(NamedTuple):
    """A contact profile (curve), and the direction in which its arc length is counted.

    Attributes
    ----------
    profile
        The curve as the file describes it.
    runs_backwards
        Whether the arc length is counted against the direction in which the file describes
        the curve. At a contact, both arc lengths must increase in the same direction along
        the common tangent. In the file, the body of a link is on the left of its curve. In
        an external contact the two bodies are on opposite sides of the tangent, so the file
        describes the two curves in opposite directions. The second curve therefore runs
        backwards. In an internal contact no curve does.
    """

    profile: Profile
    runs_backwards: bool


def list_profiles(mechanism: Mechanism) -> list[DirectedProfile]:
    """Return the profiles of all contacts, in the order of `make_contact_profiles`."""
    return [
        DirectedProfile(profile, side == 1 and pair.contact == "external")
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
    """Return the derivative of a contact profile with respect to a design variable.

    A profile is the curve along which a link touches another link.

    Parameters
    ----------
    profile
        The curve: a circle, a Fourier series, or a spline through points.
    runs_backwards
        Whether the arc length runs against the direction in which the file describes the
        curve.
    slopes
        Derivatives of the numbers that define the curve, with respect to the variable. For
        a spline these are all points (3 each). For other curves these are the centre (3),
        and the radius or the coefficients.

    Returns
    -------
    A function of arc lengths (n,) that returns (8, n) derivatives with respect to the
    variable: of the tangent (3), the point (3), the curvature k, and dk/ds with the arc
    length s.
    """
    if profile.points:
        return differentiate_spline(
            profile.points,
            change=slopes.reshape(-1, 3),
            closed=profile.closed,
            backwards=runs_backwards,
        )
    # All other curves are Fourier series: the angle from the centre as a function of the
    # azimuth. Each argument is a value and its derivative.
    centre = (np.array(profile.centre), slopes[:3])
    # `round_axis` is the axis of a circle. Other curves have none.
    is_circle = profile.round_axis is not None
    if is_circle:
        # A circle has one constant coefficient, its radius. Without a radius in the file
        # the circle is a great circle, and its radius cannot vary.
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
    """Return the derivatives of columns of contact profiles with respect to arc length.

    The nine columns of a profile are the tangent t (3), the point p (3), the geodesic
    curvature k, and the first two derivatives of k. On the unit sphere dt/ds = k (p x t) -
    p and dp/ds = t. The last column cannot be differentiated, so eight columns remain.

    The caller needs them if a design variable moves the start of a profile, so that the
    contact is at another arc length.

    Parameters
    ----------
    columns
        (9 * profiles, n) columns at n points of contact. Each row of the array is one
        column. The nine columns of a profile follow one another.

    Returns
    -------
    (profiles, 8, n) derivatives of the first eight columns.
    """
    profile_count = len(columns) // COLUMN_COUNT
    columns = columns.reshape(profile_count, COLUMN_COUNT, columns.shape[1])
    tangent, point, curvature, curvature_derivatives = np.split(columns, [3, 6, 7], axis=1)
    tangent_derivative = curvature * np.cross(point, tangent, axis=1) - point
    return np.concatenate([tangent_derivative, tangent, curvature_derivatives], axis=1)


def _nearest_point_rates(
    profiles: tuple[ContactProfile, ContactProfile],
    derivatives: tuple[CurveDerivative | None, CurveDerivative | None],
) -> Floats:
    """Return how the contact point moves along two profiles as a design variable changes.

    At each point of a profile there is a frame: tangent, normal, and the point on the unit
    sphere. At the contact in the reference pose, the frames of both profiles coincide. As
    the variable v changes, both frames rotate. With the arc lengths s1 and s2 of the
    contact, and the rotation vectors r per unit of s1, s2 and v, the two rotations are

        r1_s ds1/dv + r1_v    and    r2_s ds2/dv + r2_v.

    The rates ds1/dv and ds2/dv are chosen such that the two rotations differ as little as
    possible, by least squares.

    Parameters
    ----------
    profiles
        The two profiles (curves) of a contact. `start` of each profile is the arc length at
        the contact.
    derivatives
        Derivatives of the profiles with respect to the variable, None for a profile that
        does not change.

    Returns
    -------
    (2,) derivatives ds1/dv and ds2/dv of the arc lengths (rad) with respect to the
    variable.
    """
    # In the reference pose the axes of both links coincide, so no rotation is needed
    # between them.
    frames = [_contact_frame(profile) for profile in profiles]
    r1_s, r2_s = [frame.rotation_by_arc_length() for frame in frames]
    r1_v, r2_v = [
        np.zeros(3) if derivative is None else frame.rotation_by_variable(derivative)
        for frame, derivative in zip(frames, derivatives, strict=True)
    ]
    # Both rotations are set equal, with the unknown rates on the left side. So there are
    # three equations for two unknowns.
    unknown_factors = np.stack([r1_s, -r2_s], axis=1)
    right_side = -(r1_v - r2_v)
    rates, *_ = np.linalg.lstsq(unknown_factors, right_side, rcond=None)
    return np.asarray(rates, dtype=float)


@dataclass(frozen=True)
class ContactFrame:
    """The moving frame of a profile at the point of contact, on the unit sphere.

    Attributes
    ----------
    arc_length
        Arc length (rad) of the point.
    tangent, normal, point
        (3,) unit vectors of the right-handed frame, in the axes of the link of the profile.
    curvature
        Geodesic curvature of the profile at the point.
    """

    arc_length: float
    tangent: Floats
    normal: Floats
    point: Floats
    curvature: float

    def rotation_by_arc_length(self) -> Floats:
        """Return the rotation vector (3,) of the frame per unit of the curve's arc length.

        The frame moves along a curve on the unit sphere. Its axes are the tangent, the
        normal and the point itself. The frame rotates about the normal as the point moves
        along the curve, and about the point because of the geodesic curvature.
        """
        return self.normal + self.curvature * self.point

    def rotation_by_variable(self, derivative: CurveDerivative) -> Floats:
        """Return how the frame of a contact profile rotates as a design variable changes.

        The frame consists of tangent, normal and point of the curve on the unit sphere. The
        result is its rotation vector (3,) per unit of the variable.

        Parameters
        ----------
        derivative
            Derivative of the profile with respect to the variable, at a constant arc
            length.
        """
        # Derivatives of the tangent (3), of the point (3) and of the curvature.
        change = derivative(np.array([self.arc_length]))[:, 0]
        tangent_change = change[:3]
        point_change = change[3:6]
        # The rotation vector r = r_t t + r_n n + r_p p (tangent t, normal n, point p) gives
        # the changes
        #     dp = r x p = r_n t - r_t n,
        #     dt = r x t = r_p n - r_n p.
        # Each component of r is therefore a scalar product of a change and an axis.
        about_tangent = -point_change @ self.normal
        about_normal = point_change @ self.tangent
        about_point = tangent_change @ self.normal
        return (
            about_tangent * self.tangent
            + about_normal * self.normal
            + about_point * self.point
        )


def _contact_frame(profile: ContactProfile) -> ContactFrame:
    """Return the moving frame of a profile where the variable of the contact is 0."""
    curve_point = profile.curve.evaluate(np.array([profile.start]))
    tangent, normal, point = curve_point.frame[0].T
    curvature = curve_point.curvature[0]
    return ContactFrame(profile.start, tangent, normal, point, curvature)


def evaluate_profile_columns(
    profiles: Sequence[ContactProfile],
    values: Floats,
    with_second_derivative: bool = True,
) -> Floats:
    """Return the numbers that describe contact profiles at some configurations.

    A profile is the curve along which a link touches another link. Nine numbers describe it
    at the point of contact: the tangent (3), the point (3) on the unit sphere, the geodesic
    curvature, and the first two derivatives of the curvature with respect to arc length.
    They are called the columns of the profile, although each is a row of the result.

    Parameters
    ----------
    profiles
        The profiles of all contacts. The arc length of the contact point is a pair variable
        plus `start`.
    values
        (n, variables) pair variables (rad).
    with_second_derivative
        Whether the second derivative of the curvature is computed; otherwise it is NaN.

    Returns
    -------
    (9 * profiles, n) numbers: nine rows for each profile, with one entry for each
    configuration. Vectors are in the axes of the link of the profile. NaN if variables are
    NaN, or if the arc length is outside an open profile.
    """
    columns = nans((COLUMN_COUNT * len(profiles), len(values)))
    finite_rows = np.flatnonzero(all_finite(values, 1))
    for k, profile in enumerate(profiles):
        arc_lengths = values[finite_rows, profile.variable] + profile.start
        curve_points = profile.curve.evaluate(arc_lengths)
        profile_columns = nans((COLUMN_COUNT, len(finite_rows)))
        # The columns of the matrix `frame` are tangent, normal and point.
        profile_columns[:3] = curve_points.frame[:, :, 0].T
        profile_columns[3:6] = curve_points.frame[:, :, 2].T
        profile_columns[6] = curve_points.curvature
        profile_columns[7] = curve_points.curvature_rate
        if with_second_derivative:
            profile_columns[8] = profile.curve.curvature_second(arc_lengths)
        profile_columns[:, ~curve_points.inside] = np.nan
        columns[COLUMN_COUNT * k : COLUMN_COUNT * (k + 1), finite_rows] = profile_columns
    return columns


def _interpolate_columns(start: Floats, end: Floats, fractions: Floats) -> Floats:
    """Interpolate the numbers that describe contact profiles between two designs.

    A path leads from one design to the other. The interpolation avoids computing the
    profiles of all designs in between.

    Nine numbers describe a profile at a point of contact: the tangent (3), the point (3) on
    the unit sphere, the geodesic curvature, and the first two derivatives of the curvature
    with respect to arc length. They are called columns, but each is a row of the arrays
    here. All are interpolated linearly. Afterwards point and tangent are corrected to
    orthogonal unit vectors.

    Parameters
    ----------
    start, end
        (9 * profiles, n) numbers of the first and of the second design, at the contact
        points of n configurations.
    fractions
        (n,) 0 for `start`, 1 for `end`, and numbers in between.

    Returns
    -------
    (9 * profiles, n) interpolated numbers.
    """
    columns = start + fractions * (end - start)
    for k in range(0, len(columns), COLUMN_COUNT):
        # These are views (3, n), so the following lines change `columns`.
        tangent = columns[k : k + 3]
        point = columns[k + 3 : k + 6]
        point /= np.linalg.norm(point, axis=0)
        tangent -= np.sum(tangent * point, axis=0) * point
        tangent /= np.linalg.norm(tangent, axis=0)
    return columns
