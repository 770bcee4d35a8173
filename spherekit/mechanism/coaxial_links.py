"""Links relative to which a wheel rotates about a line that is fixed in both.

A wheel and its carrier are joined by an R pair on the axis of the wheel, or by several
coaxial R pairs in a chain.
"""

from collections.abc import Hashable, Mapping
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from spherekit.arrays import Floats
from spherekit.geometry.vectors import cross

SAME_AXIS_RAD = 1e-9
"""Angle (rad) below which two axes are the same axis.

The number is also the gap (rad) below which two circles touch. Larger: axes that differ
slightly count as coaxial. Smaller: rounded axes in a file are not recognized as coaxial.
"""

PairName = TypeVar("PairName", bound=Hashable)
LinkName = TypeVar("LinkName", bound=Hashable)


class CoaxialLink(NamedTuple, Generic[PairName]):
    """A link relative to which a wheel rotates about a fixed line, the axis of the wheel.

    A chain of R pairs (hinges), all with this line as axis, joins the wheel to the link.

    Attributes
    ----------
    line
        (3,) unit vector of the line in the axes of this link.
    angle_signs
        The sign, 1.0 or -1.0, of each R pair of the chain. The rotations of the chain add
        up: the angle of the wheel about `line`, relative to this link, is the sum of the
        pair variables, each times its sign.
    path
        The R pairs of the chain, from the wheel to the link. Each pair has the side that is
        nearer to the wheel: 0 for its first link, 1 for its second.
    """

    line: Floats
    angle_signs: Mapping[PairName, float]
    path: tuple[tuple[PairName, int], ...]


def find_coaxial_links(
    links_by_pair: Mapping[PairName, tuple[LinkName, LinkName]],
    axes_by_pair: Mapping[PairName, tuple[Floats, Floats]],
    wheel: LinkName,
    wheel_line: Floats,
) -> dict[LinkName, CoaxialLink[PairName]]:
    """Find all links that coaxial R pairs join to a wheel, breadth first.

    Relative to each of these links the wheel rotates about one line, fixed in wheel and
    link. The R pairs (hinges) between wheel and link have this line as axis. The angle of
    the wheel is the sum of the pair variables, each with a sign. Such links can carry the
    wheel in a gear train.

    Parameters
    ----------
    links_by_pair
        The two links of each pair.
    axes_by_pair
        The unit axis (3,) of each R pair, in the axes of its first and its second link.
    wheel
        The link from which the search starts. The result contains the wheel, with an empty
        path.
    wheel_line
        (3,) unit vector along the axis of the wheel, in the axes of the wheel.

    Returns
    -------
    The links in the order in which they are reached. The path of a link has the R pairs
    from the wheel to it. Each pair has the side (0 for its first link, 1 for its second)
    that is nearer to the wheel.
    """
    reached: dict[LinkName, CoaxialLink[PairName]] = {
        wheel: CoaxialLink(wheel_line, {}, ())
    }
    queue = [wheel]
    for link in queue:  # new links are appended during the loop
        coaxial_link = reached[link]
        for pair, axes in axes_by_pair.items():
            if link not in links_by_pair[pair]:
                continue
            # The link that is reached already is on the near side of the pair (0 or 1).
            near_side = links_by_pair[pair].index(link)
            far_side = 1 - near_side
            next_link = links_by_pair[pair][far_side]
            is_coaxial = are_same_line(axes[near_side], coaxial_link.line)
            if next_link in reached or not is_coaxial:
                continue
            # 1 if the axis of the pair points along the line, -1 if it points against it.
            direction_sign = float(np.sign(axes[near_side] @ coaxial_link.line))
            # The pair variable is the angle of the second link relative to the first. The
            # required angle is the angle of the near link, with the wheel, relative to the
            # far link. The required angle is minus the pair variable if the near link is
            # the first one.
            if near_side == 1:
                sign = direction_sign
            else:
                sign = -direction_sign
            reached[next_link] = CoaxialLink(
                line=direction_sign * axes[far_side],
                angle_signs={**coaxial_link.angle_signs, pair: sign},
                path=(*coaxial_link.path, (pair, near_side)),
            )
            queue.append(next_link)
    return reached


def are_same_line(axis_a: Floats, axis_b: Floats) -> bool:
    """Return whether two unit vectors (3,) are on one line, in equal or opposite sense."""
    return bool(np.linalg.norm(cross(axis_a, axis_b)) < SAME_AXIS_RAD)
