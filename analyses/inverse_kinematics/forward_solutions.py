"""The poses of an output at many inputs."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from spherekit.plugin import Findings, Floats, Mechanism, Scene, Status, counted, numbered
from spherekit.plugin.workspace import OutputKinematics

from .solver_summary import (
    count_values,
    describe_omitted_solutions,
    format_degrees,
    summarize_solver,
)
from .tables import FORWARD, forward_columns

MAX_DESCRIBED_INPUTS = 3
"""Largest number of sets of inputs for which each pose is described in a sentence."""
POSE_ANGLES = ("azimuth", "tilt", "torsion", "phi", "gamma")
"""Columns with the angles of a pose."""


class ForwardSolutions:
    """The poses of the output at some inputs, each with its working mode if that is known.

    A working mode is one of the ways to assemble the legs at a pose.

    Parameters
    ----------
    mechanism, solver
        The mechanism, and the inverse kinematics of its output.
    inputs
        (n, inputs) values of the inputs (rad).

    Attributes
    ----------
    columns
        The table of the poses.
    """

    def __init__(
        self, mechanism: Mechanism, solver: OutputKinematics, inputs: Floats
    ) -> None:
        """Compute the table of the poses."""
        self.mechanism = mechanism
        self.solver = solver
        self.inputs = inputs
        self.columns = forward_columns(mechanism, solver, inputs)

    def table_parts(self) -> dict[str, list[dict[str, Any]]]:
        """Return the table of poses at inputs, by the name of the table."""
        return {FORWARD.name: [self.columns]}

    def findings(self) -> Findings:
        """Return the number of poses at each set of inputs, in words and as a summary.

        If there are only a few sets of inputs, the poses are described one by one.
        """
        input_count = len(self.inputs)
        # The table has one row for each pose of each set of inputs. A set without a pose
        # has one row with the status OUT_OF_REACH.
        has_pose = self.columns["status"] != Status.OUT_OF_REACH
        # The column "pose" has the number of the set of inputs.
        input_set_of_row = self.columns["pose"]
        pose_counts = np.bincount(input_set_of_row[has_pose], minlength=input_count)
        summary = summarize_solver(self.solver) | {
            "inputs": input_count,
            "inputs_by_number_of_poses": count_values(pose_counts),
        }
        without_pose = np.sum(pose_counts == 0)
        warnings: tuple[str, ...] = ()
        if without_pose:
            warnings = (
                f"No pose was found at {without_pose} of "
                f"{counted(input_count, 'set')} of inputs.",
            )
        remarks = [
            f"{counted(np.sum(has_pose), 'configuration')} at "
            f"{counted(input_count, 'set')} of inputs.",
            *describe_omitted_solutions(self.solver),
        ]
        if input_count <= MAX_DESCRIBED_INPUTS:
            remarks += self._describe_poses(has_pose)
        return Findings(summary, warnings, tuple(remarks))

    def _describe_poses(self, has_pose: NDArray[np.bool_]) -> list[str]:
        """Return a sentence for each pose, with the modes in which it occurs.

        The mode is the working mode (how the legs are assembled) if that is known. Else the
        sentence has the assembly mode (how all links are assembled). `has_pose` (rows,)
        says which rows of the table have a pose.
        """
        columns = self.columns
        # Poses with the same sentence are listed together, with all their modes.
        modes_of_sentence: dict[tuple[str, str], list[str]] = {}
        for row in np.flatnonzero(has_pose).tolist():
            angles = []
            for name in POSE_ANGLES:
                if name in columns and np.isfinite(columns[name][row]):
                    angles.append(self._describe_angle(name, row))
            # In this table, the column "pose" has the number of the set of inputs that
            # leads to the pose.
            input_set = columns["pose"][row]
            sentence = f"Inputs {input_set}: {', '.join(angles)}"
            if columns["working_mode"][row]:
                kind = "working mode"
                mode = columns["working_mode"][row]
            else:
                kind = "assembly mode"
                mode = columns["assembly_mode"][row]
            modes_of_sentence.setdefault((sentence, kind), []).append(str(mode))
        return [
            f"{sentence}, {numbered(kind, modes)}"
            for (sentence, kind), modes in modes_of_sentence.items()
        ]

    def _describe_angle(self, name: str, row: int) -> str:
        """Return a text with an angle of the pose in a row of the table.

        `name` is the name of the angle. Derivatives of the angle with respect to the inputs
        follow in brackets, if the table has such columns.
        """
        text = f"{name} = {format_degrees(self.columns[name][row])} deg"
        derivatives = []
        for pair in self.mechanism.input_pairs:
            column = f"d{name}_dq_{pair}"
            if column in self.columns:
                derivatives.append(f"d{name}/d{pair} {self.columns[column][row]:.6g}")
        if derivatives:
            text += f" ({', '.join(derivatives)})"
        return text

    def scenes(self) -> tuple[Scene, ...]:
        """Return no scenes: poses at given inputs are not drawn."""
        return ()
