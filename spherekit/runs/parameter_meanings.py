"""Reads the meaning of each parameter of an analysis from the docstring of its class.

The command `spherekit analyses NAME` and the pages of the site both show these meanings.
The docstring follows numpydoc: a section ``Parameters`` or ``Attributes`` has the names of
parameters at its margin and their meaning, indented, below them.
"""

import inspect
import re
from collections.abc import Iterator

SECTIONS_OF_PARAMETERS = ("Parameters", "Attributes")
"""Headings of the docstring sections that list parameters."""


def parameter_meanings(cls: type) -> dict[str, str]:
    """Return the meaning of each parameter of an analysis, from the docstring of its class.

    Each meaning is one line in the markup of docstrings. A parameter that the docstring
    does not describe has no entry. The docstring has a section ``Parameters`` or
    ``Attributes`` with names at its margin and indented meanings below them.
    """
    meanings: dict[str, list[str]] = {}
    names: list[str] = []
    for heading, line in _section_lines(inspect.getdoc(cls) or ""):
        if heading not in SECTIONS_OF_PARAMETERS:
            continue
        if line and not line.startswith(" "):
            # Several parameters with one meaning are written "first, second : float".
            names = [name.strip() for name in line.partition(":")[0].split(",")]
            meanings |= {name: [] for name in names}
        else:
            for name in names:
                meanings[name].append(line)
    return {name: " ".join(" ".join(lines).split()) for name, lines in meanings.items()}


def plain_meaning(meaning: str) -> str:
    """Return a meaning for the screen, without the marks that enclose code."""
    return re.sub(r"(`{1,2})([^`]+)\1", r"\2", meaning)


def _section_lines(docstring: str) -> Iterator[tuple[str, str]]:
    """Yield each line of a docstring, together with the heading of its section.

    `parameter_meanings` takes from these lines the sections that describe parameters.

    Before the first heading, "" is yielded as heading. A heading is a line that is
    underlined by as many hyphens as it has characters. Headings and their underlines are
    not yielded.
    """
    lines = docstring.splitlines()
    heading = ""
    for number, line in enumerate(lines):
        underline = "-" * len(line)
        if line and lines[number + 1 : number + 2] == [underline]:
            heading = line
        # All other lines but underlines are yielded.
        elif not (heading and line == "-" * len(heading)):
            yield heading, line
