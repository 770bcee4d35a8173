"""Functions for analyses of orientations: poses, fixed-axis rotations and schedules."""

from spherekit.geometry.mirror import mirror_angles, normal_at, normals_of
from spherekit.geometry.rotation import from_quaternion, quaternion
from spherekit.geometry.tilt_torsion import (
    azimuth_tilt,
    from_tilt_torsion,
    pointing,
    tilt_torsion,
)
from spherekit.mechanism.output_choice import chosen_output
from spherekit.mechanism.pair_frames import link_axes
from spherekit.numerics.angles import wrap
from spherekit.outputs.fixed_axis_rotation import RotationSamples, follow_rotation
from spherekit.outputs.mid_plane_architecture import MidPlaneArchitecture
from spherekit.outputs.mid_plane_symmetry import mid_plane_form
from spherekit.outputs.output_pose import (
    AtDirection,
    AtInputs,
    AtMirror,
    AtOrientation,
    AtRotation,
    EndOrientation,
    Pose,
    PoseCandidates,
    PoseFinder,
)
from spherekit.outputs.rotation_timing import (
    SHAPES,
    FixedAxisRotation,
    TimeScaling,
    Trajectory,
    dead_centre,
    schedule_limits,
    time_optimal,
)

__all__ = [
    "SHAPES",
    "AtDirection",
    "AtInputs",
    "AtMirror",
    "AtOrientation",
    "AtRotation",
    "EndOrientation",
    "FixedAxisRotation",
    "MidPlaneArchitecture",
    "Pose",
    "PoseCandidates",
    "PoseFinder",
    "RotationSamples",
    "TimeScaling",
    "Trajectory",
    "azimuth_tilt",
    "chosen_output",
    "dead_centre",
    "follow_rotation",
    "from_quaternion",
    "from_tilt_torsion",
    "link_axes",
    "mid_plane_form",
    "mirror_angles",
    "normal_at",
    "normals_of",
    "pointing",
    "quaternion",
    "schedule_limits",
    "tilt_torsion",
    "time_optimal",
    "wrap",
]
