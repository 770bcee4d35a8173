"""Closes the loops of a compiled MuJoCo model exactly, by Newton's method.

MuJoCo keeps loops closed by constraint forces only, so the pose of a file may have open
loops.
"""

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from spherekit.arrays import Bools, Floats
from spherekit.errors import FileError
from spherekit.geometry.vectors import max_abs
from spherekit.wording import listing

EXACT_LOOP_GAP = 1e-16
"""Loops with a smaller gap (m or rad) are closed, without another step."""

CLOSED_LOOP_GAP = 1e-12
"""Loops with a smaller gap (m or rad) are closed if a step did not halve the gap.

Larger: slow convergence to a loop that does not close is taken for rounding; smaller: loops
of large models, whose rounding errors are larger, are refused.
"""

MAX_LOOP_STEPS = 60
"""Number of Newton steps after which the loops do not close. Fewer may not suffice from an
open pose, whose first steps are shortened."""

MAX_JOINT_STEP_RAD = 0.5
"""Largest change (rad) of a joint in one step.

Larger: a step from an open pose may lead to another assembly mode; smaller: more steps.
"""

LOOP_SINGULAR_VALUE = 1e-9
"""Singular values of the constraints below this part of the largest count as zero.

Larger: loops near a singular pose converge slowly; smaller: constraints that repeat each
other, such as two points on one axis, give arbitrary steps.
"""

NOTED_ROTATION_RAD = 1e-9
"""Largest rotation (rad) of a joint that is not mentioned in a note."""


def close_loops(
    mujoco: Any, model: Any, data: Any, driven_joints: Collection[int], path: Path
) -> list[str]:
    """Close all loops of a MuJoCo model by rotations of its joints.

    MuJoCo closes loops only by forces, so loops can be open in the pose of a file.

    First only joints that are not driven move, so that driven joints (inputs) keep their
    angles. If this does not close the loops, all joints move.

    Parameters
    ----------
    mujoco
        The Python module `mujoco`, an optional dependency.
    model, data
        The `MjModel` with hinges only, and its `MjData`, whose pose is changed.
    driven_joints
        Numbers of the driven joints.
    path
        The file, for messages.

    Returns
    -------
    A note if joints were rotated, otherwise nothing.

    Raises
    ------
    FileError
        If the loops do not close near the pose of the file.
    """
    file_pose = data.qpos.copy()
    all_joints = [*range(model.nv)]
    passive_joints = [joint for joint in all_joints if joint not in driven_joints]
    is_closed = _move_joints(mujoco, model, data, passive_joints) or _move_joints(
        mujoco, model, data, all_joints
    )
    if not is_closed:
        data.qpos[:] = file_pose
        raise FileError(
            f"{path}: loops do not close near the pose of the file. Gaps: "
            f"{_list_gaps(mujoco, model, data)}. Correct the points or axes at which these "
            "loops are closed"
        )
    largest_rotation = max_abs(data.qpos - file_pose)
    if largest_rotation <= NOTED_ROTATION_RAD:
        return []
    return [
        f"loops are open in the file's pose; joints were turned by up to "
        f"{np.degrees(largest_rotation):.4g} deg to close them"
    ]


def _measure_gaps(mujoco: Any, model: Any, data: Any) -> tuple[Bools, Floats]:
    """Measure how far loops of a MuJoCo model are open in the present pose.

    Gaps are the errors of equality constraints, which close loops, or couple or lock
    joints. The call updates `data` to the constraints of this pose.

    Returns
    -------
    is_equality_row
        (constraints,) whether a scalar constraint of MuJoCo belongs to an equality
        constraint. The caller selects rows of other constraint arrays by this mask.
    gaps
        (equalities,) the gap (m or rad) of each of these scalar constraints.
    """
    mujoco.mj_forward(model, data)
    is_equality_row = data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
    return is_equality_row, data.efc_pos[is_equality_row]


def _move_joints(mujoco: Any, model: Any, data: Any, joints: Sequence[int]) -> bool:
    """Close the loops by Newton's method with some of the joints.

    Each step solves J dq = gaps for the least dq, and subtracts dq from the joint angles. J
    is the matrix of derivatives of the gaps with respect to the joint angles. Large steps
    are shortened, because Newton's method can diverge far from a solution.

    Parameters
    ----------
    mujoco
        The Python module `mujoco`, an optional dependency.
    model, data
        The `MjModel`, and its `MjData`, whose pose is changed.
    joints
        Numbers of the joints that may move.

    Returns
    -------
    Whether the loops are closed up to rounding.
    """
    previous_gap = np.inf
    for _ in range(MAX_LOOP_STEPS):
        is_equality_row, gaps = _measure_gaps(mujoco, model, data)
        gap = max_abs(gaps)
        # The gap is small, and the last step has not halved it: only rounding is left.
        is_at_rounding = CLOSED_LOOP_GAP > gap > 0.5 * previous_gap
        if gap < EXACT_LOOP_GAP or is_at_rounding:
            return True
        previous_gap = gap
        jacobian = data.efc_J.reshape(data.nefc, model.nv)[is_equality_row][:, joints]
        # Loops about one centre have more equations than they need, so J is singular.
        # `lstsq` finds the least change.
        step = np.linalg.lstsq(jacobian, gaps, rcond=LOOP_SINGULAR_VALUE)[0]
        scale = MAX_JOINT_STEP_RAD / max(max_abs(step), MAX_JOINT_STEP_RAD)  # at most 1
        data.qpos[joints] -= step * scale
    return False


def _list_gaps(mujoco: Any, model: Any, data: Any) -> str:
    """Return a text for an error message: how far each loop is open in the present pose.

    MuJoCo closes loops by equality constraints, and couples or locks joints in the same
    way. The text names each equality constraint, with its largest gap (error) and unit.
    """
    kinds = mujoco.mjtEq
    # The scalar constraints of a weld are lengths and angles, so its unit is "m or rad".
    units = {kinds.mjEQ_CONNECT: "m", kinds.mjEQ_JOINT: "rad"}
    is_equality_row, gaps = _measure_gaps(mujoco, model, data)
    gap_by_name: dict[str, float] = {}
    unit_by_name: dict[str, str] = {}
    # `number` is the index of the equality constraint to which a scalar constraint belongs.
    for number, gap in zip(
        data.efc_id[is_equality_row].tolist(), np.abs(gaps), strict=True
    ):
        name = element_name(model.eq(number), "equality", number)
        gap_by_name[name] = max(gap_by_name.get(name, 0.0), gap)
        unit_by_name[name] = units.get(kinds(int(model.eq_type[number])), "m or rad")
    return listing(
        f"{name} {gap:.3g} {unit_by_name[name]}" for name, gap in gap_by_name.items()
    )


def element_name(element: Any, kind: str, number: int) -> str:
    """Return the name of an element of a model, or its kind and number if it has none."""
    return str(element.name or f"{kind}{number}")
