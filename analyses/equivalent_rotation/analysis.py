"""Equivalent rotation: from one pose of an output to another about one fixed axis."""

from collections.abc import Iterator, Mapping
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
    input_columns,
)
from spherekit.plugin.rotations import (
    EndOrientation,
    PoseFinder,
    chosen_output,
    dead_centre,
    mid_plane_form,
    mirror_angles,
    schedule_limits,
    tilt_torsion,
    time_optimal,
)

from ..common import MID_PLANE_COLUMNS, TILT_TORSION_COLUMNS
from ..output_poses import read_end, read_pose
from .scenes import FoundRotation, mid_planes

ENDS: Mapping[Status, str] = {
    Status.OUT_OF_REACH: "the output link cannot turn further; choose another pose",
    Status.AT_SINGULARITY: "the loops stop fixing the links there; choose another way",
    Status.OFF_PROFILE: "a contact runs off its profile; choose a nearer pose",
    Status.MODE_LOST: "no verified step leads on; choose another way",
}
"""What it means that a rotation ends before its whole angle."""
FEASIBLE = 1e-9
"""A rotation that departs by less (rad) is one about a fixed axis."""


@dataclass(frozen=True, kw_only=True)
class EquivalentRotation(AbstractAnalysis):
    """The rotation about a fixed axis that carries an output link from `start` to `end`.

    Poses are ``key=value+key=value``, angles in degrees: all driven pairs by their names
    (``21=5.3+61=56.7``); ``phi``, ``gamma`` of a mid-plane symmetric architecture; ``x``,
    ``y``, ``z``, where an output points; ``azimuth``, ``tilt``, ``torsion`` or the
    quaternion ``qx``, ``qy``, ``qz``, ``qw`` of an orientation. The end may also be the
    axis and angle of a turn, ``ux``, ``uy``, ``uz``, ``angle``. All are seen from the link
    that the output is relative to.

    `mode` is the start's configuration, by number or by signs; the summary lists them.
    `end_mode` is that of an end with several orientations, by number, 0 the nearest to the
    start, or by signs. By default it is the nearest in the start's assembly and working
    mode.
    `samples` divide the rotation evenly; `theta` (degrees) gives its angles instead.
    `speed` (deg/s) and `acceleration` (deg/s2) are limits of the inputs, one for all or one
    for each: with one of them there is a schedule of that many rows, its time law of the
    `shape` cycloidal, cubic, quintic or septic. With the controller's `cycle` (s) it has a
    row for each cycle instead, and takes a whole number of them.
    """

    name = "equivalent_rotation"
    version = "1"
    summary = "rotation about a fixed axis between two poses, in time"
    cites = (
        "Z. Chen et al., Motion characteristics analysis of a novel spherical two-degree-"
        "of-freedom parallel mechanism, 2021, doi 10.21203/rs.3.rs-258461",
    )
    reads_samples = False
    tables = (
        Table(
            "equivalent_rotation",
            "one row per angle of the rotation",
            (
                Column("sample", "", "number of the angle, from 0", "integer"),
                Column("theta", "rad", "angle turned through about the axis"),
                *MID_PLANE_COLUMNS,
                *TILT_TORSION_COLUMNS,
                INPUTS,
                Column("dq_dtheta", "", "derivative of q by theta", per_input=True),
                Column("orientation_error", "rad", "angle from the pose turned exactly"),
                Column(
                    "drift", "rad", "angle from the axis of the moment to the fixed one"
                ),
                Column("type_2", "", "transmission measure, 0 at a type II singularity"),
                STATUS,
            ),
        ),
        Table(
            "schedule",
            "the rotation in time, for a controller; empty without limits",
            (
                TIME,
                Column("theta", "rad", "angle turned through about the axis"),
                INPUTS,
                Column("dq", "rad/s", "rate of q", per_input=True),
                Column("ddq", "rad/s2", "acceleration of q", per_input=True),
                Column("type_2", "", "transmission measure, 0 at a type II singularity"),
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
    theta: tuple[float, ...] = ()
    speed: tuple[float, ...] = ()
    acceleration: tuple[float, ...] = ()
    shape: str = "cycloidal"
    cycle: float = 0.0

    def needs(self, mechanism: Mechanism) -> Needs:
        """Return the tracer, whose solver assembles the start; refuse bad parameters."""
        chosen_output(mechanism, self.output or None)
        inputs = mechanism.input_pairs
        if len(inputs) > 3:
            raise AnalysisError(
                f"{self.name}: {len(inputs)} inputs turn the output link in more ways than "
                "there are; lock some of them"
            )
        read_pose(self.start, inputs, f"{self.name}: start")
        read_end(self.end, inputs, f"{self.name}: end")
        if self.samples < 2:
            raise AnalysisError(
                f"{self.name}: samples: found {self.samples}, needs at least 2"
            )
        if not all(0.0 <= theta < np.inf for theta in self.theta):
            raise AnalysisError(
                f"{self.name}: theta: found {'+'.join(map(str, self.theta))}, needs angles "
                "in degrees from 0 to that of the rotation"
            )
        limits = self.speed or None, self.acceleration or None
        try:
            schedule_limits(inputs, *limits, self.shape, self.cycle or None)
        except SolveError as problem:
            raise AnalysisError(f"{self.name}: {problem}") from None
        return Needs(tracer=True)

    def compute(self, batch: Batch) -> Mapping[str, TableData]:
        """Return the tables of the rotation and of its schedule."""
        result = self._found(batch)
        mechanism = batch.mechanism
        at = result.samples
        rows = result.rows
        azimuth, tilt, torsion = tilt_torsion(at.orientation).T
        first = {
            "sample": np.arange(len(at.theta)),
            "theta": at.theta,
            "azimuth": azimuth,
            "tilt": tilt,
            "torsion": torsion,
            **input_columns(mechanism, at.inputs),
            **input_columns(mechanism, at.rates, "dq_dtheta"),
            "orientation_error": at.orientation_error,
            "drift": at.drift,
            "type_2": at.type_2,
            "status": at.status,
        }
        if result.form is not None:
            mirrors = mirror_angles(mid_planes(result.form, at.orientation))
            first["phi"], first["gamma"], _ = mirrors
        second = (
            []
            if rows is None
            else [
                {
                    "t": rows.t,
                    "theta": rows.theta,
                    **input_columns(mechanism, rows.inputs),
                    **input_columns(mechanism, rows.rates, "dq"),
                    **input_columns(mechanism, rows.accelerations, "ddq"),
                    "type_2": rows.type_2,
                    "status": rows.status,
                }
            ]
        )
        one, other = self.tables
        return {
            one.name: one.stacked(mechanism, [first]),
            other.name: other.stacked(mechanism, second),
        }

    def scene(self, batch: Batch) -> tuple[Scene, ...]:
        """Return a page with the rotation, and one with its schedule if there is one."""
        told = self.findings(batch)
        mode = f"from {self.start}, mode {told.figures['start']['mode']}, to {self.end}"
        lines = "# Equivalent rotation", mode, *told.remarks, *told.warnings
        return self._found(batch).pages("\n\n".join(lines))

    def findings(self, batch: Batch) -> Findings:
        """Return axis, angle, feasibility, places of type II, and the duration."""
        result = self._found(batch)
        turn, at, start = result.turn, result.samples, result.start
        orientation_error = _largest(at.orientation_error)
        failed = ~np.isin(at.status, (Status.OK, Status.AT_SINGULARITY))
        kept = orientation_error < FEASIBLE and not np.any(failed)
        figures: dict[str, Any] = {
            "output": result.output.name,
            "axis": turn.axis.tolist(),
            "angle_rad": turn.angle,
            "feasible": bool(turn.end == Status.OK and kept),
            "failed_rows": int(np.sum(failed)),
            "reached_rad": turn.reached,
            "end": Status(turn.end).name,
            "largest_orientation_error_rad": orientation_error,
            "largest_drift_rad": _largest(at.drift),
            "crossings_rad": list(turn.crossings),
            "start": {
                "mode": str(start.labels[result.number]),
                "number": result.number,
                "configurations": [
                    {"mode": start.labels[k], "inputs_rad": inputs.tolist()}
                    for k, inputs in enumerate(start.inputs)
                ],
            },
        }
        told = [(turn.axis, f"link {result.output.relative_to}")]
        if result.form is not None:
            told.append((turn.axis @ result.form.frame, "the mirror (x0, y0, z0)"))
            figures["axis_in_mirror_axes"] = told[1][0].tolist()
        about = ", ".join(
            f"({', '.join(f'{x:.6f}' for x in axis)}) in axes of {frame}"
            for axis, frame in told
        )
        remarks = [f"{np.degrees(turn.angle):.6g} deg about {about}"]
        end = result.end
        if isinstance(end, EndOrientation) and end.count > 1:
            figures["end_pose"] = {"end_mode": end.number, "orientations": end.count}
            of_start = ", that of the start's mode" if end.has_start_mode else ""
            remarks.append(
                f"the end is end_mode={end.number} of {end.count} orientations{of_start}"
            )
        if result.schedule is not None:
            most, taken = result.schedule.binding, f"{result.schedule.duration:.6g} s"
            set_by = f"{most.quantity} of {most.input} at {most.t:.6g} s"
            figures["schedule"] = {
                "shape": self.shape,
                "duration_s": result.schedule.duration,
                "cycle_s": result.schedule.cycle,
                "set_by": set_by,
                "extremes": [
                    {
                        "input": extreme.input,
                        "quantity": extreme.quantity,
                        "value": extreme.value,
                        "unit": "rad/s" if extreme.quantity == "speed" else "rad/s2",
                        "t_s": extreme.t,
                        "theta_rad": extreme.theta,
                    }
                    for extreme in result.schedule.extremes
                ],
            }
            remarks.append(f"it takes {taken} within the limits, set by {set_by}")
        return Findings(figures, tuple(_warnings(result, failed)), tuple(remarks))

    def _found(self, batch: Batch) -> FoundRotation:
        return batch.once("found", lambda: self._rotation(batch))

    def _rotation(self, batch: Batch) -> FoundRotation:
        mechanism = batch.mechanism
        inputs = batch.moving_inputs
        output = chosen_output(mechanism, self.output or None)
        try:
            form = mid_plane_form(mechanism, output.name)
        except ModelError:
            form = None
        finder = PoseFinder(batch.tracer.solver, output, form)
        end = read_end(self.end, inputs, f"{self.name}: end")
        try:
            start = finder.candidates(read_pose(self.start, inputs, "start"))
            number = start.number_of(self.mode)
        except SolveError as problem:
            raise SolveError(f"start: {problem}") from None
        resolved_end = finder.resolve_end(start, number, end, self.end_mode)
        turn = finder.rotation(start, number, resolved_end)
        theta = np.linspace(0.0, turn.angle, self.samples)
        if self.theta:
            theta = np.radians(self.theta)
            if not np.max(theta) <= turn.angle:
                raise SolveError(
                    f"theta: {max(self.theta):g} deg is beyond the rotation, whose angle "
                    f"is {np.degrees(turn.angle):.9g} deg"
                )
        schedule = None
        unscheduled = ""
        speed, acceleration = (
            np.radians(limit or np.inf) for limit in (self.speed, self.acceleration)
        )
        if (self.speed or self.acceleration) and turn.end != Status.OK:
            unscheduled = "the mechanism does not follow all the way"
        elif self.speed or self.acceleration:
            try:
                how = self.shape, self.cycle or None
                schedule = time_optimal(turn, speed, acceleration, *how)
            except SolveError as problem:
                unscheduled = str(problem)
        return FoundRotation(
            mechanism,
            lambda values: batch.tracer.solver.closure.at(values).rotations,
            output,
            start,
            number,
            resolved_end,
            turn,
            turn.at(theta),
            form,
            schedule,
            None if schedule is None else schedule.table(self.samples),
            unscheduled,
        )


def _warnings(result: FoundRotation, failed: NDArray[np.bool_]) -> Iterator[str]:
    """Yield what is not as it was asked for; `failed` are rows of the samples."""
    turn = result.turn
    at = result.samples
    orientation_error = _largest(at.orientation_error)
    if turn.end != Status.OK:
        dead = dead_centre(turn)
        yield (
            f"the rotation ends at {np.degrees(turn.reached):.6g} of "
            f"{np.degrees(turn.angle):.6g} deg: {Status(turn.end).name}, "
            + (f"input {dead} is at a dead centre there: " if dead else "")
            + ENDS[Status(turn.end)]
            + _other_ends(result)
        )
    elif np.any(failed):
        first = np.argmax(failed)
        yield (
            f"{np.sum(failed)} of {len(failed)} rows failed, the first at theta = "
            f"{np.degrees(at.theta[first]):.6g} deg: {Status(at.status[first]).name}"
        )
    if not orientation_error < FEASIBLE:
        worst = np.nanargmax(at.orientation_error)
        yield (
            "the output link does not turn about a fixed axis: nearest to it, it "
            f"departs by up to {np.degrees(orientation_error):.4g} deg, at theta = "
            f"{np.degrees(at.theta[worst]):.4g} deg, and its axis by "
            f"{np.degrees(_largest(at.drift)):.4g} deg"
        )
    for place in turn.crossings:
        where = f"theta = {np.degrees(place):.4f} deg"
        for name, q in zip(turn.inputs, turn.at([place]).inputs[0], strict=True):
            if np.isfinite(q):
                where += f", {name} = {np.degrees(q) + 0.0:.4f}"
        yield (
            f"the rotation meets a type II singularity at {where}, where the "
            "inputs do not hold the mechanism"
        )
    if result.unscheduled:
        yield f"there is no schedule: {result.unscheduled}"


def _other_ends(result: FoundRotation) -> str:
    """Return what to say of the other orientations of an end that is not reached."""
    end = result.end
    if not isinstance(end, EndOrientation) or end.count < 2:
        return ""
    of_start = " in the start's mode" if end.has_start_mode else ""
    return (
        f". The end has {end.count} orientations, and this one is end_mode={end.number}"
        f"{of_start}; choose another with end_mode=0 to {end.count - 1}, by its angle from "
        "the start"
    )


def _largest(values: Floats) -> float:
    return float(np.max(values[np.isfinite(values)], initial=0.0))
