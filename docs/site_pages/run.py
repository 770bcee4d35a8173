"""The directive `run`: code on a page, executed, with what it prints and draws."""

import ast
import contextlib
import hashlib
import io
import os
from pathlib import Path
from typing import Any, ClassVar

from docutils import nodes
from docutils.parsers.rst import directives
from sphinx.util.docutils import SphinxDirective
from sphinx.util.typing import OptionSpec

from site_pages.figures import image_nodes, save_versions

FIGURES = "generated/figures"
FILES = "generated/files"
"""Where the code runs: the folder with the files that pages show."""


class Run(SphinxDirective):
    """Executes its content as Python, in one namespace a page."""

    has_content = True
    option_spec: ClassVar[OptionSpec] = {
        "hide": directives.flag,
        "alt": directives.unchanged,
    }

    def run(self) -> list[nodes.Node]:
        """Return the code, what it printed, and its figures."""
        code = "\n".join(self.content)
        names = self.env.current_document.setdefault("names_of_code", {"__name__": "page"})
        printed = io.StringIO()
        earlier_figures = _bound_figures(names)
        try:
            with (
                contextlib.redirect_stdout(printed),
                _inside(Path(self.env.srcdir) / FILES),
            ):
                last = _run(code, f"{self.env.docname}, line {self.lineno}", names)
        except Exception as problem:
            raise self.error(f"the code does not run: {problem!r}") from problem
        shown: list[nodes.Node] = []
        if "hide" not in self.options:
            shown.append(nodes.literal_block(code, code, language="python"))
        if printed.getvalue():
            text = printed.getvalue().rstrip()
            shown.append(
                nodes.literal_block(text, text, language="text", classes=["printed"])
            )
        new_figures = [x for x in _bound_figures(names) if x not in earlier_figures]
        return shown + self._figures(code, [last, *new_figures])

    def _figures(self, code: str, candidates: list[Any]) -> list[nodes.Node]:
        """Return the open figures of pyplot, and the figures among the candidates."""
        import matplotlib.pyplot as plt

        figures = [plt.figure(number) for number in plt.get_fignums()]
        for candidate in candidates:
            if hasattr(candidate, "savefig") and candidate not in figures:
                figures.append(candidate)

        home = Path(self.env.srcdir) / FIGURES
        home.mkdir(parents=True, exist_ok=True)
        key = hashlib.sha256(f"{self.env.docname}\n{code}".encode()).hexdigest()[:16]
        images: list[nodes.Node] = []
        for number, figure in enumerate(figures):
            path = home / f"{key}-{number}.png"
            light, dark = save_versions(figure, path)
            alt = self.options.get("alt", "figure made by the code above")
            uris = (f"/{FIGURES}/{light.name}", f"/{FIGURES}/{dark.name}")
            images += image_nodes(uris, alt)
        plt.close("all")
        return images


def _bound_figures(names: dict[str, Any]) -> list[Any]:
    """Return the figures of matplotlib to which code gave a name."""
    from matplotlib.figure import Figure

    return [value for value in names.values() if isinstance(value, Figure)]


def _run(code: str, name: str, names: dict[str, Any]) -> Any:
    """Execute the code and return the value of its last line, if that is an expression."""
    parts = ast.parse(code, name).body
    last = parts.pop() if parts and isinstance(parts[-1], ast.Expr) else None
    exec(compile(ast.Module(parts, []), name, "exec"), names)
    return eval(compile(ast.Expression(last.value), name, "eval"), names) if last else None


@contextlib.contextmanager
def _inside(folder: Path) -> Any:
    folder.mkdir(parents=True, exist_ok=True)
    before = Path.cwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)
