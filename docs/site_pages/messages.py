"""The tables of the page on messages: exceptions and statuses as the code says them."""

import inspect
from collections.abc import Iterator

from spherekit import errors
from spherekit.status import STATUS_MEANING


def pages() -> Iterator[tuple[str, str]]:
    """Yield the two tables."""
    yield "messages/errors.md", "\n".join(_errors())
    yield "messages/statuses.md", "\n".join(_statuses())


def _errors() -> Iterator[str]:
    yield "| exception | what it says |\n|---|---|"
    for name, value in vars(errors).items():
        if inspect.isclass(value):
            yield f"| `{name}` | {inspect.getdoc(value)} |"


def _statuses() -> Iterator[str]:
    yield "| status | meaning, and what to do |\n|---|---|"
    for status, meaning in STATUS_MEANING.items():
        yield f"| `{status.name}` | {meaning} |"
