"""Figures of merit: one number for a design in an assembly mode, from the result rows."""

import math
import re
from dataclasses import dataclass

from spherekit.errors import AnalysisError, ModelError
from spherekit.mechanism.load_expression import Expression, parse
from spherekit.quantity import ANGLE, AngleUnit, QuantityError, read_quantity
from spherekit.runs.reductions import REDUCTION_BY_NAME, REDUCTIONS
from spherekit.tables.table import Units
from spherekit.wording import choices, listing

_MERIT_PATTERN = re.compile(
    r"(?:(?P<name>[A-Za-z_]\w*)\s*=(?!=))?"  # NAME=, but not the operator ==
    r"\s*(?P<reduction>[A-Za-z_]\w*)"
    r"\s*\((?P<content>.*)\)\s*",
    re.S,
)
"""NAME=REDUCTION(CONTENT), the name optional."""

_TABLE_PATTERN = re.compile(
    r"\s*(?P<table>\w+\.\w+)"
    r"(?P<conditions>(?:\s+\w+\s*=\s*\w+)*)"
    r"\s*:(?P<expression>.*)",
    re.S,
)
"""ANALYSIS.TABLE COLUMN=TEXT ...: EXPRESSION, without or with conditions."""

_CONDITION_PATTERN = re.compile(r"(\w+)\s*=\s*(\w+)")
"""COLUMN=TEXT of one condition."""

_POINT_PATTERN = re.compile(r"(?P<expression>.*?)(?P<inputs>(?:,[^,()]*)+)", re.S)
"""EXPRESSION, Q, Q: the content of ``at``. The inputs contain no parentheses."""

_PLACE_PATTERN = re.compile(r"(?P<expression>.*),\s*(?P<pair>\w+)\s*", re.S)
"""EXPRESSION, PAIR: the content of ``argmin`` and ``argmax`` with several inputs."""

_QUANTITY_PATTERN = re.compile(r"\s*(?:abs\s*\(\s*)?(?P<name>[A-Za-z_]\w*)\s*\)?\s*")
"""A single quantity, or its absolute value."""


@dataclass(frozen=True)
class FigureOfMerit:
    """A number that rates a design: a reduction, such as ``min``, of an expression.

    The expression is evaluated in all rows of the design. A row is one sample in one
    assembly mode (way to assemble the mechanism).

    Attributes
    ----------
    name
        Name of the column in which a sweep stores the figure.
    reduction
        One of `REDUCTIONS`.
    expression
        An expression of quantities of a row (rad, SI), or of the columns of `table`.
    point
        The input (rad) at which the reduction ``at`` takes the expression: one number for
        each input.
    table
        The table ``ANALYSIS.TABLE`` that has the rows to reduce. None for quantities of a
        configuration, which need no analysis.
    meaning
        Meaning of the figure in a few words, such as ``largest driving torque``. The
        screen prints it in place of the name, with the unit beside it.
    only
        Names and texts of columns of the table. Only rows with these texts are reduced.
    place
        With several inputs, the driven pair with the variable that the reductions
        ``argmin`` and ``argmax`` return.
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
        """Raise `AnalysisError` if the reduction, the name or the point is not valid."""
        if self.reduction not in REDUCTIONS:
            raise AnalysisError(
                f'{self.name}: "{self.reduction}" is not a reduction'
                f"{choices(self.reduction, REDUCTIONS, 'Reductions')}"
            )
        if not re.fullmatch(r"[A-Za-z_]\w*", self.name):
            raise AnalysisError(
                f'"{self.name}" cannot name a figure of merit; use only letters, digits '
                "and _, and no digit at the beginning"
            )
        # The reduction `at` takes the expression at a point: a tuple of input values. The
        # tuple is empty if no point is given.
        has_point = len(self.point) > 0
        needs_point = REDUCTION_BY_NAME[self.reduction].needs_point
        if has_point != needs_point:
            raise AnalysisError(
                f"{self.name}: the reduction at(EXPRESSION, Q) needs an input value Q, "
                "and no other reduction accepts one"
            )
        if not all(map(math.isfinite, self.point)):
            raise AnalysisError(
                f"{self.name}: the reduction at(EXPRESSION, Q) needs a finite input value Q"
            )

    @property
    def of_table(self) -> tuple[str, str]:
        """The names of the analysis and of its table."""
        assert self.table is not None
        analysis, _, table = self.table.partition(".")
        return analysis, table

    def parsed(self, names: Units) -> Expression:
        """Return the expression of this figure of merit, parsed from its text.

        A figure of merit is a number that rates a design, such as the largest value of an
        expression over all samples.

        Parameters
        ----------
        names
            Units of the quantities that the expression may contain, by their names.

        Raises
        ------
        AnalysisError
            If the text is no expression, or contains other names.
        """
        try:
            return parse(self.expression, names)
        except ModelError as problem:
            raise AnalysisError(f"{self.name}: in the expression, {problem}") from None

    def unit(self, names: Units) -> str:
        """Return the unit of the figure of merit, or an empty text if it is not known.

        The figure of merit is a number that rates a design: a reduction, such as ``min``,
        of an expression. The unit is known in two cases:

        - The figure is an input value (reductions ``argmin`` and ``argmax``, the input at
          which the expression is smallest or largest).
        - The expression is a single quantity or its absolute value.

        Parameters
        ----------
        names
            Units of quantities by their names. A single input has the name ``q``. One of
            several inputs has, for example, the name ``q_21``.
        """
        if REDUCTION_BY_NAME[self.reduction].returns_input:
            # `place` is the pair of the input, such as "21". A single input has the name
            # "q", even if `place` names its pair.
            return names.get(f"q_{self.place}", names.get("q", ""))
        quantity = _QUANTITY_PATTERN.fullmatch(self.expression)
        return names.get(quantity["name"], "") if quantity else ""


def parse_merit(text: str, angle_unit: AngleUnit) -> FigureOfMerit:
    """Return the figure of merit that a text ``NAME=REDUCTION(EXPRESSION)`` describes.

    The name is optional.

    Parameters
    ----------
    text
        For example ``least=min(transmission_angle_43)`` or ``at(theta_41, 30)``. The text
        ``max(workspace.areas: size)`` is the maximum of a column over all rows of a table,
        and ``max(workspace.areas part=whole: size)`` over the rows that meet a condition.
    angle_unit
        Unit of angles in the mechanism file. An input of ``at`` has this unit if the text
        states none.

    Raises
    ------
    AnalysisError
        If the text does not have this form.
    """
    merit_match = _MERIT_PATTERN.fullmatch(text.strip())
    if merit_match is None:
        raise AnalysisError(
            f'"{text}" is not a figure of merit; write NAME=REDUCTION(EXPRESSION), such as '
            f"least=min(transmission_angle_43). Reductions: {listing(REDUCTIONS)}"
        )
    name, reduction, expression = merit_match.group("name", "reduction", "content")
    table = None
    conditions = ""
    if table_match := _TABLE_PATTERN.fullmatch(expression):
        table, conditions, expression = table_match.group(
            "table", "conditions", "expression"
        )

    # Texts after the expression, which become a part of the default name.
    arguments: list[str] = []
    point: tuple[float, ...] = ()
    place = ""
    if reduction == "at":
        if point_match := _POINT_PATTERN.fullmatch(expression):
            expression = point_match["expression"]
            # The inputs, such as ", 30, 45", begin with a comma: the first part is empty.
            arguments = re.split(r"\s*,\s*", point_match["inputs"])[1:]
        try:
            point = tuple(read_quantity(item, ANGLE, angle_unit) for item in arguments)
            reason = ""
        except QuantityError as problem:
            reason = f": {problem}"
        if not point:
            raise AnalysisError(
                f'"{text}": the reduction "at" needs an expression and the values of all '
                f"inputs, such as at(theta_41, 30){reason}"
            )
    elif reduction.startswith("arg") and (
        place_match := _PLACE_PATTERN.fullmatch(expression)
    ):
        expression, place = place_match.group("expression", "pair")
        arguments = [place]
    expression = expression.strip()
    if name is None:
        words = "_".join([reduction, expression, *arguments])
        name = re.sub(r"\W+", "_", words).strip("_")
    return FigureOfMerit(
        name=name,
        reduction=reduction,
        expression=expression,
        point=point,
        table=table,
        only=tuple(_CONDITION_PATTERN.findall(conditions)),
        place=place,
    )
