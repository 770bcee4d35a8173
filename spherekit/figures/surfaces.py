"""Triangulated surfaces in a space of three quantities."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from spherekit.analysis.plotted import map_range
from spherekit.analysis.scene import Surface, titled
from spherekit.figures import style
from spherekit.figures.sdk import Figure, Normalize, Poly3DCollection
from spherekit.figures.sheet import Sheet, ends, stroke, ticks_of


def draw_surfaces(surfaces: Sequence[Surface], sheet: Sheet) -> Figure:
    """Return a figure of surfaces in the same space."""
    meshed = [item for item in surfaces if len(item.triangles)]
    clouds = [item for item in surfaces if not len(item.triangles)]
    entries = [
        (item.label, stroke(style.tone_colour(item.tone), width=4.0)) for item in meshed
    ]
    with style.look():
        size = min(sheet.width, 4.5)
        figure = sheet.figure(1, size, sheet.legend_rows(entries))
        panel: Any = figure.add_subplot(projection="3d")
        for surface in meshed:
            panel.add_collection3d(
                Poly3DCollection(
                    surface.vertices[surface.triangles],
                    facecolors=style.tone_colour(surface.tone),
                    alpha=0.6,
                    shade=True,
                    linewidths=0.0,
                )
            )
        for surface in clouds:
            if surface.values is None:
                panel.scatter(*surface.vertices.T, c=style.tone_colour(surface.tone), s=3.0)
                continue
            tint = Normalize(*map_range(surface.values, surface.values_unit))
            dots = panel.scatter(
                *surface.vertices.T, c=surface.values, norm=tint, cmap=style.HEAT, s=3.0
            )
            bar = figure.colorbar(
                dots,
                ax=panel,
                shrink=0.7,
                pad=0.12,
                aspect=28,
                extend=ends(surface.values, tint),
            )
            bar.set_label(titled(surface.label, surface.values_unit))
        every = np.concatenate([item.vertices for item in surfaces])
        first = surfaces[0]
        for which, name, column in zip("xyz", first.axes, every.T, strict=True):
            getattr(panel, f"set_{which}label")(titled(name, first.unit))
            getattr(panel, f"set_{which}lim")(np.nanmin(column), np.nanmax(column))
            ticks_of(panel, first.unit, which, 5)
        panel.set_box_aspect((1, 1, 1), zoom=0.85)
        sheet.legend(figure, entries)
    return figure
