"""Checks inside an integration step: whether the loads agree there with the series.

A series of Taylor knows a load at one point of a step, a collocation at its nodes. Where
an argument of a steep function (`spherekit.mechanism.load_expression.Expression.steep`) is
zero or turns back, the load may change within a time in which neither has a point. So
accepted steps are compared with the equation of motion at even places, and at those zeros
and turns, which are found on the dense output.
"""

from collections.abc import Callable

import numpy as np

from spherekit.arrays import Floats, Indices
from spherekit.numerics.bracketed_zeros import bracketed_zeros

EVEN = 17
"""Places in a step that are always looked at, both ends among them,"""


BESIDE = 1e-6
"""and two so near to the ends that what turns back beside an end is seen."""


Look = Callable[[Indices, Floats], tuple[Floats, Floats]]
"""Of steps by number (n,) at parts x (n,) of them, from 0 to 1: what the equation of motion
misses there (n,), and the steep arguments (n, arguments)."""


def first_missed(look: Look, steps: int) -> Floats:
    """Return at which part each step (steps,) first misses more than 1, else infinity."""
    even = np.sort([*np.linspace(0.0, 1.0, EVEN), BESIDE, 1.0 - BESIDE])
    owner, x = np.repeat(np.arange(steps), len(even)), np.tile(even, steps)
    missed, arguments = look(owner, x)
    shaped = arguments.reshape(steps, len(even), arguments.shape[1])

    def value(step: Indices, x: Floats) -> Floats:
        return look(step, x)[1]

    def slope(step: Indices, x: Floats) -> Floats:
        return value(step, x + BESIDE) - value(step, x - BESIDE)

    zeros = _zeros(value, shaped, even[:-1], even[1:])
    turns = _zeros(slope, np.diff(shaped, axis=1), even[:-2], even[2:])
    which, places = (np.concatenate(parts) for parts in zip(turns, zeros, strict=True))
    order = np.lexsort((places, which))
    which, places = which[order], places[order]
    # Between two jumps, which need not be on either side of a place found.
    pairs = np.flatnonzero(which[1:] == which[:-1])
    which = np.append(which, which[pairs])
    places = np.append(places, 0.5 * (places[pairs] + places[pairs + 1]))
    owner, x = np.append(owner, which), np.append(x, places)
    missed = np.append(missed, look(which, places)[0])
    first = np.full(steps, np.inf)
    np.minimum.at(first, owner, np.where(missed <= 1.0, np.inf, x))
    return first


def _zeros(
    value: Callable[[Indices, Floats], Floats], rows: Floats, low: Floats, high: Floats
) -> tuple[Indices, Floats]:
    """Return steps and places at which arguments are zero, by their values at places.

    Of opposite signs in successive `rows` (steps, places, arguments) they are between `low`
    and `high` (places,).
    """
    step, place, argument = np.nonzero(rows[:, :-1] * rows[:, 1:] < 0.0)

    def at(x: Floats, which: Indices) -> Floats:
        return value(step[which], x)[np.arange(len(x)), argument[which]]

    ends = (rows[step, place + k, argument] for k in (0, 1))
    return step, bracketed_zeros(at, low[place], high[place], *ends)[0]
