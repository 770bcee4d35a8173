"""`spherekit analyses`: what is installed, broken plugins with their reason."""

from argparse import ArgumentParser, Namespace
from dataclasses import MISSING

from spherekit.cli.completers import complete_analyses, set_completer
from spherekit.cli.main import print_json

EXAMPLES = """examples:
  # what is installed
  spherekit analyses
  # its parameters, tables and columns
  spherekit analyses workspace
"""


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `spherekit analyses`."""
    analysis_argument = parser.add_argument(
        "analysis",
        nargs="?",
        metavar="ANALYSIS",
        help="describe this one",
    )
    set_completer(analysis_argument, complete_analyses)
    parser.add_argument(
        "--json",
        action="store_true",
        help="as JSON",
    )


def execute(options: Namespace) -> int:
    """List the installed analyses, or describe the one that is named.

    An analysis that cannot be imported is listed with its error. Returns the exit status 0.
    """
    if options.analysis:
        return _describe(options)
    from spherekit.runs.registry import list_analyses, load_analysis

    rows = [
        {
            "name": name,
            "origin": origin,
            "target": target,
            "summary": "" if error else load_analysis(name).summary,
            "error": error or None,
        }
        for name, origin, target, error in list_analyses()
    ]
    if options.json:
        print_json(rows)
        return 0
    for row in rows:
        print(f"{row['name']:20s} {row['summary'] or 'BROKEN: ' + str(row['error'])}")
    return 0


def _describe(options: Namespace) -> int:
    """Print version, parameters and tables of one analysis; return the exit status 0."""
    from spherekit.runs.parameter_text import describe_parameters
    from spherekit.runs.registry import load_analysis

    cls = load_analysis(options.analysis)
    allowed = describe_parameters(cls)  # allowed values and default, by parameter
    if options.json:
        facts = {key: getattr(cls, key) for key in ("name", "version", "summary", "cites")}
        facts["parameters"] = {key: values for key, (values, _) in allowed.items()}
        facts["tables"] = {
            table.name: [
                {key: getattr(column, key) for key in ("name", "unit", "meaning")}
                for column in table.columns
            ]
            for table in cls.tables
        }
        print_json(facts)
        return 0
    print(f"{cls.name} {cls.version}: {cls.summary}")
    for text in cls.cites:
        print(f"  cites {text}")
    print("parameters:" if allowed else "parameters: none")
    for key, (values, default) in allowed.items():
        default_text = "required" if default is MISSING else f"default {default!r}"
        print(f"  {key}: {values}, {default_text}")
    for table in cls.tables:
        print(f"table {table.name}: {table.meaning}")
        for column in table.columns:
            unit = f" [{column.unit}]" if column.unit else ""
            print(f"  {column.name:14s}{unit:8s} {column.meaning}")
    return 0
