"""Columns, plots and findings that several analyses share."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spherekit.plugin import (
    Batch,
    Column,
    Floats,
    Mechanism,
    Scene,
    Series,
    Status,
    TableData,
    degrees_text,
    input_columns,
    number_text,
    numbered,
)
from spherekit.plugin.motion import Motion
from spherekit.plugin.rotations import MidPlaneArchitecture

WORKING_MODE = Column(
    "working_mode",
    "",
    "working mode (a way to assemble the legs): one sign for each leg, such as +-",
    "text",
)
"""The column of working modes."""

DIRECTION_COLUMNS = tuple(
    Column(
        name,
        "",
        f"{name} component of the output direction or, if the output is an orientation, "
        "of its unit quaternion (x, y, z, w), in the axes of the reference link of the "
        "output",
        turns="otherwise",
    )
    for name in "xyz"
)
"""The columns of a direction, or of the first three components of a unit quaternion."""

MID_PLANE_FORMULAS = {"phi": "-2 arcsin(n_x)", "gamma": "2 arcsin(n_y)"}
"""Formulas of the angles of the mid-plane with the unit normal n."""

MID_PLANE_NORMAL = (
    "n is the unit normal of the mid-plane (the plane of symmetry of base and output "
    "link); empty if there is no such plane"
)
"""Explanation of the normal n for meanings of columns."""

MID_PLANE_COLUMNS = tuple(
    Column(name, "rad", f"angle {name} = {formula}, where {MID_PLANE_NORMAL}")
    for name, formula in MID_PLANE_FORMULAS.items()
)
"""The columns of the angles of the mid-plane of a direction."""

POSE_COLUMNS = (
    *DIRECTION_COLUMNS,
    Column(
        "w",
        "",
        "w component (the real part) of the unit quaternion of the output "
        "orientation; empty if the output is a direction",
        turns="otherwise",
    ),
    *MID_PLANE_COLUMNS,
)
"""The columns of a pose, which is a direction or an orientation of the output."""

TILT_TORSION_COLUMNS = tuple(
    Column(name, "rad", meaning, turns="otherwise")
    for name, meaning in (
        (
            "azimuth",
            "azimuth, about the z axis of the reference link, of the output direction "
            "or, if the output is an orientation, of the z axis of the output link",
        ),
        (
            "tilt",
            "angle from the z axis of the reference link to the output direction or, if "
            "the output is an orientation, to the z axis of the output link",
        ),
        (
            "torsion",
            "rotation of the output link about its own tilted z axis; empty if the "
            "output is a direction",
        ),
    )
)
"""The columns of a pose in tilt and torsion angles."""


def row_columns(batch: Batch, with_time: bool = False) -> dict[str, NDArray[Any]]:
    """Return the columns that identify the rows of a batch of results.

    A row is one sample of the motion in one assembly mode (way to assemble the links).

    Parameters
    ----------
    batch
        The n rows.
    with_time
        Whether the time of each row is included.

    Returns
    -------
    Columns (n,) by name: sample, assembly mode, time (s) if requested, and one for each
    input (rad).
    """
    columns: dict[str, NDArray[Any]] = {
        "sample": batch.sample,
        "assembly_mode": batch.assembly_mode,
    }
    if with_time:
        columns["t"] = batch.t
    return {**columns, **input_columns(batch.mechanism, batch.inputs)}


def repeat_rows(columns: TableData, subjects: Sequence[str], name: str) -> TableData:
    """Return columns in which each row is repeated once for every subject.

    An example is a table with one row for each configuration and link.

    Parameters
    ----------
    columns
        Columns (n,) of a table by name.
    subjects
        The k subjects, such as names of links.
    name
        Name of the new column that lists the subjects.

    Returns
    -------
    Columns (n k,). The k copies of one row follow each other.
    """
    row_count = len(next(iter(columns.values())))
    repeated: TableData = {
        key: np.repeat(values, len(subjects)) for key, values in columns.items()
    }
    return {**repeated, name: np.tile(np.array(subjects, dtype=str), row_count)}


def plot_series(
    group: str,
    label: str,
    title: str,
    values: Floats,
    unit: str = "",
    link: int | None = None,
) -> Series:
    """Return the declaration of a plot of a quantity against the rows of a batch.

    Parameters
    ----------
    group
        Name of the folder of the plot in the recording.
    label, title
        Name of the curve, and title of the plot. Curves with the same title are drawn
        together.
    values
        (n,) values of the quantity, one for each row.
    unit
        Its unit.
    link
        Index of a link, if the curve should have the colour of this link.
    """
    # Each curve needs a path of its own. A label can have the name of a link, pair or load,
    # and numbers. Names have only letters, digits and underscores, so different names give
    # different paths. Every other character becomes a hyphen, also the minus. So "at -1"
    # and "at 1" give the different paths "at--1" and "at-1".
    file_name = re.sub(r"[^A-Za-z0-9_]", "-", label)
    return Series(f"plots/{group}/{file_name}", label, title, values, unit, link)


def plots_by_mode(batch: Batch, plots: Sequence[Series]) -> tuple[Scene, ...]:
    """Return plots on one page for each assembly mode (way to assemble the links).

    `plots` have one value for each row (sample of one mode) of the batch. Each page has the
    values of its mode.
    """
    scenes = []
    for mode, rows in batch.assembly_mode_rows().items():
        plots_of_mode = [replace(plot, values=plot.values[rows]) for plot in plots]
        scenes.append(Scene(mode, tuple(plots_of_mode)))
    return tuple(scenes)


def describe_place(batch: Batch, row: int) -> str:
    """Return words for the place of a row: its time or its inputs, and its assembly mode.

    An example is ``21 = 30 deg, mode 0``. A row is one sample of one assembly mode. The
    time is used if the motion has times and the analysis reads them.
    """
    mode = f"mode {batch.assembly_mode[row]}"
    # `needs.time` states that the analysis reads the times.
    if batch.timed and batch.needs.time:
        return f"t = {number_text(float(batch.t[row]))} s, {mode}"
    inputs = [
        f"{pair} = {degrees_text(float(q))} deg"
        for pair, q in zip(batch.moving_inputs, batch.inputs[row], strict=True)
    ]
    return ", ".join([*inputs, mode])


def find_largest_torques(batch: Batch, torques: Floats, key: str) -> dict[str, Any]:
    """Return the torque of largest size at each input, and where it occurs.

    Parameters
    ----------
    batch
        n rows, each one sample of the motion in one assembly mode (way to assemble the
        links).
    torques
        (n, inputs) torques at the inputs (N m), NaN if unknown.
    key
        Key of the torque in the records.

    Returns
    -------
    By the name of each input, a record (entry of the summary) with the torque (N m). The
    record has the sample, assembly mode and inputs (rad) at which the torque occurs.
    ``place`` has these in words. These entries are missing if no torque is known.
    ``by_mode`` has such a record for each mode, and whether the mode exists at all samples.
    ``simulated`` is whether the motion is a simulation.
    """
    records: dict[str, Any] = {}
    for number, name in enumerate(batch.moving_inputs):
        input_torques = torques[:, number]
        all_rows = np.arange(len(input_torques))
        record = _record_largest_torque(batch, input_torques, all_rows, key)
        record["by_mode"] = {
            str(mode): {
                **_record_largest_torque(batch, input_torques, all_rows[mode_rows], key),
                "exists_at_all_samples": not np.any(
                    batch.status[mode_rows] == Status.OUT_OF_REACH
                ),
            }
            for mode, mode_rows in batch.assembly_mode_rows().items()
        }
        record["simulated"] = batch.simulated
        records[name] = record
    return records


def _record_largest_torque(
    batch: Batch, torques: Floats, rows: NDArray[np.intp], key: str
) -> dict[str, Any]:
    """Return the torque of largest size in some rows of a batch, and where it occurs.

    Parameters
    ----------
    batch
        n rows, each one sample of the motion in one assembly mode (way to assemble the
        links).
    torques
        (n,) torques (N m), NaN if unknown.
    rows
        Indices of the rows that are compared.
    key
        Key of the torque in the result.

    Returns
    -------
    An entry of the summary: the torque, and the sample, assembly mode and inputs (rad) at
    which it occurs. Empty if no torque is known.
    """
    sizes = np.abs(torques[rows])
    if not np.any(np.isfinite(sizes)):
        return {}
    row = int(rows[np.nanargmax(sizes)])
    return {
        key: float(torques[row]),
        "at_sample": int(batch.sample[row]),
        "at_assembly_mode": int(batch.assembly_mode[row]),
        "at_rad": batch.inputs[row].tolist(),
        "place": describe_place(batch, row),
    }


def describe_largest_torques(
    records: Mapping[str, Any], key: str, quantity: str
) -> tuple[str, ...]:
    """Return sentences about the largest torque at each input.

    For each input, one sentence is about the modes (ways to assemble the links) that exist
    at all samples. Another sentence is about the modes that exist at a part of the samples.
    As a rule such a mode ends at a dead centre, near which torques grow without bound.

    Parameters
    ----------
    records
        By the name of an input, the record of the largest torque at this input, as
        `find_largest_torques` returns it.
    key
        Key of the torque in the records.
    quantity
        The torque in words, such as ``driving torque``.
    """
    sentences = []
    has_ending_modes = False
    for name, record in records.items():
        if key not in record:
            continue
        if not record[key]:
            # No sentence is needed for a simulation. Its report already states which inputs
            # are driven.
            if record["simulated"]:
                continue
            sentences.append(f"The {quantity} at {name} is 0 throughout")
            continue
        whole_modes = {}
        ending_modes = {}
        for mode, mode_record in record["by_mode"].items():
            if mode_record["exists_at_all_samples"]:
                whole_modes[mode] = mode_record
            else:
                ending_modes[mode] = mode_record
        what = f"Largest {quantity} at {name}"
        largest = _largest_record(whole_modes.values(), key)
        if largest:
            sentences.append(f"{what}: {largest[key]:.6g} N m at {largest['place']}")
        largest = _largest_record(ending_modes.values(), key)
        if largest:
            has_ending_modes = True
            exist = "exists" if len(ending_modes) == 1 else "exist"
            sentences.append(
                f"{what} in {numbered('mode', ending_modes)}, which {exist} at a part of "
                f"the samples only: {largest[key]:.6g} N m at {largest['place']}"
            )
    if has_ending_modes:
        sentences.append(
            "As a rule, modes that exist at a part of the samples end at dead centres. "
            "Near a dead centre the torque grows without bound, so it can be larger "
            "between the samples"
        )
    return tuple(sentences)


def _largest_record(records: Iterable[Mapping[str, Any]], key: str) -> Mapping[str, Any]:
    """Return the record with the largest value of a key, empty if none has the key."""
    records_with_key = [record for record in records if key in record]
    return max(records_with_key, key=lambda record: abs(record[key]), default={})


def merge_largest(
    first: Mapping[str, Any], second: Mapping[str, Any], key: str
) -> dict[str, Any]:
    """Merge records of the largest values in two blocks of rows.

    A record is an entry of a summary: the largest value of one quantity in a block, and
    further facts such as its place. For each quantity, the record with the larger value is
    returned. It belongs to the largest value in both blocks together.

    Parameters
    ----------
    first, second
        The records of each block, by the name of the quantity or of the input to which it
        belongs.
    key
        Key of the value in a record. Absolute values are compared.
    """
    return {
        name: _largest_record([first.get(name, {}), second.get(name, {})], key)
        for name in {**first, **second}
    }


def merge_largest_torques(
    first: Mapping[str, Any], second: Mapping[str, Any], key: str
) -> dict[str, Any]:
    """Merge records (summary entries) of the largest torques of two blocks of rows.

    A run is computed in blocks. The summary needs the largest torque of the whole run, for
    each input and, under ``by_mode``, for each assembly mode. A mode exists at all samples
    of the run if it does so in every block that has rows of this mode.

    Parameters
    ----------
    first, second
        Records of the two blocks, by the name of an input. They have the entries that
        `find_largest_torques` describes.
    key
        Key of the torque in a record. Absolute values are compared.
    """
    merged: dict[str, Any] = {}
    for name, largest in merge_largest(first, second, key).items():
        first_modes = first[name]["by_mode"]
        second_modes = second[name]["by_mode"]
        by_mode = {}
        for mode in {**first_modes, **second_modes}:
            mode_records = [
                modes[mode] for modes in (first_modes, second_modes) if mode in modes
            ]
            by_mode[mode] = {
                **_largest_record(mode_records, key),
                "exists_at_all_samples": all(
                    record["exists_at_all_samples"] for record in mode_records
                ),
            }
        # If no torque at this input is known, `largest` is empty. The entry ``simulated``
        # is then taken from the first block.
        merged[name] = {**first[name], **largest, "by_mode": by_mode}
    return merged


def continue_load_angles(batch: Batch) -> Motion:
    """Return the configurations of a batch, with some angles that count whole revolutions.

    Loads such as springs depend on the whole rotation of a pair, including whole
    revolutions. The angles of these pairs are therefore continued from row to row, without
    jumps of 2 pi. The needs of the analysis must list these continued values and the
    position analysis (tracer).
    """
    values = batch.motion.values.copy()
    for pair in batch.needs.continued_values:
        values[:, batch.mechanism.angles[pair]] = batch.continued_value(pair)
    return replace(batch.motion, values=values)


def direction_or_quaternion_columns(
    poses: Floats, architecture: MidPlaneArchitecture | None
) -> dict[str, Any]:
    """Return table columns that describe poses of an output, by their names.

    The columns are the components of directions or quaternions. Angles of mid-planes follow
    for some mechanisms.

    In some mechanisms, base and output are mirror images of each other about a plane, the
    mid-plane. In such a mechanism, a direction of the output determines the mid-plane. Chen
    et al. 2021 describe its unit normal (x, y, z) by the angles phi = -2 arcsin(x) and
    gamma = 2 arcsin(y) (rad).

    Parameters
    ----------
    poses
        Directions (n, 3), or unit quaternions xyzw (n, 4).
    architecture
        The mid-plane symmetric architecture of the mechanism, None if it has none.
    """
    component_count = poses.shape[1]
    columns = {
        name: poses[:, number] for number, name in enumerate("xyzw"[:component_count])
    }
    are_directions = component_count == len(DIRECTION_COLUMNS)
    if architecture is not None and are_directions:
        # The third angle, omega, is a function of the other two.
        phi, gamma, _omega = architecture.angles_to(poses)
        columns["phi"] = phi
        columns["gamma"] = gamma
    return columns


def output_in_words(mechanism: Mechanism, links: str) -> str:
    """Return the name of an output with its links, such as ``rocker (4/1)``.

    Only the links are returned unless exactly one output has these links.

    Parameters
    ----------
    mechanism
        The mechanism with its declared outputs.
    links
        The names of the output link and of its reference link, such as ``4/1``.
    """
    names = [
        output.name
        for output in mechanism.outputs
        if f"{output.link}/{output.relative_to}" == links
    ]
    return f"{names[0]} ({links})" if len(names) == 1 else links
