"""Small parts of the tables of a mechanism file that an import writes."""

from collections.abc import Sequence
from typing import Any

from spherekit.exchange.short_decimals import round_to_short_degrees

Table = dict[str, Any]
"""A table of a mechanism file: values by keys."""


def range_table(ends: Sequence[float]) -> Table:
    """Return a range of an angle, given by its two ends (rad), in degrees."""
    low, high = ends
    return {"from": round_to_short_degrees(low), "to": round_to_short_degrees(high)}
