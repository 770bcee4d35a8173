"""Makes figures for pages with a dark background.

Text, axes and halos exchange light and dark. Colours of curves keep their hue and become
lighter until they can be read. Images of colour maps stay as they are.
"""

import colorsys
import pickle
from typing import Any

import numpy as np

from spherekit.arrays import Floats
from spherekit.display.figures.matplotlib_sdk import Axes, Figure, to_rgba, to_rgba_array

DARK_BACKGROUND = (0.07, 0.08, 0.11)
"""Colour (red, green, blue) behind dark figures, by which contrasts are computed."""

DARK_INK_LIGHTNESS = 0.87
"""Lightness of text that is black in light figures."""

MIN_CONTRAST = 4.5
"""Least contrast of colours with the background, from the WCAG guidelines for text."""

MAX_GREY_SATURATION = 0.12
"""Largest difference between red, green and blue of a colour that counts as a grey.

Light and dark greys are exchanged.
"""

COLOUR_PROPERTIES = (
    "color",
    "facecolor",
    "edgecolor",
    "markerfacecolor",
    "markeredgecolor",
)
"""Properties of artists that are colours."""

LIGHTNESS_STEP = 0.02
"""Step in which colours become lighter until their contrast is sufficient."""


def dark_copy(figure: Figure) -> Figure:
    """Return a copy of a figure with a transparent background, for a dark page.

    Parameters
    ----------
    figure
        The figure. It is not changed.
    """
    dark: Figure = pickle.loads(pickle.dumps(figure))
    artists = {id(artist): artist for artist in dark.findobj()}.values()
    for artist in artists:
        # Panels and figure have no colours of their own, but their background patches have.
        if not isinstance(artist, Axes | Figure):
            _darken(artist)
    # Texts can share a halo (outline), which must be changed only once.
    effects = {
        id(effect): effect
        for artist in artists
        for effect in artist.get_path_effects() or ()
    }
    for effect in effects.values():
        _darken_halo(effect)
    # The first loop has replaced white by this colour. A background that was white becomes
    # transparent. Other backgrounds stay, because they mark where a colour map has no
    # values.
    darkened_white = _dark_rgba("white")
    for patch in (dark.patch, *(panel.patch for panel in dark.axes)):
        was_white = np.allclose(to_rgba(patch.get_facecolor()), darkened_white)
        if was_white:
            patch.set_alpha(0.0)
    return dark


def _darken_halo(effect: Any) -> None:
    """Replace the colour of a halo (outline of a text) by a colour for a dark background.

    matplotlib has no public way to change the colour, which is in the mapping `_gc`.
    """
    stroke = getattr(effect, "_gc", {})
    if "foreground" in stroke:
        stroke["foreground"] = _dark_rgba(stroke["foreground"])


def _darken(artist: Any) -> None:
    """Replace all colours of a drawn object by colours for a dark background.

    The object is an artist of matplotlib, such as a line, a text or a filled area. Each
    kind of artist has some of the properties in `COLOUR_PROPERTIES`.
    """
    # Colours that a colour map computes from values stay.
    if getattr(artist, "get_array", lambda: None)() is not None:
        return
    # Read all colours before changing any, since some are copies of others by default.
    colours = {
        name: getattr(artist, f"get_{name}")()
        for name in COLOUR_PROPERTIES
        if hasattr(artist, f"get_{name}") and hasattr(artist, f"set_{name}")
    }
    for name, colour in colours.items():
        set_colour = getattr(artist, f"set_{name}")
        if isinstance(colour, np.ndarray) and colour.ndim == 2:
            set_colour([_dark_rgba(tuple(row)) for row in to_rgba_array(colour)])
        elif isinstance(colour, str | tuple | np.ndarray):
            set_colour(_dark_rgba(colour))


def _dark_rgba(colour: Any) -> tuple[float, float, float, float]:
    """Return the colour that replaces a colour of a white page on a dark background.

    Greys exchange light and dark. Other colours become lighter until they can be read.

    Parameters
    ----------
    colour
        A colour in any form that matplotlib accepts.

    Returns
    -------
    Red, green, blue and opacity, from 0 to 1.
    """
    red, green, blue, alpha = to_rgba(colour)
    hue, lightness, saturation = colorsys.rgb_to_hls(red, green, blue)
    # In a grey, red, green and blue are nearly equal. The saturation of HLS would not show
    # this, since it is relative to the lightness.
    if max(red, green, blue) - min(red, green, blue) <= MAX_GREY_SATURATION:
        # White becomes the background, black the ink.
        background_lightness = np.mean(DARK_BACKGROUND)
        level = DARK_INK_LIGHTNESS + lightness * (background_lightness - DARK_INK_LIGHTNESS)
        return (float(level), float(level), float(level), alpha)
    while lightness < 1.0:
        dark = colorsys.hls_to_rgb(hue, lightness, saturation)
        if _contrast(dark) >= MIN_CONTRAST:
            break
        lightness += LIGHTNESS_STEP
    return (*colorsys.hls_to_rgb(hue, min(lightness, 1.0), saturation), alpha)


def _contrast(colour: tuple[float, float, float]) -> float:
    """Return the contrast of a colour with the background, as WCAG 2.1 defines it."""
    lighter, darker = sorted(
        (_luminance(np.array(colour)), _luminance(np.array(DARK_BACKGROUND))), reverse=True
    )
    return (lighter + 0.05) / (darker + 0.05)


def _luminance(colour: Floats) -> float:
    """Return the relative luminance of a colour in sRGB, from 0 to 1 (WCAG 2.1)."""
    linear = np.where(colour <= 0.04045, colour / 12.92, ((colour + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])
