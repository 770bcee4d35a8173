"""`spherekit.run`: the runner, with results that can be drawn and recorded."""

import os
from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import dataclass, replace
from functools import WRAPPER_ASSIGNMENTS, cached_property, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

import numpy as np

from spherekit.conventions import Facts
from spherekit.display.figures.collector import Collector
from spherekit.files.study_reader import study_of
from spherekit.runs import runner
from spherekit.runs.run_result import Columns, RunResult
from spherekit.tables.table import Table

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from spherekit.runs.recording_session import Recorder

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")

OPTIONS_WITHOUT_EFFECT_ON_VIEWS = (
    "folder",
    "unfinished",
    "formats",
    "recorder",
    "progress",
    "verify",
    "tables",
)
"""Arguments of a run that do not change its figures and recordings."""


@dataclass
class _RunViews:
    """Draws and records a run, which is repeated when it is drawn for the first time.

    A scene is what is drawn on one page: links, curves and plots at all samples. Scenes are
    large, so results do not store them. A repeated run computes the same scenes.

    Attributes
    ----------
    name
        The name of the mechanism.
    arguments, options
        Positional and keyword arguments of `spherekit.run`, without those that have no
        effect on scenes.
    """

    name: str
    arguments: tuple[Any, ...]
    options: Facts

    def __getstate__(self) -> Facts:
        """Return the arguments only, for pickles. The scenes can be computed again."""
        return {"name": self.name, "arguments": self.arguments, "options": self.options}

    def repeat_run(self, recorder: "Recorder") -> None:
        """Repeat the run and send its scenes to a recorder."""
        options = {**self.options, "recorder": recorder, "tables": False}
        runner.run(*self.arguments, **options)

    def record(self, path: Path) -> None:
        """Write all scenes (drawings at all samples) to a recording of the viewer Rerun.

        If the scenes have not been collected in memory yet, they are written while the run
        is repeated, block by block of the samples. So they need not fit into memory.
        """
        from spherekit.display.rerun.recorder import RerunRecorder

        with RerunRecorder(self.name, path=path) as recorder:
            # A cached property is in `vars` once it has been computed.
            if "_collector" in vars(self):
                self._collector.play(recorder)
            else:
                self.repeat_run(recorder)

    def show(self) -> None:
        """Show a recording in a notebook."""
        from spherekit.display.rerun.recorder import RerunRecorder

        with RerunRecorder(self.name, notebook=True) as recorder:
            self._collector.play(recorder)

    def figures(self, degrees: bool, columns: Columns) -> "Mapping[str, Figure]":
        """Return all figures by name."""
        from spherekit.display.figures.contents import plan_figures

        scenes = self._collector.scenes()
        return plan_figures(scenes, self._collector.titles, degrees, columns)

    def column_figure(
        self,
        table: Table,
        frame: "pd.DataFrame",
        x: str,
        y: str,
        titles: Mapping[int, str],
        degrees: bool,
        columns: Columns,
    ) -> "Figure":
        """Return a figure of one column of a table against another column.

        Parameters
        ----------
        table, frame
            The declaration of the table, with the units of its columns, and its rows.
        x, y
            Names of the columns on the horizontal and the vertical axis.
        titles
            Titles of the assembly modes (ways to assemble the mechanism) by number.
        degrees
            Whether angles of the frame are in degrees.
        columns
            Width of the figure, as a number of text columns of a journal.
        """
        from spherekit.display.figures.column_plots import draw_columns
        from spherekit.display.figures.sheet import Sheet

        sheet = Sheet(columns, titles)
        return draw_columns(table, frame, x, y, degrees=degrees, sheet=sheet)

    @cached_property
    def _collector(self) -> Collector:
        """The scenes of a repeated run."""
        collector = Collector()
        self.repeat_run(collector)
        return collector


def with_signature_of(
    function: Callable[Parameters, Result], wrapper: Callable[..., Result]
) -> Callable[Parameters, Result]:
    """Return a wrapper that has the name, the signature and the docstring of a function.

    Users then see the documentation of the function, but call the wrapper. The wrapper has
    its own module name, since a worker process finds an unpickled function by module and
    name.

    Parameters
    ----------
    function
        The function that users see in the documentation.
    wrapper
        A function with the same arguments that calls `function`.
    """
    copied_attributes = [name for name in WRAPPER_ASSIGNMENTS if name != "__module__"]
    return wraps(function, assigned=copied_attributes)(wrapper)


def _run(*arguments: Any, **options: Any) -> RunResult:
    """Run analyses, and return a result that can also draw and record the run.

    The result repeats the run when it is drawn or recorded. By then the user may have
    changed the study file, or lists and arrays among the arguments. The file is therefore
    read here, and lists, dictionaries and arrays are copied. Both runs use these copies.
    """
    # The subject is the study or mechanism, or the path of its file. It is the first
    # argument, or the option "subject".
    subjects, others = arguments[:1], arguments[1:]
    arguments = (*map(_read_subject, subjects), *map(_copy_container, others))
    options = {name: _copy_container(value) for name, value in options.items()}
    if "subject" in options:
        options["subject"] = _read_subject(options["subject"])
    result = runner.run(*arguments, **options)
    view_options = {
        name: value
        for name, value in options.items()
        if name not in OPTIONS_WITHOUT_EFFECT_ON_VIEWS
    }
    views = _RunViews(result.summary["mechanism"], arguments, view_options)
    return replace(result, views=views)


def _read_subject(subject: Any) -> Any:
    """Return the study of a file; other subjects, such as a mechanism, are unchanged."""
    return study_of(subject) if isinstance(subject, str | os.PathLike) else subject


def _copy_container(value: Any) -> Any:
    """Return a copy of a list, a dictionary or an array; other values are unchanged."""
    return copy(value) if isinstance(value, list | dict | np.ndarray) else value


run = with_signature_of(runner.run, _run)
