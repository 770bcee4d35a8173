"""Figures of triangulated surfaces in a space of three quantities."""

from collections.abc import Sequence
from typing import Any

from spherekit.display.figures import style
from spherekit.display.figures.matplotlib_sdk import Figure, Normalize
from spherekit.display.figures.sheet import Sheet, add_colour_bar
from spherekit.display.figures.style import Look
from spherekit.escaping import plot_text
from spherekit.scenes.plot_layout import choose_map_range
from spherekit.scenes.scene import Surface, title_with_unit

MAX_HEIGHT_IN = 4.5
"""Largest height (inches) of the figure without its legend."""

COLOUR_BAR_DISTANCE = 0.12
"""Distance of the colour bar from the panel, beyond the labels of the panel's axis."""


def draw_surfaces(surfaces: Sequence[Surface], sheet: Sheet) -> Figure:
    """Return a figure of surfaces, or clouds of points, in one three-dimensional space.

    The axes of the space are three quantities, such as the three inputs of a mechanism.

    Parameters
    ----------
    surfaces
        The surfaces as triangles. A surface without triangles is a cloud of points, which
        may have values that are drawn in colours.
    sheet
        Size of the figure.
    """
    with style.look():
        figure = sheet.make_figure(1, min(sheet.width, MAX_HEIGHT_IN))
        panel: Any = figure.add_subplot(projection="3d")
        for surface in surfaces:
            colour = style.tone_colour(surface.tone)
            values = surface.values
            x, y, z = surface.vertices.T
            if len(surface.triangles):
                look: Look = {"color": colour, "alpha": 0.6, "linewidth": 0.0}
                panel.plot_trisurf(x, y, z, triangles=surface.triangles, **look)
                # The legend cannot show a surface, so an empty curve represents it.
                panel.plot([], [], [], color=colour, label=plot_text(surface.label))
            elif values is None:
                panel.scatter(x, y, z, c=colour, s=3.0)
            else:
                low, high = choose_map_range(values, surface.values_unit)
                colour_scale = Normalize(low, high)
                panel.scatter(
                    x, y, z, s=3.0, c=values, norm=colour_scale, cmap=style.HEAT_COLOUR_MAP
                )
                add_colour_bar(
                    figure,
                    panel,
                    values,
                    colour_scale,
                    style.HEAT_COLOUR_MAP,
                    title_with_unit(surface.label, surface.values_unit),
                    COLOUR_BAR_DISTANCE,
                )
        # All surfaces are in the same space, so the first one states the axes.
        first_surface = surfaces[0]
        x_label, y_label, z_label = (
            plot_text(title_with_unit(name, first_surface.unit))
            for name in first_surface.axes
        )
        panel.set(xlabel=x_label, ylabel=y_label, zlabel=z_label)
        panel.set_box_aspect((1, 1, 1), zoom=0.85)
        return sheet.add_legend(figure)
