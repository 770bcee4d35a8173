"""Configurations in which two links stand still, by Newton's method in 50 digits.

Independent of spherekit: unknown are the rotations and rates of all links, not variables
of pairs, and the equations say that the axes of each pair agree in both of its links.
"""

from typing import NamedTuple

import mpmath as mp
import numpy as np
from oracles.velocity_equations import revolute_frames

DIGITS = 50
STEPS = 12
wide = np.frompyfunc(mp.mpf, 1, 1)
root = np.frompyfunc(mp.sqrt, 1, 1)


class Rest(NamedTuple):
    """What Newton's method did and where it ended.

    `moved` is the largest change of an element of the rotations, `left` the residual,
    `rates` (links, 3) those of the links in the end, with `left` and the rate of the two
    links that rest rounded after 50 digits.
    """

    moved: float
    left: float
    resting: float
    rates: np.ndarray


def exact_rest(made, rotations, w, links, along):
    """Return how far a configuration is from one where two links rest.

    With `rotations` (links, 3, 3) and `w` (links, 3) as a start. For each pair, u in its
    first link and v in its second: R_a u = R_b v and (w_b - w_a) x R_a u = 0. The rates
    have the size they start with, and the relative rate of `links` has no component along
    a vector. The residual is evaluated in 50 digits; the least squares that give a step
    are those of the machine, by differences.
    """
    with mp.workdps(DIGITS):
        first, second = (wide(f[:, :, 2]) for f in revolute_frames(made))
        axes = [u / root(np.sum(u * u, axis=1, keepdims=True)) for u in (first, second)]
        (one, other), (a, b) = links, np.array(made.ends).T
        turn, rate, along = wide(rotations), wide(w), wide(along)
        for _ in range(3):
            turn = turn @ (3 * wide(np.eye(3)) - np.swapaxes(turn, 1, 2) @ turn) / 2
        start, scale = turn, rate

        def residual(turn, rate):
            p, g = (
                (turn[k] @ u[..., None])[..., 0] for k, u in zip((a, b), axes, strict=True)
            )
            slip = np.cross(rate[b] - rate[a], p)
            more = np.sum(scale * (rate - scale)), np.sum(along * (rate[one] - rate[other]))
            return np.concatenate([(p - g).ravel(), slip.ravel(), more])

        def moved(step):
            """The configuration a step (2, links - 1, 3) on, the first link held."""
            turns = [_about(x) @ r for x, r in zip(step[0], turn[1:], strict=True)]
            still = np.zeros((1, 3), dtype=int)
            return np.stack([turn[0], *turns]), rate + np.concatenate([still, step[1]])

        units = np.eye(6 * (len(turn) - 1)).reshape(-1, 2, len(turn) - 1, 3)
        small = mp.mpf(10) ** -20
        slopes = [residual(*moved(small * wide(x))) - residual(turn, rate) for x in units]
        inverse = np.linalg.pinv((np.array(slopes) / small).astype(float).T, rcond=1e-10)
        for _ in range(STEPS):
            rest = residual(turn, rate)
            left = np.max(np.abs(rest))
            if left < mp.mpf(10) ** (4 - DIGITS):
                break
            step = -(inverse @ (rest / left).astype(float)) * left
            turn, rate = moved(step.reshape(units.shape[1:]))
        return Rest(
            float(np.max(np.abs(turn - start))),
            float(left),
            float(np.max(np.abs(rate[one] - rate[other]))),
            rate.astype(float),
        )


def _about(x):
    """Return the rotation matrix of a rotation vector (3,)."""
    angle = mp.sqrt(np.sum(x * x))
    if not angle:
        return wide(np.eye(3))
    n = np.cross(wide(np.eye(3)), -x / angle)
    return wide(np.eye(3)) + mp.sin(angle) * n + (1 - mp.cos(angle)) * (n @ n)
