"""What the gallery shows of a script: the figure that its last line is."""

from typing import Any


def last_figure(
    block: tuple[Any, ...], block_vars: dict[str, Any], gallery_conf: dict[str, Any]
) -> str:
    """Save the figure, or the figures by name, of a block; return what shows them."""
    from sphinx_gallery.scrapers import figure_rst

    last = block_vars["example_globals"].get("___")
    figures = [last] if hasattr(last, "savefig") else []
    paths = []
    for figure in figures:
        path = next(block_vars["image_path_iterator"])
        figure.savefig(path, dpi=130)
        paths.append(path)
    return str(figure_rst(paths, gallery_conf["src_dir"]))
