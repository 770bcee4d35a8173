"""Pages that lie in the root of the repository, with their links as the site needs them."""

import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parent.parent.parent
AT_HOME = {
    "README.md": "../index.md",
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
}
"""Where the site has what the root of the repository has."""


def pages() -> Iterator[tuple[str, str]]:
    """Yield what contributors read, and the changelog."""
    for name in ("CONTRIBUTING", "CHANGELOG"):
        text = (ROOT / f"{name}.md").read_text("utf-8")
        yield f"{name.lower()}.md", re.sub(r"\]\((?!\w+:)([^)\s#]+)", _moved, text)


def _moved(link: re.Match[str]) -> str:
    target = link[1]
    if target in AT_HOME:
        return f"]({AT_HOME[target]}"
    if target.startswith("docs/"):
        return f"](../{target.removeprefix('docs/')}"
    return f"](../../{target}"
