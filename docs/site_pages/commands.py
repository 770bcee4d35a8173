"""A page for each subcommand: usage, arguments, options and examples, from its parser."""

import argparse
from collections.abc import Iterator

from spherekit.cli.command_line import (
    CommandParser,
    build_parser,
    command_parsers,
)
from spherekit.escaping import markdown_text


def pages() -> Iterator[tuple[str, str]]:
    """Yield a page for each subcommand."""
    for name, parser in command_parsers(build_parser()).items():
        yield f"commands/{name}.md", "\n".join(command_page(name, parser))


def command_page(name: str, parser: CommandParser) -> Iterator[str]:
    """Yield the lines of the page of a subcommand."""
    yield f"# spherekit {name}\n"
    yield f"{markdown_text(parser.description or '')}\n"
    yield f"```text\n{parser.format_usage().rstrip()}\n```\n"
    for group in parser._action_groups:  # argparse has no public way to list them
        if not group._group_actions:
            continue
        yield f"## {(group.title or 'options').capitalize()}\n"
        yield "| argument | meaning |\n|---|---|"
        for action in group._group_actions:
            yield f"| {shown_argument(action)} | {meaning(parser, action)} |"
        yield ""
    if parser.epilog:
        examples = parser.epilog.removeprefix("examples:\n")
        lines = [line.removeprefix("  ") for line in examples.rstrip().splitlines()]
        yield "## Examples\n"
        yield "\n".join(["```text", *lines, "```", ""])


def shown_argument(action: argparse.Action) -> str:
    """Return the spellings of an argument with the placeholder of its value."""
    value = action.metavar or ("" if action.option_strings else action.dest.upper())
    if not value and action.choices:
        value = "{" + ",".join(map(str, action.choices)) + "}"
    elif not value and action.nargs != 0:
        value = action.dest.upper()
    if isinstance(value, tuple):
        value = " ".join(value)
    if action.option_strings and action.nargs == "?":
        value = f"[{value}]"
    words = [f"{option} {value}".rstrip() for option in action.option_strings] or [value]
    return ", ".join(f"`{word}`" for word in words).replace("|", "\\|")


def meaning(parser: CommandParser, action: argparse.Action) -> str:
    """Return the help of an argument in one line."""
    text = parser._get_formatter()._expand_help(action) if action.help else ""
    escaped = markdown_text(" ".join(text.split())).replace("\\`", "`")  # code stays code
    return escaped.replace("|", "\\|")
