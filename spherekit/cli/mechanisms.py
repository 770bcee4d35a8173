"""`spherekit mechanisms`: what can be named instead of a path."""

from argparse import ArgumentParser, Namespace

from spherekit.cli.main import print_json, say
from spherekit.escaping import one_line

EXAMPLES = """examples:
  # names that commands take instead of a path
  spherekit mechanisms
  # the same for a program
  spherekit mechanisms --json
"""


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `spherekit mechanisms`."""
    parser.add_argument(
        "--json",
        action="store_true",
        help="as JSON",
    )


def execute(options: Namespace) -> int:
    """List the shipped mechanisms, one a line, and then the shipped studies.

    Packages ship mechanisms as packs, which are folders of files. A pack or a mechanism
    that cannot be read is reported on stderr and left out. Returns the exit status 0.
    """
    from spherekit.errors import SpherekitError
    from spherekit.files.library import shipped
    from spherekit.files.mechanism_reader import load

    rows = []
    for pack in shipped():
        if pack.fault:
            say(f"pack {pack.name}: {pack.fault}")
        for name in sorted(pack.files):
            try:
                mechanism = load(name)
            except SpherekitError as problem:
                say(str(problem))
                continue
            source = mechanism.source.citation if mechanism.source else ""
            rows.append((name, len(mechanism.links), len(mechanism.pairs), source))
    if options.json:
        keys = ("name", "links", "pairs", "source")
        print_json([dict(zip(keys, row, strict=True)) for row in rows])
        return 0
    width = max((len(row[0]) for row in rows), default=0)
    for name, links, pairs, source in rows:
        print(f"{name:{width}}  {links:3d} links {pairs:3d} pairs  {one_line(source)}")
    for pack in shipped():
        for name in sorted(pack.studies):
            print(f"{name:{width}}  study")
    return 0
