"""`spherekit analyses`: the installed analyses, and why broken plugins are broken."""

from argparse import ArgumentParser, Namespace
from dataclasses import MISSING
from typing import TYPE_CHECKING

from spherekit.cli.completers import complete_analyses, set_completer
from spherekit.cli.main import print_json
from spherekit.cli.screen_report import ScreenReport
from spherekit.number_text import number_text
from spherekit.tables.screen_table import ScreenColumn, ScreenTable

if TYPE_CHECKING:
    from spherekit.runs.parameter_text import Parameter

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
        help="print the parameters of this analysis, and its tables with their columns",
    )
    set_completer(analysis_argument, complete_analyses)
    parser.add_argument(
        "--json",
        action="store_true",
        help="print as JSON",
    )


def execute(options: Namespace) -> int:
    """Execute ``spherekit analyses``: list the installed analyses, or describe one of them.

    An analysis is a plugin that computes tables for a mechanism. An analysis that cannot be
    imported is listed with its error. Returns the exit status 0.
    """
    if options.analysis:
        return _describe(options)
    from spherekit.runs.registry import list_analyses, load_analysis

    entries = []  # for the output as JSON
    rows = []
    warnings = []
    for record in list_analyses():
        # What the analysis computes, in words.
        summary = ""
        if record.error:
            warnings.append(f"{record.name} is BROKEN: {record.error}")
        else:
            summary = load_analysis(record.name).summary
            rows.append((record.name, summary))
        entries.append(
            {
                "name": record.name,
                "origin": record.origin,  # the installed package
                "target": record.class_name,
                "summary": summary,
                "error": record.error or None,
            }
        )
    if options.json:
        print_json(entries)
        return 0
    table = ScreenTable(
        columns=(ScreenColumn("analysis"), ScreenColumn("what it computes")),
        rows=tuple(rows),
    )
    ScreenReport(
        "Installed analyses",
        results=[table],
        warnings=warnings,
        next_steps=[
            ("spherekit analyses NAME", "parameters, tables and columns of an analysis"),
            ("spherekit run FILE -a NAME", "run an analysis"),
        ],
    ).print(options)
    return 0


def _describe(options: Namespace) -> int:
    """Print version, parameters and tables of one analysis; return the exit status 0."""
    from spherekit.runs.parameter_meanings import parameter_meanings, plain_meaning
    from spherekit.runs.parameter_text import describe_parameters
    from spherekit.runs.registry import load_analysis

    cls = load_analysis(options.analysis)
    allowed = describe_parameters(cls)  # allowed values and default, by parameter
    meanings = {key: plain_meaning(text) for key, text in parameter_meanings(cls).items()}
    if options.json:
        facts = {key: getattr(cls, key) for key in ("name", "version", "summary", "cites")}
        facts["parameters"] = {
            key: parameter.type_text for key, parameter in allowed.items()
        }
        facts["parameter_meanings"] = {key: meanings.get(key, "") for key in allowed}
        facts["tables"] = {
            table.name: [
                {key: getattr(column, key) for key in ("name", "unit", "meaning")}
                for column in table.columns
            ]
            for table in cls.tables
        }
        print_json(facts)
        return 0
    tables = [
        ScreenTable(
            columns=(
                ScreenColumn("parameter"),
                ScreenColumn("values"),
                ScreenColumn("default"),
                ScreenColumn("meaning"),
            ),
            rows=tuple(
                (
                    key,
                    parameter.type_text,
                    _default_text(parameter),
                    meanings.get(key, ""),
                )
                for key, parameter in allowed.items()
            ),
            title="Parameters, written -a " + f"{cls.name}:NAME=VALUE,...",
        )
    ]
    if not allowed:
        tables = []
    for table in cls.tables:
        tables.append(
            ScreenTable(
                columns=(
                    ScreenColumn("column"),
                    ScreenColumn("unit"),
                    ScreenColumn("meaning"),
                ),
                rows=tuple(
                    (column.name, column.unit or "", column.meaning)
                    for column in table.columns
                ),
                title=f"Table {table.name}: {table.meaning}",
            )
        )
    results: list[str | ScreenTable] = []
    for screen_table in tables:
        results += [screen_table, ""]
    if not allowed:
        results.insert(0, "no parameters")
    results += [f"Reference: {text}" for text in cls.cites]
    ScreenReport(
        f"{cls.name}: {cls.summary}", results=results, details=[f"version {cls.version}"]
    ).print(options)
    return 0


def _default_text(parameter: "Parameter") -> str:
    """Return the default value of a parameter as text, with its unit; ``-`` if empty."""
    default = parameter.default
    if default is MISSING:
        return "required"
    if isinstance(default, float) or (parameter.unit and isinstance(default, int)):
        return f"{number_text(default)} {parameter.unit}".rstrip()
    if isinstance(default, tuple):
        if not default:
            return "-"
        return f"{'+'.join(map(str, default))} {parameter.unit}".rstrip()
    return str(default) or "-"
