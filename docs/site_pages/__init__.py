"""Pages of the site that are made from the package when Sphinx starts."""

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import matplotlib
from numpy.typing import ArrayLike
from sphinx.util.typing import stringify_annotation

from site_pages import (
    analyses,
    api,
    commands,
    mechanisms,
    messages,
    moving,
    root_pages,
    run,
    shown_files,
)

FOLDER = "generated"
ARRAY_LIKE = stringify_annotation(ArrayLike, "smart")
"""The types that NumPy accepts as an array, as Sphinx writes them in signatures."""


def begin(app: Any, config: Any) -> None:
    """Begin the pages of mechanisms, in other processes, and write all others."""
    home = Path(app.srcdir)
    (home / moving.HOME).mkdir(parents=True, exist_ok=True)
    app.site_mechanisms = mechanisms.pages(home, config.site_mechanisms, app.parallel)
    for part in (analyses, api, commands, messages, root_pages):
        _write(home, part.pages())
    _write(home, shown_files.pages(home))


def end(app: Any) -> None:
    """Write the pages of mechanisms, which were made while the gallery ran."""
    _write(Path(app.srcdir), app.site_mechanisms())


def _write(home: Path, pages: Iterable[tuple[str, str]]) -> None:
    """Write pages into `generated/`; what did not change keeps its date."""
    written = {home / FOLDER / name: text for name, text in pages}
    for path, text in written.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.exists() or path.read_text("utf-8") != text:
            path.write_text(text, "utf-8")
    for folder in {path.parent for path in written} - {home / FOLDER}:
        for path in {*folder.glob("*.md"), *folder.glob("*.rst")} - {*written}:
            path.unlink()  # of a mechanism or a name that is no more


def plain_signature(
    app: Any, what: str, name: str, value: Any, options: Any, signature: str, result: str
) -> tuple[str, str] | None:
    """Return the signature of an object in words that Sphinx and people can read.

    Python writes ``<factory>`` for a default that is made anew for each object. Sphinx does
    not read this and would print the whole signature as it is. `ArrayLike` is a union of
    many types that are private to NumPy, so its name is better.
    """
    if not signature:
        return None
    signature = signature.replace("<factory>", "...")
    return signature.replace(ARRAY_LIKE, "~numpy.typing.ArrayLike"), result


API_LINK = re.compile(r"(generated/api/([\w.]+?)(?:-class|-function)?\.html)#([\w.]+)")
"""A link to an object on its page in the API: address, name of the object, anchor."""


def repair_links_from_source_code(
    app: Any, page: str, template: str, context: dict[str, Any], doctree: Any
) -> None:
    """Let pages of source code link to objects by the package that exports them.

    Sphinx assumes that all objects of a module are exported by one package. The exceptions
    of `spherekit.errors` are exported by `spherekit` and by `spherekit.plugin`.
    """
    if not page.startswith("_modules/") or "body" not in context:
        return

    def repair(link: re.Match[str]) -> str:
        """Return the link with the package in the name of the page."""
        address, object_name, anchor = link.groups()
        package, _, name = object_name.rpartition(".")
        member = anchor.partition(f".{name}")[2]
        return f"{address}#{package}.{name}{member}"

    context["body"] = API_LINK.sub(repair, context["body"])


def setup(app: Any) -> dict[str, Any]:
    """Make the pages before Sphinx looks for them, and run the code of the others."""
    app.add_config_value("site_mechanisms", [], "env", list)
    matplotlib.use("Agg")
    app.add_directive("run", run.Run)
    app.add_directive("moving", moving.Moving)
    app.connect("config-inited", begin)
    app.connect("autodoc-process-signature", plain_signature)
    app.connect("html-page-context", repair_links_from_source_code)
    app.connect("builder-inited", end, priority=900)
    app.extensions["sphinx-mathjax-offline"].parallel_read_safe = True  # adds one file
    return {"parallel_read_safe": True}
