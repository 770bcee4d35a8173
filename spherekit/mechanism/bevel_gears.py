"""Pitch cones of bevel gears, and the link that carries two gears.

Bevel gears are rolling contacts of two circles on the unit sphere, the pitch circles. The
half angle of a pitch cone is the radius (rad) of its circle.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple

import numpy as np

from spherekit.errors import ModelError
from spherekit.geometry.triangle import arc
from spherekit.mechanism.coaxial_links import CoaxialLink, find_coaxial_links
from spherekit.mechanism.joint import Ends, Links
from spherekit.mechanism.joint_construction import PROFILE_GAP_RAD
from spherekit.mechanism.pair_frames import COLLINEAR_SINE, LinkAxes, axis_in_link
from spherekit.tolerances import EPS

HALF_ANGLE_ROUNDING_RAD = 8 * EPS
"""Gap (rad) of two cones up to which their half angles are used exactly as given.

Larger: half angles with a gap of more than rounding stay as they are. Smaller: the second
half angle of a file is changed in its last digits.
"""


class GearShaft(NamedTuple):
    """The R pair (revolute joint) at the carrier, about which a gear rotates.

    In the axes of the carrier, the axis of the gear is `sense` (1 or -1) times the axis of
    `pair`.
    """

    pair: str
    sense: int


class GearCarrier(NamedTuple):
    """The link that carries the axes of two gears.

    Attributes
    ----------
    link
        Name of the carrier.
    shafts
        For each gear the R pair (hinge) at the carrier about which the gear rotates.
    shaft_angle
        Angle (rad) between the two axes, 0 to pi.
    """

    link: str
    shafts: list[GearShaft]
    shaft_angle: float


def pitch_angles(
    teeth: tuple[int, int], shaft_angle: float, contact: Literal["external", "internal"]
) -> Ends:
    """Return the half angles (rad) of the pitch cones of two bevel gears by their teeth.

    Parameters
    ----------
    teeth
        Numbers of teeth. In an internal contact the second gear is the ring.
    shaft_angle
        Angle between the axes (rad), 0 to pi.
    contact
        External: the cones are side by side, and their half angles add up to the shaft
        angle. Internal: the first cone rolls inside the second.

    Raises
    ------
    ModelError
        If no cones with these teeth touch at this shaft angle, or if both axes are on one
        line.

    Notes
    -----
    The half angles d1, d2 follow from sin d1 / sin d2 = N1 / N2, with d1 + d2 (external)
    or d2 - d1 (internal) equal to the shaft angle S:
    tan d1 = sin S / (N2 / N1 + cos S), or tan d1 = sin S / (N2 / N1 - cos S).
    """
    sign = 1.0 if contact == "external" else -1.0
    ratio = teeth[1] / teeth[0]
    first = math.atan2(math.sin(shaft_angle), ratio + sign * math.cos(shaft_angle))
    second = shaft_angle - sign * first
    has_two_cones = 0.0 < min(first, second) <= max(first, second) < math.pi
    if math.sin(shaft_angle) < COLLINEAR_SINE or not has_two_cones:
        raise ModelError(
            f"gears with {teeth[0]} and {teeth[1]} teeth have no pitch cones that touch "
            f"along a single line in {contact} contact at a shaft angle of "
            f"{math.degrees(shaft_angle):.6g} deg"
        )
    return first, second


def check_half_angles(
    half_angles: Sequence[float],
    shaft_angle: float,
    contact: Literal["external", "internal"],
) -> Ends:
    """Return the half angles d1 and d2 (rad) of two pitch cones that touch along a line.

    Parameters
    ----------
    half_angles
        Half angles of both cones (rad), between 0 and pi, or of only the first cone. If
        both are stated and miss contact by at most `PROFILE_GAP_RAD`, the second is
        replaced by the half angle that fits.
    shaft_angle
        Angle between the axes (rad), 0 to pi.
    contact
        External: d1 + d2 is the shaft angle. Internal: the first cone rolls inside the
        second, and d2 - d1 is the shaft angle.

    Raises
    ------
    ModelError
        If the cones do not touch at this shaft angle, or touch all round, or a half angle
        is out of range.
    """
    for half_angle in half_angles:
        if not 0.0 < half_angle < math.pi:
            raise ModelError(
                f"found a half angle of {_degrees_text(half_angle)} deg, expected more "
                "than 0 and less than 180 deg"
            )
    if math.sin(shaft_angle) < COLLINEAR_SINE:
        raise ModelError(
            f"the shaft angle is {_degrees_text(shaft_angle)} deg, but coaxial cones do "
            "not touch along a single line; choose another shaft angle"
        )
    first = half_angles[0]
    # In external contact d1 + d2 is the shaft angle, in internal contact d2 - d1.
    sign = 1.0 if contact == "external" else -1.0
    fitting_second = shaft_angle - sign * first
    if len(half_angles) == 1:
        if not 0.0 < fitting_second < math.pi:
            raise ModelError(
                f"at a shaft angle of {_degrees_text(shaft_angle)} deg no second cone "
                f"can touch a first one with a half angle of {_degrees_text(first)} deg "
                f"in {contact} contact: the second half angle would be "
                f"{_degrees_text(fitting_second)} deg"
            )
        return first, fitting_second
    second = half_angles[1]
    gap = abs(second - fitting_second)
    if gap > PROFILE_GAP_RAD:
        raise ModelError(
            f"the cones do not touch: the shaft angle is {_degrees_text(shaft_angle)} deg, "
            f"but half angles of {_degrees_text(first)} and {_degrees_text(second)} deg in "
            f"{contact} contact need {_degrees_text(second + sign * first)} deg, which "
            f"differs by {_degrees_text(gap)} deg. If you leave the second half angle out, "
            "it is computed"
        )
    # A half angle that differs by rounding only is returned unchanged.
    return first, second if gap <= HALF_ANGLE_ROUNDING_RAD else fitting_second


def find_gear_carrier(
    links_by_pair: Mapping[str, Links],
    axes: LinkAxes,
    gears: Links,
    shafts: Links,
) -> GearCarrier:
    """Find the link that carries the axes of two gears.

    A gear is joined to its carrier by its own R pair, or by a chain of coaxial R pairs. An
    example is a planetary train: the sun rotates about its shaft in the frame, and the arm,
    which carries the planet, rotates about a coaxial pair of the frame.

    Parameters
    ----------
    links_by_pair
        The two links of every R pair.
    axes
        The axis of every R pair in each of its links.
    gears
        Names of the two links that mesh.
    shafts
        Name of the R pair about which each gear rotates.

    Returns
    -------
    The carrier, the R pair at the carrier of each gear, and the angle between both axes. If
    several links carry both axes, the carrier is the one with the fewest pairs between it
    and the gears.

    Raises
    ------
    ModelError
        If no link carries both axes.
    """
    axes_by_pair = {
        pair: (axes[first_link][pair], axes[second_link][pair])
        for pair, (first_link, second_link) in links_by_pair.items()
    }
    # For each gear the links relative to which it rotates about a fixed line, by name.
    coaxial_links: list[dict[str, CoaxialLink[str]]] = [
        find_coaxial_links(
            links_by_pair, axes_by_pair, gear, np.array(axis_in_link(axes, gear, shaft))
        )
        for gear, shaft in zip(gears, shafts, strict=True)
    ]
    first_links, second_links = coaxial_links
    carriers = [link for link in first_links if link in second_links and link not in gears]
    if not carriers:
        raise ModelError(
            f'R pairs "{shafts[0]}" and "{shafts[1]}" do not join the gears to a common '
            "link, nor does a pair coaxial with one of them; name the pairs whose axes one "
            "link carries, or give each gear its circle under profiles"
        )
    carrier = min(
        carriers, key=lambda link: len(first_links[link].path + second_links[link].path)
    )
    gear_shafts = []
    for links in coaxial_links:
        # The last pair on the path from the gear to the carrier. `near_side` is 0 or 1 if
        # the gear is on the side of the first or the second link of the pair.
        pair, near_side = links[carrier].path[-1]
        angle_sign = int(links[carrier].angle_signs[pair])
        # The sign is that of the angle of the gear relative to the carrier. The pair
        # variable is the angle of the second link relative to the first.
        gear_is_on_second_side = near_side == 1
        sense = angle_sign if gear_is_on_second_side else -angle_sign
        gear_shafts.append(GearShaft(pair, sense))
    shaft_angle = float(arc(first_links[carrier].line, second_links[carrier].line))
    return GearCarrier(carrier, gear_shafts, shaft_angle)


def _degrees_text(angle: float) -> str:
    """Return an angle (rad) in degrees, with nine digits."""
    return f"{math.degrees(angle):.9g}"
