"""`spherekit new`: files to start from, a mechanism or a distribution with an analysis."""

import re
from argparse import ArgumentParser, Namespace
from pathlib import Path

from spherekit.cli.completers import complete_mechanisms, set_completer
from spherekit.cli.main import note

EXAMPLES = """examples:
  # a four-bar to change, in wrist.toml
  spherekit new mechanism wrist
  # a cam, in a folder
  spherekit new mechanism designs/cam_3 --kind cam
  # as a shipped one, or as a file
  spherekit new mechanism mine --like stephenson
  # a plugin to change, the example of the docs, in torque_ratio/
  spherekit new analysis torque_ratio
"""


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument(
        "what",
        choices=("mechanism", "analysis"),
        help=(
            "a mechanism file, commented, complete, ready to run; or a distribution with "
            "an analysis, complete, tested, ready to install"
        ),
    )
    parser.add_argument(
        "name",
        metavar="NAME",
        help=(
            "of the mechanism: writes NAME.toml; of the analysis: writes a folder of that "
            "name"
        ),
    )
    exclusive = parser.add_mutually_exclusive_group()
    exclusive.add_argument(
        "--kind",
        choices=("four_bar", "posed", "wrist", "cam", "gears"),
        help=(
            "of a mechanism; four_bar (default): a crank drives a rocker, the links by "
            "their arcs; posed: the same by the directions of its axes in one pose, as "
            "measured; wrist: two inputs point an axis; cam: a cam moves a follower with a "
            "roller; gears: bevel gears by their teeth"
        ),
    )
    like_argument = exclusive.add_argument(
        "--like",
        metavar="FILE",
        help="start from a mechanism: path or shipped name",
    )
    set_completer(like_argument, complete_mechanisms)


TEMPLATES = Path(__file__).parent / "templates"
SUFFIX = ".toml"
MADE = ".in"
_NAME = re.compile(r"^\s*name\s*=.*$", re.M)


def execute(options: Namespace) -> int:
    """Write the file or the folder, and say what to do next."""
    from spherekit.errors import OutputError
    from spherekit.storage.atomic_write import make_folder, write_text

    analysis = options.what == "analysis"
    if analysis and (options.kind or options.like):
        raise OutputError("--kind and --like are of mechanisms; leave them out")
    path = Path(options.name if analysis else options.name.removesuffix(SUFFIX) + SUFFIX)
    name = path.stem
    _check_name(options.what, path.name if analysis else name)
    if path.exists():
        raise OutputError(f"{path}: is there already; choose another name, or remove it")
    if analysis:
        make_folder(path)
        for file, text in files_of(name).items():
            write_text(path / file, text)
        then = (
            f"change spherekit_{name}.py; pip install -e {path}; then: spherekit run "
            f"four_bar -a {name}, and pytest {path}"
        )
    else:
        kind = TEMPLATES / f"{options.kind or 'four_bar'}{SUFFIX}"
        text = _like(options.like) if options.like else kind.read_text("utf-8")
        write_text(path, _NAME.sub(f'name = "{name}"', text, count=1))
        then = f"change it, then: spherekit run {path}"
    note(options, f"{path}: {then}")
    return 0


def _check_name(what: str, name: str) -> None:
    """Raise `OutputError` if neither a file nor a plugin can have a name."""
    from spherekit.conventions import MAX_NAME_LENGTH, NAME_PATTERN
    from spherekit.errors import OutputError
    from spherekit.runs.registry import names

    better = re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_")
    pattern = NAME_PATTERN.pattern
    takes = "letters, digits and underscores"
    if what == "analysis":
        pattern = r"[a-z][a-z0-9_]*"
        better = better.lower().strip("_0123456789")
        takes = "lower-case letters, digits and underscores, a letter first"
    if not re.fullmatch(pattern, name) or len(name) > MAX_NAME_LENGTH:
        raise OutputError(
            f'"{name}" cannot be the name of a new {what}: it takes up to '
            f"{MAX_NAME_LENGTH} {takes}, such as {better[:MAX_NAME_LENGTH] or 'wrist'}"
        )
    if what == "analysis" and name in names():
        raise OutputError(f"an analysis {name} is installed already; choose another name")


def files_of(name: str) -> dict[str, str]:
    """Return the files of a distribution with an analysis of this name, by their names."""
    words = {
        "@NAME@": name,
        "@DASHED@": name.replace("_", "-"),
        "@CLASS@": "".join(part.capitalize() for part in name.split("_")),
    }
    files = {}
    for path in sorted((TEMPLATES / "analysis").glob(f"*{MADE}")):
        text = re.sub("@[A-Z]+@", lambda word: words[word[0]], path.read_text("utf-8"))
        files[path.name.removesuffix(MADE).replace("NAME", name)] = text
    return files


def _like(name: str) -> str:
    """Return the text of a mechanism's file, which has been read to be one."""
    from spherekit.files.library import find
    from spherekit.files.mechanism_reader import load

    mechanism = load(name)
    note = f"# Made from {mechanism.name}; what [source] says is of that one.\n"
    return (note if mechanism.source else "") + find(name).read_text("utf-8")
