"""What guides the assembly modes of irreducible groups: verified configurations in order.

With one input it is a curve, followed step by safe step, from whose nodes any sample is
predicted. With several it is a sheet over an input grid.

From a known configuration the mode spreads from sample to neighbouring sample by straight
ways of verified steps, wherever such a way leads: around a region that is out of reach,
but never through a configuration at which the inputs do not determine the motion.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from spherekit.arrays import Floats, Indices, SmallIntegers
from spherekit.geometry.vectors import all_finite, max_abs, nans
from spherekit.numerics.hermite import cubic_hermite
from spherekit.positions.curve_crossing import find_outgoing_points
from spherekit.positions.input_grid import InputGrid
from spherekit.positions.loop_closure import Closure
from spherekit.positions.path_continuation import (
    Nodes,
    Trail,
    flat,
    follow_inputs,
    nodes_at,
)
from spherekit.status import Status

AT_DEAD_CENTRE = 1e-9
"""Nodes of a smaller relative singular value are dead centres of the input."""
NEAR_DEAD_CENTRE = 1e-4
"""A way into a dead centre ends no farther from it (rad)."""
NEAREST = 8
"""Samples nearest to a configuration that straight ways are tried to."""

Predicted = tuple[Floats, Floats, SmallIntegers]
"""Variables (n, variables), how far (n,) rad they may be off, (n,) why there are none."""


@dataclass(frozen=True)
class ModeCurve:
    """Nodes of one assembly mode in rising input order, with exact slopes.

    `inputs` (k,), `values` and `slopes` (k, variables) in rad and rad/rad. `ends` say why
    the curve goes no further at both ends: OK where the range ends, else the status of
    the samples beyond. `tried` counts the steps that it took to find it, also in vain.
    """

    inputs: Floats
    values: Floats
    slopes: Floats
    ends: tuple[Status, Status]
    tried: int = 0

    def predict(self, q: Floats) -> tuple[Floats, Floats]:
        """Return Hermite values (n, variables) at inputs q (n,), and the nodes' spread."""
        if len(self.inputs) == 1:
            return np.repeat(self.values, len(q), axis=0), np.zeros(len(q))
        k = np.clip(np.searchsorted(self.inputs, q) - 1, 0, len(self.inputs) - 2)
        h = (self.inputs[k + 1] - self.inputs[k])[:, None]
        start, stop = ((self.values[end], self.slopes[end]) for end in (k, k + 1))
        out = cubic_hermite(start, stop, h, (q - self.inputs[k])[:, None] / h)
        return out, max_abs(stop[0] - start[0], axis=1)

    def at(self, q: Floats, rows: Indices | None) -> Predicted:
        """Return what is predicted at inputs q (n, 1)."""
        along, why = q[:, 0], np.full(len(q), Status.OK, dtype=np.int8)
        slack = 1e-14 * np.maximum(1.0, np.abs(along))
        why[along < self.inputs[0] - slack] = self.ends[0]
        why[along > self.inputs[-1] + slack] = self.ends[1]
        return (*self.predict(along), why)


class ModeOverGrid(NamedTuple):
    """Configurations of one mode at the samples of an input grid.

    `values` (n, variables), NaN where the mode was not reached; `status` (n,): OK, or why
    the last way tried towards a sample ended.
    """

    values: Floats
    status: SmallIntegers

    def at(self, q: Floats, rows: Indices | None) -> Predicted:
        """Return what is known of samples, rows (n,) of the grid."""
        assert rows is not None
        return self.values[rows], np.zeros(len(q)), self.status[rows]


def follow_each(
    closure: Closure, driven: int, values: Floats, low: float, high: float
) -> list[ModeCurve]:
    """Return the curves through closed configurations (n, variables), side by side.

    Over an input range (rad) that is made so wide as to hold the input of each. `closure`
    is that of the whole mechanism (constant pair frames), `driven` the input's variable.
    """
    starts = _starts(closure, driven, values)
    moving = ~flat(closure.at(values), [driven], AT_DEAD_CENTRE)
    moving &= all_finite(starts.slope, 1)
    followed = iter(_through(closure, driven, starts.rows(moving), low, high))
    return [
        next(followed) if moves else _from_dead_centre(closure, driven, one, low, high)
        for one, moves in zip(values, moving, strict=True)
    ]


def _from_dead_centre(
    closure: Closure, driven: int, values: Floats, low: float, high: float
) -> ModeCurve:
    """Return the curve through a dead centre (variables,), by a way that leaves it.

    It has the dead centre for its end, unless no end is nearer to it than
    `NEAR_DEAD_CENTRE`. Ways that leave are tried in a definite order.
    """
    around = find_outgoing_points(closure, values)
    moved = around[np.abs(around[:, driven] - values[driven]) > AT_DEAD_CENTRE]
    ways = sorted(moved, key=lambda way: tuple(np.round(values - way, 6)))
    starts = _starts(closure, driven, np.array([*ways, values]))
    curves = _through(closure, driven, starts, low, high)
    tried = sum(curve.tried for curve in curves)
    for curve in curves[:-1]:
        for end in (0, -1):
            away = curve.values[end] - values
            step = away[driven]
            if step and max_abs(away) < NEAR_DEAD_CENTRE:
                place = end % (len(curve.inputs) + 1)
                return ModeCurve(
                    np.insert(curve.inputs, place, values[driven]),
                    np.insert(curve.values, place, values, axis=0),
                    np.insert(curve.slopes, place, away / step, axis=0),
                    curve.ends,
                    tried,
                )
    return replace(curves[-1], tried=tried)


def _starts(closure: Closure, driven: int, values: Floats) -> Nodes:
    """Return nodes (n, variables) from which the input grows."""
    return nodes_at(closure.at(values), [driven], np.ones((len(values), 1)))


def _through(
    closure: Closure, driven: int, starts: Nodes, low: float, high: float
) -> list[ModeCurve]:
    """Return the curves through nodes at which the input moves."""
    here, count = starts.values[:, driven], len(starts.values)
    goals = np.concatenate([np.minimum(low, here), np.maximum(high, here)])
    both, trail = np.tile(starts.values, (2, 1)), Trail()
    _, status, tried = follow_inputs(closure, [driven], both, goals[:, None], trail)
    every = Nodes.joined([starts, *(made for _, made in trail)])
    ways = np.concatenate([np.arange(count), *(moved % count for moved, _ in trail)])
    order = np.argsort(every.values[:, driven], kind="stable")
    curves = []
    for row in range(count):
        nodes = every.rows(order[ways[order] == row])
        curves.append(
            ModeCurve(
                nodes.values[:, driven].copy(),
                nodes.values,
                nodes.slope * nodes.direction,
                (Status(status[row]), Status(status[count + row])),
                int(tried[row] + tried[count + row]),
            )
        )
    return curves


def sheets_through(
    closure: Closure, driven: Sequence[int], input_grid: InputGrid, values: Floats
) -> list[ModeOverGrid | None]:
    """Return the sheets through closed configurations (k, variables), side by side.

    They start at the nearest samples to which a straight way leads, None if there is none.
    """
    n, count = len(input_grid), len(values)
    if not count:
        return []
    near = np.array([input_grid.nearest(one[list(driven)], NEAREST) for one in values])
    beside = input_grid.neighbours()
    inside, shift = beside >= 0, n * np.arange(count)[:, None]
    first = np.repeat(count * n + np.arange(count), near.shape[1])
    start = np.append(first, np.nonzero(inside)[1] + shift)
    stop = np.append(near + shift, beside[inside] + shift)
    sheets = np.concatenate([nans((count * n, values.shape[1])), values])
    status = np.full(len(sheets), Status.OUT_OF_REACH, dtype=np.int8)
    status[count * n :] = Status.OK
    left = np.ones(len(stop), dtype=bool)
    while np.any(ways := left & (status[start] == Status.OK) & (status[stop] != Status.OK)):
        (once,) = np.nonzero(ways)
        once = once[np.unique(stop[once], return_index=True)[1]]
        left[once] = False
        to = stop[once]
        goals = input_grid.q[to % n]
        reached, status[to], _ = follow_inputs(closure, driven, sheets[start[once]], goals)
        arrived = status[to] == Status.OK
        sheets[to[arrived]] = reached.values[arrived]
    parts = (part[: count * n].reshape(count, n, -1) for part in (sheets, status))
    return [
        ModeOverGrid(there, why[:, 0]) if np.any(why == Status.OK) else None
        for there, why in zip(*parts, strict=True)
    ]
