"""The tables of the analysis `inverse_kinematics`, and how they are filled."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

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
    MID_PLANE_FORMULAS,
    MID_PLANE_NORMAL,
    POSE_COLUMNS,
    TILT_TORSION_COLUMNS,
    WORKING_MODE,
    direction_or_quaternion_columns,
)

Columns = dict[str, Any]
"""Columns of a table by name."""

SAME_SOLUTION_RAD = 1e-6
"""Configurations whose variables differ by less are the same one. Larger: modes near a
singularity are confused; smaller: rounding hides the working mode of a pose."""

POSE_NUMBER = Column(
    "pose",
    "",
    "number of the row in the list of given poses (or of given inputs), from 0",
    "integer",
)


ALL_POSE_COLUMNS = (*POSE_COLUMNS, *TILT_TORSION_COLUMNS)
"""The columns of a pose in all forms."""


MID_PLANE_RATE_COLUMNS = tuple(
    Column(
        f"d{name}_dq",
        "",
        f"derivative of {name} = {formula} with respect to the angle of the driven pair; "
        f"{MID_PLANE_NORMAL}",
        per_input=True,
    )
    for name, formula in MID_PLANE_FORMULAS.items()
)


SOLVED_BY = Column(
    "solved_by",
    "",
    "method that found the solution: dyads (closed form, finds all solutions), graph "
    "(solves the loop equations of all links, may miss solutions) or mid-plane (finds only "
    "solutions in which base and output link are mirror images of each other)",
    "text",
)


INVERSE = Table(
    "inverse_kinematics",
    "one row per pose and working mode, or per pose and configuration found",
    (
        POSE_NUMBER,
        WORKING_MODE,
        *ALL_POSE_COLUMNS,
        INPUTS,
        *(
            Column(
                f"rate_{axis}",
                "",
                "angular velocity of the driven pair per unit angular velocity of the "
                f"output link about the {axis} axis",
                per_input=True,
            )
            for axis in "xyz"
        ),
        *MID_PLANE_RATE_COLUMNS,
        Column(
            "margin",
            "rad",
            "angle between the configuration and the nearest limit (the reach of a "
            "leg or a joint limit); negative if the limit is exceeded",
        ),
        Column(
            "limiting",
            "",
            "name of the nearest limit, to which the column margin refers",
            "text",
        ),
        Column(
            "type_1",
            "",
            "speed of the output per unit angular velocity of the driven pair; 0 at a "
            "type I singularity",
            per_input=True,
        ),
        Column(
            "type_2",
            "",
            "transmission measure: how well the locked inputs hold "
            "the output, from 0 (at a type II singularity) to 1",
        ),
        Column(
            "sense",
            "",
            "sign of the determinant of the matrix that converts the angular velocity "
            "of the output into the rates of the inputs; the sign changes only at "
            "singularities",
            "integer",
        ),
        STATUS,
        SOLVED_BY,
        *(
            Column(
                f"near_{axis}",
                "",
                f"{axis} component of the output direction or, if the output is an "
                "orientation, of its unit quaternion (x, y, z, w), in the reachable pose "
                "nearest to the given pose; empty if the given pose can be reached",
            )
            for axis in "xyz"
        ),
        Column(
            "near_w",
            "",
            "w component (the real part) of the unit quaternion of the output orientation "
            "in the reachable pose nearest to the given pose; empty if the given pose can "
            "be reached, or if the output is a direction",
        ),
        Column(
            "away", "rad", "angle between the given pose and the nearest reachable pose"
        ),
    ),
)


FORWARD = Table(
    "forward",
    "one row per given set of inputs and pose found",
    (
        POSE_NUMBER,
        Column(
            "solution",
            "",
            "number of the solution (a pose of the output) for the given inputs, from 0",
            "integer",
        ),
        Column(
            "assembly_mode",
            "",
            "assembly mode (a way to assemble the mechanism): one sign for each group "
            "of links, such as +-",
            "text",
        ),
        Column(
            "working_mode",
            "",
            "working mode (a way to assemble the legs) of the solution: one sign for "
            "each leg; empty if unknown",
            "text",
        ),
        INPUTS,
        *ALL_POSE_COLUMNS,
        *MID_PLANE_RATE_COLUMNS,
        Column(
            "type_2",
            "",
            "transmission measure: how well the locked inputs hold "
            "the output, from 0 (at a type II singularity) to 1",
        ),
        STATUS,
        SOLVED_BY,
    ),
)


PAIRS = Table(
    "pairs",
    "variables of pairs: one row per pose, working mode and requested pair",
    (
        POSE_NUMBER,
        WORKING_MODE,
        Column("pair", "", "name of the pair", "text"),
        Column(
            "value",
            "rad",
            "angle of an R pair; for a contact, an arc length along a profile",
        ),
    ),
)


def forward_columns(
    mechanism: Mechanism, solver: OutputKinematics, inputs: Floats
) -> Columns:
    """Return the table of the poses at given inputs, each with its working mode if known.

    The working mode is given by the signs of the legs. Rows are in the order of the inputs.
    The column `pose` has the index of the set of inputs, from 0 to n - 1. Inputs without a
    pose have one row with status OUT_OF_REACH. The column `type_2` is a measure that is 0
    at a type II singularity, where the output can move while the inputs rest.

    Parameters
    ----------
    mechanism, solver
        The mechanism, and the inverse kinematics of its output.
    inputs
        (n, inputs) values of the inputs (rad).
    """
    solutions = solver.forward(inputs)
    # The rows of the table: all solutions and all inputs without a pose, sorted by inputs.
    inputs_without_pose = np.setdiff1d(np.arange(len(inputs)), solutions.row)
    input_rows = np.concatenate([solutions.row, inputs_without_pose])
    order = np.argsort(input_rows, kind="stable")
    input_number = input_rows[order]
    # The number of the solution of each row of the table. Inputs without a pose have -1,
    # the index of a last row with NaN.
    solution_number = np.where(order < len(solutions.row), order, -1)

    def fill_rows(values: Floats) -> Floats:
        """Return values (solutions, ...) for the rows of the table, NaN without a pose."""
        no_solution = np.full((1, *values.shape[1:]), np.nan)
        return np.concatenate([values, no_solution])[solution_number]

    # If the solver has `points`, poses are directions (n, 3), else rotations (n, 3, 3).
    solved_poses = solutions.rotations
    if solver.points:
        assert solutions.directions is not None
        solved_poses = solutions.directions
    working_modes = _find_working_modes(mechanism, solver, solved_poses, solutions.values)
    assembly_modes = np.array([*map(label_of, solutions.signs), ""])
    poses = fill_rows(solved_poses)
    rate_columns: Columns = {}
    # `form` is the mid-plane symmetric architecture, if the mechanism has one: base and
    # output link are mirror images of each other in a plane.
    if solver.form is not None:
        # (rows, 3, inputs) angular velocity of the output per unit rate of each input.
        angular_velocities = fill_rows(solver.turns(solutions.values))
        rate_columns = mid_plane_rate_columns(
            mechanism, solver.form, poses, angular_velocities
        )
    # For each row of the table the first row with the same inputs.
    first_row_of_input = np.searchsorted(input_number, input_number)
    return {
        "pose": input_number,
        # Solutions are counted from 0 for each set of inputs.
        "solution": np.arange(len(input_number)) - first_row_of_input,
        "assembly_mode": assembly_modes[solution_number],
        "working_mode": working_modes[solution_number],
        **input_columns(mechanism, inputs[input_number]),
        **all_pose_columns(solver, poses),
        **rate_columns,
        "type_2": fill_rows(solver.type_2(solutions.values)),
        "status": np.where(solution_number < 0, Status.OUT_OF_REACH, Status.OK),
        "solved_by": solver.solved_by,
    }


def _find_working_modes(
    mechanism: Mechanism, solver: OutputKinematics, poses: Floats, values: Floats
) -> NDArray[np.str_]:
    """Return the working mode of each of n solutions, and one empty text at the end.

    A working mode is one of the ways to assemble the legs at a pose. The name of a working
    mode has a sign for each leg, such as "+-+". An inverse kinematics in closed form has
    one configuration of a pose for each working mode. The working mode of a solution is the
    one with the same configuration. Without such a mode the text is empty. The last text,
    with index -1, is for rows of a table without a solution.

    Parameters
    ----------
    mechanism, solver
        The mechanism, and the inverse kinematics of its output.
    poses
        (n, 3) directions or (n, 3, 3) rotations of the solutions.
    values
        (n, variables) configurations (rad) of the same solutions.
    """
    modes = np.full(len(poses) + 1, "", dtype=object)
    if isinstance(solver, ClosedKinematics):
        # The variables of wheels are not compared. If a pair that turns a wheel makes a
        # whole revolution, the wheel can have another angle in the same working mode.
        names = [pair.name for pair in solver.carrying.pairs]
        pairs = [mechanism.pair_number[name] for name in names]
        # One row for each pose (`rows.pose`) and working mode.
        rows = solver.inverse(poses, solver.labels, pairs)
        solution_values = values[rows.pose][:, pairs]
        differences = np.abs(wrap(rows.values - solution_values)).max(axis=1)
        same = np.flatnonzero(differences < SAME_SOLUTION_RAD)
        modes[rows.pose[same]] = rows.mode[same]
    return modes.astype(str)


def all_pose_columns(solver: OutputKinematics, poses: Floats) -> Columns:
    """Return the columns of poses, with all numbers that describe them.

    A direction has x, y, z, azimuth and tilt. A rotation has a quaternion, azimuth, tilt
    and torsion (the angle about the tilted axis). If base and output mirror each other in a
    plane (mid-plane), directions also have phi and gamma. These two angles describe the
    normal of the mid-plane.

    Parameters
    ----------
    solver
        The inverse kinematics of the output.
    poses
        (n, 3) directions or (n, 3, 3) rotations; NaN gives NaN.
    """
    # `points` tells whether poses are directions, at which the output points.
    are_directions = solver.points
    # `form` is the mid-plane symmetric architecture, in which base and output mirror each
    # other. It is None in other mechanisms.
    architecture = solver.form
    if are_directions:
        columns = direction_or_quaternion_columns(poses, architecture)
        columns["azimuth"], columns["tilt"] = azimuth_tilt(poses).T
    else:
        columns = direction_or_quaternion_columns(quaternion(poses), architecture)
        columns["azimuth"], columns["tilt"], columns["torsion"] = tilt_torsion(poses).T
    return columns


def mid_plane_rate_columns(
    mechanism: Mechanism,
    architecture: MidPlaneArchitecture,
    directions: Floats,
    angular_velocities: Floats,
) -> Columns:
    """Return the columns of the derivatives of phi and gamma with respect to the inputs.

    In the mechanism, base and output link mirror each other in a plane (mid-plane). Its
    unit normal (x, y, z) is described by the angles phi = -2 arcsin(x) and gamma = 2
    arcsin(y) (Chen et al. 2021). The components x, y, z are along mirror axes: axes that
    are fixed in the base and belong to the `architecture`.

    Parameters
    ----------
    mechanism, architecture
        The mechanism, and its mid-plane symmetric architecture.
    directions
        (n, 3) unit vectors along the output direction (an axis of the output link).
    angular_velocities
        (n, 3, inputs) angular velocity of the output per unit rate of each input.
    """
    rates = architecture.angle_rates(directions, angular_velocities)
    phi_rates, gamma_rates = np.moveaxis(rates, -1, 0)
    return {
        **input_columns(mechanism, phi_rates, "dphi_dq"),
        **input_columns(mechanism, gamma_rates, "dgamma_dq"),
    }
