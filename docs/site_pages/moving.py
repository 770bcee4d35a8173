"""The directive `moving`: a mechanism that the reader moves, with its picture behind."""

from pathlib import Path
from typing import ClassVar

from docutils import nodes
from docutils.parsers.rst import directives
from sphinx.util.docutils import SphinxDirective
from sphinx.util.typing import OptionSpec

import spherekit as sk

HOME = "generated/extra/moving"
"""Where the pages are made; the site has them in its folder `moving`."""
FRAME = '<iframe class="{kind}" loading="lazy" title="{name}" src="{path}"></iframe>'


def make(mechanism: sk.Mechanism, path: Path) -> None:
    """Write the page of a mechanism."""
    path.parent.mkdir(parents=True, exist_ok=True)
    sk.page(mechanism, path)


class Moving(SphinxDirective):
    """Shows the page of a mechanism in a frame, and its picture where there is none."""

    required_arguments = 1
    option_spec: ClassVar[OptionSpec] = {"compact": directives.flag}

    def run(self) -> list[nodes.Node]:
        """Return the frame and the picture."""
        (name,) = self.arguments
        up = "../" * self.env.docname.count("/")
        compact = "compact" in self.options
        picture = nodes.image(
            uri=f"/generated/mechanisms/{name}{'_card' if compact else ''}.png",
            alt=f"{name} on the unit sphere in a configuration of its first assembly mode",
            classes=["dark-light", "still"],
        )
        kind, state = ("moving compact", "#alone=1") if compact else ("moving", "")
        path = f"{up}moving/{name}.html{state}"
        frame = FRAME.format(kind=kind, name=f"{name}, moving", path=path)
        shown = nodes.container(classes=["moving"])
        shown += [picture, nodes.raw("", frame, format="html")]
        return [shown]
