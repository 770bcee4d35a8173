"""What the gallery shows of a script: the figures that its blocks end with."""

import io
import pickle
import re
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt

import spherekit as sk
from site_pages.figures import save_versions
from site_pages.picture import draw
from spherekit.display.figures import style


def last_figure(
    block: tuple[Any, ...], block_vars: dict[str, Any], gallery_conf: dict[str, Any]
) -> str:
    """Save the figure that a block ends with, after the script's picture in miniature."""
    figure = block_vars["example_globals"].get("___")
    if not hasattr(figure, "savefig"):
        return ""
    paths = block_vars["image_path_iterator"]
    if not len(paths):
        _thumbnail(figure, Path(block_vars["src_file"]), next(paths))
    light, dark = save_versions(figure, Path(next(paths)))
    # The directive `image-sg` of sphinx-gallery would drop the class of the theme.
    return "\n".join(
        IMAGE.format(
            uri="/" + path.relative_to(gallery_conf["src_dir"]).as_posix(),
            alt=f"Figure that the code of {Path(block_vars['src_file']).name} draws",
            theme=theme,
        )
        for path, theme in ((light, "only-light"), (dark, "only-dark"))
    )


IMAGE = """\
.. image:: {uri}
   :alt: {alt}
   :class: {theme}

"""
"""Image of a figure that one theme shows, in reStructuredText."""

THUMBNAIL_SIZE_IN = (4.8, 2.4)
"""Width and height (inches) of a thumbnail."""

THUMBNAIL_LINE_PT = 3.0
"""Width (points) of curves in thumbnails, which are shown at half their size or less."""

NEUTRAL = "0.5"
"""Colour of axes in thumbnails, a grey that is visible on light and on dark pages."""


def _thumbnail(figure: Any, script: Path, path: str) -> None:
    """Save the mechanism that a script names beside the first panel of its figure.

    Text could not be read at the size of a thumbnail, so the panel has none. The background
    is transparent, because the theme of the page may be light or dark.
    """
    named = re.findall(r'"(\w+)",', script.read_text("utf-8"))
    both = plt.figure(figsize=THUMBNAIL_SIZE_IN)
    draw(both.add_axes((0.0, 0.03, 0.47, 0.94)), _driven(named), named=False)
    drawn_panel = io.BytesIO()
    _without_text(figure).savefig(drawn_panel, dpi=200, transparent=True)
    drawn_panel.seek(0)
    beside = both.add_axes((0.5, 0.03, 0.5, 0.94))
    beside.imshow(plt.imread(drawn_panel), interpolation="antialiased")
    beside.axis("off")
    both.savefig(path, dpi=160, transparent=True)
    plt.close(both)


def _without_text(figure: Any) -> Any:
    """Return a copy of a figure with its first panel alone, thick lines and no text."""
    small = pickle.loads(pickle.dumps(figure))
    panel, *others = small.axes
    for part in (*others, *small.legends, *small.texts):
        part.remove()
    small.suptitle("")
    small.supylabel("")
    small.supxlabel("")
    small.set_layout_engine("none")
    small.set_size_inches(THUMBNAIL_SIZE_IN[0] / 2, THUMBNAIL_SIZE_IN[1])
    panel.set_position((0.04, 0.04, 0.92, 0.92))
    panel.set_anchor("C")
    panel.set(title="", xlabel="", ylabel="")
    panel.tick_params(labelbottom=False, labelleft=False, length=0.0, which="both")
    panel.set_facecolor("none")
    for text in panel.texts:
        text.set_visible(False)
    if panel.get_legend() is not None:
        panel.get_legend().remove()
    for spine in panel.spines.values():
        spine.set(color=NEUTRAL, linewidth=1.5)
    for line in panel.lines:
        line.set_linewidth(THUMBNAIL_LINE_PT if len(line.get_xdata()) > 2 else 1.0)
        if line.get_color() in (style.INK, style.FAINT):
            line.set_color(NEUTRAL)
    return small


def _driven(named: list[str]) -> sk.Mechanism:
    return sk.load(next(name for name in named if name in sk.mechanisms()))
