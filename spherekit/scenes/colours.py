"""Colours on the dark background, told apart with any kind of colour vision.

The link colours are the set of Okabe and Ito (2008), lightened for a dark background
and without its yellow and orange, which are left to the pole axes.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from spherekit.arrays import Floats

Colour = tuple[int, int, int]

BACKGROUND: Colour = (20, 22, 30)
GRATICULE: Colour = (62, 68, 90)
SPHERE = (60, 70, 100, 120)
GOLD: Colour = (255, 196, 0)
BRONZE: Colour = (122, 98, 34)
SILVER: Colour = (165, 170, 184)
VIOLET: Colour = (128, 104, 184)
PALE: Colour = (232, 234, 240)
WARNING: Colour = (255, 120, 90)

LINKS: tuple[Colour, ...] = (
    (176, 182, 196),
    (86, 180, 233),
    (238, 108, 52),
    (32, 190, 142),
    (222, 136, 188),
    (104, 132, 245),
    (192, 206, 92),
    (150, 228, 244),
    (188, 132, 92),
)

TONES: tuple[Colour, ...] = (PALE, LINKS[1], LINKS[2], LINKS[4], LINKS[3], LINKS[5])


HEAT: tuple[Colour, ...] = (
    (68, 1, 84),
    (59, 82, 139),
    (33, 145, 140),
    (94, 201, 98),
    (253, 231, 37),
)
"""From low to high; the map viridis of S. van der Walt and N. Smith (2015), in five."""


def heat_of(values: Floats, low: float = 0.0, high: float = 1.0) -> NDArray[np.uint8]:
    """Return the colours (..., 3) of values (...) on a scale from low to high."""
    parts = (np.nan_to_num(values) - low) / (high - low if high > low else 1.0)
    places = np.linspace(0.0, 1.0, len(HEAT))
    columns = [np.interp(parts, places, channel) for channel in np.transpose(HEAT)]
    return np.round(np.stack(columns, axis=-1)).astype(np.uint8)


def tone(number: int) -> Colour:
    """Return the colour of a kind of curve or mark."""
    return TONES[number % len(TONES)]


def link_colour(number: int) -> Colour:
    """Return the colour of the link at position `number` of the mechanism."""
    return LINKS[1 + (number - 1) % (len(LINKS) - 1)] if number else LINKS[0]


def of_series(link: int | None, used: Sequence[Colour]) -> Colour:
    """Return the colour of a series: that of its link, or one that its plot lacks."""
    if link is not None:
        return link_colour(link)
    left = [colour for colour in LINKS[1:] if colour not in used]
    return left[0] if left else link_colour(len(used) + 1)


def shaded(colour: Colour, step: int) -> Colour:
    """Return `colour` mixed with white, more so for a larger `step`; 0 leaves it."""
    red, green, blue = (round(c + (255 - c) * (1.0 - 0.55**step)) for c in colour)
    return red, green, blue
