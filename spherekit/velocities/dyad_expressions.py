"""Positions in closed form as expressions, for mechanisms whose groups are all dyads.

The inputs' angles and one sign for each dyad give the directions of all axes; no angle of
any other pair is formed.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from spherekit.arrays import Bools, Floats, Integers
from spherekit.errors import EngineError
from spherekit.geometry.dyad_axis import HalfAngle, middle_axis, triple_square
from spherekit.mechanism.cache import MechanismCache
from spherekit.mechanism.graph import find_spanning_tree
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.assembly_plan import Assembly, Group
from spherekit.symbolic.expression_graph import Expr, ExpressionNode, dot, function, symbols
from spherekit.symbolic.vector_algebra import Exprs, constants, cross
from spherekit.velocities.axis_rotations import Entries, pair_rotations
from spherekit.velocities.kinematic_structure import KinematicStructure
from spherekit.velocities.pose_expressions import (
    GROUND_ORIENTATION,
    LinkOrientation,
    place_by_variables,
)

COMPILED = MechanismCache()
"""Kernels and equations of motion that were compiled."""


def place_by_inputs(
    structure: KinematicStructure, q: Sequence[Expr], signs: Sequence[Expr]
) -> tuple[list[LinkOrientation], list[Expr]]:
    """Return the placements of all links for the angles q of the inputs.

    With them, of the dyads that these follow from, the squares of triple products, negative
    where arcs do not reach.

    `signs` are those of the dyads in solving order, as in
    `spherekit.positions.assembly_mode.AssemblyMode`: +1 or -1, the sign of u_1 . (u_2 x
    u_3) with the axes of the dyad's pairs in file order.

    Raises
    ------
    EngineError
        If a group is not a dyad.
    """
    mechanism, assembly = structure.mechanism, structure.assembly
    if not assembly.has_closed_form:
        raise EngineError(
            f"{mechanism.name}: not every group is a dyad, so positions have no closed "
            "form; give the variables of a motion instead of the input"
        )
    driven = dict(zip(structure.inputs, q, strict=True)) | structure.follower_angles(q)
    variables = [driven.get(v) for v in range(len(mechanism.variable_names))]
    ways = find_spanning_tree(mechanism.ends, assembly.bodies, assembly.inputs)
    within = place_by_variables(mechanism, structure.pairs, variables, ways)
    squares = [
        _close(structure, group, sign, within)
        for group, sign in zip(assembly.groups, signs, strict=True)
    ]
    ground = within[0]
    if ground.depth:
        back = constants(ground.within.T) @ ground.basis.T
        within = [replace(x, basis=back @ x.basis, depth=x.depth + 1) for x in within]
        within[0] = GROUND_ORIENTATION
    return within, squares


def _close(
    structure: KinematicStructure, group: Group, sign: Expr, within: list[LinkOrientation]
) -> Expr:
    """Place the free bodies of a dyad; return the square of its triple product."""
    mechanism = structure.mechanism
    near, middle, far = group.dyad_positions

    def held(which: int, body: int) -> tuple[LinkOrientation, Entries]:
        pair, end = group.pairs[which], group.ends[which].index(body)
        return within[mechanism.ends[pair][end]], structure.pairs.axes(pair)[end]

    fixed = (held(outer, 0) for outer in (near, far))
    first, second = (link.direction(axis) for link, axis in fixed)
    bodies = [(near, 1), (far, 2)]
    held_axes = [(held(outer, body), held(middle, body)) for outer, body in bodies]
    near_arc, far_arc = (_side(*both) for both in held_axes)
    more, less = first + second, first - second
    squares = dot(more, more), dot(less, less)
    square = triple_square(near_arc, far_arc, *squares)
    height = function("sqrt", square) * (sign if group.dyad_parity > 0 else -1.0 * sign)
    along, beside, upright = middle_axis(near_arc, far_arc, *squares, height)
    third = more * along + less * beside + cross(first, second) * upright
    reached = np.asarray(third)
    depth = 1 + max(placement.depth for placement in within)
    for (_, body), sides in zip(bodies, held_axes, strict=True):
        ends = (link.direction(axis) for link, axis in sides)
        onto = _frame(first if body == 1 else second, reached) @ _inverse(*ends)
        for link in group.bodies[body]:
            turned = onto @ within[link].basis
            within[link] = replace(within[link], basis=turned, depth=depth)
    return square


def _frame(a: Exprs, b: Exprs) -> Exprs:
    """Return the columns a + b, a - b, a x b, at right angles to each other (unit a, b).

    Unlike a and b themselves they keep their digits where those nearly coincide.
    """
    return np.stack([a + b, a - b, cross(a, b)], axis=1)


def _inverse(a: Exprs, b: Exprs) -> Exprs:
    """Return the inverse of the frame of a and b.

    Rounding of their lengths tilts a + b and a - b against each other; where one of them
    is short that counts, so they are not taken to be at right angles.
    """
    more, less = a + b, a - b
    u, v = 1.0 / dot(more, more), 1.0 / dot(less, less)
    tilt = dot(more, less) * u * v
    third = cross(a, b) * (4.0 * (u * v))
    return np.stack([more * u - less * tilt, less * v - more * tilt, third])


def _side(
    one: tuple[LinkOrientation, Entries], other: tuple[LinkOrientation, Entries]
) -> HalfAngle:
    """Return the arc between two axes (link, direction) of a body."""
    if one[0] is other[0]:
        a, b = (constants(axis) for _, axis in (one, other))
    else:
        a, b = (link.direction(axis) for link, axis in (one, other))
    more, less = a + b, a - b
    return HalfAngle(0.5 * np.sqrt(dot(less, less)), 0.5 * np.sqrt(dot(more, more)))


OUT_OF_REACH = -1e-4
"""Squares of triple products below this are those of arcs that do not reach each other,
whatever their ends are off by."""
IN_LINE = 1e-16
"""Squares above this are those of dyads that are placed to 1e-8 rad at least."""


ClosedForm = tuple[list[ExpressionNode], list[Expr], list[Expr]]
"""The inputs with the signs of the dyads, all variables as terms of these, and the squares
of the dyads' triple products."""


def closed_form(mechanism: Mechanism, assembly: Assembly) -> ClosedForm | None:
    """Return the terms of configurations, None where a group is no dyad."""
    if not assembly.has_closed_form or not assembly.groups:
        return None
    inputs = symbols(f"q_{k + 1}" for k in range(len(assembly.inputs)))
    signs = symbols(f"sign_{k + 1}" for k in range(len(assembly.groups)))
    # Rates are not asked for, so no equations are chosen.
    structure = KinematicStructure(mechanism, assembly, pair_rotations(mechanism), ())
    placed, squares = place_by_inputs(structure, inputs, signs)
    driven = dict(zip(assembly.inputs, inputs, strict=True))
    variables = [
        driven[pair] if pair in driven else angle_of(structure, pair, placed)
        for pair in mechanism.variable_owners
    ]
    return [*inputs, *signs], variables, squares


def given_by(q: Floats, signs: Integers, out: Floats) -> Floats:
    """Write inputs q (inputs, n) and signs (dyads, n) into what functions are given."""
    out[: len(q)] = q
    out[len(q) :] = signs
    return out


def lost_by(squares: Floats) -> Bools:
    """Return (n,) where squares (dyads, n) say that there surely is no configuration.

    In solving order: one that follows a dyad in line says nothing.
    """
    lost = np.zeros(squares.shape[1], dtype=bool)
    placed = ~lost
    with np.errstate(invalid="ignore"):
        for square in squares:
            lost |= placed & (square < OUT_OF_REACH)
            placed &= square > IN_LINE
    return lost


def angle_of(
    structure: KinematicStructure, pair: int, placed: Sequence[LinkOrientation]
) -> Expr:
    """Return the variable of an R pair between placed links, less its turns."""
    chain = structure.pairs.chains[pair]
    first, second = (placed[link] for link in structure.mechanism.ends[pair])
    ahead, beside = (first.direction(chain.constants[0][:, k]) for k in (0, 1))
    reached = second.direction(chain.constants[1][0])
    return function("atan2", dot(beside, reached), dot(ahead, reached))
