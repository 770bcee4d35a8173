"""Parameters and data as JSON has them, the same in every process."""

import math
from collections.abc import Mapping
from typing import Any


def as_json(value: Any) -> Any:
    """Return a value as JSON gives it back: sets in order, other things by their words."""
    if isinstance(value, Mapping):
        return {str(key): as_json(item) for key, item in value.items()}
    if isinstance(value, set | frozenset):
        value = sorted(value, key=str)
    if isinstance(value, list | tuple):
        return [as_json(item) for item in value]
    if isinstance(value, float):
        return float(value)  # numbers of files remember how they are written
    return value if isinstance(value, str | int | None) else repr(value)


def finite(value: float) -> float | None:
    """Return a number as JSON has it, None where there is none."""
    return float(value) if math.isfinite(value) else None
