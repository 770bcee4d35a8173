"""Poses of an output and limits of a workspace as text, such as ``azimuth=10+tilt=20``."""

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from spherekit.plugin import (
    AnalysisError,
    Floats,
    listing,
)
from spherekit.plugin.quantities import ANGLE, AngleUnit, QuantityError, read_quantity
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

DIRECTION_TERMS = ("x", "y", "z")
AZIMUTH_TILT_TERMS = ("azimuth", "tilt")
MID_PLANE_TERMS = ("phi", "gamma")
TILT_TORSION_TERMS = ("azimuth", "tilt", "torsion")
QUATERNION_TERMS = ("qx", "qy", "qz", "qw")
ROTATION_VECTOR_TERMS = ("rx", "ry", "rz")
MATRIX_TERMS = tuple(f"r{row}{column}" for row in (1, 2, 3) for column in (1, 2, 3))
AXIS_ANGLE_TERMS = ("ux", "uy", "uz", "angle")
"""The names of the numbers in each form of a pose, and of a rotation about an axis."""
ANGULAR_TERMS = frozenset(
    (*TILT_TORSION_TERMS, *MID_PLANE_TERMS, *ROTATION_VECTOR_TERMS, "angle")
)
"""Terms that are angles, or components of a rotation vector."""
NO_DIRECTION = "no direction: all its components are 0"
"""Error message about a direction or quaternion of length 0."""


def read_pose(
    text: str, inputs: tuple[str, ...], where: str, angle_unit: AngleUnit
) -> Pose:
    """Return the pose of an output link from a text.

    Parameters
    ----------
    text
        ``name=number+name=number``, such as ``azimuth=10+tilt=20deg``. The names are:

        - all driven pairs;
        - x, y, z or azimuth, tilt for a direction;
        - phi, gamma, two angles of the plane in which base and output link mirror each
          other;
        - azimuth, tilt, torsion, a quaternion qx, qy, qz, qw, or a rotation vector rx, ry,
          rz for an orientation.
    inputs
        Names of the driven pairs.
    where
        Name of the parameter that has the text, for error messages.
    angle_unit
        Unit of angles without a unit in the text.

    Raises
    ------
    AnalysisError
        If the text has no such form.
    """
    # `allow_rotation=False` refuses the axis and angle of a rotation from another pose.
    pose = read_end(text, inputs, where, angle_unit, allow_rotation=False)
    assert not isinstance(pose, AtRotation)
    return pose


def read_end(
    text: str,
    inputs: tuple[str, ...],
    where: str,
    angle_unit: AngleUnit,
    allow_rotation: bool = True,
) -> Pose | AtRotation:
    """Return the end of a rotation of the output link from a text.

    The end is a pose, or an axis and an angle by which the start pose is turned.

    Parameters
    ----------
    text
        ``name=number+name=number``, with the names that `read_pose` accepts.
    inputs
        Names of the driven pairs.
    where
        Name of the parameter that has the text, for error messages.
    angle_unit
        Unit of angles without a unit in the text.
    allow_rotation
        Whether the text may also be the axis and the angle of a rotation: ux, uy, uz,
        angle.

    Raises
    ------
    AnalysisError
        If the text has no such form.
    """
    # 1. Find the form: the set of names decides how the numbers describe a pose.
    (number_of_term,) = read_terms(
        text.split("+"), inputs, where, angle_unit, allow_several=False
    )
    forms = [inputs, *CONVERSION_OF_FORM]
    if not allow_rotation:
        forms.remove(AXIS_ANGLE_TERMS)
    form = next((terms for terms in forms if set(terms) == set(number_of_term)), None)
    if form is None:
        alternatives = listing("=..+".join(terms) + "=.." for terms in forms)
        raise AnalysisError(
            f'{where}: "{text}" does not describe a pose; give one of {alternatives}'
        )

    # 2. Convert the numbers, in the order of the form, to a pose. Angles are in rad.
    values = np.array([number_of_term[term] for term in form])
    if form == inputs:
        return AtInputs(values)
    # phi and gamma of the plane in which base and output link mirror each other.
    if form == MID_PLANE_TERMS:
        return AtMirror(*values)
    # A direction (3,), an orientation (3, 3), or the axis (3,) of a rotation. A direction,
    # axis or quaternion of length 0 gives NaN.
    (pose_or_axis,) = CONVERSION_OF_FORM[form](values[None])
    if np.any(np.isnan(pose_or_axis)):
        raise AnalysisError(f'{where}: "{text}" has {NO_DIRECTION}')
    if form != AXIS_ANGLE_TERMS:
        is_direction = pose_or_axis.ndim == 1
        return AtDirection(pose_or_axis) if is_direction else AtOrientation(pose_or_axis)
    angle = values[3]
    if not angle > 0.0:
        raise AnalysisError(
            f'{where}: "{text}": angle must be above 0; reverse the axis for a rotation in '
            "the opposite sense"
        )
    return AtRotation(pose_or_axis, float(angle))


def _normalize(rows: Floats) -> Floats:
    """Return rows (n, k) of length 1; NaN for a row of zeros."""
    # A power of two scales each row, so that squares neither overflow nor become 0.
    _, exponents = np.frexp(np.max(np.abs(rows), axis=1, keepdims=True))
    scaled_rows = np.ldexp(rows, -exponents)
    with np.errstate(invalid="ignore"):
        return scaled_rows / np.linalg.norm(scaled_rows, axis=1, keepdims=True)


def _rotations_from_vectors(rotation_vectors: Floats) -> Floats:
    """Return the rotations (n, 3, 3) of rotation vectors (n, 3) in rad.

    A rotation vector v has the direction of the axis and the length of the angle a. The
    quaternion is (sin(a / 2) v / a, cos(a / 2)).
    """
    half_angle = 0.5 * np.linalg.norm(rotation_vectors, axis=1, keepdims=True)
    # `np.sinc(x / pi)` is sin(x) / x, without a division by 0 at x = 0.
    vector_part = 0.5 * np.sinc(half_angle / np.pi) * rotation_vectors
    return from_quaternion(np.hstack([vector_part, np.cos(half_angle)]))


CONVERSION_OF_FORM: Mapping[tuple[str, ...], Callable[[Floats], Floats]] = {
    DIRECTION_TERMS: _normalize,
    AZIMUTH_TILT_TERMS: pointing,
    MID_PLANE_TERMS: lambda rows: normals_of(*rows.T),
    TILT_TORSION_TERMS: from_tilt_torsion,
    QUATERNION_TERMS: lambda rows: from_quaternion(_normalize(rows)),
    ROTATION_VECTOR_TERMS: _rotations_from_vectors,
    AXIS_ANGLE_TERMS: lambda rows: _normalize(rows[:, :3]),
}
"""The function that converts rows (n, k) of numbers, by the terms of their columns.

Angles are in rad. The results are directions (n, 3), normals of mid-planes (n, 3),
rotations (n, 3, 3), or axes of rotations (n, 3). Rows that are no pose give NaN."""


def format_pose(pose: Floats) -> str:
    """Return a direction (3,) or quaternion (4,) as text."""
    # Adding zero turns negative zeros into zeros.
    return f"({', '.join(f'{x:.6g}' for x in np.round(pose, 6) + 0.0)})"


def describe_nearest_pose(pose: Floats, distance: float) -> str:
    """Return the nearest reachable pose and its angular distance (rad) in words."""
    return f"nearest is {format_pose(pose)}, {np.degrees(distance):.4g} deg away"


def find_angular_terms(names: Iterable[str], inputs: Sequence[str]) -> frozenset[str]:
    """Return the terms that are angles: those in `ANGULAR_TERMS`, and the inputs.

    An input can have the name of a term, such as x. If the names of the numbers are those
    of another form, such as x, y, z, only the terms in `ANGULAR_TERMS` are angles.
    """
    given_names = set(names)
    other_forms = [set(form) for form in (*CONVERSION_OF_FORM, MATRIX_TERMS)]
    if given_names != set(inputs) and given_names in other_forms:
        return ANGULAR_TERMS
    return ANGULAR_TERMS | set(inputs)


def read_terms(
    parts: Sequence[str],
    inputs: Sequence[str],
    where: str,
    angle_unit: AngleUnit,
    allow_several: bool = True,
) -> list[dict[str, float]]:
    """Read poses from texts ``name=number``.

    Parameters
    ----------
    parts
        The texts. A name that occurs again begins the next pose.
    inputs
        Names of the driven pairs (joints), whose numbers are angles.
    where
        Name of the parameter that has the texts, for error messages.
    angle_unit
        Unit of angles without a unit in the text.
    allow_several
        Whether there may be several poses.

    Returns
    -------
    For each pose its numbers by name, angles in rad.

    Raises
    ------
    AnalysisError
        If a text is not ``name=number``, or if a name occurs twice where only one pose
        is allowed.
    """
    poses: list[dict[str, float]] = [{}]
    names = [part.partition("=")[0] for part in parts]
    angular_terms = find_angular_terms(names, inputs)
    # The whole text, for messages about a part of it.
    whole = f' in "{"+".join(parts)}"' if len(parts) > 1 else ""
    for part in parts:
        name, _, value = part.partition("=")
        try:
            if name in angular_terms:
                number = read_quantity(value, ANGLE, angle_unit)
            else:
                number = float(value)
        except QuantityError as problem:
            raise AnalysisError(f"{where}: {name}: {problem}") from None
        except ValueError:
            # NaN is refused below.
            number = np.nan
        begins_pose = name in poses[-1]
        if not name or not np.isfinite(number):
            raise AnalysisError(
                f'{where}: found "{part}"{whole}, expected the form name=number; '
                "join several of them by +, for example azimuth=10+tilt=20"
            )
        if begins_pose and not allow_several:
            raise AnalysisError(
                f"{where}: {name} is given twice{whole}; give each name once"
            )
        if begins_pose:
            poses.append({})
        poses[-1][name] = number
    return poses


def read_joint_range(text: str, angle_unit: AngleUnit) -> JointRange:
    """Return the limits of a pair from ``PAIR:LOW:HIGH``, two angles."""
    pair, *limits = text.split(":")
    try:
        low, high = _read_angles(limits, angle_unit)
    except ValueError as problem:
        raise AnalysisError(
            f'workspace: limits: "{text}" is not PAIR:LOW:HIGH with two angles, such as '
            f"21:-30deg:60deg{_reason(problem)}"
        ) from None
    return JointRange(pair, low, high)


def read_interference_limit(text: str, angle_unit: AngleUnit) -> InterferenceLimit:
    """Read a limit of the angle between the axes of two pairs, the option ``apart``.

    If the angle between two axes is too small, the links at these pairs (joints) collide.

    Parameters
    ----------
    text
        ``PAIR/PAIR:MIN`` or ``PAIR/PAIR:MIN:MAX``, with two angles. MAX is 180 degrees if
        it is left out.
    angle_unit
        Unit of angles without a unit in the text.
    """
    axes, *limits = text.split(":")
    if len(limits) == 1:
        limits.append("180deg")
    # A wrong number of names or angles raises a ValueError here.
    try:
        first_pair, second_pair = axes.split("/")
        low, high = _read_angles(limits, angle_unit)
    except ValueError as problem:
        raise AnalysisError(
            f'workspace: apart: "{text}" has to be PAIR/PAIR:MIN or PAIR/PAIR:MIN:MAX, '
            "where MIN and MAX limit the angle between the two axes, such as 21/51:20deg"
            f"{_reason(problem)}"
        ) from None
    return InterferenceLimit(first_pair, second_pair, low, high)


def _read_angles(texts: Sequence[str], angle_unit: AngleUnit) -> list[float]:
    """Return angles in rad from texts."""
    return [read_quantity(text, ANGLE, angle_unit) for text in texts]


def _reason(problem: ValueError) -> str:
    """Return what is wrong with the unit of a number, as the end of a message, or ""."""
    return f"; {problem}" if isinstance(problem, QuantityError) else ""
