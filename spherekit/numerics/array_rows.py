"""Records of arrays with one row for each item: selecting rows, joining records."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from typing import Any, Self

import numpy as np

from spherekit.arrays import Array, Indices


class ArrayRows:
    """A dataclass whose arrays have their rows along the first axis.

    So have those of its records of this kind, dictionaries and tuples; the rest is kept.
    """

    def rows(self, chosen: slice | Array) -> Self:
        """Return some rows, chosen by a mask, a slice or numbers."""
        made = _mapped([_parts(self)], lambda x: x[0][chosen], lambda x: x[0].rows(chosen))
        return type(self)(**made)

    def put(self, rows: Indices, new: Self) -> None:
        """Replace some rows of all arrays."""
        others = _parts(new)
        for name, part in _parts(self).items():
            if isinstance(part, np.ndarray):
                part[rows] = others[name]
            elif isinstance(part, ArrayRows):
                part.put(rows, others[name])
            elif isinstance(part, Mapping):
                for key, values in part.items():
                    values[rows] = others[name][key]

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """Return the rows of all parts in order, with the rest of the first."""
        every = [_parts(part) for part in parts]
        return cls(**_mapped(every, np.concatenate, lambda x: type(x[0]).joined(x)))


def _parts(record: Any) -> dict[str, Any]:
    return {item.name: getattr(record, item.name) for item in fields(record)}


def _mapped(
    parts: Sequence[Any], arrays: Callable[[Any], Any], records: Callable[[Any], Any]
) -> Any:
    """Return what alike parts of records become, arrays and records in them each by one."""
    first = parts[0]
    if isinstance(first, np.ndarray):
        return arrays(parts)
    if isinstance(first, ArrayRows):
        return records(parts)
    if isinstance(first, Mapping):
        items = {key: [part[key] for part in parts] for key in first}
        return {key: _mapped(held, arrays, records) for key, held in items.items()}
    if type(first) is tuple:
        return tuple(_mapped(held, arrays, records) for held in zip(*parts, strict=True))
    return first
