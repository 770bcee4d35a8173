"""Axes of another program's model: the point they meet in, gears, and their numbers.

Hinges coupled at a constant ratio are two circles that roll on each other; numbers are
written as a person would have.
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from spherekit.arrays import Floats
from spherekit.model.graph import spanning
from spherekit.sphere.rotation import arc, unit_rows

ONE_LINE = 1e-6
"""Sine below which two axes are one."""

SAME = 1e-9
"""Relative difference below which two ratios are the same."""


class Turning(NamedTuple):
    """A pair of two links about an axis (3,); `joint` is its joint's number, or -1."""

    name: str
    links: tuple[int, int]
    axis: Floats
    value: float
    joint: int = -1


Circle = tuple[float, int, Floats]
"""A radius (rad), the link that a circle is fixed in, and its centre (3,)."""


def gears_of(
    hinges: Sequence[Turning], factors: Mapping[int, float]
) -> tuple[list[Circle], bool] | str:
    """Return the two circles that say the same as a sum of rates that is zero.

    And whether they touch from outside; else the smaller one comes first.

    Parameters
    ----------
    hinges
        All that there are.
    factors
        Of the rates in the sum, by hinge.

    Returns
    -------
    circles, external
        Or why no two circles do.

    Notes
    -----
    The hinges have to lie on one way from a link a to a link b, first along one axis A,
    then along another one B. With the rotations x about A and y about B the relative
    angular velocity w_b - w_a is x A + y B, and the sum u x + v y. It is zero where that is
    along v A - u B, the direction in which the circles touch.
    """
    used = [hinge for hinge in hinges if factors.get(hinge.joint)]
    if not (way := _way(used)):
        return "its joints do not follow each other from one link to another"
    if all(_aligned(hinge.axis, used[0].axis) for hinge in used):
        return "its joints lie along one line, and axes of bevel gears cross"
    lines, shares = list[Floats](), list[float]()
    for hinge, sense in way:
        share = sense * factors[hinge.joint]
        if not (lines and _aligned(hinge.axis, lines[-1])):
            lines.append(hinge.axis)
            shares.append(share)
        share *= float(np.sign(hinge.axis @ lines[-1]))
        if abs(share - shares[-1]) > SAME * abs(share):
            return "its joints about one axis do not add up"
    if len(lines) != 2:
        return f"its joints lie along {len(lines)} axes, and two gears have two"
    touching = unit_rows(shares[1] * lines[0] - shares[0] * lines[1])
    (first, onwards), (last, sense) = way[0], way[-1]
    ends = first.links[0 if onwards > 0 else 1], last.links[1 if sense > 0 else 0]
    centres = [line if line @ touching >= 0.0 else -line for line in lines]
    radii = [float(arc(centre, touching)) for centre in centres]
    if min(radii) < ONE_LINE:
        return "one of its gears would have no size"
    one, other = np.cross(centres, touching)
    external = bool(one @ other < 0.0)
    circles = [*zip(radii, ends, centres, strict=True)]
    return circles if external else sorted(circles, key=lambda x: x[0]), external


def _aligned(one: Floats, other: Floats) -> bool:
    return float(np.linalg.norm(np.cross(one, other))) <= ONE_LINE


def _way(hinges: Sequence[Turning]) -> list[tuple[Turning, float]]:
    """Return hinges in the order of a way through all, with the sense of each."""
    links = [link for hinge in hinges for link in hinge.links]
    ends = [link for link in dict.fromkeys(links) if links.count(link) == 1]
    ways = spanning([hinge.links for hinge in hinges], ends[:1])
    if len(ends) != 2 or len(ways) < len(hinges):
        return []
    return [(hinges[k], 1.0 if hinges[k].links[0] == x else -1.0) for k, x, _ in ways]


PARALLEL = 1e-9
"""Sine below which two axes are parallel."""


def distances(place: Floats, points: Floats, axes: Floats) -> Floats:
    """Return how far (n,) m lines through points along unit axes (n, 3) pass a place."""
    return np.linalg.norm(np.cross(place - points, axes), axis=1)


def common_point(points: Floats, axes: Floats, within: float) -> Floats | None:
    """Return the point (3,) that lines pass within a distance (m), None if parallel.

    Lines go through points along unit axes (n, 3). The point of least squared distances,
    where the farthest lines are left out until the others pass it. Where all lines are one,
    any point of it will do, and the one nearest to the origin is taken.
    """
    kept, best = np.arange(len(points)), None
    across = np.eye(3) - axes[:, :, None] * axes[:, None]
    while len(kept) > 1:
        summed = np.sum(across[kept], axis=0)
        if np.linalg.eigvalsh(summed)[0] < PARALLEL**2 * len(kept):
            break
        pulled = np.sum(across[kept] @ points[kept, :, None], axis=0)[:, 0]
        best = np.linalg.solve(summed, pulled)
        gaps = distances(best, points[kept], axes[kept])
        if np.max(gaps) <= within:
            break
        kept = np.delete(kept, np.argmax(gaps))
    if best is not None:
        return best
    foot = points[0] - (points[0] @ axes[0]) * axes[0]
    return foot if np.max(distances(foot, points, axes)) <= within else None


ROUNDING = 4e-15
"""Numbers that differ by less, relative to what is beside them, are one."""

DEGREES = 1e-14
"""The same of angles in degrees, relative, or absolute where they are below one."""


def plain(number: float, scale: float, rounding: float = ROUNDING) -> float:
    """Return the shortest decimal within the rounding of numbers as large as `scale`."""
    number = float(number)
    allowed = rounding * max(abs(scale), abs(number))
    for digits in range(1, 18):
        short = float(f"{number:.{digits}g}")
        if abs(short - number) <= allowed:
            return 0.0 if abs(number) <= allowed else short
    return number


def plain_angle(angle: float) -> float:
    """Return an angle (rad) as it stands in a file, in degrees."""
    return plain(math.degrees(angle), 1.0, DEGREES)


def plain_axis(axis: Floats) -> list[float]:
    """Return the components of an axis (3,) as they stand in a file."""
    return [plain(part, 1.0) for part in axis]
