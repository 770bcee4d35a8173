"""Figures of pages, each in a version for the light and one for the dark theme."""

from pathlib import Path
from typing import Any

from docutils import nodes

from spherekit.display.figures.dark_figure import dark_copy

FIGURE_DPI = 130
"""Dots per inch of figures on pages."""


def save_versions(figure: Any, path: Path) -> tuple[Path, Path]:
    """Save a figure for both themes, and return the paths of the light and the dark image.

    Parameters
    ----------
    figure
        A figure of matplotlib.
    path
        Path of the light image. The dark one is named `NAME_dark.png`.
    """
    dark_path = path.with_name(f"{path.stem}_dark.png")
    figure.savefig(path, dpi=FIGURE_DPI)
    dark_copy(figure).savefig(dark_path, dpi=FIGURE_DPI)
    return path, dark_path


def image_nodes(uris: tuple[str, str], alt: str) -> list[nodes.Node]:
    """Return the images of a figure, of which the theme shows one.

    Parameters
    ----------
    uris
        Addresses of the light and of the dark image.
    alt
        Text for readers who do not see the image.
    """
    return [
        nodes.image(uri=uri, alt=alt, classes=[theme])
        for uri, theme in zip(uris, ("only-light", "only-dark"), strict=True)
    ]
