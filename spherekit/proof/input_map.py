"""Two or more inputs: boxes in which no mode is singular, and those in which one is.

Where all complex roots that there can be are continued over a box of inputs, none of them
meets another: no configuration of the box is singular with the inputs as they are (type
II), and the number of modes is the same everywhere. Where two such boxes in one connected
part have different numbers, a singular configuration lies between.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import listing
from spherekit.errors import PlanError
from spherekit.guarantee import Claim, Guarantee
from spherekit.progress import Working
from spherekit.proof.balls import bits
from spherekit.proof.construction import Construction, construct
from spherekit.proof.equations import Equations
from spherekit.proof.paving import Axis, Boxes
from spherekit.proof.systems import Guide, SolvedSystem, Systems
from spherekit.proof.written import Written
from spherekit.sphere.rotation import Floats

PRECISION = 80
CELL = 0.01
"""Largest side (rad) of the cells that are judged."""
FINER = 4
"""How often cells are halved further each way, to judge them."""
AT_ONCE = 4096
"""Roots that are looked at together."""
REGULAR, CONTAINS, UNDECIDED = 0, 1, 2


@final
@dataclass(frozen=True)
class InputMap:
    """What is proven of boxes of the inputs (n, inputs) rad, which fill their ranges.

    `kind` (n,) is `REGULAR`, `CONTAINS` for boxes with a configuration of type II in them,
    or `UNDECIDED`; `modes` (n,) are the numbers of modes of regular ones, else -1.
    `systems` are those by which they were counted, with solutions to start from.
    """

    written: Written
    construction: Construction
    range_texts: tuple[tuple[str, str], ...]
    centres: Floats
    radii: Floats
    kind: NDArray[np.intp]
    modes: NDArray[np.intp]
    systems: tuple[SolvedSystem, ...]

    def share(self, kind: int) -> float:
        """Return the share of the whole area that boxes of a kind have."""
        sizes = np.prod(self.radii, axis=1)
        return float(np.sum(sizes[self.kind == kind]) / np.sum(sizes))

    @cached_property
    def counts(self) -> dict[int, float]:
        """The share of the whole area in which there are so many modes, proven."""
        sizes = np.prod(self.radii, axis=1)
        return {
            int(count): float(np.sum(sizes[self.modes == count]) / np.sum(sizes))
            for count in np.unique(self.modes[self.kind == REGULAR])
        }

    def clearance(self, q: Floats) -> float:
        """Return how far (rad) every input may go from q before type II, at least.

        In all modes, and not beyond the ranges of the inputs.
        """
        away = np.abs(self.centres - q) - self.radii
        low = np.min(self.centres - self.radii, axis=0)
        high = np.max(self.centres + self.radii, axis=0)
        gaps = np.max(away[self.kind != REGULAR], axis=1, initial=-np.inf)
        nearest = float(np.min(gaps, initial=np.inf))
        edge = float(min(np.min(q - low), np.min(high - q)))
        return max(min(nearest, edge) - 1e-12, 0.0)

    def at(self, q: Floats) -> NDArray[np.intp]:
        """Return the kind (m,) of the box that inputs (m, inputs) are in, -1 outside."""
        out = np.full(len(q), -1, dtype=np.intp)
        for row, place in enumerate(q):
            inside = np.all(np.abs(self.centres - place) <= self.radii * (1 + 1e-9), axis=1)
            if np.any(inside):
                out[row] = np.max(self.kind[inside])
        return out

    @property
    def claim(self) -> Claim:
        """What is guaranteed, and what that rests on."""
        regular, contains, left = (self.share(k) for k in (REGULAR, CONTAINS, UNDECIDED))
        words = (
            f"{100 * regular:.3f} % of the area of the inputs free of type II, "
            f"{100 * contains:.3f} % in cells with some, {100 * left:.3f} % undecided; "
            f"{len(self.centres)} boxes, all complex roots continued over each that is free"
        )
        if left == 0.0:
            return Claim(Guarantee.CERTIFIED, words)
        return Claim(Guarantee.TO_BOX, words, CELL)


def input_map(
    written: Written,
    range_texts: Sequence[tuple[str, str]],
    cell: float = CELL,
    finer: int = FINER,
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
    finer
        How often these are halved each way to be judged.

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
            f"{listing(written.structure.pairs[pair] for pair in made.followers)} with the "
            "inputs; maps of inputs are for mechanisms without rolling contacts: give "
            "values of the inputs with --at"
        )
    with bits(PRECISION):
        equations = Equations(written, made)
        axes = []
        for low, high in range_texts:
            start = written.input_angle(low)
            axes.append(Axis(start, written.input_angle(high) - start))
        search = _Map(equations, axes, cell, finer)
        boxes = search.judged()
    systems = search.systems.starts()
    return InputMap(written, made, tuple(range_texts), *boxes, systems)


@final
class _Map:
    """Boxes halved until they are judged."""

    def __init__(
        self, equations: Equations, axes: Sequence[Axis], cell: float, finer: int
    ) -> None:
        self.equations, self.axes = equations, axes
        self.systems = Systems(equations)
        widths = np.array([axis.extent for axis in axes])
        self.cell = np.maximum(np.ceil(np.log2(widths / cell)), 0).astype(np.int64)
        self.finest = self.cell + finer
        self.done: list[tuple[Floats, Floats, NDArray[np.intp], NDArray[np.intp]]] = []

    def judged(self) -> tuple[Floats, Floats, NDArray[np.intp], NDArray[np.intp]]:
        """Return centres, radii, kinds and numbers of modes of all boxes."""
        zero = np.zeros((1, len(self.axes)), dtype=np.int64)
        boxes = Boxes(zero, zero)
        guides: list[Guide] = [{}]
        working = Working("proving boxes of the inputs regular")
        waiting = [(boxes, guides)]
        fine: dict[tuple[int, ...], list[int]] = {}
        while waiting:
            boxes, guides = waiting.pop()
            most = max(1, AT_ONCE // sum(self.systems.bounds))
            if len(boxes) > most:
                waiting.append((boxes.take(slice(most, None)), guides[most:]))
                boxes, guides = boxes.take(slice(0, most)), guides[:most]
            working.tell(lambda: f"{sum(len(d[0]) for d in self.done)} boxes")
            good, modes, guides = self._tried(boxes, guides)
            small = np.all(boxes.levels >= self.cell, axis=1)
            inside = np.any(boxes.levels > self.cell, axis=1) & small
            last = np.all(boxes.levels >= self.finest, axis=1)
            whole = good & ~inside
            if np.any(whole):
                self._keep(boxes.take(whole), np.zeros(np.sum(whole), int), modes[whole])
            for row in np.flatnonzero(inside & (good | last)):
                fine.setdefault(self._cell_of(boxes, int(row)), []).append(
                    int(modes[row]) if good[row] else -1
                )
            left = np.flatnonzero(~good & ~last)
            if len(left):
                waiting.append(self._split(boxes, guides, left))
        for place, counts in fine.items():
            every = set(counts)
            kind, count = UNDECIDED, -1
            if -1 not in every and len(every) == 1:
                kind, count = REGULAR, counts[0]
            elif len(every - {-1}) > 1:
                kind = CONTAINS
            at = Boxes(self.cell[None], np.array([place], dtype=np.int64))
            self._keep(at, np.array([kind]), np.array([count]))
        parts = list(zip(*self.done, strict=True))
        centres, radii, kinds, modes_of = (np.concatenate(part) for part in parts)
        return centres, radii, kinds, modes_of

    def _keep(self, boxes: Boxes, kind: NDArray[np.intp], modes: NDArray[np.intp]) -> None:
        self.done.append((boxes.centres(self.axes), boxes.radii(self.axes), kind, modes))

    def _cell_of(self, boxes: Boxes, row: int) -> tuple[int, ...]:
        shift = boxes.levels[row] - self.cell
        return tuple((boxes.places[row] >> shift).tolist())

    def _split(
        self, boxes: Boxes, guides: list[Guide], left: NDArray[np.intp]
    ) -> tuple[Boxes, list[Guide]]:
        """Return the halves of boxes across the side that has farthest to go."""
        chosen = np.zeros(len(boxes), dtype=bool)
        chosen[left] = True
        taken = boxes.take(chosen)
        spare = np.where(taken.levels < self.cell, self.cell, self.finest) - taken.levels
        coarse = np.any(taken.levels < self.cell, axis=1)
        radii = taken.radii(self.axes) * (spare > 0)
        radii = np.where(coarse[:, None] & (taken.levels >= self.cell), 0.0, radii)
        halves = taken.halved(np.argmax(radii, axis=1))
        kept = [guides[row] for row in left]
        return halves, kept + kept

    def _tried(
        self, boxes: Boxes, guides: list[Guide]
    ) -> tuple[NDArray[np.bool_], NDArray[np.intp], list[Guide]]:
        """Return which boxes are proven regular, their modes, and the roots they have."""
        hard = np.all(boxes.levels >= self.finest - 1, axis=1)
        counted = self.systems.counted(
            boxes.centres(self.axes),
            boxes.turns(self.axes),
            boxes.radii(self.axes),
            guides,
            hard,
        )
        return counted.good, counted.modes, counted.guides
