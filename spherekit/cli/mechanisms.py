"""`spherekit mechanisms`: what can be named instead of a path."""

from argparse import ArgumentParser, Namespace

from spherekit.cli.main import print_json, say
from spherekit.cli.screen_report import ScreenReport
from spherekit.conventions import Facts
from spherekit.escaping import one_line
from spherekit.tables.screen_table import ScreenColumn, ScreenTable

EXAMPLES = """examples:
  # names that commands take instead of a path
  spherekit mechanisms
  # the same as JSON, for programs
  spherekit mechanisms --json
"""


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `spherekit mechanisms`."""
    parser.add_argument(
        "--json",
        action="store_true",
        help="print as JSON, with the literature reference of each mechanism",
    )


def execute(options: Namespace) -> int:
    """Execute ``spherekit mechanisms``: list the shipped mechanisms and studies.

    A study is a file that states what to compute for a mechanism. Python packages ship such
    files in folders called packs. A pack or mechanism that cannot be used is reported on
    stderr and left out. Returns the exit status 0.
    """
    from spherekit.errors import SpherekitError
    from spherekit.files.library import shipped
    from spherekit.files.mechanism_reader import load
    from spherekit.planning.assembly_plan import driven_pairs

    rows: list[Facts] = []  # one for each mechanism
    for pack in shipped():
        if pack.fault:
            say(f"pack {pack.name}: {pack.fault}")
        for name in sorted(pack.files):
            try:
                mechanism = load(name)
                freedom_count = len(driven_pairs(mechanism))
            except SpherekitError as problem:
                say(str(problem))
                continue
            rows.append(
                {
                    "name": name,
                    "links": len(mechanism.links),
                    "pairs": len(mechanism.pairs),
                    "freedoms": freedom_count,
                    "description": mechanism.description,
                    "source": mechanism.source.citation if mechanism.source else "",
                }
            )
    if options.json:
        print_json(rows)
        return 0
    ScreenReport(
        "Shipped mechanisms, whose names commands take instead of a file",
        results=[_mechanism_table(rows), *_study_tables()],
        next_steps=[
            ("spherekit run NAME", "compute the motion and the pole axes"),
            ("spherekit new mechanism MINE --like NAME", "start from one of them"),
        ],
    ).print(options)
    return 0


def _mechanism_table(rows: list[Facts]) -> ScreenTable:
    """Return a screen table of the shipped mechanisms.

    The freedoms of a mechanism are the number of its driven pairs (joints). The last column
    has the first sentence of the description, or else the source.

    Parameters
    ----------
    rows
        For each mechanism the name, the numbers of links, pairs and freedoms, the
        description and the source in the literature.
    """
    columns = (
        ScreenColumn("name"),
        ScreenColumn("links", "right"),
        ScreenColumn("pairs", "right"),
        ScreenColumn("freedoms", "right"),
        ScreenColumn("what it is"),
    )
    cells = [
        (
            row["name"],
            str(row["links"]),
            str(row["pairs"]),
            str(row["freedoms"]),
            one_line(_first_sentence(row["description"]) or row["source"]),
        )
        for row in rows
    ]
    return ScreenTable(columns, tuple(cells))


def _study_tables() -> list[ScreenTable]:
    """Return a screen table of the shipped studies, as a list that may be empty.

    A study is a file that states what to compute for a mechanism. Python packages ship
    studies in folders called packs. A study that cannot be read is reported and left out.
    """
    from spherekit.errors import SpherekitError
    from spherekit.files.library import shipped
    from spherekit.files.study_reader import load_study

    rows = []
    for pack in shipped():
        for name in sorted(pack.studies):
            try:
                study = load_study(name)
            except SpherekitError as problem:
                say(str(problem))
                continue
            rows.append((name, study.mechanism.name))
    columns = (ScreenColumn("study"), ScreenColumn("of the mechanism"))
    return [ScreenTable(columns, tuple(rows))] if rows else []


def _first_sentence(text: str) -> str:
    """Return the first sentence of a text, without its full stop."""
    sentence, _, _ = text.partition(". ")
    return sentence.removesuffix(".")
