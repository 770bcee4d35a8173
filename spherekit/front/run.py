"""A run whose result can be seen: it is gone through once more for that.

A trade whose chart can be drawn.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, wraps
from pathlib import Path
from typing import TYPE_CHECKING, ParamSpec

from spherekit.analysis import run as analysis
from spherekit.analysis.result import Columns, RunResult
from spherekit.conventions import Facts
from spherekit.figures.collector import Collector
from spherekit.tradeoff import trade as measured
from spherekit.tradeoff.record import Trade

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from spherekit.analysis.running.recording import Recorder


P = ParamSpec("P")

ONCE = ("folder", "unfinished", "formats", "recorder", "progress", "verify", "tables")
"""Arguments of a run that do not matter to what is seen of it."""


@dataclass
class _Again:
    """What shows a run by going through it once more, and keeps what is to be seen."""

    name: str
    go: Callable[["Recorder"], object]

    def record(self, path: Path) -> None:
        """Write a recording, block by block where nothing is kept yet."""
        from spherekit.view.rerun_view import RerunRecorder

        with RerunRecorder(self.name, path=path) as recorder:
            if "_kept" in vars(self):
                self._kept.play(recorder)
            else:
                self.go(recorder)

    def show(self) -> None:
        """Put a recording into the page of a notebook."""
        from spherekit.view.rerun_view import RerunRecorder

        with RerunRecorder(self.name, notebook=True) as recorder:
            self._kept.play(recorder)

    def figures(self, degrees: bool, columns: Columns) -> "Mapping[str, Figure]":
        """Return all figures by name."""
        from spherekit.figures.contents import figures_of

        return figures_of(self._kept.scenes(), self._kept.titles, degrees, columns)

    @cached_property
    def _kept(self) -> Collector:
        collector = Collector()
        self.go(collector)
        return collector


def _visible(function: Callable[P, RunResult]) -> Callable[P, RunResult]:
    """Return a function that runs, with results that can be seen."""

    @wraps(function)
    def _run(*args: P.args, **kwargs: P.kwargs) -> RunResult:
        result = function(*args, **kwargs)
        again: Facts = {k: v for k, v in kwargs.items() if k not in ONCE}

        def go(recorder: "Recorder") -> None:
            again.update(recorder=recorder, tables=False)
            function(*args, **again)  # type: ignore[call-arg]

        return replace(result, views=_Again(result.summary["mechanism"], go))

    return _run


run = _visible(analysis.run)


def _drawable(function: Callable[P, Trade]) -> Callable[P, Trade]:
    """Return a function that measures, with results that can be drawn."""

    @wraps(function)
    def _trade(*args: P.args, **kwargs: P.kwargs) -> Trade:
        return replace(function(*args, **kwargs), draw=_figure)

    return _trade


def _figure(result: Trade, tolerance: float | None, columns: Columns) -> "Figure":
    from spherekit.figures.contents import figures_of
    from spherekit.tradeoff.record import scene

    (figure,) = figures_of([scene(result, tolerance)], {}, columns=columns).values()
    return figure


trade = _drawable(measured.trade)
