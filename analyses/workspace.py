"""Workspace: what an output reaches under constraints, its border, area and margins."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from spherekit.plugin import (
    INPUTS,
    AbstractAnalysis,
    AnalysisError,
    Batch,
    Column,
    FigureOfMerit,
    Findings,
    Mechanism,
    Needs,
    ParameterTrade,
    Scene,
    Table,
    TableData,
)
from spherekit.plugin.quantities import Degrees
from spherekit.plugin.workspace import Constraints, closed_kinematics, label_of

from .common import DIRECTION_COLUMNS, MID_PLANE_COLUMNS, POSE_COLUMNS, WORKING_MODE
from .output_poses import read_interference_limit, read_joint_range
from .workspace_modes import WorkspaceModes, read_distinct_poses, size_table

AREA_TOLERANCE = 1e-4
"""Default relative error of the area of a set of directions."""
VOLUME_TOLERANCE = 1e-2
"""Default relative error of the volume of a set of orientations."""
SIZE_UNIT = "sr or sr rad"
"""The unit of the size of a set of directions, or of orientations."""


@dataclass(frozen=True, kw_only=True)
class WorkspaceAnalysis(AbstractAnalysis):
    """Directions or orientations that an output reaches in a working mode.

    A working mode is one of the ways to assemble the legs at a given pose of the output.
    Angles without a unit are in the unit of the mechanism's file.

    Attributes
    ----------
    output
        Name of the output, needed if the mechanism declares several.
    working_mode
        Signs of one working mode, such as ``+-``, or its number. By default all modes.
    limits
        Ranges of pair variables, ``PAIR:LOW:HIGH``, in addition to the joint limits of the
        mechanism.
    apart
        Ranges of the angle between the axes of two pairs, ``PAIR/PAIR:MIN`` or
        ``PAIR/PAIR:MIN:MAX``.
    near
        Least distance of the poses of the workspace from singularities of types I and II,
        as an angle (in Python in degrees).
    width
        Width of the links, in the unit of `radius`. The outer axes of each leg that can
        fold stay ``width / radius`` (rad) apart, so that its links do not touch.
    radius
        Radius of the sphere, in the unit of `width`.
    tolerance
        Largest relative error of the area or volume. With 0 it is 1e-4 for the area of
        directions and 1e-2 for the volume of orientations.
    pose
        Poses of which the analysis reports whether they are inside the workspace. A pose is
        written ``name=number+name=number``. A direction has the names ``x``, ``y``, ``z``,
        or ``azimuth``, ``tilt``. An orientation has the names ``azimuth``, ``tilt``,
        ``torsion``, those of a quaternion ``qx``, ``qy``, ``qz``, ``qw``, or those of a
        rotation vector ``rx``, ``ry``, ``rz``. In a mid-plane symmetric architecture, a
        pose can also have the names ``phi``, ``gamma``, the angles of the plane about which
        base and output link are mirror images of each other. With the names of all driven
        pairs, the pose at these inputs is meant.
    """

    name = "workspace"
    version = "1"
    summary = (
        "directions or orientations that an output reaches within limits, with their "
        "area or volume"
    )
    cites = (
        "C. Gosselin and J. Angeles, IEEE Trans. Robotics and Automation 6(3), 1990",
        "Z. Chen et al., 2021, doi 10.21203/rs.3.rs-258461",
    )
    reads_samples = False
    tables = (
        Table(
            "workspace",
            "one row per working mode and sample pose, inside or outside the workspace",
            (
                WORKING_MODE,
                *POSE_COLUMNS,
                Column(
                    "inside",
                    "",
                    "yes if the pose is in the workspace, otherwise no",
                    "text",
                ),
                Column(
                    "margin",
                    "rad",
                    "angle between the pose and the nearest limit (such as the reach "
                    "of a leg or a joint limit); negative if the limit is exceeded",
                ),
                Column(
                    "limiting",
                    "",
                    "name of the nearest limit, to which the column margin refers",
                    "text",
                ),
                INPUTS,
                Column(
                    "type_1",
                    "",
                    "smallest speed of the output per unit rate of an input (the minimum "
                    "over all inputs); 0 at a type I singularity",
                ),
                Column(
                    "type_2",
                    "",
                    "transmission measure: how well the locked inputs hold the "
                    "output, from 0 (at a type II singularity) to 1",
                ),
            ),
        ),
        Table(
            "boundary",
            "one row per point of the border of a workspace of directions; along the "
            "border, the workspace is on the left",
            (
                WORKING_MODE,
                Column(
                    "curve",
                    "",
                    "number of the closed curve that bounds the workspace",
                    "integer",
                ),
                Column(
                    "component",
                    "",
                    "number of the connected part of the workspace that the curve bounds",
                    "integer",
                ),
                Column(
                    "gap",
                    "",
                    "number of the region on the other side of the curve, which does not "
                    "belong to the workspace; 0: the outside; larger numbers: holes",
                    "integer",
                ),
                Column("arc", "", "number of the smooth arc within the curve", "integer"),
                Column("point", "", "number of the point on the arc", "integer"),
                *DIRECTION_COLUMNS,
                *MID_PLANE_COLUMNS,
                Column(
                    "constraint",
                    "",
                    "name of the limit that bounds the workspace at this point",
                    "text",
                ),
            ),
        ),
        Table(
            "areas",
            "one row per working mode for the whole workspace, and for each part and hole",
            (
                WORKING_MODE,
                Column(
                    "part",
                    "",
                    "part that the row describes: the whole workspace (whole), a "
                    "connected part of the workspace (component), a hole or the "
                    "outside",
                    "text",
                ),
                Column(
                    "number",
                    "",
                    "number of the part, in the order of decreasing size",
                    "integer",
                ),
                Column(
                    "size",
                    SIZE_UNIT,
                    "area of the part if the output is a direction; volume of the part if "
                    "it is an orientation (8 pi^2 for all orientations)",
                ),
                Column(
                    "error",
                    SIZE_UNIT,
                    "upper bound of the error of an area, estimate of that of a volume",
                ),
                Column("curves", "", "numbers of the curves that bound the part", "text"),
                *POSE_COLUMNS,
                Column(
                    "margin",
                    "rad",
                    "margin (angle to the nearest limit) of the pose in this row, a "
                    "sample pose well inside the part",
                ),
            ),
        ),
    )

    trades = (
        ParameterTrade(
            "tolerance",
            (1e-2, 1e-3, 1e-4, 1e-5),
            "areas",
            "size",
            ("working_mode", "part"),
            "error",
        ),
    )

    output: str = ""
    working_mode: str = ""
    limits: tuple[str, ...] = ()
    apart: tuple[str, ...] = ()
    near: Degrees = 0.0
    width: float = 0.0
    radius: float = 0.0
    tolerance: float = 0.0
    pose: str = ""

    def merits(self, mechanism: Mechanism) -> tuple[FigureOfMerit, ...]:
        """Return the area, or volume, of the whole workspace in each working mode."""
        del mechanism
        size = FigureOfMerit(
            "workspace_area",
            "max",
            "size",
            table="workspace.areas",
            meaning="area of the workspace, or volume of orientations",
            only=(("part", "whole"),),
        )
        return (size,)

    def needs(self, mechanism: Mechanism) -> Needs:
        """Check all parameters, and return what this analysis reads of a run: nothing.

        The workspace does not depend on the samples of a motion.

        Raises
        ------
        AnalysisError
            If a parameter is not valid for the mechanism.
        """
        if not 0.0 <= self.tolerance < 1.0:
            raise AnalysisError(
                f"workspace: tolerance: {self.tolerance:g} is not a relative error; give "
                "one above 0 and below 1, or 0 for the default"
            )
        # This call checks all other parameters.
        self._make_workspaces(mechanism)
        return Needs()

    def _make_workspaces(self, mechanism: Mechanism) -> WorkspaceModes:
        """Return the workspaces of the requested working modes.

        A working mode is one of the ways to assemble the legs at a pose of the output. This
        method reads the parameters of the analysis, which are texts and numbers, and
        converts angles to rad. The workspaces are computed when they are first read.
        """
        kinematics = closed_kinematics(mechanism, self.output or None)
        # If the output is a direction (`points`), its workspace has an area. If it is an
        # orientation, its workspace has a volume.
        default_tolerance = AREA_TOLERANCE if kinematics.points else VOLUME_TOLERANCE
        # `limits` are ranges of pair angles, `apart` are ranges of angles between axes of
        # pairs. `near` (rad) is the least allowed distance from singularities, measured as
        # an angle. `width` (of the links) and `radius` (of the sphere) have the same unit;
        # links of this width must not touch.
        constraints = Constraints(
            limits=tuple(
                read_joint_range(text, mechanism.angle_unit) for text in self.limits
            ),
            apart=tuple(
                read_interference_limit(text, mechanism.angle_unit) for text in self.apart
            ),
            near=float(np.radians(self.near)),
            width=self.width,
            radius=self.radius,
        )
        return WorkspaceModes(
            mechanism,
            kinematics,
            constraints,
            modes=kinematics.chosen_modes(self.working_mode),
            # Poses for which the findings say whether they are in the workspaces.
            poses=read_distinct_poses(self.pose, kinematics),
            tolerance=self.tolerance or default_tolerance,
        )

    def compute(self, batch: Batch) -> Mapping[str, TableData]:
        """Return the tables: sampled poses, borders and sizes of the workspaces."""
        parts = self._workspaces(batch).table_parts()
        return {
            table.name: table.stacked(batch.mechanism, parts[table.name])
            for table in self.tables
        }

    def findings(self, batch: Batch) -> Findings:
        """Return the sizes of the workspaces, and in which of them the user's poses are.

        A working mode is one way to assemble the legs at a pose. Each working mode has its
        own workspace. The size is an area if the output is a direction, and a volume if it
        is an orientation. The summary also names the limits, such as joint limits.
        """
        workspaces = self._workspaces(batch)
        warnings: list[str] = []
        modes: dict[str, Any] = {}
        for workspace in workspaces.workspaces:
            label = label_of(workspace.signs)
            record, warning = workspaces.summarize(workspace)
            modes[label] = record
            if warning:
                warnings.append(f"Mode {label}: {warning}")
        summary: dict[str, Any] = {
            "output": workspaces.kinematics.output.name,
            "legs": list(workspaces.kinematics.legs),
            "limits": [limit.name for limit in workspaces.limits],
            "working_modes": modes,
        }
        # Modes with the same workspace share a row of the table of sizes. If an earlier
        # mode has the same workspace, "same_as" has its label.
        labels_by_first_mode: dict[str, list[str]] = {}
        for label, record in modes.items():
            first_mode = record.get("same_as", label)
            labels_by_first_mode.setdefault(first_mode, []).append(label)
        sizes = [
            (labels, modes[first_mode])
            for first_mode, labels in labels_by_first_mode.items()
        ]
        remarks: list[str] = []
        # For the poses that the user names: in which modes they can be reached.
        if self.pose:
            pose_findings = workspaces.examine_poses()
            summary["pose"] = pose_findings.records
            warnings += pose_findings.warnings
            remarks += pose_findings.remarks
        return Findings(summary, tuple(warnings), tuple(remarks), (size_table(sizes),))

    def scene(self, batch: Batch) -> tuple[Scene, ...]:
        """Return the pages of all workspaces.

        For directions, a page has the border and the margin (angle to the limits), and a
        page for each mode has the angle to singularities. A page of orientations has the
        rotation that is possible about each direction, and the margin.
        """
        return self._workspaces(batch).scenes()

    def _workspaces(self, batch: Batch) -> WorkspaceModes:
        """Return the workspaces of a batch, which are computed once."""
        return batch.once("workspaces", lambda: self._make_workspaces(batch.mechanism))
