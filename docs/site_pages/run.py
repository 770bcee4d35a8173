"""The directive `run`: code on a page, executed, with what it prints and draws."""

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
        try:
            with (
                contextlib.redirect_stdout(printed),
                _inside(Path(self.env.srcdir) / FILES),
            ):
                exec(
                    compile(code, f"{self.env.docname}, line {self.lineno}", "exec"), names
                )
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
        return shown + self._figures(code)

    def _figures(self, code: str) -> list[nodes.Node]:
        import matplotlib.pyplot as plt

        home = Path(self.env.srcdir) / FIGURES
        home.mkdir(parents=True, exist_ok=True)
        key = hashlib.sha256(f"{self.env.docname}\n{code}".encode()).hexdigest()[:16]
        images: list[nodes.Node] = []
        for number in plt.get_fignums():
            path = home / f"{key}-{number}.png"
            figure = plt.figure(number)
            figure.savefig(path, dpi=130)
            plt.close(figure)
            alt = self.options.get("alt", "figure made by the code above")
            images.append(nodes.image(uri=f"/{FIGURES}/{path.name}", alt=alt))
        return images


@contextlib.contextmanager
def _inside(folder: Path) -> Any:
    folder.mkdir(parents=True, exist_ok=True)
    before = Path.cwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)
