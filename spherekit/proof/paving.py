"""Exclusion: proof that no configuration exists outside given parts of space.

The space of the variables is cut into boxes. A box is discarded if an equation cannot
vanish in it: |f| at its centre exceeds what the slopes and the bound of the second
derivatives allow over the box. It is also discarded if it is inside a given part. All other
boxes are halved. Boxes that are too small to be halved, or too many, are undecided.

A linear combination of equations that cannot vanish in a box discards it as well. The
combinations that are tried are the rows of the pseudo-inverse of the matrix of slopes. In
each combination the slope by one variable dominates as far as possible. The proof is valid
for any weights, so their rounding does not matter.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Bools, Floats, Indices, Integers
from spherekit.progress import ProgressReporter
from spherekit.proof.arc_equations import ArcEquations
from spherekit.proof.balls import (
    UNIT_ROUNDOFF,
    Ball,
    centre_float,
    cosines_and_sines,
    upper_magnitude,
)
from spherekit.proof.tubes import PRODUCT_ROUNDING, ROUND_UP, correct_configuration

WEIGHT_REGULARISATION = 1e-9
"""Number added to the diagonal of F' F'^T (F': slopes), so that the weights are finite.

Larger: weights farther from the pseudo-inverse, which discard fewer boxes. Smaller: near
singular F' the weights may overflow.
"""

MAX_BOXES_AT_ONCE = 4000
"""Number of boxes that are examined in one array operation.

Larger: more memory. Smaller: more overhead.
"""

SEARCHED_BOX_RAD = 0.12
"""Half width (rad) of boxes below which configurations are looked for in them.

Larger: curves are found earlier, with more failing searches. Smaller: more boxes are cut
before a curve is found.
"""

SEARCHED_BOXES = 3
"""Approximate number of boxes of each batch in which configurations are looked for.

Larger: curves are found earlier, with more searches that find nothing new. Smaller: more
boxes are cut before a curve is found.
"""

SMALLEST_BOX_RAD = 1e-6
"""Half width (rad) below which boxes are not halved and count as undecided.

Larger: larger undecided parts. Smaller: near crossings more boxes are examined.
"""

FIRST_ANGLE_RAD = -2.4
"""Start (rad) of the full turn of each unknown angle.

Special geometry has its configurations at multiples of simple fractions of a turn. At this
start none of them is on the side of a box.
"""


def are_excluded(
    values: Floats, slopes: Floats, radii: Floats, remainders: Floats
) -> Bools:
    """Return a mask (n,) of boxes proven to contain no common zero of all equations.

    Such boxes contain no configuration. Weighted sums of the equations are tried. With the
    weights w, the equations F, the centre c of the box and any point x in it, a sum is
    never zero in the box if

        |w . F(c)|  >  largest |w . (F(x) - F(c))| in the box.

    A common zero of the equations would make all sums zero, so the box contains none.

    Parameters
    ----------
    values
        (n, k) equations at the centres of the boxes.
    slopes
        (n, k, v) derivatives of the equations at the centres.
    radii
        (n, v) half widths of the boxes (rad).
    remainders
        (n, k) bounds of the difference of the equations from their linear approximations
        over the boxes. They include the numerical errors of `values` and `slopes`.
    """
    weights = _choose_weights(slopes)
    rounding = _bound_rounding_of_sums(values, slopes, radii)
    # Indices of `einsum`: n box, w weighted sum, k equation, v variable.
    sums_at_centre = np.abs(np.einsum("nwk,nk->nw", weights, values))
    linear_change = np.einsum("nwv,nv->nw", np.abs(weights @ slopes), radii)
    other_change = np.einsum("nwk,nk->nw", np.abs(weights), remainders + rounding)
    # Raise the bound by the rounding of this sum.
    largest_change = (linear_change + other_change) * ROUND_UP
    return np.any(sums_at_centre > largest_change, axis=1)


def _choose_weights(slopes: Floats) -> Floats:
    """Return weights (n, v, k) of v weighted sums of k equations, for each of n boxes.

    A sum is useful if it depends mainly on one variable. So the weights are the
    pseudo-inverse F'^T (F' F'^T)^-1 of the slopes F' (k, v). Its product with F' is as near
    the identity as possible: sum j depends mainly on variable j if it can. Proofs are valid
    for any weights, so rounding errors of the weights do not matter.

    Parameters
    ----------
    slopes
        (n, k, v) derivatives of the equations at the centres of the boxes.
    """
    equation_count = slopes.shape[1]
    transposed = slopes.swapaxes(1, 2)
    # A small term on the diagonal makes the inverse finite if slopes depend on each other.
    regularisation = WEIGHT_REGULARISATION * np.eye(equation_count)
    return transposed @ np.linalg.inv(slopes @ transposed + regularisation)


def _bound_rounding_of_sums(values: Floats, slopes: Floats, radii: Floats) -> Floats:
    """Return the share (n, k) of each equation in the rounding error of a weighted sum.

    A caller multiplies k equations by weights and adds them up, to test whether a box can
    contain a solution. Two sums are computed in this way: that of the values at the centre
    of the box, and that of the derivatives there. The rounding error of a sum, including
    its multiplications and additions, is at most `PRODUCT_ROUNDING` times the sum of the
    magnitudes of its terms. The error of the derivatives is multiplied by the half widths.

    The share of an equation is for a weight of 1. The caller multiplies the shares by the
    magnitudes of the weights, and adds up the k products to one bound for each sum.

    Parameters
    ----------
    values
        (n, k) equations at the centres of the boxes.
    slopes
        (n, k, v) derivatives of the equations at the centres.
    radii
        (n, v) half widths of the boxes (rad).
    """
    largest_linear_changes = np.einsum("nkv,nv->nk", np.abs(slopes), radii)
    return PRODUCT_ROUNDING * (np.abs(values) + largest_linear_changes)


class VariableRanges:
    """The ranges of all variables, and their division into boxes.

    An array of n boxes consists of integers (2, n, variables). Index 0 of the first axis is
    the level: the number of times that the range of a variable was halved. Index 1 is the
    index of the part, from 0. A part of level l is 1 / 2^l of the range.

    Parameters
    ----------
    low
        Lower end of each range (rad), as a ball: a number with a bound of its error. This
        bound is 0 or far smaller than a rounding error of float64.
    width
        Width of each range, as such a ball; 0 for a variable with one value.

    Attributes
    ----------
    low
        The lower ends as balls.
    float_low, float_width
        (variables,) the lower ends and widths rounded to float64.
    whole
        The box that consists of the whole range of each variable.
    """

    def __init__(self, low: Sequence[Ball], width: Sequence[Ball]) -> None:
        """Round the lower ends and widths to float64, with bounds of the rounding."""
        self.low = low
        self.float_low = np.array([*map(centre_float, low)])
        self.float_width = np.array([*map(centre_float, width)])
        self.whole: Integers = np.zeros((2, 1, len(low)), dtype=np.int64)
        self._upper_width = np.array([*map(upper_magnitude, width)]) * ROUND_UP
        # A bound of the rounding of the centres. The lower end, the width, their product
        # with the index of the part, and the sum are rounded: together by 3 roundings of
        # the magnitude, or little more. The factor 8 is more than enough.
        magnitude = np.abs(self.float_low) + np.abs(self.float_width)
        self._rounding = 8.0 * UNIT_ROUNDOFF * magnitude
        self._rounding[self.float_width == 0.0] = 0.0

    def radii(self, boxes: Integers) -> Floats:
        """Return the half widths (n, variables) rad about `centres`, rounded up."""
        return self._upper_width * np.exp2(-1.0 - boxes[0]) + self._rounding

    def centres(self, boxes: Integers) -> Floats:
        """Return float64 numbers (n, variables) rad near the centres of boxes."""
        levels, parts = boxes
        return self.float_low + self.float_width * (parts + 0.5) * np.exp2(-levels)

    def circle_points(self, boxes: Integers) -> Floats:
        """Return cosines and sines (n, variables, 2) of `centres`, each rounded once.

        A variable with a range of width 0, such as an input, is known with more digits than
        float64. Its cosine and sine are computed with these digits. `boxes` is described in
        the class.
        """
        centres = self.centres(boxes)
        # Many boxes share coordinates, so each number is evaluated once.
        numbers, positions = np.unique(centres, return_inverse=True)
        circle_points = cosines_and_sines(numbers)[positions]
        has_one_value = self.float_width == 0.0
        circle_points[:, has_one_value] = cosines_and_sines(self.low)[has_one_value]
        return circle_points


def halve_boxes(boxes: Integers, variables: Indices) -> Integers:
    """Return both halves of each box, cut across one variable per box.

    A box is stored by how it was cut out of the ranges of all v variables.

    Parameters
    ----------
    boxes
        (2, n, v) integers. `boxes[0]` says how many times the range of each variable was
        halved, and `boxes[1]` which of the equal parts belongs to the box, counted from 0.
    variables
        (n,) the variable across which each box is cut.

    Returns
    -------
    (2, 2 n, v): the lower halves of all boxes, then the upper halves.
    """
    # Part number p of a range is cut into the parts 2 p and 2 p + 1 of the next level.
    levels, parts = boxes
    is_cut = np.arange(levels.shape[1]) == variables[:, None]
    levels = levels + is_cut
    lower_parts = parts << is_cut
    return np.concatenate([[levels, lower_parts], [levels, lower_parts + is_cut]], axis=1)


def subdivide(
    boxes: Integers,
    max_at_once: int,
    activity: str,
    examine: Callable[[Integers, int], Integers],
) -> int:
    """Examine boxes, and then the parts that `examine` returns, until nothing remains.

    Proofs that divide space into boxes use this loop.

    Parameters
    ----------
    boxes
        (2, n, v) integers that describe n boxes in the space of v variables. The range of
        each variable is halved again and again. `boxes[0]` says how many times it was
        halved, and `boxes[1]` which of the equal parts belongs to the box, counted from 0.
        For example, part 3 after 2 halvings is the last quarter of the range.
    max_at_once
        Largest number of boxes that are examined in one call.
    activity
        Words that name the work in the progress report.
    examine
        Function that examines boxes and returns those to be examined next, for example the
        halves of undecided boxes. The function stores its results itself. Its second
        argument is the number of boxes examined so far, including these. From this number
        the function can tell that a limit is exceeded.

    Returns
    -------
    The number of examined boxes.
    """
    # A list of arrays of boxes. The last array is taken first, so that few boxes wait.
    waiting = [boxes]
    examined_count = 0
    progress = ProgressReporter(activity)
    while waiting:
        # The first `max_at_once` boxes are examined now, all other boxes later.
        batch, postponed = np.split(waiting.pop(), [max_at_once], axis=1)
        examined_count += batch.shape[1]
        # The text is built by a function, only if it is shown.
        progress.report_if_due(lambda: f"{examined_count} boxes")  # noqa: B023
        remaining = examine(batch, examined_count)
        for part in (postponed, remaining):
            if part.shape[1]:  # the array contains boxes
                waiting.append(part)
    return examined_count


@dataclass(frozen=True)
class BoxSet:
    """Boxes in the space of all v variables, with sides along the variables.

    Attributes
    ----------
    centres, radii
        (n, v) centres and half widths (rad).
    """

    centres: Floats
    radii: Floats

    def __len__(self) -> int:
        return len(self.centres)


BoxCover = Callable[[Floats, Floats], Bools]
"""Returns which boxes are inside given parts, from centres and half widths (n, v) rad."""

ConfigurationSink = Callable[[Floats], bool]
"""Receives a configuration (v,) near a box; returns whether a part was added."""


def pave(
    equations: ArcEquations,
    ranges: VariableRanges,
    covers: BoxCover,
    add_configuration: ConfigurationSink,
    max_boxes: int,
) -> tuple[int, BoxSet]:
    """Divide the space of all variables into boxes, and return those that stay undecided.

    This proves that no configuration was missed elsewhere.
    A box is discarded if an equation, or a weighted sum of equations, cannot vanish in it,
    or if it is inside a part of space with known configurations. Near some of the other
    boxes a configuration is searched. If one is found, a part of space with this
    configuration may be added to the known parts. All boxes that remain are halved, unless
    they are too small or too many.

    Parameters
    ----------
    equations
        The equations of the mechanism.
    ranges
        The ranges of all variables.
    covers
        Returns which boxes are inside the parts with known configurations, from their
        centres and half widths (n, v) rad.
    add_configuration
        Receives a configuration (v,) near a box that is not excluded, and returns whether a
        part was added for it.
    max_boxes
        After this number of boxes none is halved.

    Returns
    -------
    The number of examined boxes, and the undecided boxes. Outside the known parts,
    configurations can exist in these boxes only.
    """
    degrees = equations.degrees
    error = equations.harmonics.error
    # Known angles, such as the input, follow the unknown ones. Newton's method changes the
    # variables before the first one with one value.
    moving_count = int(np.sum(np.cumprod(ranges.float_width > 0.0)))
    undecided_centres: list[Floats] = []
    undecided_radii: list[Floats] = []

    def examine(boxes: Integers, examined_count: int) -> Integers:
        """Return the halves of the boxes that are neither excluded nor covered.

        A box is excluded if it is proven to contain no configuration. A box is covered if
        it is inside a part of space in which all configurations are known. Boxes that are
        too small to be halved, or beyond `max_boxes`, are recorded as undecided.

        Parameters
        ----------
        boxes
            (2, n, v) boxes: for each variable how often its range was halved [0], and the
            index of the part [1].
        examined_count
            Number of boxes examined so far, including these boxes.
        """
        # 1. Discard boxes in which an equation cannot vanish: values (n, k) of k equations
        # and slopes (n, k, v) at the centres.
        radii = ranges.radii(boxes)
        values, slopes = equations.harmonics.derivatives(ranges.circle_points(boxes), 1)
        # Bound of the difference from the linear part over the box. An equation is a
        # trigonometric polynomial with a degree in each variable (`degrees`). Its second
        # derivative with respect to two variables is at most `derivative_bound` times both
        # degrees. The second term bounds the numerical errors: `error` is the error of a
        # value, and a slope has this error times the degree in its variable.
        change = radii @ degrees.T
        remainders = 0.5 * equations.derivative_bound * change**2 + error * (1.0 + change)
        reach = np.einsum("nkv,nv->nk", np.abs(slopes), radii)
        # Single equations first: they are cheap and discard most boxes.
        can_vanish = np.all(np.abs(values) <= (reach + remainders) * ROUND_UP, axis=1)
        rows = np.flatnonzero(can_vanish)
        is_excluded = are_excluded(
            values[rows], slopes[rows], radii[rows], remainders[rows]
        )
        rows = rows[~is_excluded]

        # 2. Search configurations near the boxes that are not in a known part.
        boxes = boxes[:, rows]
        radii = radii[rows]
        centres = ranges.centres(boxes)
        is_open = ~covers(centres, radii)
        largest_radius = np.max(radii, axis=1)
        small_boxes = np.flatnonzero(is_open & (largest_radius < SEARCHED_BOX_RAD))
        has_new_part = False
        # A search takes long, so that only about `SEARCHED_BOXES` of the boxes are
        # searched, spread evenly over all of them.
        for row in small_boxes[:: max(1, len(small_boxes) // SEARCHED_BOXES)]:
            # Newton's method for the first `moving_count` variables; None if it fails.
            configuration = correct_configuration(equations, centres[row], moving_count)
            if configuration is None:
                continue
            # A configuration farther away than two widths of the box is left to the boxes
            # near it.
            distance = np.max(np.abs(configuration - centres[row]))
            if distance <= 4.0 * largest_radius[row]:
                has_new_part |= add_configuration(configuration)
        if has_new_part:
            is_open[is_open] = ~covers(centres[is_open], radii[is_open])

        # 3. Halve the longest side of the remaining boxes, or record them as undecided.
        is_last = (largest_radius < SMALLEST_BOX_RAD) | (examined_count > max_boxes)
        is_undecided = is_open & is_last
        undecided_centres.append(centres[is_undecided])
        undecided_radii.append(radii[is_undecided])
        is_open &= ~is_undecided
        return halve_boxes(boxes[:, is_open], np.argmax(radii[is_open], axis=1))

    examined_count = subdivide(
        ranges.whole, MAX_BOXES_AT_ONCE, "proving that nothing else is there", examine
    )
    undecided = BoxSet(np.concatenate(undecided_centres), np.concatenate(undecided_radii))
    return examined_count, undecided
