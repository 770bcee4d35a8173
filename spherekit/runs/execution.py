"""The options that say how a run is done: its folder, engine, recorder and so on."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from spherekit.argument_validation import check_fields
from spherekit.conventions import AnyPath
from spherekit.errors import AnalysisError
from spherekit.runs.evaluation_options import ORDINARY, Setting
from spherekit.runs.recording_session import Recorder
from spherekit.runs.run_folder import Unfinished
from spherekit.symbolic.compiler import EngineChoice
from spherekit.tables.table_formats import Format

Progress = Callable[[int, int], None]
"""Receives the number of samples that are done, and of all samples."""


@dataclass(frozen=True)
class Execution:
    """The options of a run that do not change which motion is analysed.

    The motion is described by a `Study`. `AnalysisError` is raised if a value has another
    type than its field.

    Attributes
    ----------
    folder
        Folder of the results. Tables are stored there block by block, so memory does not
        grow with the number of samples. Without it, tables stay in memory.
    unfinished
        Treatment of a folder with the unfinished work of a stopped run: ``"refuse"`` to
        start, ``"resume"`` the stopped run (or start, if there is none), or ``"discard"``
        the work.
    formats
        Formats of the table files. By default Parquet, and CSV up to 100 MB.
    tables
        Whether tables are kept in memory if there is no folder.
    engine
        The solver of a simulation; see `spherekit.dynamics.forward_dynamics.simulate`.
    only_needed
        Whether to leave out the groups of links that no analysis needs. Assembly modes are
        then modes of the remaining part of the mechanism, and only that part has to close.
    recorder
        Receives the drawings (scenes) of each block of samples.
    log_every
        Number of successive samples of which one is recorded. By default it is chosen for
        at most `MAX_RECORDED_SAMPLES` in each assembly mode.
    progress
        Called after each block with the numbers of samples done and of all samples.
    block
        Number of samples in a block. By default it is chosen for speed. It has no effect if
        an analysis reads all samples at once.
    setting
        The way in which velocities are computed.
    accuracy
        Known errors of the setting, which are added to the summary.
    """

    folder: AnyPath | None = None
    unfinished: Unfinished = "refuse"
    formats: Sequence[Format] | None = None
    tables: bool = True
    engine: EngineChoice = "auto"
    only_needed: bool = False
    recorder: Recorder | None = None
    log_every: int | None = None
    progress: Progress | None = None
    block: int | None = None
    setting: Setting = ORDINARY
    accuracy: Mapping[str, Any] | None = None

    def __post_init__(self) -> None:
        """Raise `AnalysisError` if a value is wrong, or `unfinished` has no folder."""
        check_fields(self, AnalysisError, "run")
        for name in ("block", "log_every"):
            number = getattr(self, name)
            if number is not None and number < 1:
                raise AnalysisError(f"run: {name} must be at least 1, not {number}")
        if self.folder is None and self.unfinished != "refuse":
            raise AnalysisError(
                'run: the option "unfinished" applies only to a run that writes to a '
                'folder; give the option "folder", or leave "unfinished" out'
            )
