"""Workspaces of all working modes of an output: tables, summary, and scenes."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from spherekit.plugin import (
    Floats,
    Mark,
    Mechanism,
    Primitive,
    Scene,
    ScreenColumn,
    ScreenTable,
    SphereCurves,
    SphereMap,
    Surface,
    Text,
    degrees_text,
    input_columns,
    number_text,
)
from spherekit.plugin.rotations import (
    azimuth_tilt,
    from_quaternion,
    from_tilt_torsion,
    quaternion,
    tilt_torsion,
)
from spherekit.plugin.workspace import (
    ClosedKinematics,
    Constraints,
    DirectionWorkspace,
    Judged,
    OrientationWorkspace,
    Part,
    Region,
    bounds_of,
    direction_workspaces,
    judge,
    label_of,
    nearest_reachable,
    orientation_samples,
    orientation_workspaces,
    sphere_mesh,
)

from .common import direction_or_quaternion_columns
from .inverse_kinematics.pose_lists import read_poses
from .output_poses import describe_nearest_pose, format_pose

DRAWN_TILTS = 24
"""Number of tilts at which orientations are drawn. Larger: smoother, slower drawings."""
DRAWN_AZIMUTHS = 48
"""Number of azimuths at which orientations are drawn."""
DRAWN_TORSIONS = 36
"""Number of torsions at which orientations are drawn, at each tilt and azimuth."""
POSE_DECIMALS = 9
"""Decimals to which equal poses agree. Larger: rounding errors make equal poses differ;
smaller: close poses are taken for equal."""
NO_LIMIT_NAME = "the output is not determined"
"""Name of a border at which no limit is reached."""

Workspace = DirectionWorkspace | OrientationWorkspace
"""The workspace of one working mode."""
Columns = dict[str, Any]
"""Columns of a table, or a record of the summary."""


@dataclass(frozen=True)
class PoseSamples:
    """Sampled poses inside and outside of a workspace.

    Attributes
    ----------
    poses
        (n, 3) directions, or (n, 4) unit quaternions xyzw.
    judged
        The margins (angles to the limits) of the poses, and their measures of
        singularities.
    """

    poses: Floats
    judged: Judged


@dataclass(frozen=True)
class DistinctPoses:
    """Poses that the user names, without repeated ones.

    Attributes
    ----------
    poses
        (k, 3) directions, or (k, 4) unit quaternions xyzw of orientations; (0, 3) if the
        user names no pose.
    warnings
        Sentences about inputs without a pose.
    """

    poses: Floats
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class PoseFindings:
    """Which of the user's poses are inside the workspace, for the summary and in words.

    Attributes
    ----------
    records
        Entry of the summary about each pose in each working mode.
    warnings, remarks
        Sentences about poses outside and inputs without a pose, and about poses inside.
    """

    records: list[Columns]
    warnings: list[str]
    remarks: list[str]


class WorkspaceModes:
    """The workspaces of an output under constraints in some working modes.

    Parameters
    ----------
    mechanism, kinematics
        The mechanism, and the inverse kinematics of its output in closed form.
    constraints
        Constraints in addition to the reach of the legs.
    modes
        Signs of the legs in each working mode.
    poses
        The poses that are examined.
    tolerance
        Error of areas and volumes to aim at, relative to the area or volume.

    Attributes
    ----------
    bounds
        The limits that end the workspace.
    limit_names
        Names of the limits by their indices. The last name, with index -1, stands for no
        limit.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        kinematics: ClosedKinematics,
        constraints: Constraints,
        modes: Sequence[tuple[int, ...]],
        poses: DistinctPoses,
        tolerance: float,
    ) -> None:
        """Store the arguments, and list the limits of the output.

        Legs (chains of links) join the output to the base. The mechanism has limits,
        such as how far its legs extend, and `constraints` has further limits. The
        workspace of each working mode is computed when it is first used.

        Parameters
        ----------
        mechanism, kinematics
            The mechanism, and the inverse kinematics of its output in closed form.
        constraints
            Limits in addition to those of the mechanism.
        modes
            Signs, 1 or -1, of the legs in each working mode (way to assemble the legs at a
            pose).
        poses
            For each of these poses, the modes in which the output reaches it are reported.
        tolerance
            Desired error of areas and volumes, relative to the area or volume.
        """
        self.mechanism = mechanism
        self.kinematics = kinematics
        self.limits = bounds_of(kinematics, constraints)
        # Borders of a workspace have the index of the limit that is reached there. Borders
        # that consist of singularities reach no limit. Their index -1 selects the last
        # name.
        self.limit_names = [limit.name for limit in self.limits] + [NO_LIMIT_NAME]
        self.modes = modes
        self.poses = poses
        self.tolerance = tolerance

    @cached_property
    def workspaces(self) -> Sequence[Workspace]:
        """The workspace of each mode."""
        find_workspaces: Callable[..., Sequence[Workspace]] = orientation_workspaces
        if self.kinematics.points:
            find_workspaces = direction_workspaces
        return find_workspaces(self.kinematics, self.limits, self.modes, self.tolerance)

    @cached_property
    def samples(self) -> dict[tuple[int, ...], PoseSamples]:
        """Sampled poses of each workspace, by the signs of its working mode.

        The samples of a set of directions are the vertices of its mesh. Those of a set of
        orientations are spread evenly over all orientations.
        """
        samples: dict[tuple[int, ...], PoseSamples] = {}
        for workspace in self.workspaces:
            if isinstance(workspace, DirectionWorkspace):
                poses = workspace.region.points
            else:
                poses = orientation_samples()
            samples[workspace.signs] = PoseSamples(poses, self.judge(workspace, poses))
        return samples

    def judge(self, workspace: Workspace, poses: Floats) -> Judged:
        """Return margins and measures of poses (n, 3) or (n, 4) in a workspace's mode."""
        return judge(self.kinematics, self.limits, workspace.signs, poses)

    def table_parts(self) -> dict[str, list[Columns]]:
        """Return the tables of samples, borders and sizes of all working modes, by name."""
        parts: dict[str, list[Columns]] = {"workspace": [], "boundary": [], "areas": []}
        for workspace in self.workspaces:
            mode = {"working_mode": label_of(workspace.signs)}
            parts["workspace"].append(mode | self._sample_columns(workspace))
            parts["areas"].append(mode | self._size_columns(workspace))
            if isinstance(workspace, DirectionWorkspace):
                for columns in self._border_columns(workspace.region):
                    parts["boundary"].append(mode | columns)
        return parts

    def _sample_columns(self, workspace: Workspace) -> Columns:
        """Return the columns of the sampled poses, with their margins and measures."""
        samples = self.samples[workspace.signs]
        judged = samples.judged
        return {
            **direction_or_quaternion_columns(samples.poses, self.kinematics.form),
            "inside": np.where(judged.inside, "yes", "no"),
            "margin": judged.margin,
            "limiting": np.array(self.limit_names)[judged.limiting],
            **input_columns(self.mechanism, judged.inputs),
            "type_1": judged.type_1,
            "type_2": judged.type_2,
        }

    def _name_of_limit(self, number: int) -> str:
        """Return the name of a limit at the border of a workspace.

        Limits are numbered from 0. The number -1 stands for a border that consists of
        singularities and reaches no limit.
        """
        return self.limit_names[number]

    def _border_columns(self, region: Region) -> list[Columns]:
        """Return the border of a set of directions, one part of the table for each arc.

        The output of one working mode reaches the directions of the set, `region`. The
        border consists of closed curves. A curve is divided into smooth arcs, and each arc
        has one limit of the mechanism that is reached there. A connected part of the set is
        called a component. A connected part of all other directions is called a gap. A
        curve separates one component from one gap, and the table has the numbers of both.
        """
        # None unless base and output are always mirror images in a plane, the mid-plane.
        # Each direction of the output then has one mid-plane, and the table has two angles
        # of its normal.
        mid_plane_architecture = self.kinematics.form
        columns = []
        for curve_number, curve in enumerate(region.boundaries):
            for arc_number, arc in enumerate(curve.arcs):
                columns.append(
                    {
                        "curve": curve_number,
                        "component": curve.component,
                        "gap": curve.gap,
                        "arc": arc_number,
                        "point": np.arange(len(arc.points)),
                        # x, y, z of the directions (k, 3), and the angles of mid-planes.
                        **direction_or_quaternion_columns(
                            arc.points, mid_plane_architecture
                        ),
                        # `margin` is the index of the limit that is reached on the arc.
                        "constraint": self._name_of_limit(arc.margin),
                    }
                )
        return columns

    def _size_columns(self, workspace: Workspace) -> Columns:
        """Return the sizes of a workspace and of its parts as columns of a table.

        The first row is the whole workspace. For directions, the connected parts of the
        workspace follow, then the gaps: connected sets of directions that the output does
        not reach. The largest gap is called outside, the others holes.

        Each part or gap has a sample: the pose that is farthest from its border. The margin
        of a sample is the angle (rad) to the nearest limit. The margin is negative in gaps.

        The whole set of directions has no sample (NaN). A set of orientations is not
        divided into parts, so its only row has the sample.

        The column `number` is the position of a part in `region.components`, or of a gap in
        `region.gaps`.
        """
        # Each list has one item for each row of the table.
        kinds = ["whole"]
        numbers = [0]
        curves: list[Sequence[int]] = [()]
        if isinstance(workspace, DirectionWorkspace):
            region = workspace.region
            error = region.error
            sizes = [region.area]
            samples = [np.full(3, np.nan)]
            kinds += ["component"] * len(region.components)
            numbers += range(len(region.components))
            # Gap 0 is the largest one.
            for gap_number in range(len(region.gaps)):
                kinds.append("outside" if gap_number == 0 else "hole")
                numbers.append(gap_number)
            for part in [*region.components, *region.gaps]:
                sizes.append(part.area)
                curves.append(part.boundaries)
                samples.append(part.place)
        else:
            orientations = workspace.orientations
            error = orientations.error
            sizes = [orientations.volume]
            samples = [orientations.place]
        poses = np.array(samples)
        has_sample = ~np.isnan(poses[:, 0])
        margin = np.where(has_sample, self.judge(workspace, poses).margin, np.nan)
        return {
            "part": kinds,
            "number": numbers,
            "size": sizes,
            "error": error,
            # The curves around a part, such as "0 2".
            "curves": [" ".join(map(str, numbers_of_part)) for numbers_of_part in curves],
            **direction_or_quaternion_columns(poses, self.kinematics.form),
            "margin": margin,
        }

    def summarize(self, workspace: Workspace) -> tuple[Columns, str]:
        """Return the summary entry of a working mode, and a warning or an empty text."""
        if isinstance(workspace, DirectionWorkspace):
            record, warning = self._summarize_directions(workspace.region)
        else:
            record, warning = self._summarize_orientations(workspace)
        if workspace.same_as is not None:
            # The mode with the same workspace has the warning.
            record["same_as"] = label_of(workspace.same_as)
            warning = ""
        return record, warning

    def _summarize_directions(self, region: Region) -> tuple[Columns, str]:
        """Return the summary of a set of directions, and a warning or an empty text.

        There is a warning if no direction is inside, or if the area is less accurate than
        the tolerance.

        The area is measured with a mesh of triangles on the unit sphere. ``unresolved_sr``
        is the area (sr) of triangles with too much detail, such as borders that touch. The
        bound of the error, ``error_sr``, includes this area. ``components`` and ``holes``
        list the areas of connected parts of the set, and of holes in it, if they are larger
        than ``unresolved_sr``. ``bounded_by`` names the limits that are reached on the
        border. ``evaluations`` is the number of directions that were tested.

        If no direction is inside, ``excluding`` lists the smallest sets of limits that no
        direction satisfies together.
        """
        record: Columns = {
            "area_sr": region.area,
            "error_sr": region.error,
            "components": [part.area for part in resolved_parts(region, region.components)],
            "holes": [part.area for part in resolved_parts(region, region.holes)],
            "unresolved_sr": region.unresolved,
            "bounded_by": [self.limit_names[number] for number in arcs_by_limit(region)],
            "evaluations": region.evaluations,
        }
        if not region.components:
            # `limits` has indices of limits, such as (0, 2).
            excluding = [
                " with ".join(self.limit_names[number] for number in limits)
                for limits in region.excluding
            ]
            record["excluding"] = excluding
            # A workspace can be hidden in unresolved triangles.
            if region.unresolved > 0.0:
                warning = (
                    "no direction was found inside the workspace, whose area is at most "
                    f"{region.area + region.error:.3g} sr"
                )
                satisfies = "was found that satisfies"
            else:
                warning = "the workspace is empty"
                satisfies = "satisfies"
            if excluding:
                joined = f", and none {satisfies} ".join(excluding)
                warning += f"; no direction {satisfies} {joined}"
            return record, warning
        if region.error > self.tolerance * region.area:
            warning = (
                f"the area {region.area:.9g} sr is accurate to only {region.error:.3g} sr"
            )
            if region.unresolved > 0.0:
                warning += ", because borders touch, are close or end at sharp corners"
            return record, warning
        return record, ""

    def _summarize_orientations(
        self, workspace: OrientationWorkspace
    ) -> tuple[Columns, str]:
        """Return the summary of a set of orientations, and a warning or an empty text.

        An orientation is inside if all its margins (angles to the limits of the mechanism)
        are at least 0. There is a warning if no orientation is inside, or if the error of
        the volume exceeds the tolerance.
        """
        orientations = workspace.orientations
        record: Columns = {
            "volume": orientations.volume,
            "error": orientations.error,
            # The volume as a fraction of the volume of all orientations.
            "fraction": orientations.fraction,
            # Number of orientations whose margins were computed.
            "evaluations": orientations.evaluations,
        }
        # The depth is the smallest margin of the best orientation, `place`. With a negative
        # depth, all tested orientations are outside.
        if orientations.depth < 0.0:
            # The smallest margin of this orientation, and the index of the limit to
            # which it belongs.
            best = self.judge(workspace, orientations.place[None])
            record["nearest_limit"] = self.limit_names[int(best.limiting[0])]
            return record, (
                "no orientation was found inside the workspace; the best one exceeds "
                f"the limit {record['nearest_limit']} by "
                f"{-np.degrees(best.margin[0]):.3g} deg"
            )
        if orientations.error > self.tolerance * orientations.volume:
            return record, (
                f"the volume {orientations.volume:.6g} is accurate to only "
                f"{orientations.error:.3g}"
            )
        return record, ""

    def examine_poses(self) -> PoseFindings:
        """Return, for each pose, the working modes in which the output reaches the pose.

        A working mode is one way to assemble the legs, described by their signs. If a pose
        is outside of the workspace of a mode, the nearest reachable pose is stated.
        """
        findings = PoseFindings(records=[], warnings=list(self.poses.warnings), remarks=[])
        for pose in self.poses.poses:
            # Modes with the same sentence are listed together.
            labels_inside: dict[str, list[str]] = {}
            labels_outside: dict[str, list[str]] = {}
            for workspace in self.workspaces:
                record, text = self._examine_pose(workspace, pose)
                findings.records.append(record)
                is_inside = record["inside"] == "yes"
                labels = labels_inside if is_inside else labels_outside
                labels.setdefault(text, []).append(label_of(workspace.signs))
            pose_text = format_pose(pose)
            for text, modes in labels_inside.items():
                findings.remarks.append(
                    f"Pose {pose_text} is inside in mode {', '.join(modes)}, {text}"
                )
            for text, modes in labels_outside.items():
                findings.warnings.append(
                    f"Pose {pose_text} is outside in mode {', '.join(modes)}, {text}"
                )
        return findings

    def _examine_pose(self, workspace: Workspace, pose: Floats) -> tuple[Columns, str]:
        """Examine a pose in one working mode. Return its record, and its margin in words.

        A working mode is one way to assemble the legs. The margin is the angle (rad) to the
        nearest limit of the workspace, negative if the limit is exceeded. For a pose
        outside of the workspace the record includes the nearest reachable pose. ``type_1``
        and ``type_2`` are 0 at singularities of type I and II, and measure how far the pose
        is from them. At type I the output rests while an input moves. At type II the output
        can move while the inputs are locked.

        Parameters
        ----------
        workspace
            The workspace of the mode.
        pose
            (3,) direction or (4,) unit quaternion xyzw.

        Returns
        -------
        record
            The record for the summary.
        text
            End of a sentence. The sentence is "pose ... is inside in mode ..., and 3.2 deg
            from the limit: (a limit)", or "pose ... is outside in mode ..., because of the
            limit: (a limit)".
        """
        judged = self.judge(workspace, pose[None])
        limit = self.limit_names[int(judged.limiting[0])]
        is_inside = bool(judged.inside[0])
        record: Columns = {
            "pose": pose.tolist(),
            "working_mode": label_of(workspace.signs),
            "inside": "yes" if is_inside else "no",
            "margin_rad": _to_json_numbers(judged.margin)[0],
            "limiting": limit,
            "inputs": _to_json_numbers(judged.inputs[0]),
            "type_1": _to_json_numbers(judged.type_1)[0],
            "type_2": _to_json_numbers(judged.type_2)[0],
        }
        if is_inside:
            return record, (
                f"and {np.degrees(judged.margin[0]):.4g} deg from the limit: {limit}"
            )
        text = f"because of the limit: {limit}"
        nearest = nearest_reachable(self.kinematics, self.limits, workspace, pose)
        if nearest is not None:
            nearest_pose, distance = nearest
            nearest_judged = self.judge(workspace, nearest_pose[None])
            record["away_rad"] = distance
            record["nearest"] = nearest_pose.tolist()
            record["nearest_inputs"] = _to_json_numbers(nearest_judged.inputs[0])
            text += f"; {describe_nearest_pose(nearest_pose, distance)}"
        return record, text

    def scenes(self) -> tuple[Scene, ...]:
        """Return the pages of all working modes (ways to assemble the legs).

        A page shows the workspace of a mode. Modes with equal workspaces share this page. A
        workspace of directions also has a page with the angle to the nearest singularity.
        Each mode has its own page of this kind, because the angles of modes can differ.
        """
        pages: list[Scene] = []
        distinct_count = sum(workspace.same_as is None for workspace in self.workspaces)
        for workspace in self.workspaces:
            label = f" {label_of(workspace.signs)}"
            title = "Workspace" if distinct_count == 1 else f"Workspace{label}"
            if isinstance(workspace, DirectionWorkspace):
                suffix = "" if len(self.workspaces) == 1 else label
                pages += self._draw_directions(workspace, title, f"Singularity{suffix}")
            elif workspace.same_as is None:
                pages.append(self._draw_orientations(workspace, title))
        return tuple(pages)

    def _draw_directions(
        self, workspace: DirectionWorkspace, title: str, singularity_title: str
    ) -> list[Scene]:
        """Return two pages with maps of the directions that the output reaches.

        The first map shows the margin (angle to the nearest limit). The second map shows
        the angle to the nearest singularity. If an earlier mode has the same workspace, the
        first page is left out. If the output reaches no direction, the second page is left
        out, and the first one has no map.

        Parameters
        ----------
        workspace
            The directions that the output reaches in one working mode (way to assemble the
            legs).
        title, singularity_title
            Titles of the two pages.
        """
        region = workspace.region
        # A mesh with vertices (P, 3) and triangles (F, 3), which covers the set of
        # directions exactly up to the border.
        directions = region.surface_points
        triangles = region.surface_triangles
        border = (*self._draw_border(region), self._legend(workspace))
        if not len(triangles):
            return [Scene(title, border)] if workspace.same_as is None else []
        judged = self.judge(workspace, directions)
        # Near the border, rounding can make margins negative or NaN. These become 0.
        margin = np.maximum(np.nan_to_num(judged.margin), 0.0)
        # The distances to singularities are expressed as angles, and `type_1` and `type_2`
        # are their sines. At type I the output rests while an input moves. At type II the
        # output can move while the inputs are locked.
        least_measure = np.nan_to_num(np.fmin(judged.type_1, judged.type_2))
        singularity_angle = np.arcsin(np.clip(least_measure, 0.0, 1.0))
        # `samples` are the vertices of a mesh over the whole sphere. The vertex with the
        # largest margin is marked as the one farthest inside.
        samples = self.samples[workspace.signs]
        deepest = np.nanargmax(samples.judged.margin)
        deepest_margin = np.degrees(samples.judged.margin[deepest])
        deepest_label = f"farthest inside, {deepest_margin:.3g} deg"
        mark = Mark(deepest_label, samples.poses[deepest])
        # A mark without curves, in the colour 0.
        deepest_direction = SphereCurves("workspace/deepest", deepest_label, (), 0, [mark])
        maps = [(singularity_title, "angle to a singularity", singularity_angle)]
        if workspace.same_as is None:
            maps.insert(0, (title, "margin", margin))
        pages = []
        for page, quantity, values in maps:
            path = "workspace/map"
            sphere_map = SphereMap(path, quantity, directions, triangles, values, "rad")
            parts = (sphere_map, *border, deepest_direction)
            pages.append(Scene(page, parts))
        return pages

    def _draw_orientations(self, workspace: OrientationWorkspace, title: str) -> Scene:
        """Return the page of a set of orientations, with two drawings.

        An orientation is described by the direction of the z axis (azimuth and tilt) and
        the torsion, a rotation about this axis. The first drawing is a map on the sphere.
        For each direction of the z axis, it shows the total angle (rad) of the possible
        torsions, at most 2 pi.

        The second drawing shows each reachable sample as a point. Tilt and azimuth are
        polar coordinates, and the torsion is the height. The colour is the margin (angle to
        the nearest limit, rad).
        """
        # 1. Evenly spaced torsions are tested at each direction of the z axis. The fraction
        # of them in the workspace, times 2 pi, is the total angle.
        directions, triangles = sphere_mesh(DRAWN_AZIMUTHS, DRAWN_TILTS)
        torsions = 2.0 * np.pi * np.arange(DRAWN_TORSIONS) / DRAWN_TORSIONS
        tilts = np.repeat(azimuth_tilt(directions), DRAWN_TORSIONS, axis=0)
        angles = np.column_stack([tilts, np.tile(torsions, len(directions))])
        orientations = quaternion(from_tilt_torsion(angles))
        is_inside = self.judge(workspace, orientations).inside
        inside_fraction = is_inside.reshape(-1, DRAWN_TORSIONS).mean(axis=1)
        possible_rotation = 2.0 * np.pi * inside_fraction
        parts: list[Primitive] = [
            SphereMap(
                path="workspace/map",
                label="turn about z",
                vertices=directions,
                triangles=triangles,
                values=possible_rotation,
                unit="rad",
            )
        ]

        # 2. The orientations inside, as points without triangles.
        samples = self.samples[workspace.signs]
        is_inside = samples.judged.inside
        if np.any(is_inside):
            rotations = from_quaternion(samples.poses[is_inside])
            azimuth, tilt, torsion = tilt_torsion(rotations).T
            points = [tilt * np.cos(azimuth), tilt * np.sin(azimuth), torsion]
            parts.append(
                Surface(
                    path="workspace/margins",
                    label="margin of orientations",
                    vertices=np.stack(points, 1),
                    triangles=np.zeros((0, 3), dtype=np.int64),
                    axes=("tilt to x", "tilt to y", "torsion"),
                    unit="rad",
                    values=samples.judged.margin[is_inside],
                    values_unit="rad",
                )
            )
        return Scene(title, (*parts, self._legend(workspace)))

    def _draw_border(self, region: Region) -> list[Primitive]:
        """Return the border of a set of directions, drawn in one colour for each limit.

        The border consists of arcs. On each arc one limit is reached, such as that of a
        joint. The name of the limit is written at the middle of its longest arc. Colours
        are numbered from 1, because another mark has colour 0.
        """
        curves: list[Primitive] = []
        for colour, (limit_number, arcs) in enumerate(arcs_by_limit(region).items(), 1):
            name = self._name_of_limit(limit_number)
            longest = max(arcs, key=len)
            middle = longest[len(longest) // 2]
            # Marks have no room for the details of a limit in parentheses.
            short_name, _, _ = name.partition(" (")
            mark = Mark(short_name, middle, colour)
            # Limits are numbered from -1, paths in the recording from 0.
            path = f"workspace/border/{limit_number + 1}"
            curves.append(SphereCurves(path, name, arcs, colour, [mark]))
        return curves

    def _legend(self, workspace: Workspace) -> Text:
        """Return the summary of a workspace in Markdown."""
        record, warning = self.summarize(workspace)
        paragraphs = (
            f"# Workspace of {self.kinematics.output.name}",
            f"Mode {label_of(workspace.signs)}: {_describe_size(record)}.",
            warning,
            f"Signs of a mode: {'; '.join(self.kinematics.legs)}.",
        )
        return Text("legend", "Areas", "\n\n".join(paragraphs))


def arcs_by_limit(region: Region) -> dict[int, list[Floats]]:
    """Return the arcs of the border, points (k, 3) each, by the index of the limit."""
    arcs: dict[int, list[Floats]] = {}
    for boundary in region.boundaries:
        for arc in boundary.arcs:
            arcs.setdefault(arc.margin, []).append(arc.points)
    return dict(sorted(arcs.items()))


def _to_json_numbers(values: Floats) -> list[float | None]:
    """Return numbers (n,) ready for JSON, None for NaN and infinity."""
    return [value if np.isfinite(value) else None for value in values.tolist()]


def resolved_parts(region: Region, parts: Sequence[Part]) -> list[Part]:
    """Return the parts that are larger than the unresolved area.

    Smaller parts may be connected to other parts.
    """
    return [part for part in parts if part.area > region.unresolved]


def read_distinct_poses(text: str, kinematics: ClosedKinematics) -> DistinctPoses:
    """Read the poses that the user names, without repeated ones.

    The analysis reports for each of them whether it is in the workspace of the output.

    Parameters
    ----------
    text
        Poses, or inputs for which poses are computed. An example with two directions is
        ``azimuth=10+tilt=20+azimuth=30+tilt=5``. A name that occurs again begins the next
        pose. An empty text has no poses.
    kinematics
        The inverse kinematics of the output, which is a direction or an orientation.
    """
    if not text:
        return DistinctPoses(np.empty((0, 3)))
    # `points` states that the output is a direction.
    is_direction = kinematics.points
    pose_list = read_poses(kinematics, "workspace", text.split("+"), parameter="pose")
    # Either `poses` or `inputs` is None.
    poses = pose_list.poses
    warnings: list[str] = []
    if pose_list.inputs is not None:
        solutions = kinematics.forward(pose_list.inputs)
        poses = solutions.directions if is_direction else solutions.rotations
        input_pairs = kinematics.mechanism.input_pairs
        for row in np.setdiff1d(np.arange(len(pose_list.inputs)), solutions.row):
            inputs = ", ".join(
                f"{pair} = {degrees_text(float(q))} deg"
                for pair, q in zip(input_pairs, pose_list.inputs[row], strict=True)
            )
            warnings.append(f"No pose was found at the inputs {inputs}")
    assert poses is not None
    # Of poses that are equal up to rounding, only the first is kept. `unique` sorts the
    # poses, so the indices are sorted to get the original order.
    rounded = np.round(poses, POSE_DECIMALS)
    _, first_rows = np.unique(rounded, axis=0, return_index=True)
    poses = poses[np.sort(first_rows)]
    if not is_direction:
        poses = quaternion(poses)  # from rotations (k, 3, 3)
    return DistinctPoses(poses, tuple(warnings))


def _describe_size(record: Mapping[str, Any]) -> str:
    """Return the size of a workspace in words, from the record of the summary."""
    if "volume" in record:
        if not record["error"] and record["fraction"] > 0.5:
            return "the whole volume, all orientations"
        return (
            f"volume {record['volume']:.6g} +- {record['error']:.1g}, "
            f"{record['fraction']:.1%} of all orientations (8 pi^2)"
        )
    return (
        f"area {record['area_sr']:.8g} +- {record['error_sr']:.1g} sr, parts "
        f"{len(record['components'])}, holes {len(record['holes'])}, bounded by "
        f"{', '.join(record['bounded_by']) or 'nothing'}"
    )


def size_table(sizes: Sequence[tuple[Sequence[str], Mapping[str, Any]]]) -> ScreenTable:
    """Return the sizes of workspaces as a table for the screen.

    Sets of directions have an area, sets of orientations a volume.

    Parameters
    ----------
    sizes
        For each workspace the labels of its working modes (ways to assemble the legs), and
        its part of the summary.
    """
    has_volumes = any("volume" in record for _, record in sizes)
    rows: list[tuple[str, ...]] = []
    for labels, record in sizes:
        modes = ", ".join(labels)
        if has_volumes:
            volume = number_text(record["volume"])
            rows.append(
                (modes, volume, f"{record['error']:.1g}", f"{record['fraction']:.1%}")
            )
            continue
        share = record["area_sr"] / (4.0 * np.pi)
        rows.append(
            (
                modes,
                number_text(record["area_sr"]),
                f"{record['error_sr']:.1g}",
                f"{share:.1%}",
                str(len(record["components"])),
                str(len(record["holes"])),
                ", ".join(record["bounded_by"]) or "nothing",
            )
        )
    if has_volumes:
        headings = ["volume (rad^3)", "error", "share of all orientations"]
    else:
        headings = ["area (sr)", "error (sr)", "share of the sphere", "parts", "holes"]
    columns = [ScreenColumn("working mode")]
    columns += [ScreenColumn(heading, "right") for heading in headings]
    if not has_volumes:
        columns.append(ScreenColumn("border"))
    return ScreenTable(tuple(columns), tuple(rows))
