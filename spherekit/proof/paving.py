"""Proof that no configuration lies outside given pieces: space is cut into boxes.

A box goes if an equation cannot vanish in it: |f| at its centre is more than its slopes and
the bound of its second derivatives allow over the box. It goes too if it is inside a
piece. All others are halved. What is left when boxes are small is undecided.

Nor can a sum of equations vanish where one of them cannot be made up for by others: taken
are the sums of the pseudo-inverse of F', in which the slope by one variable is largest. Any
sum is one that may be taken, so that nothing rests on how well its weights are computed.
"""

from collections.abc import Callable, Sequence

import numpy as np

from spherekit.arrays import Bools, Floats, Indices, Integers
from spherekit.progress import ProgressReporter
from spherekit.proof.arc_equations import Equations
from spherekit.proof.balls import UNIT, Ball, circle, middle, upper
from spherekit.proof.tubes import ROUNDING, UP, corrected

RIDGE = 1e-9
"""What is added to the squares of slopes, so that weights are finite."""


def apart(values: Floats, slopes: Floats, radii: Floats, bent: Floats) -> Bools:
    """Return which boxes are proven to have no zero (n,).

    Parameters
    ----------
    values, slopes
        Of the equations at the centres, (n, k) and (n, k, v).
    radii
        Of the boxes, (n, v).
    bent
        (n, k) by how much at most the equations differ from their linear parts over the
        boxes, errors included.
    """
    across = slopes.swapaxes(1, 2)
    weights = across @ np.linalg.inv(slopes @ across + RIDGE * np.eye(values.shape[1]))
    size = np.abs(values) + np.einsum("nkv,nv->nk", np.abs(slopes), radii)
    reach = np.einsum("nwv,nv->nw", np.abs(weights @ slopes), radii)
    reach += np.einsum("nwk,nk->nw", np.abs(weights), bent + ROUNDING * size)
    sums = np.abs(np.einsum("nwk,nk->nw", weights, values))
    return np.any(sums > reach * UP, axis=1)


CHUNK = 4000
SEEDING, TRIED = 0.12, 3
"""Boxes (rad) so small are looked into for what is not known yet, some of each batch."""
SMALLEST = 1e-6
"""Boxes (rad) are not halved further."""
FIRST = -2.4
"""Where turns of unknown angles begin (rad): at no place that special geometry prefers."""


class Ranges:
    """The ranges of variables from `low` on, `width` wide: balls (rad), cut into boxes.

    The balls are exact or far narrower than a rounding. Boxes are integers (2, n,
    variables): how often each side was halved, and which part it is.
    """

    def __init__(self, low: Sequence[Ball], width: Sequence[Ball]) -> None:
        self.low = low
        self.start, self.extent = (np.array([*map(middle, x)]) for x in (low, width))
        self.whole: Integers = np.zeros((2, 1, len(low)), dtype=np.int64)
        self._widest = np.array([*map(upper, width)]) * UP
        self._off = 8.0 * UNIT * (np.abs(self.start) + np.abs(self.extent))
        self._off[self.extent == 0.0] = 0.0

    def radii(self, boxes: Integers) -> Floats:
        """Return half widths (n, variables) about the centres, rounded up."""
        return self._widest * np.exp2(-1.0 - boxes[0]) + self._off

    def centres(self, boxes: Integers) -> Floats:
        """Return float64 numbers (n, variables) next to the centres."""
        levels, places = boxes
        return self.start + self.extent * (places + 0.5) * np.exp2(-levels)

    def turns(self, boxes: Integers) -> Floats:
        """Return cosines and sines (n, variables, 2) of these, each rounded once.

        Where a variable has only one angle they are of that.
        """
        centres = self.centres(boxes)
        numbers, back = np.unique(centres, return_inverse=True)
        made = circle(numbers)[back]
        fixed = self.extent == 0.0
        made[:, fixed] = circle(self.low)[fixed]
        return made


def halved(boxes: Integers, sides: Indices) -> Integers:
    """Return both halves of each box across its side in `sides` (n,)."""
    levels, places = boxes
    cut = np.arange(levels.shape[1]) == sides[:, None]
    levels, low = levels + cut, places << cut
    return np.concatenate([[levels, low], [levels, low + cut]], axis=1)


def cut_up(
    boxes: Integers, most: int, doing: str, judged: Callable[[Integers, int], Integers]
) -> int:
    """Return how many boxes were looked at until `judged` leaves none.

    It is told at most `most` boxes at once, and how many there were before and with them.
    """
    waiting, looked_at, working = [boxes], 0, ProgressReporter(doing)
    while waiting:
        boxes, later = np.split(waiting.pop(), [most], axis=1)
        looked_at += boxes.shape[1]
        working.tell(lambda: f"{looked_at} boxes")  # noqa: B023
        left = judged(boxes, looked_at)
        waiting += [part for part in (later, left) if part.shape[1]]
    return looked_at


Covered = Callable[[Floats, Floats], Bools]
"""Says which boxes of centres and radii (n, variables) are inside a piece."""
Taken = Callable[[Floats], bool]
"""Is told a configuration next to a box that is not decided; whether it finds a piece."""
Left = tuple[Floats, Floats]
"""Centres and radii (n, variables) rad of boxes that are left undecided."""


def paved(
    equations: Equations,
    ranges: Ranges,
    covered: Covered,
    taken: Taken,
    most: int,
) -> tuple[int, Left]:
    """Return how many boxes of the ranges were looked at, and those left over.

    They may have configurations that are not in pieces. After `most` boxes none are halved.
    """
    degrees, error = equations.degrees, equations.real.error
    moved = int(np.sum(ranges.extent > 0.0))
    left: list[Left] = []

    def judged(boxes: Integers, looked_at: int) -> Integers:
        radii = ranges.radii(boxes)
        values, slopes = equations.real.derivatives(ranges.turns(boxes), 1)
        change = radii @ degrees.T
        bent = 0.5 * equations.bound * change**2 + error * (1.0 + change)
        reach = np.einsum("nkv,nv->nk", np.abs(slopes), radii)
        rows = np.flatnonzero(np.all(np.abs(values) <= (reach + bent) * UP, axis=1))
        rows = rows[~apart(values[rows], slopes[rows], radii[rows], bent[rows])]
        boxes, radii = boxes[:, rows], radii[rows]
        centres = ranges.centres(boxes)
        kept, widest = ~covered(centres, radii), np.max(radii, axis=1)
        small = np.flatnonzero(kept & (widest < SEEDING))
        new = False
        for row in small[:: max(1, len(small) // TRIED)]:
            place = corrected(equations, centres[row], moved)
            near = 4.0 * widest[row]
            if place is not None and np.max(np.abs(place - centres[row])) <= near:
                new |= taken(place)
        if new:
            kept[kept] = ~covered(centres[kept], radii[kept])
        ended = kept & ((widest < SMALLEST) | (looked_at > most))
        left.append((centres[ended], radii[ended]))
        kept &= ~ended
        return halved(boxes[:, kept], np.argmax(radii[kept], axis=1))

    looked_at = cut_up(ranges.whole, CHUNK, "proving that nothing else is there", judged)
    centres, radii = map(np.concatenate, zip(*left, strict=True))
    return looked_at, (centres, radii)
