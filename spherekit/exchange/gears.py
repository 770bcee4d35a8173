"""Hinges coupled at a constant ratio as two circles that roll on each other."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import final

import numpy as np

from spherekit.sphere.rotation import Floats

ONE_LINE = 1e-6
"""Sine below which two axes are one."""

SAME = 1e-9
"""Relative difference below which two ratios are the same."""


@final
@dataclass(frozen=True, eq=False)
class Turning:
    """A hinge as far as gears are concerned: the links it joins, and its axis (3,)."""

    joint: int
    links: tuple[int, int]
    axis: Floats


@final
@dataclass(frozen=True)
class Gears:
    """Two circles that touch: links, centres (3,), radii (rad), and how they lie."""

    links: tuple[int, int]
    centres: tuple[Floats, Floats]
    radii: tuple[float, float]
    contact: str


def gears_of(hinges: Sequence[Turning], factors: Mapping[int, float]) -> Gears | str:
    """Return the circles that say the same as a sum of rates that is zero.

    Parameters
    ----------
    hinges
        All that there are.
    factors
        Of the rates in the sum, by hinge.

    Returns
    -------
    Gears or str
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
    lines: list[Floats] = []
    shares: list[float] = []
    for hinge, sense in way:
        if not lines or not _aligned(hinge.axis, lines[-1]):
            lines.append(hinge.axis)
            shares.append(sense * factors[hinge.joint])
        share = sense * factors[hinge.joint] * float(np.sign(hinge.axis @ lines[-1]))
        if abs(share - shares[-1]) > SAME * abs(share):
            return "its joints about one axis do not add up"
    if len(lines) != 2:
        return f"its joints lie along {len(lines)} axes, and two gears have two"
    touching = shares[1] * lines[0] - shares[0] * lines[1]
    touching = touching / np.linalg.norm(touching)
    (first, onwards), (last, sense) = way[0], way[-1]
    ends = first.links[0 if onwards > 0 else 1], last.links[1 if sense > 0 else 0]
    return _circles(ends, lines, touching)


def _circles(ends: Sequence[int], lines: Sequence[Floats], touching: Floats) -> Gears | str:
    """Return circles fixed in two links about lines that touch in a direction."""
    circles = []
    for link, line in zip(ends, lines, strict=True):
        centre = line * (1.0 if line @ touching >= 0.0 else -1.0)
        across = float(np.linalg.norm(np.cross(centre, touching)))
        circles.append((float(np.arctan2(across, centre @ touching)), link, centre))
    if min(radius for radius, _, _ in circles) < ONE_LINE:
        return "one of its gears would have no size"
    side = [centre - (centre @ touching) * touching for _, _, centre in circles]
    external = float(side[0] @ side[1]) < 0.0
    if not external:
        circles.sort(key=lambda circle: circle[0])
    radii, links, centres = zip(*circles, strict=True)
    return Gears(links, centres, radii, "external" if external else "internal")


def _aligned(one: Floats, other: Floats) -> bool:
    return float(np.linalg.norm(np.cross(one, other))) <= ONE_LINE


def _way(hinges: Sequence[Turning]) -> list[tuple[Turning, float]]:
    """Return hinges in the order of a way through all, with the sense of each."""
    ends = [link for hinge in hinges for link in hinge.links]
    odd = [link for link in dict.fromkeys(ends) if ends.count(link) == 1]
    if len(odd) != 2 or max(ends.count(link) for link in ends) > 2:
        return []
    left, link, ordered = list(hinges), odd[0], []
    while left:
        here = next((hinge for hinge in left if link in hinge.links), None)
        if here is None:
            return []
        forwards = here.links[0] == link
        ordered.append((here, 1.0 if forwards else -1.0))
        link = here.links[1] if forwards else here.links[0]
        left.remove(here)
    return ordered
