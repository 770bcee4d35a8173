"""The tables of the analysis `inverse_kinematics`, and how they are filled."""

from dataclasses import dataclass
from typing import Any, final

import numpy as np

from spherekit.plugin import (
    INPUTS,
    STATUS,
    Column,
    Floats,
    Mechanism,
    Status,
    Table,
    input_columns,
)
from spherekit.plugin.rotations import azimuth_tilt, quaternion, tilt_torsion, wrap
from spherekit.plugin.workspace import (
    ClosedKinematics,
    InverseRows,
    OutputKinematics,
    label_of,
    sense_of,
    turns_of,
)

from .pose_columns import MODE, PLACE, place_columns
from .pose_lists import PoseList

Row = dict[str, Any]

SAME_VALUES = 1e-6
"""Configurations whose variables (rad) differ by less are one."""
POSE = Column("pose", "", "number of the pose or of the inputs given, from 0", "integer")
PLACES = (
    *PLACE,
    *(
        Column(name, "rad", meaning, turns="otherwise")
        for name, meaning in (
            ("azimuth", "of the direction, or in which the link is tilted"),
            ("tilt", "of the direction, or of the link's z axis"),
            ("torsion", "of the orientation; empty for directions"),
        )
    ),
)
MIRROR_RATES = tuple(
    Column(f"d{name}_dq", "", f"derivative of {name} by q", per_input=True)
    for name in ("phi", "gamma")
)
SOLVED_BY = Column(
    "solved_by",
    "",
    "dyads, graph: all that were found; mid-plane: those that mirror base and output",
    "text",
)
INVERSE = Table(
    "inverse_kinematics",
    "one row per pose and working mode, or configuration found",
    (
        POSE,
        MODE,
        *PLACES,
        INPUTS,
        *(
            Column(
                f"rate_{axis}",
                "",
                f"rate of q per unit angular velocity of the output about {axis}",
                per_input=True,
            )
            for axis in "xyz"
        ),
        *MIRROR_RATES,
        Column("margin", "rad", "left to the nearest limit, negative outside"),
        Column("limiting", "", "that limit", "text"),
        Column("type_1", "", "0 at a type I singularity of q", per_input=True),
        Column("type_2", "", "0 at a type II singularity"),
        Column("sense", "", "sign of the determinant of the rates", "integer"),
        STATUS,
        SOLVED_BY,
        *(Column(f"near_{axis}", "", "of a reachable pose near by") for axis in "xyzw"),
        Column("away", "rad", "how far that is"),
    ),
)
FORWARD = Table(
    "forward",
    "one row per inputs given and pose found",
    (
        POSE,
        Column("solution", "", "number of the pose at these inputs", "integer"),
        Column("assembly_mode", "", "signs of the assembly mode's groups", "text"),
        Column("working_mode", "", "label of its working mode, if known", "text"),
        INPUTS,
        *PLACES,
        *MIRROR_RATES,
        Column("type_2", "", "0 at a type II singularity"),
        STATUS,
        SOLVED_BY,
    ),
)
PAIRS = Table(
    "pairs",
    "variables of pairs: one row per pose, mode and pair asked for",
    (
        POSE,
        MODE,
        Column("pair", "", "name of the pair", "text"),
        Column("value", "rad", "its variable"),
    ),
)


@final
@dataclass(frozen=True)
class FoundPoses:
    """What was asked for, and what was found: one of `rows` and `forward` is None."""

    solver: OutputKinematics
    given: PoseList
    rows: InverseRows | None
    forward: Row | None
    near: Floats
    away: Floats
    offered: int


def inverse_rows(mechanism: Mechanism, result: FoundPoses, rows: InverseRows) -> Row:
    """Return the configurations of poses, with a reachable pose near by."""
    poses = result.given.poses
    assert poses is not None
    directions = poses[rows.pose] if result.solver.points else None
    names = np.array([*rows.limits, ""])
    rates: Row = {}
    for k, axis in enumerate("xyz"):
        rates |= input_columns(mechanism, rows.rates[:, :, k], f"rate_{axis}")
    return {
        "pose": rows.pose,
        "working_mode": rows.mode,
        **{
            name: column[rows.pose]
            for name, column in _places(result.solver, poses).items()
        },
        **input_columns(mechanism, rows.inputs),
        **rates,
        **_mirror_rates(
            mechanism, result.solver, directions, turns_of(rows.rates, directions)
        ),
        "margin": rows.margin,
        "limiting": names[rows.limiting],
        **input_columns(mechanism, rows.type_1, "type_1"),
        "type_2": rows.type_2,
        "sense": sense_of(rows.rates, directions),
        "status": rows.status,
        "solved_by": result.solver.solved_by,
        **{f"near_{axis}": result.near[:, k] for k, axis in enumerate("xyzw")},
        "away": result.away,
    }


def forward_rows(mechanism: Mechanism, solver: OutputKinematics, inputs: Floats) -> Row:
    """Return the poses at inputs (n, inputs), each with the working mode that has them."""
    solutions = solver.forward(inputs)
    none = np.setdiff1d(np.arange(len(inputs)), solutions.row)
    order = np.argsort(np.concatenate([solutions.row, none]), kind="stable")
    pose = np.concatenate([solutions.row, none])[order]
    poses = solutions.rotations
    if solver.points:
        assert solutions.directions is not None
        poses = solutions.directions
    working = np.full(len(pose), "", dtype=f"<U{max(map(len, solver.labels), default=1)}")
    type_2 = np.full(len(pose), np.nan)
    type_2[: len(solutions.row)] = solver.type_2(solutions.values)
    if isinstance(solver, ClosedKinematics):
        rows = solver.inverse(poses, solver.labels, range(len(mechanism.pairs)))
        off = rows.values - solutions.values[rows.pose]
        off = np.abs(wrap(off)).max(axis=1)
        same = np.flatnonzero(off < SAME_VALUES)
        working[rows.pose[same]] = rows.mode[same]
    poses = np.concatenate([poses, np.full((len(none), *poses.shape[1:]), np.nan)])
    places = _places(solver, poses)
    turns = np.full((len(pose), 3, len(mechanism.inputs)), np.nan)
    if solver.form is not None:
        turns[: len(solutions.row)] = solver.turns(solutions.values)
    moved = _mirror_rates(mechanism, solver, poses, turns)
    first = np.searchsorted(pose, pose)
    status = np.full(len(pose), Status.OK, dtype=np.int8)
    status[len(solutions.row) :] = Status.OUT_OF_REACH
    modes = np.array([*map(label_of, solutions.signs), *("" for _ in none)], dtype=str)
    return {
        "pose": pose,
        "solution": np.arange(len(pose)) - first,
        "assembly_mode": modes[order],
        "working_mode": working[order],
        **input_columns(mechanism, inputs[pose]),
        **{name: column[order] for name, column in (places | moved).items()},
        "type_2": type_2[order],
        "status": status[order],
        "solved_by": solver.solved_by,
    }


def _places(solver: OutputKinematics, poses: Floats) -> Row:
    """Return the columns of poses."""
    if solver.points:
        angles, places = azimuth_tilt(poses), poses
    else:
        angles, places = tilt_torsion(poses), _quaternions(poses)
    return {
        **place_columns(places, solver.form),
        **dict(zip(("azimuth", "tilt", "torsion"), angles.T, strict=False)),
    }


def _mirror_rates(
    mechanism: Mechanism, solver: OutputKinematics, directions: Floats | None, turns: Floats
) -> Row:
    """Return the columns of the derivatives of phi and gamma by the inputs, if any."""
    if solver.form is None or directions is None:
        return {}
    rates = solver.form.angle_rates(directions, turns)
    return {
        name: column
        for k, angle in enumerate(("dphi_dq", "dgamma_dq"))
        for name, column in input_columns(mechanism, rates[:, k], angle).items()
    }


def _quaternions(rotations: Floats) -> Floats:
    """Return unit quaternions (n, 4) xyzw, NaN for NaN."""
    quaternions = np.full((len(rotations), 4), np.nan)
    finite = np.isfinite(rotations[:, 0, 0])
    quaternions[finite] = quaternion(rotations[finite])
    return quaternions


def pair_rows(mechanism: Mechanism, numbers: list[int], rows: InverseRows) -> Row:
    """Return the variables of some pairs, by their numbers."""
    names = np.array([mechanism.pairs[pair].name for pair in numbers], dtype=str)
    return {
        "pose": np.repeat(rows.pose, len(numbers)),
        "working_mode": np.repeat(rows.mode, len(numbers)),
        "pair": np.tile(names, len(rows)),
        "value": rows.values.ravel(),
    }
