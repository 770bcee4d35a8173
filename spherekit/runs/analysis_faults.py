"""Errors of analyses: sentences that say what failed, and where in a plugin."""

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

PLUGIN_LOG = logging.getLogger("spherekit.plugins")
"""Receives the tracebacks of errors of plugins, at the level of debugging."""

LIBRARY_FOLDERS = (Path(__file__).parent.parent, Path(str(np.__file__)).parent)
"""Folders of spherekit and NumPy: lines in them are not named as the place of an error."""

STANDARD_LIBRARY_FOLDER = sysconfig.get_path("stdlib")
"""Folder of the standard library."""

INSTALLED_PACKAGES_FOLDER = sysconfig.get_path("purelib")
"""Folder of installed packages, which can be inside the standard library folder."""


def describe_failed_rows(summary: Facts) -> list[str]:
    """Return a sentence for each table of results that has failed rows.

    The sentence states the number of failed rows for each status (reason). A row has failed
    if the position of the mechanism was computed at its sample, but not the results. Rows
    of samples without a position are not counted.

    Parameters
    ----------
    summary
        The summary of a run, as in its JSON file.
    """
    sentences = []
    for analysis in summary.get("analyses", ()):
        for table, count_by_status in analysis["failed_rows"].items():
            counts = ", ".join(f"{n} {status}" for status, n in count_by_status.items())
            row_count = counted(sum(count_by_status.values()), "row")
            sentences.append(
                f"{analysis['name']}: {row_count} of table {table} failed: {counts}"
            )
    return sentences


@contextmanager
def convert_plugin_errors(analysis: str, action: str) -> Iterator[None]:
    """Convert errors of a plugin to `PluginError` in a `with` block.

    A plugin is an analysis that other people may have written. It can raise exceptions of
    any kind. As a `PluginError`, the exception is handled like every error of spherekit,
    and its message names the analysis. The log keeps the traceback.

    Two kinds of exceptions pass unchanged: errors of spherekit itself (`SpherekitError`),
    and interruptions by the user.

    Parameters
    ----------
    analysis
        Name of the analysis.
    action
        What the plugin does in the `with` block, such as ``"compute"``.
    """
    try:
        yield
    except SpherekitError:
        raise
    except (Exception, SystemExit) as problem:
        PLUGIN_LOG.debug("%s: %s", analysis, action, exc_info=True)
        raise PluginError(
            f"{analysis}: {action} raises {describe_exception(problem)}"
        ) from problem


def describe_failure(analysis: str, reason: str) -> str:
    """Return the sentence that an analysis failed, and why, with its name once."""
    return f"analysis {analysis} failed: {reason.removeprefix(f'{analysis}: ')}"


def describe_exception(problem: BaseException) -> str:
    """Return an exception as text, with the line of the user's code that led to it.

    All code outside spherekit, NumPy and the standard library counts as the user's. If
    several lines of it are in the traceback, the last one is named.
    """
    message, _, _ = str(problem).strip().partition("\n")
    location = ""
    for frame in traceback.extract_tb(problem.__traceback__):
        path = Path(frame.filename)
        # Names such as "<string>" are no files.
        is_library = frame.filename.startswith("<") or any(
            path.is_relative_to(folder) for folder in LIBRARY_FOLDERS
        )
        is_installed = path.is_relative_to(INSTALLED_PACKAGES_FOLDER)
        is_standard = path.is_relative_to(STANDARD_LIBRARY_FOLDER) and not is_installed
        if not is_library and not is_standard:
            location = f" ({path.name}, line {frame.lineno})"
    return f"{type(problem).__name__}{': ' if message else ''}{message}{location}"
