"""What analyses of orientations compute with: poses, fixed-axis rotations, schedules."""

from typing import TYPE_CHECKING

from spherekit.lazy_imports import offered as _offered
from spherekit.plugin import _offer

if TYPE_CHECKING:
    from spherekit.geometry.mirror import mirror_angles as mirror_angles
    from spherekit.geometry.mirror import normal_at as normal_at
    from spherekit.geometry.mirror import normals_of as normals_of
    from spherekit.geometry.rotation import from_quaternion as from_quaternion
    from spherekit.geometry.rotation import quaternion as quaternion
    from spherekit.geometry.tilt_torsion import azimuth_tilt as azimuth_tilt
    from spherekit.geometry.tilt_torsion import from_tilt_torsion as from_tilt_torsion
    from spherekit.geometry.tilt_torsion import pointing as pointing
    from spherekit.geometry.tilt_torsion import tilt_torsion as tilt_torsion
    from spherekit.mechanism.mechanism import chosen_output as chosen_output
    from spherekit.mechanism.pair_frames import link_axes as link_axes
    from spherekit.numerics.angles import wrap as wrap
    from spherekit.outputs.fixed_axis_rotation import RotationSamples as RotationSamples
    from spherekit.outputs.fixed_axis_rotation import follow_rotation as follow_rotation
    from spherekit.outputs.mid_plane_architecture import (
        MidPlaneArchitecture as MidPlaneArchitecture,
    )
    from spherekit.outputs.mid_plane_symmetry import mid_plane_form as mid_plane_form
    from spherekit.outputs.output_pose import AtDirection as AtDirection
    from spherekit.outputs.output_pose import AtInputs as AtInputs
    from spherekit.outputs.output_pose import AtMirror as AtMirror
    from spherekit.outputs.output_pose import AtOrientation as AtOrientation
    from spherekit.outputs.output_pose import AtRotation as AtRotation
    from spherekit.outputs.output_pose import EndOrientation as EndOrientation
    from spherekit.outputs.output_pose import Pose as Pose
    from spherekit.outputs.output_pose import PoseCandidates as PoseCandidates
    from spherekit.outputs.output_pose import PoseFinder as PoseFinder
    from spherekit.outputs.rotation_timing import SHAPES as SHAPES
    from spherekit.outputs.rotation_timing import FixedAxisRotation as FixedAxisRotation
    from spherekit.outputs.rotation_timing import TimeScaling as TimeScaling
    from spherekit.outputs.rotation_timing import Trajectory as Trajectory
    from spherekit.outputs.rotation_timing import dead_centre as dead_centre
    from spherekit.outputs.rotation_timing import schedule_limits as schedule_limits
    from spherekit.outputs.rotation_timing import time_optimal as time_optimal

__all__, __getattr__, __dir__ = _offered(__name__, __file__, _offer)
