"""The vectors of variables as expressions, each carried by a link that it slides on.

A variable's vector is the angular velocity of its pair's second link relative to the first
per unit rate. An R pair's is an axis of either link. That of a contact slides on the link
that carries it as the contact goes along its profile.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from spherekit.mechanism.mechanism import Mechanism
from spherekit.symbolic.expression_graph import Expr, ExpressionNode, function
from spherekit.symbolic.frame_expressions import cross
from spherekit.symbolic.vector_algebra import Exprs
from spherekit.velocities.axis_rotations import AxisRotation, ProfileSide, TurningPairs
from spherekit.velocities.pose_expressions import LinkOrientation, placed_by


@dataclass(frozen=True)
class UnitTwist:
    """A variable's `vector` (3,): it turns with a link, and slides on it.

    By `slide` (3,) per unit of the variable, None where it is fixed in the link. `size` and
    `slid` are the lengths of both; the slide changes on the link by `bend` and by how the
    curvatures of the `sides` bend, at most.
    """

    vector: Exprs
    link: int
    size: Expr = 1.0
    slide: Exprs | None = None
    slid: Expr = 0.0
    bend: Expr = 0.0
    sides: tuple[ProfileSide, ...] = ()

    @property
    def bent(self) -> Expr:
        """A bound of how the slide changes on the link."""
        return self.bend + sum(side.series.most_bent for side in self.sides if side.terms)

    def change(self, w: Exprs, rate: Expr) -> Exprs:
        """Return the rate (3,) of the vector while the link turns and the variable runs."""
        turned = cross(w, self.vector)
        return turned if self.slide is None else turned + self.slide * rate


def carried_vectors(
    mechanism: Mechanism,
    pairs: TurningPairs,
    placed: Sequence[LinkOrientation],
    variables: Sequence[Expr],
    about_centres: bool,
) -> tuple[list[UnitTwist], dict[int, UnitTwist]]:
    """Return the vectors of all variables, and by pair the lines of rolling contacts.

    Where circles roll on each other, their vector may be that `about_centres`, the sum of
    those of both, which takes fewer terms but loses digits where the circles are small.
    """
    carried: dict[int, UnitTwist] = {}
    lines: dict[int, UnitTwist] = {}
    for pair, ends in enumerate(mechanism.ends):
        owned = mechanism.variables_of(pair)
        if pair not in pairs.sides:
            held = zip(ends, pairs.axes(pair), strict=True)
            link, axis = min(held, key=lambda end: placed[end[0]].depth)
            carried[owned[0]] = UnitTwist(placed[link].direction(axis), link)
            continue
        sides = pairs.sides[pair]
        around = [
            _sliding(sense, side, end, placed[end], variables)
            for side, end, sense in zip(sides, ends, (1.0, -1.0), strict=True)
        ]
        if len(owned) == 2:
            carried |= zip(owned, around, strict=True)
        elif about_centres and not any(side.terms for side in sides):
            one, other = (part.vector for part in around)
            carried[owned[0]] = UnitTwist(one + other, ends[0], slide=cross(one, other))
        else:
            near = placed[ends[0]].depth > placed[ends[1]].depth
            tangent, _, point = _axes(sides[near], placed[ends[near]], variables)
            curvature = sides[near].curvature
            lines[pair] = UnitTwist(
                point,
                ends[near],
                slide=tangent,
                slid=1.0,
                bend=root(1.0 + curvature * curvature),
            )
            carried[owned[0]] = _rolling(sides, curvature, lines[pair])
    return [*carried.values()], lines


def root(item: Expr) -> Expr:
    """Return the square root of a number or a term."""
    return function("sqrt", item) if isinstance(item, ExpressionNode) else float(item**0.5)


def size_of(item: Expr) -> Expr:
    """Return the absolute value of a number or a term."""
    return root(item * item)


def largest(items: Iterable[Expr]) -> Expr:
    """Return the largest of numbers and terms, none of which is negative."""
    items = list(items)
    most: Expr = max((x for x in items if not isinstance(x, ExpressionNode)), default=0.0)
    for term in dict.fromkeys(x for x in items if isinstance(x, ExpressionNode)):
        most = function("maximum", most, term) if most else term
    return most


def _axes(side: ProfileSide, placed: LinkOrientation, variables: Sequence[Expr]) -> Exprs:
    """Return the tangent, the normal and the point (3,) of a profile at the contact."""
    return placed_by(side.chain, placed, variables).direction(np.eye(3)).T


def _rolling(
    sides: tuple[ProfileSide, ProfileSide], curvature: Expr, line: UnitTwist
) -> UnitTwist:
    """Return (k1 - k2) p, with the curvature of the profile on the link of the line."""
    one, other = sides
    relative, slope = one.curvature - other.curvature, one.slope - other.slope
    return UnitTwist(
        line.vector * relative,
        line.link,
        size_of(relative),
        line.slide * relative + line.vector * slope,
        root(relative * relative + slope * slope),
        2.0 * size_of(slope) + size_of(relative) * root(1.0 + curvature * curvature),
        sides,
    )


def _sliding(
    sense: float,
    side: ProfileSide,
    link: int,
    placed: LinkOrientation,
    variables: Sequence[Expr],
) -> UnitTwist:
    """Return n + k p, or the opposite."""
    (turn,) = side.chain.turns
    if isinstance(turn, AxisRotation):
        axis = placed.direction(side.chain.constants[0][:, 2]) * (sense * turn.scale)
        return UnitTwist(axis, link, abs(turn.scale))
    _, normal, point = _axes(side, placed, variables)
    k, slope = side.curvature, size_of(side.slope)
    return UnitTwist(
        (normal + point * k) * sense,
        link,
        root(1.0 + k * k),
        point * (sense * side.slope),
        slope,
        slope,
        (side,),
    )
