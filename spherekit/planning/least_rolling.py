"""The assembly of wheels in which they have rolled least.

Arcs and angles of links do not state which teeth of two wheels touch. An assembly differs
from another one by whole turns of wheels. The one with the smallest rolled lengths is
chosen.
"""

import numpy as np

from spherekit.arrays import Floats, Indices, Integers
from spherekit.geometry.vectors import max_abs

SAME_ROLLED_LENGTH_RAD = 1e-7
"""Difference (rad) below which two rolled lengths are the same length.

Larger: different assemblies are taken for one. Smaller: rounding errors distinguish equal
assemblies.
"""

MAX_TRIED_TURNS = 2
"""Whole turns of a wheel that are tried in each direction. Larger: more assemblies."""

MAX_TURN_COMBINATIONS = 400_000
"""Combinations of whole turns of all wheels that are tried.

Larger: more time and memory. Smaller: fewer turns are tried if there are many wheels.
"""


def find_least_rolled_turns(
    lengths: Floats, circumferences: Floats, first_slopes: Floats, matrix: Floats
) -> Integers | None:
    """Return the whole turns of wheels in the assembly with the smallest rolled lengths.

    The sum of the absolute values of the rolled lengths is minimised at inputs of zero. Of
    assemblies with the same sum, the one with the largest first length is chosen, then with
    the largest second length, and so on. Turns that do not change any length are zero.

    With the angles a of the pairs that follow from the inputs, the lengths along the first
    circles are lengths[:, 0] - first_slopes a. Those along the second circles are equal, so
    matrix a = lengths[:, 0] - lengths[:, 1].

    Parameters
    ----------
    lengths
        (m, 2) arc lengths (rad) of the point of contact along both circles of m contacts
        where all angles are zero.
    circumferences
        (m, 2) arc lengths of whole turns.
    first_slopes, matrix
        (m, m) derivatives of the lengths along the first circles by the angles a, with the
        opposite sign, and the matrix of the equations for a.

    Returns
    -------
    (m, 2) numbers of turns to add along both circles; None if there are too many wheels to
    try them.
    """
    inverse = np.linalg.inv(matrix)
    rolled = lengths[:, 0] - first_slopes @ inverse @ (lengths[:, 0] - lengths[:, 1])

    # The changes (m,) of all rolled lengths by one turn along each circle, which is that of
    # the first (0) or second (1) wheel of a contact. Circles that change nothing, or the
    # same as another one apart from the sign, are left out.
    changes: list[Floats] = []
    circles = []
    for contact, side in np.ndindex(*circumferences.shape):
        change = first_slopes @ inverse[:, contact] * (2 * side - 1)
        change[contact] += 1 - side
        change *= circumferences[contact, side]
        is_new = True
        for earlier_change in (*changes, np.zeros_like(change)):
            for sense in (1, -1):
                difference = max_abs(change - sense * earlier_change)
                is_new &= bool(difference > SAME_ROLLED_LENGTH_RAD)
        if is_new:
            changes.append(change)
            circles.append((contact, side))

    # Try all combinations of whole turns of these circles, from -max_turns to max_turns.
    turns_within_limit = 0.5 * (MAX_TURN_COMBINATIONS ** (1.0 / len(changes)) - 1.0)
    max_turns = min(MAX_TRIED_TURNS, int(turns_within_limit))
    if max_turns < 1:
        return None
    counts = np.indices((2 * max_turns + 1,) * len(changes)).reshape(len(changes), -1).T
    counts = counts - max_turns
    turns = np.zeros(circumferences.shape, dtype=np.int64)
    best = index_of_least_rolled(rolled + counts @ np.array(changes))
    turns[*np.transpose(circles)] = counts[best]
    return turns


def index_of_least_rolled(rolled: Floats) -> Indices:
    """Return the index of the assembly with the smallest rolled lengths.

    Parameters
    ----------
    rolled
        (n, m) rolled lengths (rad) of m contacts in n assemblies. The sum of their absolute
        values decides, and then the lengths one after the other, the largest first.
    """
    # Lengths are rounded, so that equal ones do not decide. `lexsort` takes the last key
    # first.
    keys = np.column_stack([np.sum(np.abs(rolled), axis=1), -rolled])
    return np.lexsort(np.round(keys / SAME_ROLLED_LENGTH_RAD).T[::-1])[0]
