"""Triangulated surfaces in a space of three quantities."""

from collections.abc import Sequence
from typing import Any

from spherekit.display.figures import style
from spherekit.display.figures.matplotlib_sdk import Figure, Normalize
from spherekit.display.figures.sheet import Sheet, colour_bar
from spherekit.display.figures.style import Look
from spherekit.escaping import plot_text
from spherekit.scenes.plot_layout import choose_map_range
from spherekit.scenes.scene import Surface, title_with_unit


def draw_surfaces(surfaces: Sequence[Surface], sheet: Sheet) -> Figure:
    """Return a figure of surfaces in the same space."""
    with style.look():
        figure = sheet.figure(1, min(sheet.width, 4.5))
        panel: Any = figure.add_subplot(projection="3d")
        for surface in surfaces:
            colour, values = style.tone_colour(surface.tone), surface.values
            x, y, z = surface.vertices.T
            if len(surface.triangles):
                look: Look = {"color": colour, "alpha": 0.6, "linewidth": 0.0}
                panel.plot_trisurf(x, y, z, triangles=surface.triangles, **look)
                # An empty curve: what the legend takes for the surface.
                panel.plot([], [], [], color=colour, label=plot_text(surface.label))
            elif values is None:
                panel.scatter(x, y, z, c=colour, s=3.0)
            else:
                tint = Normalize(*choose_map_range(values, surface.values_unit))
                panel.scatter(x, y, z, s=3.0, c=values, norm=tint, cmap=style.HEAT)
                words = title_with_unit(surface.label, surface.values_unit)
                colour_bar(figure, panel, values, tint, style.HEAT, words, 0.12)
        first = surfaces[0]
        x, y, z = (plot_text(title_with_unit(name, first.unit)) for name in first.axes)
        panel.set(xlabel=x, ylabel=y, zlabel=z)
        panel.set_box_aspect((1, 1, 1), zoom=0.85)
        return sheet.name(figure)
