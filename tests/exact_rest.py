"""Configurations in which two links stand still, by Newton's method in 50 digits.

Independent of spherekit: unknown are the rotations and rates of all links, not variables
of pairs, and the equations say that the axes of each pair agree in both of its links.
"""

from typing import NamedTuple

import mpmath as mp
import numpy as np
from oracles import revolute_frames

DIGITS = 50
STEPS = 8


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
    need only those of the machine.
    """
    with mp.workdps(DIGITS):
        return _solved(made, rotations, w, links, along)


def _solved(made, rotations, w, links, along):
    first, second = (_exact(f[:, :, 2]) for f in revolute_frames(made))
    first, second = (u / _lengths(u) for u in (first, second))
    count, (one, other) = len(made.links), links
    turn, rate, along = _exact(rotations), _exact(w), _exact(along)
    for _ in range(3):
        turn = turn @ (3 * _exact(np.eye(3)) - np.swapaxes(turn, 1, 2) @ turn) / 2
    start, scale = turn.copy(), rate.copy()
    a, b = np.array(made.ends).T
    inverse = None
    for _ in range(STEPS):
        p = (turn[a] @ first[..., None])[..., 0]
        g = (turn[b] @ second[..., None])[..., 0]
        v = rate[b] - rate[a]
        if inverse is None:
            inverse = _inverse(count, a, b, p, g, v, scale, links, along)
        size = np.sum(scale * (rate - scale))
        still = np.sum(along * (rate[one] - rate[other]))
        rest = np.concatenate([(p - g).ravel(), np.cross(v, p).ravel(), [size, still]])
        left = np.max(np.abs(rest))
        if left < mp.mpf(10) ** (4 - DIGITS):
            break
        step = -(inverse @ (rest / left).astype(float)) * left
        step = step.reshape(2, count - 1, 3)
        turn[1:] = [_about(x) @ r for x, r in zip(step[0], turn[1:], strict=True)]
        rate[1:] += step[1]
    return Rest(
        float(np.max(np.abs(turn - start))),
        float(left),
        float(np.max(np.abs(rate[one] - rate[other]))),
        rate.astype(float),
    )


def _inverse(count, a, b, p, g, v, scale, links, along):
    """Return the pseudo-inverse of the Jacobian, the first link held."""
    p, g, v, scale, along = (x.astype(float) for x in (p, g, v, scale, along))
    pairs = len(a)
    rows = np.zeros((6 * pairs + 2, 2, count, 3))
    for k in range(pairs):
        gap, slip = slice(3 * k, 3 * k + 3), slice(3 * (pairs + k), 3 * (pairs + k) + 3)
        rows[gap, 0, a[k]] -= _skew(p[k])
        rows[gap, 0, b[k]] += _skew(g[k])
        rows[slip, 0, a[k]] -= _skew(v[k]) @ _skew(p[k])
        rows[slip, 1, a[k]] += _skew(p[k])
        rows[slip, 1, b[k]] -= _skew(p[k])
    rows[-2, 1] = scale
    rows[-1, 1, links[0]] += along
    rows[-1, 1, links[1]] -= along
    return np.linalg.pinv(rows[:, :, 1:].reshape(len(rows), -1), rcond=1e-10)


def _exact(values):
    return np.vectorize(mp.mpf, otypes=[object])(values)


def _lengths(vectors):
    squares = np.sum(vectors * vectors, axis=-1, keepdims=True)
    return np.vectorize(mp.sqrt, otypes=[object])(squares)


def _skew(v):
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def _about(x):
    """Return the rotation matrix of a rotation vector (3,)."""
    angle = mp.sqrt(np.sum(x * x))
    if not angle:
        return _exact(np.eye(3))
    n = _skew(x / angle)
    return _exact(np.eye(3)) + mp.sin(angle) * n + (1 - mp.cos(angle)) * (n @ n)
