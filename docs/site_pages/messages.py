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
    yield "| exception | meaning |\n|---|---|"
    for name, value in vars(errors).items():
        if inspect.isclass(value):
            summary = (inspect.getdoc(value) or "").partition("\n\n")[0]
            yield f"| `{name}` | {' '.join(summary.split())} |"


def _statuses() -> Iterator[str]:
    yield "| status | meaning and cure |\n|---|---|"
    for status, meaning in STATUS_MEANING.items():
        yield f"| `{status.name}` | {meaning} |"
