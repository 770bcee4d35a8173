"""Conditions on the columns of a table of designs."""

import re
from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import numpy as np

from spherekit.arrays import Bools, Floats
from spherekit.errors import DesignError, ModelError
from spherekit.mechanism.load_expression import Expression, parse

Columns = dict[str, Any]
"""The columns (rows,) of a table of designs, by name."""

_COMPARISON_SIGN = re.compile(r"(<=|>=|<|>)")


@dataclass(frozen=True)
class Condition:
    """A condition ``less < more``, or ``less <= more``, on the designs of a table.

    Both sides are expressions of columns, such as sizes. The condition is violated if a
    side is NaN.

    Attributes
    ----------
    text
        The condition as the user wrote it.
    less, more
        The expressions on the two sides.
    allows_equality
        Whether the condition is met if the two sides are equal.
    """

    text: str
    less: Expression
    more: Expression
    allows_equality: bool

    @property
    def names(self) -> frozenset[str]:
        """Names of the columns on which the condition depends."""
        return self.less.names | self.more.names

    def evaluate_sides(self, columns: Columns) -> tuple[Floats, Floats]:
        """Return the values (rows,) of `less` and of `more` for the rows of a table.

        A side without columns has a single value.
        """
        less = self.less.evaluate({name: columns[name] for name in self.less.names})
        more = self.more.evaluate({name: columns[name] for name in self.more.names})
        return less, more

    def find_met(self, columns: Columns) -> Bools:
        """Return a mask (rows,) of the rows of a table that meet the condition.

        A condition without columns has a single value.
        """
        less, more = self.evaluate_sides(columns)
        with np.errstate(invalid="ignore"):
            if self.allows_equality:
                return np.less_equal(less, more)
            return np.less(less, more)


def parse_condition(text: str, names: Collection[str]) -> Condition:
    """Read a condition on designs, such as ``"links_2_arc < links_4_arc"``.

    Parameters
    ----------
    text
        The condition: two expressions with ``<``, ``<=``, ``>`` or ``>=`` between them.
    names
        Names that the expressions may contain: columns of the table of designs.

    Returns
    -------
    The condition. One with ``>`` or ``>=`` is turned round, so that the smaller side comes
    first.

    Raises
    ------
    DesignError
        If the text is not one comparison, or contains another name.
    """
    parts = _COMPARISON_SIGN.split(text)
    if len(parts) != 3:
        raise DesignError(
            f'"{text}" is not a condition; write a single comparison, such as links_2_arc '
            "< links_4_arc, and give several conditions separately"
        )
    left_text, sign, right_text = parts
    try:
        left = parse(left_text, names)
        right = parse(right_text, names)
    except ModelError as problem:
        raise DesignError(f'"{text}": on one side of the comparison, {problem}') from None
    allows_equality = sign.endswith("=")
    if sign.startswith("<"):
        return Condition(text, left, right, allows_equality)
    return Condition(text, right, left, allows_equality)
