"""Bevel gears as rolling cones: pitch cones from numbers of teeth and the shaft angle."""

import math
from collections.abc import Mapping
from typing import Literal

import numpy as np

from spherekit.conventions import listing, nearest
from spherekit.errors import ModelError
from spherekit.model.geometry import axes_from_sizes
from spherekit.model.mechanism import LinkSizes, PoseGeometry, SizeGeometry
from spherekit.sphere.rotation import Floats, arc

Vector = tuple[float, float, float]


def pitch_angles(
    teeth: tuple[int, int], shaft_angle: float, contact: Literal["external", "internal"]
) -> tuple[float, float]:
    """Return the half angles (rad) of the pitch cones of two bevel gears.

    Parameters
    ----------
    teeth
        Numbers of teeth; of an internal pair the ring comes second.
    shaft_angle
        Angle between the axes (rad), 0 to pi.
    contact
        External: the cones lie beside each other and their half angles add up to the
        shaft angle. Internal: the first rolls inside the second.

    Raises
    ------
    ModelError
        If no cones with these teeth touch at this shaft angle.

    Notes
    -----
    sin d1 / sin d2 = N1 / N2 with d1 + d2 or d2 - d1 equal to the shaft angle:
    tan d1 = sin S / (N2 / N1 + cos S), or tan d1 = sin S / (N2 / N1 - cos S).
    """
    sense = 1.0 if contact == "external" else -1.0
    ratio = teeth[1] / teeth[0]
    first = math.atan2(math.sin(shaft_angle), ratio + sense * math.cos(shaft_angle))
    second = shaft_angle - first if contact == "external" else shaft_angle + first
    if not (0.0 < first < math.pi and 0.0 < second < math.pi):
        raise ModelError(
            f"gears with {teeth[0]} and {teeth[1]} teeth have no pitch cones that touch in "
            f"{contact} contact at a shaft angle of {math.degrees(shaft_angle):.6g} deg"
        )
    return first, second


def gear_axes(
    geometry: SizeGeometry | PoseGeometry,
    joined: Mapping[str, tuple[str, str]],
    links: tuple[str, str],
    axes: tuple[str, str],
) -> tuple[tuple[Vector, Vector], float]:
    """Return the gears' axes in their links, and the shaft angle (rad) between them.

    `joined` holds the two links of every R pair, `links` the two gears, `axes` the R pairs
    they turn about; both pairs must join their gear to one common link.
    """
    for link, axis in zip(links, axes, strict=True):
        if axis not in joined:
            raise ModelError(
                f'no R pair is named "{axis}"{nearest(axis, joined) or ";"} R pairs: '
                f"{listing(joined)}"
            )
        if link not in joined[axis]:
            raise ModelError(f'R pair "{axis}" is not on gear "{link}"')
    carriers = [set(joined[a]) - {link} for a, link in zip(axes, links, strict=True)]
    common = carriers[0] & carriers[1]
    if not common:
        raise ModelError(
            f'R pairs "{axes[0]}" and "{axes[1]}" do not join the gears to a common link'
        )
    carrier = common.pop()

    def direction(link: str, axis: str) -> Floats:
        if isinstance(geometry, PoseGeometry):
            axes = {name: np.array(given) for name, given in geometry.axes.items()}
        else:
            axes = axes_from_sizes(geometry.links.get(link, LinkSizes(())))
        if axis not in axes:
            raise ModelError(f'the axis of pair "{axis}" is not given in link "{link}"')
        return axes[axis]

    shaft_angle = float(arc(direction(carrier, axes[0]), direction(carrier, axes[1])))
    first, second = (direction(k, a) for k, a in zip(links, axes, strict=True))
    return (_vector(first), _vector(second)), shaft_angle


def _vector(axis: Floats) -> Vector:
    x, y, z = axis
    return float(x), float(y), float(z)
