"""What makes a profile valid: colatitudes, points, and closed curves that stay simple."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spherekit.sphere.paths import UNIT_TOLERANCE, FourierPath, SplinePath, dot
from spherekit.sphere.rotation import Floats, arc, cross

FEWEST_POINTS = 6
"""Fewest points of a curve through points: they fix one polynomial of degree 5."""

_TOUCH = 1e-13


def check_colatitude(path: FourierPath) -> None:
    """Raise ValueError if a Fourier colatitude leaves (0, pi) anywhere."""
    a = np.linspace(0.0, 2.0 * np.pi, 64 * len(path.cosines), endpoint=False)
    spacing = float(a[1])
    for _ in range(4):
        # towards the stationary point nearby; the samples that have none stay near
        _, slope, bend = path.colatitude(a, 2)
        step = np.divide(slope, bend, out=np.zeros_like(a), where=bend != 0.0)
        a = a - np.clip(step, -spacing, spacing)
    value = path.colatitude(a, 0)[0]
    for at, wrong in (
        (int(np.argmin(value)), np.min(value) <= 0.0),
        (int(np.argmax(value)), np.max(value) >= np.pi),
    ):
        if wrong:
            raise ValueError(
                f"the colatitude is {np.rad2deg(value[at]):.6g} deg at "
                f"{path.place(float(a[at]))}; it has to stay between 0 and 180 deg, both "
                "excluded"
            )


def checked_points(points: ArrayLike, closed: bool) -> Floats:
    """Return points (m, 3) of exactly unit length; a closed curve's first one again."""
    given = np.array(points, dtype=float)
    if given.ndim != 2 or given.shape[1] != 3:
        raise ValueError(f"the points have shape {given.shape}; they have to be (m, 3)")
    if len(given) < FEWEST_POINTS:
        raise ValueError(
            f"the curve has {len(given)} points; it needs at least {FEWEST_POINTS}"
        )
    size = np.sqrt(dot(given, given))
    wrong = ~(np.abs(size - 1.0) <= UNIT_TOLERANCE)
    if np.any(wrong):
        k = int(np.argmax(wrong))
        raise ValueError(
            f"point {k + 1} has length {size[k]:.9g}; it has to be a unit vector"
        )
    given = given / size[:, None]
    if closed:
        if arc(given[-1], given[0]) < UNIT_TOLERANCE:
            raise ValueError(
                f"the last point, {len(given)}, repeats the first; leave it out: a closed "
                "curve returns to its first point by itself"
            )
        given = np.concatenate([given, given[:1]])
    steps = arc(given[:-1], given[1:])
    count = len(given) - int(closed)
    for k, step in enumerate(steps):
        names = f"points {k + 1} and {(k + 1) % count + 1}"
        if step < 1e-9:
            raise ValueError(f"{names} coincide; leave one of them out")
        if step >= 0.5 * np.pi:
            raise ValueError(
                f"{names} are {np.rad2deg(step):.6g} deg apart; successive points have to "
                "be less than 90 deg apart, so give more of them"
            )
    return given


def check_simple(path: SplinePath) -> None:
    """Raise ValueError if a closed curve through points crosses or touches itself.

    Looks at a polyline of great-circle arcs, at least 8 between successive points.
    Arcs can meet only where their middles are nearer than half their lengths together;
    a tree finds those pairs, long arcs first so that each search has one radius.
    """
    from scipy.spatial import cKDTree

    count = len(path.knots) - 1
    parts = max(8, -(-400 // count))
    u = path.knots[:-1, None] + np.diff(path.knots)[:, None] * (np.arange(parts) / parts)
    x = path.spline(u.ravel())
    a = x / np.sqrt(dot(x, x))[:, None]
    b = np.roll(a, -1, axis=0)
    middle, length = 0.5 * (a + b), np.sqrt(dot(b - a, b - a))
    size = np.floor(np.log2(length))
    total = len(a)
    for exponent in np.unique(size):
        these, shorter = np.flatnonzero(size == exponent), np.flatnonzero(size <= exponent)
        neighbours = cKDTree(middle[shorter]).query_ball_point(
            middle[these], 2.0 ** (exponent + 1)
        )
        i = np.repeat(these, [len(row) for row in neighbours])
        j = shorter[np.concatenate([np.asarray(row, dtype=int) for row in neighbours])]
        apart = np.minimum((i - j) % total, (j - i) % total) > 1
        gap = middle[i] - middle[j]
        close = np.sqrt(dot(gap, gap)) <= 0.5 * (length[i] + length[j]) * (1.0 + 1e-9)
        i, j = i[apart & close], j[apart & close]
        met = _straddle(a[i], b[i], a[j], b[j]) & _straddle(a[j], b[j], a[i], b[i])
        if np.any(met):
            at = int(np.argmax(met))
            first, second = sorted((int(i[at]) // parts, int(j[at]) // parts))
            raise ValueError(
                f"the closed curve meets itself: between points {first + 1} and "
                f"{(first + 1) % count + 1} and between points {second + 1} and "
                f"{(second + 1) % count + 1}"
            )


def _straddle(a: Floats, b: Floats, c: Floats, d: Floats) -> NDArray[np.bool_]:
    """Return where c and d (n, 3) are not strictly on one side of the circle a, b."""
    normal = cross(a, b)
    normal = normal / np.sqrt(dot(normal, normal))[:, None]
    at_c, at_d = dot(normal, c), dot(normal, d)
    return np.asarray(
        (at_c * at_d <= 0.0) | (np.abs(at_c) <= _TOUCH) | (np.abs(at_d) <= _TOUCH)
    )
