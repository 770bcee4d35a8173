"""Poses of an output in several descriptions, and the configurations at these poses.

With a mid-plane symmetric architecture the configurations come from its closed forms.
Otherwise they come from the inverse kinematics of the output and from the assembly modes of
the mechanism.
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
    UNIT_ORIENTATION_TOLERANCE,
    FollowedRotation,
    follow_rotation,
    follow_to,
    unit,
)
from spherekit.outputs.forward_kinematics import PoseSolutions
from spherekit.outputs.inverse_kinematics import InverseKinematics
from spherekit.outputs.mid_plane_architecture import (
    MidPlaneArchitecture,
    describe_mid_plane,
)
from spherekit.outputs.target_deviation import OutputLink
from spherekit.outputs.virtual_output import COORDINATES, with_wrist
from spherekit.positions.assembly_enumeration import enumerate_assemblies
from spherekit.positions.assembly_mode import label_of
from spherekit.positions.position_solver import PositionSolver
from spherekit.tolerances import SINGULAR_TARGET_CONDITION, SINGULAR_TRANSMISSION
from spherekit.velocities.transmission_measure import Transmission
from spherekit.wording import listing

SAME_ORIENTATION_RAD = 1e-7
"""Angle (rad) below which two orientations are the same.

Near a fold solutions have larger errors than rounding. Larger: different orientations count
as the same. Smaller: a pose of the mid-plane architecture is not recognised near a fold.
"""

SAME_MODE_RAD = 1e-4
"""Difference of variables (rad) below which two configurations are the same.

Larger: configurations in different working modes are taken for the same if a leg is nearly
stretched or folded. Smaller: a configuration that is less accurate gets no working mode.
"""

IN_PLANE_RAD = 1e-9
"""Angle (rad) between an orientation and a mirror image below which it counts as one.

Also the largest sine between an axis and a mid-plane with which the axis is in the plane.
Larger: poses that the mechanism does not have are accepted. Smaller: poses that were
rounded in a text are refused.
"""

ANGLE_SORTING_DECIMALS = 9
"""Decimals of the angles (rad) by which configurations at the end of a rotation are sorted.

More: rounding errors decide about the order of configurations with equal angles.
"""


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
    """A pose that is given by two angles (rad) of the mid-plane, see `mirror_angles`."""

    phi: float
    gamma: float


@dataclass(frozen=True)
class AtRotation:
    """The end of a rotation: the start pose turned about an axis (3,) by an angle, rad."""

    axis: Floats
    angle: float


Pose = AtInputs | AtOrientation | AtDirection | AtMirror
"""A pose of an output in one of its descriptions."""


@dataclass(frozen=True)
class PoseCandidates(ArrayRows):
    """The k configurations of a pose, singular ones last.

    Attributes
    ----------
    values
        (k, variables) values of all pair variables (rad).
    inputs
        (k, inputs) values of the inputs (rad).
    orientations
        (k, 3, 3) orientations of the output link, seen from the link it is relative to.
    labels
        (k,) signs of the assembly mode as text, such as ``+-``. Each dyad (group of two
        links) has a sign, and any other group of links has ~. In a mid-plane symmetric
        architecture (base and output link are mirror images of each other), each leg has a
        sign instead.
    singular
        (k,) whether the inputs do not determine the configuration, or some motion of the
        inputs does not move the output.
    """

    values: Floats
    inputs: Floats
    orientations: Floats
    labels: NDArray[np.str_]
    singular: Bools

    def __len__(self) -> int:
        return len(self.values)

    def number_of(self, mode: str) -> int:
        """Return the index of the configuration that the user has named by a text.

        Parameters
        ----------
        mode
            The signs of the assembly mode of the configuration, such as ``+-+``, or the
            index of the configuration as text. If several configurations have these signs,
            the first one is meant. Each sign says in which of two ways a dyad (group of two
            links) or a leg is assembled, see `labels`.

        Raises
        ------
        SolveError
            If there is no such configuration.
        """
        if mode in self.labels:
            return self.labels.tolist().index(mode)
        if mode.isdecimal() and int(mode) < len(self):
            return int(mode)
        raise SolveError(
            f'the pose has no configuration "{mode}"; its configurations are '
            + listing(f"{k} ({label})" for k, label in enumerate(self.labels))
        )


@dataclass(frozen=True)
class EndOrientation:
    """The orientation at which the output link ends its rotation about a fixed axis.

    The user states the poses of the output link at the start and at the end, between which
    it rotates. The mechanism may have several configurations at the end pose, with
    different orientations. `PoseFinder.resolve_end` has chosen one of them. Reports tell
    the user which one.

    Attributes
    ----------
    orientation
        (3, 3) rotation from the axes of the output link to those of the link that the
        output is relative to.
    number, count
        Index of the chosen configuration, and count of all configurations at the end pose.
    has_start_mode
        Whether the configuration was chosen because its dyads have the same signs as the
        dyads at the start. A dyad is two links that can be placed in two ways, which its
        sign distinguishes.
    """

    orientation: Floats
    number: int
    count: int
    has_start_mode: bool


@dataclass(frozen=True)
class PoseFinder:
    """Finds the configurations of a mechanism at poses of an output.

    Attributes
    ----------
    solver
        Position solver of the mechanism.
    output
        The output.
    form
        The mid-plane symmetric architecture of the mechanism, in which base and output
        mirror each other in a plane; None if it has none.
    """

    solver: PositionSolver
    output: Output
    form: MidPlaneArchitecture | None

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism with its inputs."""
        return self.solver.mechanism

    def candidates(self, pose: Pose) -> PoseCandidates:
        """Return every configuration found at a pose, in all assembly modes.

        In a mid-plane symmetric architecture (`form`), base and output are mirror images of
        each other about a plane, the mid-plane. Then only configurations with this symmetry
        are returned, in closed form. The pose can also be stated by two angles of the
        mid-plane. For other mechanisms, position analysis finds the configurations if the
        pose is stated by inputs, and otherwise inverse kinematics. Joint limits are not
        examined.

        Parameters
        ----------
        pose
            The pose, by inputs, an orientation, a direction or angles of the mid-plane.

        Raises
        ------
        SolveError
            If there is no configuration at the pose, if the output has no poses of this
            kind, or if the number of inputs is wrong or the orientation no rotation.
        """
        match pose:
            case AtInputs(inputs):
                self._check_inputs(inputs)
            case AtOrientation(orientation):
                _check_orientation(orientation)
        if self.form is not None:
            return self._find_at_mid_plane(self.form, pose)
        match pose:
            case AtInputs(inputs):
                return self._find_at_inputs(inputs)
            case AtOrientation(orientation):
                return self._find_at_pose(orientation, is_direction=False)
            case AtDirection(direction):
                return self._find_at_pose(unit(direction), is_direction=True)
            case AtMirror():
                raise SolveError(
                    f"{self.mechanism.name}: phi and gamma describe a mid-plane, but the "
                    "mechanism has no mid-plane symmetric architecture; give inputs, a "
                    "direction or an orientation"
                )

    def _check_inputs(self, inputs: Floats) -> None:
        """Raise `SolveError` if there is not one value for each input."""
        names = self.mechanism.input_pairs
        if np.shape(inputs) != (len(names),):
            raise SolveError(
                f"{self.mechanism.name}: found inputs of the shape {np.shape(inputs)}, "
                f"expected one value for each of: {listing(names)}"
            )

    def _find_at_inputs(self, inputs: Floats) -> PoseCandidates:
        """Return the configurations of all assembly modes at inputs (inputs,) in rad."""
        solutions = enumerate_assemblies(self.solver, inputs)
        if not solutions.signs:
            degrees = zip(self.mechanism.input_pairs, np.degrees(inputs), strict=True)
            raise SolveError(
                f"{self.mechanism.name} cannot be assembled at "
                + ", ".join(f"{name} = {q:.6g} deg" for name, q in degrees)
                + "; change one input"
            )
        return self._make_candidates(solutions.values, [*map(label_of, solutions.signs)])

    def _make_candidates(self, values: Floats, labels: Sequence[str]) -> PoseCandidates:
        """Return configurations as candidates for the start or end of a rotation.

        Singular configurations come last. A configuration is singular if one of three
        measures is nearly zero:

        - `loop_conditioning`, if the loops do not determine the links,
        - `output_singular_value`, if the output link cannot turn in as many ways as there
          are inputs,
        - the transmission measure, if the inputs do not determine the output (type II).

        Parameters
        ----------
        values
            (k, variables) pair variables (rad) of closed configurations.
        labels
            (k,) the signs of the dyads of each configuration, as text. A dyad is two links
            with three R pairs, and its sign is one of two ways to assemble it.
        """
        output_link = OutputLink.from_output(self.mechanism, self.output)
        # `compare` needs a target orientation (1, 3, 3). Only results that do not depend on
        # the target are used here, so any orientation will do.
        any_target = np.eye(3)[None]
        deviation = output_link.compare(values, any_target)
        conditioning = np.minimum(
            deviation.output_singular_value, deviation.loop_conditioning
        )
        transmission = Transmission.from_mechanism(self.mechanism, self.output)
        type_2 = transmission.measure_configurations(self.solver.closure, values)
        is_regular = (conditioning > SINGULAR_TARGET_CONDITION) & (
            type_2 > SINGULAR_TRANSMISSION
        )
        candidates = PoseCandidates(
            values=values,
            inputs=self.solver.reduce_inputs(values[:, self.solver.driven]),
            orientations=deviation.orientations,
            labels=np.array(labels, dtype=str),
            singular=~is_regular,
        )
        return candidates.rows(np.argsort(candidates.singular, kind="stable"))

    def _find_at_pose(self, pose: Floats, is_direction: bool) -> PoseCandidates:
        """Return the configurations at a pose of the output, by inverse kinematics.

        Parameters
        ----------
        pose
            (3, 3) orientation or (3,) direction of the output.
        is_direction
            Whether the pose is a direction.

        Raises
        ------
        SolveError
            If the output takes the other kind of pose, or does not reach it.
        """
        kinematics = InverseKinematics(self.mechanism, self.output.name)
        # Inverse kinematics adds virtual links, which prescribe the pose of the output, to
        # the mechanism. The result is `wrist`. Its `points` is true if the output takes a
        # direction, false if it takes an orientation.
        takes_direction = kinematics.wrist.points
        if takes_direction != is_direction:
            names = ("an orientation", "a direction")
            raise SolveError(
                f"{self.mechanism.name}: outputs.{self.output.name}: found "
                f"{names[is_direction]}, expected {names[takes_direction]}, or values of "
                "the inputs"
            )
        solutions = kinematics.solutions(pose[None])
        if not len(solutions.row):
            raise SolveError(
                f"{self.mechanism.name}: outputs.{self.output.name} does not reach this "
                "pose, or is singular there; choose one inside its workspace, such as the "
                "nearest one that the analysis inverse_kinematics gives"
            )
        # A label has the signs of the dyads (two links and three R pairs), such as "+-".
        labels = [label_of(signs) for signs in solutions.signs]
        return self._make_candidates(solutions.values, labels)

    def _find_mid_plane(
        self, architecture: MidPlaneArchitecture, pose: Pose
    ) -> tuple[Floats, Floats | None]:
        """Return the normal of the mid-plane at a pose.

        Base and output mirror each other in the mid-plane. A leg has two links, and the
        axis between them, the elbow, lies in the mid-plane. Mirror axes are axes of the
        base in which the formulas of the mid-plane are simplest.

        Parameters
        ----------
        architecture
            The mid-plane symmetric architecture.
        pose
            The pose, in any description: two angles of the mid-plane, both inputs, an
            orientation or a direction.

        Returns
        -------
        normals
            (1, 3) unit normal of the mid-plane, in mirror axes, with n_z >= 0.
        driven_signs
            (2,) signs of the driven legs if the pose is given by its inputs, which
            determine the elbows of these legs; otherwise None.

        Raises
        ------
        SolveError
            If the pose does not determine a mid-plane.
        """
        match pose:
            case AtMirror(phi, gamma):
                return normal_at(phi, gamma)[None], None
            case AtInputs(inputs):
                # Both driven elbows span the mid-plane, unless they are parallel.
                normals = architecture.plane.normals(inputs[None])
                if np.any(np.isnan(normals)):
                    raise SolveError(
                        f"{architecture.mechanism.name}: at these inputs both driven "
                        "elbows are collinear and do not determine the mid-plane; change "
                        "one input"
                    )
                return normals, architecture.plane.modes(inputs[None])[0]
            case AtOrientation(orientation):
                # The deviation (rad) is that of the orientation from the nearest mirror
                # image of the base.
                normals, deviation = architecture.normals(orientation[None])
                if not deviation[0] < IN_PLANE_RAD:
                    raise SolveError(
                        f"{architecture.mechanism.name}: the orientation is not a pose of "
                        f"its output link: it is {np.degrees(deviation[0]):.3g} deg from "
                        f"{describe_mid_plane(normals[0])}"
                    )
                return normals, None
            case AtDirection(direction):
                if self.output.direction is None:
                    # Virtual links that hold a direction (a wrist) cannot be added to this
                    # output. The call raises the error that says so.
                    with_wrist(self.mechanism, self.output.name)
                # The normal points from the home direction of the output to its mirror
                # image, the given direction. If their distance is 0, every plane through
                # this direction is possible.
                normals, distance = architecture.normals_to(
                    unit(direction)[None] @ architecture.frame
                )
                if distance[0] < SAME_ORIENTATION_RAD:
                    raise SolveError(
                        f"{architecture.mechanism.name}: outputs.{self.output.name} "
                        "points in this direction for every mid-plane that contains it; "
                        "give inputs, an "
                        "orientation, or phi and gamma"
                    )
                # Of the two opposite normals, the one with n_z >= 0.
                return upward(normals), None

    def _find_at_mid_plane(
        self, architecture: MidPlaneArchitecture, pose: Pose
    ) -> PoseCandidates:
        """Return the configurations at a pose in all modes of a mid-plane architecture.

        Base and end effector mirror each other in the mid-plane, so the normal of this
        plane determines the pose. A leg has two links, and the axis between them is its
        elbow. A mode has a sign, 1 or -1, for each leg, which chooses one of two positions
        of the elbow. Inputs determine the elbows of the driven legs. If the pose is stated
        by inputs, only modes with the signs of these elbows are returned.

        Parameters
        ----------
        architecture
            The mid-plane symmetric architecture of the mechanism.
        pose
            The pose: inputs, an orientation, a direction, or angles of the mid-plane.

        Raises
        ------
        SolveError
            If the pose does not determine a mid-plane, or a leg does not reach it.
        """
        # (1, 3) normal of the mid-plane at the only pose. `driven_signs` is None unless the
        # pose is given by inputs.
        normals, driven_signs = self._find_mid_plane(architecture, pose)
        architecture.check_reach(normals[0])
        modes = _list_modes(architecture)
        if driven_signs is not None:
            driven_legs = architecture.plane.driven  # numbers of the driven legs
            modes = [mode for mode in modes if np.all(mode[driven_legs] == driven_signs)]
        values = []
        for mode in modes:
            # The residuals show whether all loops close, which is known for this
            # architecture.
            link_orientations = architecture.place(normals, mode)
            mode_values, _residuals = architecture.values(link_orientations)
            values.append(mode_values)
        labels = [label_of(mode) for mode in modes]
        return self._make_candidates(np.concatenate(values), labels)

    def resolve_end(
        self, start: PoseCandidates, number: int, end: Pose | AtRotation, mode: str
    ) -> EndOrientation | AtRotation:
        """Return the orientation at the end of a rotation.

        The mechanism may have several configurations at the end pose, with different
        orientations of the output link. The configurations are sorted by the angle from the
        start, singular ones last. An end that is given by an orientation needs no choice.
        An end that is given by an axis and an angle is returned unchanged.

        Parameters
        ----------
        start, number
            Candidates for the start, and the index of the candidate at which the rotation
            starts.
        end
            The pose at the end.
        mode
            The configuration to choose at the end: its signs such as ``+-+``, or its
            number. A mode is the signs of the dyads (two links each, with two possible
            positions). If `mode` is empty, the nearest configuration in the mode of the
            start is chosen, or the nearest of all if this mode does not exist.
            `EndOrientation.has_start_mode` tells which case applies.

        Raises
        ------
        SolveError
            If the pose is not reached or has no such mode. Whether an orientation is
            reached is not examined.
        """
        if isinstance(end, AtRotation):
            return end
        if isinstance(end, AtOrientation):
            # All configurations at the end have this orientation, so there is only one
            # choice.
            _check_orientation(end.orientation)
            return EndOrientation(end.orientation, number=0, count=1, has_start_mode=False)
        try:
            ends = self.candidates(end)
            angles = angles_between(start.orientations[number][None], ends.orientations)
            # Equal angles can differ by rounding errors, which would make the order of
            # their configurations random. The angles are therefore rounded. lexsort takes
            # the most significant key last: regular configurations come first.
            rounded_angles = np.round(angles, ANGLE_SORTING_DECIMALS)
            ends = ends.rows(np.lexsort((rounded_angles, ends.singular)))
            if mode:
                chosen = ends.number_of(mode)
                return EndOrientation(
                    ends.orientations[chosen],
                    number=chosen,
                    count=len(ends),
                    has_start_mode=False,
                )
        except SolveError as problem:
            raise SolveError(f"end: {problem}") from None
        (start_mode,) = self._find_modes(start.rows(np.array([number])))
        end_modes = self._find_modes(ends)
        ends_in_start_mode = [
            k for k, end_mode in enumerate(end_modes) if end_mode == start_mode
        ]
        chosen = ends_in_start_mode[0] if ends_in_start_mode else 0
        return EndOrientation(
            orientation=ends.orientations[chosen],
            number=chosen,
            count=len(ends),
            has_start_mode=len(ends_in_start_mode) > 0,
        )

    def _find_modes(self, candidates: PoseCandidates) -> list[tuple[str, str]]:
        """Return the labels of the assembly mode and working mode of each configuration.

        `resolve_end` compares the labels at the start and at the end of a rotation. It
        prefers an end with the labels of the start.

        A dyad is two links that can be placed in two ways, which its sign distinguishes. In
        an assembly mode, links are placed from known inputs. In a working mode, they are
        placed from a known pose of the output. Different links can form the dyads in both
        cases.

        Returns
        -------
        For each candidate two texts: the signs of its assembly mode and of its working
        mode. The second text is empty if there is no separate working mode.
        """
        labels = candidates.labels.tolist()
        without_working_modes = [(label, "") for label in labels]
        # In some mechanisms base and output mirror each other in a plane, the mid-plane.
        # Each leg then has one sign for both modes, so there is no separate working mode.
        has_mid_plane = self.form is not None
        # Inverse kinematics needs as many inputs as the pose has coordinates: 2 of a
        # direction or 3 of an orientation (`COORDINATES`).
        if has_mid_plane or len(self.mechanism.inputs) not in COORDINATES:
            return without_working_modes
        try:
            kinematics = InverseKinematics(self.mechanism, self.output.name)
        except SpherekitError:
            return without_working_modes
        if not kinematics.has_closed_form:
            return without_working_modes
        poses = candidates.orientations
        # `wrist.points` tells whether the output is a direction, as with two inputs.
        # Otherwise a pose is the orientation of the output.
        has_direction_poses = kinematics.wrist.points
        if has_direction_poses:
            poses = poses @ np.array(self.output.direction)
        solutions = kinematics.solutions(poses)
        modes = []
        for k, label in enumerate(labels):
            working_mode = _find_working_mode(solutions, k, candidates.values[k])
            modes.append((label, working_mode))
        return modes

    def rotation(
        self, start: PoseCandidates, number: int, end: EndOrientation | AtRotation
    ) -> FollowedRotation:
        """Return the rotation of the output link from a configuration to its end.

        The rotation is a path of configurations along which the output link turns about one
        fixed axis. It is followed numerically, step by step.

        In a mid-plane symmetric architecture, the output link is a mirror image of the base
        in a plane, the mid-plane. If the axis lies in the mid-plane at the start, the link
        stays a mirror image during the whole rotation. The start may then be singular,
        because the path can begin at a configuration shortly before it, which formulas
        give. In all other cases the start must not be singular.

        Parameters
        ----------
        start, number
            Candidates for the start, and the index of the candidate at which the rotation
            starts.
        end
            An orientation of `resolve_end`, or an axis and an angle.

        Raises
        ------
        SolveError
            If the axis is not determined, or the start is singular.
        """
        start_orientation = start.orientations[number]
        architecture = self.form
        if architecture is not None:  # it is mid-plane symmetric
            # Each sign chooses one of two positions of a leg.
            signs = _signs_of_legs(start.labels[number])
            if isinstance(end, AtRotation):
                rotation = _rotate_in_mid_plane(architecture, start_orientation, signs, end)
            else:
                rotation = _rotate_to_mirror_image(
                    architecture, start_orientation, signs, end
                )
            # None means that the formulas do not apply: the axis is not in the mid-plane,
            # or the output link is no mirror image of the base at the end.
            if rotation is not None:
                return rotation

        start_values = start.values[number]
        if isinstance(end, AtRotation):
            return follow_rotation(
                self.mechanism, start_values, end.axis, end.angle, self.output.name
            )
        return follow_to(self.mechanism, start_values, end.orientation, self.output.name)


def _check_orientation(orientation: Floats) -> None:
    """Raise `SolveError` if an orientation is not a rotation matrix (3, 3)."""
    matrix = np.asarray(orientation, dtype=float)
    # Comparisons with NaN are false, and fail the test.
    with np.errstate(all="ignore"):
        is_rotation = (
            matrix.shape == (3, 3)
            and np.linalg.det(matrix) > 0.0
            and max_abs(matrix @ matrix.T - np.eye(3)) < UNIT_ORIENTATION_TOLERANCE
        )
    if not is_rotation:
        raise SolveError("the orientation has to be a rotation matrix (3, 3)")


def _find_working_mode(solutions: PoseSolutions, pose: int, values: Floats) -> str:
    """Return the label of the working mode of a configuration, "" if it is in none.

    A working mode is one way to assemble the mechanism at a pose of the output. It is given
    by a sign for each group of links. All configurations of the pose are known with their
    signs. The configuration with the same pair variables is searched.

    Parameters
    ----------
    solutions
        The configurations of several poses in all working modes.
    pose
        Index of the pose of the configuration.
    values
        (variables,) pair variables (rad) of the configuration.
    """
    # `solutions.row` has the index of the pose of each configuration.
    rows = np.flatnonzero(solutions.row == pose)
    if len(rows) == 0:
        return ""
    difference = wrap(solutions.values[rows] - values)
    distance = max_abs(difference, axis=1)
    nearest = np.argmin(distance)
    if not distance[nearest] < SAME_MODE_RAD:
        return ""
    return label_of(solutions.signs[rows[nearest]])


def _signs_of_legs(label: str) -> Floats:
    """Return the signs (legs,), 1 or -1, of a label such as "+-+"."""
    return np.array([1.0 if sign == "+" else -1.0 for sign in label])


def _rotate_in_mid_plane(
    architecture: MidPlaneArchitecture,
    start_orientation: Floats,
    signs: Floats,
    end: AtRotation,
) -> FollowedRotation | None:
    """Return the rotation about an axis in the mid-plane, None if the axis is elsewhere.

    The result has the configurations of the whole mechanism while the output link rotates.
    Base and output link mirror each other in the mid-plane. If the axis is in this plane,
    they do so in all poses of the rotation, and formulas give the configurations. A path
    cannot begin at a singular configuration. With a singular start, the path therefore
    begins shortly before the start, at a configuration that the formulas give.

    Parameters
    ----------
    architecture
        The architecture, in which the output link is the mirror image of the base.
    start_orientation
        (3, 3) orientation of the output link at the start.
    signs
        (legs,) signs, 1.0 or -1.0, of the legs: each chooses one of two positions of the
        leg.
    end
        Axis and angle of the rotation. The axis is in the axes of the base.
    """
    # The normal is in mirror axes. These are a second set of axes fixed to the base, in
    # which the formulas are simplest.
    normals, _deviation = architecture.normals(start_orientation[None])
    start_normal = normals[0]
    axis = unit(end.axis)
    # The rotation `frame` leads from mirror axes to the axes of the base.
    normal_in_base_axes = start_normal @ architecture.frame.T
    # The sine of the angle between the axis and the mid-plane.
    axis_sine = abs(normal_in_base_axes @ axis)
    if not axis_sine < IN_PLANE_RAD:
        return None
    return architecture.rotation_about(start_normal, axis, end.angle, signs)


def _rotate_to_mirror_image(
    architecture: MidPlaneArchitecture,
    start_orientation: Floats,
    signs: Floats,
    end: EndOrientation,
) -> FollowedRotation | None:
    """Return the rotation to a mirror image of the base, None if the end is no such image.

    The output link rotates about a fixed axis from its start to its end. The result has
    the configurations of the whole mechanism during this rotation.

    At the start, the output link is the mirror image of the base in a plane. If it is one
    at the end as well, formulas give the configurations of the mechanism. A path cannot
    begin at a singular configuration. With a singular start, the path therefore begins
    shortly before the start, at a configuration that the formulas give.

    Parameters
    ----------
    architecture
        The architecture, in which the output link is the mirror image of the base.
    start_orientation
        (3, 3) orientation of the output link at the start.
    signs
        (legs,) signs, 1.0 or -1.0, of the legs: each chooses one of two positions of the
        leg.
    end
        The orientation at the end.
    """
    normals, deviations = architecture.normals(
        np.stack([start_orientation, end.orientation])
    )
    start_normal, end_normal = normals
    # The angle (rad) from the nearest mirror image of the base.
    _, end_deviation = deviations
    if not end_deviation < SAME_ORIENTATION_RAD:
        return None
    return architecture.rotation_between(start_normal, end_normal, signs)


def _list_modes(architecture: MidPlaneArchitecture) -> list[Floats]:
    """Return the signs (legs,) of all modes of a mid-plane architecture.

    A mode has a sign for each leg, 1.0 or -1.0, for its two possible positions. The modes
    are in the same order as in `MidPlane.solutions`: first the modes in which the first
    driven leg has -1, and among these first those in which the second driven leg has 1.
    """
    first, second = architecture.plane.driven
    modes = [
        np.array(signs) for signs in product((1.0, -1.0), repeat=len(architecture.legs))
    ]
    return sorted(modes, key=lambda mode: (mode[first], -mode[second]))
