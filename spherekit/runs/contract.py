"""The contract between spherekit and an analysis: needs, batch, tables, scenes, findings.

A plugin is a frozen dataclass derived from `AbstractAnalysis`; its fields are its
parameters. It declares what it needs before anything is computed. It then reads exactly
that, block by block or for all samples at once, and returns its declared tables.
"""

import json
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, asdict, dataclass, field, fields, replace
from typing import Any, ClassVar, Literal, Self

from spherekit.conventions import Names
from spherekit.errors import AnalysisError, PluginError
from spherekit.mechanism.mechanism import Mechanism
from spherekit.runs.batch import Batch
from spherekit.runs.figure_of_merit import FigureOfMerit
from spherekit.runs.needs import Needs
from spherekit.scenes.scene import Scene
from spherekit.tables.screen_table import ScreenTable
from spherekit.tables.table import Table, TableArrays, Tables

CONTRACT = 1
"""Version of this contract. A plugin states the version for which it was written."""


@dataclass(frozen=True)
class ParameterTrade:
    """Declares how `spherekit trade` compares the values of a parameter of an analysis.

    Such a parameter trades speed for accuracy. The command runs the analysis with each
    value of the parameter. The command compares one column of the results with the same
    column at the most accurate value. The command recommends the quickest value that
    reaches the accuracy asked for.

    Attributes
    ----------
    parameter
        Name of the parameter; ``"samples"`` is the number of samples of the run.
    values
        Values of the parameter to try, the most accurate last.
    table, column
        Names of the table and of the column with the values that are compared.
    match
        Columns of texts that identify a row. Rows of two runs with the same texts in these
        columns are compared.
    error
        Column with the error estimate of the analysis, if there is one.
    places
        Whether the column has input values (rad) at which something happens, such as a dead
        centre. Each is compared with the nearest one in the most accurate run. With several
        inputs there is one column for each input, and their names begin with `column`.
    beside
        Names and values of other parameters of the analysis, which are constant during the
        comparison.
    inputs
        Whether the parameter matters to mechanisms with any number of inputs, with one, or
        with several.
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
        """Return whether the parameter has an effect for a mechanism (`inputs`)."""
        return self.inputs in ("any", "several" if len(mechanism.inputs) > 1 else "one")


@dataclass(frozen=True)
class Findings:
    """Results of an analysis in addition to its tables.

    Attributes
    ----------
    figures
        Values for the summary of the run, by name. They must be data that JSON can store.
    warnings
        Warnings for the user, as whole sentences.
    remarks
        The main results for the user, in a line or two.
    tables
        The main results for the user as small tables, which are printed before the remarks.
        The cells are strings.
    """

    figures: Mapping[str, Any] = field(default_factory=dict)
    warnings: Names = ()
    remarks: Names = ()
    tables: tuple[ScreenTable, ...] = ()

    @classmethod
    def from_json(cls, entries: Mapping[str, Any]) -> Self:
        """Return findings from a dictionary that was stored as JSON."""
        return cls(
            entries["figures"],
            tuple(entries["warnings"]),
            tuple(entries["remarks"]),
            tuple(ScreenTable.from_json(table) for table in entries["tables"]),
        )


class AbstractAnalysis(ABC):
    """Base class of analyses. Subclasses are frozen dataclasses of parameters.

    Attributes
    ----------
    name, version, summary
        Name on the command line, version, and a line for the list of analyses.
    contract
        Version of the contract for which the analysis was written. The contract states the
        attributes and methods by which spherekit uses analyses.
    cites
        Sources to cite.
    tables
        The tables that `compute` returns; the first one is the main table.
    """

    name: ClassVar[str]
    version: ClassVar[str]
    contract: ClassVar[int] = CONTRACT
    summary: ClassVar[str]
    cites: ClassVar[Names] = ()
    tables: ClassVar[tuple[Table, ...]]
    rowwise: ClassVar[bool] = False
    """Whether each row depends only on the quantities of the same row of the batch.

    Such an analysis is given block by block, and the size of its tables is predicted from a
    few rows. Others are given all samples at once.
    """
    reads_samples: ClassVar[bool] = True
    """Whether the analysis reads samples of the run.

    An analysis that reads none is computed once, with the first block.
    """
    trades: ClassVar[tuple[ParameterTrade, ...]] = ()
    """Parameters that trade speed for accuracy, with values for `spherekit.trade`."""

    def requested_tables(self) -> tuple[Table, ...]:
        """Return the tables of results, with only the columns that the user requests.

        The attribute `on_request` of a column is the name of a parameter of the analysis.
        The column is left out if this parameter has its default value.
        """
        defaults = {}
        for item in fields(self):  # type: ignore[arg-type]
            factory = item.default_factory
            defaults[item.name] = item.default if factory is MISSING else factory()
        return tuple(
            replace(
                table,
                columns=tuple(
                    column
                    for column in table.columns
                    if not column.on_request
                    or getattr(self, column.on_request) != defaults[column.on_request]
                ),
            )
            for table in self.tables
        )

    @property
    def at_once(self) -> bool:
        """Whether the analysis reads all samples of a run in one batch."""
        return self.reads_samples and not self.rowwise

    @abstractmethod
    def needs(self, mechanism: Mechanism) -> Needs:
        """Return the quantities of a `Batch` (block of samples) that the analysis reads.

        Only these are computed. The method must be fast.

        Raises
        ------
        AnalysisError
            If a parameter does not fit the mechanism.
        """

    @abstractmethod
    def compute(self, batch: Batch) -> Tables:
        """Return the declared tables by name for all rows of the batch."""

    def scene(self, batch: Batch) -> tuple[Scene, ...]:
        """Return the scenes (drawings) of the batch; none by default."""
        return ()

    def findings(self, batch: Batch) -> Findings:
        """Return results in addition to the tables; none by default.

        Findings are, for example, remarks for the user and numbers for the summary. A
        `rowwise` analysis receives one block of samples after another. It returns findings
        for each block, and the method `joined` joins them.
        """
        return Findings()

    def merits(self, mechanism: Mechanism) -> tuple[FigureOfMerit, ...]:
        """Return the figures of merit by which designs are compared; none by default.

        A figure of merit is one number for each design (choice of sizes) and assembly mode.
        A `FigureOfMerit` has an expression, and says how the values of this expression in
        all rows become one number, for example the largest. The expression contains
        quantities of `spherekit.plugin.designs.row_quantities`. If `FigureOfMerit.table` is
        ``"ANALYSIS.TABLE"``, a table of this analysis, it contains columns of this table.
        """
        return ()

    def joined(self, before: Findings, now: Findings) -> Findings:
        """Join the findings of all earlier blocks of samples with the findings of the next.

        A run is computed in blocks of samples, and findings are results besides tables.
        This method accepts only equal findings. A subclass overrides it if findings differ.

        Raises
        ------
        AnalysisError
            If the findings of the next block differ from the earlier findings.
        """
        # Findings of a resumed run come from its journal, where tuples have become lists.
        if before != now and json.dumps(asdict(before)) != json.dumps(asdict(now)):
            raise AnalysisError(
                f"{self.name}: the findings differ between blocks of samples; define "
                "joined(), which combines two findings into one that holds for both"
            )
        return now


Analyses = Sequence[AbstractAnalysis]
"""The analyses of a run, in the order of their tables."""


@dataclass(frozen=True)
class BrokenAnalysis(AbstractAnalysis):
    """Takes the place of an analysis that cannot be used.

    The other analyses of the run are still computed. `needs` and `compute` raise
    `PluginError` with the reason `why`, for example that a plugin cannot be imported. The
    run notes this error as the failure of the analysis.
    """

    name: str  # type: ignore[misc]
    why: str
    version = ""
    summary = ""
    tables = ()

    def needs(self, mechanism: Mechanism) -> Needs:
        """Raise `PluginError`. A run calls this method before all other methods."""
        raise PluginError(self.why)

    def compute(self, batch: Batch) -> Mapping[str, TableArrays]:
        """Raise `PluginError`."""
        raise PluginError(self.why)
