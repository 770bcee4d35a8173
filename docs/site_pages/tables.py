"""The tables of a page as data, so that figures show what the page says."""

from pathlib import Path

DOCS = Path(__file__).parent.parent


def table(page: str, heading: str) -> list[dict[str, str]]:
    """Return the rows of the first table below a heading, by the names of its columns."""
    text = (DOCS / page).read_text("utf-8")
    below = text.partition(f"\n## {heading}\n")[2]
    if not below:
        raise ValueError(f"{page} has no heading {heading!r}")
    lines = [line for line in below.partition("\n## ")[0].splitlines() if line[:1] == "|"]
    header, _, *rows = ([cell.strip() for cell in row[1:-1].split("|")] for row in lines)
    return [dict(zip(header, row, strict=True)) for row in rows]
