"""Equivalent rotation: an output turns from one pose to another about one fixed axis."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spherekit.plugin import (
    INPUTS,
    STATUS,
    TIME,
    AbstractAnalysis,
    AnalysisError,
    Batch,
    Column,
    Findings,
    Floats,
    Mechanism,
    ModelError,
    Needs,
    Scene,
    SolveError,
    Status,
    Table,
    TableData,
    degree_range_text,
    input_columns,
)
from spherekit.plugin.quantities import (
    Degrees,
    DegreesPerSecond,
    DegreesPerSecond2,
    Seconds,
)
from spherekit.plugin.rotations import (
    EndOrientation,
    PoseFinder,
    TimeScaling,
    chosen_output,
    dead_centre,
    mid_plane_form,
    mirror_angles,
    schedule_limits,
    tilt_torsion,
    time_optimal,
)

from ..common import MID_PLANE_COLUMNS
from ..output_poses import read_end, read_pose
from .scenes import RotationResult, mid_planes

MEANING_OF_END: Mapping[Status, str] = {
    Status.OUT_OF_REACH: "the output link cannot turn further; choose another pose",
    Status.AT_SINGULARITY: "the loops no longer determine the links there; choose another "
    "start or end",
    Status.OFF_PROFILE: "a contact reaches the end of its profile; choose a nearer pose",
    Status.MODE_LOST: "no verified step continues the motion; choose another start or end",
}
"""Why a rotation ends before its whole angle, by the status of the end."""
FIXED_AXIS_TOLERANCE_RAD = 1e-9
"""A rotation that deviates by less counts as a rotation about a fixed axis. Larger:
rotations about a moving axis count as feasible; smaller: rounding makes rotations
infeasible."""
CHECKED_ANGLES = 91
"""Number of equally spaced angles at which deviations from the fixed axis and extremes of
the inputs are searched, in addition to the rows. Larger: short ones are found; smaller:
they are missed."""


@dataclass(frozen=True, kw_only=True)
class EquivalentRotation(AbstractAnalysis):
    """The rotation about a fixed axis that carries an output link from `start` to `end`.

    A pose is a text ``name=number+name=number``. An angle without a unit is in the unit of
    the mechanism's file. The pose is seen from the link that the output is relative to. The
    names are one of these sets:

    - all driven pairs, as in ``21=5.3+61=56.7``: the inputs of the pose,
    - ``phi``, ``gamma``: the angles of the plane about which base and output link are
      mirror images of each other, in a mid-plane symmetric architecture,
    - ``x``, ``y``, ``z`` or ``azimuth``, ``tilt``: the direction of the output,
    - ``azimuth``, ``tilt``, ``torsion``, a quaternion ``qx``, ``qy``, ``qz``, ``qw`` or a
      rotation vector ``rx``, ``ry``, ``rz``: its orientation,
    - ``ux``, ``uy``, ``uz``, ``angle``, only at the end: the axis and the angle of the
      rotation from the start.

    Attributes
    ----------
    start
        Pose of the output link at the start of the rotation.
    end
        Pose of the output link at the end of the rotation.
    mode
        Number or signs of the configuration at the start. The summary lists all such
        configurations.
    end_mode
        Number or signs of the orientation at the end, if the pose `end` has several. They
        are numbered by their angle from the start, singular ones last. By default it is the
        nearest in the assembly and working mode of the start.
    output
        Name of the output, needed if the mechanism declares several.
    samples
        Number of rows of each table: equally spaced angles, or times of the schedule.
    theta
        Angles of the rotation (in Python in degrees) that replace the equally spaced ones.
    speed
        Speed limits of the inputs (in Python in deg/s): one for all inputs or one for each.
        A schedule, the rotation in time, is computed if a limit of speed or acceleration is
        given.
    acceleration
        Acceleration limits of the inputs (in Python in deg/s2): one for all inputs or one
        for each.
    shape
        Time law of the schedule: cycloidal, cubic, quintic or septic.
    cycle
        Cycle time (s) of the controller that executes the schedule. The rows of the
        schedule are then one cycle apart, and its duration is a whole number of cycles.
    """

    name = "equivalent_rotation"
    version = "1"
    summary = (
        "rotation about a fixed axis from one pose to another, also as a function of time"
    )
    cites = (
        "Z. Chen et al., Motion characteristics analysis of a novel spherical two-degree-"
        "of-freedom parallel mechanism, 2021, doi 10.21203/rs.3.rs-258461",
    )
    reads_samples = False
    tables = (
        Table(
            "equivalent_rotation",
            "one row per angle of the rotation about the fixed axis",
            (
                Column(
                    "sample",
                    "",
                    "number of the angle theta in the sequence of angles, from 0",
                    "integer",
                ),
                Column(
                    "theta",
                    "rad",
                    "angle of the rotation about the fixed axis, "
                    "measured from the start pose",
                ),
                *MID_PLANE_COLUMNS,
                Column(
                    "azimuth",
                    "rad",
                    "azimuth of the z axis of the output link, about the z axis of the "
                    "reference link of the output",
                    turns="otherwise",
                ),
                Column(
                    "tilt",
                    "rad",
                    "angle from the z axis of the reference link of the output to the z "
                    "axis of the output link",
                    turns="otherwise",
                ),
                Column(
                    "torsion",
                    "rad",
                    "rotation of the output link about its own tilted z axis",
                    turns="otherwise",
                ),
                INPUTS,
                Column(
                    "dq_dtheta",
                    "",
                    "derivative of the angle of the driven pair with respect to theta",
                    per_input=True,
                ),
                Column(
                    "orientation_error",
                    "rad",
                    "angle between the actual orientation of the output link and its "
                    "orientation after an exact rotation about the fixed axis",
                ),
                Column(
                    "drift",
                    "rad",
                    "angle between the instantaneous axis of rotation of the output "
                    "link and the fixed axis",
                ),
                Column(
                    "type_2",
                    "",
                    "transmission measure: how well the locked inputs hold the "
                    "output, from 0 (at a type II singularity) to 1",
                ),
                STATUS,
            ),
        ),
        Table(
            "schedule",
            "the rotation as a function of time, for a controller: one row per time; the "
            "table is empty if no limits of speed or acceleration are given",
            (
                TIME,
                Column(
                    "theta",
                    "rad",
                    "angle of the rotation about the fixed axis, "
                    "measured from the start pose",
                ),
                INPUTS,
                Column(
                    "dq", "rad/s", "angular velocity of the driven pair", per_input=True
                ),
                Column(
                    "ddq",
                    "rad/s2",
                    "angular acceleration of the driven pair",
                    per_input=True,
                ),
                Column(
                    "type_2",
                    "",
                    "transmission measure: how well the locked inputs hold the "
                    "output, from 0 (at a type II singularity) to 1",
                ),
                STATUS,
            ),
        ),
    )

    start: str
    end: str
    mode: str = "0"
    end_mode: str = ""
    output: str = ""
    samples: int = 91
    theta: tuple[Degrees, ...] = ()
    speed: tuple[DegreesPerSecond, ...] = ()
    acceleration: tuple[DegreesPerSecond2, ...] = ()
    shape: str = "cycloidal"
    cycle: Seconds = 0.0

    def needs(self, mechanism: Mechanism) -> Needs:
        """Check all parameters, and return what this analysis reads of a run.

        The analysis turns the output link from a start to an end about one fixed axis, and
        computes the inputs during this rotation. Only the position analysis (`tracer`) of
        the run is read.

        Raises
        ------
        AnalysisError, ModelError
            If a parameter is not valid for the mechanism.
        """
        chosen_output(mechanism, self.output or None)
        inputs = mechanism.input_pairs
        # A link on a sphere has three degrees of freedom, so more inputs are redundant.
        if len(inputs) > 3:
            raise AnalysisError(
                f"{self.name}: the mechanism has {len(inputs)} inputs, but an orientation "
                "has only three degrees of freedom; lock some inputs"
            )
        angle_unit = mechanism.angle_unit
        # These calls only raise an error if a text is not valid.
        read_pose(self.start, inputs, f"{self.name}: start", angle_unit)
        read_end(self.end, inputs, f"{self.name}: end", angle_unit)
        if self.samples < 2:
            raise AnalysisError(
                f"{self.name}: samples: found {self.samples}, expected at least 2"
            )
        # The user can list angles of the rotation. An upper limit is not checked here,
        # because the angle of the whole rotation is not known yet.
        if not all(0.0 <= theta < np.inf for theta in self.theta):
            raise AnalysisError(
                f"{self.name}: theta: found {'+'.join(map(str, self.theta))}, expected "
                "angles in degrees between 0 and the angle of the whole rotation"
            )
        try:
            # This call only raises an error if a parameter of the schedule is not valid. A
            # schedule is the angle of the rotation as a function of time.
            schedule_limits(
                inputs,
                self.speed or None,
                self.acceleration or None,
                self.shape,
                self.cycle or None,
            )
        except SolveError as problem:
            raise AnalysisError(f"{self.name}: {problem}") from None
        return Needs(tracer=True)

    def compute(self, batch: Batch) -> Mapping[str, TableData]:
        """Return the tables of a rotation of the output link and of its schedule.

        The output link is to turn about an axis that is fixed in its reference link. The
        table of the rotation has one row for each sampled angle. `orientation_error` is the
        angle between the reached and the wanted orientation. `drift` is the angle between
        the wanted axis and the axis about which the link momentarily turns.
        `orientation_error` and `drift` are 0 (up to rounding) if the mechanism can follow
        exactly. `type_2` measures how well locked inputs prevent a motion of the output
        link. It is 0 at a type II singularity, and at most 1.

        The schedule is the rotation in time, within limits of speed and acceleration of the
        inputs. The table of the schedule has one row for each time.
        """
        result = self._result(batch)
        mechanism = batch.mechanism
        samples = result.samples
        azimuth, tilt, torsion = tilt_torsion(samples.orientation).T
        rotation_columns = {
            "sample": np.arange(len(samples.theta)),
            "theta": samples.theta,
            "azimuth": azimuth,
            "tilt": tilt,
            "torsion": torsion,
            **input_columns(mechanism, samples.inputs),
            **input_columns(mechanism, samples.rates, "dq_dtheta"),
            "orientation_error": samples.orientation_error,
            "drift": samples.drift,
            "type_2": samples.type_2,
            "status": samples.status,
        }
        # In a mid-plane symmetric architecture the base and the output link are mirror
        # images of each other about a plane. Two angles phi and gamma give the normal of
        # the plane.
        if result.architecture is not None:
            normals = mid_planes(result.architecture, samples.orientation)
            phi, gamma, _omega = mirror_angles(normals)
            rotation_columns["phi"] = phi
            rotation_columns["gamma"] = gamma
        # A part is a mapping of columns. Without a schedule there is no part, and the table
        # of the schedule is empty.
        schedule_parts = []
        trajectory = result.trajectory
        if trajectory is not None:
            schedule_parts.append(
                {
                    "t": trajectory.t,
                    "theta": trajectory.theta,
                    **input_columns(mechanism, trajectory.inputs),
                    **input_columns(mechanism, trajectory.rates, "dq"),
                    **input_columns(mechanism, trajectory.accelerations, "ddq"),
                    "type_2": trajectory.type_2,
                    "status": trajectory.status,
                }
            )
        # The declarations of both tables. `stacked` joins the rows of all parts.
        rotation_table, schedule_table = self.tables
        return {
            rotation_table.name: rotation_table.stacked(mechanism, [rotation_columns]),
            schedule_table.name: schedule_table.stacked(mechanism, schedule_parts),
        }

    def scene(self, batch: Batch) -> tuple[Scene, ...]:
        """Return a page with the rotation, and one with its schedule if there is one."""
        findings = self.findings(batch)
        mode = findings.figures["start"]["mode"]
        paragraphs = [
            "# Equivalent rotation",
            f"from {self.start}, mode {mode}, to {self.end}",
            *findings.remarks,
            *findings.warnings,
        ]
        return self._result(batch).scenes("\n\n".join(paragraphs))

    def findings(self, batch: Batch) -> Findings:
        """Return axis, angle, feasibility, positions of type II, and the duration.

        A rotation is feasible if the mechanism follows it to its end and the output link
        turns about a fixed axis. At a singularity of type II the locked inputs do not hold
        the output.
        """
        result = self._result(batch)
        rotation = result.rotation
        samples = result.samples
        start = result.start
        orientation_error = _largest_finite(result.checked.orientation_error)
        # Samples without a configuration. Singular samples have one, but not beyond the end
        # of the rotation.
        has_failed = ~np.isin(samples.status, (Status.OK, Status.AT_SINGULARITY))
        has_failed |= samples.theta > rotation.reached
        keeps_axis = orientation_error < FIXED_AXIS_TOLERANCE_RAD
        is_feasible = rotation.end == Status.OK and keeps_axis and not np.any(has_failed)
        summary: dict[str, Any] = {
            "output": result.output.name,
            "axis": rotation.axis.tolist(),
            "angle_rad": rotation.angle,
            "feasible": bool(is_feasible),
            "failed_rows": int(np.sum(has_failed)),
            "reached_rad": rotation.reached,
            "end": Status(rotation.end).name,
            "largest_orientation_error_rad": orientation_error,
            "largest_drift_rad": _largest_finite(result.checked.drift),
            "crossings_rad": list(rotation.crossings),
            "start": {
                "mode": str(start.labels[result.start_number]),
                "number": result.start_number,
                "configurations": [
                    {"mode": start.labels[number], "inputs_rad": inputs.tolist()}
                    for number, inputs in enumerate(start.inputs)
                ],
            },
        }
        axis_by_frame = {f"link {result.output.relative_to}": rotation.axis}
        if result.architecture is not None:
            axis_in_mirror = rotation.axis @ result.architecture.frame
            axis_by_frame["the mirror (x0, y0, z0)"] = axis_in_mirror
            summary["axis_in_mirror_axes"] = axis_in_mirror.tolist()
        axes = ", ".join(
            f"({', '.join(f'{x:.6f}' for x in axis)}) in axes of {frame}"
            for frame, axis in axis_by_frame.items()
        )
        remarks = [
            f"The output turns by {np.degrees(rotation.angle):.6g} deg about the fixed "
            f"axis {axes}."
        ]
        remarks += _describe_input_ranges(result.checked.inputs, rotation.inputs)
        end = result.end
        if isinstance(end, EndOrientation) and end.count > 1:
            summary["end_pose"] = {"end_mode": end.number, "orientations": end.count}
            of_start = ", in the mode of the start" if end.has_start_mode else ""
            remarks.append(
                f"The end has {end.count} orientations; this one is "
                f"end_mode={end.number}{of_start}."
            )
        if result.schedule is not None:
            schedule_record = self._schedule_record(result.schedule)
            summary["schedule"] = schedule_record
            remarks.append(
                f"The rotation takes {result.schedule.duration:.6g} s within the limits, "
                f"set by {schedule_record['set_by']}."
            )
        warnings = tuple(_warnings(result, has_failed))
        return Findings(summary, warnings, tuple(remarks))

    def _schedule_record(self, schedule: TimeScaling) -> dict[str, Any]:
        """Return what the summary states about a schedule of the rotation.

        A schedule gives the time at which the rotation reaches each angle theta. The record
        has the duration and the extremes: the largest speed and the largest acceleration of
        each input. Each extreme has its time t, and the angle theta at this time.
        """
        # The speeds and accelerations of the inputs are limited. The duration is as short
        # as these limits allow. The binding limit is the one that prevents a shorter
        # duration.
        binding = schedule.binding
        return {
            # The name of the law by which the angle grows in time.
            "shape": self.shape,
            "duration_s": schedule.duration,
            # Cycle time of the controller of the inputs; None if no cycle time is given.
            "cycle_s": schedule.cycle,
            "set_by": f"{binding.quantity} of {binding.input} at {binding.t:.6g} s",
            "extremes": [
                {
                    "input": extreme.input,
                    "quantity": extreme.quantity,
                    "value": extreme.value,
                    "unit": "rad/s" if extreme.quantity == "speed" else "rad/s2",
                    "t_s": extreme.t,
                    "theta_rad": extreme.theta,
                }
                for extreme in schedule.extremes
            ],
        }

    def _result(self, batch: Batch) -> RotationResult:
        """Return the rotation and its schedule, which are computed once."""
        return batch.once("result", lambda: self._compute_result(batch))

    def _compute_result(self, batch: Batch) -> RotationResult:
        """Return the rotation and its schedule.

        Start and end are read from the parameters. A pose can have several configurations;
        the rotation is followed from one configuration of the start. There is a schedule
        only if the user limits speed or acceleration and the mechanism follows to the end.

        Raises
        ------
        SolveError
            If the start or the end cannot be assembled, or `theta` exceeds the rotation.
        """
        # 1. The output, and its mid-plane symmetric architecture if it has one.
        mechanism = batch.mechanism
        solver = batch.tracer.solver
        inputs = batch.moving_inputs
        output = chosen_output(mechanism, self.output or None)
        try:
            architecture = mid_plane_form(mechanism, output.name)
        except ModelError:
            architecture = None

        # 2. The configuration at the start, and the orientation at the end.
        finder = PoseFinder(solver, output, architecture)
        end_pose = read_end(self.end, inputs, f"{self.name}: end", mechanism.angle_unit)
        try:
            start_pose = read_pose(self.start, inputs, "start", mechanism.angle_unit)
            start = finder.candidates(start_pose)
            start_number = start.number_of(self.mode)
        except SolveError as problem:
            raise SolveError(f"start: {problem}") from None
        end = finder.resolve_end(start, start_number, end_pose, self.end_mode)

        # 3. The rotation, and the angles at which it is sampled.
        rotation = finder.rotation(start, start_number, end)
        theta = np.linspace(0.0, rotation.angle, self.samples)
        if self.theta:
            angle_deg = np.degrees(rotation.angle)
            # The whole angle may also be given as it is rounded in the message.
            if max(self.theta) > max(angle_deg, float(f"{angle_deg:.9g}")):
                raise SolveError(
                    f"theta: {max(self.theta):.12g} deg is beyond the rotation, whose "
                    f"angle is {angle_deg:.9g} deg"
                )
            theta = np.minimum(np.radians(self.theta), rotation.angle)
        checked_theta = np.linspace(0.0, rotation.angle, CHECKED_ANGLES)

        # 4. The schedule.
        schedule = None
        why_no_schedule = ""
        if self.speed or self.acceleration:
            if rotation.end != Status.OK:
                why_no_schedule = "the mechanism cannot follow the whole rotation"
            else:
                try:
                    schedule = time_optimal(
                        rotation,
                        np.radians(self.speed or np.inf),
                        np.radians(self.acceleration or np.inf),
                        self.shape,
                        self.cycle or None,
                    )
                except SolveError as problem:
                    why_no_schedule = str(problem)
        return RotationResult(
            mechanism=mechanism,
            orient_links=lambda values: solver.closure.linearise(values).rotations,
            output=output,
            start=start,
            start_number=start_number,
            end=end,
            rotation=rotation,
            samples=rotation.at(theta),
            checked=rotation.at(np.append(checked_theta, theta)),
            architecture=architecture,
            schedule=schedule,
            trajectory=None if schedule is None else schedule.table(self.samples),
            why_no_schedule=why_no_schedule,
        )


def _describe_input_ranges(inputs: Floats, names: Sequence[str]) -> list[str]:
    """Return a sentence on the ranges that the inputs pass through during a rotation.

    The list is empty if no row has a configuration.

    Parameters
    ----------
    inputs
        (n, inputs) inputs of the samples (rad), NaN in rows without a configuration.
    names
        Names of the inputs.
    """
    is_known = np.all(np.isfinite(inputs), axis=1)
    if not np.any(is_known):
        return []
    ranges = [
        f"{name} from {degree_range_text(float(np.min(q)), float(np.max(q)))} deg"
        for name, q in zip(names, inputs[is_known].T, strict=True)
    ]
    return [f"The inputs pass through these ranges: {', '.join(ranges)}."]


def _warnings(result: RotationResult, has_failed: NDArray[np.bool_]) -> Iterator[str]:
    """Yield warnings about a rotation.

    There are warnings if the rotation ends early, if rows failed, and if the axis is not
    fixed. Each singularity of type II has a warning, and so has a missing schedule for
    which the user asked. A schedule is the rotation in time, within limits of the inputs.

    Parameters
    ----------
    result
        The rotation.
    has_failed
        (n,) whether a sample has no configuration.
    """
    rotation = result.rotation
    samples = result.samples
    checked = result.checked
    orientation_error = _largest_finite(checked.orientation_error)
    # `rotation.end` is OK if the mechanism follows the whole rotation. Else it is the
    # reason why the mechanism does not follow beyond the angle `rotation.reached`.
    if rotation.end != Status.OK:
        input_at_dead_centre = dead_centre(rotation)
        cause = ""
        if input_at_dead_centre:
            cause = f"input {input_at_dead_centre} is at a dead centre there: "
        yield (
            f"The rotation ends at {np.degrees(rotation.reached):.6g} of "
            f"{np.degrees(rotation.angle):.6g} deg: {Status(rotation.end).name}, "
            f"{cause}{MEANING_OF_END[Status(rotation.end)]}{_suggest_other_ends(result)}"
        )
    elif np.any(has_failed):
        first = np.argmax(has_failed)
        yield (
            f"{np.sum(has_failed)} of {len(has_failed)} rows failed, the first at theta = "
            f"{np.degrees(samples.theta[first]):.6g} deg: "
            f"{Status(samples.status[first]).name}"
        )
    # The orientation error is the angle between the orientation of the link and the exact
    # one. The drift is the angle between the instantaneous axis of the link and the fixed
    # axis.
    if orientation_error >= FIXED_AXIS_TOLERANCE_RAD:
        worst = np.nanargmax(checked.orientation_error)
        worst_theta_deg = np.degrees(checked.theta[worst])
        largest_drift_deg = np.degrees(_largest_finite(checked.drift))
        yield (
            "The output link cannot turn exactly about the fixed axis: its orientation "
            f"deviates by up to {np.degrees(orientation_error):.4g} deg, at theta = "
            f"{worst_theta_deg:.4g} deg, and its axis by up to {largest_drift_deg:.4g} deg"
        )
    for theta in rotation.crossings:
        location = f"theta = {np.degrees(theta):.4f} deg"
        (inputs,) = rotation.at([theta]).inputs
        for name, q in zip(rotation.inputs, inputs, strict=True):
            if np.isfinite(q):
                # Adding 0.0 changes -0.0 to 0.0, which is printed without a minus sign.
                location += f", {name} = {np.degrees(q) + 0.0:.4f} deg"
        yield (
            f"The rotation meets a type II singularity at {location}, where the "
            "inputs do not hold the mechanism"
        )
    if result.why_no_schedule:
        yield f"There is no schedule: {result.why_no_schedule}"


def _suggest_other_ends(result: RotationResult) -> str:
    """Return advice to choose another orientation at the end, or an empty text.

    The mechanism may have several configurations at the end, with different orientations.
    """
    end = result.end
    if not isinstance(end, EndOrientation) or end.count < 2:
        return ""
    of_start = ", in the mode of the start" if end.has_start_mode else ""
    return (
        f". The end has {end.count} orientations, numbered by their angle from the start. "
        f"This one is end_mode={end.number}{of_start}; choose another with end_mode=0 to "
        f"{end.count - 1}"
    )


def _largest_finite(values: Floats) -> float:
    """Return the largest finite value of an array, at least 0."""
    return float(np.max(values[np.isfinite(values)], initial=0.0))
