"""`spherekit new mechanism`: a mechanism file to change into one's own."""

import argparse
import re
import sys
from pathlib import Path

from spherekit.cli.suggest import mechanisms, suggesting

TEMPLATES = Path(__file__).parent / "templates"
SUFFIX = ".toml"
KINDS = {
    "four_bar": "a crank drives a rocker; the links by their arcs",
    "posed": "the same by the directions of its axes in one pose, as measured",
    "wrist": "two inputs point an axis",
    "cam": "a cam moves a follower with a roller",
    "gears": "bevel gears by their teeth",
}
_NAME = re.compile(r"^\s*name\s*=.*$", re.M)

EXAMPLES = (
    ("spherekit new mechanism hand", "a four-bar in hand.toml"),
    ("spherekit new mechanism designs/cam_3 --kind cam", "a cam, in a folder"),
    ("spherekit new mechanism mine --like stephenson", "as a shipped one, or as a file"),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("name", metavar="NAME", help="of the mechanism: writes NAME.toml")
    source = parser.add_mutually_exclusive_group()
    source.add_argument(
        "--kind",
        choices=KINDS,
        default="four_bar",
        help="; ".join(f"{kind}: {what}" for kind, what in KINDS.items()),
    )
    suggesting(
        source.add_argument(
            "--like", metavar="FILE", help="start from a mechanism: path or shipped name"
        ),
        mechanisms,
    )


def execute(options: argparse.Namespace) -> int:
    """Write the file and say what to do next."""
    from spherekit.conventions import MAX_NAME_LENGTH, NAME_PATTERN
    from spherekit.errors import OutputError
    from spherekit.files.atomic import write_text

    path = Path(options.name.removesuffix(SUFFIX) + SUFFIX)
    name = path.stem
    if not NAME_PATTERN.fullmatch(name) or len(name) > MAX_NAME_LENGTH:
        better = re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_")[:MAX_NAME_LENGTH]
        raise OutputError(
            f'"{name}" cannot be the name of a mechanism: it takes 1 to {MAX_NAME_LENGTH} '
            f"letters, digits and underscores, such as {better or 'wrist'}"
        )
    if path.exists():
        raise OutputError(f"{path}: is there already; choose another name, or remove it")
    text = _like(options.like) if options.like else _template(options.kind)
    write_text(path, _NAME.sub(f'name = "{name}"', text, count=1))
    if not options.quiet:
        print(f"{path}: change it, then: spherekit run {path}", file=sys.stderr)
    return 0


def _template(kind: str) -> str:
    return (TEMPLATES / f"{kind}{SUFFIX}").read_text("utf-8")


def _like(name: str) -> str:
    """Return the text of a mechanism's file, which has been read to be one."""
    from spherekit.files.library import find
    from spherekit.files.read import load

    mechanism = load(name)
    note = f"# Made from {mechanism.name}; what [source] says is of that one.\n"
    return (note if mechanism.source else "") + find(name).read_text("utf-8")
