"""Inverse kinematics in rows: the configurations of poses, with measures and rates.

A closed form has a row for each pose and working mode; on the graph of a mechanism with
other groups there is one for each configuration that was found.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import Status
from spherekit.errors import AnalysisError, ModelError
from spherekit.guidance.form import MidPlaneForm
from spherekit.guidance.symmetry import mid_plane_form
from spherekit.model.geometry import geometry_of
from spherekit.model.mechanism import Mechanism, Output
from spherekit.motion.branches import FLAT_DYAD
from spherekit.motion.closure import Closure
from spherekit.motion.motion import motion_of
from spherekit.output.forward import ForwardKinematics, output_rates
from spherekit.output.inverse import InverseKinematics
from spherekit.output.solutions import Solutions
from spherekit.output.wrist import COORDINATES, with_wrist
from spherekit.rates.transmission import Transmission
from spherekit.sphere.rotation import Floats, cross
from spherekit.workspace.constraints import Bound, Constraints, bounds_of
from spherekit.workspace.kinematics import (
    MidPlaneKinematics,
    OutputKinematics,
    closed_form_of,
    label_of,
)
from spherekit.workspace.workspace import (
    direction_workspaces,
    left_of,
    nearest_orientations,
    nearest_reachable,
    orientation_samples,
)

COARSE = 1e-2
"""Relative error of the set of directions in which the nearest one is looked for; the
places on its border do not depend on it."""


@final
@dataclass(frozen=True)
class InverseRows:
    """k rows: the number of the pose, the label of the working mode, and what is there.

    Attributes
    ----------
    pose
        (k,) number of the pose, ascending.
    mode
        (k,) label of the working mode, ``~`` for each group without signs; empty for a
        pose without a configuration.
    inputs
        (k, inputs) rad in (-pi, pi].
    status
        (k,) values of `Status`: OK; OUT_OF_REACH, and then all but margin and limiting
        are NaN; AT_SINGULARITY where a measure is nearly 0 or has no value.
    margin, limiting
        (k,) rad left to the nearest limit, negative outside, and its number in `limits`;
        NaN and -1 where no limit says anything.
    type_1, type_2
        (k, inputs) and (k,), see `Inverse` and `spherekit.rates.transmission`.
    rates
        (k, inputs, 3): rates of the inputs per unit angular velocity of the output, in
        axes of the link it is seen from; for a pointing output of that part of it which
        is at right angles to the direction.
    values
        (k, pairs asked for) rad in (-pi, pi].
    limits
        Names of the limits.
    """

    pose: NDArray[np.intp]
    mode: NDArray[np.str_]
    inputs: Floats
    status: NDArray[np.int8]
    margin: Floats
    limiting: NDArray[np.intp]
    type_1: Floats
    type_2: Floats
    rates: Floats
    values: Floats
    limits: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.pose)

    @property
    def solved(self) -> NDArray[np.bool_]:
        """Which rows (k,) have a configuration."""
        return np.asarray(self.status != Status.OUT_OF_REACH)

    @staticmethod
    def joined(parts: "Sequence[InverseRows]") -> "InverseRows":
        """Return the rows of several modes, those of a pose together."""
        pose = np.concatenate([part.pose for part in parts])
        order = np.argsort(pose, kind="stable")
        names = ("mode", "inputs", "status", "margin", "limiting", "type_1", "type_2")
        return InverseRows(
            pose[order],
            **{
                name: np.concatenate([getattr(part, name) for part in parts])[order]
                for name in (*names, "rates", "values")
            },
            limits=parts[0].limits,
        )


class PoseSolver(ABC):
    """Inverse and forward kinematics of one output, whatever way leads there."""

    mechanism: Mechanism
    output: Output
    points: bool
    """Whether poses are directions (n, 3), else rotations (n, 3, 3)."""
    modes: tuple[str, ...]
    """Labels of the working modes."""
    legs: tuple[str, ...]
    """What each sign belongs to."""
    form: MidPlaneForm | None = None
    """The mid-plane form of the output, if it has one."""
    solved_by: str
    """What gives the configurations: ``dyads``, ``mid-plane`` or ``graph``."""

    @abstractmethod
    def inverse(
        self, poses: Floats, modes: Sequence[str], pairs: Sequence[int] = ()
    ) -> InverseRows:
        """Return the configurations of poses in some modes, with variables of pairs."""

    @abstractmethod
    def forward(self, inputs: Floats) -> Solutions:
        """Return every pose found at inputs (n, inputs) rad."""

    def type_2(self, values: Floats) -> Floats:
        """Return the measure (n,) of type II at configurations (n, variables)."""
        closure = Closure.of(self.mechanism, geometry_of(self.mechanism).joints)
        return Transmission.of(self.mechanism, self.output).of_values(closure, values)

    def residual(self, values: Floats) -> Floats:
        """Return (n,) rad by how much loops fail to close at values (n, variables)."""
        closure = Closure.of(self.mechanism, geometry_of(self.mechanism).joints)
        return closure.at(values).gap


def pose_solver(
    mechanism: Mechanism, output: str | None = None, graph: bool = False
) -> PoseSolver:
    """Return what solves the poses of an output.

    Parameters
    ----------
    mechanism, output
        The mechanism, and the name of its output if there are several.
    graph
        Whether to solve the graph of all links, though there is a closed form.

    Raises
    ------
    PlanError
        If the output is unknown, or cannot take every pose.
    """
    if len(mechanism.inputs) not in COORDINATES:
        return ForwardPoses(mechanism, output)
    inverse = InverseKinematics(mechanism, output)
    if inverse.has_closed_form or not graph:
        try:
            return ClosedPoses(closed_form_of(inverse))
        except AnalysisError:
            pass
    return GraphPoses(inverse)


@final
class ForwardPoses(PoseSolver):
    """An output with another number of inputs than a pose has coordinates: one way only."""

    points = False
    modes = ()
    legs = ()
    solved_by = "graph"

    def __init__(self, mechanism: Mechanism, output: str | None) -> None:
        self._own = ForwardKinematics(mechanism, output)
        self.mechanism, self.output = mechanism, self._own.output

    def inverse(
        self, poses: Floats, modes: Sequence[str], pairs: Sequence[int] = ()
    ) -> InverseRows:
        """Raise the `PlanError` that says why there is none."""
        with_wrist(self.mechanism, self.output.name)
        raise AssertionError(self.mechanism.inputs)

    def forward(self, inputs: Floats) -> Solutions:
        """Return every pose found at inputs."""
        return self._own.solutions(inputs)


@final
class ClosedPoses(PoseSolver):
    """An output in a closed form, see `kinematics_of`; poses are judged by its limits."""

    def __init__(self, kinematics: OutputKinematics) -> None:
        self.kinematics = kinematics
        self.mechanism, self.output = kinematics.mechanism, kinematics.output
        self.points, self.legs = kinematics.points, kinematics.legs
        self.solved_by = "dyads"
        if isinstance(kinematics, MidPlaneKinematics):
            self.form, self.solved_by = kinematics.form, "mid-plane"
        self._signs = {label_of(signs): signs for signs in kinematics.modes}
        self.modes = tuple(self._signs)

    @cached_property
    def bounds(self) -> tuple[Bound, ...]:
        """The reach of the legs, and the stops of the mechanism."""
        return bounds_of(self.kinematics, Constraints())

    def inverse(
        self, poses: Floats, modes: Sequence[str], pairs: Sequence[int] = ()
    ) -> InverseRows:
        """Return a row for each pose and mode."""
        limits = tuple(bound.name for bound in self.bounds)
        parts = []
        for mode in modes:
            with np.errstate(invalid="ignore", divide="ignore"):
                rows = self.kinematics.at(poses, self._signs[mode])
                margin, limiting = left_of(self.bounds, rows)
                values = [rows.angle(pair) for pair in pairs]
                parts.append(
                    _masked(
                        np.arange(len(poses)),
                        np.full(len(poses), mode),
                        rows.inputs,
                        margin,
                        limiting,
                        Measures(rows.rates, rows.type_1, rows.type_2),
                        _columns(values, len(poses)),
                        limits,
                    )
                )
        return InverseRows.joined(parts)

    def forward(self, inputs: Floats) -> Solutions:
        """Return every pose at inputs."""
        return self.kinematics.forward(inputs)

    def nearest(self, places: Floats, mode: str) -> tuple[Floats, Floats]:
        """Return reachable poses near ones that are outside, and how far (n,) rad.

        Directions (n, 3) or quaternions xyzw (n, 4), see `nearest_reachable`; NaN where
        none is known.
        """
        signs = self._signs[mode]
        if self.points:
            (found,) = direction_workspaces(self.kinematics, self.bounds, [signs], COARSE)
            offers = [
                nearest_reachable(self.kinematics, self.bounds, found, place)
                for place in places
            ]
        else:
            offers = nearest_orientations(
                self.kinematics, self.bounds, signs, places, orientation_samples()
            )
        near, away = np.full_like(places, np.nan), np.full(len(places), np.nan)
        for k, offer in enumerate(offers):
            if offer is not None:
                near[k], away[k] = offer
        return near, away


@final
class GraphPoses(PoseSolver):
    """An output whose poses are solved on the graph of all links, row by row."""

    solved_by = "graph"

    def __init__(self, inverse: InverseKinematics) -> None:
        self.kinematics = inverse
        self.mechanism, self.output = inverse.own, inverse.wrist.output
        self.points, self.legs = inverse.wrist.points, inverse.legs
        self.modes = tuple(label_of(signs) for signs in inverse.modes)
        try:
            self.form = mid_plane_form(self.mechanism, self.output.name)
        except ModelError:
            self.form = None

    def inverse(
        self, poses: Floats, modes: Sequence[str], pairs: Sequence[int] = ()
    ) -> InverseRows:
        """Return a row for each configuration found, or one that says there is none."""
        found = self.kinematics.solutions(poses)
        labels = np.array([label_of(signs) for signs in found.signs], dtype=str)
        kept = np.flatnonzero(np.isin(labels, list(modes)))
        none = np.setdiff1d(np.arange(len(poses)), found.row[kept])
        lost = np.full(len(kept) + len(none), -1)
        lost[: len(kept)] = kept
        values = _filled(found.values, lost)
        owner = list(self.mechanism.variable_owners)
        rows = _masked(
            np.concatenate([found.row[kept], none]),
            np.concatenate([labels[kept], np.full(len(none), "")]),
            _filled(found.inputs, lost),
            np.where(lost < 0, -np.inf, np.nan),
            np.full(len(lost), -1),
            self._measures(values, _filled(found.rotations, lost)),
            values[:, [owner.index(pair) for pair in pairs]],
            (),
        )
        return InverseRows.joined([rows])

    def _measures(self, values: Floats, rotations: Floats) -> "Measures":
        """Return the measures of configurations (k, variables), NaN where they are."""
        known = np.isfinite(values[:, 0])
        turns = np.full((len(values), 3, len(self.mechanism.inputs)), np.nan)
        motion = motion_of(self._own.solver, values[known])
        turns[known] = output_rates(motion, self.output)
        direction = self.output.direction if self.points else None
        return measures_of(
            turns,
            self.type_2(values),
            None if direction is None else rotations @ np.array(direction),
        )

    @cached_property
    def _own(self) -> ForwardKinematics:
        return ForwardKinematics(self.mechanism, self.output.name)

    def forward(self, inputs: Floats) -> Solutions:
        """Return every pose found at inputs."""
        return self._own.solutions(inputs)


@final
@dataclass(frozen=True)
class Measures:
    """Rates and measures of type I and II, see `InverseRows`."""

    rates: Floats
    type_1: Floats
    type_2: Floats


def measures_of(turns: Floats, type_2: Floats, directions: Floats | None) -> Measures:
    """Return what follows from the output's angular velocities per unit input rate.

    `turns` (k, 3, inputs) are those of three inputs; or those of two with `directions`
    (k, 3), of which the part at right angles to these counts. `type_2` (k,) is known.
    """
    a, b = turns[..., 0], turns[..., 1]
    if directions is None:
        c = turns[..., 2]
        across = np.stack([cross(b, c), cross(c, a), cross(a, b)], axis=1)
        volume = np.sum(a * across[:, 0], axis=1)
    else:
        across = np.stack([cross(b, directions), cross(directions, a)], axis=1)
        volume = np.sum(a * across[:, 0], axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        size = np.linalg.norm(across, axis=2)
        rates = across / volume[:, None, None]
        return Measures(rates, np.abs(volume)[:, None] / size, type_2)


def sense_of(rates: Floats, directions: Floats | None) -> NDArray[np.int64]:
    """Return the sign (k,) of the determinant of rates (k, inputs, 3), 0 for none.

    It changes at singularities only: poses of one mode and one sign that hang together
    are an aspect. With two inputs the determinant is seen along the directions (k, 3).
    """
    across = cross(rates[:, 0], rates[:, 1])
    volume = np.sum(across * (rates[:, 2] if directions is None else directions), axis=1)
    return np.asarray(np.sign(np.nan_to_num(volume)), dtype=np.int64)


def _filled(found: Floats, rows: NDArray[np.intp]) -> Floats:
    """Return some rows, NaN where their number is negative."""
    filled = np.full((len(rows), *found.shape[1:]), np.nan)
    filled[rows >= 0] = found[rows[rows >= 0]]
    return filled


def _masked(
    pose: NDArray[np.intp],
    mode: NDArray[np.str_],
    inputs: Floats,
    margin: Floats,
    limiting: NDArray[np.intp],
    measures: Measures,
    values: Floats,
    limits: tuple[str, ...],
) -> InverseRows:
    """Return rows with their status, empty where a limit or the reach says no."""
    out = margin < 0.0
    least = np.fmin(np.min(measures.type_1, axis=1), measures.type_2)
    known = np.isfinite(inputs).all(axis=1) & (least > FLAT_DYAD)
    status = np.where(known, Status.OK, Status.AT_SINGULARITY)
    status[out] = Status.OUT_OF_REACH
    gone = np.where(out, np.nan, 0.0)
    return InverseRows(
        pose,
        mode,
        inputs + gone[:, None],
        status.astype(np.int8),
        np.where(np.isfinite(margin), margin, np.nan),
        limiting,
        measures.type_1 + gone[:, None],
        measures.type_2 + gone,
        measures.rates + gone[:, None, None],
        values + gone[:, None],
        limits,
    )


def _columns(values: Sequence[Floats], count: int) -> Floats:
    return np.stack(values, axis=1) if values else np.empty((count, 0))
