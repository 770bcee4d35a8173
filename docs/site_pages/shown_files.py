"""The mechanism files that pages show, where code on the pages finds them."""

import re
from collections.abc import Iterator
from pathlib import Path

NAMED = re.compile(r"^```toml\n(# ([\w.]+\.toml)\n.*?)^```$", re.M | re.S)


def pages(home: Path) -> Iterator[tuple[str, str]]:
    """Yield every file with a name that a page shows."""
    for path in sorted(home.rglob("*.md")):
        for text, name in NAMED.findall(path.read_text("utf-8")):
            yield f"files/{name}", text
