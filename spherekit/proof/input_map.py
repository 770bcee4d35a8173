"""Boxes of two or more inputs in which no mode is singular, and those in which one is.

Where all complex roots that there can be are continued over a box of inputs, none of them
meets another: no configuration of the box is singular with the inputs as they are (type
II), and the number of modes is the same everywhere. Where two such boxes in one connected
part have different numbers, a singular configuration lies between.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from spherekit.arrays import Bools, Floats, Indices, Integers
from spherekit.completeness import Completeness, Guarantee
from spherekit.errors import PlanError
from spherekit.proof.arc_equations import Equations
from spherekit.proof.balls import bits
from spherekit.proof.construction import Construction, construct
from spherekit.proof.decimal_mechanism import Written
from spherekit.proof.modes_over_boxes import System, counted, systems_of
from spherekit.proof.paving import Ranges, cut_up, halved
from spherekit.wording import listing

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
