"""Workspaces of an output: what it reaches in each working mode under constraints."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import starmap
from typing import TypeVar

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.output.dyads import Signs
from spherekit.region.orientations import Orientations, find_orientations
from spherekit.region.refine import Region, find_region
from spherekit.sphere.rotation import from_quaternion, nans, unit_rows
from spherekit.workspace.rows import AngleLimit, ClosedKinematics, left_of

SAMPLES = 4000
"""Orientations looked at."""
PSI = 1.533751168755204288118041
"""The positive root of x^4 = x + 4."""
NUDGES = (1e-12, 1e-11, 1e-10, 1e-9, 1e-8)
"""Steps (rad) into a workspace from its border, which is known to rounding only."""
WAY_ROUNDS, WAY_SAMPLES = 8, 65
COARSE = 1e-2
"""Relative error of the set of directions in which the nearest one is looked for; the
places on its border do not depend on it."""


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


Margins = Callable[[Floats], Floats]
"""Margins (n, bounds) at places (n, ...)."""


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


def nearest_reachable(
    kinematics: ClosedKinematics,
    bounds: Sequence[AngleLimit],
    workspace: DirectionWorkspace | OrientationWorkspace,
    place: Floats,
) -> tuple[Floats, float] | None:
    """Return a reachable pose near one that is outside, and how far (rad) it is.

    Of directions (3,) it is the nearest one, to 1e-8 rad. Of quaternions xyzw (4,) it is
    where the way to the nearest of `SAMPLES` orientations spread evenly, or to the best
    one known, enters the workspace for good. None if no pose is known to be inside.
    """
    if isinstance(workspace, OrientationWorkspace):
        samples = np.concatenate(
            [orientation_samples(), workspace.orientations.place[None]]
        )
        (offer,) = nearest_orientations(
            kinematics, bounds, workspace.signs, place[None], samples
        )
        return offer
    if not workspace.region.components:
        return None
    border = workspace.region.nearest(place)
    inward = [2.0 * border - place, *(part.place for part in workspace.region.components)]
    aims = [border, *(_beyond(border, aim, step) for step in NUDGES for aim in inward)]
    candidates = np.stack(aims)
    good = np.flatnonzero(judge(kinematics, bounds, workspace.signs, candidates).inside)
    there = candidates[good[0]] if len(good) else border
    return there, _between(place, there)


def nearest_orientations(
    kinematics: ClosedKinematics,
    bounds: Sequence[AngleLimit],
    signs: Signs,
    places: Floats,
    samples: Floats,
) -> list[tuple[Floats, float] | None]:
    """Return reachable orientations near ones that are outside, and how far (rad).

    Quaternions (n, 4); each is where the way to the nearest of the samples (k, 4) that are
    inside enters the workspace for good; None if none of them is.
    """

    def inside(places: Floats) -> Bools:
        return judge(kinematics, bounds, signs, places).inside

    held = samples[inside(samples)]
    if not len(held):
        return [None] * len(places)
    offers: list[tuple[Floats, float] | None] = []
    for place in places:
        near = held[np.argmax(np.abs(held @ place))]
        there = _on_way(place, near if near @ place >= 0.0 else -near, inside)
        offers.append((there, 2.0 * _between(place, there)))
    return offers


def nearest_poses(
    kinematics: ClosedKinematics, places: Floats, signs: Signs
) -> tuple[Floats, Floats]:
    """Return reachable poses near ones that are outside, and how far (n,) rad.

    Directions (n, 3) or quaternions xyzw (n, 4), see `nearest_reachable`, under the limits
    of the mechanism alone; NaN where none is known.
    """
    bounds = kinematics.bounds
    if kinematics.points:
        (workspace,) = direction_workspaces(kinematics, bounds, [signs], COARSE)
        offers = [
            nearest_reachable(kinematics, bounds, workspace, place) for place in places
        ]
    else:
        samples = orientation_samples()
        offers = nearest_orientations(kinematics, bounds, signs, places, samples)
    near, away = np.full_like(places, np.nan), nans(len(places))
    for k, offer in enumerate(offers):
        if offer is not None:
            near[k], away[k] = offer
    return near, away


def _between(one: Floats, other: Floats) -> float:
    """Return the angle (rad) between unit vectors of any dimension."""
    apart, together = np.linalg.norm(one - other), np.linalg.norm(one + other)
    return float(2.0 * np.arctan2(apart, together))


def _beyond(start: Floats, aim: Floats, step: float) -> Floats:
    """Return the direction (3,) a step (rad) from `start` towards another place."""
    way = aim - (aim @ start) * start
    return unit_rows(start + way * (step / max(float(np.linalg.norm(way)), 1e-300)))


def _on_way(outside: Floats, held: Floats, inside: Callable[[Floats], Bools]) -> Floats:
    """Return the quaternion on the way to `held` from which on all samples are inside."""
    low, high = 0.0, 1.0
    for _ in range(WAY_ROUNDS):
        parts = np.linspace(low, high, WAY_SAMPLES)[:, None]
        places = unit_rows((1.0 - parts) * outside + parts * held)
        last = np.flatnonzero(~inside(places))[-1]
        low, high = parts[last : last + 2, 0]
        held_there = places[last + 1]
    return held_there
