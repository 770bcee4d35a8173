"""A run whose result can be seen: it is gone through once more for that."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import WRAPPER_ASSIGNMENTS, cached_property, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

from spherekit.conventions import Facts
from spherekit.display.figures.collector import Collector
from spherekit.runs import runner as analysis
from spherekit.runs.run_result import Columns, RunResult

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from spherekit.runs.recording_session import Recorder


P = ParamSpec("P")
R = TypeVar("R")

ONCE = ("folder", "unfinished", "formats", "recorder", "progress", "verify", "tables")
"""Arguments of a run that do not matter to what is seen of it."""


@dataclass
class _Again:
    """What shows a run by going through it once more, and keeps what is to be seen.

    Attributes
    ----------
    name
        The name of the mechanism.
    arguments, options
        What `spherekit.run` was called with, without the options of `ONCE`.
    """

    name: str
    arguments: tuple[Any, ...]
    options: Facts

    def __getstate__(self) -> Facts:
        """Return the call alone: what is to be seen is large, and made again by it."""
        return {"name": self.name, "arguments": self.arguments, "options": self.options}

    def go(self, recorder: "Recorder") -> None:
        """Go through the run again, and show it to a recorder."""
        options = {**self.options, "recorder": recorder, "tables": False}
        analysis.run(*self.arguments, **options)

    def record(self, path: Path) -> None:
        """Write a recording, block by block where nothing is kept yet."""
        from spherekit.display.rerun.recorder import RerunRecorder

        with RerunRecorder(self.name, path=path) as recorder:
            if "_kept" in vars(self):
                self._kept.play(recorder)
            else:
                self.go(recorder)

    def show(self) -> None:
        """Put a recording into the page of a notebook."""
        from spherekit.display.rerun.recorder import RerunRecorder

        with RerunRecorder(self.name, notebook=True) as recorder:
            self._kept.play(recorder)

    def figures(self, degrees: bool, columns: Columns) -> "Mapping[str, Figure]":
        """Return all figures by name."""
        from spherekit.display.figures.contents import figures_of

        return figures_of(self._kept.scenes(), self._kept.titles, degrees, columns)

    @cached_property
    def _kept(self) -> Collector:
        collector = Collector()
        self.go(collector)
        return collector


def _published(function: Callable[P, R], wrapper: Callable[..., R]) -> Callable[P, R]:
    """Return a wrapper with the name, the signature and the docs of its function.

    Its module stays its own: pickles find functions by module and name, and pools of
    processes are given functions as pickles.
    """
    copied = [name for name in WRAPPER_ASSIGNMENTS if name != "__module__"]
    return wraps(function, assigned=copied)(wrapper)


def _run(*arguments: Any, **options: Any) -> RunResult:
    """Run, and let the result be seen."""
    result = analysis.run(*arguments, **options)
    again = {name: value for name, value in options.items() if name not in ONCE}
    return replace(result, views=_Again(result.summary["mechanism"], arguments, again))


run = _published(analysis.run, _run)
