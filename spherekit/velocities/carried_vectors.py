"""The vector of each pair variable as expressions, with bounds of how it changes.

The vector of a variable is the angular velocity of the second link of its pair relative to
the first, per unit rate of this variable. The vector of an R pair is its axis, which is
fixed in both links. The vector of a contact slides on the link that carries it while the
contact moves along the profile of this link.

A profile has at its contact point the unit vectors t (tangent), n = p x t (normal) and p
(point), and the curvature k. All vectors are in ground axes.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from spherekit.mechanism.mechanism import Mechanism
from spherekit.symbolic.expression_graph import Expr, ExpressionNode, function
from spherekit.symbolic.vector_algebra import Exprs, cross
from spherekit.velocities.axis_rotations import (
    Entries,
    PairRotations,
    ProfileCircle,
    ProfileSide,
)
from spherekit.velocities.pose_expressions import LinkOrientation, place_link


@dataclass(frozen=True)
class SlideChangeBound:
    """Upper bound of the length of the derivative of `CarriedVector.slide`.

    `CarriedVector` has the vector of a pair variable, which is carried by a link. The slide
    is the first derivative of this vector with respect to the variable, as seen from the
    link. So this class bounds the second derivative. The bound tells how much a small error
    of the variable changes the slide.

    The second derivative is a sum of terms, whose lengths are added. For a contact, some
    terms contain k'', the second derivative of the curvature k of a profile with respect to
    arc length. There is no expression of k'', so a bound of ``|k''|`` for the whole profile
    is used.

    Attributes
    ----------
    other_terms
        Bound of the length of the sum of all terms without a k''.
    profiles
        The profiles whose k'' occurs in a term. Each adds its bound of ``|k''|``.
    """

    other_terms: Expr = 0.0
    profiles: tuple[ProfileSide, ...] = ()

    @property
    def total(self) -> Expr:
        """The bound: `other_terms`, plus a bound of ``|k''|`` for each of `profiles`."""
        return self.other_terms + sum(
            profile.max_curvature_second for profile in self.profiles
        )


@dataclass(frozen=True)
class CarriedVector:
    """The vector of a pair variable, with the way it changes as the variable grows.

    The vector is the relative angular velocity of the two links of the pair (joint), per
    unit rate of the variable. The axis of an R pair (revolute joint) is fixed in its links.
    The vector of a contact turns with a link, and changes relative to this link as the
    contact moves along a profile (a curve of the link).

    The lengths and the upper bound are for bounds of errors and of rates. For example, a
    small error of the variable changes the vector by about this error times `slide_length`.

    Attributes
    ----------
    vector
        (3,) expressions of the vector in ground axes.
    link
        Index of the link that carries the vector.
    length
        Length of `vector`, as an expression with fewer operations than the root of the sum
        of the squared components.
    slide
        (3,) derivative of the vector with respect to the variable, as seen from the link,
        in ground axes. None if the vector is fixed in the link.
    slide_length
        Length of `slide`, 0 if there is no slide. Its expression has few operations, too.
    slide_change_bound
        Parts of an upper bound of the length of the derivative of `slide` with respect to
        the variable. Their sum is `slide_change_bound.total`. If the variable has a small
        error, the error of `slide` is at most this sum times the error of the variable.
    """

    vector: Exprs
    link: int
    length: Expr = 1.0
    slide: Exprs | None = None
    slide_length: Expr = 0.0
    slide_change_bound: SlideChangeBound = SlideChangeBound()

    def derivative(self, w: Exprs, rate: Expr) -> Exprs:
        """Return the time derivative (3,) of the vector in ground axes.

        The vector turns with its link, and can slide on the link with the variable.

        Parameters
        ----------
        w
            (3,) angular velocity of the link, in ground axes.
        rate
            Rate of the variable.
        """
        turning = cross(w, self.vector)
        return turning if self.slide is None else turning + self.slide * rate


def carried_vectors(
    mechanism: Mechanism,
    pairs: PairRotations,
    placed: Sequence[LinkOrientation],
    variables: Sequence[Expr],
    about_centres: bool,
) -> tuple[list[CarriedVector], dict[int, CarriedVector]]:
    """Return the vectors of all variables, and the contact lines of rolling contacts.

    The vector of a variable is the angular velocity of the second link of its pair relative
    to the first, per unit rate of the variable. The vector of an R pair is its axis. If a
    contact moves along a profile, the vector is +-(n + k p), with the normal n, the contact
    point p and the curvature k of the profile. If two profiles with the curvatures k1 and
    k2 roll on each other, it is (k1 - k2) p.

    Parameters
    ----------
    mechanism, pairs
        The mechanism and the rotations of its pairs.
    placed
        Orientations of all links.
    variables
        Expressions of all variables, on which the points of contacts depend.
    about_centres
        Whether the vector of two circles that roll on each other is the sum of the two
        vectors about their centres. The sum takes fewer expressions than (k1 - k2) p, but
        loses digits if the circles are small. The length and bounds of the sum are not
        computed.

    Returns
    -------
    vectors
        The vectors in the order of the variables.
    contact_lines
        By the number of each rolling pair, the direction p from the centre of the sphere to
        the contact point. Pairs that are computed about centres are left out.
    """
    vectors: dict[int, CarriedVector] = {}
    contact_lines: dict[int, CarriedVector] = {}
    for pair, ends in enumerate(mechanism.ends):
        owned = mechanism.variables_of(pair)
        if pair not in pairs.sides:
            vectors[owned[0]] = _axis_of_r_pair(ends, pairs.axes(pair), placed)
            continue
        sides = pairs.sides[pair]
        # The two variables of a sliding contact move it along the first and the second
        # profile. A rolling contact has a single variable, which moves it along both.
        along_sides = [
            _vector_along_profile(sign, side, link, placed[link], variables)
            for side, link, sign in zip(sides, ends, (1.0, -1.0), strict=True)
        ]
        if len(owned) == 2:
            vectors |= zip(owned, along_sides, strict=True)
        elif about_centres and not any(side.contact_symbols for side in sides):
            first, second = (carried.vector for carried in along_sides)
            # The second vector is fixed in the second link. Seen from the first link, its
            # derivative is (first + second) x second = first x second.
            vectors[owned[0]] = CarriedVector(
                first + second, ends[0], slide=cross(first, second)
            )
        else:
            # The link with the smaller `depth` is placed earlier and has the shorter
            # expressions, so its frame is used.
            is_second_first = placed[ends[0]].depth > placed[ends[1]].depth
            carrier_side = sides[1] if is_second_first else sides[0]
            carrier = ends[1] if is_second_first else ends[0]
            contact_lines[pair] = _contact_line(
                carrier_side, carrier, placed[carrier], variables
            )
            vectors[owned[0]] = _rolling_vector(
                sides, carrier_side.curvature, contact_lines[pair]
            )
    return [*vectors.values()], contact_lines


def root(item: Expr) -> Expr:
    """Return the square root of a number or of a symbolic expression."""
    return function("sqrt", item) if isinstance(item, ExpressionNode) else float(item**0.5)


def absolute(item: Expr) -> Expr:
    """Return the absolute value of a number or an expression."""
    return root(item * item)


def largest(items: Iterable[Expr]) -> Expr:
    """Return the largest of numbers and expressions, none of which is negative.

    Numbers are compared immediately. Expressions are compared when the result is
    evaluated; equal expressions count only once.
    """
    items = list(items)
    maximum: Expr = max(
        (x for x in items if not isinstance(x, ExpressionNode)), default=0.0
    )
    for term in dict.fromkeys(x for x in items if isinstance(x, ExpressionNode)):
        maximum = function("maximum", maximum, term) if maximum else term
    return maximum


def _axis_of_r_pair(
    links: Sequence[int],
    axes: tuple[Entries, Entries],
    placed: Sequence[LinkOrientation],
) -> CarriedVector:
    """Return the axis of an R pair (revolute joint) as expressions, in ground axes.

    The axis is fixed in both links of the pair, so either link can carry it. The link that
    is placed earlier is chosen, because its orientation has the shorter expressions.

    Parameters
    ----------
    links
        Indices of the two links.
    axes
        The axis (3,) in the axes of the first link, and in those of the second.
    placed
        Orientations of all links. A link with a smaller `depth` was placed earlier.
    """
    first_link, second_link = links
    first_axis, second_axis = axes
    if placed[second_link].depth < placed[first_link].depth:
        return CarriedVector(placed[second_link].direction(second_axis), second_link)
    return CarriedVector(placed[first_link].direction(first_axis), first_link)


def _contact_line(
    side: ProfileSide, link: int, placed: LinkOrientation, variables: Sequence[Expr]
) -> CarriedVector:
    """Return the direction p to a contact point, which slides along a profile of a link.

    A profile is a curve on the unit sphere, fixed in the link. Seen from the link, p
    changes as the contact moves along the profile. The result states this change, which is
    needed for derivatives and error bounds of p:

    - The slide, the derivative of p with respect to arc length, is the unit tangent.
    - The bound of the derivative of the slide is the length of the tangent's derivative.

    Parameters
    ----------
    side
        The profile.
    link, placed
        Number and orientation of its link.
    variables
        Expressions of all pair variables.
    """
    tangent, _, point = _contact_frame(side, placed, variables)
    tangent_change = _tangent_change(side.curvature)
    return CarriedVector(
        vector=point,
        link=link,
        slide=tangent,
        slide_length=1.0,
        slide_change_bound=SlideChangeBound(tangent_change),
    )


def _contact_frame(
    side: ProfileSide, placed: LinkOrientation, variables: Sequence[Expr]
) -> Exprs:
    """Return the moving frame of a profile at the contact, in ground axes.

    A profile is the curve on a link along which the contact point moves.

    The rows of the matrix (3, 3) are the tangent t of the profile, its normal n = p x t,
    and the contact point p.
    """
    return place_link(side.chain, placed, variables).direction(np.eye(3)).T


def _tangent_change(curvature: Expr) -> Expr:
    """Return the length of dt/ds = k n - p, the derivative of the tangent of a profile."""
    return root(1.0 + curvature * curvature)


def _rolling_vector(
    sides: tuple[ProfileSide, ProfileSide],
    carrier_curvature: Expr,
    contact_line: CarriedVector,
) -> CarriedVector:
    """Return the vector (k1 - k2) p of a rolling contact, with its derivatives.

    The vector is the angular velocity of the second link relative to the first, per unit of
    arc length s. k1 and k2 are the curvatures of the profiles of both links, and p is the
    contact point. The derivatives serve to differentiate velocities, and to bound errors.

    The vector is seen from one of the two links, its carrier: it turns with the carrier
    and also changes relative to it. Primes are derivatives with respect to s as seen from
    the carrier. The tangent is t = p'. Then

        slide, the first derivative: (k1 - k2) t + (k1 - k2)' p
        second derivative:           (k1 - k2) t' + 2 (k1 - k2)' t + (k1 - k2)'' p

    `slide_change_bound` of the result bounds the length of the second derivative by the sum
    of the lengths of its terms. The length of the last term is at most ``|k1''| + |k2''|``,
    of which each profile knows a bound.

    Parameters
    ----------
    sides
        The two profiles, with the curvatures k1 and k2.
    carrier_curvature
        The curvature, k1 or k2, of the profile on the carrier.
    contact_line
        The contact point p, which slides on the carrier along the tangent.
    """
    first, second = sides
    curvature_difference = first.curvature - second.curvature  # k1 - k2
    slope_difference = first.slope - second.slope  # (k1 - k2)'
    point = contact_line.vector  # p
    tangent = contact_line.slide  # t
    vector = point * curvature_difference
    length = absolute(curvature_difference)
    slide = tangent * curvature_difference + point * slope_difference
    # The point and the tangent are perpendicular unit vectors.
    slide_length = root(
        curvature_difference * curvature_difference + slope_difference * slope_difference
    )
    # The lengths of the first two terms of the second derivative.
    first_two_terms = 2.0 * absolute(slope_difference) + absolute(
        curvature_difference
    ) * _tangent_change(carrier_curvature)
    return CarriedVector(
        vector=vector,
        link=contact_line.link,
        length=length,
        slide=slide,
        slide_length=slide_length,
        slide_change_bound=SlideChangeBound(other_terms=first_two_terms, profiles=sides),
    )


def _vector_along_profile(
    sign: float,
    side: ProfileSide,
    link: int,
    placed: LinkOrientation,
    variables: Sequence[Expr],
) -> CarriedVector:
    """Return the vector of a contact that moves along one of its two profiles.

    A contact has two variables: the arc lengths along the profiles of both links. Here only
    the arc length along one profile changes. The vector is the angular velocity of the
    second link relative to the first, per unit of this arc length.

    Parameters
    ----------
    sign
        1.0 for the profile of the first link of the contact: the second link turns relative
        to it. -1.0 for the profile of the second link: the first link turns, so the
        relative velocity has the opposite sign.
    side
        The profile.
    link
        Index of the link that carries the profile.
    placed
        Orientation of this link.
    variables
        Expressions of all pair variables, among them the arc length along the profile.
    """
    # The vector of a circle is fixed in the link, which gives shorter expressions.
    if side.circle is not None:
        return _vector_along_circle(sign, side.circle, link, placed)
    contact_frame = _contact_frame(side, placed, variables)
    return _vector_along_curve(sign, side, link, contact_frame)


def _vector_along_circle(
    sign: float, circle: ProfileCircle, link: int, placed: LinkOrientation
) -> CarriedVector:
    """Return the angular velocity of a contact that moves along a circle.

    A contact has two variables, the arc lengths along the profiles of its two links. The
    profile of one link is the circle. Only the arc length along the circle changes here, so
    tangent, normal and point of the contact are fixed in the other link.

    Seen from the link with the circle, the other link therefore turns about the axis
    through the centre of the circle. The result is the angular velocity of the second link
    of the contact relative to the first, per unit of arc length. This vector is fixed in
    the link with the circle. Its length is the angle about the axis per unit of arc length.

    Parameters
    ----------
    sign
        1.0 if the first link of the contact carries the circle: the second link turns.
        -1.0 if the second link carries the circle: the first link turns, so the velocity of
        the second link relative to the first has the opposite sign.
    circle
        The circle.
    link, placed
        Number and orientation of the link that carries the profile.
    """
    # The angle per length is positive: the arc length grows counter-clockwise about the
    # axis.
    angle_per_length = circle.angle_per_length
    vector = placed.direction(circle.axis) * (sign * angle_per_length)
    return CarriedVector(vector, link, length=angle_per_length)


def _vector_along_curve(
    sign: float, side: ProfileSide, link: int, contact_frame: Exprs
) -> CarriedVector:
    """Return the angular velocity of a contact that moves along a profile.

    The contact has the tangent t of the profile, the normal n = p x t, and the point p on
    the unit sphere. As the contact moves along the profile, these three axes turn with the
    angular velocity n + k p, with the curvature k of the profile. The rotation n moves the
    point along the profile. The rotation k p turns the tangent.

    Only the arc length along this profile changes here, so the contact point is fixed on
    the other link. The other link therefore turns with the three axes. The result is the
    angular velocity of the second link relative to the first, per unit of arc length:
    n + k p if the first link carries the profile, -(n + k p) if the second does.

    Let primes be derivatives with respect to arc length, as seen from the link with the
    profile. Because n' = -k t and p' = t,

        slide, the first derivative: k' p
        second derivative:           k' t + k'' p

    `slide_change_bound` of the result bounds the length of the second derivative by
    ``|k'| + |k''|``. The profile knows a bound of ``|k''|``.

    Parameters
    ----------
    sign
        1.0 if the first link of the contact carries the profile, -1.0 if the second does.
        The vector and its derivatives are multiplied by the sign.
    side
        The profile.
    link
        Index of the link that carries the profile.
    contact_frame
        (3, 3) rows t, n and p in ground axes.
    """
    _, normal, point = contact_frame
    slope_size = absolute(side.slope)  # |k'|
    return CarriedVector(
        vector=(normal + point * side.curvature) * sign,
        link=link,
        length=root(1.0 + side.curvature * side.curvature),
        slide=point * (sign * side.slope),
        slide_length=slope_size,
        slide_change_bound=SlideChangeBound(other_terms=slope_size, profiles=(side,)),
    )
