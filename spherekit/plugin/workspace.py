"""Functions for analyses of workspaces: poses of files, inverse kinematics and regions."""

from spherekit.geometry.direction_region import Part, Region, find_region
from spherekit.geometry.sphere_mesh import sphere_mesh
from spherekit.outputs.output_kinematics import (
    ClosedKinematics,
    InverseRows,
    OutputKinematics,
)
from spherekit.outputs.pose_constraints import (
    AngleLimit,
    Constraints,
    InterferenceLimit,
    bounds_of,
)
from spherekit.outputs.pose_rows import JointRange, sense_of, turns_of
from spherekit.outputs.pose_solver import closed_kinematics, output_kinematics
from spherekit.outputs.workspace import (
    DirectionWorkspace,
    Judged,
    OrientationWorkspace,
    direction_workspaces,
    judge,
    nearest_poses,
    nearest_reachable,
    orientation_samples,
    orientation_workspaces,
)
from spherekit.positions.assembly_mode import label_of
from spherekit.tables.number_files import columns_of, read_numbers

__all__ = [
    "AngleLimit",
    "ClosedKinematics",
    "Constraints",
    "DirectionWorkspace",
    "InterferenceLimit",
    "InverseRows",
    "JointRange",
    "Judged",
    "OrientationWorkspace",
    "OutputKinematics",
    "Part",
    "Region",
    "bounds_of",
    "closed_kinematics",
    "columns_of",
    "direction_workspaces",
    "find_region",
    "judge",
    "label_of",
    "nearest_poses",
    "nearest_reachable",
    "orientation_samples",
    "orientation_workspaces",
    "output_kinematics",
    "read_numbers",
    "sense_of",
    "sphere_mesh",
    "turns_of",
]
