"""Checks of profiles: colatitudes, points, and that closed curves do not cross."""

import numpy as np
from numpy.typing import ArrayLike

from spherekit.arrays import Bools, Floats
from spherekit.geometry.parametric_curve import UNIT_TOLERANCE, FourierPath, SplinePath
from spherekit.geometry.triangle import arc
from spherekit.geometry.vectors import cross, dot

FEWEST_POINTS = 6
"""Fewest points of a curve through points: they fix one polynomial of degree 5."""


_TOUCH = 1e-13


def check_colatitude(path: FourierPath) -> None:
    """Raise ValueError if a Fourier colatitude leaves (0, pi) anywhere."""
    even, odd = path.series[1]
    # e^(ia) at the zeros of the slope, and so its angle at the real ones, are roots
    ahead = np.round(0.5 * (even - 1j * odd), 30)  # quotients remain finite
    roots = np.roots(np.concatenate([ahead[::-1], np.conj(ahead[1:])]))
    a = np.angle(np.append(roots, 1.0))
    value = path.colatitude(a, 0)[0]
    at = int(np.argmax(np.abs(value - 0.5 * np.pi)))
    if not 0.0 < value[at] < np.pi:
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
    count = len(given) - closed
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

    Looks at a polyline of great-circle arcs, at least 8 between successive points. Two arcs
    can meet only where the middle of one is nearer than the longer one's length.
    """
    from scipy.spatial import cKDTree

    count = len(path.knots) - 1
    parts = max(8, -(-400 // count))
    u = path.knots[:-1, None] + np.diff(path.knots)[:, None] * (np.arange(parts) / parts)
    x = path.spline(u.ravel())
    a = x / np.sqrt(dot(x, x))[:, None]
    b = np.roll(a, -1, axis=0)
    middle, length, total = 0.5 * (a + b), np.sqrt(dot(b - a, b - a)), len(a)
    near = cKDTree(middle).query_ball_point(middle, length * (1.0 + 1e-9))
    i, j = np.repeat(np.arange(total), [*map(len, near)]), np.concatenate([*near])
    apart = np.minimum((i - j) % total, (j - i) % total) > 1
    i, j = i[apart], j[apart]
    met = _straddle(a[i], b[i], a[j], b[j]) & _straddle(a[j], b[j], a[i], b[i])
    if np.any(met):
        at = np.argmax(met)
        places = " and ".join(
            f"between points {k + 1} and {(k + 1) % count + 1}"
            for k in sorted((i[at] // parts, j[at] // parts))
        )
        raise ValueError(f"the closed curve meets itself: {places}")


def _straddle(a: Floats, b: Floats, c: Floats, d: Floats) -> Bools:
    """Return where c and d (n, 3) are not strictly on one side of the circle a, b."""
    normal = cross(a, b)
    normal = normal / np.sqrt(dot(normal, normal))[:, None]
    at_c, at_d = dot(normal, c), dot(normal, d)
    return (at_c * at_d <= 0.0) | (np.abs(at_c) <= _TOUCH) | (np.abs(at_d) <= _TOUCH)
