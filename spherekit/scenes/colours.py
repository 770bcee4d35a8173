"""Colours on the dark background, most of which are told apart with colour blindness, too.

The first link colours after the grey of the ground are five of the set of Okabe and Ito
(2008), in part lightened for a dark background. Its yellow and orange are left out, since
pole axes have similar colours. Three further colours follow.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from spherekit.arrays import Floats

Colour = tuple[int, int, int]
"""Red, green and blue from 0 to 255."""

BACKGROUND: Colour = (20, 22, 30)
"""Colour behind everything."""

GRATICULE: Colour = (62, 68, 90)
"""Colour of the meridians and parallels of the sphere."""

SPHERE = (60, 70, 100, 120)
"""Colour of the sphere; the last number is its opacity from 0 to 255."""

GOLD: Colour = (255, 196, 0)
BRONZE: Colour = (122, 98, 34)
SILVER: Colour = (165, 170, 184)
VIOLET: Colour = (128, 104, 184)
PALE: Colour = (232, 234, 240)
WARNING: Colour = (255, 120, 90)

LINK_COLOURS: tuple[Colour, ...] = (
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
"""Colours of links: the first is for the ground, the remaining colours repeat."""

TONES: tuple[Colour, ...] = (
    PALE,
    LINK_COLOURS[1],
    LINK_COLOURS[2],
    LINK_COLOURS[4],
    LINK_COLOURS[3],
    LINK_COLOURS[5],
)
"""Colours of the kinds of curves and marks, by their `tone`."""

HEAT_COLOURS: tuple[Colour, ...] = (
    (68, 1, 84),
    (59, 82, 139),
    (33, 145, 140),
    (94, 201, 98),
    (253, 231, 37),
)
"""Five colours, from low to high values, of a map.

They are from the map viridis of S. van der Walt and N. Smith (2015).
"""

LIGHTENING_BASE = 0.55
"""Part of the distance to white that remains after each step of `lighten`.

Larger: the steps are less visible. Smaller: colours become white after fewer steps.
"""


def heat_colours(values: Floats, low: float = 0.0, high: float = 1.0) -> NDArray[np.uint8]:
    """Return the colours of values on a colour scale from low to high.

    Values beyond the scale get its first or last colour.

    Parameters
    ----------
    values
        (...) values. NaN counts as 0.
    low, high
        Values of the first and the last colour of the scale.

    Returns
    -------
    (..., 3) red, green and blue, from 0 to 255.
    """
    width = high - low if high > low else 1.0
    positions = (np.nan_to_num(values) - low) / width
    scale_positions = np.linspace(0.0, 1.0, len(HEAT_COLOURS))
    channels = [
        np.interp(positions, scale_positions, channel)
        for channel in np.transpose(HEAT_COLOURS)
    ]
    return np.round(np.stack(channels, axis=-1)).astype(np.uint8)


def tone_colour(number: int) -> Colour:
    """Return the colour of a kind of curve or mark, by the index of its tone."""
    return TONES[number % len(TONES)]


def link_colour(number: int) -> Colour:
    """Return the colour of a link, by its index in the mechanism; 0 is the ground."""
    return (
        LINK_COLOURS[1 + (number - 1) % (len(LINK_COLOURS) - 1)]
        if number
        else LINK_COLOURS[0]
    )


def series_colour(link: int | None, used_colours: Sequence[Colour]) -> Colour:
    """Return the colour of a curve in a plot.

    Parameters
    ----------
    link
        Index of the link to which the curve belongs. The curve gets the colour of this
        link. With None the curve gets a colour that the plot does not have yet, if there is
        one.
    used_colours
        Colours of the curves that are already in the plot.
    """
    if link is not None:
        return link_colour(link)
    # The first colour, the grey of the ground, is not used for other curves.
    unused_colours = [colour for colour in LINK_COLOURS[1:] if colour not in used_colours]
    if unused_colours:
        return unused_colours[0]
    # All colours are used, so they are repeated in their order by `link_colour`. Its number
    # 0 is the ground, so numbers of curves begin at 1.
    curve_number = len(used_colours) + 1
    return link_colour(curve_number)


def lighten(colour: Colour, steps: int) -> Colour:
    """Return a colour mixed with white, more so for more steps; 0 steps change nothing."""
    white_part = 1.0 - LIGHTENING_BASE**steps
    red, green, blue = (round(channel + (255 - channel) * white_part) for channel in colour)
    return red, green, blue
