"""What the gallery shows of a script: the figures that its blocks end with."""

import re
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt

import spherekit as sk
from site_pages.picture import draw


def last_figure(
    block: tuple[Any, ...], block_vars: dict[str, Any], gallery_conf: dict[str, Any]
) -> str:
    """Save the figure that a block ends with, after the script's picture in miniature."""
    from sphinx_gallery.scrapers import figure_rst

    figure = block_vars["example_globals"].get("___")
    if not hasattr(figure, "savefig"):
        return ""
    paths = block_vars["image_path_iterator"]
    if not len(paths):
        _thumbnail(figure, Path(block_vars["src_file"]), next(paths))
    path = next(paths)
    figure.savefig(path, dpi=130)
    return str(figure_rst([path], gallery_conf["src_dir"]))


def _thumbnail(figure: Any, script: Path, path: str) -> None:
    """Save the mechanism that a script names beside its figure's first panel."""
    figure.draw_without_rendering()  # so that panels are where they come to be
    panel = figure.axes[0].get_tightbbox().padded(4.0)
    box = panel.transformed(figure.dpi_scale_trans.inverted())
    figure.savefig(path, dpi=200, bbox_inches=box)
    named = re.findall(r'"(\w+)",', script.read_text("utf-8"))
    both = plt.figure(figsize=(4.8, 2.4))
    draw(both.add_axes((0.0, 0.02, 0.48, 0.96)), _driven(named), named=False)
    beside = both.add_axes((0.52, 0.02, 0.47, 0.96))
    beside.imshow(plt.imread(path), interpolation="antialiased")
    beside.axis("off")
    both.savefig(path, dpi=160)
    plt.close(both)


def _driven(named: list[str]) -> sk.Mechanism:
    return sk.load(next(name for name in named if name in sk.mechanisms()))
