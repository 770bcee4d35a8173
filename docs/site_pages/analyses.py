"""Parameters, tables and sources of every shipped analysis, from its class."""

from collections.abc import Iterator
from dataclasses import MISSING

from spherekit.runs.contract import AbstractAnalysis
from spherekit.runs.parameter_meanings import parameter_meanings
from spherekit.runs.parameter_text import describe_parameters
from spherekit.runs.registry import analysis_names, load_analysis
from spherekit.tables.table import Column


def pages() -> Iterator[tuple[str, str]]:
    """Yield a page for each analysis."""
    for name in analysis_names():
        yield f"analyses/{name}.md", "\n".join(_page(load_analysis(name)))


def _page(cls: type[AbstractAnalysis]) -> Iterator[str]:
    """Yield the lines of the page of an analysis."""
    yield f"# Analysis `{cls.name}`\n"
    yield f"{cls.summary[:1].upper()}{cls.summary[1:]}.\n"
    yield "[Analyses](../../analyses.md) has a link to the explanation.\n"
    parameters = describe_parameters(cls)
    if parameters:
        yield f"## Parameters\n\nWritten as `-a {cls.name}:{next(iter(parameters))}=...`.\n"
        yield "| parameter | value | default | meaning |\n|---|---|---|---|"
    meanings = parameter_meanings(cls)
    for key, parameter in parameters.items():
        default = parameter.default
        default_text = "" if default in ("", ()) else f"`{parameter.default_text}`"
        default_text = "required" if default is MISSING else default_text
        type_text = _cell(parameter.type_text)
        cells = (f"`{key}`", type_text, default_text, _cell(meanings.get(key, "")))
        yield f"| {' | '.join(cells)} |"
    for table in cls.tables:
        meaning = f"{table.meaning[:1].upper()}{table.meaning[1:]}."
        yield f"\n## Table `{table.name}`\n\n{meaning}\n"
        yield "| column | unit | meaning |\n|---|---|---|"
        for column in table.columns:
            yield f"| {_names(column)} | {column.unit} | {_cell(column.meaning)} |"
    yield "\n## Sources\n"
    yield from (f"- {text}" for text in cls.cites)
    yield ""


def _names(column: Column) -> str:
    """Return the name of a column, and the names of the columns that it stands for."""
    if column.per_input:
        return f"`{column.name}`, or `{column.name}_PAIR` for each of several inputs"
    if column.per_passive:
        return "the name of each variable of the passive pairs"
    return f"`{column.name}`"


def _cell(text: str) -> str:
    return text.replace("|", "\\|")
