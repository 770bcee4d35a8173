"""The contract between spherekit and an analysis: needs, batch, tables, scene.

A plugin is a frozen dataclass derived from `AbstractAnalysis`; its fields are its
parameters. It says what it needs before anything is computed, gets exactly that, block
after block or for all samples at once, and returns the tables it declared.

What stands in a run for an analysis that is broken, so that the others go on.

Figures of merit: one number of a design in an assembly mode, from its rows.
"""

import re
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal

from spherekit.analysis.batch import Batch, Needs
from spherekit.analysis.scene import Scene
from spherekit.analysis.tables import Table, TableArrays, Tables, Units
from spherekit.conventions import Names, choices, listing
from spherekit.errors import AnalysisError, ModelError, PluginError
from spherekit.model.expression import Expression, parse
from spherekit.model.mechanism import Mechanism

REDUCTIONS = {
    "min": "the least value",
    "max": "the greatest value",
    "mean": "the mean over the samples",
    "rms": "the root of the mean square",
    "range": "the greatest value less the least",
    "swing": "the range of an angle that is followed over whole turns",
    "sum": "the sum over the rows",
    "argmin": "the input at which it is least",
    "argmax": "the input at which it is greatest",
    "at": "the value at an input: at(EXPRESSION, Q); at several: at(EXPRESSION, Q, Q)",
}
"""How rows become one number. Samples that do not close are left out."""

_FORM = re.compile(r"(?:([A-Za-z_]\w*)\s*=(?!=))?\s*([A-Za-z_]\w*)\s*\((.*)\)\s*", re.S)
_TABLE = re.compile(r"\s*(\w+\.\w+)((?:\s+\w+\s*=\s*\w+)*)\s*:(.*)", re.S)
_POINT = re.compile(r"(.*?)((?:,[^,()]*)+)", re.S)
_PLACE = re.compile(r"(.*),\s*(\w+)\s*", re.S)
_BARE = re.compile(r"\s*(?:abs\s*\(\s*)?([A-Za-z_]\w*)\s*\)?\s*")


@dataclass(frozen=True)
class FigureOfMerit:
    """A figure of merit: a reduction of an expression over the rows of a design.

    Attributes
    ----------
    name
        What its column is called.
    reduction
        One of `REDUCTIONS`.
    expression
        Of quantities of a row (rad, SI), or of the columns of a `table`.
    point
        The input (rad) of ``at``, or each of several.
    place
        The pair of several inputs whose value ``argmin`` and ``argmax`` give.
    table
        ``ANALYSIS.TABLE`` whose rows are meant; None for those that kernels compute.
    only
        Columns of the table, and what each is in the rows that count.
    meaning
        What it says, in a few words.
    """

    name: str
    reduction: str
    expression: str
    point: tuple[float, ...] = ()
    table: str | None = None
    meaning: str = ""
    only: tuple[tuple[str, str], ...] = ()
    place: str = ""

    def __post_init__(self) -> None:
        if self.reduction not in REDUCTIONS:
            raise AnalysisError(
                f'{self.name}: "{self.reduction}" is no reduction'
                f"{choices(self.reduction, REDUCTIONS, 'it is')}"
            )
        if not re.fullmatch(r"[A-Za-z_]\w*", self.name):
            raise AnalysisError(
                f'"{self.name}" cannot name a figure of merit: letters, digits and _ can'
            )
        if bool(self.point) != (self.reduction == "at"):
            raise AnalysisError(
                f"{self.name}: at(EXPRESSION, Q) needs an input Q, and no other has one"
            )

    @property
    def of_table(self) -> tuple[str, str]:
        """The names of the analysis and of its table."""
        assert self.table is not None
        analysis, _, table = self.table.partition(".")
        return analysis, table

    def parsed(self, names: Units) -> Expression:
        """Return the expression, of quantities with units by name.

        Raises
        ------
        AnalysisError
            If it is not an expression of these.
        """
        try:
            return parse(self.expression, names)
        except ModelError as problem:
            raise AnalysisError(f"{self.name}: {problem}") from None

    def unit(self, names: Units) -> str:
        """Return its unit where the expression is a quantity or its size, else nothing."""
        if self.reduction.startswith("arg"):
            return names.get(f"q_{self.place}" if self.place else "q", "")
        bare = _BARE.fullmatch(self.expression)
        return names.get(bare[1], "") if bare else ""


def parse_merit(text: str, radians: float) -> FigureOfMerit:
    """Return the figure of merit of ``NAME=REDUCTION(EXPRESSION)``, the name optional.

    Parameters
    ----------
    text
        Such as ``least=min(transmission_angle_43)`` or ``at(theta_41, 30)``; of the rows
        of a table ``max(workspace.areas: size)``, of some of them
        ``max(workspace.areas part=whole: size)``.
    radians
        What a unit of an input given by ``at`` is in rad.

    Raises
    ------
    AnalysisError
        If it has not that form.
    """
    match = _FORM.fullmatch(text.strip())
    if match is None:
        raise AnalysisError(
            f'"{text}" is no figure of merit: write NAME=REDUCTION(EXPRESSION), such as '
            f"least=min(transmission_angle_43); reductions: {listing(REDUCTIONS)}"
        )
    name, reduction, expression = match.groups()
    table = None
    only = ""
    place = ""
    texts = list[str]()
    if rows := _TABLE.fullmatch(expression):
        table, only, expression = rows.groups()
    point: tuple[float, ...] = ()
    if reduction == "at":
        if parts := _POINT.fullmatch(expression):
            expression, ends = parts.groups()
            texts = re.split(r"\s*,\s*", ends)[1:]
        with suppress(ValueError):
            point = tuple(float(part) * radians for part in texts)
        if not point:
            raise AnalysisError(
                f'"{text}": at needs an expression and an input, at(theta_41, 30)'
            )
    elif reduction.startswith("arg") and (parts := _PLACE.fullmatch(expression)):
        expression, place = parts.groups()
        texts = [place]
    expression = expression.strip()
    if name is None:
        name = re.sub(r"\W+", "_", "_".join([reduction, expression, *texts])).strip("_")
    only_of = tuple(re.findall(r"(\w+)\s*=\s*(\w+)", only))
    return FigureOfMerit(name, reduction, expression, point, table, "", only_of, place)


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
