"""A pose of an output as text: ``phi=75+gamma=-20``, ``21=5.3+61=56.7``."""

import numpy as np

from spherekit.plugin import (
    AnalysisError,
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
)

DIRECTION = ("x", "y", "z")
MIRROR = ("phi", "gamma")
TILT_TORSION = ("azimuth", "tilt", "torsion")
QUATERNION = ("qx", "qy", "qz", "qw")
TURN = ("ux", "uy", "uz", "angle")


def read_pose(text: str, inputs: tuple[str, ...], where: str) -> Pose:
    """Return the pose that a text gives; angles in it are in degrees.

    Parameters
    ----------
    text
        ``key=value+key=value``: all driven pairs; x, y, z; phi, gamma; azimuth, tilt,
        torsion; or qx, qy, qz, qw.
    inputs
        Names of the driven pairs.
    where
        What the text is, for complaints.

    Raises
    ------
    AnalysisError
        If it is no such text.
    """
    found = read_end(text, inputs, where, turns=False)
    assert not isinstance(found, AtRotation)
    return found


def read_end(
    text: str, inputs: tuple[str, ...], where: str, turns: bool = True
) -> Pose | AtRotation:
    """Return the pose, or with `turns` also the turn (ux, uy, uz, angle), of a text."""
    given = _numbers(text, where)
    kinds = [inputs, DIRECTION, MIRROR, TILT_TORSION, QUATERNION]
    if turns:
        kinds.append(TURN)
    kind = next((names for names in kinds if set(names) == set(given)), None)
    if kind is None:
        ways = listing("+".join(f"{name}=.." for name in names) for names in kinds)
        raise AnalysisError(f'{where}: "{text}" is not a pose; say one of {ways}')
    values = np.array([given[name] for name in kind])
    if kind == inputs:
        return AtInputs(np.radians(values))
    if kind == MIRROR:
        return AtMirror(*np.radians(values))
    if kind == TILT_TORSION:
        return AtOrientation(from_tilt_torsion(np.radians(values)[None])[0])
    length = float(np.linalg.norm(values if kind == QUATERNION else values[:3]))
    if length == 0.0:
        raise AnalysisError(f'{where}: "{text}" has no direction: all numbers are 0')
    if kind == QUATERNION:
        return AtOrientation(from_quaternion((values / length)[None])[0])
    if kind == DIRECTION:
        return AtDirection(values / length)
    if not values[3] > 0.0:
        raise AnalysisError(
            f'{where}: "{text}": angle has to be above 0; turn the axis round instead'
        )
    return AtRotation(values[:3] / length, float(np.radians(values[3])))


def _numbers(text: str, where: str) -> dict[str, float]:
    found: dict[str, float] = {}
    for part in text.split("+"):
        name, equals, value = part.partition("=")
        try:
            number = float(value)
        except ValueError:
            number = np.nan
        if not (name and equals and np.isfinite(number)) or name in found:
            raise AnalysisError(
                f'{where}: "{part}" of "{text}" is not name=number, each name once; say '
                "for example phi=75+gamma=-20"
            )
        found[name] = number
    return found
