"""A run whose result can be saved as a recording: it is gone through once more."""

from collections.abc import Callable
from dataclasses import replace
from functools import wraps
from pathlib import Path
from typing import Any, ParamSpec

from spherekit.analysis import run as analysis
from spherekit.analysis.result import RunResult

P = ParamSpec("P")

ONCE = ("folder", "unfinished", "formats", "recorder", "progress", "verify", "tables")
"""Arguments of a run that do not matter to its recording."""


def _recordable(function: Callable[P, RunResult]) -> Callable[P, RunResult]:
    """Return a function that runs, with results that can be saved as a recording."""

    @wraps(function)
    def _run(*args: P.args, **kwargs: P.kwargs) -> RunResult:
        found = function(*args, **kwargs)
        again: dict[str, Any] = {k: v for k, v in kwargs.items() if k not in ONCE}

        def record(path: Path) -> None:
            from spherekit.view.rerun_view import RerunRecorder

            with RerunRecorder(found.summary["mechanism"], path=path) as recorder:
                again.update(recorder=recorder, tables=False)
                function(*args, **again)  # type: ignore[call-arg]

        return replace(found, record=record)

    return _run


run = _recordable(analysis.run)
