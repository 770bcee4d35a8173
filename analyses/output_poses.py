"""A pose of an output as text, ``azimuth=10+tilt=20``, ``21=5.3+61=56.7``; its limits."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from spherekit.plugin import (
    AnalysisError,
    Floats,
    listing,
)
from spherekit.plugin.rotations import (
    AtDirection,
    AtInputs,
    AtMirror,
    AtOrientation,
    AtRotation,
    Pose,
    from_quaternion,
    from_tilt_torsion,
    normals_of,
    pointing,
)
from spherekit.plugin.workspace import (
    InterferenceLimit,
    JointRange,
)

DIRECTION = ("x", "y", "z")
AZIMUTH_TILT = ("azimuth", "tilt")
MIRROR = ("phi", "gamma")
TILT_TORSION = ("azimuth", "tilt", "torsion")
QUATERNION = ("qx", "qy", "qz", "qw")
VECTOR = ("rx", "ry", "rz")
TURN = ("ux", "uy", "uz", "angle")
ANGLES = frozenset((*TILT_TORSION, *MIRROR, *VECTOR))
"""Terms that are angles."""
WANTING = "no direction: all numbers are 0"


def read_pose(text: str, inputs: tuple[str, ...], where: str) -> Pose:
    """Return the pose that a text gives; angles in it are in degrees.

    Parameters
    ----------
    text
        ``name=number+name=number``: all driven pairs; x, y, z; azimuth, tilt; phi,
        gamma; azimuth, tilt, torsion; qx, qy, qz, qw; or rx, ry, rz.
    inputs
        Names of the driven pairs.
    where
        What the text is, for complaints.

    Raises
    ------
    AnalysisError
        If it is no such text.
    """
    pose = read_end(text, inputs, where, turns=False)
    assert not isinstance(pose, AtRotation)
    return pose


def read_end(
    text: str, inputs: tuple[str, ...], where: str, turns: bool = True
) -> Pose | AtRotation:
    """Return the pose, or with `turns` also the turn (ux, uy, uz, angle), of a text."""
    (given,) = numbers_of(text.split("+"), where, several=False)
    kinds = [inputs, *POSED][: None if turns else -1]
    kind = next((names for names in kinds if set(names) == set(given)), None)
    if kind is None:
        ways = listing("=..+".join(names) + "=.." for names in kinds)
        raise AnalysisError(f'{where}: "{text}" is not a pose; say one of {ways}')
    values = np.array([given[name] for name in kind])
    if kind == inputs:
        return AtInputs(np.radians(values))
    if kind == MIRROR:
        return AtMirror(*np.radians(values))
    if ANGLES.issuperset(kind):
        values = np.radians(values)
    (pose,) = POSED[kind](values[None])
    if np.any(np.isnan(pose)):
        raise AnalysisError(f'{where}: "{text}" has {WANTING}')
    if kind != TURN:
        return AtDirection(pose) if pose.ndim == 1 else AtOrientation(pose)
    if not values[3] > 0.0:
        raise AnalysisError(
            f'{where}: "{text}": angle has to be above 0; turn the axis round instead'
        )
    return AtRotation(pose, float(np.radians(values[3])))


def _unit(rows: Floats) -> Floats:
    """Return rows of length 1, NaN where all numbers of one are 0."""
    with np.errstate(invalid="ignore"):
        return rows / np.linalg.norm(rows, axis=1, keepdims=True)


def _turned(rows: Floats) -> Floats:
    """Return the rotations (n, 3, 3) with rotation vectors (n, 3)."""
    half = 0.5 * np.linalg.norm(rows, axis=1, keepdims=True)
    vectors = 0.5 * np.sinc(half / np.pi) * rows
    return from_quaternion(np.hstack([vectors, np.cos(half)]))


POSED: Mapping[tuple[str, ...], Callable[[Floats], Floats]] = {
    DIRECTION: _unit,
    AZIMUTH_TILT: pointing,
    MIRROR: lambda rows: normals_of(*rows.T),
    TILT_TORSION: from_tilt_torsion,
    QUATERNION: lambda rows: from_quaternion(_unit(rows)),
    VECTOR: _turned,
    TURN: lambda rows: _unit(rows[:, :3]),
}
"""Directions (n, 3), mid-planes (n, 3), rotations (n, 3, 3) and axes of turns, by the terms
that they are said in: rows of numbers, angles in rad. NaN where the numbers say none."""


def shown(place: Floats) -> str:
    """Return a direction or quaternion as text."""
    return f"({', '.join(f'{x:.6g}' for x in np.round(place, 6) + 0.0)})"


def nearest_at(place: Floats, away: float) -> str:
    """Return words on the nearest pose that is reached, and how far (rad) it is."""
    return f"nearest is {shown(place)}, {np.degrees(away):.4g} deg away"


def numbers_of(
    parts: Sequence[str], where: str, several: bool = True
) -> list[dict[str, float]]:
    """Return the numbers by name of poses; a name that comes again begins the next.

    Raises
    ------
    AnalysisError
        If a part is not ``name=number``, or there are `several` poses and may be one.
    """
    poses: list[dict[str, float]] = [{}]
    for part in parts:
        name, _, value = part.partition("=")
        try:
            number = float(value)
        except ValueError:
            number = np.nan
        again = name in poses[-1]
        if not (name and np.isfinite(number)) or (again and not several):
            raise AnalysisError(
                f'{where}: "{part}" of "{"+".join(parts)}" is not name=number'
                f"{'' if several else ', each name once'}; say for example "
                "azimuth=10+tilt=20"
            )
        if again:
            poses.append({})
        poses[-1][name] = number
    return poses


def read_limit(text: str) -> JointRange:
    """Return the limits of a pair from ``PAIR:LOW:HIGH`` in degrees."""
    pair, *limits = text.split(":")
    try:
        low, high = _radians(limits)
    except ValueError:
        raise AnalysisError(
            f'workspace: limits: "{text}" is not PAIR:LOW:HIGH, with both in degrees'
        ) from None
    return JointRange(pair, low, high)


def read_apart(text: str) -> InterferenceLimit:
    """Return limits from ``PAIR/PAIR:LEAST`` or ``PAIR/PAIR:LEAST:GREATEST``."""
    axes, *limits = text.split(":")
    try:
        one, other = axes.split("/")
        low, high = _radians(limits if len(limits) == 2 else [*limits, "180"])
    except ValueError:
        raise AnalysisError(
            f'workspace: apart: "{text}" is not PAIR/PAIR:LEAST or '
            "PAIR/PAIR:LEAST:GREATEST, with angles in degrees"
        ) from None
    return InterferenceLimit(one, other, low, high)


def _radians(numbers: Sequence[str]) -> Sequence[float]:
    angles: list[float] = np.radians([float(number) for number in numbers]).tolist()
    return angles
