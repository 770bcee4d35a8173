"""Configurations in which a loop of four pairs lies in a plane, exactly.

Mirrored at the plane of its four axes, a loop closes with the same arcs: its equation is
even about such a configuration, and its slopes vanish there. Whether it closes in line is a
sum of arcs, decided on the decimal numbers of the file. Where it closes with one angle at a
value, and the other at both of its values in line, it closes with all values of the other:
the equation is a + b cos of it then, and both a + b and a - b are zero.

Saddles met by chains are kept here: where arms begin and end, and what is still at them.
"""

from collections.abc import Mapping, Sequence
from fractions import Fraction
from itertools import pairwise, product

import numpy as np

from spherekit.arrays import Array, Bools, Floats
from spherekit.mechanism.elements import SizeGeometry
from spherekit.numerics.angles import wrap
from spherekit.proof.arc_equations import Equations
from spherekit.proof.ball_frames import exact, exactly
from spherekit.proof.balls import Ball, angle_of, floats, middle, pi, upper, wide
from spherekit.proof.construction import Step
from spherekit.proof.decimal_mechanism import Written, text_of
from spherekit.proof.root_ball import zero_within
from spherekit.proof.saddles import Quadrant, Saddle, saddle_near
from spherekit.proof.tubes import CertifiedArc, Zone

NEAR = 1e-9
"""Variables (rad) that differ by less are tried as the same."""
BALL = 1e-9
"""Half widths (rad) of balls in which the other variables are shown to be."""


Folding = tuple[int, tuple[int, int], Array, Bools]
"""The equation of a loop of four pairs, both its variables, and where they are in line.

These are angles (2, 2) rad of each variable: links on the same side, and on opposite sides;
and whether the loop closes (2, 2) with two of these.
"""


def completed(
    equations: Equations, equation: int, given: Mapping[int, Ball], place: Floats
) -> Array | None:
    """Return balls next to a place, with variables given, that solve all other equations.

    None if the variables given are not next to the place, or nothing is proven.
    """
    balls = exactly(place)
    for variable, value in given.items():
        turns = np.round((place[variable] - middle(value)) / (2.0 * np.pi))
        balls[variable] = value + 2 * pi() * turns
        if abs(middle(balls[variable]) - place[variable]) > NEAR:
            return None
    free = [j for j in range(equations.variables) if j not in given]
    rows = [k for k in range(equations.unknowns) if k != equation]
    if len(free) != len(rows):
        return None
    if not free:
        return balls
    (values,), around = equations.arrays(balls, 0), balls.copy()
    around[free] += wide(0.0, BALL)
    over = equations.arrays(around)[1][np.ix_(rows, free)]
    return around if zero_within(values[rows], over) < BALL else None


def _folding(equations: Equations, number: int, step: Step) -> Folding | None:
    """Return the loop of an equation, None if it is none of four pairs in exact arcs."""
    shared, first, second = equations.construction.apart(step)
    turned = [s for s in equations.construction.steps if s.link in (*first, *second)]
    joints = [s for s in turned if not s.is_dyad]
    if not len(turned) == len(joints) == len({s.variable for s in joints}) == 2:
        return None
    if any(s.turns != 1 or s.pairs[0] in equations.offsets for s in joints):
        return None
    # the loop as links with the pairs between them, from the shared link round to it
    links = [shared, *first[::-1], step.link, *second]
    pairs = {s.link: s.pairs[0] for s in joints}
    hinges = [
        *(pairs[link] for link in first[::-1]),
        *step.pairs,
        *(pairs[link] for link in second),
    ]
    written = equations.written
    arcs = [
        arc
        for link, two in zip(links, pairwise([hinges[-1], *hinges]), strict=True)
        if (arc := _arc(written, link, *two)) is not None
    ]
    if len(arcs) < len(links):
        return None
    places = [hinges.index(joint.pairs[0]) for joint in joints]
    closes = [[_closes(arcs, places, (i, j), written) for j in (0, 1)] for i in (0, 1)]
    angles = np.array([_in_line(equations, hinges, links, k) for k in places])
    return number, (joints[0].variable, joints[1].variable), angles, np.array(closes)


def _closes(
    arcs: Sequence[Fraction],
    places: Sequence[int],
    sides: tuple[int, int],
    written: Written,
) -> bool:
    """Return whether a loop closes in line with two of its joints folded or stretched.

    `arcs[k]` is that of the link before joint k, `sides` are 0 where both links of a joint
    lie on the same side of its axis; the other two joints lie as they must.
    """
    # a number of whole turns; no sum in rad is one but 0
    for senses in product((1, -1), repeat=4):
        left = sum(sense * arc for sense, arc in zip(senses, arcs, strict=True))
        lie = [senses[k] == senses[(k + 1) % 4] for k in places]
        if lie == [*sides] and (left % 360 if written.in_degrees else left) == 0:
            return True
    return False


def _arc(written: Written, link: int, one: int, other: int) -> Fraction | None:
    """Return the arc between two axes of a link as the decimal number that the file has.

    None where it is none, or would be 0 or half a turn.
    """
    structure = written.structure
    item = written.document.data["links"].get(structure.links[link])
    if not item or "axes" not in item:
        return None
    names, pairs = item["axes"], (structure.pairs[one], structure.pairs[other])
    if names[0] not in pairs or not set(pairs) <= set(names) or one == other:
        return None
    number = max(names.index(pair) for pair in pairs) - 1
    arc = Fraction(text_of(item["arcs"][number]).replace("_", ""))
    half = 3.14159
    if written.in_degrees:
        arc, half = min(arc % 360, -arc % 360), 180
    return arc if 0 < arc < half else None


def _in_line(
    equations: Equations, hinges: Sequence[int], links: Sequence[int], joint: int
) -> tuple[Ball, Ball]:
    """Return the angles of a joint with both its links on the same side, and on opposite.

    Joint k lies between links k and k + 1 of the loop.
    """
    pair, count = hinges[joint], len(hinges)
    azimuths = {}
    for k, other in ((joint, joint - 1), (joint + 1, joint + 1)):
        link = links[k % count]
        axis = equations.frame(hinges[other % count], link)[2]
        azimuths[link] = angle_of(*(equations.frame(pair, link)[:2] @ axis))
    one, two = equations.written.structure.ends[pair]
    same = azimuths[one] - azimuths[two]
    return same, same + pi()


MOST_SADDLES = 64


Arm = tuple[int, Quadrant]
"""One of the four arms of a saddle, by the saddle's number and its quadrant."""


class Crossings:
    """All saddles of a search, whose parts of space have no point in common."""

    def __init__(self, equations: Equations) -> None:
        self.equations = equations
        written, self.loops = equations.written, list[Folding]()
        if isinstance(written.mechanism.geometry, SizeGeometry) and not written.tolerance:
            for number, step in enumerate(equations.construction.equations):
                if folding := _folding(equations, number, step):
                    self.loops.append(folding)
        self.saddles: list[Saddle] = []

    def find(self, place: Floats) -> bool:
        """Look for a saddle next to a place; return whether there is a new one."""
        if len(self.saddles) >= MOST_SADDLES:
            return False
        made = saddle_near(self.equations, place, self._crosses, self._fits)
        if made is not None:
            self.saddles.append(made)
        return made is not None

    def arm(self, piece: CertifiedArc) -> Arm | None:
        """Return the arm that the middle of a piece's arc is on, None if on none."""
        for number, saddle in enumerate(self.saddles):
            if quadrant := saddle.quadrant(piece.centre, piece.miss):
                return number, quadrant
        return None

    def ends(
        self, pieces: Sequence[CertifiedArc], closed: bool
    ) -> tuple[Arm | None, Arm | None]:
        """Return the arms that a chain begins and ends on, None where on none.

        A chain of one piece on an arm comes from beyond the range.
        """
        if closed:
            return None, None
        return None if len(pieces) == 1 else self.arm(pieces[0]), self.arm(pieces[-1])

    def may_hold(self, place: Floats, off: float) -> bool:
        """Return whether a configuration, off by at most `off`, may be in a saddle."""
        return any(saddle.may_hold(place, off) for saddle in self.saddles)

    def still(self, pieces: Sequence[CertifiedArc], variable: int) -> bool:
        """Return whether a variable is proven the same along a whole chain of pieces.

        One configuration of it is enough: where the slopes of the loop's equation by the
        other variable vanish, and not all do, there is no other near by.
        """
        piece = pieces[len(pieces) // 2]
        for equation, variables, values, closes in self.loops:
            if variable not in variables:
                continue
            side = variables.index(variable)
            other = variables[1 - side]
            for value in values[side][np.all(closes, axis=1 - side)]:
                given = {variable: value, other: exact(piece.centre[other])}
                balls = completed(self.equations, equation, given, piece.centre)
                if balls is not None:
                    return piece.holds(floats(balls), 2.0 * BALL)
        return False

    def _crosses(self, part: Zone) -> bool:
        """Return whether a loop is proven to close in line next to a saddle's centre."""
        reach, centre = 1e-3 * np.min(part.limits), exactly(part.centre)
        for equation, variables, values, closes in self.loops:
            for i, j in np.argwhere(closes):
                given = dict(zip(variables, (values[0, i], values[1, j]), strict=True))
                balls = completed(self.equations, equation, given, part.centre)
                if balls is not None and max(map(upper, balls - centre)) < reach:
                    return True
        return False

    def _fits(self, made: Zone) -> bool:
        return all(_disjoint(made, other) for other in self.saddles)


def _disjoint(one: Zone, other: Zone) -> bool:
    """Return whether a face of one of two parts of space has them on both its sides."""
    apart = wrap(other.centre - one.centre)
    for first, second in ((one, other), (other, one)):
        inner = np.abs(first.frame.T @ second.frame) @ second.limits
        if np.any(np.abs(apart @ first.frame) > first.limits + inner + 1e-9):
            return True
    return False
