"""Parameters, tables and sources of every shipped analysis, from its class."""

from collections.abc import Iterator
from dataclasses import MISSING

from spherekit.runs.contract import AbstractAnalysis
from spherekit.runs.parameter_text import describe_parameters
from spherekit.runs.registry import analysis_names, load_analysis


def pages() -> Iterator[tuple[str, str]]:
    """Yield a page for each analysis."""
    for name in analysis_names():
        yield f"analyses/{name}.md", "\n".join(_part(load_analysis(name)))


def _part(cls: type[AbstractAnalysis]) -> Iterator[str]:
    yield f"# Analysis `{cls.name}`\n"
    yield f"{cls.summary.capitalize()}.\n"
    yield "| parameter | value | default |\n|---|---|---|"
    for key, (shown, default) in describe_parameters(cls).items():
        said = "" if default in ("", ()) else f"`{default!r}`"
        said = "required" if default is MISSING else said
        yield f"| `{key}` | {_cell(shown)} | {said} |"
    for table in cls.tables:
        yield f"\n## Table `{table.name}`\n\n{table.meaning}\n"
        yield "| column | unit | meaning |\n|---|---|---|"
        for column in table.columns:
            yield f"| `{column.name}` | {column.unit} | {_cell(column.meaning)} |"
    yield "\n## Sources\n"
    yield from (f"- {text}" for text in cls.cites)
    yield ""


def _cell(text: str) -> str:
    return text.replace("|", "\\|")
