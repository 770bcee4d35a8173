"""Proof that no configuration lies outside given pieces: space is cut into boxes.

A box goes if an equation cannot vanish in it: |f| at its centre is more than its slopes and
the bound of its second derivatives allow over the box. It goes too if it is inside a
piece. All others are halved. What is left when boxes are small is undecided.

With f and F' at a box's centre, the values of the linear parts over the box are a zonotope,
and zero is outside of it if and only if it is beyond one of its facets (McMullen, On
zonotopes, 1971). The normal of a facet is a sum of equations in which all variables but
two, or one where there are as many as equations, have no slope. Any sum is one that may be
taken, so that nothing rests on how well its weights are computed.

Two or more inputs: boxes in which no mode is singular, and those in which one is.

Where all complex roots that there can be are continued over a box of inputs, none of them
meets another: no configuration of the box is singular with the inputs as they are (type
II), and the number of modes is the same everywhere. Where two such boxes in one connected
part have different numbers, a singular configuration lies between.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations

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
from spherekit.proof.systems import SolvedSystem, Systems
from spherekit.proof.tubes import ROUNDING, UP

FLATTEST = 1e-9
"""Least determinant of slopes by which weights are computed."""


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
    out = np.zeros(len(values), dtype=bool)
    count = values.shape[1]
    moving = np.flatnonzero(np.any(radii > 0.0, axis=0))
    if len(values) == 0 or count == 1 or not count <= len(moving) <= count + 1:
        return out
    steep, wide = slopes[..., moving], radii[:, moving]
    columns = list(combinations(range(len(moving)), count))
    sizes = np.stack([np.abs(np.linalg.det(steep[..., kept])) for kept in columns], axis=1)
    largest = np.argmax(sizes, axis=1)
    sizes = sizes[np.arange(len(sizes)), largest]
    for number, kept in enumerate(columns):
        rows = np.flatnonzero((largest == number) & (sizes > FLATTEST))
        if len(rows):
            weights = _normals(steep[rows], kept)
            out[rows] = _beyond(weights, values[rows], steep[rows], wide[rows], bent[rows])
    return out


def _normals(slopes: Floats, kept: tuple[int, ...]) -> Floats:
    """Return weights (n, facets, k) of the facets, from the inverse of some columns."""
    inverse = np.linalg.inv(slopes[..., kept])
    left = [column for column in range(slopes.shape[2]) if column not in kept]
    if not left:
        return np.asarray(inverse)
    also = inverse @ slopes[..., left]
    pairs = [
        also[:, one] * inverse[:, other] - also[:, other] * inverse[:, one]
        for one, other in combinations(range(len(kept)), 2)
    ]
    return np.concatenate([inverse, np.stack(pairs, axis=1)], axis=1)


def _beyond(
    weights: Floats, values: Floats, slopes: Floats, radii: Floats, bent: Floats
) -> Bools:
    """Return whether one of the sums of equations cannot vanish."""
    size = np.abs(values) + np.einsum("nkv,nv->nk", np.abs(slopes), radii)
    reach = np.einsum("nwv,nv->nw", np.abs(weights @ slopes), radii)
    reach += np.einsum("nwk,nk->nw", np.abs(weights), bent + ROUNDING * size)
    return np.any(np.abs(np.einsum("nwk,nk->nw", weights, values)) > reach * UP, axis=1)


CHUNK = 20000
FIRST = -2.4
"""Where turns of unknown angles begin (rad): at no place that special geometry prefers."""


class Axis:
    """One variable over its range, cut in halves: centres, radii, cosines and sines.

    `low` and `width` are balls (rad), exact or far narrower than a rounding.
    """

    def __init__(self, low: Ball, width: Ball) -> None:
        self.low, self.width = low, width
        self.start, self.extent = middle(low), middle(width)
        self._known: dict[float, Floats] = {}

    def radii(self, levels: Integers, _: Integers) -> Floats:
        """Return half widths after so many halvings, about the centres, rounded up."""
        off = 8.0 * UNIT * (abs(self.start) + abs(self.extent)) if self.extent else 0.0
        return upper(self.width) * UP * np.exp2(-1.0 - levels) + off

    def centres(self, levels: Integers, places: Integers) -> Floats:
        """Return float64 numbers next to the centres, or to the angle if it is only one."""
        return np.asarray(self.start + self.extent * (places + 0.5) * np.exp2(-levels))

    def turns(self, levels: Integers, places: Integers) -> Floats:
        """Return cosines and sines (n, 2) of these numbers, each rounded once."""
        centres, back = np.unique(self.centres(levels, places), return_inverse=True)
        fresh = [centre for centre in centres.tolist() if centre not in self._known]
        angles = fresh if self.extent else [self.low] * len(fresh)
        self._known.update(zip(fresh, circle(angles), strict=True))
        return np.array([self._known[centre] for centre in centres.tolist()])[back]


@dataclass(frozen=True)
class Boxes:
    """Boxes (n, variables) by how often each side was halved, and which part they are."""

    axes: Sequence[Axis]
    levels: Integers
    places: Integers

    @staticmethod
    def whole(axes: Sequence[Axis]) -> "Boxes":
        """Return the box of the axes' whole ranges."""
        zero = np.zeros((1, len(axes)), dtype=np.int64)
        return Boxes(axes, zero, zero)

    def __len__(self) -> int:
        return len(self.levels)

    def _along(self, of: Callable[[Axis, Integers, Integers], Floats]) -> Floats:
        columns = zip(self.axes, self.levels.T, self.places.T, strict=True)
        return np.stack([of(*column) for column in columns], axis=1)

    @property
    def centres(self) -> Floats:
        """Float64 numbers (n, variables) next to the centres."""
        return self._along(Axis.centres)

    @property
    def radii(self) -> Floats:
        """Half widths (n, variables), rounded up."""
        return self._along(Axis.radii)

    @property
    def turns(self) -> Floats:
        """Cosines and sines (n, variables, 2) of the centres, each rounded once."""
        return self._along(Axis.turns)

    def take(self, rows: Bools | slice) -> "Boxes":
        """Return some of them."""
        return Boxes(self.axes, self.levels[rows], self.places[rows])

    def halved(self, sides: Indices) -> "Boxes":
        """Return both halves of each across its side in `sides` (n,)."""
        cut = np.arange(len(self.axes)) == sides[:, None]
        low = self.places << cut
        levels = self.levels + cut
        return Boxes(
            self.axes, np.concatenate([levels, levels]), np.concatenate([low, low + cut])
        )


@dataclass
class CoveredBoxes:
    """What became of space: how many boxes were looked at, and those undecided.

    `centres` and `radii` (n, variables) rad are those of the boxes left.
    """

    looked_at: int = 0
    centres: Floats = field(default_factory=lambda: np.empty((0, 0)))
    radii: Floats = field(default_factory=lambda: np.empty((0, 0)))


Covered = Callable[[Floats, Floats], Bools]
"""Says which boxes of centres and radii (n, variables) are inside a piece."""
Looked = Callable[[Floats, Floats], bool]
"""Is told the centres and radii of boxes that are not decided; whether it finds pieces."""


def paved(
    equations: Equations,
    axes: Sequence[Axis],
    covered: Covered,
    looked: Looked,
    smallest: float,
    most: int,
) -> CoveredBoxes:
    """Return which boxes of the axes' ranges may have configurations not in pieces.

    Boxes whose largest radius is below `smallest` (rad) are not halved; after `most` boxes
    none are.
    """
    degrees, error = equations.degrees, equations.real.error
    waiting = [Boxes.whole(axes)]
    nothing = np.empty((0, len(axes)))
    left = [(nothing, nothing)]
    paving = CoveredBoxes()
    working = ProgressReporter("proving that nothing else is there")
    while waiting:
        boxes = waiting.pop()
        if len(boxes) > CHUNK:
            waiting.append(boxes.take(slice(CHUNK, None)))
            boxes = boxes.take(slice(0, CHUNK))
        paving.looked_at += len(boxes)
        working.tell(lambda: f"{paving.looked_at} boxes")
        radii = boxes.radii
        values, slopes = equations.real.first(boxes.turns)
        change = radii @ degrees.T
        reach = np.einsum("nkv,nv->nk", np.abs(slopes), radii)
        bent = 0.5 * equations.bound * change**2 + error * (1.0 + change)
        open_ = ~np.any(np.abs(values) > (reach + bent) * UP, axis=1)
        rows = np.flatnonzero(open_)
        open_[rows] = ~apart(values[rows], slopes[rows], radii[rows], bent[rows])
        if not np.any(open_):
            continue
        boxes, radii, slopes = boxes.take(open_), radii[open_], slopes[open_]
        centres = boxes.centres
        largest = np.max(radii, axis=1)
        kept = ~covered(centres, radii)
        if np.any(kept) and looked(centres[kept], radii[kept]):
            kept[kept] = ~covered(centres[kept], radii[kept])
        ended = kept & ((largest < smallest) | (paving.looked_at > most))
        left.append((centres[ended], radii[ended]))
        kept &= ~ended
        if np.any(kept):
            weight = _weights(slopes[kept], degrees, radii[kept])
            waiting.append(boxes.take(kept).halved(np.argmax(weight, axis=1)))
    paving.centres, paving.radii = map(np.concatenate, zip(*left, strict=True))
    return paving


def _weights(slopes: Floats, degrees: Floats, radii: Floats) -> Floats:
    """Return by how much each side of boxes (n, v) keeps the equations undecided."""
    norms = np.sqrt(np.sum(slopes**2, axis=2, keepdims=True)) + 1e-3
    share = np.max(np.abs(slopes) / norms, axis=1)
    return np.maximum(share, 0.2 * np.any(degrees > 0, axis=0)) * radii


PRECISION = 80
CELL = 0.01
"""Largest side (rad) of the cells that are judged."""
FINER = 4
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
    range_texts: tuple[tuple[str, str], ...]
    centres: Floats
    radii: Floats
    kind: Indices
    modes: Indices
    systems: tuple[SolvedSystem, ...]

    def share(self, kind: int) -> float:
        """Return the share of the whole area that boxes of a kind have."""
        return self._share(self.kind == kind)

    def _share(self, chosen: Bools) -> float:
        sizes = np.prod(self.radii, axis=1)
        return float(np.sum(sizes[chosen]) / np.sum(sizes))

    @cached_property
    def counts(self) -> dict[int, float]:
        """The share of the whole area in which there are so many modes, proven."""
        counts = np.unique(self.modes[self.kind == REGULAR]).tolist()
        return {count: self._share(self.modes == count) for count in counts}

    def clearance(self, q: Floats) -> float:
        """Return how far (rad) every input may go from q before type II, at least.

        In all modes, and not beyond the ranges of the inputs.
        """
        away = np.abs(self.centres - q) - self.radii
        low = np.min(self.centres - self.radii, axis=0)
        high = np.max(self.centres + self.radii, axis=0)
        gaps = np.max(away[self.kind != REGULAR], axis=1, initial=-np.inf)
        nearest = float(np.min(gaps, initial=np.inf))
        return max(min(nearest, float(min(np.min(q - low), np.min(high - q)))) - 1e-12, 0.0)

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
        systems = Systems(equations)
        boxes, kinds, modes = _judged(systems, axes, cell, finer)
    return InputMap(
        written,
        made,
        tuple(range_texts),
        np.concatenate([part.centres for part in boxes]),
        np.concatenate([part.radii for part in boxes]),
        np.concatenate(kinds),
        np.concatenate(modes),
        tuple(systems.parts),
    )


def _judged(
    systems: Systems, axes: Sequence[Axis], side: float, finer: int
) -> tuple[Sequence[Boxes], Sequence[Indices], Sequence[Indices]]:
    """Return boxes with their kinds and numbers of modes, halved until they are judged."""
    widths = np.array([axis.extent for axis in axes])
    cell = np.maximum(np.ceil(np.log2(widths / side)), 0).astype(np.int64)
    finest = cell + finer
    most = max(1, AT_ONCE // sum(system.bound for system in systems.parts))
    done: list[tuple[Boxes, Indices, Indices]] = []
    fine: dict[tuple[int, ...], set[int]] = {}
    working = ProgressReporter("proving boxes of the inputs regular")
    waiting = [Boxes.whole(axes)]
    while waiting:
        boxes = waiting.pop()
        if len(boxes) > most:
            waiting.append(boxes.take(slice(most, None)))
            boxes = boxes.take(slice(0, most))
        working.tell(lambda: f"{sum(len(part) for part, *_ in done)} boxes")
        levels, places = boxes.levels, boxes.places
        hard = np.all(levels >= finest - 1, axis=1)
        good, modes = systems.counted(boxes.centres, boxes.turns, boxes.radii, hard)
        inside = np.all(levels >= cell, axis=1) & np.any(levels > cell, axis=1)
        last = np.all(levels >= finest, axis=1)
        whole = good & ~inside
        done.append((boxes.take(whole), 0 * modes[whole], modes[whole]))
        for row in np.flatnonzero(inside & (good | last)):
            place = tuple((places[row] >> (levels[row] - cell)).tolist())
            fine.setdefault(place, set()).add(int(modes[row]) if good[row] else -1)
        left = boxes.take(~good & ~last)
        if len(left):
            waiting.append(left.halved(_farthest(left, cell, finest)))
    for place, counts in fine.items():
        same = len(counts) == 1 and -1 not in counts
        kind = REGULAR if same else CONTAINS if len(counts - {-1}) > 1 else UNDECIDED
        at = Boxes(axes, cell[None], np.array([place], dtype=np.int64))
        done.append((at, np.array([kind]), np.array([max(counts) if same else -1])))
    boxes_of, kinds, modes_of = zip(*done, strict=True)
    return boxes_of, kinds, modes_of


def _farthest(boxes: Boxes, cell: Integers, finest: Integers) -> Indices:
    """Return the side of each box that has farthest to go, to cells first."""
    levels = boxes.levels
    coarse = np.any(levels < cell, axis=1, keepdims=True)
    return np.argmax(boxes.radii * np.where(coarse, levels < cell, levels < finest), axis=1)
