"""Mistakes of analyses: what one raises becomes a sentence that says where it was."""

import logging
import sysconfig
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from spherekit.conventions import Facts
from spherekit.errors import PluginError, SpherekitError
from spherekit.wording import counted

LOG = logging.getLogger("spherekit.plugins")
"""Gets the trace of every mistake, at the level of debugging."""

NOT_TO_BLAME = (str(Path(__file__).parent.parent), str(Path(str(np.__file__)).parent))
STANDARD = sysconfig.get_path("stdlib")
INSTALLED = sysconfig.get_path("purelib")


def failed_rows(summary: Facts) -> list[str]:
    """Return what rows of analyses failed where their configurations did not."""
    return [
        f"{analysis['name']}: {counted(sum(statuses.values()), 'row')} of table {table} "
        f"failed: {', '.join(f'{n} {name}' for name, n in statuses.items())}"
        for analysis in summary.get("analyses", ())
        for table, statuses in analysis["failed_rows"].items()
    ]


@contextmanager
def faults_of(analysis: str, what: str) -> Iterator[None]:
    """Turn whatever a plugin raises into `PluginError`; errors of spherekit stay.

    Parameters
    ----------
    analysis
        Its name.
    what
        What of it is asked, such as ``"compute"``.
    """
    try:
        yield
    except SpherekitError:
        raise
    except (Exception, SystemExit) as problem:
        LOG.debug("%s: %s", analysis, what, exc_info=True)
        raise PluginError(f"{analysis}: {what} raises {described(problem)}") from problem


def failed(analysis: str, why: str) -> str:
    """Return the sentence that says that an analysis failed and why, with its name once."""
    return f"analysis {analysis} failed: {why.removeprefix(f'{analysis}: ')}"


def described(problem: BaseException) -> str:
    """Return an exception with the last line of a plugin's own that led to it."""
    words = str(problem).strip().partition("\n")[0]
    where = ""
    for frame in traceback.extract_tb(problem.__traceback__):
        path = frame.filename
        ours = path.startswith((*NOT_TO_BLAME, "<"))
        if not ours and (path.startswith(INSTALLED) or not path.startswith(STANDARD)):
            where = f" ({Path(path).name}, line {frame.lineno})"
    return f"{type(problem).__name__}{': ' if words else ''}{words}{where}"
