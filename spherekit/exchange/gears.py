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
@dataclass(frozen=True)
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
    way = _way(used)
    if way is None:
        return "its joints do not follow each other from one link to another"
    if all(
        np.linalg.norm(np.cross(hinge.axis, used[0].axis)) <= ONE_LINE for hinge in used
    ):
        return "its joints lie along one line, and axes of bevel gears cross"
    lines: list[Floats] = []
    shares: list[float] = []
    for hinge, sense in way:
        if not lines or np.linalg.norm(np.cross(hinge.axis, lines[-1])) > ONE_LINE:
            lines.append(hinge.axis)
            shares.append(sense * factors[hinge.joint])
        share = sense * factors[hinge.joint] * float(np.sign(hinge.axis @ lines[-1]))
        if abs(share - shares[-1]) > SAME * abs(share):
            return "its joints about one axis do not add up"
    if len(lines) != 2:
        return f"its joints lie along {len(lines)} axes, and two gears have two"
    A, B = lines
    touching = shares[1] * A - shares[0] * B
    touching = touching / np.linalg.norm(touching)
    links = (_first(way), _last(way))
    centres = [axis * (1.0 if axis @ touching >= 0.0 else -1.0) for axis in lines]
    radii = [
        float(np.arctan2(np.linalg.norm(np.cross(c, touching)), c @ touching))
        for c in centres
    ]
    if min(radii) < ONE_LINE:
        return "one of its gears would have no size"
    side = [centre - (centre @ touching) * touching for centre in centres]
    external = float(side[0] @ side[1]) < 0.0
    order = (0, 1) if external or radii[0] <= radii[1] else (1, 0)
    return Gears(
        (links[order[0]], links[order[1]]),
        (centres[order[0]], centres[order[1]]),
        (radii[order[0]], radii[order[1]]),
        "external" if external else "internal",
    )


def _way(hinges: Sequence[Turning]) -> list[tuple[Turning, float]] | None:
    """Return hinges in the order of a way through all, with the sense of each."""
    ends = [link for hinge in hinges for link in hinge.links]
    odd = [link for link in dict.fromkeys(ends) if ends.count(link) == 1]
    if len(odd) != 2 or max(ends.count(link) for link in ends) > 2:
        return None
    left, link, ordered = list(hinges), odd[0], []
    while left:
        here = next((hinge for hinge in left if link in hinge.links), None)
        if here is None:
            return None
        forwards = here.links[0] == link
        ordered.append((here, 1.0 if forwards else -1.0))
        link = here.links[1] if forwards else here.links[0]
        left = [hinge for hinge in left if hinge is not here]
    return ordered


def _first(way: Sequence[tuple[Turning, float]]) -> int:
    hinge, sense = way[0]
    return hinge.links[0] if sense > 0 else hinge.links[1]


def _last(way: Sequence[tuple[Turning, float]]) -> int:
    hinge, sense = way[-1]
    return hinge.links[1] if sense > 0 else hinge.links[0]
