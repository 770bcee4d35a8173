"""Following one assembly mode of a mechanism along its input, step by safe step.

The accepted nodes form a curve from which any sample is predicted.
"""

from dataclasses import dataclass, replace
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import Status
from spherekit.motion.closure import Closure
from spherekit.motion.crossing import ways_out
from spherekit.motion.steps import InputPaths, Nodes, nodes_at
from spherekit.sphere.rotation import Floats

AT_DEAD_CENTRE = 1e-9
"""Nodes of a smaller relative singular value are dead centres of the input."""
NEAR_DEAD_CENTRE = 1e-4
"""A way into a dead centre ends no farther from it (rad)."""


@final
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
        k = np.clip(np.searchsorted(self.inputs, q) - 1, 0, max(len(self.inputs) - 2, 0))
        if len(self.inputs) == 1:
            return np.repeat(self.values, len(q), axis=0), np.zeros(len(q))
        h = self.inputs[k + 1] - self.inputs[k]
        t = ((q - self.inputs[k]) / h)[:, None]
        h = h[:, None]
        a, b = self.values[k], self.values[k + 1]
        out = (
            a * (1 + 2 * t) * (1 - t) ** 2
            + b * t * t * (3 - 2 * t)
            + h * t * (1 - t) * ((1 - t) * self.slopes[k] - t * self.slopes[k + 1])
        )
        return out, np.max(np.abs(b - a), axis=1)

    def to(self, values: Floats, driven: int) -> "ModeCurve | None":
        """Return the curve with a dead centre (variables,) for its end, None if it is not.

        It is not an end where it is farther than `NEAR_DEAD_CENTRE` from both of them.
        """
        for end in (0, -1):
            away = float(np.max(np.abs(self.values[end] - values)))
            step = abs(float(self.inputs[end] - values[driven]))
            if not 0.0 < away < NEAR_DEAD_CENTRE or not step:
                continue
            place = 0 if end == 0 else len(self.inputs)
            chord = (self.values[end] - values) / (self.inputs[end] - values[driven])
            return ModeCurve(
                np.insert(self.inputs, place, values[driven]),
                np.insert(self.values, place, values, axis=0),
                np.insert(self.slopes, place, chord, axis=0),
                self.ends,
            )
        return None

    def covers(self, q: Floats) -> NDArray[np.bool_]:
        """Return (n,) whether each input lies on the curve."""
        slack = 1e-14 * np.maximum(1.0, np.abs(q))
        inside = (q >= self.inputs[0] - slack) & (q <= self.inputs[-1] + slack)
        return np.asarray(inside)

    def ends_before(self, q: Floats) -> NDArray[np.bool_]:
        """Return (n,) which inputs are beyond an end that the mode does not reach past."""
        out = np.array([end == Status.OUT_OF_REACH for end in self.ends])
        return np.asarray(~self.covers(q) & np.where(q < self.inputs[0], *out))


def follow(
    closure: Closure, driven: int, values: Floats, low: float, high: float
) -> ModeCurve:
    """Return the curve through one closed configuration over an input range.

    Parameters
    ----------
    closure
        Loop closure of the whole mechanism (constant pair frames).
    driven
        Number of the input's variable.
    values
        (variables,) a closed configuration with `values[driven]` in [low, high], rad.
    """
    (curve,) = follow_each(closure, driven, values[None], low, high)
    return curve


def follow_each(
    closure: Closure, driven: int, values: Floats, low: float, high: float
) -> list[ModeCurve]:
    """Return the curves through closed configurations (n, variables), side by side.

    Over an input range that is made so wide as to hold the input of each; see `follow`.
    """
    starts = nodes_at(closure.at(values), [driven], np.ones((len(values), 1)))
    moving = starts.reciprocal_condition > AT_DEAD_CENTRE
    moving &= np.all(np.isfinite(starts.slope), axis=1)
    curves: list[ModeCurve | None] = [None] * len(values)
    (regular,) = np.nonzero(moving)
    followed = _through(closure, driven, starts.rows(regular), low, high)
    for row, curve in zip(regular, followed, strict=True):
        curves[row] = curve
    return [
        _from_dead_centre(closure, driven, one, low, high) if curve is None else curve
        for one, curve in zip(values, curves, strict=True)
    ]


def _from_dead_centre(
    closure: Closure, driven: int, values: Floats, low: float, high: float
) -> ModeCurve:
    """Return the curve through a dead centre (variables,), by a way that leaves it."""
    tried = 0
    start = nodes_at(closure.at(values[None]), [driven], np.ones((1, 1)))
    for beside in _ways_on(closure, driven, values):
        start = nodes_at(closure.at(beside[None]), [driven], np.ones((1, 1)))
        (curve,) = _through(closure, driven, start, low, high)
        tried += curve.tried
        if (reached := curve.to(values, driven)) is not None:
            return replace(reached, tried=tried)
    (curve,) = _through(closure, driven, start, low, high)
    return replace(curve, tried=tried + curve.tried)


def _ways_on(closure: Closure, driven: int, values: Floats) -> list[Floats]:
    """Return configurations (variables,) beside a dead centre, in a definite order."""
    around = ways_out(closure, values)
    moved = around[np.abs(around[:, driven] - values[driven]) > AT_DEAD_CENTRE]
    return sorted(moved, key=lambda way: tuple(np.round(values - way, 6)))


def _through(
    closure: Closure, driven: int, starts: Nodes, low: float, high: float
) -> list[ModeCurve]:
    """Return the curves through nodes at which the input moves."""
    here = starts.values[:, driven]
    goals = np.concatenate([np.minimum(low, here), np.maximum(high, here)])
    both = np.concatenate([starts.values, starts.values])
    paths = InputPaths(closure, [driven], both, goals[:, None], keeps_trail=True)
    count = len(here)
    ways = paths.nodes_of(range(2 * count))
    curves = []
    for row in range(count):
        start = starts.rows(slice(row, row + 1))
        down = Nodes.joined([ways[row].rows(slice(None, None, -1)), start])
        nodes = Nodes.joined([down, ways[count + row]])
        ends = Status(paths.status[row]), Status(paths.status[count + row])
        curves.append(
            ModeCurve(
                nodes.values[:, driven].copy(),
                nodes.values,
                nodes.slope * nodes.direction,
                ends,
                int(paths.tried[row] + paths.tried[count + row]),
            )
        )
    return curves
