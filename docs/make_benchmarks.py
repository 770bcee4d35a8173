"""Write docs/benchmarks.md from the record of the benchmarks.

In the root of the repository ``python -m benchmarks --add docs/benchmarks.json`` measures
again; then run ``python docs/make_benchmarks.py``.
"""

import sys
from pathlib import Path

DOCS = Path(__file__).parent
PAGE, RECORD = DOCS / "benchmarks.md", DOCS / "benchmarks.json"
sys.path.insert(0, str(DOCS.parent))

from benchmarks.page import page_text, read_record  # noqa: E402


def page() -> str:
    """Return the text of the page."""
    return page_text(read_record(RECORD))


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
