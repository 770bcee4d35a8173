"""Steps looked at between their ends: whether the loads do there what the series say.

A series of Taylor knows a load at one point of a step, a collocation at its nodes. Where
an argument of a steep function (`spherekit.model.expression.Expression.steep`) is zero or
turns back, the load may change within a time in which neither has a point. So accepted
steps are compared with the equation of motion at even places, and at those zeros and
turns, which are found on the dense output.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from spherekit.sphere.rotation import Floats

EVEN = 17
"""Places in a step that are always looked at, both ends among them,"""

BESIDE = 1e-6
"""and two so near to the ends that what turns back beside an end is seen."""

FINER = 9
"""Places in a bracket of a zero or a turn, which one round narrows to two of its gaps,"""

ROUNDS = 6
"""and the number of such rounds."""

Look = Callable[[NDArray[np.intp], Floats], tuple[Floats, Floats]]
"""Of steps by number (n,) at parts x (n,) of them, from 0 to 1: what the equation of motion
misses there (n,), and the steep arguments (n, arguments)."""


def good_until(look: Look, steps: int) -> Floats:
    """Return up to which part each step (steps,) is right, 1 for all of it.

    What is missed is right where it is at most 1; the part is that of the last place
    before the first one that is not.
    """
    even = np.sort([*np.linspace(0.0, 1.0, EVEN), BESIDE, 1.0 - BESIDE])
    owner, x = np.repeat(np.arange(steps), len(even)), np.tile(even, steps)
    missed, arguments = look(owner, x)
    shaped = arguments.reshape(steps, len(even), arguments.shape[1])
    more = (_turns(look, even, shaped), _zeros(look, even, shaped))
    which, places = (np.concatenate(parts) for parts in zip(*more, strict=True))
    if len(which):
        order = np.lexsort((places, which))
        which, places = which[order], places[order]
        # Between two jumps, which need not be on either side of a place found.
        pairs = np.flatnonzero(which[1:] == which[:-1])
        which = np.append(which, which[pairs])
        places = np.append(places, 0.5 * (places[pairs] + places[pairs + 1]))
        owner, x = np.append(owner, which), np.append(x, places)
        missed = np.append(missed, look(which, places)[0])
    wrong = ~(missed <= 1.0)
    first = np.full(steps, np.inf)
    np.minimum.at(first, owner[wrong], x[wrong])
    good = np.zeros(steps)
    before = ~wrong & (x < first[owner])
    np.maximum.at(good, owner[before], x[before])
    good[np.isinf(first)] = 1.0
    return good


def _turns(look: Look, even: Floats, shaped: Floats) -> tuple[NDArray[np.intp], Floats]:
    """Return steps and places at which arguments (steps, even, arguments) turn back."""
    slopes = np.diff(shaped, axis=1)
    step, place, argument = np.nonzero(slopes[:, :-1] * slopes[:, 1:] < 0.0)
    sense = np.sign(slopes[step, place, argument])
    low, width = even[place], even[place + 2] - even[place]
    rows = np.arange(len(step))
    for _ in range(ROUNDS if len(step) else 0):
        values = sense[:, None] * _finer(look, step, low, width, argument)
        best = np.clip(np.argmax(values, axis=1), 1, FINER - 2)
        gap = width / (FINER - 1.0)
        low, width = low + (best - 1) * gap, 2.0 * gap
        before, here, after = (values[rows, best + k] for k in (-1, 0, 1))
    if not len(step):
        return step, low
    bend = before - 2.0 * here + after
    with np.errstate(divide="ignore", invalid="ignore"):
        shift = np.clip(0.5 * (before - after) / bend, -1.0, 1.0)
    return step, low + 0.5 * width * (1.0 + np.where(np.isfinite(shift), shift, 0.0))


def _zeros(look: Look, even: Floats, shaped: Floats) -> tuple[NDArray[np.intp], Floats]:
    """Return steps and places at which arguments (steps, even, arguments) are zero."""
    step, place, argument = np.nonzero(shaped[:, :-1] * shaped[:, 1:] < 0.0)
    sense = np.sign(shaped[step, place, argument])
    low, width = even[place], even[place + 1] - even[place]
    rows = np.arange(len(step))
    before, after = np.ones(len(step)), -np.ones(len(step))
    for _ in range(ROUNDS if len(step) else 0):
        values = sense[:, None] * _finer(look, step, low, width, argument)
        last = np.argmax(~(values[:, 1:] > 0.0), axis=1)
        width = width / (FINER - 1.0)
        low = low + last * width
        before, after = values[rows, last], values[rows, last + 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        part = before / (before - after)
    return step, low + width * np.where(np.isfinite(part), np.clip(part, 0.0, 1.0), 0.5)


def _finer(
    look: Look,
    step: NDArray[np.intp],
    low: Floats,
    width: Floats,
    argument: NDArray[np.intp],
) -> Floats:
    """Return one argument of each bracket (n,) at its places (n, FINER)."""
    x = low[:, None] + width[:, None] * np.linspace(0.0, 1.0, FINER)
    _, arguments = look(np.repeat(step, FINER), x.ravel())
    chosen = np.repeat(argument, FINER)
    return np.asarray(arguments[np.arange(x.size), chosen].reshape(x.shape))
