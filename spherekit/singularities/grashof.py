"""Grashof's criterion on the sphere, which says which links of a four-bar turn fully.

The arcs of the links, in (0, pi], are g of the fixed link, a of the input, h of the coupler
and b of the output. While the input turns, the distance c of the two moving axes runs from
``|g - a|`` to the smaller of g + a and 2 pi - g - a. Coupler and output can be joined
if c is at least ``|h - b|`` and at most the smaller of h + b and 2 pi - h - b.

So they can be joined at all inputs if T1 T2 >= 0 (for the smallest c) and T3 T4 >= 0 (for
the largest c). The four sums T of arcs are defined in `class_of`, see J. M. McCarthy and
G. S. Soh, Geometric Design of Linkages, 2nd ed., Springer, 2011, section 7.2.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spherekit.arrays import Floats
from spherekit.geometry.triangle import arc
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.pair_frames import link_axes

CHANGE_POINT_TOLERANCE_RAD = 1e-9
"""A sum T of arcs below this is zero: all links can lie in one great circle. Larger: more
four-bars are change-point; smaller: rounding of the arcs decides the class."""


@dataclass(frozen=True)
class Grashof:
    """The class of a four-bar by Grashof's criterion, and its input and output links.

    Attributes
    ----------
    name
        crank-rocker, rocker-crank, double-crank, double-rocker (only the coupler turns
        fully), triple-rocker (no link turns fully, so it is not of Grashof's kind) or
        change-point (all links can lie in one great circle).
    input, output
        Names of the input link and of the output link.
    fixed
        Name of the fixed link. The input and output links turn relative to it. None if the
        fixed link is the ground.
    """

    name: str
    input: str
    output: str
    fixed: str | None = None

    def __str__(self) -> str:
        motion = {
            "crank-rocker": f"link {self.input} turns fully, link {self.output} swings",
            "rocker-crank": f"link {self.input} swings, link {self.output} turns fully",
            "double-crank": f"links {self.input} and {self.output} turn fully",
            "double-rocker": f"links {self.input} and {self.output} swing, only the "
            "coupler turns fully",
            "triple-rocker": "no link turns fully (the four-bar is not a Grashof linkage)",
            "change-point": "all links can lie in one great circle, from which the motion "
            "can continue in two ways",
        }[self.name]
        relative_to = "" if self.fixed is None else f" (relative to link {self.fixed})"
        return f"{self.name.capitalize()}{relative_to}: {motion}"


def grashof(mechanism: Mechanism) -> Grashof | None:
    """Return the Grashof class of a spherical four-bar, None for other mechanisms.

    The class says which links turn fully, relative to the fixed link. The driven pair joins
    the fixed link and the input link. The fixed link is the ground if the driven pair is on
    it, otherwise the first link of the driven pair.
    """
    links = four_bar_links(mechanism)
    if links is None:
        return None
    fixed_link, input_link, coupler, output_link = links
    # For each link its two axes, by the names of the pairs.
    axes_by_link = list(link_axes(mechanism).values())

    def arc_of(link: int) -> Floats:
        """Return the arc (rad) between the two axes of a link."""
        first_axis, second_axis = axes_by_link[link].values()
        return arc(first_axis, second_axis)

    grashof_class = class_of(
        arc_of(fixed_link), arc_of(input_link), arc_of(coupler), arc_of(output_link)
    )
    return Grashof(
        name=str(grashof_class),
        input=mechanism.links[input_link],
        output=mechanism.links[output_link],
        fixed=None if fixed_link == 0 else mechanism.links[fixed_link],
    )


def four_bar_links(mechanism: Mechanism) -> tuple[int, int, int, int] | None:
    """Return the indices of fixed link, input, coupler and output of a four-bar.

    A four-bar has one loop of four links, joined by pairs with an axis, and one input. The
    result is None for other mechanisms. The fixed link is the ground (link 0) if the driven
    pair is on it, otherwise the first link of this pair.
    """
    ends = mechanism.ends
    pairs_of_link = np.bincount(np.ravel(ends), minlength=len(mechanism.links)).tolist()
    has_axes_only = all(pair.kind.has_axis for pair in mechanism.pairs)
    is_loop_of_four = pairs_of_link == [2, 2, 2, 2]
    if not has_axes_only or not is_loop_of_four or len(mechanism.inputs) != 1:
        return None
    fixed, input_link = ends[mechanism.pair_number[mechanism.inputs[0].pair]]
    # If the ground is the second link of the driven pair, it is the fixed link.
    if input_link == 0:
        fixed, input_link = input_link, fixed
    # In the loop, the output link is the other neighbour of the fixed link, and the coupler
    # is the link that remains.
    neighbours = {link for pair_ends in ends if fixed in pair_ends for link in pair_ends}
    (output,) = neighbours - {fixed, input_link}
    (coupler,) = set(range(4)) - {fixed, input_link, output}
    return fixed, input_link, coupler, output


def class_of(g: ArrayLike, a: ArrayLike, h: ArrayLike, b: ArrayLike) -> NDArray[np.str_]:
    """Return the class of four-bars by Grashof's criterion, from the arcs of their links.

    The arc of a link is the angle between its two axes. The classes follow from four sums
    T1 to T4 of the arcs (McCarthy and Soh 2011, section 7.2). The input turns fully if T1
    T2 > 0 and T3 T4 > 0, the output if T1 T3 < 0 and T2 T4 < 0. If a sum is zero, all links
    can lie in one great circle (class change-point). Otherwise the classes are:

    ===================  ====================  =============  =============
    input turns fully    output turns fully    T1 T2 T3 T4    class
    ===================  ====================  =============  =============
    yes                  yes                   positive       double-crank
    yes                  no                    positive       crank-rocker
    no                   yes                   positive       rocker-crank
    no                   no                    positive       double-rocker
    no                   no                    negative       triple-rocker
    ===================  ====================  =============  =============

    Parameters
    ----------
    g, a, h, b
        (n,) arcs (rad) of fixed link, input, coupler and output.

    Returns
    -------
    (n,) names of classes, as in `Grashof`.
    """
    g, a, h, b = (np.asarray(arc, dtype=float) for arc in (g, a, h, b))
    # The sums T1 to T4 of McCarthy and Soh.
    t1 = g - a + h - b
    t2 = g - a - h + b
    t3 = h + b - g - a
    t4 = 2.0 * np.pi - g - a - h - b
    sums = np.stack([t1, t2, t3, t4])
    input_turns_fully = (t1 * t2 > 0.0) & (t3 * t4 > 0.0)
    output_turns_fully = (t1 * t3 < 0.0) & (t2 * t4 < 0.0)
    # The first condition that is fulfilled decides.
    return np.select(
        [
            np.min(np.abs(sums), axis=0) < CHANGE_POINT_TOLERANCE_RAD,
            input_turns_fully & output_turns_fully,
            input_turns_fully,
            output_turns_fully,
            np.prod(sums, axis=0) > 0.0,
        ],
        ["change-point", "double-crank", "crank-rocker", "rocker-crank", "double-rocker"],
        "triple-rocker",
    )
