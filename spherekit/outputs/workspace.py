"""Workspaces of an output: what it reaches in each working mode under constraints."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import starmap
from typing import TypeVar

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.geometry.direction_region import Region, find_region
from spherekit.geometry.orientation_region import Orientations, find_orientations
from spherekit.geometry.rotation import from_quaternion
from spherekit.geometry.vectors import nans
from spherekit.outputs.dyad_chain import Signs
from spherekit.outputs.nearest_pose import Margins, NearestPoseSearch
from spherekit.outputs.pose_constraints import AngleLimit, ClosedKinematics, left_of

SAMPLES = 4000
"""Orientations or directions looked at."""
PSI = 1.533751168755204288118041
"""The positive root of x^4 = x + 4."""


@dataclass(frozen=True)
class Judged:
    """Constraints at n poses in one mode.

    `margin` (n,) rad is what is left to the limit that is nearest, negative outside, and
    `limiting` (n,) its number, -1 where no limit says why the pose cannot be taken.
    `inputs` (n, inputs) rad, `type_1` (n,) the least of all inputs, `type_2` (n,).
    """

    margin: Floats
    limiting: Indices
    inputs: Floats
    type_1: Floats
    type_2: Floats

    @property
    def inside(self) -> Bools:
        """Which poses (n,) keep to all bounds."""
        return self.margin >= 0.0


@dataclass(frozen=True)
class DirectionWorkspace:
    """The directions that one working mode reaches; `same_as` an earlier mode has them too.

    Numbers of margins in `region` are those of `bounds`.
    """

    signs: Signs
    region: Region
    same_as: Signs | None


@dataclass(frozen=True)
class OrientationWorkspace:
    """The orientations that one working mode reaches; `same_as` as for directions."""

    signs: Signs
    orientations: Orientations
    same_as: Signs | None


def margins_of(
    kinematics: ClosedKinematics, bounds: Sequence[AngleLimit], signs: Signs
) -> Margins:
    """Return the margins (n, bounds) of a mode, of directions or quaternions xyzw."""

    def margins(places: Floats) -> Floats:
        with np.errstate(all="ignore"):
            rows = kinematics.at(_poses(kinematics, places), signs)
            return np.stack([bound.column(rows) for bound in bounds], axis=1)

    return margins


def judge(
    kinematics: ClosedKinematics, bounds: Sequence[AngleLimit], signs: Signs, places: Floats
) -> Judged:
    """Return what is left at places, directions (n, 3) or quaternions (n, 4) xyzw.

    The measures are NaN where no inputs are.
    """
    with np.errstate(all="ignore"):
        rows = kinematics.at(_poses(kinematics, places), signs)
        inputs = rows.inputs
        gone = 0.0 * np.sum(inputs, axis=1)
        type_1, type_2 = np.min(rows.type_1, axis=1) + gone, rows.type_2 + gone
        return Judged(*left_of(bounds, rows), inputs, type_1, type_2)


def _poses(kinematics: ClosedKinematics, places: Floats) -> Floats:
    return places if kinematics.points else from_quaternion(places)


def direction_workspaces(
    kinematics: ClosedKinematics,
    bounds: Sequence[AngleLimit],
    modes: Sequence[Signs],
    tolerance: float = 1e-4,
) -> tuple[DirectionWorkspace, ...]:
    """Return the directions that each mode reaches.

    Parameters
    ----------
    kinematics, bounds, modes
        The output, what holds, and the signs of the modes wanted.
    tolerance
        Error of the area to aim at, relative to the area.

    Notes
    -----
    Modes whose margins are the same at all vertices of a region share it.
    """

    def find(margins: Margins) -> tuple[Floats, Floats, Region]:
        region = find_region(margins, tolerance * 2.0 * np.pi)
        goal = tolerance * region.area
        if region.error > goal > 0.0:
            region = find_region(margins, goal)
        return region.points, region.values, region

    return tuple(starmap(DirectionWorkspace, _found_once(kinematics, bounds, modes, find)))


Found = TypeVar("Found")


def _found_once(
    kinematics: ClosedKinematics,
    bounds: Sequence[AngleLimit],
    modes: Sequence[Signs],
    find: Callable[[Margins], tuple[Floats, Floats, Found]],
) -> Iterator[tuple[Signs, Found, Signs | None]]:
    """Yield modes with what is found of them, and the earlier one that it is the same as.

    `find` gives places, the margins there, which tell modes apart, and what is found.
    """
    kept: list[tuple[Floats, Floats, Found, Signs]] = []
    for signs in modes:
        margins = margins_of(kinematics, bounds, signs)
        for places, values, reached, first in kept:
            if np.array_equal(margins(places), values, equal_nan=True):
                yield signs, reached, first
                break
        else:
            kept.append((*find(margins), signs))
            yield signs, kept[-1][2], None


def orientation_workspaces(
    kinematics: ClosedKinematics,
    bounds: Sequence[AngleLimit],
    modes: Sequence[Signs],
    tolerance: float = 1e-2,
) -> tuple[OrientationWorkspace, ...]:
    """Return the orientations that each mode reaches; the tolerance is relative.

    Modes whose margins are the same at all samples share what was found.
    """
    samples = orientation_samples()

    def find(margins: Margins) -> tuple[Floats, Floats, Orientations]:
        return samples, margins(samples), find_orientations(margins, tolerance)

    return tuple(
        starmap(OrientationWorkspace, _found_once(kinematics, bounds, modes, find))
    )


def orientation_samples(count: int = SAMPLES) -> Floats:
    """Return unit quaternions (count, 4) xyzw spread evenly over all orientations.

    Notes
    -----
    The spirals of M. Alexa, Super-Fibonacci spirals: fast, low-discrepancy sampling of
    SO(3) (2022).
    """
    part = (np.arange(count) + 0.5) / count
    turned = 2.0 * np.pi * count * part / np.array([[np.sqrt(2.0)], [PSI]])
    spirals = np.sqrt([part, 1.0 - part]) * [np.sin(turned), np.cos(turned)]
    return np.hstack(np.moveaxis(spirals, 0, 2))


def direction_samples(count: int = SAMPLES) -> Floats:
    """Return directions (count, 3) spread evenly over the sphere, along a spiral."""
    number = np.arange(count)
    z = 1.0 - (2.0 * number + 1.0) / count
    turn = number * np.pi * (3.0 - np.sqrt(5.0))
    width = np.sqrt(1.0 - z * z)
    return np.column_stack([width * np.cos(turn), width * np.sin(turn), z])


def nearest_reachable(
    kinematics: ClosedKinematics,
    bounds: Sequence[AngleLimit],
    workspace: DirectionWorkspace | OrientationWorkspace,
    place: Floats,
) -> tuple[Floats, float] | None:
    """Return the reachable pose nearest to one that is outside, and how far (rad) it is.

    A direction (3,) or quaternion xyzw (4,), see `nearest_in_mode`. Parts that the
    workspace has are met whatever their size. None if no pose is known to be inside.
    """
    if isinstance(workspace, OrientationWorkspace):
        inside_poses = workspace.orientations.place[None]
    else:
        region = workspace.region
        if not region.components:
            return None
        inside_poses = np.stack(
            [region.nearest(place), *(x.place for x in region.components)]
        )
    (offer,) = nearest_in_mode(
        kinematics, bounds, workspace.signs, place[None], inside_poses
    )
    return offer


def nearest_in_mode(
    kinematics: ClosedKinematics,
    bounds: Sequence[AngleLimit],
    signs: Signs,
    places: Floats,
    inside_poses: Floats | None = None,
) -> list[tuple[Floats, float] | None]:
    """Return the reachable poses nearest to some that are outside, in one mode.

    Parameters
    ----------
    kinematics, bounds, signs
        The output, its limits, and the signs of the working mode.
    places
        (n, 3) directions or (n, 4) unit quaternions xyzw that are outside.
    inside_poses
        (k, 3 or 4) poses inside, besides those of `SAMPLES` spread evenly.

    Returns
    -------
    For each place the pose and the angle (rad) to it, to 1e-8 rad; None if no pose inside
    was met. `spherekit.outputs.nearest_pose` says what is compared.
    """

    def is_inside(places: Floats) -> Bools:
        # `judge` would compute inputs and measures too, which take most of its time.
        with np.errstate(all="ignore"):
            margin, _ = left_of(bounds, kinematics.at(_poses(kinematics, places), signs))
        return margin >= 0.0

    search = NearestPoseSearch(margins_of(kinematics, bounds, signs), is_inside)
    samples = direction_samples() if kinematics.points else orientation_samples()
    reachable = samples[is_inside(samples)]
    if inside_poses is not None:
        reachable = np.concatenate([reachable, inside_poses])
    if not len(reachable):
        return [None] * len(places)
    return [search.find_nearest(place, reachable) for place in places]


def nearest_poses(
    kinematics: ClosedKinematics, places: Floats, signs: Signs
) -> tuple[Floats, Floats]:
    """Return the reachable poses nearest to some that are outside, and how far (n,) rad.

    Directions (n, 3) or quaternions xyzw (n, 4), see `nearest_in_mode`, under the limits
    of the mechanism alone; NaN where none is known.
    """
    offers = nearest_in_mode(kinematics, kinematics.bounds, signs, places)
    near, away = np.full_like(places, np.nan), nans(len(places))
    for k, offer in enumerate(offers):
        if offer is not None:
            near[k], away[k] = offer
    return near, away
