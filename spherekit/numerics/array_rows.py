"""Dataclasses of arrays that share their rows: select, replace and join rows."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from typing import Any, Self

import numpy as np

from spherekit.arrays import Array, Indices


class ArrayRows:
    """Base class of dataclasses with arrays whose first axes are the same items (rows).

    A row is one item, such as one sample, and each array has a part of its data. The
    methods select and join rows of all arrays together. A field may be an array, another
    `ArrayRows`, or a dictionary or tuple of these. Fields of other types belong to all rows
    and stay unchanged.
    """

    def rows(self, chosen: slice | Array) -> Self:
        """Return an object with some of the rows, chosen by a mask, a slice or indices."""
        selected = _transform_fields(
            [_field_values(self)],
            combine_arrays=lambda arrays: arrays[0][chosen],
            combine_records=lambda records: records[0].rows(chosen),
        )
        return type(self)(**selected)

    def assign_rows(self, rows: Indices, new: Self) -> None:
        """Replace some rows of the arrays in place by the rows of another object.

        Nested `ArrayRows` and arrays in dictionaries are changed too. Arrays in tuples are
        not changed, so the class must not have a field with such a tuple.

        Parameters
        ----------
        rows
            (k,) indices of the rows to replace.
        new
            An object of the same type with k rows.
        """
        new_values = _field_values(new)
        for name, value in _field_values(self).items():
            if isinstance(value, np.ndarray):
                value[rows] = new_values[name]
            elif isinstance(value, ArrayRows):
                value.assign_rows(rows, new_values[name])
            elif isinstance(value, Mapping):
                for key, array in value.items():
                    array[rows] = new_values[name][key]

    @classmethod
    def concatenate(cls, parts: Sequence[Self]) -> Self:
        """Return an object with the rows of all parts (of this class) in their order.

        Fields that are not arrays are taken from the first part.
        """
        joined = _transform_fields(
            [_field_values(part) for part in parts],
            combine_arrays=np.concatenate,
            combine_records=lambda records: type(records[0]).concatenate(records),
        )
        return cls(**joined)


def _field_values(record: Any) -> dict[str, Any]:
    """Return the field values of a dataclass by name, without copying the values."""
    return {item.name: getattr(record, item.name) for item in fields(record)}


def _transform_fields(
    values: Sequence[Any],
    combine_arrays: Callable[[Any], Any],
    combine_records: Callable[[Any], Any],
) -> Any:
    """Combine the values that one field has in several records.

    A record is an `ArrayRows` object: a dataclass of arrays with common rows. Dictionaries
    and plain tuples are combined item by item. All other values belong to all rows, and are
    taken from the first record.

    Parameters
    ----------
    values
        The value of the field in each record, all of one structure. Dictionaries of all
        fields by name are combined in the same way.
    combine_arrays
        Returns one array for the arrays of all records.
    combine_records
        Returns one record for the nested records of all records.
    """
    first = values[0]
    if isinstance(first, np.ndarray):
        return combine_arrays(values)
    if isinstance(first, ArrayRows):
        return combine_records(values)
    if isinstance(first, Mapping):
        return {
            key: _transform_fields(
                [value[key] for value in values], combine_arrays, combine_records
            )
            for key in first
        }
    # A named tuple belongs to all rows.
    is_plain_tuple = type(first) is tuple
    if is_plain_tuple:
        return tuple(
            _transform_fields(entries, combine_arrays, combine_records)
            for entries in zip(*values, strict=True)
        )
    return first
