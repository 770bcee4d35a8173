"""Workspace: what an output reaches under constraints, its border, area and margins.

What the analysis `workspace` shows: borders, margins and turns on the sphere.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from spherekit.plugin import (
    INPUTS,
    AbstractAnalysis,
    AnalysisError,
    Batch,
    Column,
    Findings,
    Floats,
    Mark,
    Mechanism,
    Needs,
    Primitive,
    Scene,
    SphereCurves,
    SphereMap,
    Surface,
    Sweep,
    Table,
    TableData,
    Text,
    input_columns,
    numbered,
)
from spherekit.plugin.designs import FigureOfMerit
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
    closed_kinematics,
    direction_workspaces,
    judge,
    label_of,
    nearest_reachable,
    orientation_samples,
    orientation_workspaces,
    sphere_mesh,
)

from .common import (
    DIRECTION_COLUMNS,
    MID_PLANE_COLUMNS,
    POSE_COLUMNS,
    WORKING_MODE,
    direction_or_quaternion_columns,
)
from .inverse_kinematics.pose_lists import read_poses
from .output_poses import nearest_at, read_apart, read_limit, shown

ROWS = 24
COLUMNS = 48
TORSIONS = 36
"""Tilts, azimuths and torsions at which orientations are drawn."""
COARSE = 1e-2
"""Relative error of the volume of a set of orientations, if nothing else is asked for."""
FINE = 1e-4
"""Relative error of the area of a set of directions, if nothing else is asked for."""
UNDEFINED = "the output is not determined"
"""Name of a border where no bound is 0."""
AREA = "sr or sr rad"
"""The unit of a set of directions, or of orientations."""

Row = dict[str, Any]


class Reached:
    """What an output reaches under limits of angles in some modes, and how poses fare.

    `names` are those of the limits by their numbers, with that of none; `poses` (k, 3) or
    (k, 4) are to be judged. Faults of what is `asked` are raised when it is made.
    """

    def __init__(self, mechanism: Mechanism, asked: "WorkspaceAnalysis") -> None:
        self.mechanism = mechanism
        self.kinematics = closed_kinematics(mechanism, asked.output or None)
        self.tolerance = asked.tolerance or (FINE if self.kinematics.points else COARSE)
        wanted = Constraints(
            tuple(map(read_limit, asked.limits)),
            tuple(map(read_apart, asked.apart)),
            float(np.radians(asked.near)),
            asked.width,
            asked.radius,
        )
        self.bounds = bounds_of(self.kinematics, wanted)
        self.names = [bound.name for bound in self.bounds] + [UNDEFINED]
        self.modes = self.kinematics.chosen_modes(asked.working_mode)
        self.poses = given_poses(asked.pose, self.kinematics)

    @cached_property
    def workspaces(self) -> Sequence[DirectionWorkspace | OrientationWorkspace]:
        """Those of all modes."""
        find = direction_workspaces if self.kinematics.points else orientation_workspaces
        return find(self.kinematics, self.bounds, self.modes, self.tolerance)

    @cached_property
    def samples(self) -> dict[tuple[int, ...], tuple[Judged, Floats]]:
        """How vertices, or orientations spread evenly, fare in each mode, and these."""
        made = {}
        for item in self.workspaces:
            places = (
                item.region.points
                if isinstance(item, DirectionWorkspace)
                else orientation_samples()
            )
            made[item.signs] = self.judge(item, places), places
        return made

    def judge(
        self, item: DirectionWorkspace | OrientationWorkspace, places: Floats
    ) -> Judged:
        """Return how places (n, 3) or (n, 4) fare in the working mode of a workspace."""
        return judge(self.kinematics, self.bounds, item.signs, places)

    def rows(self) -> dict[str, list[Row]]:
        """Return samples, borders and sizes of all modes by table."""
        rows: dict[str, list[Row]] = {"workspace": [], "boundary": [], "areas": []}
        for item in self.workspaces:
            mode = {"working_mode": label_of(item.signs)}
            judged, places = self.samples[item.signs]
            rows["workspace"].append(
                {
                    **mode,
                    **direction_or_quaternion_columns(places, self.kinematics.form),
                    "inside": np.where(judged.inside, "yes", "no"),
                    "margin": judged.margin,
                    "limiting": np.array(self.names)[judged.limiting],
                    **input_columns(self.mechanism, judged.inputs),
                    "type_1": judged.type_1,
                    "type_2": judged.type_2,
                }
            )
            rows["areas"].append(mode | self._sizes(item))
            if isinstance(item, DirectionWorkspace):
                rows["boundary"] += [
                    {
                        **mode,
                        "curve": curve,
                        "component": boundary.component,
                        "gap": boundary.gap,
                        "arc": number,
                        "point": np.arange(len(arc.points)),
                        **direction_or_quaternion_columns(arc.points, self.kinematics.form),
                        "constraint": self.names[arc.margin],
                    }
                    for curve, boundary in enumerate(item.region.boundaries)
                    for number, arc in enumerate(boundary.arcs)
                ]
        return rows

    def _sizes(self, item: DirectionWorkspace | OrientationWorkspace) -> Row:
        """Return the size of the whole, and of each part and hole of directions."""
        parts: list[tuple[str, int, float, tuple[int, ...], Floats]]
        if isinstance(item, DirectionWorkspace):
            region = item.region
            error = region.error
            parts = [("whole", 0, region.area, (), np.full(3, np.nan))]
            for k, part in enumerate(region.components):
                parts.append(("component", k, part.area, part.boundaries, part.place))
            for k, part in enumerate(region.gaps):
                parts.append(
                    ("hole" if k else "outside", k, part.area, part.boundaries, part.place)
                )
        else:
            whole = item.orientations
            error = whole.error
            parts = [("whole", 0, whole.volume, (), whole.place)]
        kinds, numbers, sizes, curves, at = zip(*parts, strict=True)
        places = np.array(at)
        return {
            "part": kinds,
            "number": numbers,
            "size": sizes,
            "error": error,
            "curves": [" ".join(map(str, touching)) for touching in curves],
            **direction_or_quaternion_columns(places, self.kinematics.form),
            "margin": self.judge(item, places).margin + 0.0 * places[:, 0],
        }

    def told(self, item: DirectionWorkspace | OrientationWorkspace) -> tuple[Row, str]:
        """Return the figures of a mode, and what is to be heeded."""
        if isinstance(item, DirectionWorkspace):
            figures, warning = self._of_region(item.region)
        else:
            figures, warning = self._of_orientations(item)
        if item.same_as is not None:
            figures["same_as"], warning = label_of(item.same_as), ""
        return figures, warning

    def _of_region(self, region: Region) -> tuple[Row, str]:
        figures: Row = {
            "area_sr": region.area,
            "error_sr": region.error,
            "components": [part.area for part in sure_of(region, region.components)],
            "holes": [part.area for part in sure_of(region, region.holes)],
            "unresolved_sr": region.unresolved,
            "bounded_by": [self.names[number] for number in arcs_of(region)],
            "evaluations": region.evaluations,
        }
        if not region.components:
            figures["excluding"] = sets = [
                " with ".join(self.names[k] for k in subset) for subset in region.excluding
            ]
            keeps = f"; no direction keeps to {', nor to '.join(sets)}" if sets else ""
            return figures, f"the workspace is empty{keeps}"
        if region.error > self.tolerance * region.area:
            return figures, (
                f"the area {region.area:.9g} sr is known to {region.error:.3g} sr only; "
                "borders touch, or end at sharp corners"
            )
        return figures, ""

    def _of_orientations(self, item: OrientationWorkspace) -> tuple[Row, str]:
        size = item.orientations
        figures: Row = {
            "volume": size.volume,
            "error": size.error,
            "fraction": size.fraction,
            "evaluations": size.evaluations,
        }
        if size.depth < 0.0:
            here = self.judge(item, size.place[None])
            figures["nearest_limit"] = self.names[int(here.limiting[0])]
            return figures, (
                "no orientation was found inside; the best one seen misses "
                f"{figures['nearest_limit']} by {-np.degrees(here.margin[0]):.3g} deg"
            )
        if size.error > self.tolerance * size.volume:
            return (
                figures,
                f"the volume {size.volume:.6g} is known to {size.error:.3g} only",
            )
        return figures, ""

    def how_poses_fare(self) -> tuple[list[Row], list[str], list[str]]:
        """Return how each pose fares in each mode, with the nearest one that is reached.

        And what to warn of, and what to say.
        """
        figures: list[Row] = []
        warnings = list[str]()
        said = list[str]()
        if not len(self.poses):
            warnings.append("pose: the mechanism does not close at these inputs")
        for place in self.poses:
            told: dict[tuple[bool, str], list[str]] = {}
            for item in self.workspaces:
                here = self.judge(item, place[None])
                label = label_of(item.signs)
                limit = self.names[int(here.limiting[0])]
                is_inside = bool(here.inside[0])
                row: Row = {
                    "pose": place.tolist(),
                    "working_mode": label,
                    "inside": "yes" if is_inside else "no",
                    "margin_rad": _numbers(here.margin)[0],
                    "limiting": limit,
                    "inputs": _numbers(here.inputs[0]),
                    "type_1": _numbers(here.type_1)[0],
                    "type_2": _numbers(here.type_2)[0],
                }
                text = f"{np.degrees(here.margin[0]):.4g} deg from {limit}"
                if not is_inside:
                    text = f"by {limit}"
                    nearest = nearest_reachable(self.kinematics, self.bounds, item, place)
                    if nearest is not None:
                        there, away = nearest
                        row |= {
                            "away_rad": away,
                            "nearest": there.tolist(),
                            "nearest_inputs": _numbers(
                                self.judge(item, there[None]).inputs[0]
                            ),
                        }
                        text += f"; {nearest_at(there, away)}"
                figures.append(row)
                told.setdefault((is_inside, text), []).append(label)
            for (is_inside, text), labels in told.items():
                state = "inside" if is_inside else "outside"
                modes = ", ".join(labels)
                words = f"pose {shown(place)} is {state} in mode {modes}, {text}"
                (said if is_inside else warnings).append(words)
        return figures, warnings, said

    def pages(self) -> tuple[Scene, ...]:
        """Return a page or two for each workspace that is not that of another mode."""
        pages: list[Scene] = []
        distinct = [item for item in self.workspaces if item.same_as is None]
        for item in distinct:
            mode = "" if len(distinct) == 1 else f" {label_of(item.signs)}"
            if isinstance(item, DirectionWorkspace):
                pages += self._of_directions(item, mode)
            else:
                pages.append(self._of_all_turns(item, f"Workspace{mode}"))
        return tuple(pages)

    def _of_directions(self, item: DirectionWorkspace, mode: str) -> list[Scene]:
        """Return the page of the margin and that of the singularity measures."""
        places = item.region.surface_points
        triangles = item.region.surface_triangles
        border = *self._curves(item.region), self._words(item)
        if not len(triangles):
            return [Scene(f"Workspace{mode}", border)]
        at = self.judge(item, places)
        margin = np.maximum(np.nan_to_num(at.margin), 0.0)
        angle = np.arcsin(np.clip(np.nan_to_num(np.fmin(at.type_1, at.type_2)), 0.0, 1.0))
        judged, vertices = self.samples[item.signs]
        best = np.nanargmax(judged.margin)
        words = f"farthest inside, {np.degrees(judged.margin[best]):.3g} deg"
        mark = Mark(words, vertices[best])
        deepest = SphereCurves("workspace/deepest", words, (), 0, [mark])
        return [
            Scene(
                f"{title}{mode}",
                (
                    SphereMap("workspace/map", name, places, triangles, values, "rad"),
                    *border,
                    deepest,
                ),
            )
            for title, name, values in (
                ("Workspace", "margin", margin),
                ("Singularity", "angle to a singularity", angle),
            )
        ]

    def _of_all_turns(self, item: OrientationWorkspace, title: str) -> Scene:
        """Return the turns reached about each direction of the z axis, and all margins.

        The margins are in the space of tilt and torsion, tilts as polar coordinates.
        """
        vertices, triangles = sphere_mesh(COLUMNS, ROWS)
        torsion = 2.0 * np.pi * np.arange(TORSIONS) / TORSIONS
        tilted = np.repeat(azimuth_tilt(vertices), TORSIONS, axis=0)
        angles = np.column_stack([tilted, np.tile(torsion, len(vertices))])
        inside = self.judge(item, quaternion(from_tilt_torsion(angles))).inside
        reached = 2.0 * np.pi * inside.reshape(-1, TORSIONS).mean(axis=1)
        seen: list[Primitive] = [
            SphereMap("workspace/map", "turn about z", vertices, triangles, reached, "rad")
        ]
        judged, places = self.samples[item.signs]
        if np.any(judged.inside):
            azimuth, tilt, turn = tilt_torsion(from_quaternion(places[judged.inside])).T
            seen.append(
                Surface(
                    "workspace/margins",
                    "margin of orientations",
                    np.stack([tilt * np.cos(azimuth), tilt * np.sin(azimuth), turn], 1),
                    np.zeros((0, 3), dtype=np.int64),
                    ("tilt to x", "tilt to y", "torsion"),
                    unit="rad",
                    values=judged.margin[judged.inside],
                    values_unit="rad",
                )
            )
        return Scene(title, (*seen, self._words(item)))

    def _curves(self, region: Region) -> list[Primitive]:
        """Return the border by the limits that end it, each named on its longest arc."""
        curves: list[Primitive] = []
        for tone, (number, arcs) in enumerate(arcs_of(region).items(), 1):
            name = self.names[number]
            longest = max(arcs, key=len)
            mark = Mark(name.partition(" (")[0], longest[len(longest) // 2], tone)
            path = f"workspace/border/{number + 1}"
            curves.append(SphereCurves(path, name, arcs, tone, [mark]))
        return curves

    def _words(self, item: DirectionWorkspace | OrientationWorkspace) -> Text:
        """Return what is told of a workspace, as Markdown."""
        figures, warning = self.told(item)
        lines = (
            f"# Workspace of {self.kinematics.output.name}",
            f"Mode {label_of(item.signs)}: {_in_words(figures)}.",
            warning,
            f"Signs of a mode: {'; '.join(self.kinematics.legs)}.",
        )
        return Text("legend", "Areas", "\n\n".join(lines))


def arcs_of(region: Region) -> dict[int, list[Floats]]:
    """Return the arcs of the border by the numbers of the limits that end it."""
    arcs: dict[int, list[Floats]] = {}
    for boundary in region.boundaries:
        for arc in boundary.arcs:
            arcs.setdefault(arc.margin, []).append(arc.points)
    return dict(sorted(arcs.items()))


def _numbers(values: Floats) -> list[float | None]:
    """Return numbers ready for JSON, None for NaN."""
    return [value if np.isfinite(value) else None for value in values.tolist()]


def sure_of(region: Region, parts: Sequence[Part]) -> list[Part]:
    """Return the parts larger than what is not resolved, which can be parts of others."""
    return [part for part in parts if part.area > region.unresolved]


def given_poses(text: str, kinematics: ClosedKinematics) -> Floats:
    """Return the poses (k, 3) or (k, 4) that a text says, none of an empty one."""
    if not text:
        return np.empty((0, 3))
    poses, inputs, _ = read_poses(kinematics, "workspace", text.split("+"), called="pose")
    if inputs is not None:
        solutions = kinematics.forward(inputs)
        poses = solutions.directions if kinematics.points else solutions.rotations
    assert poses is not None
    places = poses if kinematics.points else quaternion(poses)
    _, first = np.unique(places, axis=0, return_index=True)
    return places[np.sort(first)]


@dataclass(frozen=True, kw_only=True)
class WorkspaceAnalysis(AbstractAnalysis):
    """Directions or orientations that an output reaches in a working mode.

    `output` is its name, if several are declared. `mode` is the signs of one mode, such as
    ``+-``, or its number; by default all modes. Angles are in degrees: `limits` of pairs
    are ``PAIR:LOW:HIGH``, beside the joint limits of the mechanism; `apart` are angles
    between the axes of two pairs, ``PAIR/PAIR:LEAST`` or ``PAIR/PAIR:LEAST:GREATEST``;
    `near` is the least angle to a singularity of type I or II. Links of a `width` on a
    sphere of a `radius`, in the same unit of length, are kept from touching. `tolerance` is
    the relative error of the area or volume, by default 1e-4 of directions and 1e-2 of
    orientations. `pose` is judged: ``name=number+name=number`` of x, y, z or azimuth, tilt
    of a direction; azimuth, tilt, torsion, qx, qy, qz, qw or rx, ry, rz of an orientation;
    phi, gamma; or all driven pairs.
    """

    name = "workspace"
    version = "1"
    summary = "what an output reaches under constraints, with its area"
    cites = (
        "C. Gosselin and J. Angeles, IEEE Trans. Robotics and Automation 6(3), 1990",
        "Z. Chen et al., 2021, doi 10.21203/rs.3.rs-258461",
    )
    reads_samples = False
    tables = (
        Table(
            "workspace",
            "one row per mode and sample, inside and outside",
            (
                WORKING_MODE,
                *POSE_COLUMNS,
                Column("inside", "", "yes or no", "text"),
                Column("margin", "rad", "left to the nearest limit, negative outside"),
                Column("limiting", "", "that limit", "text"),
                INPUTS,
                Column("type_1", "", "least measure of type I, 0 at a singularity"),
                Column("type_2", "", "measure of type II, 0 at a singularity"),
            ),
        ),
        Table(
            "boundary",
            "one row per point of the border of directions, the workspace to its left",
            (
                WORKING_MODE,
                Column("curve", "", "number of the closed curve", "integer"),
                Column("component", "", "the part of the workspace beside it", "integer"),
                Column("gap", "", "the part of the outside beside it", "integer"),
                Column("arc", "", "number of the smooth arc in its curve", "integer"),
                Column("point", "", "number of the point in its arc", "integer"),
                *DIRECTION_COLUMNS,
                *MID_PLANE_COLUMNS,
                Column("constraint", "", "the limit that ends the workspace", "text"),
            ),
        ),
        Table(
            "areas",
            "one row per mode for the whole, and for each part and hole",
            (
                WORKING_MODE,
                Column("part", "", "whole, component, hole or outside", "text"),
                Column("number", "", "of the part, the largest first", "integer"),
                Column("size", AREA, "area, or volume of all 8 pi^2 orientations"),
                Column("error", AREA, "bound of its error"),
                Column("curves", "", "numbers of the curves around it", "text"),
                *POSE_COLUMNS,
                Column("margin", "rad", "at this sample, well within the part"),
            ),
        ),
    )

    trades = (
        Sweep(
            "tolerance",
            (1e-2, 1e-3, 1e-4, 1e-5),
            "areas",
            "size",
            ("working_mode", "part"),
            "error",
        ),
    )

    output: str = ""
    working_mode: str = ""
    limits: tuple[str, ...] = ()
    apart: tuple[str, ...] = ()
    near: float = 0.0
    width: float = 0.0
    radius: float = 0.0
    tolerance: float = 0.0
    pose: str = ""

    def merits(self, mechanism: Mechanism) -> tuple[FigureOfMerit, ...]:
        """Return the area, or volume, of the whole workspace in each working mode."""
        del mechanism
        size = FigureOfMerit(
            "workspace_area",
            "max",
            "size",
            table="workspace.areas",
            meaning="sr, or the volume of orientations",
            only=(("part", "whole"),),
        )
        return (size,)

    def needs(self, mechanism: Mechanism) -> Needs:
        """Return nothing: poses are given, not traced. Bad parameters are refused here."""
        if not 0.0 <= self.tolerance < 1.0:
            raise AnalysisError(
                f"workspace: tolerance: {self.tolerance:g} is not a relative error; "
                f"give one "
                "above 0 and below 1, or 0 for the default"
            )
        Reached(mechanism, self)
        return Needs()

    def compute(self, batch: Batch) -> Mapping[str, TableData]:
        """Return samples, border and areas."""
        rows = self._reached(batch).rows()
        return {
            table.name: table.stacked(batch.mechanism, rows[table.name])
            for table in self.tables
        }

    def findings(self, batch: Batch) -> Findings:
        """Return area, parts and limits of each mode, and how the pose fares."""
        reached = self._reached(batch)
        warnings: list[str] = []
        modes: dict[str, Any] = {}
        for item in reached.workspaces:
            label = label_of(item.signs)
            modes[label], warning = reached.told(item)
            if warning:
                warnings.append(f"mode {label}: {warning}")
        figures: dict[str, Any] = {
            "output": reached.kinematics.output.name,
            "legs": list(reached.kinematics.legs),
            "limits": [bound.name for bound in reached.bounds],
            "working_modes": modes,
        }
        alike: dict[str, list[str]] = {}
        for label, facts in modes.items():
            alike.setdefault(facts.get("same_as", label), []).append(label)
        remarks = [
            f"{numbered('mode', labels)}: {'each ' * (len(labels) > 1)}"
            f"{_in_words(modes[first])}"
            for first, labels in alike.items()
        ]
        if self.pose:
            figures["pose"], words, said = reached.how_poses_fare()
            warnings += words
            remarks += said
        return Findings(figures, tuple(warnings), tuple(remarks))

    def scene(self, batch: Batch) -> tuple[Scene, ...]:
        """Return a page for each set: of directions its border, margin and measures.

        Of orientations how far the link can turn about each direction, and the margin.
        """
        return self._reached(batch).pages()

    def _reached(self, batch: Batch) -> Reached:
        return batch.once("reached", lambda: Reached(batch.mechanism, self))


def _in_words(figures: Row) -> str:
    """Return what the findings of a mode say in a line."""
    if "volume" in figures:
        if not figures["error"] and figures["fraction"] > 0.5:
            return "the whole volume, all orientations"
        return (
            f"volume {figures['volume']:.6g} +- {figures['error']:.1g}, "
            f"{figures['fraction']:.1%} of all orientations (8 pi^2)"
        )
    return (
        f"area {figures['area_sr']:.8g} +- {figures['error_sr']:.1g} sr, parts "
        f"{len(figures['components'])}, holes {len(figures['holes'])}, bounded by "
        f"{', '.join(figures['bounded_by']) or 'nothing'}"
    )
