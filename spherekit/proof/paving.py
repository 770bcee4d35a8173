"""Proof that no configuration lies outside given pieces: space is cut into boxes.

A box goes if an equation cannot vanish in it: |f| at its centre is more than its slopes and
the bound of its second derivatives allow over the box. It goes too if it is inside a
piece. All others are halved. What is left when boxes are small is undecided.

Nor can a sum of equations vanish where one of them cannot be made up for by others: taken
are the sums of the pseudo-inverse of F', in which the slope by one variable is largest. Any
sum is one that may be taken, so that nothing rests on how well its weights are computed.

Two or more inputs: boxes in which no mode is singular, and those in which one is.

Where all complex roots that there can be are continued over a box of inputs, none of them
meets another: no configuration of the box is singular with the inputs as they are (type
II), and the number of modes is the same everywhere. Where two such boxes in one connected
part have different numbers, a singular configuration lies between.
"""

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from spherekit.arrays import Bools, Floats, Indices, Integers
from spherekit.conventions import listing
from spherekit.errors import PlanError
from spherekit.guarantee import Completeness, Guarantee
from spherekit.progress import ProgressReporter
from spherekit.proof.balls import UNIT, Ball, bits, circle, middle, upper
from spherekit.proof.construction import Construction, construct
from spherekit.proof.equations import Equations
from spherekit.proof.gears import Written
from spherekit.proof.systems import System, counted, systems_of
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


PRECISION = 80
CELL = 0.01
"""Largest side (rad) of the cells that are judged."""
FINER = 5
"""How often cells are halved further each way, to judge them."""
AT_ONCE = 4096
"""Roots that are looked at together."""
REGULAR, CONTAINS, UNDECIDED = 0, 1, 2


@dataclass(frozen=True)
class InputMap:
    """What is proven of boxes of the inputs (n, inputs) rad, which fill their ranges.

    `kind` (n,) is `REGULAR`, `CONTAINS` for boxes with a configuration of type II in them,
    or `UNDECIDED`; `modes` (n,) are the numbers of modes of regular ones, else -1.
    `systems` are those by which they were counted, with solutions to start from.
    """

    written: Written
    construction: Construction
    range_texts: Sequence[tuple[str, str]]
    centres: Floats
    radii: Floats
    kind: Indices
    modes: Indices
    systems: Sequence[System]

    def share(self, kind: int) -> float:
        """Return the share of the whole area that boxes of a kind have."""
        return self._share(self.kind == kind)

    def _share(self, chosen: Bools) -> float:
        sizes = np.prod(self.radii, axis=1)
        return np.sum(sizes[chosen]) / np.sum(sizes)

    @cached_property
    def counts(self) -> dict[int, float]:
        """The share of the whole area in which there are so many modes, proven."""
        counts = np.unique(self.modes).tolist()
        return {n: self._share(self.modes == n) for n in counts if n >= 0}

    def clearance(self, q: Floats) -> float:
        """Return how far (rad) every input may go from q before type II, at least.

        In all modes, and not beyond the ranges of the inputs.
        """
        away = np.abs(self.centres - q) - self.radii
        low = np.min(self.centres - self.radii, axis=0)
        high = np.max(self.centres + self.radii, axis=0)
        gaps = np.max(away[self.kind != REGULAR], axis=1)
        return max(np.min([*gaps, *(q - low), *(high - q)]) - 1e-12, 0.0)

    @property
    def claim(self) -> Completeness:
        """What is guaranteed, and what that rests on."""
        regular, contains, left = (self.share(k) for k in (REGULAR, CONTAINS, UNDECIDED))
        words = (
            f"{100 * regular:.3f} % of the area of the inputs free of type II, "
            f"{100 * contains:.3f} % in cells with some, {100 * left:.3f} % undecided; "
            f"{len(self.centres)} boxes, all complex roots continued over each that is free"
        )
        if left == 0.0:
            return Completeness(Guarantee.CERTIFIED, words)
        return Completeness(Guarantee.TO_BOX, words, CELL)


def input_map(
    written: Written,
    range_texts: Sequence[tuple[str, str]],
    cell: float = CELL,
) -> InputMap:
    """Return where over the ranges of the inputs modes are proven to be regular.

    Parameters
    ----------
    written
        The mechanism.
    range_texts
        The ends of each input's range as decimal numbers in the unit of the file, in the
        order of the inputs.
    cell
        Largest side (rad) of the boxes that are said to contain a singular configuration.

    Raises
    ------
    PlanError
        If no input leaves as many complex modes as there can be at most: some coincide
        everywhere, or solutions at infinity do.
    """
    made = construct(written.structure)
    if made.followers:
        raise PlanError(
            f"{written.mechanism.name}: wheels turn "
            f"{listing(written.structure.names_of(made.followers))} with the inputs; maps "
            "of inputs are for mechanisms without rolling contacts: give values of the "
            "inputs with --at"
        )
    with bits(PRECISION):
        ends = [[*map(written.input_angle, two)] for two in range_texts]
        ranges = Ranges([start for start, _ in ends], [end - start for start, end in ends])
        systems = systems_of(Equations(written, made))
        boxes, kinds, modes = _judged(systems, ranges, cell)
        centres, radii = ranges.centres(boxes), ranges.radii(boxes)
    return InputMap(written, made, range_texts, centres, radii, kinds, modes, systems)


def _judged(
    systems: Sequence[System], ranges: Ranges, side: float
) -> tuple[Integers, Indices, Indices]:
    """Return boxes with their kinds and numbers of modes, halved until they are judged."""
    cell = np.maximum(np.ceil(np.log2(ranges.extent / side)), 0).astype(np.int64)
    finest = cell + FINER
    most = max(1, AT_ONCE // sum(system.bound for system in systems))
    done: list[tuple[Integers, Indices, Indices]] = []
    fine: dict[tuple[int, ...], set[int]] = defaultdict(set)

    def judged(boxes: Integers, _: int) -> Integers:
        levels, places = boxes
        radii = ranges.radii(boxes)
        centres, turns = ranges.centres(boxes), ranges.turns(boxes)
        good, modes = counted(systems, centres, turns, radii)
        inside = np.all(levels >= cell, axis=1) & np.any(levels > cell, axis=1)
        last = np.all(levels >= finest, axis=1)
        whole = good & ~inside
        done.append((boxes[:, whole], 0 * modes[whole], modes[whole]))
        left = ~good & ~last
        for row in np.flatnonzero(inside):
            counts = fine[tuple((places[row] >> (levels[row] - cell)).tolist())]
            if good[row] or last[row]:
                counts.add(int(modes[row]) if good[row] else -1)
            # of a cell with two numbers of modes no more is asked
            left[row] &= len(counts - {-1}) < 2
        # across the side that has farthest to go, to cells first
        coarse = np.any(levels < cell, axis=1, keepdims=True)
        farther = radii * np.where(coarse, levels < cell, levels < finest)
        return halved(boxes[:, left], np.argmax(farther[left], axis=1))

    cut_up(ranges.whole, most, "proving boxes of the inputs regular", judged)
    for place, counts in fine.items():
        same = len(counts) == 1 and -1 not in counts
        kind = REGULAR if same else CONTAINS if len(counts - {-1}) > 1 else UNDECIDED
        at = np.array([[cell], [place]])
        done.append((at, np.array([kind]), np.array([max(counts) if same else -1])))
    boxes, kinds, modes = zip(*done, strict=True)
    return np.concatenate(boxes, axis=1), np.concatenate(kinds), np.concatenate(modes)
