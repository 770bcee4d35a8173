"""The tables of the analysis `inverse_kinematics`, and how they are filled."""

from typing import Any

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
from spherekit.plugin.rotations import (
    MidPlaneArchitecture,
    azimuth_tilt,
    quaternion,
    tilt_torsion,
    wrap,
)
from spherekit.plugin.workspace import (
    ClosedKinematics,
    OutputKinematics,
    label_of,
)

from ..common import (
    POSE_COLUMNS,
    TILT_TORSION_COLUMNS,
    WORKING_MODE,
    direction_or_quaternion_columns,
)

Row = dict[str, Any]


SAME_VALUES = 1e-6
"""Configurations whose variables (rad) differ by less are one."""


POSE = Column("pose", "", "number of the pose or of the inputs given, from 0", "integer")


PLACES = *POSE_COLUMNS, *TILT_TORSION_COLUMNS


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
        WORKING_MODE,
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
        *(Column(f"near_{axis}", "", "of the nearest reachable pose") for axis in "xyzw"),
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
        WORKING_MODE,
        Column("pair", "", "name of the pair", "text"),
        Column("value", "rad", "its variable"),
    ),
)


def forward_rows(mechanism: Mechanism, solver: OutputKinematics, inputs: Floats) -> Row:
    """Return the poses at inputs (n, inputs), each with the working mode that has them."""
    solutions = solver.forward(inputs)
    none = np.setdiff1d(np.arange(len(inputs)), solutions.row)
    every = np.concatenate([solutions.row, none])
    order = np.argsort(every, kind="stable")
    pose = every[order]
    at = np.where(order < len(solutions.row), order, -1)

    def filled(values: Floats) -> Floats:
        return np.concatenate([values, np.full((1, *values.shape[1:]), np.nan)])[at]

    poses = solutions.rotations
    if solver.points:
        assert solutions.directions is not None
        poses = solutions.directions
    working = np.full(len(poses) + 1, "", dtype=object)
    if isinstance(solver, ClosedKinematics):
        rows = solver.inverse(poses, solver.labels, range(len(mechanism.pairs)))
        off = np.abs(wrap(rows.values - solutions.values[rows.pose])).max(axis=1)
        same = np.flatnonzero(off < SAME_VALUES)
        working[rows.pose[same]] = rows.mode[same]
    places = filled(poses)
    moved = dict[str, Any]()
    if solver.form is not None:
        turns = filled(solver.turns(solutions.values))
        moved = mirror_rates(mechanism, solver.form, places, turns)
    return {
        "pose": pose,
        "solution": np.arange(len(pose)) - np.searchsorted(pose, pose),
        "assembly_mode": np.array([*map(label_of, solutions.signs), ""])[at],
        "working_mode": working[at].astype(str),
        **input_columns(mechanism, inputs[pose]),
        **pose_columns(solver, places),
        **moved,
        "type_2": filled(solver.type_2(solutions.values)),
        "status": np.where(at < 0, Status.OUT_OF_REACH, Status.OK),
        "solved_by": solver.solved_by,
    }


def pose_columns(solver: OutputKinematics, poses: Floats) -> Row:
    """Return the columns of poses; NaN for NaN."""
    if solver.points:
        angles = azimuth_tilt(poses)
        places = poses
    else:
        angles = tilt_torsion(poses)
        places = quaternion(poses)
    return {
        **direction_or_quaternion_columns(places, solver.form),
        **dict(zip(("azimuth", "tilt", "torsion"), angles.T, strict=False)),
    }


def mirror_rates(
    mechanism: Mechanism, form: MidPlaneArchitecture, directions: Floats, turns: Floats
) -> Row:
    """Return the columns of the derivatives of phi and gamma by the inputs."""
    phi, gamma = np.moveaxis(form.angle_rates(directions, turns), -1, 0)
    return {
        **input_columns(mechanism, phi, "dphi_dq"),
        **input_columns(mechanism, gamma, "dgamma_dq"),
    }
