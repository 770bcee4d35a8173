"""Stationary points of a variable along a chain of certified arcs.

Each stationary point is proven to be the only one in its neighbourhood. Outside of these
neighbourhoods and of undecided parts there is none.

The variables z of a configuration solve the equations F(z) = 0 of the mechanism. An arc is
z = z0 + t s + N y(s), with the tangent t and the normals N at its centre z0. Its rates, the
derivatives with respect to s, are z' = t + N y'. They satisfy F' z' = 0, so (F'N) y' =
-F't. Bounds of F' in the arc's box therefore give bounds of the rates of all variables, and
bounds of F'' give bounds of the derivatives of the rates.

Let a *stretch* be the part of a curve between two configurations. A rate that cannot vanish
in a stretch has no zero there. If the derivative of a rate cannot vanish, the rate has one
zero if its signs at both ends differ, and no zero if the signs agree. All other stretches
are cut in two.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from spherekit.arrays import Floats, Indices
from spherekit.numerics.angles import wrap
from spherekit.numerics.bracketed_zeros import find_bracketed_zeros
from spherekit.proof.arc_equations import ArcEquations
from spherekit.proof.balls import cosines_and_sines
from spherekit.proof.chains import Chain, find_piece_ahead
from spherekit.proof.tubes import (
    COORDINATE_ROUNDING_RAD,
    PRODUCT_ROUNDING,
    ROUND_UP,
    CertifiedArc,
    correct_configuration,
    find_frame,
    find_piece,
)

MAX_CUT_DEPTH = 40
"""Largest number of times that a stretch is cut in two.

Larger: shorter stretches are decided. Smaller: more of them stay undecided.
"""

SHORTEST_STRETCH_RAD = 1e-6
"""Length (rad) below which stretches are not cut.

Larger: two stationary points closer than this stay undecided. Smaller: more stretches.
"""

SHORTEST_FLAT_STRETCH_RAD = 0.02
"""Length (rad) below which a stretch is not cut if shorter stretches would not help.

They help only if the derivative of the rate has no proven sign in the whole stretch, but
it or the rate has one at the start. Larger: more stays undecided. Smaller: more stretches
are examined in vain.
"""

MAX_STRETCHES = 4000
"""Number of stretches of a chain beyond which stretches are not cut into short ones.

Larger: more is decided where the variable nearly rests. Smaller: less time is spent there.
"""

STRETCHES_PER_ARC = 40
"""Number of further stretches for each arc of the chain, see `MAX_STRETCHES`.

Larger: more is decided on long chains, in more time. Smaller: less is decided.
"""

FIRST_BRACKET_RAD = 3.6e-10
"""Length (rad) of the first stretch in which a zero of a rate is enclosed.

Larger: wider enclosures. Smaller: the signs at the ends are more often open.
"""

BRACKET_GROWTH = 4.0
"""Ratio of the lengths of successive stretches that are tried to enclose a zero.

Larger: wider enclosures. Smaller: more trials.
"""

MIN_FORWARD_COSINE = 1e-3
"""Smallest cosine of the angle between the tangents of two arcs that are oriented alike.

Larger: sharper bends are not passed. Smaller: an arc of the opposite sense might pass.
"""


@dataclass(frozen=True)
class RateBounds:
    """Bounds of the rates of all v variables along an arc, and of their derivatives.

    They serve to find or exclude stationary points, at which the rate of a variable is 0.
    An arc is a part of a curve of configurations. Rates are derivatives of the variables
    with respect to the coordinate s along the tangent at the centre of the arc. The bounds
    are valid up to the |s| for which they were computed (`bound_rates`).

    Attributes
    ----------
    rate_low, rate_high
        (v,) bounds of the rates.
    derivative_low, derivative_high
        (v,) bounds of the derivatives of the rates with respect to s.
    """

    rate_low: Floats
    rate_high: Floats
    derivative_low: Floats
    derivative_high: Floats


def bound_rates(piece: CertifiedArc, half_length: float) -> RateBounds:
    """Return bounds of the rates of all variables along a certified arc.

    With these bounds, stationary points of variables are found or excluded. z are the
    variables, and s is the coordinate along the tangent. The arc is z = z0 + t s + N y(s)
    with the tangent t and the normals N at its centre z0. The points of the arc solve the k
    equations F(z) = 0. The rates are z' = t + N y', where y' is bounded. From F'' (z', z')
    + F' z'' = 0 with z'' = N y'' follows z'' = -N (F'N)^-1 F''(z', z'). The matrix Y is
    near the inverse of F'N at the centre.

    Each equation is a trigonometric polynomial. Its derivative of any order is at most a
    constant C times the degrees of the equation in the variables of the derivative. For
    example, C d_1 d_2 bounds the derivative with respect to the variables 1 and 2.

    Parameters
    ----------
    piece
        The arc. Its attribute `test` has bounds that were computed at the centre, along the
        frame of t and N: the degrees `test.degrees` (k, v), the constants C as
        `test.third_bound` (k,), and Y F'' as `test.second_derivatives` (k, v, v).
    half_length
        The bounds are valid for |s| up to this (rad).
    """
    test = piece.test
    tangent = piece.frame[:, 0]
    normals = piece.frame[:, 1:]
    # Largest ``|y_i|`` of the arc. In the box with this radius, `bounds.slope` is the
    # largest ``|y_i'|``, and `bounds.contraction` the largest row sum of ``|Y F'N - 1|``.
    distance = piece.largest_normal_coordinate(half_length)
    bounds = test.bound_arc(half_length, distance)
    rate_error = np.sum(np.abs(normals), axis=1) * bounds.slope * ROUND_UP
    # Largest coordinates (v,) along the frame: of the arc from its centre, and of z'. The
    # first coordinate of z', along t, is 1.
    reach = np.append(half_length, np.zeros(len(tangent) - 1) + distance)
    velocity = np.append(1.0, np.zeros(len(tangent) - 1) + bounds.slope)
    # (k,) bound of how much F''(z', z') changes from the centre to any point of the arc. Of
    # the three derivatives, one is along the way from the centre (`reach`) and two are
    # along z'. Each contributes the degrees times the coordinates, summed over the
    # coordinates. The error of F'' at the centre (`test.derivative_error`) is included.
    sums = test.degrees @ reach
    variation = (test.third_bound * sums + test.derivative_error) * (
        test.degrees @ velocity
    ) ** 2
    # (k,) -Y F''(t, t) at the centre. Coordinate 0 is along t.
    bend = -test.second_derivatives[:, 0, 0]
    magnitudes = np.abs(test.second_derivatives)
    # (k,) deviation of Y F''(z', z') from its value at the centre for z' = t. There are two
    # parts: the change of F'' (`inverse_size` has the magnitudes of Y), and the difference
    # of z' and t with F'' of the centre. The latter is the sum over all coordinates of z',
    # without the term in which both derivatives are along t.
    form_deviation = (
        test.inverse_size @ variation
        + magnitudes @ velocity @ velocity
        - magnitudes[:, 0, 0]
    ) * ROUND_UP
    # The inverse of F'N differs from Y by at most this factor, relative to Y.
    inverse_factor = bounds.contraction / (1.0 - bounds.contraction)
    largest_bend = np.max(np.abs(bend) + form_deviation)
    # With 1e-15 added, the error is not 0 where all terms are.
    bend_error = (form_deviation + inverse_factor * largest_bend) * ROUND_UP + 1e-15
    second = normals @ bend
    second_error = np.abs(normals) @ bend_error * ROUND_UP
    return RateBounds(
        rate_low=tangent - rate_error,
        rate_high=tangent + rate_error,
        derivative_low=second - second_error,
        derivative_high=second + second_error,
    )


def _rate_signs(piece: CertifiedArc, half_length: float, variable: int) -> tuple[int, int]:
    """Return the proven signs of the rate of a variable, and of the derivative of the rate.

    The rate is the derivative of the variable along a certified arc with respect to the
    coordinate s along its tangent (0 at the centre). The signs apply to all |s| <=
    `half_length` (rad). A sign that is not proven is 0.
    """
    bounds = bound_rates(piece, half_length)
    return (
        _common_sign(bounds.rate_low[variable], bounds.rate_high[variable]),
        _common_sign(bounds.derivative_low[variable], bounds.derivative_high[variable]),
    )


def _common_sign(low: float, high: float) -> int:
    """Return the sign of all numbers from low to high, 0 if they do not have one."""
    return int(low > 0.0) - int(high < 0.0)


@dataclass(frozen=True)
class StationaryPoint:
    """A configuration at which one variable is, or may be, stationary along a curve.

    The curve is a chain of certified arcs: each is proven to contain all configurations in
    a box about it. There are two kinds of such points:

    - in `StationaryPoints.proven`: the variable is stationary in exactly one configuration
      near the position,
    - in `StationaryPoints.undecided`: the variable may be stationary in a part (stretch) of
      the curve that begins at the position.

    Attributes
    ----------
    position
        (v,) values of all variables (rad).
    error
        A bound (rad). For a proven point: of the difference of each variable from the
        position. For an undecided stretch: of the change, in the stretch, of the variable
        that may be stationary.
    piece
        Index of a certified arc. The point is between the centre of this arc and the centre
        of the next arc.
    """

    position: Floats
    error: float
    piece: int = 0


@dataclass(frozen=True)
class StationaryPoints:
    """The configurations on a curve (chain of arcs) in which a variable is stationary.

    Attributes
    ----------
    proven
        The proven stationary points, in order.
    undecided
        Stretches (parts of the curve) in which there may be more stationary points.
    """

    proven: list[StationaryPoint] = field(default_factory=list)
    undecided: list[StationaryPoint] = field(default_factory=list)


@dataclass(frozen=True)
class _StretchSigns:
    """Proven signs of the rate of a variable in a stretch (part) of a curve.

    The rate is the derivative of the variable along the curve; it may be zero in the
    stretch. If the derivative of the rate has one sign there, the rate is monotonic. Then
    it has one zero if its signs at both ends differ, and none if they agree. A sign that is
    not proven is 0.

    Attributes
    ----------
    at_start
        Sign of the rate at the start.
    derivative
        Sign of the derivative of the rate in the whole stretch.
    at_end
        Sign of the rate at the end.
    """

    at_start: int
    derivative: int
    at_end: int


@dataclass(frozen=True)
class _Stretch:
    """The part of a curve from the centre of an arc to a configuration in the arc's box.

    An arc is a part of the curve in a box along its tangent. The box is proven to contain
    no other part of the curve. The search is for points of the curve at which a variable is
    stationary. If it stays open whether a stretch has one, the stretch is cut in two at the
    centre of a new arc. The first part keeps its arc and ends at this centre. The second
    part begins there, with the new arc.

    Attributes
    ----------
    piece
        The arc with its box. The centre of the arc is the start of the stretch.
    end
        (v,) the configuration (rad) at the end, ahead of the centre along the tangent.
    end_error
        Bound (rad) of the distance of the exact configuration from `end`.
    depth
        How many cuts have led to this stretch.
    """

    piece: CertifiedArc
    end: Floats
    end_error: float
    depth: int = 0

    @property
    def chord(self) -> Floats:
        """The straight line (v,) from the start of the stretch to its end (rad)."""
        return wrap(self.end - self.piece.centre)

    def position(self, ratio: float) -> Floats:
        """Return the point (v,) at a fraction of the straight line from start to end."""
        return self.piece.centre + ratio * self.chord

    @property
    def reach(self) -> float:
        """Upper bound (rad) of the coordinate along the tangent, anywhere in the stretch.

        The coordinate along the tangent of the arc is 0 at the centre of the arc, where the
        stretch starts. It grows along the stretch, so it is largest at the end. The bound
        includes the error of the end and rounding.
        """
        coordinate = self.piece.coordinates(self.end)[0]
        return float(coordinate + self.end_error + COORDINATE_ROUNDING_RAD)


def find_stationary_points(
    equations: ArcEquations, chain: Chain, variable: int
) -> StationaryPoints:
    """Return the stationary points of a variable along a chain, and what is undecided.

    The chain is a curve as a row of certified arcs. The stretch of the curve from the
    centre of each arc to the centre of the next arc is examined. The rate is the derivative
    of the variable along the curve. A stretch is cut in two until the rate cannot vanish in
    it, or until the derivative of the rate has one sign. The rate then has one zero if its
    signs at both ends differ, and no zero if they agree. Stretches that cannot be cut
    further stay undecided.

    Parameters
    ----------
    equations
        The equations of the mechanism.
    chain
        The chain of certified arcs.
    variable
        Index of the variable.
    """
    result = StationaryPoints()
    # Successive stretches in which the derivative of the rate has the same sign are joined
    # to a run. The rate passes zero at most once in a run, so only its signs at both ends
    # of the run matter.
    run_start = chain.pieces[0]
    run_start_sign = 0
    run_derivative = 0
    undecided_before_run = 0
    stretch_budget = MAX_STRETCHES
    numbered_pieces = list(enumerate(chain.successive_pieces))
    first = _find_first_number(chain, variable)
    for number, (piece, next_piece) in numbered_pieces[first:] + numbered_pieces[:first]:
        stretch_budget += STRETCHES_PER_ARC
        waiting = [_Stretch(piece, next_piece.centre, next_piece.centre_error)]
        while waiting:
            stretch_budget -= 1
            stretch = waiting.pop()
            finding = _examine_stretch(
                equations, variable, stretch, allows_short=stretch_budget > 0
            )
            if isinstance(finding, CertifiedArc):
                # Cut at this arc; the first half is examined first.
                depth = stretch.depth + 1
                waiting += [
                    _Stretch(finding, stretch.end, stretch.end_error, depth),
                    _Stretch(stretch.piece, finding.centre, finding.centre_error, depth),
                ]
                continue
            # The finding None means that the rate does not vanish in this stretch, which
            # ends a run.
            signs = finding or _StretchSigns(at_start=0, derivative=0, at_end=0)
            continues_run = (
                signs.derivative
                and signs.derivative == run_derivative
                and run_start.contains(stretch.end, stretch.end_error)
            )
            if not continues_run:
                run_start = stretch.piece
                run_start_sign = signs.at_start
                undecided_before_run = len(result.undecided)
            is_decided = run_start_sign and signs.derivative and signs.at_end
            # The signs at both ends of a run decide on its undecided stretches as well.
            if is_decided:
                del result.undecided[undecided_before_run:]
            if is_decided and run_start_sign != signs.at_end:
                run = _Stretch(run_start, stretch.end, stretch.end_error)
                point = _enclose_zero(equations, run, variable, signs.at_end)
                result.proven.append(replace(point, piece=number))
            elif finding and not is_decided:
                point = _bound_undecided(stretch, variable)
                result.undecided.append(replace(point, piece=number))
            run_derivative = 0 if is_decided else signs.derivative
    result.proven.sort(key=lambda point: point.piece)
    return result


def _find_first_number(chain: Chain, variable: int) -> int:
    """Return the index of the arc of a chain from which on stationary points are searched.

    A closed chain may begin at a stationary point of the variable. The sign of its rate is
    open there, so the point would stay undecided. The search then begins at the first arc
    with a proven sign of the rate at its centre, if there is one.
    """
    if chain.closed:
        for number, piece in enumerate(chain.pieces):
            sign_at_centre, _ = _rate_signs(piece, half_length=0.0, variable=variable)
            if sign_at_centre:
                return number
    return 0


def _examine_stretch(
    equations: ArcEquations, variable: int, stretch: _Stretch, allows_short: bool
) -> _StretchSigns | CertifiedArc | None:
    """Return the proven signs of the rate of a variable in a stretch, or where to cut it.

    A stretch is a part of a configuration curve, from the centre of a certified arc to a
    configuration in the box of this arc. The rate is the derivative of the variable along
    it. If the rate has one sign, the variable is not stationary in the stretch. If only the
    derivative of the rate has one sign, the signs of the rate at both ends decide.

    Parameters
    ----------
    equations
        The equations of the mechanism.
    variable
        Index of the variable.
    stretch
        The stretch.
    allows_short
        Whether the stretch may be cut into short stretches.

    Returns
    -------
    - None if the rate does not vanish in the stretch.
    - A certified arc if the stretch is to be cut in two: at the centre of this arc.
    - Otherwise the proven signs of the rate at both ends, and of its derivative. The
      stretch is then not cut, even if signs are open (0).
    """
    piece = stretch.piece
    reach = stretch.reach
    # Signs in the whole stretch: for all coordinates s along the tangent up to the reach of
    # the stretch. Bounds are valid in the box only, up to its half length.
    rate_sign, derivative_sign = _rate_signs(piece, min(reach, piece.half_length), variable)
    if rate_sign:
        return None
    # Signs at the start, the centre of the arc (s = 0).
    start_rate_sign, start_derivative_sign = _rate_signs(
        piece, half_length=0.0, variable=variable
    )
    sign_at_end = 0
    # Stretches shorter than this are not cut. The limit is lower if the rate or its
    # derivative has a sign at the start only. A shorter part at the start then has the same
    # sign. If only the sign at the end is open, cutting does not help.
    shortest = SHORTEST_FLAT_STRETCH_RAD
    if derivative_sign:
        # An arc about the end gives the sign of the rate there. Only the bounds at its
        # centre are used, so a short arc is enough.
        end_piece = find_piece(equations, stretch.end, piece.tangent, longest=1e-3)
        if end_piece is not None and _has_same_sense(end_piece, piece):
            sign_at_end, _ = _rate_signs(end_piece, half_length=0.0, variable=variable)
    elif allows_short and (start_rate_sign or start_derivative_sign):
        shortest = SHORTEST_STRETCH_RAD
    has_both_signs = start_rate_sign and sign_at_end
    if not has_both_signs and reach >= shortest and stretch.depth < MAX_CUT_DEPTH:
        # The sign of a rate cannot be proven at its zero. If a zero is exactly at one cut,
        # the next cut is at another ratio. So two ratios are used in turn.
        ratio = 0.5 if stretch.depth % 2 else 0.47
        middle = _find_middle_piece(equations, stretch, ratio)
        if middle is not None and middle.contains(stretch.end, stretch.end_error):
            return middle
    return _StretchSigns(start_rate_sign, derivative_sign, sign_at_end)


def _bound_undecided(stretch: _Stretch, variable: int) -> StationaryPoint:
    """Return a part of a curve as undecided, with a bound of a variable's change in it.

    A stretch is a part of a curve of configurations, and starts at the centre of an arc of
    the curve (`stretch.piece`). The stretch is undecided: the proof does not show whether
    the variable is stationary in it. If the variable is the input, modes (ways to assemble
    the links) cannot be counted at the inputs in the stretch. The bound limits these inputs
    (`CertifiedCurves.undecided_ranges`).

    Parameters
    ----------
    stretch
        The stretch.
    variable
        Index of the variable.

    Returns
    -------
    The position of the start, with the bound (rad) as `error`. It is the smaller of two
    bounds: one from a box around the stretch, the other from the largest rate.
    """
    change_in_box = _bound_change_by_box(stretch, variable)
    change_along_curve = _bound_change_by_rate(stretch, variable)
    # 1e-12 rad is far above the rounding errors of both bounds.
    return StationaryPoint(
        position=stretch.piece.centre,
        error=min(change_in_box, change_along_curve) + 1e-12,
    )


def _bound_change_by_box(stretch: _Stretch, variable: int) -> float:
    """Return a bound (rad) of the change of a variable in a stretch, from a box around it.

    A stretch is a part of a configuration curve. Its start is the centre of the box. The
    edges of the box are along the tangent of the curve at the start and along its normals.
    These directions are the columns of the frame of the arc. `_bound_undecided` explains
    why the bound is needed.
    """
    # The arc of the curve that contains the stretch.
    arc = stretch.piece
    # The bound of the coordinate along the tangent, then one bound for all coordinates
    # along normals.
    largest_coordinate = min(stretch.reach, arc.half_length)
    distance = arc.largest_normal_coordinate(largest_coordinate)
    # There are as many directions as variables, and all but the tangent are normals.
    normal_count = len(arc.frame) - 1
    half_lengths = [largest_coordinate, *[distance] * normal_count]
    # Rows of the frame are variables, and columns are directions.
    components = np.abs(arc.frame[variable])
    return float(components @ half_lengths)


def _bound_change_by_rate(stretch: _Stretch, variable: int) -> float:
    """Return a bound (rad) of the change of a variable in a stretch, from its largest rate.

    A stretch is a part of a configuration curve. The rate is the derivative of the variable
    with respect to the coordinate s along the tangent at the start. The change from s = 0
    is at most the largest rate times the largest s. The computed start may be beside the
    curve, so its error is added.
    """
    arc = stretch.piece
    largest_coordinate = min(stretch.reach, arc.half_length)
    bounds = bound_rates(arc, largest_coordinate)
    largest_rate = max(abs(bounds.rate_low[variable]), abs(bounds.rate_high[variable]))
    # The factor 1.001 is much larger than the rounding of the product.
    return float(1.001 * largest_rate * largest_coordinate + arc.centre_error)


def _find_middle_piece(
    equations: ArcEquations, stretch: _Stretch, ratio: float
) -> CertifiedArc | None:
    """Return a certified arc with its centre in a stretch, to cut the stretch in two.

    A stretch is a part of a curve of configurations, from the centre of a certified arc
    (`stretch.piece`) to a configuration in the box of this arc. A certified arc is proven
    to be the only arc in its box. The centre of the new arc is the place of the cut. A sign
    of a rate that is not proven in the whole stretch can be proven in its parts.

    Parameters
    ----------
    equations
        The equations of the mechanism.
    stretch
        The stretch to cut.
    ratio
        Where to look for the centre of the arc, as a fraction of the straight line from
        start to end of the stretch.

    Returns
    -------
    The arc. None if none is proven between the start and the end.
    """
    start_arc = stretch.piece
    # The first coordinate in the box of an arc is along its tangent, 0 at its centre.
    end_coordinate = start_arc.coordinates(stretch.end)[0]
    # Limit of the half length of the box of the new arc. The end of the stretch is nearer
    # to any centre in the stretch than this. So the limit lets the box contain the end.
    longest = max(2.0 * end_coordinate, SHORTEST_STRETCH_RAD)
    middle = find_piece_ahead(equations, start_arc, stretch.position(ratio), longest)
    if middle is None:
        return None
    is_before_end = start_arc.coordinates(middle.centre)[0] < end_coordinate
    end_is_ahead = middle.coordinates(stretch.end)[0] > 0.0
    # The tangents of both arcs must point the same way along the curve.
    if is_before_end and end_is_ahead and _has_same_sense(middle, start_arc):
        return middle
    return None


def _has_same_sense(first: CertifiedArc, second: CertifiedArc) -> bool:
    """Return whether two neighbouring arcs of a curve run along it in the same sense."""
    return bool(first.tangent @ second.tangent > MIN_FORWARD_COSINE)


def _enclose_zero(
    equations: ArcEquations, stretch: _Stretch, variable: int, end_sign: int
) -> StationaryPoint:
    """Return an enclosure of the only zero of a rate in a stretch (part) of a curve.

    The rate is the derivative of a variable along the curve, so the variable is stationary
    at the zero. The zero is approximated. Then the stretch is shortened to a proven
    neighbourhood of the zero. The result is the middle of this range, with an error bound.

    Parameters
    ----------
    equations
        The equations of the mechanism.
    stretch
        A stretch in which the rate has exactly one zero.
    variable
        Index of the variable.
    end_sign
        Sign of the rate at the end of the stretch. At the start the sign is opposite.
    """
    zero_ratio = _approximate_zero(equations, stretch, variable, end_sign)
    short_stretch = _shorten_to_zero(equations, stretch, variable, end_sign, zero_ratio)
    largest_difference = np.max(_bound_differences_from_middle(short_stretch))
    return StationaryPoint(short_stretch.position(0.5), float(largest_difference))


def _bound_differences_from_middle(stretch: _Stretch) -> Floats:
    """Return how much each variable in a stretch of a curve differs from the middle point.

    A stretch is a part of a curve of configurations. Its start is the centre of a certified
    arc (`stretch.piece`), and its end is a computed configuration. The middle point is half
    way on the straight line from the start to the end. It approximates a stationary point
    that is proven to be in the stretch, and the caller needs the error.

    Distances from the middle point are bounded along the columns of the frame of the arc.
    The columns are the tangent of the curve at the start, then its normals.

    Returns
    -------
    (v,) bounds (rad), valid for all configurations of the stretch.
    """
    along_tangent = _bound_distance_along_tangent(stretch)
    along_normal = _bound_distance_along_normal(stretch)
    normal_count = len(stretch.end) - 1
    distances = [along_tangent, *[along_normal] * normal_count]
    # The difference of a variable is a sum over the columns of the frame: each distance
    # along a column, times the component of the column for this variable.
    differences = np.abs(stretch.piece.frame) @ distances
    # Far above the rounding errors of angles of a few radians.
    rounding_allowance = 1e-12
    return differences + rounding_allowance


def _bound_distance_along_tangent(stretch: _Stretch) -> float:
    """Return how far a stretch extends from its middle along the tangent at its start.

    The result is a bound (rad). A stretch is a part of a configuration curve. Along the
    tangent it has coordinates from 0 to its length. The coordinate of the middle is half
    that of the computed end. So its error is half the error of the end.
    """
    largest_length = stretch.reach
    return 0.5 * (largest_length + stretch.end_error)


def _bound_distance_along_normal(stretch: _Stretch) -> float:
    """Return how far a stretch is from its middle along each normal, as a bound (rad).

    A configuration of the stretch and the middle may be on opposite sides of the tangent
    line, the straight line along the tangent at the start. Their distances from this line
    are therefore added:

    - A configuration is at most c from the line.
    - The computed end is at most c + e from the line, where e is its error. The middle is
      nearer to the line than the computed end.
    """
    curve_from_line = stretch.piece.largest_normal_coordinate(stretch.reach)  # c
    return 2.0 * curve_from_line + stretch.end_error


def _approximate_zero(
    equations: ArcEquations, stretch: _Stretch, variable: int, end_sign: int
) -> float:
    """Return approximately where a rate is 0 in a stretch (part) of a curve.

    The rate is the derivative of a variable along the curve. A later proof starts from the
    result, and does not depend on its accuracy.

    Parameters
    ----------
    equations
        The equations of the mechanism.
    stretch
        A stretch in which the rate has exactly one zero.
    variable
        Index of the variable.
    end_sign
        Sign of the rate at the end of the stretch. At the start the sign is opposite.

    Returns
    -------
    The zero, as a fraction of the way from the start of the stretch to its end.
    """

    def signed_rate(ratios: Floats, _function_numbers: Indices) -> Floats:
        """Return the rate (1,) at a fraction (1,) of the way, times its sign at the end.

        `end_sign` makes the result positive at the end and negative at the start.
        """
        rate = _approximate_rate_at_ratio(equations, stretch, variable, ratios[0])
        return np.array([end_sign * rate])

    # The search takes several functions and fractions. Here there is one of each. The
    # search needs the values at both ends, of which only the signs matter. The tolerance is
    # the rounding of float64, so the zero is as accurate as possible.
    one = np.ones(1)
    zero_ratios, _ = find_bracketed_zeros(
        signed_rate,
        low=0.0 * one,
        high=one,
        values_at_low=-one,
        values_at_high=one,
        tolerance=PRODUCT_ROUNDING,
    )
    (zero_ratio,) = zero_ratios
    return float(zero_ratio)


def _approximate_rate_at_ratio(
    equations: ArcEquations, stretch: _Stretch, variable: int, ratio: float
) -> float:
    """Return the rate of a variable at a fraction of the way along a stretch of a curve.

    The rate is the derivative of the variable along the curve. The result has no error
    bounds.

    Parameters
    ----------
    equations
        The equations of the mechanism.
    stretch
        The stretch (part) of the curve.
    variable
        Index of the variable.
    ratio
        Fraction of the straight line from the start of the stretch to its end. Newton's
        method leads from there to a configuration of the curve. If it fails, the rate at
        the start is returned.
    """
    configuration = correct_configuration(equations, stretch.position(ratio))
    if configuration is None:
        # The start of a stretch is the centre of an arc (piece) of the curve.
        configuration = stretch.piece.centre
    # The tangent of the arc says in which sense the curve is followed.
    return _approximate_rate(
        equations, configuration, variable, direction=stretch.piece.tangent
    )


def _approximate_rate(
    equations: ArcEquations, configuration: Floats, variable: int, direction: Floats
) -> float:
    """Return the derivative of a variable along the curve through a configuration.

    The curve consists of configurations of the mechanism. The result is only an
    approximation. With it the caller searches where the derivative is 0, as the start of a
    proof that does not depend on its accuracy.

    Parameters
    ----------
    equations
        The equations of the mechanism.
    configuration
        (v,) the configuration (rad).
    variable
        Index of the variable.
    direction
        (v,) direction that says in which sense the curve is followed.

    Returns
    -------
    The component of the unit tangent for this variable, without error bounds. The result is
    0 if the curve has no unique tangent there.
    """
    # Derivatives (k, v) of the k equations, which are sums of cosines and sines.
    circle_points = cosines_and_sines(configuration[None])
    _values, (slopes,) = equations.harmonics.derivatives(circle_points, order=1)
    tangent_frame = find_frame(slopes, direction)
    if tangent_frame is None:
        return 0.0
    tangent = tangent_frame.frame[:, 0]
    return float(tangent[variable])


def _shorten_to_zero(
    equations: ArcEquations,
    stretch: _Stretch,
    variable: int,
    end_sign: int,
    zero_ratio: float,
) -> _Stretch:
    """Return a short part of a stretch that is proven to contain the only zero of a rate.

    A stretch is a part of a curve, and the rate is the derivative of a variable along it.
    Two certified arcs are searched, one before and one after the approximate zero. If the
    rate has opposite proven signs at their centres, the zero is between them. Very near the
    zero the signs cannot be proven. So both distances are increased until both arcs have
    been found. Each round searches both arcs again. An arc that is found replaces the arc
    of an earlier round.

    Parameters
    ----------
    equations
        The equations of the mechanism.
    stretch
        A stretch in which the rate has exactly one zero.
    variable
        Index of the variable.
    end_sign
        Sign of the rate at the end of the stretch. At the start the sign is opposite.
    zero_ratio
        Approximate zero, as a fraction of the way from the start to the end.

    Returns
    -------
    The part between both arcs. On a side where no arc is found, it ends with the stretch.
    """
    shortened = stretch
    has_new_start = False
    has_new_end = False
    length = np.max(np.abs(stretch.chord))
    # Distance (rad) between the two arcs.
    bracket = FIRST_BRACKET_RAD
    while bracket < length and not (has_new_start and has_new_end):
        offset = 0.5 * bracket / length
        arc_after = _find_arc_with_sign(
            equations, stretch, variable, zero_ratio + offset, rate_sign=end_sign
        )
        if arc_after is not None:
            shortened = replace(
                shortened, end=arc_after.centre, end_error=arc_after.centre_error
            )
            has_new_end = True
        arc_before = _find_arc_with_sign(
            equations, stretch, variable, zero_ratio - offset, rate_sign=-end_sign
        )
        # A stretch begins at the centre of its `piece`, an arc in a box, and must end in
        # this box. An arc with a box that does not reach the end cannot be used.
        if arc_before is not None and arc_before.contains(
            shortened.end, shortened.end_error
        ):
            shortened = replace(shortened, piece=arc_before)
            has_new_start = True
        bracket *= BRACKET_GROWTH
    return shortened


def _find_arc_with_sign(
    equations: ArcEquations,
    stretch: _Stretch,
    variable: int,
    ratio: float,
    rate_sign: int,
) -> CertifiedArc | None:
    """Return a certified arc in a stretch if a rate has a given sign at its centre.

    A stretch is a part of a curve, and the rate is the derivative of a variable along it. A
    certified arc is a part of the curve that is proven to be the only arc in a box.

    The caller searches one arc on each side of a zero of the rate. If the signs at the
    centres of both arcs are opposite, the zero is proven to be between them.

    Parameters
    ----------
    equations
        The equations of the mechanism.
    stretch
        The stretch in which the arc is searched.
    variable
        Index of the variable. The rate is the derivative of this variable along the curve.
    ratio
        Where to look for the centre of the arc, as a fraction of the straight line from
        start to end of the stretch.
    rate_sign
        The required sign, 1 or -1.

    Returns
    -------
    The arc. None if no arc is proven, or if the rate is not proven to have this sign.
    """
    arc = _find_middle_piece(equations, stretch, ratio)
    if arc is None:
        return None
    proven_sign, _ = _rate_signs(arc, half_length=0.0, variable=variable)
    return arc if proven_sign == rate_sign else None
