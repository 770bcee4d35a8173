"""Figures of merit: one number of a design in an assembly mode, from its rows."""

import re
from contextlib import suppress
from dataclasses import dataclass

from spherekit.errors import AnalysisError, ModelError
from spherekit.mechanism.load_expression import Expression, parse
from spherekit.tables.table import Units
from spherekit.wording import choices, listing

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
