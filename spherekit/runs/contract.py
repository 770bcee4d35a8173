"""The contract between spherekit and an analysis: needs, batch, tables, scene.

A plugin is a frozen dataclass derived from `AbstractAnalysis`; its fields are its
parameters. It says what it needs before anything is computed, gets exactly that, block
after block or for all samples at once, and returns the tables it declared.

What stands in a run for an analysis that is broken, so that the others go on.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal

from spherekit.conventions import Names
from spherekit.errors import AnalysisError, PluginError
from spherekit.mechanism.mechanism import Mechanism
from spherekit.runs.figure_of_merit import FigureOfMerit
from spherekit.runs.needs import Needs
from spherekit.runs.table_scenes import Batch
from spherekit.scenes.scene import Scene
from spherekit.tables.table import Table, TableArrays, Tables

CONTRACT = 1
"""Version of this contract; a plugin states the one it was written for."""


@dataclass(frozen=True)
class Sweep:
    """A parameter of an analysis that trades speed for accuracy, for `spherekit trade`.

    `values` of the `parameter`, the most accurate last: what the others give is compared
    with that. ``"samples"`` are those of the run. The numbers compared are those of
    `column` in `table`, row by row where the columns `match` agree; `error` is the column
    with the analysis's own estimate. Where the rows are `places`, `column` says where (rad,
    of each input if it is one of inputs), and each is compared with the nearest.

    Other parameters have the values `beside` meanwhile. What matters to mechanisms with
    one or with several `inputs` only says so.
    """

    parameter: str
    values: tuple[Any, ...]
    table: str
    column: str
    match: Names
    error: str = ""
    places: bool = False
    beside: tuple[tuple[str, Any], ...] = ()
    inputs: Literal["any", "one", "several"] = "any"

    def applies(self, mechanism: Mechanism) -> bool:
        """Return whether it matters to a mechanism."""
        return self.inputs in ("any", "several" if len(mechanism.inputs) > 1 else "one")


@dataclass(frozen=True)
class Findings:
    """What an analysis has to say beside its tables.

    `figures` go to the summary and must be ready for JSON; `warnings`, in whole
    sentences, and `remarks`, the results in a line or two, are shown to whoever runs it.
    """

    figures: Mapping[str, Any] = field(default_factory=dict)
    warnings: Names = ()
    remarks: Names = ()


class AbstractAnalysis(ABC):
    """Base class of analyses; subclasses are frozen dataclasses of parameters."""

    name: ClassVar[str]
    version: ClassVar[str]
    contract: ClassVar[int] = CONTRACT
    summary: ClassVar[str]
    cites: ClassVar[Names] = ()
    tables: ClassVar[tuple[Table, ...]]
    rowwise: ClassVar[bool] = False
    """Whether a row depends only on what the batch says of it: then blocks are given as
    they come, and a few rows tell what many cost."""
    reads_samples: ClassVar[bool] = True
    """Whether it reads samples of a run; otherwise it is asked once, with the first
    block, which is empty where no analysis of the run reads samples."""
    trades: ClassVar[tuple[Sweep, ...]] = ()
    """Own parameters that trade speed for accuracy, where samples are not what costs."""

    @property
    def at_once(self) -> bool:
        """Whether all samples of a run have to come in one batch."""
        return self.reads_samples and not self.rowwise

    @abstractmethod
    def needs(self, mechanism: Mechanism) -> Needs:
        """Return what will be read; cheap, and `AnalysisError` for bad parameters."""

    @abstractmethod
    def compute(self, batch: Batch) -> Tables:
        """Return the declared tables by name for all rows of the batch."""

    def scene(self, batch: Batch) -> tuple[Scene, ...]:
        """Return what is to be seen of the batch; nothing by default."""
        return ()

    def findings(self, batch: Batch) -> Findings:
        """Return what is to be said beside the tables; nothing by default.

        Of an analysis that is `rowwise` it is said of each block, and then `joined`.
        """
        return Findings()

    def merits(self, mechanism: Mechanism) -> tuple[FigureOfMerit, ...]:
        """Return the figures of merit that compare designs; none by default.

        Their expressions are of `spherekit.plugin.designs.row_quantities`, or of the
        columns of one of its tables, ``table="NAME.TABLE"``.
        """
        return ()

    def joined(self, before: Findings, now: Findings) -> Findings:
        """Return what is to be said of all blocks `before` and of the next one together.

        Raises
        ------
        AnalysisError
            By default, if these differ.
        """
        if before != now:
            raise AnalysisError(
                f"{self.name}: what it finds in one block is not what it finds in the "
                "next; define joined(), which says what holds for both"
            )
        return now


Analyses = Sequence[AbstractAnalysis]


@dataclass(frozen=True)
class BrokenAnalysis(AbstractAnalysis):
    """An analysis that is asked for and cannot be used; `why` says what is wrong."""

    name: str  # type: ignore[misc]
    why: str
    version = ""
    summary = ""
    tables = ()

    def needs(self, mechanism: Mechanism) -> Needs:
        """Raise `PluginError` with what is wrong."""
        raise PluginError(self.why)

    def compute(self, batch: Batch) -> Mapping[str, TableArrays]:
        """Raise `PluginError` with what is wrong."""
        raise PluginError(self.why)
