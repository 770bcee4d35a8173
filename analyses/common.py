"""Columns, plots and findings that several analyses share."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spherekit.plugin import (
    Batch,
    Column,
    Floats,
    Scene,
    Series,
    TableData,
    input_columns,
)
from spherekit.plugin.motion import Motion
from spherekit.plugin.rotations import (
    MidPlaneArchitecture,
)


def row_columns(batch: Batch, timed: bool = False) -> dict[str, NDArray[Any]]:
    """Return sample, assembly mode and inputs of all rows, and their time if asked for."""
    return {
        "sample": batch.sample,
        "assembly_mode": batch.assembly_mode,
        **({"t": batch.t} if timed else {}),
        **input_columns(batch.mechanism, batch.inputs),
    }


def repeated(columns: TableData, subjects: Sequence[str], name: str) -> TableData:
    """Return columns with a row for each subject at every row, the subjects as `name`."""
    count = len(next(iter(columns.values())))
    return {
        **{key: np.repeat(values, len(subjects)) for key, values in columns.items()},
        name: np.tile(np.array(subjects, dtype=str), count),
    }


def curve(
    group: str,
    label: str,
    title: str,
    values: Floats,
    unit: str = "",
    link: int | None = None,
) -> Series:
    """Return a quantity (n,) to be plotted, with others of its group, against the rows."""
    name = re.sub(r"[^A-Za-z0-9-]+", "_", label)
    return Series(f"plots/{group}/{name}", label, title, values, unit, link)


def plotted(batch: Batch, curves: Sequence[Series]) -> tuple[Scene, ...]:
    """Return a scene for each assembly mode, with its part of every curve."""
    return tuple(
        Scene(mode, tuple(replace(one, values=one.values[rows]) for one in curves))
        for mode, rows in batch.assembly_mode_rows().items()
    )


def largest_torques(batch: Batch, torques: Floats, size: str) -> dict[str, Any]:
    """Return by input the torque (n, inputs) farthest from 0 as `size`, and where it is."""
    figures: dict[str, Any] = {}
    for k, name in enumerate(batch.moving_inputs):
        torque = np.abs(torques[:, k])
        if np.any(np.isfinite(torque)):
            row = int(np.nanargmax(torque))
            figures[name] = {
                size: float(torques[row, k]),
                "at_sample": int(batch.sample[row]),
                "at_assembly_mode": int(batch.assembly_mode[row]),
                "at_rad": batch.inputs[row].tolist(),
            }
    return figures


def said_of_torques(figures: Mapping[str, Any], size: str, what: str) -> tuple[str, ...]:
    """Return in words what `largest_torques` found."""
    return tuple(
        f"largest {what} at {name}: {largest[size]:.6g} N m at sample "
        f"{largest['at_sample']} of assembly mode {largest['at_assembly_mode']}"
        if largest[size]
        else f"{what} at {name}: zero in every row, to rounding"
        for name, largest in figures.items()
    )


def largest_of(
    before: Mapping[str, Any], now: Mapping[str, Any], size: str
) -> dict[str, Any]:
    """Return by name whichever record of two has the number `size` farther from 0."""
    return {
        name: max(
            (records[name] for records in (before, now) if name in records),
            key=lambda record: abs(record[size]),
        )
        for name in {**before, **now}
    }


def as_loads_see(batch: Batch) -> Motion:
    """Return the configurations of a batch with the angles of its loads going on.

    The batch needs the tracer, and continued values of the pairs that loads depend on.
    """
    values = batch.motion.values.copy()
    for pair in batch.needs.continued_values:
        values[:, batch.mechanism.angles[pair]] = batch.continued_value(pair)
    return replace(batch.motion, values=values)


MODE = Column("working_mode", "", "signs of the working mode's legs", "text")


DIRECTION = tuple(
    Column(name, "", "of the direction, or of the unit quaternion xyzw", turns="otherwise")
    for name in "xyz"
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


TILTED = tuple(
    Column(name, "rad", meaning, turns="otherwise")
    for name, meaning in (
        ("azimuth", "of the direction, or in which the link is tilted"),
        ("tilt", "of the direction, or of the link's z axis"),
        ("torsion", "turn of the link that is not a tilt; empty for directions"),
    )
)


def place_columns(places: Floats, form: MidPlaneArchitecture | None) -> dict[str, Any]:
    """Return the columns of directions (n, 3), or of quaternions xyzw (n, 4).

    With the angles of the mid-planes of directions, where the mechanism has these.
    """
    columns = {name: places[:, k] for k, name in enumerate("xyzw"[: places.shape[1]])}
    if form is not None and places.shape[1] == len(DIRECTION):
        columns["phi"], columns["gamma"], _ = form.angles_to(places)
    return columns
