"""What analyses of orientations compute with: poses, fixed-axis rotations, schedules."""

from typing import TYPE_CHECKING

from spherekit.lazily import offered as _offered
from spherekit.plugin import _offer

if TYPE_CHECKING:
    from spherekit.guidance.follow import follow_rotation as follow_rotation
    from spherekit.guidance.mid_plane_architecture import (
        MidPlaneArchitecture as MidPlaneArchitecture,
    )
    from spherekit.guidance.mid_plane_architecture import (
        MidPlaneRotation as MidPlaneRotation,
    )
    from spherekit.guidance.poses import AtDirection as AtDirection
    from spherekit.guidance.poses import AtInputs as AtInputs
    from spherekit.guidance.poses import AtMirror as AtMirror
    from spherekit.guidance.poses import AtOrientation as AtOrientation
    from spherekit.guidance.poses import AtRotation as AtRotation
    from spherekit.guidance.poses import Pose as Pose
    from spherekit.guidance.poses import PoseCandidates as PoseCandidates
    from spherekit.guidance.poses import PoseFinder as PoseFinder
    from spherekit.guidance.rotation import SHAPES as SHAPES
    from spherekit.guidance.rotation import FixedAxisRotation as FixedAxisRotation
    from spherekit.guidance.rotation import RotationSamples as RotationSamples
    from spherekit.guidance.rotation import Schedule as Schedule
    from spherekit.guidance.rotation import Timetable as Timetable
    from spherekit.guidance.rotation import dead_centre as dead_centre
    from spherekit.guidance.rotation import quickest as quickest
    from spherekit.guidance.symmetry import mid_plane_form as mid_plane_form
    from spherekit.model.geometry import link_axes as link_axes
    from spherekit.model.outputs import chosen_output as chosen_output
    from spherekit.numeric.turns import wrap as wrap
    from spherekit.sphere.mirror import mirror_angles as mirror_angles
    from spherekit.sphere.mirror import normal_at as normal_at
    from spherekit.sphere.mirror import normals_of as normals_of
    from spherekit.sphere.rotation import from_quaternion as from_quaternion
    from spherekit.sphere.rotation import quaternion as quaternion
    from spherekit.sphere.tilt_torsion import azimuth_tilt as azimuth_tilt
    from spherekit.sphere.tilt_torsion import from_tilt_torsion as from_tilt_torsion
    from spherekit.sphere.tilt_torsion import pointing as pointing
    from spherekit.sphere.tilt_torsion import tilt_torsion as tilt_torsion

__all__, __getattr__, __dir__ = _offered(__name__, __file__, _offer)
