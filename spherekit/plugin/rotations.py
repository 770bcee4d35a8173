"""What analyses of orientations compute with: poses, fixed-axis rotations, schedules."""

from typing import TYPE_CHECKING

from spherekit.lazy_imports import offered as _offered
from spherekit.plugin import _offer

if TYPE_CHECKING:
    from spherekit.guidance.follow import RotationSamples as RotationSamples
    from spherekit.guidance.follow import follow_rotation as follow_rotation
    from spherekit.guidance.loci import mid_plane_form as mid_plane_form
    from spherekit.guidance.mid_plane_architecture import (
        MidPlaneArchitecture as MidPlaneArchitecture,
    )
    from spherekit.guidance.poses import AtDirection as AtDirection
    from spherekit.guidance.poses import AtInputs as AtInputs
    from spherekit.guidance.poses import AtMirror as AtMirror
    from spherekit.guidance.poses import AtOrientation as AtOrientation
    from spherekit.guidance.poses import AtRotation as AtRotation
    from spherekit.guidance.poses import EndOrientation as EndOrientation
    from spherekit.guidance.poses import Pose as Pose
    from spherekit.guidance.poses import PoseCandidates as PoseCandidates
    from spherekit.guidance.poses import PoseFinder as PoseFinder
    from spherekit.guidance.rotation import SHAPES as SHAPES
    from spherekit.guidance.rotation import FixedAxisRotation as FixedAxisRotation
    from spherekit.guidance.rotation import TimeScaling as TimeScaling
    from spherekit.guidance.rotation import Trajectory as Trajectory
    from spherekit.guidance.rotation import dead_centre as dead_centre
    from spherekit.guidance.rotation import schedule_limits as schedule_limits
    from spherekit.guidance.rotation import time_optimal as time_optimal
    from spherekit.model.gears import link_axes as link_axes
    from spherekit.model.mechanism import chosen_output as chosen_output
    from spherekit.numeric.crossings import wrap as wrap
    from spherekit.sphere.rotation import azimuth_tilt as azimuth_tilt
    from spherekit.sphere.rotation import from_quaternion as from_quaternion
    from spherekit.sphere.rotation import from_tilt_torsion as from_tilt_torsion
    from spherekit.sphere.rotation import mirror_angles as mirror_angles
    from spherekit.sphere.rotation import normal_at as normal_at
    from spherekit.sphere.rotation import normals_of as normals_of
    from spherekit.sphere.rotation import pointing as pointing
    from spherekit.sphere.rotation import quaternion as quaternion
    from spherekit.sphere.rotation import tilt_torsion as tilt_torsion

__all__, __getattr__, __dir__ = _offered(__name__, __file__, _offer)
