"""Poses of an output, said in any of its terms, and the configurations that have them.

With a mid-plane symmetric architecture the configurations come from its closed forms;
otherwise from the inverse kinematics of the output and the assembly modes of the mechanism.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from spherekit.arrays import Bools, Floats
from spherekit.errors import SolveError, SpherekitError
from spherekit.geometry.mirror import normal_at, upward
from spherekit.geometry.rotation import angles_between
from spherekit.geometry.vectors import max_abs
from spherekit.mechanism.elements import Output
from spherekit.mechanism.mechanism import Mechanism
from spherekit.numerics.angles import wrap
from spherekit.numerics.array_rows import ArrayRows
from spherekit.outputs.fixed_axis_rotation import (
    FollowedRotation,
    follow_rotation,
    follow_to,
    unit,
)
from spherekit.outputs.inverse_kinematics import InverseKinematics
from spherekit.outputs.mid_plane_architecture import MidPlaneArchitecture, named
from spherekit.outputs.rotation_path import UNDETERMINED_CONDITION
from spherekit.outputs.target_deviation import OutputLink
from spherekit.outputs.virtual_output import COORDINATES, with_wrist
from spherekit.positions.assembly_enumeration import enumerate_assemblies
from spherekit.positions.assembly_mode import label_of
from spherekit.positions.position_solver import PositionSolver
from spherekit.velocities.transmission import SINGULAR_TRANSMISSION, Transmission
from spherekit.wording import listing

SAME_POSE = 1e-7
"""Orientations that differ by less (rad) are one; solutions near a fold are known less
well than to rounding."""
SAME_MODE_RAD = 1e-4
"""Variables that differ by less are those of one configuration. Configurations of a pose
in different working modes differ by more, unless a leg is nearly stretched or folded."""
IN_PLANE = 1e-9
"""How near (rad) an orientation is to a mirror image to be taken for one."""


@dataclass(frozen=True)
class AtInputs:
    """The pose at inputs (inputs,) rad."""

    inputs: Floats


@dataclass(frozen=True)
class AtOrientation:
    """An orientation (3, 3) of the output link."""

    orientation: Floats


@dataclass(frozen=True)
class AtDirection:
    """A pose in which the output points at a direction (3,) of any length."""

    direction: Floats


@dataclass(frozen=True)
class AtMirror:
    """The pose of a mid-plane architecture with these angles (rad), see `mirror_angles`."""

    phi: float
    gamma: float


@dataclass(frozen=True)
class AtRotation:
    """The start's pose turned about an axis (3,) by an angle (rad)."""

    axis: Floats
    angle: float


Pose = AtInputs | AtOrientation | AtDirection | AtMirror


@dataclass(frozen=True)
class PoseCandidates(ArrayRows):
    """k configurations: `values` (k, variables), `inputs` (k, inputs) rad.

    `orientations` (k, 3, 3) are those of the output link seen from its other link,
    `labels` the signs of modes: of the legs of a mid-plane symmetric architecture, else of
    dyads, with ~ for other groups. Those come last where the inputs do not hold the
    mechanism, or do not turn the output link in as many ways as there are inputs:
    `singular` (k,).
    """

    values: Floats
    inputs: Floats
    orientations: Floats
    labels: NDArray[np.str_]
    singular: Bools

    def __len__(self) -> int:
        return len(self.values)

    def number_of(self, mode: str) -> int:
        """Return the number of the candidate that a number or signs name.

        Raises
        ------
        SolveError
            If there is none.
        """
        if mode in self.labels:
            return self.labels.tolist().index(mode)
        if mode.isdigit() and int(mode) < len(self):
            return int(mode)
        raise SolveError(
            f'no configuration of the pose is "{mode}"; there are '
            + listing(f"{k} ({label})" for k, label in enumerate(self.labels))
        )


@dataclass(frozen=True)
class EndOrientation:
    """The orientation (3, 3) at the end of a rotation, and which of several it is.

    Attributes
    ----------
    orientation
        Of the output link, seen from its other link.
    number, count
        Its number among those that the end has, and how many there are.
    has_start_mode
        Whether it was chosen because it is in the start's assembly and working mode.
    """

    orientation: Floats
    number: int
    count: int
    has_start_mode: bool


@dataclass(frozen=True)
class PoseFinder:
    """Finds the configurations of a mechanism at poses of an output.

    `form` is its mid-plane symmetric architecture for this output, None if it has none.
    """

    solver: PositionSolver
    output: Output
    form: MidPlaneArchitecture | None

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism with its inputs."""
        return self.solver.mechanism

    def candidates(self, pose: Pose) -> PoseCandidates:
        """Return every configuration found at a pose.

        Raises
        ------
        SolveError
            If there is none, or the pose is not one of this mechanism's output.
        """
        if self.form is not None:
            return self._of_mirrors(self.form, pose)
        match pose:
            case AtInputs(inputs):
                return self._assembled(inputs)
            case AtOrientation(orientation):
                return self._inverse(orientation, points=False)
            case AtDirection(direction):
                return self._inverse(unit(direction), points=True)
            case AtMirror():
                raise SolveError(
                    f"{self.mechanism.name}: phi and gamma name a mid-plane, and the "
                    "mechanism has no mid-plane symmetric architecture; give inputs, a "
                    "direction or an orientation"
                )

    def _assembled(self, inputs: Floats) -> PoseCandidates:
        here = enumerate_assemblies(self.solver, inputs)
        if not here.signs:
            degrees = zip(self.mechanism.input_pairs, np.degrees(inputs), strict=True)
            raise SolveError(
                f"{self.mechanism.name} cannot be assembled at "
                + ", ".join(f"{name} = {q:.6g} deg" for name, q in degrees)
                + "; trace it, or change one input"
            )
        return self._of_values(here.values, [*map(label_of, here.signs)])

    def _of_values(self, values: Floats, labels: Sequence[str]) -> PoseCandidates:
        near = OutputLink.from_output(self.mechanism, self.output).compare(
            values, np.eye(3)[None]
        )
        free = (
            np.minimum(near.output_singular_value, near.loop_conditioning)
            > UNDETERMINED_CONDITION
        )
        transmission = Transmission.from_mechanism(self.mechanism, self.output)
        free &= (
            transmission.measure_configurations(self.solver.closure, values)
            > SINGULAR_TRANSMISSION
        )
        candidates = PoseCandidates(
            values,
            self.solver.reduce_inputs(values[:, self.solver.driven]),
            near.orientations,
            np.array(labels, dtype=str),
            ~free,
        )
        return candidates.rows(np.argsort(candidates.singular, kind="stable"))

    def _inverse(self, pose: Floats, points: bool) -> PoseCandidates:
        """Return the configurations at an orientation (3, 3) or direction (3,)."""
        kinematics = InverseKinematics(self.mechanism, self.output.name)
        if kinematics.wrist.points != points:
            takes = "a direction" if kinematics.wrist.points else "an orientation"
            raise SolveError(
                f"{self.mechanism.name}: outputs.{self.output.name} takes {takes}, or "
                "inputs"
            )
        solutions = kinematics.solutions(pose[None])
        if not len(solutions.row):
            raise SolveError(
                f"{self.mechanism.name}: outputs.{self.output.name} does not reach this "
                "pose, or is singular there; choose one inside its workspace, such as the "
                "nearest one that the analysis inverse_kinematics gives"
            )
        return self._of_values(solutions.values, [*map(label_of, solutions.signs)])

    def _normals(
        self, form: MidPlaneArchitecture, pose: Pose
    ) -> tuple[Floats, Floats | None]:
        """Return the normal (1, 3) of a mid-plane, and signs of the driven legs or none."""
        match pose:
            case AtMirror(phi, gamma):
                return normal_at(phi, gamma)[None], None
            case AtInputs(inputs):
                normals = form.plane.normals(inputs[None])
                if np.any(np.isnan(normals)):
                    raise SolveError(
                        f"{form.mechanism.name}: at these inputs both driven elbows lie "
                        "on one line and do not fix the mid-plane; change one input"
                    )
                return normals, form.plane.modes(inputs[None])[0]
            case AtOrientation(orientation):
                normals, departure = form.normals(orientation[None])
                if not departure[0] < IN_PLANE:
                    raise SolveError(
                        f"{form.mechanism.name}: the orientation is not a pose of its "
                        f"output link: it is {np.degrees(departure[0]):.3g} deg from "
                        f"{named(normals[0])}"
                    )
                return normals, None
            case AtDirection(direction):
                if self.output.direction is None:
                    with_wrist(self.mechanism, self.output.name)  # says so
                normals, distance = form.normals_to(unit(direction)[None] @ form.frame)
                if distance[0] < SAME_POSE:
                    raise SolveError(
                        f"{form.mechanism.name}: outputs.{self.output.name} points there "
                        "in every mid-plane through this direction; give inputs, an "
                        "orientation, or phi and gamma"
                    )
                return upward(normals), None

    def _of_mirrors(self, form: MidPlaneArchitecture, pose: Pose) -> PoseCandidates:
        normals, signs = self._normals(form, pose)
        form.check_reach(normals[0])
        modes = [
            mode
            for mode in _modes(form)
            if signs is None or np.all(mode[form.plane.driven] == signs)
        ]
        values = [form.values(form.place(normals, mode))[0] for mode in modes]
        return self._of_values(np.concatenate(values), [label_of(mode) for mode in modes])

    def resolve_end(
        self, start: PoseCandidates, number: int, end: Pose | AtRotation, mode: str
    ) -> EndOrientation | AtRotation:
        """Return the orientation at the end of a rotation; an axis and an angle unchanged.

        Parameters
        ----------
        start, number
            Configurations, and which of them to start from.
        end
            The pose. It has several orientations if the mechanism can be assembled in
            several ways there.
        mode
            Which of them, in the order of their angles from the start, by number or signs.
            Empty for the nearest of those in the start's modes, or else the nearest.

        Raises
        ------
        SolveError
            If the pose is not reached, or has no such mode.
        """
        if isinstance(end, AtRotation):
            return end
        if isinstance(end, AtOrientation):
            return EndOrientation(end.orientation, 0, 1, False)
        try:
            ends = self.candidates(end)
            angles = angles_between(start.orientations[number][None], ends.orientations)
            ends = ends.rows(np.lexsort((np.round(angles, 9), ends.singular)))
            if mode:
                chosen = ends.number_of(mode)
                return EndOrientation(ends.orientations[chosen], chosen, len(ends), False)
        except SolveError as problem:
            raise SolveError(f"end: {problem}") from None
        (start_mode,) = self._modes_of(start.rows(np.array([number])))
        end_modes = self._modes_of(ends)
        of_start = [k for k, modes in enumerate(end_modes) if modes == start_mode]
        chosen = of_start[0] if of_start else 0
        return EndOrientation(
            ends.orientations[chosen], chosen, len(ends), len(of_start) > 0
        )

    def _modes_of(self, candidates: PoseCandidates) -> list[tuple[str, str]]:
        """Return the label of each configuration, and that of its working mode.

        The second is empty where the inverse kinematics has no closed form.
        """
        labels = candidates.labels.tolist()
        unknown = [(label, "") for label in labels]
        if self.form is not None or len(self.mechanism.inputs) not in COORDINATES:
            return unknown
        try:
            kinematics = InverseKinematics(self.mechanism, self.output.name)
        except SpherekitError:
            return unknown
        if not kinematics.has_closed_form:
            return unknown
        poses = candidates.orientations
        if kinematics.wrist.points:
            poses = poses @ np.array(self.output.direction)
        solutions = kinematics.solutions(poses)
        modes = []
        for k, label in enumerate(labels):
            # A pose has one configuration in each working mode. The one with the
            # variables of the candidate is that of its mode.
            rows = np.flatnonzero(solutions.row == k)
            departure = max_abs(wrap(solutions.values[rows] - candidates.values[k]), axis=1)
            is_same = len(rows) > 0 and np.min(departure) < SAME_MODE_RAD
            row = rows[np.argmin(departure)] if is_same else 0
            modes.append((label, label_of(solutions.signs[row]) if is_same else ""))
        return modes

    def rotation(
        self, start: PoseCandidates, number: int, end: EndOrientation | AtRotation
    ) -> FollowedRotation:
        """Return the rotation from a configuration to an orientation, or by an angle.

        Parameters
        ----------
        start, number
            Configurations, and which of them to start from.
        end
            An orientation of `resolve_end`, or an axis and an angle.

        Raises
        ------
        SolveError
            If the axis is not determined, or the start is singular.
        """
        values, first = start.values[number], start.orientations[number]
        name, form = self.output.name, self.form
        signs = np.array([1.0 if sign == "+" else -1.0 for sign in start.labels[number]])
        if isinstance(end, AtRotation):
            if form is not None:
                (normal,), _ = form.normals(first[None])
                about = unit(end.axis)
                if abs(normal @ form.frame.T @ about) < IN_PLANE:
                    return form.rotation_about(normal, about, end.angle, signs)
            return follow_rotation(self.mechanism, values, end.axis, end.angle, name)
        wanted = end.orientation
        if form is not None:
            normals, departure = form.normals(np.stack([first, wanted]))
            if departure[1] < SAME_POSE:
                return form.rotation_between(normals[0], normals[1], signs)
        return follow_to(self.mechanism, values, wanted, name)


def _modes(form: MidPlaneArchitecture) -> list[Floats]:
    """Return all signs of the legs: first those of the driven ones as in `solutions`."""
    first, second = form.plane.driven
    every = (np.array(signs) for signs in product((1.0, -1.0), repeat=len(form.legs)))
    return sorted(every, key=lambda mode: (mode[first], -mode[second]))
