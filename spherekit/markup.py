"""Tables and lists as HTML, for notebooks."""

from collections.abc import Iterable, Sequence
from typing import Any

from spherekit.escaping import html_text

CAPTION_STYLE = (
    "caption-side: top; text-align: left; color: inherit; font-weight: 600; "
    "white-space: nowrap; padding: 0.3em 0"
)
"""Style of captions.

Notebooks would centre captions in the colour of remarks, and break them at the width of the
table.
"""

CELL_STYLE = "padding: 0.2em 0.7em"
"""Style of cells, with a distance between columns."""


def html_table(
    header: Sequence[str],
    rows: Iterable[Sequence[Any]],
    caption: str = "",
    note: str = "",
    is_centred: bool = False,
) -> str:
    """Return a table as HTML. All texts are escaped.

    Texts are aligned at the left and numbers at the right. Notebooks would align all cells
    at the right.

    Parameters
    ----------
    header
        Titles of the columns.
    rows
        Cells of each row: texts or numbers.
    caption
        Caption of the table, or empty.
    note
        Explanation below the table, or empty.
    is_centred
        Whether all cells are centred, such as in a square table of marks.
    """
    row_list = [list(row) for row in rows]
    alignments = ["center" if is_centred else "left"] * len(header)
    # The first row shows whether a column has numbers or texts.
    if row_list and not is_centred:
        alignments = [
            "right" if isinstance(cell, int | float) else "left" for cell in row_list[0]
        ]

    def row_html(tag: str, cells: Sequence[Any]) -> str:
        """Return a row of the head (tag th) or of the body (tag td)."""
        cells_html = ""
        for cell, alignment in zip(cells, alignments, strict=True):
            style = f"{CELL_STYLE}; text-align: {alignment}"
            cells_html += f'<{tag} style="{style}">{html_text(cell_text(cell))}</{tag}>'
        return f"<tr>{cells_html}</tr>"

    head_html = f"<thead>{row_html('th', header)}</thead>"
    body = "".join(row_html("td", row) for row in row_list)
    caption_html = ""
    if caption:
        caption_html = f'<caption style="{CAPTION_STYLE}">{html_text(caption)}</caption>'
    note_html = f"<p>{html_text(note)}</p>" if note else ""
    # Pages of Sphinx show tables of this class in the colours of their theme.
    table_html = f"{caption_html}{head_html}<tbody>{body}</tbody>"
    return f'<table class="dataframe">{table_html}</table>{note_html}'


def html_list(title: str, lines: Sequence[str]) -> str:
    """Return a list with a title as HTML, escaped; an empty text without lines."""
    if not lines:
        return ""
    items = "".join(f"<li>{html_text(line)}</li>" for line in lines)
    return f"<p><b>{html_text(title)}</b></p><ul>{items}</ul>"


def cell_text(value: Any) -> str:
    """Return the value of a cell as text; a float has six significant digits."""
    return f"{value:.6g}" if isinstance(value, float) else str(value)
