"""What analyses of reach compute with: poses of files, inverse kinematics, regions."""

from typing import TYPE_CHECKING

from spherekit.lazy_imports import offered as _offered
from spherekit.plugin import _offer

if TYPE_CHECKING:
    from spherekit.analysis.numbers import columns_of as columns_of
    from spherekit.analysis.numbers import read_numbers as read_numbers
    from spherekit.motion.assembly_modes import label_of as label_of
    from spherekit.region.mesh import sphere_mesh as sphere_mesh
    from spherekit.region.refine import Part as Part
    from spherekit.region.refine import Region as Region
    from spherekit.region.refine import find_region as find_region
    from spherekit.workspace.inverse import closed_kinematics as closed_kinematics
    from spherekit.workspace.inverse import output_kinematics as output_kinematics
    from spherekit.workspace.rows import AngleLimit as AngleLimit
    from spherekit.workspace.rows import ClosedKinematics as ClosedKinematics
    from spherekit.workspace.rows import Constraints as Constraints
    from spherekit.workspace.rows import InterferenceLimit as InterferenceLimit
    from spherekit.workspace.rows import InverseRows as InverseRows
    from spherekit.workspace.rows import JointRange as JointRange
    from spherekit.workspace.rows import OutputKinematics as OutputKinematics
    from spherekit.workspace.rows import bounds_of as bounds_of
    from spherekit.workspace.rows import sense_of as sense_of
    from spherekit.workspace.rows import turns_of as turns_of
    from spherekit.workspace.workspace import DirectionWorkspace as DirectionWorkspace
    from spherekit.workspace.workspace import Judged as Judged
    from spherekit.workspace.workspace import OrientationWorkspace as OrientationWorkspace
    from spherekit.workspace.workspace import direction_workspaces as direction_workspaces
    from spherekit.workspace.workspace import judge as judge
    from spherekit.workspace.workspace import nearest_poses as nearest_poses
    from spherekit.workspace.workspace import nearest_reachable as nearest_reachable
    from spherekit.workspace.workspace import orientation_samples as orientation_samples
    from spherekit.workspace.workspace import (
        orientation_workspaces as orientation_workspaces,
    )

__all__, __getattr__, __dir__ = _offered(__name__, __file__, _offer)
