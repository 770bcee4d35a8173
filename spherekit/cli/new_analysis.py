"""`spherekit new analysis`: a distribution with an analysis to change into one's own."""

import argparse
import re
import sys
from pathlib import Path

TEMPLATES = Path(__file__).parent / "templates" / "analysis"
SUFFIX = ".in"

EXAMPLES = (
    ("spherekit new analysis torque_ratio", "the example of the docs, in torque_ratio/"),
    ("spherekit new analysis plugins/swing", "in another folder"),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument(
        "name", metavar="NAME", help="of the analysis: writes a folder of that name"
    )


def execute(options: argparse.Namespace) -> int:
    """Write the distribution and say what to do next."""
    from spherekit.analysis.registry import names
    from spherekit.conventions import MAX_NAME_LENGTH
    from spherekit.errors import OutputError
    from spherekit.files.atomic import make_folder, write_text

    folder = Path(options.name)
    name = folder.name
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name) or len(name) > MAX_NAME_LENGTH:
        better = re.sub(r"\W+", "_", name.lower(), flags=re.ASCII).strip("_0123456789")
        raise OutputError(
            f'"{name}" cannot be the name of an analysis: it takes up to {MAX_NAME_LENGTH} '
            "lower-case letters, digits and underscores, a letter first, such as "
            f"{better[:MAX_NAME_LENGTH] or 'torque_ratio'}"
        )
    if name in names():
        raise OutputError(f"an analysis {name} is installed already; choose another name")
    if folder.exists():
        raise OutputError(f"{folder}: is there already; choose another name, or remove it")
    make_folder(folder)
    for file, text in files_of(name).items():
        write_text(folder / file, text)
    if not options.quiet:
        print(
            f"{folder}: change spherekit_{name}.py; pip install -e {folder}; then: "
            f"spherekit run four_bar -a {name}, and pytest {folder}",
            file=sys.stderr,
        )
    return 0


def files_of(name: str) -> dict[str, str]:
    """Return the files of a distribution with an analysis of this name, by their names."""
    words = {
        "@NAME@": name,
        "@DASHED@": name.replace("_", "-"),
        "@CLASS@": "".join(part.capitalize() for part in name.split("_")),
    }
    files = {}
    for path in sorted(TEMPLATES.glob(f"*{SUFFIX}")):
        text = path.read_text("utf-8")
        for word, replacement in words.items():
            text = text.replace(word, replacement)
        files[path.name.removesuffix(SUFFIX).replace("NAME", name)] = text
    return files
