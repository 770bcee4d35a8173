"""Positions in closed form as expressions, for mechanisms whose groups are all dyads.

The angles of the inputs and one sign for each dyad give the orientations of all links. The
directions of axes are computed from each other without the angles of other pairs. The
angles of other pairs follow afterwards, if the caller uses them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from spherekit.arrays import Bools, Floats, Integers
from spherekit.errors import EngineError
from spherekit.geometry.dyad_axis import HalfAngle, middle_axis, triple_square
from spherekit.mechanism.graph import find_spanning_tree
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.assembly_plan import Assembly, Group
from spherekit.symbolic.expression_graph import Expr, ExpressionNode, dot, function, symbols
from spherekit.symbolic.vector_algebra import Exprs, constants, cross
from spherekit.tolerances import MAX_UNREACHED_SQUARE
from spherekit.velocities.axis_rotations import Entries, pair_rotations
from spherekit.velocities.kinematic_structure import KinematicStructure
from spherekit.velocities.pose_expressions import (
    GROUND_ORIENTATION,
    LinkOrientation,
    place_by_variables,
)

MIN_RELIABLE_SQUARE = 1e-16
"""Smallest square of the triple product of a dyad with which bodies are placed to 1e-8 rad.

Later dyads whose axes depend on a dyad with a smaller square are not judged. Larger: fewer
of these are found out of reach. Smaller: axes with larger errors are trusted.
"""


@dataclass(frozen=True)
class DyadPlacement:
    """Orientations of all links as formulas, for mechanisms that consist of dyads.

    A dyad is two links in series between two other links, joined by three pairs (joints).

    Attributes
    ----------
    orientations
        The orientation of each link.
    triple_squares
        For each dyad the square of the triple product u_1 . (u_2 x u_3) of the axes of its
        pairs. It is computed from the arcs of the two links and the angle between the two
        outer axes. The square is negative if the arcs are too short or too long to close
        the dyad. It shows the caller at which inputs there is no configuration.
    """

    orientations: list[LinkOrientation]
    triple_squares: list[Expr]


@dataclass(frozen=True)
class BodyAxis:
    """The axis of a pair (joint), as fixed in one of the two links that the pair joins.

    To place a dyad, the axes of its pairs are needed in the axes of the bodies that they
    join. A body is a group of links whose orientations relative to each other are known.

    Attributes
    ----------
    orientation
        Orientation of the link relative to the body to which it belongs.
    axis
        (3,) unit vector of the axis in link axes.
    """

    orientation: LinkOrientation
    axis: Entries

    @property
    def direction(self) -> Exprs:
        """(3,) direction of the axis, in the axes of the body."""
        return self.orientation.direction(self.axis)


def place_by_inputs(
    structure: KinematicStructure, q: Sequence[Expr], signs: Sequence[Expr]
) -> DyadPlacement:
    """Return the orientations of all links for given inputs and signs.

    A dyad is two links in series between two other links. It can be closed in two ways,
    and the sign of the dyad chooses one of them. Links whose relative orientations are
    known form a body. The inputs determine the bodies at the beginning, and each dyad
    unites three of them.

    The rotation of a link from link axes to ground axes is `basis @ basis_from_link`, see
    `LinkOrientation`. Only `basis` changes when a body is turned.

    Parameters
    ----------
    structure
        A mechanism whose groups are all dyads.
    q
        Angles (rad) of the inputs.
    signs
        +1 or -1 for each dyad in solving order: the sign of u_1 . (u_2 x u_3) with the axes
        of its pairs in file order, as in `AssemblyMode`.

    Returns
    -------
    The orientations, and for each dyad the square of the triple product u_1 . (u_2 x u_3),
    which is negative if the dyad does not close.

    Raises
    ------
    EngineError
        If a group is not a dyad.
    """
    mechanism = structure.mechanism
    assembly = structure.assembly
    if not assembly.has_closed_form:
        raise EngineError(
            f"{mechanism.name}: not every group is a dyad, so positions have no closed "
            "form; give the variables of a motion instead of the input"
        )
    driven_angles = dict(zip(structure.inputs, q, strict=True))
    driven_angles |= structure.follower_angles(q)
    variables = [driven_angles.get(v) for v in range(len(mechanism.variable_names))]
    # The driven pairs place the links of each body relative to its first link.
    steps = find_spanning_tree(mechanism.ends, assembly.body_of_link, assembly.inputs)
    orientations = place_by_variables(mechanism, structure.pairs, variables, steps)
    # Each dyad becomes part of the first body of its group. `_close_dyad` changes
    # `orientations` in place.
    triple_squares = [
        _close_dyad(structure, group, sign, orientations)
        for group, sign in zip(assembly.groups, signs, strict=True)
    ]
    ground = orientations[0]
    if ground.depth:
        # The depth is not 0 if the ground was placed relative to another link of its body,
        # or if a dyad has turned this body. All links are turned by the inverse of the
        # rotation of the ground, so that the ground has its own axes again.
        inverse_rotation = constants(ground.basis_from_link.T) @ ground.basis.T
        orientations = [
            replace(
                orientation,
                basis=inverse_rotation @ orientation.basis,
                depth=orientation.depth + 1,
            )
            for orientation in orientations
        ]
        orientations[0] = GROUND_ORIENTATION
    return DyadPlacement(orientations, triple_squares)


def _close_dyad(
    structure: KinematicStructure,
    group: Group,
    sign: Expr,
    orientations: list[LinkOrientation],
) -> Expr:
    """Rotate the two free bodies of a dyad so that the dyad is closed.

    A body is a set of links that do not move relative to each other. The bodies of a dyad
    are numbered: the two outer pairs join the free bodies 1 and 2 to body 0, and the middle
    pair joins the free bodies to each other. Each free body has an arc from its outer axis
    to its middle axis. The two arcs start at the outer axes in body 0 and meet in the
    middle axis. There are two such directions, and the sign chooses one.

    Parameters
    ----------
    structure, group, sign
        The mechanism, the dyad and its sign as in `place_by_inputs`.
    orientations
        Orientations of all links, each relative to the body to which it belongs. The
        orientations of the links of the two free bodies are replaced in place.

    Returns
    -------
    The square of the triple product of the axes of the dyad.
    """
    mechanism = structure.mechanism
    first_outer, middle, second_outer = group.dyad_positions

    def body_axis(position: int, body: int) -> BodyAxis:
        """Return the axis of a pair of the group in a body of the group."""
        pair = group.pairs[position]
        end = group.ends[position].index(body)
        link = mechanism.ends[pair][end]
        return BodyAxis(orientations[link], structure.pairs.axes(pair)[end])

    # Known are the outer axes a and c in body 0, and the outer and the middle axis in each
    # of the free bodies 1 and 2.
    a = body_axis(first_outer, 0).direction
    c = body_axis(second_outer, 0).direction
    first_body_axes = body_axis(first_outer, 1), body_axis(middle, 1)
    second_body_axes = body_axis(second_outer, 2), body_axis(middle, 2)
    first_arc = _arc_between(*first_body_axes)
    second_arc = _arc_between(*second_body_axes)

    # The middle direction is a combination of a + c, a - c and a x c, whose factors follow
    # from the two arcs and from the triple product of the three axes.
    axis_sum = a + c
    axis_difference = a - c
    sum_square = dot(axis_sum, axis_sum)
    difference_square = dot(axis_difference, axis_difference)
    square = triple_square(first_arc, second_arc, sum_square, difference_square)
    # The sign refers to the axes in file order. The parity says whether (a, middle, c) is
    # an odd permutation of that order.
    parity_sign = sign if group.dyad_parity > 0 else -1.0 * sign
    triple_product = function("sqrt", square) * parity_sign
    sum_factor, difference_factor, normal_factor = middle_axis(
        first_arc, second_arc, sum_square, difference_square, triple_product
    )
    middle_direction = np.asarray(
        axis_sum * sum_factor
        + axis_difference * difference_factor
        + cross(a, c) * normal_factor
    )

    # The depth ranks links by the length of their expressions. The links of the dyad now
    # have the longest ones.
    depth = 1 + max(orientation.depth for orientation in orientations)
    for body, outer_direction, body_axes in (
        (1, a, first_body_axes),
        (2, c, second_body_axes),
    ):
        # The rotation that leads from the two axes of the body to their new directions.
        rotation = _axis_frame(outer_direction, middle_direction) @ _inverse_axis_frame(
            *(axis.direction for axis in body_axes)
        )
        for link in group.bodies[body]:
            orientations[link] = replace(
                orientations[link], basis=rotation @ orientations[link].basis, depth=depth
            )
    return square


def _axis_frame(a: Exprs, b: Exprs) -> Exprs:
    """Return the columns a + b, a - b and a x b (3, 3) of two unit vectors.

    The columns are perpendicular to each other and serve as a frame of a and b. If a and b
    nearly coincide, few digits are lost, unlike with a, b and a x b.
    """
    return np.stack([a + b, a - b, cross(a, b)], axis=1)


def _inverse_axis_frame(a: Exprs, b: Exprs) -> Exprs:
    """Return the inverse (3, 3) of the matrix with the columns a + b, a - b and a x b.

    The unit vectors a and b (3,) are two axes of a body. A rotation leads them to new
    directions a' and b'. Its matrix is [a' + b', a' - b', a' x b'] times this inverse. Sums
    and differences keep their digits if a and b are nearly equal or nearly opposite.

    Let s = a + b, d = a - b and n = a x b. The three are perpendicular to each other,
    because s . d = |a|^2 - |b|^2 = 0. So the rows of the inverse are

        s / |s|^2,   d / |d|^2,   n / |n|^2.

    With rounded numbers, s . d is not exactly 0. If s or d is short, these rows are
    therefore inaccurate. The number tilt = s . d / (|s|^2 |d|^2) corrects them to first
    order: tilt d is subtracted from the first row, and tilt s from the second.
    """
    axis_sum = a + b
    axis_difference = a - b
    inverse_sum_square = 1.0 / dot(axis_sum, axis_sum)
    inverse_difference_square = 1.0 / dot(axis_difference, axis_difference)
    tilt = dot(axis_sum, axis_difference) * inverse_sum_square * inverse_difference_square
    # The row of n uses |n|^2 = |s|^2 |d|^2 / 4.
    normal_row = cross(a, b) * (4.0 * (inverse_sum_square * inverse_difference_square))
    return np.stack(
        [
            axis_sum * inverse_sum_square - axis_difference * tilt,
            axis_difference * inverse_difference_square - axis_sum * tilt,
            normal_row,
        ]
    )


def _arc_between(first: BodyAxis, second: BodyAxis) -> HalfAngle:
    """Return the arc between two axes of one body, as sine and cosine of half the arc.

    A body is a set of links that do not move relative to each other. The two axes may be in
    the same link or in different links of the body. For unit vectors a and b, the sine and
    cosine are |a - b| / 2 and |a + b| / 2. The formulas are accurate for small arcs, too.
    """
    if first.orientation is second.orientation:
        # Both axes are in one link. In link axes they are numbers (or expressions of sizes
        # that are symbols), and so is the arc.
        a = constants(first.axis)
        b = constants(second.axis)
    else:
        # The axes are in two links. In common axes they are expressions.
        a = first.direction
        b = second.direction
    axis_sum = a + b
    axis_difference = a - b
    half_sine = 0.5 * np.sqrt(dot(axis_difference, axis_difference))
    half_cosine = 0.5 * np.sqrt(dot(axis_sum, axis_sum))
    return HalfAngle(half_sine, half_cosine)


@dataclass(frozen=True)
class ClosedForm:
    """Formulas of all pair (joint) variables of a mechanism as functions of its inputs.

    Attributes
    ----------
    arguments
        Symbols of the inputs (rad), then of the signs of the dyads. A dyad (two links
        joined by a pair) can be closed in two ways. Its sign, +1 or -1, chooses one of
        them.
    variables
        Expressions (rad) of all pair variables. Variables of pairs that are not inputs are
        in [-pi, pi].
    triple_squares
        For each dyad, in the order in which dyads are solved, the square of the triple
        product of its three axes. The square follows from the arcs between the axes. It is
        negative if the dyad cannot be closed.
    """

    arguments: list[ExpressionNode]
    variables: list[Expr]
    triple_squares: list[Expr]


def make_closed_form(mechanism: Mechanism, assembly: Assembly) -> ClosedForm | None:
    """Return formulas of all pair (joint) variables as functions of inputs and signs.

    A dyad is two links in series between two other links. It can be closed in two ways, and
    a sign chooses one of them. If its links are too short or too long to close the dyad,
    the square of the triple product of its three axes, computed from the arcs of its links,
    is negative.

    Parameters
    ----------
    mechanism
        The mechanism.
    assembly
        Its driven pairs, and its groups: sets of links that are placed together, one group
        after another.

    Returns
    -------
    The variables as expressions, with the squares of the triple products. None if a group
    is not a dyad, or if there are no groups.
    """
    if not assembly.has_closed_form or not assembly.groups:
        return None
    inputs = symbols(f"q_{k + 1}" for k in range(len(assembly.inputs)))
    signs = symbols(f"sign_{k + 1}" for k in range(len(assembly.groups)))
    # Velocity equations of the groups are not needed for positions.
    group_equations = ()
    structure = KinematicStructure(
        mechanism, assembly, pair_rotations(mechanism), group_equations
    )
    placement = place_by_inputs(structure, inputs, signs)
    input_by_pair = dict(zip(assembly.inputs, inputs, strict=True))
    variables: list[Expr] = []
    # `variable_owners` has the pair of each variable.
    for pair in mechanism.variable_owners:
        if pair in input_by_pair:
            variables.append(input_by_pair[pair])
        else:
            variables.append(pair_angle(structure, pair, placement.orientations))
    return ClosedForm([*inputs, *signs], variables, placement.triple_squares)


def write_arguments(q: Floats, signs: Integers, out: Floats) -> Floats:
    """Write inputs and signs into an array, in the order of `ClosedForm.arguments`.

    The signs choose how the dyads (two links joined by a pair) are closed. The array is
    also returned.

    Parameters
    ----------
    q
        (inputs, n) values of the inputs (rad).
    signs
        (dyads, n) signs, +1 or -1, of the dyads.
    out
        (inputs + dyads, n) array that is filled.
    """
    out[: len(q)] = q
    out[len(q) :] = signs
    return out


def find_out_of_reach(triple_squares: Floats) -> Bools:
    """Return a mask (n,) of configurations in which a dyad certainly cannot be closed.

    If the links of a dyad (two links joined by a pair) are too short or too long to close
    the dyad, the square of the triple product of its axes is negative. A small square means
    that the dyad is nearly stretched or folded. The axes of later dyads have large errors
    in this case, so later dyads are not judged.

    Parameters
    ----------
    triple_squares
        (dyads, n) values of `ClosedForm.triple_squares`, in solving order.
    """
    is_out_of_reach = np.zeros(triple_squares.shape[1], dtype=bool)
    # Whether the axes of the next dyad are accurate enough to judge it.
    is_reliable = ~is_out_of_reach
    with np.errstate(invalid="ignore"):
        for square in triple_squares:
            is_out_of_reach |= is_reliable & (square < MAX_UNREACHED_SQUARE)
            is_reliable &= square > MIN_RELIABLE_SQUARE
    return is_out_of_reach


def pair_angle(
    structure: KinematicStructure, pair: int, orientations: Sequence[LinkOrientation]
) -> Expr:
    """Return the angle of an R pair (revolute joint), rad in [-pi, pi].

    The angle is counted about the axis, from the zero direction of the pair in its first
    link to the zero direction in its second link.

    Parameters
    ----------
    structure, pair
        The mechanism, and the index of the pair.
    orientations
        Orientations of all links.
    """
    # The constants are the frame of the pair in the first link, and its transposed frame in
    # the second. The columns of a frame are the zero direction, the direction 90 degrees
    # ahead, and the axis.
    first_frame, transposed_second_frame = structure.pairs.chains[pair].constants
    first_link, second_link = structure.mechanism.ends[pair]
    first = orientations[first_link]
    zero = first.direction(first_frame[:, 0])
    quarter = first.direction(first_frame[:, 1])
    # The zero direction in the second link has the components cos and sin of the angle.
    pointer = orientations[second_link].direction(transposed_second_frame[0])
    return function("atan2", dot(quarter, pointer), dot(zero, pointer))
