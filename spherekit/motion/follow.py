"""Following one assembly mode of a mechanism along its input, step by safe step.

A small closure residual does not prove the mode: Newton's method may close the loops on
a neighbouring one. A step is therefore accepted only if the predictor with exact first
and second derivatives was nearly right, the iteration contracted at once, the tangent
turned little, and the determinant of the closure Jacobian kept its sign; otherwise it
is halved. The accepted nodes form a curve from which any sample is predicted.
"""

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import CLOSURE_TOLERANCE, Status
from spherekit.model.geometry import Contact
from spherekit.motion.closure import Closure
from spherekit.motion.loops import left_inverse
from spherekit.motion.pairs import pair_rates, variable_vectors
from spherekit.sphere.rotation import Floats

LARGEST_STEP = 0.2
"""Longest step of the input (rad)."""
BEND = 0.02
"""Second-order part of a step that is aimed at (rad)."""
NEARER = 0.3
"""Part of slope / bend stepped at most: 0.6 of the way to a dead centre, where a
variable goes as the square root of the way left and slope / bend is twice that way."""
SMALLEST_STEP = 4e-13
"""A step below this means that the input has reached a dead centre (rad)."""
MOST_NODES = 20000
NEARLY_FLAT, NEARLY_EQUAL, NEARLY_ENDED = 1e-3, 1e-3, 1e-6
"""How near the last node is to a dead centre (relative singular value), to equal
curvatures, and to the end of an open profile (rad), to name it as the reason."""


@final
@dataclass(frozen=True)
class Curve:
    """Nodes of one branch in rising input order, with exact slopes.

    `inputs` (k,), `values` and `slopes` (k, variables) in rad and rad/rad. `ends` say why
    the curve goes no further at both ends: OK where the range ends, else the status of
    the samples beyond.
    """

    inputs: Floats
    values: Floats
    slopes: Floats
    ends: tuple[Status, Status]

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

    def covers(self, q: Floats) -> NDArray[np.bool_]:
        """Return (n,) whether each input lies on the curve."""
        slack = 1e-14 * np.maximum(1.0, np.abs(q))
        inside = (q >= self.inputs[0] - slack) & (q <= self.inputs[-1] + slack)
        return np.asarray(inside)


@final
@dataclass(frozen=True)
class _Node:
    q: float
    values: Floats
    slope: Floats
    bend: Floats
    sign: float
    flatness: float


def follow(closure: Closure, driven: int, values: Floats, low: float, high: float) -> Curve:
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
    start = _node(closure, driven, values)
    down, why_down = _march(closure, driven, start, low)
    up, why_up = _march(closure, driven, start, high)
    nodes = [*reversed(down), start, *up]
    return Curve(
        np.array([node.q for node in nodes]),
        np.array([node.values for node in nodes]),
        np.array([node.slope for node in nodes]),
        (why_down, why_up),
    )


def _march(
    closure: Closure, driven: int, start: _Node, stop: float
) -> tuple[list[_Node], Status]:
    nodes: list[_Node] = []
    at = start
    way = 1.0 if stop > start.q else -1.0
    step = LARGEST_STEP
    while (stop - at.q) * way > 0.0 and len(nodes) < MOST_NODES:
        bend = float(np.max(np.abs(at.bend))) + 1e-300
        slope = float(np.max(np.abs(at.slope)))
        step = min(step, LARGEST_STEP, (2 * BEND / bend) ** 0.5, NEARER * slope / bend)
        step = max(step, SMALLEST_STEP)
        rest = (stop - at.q) * way
        last = step >= rest * (1 - 1e-9)
        new = _advance(closure, driven, at, stop if last else at.q + way * step)
        if new is not None:
            nodes.append(new)
            at = new
            step *= 2.0
        elif step <= 2 * SMALLEST_STEP * max(1.0, abs(at.q)):
            return nodes, _why_ended(closure, at)
        else:
            step *= 0.5
    return nodes, Status.BRANCH_LOST if len(nodes) >= MOST_NODES else Status.OK


def _why_ended(closure: Closure, at: _Node) -> Status:
    """Return the status of the samples beyond the last node that could be reached."""
    _, states = closure.place(at.values[None])
    for k, joint in enumerate(closure.joints):
        if not isinstance(joint, Contact):
            continue
        if states.curvatures[0, k, 0] - states.curvatures[0, k, 1] < NEARLY_EQUAL:
            return Status.CURVATURE
        first = at.values[closure.tree.owners.index(k)]
        last = first if joint.rolling else at.values[closure.tree.owners.index(k) + 1]
        start = joint.start if joint.rolling else (0.0, 0.0)
        for curve, s in ((joint.first, first + start[0]), (joint.second, last + start[1])):
            if not curve.closed and min(s, curve.length - s) < NEARLY_ENDED:
                return Status.OFF_PROFILE
    return Status.OUT_OF_REACH if at.flatness < NEARLY_FLAT else Status.BRANCH_LOST


def _advance(closure: Closure, driven: int, at: _Node, q: float) -> _Node | None:
    h = q - at.q
    guess = at.values + h * at.slope + 0.5 * h * h * at.bend
    guess[driven] = q
    moved = float(np.max(np.abs(guess - at.values)))
    result = closure.solve(guess[None], held=driven, iterations=6)
    if not result.residual[0] < CLOSURE_TOLERANCE:
        return None
    correction = float(result.first_step[0])
    if correction > min(0.05, 0.1 * moved) + 1e-9:
        return None
    if correction > 1e-6 and result.ratio[0] > 0.1:
        return None
    new = _node(closure, driven, result.values[0])
    if new.sign != at.sign or not np.all(np.isfinite(new.slope)):
        return None
    before, after = _unit(at.slope), _unit(new.slope)
    if float(before @ after) < 0.95:
        return None
    return new


def _unit(slope: Floats) -> Floats:
    return np.asarray(slope / np.linalg.norm(slope))


def _node(closure: Closure, driven: int, values: Floats) -> _Node:
    placed, states = closure.place(values[None])
    frames = closure.frames(placed, states)
    vectors = variable_vectors(closure.joints, frames, states.curvatures)
    jacobian = closure.tree.jacobian(vectors)[0]
    free = [e for e in range(jacobian.shape[1]) if e != driven]
    square = jacobian[:, free]
    sign = determinant_sign(square)
    singular = np.linalg.svd(square, compute_uv=False)
    slope, bend = np.ones(len(values)), np.zeros(len(values))
    inverse = left_inverse(square[None])[0]
    slope[free] = -inverse @ jacobian[:, driven]
    w = closure.tree.body_rates(vectors, slope[None])
    first, second = (w[:, [pair[k] for pair in closure.tree.ends]] for k in (0, 1))
    turned = pair_rates(closure.joints, frames, states, first, second).vectors
    bend[free] = -inverse @ (closure.tree.jacobian(turned)[0] @ slope)
    flatness = float(singular[-1] / singular[0])
    return _Node(float(values[driven]), values, slope, bend, sign, flatness)


def determinant_sign(matrix: Floats) -> float:
    """Return the sign of a square matrix's determinant; 1 for one with extra rows."""
    if matrix.shape[0] != matrix.shape[1]:
        return 1.0
    return float(np.linalg.slogdet(matrix)[0])
