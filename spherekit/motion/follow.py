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
    start = nodes_at(closure, [driven], values[None], np.ones((1, 1)))
    if start.reciprocal_condition[0] > AT_DEAD_CENTRE and np.all(np.isfinite(start.slope)):
        return _through(closure, driven, start, low, high)
    tried = 0
    for beside in _ways_on(closure, driven, values):
        start = nodes_at(closure, [driven], beside[None], np.ones((1, 1)))
        q = float(beside[driven])
        curve = _through(closure, driven, start, min(low, q), max(high, q))
        tried += curve.tried
        if (reached := curve.to(values, driven)) is not None:
            return replace(reached, tried=tried)
    curve = _through(closure, driven, start, low, high)
    return replace(curve, tried=tried + curve.tried)


def _ways_on(closure: Closure, driven: int, values: Floats) -> list[Floats]:
    """Return configurations (variables,) beside a dead centre, in a definite order."""
    around = ways_out(closure, values)
    moved = around[np.abs(around[:, driven] - values[driven]) > AT_DEAD_CENTRE]
    return sorted(moved, key=lambda way: tuple(np.round(values - way, 6)))


def _through(
    closure: Closure, driven: int, start: Nodes, low: float, high: float
) -> ModeCurve:
    """Return the curve through a node at which the input moves."""
    both = np.repeat(start.values, 2, axis=0)
    goals = np.array([[low], [high]])
    paths = InputPaths(closure, [driven], both, goals, keeps_trail=True)
    down, up = (_of_way(start, paths, row) for row in (0, 1))
    values, slopes = (np.concatenate([down[k][:0:-1], up[k]]) for k in (0, 1))
    ends = Status(paths.status[0]), Status(paths.status[1])
    return ModeCurve(values[:, driven].copy(), values, slopes, ends, paths.tried)


def _of_way(start: Nodes, paths: InputPaths, row: int) -> tuple[Floats, Floats]:
    """Return values and slopes by the input (k, variables) of a way, the start first."""
    nodes = [start]
    for rows, made in paths.trail or ():
        nodes.append(made.rows(rows == row))
    return (
        np.concatenate([node.values for node in nodes]),
        np.concatenate([node.slope * node.direction for node in nodes]),
    )
