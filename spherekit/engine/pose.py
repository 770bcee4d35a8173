"""Orientations of links as expressions of the pair variables.

The vectors of variables as terms, each carried by a link that it slides on.

A variable's vector is the angular velocity of its pair's second link relative to the first
per unit rate. An R pair's is an axis of either link. That of a contact slides on the link
that carries it as the contact goes along its profile.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from spherekit.engine.algebra import Exprs, constants, cross, vector
from spherekit.engine.expression_graph import Expr, ExpressionNode, function
from spherekit.engine.turns import (
    AxisRotation,
    Entries,
    JointTransform,
    ProfileFrame,
    ProfileSide,
    TurningPairs,
)
from spherekit.model.graph import spanning
from spherekit.model.mechanism import Mechanism
from spherekit.motion.loops import LoopTree


@dataclass(frozen=True)
class LinkOrientation:
    """The orientation of a link: R = basis @ within, from link axes to ground axes.

    `basis` (3, 3) holds expressions, `within` (3, 3) numbers or terms of sizes. The basis
    need not be orthonormal; `metric` is its Gram matrix. `depth` counts what had to be
    placed before: directions are cheapest in the least deep of the links that hold them.
    """

    basis: Exprs
    within: Entries
    metric: Entries
    depth: int

    def direction(self, axis: Entries) -> Exprs:
        """Return a vector (3,) fixed in the link, in ground axes."""
        return self.basis @ constants(self.within @ axis)

    def fixed(self, axis: Entries) -> Exprs:
        """Return what `seen` gives for a vector fixed in the link: numbers."""
        return constants(self.metric @ (self.within @ axis))

    def seen(self, given: Exprs) -> Exprs:
        """Return the components (3,) of a vector in ground axes along the basis."""
        return self.basis.T @ given

    def tensor(self, inertia: Entries) -> Exprs:
        """Return M (3, 3) with w . I w = y . M y for y = `seen(w)`, I in link axes."""
        return constants(self.within @ inertia @ self.within.T)


def ground_placement() -> LinkOrientation:
    """Return the placement of the ground in its own axes."""
    return LinkOrientation(constants(np.eye(3)), np.eye(3), np.eye(3), 0)


@dataclass(frozen=True)
class Angles:
    """Sine and cosine of each turn, formed once."""

    variables: Sequence[Expr]

    def of(self, turn: AxisRotation) -> tuple[Expr, Expr]:
        """Return the cosine and the sine of a turn."""
        angle = self.variables[turn.variable]
        sense = 1.0 if turn.scale > 0.0 else -1.0
        scale, offset = abs(turn.scale), sense * turn.offset
        if scale != 1.0:
            angle = scale * angle
        if offset != 0.0:
            angle = angle + offset
        return function("cos", angle), sense * function("sin", angle)


def placed_by(
    chain: JointTransform, start: LinkOrientation, angles: Angles
) -> LinkOrientation:
    """Return the placement of a link that a chain of turns joins to a placed one."""
    basis, within = start.basis, start.within
    for constant, turn in zip(chain.constants, chain.turns, strict=False):
        basis = basis @ constants(within @ constant)
        within = np.eye(3)
        if isinstance(turn, ProfileFrame):
            basis = basis @ turn.frame
            continue
        cosine, sine = angles.of(turn)
        basis = np.stack(
            [
                basis[:, 0] * cosine + basis[:, 1] * sine,
                basis[:, 1] * cosine - basis[:, 0] * sine,
                basis[:, 2],
            ],
            axis=1,
        )
    return LinkOrientation(basis, chain.constants[-1], np.eye(3), start.depth + 1)


def place_by_variables(
    mechanism: Mechanism, pairs: TurningPairs, variables: Sequence[Expr]
) -> list[LinkOrientation]:
    """Return the placements of all links along the shortest ways from the ground."""
    return placed_along(mechanism, pairs, Angles(variables), spanning(mechanism.ends))


def placed_along(
    mechanism: Mechanism,
    pairs: TurningPairs,
    angles: Angles,
    ways: Iterable[tuple[int, int, int]],
) -> list[LinkOrientation]:
    """Return the placements of links on ways, those of others where the ground is.

    `ways` are pairs with the links that they lead from and to, in order.
    """
    placed = [ground_placement()] * len(mechanism.links)
    for pair, parent, child in ways:
        chain = pairs.chains[pair]
        ahead = mechanism.ends[pair][0] == parent
        placed[child] = placed_by(
            chain if ahead else chain.reversed(), placed[parent], angles
        )
    return placed


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
        return self.bend + sum(side.most_bent for side in self.sides)

    def change(self, w: Exprs, rate: Expr) -> Exprs:
        """Return the rate (3,) of the vector while the link turns and the variable runs."""
        turned = cross(w, self.vector)
        return turned if self.slide is None else np.asarray(turned + self.slide * rate)


@dataclass(frozen=True)
class ContactLine:
    """The line of a rolling contact, carried by a link: `point` and `tangent` (3,).

    `relative` is by how much more the first profile curves than the second, `slope` its
    derivative by the arc length.
    """

    point: Exprs
    tangent: Exprs
    link: int
    relative: Expr
    slope: Expr


@dataclass(frozen=True)
class UnitTwists:
    """The vectors of all variables, the lines of rolling contacts by pair, and curvatures.

    `relative` are by how much more first profiles curve than second ones, of all contacts.
    """

    vectors: tuple[UnitTwist, ...]
    lines: Mapping[int, ContactLine]
    relative: tuple[Expr, ...]


def carried_vectors(
    mechanism: Mechanism,
    pairs: TurningPairs,
    placed: Sequence[LinkOrientation],
    variables: Sequence[Expr],
    about_centres: bool = False,
) -> UnitTwists:
    """Return them of links that are placed, by pair variables.

    Where circles roll on each other, their vector may be that `about_centres`, the sum of
    those of both, which takes fewer terms but loses digits where the circles are small.
    """
    angles = Angles(variables)
    carried: dict[int, UnitTwist] = {}
    lines: dict[int, ContactLine] = {}
    for pair, ends in enumerate(mechanism.ends):
        owned = mechanism.variables_of(pair)
        if pair not in pairs.sides:
            held = zip(ends, pairs.axes(pair), strict=True)
            link, axis = min(held, key=lambda end: placed[end[0]].depth)
            carried[owned[0]] = UnitTwist(vector(list(placed[link].direction(axis))), link)
            continue
        sides = pairs.sides[pair]
        around = [
            _sliding(sense, side, end, placed[end], angles)
            for side, end, sense in zip(sides, ends, (1.0, -1.0), strict=True)
        ]
        if len(owned) == 2:
            carried |= zip(owned, around, strict=True)
        elif about_centres and not any(side.columns for side in sides):
            one, other = (part.vector for part in around)
            carried[owned[0]] = UnitTwist(one + other, ends[0], slide=cross(one, other))
        else:
            near = 0 if placed[ends[0]].depth <= placed[ends[1]].depth else 1
            line = _line(sides, near, ends[near], placed[ends[near]], angles)
            lines[pair] = line
            carried[owned[0]] = _rolling(sides, near, line)
    relative = tuple(_relative(sides) for sides in pairs.sides.values())
    return UnitTwists(tuple(carried[v] for v in sorted(carried)), lines, relative)


def along_ways(tree: LoopTree, parts: Sequence[Exprs]) -> list[Exprs]:
    """Return for each link the sum (3,) of the parts of pairs on the way to it."""
    sums = [vector([0.0, 0.0, 0.0])] * tree.count
    for pair, parent, child in tree.placements:
        ahead = tree.ends[pair][0] == parent
        part = parts[pair]
        sums[child] = sums[parent] + part if ahead else sums[parent] - part
    return sums


def root(item: Expr) -> Expr:
    """Return the square root of a number or a term."""
    return function("sqrt", item) if isinstance(item, ExpressionNode) else float(item**0.5)


def size_of(item: Expr) -> Expr:
    """Return the absolute value of a number or a term."""
    return root(item * item)


def bounded(items: Iterable[Expr]) -> Expr:
    """Return what none of these, not negative, exceeds: the largest, if all are numbers."""
    items = list(items)
    terms = dict.fromkeys(x for x in items if isinstance(x, ExpressionNode))
    total: Expr = max((x for x in items if not isinstance(x, ExpressionNode)), default=0.0)
    for term in terms:
        total = total + term
    return total


def largest(items: Iterable[Expr]) -> Expr:
    """Return the largest of numbers and terms, none of which is negative."""
    items = list(items)
    terms = dict.fromkeys(x for x in items if isinstance(x, ExpressionNode))
    most: Expr = max((x for x in items if not isinstance(x, ExpressionNode)), default=0.0)
    for term in terms:
        most = function("maximum", most, term) if most else term
    return most


def _relative(sides: tuple[ProfileSide, ProfileSide]) -> Expr:
    return sides[0].curvature - sides[1].curvature


def _line(
    sides: tuple[ProfileSide, ProfileSide],
    near: int,
    link: int,
    placed: LinkOrientation,
    angles: Angles,
) -> ContactLine:
    tangent, _, point = _frame(sides[near], placed, angles)
    slope = sides[0].slope - sides[1].slope
    return ContactLine(point, tangent, link, _relative(sides), slope)


def _frame(
    side: ProfileSide, placed: LinkOrientation, angles: Angles
) -> tuple[Exprs, Exprs, Exprs]:
    """Return the tangent, the normal and the point (3,) of a profile at the contact."""
    there = placed_by(side.frame, placed, angles)
    axes = (there.direction(axis) for axis in np.eye(3))
    tangent, normal, point = (vector(list(axis)) for axis in axes)
    return tangent, normal, point


def _rolling(
    sides: tuple[ProfileSide, ProfileSide], near: int, line: ContactLine
) -> UnitTwist:
    """Return (k1 - k2) p."""
    relative, slope, curvature = line.relative, line.slope, sides[near].curvature
    swing = size_of(relative) * root(1.0 + curvature * curvature)
    vector, slide = sides[0].rolled(sides[1], line.tangent, line.point)
    return UnitTwist(
        vector,
        line.link,
        size_of(relative),
        slide,
        root(relative * relative + slope * slope),
        2.0 * size_of(slope) + swing,
        sides,
    )


def _sliding(
    sense: float, side: ProfileSide, link: int, placed: LinkOrientation, angles: Angles
) -> UnitTwist:
    """Return n + k p, or the opposite."""
    if isinstance(side.turn, AxisRotation):
        axis = placed.direction(side.before[:, 2]) * (sense * side.turn.scale)
        return UnitTwist(vector(list(axis)), link, abs(side.turn.scale))
    _, normal, point = _frame(side, placed, angles)
    k, slope = side.curvature, side.slope
    along, slide = side.slid(sense, normal, point)
    return UnitTwist(
        along,
        link,
        root(1.0 + k * k),
        slide,
        size_of(slope),
        size_of(slope),
        (side,),
    )
