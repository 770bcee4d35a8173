"""Records of arrays with a row for each thing: some of the rows, and records joined."""

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray


class ArrayRows:
    """A dataclass whose arrays have their rows along the first axis.

    So have those of its records of this kind, dictionaries and tuples; the rest is kept.
    """

    def rows(self, chosen: slice | NDArray[Any]) -> Self:
        """Return some rows, chosen by a mask, a slice or numbers."""
        return type(self)(
            **{name: _taken(part, chosen) for name, part in _parts(self).items()}
        )

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """Return the rows of all parts in order, with the rest of the first."""
        every = [_parts(part) for part in parts]
        return cls(**{name: _joined([part[name] for part in every]) for name in every[0]})


def _parts(record: Any) -> dict[str, Any]:
    return {item.name: getattr(record, item.name) for item in fields(record)}


def _taken(part: Any, chosen: Any) -> Any:
    if isinstance(part, np.ndarray):
        return part[chosen]
    if isinstance(part, ArrayRows):
        return part.rows(chosen)
    if isinstance(part, Mapping):
        return {key: _taken(value, chosen) for key, value in part.items()}
    return tuple(_taken(item, chosen) for item in part) if type(part) is tuple else part


def _joined(parts: Sequence[Any]) -> Any:
    first = parts[0]
    if isinstance(first, np.ndarray):
        return np.concatenate(parts)
    if isinstance(first, ArrayRows):
        return type(first).joined(parts)
    if isinstance(first, Mapping):
        return {key: _joined([part[key] for part in parts]) for key in first}
    if type(first) is tuple:
        return tuple(_joined(items) for items in zip(*parts, strict=True))
    return first
