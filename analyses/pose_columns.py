"""Columns that say a pose of an output and its working mode."""

from typing import Any

from spherekit.plugin import Column, Floats
from spherekit.plugin.rotations import MidPlaneArchitecture

MODE = Column("working_mode", "", "signs of the working mode's legs", "text")
DIRECTION = tuple(
    Column(name, "", meaning, turns="otherwise")
    for name, meaning in (
        ("x", "of the direction, or of the unit quaternion xyzw"),
        ("y", "of the direction or quaternion"),
        ("z", "of the direction or quaternion"),
    )
)
MIRROR = tuple(
    Column(name, "rad", f"{meaning}; empty without a mid-plane symmetric architecture")
    for name, meaning in (
        ("phi", "arc from Q to P, negative where P is on the side z0 < 0"),
        ("gamma", "turn of the mid-plane"),
    )
)
PLACE = (
    *DIRECTION,
    Column("w", "", "of the quaternion; empty for directions", turns="otherwise"),
    *MIRROR,
)


def place_columns(places: Floats, form: MidPlaneArchitecture | None) -> dict[str, Any]:
    """Return the columns of directions (n, 3), or of quaternions xyzw (n, 4).

    With the angles of the mid-planes of directions, where the mechanism has these.
    """
    columns = {name: places[:, k] for k, name in enumerate("xyzw"[: places.shape[1]])}
    if form is not None and places.shape[1] == len(DIRECTION):
        angles = form.angles_to(places)
        columns |= {"phi": angles.phi, "gamma": angles.gamma}
    return columns
