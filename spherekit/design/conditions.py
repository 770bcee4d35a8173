"""Conditions on designs: comparisons of expressions of what a table has."""

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from spherekit.errors import DesignError, ModelError
from spherekit.model.expression import Expression, parse

_COMPARED = re.compile(r"(<=|>=|<|>)")

_HOLDS = {"<": np.less, "<=": np.less_equal, ">": np.greater, ">=": np.greater_equal}


@final
@dataclass(frozen=True)
class Condition:
    """``left < right`` of two expressions; where a value is NaN it does not hold."""

    text: str
    left: Expression
    sign: str
    right: Expression

    @property
    def names(self) -> frozenset[str]:
        """What it depends on."""
        return self.left.names | self.right.names

    def holds(self, columns: Mapping[str, Any]) -> NDArray[np.bool_]:
        """Return for which rows it holds, from columns (n,) by name."""
        left, right = (
            side.evaluate({name: columns[name] for name in side.names})
            for side in (self.left, self.right)
        )
        with np.errstate(invalid="ignore"):
            return np.asarray(_HOLDS[self.sign](left, right))

    def slack(self, columns: Mapping[str, Any]) -> NDArray[np.float64]:
        """Return by how much it holds (n,): negative where it does not."""
        left, right = (
            side.evaluate({name: columns[name] for name in side.names})
            for side in (self.left, self.right)
        )
        return np.asarray(right - left if self.sign.startswith("<") else left - right)


def condition(text: str, names: Collection[str]) -> Condition:
    """Return the condition that a text states.

    Raises
    ------
    DesignError
        If it is no comparison, or of other names.
    """
    parts = _COMPARED.split(text)
    if len(parts) != 3:
        raise DesignError(
            f'"{text}" is no condition: write one comparison, such as '
            "links_2_arc < links_4_arc; give several one by one"
        )
    left, sign, right = parts
    try:
        return Condition(text, parse(left, names), sign, parse(right, names))
    except ModelError as problem:
        raise DesignError(f'"{text}": {problem}') from None
