"""Configurations in which a loop of four pairs lies in a plane, exactly.

Mirrored at the plane of its four axes, a loop closes with the same arcs: its equation is
even about such a configuration, and its slopes vanish there. Whether it closes in line is a
sum of arcs, decided on the decimal numbers of the file. Where it closes with one angle at a
value, and the other at both of its values in line, it closes with all values of the other:
the equation is a + b cos of it then, and both a + b and a - b are zero.

Saddles met by chains are kept here: where arms begin and end, and what is still at them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from itertools import pairwise
from typing import final

import numpy as np

from spherekit.arrays import Bools, Floats
from spherekit.files.document import LiteralNumber
from spherekit.model.parts import SizeGeometry
from spherekit.numeric.crossings import wrap
from spherekit.proof.balls import (
    Ball,
    angle_of,
    exact,
    matrix,
    middle,
    pi,
    upper,
    wide,
)
from spherekit.proof.construction import Across, Onto
from spherekit.proof.equations import Equations
from spherekit.proof.gears import Written
from spherekit.proof.roots import zero_within
from spherekit.proof.saddles import Quadrant, Saddle, saddle_near
from spherekit.proof.tubes import Piece

NEAR = 1e-9
"""Variables (rad) that differ by less are tried as the same."""
BALL = 1e-9
"""Half widths (rad) of balls in which the other variables are shown to be."""


@final
@dataclass(frozen=True)
class Folding:
    """The equation of a loop of four pairs with both its variables.

    `values` are the angles (rad) of each variable in line: links on the same side, and on
    opposite sides. `closes[i][j]` says whether the loop closes with these.
    """

    equation: int
    variables: tuple[int, int]
    values: tuple[tuple[Ball, Ball], tuple[Ball, Ball]]
    closes: tuple[tuple[bool, bool], tuple[bool, bool]]


@final
class Foldings:
    """All loops of four pairs among the equations, with what is exact about them."""

    def __init__(self, equations: Equations) -> None:
        self.equations = equations

    @cached_property
    def loops(self) -> list[Folding]:
        """The loops whose arcs are decimal numbers, none without a tolerance of zero."""
        written = self.equations.written
        if written.tolerance or not isinstance(written.mechanism.geometry, SizeGeometry):
            return []
        made = (
            _folding(self.equations, number, step)
            for number, step in enumerate(self.equations.construction.equations)
        )
        return [folding for folding in made if folding is not None]

    def closed_at(self, place: Floats, reach: float) -> list[Ball] | None:
        """Return a configuration in line next to a place, in balls within `reach` of it."""
        for loop in self.loops:
            for i, one in enumerate(loop.values[0]):
                for j, other in enumerate(loop.values[1]):
                    if not loop.closes[i][j]:
                        continue
                    given = dict(zip(loop.variables, (one, other), strict=True))
                    balls = self.completed(loop.equation, given, place)
                    near = balls is not None and all(
                        upper(ball - exact(float(e))) < reach
                        for ball, e in zip(balls, place, strict=True)
                    )
                    if near:
                        return balls
        return None

    def still(self, variable: int, place: Floats) -> list[Ball] | None:
        """Return a configuration at which a variable is what it is along a whole curve.

        In balls next to a place; None if no loop closes with all values of its other
        variable there.
        """
        for loop in self.loops:
            if variable not in loop.variables:
                continue
            side = loop.variables.index(variable)
            other = loop.variables[1 - side]
            for number, value in enumerate(loop.values[side]):
                closes = np.array(loop.closes) if side == 0 else np.array(loop.closes).T
                if not np.all(closes[number]):
                    continue
                given = {variable: value, other: exact(float(place[other]))}
                balls = self.completed(loop.equation, given, place)
                if balls is not None:
                    return balls
        return None

    def completed(
        self, equation: int, given: Mapping[int, Ball], place: Floats
    ) -> list[Ball] | None:
        """Return balls next to a place, with variables given, that solve other equations.

        None if the variables given are not next to the place, or nothing is proven.
        """
        count = self.equations.variables
        balls = [exact(float(e)) for e in place]
        for variable, value in given.items():
            turns = np.round((place[variable] - middle(value)) / (2.0 * np.pi))
            balls[variable] = value + 2 * pi() * exact(float(turns))
            if abs(middle(balls[variable]) - place[variable]) > NEAR:
                return None
        free = [j for j in range(count) if j not in given]
        rows = [k for k in range(self.equations.unknowns) if k != equation]
        if len(free) != len(rows):
            return None
        if not free:
            return balls
        around = list(balls)
        for j in free:
            around[j] = wide(balls[j], BALL)
        values, _ = self.equations.arrays(balls)
        _, slopes = self.equations.arrays(around)
        over = matrix(slopes[np.ix_(rows, free)])
        return around if zero_within(matrix(values[rows][:, None]), over) < BALL else None


def _folding(equations: Equations, number: int, step: Onto) -> Folding | None:
    """Return the loop of an equation, None if it is none of four pairs in exact arcs."""
    shared, first, second = equations.ranks.apart(*step.parents)
    steps = {s.link: s for s in equations.construction.steps}
    turned = [*first, *second]
    across = [steps[link] for link in turned]
    if len(turned) != 2 or not all(isinstance(s, Across) for s in across):
        return None
    joints = [s for s in across if isinstance(s, Across)]
    if joints[0].variable == joints[1].variable:
        return None
    if any(s.turns != 1 or s.pair in equations.offsets for s in joints):
        return None
    # the loop as links with the pairs between them, from the shared link round to it
    links = [shared, *first[::-1], step.link, *second]
    hinges = [
        *(steps[link].pair for link in first[::-1]),  # type: ignore[union-attr]
        *step.pairs,
        *(steps[link].pair for link in second),  # type: ignore[union-attr]
    ]
    written = equations.written
    sides = [
        _arc(written, link, one, other)
        for link, (one, other) in zip(links, pairwise([hinges[-1], *hinges]), strict=True)
    ]
    if any(side is None for side in sides):
        return None
    arcs = [side for side in sides if side is not None]
    where = {pair: k for k, pair in enumerate(hinges)}
    variables = joints[0].variable, joints[1].variable
    places = [where[joint.pair] for joint in joints]
    values = [_in_line(equations, hinges, links, k) for k in places]
    closes = [[_closes(arcs, places, (i, j), written) for j in (0, 1)] for i in (0, 1)]
    return Folding(
        number,
        variables,
        (values[0], values[1]),
        ((closes[0][0], closes[0][1]), (closes[1][0], closes[1][1])),
    )


def _closes(
    arcs: Sequence[Fraction],
    places: Sequence[int],
    sides: tuple[int, int],
    written: Written,
) -> bool:
    """Return whether a loop closes in line with two of its joints folded or stretched.

    `arcs[k]` is that of the link before joint k, `sides` are 0 where both links of a joint
    lie on the same side of its axis; the other two joints lie as they must, which leaves
    the arc of the link between them.
    """
    free = next(k for k in range(4) if k not in places and (k + 1) % 4 not in places)
    opposite = dict(zip(places, sides, strict=True))
    # from the joint after the free link round to the one before it
    sense, total = 1, Fraction(0)
    for k in range(free + 2, free + 5):
        total += sense * arcs[k % 4]
        if k % 4 in opposite and not opposite[k % 4]:
            sense = -sense
    return any(_whole(total + sign * arcs[(free + 1) % 4], written) for sign in (1, -1))


def _whole(total: Fraction, written: Written) -> bool:
    """Return whether a sum of arcs is a number of whole turns; no sum in rad but 0 is."""
    if written.document.data["angle_unit"] == "deg":
        return total % 360 == 0
    return total == 0


def _arc(written: Written, link: int, one: int, other: int) -> Fraction | None:
    """Return the arc between two axes of a link as the decimal number that the file has.

    None where it is none, or would be 0 or half a turn.
    """
    structure = written.structure
    item = written.document.data["links"].get(structure.links[link])
    if not item or "axes" not in item:
        return None
    names = list(item["axes"])
    pairs = structure.pairs[one], structure.pairs[other]
    if names[0] not in pairs or not set(pairs) <= set(names) or one == other:
        return None
    number = max(names.index(pair) for pair in pairs) - 1
    arc = _fraction(item["arcs"][number])
    if written.document.data["angle_unit"] != "deg":
        return arc if 0 < arc < Fraction(314159, 100000) else None
    arc %= 360
    arc = min(arc, 360 - arc)
    return arc if 0 < arc < 180 else None


def _fraction(number: float) -> Fraction:
    if isinstance(number, LiteralNumber):
        return Fraction(number.text.replace("_", ""))
    return Fraction(number)


def _in_line(
    equations: Equations, hinges: Sequence[int], links: Sequence[int], joint: int
) -> tuple[Ball, Ball]:
    """Return the angles of a joint with both its links on the same side, and on opposite.

    Joint k lies between links k and k + 1 of the loop.
    """
    pair, count = hinges[joint], len(hinges)
    azimuths = {}
    for link, other in (
        (links[joint], hinges[joint - 1]),
        (links[(joint + 1) % count], hinges[(joint + 1) % count]),
    ):
        x, y, z = equations.frame(pair, link)
        axis = equations.frame(other, link)[2]
        assert upper(np.cross(x, y) @ z - 1) < NEAR
        azimuths[link] = angle_of(x @ axis, y @ axis)
    one, two = equations.written.structure.ends[pair]
    same = azimuths[one] - azimuths[two]
    return same, same + pi()


FARTHEST = 0.02
"""How far (rad) from where a curve could not be followed a saddle is looked for."""
MOST_SADDLES = 64


@final
@dataclass(frozen=True)
class Arm:
    """One of the four arms of a saddle, by the saddle's number and its quadrant."""

    saddle: int
    quadrant: Quadrant


@final
class Crossings:
    """All saddles of a search, whose parts of space have no point in common."""

    def __init__(self, equations: Equations) -> None:
        self.equations = equations
        self.foldings = Foldings(equations)
        self.saddles: list[Saddle] = []

    def find(self, place: Floats) -> bool:
        """Look for a saddle next to a place; return whether there is a new one."""
        if len(self.saddles) >= MOST_SADDLES:
            return False
        made = saddle_near(self.equations, place, FARTHEST, self._crosses, self._fits)
        if made is not None:
            self.saddles.append(made)
        return made is not None

    def arm(self, piece: Piece) -> Arm | None:
        """Return the arm that the middle of a piece's arc is on, None if on none."""
        for number, saddle in enumerate(self.saddles):
            quadrant = saddle.quadrant(piece.centre, piece.miss)
            if quadrant is not None:
                return Arm(number, quadrant)
        return None

    def ends(self, pieces: Sequence[Piece], closed: bool) -> tuple[Arm | None, Arm | None]:
        """Return the arms that a chain begins and ends on, None where on none.

        A chain of one piece on an arm comes from beyond the range.
        """
        if closed:
            return None, None
        return None if len(pieces) == 1 else self.arm(pieces[0]), self.arm(pieces[-1])

    def may_hold(self, place: Floats, off: float) -> bool:
        """Return whether a configuration, off by at most `off`, may be in a saddle."""
        return any(saddle.may_hold(place, off) for saddle in self.saddles)

    def covers(self, centres: Floats, radii: Floats) -> Bools:
        """Return whether boxes of radii (n, v) are in the part of space of a saddle."""
        out = np.zeros(len(centres), dtype=bool)
        for saddle in self.saddles:
            out |= saddle.covers(centres, radii)
        return out

    def still(self, pieces: Sequence[Piece], variable: int) -> bool:
        """Return whether a variable is proven the same along a whole chain of pieces.

        One configuration of it is enough: where the slopes of the loop's equation by the
        other variable vanish, and not all do, there is no other near by.
        """
        piece = pieces[len(pieces) // 2]
        balls = self.foldings.still(variable, piece.centre)
        if balls is None:
            return False
        return piece.holds(np.array([middle(ball) for ball in balls]), 2.0 * BALL)

    def _crosses(self, part: Saddle) -> bool:
        balls = self.foldings.closed_at(part.centre, 1e-3 * np.min(part.limits))
        return balls is not None

    def _fits(self, made: Saddle) -> bool:
        return all(_disjoint(made, other) for other in self.saddles)


def _disjoint(one: Saddle, other: Saddle) -> bool:
    """Return whether a face of one of two parts of space has them on both its sides."""
    apart = wrap(other.centre - one.centre)
    for first, second in ((one, other), (other, one)):
        inner = np.abs(first.frame.T @ second.frame) @ second.limits
        if np.any(np.abs(apart @ first.frame) > first.limits + inner + 1e-9):
            return True
    return False
