"""Boxes of two or more inputs that are proven free of type II singularities.

Suppose that as many complex roots as the equations can have are continued over a box of
inputs, and that no two of them meet. Then no configuration of the box is singular with
locked inputs (type II), and the number of modes is the same everywhere: the box is
*regular*. If two regular boxes in one connected region have different numbers of modes,
there is a singular configuration between them.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from spherekit.arrays import Bools, Floats, Indices, Integers
from spherekit.completeness import Completeness, Guarantee
from spherekit.errors import PlanError
from spherekit.proof.arc_equations import ArcEquations
from spherekit.proof.balls import working_precision
from spherekit.proof.construction import Construction, find_construction
from spherekit.proof.decimal_mechanism import DecimalMechanism
from spherekit.proof.modes_over_boxes import EquationSystem, count_modes, list_systems
from spherekit.proof.paving import VariableRanges, halve_boxes, subdivide
from spherekit.wording import listing

MAP_PRECISION_BITS = 80
"""Bits of ball centres for maps of inputs.

More bits do not help: the tests over boxes are in float64.
"""

DEFAULT_CELL_RAD = 0.01
"""Largest side (rad) of the cells that are classified, unless another is asked for.

Larger: coarser maps. Smaller: finer maps, in more time.
"""

CELL_HALVINGS = 5
"""Number of times that the sides of a cell are halved to classify it.

Larger: fewer undecided cells, in longer times. Smaller: more cells stay undecided.
"""

MAX_ROOTS_AT_ONCE = 4096
"""About how many roots are examined in one array operation.

Larger: more memory. Smaller: more overhead.
"""

REGULAR = 0
"""Kind of a box without singular configurations of type II."""

CONTAINS_TYPE_II = 1
"""Kind of a box that contains a singular configuration of type II."""

UNDECIDED = 2
"""Kind of a box of which neither is proven."""


@dataclass(frozen=True)
class InputMap:
    """A map of the inputs: boxes that fill their ranges, with what is proven of each box.

    A box is regular if no configuration in it is singular with locked inputs (type II). The
    number of assembly modes is then the same everywhere in the box.

    Attributes
    ----------
    decimal_mechanism
        The mechanism with its decimal sizes.
    construction
        The order of placing its links.
    range_texts
        Ends of the range of each input as decimal numbers in the unit of the file.
    centres, radii
        (n, inputs) centres and half widths (rad) of the boxes.
    kind
        (n,) `REGULAR`, `CONTAINS_TYPE_II` or `UNDECIDED`.
    modes
        (n,) number of modes of regular boxes, else -1.
    systems
        The systems by which modes were counted, with solutions to start from.
    """

    decimal_mechanism: DecimalMechanism
    construction: Construction
    range_texts: Sequence[tuple[str, str]]
    centres: Floats
    radii: Floats
    kind: Indices
    modes: Indices
    systems: Sequence[EquationSystem]

    def share(self, kind: int) -> float:
        """Return the share of the whole area that boxes of one kind have."""
        return self._share_of(self.kind == kind)

    def _share_of(self, chosen: Bools) -> float:
        """Return the share of the whole area that the boxes of a mask (n,) have."""
        areas = np.prod(self.radii, axis=1)
        return np.sum(areas[chosen]) / np.sum(areas)

    @cached_property
    def mode_shares(self) -> dict[int, float]:
        """By number of modes: the share of the area in which this number is proven."""
        counts = np.unique(self.modes).tolist()
        return {
            count: self._share_of(self.modes == count) for count in counts if count >= 0
        }

    def clearance(self, q: Floats) -> float:
        """Return how far (rad) all inputs can change from q without meeting type II.

        At type II a configuration is singular with locked inputs. If each input changes by
        less than the result, no configuration of any assembly mode is of type II.

        The map divides the ranges of the inputs into boxes, and some are proven to be free
        of type II (regular). The result is the distance of q (inputs,) rad from the nearest
        box that is not regular, or from the end of a range. It is 0 if q is in a box that
        is not regular, or outside the ranges.
        """
        # Distances (boxes, inputs) of q from each box along each input, negative inside.
        distances = np.abs(self.centres - q) - self.radii
        low = np.min(self.centres - self.radii, axis=0)
        high = np.max(self.centres + self.radii, axis=0)
        # A point is in a box only if its distances along all inputs are at most 0. So the
        # largest of them tells how far the inputs must change to reach the box.
        gaps = np.max(distances[self.kind != REGULAR], axis=1)
        # 1e-12 rad covers the rounding of the boxes.
        return max(np.min([*gaps, *(q - low), *(high - q)]) - 1e-12, 0.0)

    @property
    def completeness(self) -> Completeness:
        """What is guaranteed about the map, and why.

        A box of the inputs is regular if it is proven free of type II (configurations that
        are singular with locked inputs). The proof follows all complex roots of the
        equations over the box, and shows that none of them meet. Without undecided boxes
        the result is certified. Otherwise regions smaller than the largest undecided box
        may be unknown (`Guarantee.TO_BOX`).
        """
        regular = self.share(REGULAR)
        contains = self.share(CONTAINS_TYPE_II)
        undecided = self.share(UNDECIDED)
        words = (
            f"{100 * regular:.3f} % of the area of the inputs free of type II, "
            f"{100 * contains:.3f} % in cells with some, {100 * undecided:.3f} % "
            f"undecided; {len(self.centres)} boxes, all complex roots continued over each "
            "that is free"
        )
        if undecided == 0.0:
            return Completeness(Guarantee.CERTIFIED, words)
        largest_side = 2.0 * np.max(self.radii[self.kind == UNDECIDED])
        return Completeness(Guarantee.TO_BOX, words, float(largest_side))


def certify_input_map(
    decimal_mechanism: DecimalMechanism,
    range_texts: Sequence[tuple[str, str]],
    cell: float = DEFAULT_CELL_RAD,
) -> InputMap:
    """Divide the ranges of the inputs into boxes, and prove which are free of type II.

    At type II a configuration is singular with locked inputs. Boxes are halved until they
    are proven to be free of type II, or are cells (the smallest boxes). A cell is free of
    type II, contains such a configuration, or is undecided.

    Parameters
    ----------
    decimal_mechanism
        The mechanism with its decimal sizes.
    range_texts
        For each input, in order, the ends of its range as decimal numbers in the unit of
        the file.
    cell
        Largest side (rad) of a cell.

    Raises
    ------
    PlanError
        If the inputs drive wheels, or if a range is empty.
    """
    structure = decimal_mechanism.structure
    construction = find_construction(structure)
    # Followers are pairs (joints) that the inputs drive through rolling wheels.
    if construction.follower_pairs:
        raise PlanError(
            f"{decimal_mechanism.mechanism.name}: the inputs drive "
            f"{listing(structure.names_of(construction.follower_pairs))} through wheels; "
            "maps over ranges of inputs are possible only without rolling contacts: give "
            "values of the inputs with --at"
        )
    input_names = structure.names_of(construction.input_pairs)
    for input_name, (low_text, high_text) in zip(input_names, range_texts, strict=True):
        if not float(low_text) < float(high_text):
            raise PlanError(
                f"{structure.name}: the range {low_text} to {high_text} of input "
                f"{input_name} is empty; give FROM < TO, or values of the inputs with --at"
            )
    with working_precision(MAP_PRECISION_BITS):
        lows = []
        widths = []
        for low_text, high_text in range_texts:
            low = decimal_mechanism.input_angle(low_text)
            lows.append(low)
            widths.append(decimal_mechanism.input_angle(high_text) - low)
        ranges = VariableRanges(lows, widths)
        # The closure equations consist of systems that are solved one after another.
        systems = list_systems(ArcEquations(decimal_mechanism, construction))
        classified = _classify_boxes(systems, ranges, cell)
        centres = ranges.centres(classified.boxes)
        radii = ranges.radii(classified.boxes)
    return InputMap(
        decimal_mechanism=decimal_mechanism,
        construction=construction,
        range_texts=range_texts,
        centres=centres,
        radii=radii,
        kind=classified.kind,
        modes=classified.modes,
        systems=systems,
    )


@dataclass(frozen=True)
class _ClassifiedBoxes:
    """Boxes in the space of the inputs, with what is proven of them.

    Attributes
    ----------
    boxes
        (2, n, inputs) boxes: for each input how often its range was halved [0], and the
        index of the part [1]. Example: 2 and 3 is the last quarter of the range.
    kind
        (n,) `CONTAINS_TYPE_II` if a box contains a configuration that can move while the
        inputs are locked. `REGULAR` if it contains none, otherwise `UNDECIDED`.
    modes
        (n,) number of assembly modes of regular boxes, else -1.
    """

    boxes: Integers
    kind: Indices
    modes: Indices


def _classify_boxes(
    systems: Sequence[EquationSystem], ranges: VariableRanges, cell: float
) -> _ClassifiedBoxes:
    """Halve the ranges of the inputs until all boxes are classified.

    A box is regular if no configuration in it is singular with locked inputs. A regular box
    has the same number of assembly modes everywhere. Boxes that are not proven regular are
    halved until they have the size of a cell. A cell is halved further into parts. If two
    regular parts have different numbers of modes, the cell contains a singular
    configuration. If all parts are regular with the same number of modes, the cell is
    regular. Otherwise the cell is undecided.

    Parameters
    ----------
    systems
        The systems of the mechanism in order.
    ranges
        The ranges of the inputs.
    cell
        Largest side (rad) of a cell.
    """
    # Number of halvings of each input's range for cells, and for their smallest parts.
    cell_levels = np.maximum(np.ceil(np.log2(ranges.float_width / cell)), 0).astype(
        np.int64
    )
    finest_levels = cell_levels + CELL_HALVINGS
    max_at_once = max(1, MAX_ROOTS_AT_ONCE // sum(system.bound for system in systems))
    classified: list[_ClassifiedBoxes] = []
    # By cell, the numbers of modes of its regular parts. -1 is added if a part of the
    # smallest size is not regular.
    counts_of_cell: dict[tuple[int, ...], set[int]] = defaultdict(set)

    def examine(boxes: Integers, examined_count: int) -> Integers:
        """Examine boxes (2, n, inputs), and return the halves of those to be examined next.

        A box is regular if all complex roots of the equations can be continued over it and
        no two of them meet. What happens to a box depends on its size:

        1. A box of at least the size of a cell is recorded if it is regular. Otherwise it
           is halved. A piece that is smaller than a cell is called a part of its cell.
        2. A part of a cell is not recorded itself. If it is regular, it adds its number of
           assembly modes to the set `counts_of_cell` of its cell. Otherwise it is halved.
        3. A part of the smallest size cannot be halved. If it is not regular, its number of
           modes is unknown, and it adds -1 to the set.

        From these sets, `_classify_boxes` classifies the cells in the end.
        """
        del examined_count  # `subdivide` passes this number to all such functions.
        # By box and input: number of halvings of the range (level), and index of the part.
        levels, parts = boxes
        radii = ranges.radii(boxes)
        # `circle_points` are the cosines and sines of the centres.
        is_regular, modes = count_modes(
            systems, ranges.centres(boxes), ranges.circle_points(boxes), radii
        )
        # A part of a cell was halved more often than the cell.
        is_in_cell = np.all(levels >= cell_levels, axis=1) & np.any(
            levels > cell_levels, axis=1
        )
        is_finest = np.all(levels >= finest_levels, axis=1)
        is_whole = is_regular & ~is_in_cell
        regular_modes = modes[is_whole]
        classified.append(
            _ClassifiedBoxes(
                boxes[:, is_whole],
                kind=np.full_like(regular_modes, REGULAR),
                modes=regular_modes,
            )
        )
        needs_halving = ~is_regular & ~is_finest
        for row in np.flatnonzero(is_in_cell):
            # For each input, the index of the cell to which this part belongs. Each halving
            # of the cell has appended one binary digit to the index. The shift removes
            # these digits.
            cell_parts = parts[row] >> (levels[row] - cell_levels)
            counts = counts_of_cell[tuple(cell_parts.tolist())]
            if is_regular[row]:
                counts.add(int(modes[row]))
            elif is_finest[row]:
                counts.add(-1)
            # The number of modes can change only at a singular configuration. So a cell
            # with two numbers contains one, and its other parts need not be halved. -1 is
            # not a number of modes.
            mode_counts = counts - {-1}
            needs_halving[row] &= len(mode_counts) < 2
        # Halve the longest side of each remaining box. Sides that are still longer than the
        # sides of a cell come first.
        is_coarse = np.any(levels < cell_levels, axis=1, keepdims=True)
        can_halve = np.where(is_coarse, levels < cell_levels, levels < finest_levels)
        halvable_radii = radii * can_halve
        return halve_boxes(
            boxes[:, needs_halving], np.argmax(halvable_radii[needs_halving], axis=1)
        )

    subdivide(ranges.whole, max_at_once, "proving boxes of the inputs regular", examine)
    for cell_parts, counts in counts_of_cell.items():
        if len(counts) == 1 and -1 not in counts:
            kind = REGULAR
            mode_count = max(counts)
        elif len(counts - {-1}) > 1:
            kind = CONTAINS_TYPE_II
            mode_count = -1
        else:
            kind = UNDECIDED
            mode_count = -1
        cell_box = np.array([[cell_levels], [cell_parts]])
        classified.append(
            _ClassifiedBoxes(cell_box, np.array([kind]), np.array([mode_count]))
        )
    return _ClassifiedBoxes(
        np.concatenate([part.boxes for part in classified], axis=1),
        np.concatenate([part.kind for part in classified]),
        np.concatenate([part.modes for part in classified]),
    )
