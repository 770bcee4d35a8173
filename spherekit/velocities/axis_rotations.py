"""Pairs as chains of rotations about axes that are fixed in links.

An R pair is one rotation. A contact point that moves along a circle turns about the centre
of this circle, so a contact of two circles is two rotations. The variables of such pairs
turn links about axes that are fixed in one link each, so velocities need no curvature.

The moving frame (tangent t, normal n = p x t, point p) and the curvature k of any other
profile are not written as expressions of the arc length. They are *profile columns*:
symbols whose values are computed from a series and are passed to kernels after the
variables.
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
from spherekit.mechanism.joint import ContactProfile, revolute
from spherekit.mechanism.joint_construction import make_joints
from spherekit.mechanism.mechanism import Mechanism
from spherekit.positions.pair_states import enumerate_joints, iterate_contact_profiles
from spherekit.symbolic.expression_graph import (
    ADVICE_WITHOUT_EXPRESSIONS,
    Expr,
    ExpressionNode,
    symbols,
)
from spherekit.symbolic.frame_expressions import DesignGeometry, revolute_frames
from spherekit.symbolic.vector_algebra import Exprs, cross, vector

PROFILE_COLUMNS = ("tx", "ty", "tz", "px", "py", "pz", "k", "dk")
"""Columns of a profile: t and p in link axes, k, and dk/ds with the arc length s."""

LAST_DERIVATIVE = "d2k"
"""Symbol of d2k/ds2, which appears only in derivatives of expressions with ``dk``."""

Entries = Floats | Exprs
"""Numbers, or expressions of the sizes of a design."""


@dataclass(frozen=True)
class AxisRotation:
    """A rotation about the z axis by the angle scale * variable + offset (rad).

    The chain of rotations from one link of a pair to the other consists of such rotations
    and constant ones. `variable` is the index of the pair variable in the mechanism.
    """

    variable: int
    scale: float = 1.0
    offset: float = 0.0


VariableRotation = AxisRotation | Exprs
"""A rotation about z, or a rotation matrix (3, 3) with profile columns as entries."""


@dataclass(frozen=True)
class JointTransform:
    """The rotation from the first link of a pair (joint) to the second, as a product.

    The orientation of the second link is R_second = R_first C_0 Z_1 C_1 ... Z_k C_k. The
    matrices R convert from link axes to ground axes. The factors C are the `constants` (3,
    3). The factors Z are the `rotations`, which depend on the pair variables. There is one
    more constant than rotations.
    """

    constants: tuple[Entries, ...]
    rotations: tuple[VariableRotation, ...]

    @property
    def axis_in_first_link(self) -> Entries:
        """The axis (3,) of the first rotation Z_1, in the axes of the first link.

        A pair is a chain C_0 Z_1 C_1 ... Z_k C_k of constant rotations C and rotations Z
        about z. C_0 converts from the frame in which Z_1 rotates about z to the axes of the
        first link. So the columns of C_0 are the axes of this frame.
        """
        return self.constants[0][:, 2]

    @property
    def axis_in_second_link(self) -> Entries:
        """The axis (3,) of the last rotation Z_k, in the axes of the second link.

        A pair is a chain C_0 Z_1 C_1 ... Z_k C_k of constant rotations C and rotations Z
        about z. C_k converts from the axes of the second link to the frame in which Z_k
        rotates about z. So the rows of C_k are the axes of this frame.
        """
        return self.constants[-1][2]

    def reversed(self) -> "JointTransform":
        """Return the rotation from the second link to the first."""
        inverse_constants = tuple(constant.T for constant in reversed(self.constants))
        inverse_rotations: list[VariableRotation] = []
        for rotation in reversed(self.rotations):
            if isinstance(rotation, AxisRotation):
                # A rotation about z by the angle scale * variable + offset.
                inverse_rotations.append(
                    AxisRotation(rotation.variable, -rotation.scale, -rotation.offset)
                )
            else:
                inverse_rotations.append(rotation.T)  # a rotation matrix (3, 3)
        return JointTransform(inverse_constants, tuple(inverse_rotations))


@dataclass(frozen=True)
class ProfileCircle:
    """A circular profile of a contact, about whose centre the contact point turns.

    Attributes
    ----------
    axis
        (3,) unit vector from the centre of the sphere to the centre of the circle, in the
        axes of the link that has the profile.
    angle_per_length
        Angle (rad) by which the contact point turns about this axis per unit of arc length.
    """

    axis: Entries
    angle_per_length: float


@dataclass(frozen=True)
class ProfileSide:
    """One of the two profiles of a contact, as expressions.

    A profile is the curve along which the contact point moves on one link. A contact has
    two sides: the profile on the first link and the one on the second link.

    A circle is written as a rotation about its centre. For other curves, eight numbers at
    the contact point are symbols: the tangent t (3 components), the point p (3), the
    curvature k, and dk/ds with the arc length s (`PROFILE_COLUMNS`). Their values are
    computed from a series, and passed to the compiled functions of the expressions.

    Attributes
    ----------
    track
        The curve, the variable (arc length) that runs along it, and its start.
    chain
        Rotation from the link of the profile to the moving frame (t, n, p) at the contact.
    curvature
        Curvature k of the profile: a number for a circle, otherwise a symbol.
    slope
        Derivative dk/ds of the curvature: a number for a circle, otherwise a symbol.
    contact_symbols
        The eight symbols. Empty for circles that are written as rotations.
    last_derivative
        Symbol of d2k/ds2, the derivative of the last of the `contact_symbols`; 0.0 if there
        are none.
    """

    track: ContactProfile
    chain: JointTransform
    curvature: Expr
    slope: Expr
    contact_symbols: tuple[ExpressionNode, ...] = ()
    last_derivative: Expr = 0.0

    @property
    def circle(self) -> ProfileCircle | None:
        """The circle that is written as a rotation about its centre, or None."""
        # The chain from the link to the contact frame has one rotation.
        (rotation,) = self.chain.rotations
        if not isinstance(rotation, AxisRotation):
            return None
        return ProfileCircle(self.chain.axis_in_first_link, rotation.scale)

    @cached_property
    def series(self) -> ProfileSeries:
        """The series in arc length from which the profile columns are computed."""
        return ProfileSeries.fit(self.track.curve)

    @property
    def max_curvature_second(self) -> float:
        """Bound of ``|d2k/ds2|``, from samples; 0 for a circle written as a rotation."""
        return self.series.max_curvature_second if self.contact_symbols else 0.0

    @property
    def column_derivatives(self) -> list[Expr]:
        """The derivatives of the columns with respect to the arc length, in their order.

        The profile must have columns.
        """
        tangent, normal, point = _moving_frame(self.contact_symbols).T
        # dt/ds = k n - p and dp/ds = t on the unit sphere.
        tangent_derivative = normal * self.curvature - point
        return [*tangent_derivative, *tangent, self.slope, self.last_derivative]


@dataclass(frozen=True)
class PairRotations:
    """The pairs (joints) of a mechanism as products of rotations.

    Expressions of positions and rates, which are then compiled, are built from these
    products. The entries of the rotations are numbers, or expressions if sizes of the
    mechanism are symbols.

    Attributes
    ----------
    chains
        For each pair the rotation from its first link to its second, as a product of
        constant rotations and rotations by its variables.
    sides
        For each contact of two profiles, by index of the pair: the profile of its first
        and of its second link.
    followers
        R pairs that wheels couple to the inputs, by index of the pair. The angle of such a
        pair is a linear function of the input angles. The values are one factor for each
        input, then the constant (rad).
    """

    chains: tuple[JointTransform, ...]
    sides: dict[int, tuple[ProfileSide, ProfileSide]]
    followers: Mapping[int, Sequence[Expr]] = field(default_factory=dict)

    def axes(self, pair: int) -> tuple[Entries, Entries]:
        """Return the axis (3,) of an R pair in the axes of its first and second link."""
        chain = self.chains[pair]
        return chain.axis_in_first_link, chain.axis_in_second_link

    @property
    def sides_with_symbols(self) -> tuple[ProfileSide, ...]:
        """The profiles whose geometry at the contact is passed to functions as symbols.

        A profile is the curve of a link at a contact. A circle that is written as a
        rotation about its centre needs no symbols and is not listed. For any other profile,
        the tangent, point and curvature at the contact are symbols (`contact_symbols`).

        Compiled functions take the values of these symbols as arguments after the pair
        variables, in the order of the profiles here.
        """
        return tuple(
            side
            for both_sides in self.sides.values()
            for side in both_sides
            if side.contact_symbols
        )


def append_profile_columns(
    values: Array, profiles: Sequence[ProfileSide], expansion_point: Floats | None = None
) -> Array:
    """Append the values of the profile columns to the values of the variables.

    A profile is the curve along which the contact point moves on a link. Its columns are
    the tangent and the point of the curve in link axes, its curvature and the derivative of
    the curvature, at the contact. Compiled functions need them as arguments. Each profile
    has a series in the arc length from which its columns are computed. The arc length is
    the value of a variable plus a start.

    Parameters
    ----------
    values
        (variables, n) values of the variables, of any number type.
    profiles
        The profiles that have columns.
    expansion_point
        (variables, n) float64 values near `values`, required if `values` are complex or
        have quad precision. The series accept only float64. They are evaluated at this
        point, and the columns are extrapolated linearly from there to `values`.

    Returns
    -------
    (variables + columns, n) of the number type of `values`. The columns come last.
    """
    if not profiles:
        return values
    count, n = values.shape
    column_count = len(PROFILE_COLUMNS)
    extended = np.empty((count + column_count * len(profiles), n), dtype=values.dtype)
    extended[:count] = values
    columns_by_profile = extended[count:].reshape(len(profiles), column_count, n)
    series_values = values if expansion_point is None else expansion_point
    for profile, columns in zip(profiles, columns_by_profile, strict=True):
        # `track` has the curve, the variable that runs along it, and its start.
        variable = profile.track.variable
        arc_length = series_values[variable] + profile.track.start
        columns[:] = profile.series.evaluate(arc_length)
        if expansion_point is not None:
            slopes = profile.series.evaluate_derivative(arc_length)
            columns += slopes * (values[variable] - expansion_point[variable])
    return extended


def pair_rotations(
    mechanism: Mechanism,
    design: DesignGeometry | None = None,
    any_profile: bool = False,
    as_columns: bool = False,
) -> PairRotations:
    """Return the pairs of a mechanism as chains of rotations.

    An R pair is a single rotation about its axis. At a contact, the frames (tangent,
    normal, point) of both profiles coincide, so the chain leads from the first link to this
    frame and on to the second link.

    Parameters
    ----------
    mechanism
        The mechanism.
    design
        Expressions for some of the sizes that place the axes of R pairs. By default all
        sizes are numbers.
    any_profile
        Whether profiles other than circles are allowed. The tangent, point and curvature of
        such a profile at the contact are symbols, called the columns of the profile. (The
        values of each symbol are a column of numbers.)
    as_columns
        Whether circles have such columns, and are not written as rotations.

    Raises
    ------
    EngineError
        If a profile is neither a circle nor a great circle, and both `any_profile` and
        `as_columns` are false.
    """
    design_frames = revolute_frames(mechanism, design) if design else {}
    joints = make_joints(mechanism)
    chains: list[JointTransform] = []
    # For each contact the two curves with the variables that run along them.
    tracks = dict(iterate_contact_profiles(joints))
    sides: dict[int, tuple[ProfileSide, ProfileSide]] = {}
    for number, first_variable, joint in enumerate_joints(joints):
        pair = mechanism.pairs[number]
        if number in tracks:
            first_side, second_side = (
                _profile_side(mechanism, pair, end, track, any_profile, as_columns)
                for end, track in enumerate(tracks[number])
            )
            sides[number] = first_side, second_side
            # The chain leads to the contact frame and on to the second link. Each part has
            # two constants (rotation matrices that do not depend on variables), with a
            # rotation by a variable between them. The constants next to the contact frame
            # become one.
            to_contact = first_side.chain
            from_contact = second_side.chain.reversed()
            first, before_contact = to_contact.constants
            after_contact, last = from_contact.constants
            constants = (first, before_contact @ after_contact, last)
            rotations = (*to_contact.rotations, *from_contact.rotations)
            chains.append(JointTransform(constants, rotations))
        else:
            hinge = revolute(joint)
            first_frame, second_frame = design_frames.get(
                pair.name, (hinge.first, hinge.second)
            )
            rotation = AxisRotation(first_variable)
            chains.append(JointTransform((first_frame, second_frame.T), (rotation,)))
    return PairRotations(tuple(chains), sides)


def _profile_side(
    mechanism: Mechanism,
    pair: Pair,
    end: int,
    track: ContactProfile,
    any_profile: bool,
    as_columns: bool,
) -> ProfileSide:
    """Return the profile of a contact on one of its two links, as expressions.

    A profile is the curve along which the contact point moves on the link. At the contact
    it has the moving frame (t, n, p): tangent, normal and point. A circle is written as a
    rotation about its centre. Any other profile has *columns*: the components of t and p,
    the curvature k and its derivatives are symbols, whose values are computed elsewhere.

    Parameters
    ----------
    mechanism, pair
        The mechanism and the contact.
    end
        0 for the first link of the contact, 1 for the second.
    track
        The curve, the variable that runs along it, and its start.
    any_profile
        Whether profiles other than circles are allowed.
    as_columns
        Whether circles are treated like other profiles, with symbols for their columns.

    Raises
    ------
    EngineError
        If the profile is not allowed.
    """
    profile = (pair.profiles or ())[end]
    link = pair.links[end]
    if as_columns or profile.round_axis is None:
        if not (as_columns or any_profile):
            raise EngineError(
                f"{mechanism.name}: pairs.{pair.name}.profiles.{link}: expressions are "
                f'written for circles and great circles, not "{profile.kind}"',
                ADVICE_WITHOUT_EXPRESSIONS,
            )
        *columns, last_derivative = symbols(
            [
                f"profile_{pair.name}_{link}_{column}"
                for column in (*PROFILE_COLUMNS, LAST_DERIVATIVE)
            ]
        )
        chain = JointTransform((np.eye(3), np.eye(3)), (_moving_frame(columns),))
        *_, column_curvature, column_slope = columns
        return ProfileSide(
            track,
            chain=chain,
            curvature=column_curvature,
            slope=column_slope,
            contact_symbols=tuple(columns),
            last_derivative=last_derivative,
        )
    # The moving frame A of a curve with constant curvature k turns about n + k p, which is
    # fixed in the link (by the derivatives of n and p). So
    # A(s) = A(0) U Z(s sqrt(1 + k^2)) U^T, where the third column of U is the unit vector
    # along n + k p, in the axes (t, n, p).
    start = track.curve.evaluate(np.zeros(1))
    circle_curvature = float(start.curvature[0])
    scale = float(np.hypot(1.0, circle_curvature))
    axis = np.array([0.0, 1.0, circle_curvature]) / scale
    centre_frame = frame_from(axis, np.array([1.0, 0.0, 0.0]))
    rotation = AxisRotation(track.variable, scale, scale * track.start)
    constants = start.frame[0] @ centre_frame, transpose(centre_frame)
    return ProfileSide(
        track,
        chain=JointTransform(constants, (rotation,)),
        curvature=circle_curvature,
        slope=0.0,
    )


def _moving_frame(columns: Sequence[Expr]) -> Exprs:
    """Return the matrix (3, 3) with the columns t, n and p of a profile, in link axes."""
    tangent = vector(columns[:3])
    point = vector(columns[3:6])
    return np.stack([tangent, cross(point, tangent), point], axis=1)
