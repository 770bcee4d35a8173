"""Which links of a spherical four-bar turn fully: Grashof's criterion on the sphere.

With arcs g of the fixed link, a of the input, h of the coupler, b of the output in (0, pi]
the distance c of the two moving axes runs from |g - a| to g + a, or 2 pi less that, while
the input turns. Coupler and output close where |h - b| <= c <= min(h + b, 2 pi - h - b).
Both hold throughout where T1 T2 >= 0 and T3 T4 >= 0, see J. M. McCarthy and G. S. Soh,
Geometric Design of Linkages, 2nd ed., Springer, 2011, section 7.2.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spherekit.geometry.triangle import arc
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.pair_frames import link_axes

FOLDS = 1e-9
"""Sums of arcs (rad) below this are zero: the links can lie in one great circle."""


@dataclass(frozen=True)
class Grashof:
    """The class of a four-bar: names of its input and output links, and how they move.

    `name` is crank-rocker, rocker-crank, double-crank, double-rocker (the coupler turns
    fully), triple-rocker (no link does: not of Grashof's kind) or change-point.
    """

    name: str
    input: str
    output: str

    def __str__(self) -> str:
        motion = {
            "crank-rocker": f"link {self.input} turns fully, link {self.output} swings",
            "rocker-crank": f"link {self.input} swings, link {self.output} turns fully",
            "double-crank": f"links {self.input} and {self.output} turn fully",
            "double-rocker": f"links {self.input} and {self.output} swing, only the "
            "coupler turns fully",
            "triple-rocker": "no link turns fully, it is not of Grashof's kind",
            "change-point": "all links can lie in one great circle, from where it may go "
            "on in two ways",
        }[self.name]
        return f"{self.name}: {motion}"


def grashof(mechanism: Mechanism) -> Grashof | None:
    """Return the class of a four-bar of R pairs driven at one of its links' ends.

    None for other mechanisms. The fixed link is the ground, where the driven pair is on
    it, else the pair's first link.
    """
    places = four_bar_links(mechanism)
    if places is None:
        return None
    axes = [of_link.values() for of_link in link_axes(mechanism).values()]
    name = str(class_of(*(arc(*axes[k]) for k in places)))
    return Grashof(name, mechanism.links[places[1]], mechanism.links[places[3]])


def four_bar_links(mechanism: Mechanism) -> tuple[int, int, int, int] | None:
    """Return the numbers of fixed link, input, coupler and output of a four-bar.

    None for other mechanisms.
    """
    ends = mechanism.ends
    joined = np.bincount(np.ravel(ends), minlength=len(mechanism.links)).tolist()
    turning = all(pair.kind.has_axis for pair in mechanism.pairs)
    if not turning or joined != [2, 2, 2, 2] or len(mechanism.inputs) != 1:
        return None
    fixed, moved = ends[mechanism.pair_number[mechanism.inputs[0].pair]]
    if moved == 0:
        fixed, moved = moved, fixed
    (output,) = (
        sum(links) - fixed for links in ends if fixed in links and moved not in links
    )
    return fixed, moved, 6 - fixed - moved - output, output


def class_of(g: ArrayLike, a: ArrayLike, h: ArrayLike, b: ArrayLike) -> NDArray[np.str_]:
    """Return the class (n,) of arcs (n,) rad of fixed link, input, coupler and output."""
    g, a, h, b = (np.asarray(arc, dtype=float) for arc in (g, a, h, b))
    t = np.stack([g - a + h - b, g - a - h + b, h + b - g - a, 2.0 * np.pi - g - a - h - b])
    turns = (t[0] * t[1] > 0.0) & (t[2] * t[3] > 0.0)
    output_turns = (t[0] * t[2] < 0.0) & (t[1] * t[3] < 0.0)
    return np.select(
        [
            np.min(np.abs(t), axis=0) < FOLDS,
            turns & output_turns,
            turns,
            output_turns,
            np.prod(t, axis=0) > 0.0,
        ],
        ["change-point", "double-crank", "crank-rocker", "rocker-crank", "double-rocker"],
        "triple-rocker",
    )
