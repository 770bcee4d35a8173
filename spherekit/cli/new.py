"""`spherekit new`: files to start from, a mechanism or a distribution with an analysis."""

import keyword
import re
import shlex
from argparse import ArgumentParser, Namespace
from pathlib import Path

from spherekit.cli.argument_types import angles_in_degrees
from spherekit.cli.completers import complete_mechanisms, set_completer
from spherekit.cli.screen_report import ScreenReport

TEMPLATES = Path(__file__).parent / "templates"
"""Folder of the mechanism files and of the distribution that the command copies."""

SUFFIX = ".toml"
KINDS = ("four_bar", "posed", "wrist", "cam", "gears", "vertex")
"""Kinds of new mechanisms; all but `vertex` are files in `TEMPLATES`."""

TEMPLATE_SUFFIX = ".in"
"""Ending of template files in which ``@NAME@`` and other words are replaced."""

EXAMPLES = """examples:
  # a four-bar to change, in wrist.toml
  spherekit new mechanism wrist
  # a cam, in a folder
  spherekit new mechanism designs/cam_3 --kind cam
  # a vertex of folded paper with five creases, from its sector angles
  spherekit new mechanism corner --kind vertex --sectors 80,75,60,70,75
  # a copy of a shipped mechanism
  spherekit new mechanism mine --like stephenson
  # a plugin to change, the example of the docs, in torque_ratio/
  spherekit new analysis torque_ratio
"""


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `spherekit new`.

    This command writes files to start from: a mechanism, or a Python package with a new
    analysis.
    """
    parser.add_argument(
        "what",
        choices=("mechanism", "analysis"),
        help=(
            "mechanism: write a complete mechanism file with comments, ready to run; "
            "analysis: write a Python package with an analysis and its tests, ready to "
            "install"
        ),
    )
    parser.add_argument(
        "name",
        metavar="NAME",
        help=(
            "name of the mechanism, which is written to NAME.toml, or of the analysis, "
            "which is written to a folder NAME"
        ),
    )
    exclusive = parser.add_mutually_exclusive_group()
    exclusive.add_argument(
        "--kind",
        choices=KINDS,
        help=(
            "kind of mechanism; four_bar (default): a crank drives a rocker, and links are "
            "given by their arcs; posed: a four-bar that is given by the directions of its "
            "axes, as measured in one pose; wrist: two inputs point an axis; cam: a cam "
            "moves a roller follower; gears: bevel gears, given by their numbers of teeth; "
            "vertex: creases of folded paper that meet at one point, given by the sector "
            "angles between them"
        ),
    )
    like_argument = exclusive.add_argument(
        "--like",
        metavar="FILE",
        help=(
            "start from a copy of this mechanism: path of a file, or name of a shipped one"
        ),
    )
    set_completer(like_argument, complete_mechanisms)
    parser.add_argument(
        "--sectors",
        type=angles_in_degrees,
        metavar="A,B,C,D[,...]",
        help=(
            "with --kind vertex: the sector angles, counter-clockwise, in degrees "
            "(default: 100,60,80,120). In the new file, all creases except three are "
            "driven, over ranges in which the vertex can be assembled"
        ),
    )


def execute(options: Namespace) -> int:
    """Write a mechanism file or a package with an analysis, and print what to do next.

    A mechanism file is a copy of a shipped template, of the kind that the user chooses, or
    of another mechanism (``--like``), with the new name. An analysis is written as a folder
    with a Python package that pip can install. Returns the exit status 0.

    Parameters
    ----------
    options
        Values of the arguments: ``what`` is ``"mechanism"`` or ``"analysis"``, and ``name``
        is its name, which may begin with a path.
    """
    from spherekit.errors import OutputError
    from spherekit.files.toml_lines import locate_keys
    from spherekit.storage.atomic_write import make_folder, write_text

    is_analysis = options.what == "analysis"
    if options.sectors and (is_analysis or options.kind != "vertex"):
        raise OutputError(
            "--sectors applies only to a vertex of folded paper; add --kind vertex, or "
            "leave --sectors out"
        )
    if is_analysis and (options.kind or options.like):
        raise OutputError(
            "--kind and --like apply only to mechanisms, not to analyses; leave them out"
        )
    if is_analysis:
        path = Path(options.name)
        name = path.name
    else:
        path = Path(options.name.removesuffix(SUFFIX) + SUFFIX)
        name = path.stem
    _check_name(options.what, name)
    word = shlex.quote(str(path))  # the path as a word of a command
    if path.exists():
        raise OutputError(f"{path}: exists already; choose another name, or remove it")
    if is_analysis:
        make_folder(path)
        for file, text in distribution_files(name).items():  # of the package
            write_text(path / file, text)
        next_steps = [
            (f"pip install -e {word}", f"install it, then change spherekit_{name}.py"),
            (f"spherekit run four_bar -a {name}", "run it"),
            (f"pytest {word}", "test it"),
        ]
    else:
        if options.like:
            text = _text_of_mechanism(options.like)
        elif options.kind == "vertex":
            from spherekit.cli.vertex_file import DEFAULT_SECTORS_DEG, vertex_text

            text = vertex_text(options.sectors or DEFAULT_SECTORS_DEG)
        else:
            template = TEMPLATES / f"{options.kind or 'four_bar'}{SUFFIX}"
            text = template.read_text("utf-8")
        lines = text.split("\n")
        lines[locate_keys(text)["name",] - 1] = f'name = "{name}"'
        write_text(path, "\n".join(lines))
        next_steps = [
            (f"spherekit validate {word}", "check the file after you have changed it"),
            (f"spherekit run {word}", "compute motion and pole axes"),
        ]
    ScreenReport(
        f"{name}: new {options.what} to change", files=str(path), next_steps=next_steps
    ).print(options)
    return 0


def _check_name(kind: str, name: str) -> None:
    """Raise `OutputError` if a name is not allowed for a new mechanism or analysis.

    Parameters
    ----------
    kind
        ``"mechanism"`` or ``"analysis"``. The name of an analysis is also part of the names
        of a Python package, a module and a class, so fewer names are allowed.
    name
        The name that the user wrote.
    """
    import spherekit.plugin as plugin
    from spherekit.conventions import MAX_NAME_LENGTH, NAME_PATTERN
    from spherekit.errors import OutputError
    from spherekit.runs.registry import analysis_names

    # The message suggests a similar name that is allowed.
    suggestion = re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_")
    pattern = NAME_PATTERN.pattern
    rule = f"1 to {MAX_NAME_LENGTH} letters, digits and underscores"
    if kind == "analysis":
        pattern = r"[a-z][a-z0-9_]*(?<!_)"
        suggestion = suggestion.lower().strip("_0123456789")
        rule = (
            f"1 to {MAX_NAME_LENGTH} lower-case letters, digits and underscores, of which "
            "the first is a letter and the last is no underscore"
        )
    if not re.fullmatch(pattern, name) or len(name) > MAX_NAME_LENGTH:
        raise OutputError(
            f'"{name}" cannot be the name of a new {kind}: a name has {rule}, such as '
            f"{suggestion[:MAX_NAME_LENGTH] or 'wrist'}"
        )
    if kind != "analysis":
        return
    if name in analysis_names():
        raise OutputError(f"an analysis {name} is installed already; choose another name")
    # The module of the analysis imports names from spherekit.plugin. A class with one of
    # these names would replace the imported object.
    class_name = _class_name(name)
    if keyword.iskeyword(class_name) or hasattr(plugin, class_name):
        raise OutputError(
            f'"{name}" cannot be the name of a new analysis: its class would be '
            f"{class_name}, a name of Python or of spherekit.plugin; choose another name"
        )


def _class_name(name: str) -> str:
    """Return the name of the class of an analysis, such as ``TorqueRatio``."""
    return "".join(part.capitalize() for part in name.split("_"))


def distribution_files(name: str) -> dict[str, str]:
    """Return the files of an installable Python package with a new analysis.

    The result has the text of each file by file name. The files are written from templates,
    in which placeholders such as ``@NAME@`` are replaced. NAME in the name of a template is
    replaced, too.

    Parameters
    ----------
    name
        Name of the analysis, in lower case with underscores.
    """
    replacements = {
        "@NAME@": name,
        "@DASHED@": name.replace("_", "-"),
        "@CLASS@": _class_name(name),
    }
    files = {}
    for path in sorted((TEMPLATES / "analysis").glob(f"*{TEMPLATE_SUFFIX}")):
        template = path.read_text("utf-8")
        text = re.sub("@[A-Z]+@", lambda match: replacements[match[0]], template)
        files[path.name.removesuffix(TEMPLATE_SUFFIX).replace("NAME", name)] = text
    return files


def _text_of_mechanism(name: str) -> str:
    """Return the text of a mechanism's file, after a check that it can be read."""
    from spherekit.files.library import find
    from spherekit.files.mechanism_reader import load

    mechanism = load(name)
    # Some editors begin a file with a byte-order mark, which must not follow a comment.
    text = find(name).read_text("utf-8").removeprefix("\ufeff")
    comment = f"# Made from {mechanism.name}, which the table [source] describes.\n"
    return (comment if mechanism.source else "") + text
