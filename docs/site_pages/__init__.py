"""Pages of the site that are made from the package when Sphinx starts."""

from pathlib import Path
from typing import Any

import matplotlib

from site_pages import analyses, api, mechanisms, messages, root_pages, shown_files
from site_pages.run import Run

FOLDER = "generated"


def make(app: Any, config: Any) -> None:
    """Write all pages into `generated/`; what did not change keeps its date."""
    home = Path(app.srcdir) / FOLDER
    written = set()
    for part in (
        mechanisms.pages(Path(app.srcdir), config.site_mechanisms),
        analyses.pages(),
        api.pages(),
        messages.pages(),
        root_pages.pages(),
        shown_files.pages(Path(app.srcdir)),
    ):
        for name, text in part:
            _write(home / name, text)
            written.add(home / name)
    for path in home.rglob("*.*"):
        if path.suffix in (".md", ".rst") and path not in written:
            path.unlink()  # of a mechanism or a name that is no more


def _write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    if not path.exists() or path.read_text("utf-8") != text:
        path.write_text(text, "utf-8")


def setup(app: Any) -> dict[str, Any]:
    """Make the pages before Sphinx looks for them, and run the code of the others."""
    app.add_config_value("site_mechanisms", [], "env", list)
    matplotlib.use("Agg")
    app.add_directive("run", Run)
    app.connect("config-inited", make)
    return {"parallel_read_safe": True}
