"""Positions in closed form as expressions, for mechanisms whose groups are all dyads.

The input's angle and one sign for each dyad give the directions of all axes; no angle of
any other pair is formed.
"""

from collections.abc import Sequence

import numpy as np

from spherekit.engine.algebra import Exprs, constants, cross, dot
from spherekit.engine.kinematics import Structure
from spherekit.engine.pose import Angles, Placement, ground_placement, placed_by
from spherekit.engine.terms import Expr, function
from spherekit.errors import EngineError
from spherekit.model.geometry import Revolute
from spherekit.planning.assembly import Group
from spherekit.sphere.rotation import Floats


def place_by_input(structure: Structure, q: Expr, signs: Sequence[Expr]) -> list[Placement]:
    """Return the placements of all links for the input's angle q.

    `signs` are those of the dyads in solving order, as in
    `spherekit.motion.branches.Branch`: +1 or -1, the sign of u_1 . (u_2 x u_3) with the
    axes of the dyad's pairs in file order.

    Raises
    ------
    EngineError
        If a group is no dyad.
    """
    mechanism = structure.mechanism
    if not structure.assembly.has_closed_form:
        raise EngineError(
            f"{mechanism.name}: not every group is a dyad, so positions have no closed "
            "form; give the variables of a motion instead of the input"
        )
    variables: list[Expr] = [None] * len(mechanism.variable_names)
    variables[structure.driven] = q
    angles = Angles(variables)
    driven = structure.assembly.input
    within = [ground_placement()] * len(mechanism.links)
    chain = structure.pairs.chains[driven]
    within[mechanism.ends[driven][1]] = placed_by(chain, ground_placement(), angles)
    for group, sign in zip(structure.assembly.groups, signs, strict=True):
        _close(structure, group, sign, within)
    ground = within[0]
    if ground.depth:
        back = constants(ground.within.T) @ ground.basis.T
        within = [_turned(back, each) for each in within]
        within[0] = ground_placement()
    return within


def _turned(basis: Exprs, placed: Placement) -> Placement:
    return Placement(
        np.asarray(basis @ placed.basis), placed.within, placed.metric, placed.depth + 1
    )


def _close(structure: Structure, group: Group, sign: Expr, within: list[Placement]) -> None:
    """Place the two free bodies of a dyad in the first one."""
    mechanism = structure.mechanism

    def joint(a: int, b: int) -> int:
        return next(k for k, pair in enumerate(group.ends) if set(pair) == {a, b})

    near, middle, far = joint(0, 1), joint(1, 2), joint(0, 2)

    def held(which: int, body: int) -> tuple[int, Floats]:
        pair = group.pairs[which]
        joined = structure.pairs.joints[pair]
        assert isinstance(joined, Revolute)
        first = group.ends[which][0] == body
        frame = joined.first if first else joined.second
        return mechanism.ends[pair][0 if first else 1], frame[:, 2]

    def axis(which: int, body: int) -> Exprs:
        link, direction = held(which, body)
        return within[link].direction(direction)

    order = (middle, near, far)
    even = order in ((0, 1, 2), (1, 2, 0), (2, 0, 1))
    first, second = axis(near, 0), axis(far, 0)
    bodies = [(near, 1), (far, 2)]
    own = [(held(outer, body), held(middle, body)) for outer, body in bodies]
    sides = [_versine(within, *both) for both in own]
    reached = _third_axis(first, second, sides, sign if even else -1.0 * sign)
    depth = 1 + max(each.depth for each in within)
    for (_, body), ((one, outer), (other, mid)) in zip(bodies, own, strict=True):
        given = first if body == 1 else second
        basis = np.stack([given, reached, cross(given, reached)], axis=1)
        links = group.bodies[body]
        if len(links) == 1:
            within[links[0]] = _single(basis, outer, mid, depth)
            continue
        ends = within[one].direction(outer), within[other].direction(mid)
        onto = basis @ _inverse(*ends)
        for link in links:
            old = within[link]
            within[link] = Placement(
                np.asarray(onto @ old.basis), old.within, old.metric, depth
            )


def _single(basis: Exprs, outer: Floats, middle: Floats, depth: int) -> Placement:
    """Return the placement of one link by two of its axes and their product."""
    own = np.stack([outer, middle, np.cross(outer, middle)], axis=1)
    return Placement(basis, np.linalg.inv(own), own.T @ own, depth)


def _inverse(a: Exprs, b: Exprs) -> Exprs:
    """Return the inverse of the matrix with the columns a, b, a x b (unit a, b)."""
    g = dot(a, b)
    share = 1.0 / (1.0 - g * g)
    rows = [(a - b * g) * share, (b - a * g) * share, cross(a, b) * share]
    return np.stack(rows, axis=0)


def _versine(
    within: Sequence[Placement], one: tuple[int, Floats], other: tuple[int, Floats]
) -> Expr:
    """Return 1 - cos of the arc between two axes (link, direction) of a body."""
    if one[0] == other[0]:
        return 0.5 * float(np.sum((one[1] - other[1]) ** 2))
    gap = within[one[0]].direction(one[1]) - within[other[0]].direction(other[1])
    return 0.5 * dot(gap, gap)


def _third_axis(first: Exprs, second: Exprs, sides: Sequence[Expr], sign: Expr) -> Exprs:
    """Return the unit vector at given arcs from two others.

    With X, Y, Z the versines of base and sides, b = p a + q c + r (a x c), where
    p = (cos Y - cos X cos Z) / sin^2 and so on, and r^2 sin^4 is the Gram determinant
    4 X Y - (X + Y - Z)^2 - 2 X Y Z: no difference of nearly equal cosines is formed.
    """
    gap = first - second
    x, (y, z) = 0.5 * dot(gap, gap), sides
    sine = x * (2.0 - x)
    share = 1.0 / sine
    middle = x + y - z
    gram = 4.0 * (x * y) - middle * middle - 2.0 * (x * y * z)
    p = (x + z - y - x * z) * share
    q = (middle - x * y) * share
    r = function("sqrt", gram) * share * sign
    return np.asarray(first * p + second * q + cross(first, second) * r)
