"""How a run is done: where its results go, and by what means its numbers are found."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from spherekit.argument_validation import check_fields
from spherekit.conventions import AnyPath
from spherekit.errors import AnalysisError
from spherekit.runs.evaluation_options import ORDINARY, Setting
from spherekit.runs.recording_session import Recorder
from spherekit.runs.run_folder import Unfinished
from spherekit.tables.table import Format
from spherekit.velocities.kernels import Engine

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Execution:
    """How a run is done; what it goes through is its `Study`.

    Raises `AnalysisError` where a value is not of the type that its field has.

    Attributes
    ----------
    folder
        Where tables go while the run goes on, so that memory does not grow with the
        samples; the files are there at the end. Without it tables stay in memory.
    unfinished
        What to do with the work of a run that was stopped in that folder: ``"refuse"`` to
        start, ``"resume"`` it (or start, if there is none), or ``"discard"`` it.
    formats
        Which files are written; by default Parquet, and CSV up to 100 MB.
    tables
        Whether tables are kept in memory where there is no folder.
    engine
        What solves a simulation, see `spherekit.dynamics.forward_dynamics.simulate`.
    only_needed
        Whether to leave out the groups of links that no analysis needs. Assembly modes are
        then modes of the part that is left, and only that part has to close.
    recorder
        Receives the scenes block by block while the run goes on.
    log_every
        Of how many successive samples one goes to the recorder; by default so many that
        no assembly mode has more than `MOST_LOGGED`.
    progress
        Called with samples done and samples in all after each block.
    block
        Samples evaluated at once, by default as `PositionAnalysis.blocks` has them; all, if
        an analysis wants whole batches.
    setting, accuracy
        How samples are computed, and what is known of the errors of that, for the summary.
    """

    folder: AnyPath | None = None
    unfinished: Unfinished = "refuse"
    formats: Sequence[Format] | None = None
    tables: bool = True
    engine: Engine = "auto"
    only_needed: bool = False
    recorder: Recorder | None = None
    log_every: int | None = None
    progress: Progress | None = None
    block: int | None = None
    setting: Setting = ORDINARY
    accuracy: Mapping[str, Any] | None = None

    def __post_init__(self) -> None:
        check_fields(self, AnalysisError, "run")
        for name in ("block", "log_every"):
            number = getattr(self, name)
            if number is not None and number < 1:
                raise AnalysisError(f"run: {name} must be at least 1, not {number}")
        if self.folder is None and self.unfinished != "refuse":
            raise AnalysisError("run: unfinished does nothing without a folder")
