"""Chooses the assembly of a gear train in which the wheels have rolled least.

Arcs and angles of links do not state which teeth of two wheels touch. Assemblies differ by
whole turns of wheels. The assembly with the smallest rolled lengths is chosen.
"""

import numpy as np

from spherekit.arrays import Floats, Integers
from spherekit.geometry.vectors import max_abs

SAME_ROLLED_LENGTH_RAD = 1e-7
"""Difference (rad) below which two rolled lengths are the same length.

Larger: different assemblies are taken for one. Smaller: rounding errors distinguish equal
assemblies.
"""

MAX_TRIED_TURNS = 2
"""Largest number of whole turns of a wheel that one step tries in each direction.

Larger: more assemblies are compared.
"""

MAX_TURN_COMBINATIONS = 400_000
"""Largest number of combinations of whole turns of all wheels that one step tries.

Larger: more time and memory. Smaller: fewer turns are tried if there are many wheels.
"""


def find_least_rolled_turns(
    lengths: Floats, circumferences: Floats, first_slopes: Floats, matrix: Floats
) -> Integers | None:
    """Return the whole turns of wheels in the assembly in which they have rolled least.

    Wheels can be put together with different teeth in contact. So the arc lengths to a
    point of contact are known only up to whole turns of both wheels. Of the assemblies that
    are tried, the one with the smallest sum of absolute rolled lengths at inputs of zero is
    chosen. Among equal sums, `index_of_least_rolled` chooses. If a wheel of the best
    assembly has the largest number of turns that is tried, the search goes on from there.

    The rolled length of a contact is the arc length from the points that touch first to the
    point that touches now. It is equal along both circles. The inputs are zero, and the
    other pairs that turn with the wheels have unknown angles a. At a = 0 the arc lengths
    are `lengths`. When the angles grow, the point of contact moves back along a circle by
    its slopes times a. So

        rolled length = lengths[:, 0] - first_slopes @ a = lengths[:, 1] - second_slopes @ a

    and, with ``matrix = first_slopes - second_slopes``,

        matrix @ a = lengths[:, 0] - lengths[:, 1].

    Parameters
    ----------
    lengths
        (m, 2) arc lengths (rad) to the point of contact along both circles of m contacts,
        if all angles a are zero.
    circumferences
        (m, 2) arc lengths (rad) of one turn along both circles.
    first_slopes
        (m, m) by how much the point of contact moves back along the first circle of each
        contact, per radian of each angle.
    matrix
        (m, m) the same numbers, less the numbers for the second circles.

    Returns
    -------
    (m, 2) numbers of turns to add along both circles. None if there are too many circles to
    try all combinations.
    """
    inverse = np.asarray(np.linalg.inv(matrix), dtype=float)
    # Lengths of a turn or more are reduced first, since only few turns are tried.
    whole_turns = np.fix(lengths / circumferences).astype(np.int64)
    lengths = lengths - whole_turns * circumferences
    differences = lengths[:, 0] - lengths[:, 1]
    # The angles a are inverse @ differences.
    rolled_without_turns = lengths[:, 0] - first_slopes @ inverse @ differences
    # The circles whose turns are tried, with the change of all rolled lengths by one turn.
    # All other circles get no further turns.
    changes_by_circle = _find_changes_by_turns(circumferences, first_slopes, inverse)
    # (combinations, circles) the numbers of turns that are tried around a centre.
    turn_counts = _list_turn_counts(len(changes_by_circle))
    if turn_counts is None:
        return None
    changes = np.array(list(changes_by_circle.values()))  # (circles, contacts)
    centre = np.zeros(len(changes), dtype=np.int64)
    max_turns = np.max(turn_counts)
    while True:
        combinations = centre + turn_counts
        best = combinations[
            index_of_least_rolled(rolled_without_turns + combinations @ changes)
        ]
        is_at_border = np.max(np.abs(best - centre)) == max_turns
        # The search goes on around the best assembly if this is better than the centre.
        centre_and_best = rolled_without_turns + np.array([centre, best]) @ changes
        is_better = index_of_least_rolled(centre_and_best) == 1
        centre = best
        if not (is_at_border and is_better):
            break
    # A circle is the index of its contact, and 0 or 1 for the first or second wheel.
    turns = -whole_turns
    for circle, turn_count in zip(changes_by_circle, best, strict=True):
        turns[circle] += turn_count
    return turns


def _find_changes_by_turns(
    circumferences: Floats, first_slopes: Floats, inverse: Floats
) -> dict[tuple[int, int], Floats]:
    """Return how one turn along each circle changes the rolled lengths of all m contacts.

    The caller tries turns along these circles to find the assembly in which the wheels have
    rolled least. All inputs are zero, and the pairs that turn with the wheels have unknown
    angles a. The rolled length of a contact is the arc length from the points that touch
    first to the point that touches now. `lengths` (m, 2) are these arc lengths at a = 0
    along both circles of each contact. From them, a and the rolled lengths are computed:

        1. a = inverse @ (lengths[:, 0] - lengths[:, 1])
        2. rolled lengths = lengths[:, 0] - first_slopes @ a

    A turn adds the circumference of a circle to one of the lengths.

    Circles whose turns change nothing are left out. A circle is also left out if a turn has
    the same or the opposite effect as a turn of an earlier circle. The earlier circle is
    enough, since turns along it are tried in both senses.

    Parameters
    ----------
    circumferences
        (m, 2) circumferences (rad) of both circles of each contact.
    first_slopes
        (m, m) by how much the length along the first circle of each contact falls per
        radian of each angle.
    inverse
        (m, m) matrix that gives the angles.

    Returns
    -------
    The changes (m,) (rad) by circle. A circle is the index of its contact, and 0 for the
    first wheel or 1 for the second one.
    """
    changes: dict[tuple[int, int], Floats] = {}
    for contact, side in np.ndindex(*circumferences.shape):
        # The change of first_slopes @ a if the difference lengths[:, 0] - lengths[:, 1] of
        # this contact grows by 1.
        slope_change = first_slopes @ inverse[:, contact]
        # The change of the rolled lengths if the length along this circle grows by 1.
        if side == 0:
            # The difference grows by 1. So does the first length in formula 2.
            change = -slope_change
            change[contact] += 1
        else:
            # The difference falls by 1.
            change = slope_change
        change *= circumferences[contact, side]
        no_change = np.zeros_like(change)
        known_changes = [no_change, *changes.values()]
        is_known = any(
            _are_equal_up_to_sign(change, known_change) for known_change in known_changes
        )
        if not is_known:
            changes[contact, side] = change
    return changes


def _are_equal_up_to_sign(change: Floats, other_change: Floats) -> bool:
    """Return whether changes (m,) of rolled lengths are equal or opposite."""
    return bool(
        max_abs(change - other_change) <= SAME_ROLLED_LENGTH_RAD
        or max_abs(change + other_change) <= SAME_ROLLED_LENGTH_RAD
    )


def _list_turn_counts(circle_count: int) -> Integers | None:
    """Return all combinations of whole turns along some circles, in both senses.

    Wheels roll on each other along circles, two for each contact. The caller adds the turns
    to the arc lengths along these circles. Each combination is an assembly of the wheels,
    and the caller chooses the one in which they have rolled least.

    For one circle, the numbers of turns are all integers from -k to k. Here k is
    `MAX_TRIED_TURNS`, or less if there would be more than `MAX_TURN_COMBINATIONS`
    combinations. Example: for k = 1 and two circles, there are 3 x 3 combinations,
    (-1, -1), (-1, 0) and so on to (1, 1).

    Parameters
    ----------
    circle_count
        Number of circles.

    Returns
    -------
    (combinations, circles) numbers of turns. None if not even k = 1 is possible.
    """
    # With 2 k + 1 numbers for each circle, there are (2 k + 1)^circles combinations.
    turns_within_limit = 0.5 * (MAX_TURN_COMBINATIONS ** (1.0 / circle_count) - 1.0)
    max_turns = min(MAX_TRIED_TURNS, int(turns_within_limit))
    if max_turns < 1:
        return None
    tried_numbers = 2 * max_turns + 1
    # `indices` counts from 0, so that the combinations are those of 0 to 2 k.
    grid = np.indices((tried_numbers,) * circle_count)
    combinations = grid.reshape(circle_count, -1).T
    return combinations - max_turns


def index_of_least_rolled(rolled: Floats) -> np.intp:
    """Return the index of the assembly in which wheels have rolled least.

    The assemblies of a gear train differ in the teeth that touch. The chosen one has the
    smallest sum of absolute rolled lengths. Among equal sums, the assembly with the largest
    signed length of the first contact is chosen, then of the second, and so on. This second
    rule is arbitrary, but always gives the same choice.

    Parameters
    ----------
    rolled
        (n, m) rolled lengths (rad), with signs, of m contacts in n assemblies.
    """
    # The sort keys of each assembly, the most important first. Sorting is in rising order,
    # so lengths have the opposite sign to get the largest one first.
    keys = np.column_stack([np.sum(np.abs(rolled), axis=1), -rolled])
    # Rounding makes keys equal that differ only by rounding errors.
    rounded_keys = np.round(keys / SAME_ROLLED_LENGTH_RAD)
    # `lexsort` takes the most important key last.
    order = np.lexsort(rounded_keys.T[::-1])
    return order[0]
