"""Conversion of parameters and data to values of JSON, equal in every process."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np


def as_json(value: Any) -> Any:
    """Return a value in the form that it has after it is written to JSON and read again.

    Keys become text by `str`, sets become sorted lists, and arrays of NumPy become lists.
    Objects of other types become their `repr`.
    """
    if isinstance(value, np.ndarray):
        value = value.tolist()  # the `repr` of an array omits digits and entries
    if isinstance(value, Mapping):
        return {str(key): as_json(item) for key, item in value.items()}
    if isinstance(value, set | frozenset):
        value = sorted(value, key=str)
    if isinstance(value, list | tuple):
        return [as_json(item) for item in value]
    if isinstance(value, float):
        return float(value)  # numbers read from files are of a subclass
    return value if isinstance(value, str | int | None) else repr(value)


def finite_or_none(value: float) -> float | None:
    """Return a finite number, and None for NaN and infinity, which JSON does not have."""
    return float(value) if math.isfinite(value) else None
