"""Tables and lists as HTML, for notebooks."""

from collections.abc import Iterable, Sequence
from typing import Any

from spherekit.escaping import html_text


def html_table(
    header: Sequence[str], rows: Iterable[Sequence[Any]], caption: str = ""
) -> str:
    """Return a table as HTML. All texts are escaped.

    Parameters
    ----------
    header
        Titles of the columns.
    rows
        Cells of each row: texts or numbers.
    caption
        Caption of the table, or empty.
    """
    head = "".join(f"<th>{html_text(title)}</th>" for title in header)
    body = "".join(
        "<tr>" + "".join(f"<td>{html_text(cell_text(cell))}</td>" for cell in row) + "</tr>"
        for row in rows
    )
    caption_html = f"<caption>{html_text(caption)}</caption>" if caption else ""
    head_html = f"<thead><tr>{head}</tr></thead>"
    return f"<table>{caption_html}{head_html}<tbody>{body}</tbody></table>"


def html_list(title: str, lines: Sequence[str]) -> str:
    """Return a list with a title as HTML, escaped; an empty text without lines."""
    if not lines:
        return ""
    items = "".join(f"<li>{html_text(line)}</li>" for line in lines)
    return f"<p><b>{html_text(title)}</b></p><ul>{items}</ul>"


def cell_text(value: Any) -> str:
    """Return the value of a cell as text; numbers have six digits."""
    return f"{value:.6g}" if isinstance(value, float) else str(value)
