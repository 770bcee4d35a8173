"""Workspaces of an output: the poses that a working mode reaches under constraints."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.geometry.direction_region import Region, find_region
from spherekit.geometry.orientation_region import Orientations, find_orientations
from spherekit.geometry.rotation import from_quaternion
from spherekit.geometry.vectors import nans
from spherekit.outputs.dyad_chain import Signs
from spherekit.outputs.nearest_pose import Margins, NearestPoseSearch
from spherekit.outputs.output_kinematics import ClosedKinematics
from spherekit.outputs.pose_constraints import AngleLimit, find_least_margin

POSE_SAMPLES = 4000
"""Number of poses that are spread evenly over all poses.

Larger: smaller parts of a workspace are met when the nearest pose is searched, in more
time.
"""

SUPER_FIBONACCI_PSI = 1.533751168755204288118041
"""The positive root of x^4 = x + 4, with which super-Fibonacci spirals are even."""


@dataclass(frozen=True)
class Judged:
    """Margins, inputs and measures of singularities at n poses in one working mode.

    A working mode is one way to assemble the legs at a pose of the output.

    Attributes
    ----------
    margin
        (n,) angle (rad) that is left to the nearest of all limits of angles. It is negative
        outside of the workspace. NaN if it is not known: a limited angle may have no value
        where a leg does not reach.
    limiting
        (n,) index of this limit, -1 if the margin is not known.
    inputs
        (n, inputs) rad.
    type_1
        (n,) measure of type I. For each input there is a least angular speed of the output
        while this input has the rate 1 and the others have any rates. The measure is the
        smallest of these speeds. It is 0 at a singularity of type I, where an input moves
        while the output rests.
    type_2
        (n,) measure of type II, from 0 to 1: how well the locked inputs hold the output. It
        is 0 at a singularity of type II, where the output can move although the inputs are
        locked.
    """

    margin: Floats
    limiting: Indices
    inputs: Floats
    type_1: Floats
    type_2: Floats

    @property
    def inside(self) -> Bools:
        """(n,) whether the pose keeps all limits."""
        return self.margin >= 0.0


@dataclass(frozen=True)
class DirectionWorkspace:
    """The directions that an output reaches in one working mode.

    A working mode is one way to assemble the legs at a pose of the output.

    Attributes
    ----------
    signs
        The sign, 1 or -1, of each leg in the working mode.
    region
        The set of directions with its border.
    same_as
        Signs of an earlier mode in the list of results that reaches the same directions,
        whose `region` is used. None if the region was computed for this mode.
    """

    signs: Signs
    region: Region
    same_as: Signs | None


@dataclass(frozen=True)
class OrientationWorkspace:
    """The orientations that an output reaches in one working mode.

    A working mode is one way to assemble the legs at a pose of the output.

    Attributes
    ----------
    signs
        The sign, 1 or -1, of each leg in the working mode.
    orientations
        The set of orientations with its volume.
    same_as
        Signs of an earlier mode in the list of results that reaches the same orientations,
        whose `orientations` are used. None if they were computed for this mode.
    """

    signs: Signs
    orientations: Orientations
    same_as: Signs | None


def make_margins(
    kinematics: ClosedKinematics, bounds: Sequence[AngleLimit], signs: Signs
) -> Margins:
    """Return a function that computes how well poses keep all limits, in one working mode.

    Each limit of an angle gives a pose a margin. Its size is the difference between the
    cosines of the angle and of the limit. The margin is negative beyond the limit. A
    working mode is one way to assemble the legs.

    Parameters
    ----------
    kinematics
        The formulas that give the configuration of the mechanism at a pose of its output.
    bounds
        The limits of angles that a pose has to keep.
    signs
        The signs, 1 or -1, of the legs in the working mode.

    Returns
    -------
    A function of directions (n, 3) or quaternions xyzw (n, 4) that returns the margins (n,
    bounds).
    """

    def margins(poses: Floats) -> Floats:
        """Return the margins (n, bounds), negative beyond a limit."""
        # Poses that the legs cannot reach have NaN, without warnings.
        with np.errstate(all="ignore"):
            configurations = kinematics.at(_convert_poses(kinematics, poses), signs)
            # The method `column` returns the margins (n,) of one limit.
            margins_of_limits = [limit.column(configurations) for limit in bounds]
            return np.stack(margins_of_limits, axis=1)

    return margins


def judge(
    kinematics: ClosedKinematics, bounds: Sequence[AngleLimit], signs: Signs, places: Floats
) -> Judged:
    """Return margins, inputs and measures of singularities at poses in one mode.

    A working mode is one way to assemble the legs at a given pose. The margin of a pose is
    the angle that is left to the nearest of all limits. The measures of singularities are 0
    at a singularity and positive elsewhere:

    - Type I: the least angular speed of the output while one input has the rate 1 and the
      other inputs have any rates. The input with the smallest value counts. At the
      singularity, this input can move while the output rests.
    - Type II: a number of at most 1. At the singularity, the output can move although all
      inputs are locked.

    Parameters
    ----------
    kinematics
        The output, with closed-form solutions for the inputs at its poses.
    bounds
        The limits of angles that a pose has to keep.
    signs
        The signs, 1 or -1, of the legs in the working mode.
    places
        The n poses: (n, 3) directions or (n, 4) unit quaternions xyzw.

    Returns
    -------
    The results for each pose. The measures are NaN where an input has no value. The margin
    is NaN where a limited angle has no value and no other limit is exceeded.
    """
    with np.errstate(all="ignore"):
        mode = kinematics.at(_convert_poses(kinematics, places), signs)
        inputs = mode.inputs
        # 0 where all inputs are finite, NaN elsewhere. Added to a measure, NaN marks poses
        # that the legs cannot reach.
        nan_if_unreachable = 0.0 * np.sum(inputs, axis=1)
        # The angle left to the nearest limit, and the number of this limit.
        margin, limiting = find_least_margin(bounds, mode)
        return Judged(
            margin=margin,
            limiting=limiting,
            inputs=inputs,
            type_1=np.min(mode.type_1, axis=1) + nan_if_unreachable,
            type_2=mode.type_2 + nan_if_unreachable,
        )


def _convert_poses(kinematics: ClosedKinematics, poses: Floats) -> Floats:
    """Return directions (n, 3) unchanged, and quaternions (n, 4) as rotations (n, 3, 3)."""
    return poses if kinematics.points else from_quaternion(poses)


def direction_workspaces(
    kinematics: ClosedKinematics,
    bounds: Sequence[AngleLimit],
    modes: Sequence[Signs],
    tolerance: float = 1e-4,
) -> tuple[DirectionWorkspace, ...]:
    """Return the directions that an output reaches in each working mode.

    A working mode is one way to assemble the legs at a pose of the output.

    Parameters
    ----------
    kinematics, bounds
        The output, and the limits of angles that a pose has to keep.
    modes
        The requested working modes, each with the signs, 1 or -1, of its legs.
    tolerance
        Error of the area to aim at, relative to the area.

    Notes
    -----
    A region is computed with a mesh of directions. The margins of a direction say how much
    is left to each limit. If two modes have exactly equal margins at all vertices of this
    mesh, their regions are assumed to be equal, and only one is computed.
    """

    def find_directions(margins: Margins) -> _SampledWorkspace[Region]:
        """Return the region of a mode, with the vertices of its mesh and their margins."""
        # The area is not known beforehand. The first error is relative to half the sphere
        # (2 pi). A smaller region that is not empty is computed again with a smaller error.
        region = find_region(margins, tolerance * 2.0 * np.pi)
        target_error = tolerance * region.area
        if region.error > target_error > 0.0:
            region = find_region(margins, target_error)
        return _SampledWorkspace(region.points, region.values, region)

    return tuple(
        DirectionWorkspace(signs, region, same_as)
        for signs, region, same_as in _share_between_modes(
            kinematics, bounds, modes, find_directions
        )
    )


Workspace = TypeVar("Workspace")


@dataclass(frozen=True)
class _SampledWorkspace(Generic[Workspace]):
    """A workspace of one working mode, with margins at sampled poses.

    A workspace is the set of poses that the output reaches. The margin of a pose to a limit
    is positive inside the limit and negative beyond it. Another mode with exactly equal
    margins at these poses is assumed to have the same workspace, which saves time.

    Attributes
    ----------
    poses
        (n, 3) directions or (n, 4) quaternions.
    margins
        (n, limits) margin of each pose to each limit.
    workspace
        The region of directions, or the orientations.
    """

    poses: Floats
    margins: Floats
    workspace: Workspace


def _share_between_modes(
    kinematics: ClosedKinematics,
    bounds: Sequence[AngleLimit],
    modes: Sequence[Signs],
    find_workspace: Callable[[Margins], _SampledWorkspace[Workspace]],
) -> Iterator[tuple[Signs, Workspace, Signs | None]]:
    """Yield the workspace of each mode, computed once for modes that have the same one.

    A pose has one margin for each limit, which is negative if the limit is violated. Modes
    with exactly equal margins at all sampled poses are assumed to have the same workspace.

    Parameters
    ----------
    kinematics, bounds
        The output and its limits.
    modes
        The working modes, each with the signs, 1 or -1, of its legs.
    find_workspace
        Function that computes the workspace, with samples, from the margins of a mode.

    Yields
    ------
    signs
        The signs of the mode.
    workspace
        Its workspace.
    same_as
        Signs of the earlier mode with the same workspace. None if the workspace was
        computed for this mode.
    """
    # By the signs of the modes for which a workspace was computed.
    computed: dict[Signs, _SampledWorkspace[Workspace]] = {}
    for signs in modes:
        margins = make_margins(kinematics, bounds, signs)
        same_as = None
        for earlier_signs, earlier in computed.items():
            # Equal margins, bit for bit, at the samples of the earlier workspace.
            if np.array_equal(margins(earlier.poses), earlier.margins, equal_nan=True):
                same_as = earlier_signs
                break
        if same_as is None:
            sampled_workspace = find_workspace(margins)
            computed[signs] = sampled_workspace
        else:
            sampled_workspace = computed[same_as]
        yield signs, sampled_workspace.workspace, same_as


def orientation_workspaces(
    kinematics: ClosedKinematics,
    bounds: Sequence[AngleLimit],
    modes: Sequence[Signs],
    tolerance: float = 1e-2,
) -> tuple[OrientationWorkspace, ...]:
    """Return the orientations that an output reaches in each working mode.

    A working mode is one way to assemble the legs of a parallel mechanism at a pose. The
    margins of a pose say how much is left to each limit. If two modes have exactly equal
    margins at evenly spread samples, their workspaces are assumed to be equal, and only one
    is computed.

    Parameters
    ----------
    kinematics
        The output, with closed-form solutions for the inputs at its poses.
    bounds
        The limits of angles, such as joint limits, that a pose has to keep.
    modes
        The requested working modes, each with the signs, 1 or -1, of its legs.
    tolerance
        Error of the volume to aim at, relative to the volume.
    """
    samples = orientation_samples()  # only to compare modes

    def find_mode_orientations(margins: Margins) -> _SampledWorkspace[Orientations]:
        """Return the reached orientations of a mode, and its margins at the samples."""
        orientations = find_orientations(margins, tolerance)
        return _SampledWorkspace(samples, margins(samples), orientations)

    return tuple(
        OrientationWorkspace(signs, orientations, same_as)
        for signs, orientations, same_as in _share_between_modes(
            kinematics, bounds, modes, find_mode_orientations
        )
    )


def orientation_samples(count: int = POSE_SAMPLES) -> Floats:
    """Return unit quaternions (count, 4) xyzw spread evenly over all orientations.

    Notes
    -----
    With t between 0 and 1, s = t count and psi the positive root of x^4 = x + 4, the
    quaternions are (r sin a, r cos a, R sin b, R cos b) with r = sqrt(t), R = sqrt(1 - t),
    a = 2 pi s / sqrt(2) and b = 2 pi s / psi.

    References
    ----------
    M. Alexa, Super-Fibonacci spirals: fast, low-discrepancy sampling of SO(3) (2022).
    """
    t = (np.arange(count) + 0.5) / count
    # Angles a and b (2, count).
    spiral_angles = (
        2.0 * np.pi * count * t / np.array([[np.sqrt(2.0)], [SUPER_FIBONACCI_PSI]])
    )
    # The radii r and R (2, count).
    radii = np.sqrt([t, 1.0 - t])
    r_sin_a, big_r_sin_b = radii * np.sin(spiral_angles)
    r_cos_a, big_r_cos_b = radii * np.cos(spiral_angles)
    return np.array([r_sin_a, r_cos_a, big_r_sin_b, big_r_cos_b]).T


def direction_samples(count: int = POSE_SAMPLES) -> Floats:
    """Return directions (count, 3) spread evenly over the sphere, along a spiral."""
    number = np.arange(count)
    z = 1.0 - (2.0 * number + 1.0) / count
    azimuth = number * np.pi * (3.0 - np.sqrt(5.0))  # multiples of the golden angle
    radius = np.sqrt(1.0 - z * z)
    return np.column_stack([radius * np.cos(azimuth), radius * np.sin(azimuth), z])


def nearest_reachable(
    kinematics: ClosedKinematics,
    bounds: Sequence[AngleLimit],
    workspace: DirectionWorkspace | OrientationWorkspace,
    place: Floats,
) -> tuple[Floats, float] | None:
    """Return the reachable pose nearest to a pose outside, and the angle between both.

    The search starts from some poses in the workspace. In a workspace of directions, the
    point of the computed border that is nearest to the pose is one of them, so that small
    parts are considered as well.

    Parameters
    ----------
    kinematics
        The output, with closed-form solutions for the inputs at its poses.
    bounds
        The limits of angles, such as joint limits, that a pose has to keep.
    workspace
        The workspace of one working mode, with the signs of the legs in this mode.
    place
        The pose outside: a direction (3,) or a unit quaternion xyzw (4,).

    Returns
    -------
    The nearest pose (3,) or (4,), and the angle (rad) to it. None if no pose of the
    workspace is found.
    """
    # Reachable poses (k, 3 or 4) from which the search starts, in addition to evenly spread
    # ones.
    if isinstance(workspace, OrientationWorkspace):
        # `orientations.place` is the orientation deepest inside the workspace.
        deepest_pose = workspace.orientations.place
        inside_poses = deepest_pose[None]
    else:
        region = workspace.region
        if not region.components:
            return None
        # One direction in every connected part, and the point of the region nearest to the
        # pose outside.
        component_poses = [component.place for component in region.components]
        inside_poses = np.stack([region.nearest(place), *component_poses])
    # For one pose the list has one item: the nearest pose with the angle to it, or None.
    (nearest_pose,) = nearest_in_mode(
        kinematics, bounds, workspace.signs, place[None], inside_poses
    )
    return nearest_pose


def nearest_in_mode(
    kinematics: ClosedKinematics,
    bounds: Sequence[AngleLimit],
    signs: Signs,
    places: Floats,
    inside_poses: Floats | None = None,
) -> list[tuple[Floats, float] | None]:
    """Return, for each pose outside of a workspace, the nearest reachable pose in one mode.

    Parameters
    ----------
    kinematics
        The output, with closed-form solutions for the inputs at its poses.
    bounds
        The limits of angles, such as joint limits, that a pose in the workspace has to
        keep.
    signs
        The signs, 1 or -1, of the legs in the working mode (way to assemble the legs).
    places
        The n poses outside: (n, 3) directions or (n, 4) unit quaternions xyzw.
    inside_poses
        (k, 3 or 4) poses in the workspace or near it, as further candidates for the starts
        of the search. The other candidates are evenly spread poses in the workspace.

    Returns
    -------
    For each of the n poses the nearest reachable pose and the angle (rad) between both, or
    None if no reachable pose is found or the given pose is not finite. Local minima are
    located to 1e-8 rad (`spherekit.outputs.nearest_pose`). A nearer pose in a very small
    part of the workspace may be missed.
    """

    def is_inside(poses: Floats) -> Bools:
        """Return whether poses (n, 3 or 4) keep all limits."""
        # The margin is the angle that is left to the nearest limit. Only the margin is
        # computed, because measures of singularities would take much more time.
        with np.errstate(all="ignore"):
            mode = kinematics.at(_convert_poses(kinematics, poses), signs)
            margin, _ = find_least_margin(bounds, mode)
        return margin >= 0.0

    search = NearestPoseSearch(make_margins(kinematics, bounds, signs), is_inside)
    # `points` is true if the poses of the output are directions.
    samples = direction_samples() if kinematics.points else orientation_samples()
    reachable_poses = samples[is_inside(samples)]
    if inside_poses is not None:
        reachable_poses = np.concatenate([reachable_poses, inside_poses])
    if not len(reachable_poses):
        return [None] * len(places)
    return [
        search.find_nearest(place, reachable_poses) if np.isfinite(place).all() else None
        for place in places
    ]


def nearest_poses(
    kinematics: ClosedKinematics, places: Floats, signs: Signs
) -> tuple[Floats, Floats]:
    """Return the nearest reachable poses to poses outside of a workspace.

    The workspace has the poses of one working mode under the limits of the mechanism
    itself, without further constraints. A pose without a result is NaN.

    Parameters
    ----------
    kinematics
        The output, with closed-form solutions for the inputs at its poses.
    places
        The n poses outside: (n, 3) directions or (n, 4) unit quaternions xyzw.
    signs
        The signs, 1 or -1, of the legs in the working mode (way to assemble the legs).

    Returns
    -------
    poses
        (n, 3 or 4) the nearest poses, NaN where none is known.
    angles
        (n,) angles to them (rad), NaN where none is known.
    """
    results = nearest_in_mode(kinematics, kinematics.bounds, signs, places)
    # The poses are floats, even if those of the caller are integers.
    poses = np.full(places.shape, np.nan)
    angles = nans(len(places))
    for number, result in enumerate(results):
        if result is not None:
            pose, angle = result
            poses[number] = pose
            angles[number] = angle
    return poses, angles
