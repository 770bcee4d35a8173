"""Chooses the assembly of a gear train in which the wheels have rolled least.

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
"""Largest number of whole turns of a wheel that are tried in each direction.

Larger: more assemblies are compared.
"""

MAX_TURN_COMBINATIONS = 400_000
"""Largest number of combinations of whole turns of all wheels that are tried.

Larger: more time and memory. Smaller: fewer turns are tried if there are many wheels.
"""


def find_least_rolled_turns(
    lengths: Floats, circumferences: Floats, first_slopes: Floats, matrix: Floats
) -> Integers | None:
    """Return the whole turns of wheels in the assembly in which they have rolled least.

    The point of contact of two wheels is known along each circle up to whole
    circumferences, the turns. Each choice of turns is another assembly of the same wheels.
    The chosen one has the smallest sum of the absolute values of all rolled lengths at
    inputs of zero. If sums are equal, the assembly with the largest length of the first
    contact is chosen, then of the second contact, and so on. Turns that change no length
    are zero.

    The angles a of the pairs that follow from the inputs are unknown. The rolled lengths
    are ``lengths[:, 0] - first_slopes @ a``, measured along the first circles. They are the
    same along the second circles, which gives the equations
    ``matrix @ a = lengths[:, 0] - lengths[:, 1]``.

    Parameters
    ----------
    lengths
        (m, 2) arc lengths (rad) of the point of contact along both circles of m contacts
        where all angles are zero.
    circumferences
        (m, 2) arc lengths (rad) of one turn along both circles.
    first_slopes
        (m, m) derivatives of the lengths along the first circles by the angles a, with the
        opposite sign.
    matrix
        (m, m) matrix of the equations for a.

    Returns
    -------
    (m, 2) numbers of turns to add along both circles; None if there are too many circles to
    try all combinations.
    """
    inverse = np.linalg.inv(matrix)
    rolled = lengths[:, 0] - first_slopes @ inverse @ (lengths[:, 0] - lengths[:, 1])

    # `changes` has the changes (m,) of all rolled lengths by one turn along each circle of
    # `circles`. `side` is 0 for the circle of the first wheel of a contact, and 1 for that
    # of the second wheel. A circle is left out if its turn changes nothing, or changes the
    # same as that of an earlier circle apart from the sign.
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

    This is the assembly with the smallest sum of absolute values. If sums are equal, it is
    the one with the largest length of the first contact, then of the second, and so on.

    Parameters
    ----------
    rolled
        (n, m) rolled lengths (rad) of m contacts in n assemblies.
    """
    # Lengths are rounded, so that rounding errors do not decide between equal ones. The
    # sign of `rolled` puts large lengths first. `lexsort` sorts by its last key first, so
    # the keys are reversed.
    keys = np.column_stack([np.sum(np.abs(rolled), axis=1), -rolled])
    return np.lexsort(np.round(keys / SAME_ROLLED_LENGTH_RAD).T[::-1])[0]
