"""Limits of an output, read from text, and how poses fare in its workspaces under them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np

from spherekit.plugin import AnalysisError, Floats, listing
from spherekit.plugin.rotations import (
    AtDirection,
    AtInputs,
    AtMirror,
    AtOrientation,
    normals_of,
    quaternion,
)
from spherekit.plugin.workspace import (
    AngleLimit,
    AxesLimit,
    ClosedKinematics,
    DirectionWorkspace,
    Judged,
    OrientationWorkspace,
    PairLimit,
    judge,
    label_of,
    nearest_reachable,
)

from .pose_text import read_pose

UNDEFINED = "the output is not determined"
"""Name of a border where no bound is 0."""


@final
@dataclass(frozen=True)
class Limited:
    """An output under limits of angles."""

    kinematics: ClosedKinematics
    bounds: Sequence[AngleLimit]

    @property
    def names(self) -> list[str]:
        """Names of the limits by their numbers, with that of none."""
        return [bound.name for bound in self.bounds] + [UNDEFINED]

    def judge(
        self, item: DirectionWorkspace | OrientationWorkspace, places: Floats
    ) -> Judged:
        """Return how places (n, 3) or (n, 4) fare in the working mode of a workspace."""
        return judge(self.kinematics, self.bounds, item.signs, places)


def read_limit(text: str) -> PairLimit:
    """Return the limits of a pair from ``PAIR:LOW:HIGH`` in degrees."""
    pair, *limits = text.split(":")
    if len(limits) == 2:
        low, high = (_degrees("limits", text, limit) for limit in limits)
        return PairLimit(pair, low, high)
    raise AnalysisError(
        f'workspace: limits: "{text}" is not PAIR:LOW:HIGH, with both in degrees'
    )


def read_apart(text: str) -> AxesLimit:
    """Return limits from ``PAIR/PAIR:LEAST`` or ``PAIR/PAIR:LEAST:GREATEST``."""
    axes, *limits = text.split(":")
    one, _, other = axes.partition("/")
    if other and len(limits) in (1, 2):
        return AxesLimit(one, other, *(_degrees("apart", text, limit) for limit in limits))
    raise AnalysisError(
        f'workspace: apart: "{text}" is not PAIR/PAIR:LEAST or PAIR/PAIR:LEAST:GREATEST, '
        "with angles in degrees"
    )


def _degrees(what: str, text: str, number: str) -> float:
    try:
        return float(np.radians(float(number)))
    except ValueError:
        raise AnalysisError(
            f'workspace: {what}: "{number}" in "{text}" is not a number of degrees'
        ) from None


Row = dict[str, Any]
Workspaces = tuple[DirectionWorkspace, ...] | tuple[OrientationWorkspace, ...]


def given_poses(text: str, kinematics: ClosedKinematics) -> Floats:
    """Return the poses (k, 3) or (k, 4) that a text says, none of an empty one."""
    size = 3 if kinematics.points else 4
    if not text:
        return np.zeros((0, size))
    where = "workspace: pose"
    names = tuple(item.pair for item in kinematics.mechanism.inputs)
    pose = read_pose(text, names, where)
    match pose:
        case AtInputs(inputs):
            solutions = kinematics.forward(inputs[None])
            places = (
                solutions.directions
                if kinematics.points
                else quaternion(solutions.rotations)
            )
            assert places is not None
            _, first = np.unique(places, axis=0, return_index=True)
            return np.asarray(places[np.sort(first)])
        case AtDirection(direction) if kinematics.points:
            return np.asarray(direction[None])
        case AtOrientation(orientation) if not kinematics.points:
            return np.asarray(quaternion(orientation[None]))
        case AtMirror(phi, gamma) if kinematics.form is not None:
            normals = normals_of(np.array([phi]), np.array([gamma]))
            turned = kinematics.form.orientations(normals)
            return np.asarray(turned @ np.array(kinematics.output.direction))
    takes = "a direction (x, y, z or azimuth, tilt)"
    if not kinematics.points:
        takes = "an orientation (azimuth, tilt, torsion; qx, qy, qz, qw; rx, ry, rz)"
    raise AnalysisError(
        f'{where}: "{text}" does not say how output {kinematics.output.name} '
        f"is posed; it takes {takes} or all inputs ({listing(names)})"
    )


def how_poses_fare(
    places: Floats, limited: Limited, workspaces: Workspaces
) -> tuple[list[Row], list[str], list[str]]:
    """Return how each pose fares in each mode, with the nearest one that is reached.

    And what to warn of, and what to say.
    """
    figures: list[Row] = []
    warnings: list[str] = []
    within: dict[str, list[str]] = {}
    if not len(places):
        warnings.append("pose: the mechanism does not close at these inputs")
    for place in places:
        told: dict[str, list[str]] = {}
        shown = ", ".join(f"{value:.6g}" for value in place)
        for item in workspaces:
            label = label_of(item.signs)
            here = limited.judge(item, place[None])
            row: Row = {
                "pose": place.tolist(),
                "working_mode": label,
                **_fares(here, limited.names),
            }
            figures.append(row)
            if row["inside"] == "yes":
                margin = f"{np.degrees(row['margin_rad']):.4g} deg"
                text = f"{margin} from {row['limiting']}, pose ({shown}) is inside"
                within.setdefault(text, []).append(label)
                continue
            nearest = nearest_reachable(limited.kinematics, limited.bounds, item, place)
            text = f"by {row['limiting']}"
            if nearest is not None:
                there, angle = nearest
                row["nearest"] = there.tolist()
                row["away_rad"] = angle
                row["nearest_inputs"] = _numbers(limited.judge(item, there[None]).inputs[0])
                offered = ", ".join(f"{value:.6g}" for value in there)
                text += f"; nearest is ({offered}), {np.degrees(angle):.4g} deg away"
            told.setdefault(text, []).append(label)
        warnings += [
            f"pose ({shown}) is outside in mode {', '.join(labels)}, {text}"
            for text, labels in told.items()
        ]
    said = [f"{text} in mode {', '.join(modes)}" for text, modes in within.items()]
    return figures, warnings, said


def _fares(judged: Judged, names: list[str]) -> Row:
    return {
        "inside": "yes" if judged.inside[0] else "no",
        "margin_rad": _numbers(judged.margin)[0],
        "limiting": names[int(judged.limiting[0])],
        "inputs": _numbers(judged.inputs[0]),
        "type_1": _numbers(judged.type_1)[0],
        "type_2": _numbers(judged.type_2)[0],
    }


def _numbers(values: Floats) -> list[float | None]:
    """Return numbers ready for JSON, None for NaN."""
    return [value if np.isfinite(value) else None for value in values.tolist()]
