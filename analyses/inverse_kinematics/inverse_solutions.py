"""The configurations of many poses of an output."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spherekit.plugin import (
    Arrow,
    Axis,
    Findings,
    Floats,
    Mechanism,
    Primitive,
    Scene,
    ScreenColumn,
    ScreenTable,
    SphereMap,
    Status,
    Text,
    counted,
    degree_range_text,
    input_columns,
    link_bodies,
    listing,
    number_text,
    numbered,
)
from spherekit.plugin.rotations import quaternion
from spherekit.plugin.singularities import solver_of
from spherekit.plugin.workspace import (
    ClosedKinematics,
    OutputKinematics,
    nearest_poses,
    sense_of,
    sphere_mesh,
    turns_of,
)

from ..output_poses import describe_nearest_pose
from .solver_summary import (
    count_values,
    describe_omitted_solutions,
    format_degrees,
    summarize_solver,
)
from .tables import INVERSE, PAIRS, all_pose_columns, mid_plane_rate_columns

MAX_DRAWN_SOLUTIONS = 2000
"""Largest number of solutions that are drawn, one in each sample of a page."""
MAX_LISTED_SOLUTIONS = 40
"""Largest number of drawn solutions that are listed next to the drawing."""
MAX_CHECKED_POSES = 200
"""Largest number of poses whose solutions are inserted into the closure equations."""
MAX_DESCRIBED_POSES = 3
"""Largest number of poses for which each configuration is described."""

LARGEST_ZERO_MEASURE = 1e-9
"""Measures of singularities that are not larger are printed as 0."""

Columns = dict[str, Any]
"""Columns of a table by name."""


class InverseSolutions:
    """The configurations at poses of the output, and reachable poses near unreachable ones.

    Parameters
    ----------
    mechanism, solver
        The mechanism, and the inverse kinematics of its output.
    poses
        (n, 3) directions or (n, 3, 3) rotations.
    grid_shape
        Number of values along each axis if the poses are a grid; None otherwise.
    modes
        Labels of the working modes of interest.
    pairs
        Indices of the pairs whose variables are listed.
    max_nearest
        Largest number of rows for which the nearest reachable pose is computed.

    Attributes
    ----------
    solutions
        The rows of the inverse kinematics, one for each pose and mode, or configuration.
    solution_counts
        (n,) number of solutions (configurations) of each pose.
    nearest_poses, nearest_distances
        (rows, 3 or 4) the nearest reachable direction or quaternion, and its angular
        distance (rows,) in rad; NaN if not computed or not found.
    nearest_count
        Number of rows for which the nearest reachable pose was computed.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        solver: OutputKinematics,
        poses: Floats,
        *,
        grid_shape: tuple[int, ...] | None,
        modes: Sequence[str],
        pairs: list[int],
        max_nearest: int,
    ) -> None:
        """Solve all poses, then compute reachable poses near those out of reach.

        A row of the solutions is one pose in one working mode (way to assemble the
        mechanism at this pose). Nearest poses are computed for the first `max_nearest` rows
        out of reach. The output must have a closed form, because the limits of its
        workspace are then known functions of the pose.

        Parameters
        ----------
        mechanism, solver
            The mechanism, and the inverse kinematics of its output.
        poses
            (n, 3) directions or (n, 3, 3) rotations.
        grid_shape
            Number of values along each axis if the poses are a grid, else None.
        modes
            Labels of the working modes to solve for, such as "+-".
        pairs
            Indices of the pairs whose variables are listed.
        max_nearest
            Largest number of rows for which the nearest reachable pose is computed.
        """
        self.mechanism = mechanism
        self.solver = solver
        self.poses = poses
        self.grid_shape = grid_shape
        self.modes = modes
        self.pairs = pairs
        solutions = solver.inverse(poses, modes, range(len(mechanism.pairs)))
        self.solutions = solutions
        self.solution_counts = np.bincount(
            solutions.pose[solutions.solved], minlength=len(poses)
        )
        # (rows, 3 or 4) the direction or quaternion of each row. Poses are directions if
        # the solver has `points`, else rotations.
        poses_as_vectors = poses if solver.points else quaternion(poses)
        pose_rows = poses_as_vectors[solutions.pose]
        self.nearest_poses = np.full_like(pose_rows, np.nan)
        self.nearest_distances = np.full(len(solutions), np.nan)
        self.nearest_count = 0
        if isinstance(solver, ClosedKinematics):
            rows = np.flatnonzero(~solutions.solved)[:max_nearest]
            self.nearest_count = len(rows)
            # A working mode is given by its signs, or by its label, such as "+-".
            for signs, mode in zip(solver.modes, solver.labels, strict=True):
                rows_of_mode = rows[solutions.mode[rows] == mode]
                if len(rows_of_mode):
                    nearest, distances = nearest_poses(
                        solver, pose_rows[rows_of_mode], signs
                    )
                    self.nearest_poses[rows_of_mode] = nearest
                    self.nearest_distances[rows_of_mode] = distances

    def table_parts(self) -> dict[str, list[Columns]]:
        """Return the tables of configurations and of variables of pairs, by name."""
        solutions = self.solutions
        pair_names = np.array(self.mechanism.names_of(self.pairs), dtype=str)
        pair_columns: Columns = {
            "pose": np.repeat(solutions.pose, len(pair_names)),
            "working_mode": np.repeat(solutions.mode, len(pair_names)),
            "pair": np.tile(pair_names, len(solutions)),
            "value": solutions.values[:, self.pairs].ravel(),
        }
        return {INVERSE.name: [self._inverse_columns()], PAIRS.name: [pair_columns]}

    def _inverse_columns(self) -> Columns:
        """Return the table of configurations: one row for each row of the solutions.

        A solution is a configuration in which the output has a requested pose. The columns
        have the pose and the inputs, the rates of the inputs, the margin of the nearest
        limit, measures of singularities, the status, and the nearest reachable pose. The
        columns of the nearest pose are NaN if that was not computed or not found.
        """
        mechanism = self.mechanism
        solver = self.solver
        solutions = self.solutions
        # (rows, 3) if poses of the output are directions (`points`), else None.
        directions = self.poses[solutions.pose] if solver.points else None
        columns: Columns = {
            "pose": solutions.pose,
            "working_mode": solutions.mode,
            **all_pose_columns(solver, self.poses[solutions.pose]),
            **input_columns(mechanism, solutions.inputs),
        }
        # Rates of the inputs if the output turns about x, y or z at 1 rad/s.
        for component, axis in enumerate("xyz"):
            rates = solutions.rates[:, :, component]
            columns |= input_columns(mechanism, rates, f"rate_{axis}")
        # `form` describes a mechanism in which base and output link are always mirror
        # images of each other about a plane. `form` is None for other mechanisms.
        if solver.form is not None and directions is not None:
            # (rows, 3, inputs) angular velocity of the output per unit rate of each input.
            angular_velocities = turns_of(solutions.rates, directions)
            columns |= mid_plane_rate_columns(
                mechanism, solver.form, directions, angular_velocities
            )
        # Joint limits and the reach of the legs limit angles. The margin is the angle (rad)
        # that is left to the nearest limit.
        columns["margin"] = solutions.margin
        # The name of that limit; empty for the number -1 (no limit).
        columns["limiting"] = np.array([*solutions.limits, ""])[solutions.limiting]
        # Each input has a measure of type I: the speed of the output per unit rate of this
        # input. At 0, a singularity of type I, the input moves while the output rests.
        columns |= input_columns(mechanism, solutions.type_1, "type_1")
        # One measure of type II, at most 1. At 0, a singularity of type II, the output can
        # move while the inputs are locked.
        columns["type_2"] = solutions.type_2
        # Sign of the determinant of the matrix of rates. The sign changes only at
        # singularities. The matrix has a row for each input, with its rates if the output
        # turns about x, y and z. With two inputs, the direction of the output becomes the
        # third row, so that the matrix is square.
        columns["sense"] = sense_of(solutions.rates, directions)
        columns["status"] = solutions.status
        columns["solved_by"] = solver.solved_by
        for component in range(self.nearest_poses.shape[1]):
            axis = "xyzw"[component]
            columns[f"near_{axis}"] = self.nearest_poses[:, component]
        # Angle (rad) between the pose and the nearest reachable one.
        columns["away"] = self.nearest_distances
        return columns

    def findings(self) -> Findings:
        """Return how many poses have how many solutions, and how well the loops close.

        - The summary has counts, the largest closure residual of some configurations, and
          the least measures of singularities in each working mode. The measure of type I is
          0 if an input moves while the output rests, that of type II if the output can move
          while the inputs rest.
        - Remarks say how many configurations there are, and how many poses have none.
        - A table for the screen has the configurations, or the working modes.
        """
        # 1. Summary. The closure equations are tested at some evenly chosen poses only.
        solutions = self.solutions
        pose_count = len(self.poses)
        row_count = len(solutions)
        checked_poses = np.linspace(0, pose_count - 1, MAX_CHECKED_POSES).astype(int)
        is_checked = np.isin(solutions.pose, checked_poses)
        is_checked &= solutions.status == Status.OK
        residuals = self.solver.residual(solutions.values[is_checked])
        records_of_modes = {}
        for mode in self.modes:
            is_in_mode = solutions.mode == mode
            records_of_modes[mode] = {
                "solved": int(np.sum(solutions.solved[is_in_mode])),
                "least_type_1": _least_or_none(solutions.type_1[is_in_mode]),
                "least_type_2": _least_or_none(solutions.type_2[is_in_mode]),
            }
        summary: Columns = summarize_solver(self.solver) | {
            "poses": pose_count,
            "limits": list(solutions.limits),
            "poses_by_number_of_solutions": count_values(self.solution_counts),
            "working_modes": records_of_modes,
            "largest_closure_residual_rad": (
                float(np.max(residuals)) if len(residuals) else None
            ),
        }

        # 2. Sentences.
        out_of_reach = np.sum(~solutions.solved)
        most = np.max(self.solution_counts, initial=0)
        remark = (
            f"{counted(row_count - out_of_reach, 'configuration')} of "
            f"{counted(pose_count, 'pose')}"
        )
        if pose_count > 1:
            remark += f", at most {most} of one pose"
        remarks = [f"{remark}.", *describe_omitted_solutions(self.solver)]
        has_closed_form = isinstance(self.solver, ClosedKinematics)
        without_solution = np.sum(self.solution_counts == 0)
        if without_solution:
            # Without a closed form, a search does not always prove that a pose has no
            # configuration.
            doubt = "" if has_closed_form else ", which not every search proves"
            verb = "has" if without_solution == 1 else "have"
            remarks.append(
                f"{without_solution} of {counted(pose_count, 'pose')} {verb} no "
                f"configuration{doubt}."
            )
        if has_closed_form and self.nearest_count < out_of_reach:
            remarks.append(
                f"The table has the nearest reachable pose for {self.nearest_count} of "
                f"{counted(out_of_reach, 'row')} out of reach; nearest={out_of_reach} "
                "computes it for all."
            )
        remarks += self._describe_rows_out_of_reach()
        table = self._screen_table()
        if table is None:
            return Findings(summary, (), tuple(remarks))
        remarks.append(
            "The measures are 0 at singularities: that of type I where the output loses a "
            "direction of motion, that of type II where the locked inputs do not hold it."
        )
        return Findings(summary, (), tuple(remarks), (table,))

    @property
    def _has_few_poses(self) -> bool:
        """Whether the configurations of each pose are printed."""
        return len(np.unique(self.solutions.pose)) <= MAX_DESCRIBED_POSES

    def _screen_table(self) -> ScreenTable | None:
        """Return a table for the screen; None without a configuration.

        A row of `solutions` is a pose in one working mode (way to assemble the legs).

        For a few poses, the table has a row for each configuration. For many poses, the
        table has a row for each working mode. This row has the number of poses that the
        mode reaches, the ranges of the inputs, and the smallest measures of singularities.
        """
        solutions = self.solutions
        if not np.any(solutions.solved):
            return None
        pairs = self.mechanism.input_pairs
        # Each input has a measure of type I. The smallest one of each row is listed.
        least_type_1 = np.min(solutions.type_1, axis=1)
        # Working modes by the texts of the other cells. Modes with equal texts are listed
        # in one row of the table.
        modes_by_cells: dict[tuple[str, ...], list[str]] = {}
        if self._has_few_poses:
            several = len(np.unique(solutions.pose)) > 1
            headings = [
                *(["pose"] if several else []),
                *(f"{pair} (deg)" for pair in pairs),
            ]
            headings += ["type I measure", "type II measure"]
            for row in np.flatnonzero(solutions.solved).tolist():
                cells = [str(solutions.pose[row])] if several else []
                cells += [format_degrees(q) for q in solutions.inputs[row]]
                cells.append(_measure_text(least_type_1[row]))
                cells.append(_measure_text(solutions.type_2[row]))
                modes_by_cells.setdefault(tuple(cells), []).append(str(solutions.mode[row]))
        else:
            headings = ["poses", *(f"{pair} (deg)" for pair in pairs)]
            headings += ["least type I measure", "least type II measure"]
            for mode in self.modes:
                is_solved = solutions.solved & (solutions.mode == mode)
                cells = [str(len(np.unique(solutions.pose[is_solved])))]
                if np.any(is_solved):
                    for angles in solutions.inputs[is_solved].T:
                        lowest, highest = float(np.min(angles)), float(np.max(angles))
                        cells.append(degree_range_text(lowest, highest))
                    cells.append(_measure_text(np.nanmin(least_type_1[is_solved])))
                    cells.append(_measure_text(np.nanmin(solutions.type_2[is_solved])))
                else:
                    cells += ["-"] * (len(pairs) + 2)
                modes_by_cells.setdefault(tuple(cells), []).append(str(mode))
        columns = (
            ScreenColumn("working mode"),
            *(ScreenColumn(heading, "right") for heading in headings),
        )
        rows = [(listing(modes), *cells) for cells, modes in modes_by_cells.items()]
        return ScreenTable(columns, tuple(rows))

    def _describe_rows_out_of_reach(self) -> list[str]:
        """Return a sentence for each row out of reach, or none if there are many poses.

        A row is a pose in one working mode (way to assemble the legs).

        The sentence states the nearest reachable pose. Rows without such a pose have no
        sentence. Modes with the same sentence are listed together.
        """
        solutions = self.solutions
        # A limit is a joint limit or the reach of a leg. The number -1 (limit not known)
        # selects the last, empty name.
        limit_names = [*solutions.limits, ""]
        if not self._has_few_poses:
            return []
        modes_of_sentence: dict[str, list[str]] = {}
        for row, mode in enumerate(solutions.mode.tolist()):
            if solutions.solved[row] or not np.isfinite(self.nearest_distances[row]):
                continue
            # The limit because of which the pose is out of reach.
            limit_name = limit_names[solutions.limiting[row]]
            by_limit = ""
            if limit_name:
                by_limit = f" by {limit_name}"
            nearest = describe_nearest_pose(
                self.nearest_poses[row], self.nearest_distances[row]
            )
            sentence = f"Pose {solutions.pose[row]}: out of reach{by_limit}; {nearest}"
            modes_of_sentence.setdefault(sentence, []).append(mode)
        return [
            f"{sentence}, {numbered('mode', modes)}"
            for sentence, modes in modes_of_sentence.items()
        ]

    def _describe_inputs(self, row: int) -> str:
        """Return the inputs of a row in words."""
        inputs = zip(self.mechanism.input_pairs, self.solutions.inputs[row], strict=True)
        return ", ".join(f"{pair} = {format_degrees(q)} deg" for pair, q in inputs)

    def scenes(self) -> tuple[Scene, ...]:
        """Return two pages for the recording: solutions of the poses, and singularities.

        The first page shows the poses on the sphere, coloured by their number of solutions,
        and the mechanism in each solution. The second page shows the poses coloured by the
        angle to a singularity. Without any solution there is only the first page.
        """
        solutions = self.solutions
        legend = self._legend()
        solution_map = self._draw_map("solutions", self.solution_counts.astype(float), "")
        drawn_rows = np.flatnonzero(solutions.solved)[:MAX_DRAWN_SOLUTIONS]
        if not len(drawn_rows):
            return (Scene("Inverse", (solution_map, legend)),)
        parts = (solution_map, *self._draw_solutions(drawn_rows), legend)
        solution_axis = Axis("solution", "", np.arange(float(len(drawn_rows))))

        # A row of the solutions is one pose in one working mode (way to assemble the legs).
        # The row has a measure of type I for each input, and one of type II. At type I the
        # output rests while an input moves. At type II the output can move while the inputs
        # rest. Each measure is understood as the sine of the angle to a singularity of its
        # type. The smallest one counts.
        type_1 = np.min(solutions.type_1, axis=1)
        # If one of two measures is NaN, `fmin` returns the other one.
        row_measure = np.fmin(type_1, solutions.type_2)
        # Rows without a solution have the measure NaN, which becomes 0.
        row_measure = np.nan_to_num(row_measure)
        # The measure of a pose is that of its best mode. The call changes `pose_measure` in
        # place.
        pose_measure = np.zeros(len(self.poses))
        np.maximum.at(pose_measure, solutions.pose, row_measure)
        angle = np.arcsin(np.minimum(pose_measure, 1.0))
        measure_map = self._draw_map("angle to a singularity", angle, "rad")
        return (
            Scene("Inverse", parts, (solution_axis,)),
            Scene("Measure", (measure_map, legend)),
        )

    def _directions(self) -> Floats:
        """Return the directions (n, 3) of the poses, or their z axes."""
        return self.poses if self.solver.points else self.poses[:, :, 2]

    def _draw_map(self, name: str, values: Floats, unit: str) -> SphereMap:
        """Return a map on the sphere of values (n,) of the poses."""
        triangles = _grid_triangles(self.grid_shape)
        return SphereMap("poses/map", name, self._directions(), triangles, values, unit)

    def _draw_solutions(self, rows: NDArray[np.intp]) -> list[Primitive]:
        """Return drawings of the mechanism in some solutions, and a text that lists them.

        An arrow shows the direction of the requested pose. If the pose is an orientation,
        the arrow shows the z axis of the output link.

        Parameters
        ----------
        rows
            (samples,) indices of the solutions. Sample k of the drawing shows the
            mechanism in solution ``rows[k]``.
        """
        mechanism = self.mechanism
        solutions = self.solutions
        closure = solver_of(mechanism).closure
        rotations = closure.linearise(solutions.values[rows]).rotations
        reference = rotations[:, mechanism.link_number[self.solver.output.relative_to]]
        # The directions of the arrow, in the axes of the reference link.
        directions = self._directions()[solutions.pose[rows]]
        lines = [
            f"- {sample}: pose {solutions.pose[row]}, mode {solutions.mode[row]}, "
            f"{self._describe_inputs(row)}"
            for sample, row in enumerate(rows[:MAX_LISTED_SOLUTIONS])
        ]
        return [
            *link_bodies(mechanism, rotations),
            Arrow(
                "pose",
                "pose asked for",
                # From axes of the reference link to ground axes.
                np.matvec(reference, directions),
                # Primary arrows (axes of pairs) are drawn thin. This arrow is thick.
                primary=False,
                # Successive samples are separate solutions, not points of one motion.
                path_shown=False,
            ),
            Text("solutions", "Solutions", "\n".join(lines)),
        ]

    def _legend(self) -> Text:
        """Return a text in Markdown: how many poses have how many solutions.

        The text also explains what the second page shows. A working mode (way to assemble
        the legs at a pose) is a sign for each leg, in the order of `solver.legs`. At a
        singularity of type I the output rests while an input moves. At type II the output
        can move while the inputs rest. The measure of a pose in a mode is its angle to the
        nearer of both. The best mode has the largest measure.
        """
        table_rows = [
            f"| {solutions} | {poses} |\n"
            for solutions, poses in count_values(self.solution_counts).items()
        ]
        text = (
            f"# Poses of {self.solver.output.name}\n\n"
            f"Signs of a mode: {'; '.join(self.solver.legs)}.\n\n"
            "| solutions | poses |\n|---|---|\n"
            + "".join(table_rows)
            + "\nMeasure: the best mode's least angle to a singularity of type I or II."
        )
        return Text("legend", "Poses", text)


def _least_or_none(values: Floats) -> float | None:
    """Return the least finite value of an array, None if there is none."""
    finite = values[np.isfinite(values)]
    return float(np.min(finite)) if finite.size else None


def _grid_triangles(grid_shape: tuple[int, ...] | None) -> NDArray[np.int64]:
    """Return the triangles (t, 3) between neighbours of a grid over two directions.

    `grid_shape` has the number of values along each axis, None if the poses are no grid.
    Only grids that vary exactly two numbers have triangles.
    """
    counts = [count for count in grid_shape or () if count > 1]
    if len(counts) != 2:
        return np.zeros((0, 3), dtype=np.int64)
    rows, columns = counts
    _, triangles = sphere_mesh(columns - 1, rows - 1)
    return triangles


def _measure_text(measure: float) -> str:
    """Return a measure of type I or II for the screen; "-" if it is not known."""
    if not np.isfinite(measure):
        return "-"
    return number_text(float(measure), LARGEST_ZERO_MEASURE, digits=2)
