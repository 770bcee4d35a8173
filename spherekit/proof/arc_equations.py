"""The equations of a mechanism in balls: one arc for each link that is put on two axes.

The equation of such a link is f = U . W - cos(arc) = 0. U and W are the axes of its two
pairs, each in the link to which the pair joins it, and both in common axes. f is a
polynomial in the cosines and sines of the variables of `Construction`.

All derivatives of f are bounded by one constant for each equation, times degrees of f, for
all real configurations at once. A derivative has one such factor for each variable with
respect to which f is differentiated. The reason: a link across one pair contributes a
rotation about a fixed axis, which has norm 1, as have all its derivatives with respect to
the angle. A link on two axes contributes a matrix of known norm.

A jet is an array of balls together with its derivatives with respect to the variables.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import prod
from typing import Any

import numpy as np

from spherekit.arrays import Array, Floats
from spherekit.errors import PlanError
from spherekit.proof.ball_frames import (
    Frame,
    Vector,
    exact_ball,
    exact_balls,
    revolute_rotation_terms,
)
from spherekit.proof.balls import UNIT_ROUNDOFF, Ball, lower_magnitude
from spherekit.proof.construction import Construction, PlacementStep
from spherekit.proof.decimal_mechanism import DecimalMechanism
from spherekit.proof.harmonics import Harmonics

Jet = Mapping[tuple[int, ...], Any]
"""An array of balls under the key (), and its derivatives with respect to variables.

The key (j,) has the first derivative with respect to variable j, the key (j, l) with j <= l
the second derivative with respect to variables j and l. A missing key means zero.
"""

MIN_PROOF_ARC_SINE = 1e-6
"""Smallest sine of the arc of a link on two axes; at 0 the link can spin about them.

Larger: mechanisms with short arcs are refused. Smaller: the bounds of derivatives, which
are divided by the sine, grow, and boxes must be smaller.
"""


def jet_product(
    first: Jet,
    second: Jet,
    multiply: Callable[[Any, Any], Any],
    order: int,
    added: Jet | None = None,
) -> Jet:
    """Return a product of two functions with its derivatives, by the product rule.

    A jet is a mapping with an array of balls under the key (). The keys (j,) and (j, l)
    have its derivatives with respect to the variables j and l. A ball is a number with a
    bound of its error. A missing key means 0. With the factors f and g, the result has the
    values

        ()              f g
        (j,)            f_j g + f g_j
        (j, l), j < l   f_jl g + f_j g_l + f_l g_j + f g_jl
        (j, j)          f_jj g + 2 f_j g_j + f g_jj

    Parameters
    ----------
    first, second
        Jets of the two factors.
    multiply
        The bilinear product of two arrays, for example `np.matmul`.
    order
        Highest order of the derivatives: 0, 1 or 2.
    added
        A jet that is added to the product, by default none.
    """
    result: dict[tuple[int, ...], Any] = dict(added or {})
    for first_key, first_array in first.items():
        for second_key, second_array in second.items():
            if len(first_key) + len(second_key) > order:
                continue
            # Each pair of keys gives one term of the table above.
            key = tuple(sorted(first_key + second_key))
            term = multiply(first_array, second_array)
            is_mixed_term_of_one_variable = first_key == second_key and first_key != ()
            if is_mixed_term_of_one_variable:
                term = term + term  # 2 f_j g_j
            result[key] = result[key] + term if key in result else term
    return result


@dataclass(frozen=True)
class ClosingLinkPlacement:
    """The constants by which a link is oriented when two of its axes are known in space.

    Two of its pairs (joints) join it to two other links, its parents, which are placed
    already. U and W are the directions of the two pairs, as the parents are placed.
    The arc between U and W is a size of the link, so U and W must satisfy an equation.

    Attributes
    ----------
    parent_axes
        For each of the two pairs its axis (3,) in link axes of the parent.
    dual_rows
        Three vectors (3,) a, b, n in link axes: the dual basis of the two pair axes and
        their cross product. The matrix U a^T + W b^T + (U x W) n^T is the orientation of
        the link.
    arc_cosine
        Cosine of the arc of the link between its two axes, as a ball (a number with a bound
        of its error).
    arc_sine
        Lower bound of the sine of this arc. The lengths of `dual_rows` are at most 1 /
        sine.
    """

    parent_axes: list[Vector]
    dual_rows: list[Vector]
    arc_cosine: Ball
    arc_sine: float


class ArcEquations:
    """The closure equations f = 0 of a mechanism, evaluated in ball arithmetic.

    A ball is a number with a bound of its error, so results are proven. Links are placed
    one after another. Each link that is put on the axes of two placed links gives one
    equation: the arc between both axes equals the arc of the link. The precision in bits is
    set by `working_precision`.

    Parameters
    ----------
    decimal_mechanism
        The mechanism with its decimal sizes.
    construction
        The order of placing its links. It also numbers the equations and the variables.

    Attributes
    ----------
    unknown_count, variable_count
        Numbers of unknown angles and of all variables.
    degrees
        (equations, variables) degree of each equation, a trigonometric polynomial, in each
        variable.
    pair_frames
        For every pair, its frame in each of its two links. The rows of a frame are the zero
        direction, the side and the axis of the pair.
    follower_offsets
        By pair: the angle (rad) of a follower when the input is 0. A follower is a pair
        with an angle that follows from the inputs through wheels. Its angle is this
        constant plus a multiple of the input angle. Empty if the angles of followers are
        variables.

    Raises
    ------
    PlanError
        If a link that is put on two axes has an arc of about 0 or 180 degrees.
    """

    def __init__(
        self, decimal_mechanism: DecimalMechanism, construction: Construction
    ) -> None:
        """Compute the constants by which each link is placed, as balls.

        A ball is a number with a bound of its error. The equations serve to prove
        statements on the configurations of a mechanism.

        Parameters
        ----------
        decimal_mechanism
            The mechanism with its decimal sizes.
        construction
            The order in which links are placed. There are two kinds of links. A link that
            one pair (joint) joins to a placed link rotates about the axis of this pair. A
            closing link is joined to two placed links, its parents, by one pair each. It
            gives an equation: the angle between the two pair axes, as the parents place
            them, equals the arc between both axes in the closing link.
        """
        self.decimal_mechanism = decimal_mechanism
        self.construction = construction
        self.unknown_count = construction.unknown_count
        self.variable_count = len(construction.pairs)
        # (equations, variables) degree of each equation in cos and sin of each variable.
        self.degrees = construction.degrees
        self.pair_frames = decimal_mechanism.pair_frames()
        # Toothed wheels (followers) turn by a multiple of the input's angle, plus these
        # constants.
        self.follower_offsets = _follower_offsets(decimal_mechanism, construction)
        # Both dictionaries have links as keys. The first has the rotation of each link with
        # one parent, the second the constants of each closing link.
        self._rotation_terms = {
            step.link: self._pair_rotation_terms(step)
            for step in construction.steps
            if not step.has_two_parents
        }
        self._closing_link_placements = {
            step.link: self._place_closing_link(step)
            for step in construction.equation_steps
        }

    def pair_frame(self, pair: int, link: int) -> Frame:
        """Return the frame of a pair in one of its links."""
        side = self.decimal_mechanism.structure.ends[pair].index(link)
        return self.pair_frames[pair][side]

    def _pair_rotation_terms(self, step: PlacementStep) -> Array:
        """Return the rotation of a link relative to its parent, depending on its variable.

        The parent is a link placed before. One pair (joint) joins both, and the link
        rotates about its axis. `step` describes this placement.

        Returns
        -------
        (3, 3, 3) matrices T, in balls (numbers with error bounds). T[0] + cos(x) T[1] +
        sin(x) T[2] rotates from link axes to the axes of the parent. The angle of the pair
        is x. The angle of a follower, a pair that the input drives through toothed wheels,
        is x plus a constant offset.
        """
        (pair,) = step.pairs
        terms = revolute_rotation_terms(*self.pair_frames[pair])
        first_link, _second_link = self.decimal_mechanism.structure.ends[pair]
        if first_link not in step.parents:
            # The terms rotate from the second link of the pair to the first. Here the link
            # is the first one, so the rotation is transposed.
            terms = terms.swapaxes(1, 2)
        if pair in self.follower_offsets:
            # The pair is a follower. The rotation by its offset becomes part of T.
            terms = _shift_angle(terms, self.follower_offsets[pair])
        return terms

    def _place_closing_link(self, step: PlacementStep) -> ClosingLinkPlacement:
        """Return the constants by which a link is oriented from two of its axes.

        Two pairs (joints) join the link to two links placed before, its parents. In each
        configuration, the parents determine the directions U and W of the two pair axes.
        The orientation of the link is the matrix that takes its own two axes to U and W.
        The constants of this matrix are computed here, once for all configurations. All
        numbers are balls: numbers with a bound of their error.

        Raises
        ------
        PlanError
            If the arc between both axes is about 0 or 180 degrees. The link could spin
            about the common line of its axes, so these do not determine the orientation.
        """
        # Row 2 of a frame is the axis of its pair.
        first_axis, second_axis = (
            self.pair_frame(pair, step.link)[2] for pair in step.pairs
        )
        normal = np.cross(first_axis, second_axis)
        sine_squared = normal @ normal
        arc_sine = _lower_sine_bound(sine_squared)
        if not arc_sine > MIN_PROOF_ARC_SINE:
            structure = self.decimal_mechanism.structure
            raise PlanError(
                f"{structure.name}: link {structure.links[step.link]} has an arc of about "
                "0 or 180 deg between two pairs, about which the link could spin, so "
                "nothing can be proven about it; change this arc"
            )
        # The dual basis of three vectors: the two axes and their cross product. The first
        # dual vector has the dot product 1 with the first vector, and 0 with the other two.
        # The other dual vectors are defined in the same way.
        dual_rows = [
            np.cross(second_axis, normal) / sine_squared,
            np.cross(normal, first_axis) / sine_squared,
            normal / sine_squared,
        ]
        # The axis of each pair in the parent, the other link of the pair.
        parent_axes = [
            self.pair_frame(pair, parent)[2]
            for pair, parent in zip(step.pairs, step.parents, strict=True)
        ]
        return ClosingLinkPlacement(
            parent_axes=parent_axes,
            dual_rows=dual_rows,
            arc_cosine=first_axis @ second_axis,
            arc_sine=arc_sine,
        )

    def evaluate(self, variables: Sequence[Ball] | Array, order: int = 1) -> list[Array]:
        """Return the equations f and their derivatives at balls of all variables.

        Each equation belongs to a link that is put on the axes of two placed links. It says
        that the arc between these axes equals the arc of the link; f = 0 if it holds. A
        ball is a number with a bound of its error.

        Parameters
        ----------
        variables
            Balls (rad) of all variables, real or complex.
        order
            Highest order of the derivatives: 0, 1 or 2.

        Returns
        -------
        Arrays of balls for k equations and v variables: f (k,), then its derivatives
        f' (k, v) and f'' (k, v, v) up to the order.
        """
        equation_count = len(self.degrees)  # `degrees` has a row for each equation
        shape = [equation_count, *[self.variable_count] * order]
        arrays = [
            np.full(shape[: power + 1], exact_ball(0.0)) for power in range(order + 1)
        ]
        jets, _ = self._evaluate_jets(variables, order)
        # A jet has f and its derivatives. Keys are the indices of the variables with
        # respect to which f is differentiated: (), (j,) or (j, l).
        for equation, jet in enumerate(jets):
            for key, entry in jet.items():
                array = arrays[len(key)]
                array[(equation, *key)] = entry
                # Second derivatives are symmetric, and the jet has only (j, l) with j <= l.
                array[(equation, *key[::-1])] = entry
        return arrays

    def link_orientations(
        self, variables: Sequence[Ball], order: int = 0
    ) -> dict[int, Jet]:
        """Return all link orientations, and derivatives with respect to the variables.

        Variables and orientations are balls: numbers with bounds of their errors. The
        orientations are relative to the root, the link that is placed first. From
        their first derivatives, the angular velocities of the links can be computed.

        Parameters
        ----------
        variables
            Balls (rad) of all variables of the closure equations.
        order
            Highest order of the derivatives: 0, 1 or 2.

        Returns
        -------
        For each link the jet of its rotation matrix (3, 3) from link axes to the axes of
        the root. A jet has the matrix under the key (). The keys (j,) and (j, l) have its
        derivatives with respect to the variables j and l. A missing key means zero.
        """
        # At first each orientation is relative to a link placed earlier, its reference. The
        # product with the orientation of the reference leads to the root.
        _, orientations = self._evaluate_jets(variables, order)
        # The root does not rotate, so its jet has no derivatives.
        orientations[self.construction.root] = {(): exact_balls(np.eye(3))}
        for step in self.construction.steps:
            reference = self.construction.placements[step.link].reference
            orientations[step.link] = jet_product(
                orientations[reference], orientations[step.link], np.matmul, order
            )
        return orientations

    def link_rotations(self, variables: Sequence[Ball]) -> dict[int, Array]:
        """Return, by link, the rotation matrix (3, 3) from link axes to root axes.

        The root is the link that is placed first. Matrices and variables (rad) are balls,
        which are numbers with bounds of their errors.
        """
        orientations = self.link_orientations(variables)
        return {link: jet[()] for link, jet in orientations.items()}

    def _evaluate_jets(
        self, variables: Sequence[Ball] | Array, order: int
    ) -> tuple[list[Jet], dict[int, Jet]]:
        """Return the jets of all equations and of the link orientations.

        A jet is a mapping with an array and its derivatives with respect to the variables,
        in balls. The key () has the array, (j,) its first derivative with respect to the
        variable j, and (j, l) with j <= l a second derivative. A missing key means zero.

        Links are placed one after another. A link with one parent is rotated by the angle
        of the pair between both. A closing link is put on the axes U and W of two placed
        links, which gives the equation f = U . W - cos(arc) = 0, where arc is the constant
        arc between the two axes of the link. If the equation is satisfied, the orientation
        of the link is U a^T + W b^T + (U x W) n^T. The rows a, b, n are the dual basis, in
        link axes, of both axes and their vector product.

        Parameters
        ----------
        variables
            Balls (rad) of all variables of the construction, real or complex. A ball is a
            number with a bound of its error.
        order
            Highest order of the derivatives: 0, 1 or 2.

        Returns
        -------
        equations
            The jet of f of each equation, in the order of the closing links.
        orientations
            By link the jet of its rotation matrix (3, 3) to the axes of its reference link:
            its parent, or for a closing link the one at which the paths of its parents
            meet.
        """
        equations: list[Jet] = []
        orientations: dict[int, Jet] = {}

        def carry_along(path: Sequence[int], axis: Vector) -> Jet:
            """Return an axis of the first link of a path in axes of the shared link.

            A closing link is put on the axes of two links, its parents. The paths of
            reference links lead from both parents to the first link that they share. The
            result is a jet: the axis with its derivatives with respect to the variables.
            """
            # Each link's orientation leads to its reference, the next link of the path.
            jet: Jet = {(): axis}
            for link in path:
                jet = jet_product(orientations[link], jet, np.matmul, order)
            return jet

        for step in self.construction.steps:
            if not step.has_two_parents:
                # Derivatives of the rotation above the requested order are left out.
                rotation = _rotation_jet(self._rotation_terms[step.link], variables, step)
                orientations[step.link] = {
                    key: array for key, array in rotation.items() if len(key) <= order
                }
                continue
            placement = self._closing_link_placements[step.link]
            paths = self.construction.parent_paths(step)
            first_parent_axis, second_parent_axis = placement.parent_axes
            # Both axes in the axes of the link at which the paths of the parents meet.
            U = carry_along(paths.first, first_parent_axis)
            W = carry_along(paths.second, second_parent_axis)
            equations.append(
                jet_product(U, W, np.dot, order, added={(): -placement.arc_cosine})
            )
            # U a^T + W b^T + (U x W) n^T, one term after another.
            orientation: Jet = {}
            for axis, row in zip(
                (U, W, jet_product(U, W, _cross, order)), placement.dual_rows, strict=True
            ):
                orientation = jet_product(
                    axis, {(): row}, np.multiply.outer, order, added=orientation
                )
            orientations[step.link] = orientation
        return equations, orientations

    @cached_property
    def derivative_bound(self) -> Floats:
        """(equations,) bounds C of all derivatives of the equations at real angles.

        Proofs need them to bound the change of derivatives in a box, and rounding errors.

        An equation is f = 0, with a polynomial f in cosines and sines of the variables.
        Variable j occurs up to cos(d_j angle) and sin(d_j angle); d_j is its degree. For
        all real angles and any order k >= 1,

            abs(derivative of f with respect to the variables j1 to jk) <= C d_j1 ... d_jk

        Reason: each equation says that a link fits between two axes U and W of links placed
        before, f = U . W - cos(arc of the link). Each axis is a unit vector, multiplied by
        the orientation matrices of the links along a path. The product of the norms of
        these matrices is C, so abs(U . W) <= C. The norms can exceed 1: where the equations
        are not satisfied, the matrix of a closing link is not a rotation. By Bernstein's
        inequality, each derivative with respect to variable j multiplies the bound of U . W
        by d_j at most.
        """
        norms = self._orientation_norms
        bounds = []
        # Each step places the link of one equation.
        for step in self.construction.equation_steps:
            # `first` and `second` have the links on the paths of U and W.
            paths = self.construction.parent_paths(step)
            norm_of_U = _multiply_norms(norms, paths.first)
            norm_of_W = _multiply_norms(norms, paths.second)
            bounds.append(norm_of_U * norm_of_W)
        # Rounding errors of the products must not make a bound too small.
        return np.array(bounds) * (1 + 64 * UNIT_ROUNDOFF)

    @cached_property
    def _orientation_norms(self) -> dict[int, float]:
        """For each link an upper bound of the norm of its orientation matrix.

        The norm of a matrix is the largest factor by which it lengthens a vector. The
        orientation of a link is relative to another link, its reference. A closing link is
        put on axes of two earlier links. Its matrix is a rotation only at angles that close
        the loops, so at other angles the norm can exceed 1. The bounds are valid at all
        real angles. `derivative_bound` multiplies them.
        """
        # The orientation of a link placed by one pair is a rotation about the axis of the
        # pair, so its norm is 1. `_rotation_terms` has these links as keys.
        norms = dict.fromkeys(self._rotation_terms, 1.0)
        # With the axes U and W of the two earlier links, the matrix of a closing link is
        # U a^T + W b^T + (U x W) n^T, where a, b and n are constant vectors. U and W are
        # unit vectors, each multiplied by the orientation matrices along a path of links.
        # Both paths begin where they meet, and end at the earlier links.
        for step in self.construction.equation_steps:
            # `first` and `second` have the links on the paths of U and W.
            paths = self.construction.parent_paths(step)
            # A lower bound of the sine of the arc between the two axes of the link. The
            # lengths of a, b and n are at most 1 / sine.
            arc_sine = self._closing_link_placements[step.link].arc_sine
            norms[step.link] = _bound_closing_link_norm(
                first_norm=_multiply_norms(norms, paths.first),
                second_norm=_multiply_norms(norms, paths.second),
                arc_sine=arc_sine,
            )
        return norms

    @cached_property
    def harmonics(self) -> Harmonics:
        """The same equations at real angles by their Fourier coefficients, in float64."""
        return Harmonics(self.degrees, lambda angles: self.evaluate(angles, 0)[0])


def _shift_angle(terms: Array, offset: Ball) -> Array:
    """Return a rotation by the angle x + offset as a function of x.

    A pair that the input drives through toothed wheels has the angle x + offset, where x is
    a multiple of the input angle. The equations are functions of x. The result follows from
    cos(x + o) = cos(x) cos(o) - sin(x) sin(o) and sin(x + o) = sin(x) cos(o) +
    cos(x) sin(o).

    Parameters
    ----------
    terms
        (3, 3, 3) matrices that multiply 1, cos(x + offset) and sin(x + offset).
    offset
        Constant angle (rad), a ball (number with a bound of its error).

    Returns
    -------
    (3, 3, 3) matrices that multiply 1, cos(x) and sin(x).
    """
    sine, cosine = offset.sin_cos()
    constant, cosine_term, sine_term = terms
    shifted_cosine_term = cosine_term * cosine + sine_term * sine
    shifted_sine_term = sine_term * cosine - cosine_term * sine
    return np.array([constant, shifted_cosine_term, shifted_sine_term])


def _lower_sine_bound(sine_squared: Ball) -> float:
    """Return a lower bound, in float64, of a positive sine from its square as a ball."""
    # The square root and the product each have a relative error of at most one unit
    # roundoff, which the factor covers several times.
    return np.sqrt(lower_magnitude(sine_squared)) * (1 - 8 * UNIT_ROUNDOFF)


def _follower_offsets(
    decimal_mechanism: DecimalMechanism, construction: Construction
) -> dict[int, Ball]:
    """Return the constant parts of the angles of pairs that wheels drive.

    A follower is a pair (joint) that the only input drives through toothed wheels. Its
    angle is a multiple of the input angle plus a constant, the offset. The equations of a
    mechanism have one of two kinds of variables:

    - Input and followers share one variable. The angle of a follower is a factor
      (`PlacementStep.angle_factor`) times this variable, plus the offset. The caller makes
      the offset part of the rotation about the pair, and needs the result for this.
    - Each follower has a variable of its own, which is the whole angle. No offset is added,
      and the result is empty.

    The result is also empty if there are no wheels.

    Parameters
    ----------
    decimal_mechanism
        The mechanism with its decimal sizes.
    construction
        The order of placing its links, which says which angles are variables.

    Returns
    -------
    For each follower, by index of the pair, its offset (rad) as a ball (a number with a
    bound of its error).
    """
    has_wheels = bool(decimal_mechanism.meshes)
    # `follower_pairs` are only the followers with a variable of their own.
    has_follower_variables = bool(construction.follower_pairs)
    if has_follower_variables or not has_wheels:
        return {}
    # The offset is the angle of the follower when the input has the angle 0.
    _input_angle, *follower_angles = decimal_mechanism.known_angles([exact_ball(0.0)])
    followers = decimal_mechanism.structure.followers
    return dict(zip(followers, follower_angles, strict=True))


def _multiply_norms(norms: Mapping[int, float], path: Sequence[int]) -> float:
    """Return the product of the norms of the links of a path."""
    return prod(norms[link] for link in path)


def _bound_closing_link_norm(
    first_norm: float, second_norm: float, arc_sine: float
) -> float:
    """Return an upper bound of the norm of the matrix U a^T + W b^T + (U x W) n^T.

    The matrix is the orientation of a closing link, which is put on two axes U and W of
    links placed before. The lengths of the constant vectors a, b and n are at most 1 / sine
    of the arc between the two axes.

    Parameters
    ----------
    first_norm, second_norm
        Upper bounds of the lengths of U and W.
    arc_sine
        Lower bound of the sine of the arc.

    Returns
    -------
    The bound.
    """
    # Five float64 operations are rounded. An allowance of 16 roundings covers these.
    rounding_allowance = 1 + 16 * UNIT_ROUNDOFF
    sum_of_norms = (
        first_norm + second_norm + first_norm * second_norm
    ) * rounding_allowance
    return sum_of_norms / arc_sine


def _cross(a: Vector, b: Vector) -> Vector:
    """Return the vector product; NumPy's takes ten times as long for two vectors."""
    next_index = [1, 2, 0]
    last_index = [2, 0, 1]
    return a[next_index] * b[last_index] - a[last_index] * b[next_index]


def _rotation_jet(
    terms: Array, variables: Sequence[Ball] | Array, step: PlacementStep
) -> Jet:
    """Return a rotation about one pair, with its derivatives with respect to the variable.

    The angle of the pair is x = factor * variable j. The factor is 1 if there are no
    toothed wheels. With wheels, several angles are whole multiples of one variable. All
    numbers are balls (numbers with a bound of their error).

    Parameters
    ----------
    terms
        (3, 3, 3) matrices T of the rotation T[0] + cos(x) T[1] + sin(x) T[2].
    variables
        Values (rad) of all variables of the mechanism.
    step
        How the link is placed: the factor (`angle_factor`), and the number j (`variable`).

    Returns
    -------
    The `Jet` of the rotation: the (3, 3) matrix under the key (), its first derivative with
    respect to the variable under (j,) and its second derivative under (j, j).
    """
    factor = step.angle_factor
    j = step.variable
    sine, cosine = (variables[j] * factor).sin_cos()
    constant, cosine_term, sine_term = terms
    varying = cosine_term * cosine + sine_term * sine
    derivative = sine_term * cosine - cosine_term * sine
    # By the chain rule, each derivative with respect to the variable has the factor
    # dx/d(variable).
    return {
        (): constant + varying,
        (j,): derivative * factor,
        (j, j): -varying * factor**2,
    }
