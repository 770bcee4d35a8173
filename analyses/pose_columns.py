"""Columns that say a pose of an output and its working mode."""

from typing import Any

from spherekit.plugin import Column, Floats

MODE = Column("working_mode", "", "signs of the working mode's legs", "text")
PLACE = tuple(
    Column(name, "", meaning, turns="otherwise")
    for name, meaning in (
        ("x", "of the direction, or of the unit quaternion xyzw"),
        ("y", "of the direction or quaternion"),
        ("z", "of the direction or quaternion"),
        ("w", "of the quaternion; empty for directions"),
    )
)


def place_columns(places: Floats) -> dict[str, Any]:
    """Return the columns of directions (n, 3), or of quaternions xyzw (n, 4)."""
    return {name: places[:, k] for k, name in enumerate("xyzw"[: places.shape[1]])}
