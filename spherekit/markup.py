"""Tables for the pages of notebooks."""

from collections.abc import Iterable, Sequence
from typing import Any

from spherekit.escaping import html_text


def html_table(
    header: Sequence[str], rows: Iterable[Sequence[Any]], caption: str = ""
) -> str:
    """Return a table as HTML, every text in it escaped."""
    head = "".join(f"<th>{html_text(title)}</th>" for title in header)
    body = "".join(
        "<tr>" + "".join(f"<td>{html_text(shown(cell))}</td>" for cell in row) + "</tr>"
        for row in rows
    )
    words = f"<caption>{html_text(caption)}</caption>" if caption else ""
    return f"<table>{words}<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def html_list(title: str, lines: Sequence[str]) -> str:
    """Return a titled list as HTML, escaped; nothing without lines."""
    if not lines:
        return ""
    items = "".join(f"<li>{html_text(line)}</li>" for line in lines)
    return f"<p><b>{html_text(title)}</b></p><ul>{items}</ul>"


def shown(value: Any) -> str:
    """Return a value of a table as text, numbers with six digits."""
    return f"{value:.6g}" if isinstance(value, float) else str(value)
