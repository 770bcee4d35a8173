"""What analyses of reach compute with: poses of files, inverse kinematics, regions."""

from typing import TYPE_CHECKING

from spherekit.lazy_imports import offered as _offered
from spherekit.plugin import _offer

if TYPE_CHECKING:
    from spherekit.geometry.direction_region import Part as Part
    from spherekit.geometry.direction_region import Region as Region
    from spherekit.geometry.direction_region import find_region as find_region
    from spherekit.geometry.sphere_mesh import sphere_mesh as sphere_mesh
    from spherekit.outputs.pose_constraints import AngleLimit as AngleLimit
    from spherekit.outputs.pose_constraints import ClosedKinematics as ClosedKinematics
    from spherekit.outputs.pose_constraints import Constraints as Constraints
    from spherekit.outputs.pose_constraints import InterferenceLimit as InterferenceLimit
    from spherekit.outputs.pose_constraints import InverseRows as InverseRows
    from spherekit.outputs.pose_constraints import OutputKinematics as OutputKinematics
    from spherekit.outputs.pose_constraints import bounds_of as bounds_of
    from spherekit.outputs.pose_rows import JointRange as JointRange
    from spherekit.outputs.pose_rows import sense_of as sense_of
    from spherekit.outputs.pose_rows import turns_of as turns_of
    from spherekit.outputs.pose_solver import closed_kinematics as closed_kinematics
    from spherekit.outputs.pose_solver import output_kinematics as output_kinematics
    from spherekit.outputs.workspace import DirectionWorkspace as DirectionWorkspace
    from spherekit.outputs.workspace import Judged as Judged
    from spherekit.outputs.workspace import OrientationWorkspace as OrientationWorkspace
    from spherekit.outputs.workspace import direction_workspaces as direction_workspaces
    from spherekit.outputs.workspace import judge as judge
    from spherekit.outputs.workspace import nearest_poses as nearest_poses
    from spherekit.outputs.workspace import nearest_reachable as nearest_reachable
    from spherekit.outputs.workspace import orientation_samples as orientation_samples
    from spherekit.outputs.workspace import orientation_workspaces as orientation_workspaces
    from spherekit.positions.assembly_mode import label_of as label_of
    from spherekit.tables.number_files import columns_of as columns_of
    from spherekit.tables.number_files import read_numbers as read_numbers

__all__, __getattr__, __dir__ = _offered(__name__, __file__, _offer)
