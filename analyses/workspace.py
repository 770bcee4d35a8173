"""Workspace: what an output reaches under constraints, its border, area and margins.

What the analysis `workspace` shows: borders, margins and turns on the sphere.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

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
    label_of,
    orientation_samples,
    orientation_workspaces,
    sphere_mesh,
)

from .equivalent_rotation import DIRECTION, MIRROR, MODE, PLACE, place_columns
from .pose_lists import read_poses
from .posed_workspace import (
    Limited,
    Row,
    Workspaces,
    how_poses_fare,
    read_apart,
    read_limit,
)

ROWS, COLUMNS, TORSIONS = 24, 48, 36
"""Tilts, azimuths and torsions at which orientations are drawn."""


@dataclass(frozen=True)
class WorkspaceScenes:
    """Pages about workspaces; `samples` are those of each mode, with how they fare."""

    limited: Limited
    workspaces: Sequence[DirectionWorkspace | OrientationWorkspace]
    samples: Mapping[tuple[int, ...], tuple[Judged, Floats]]

    def pages(self) -> tuple[Scene, ...]:
        """Return a page or two for each workspace that is not that of another mode."""
        pages = []
        distinct = [item for item in self.workspaces if item.same_as is None]
        for item in distinct:
            one = len(distinct) == 1
            title = "Workspace" if one else f"Workspace {label_of(item.signs)}"
            if isinstance(item, DirectionWorkspace):
                pages += self._pages(item, title)
            else:
                pages.append(self._of_all_turns(item, title))
        return tuple(pages)

    def _pages(self, item: DirectionWorkspace, title: str) -> list[Scene]:
        """Return the page of the margin and that of the singularity measures."""
        region = item.region
        curves = self._curves(region)
        words = Text("legend", "Areas", self._words(item))
        if not len(region.surface_triangles):
            return [Scene(title, (*curves, words))]
        places = region.surface_points
        at = self.limited.judge(item, places)
        margin = np.maximum(np.nan_to_num(at.margin), 0.0)
        angle = np.arcsin(np.clip(np.nan_to_num(np.fmin(at.type_1, at.type_2)), 0.0, 1.0))
        judged, vertices = self.samples[item.signs]
        best = int(np.nanargmax(judged.margin))
        deepest = Mark(f"{np.degrees(judged.margin[best]):.3g} deg", vertices[best])
        inside = SphereCurves("workspace/deepest", "farthest inside", (), 0, [deepest])

        def painted(name: str, values: Floats) -> SphereMap:
            triangles = region.surface_triangles
            return SphereMap("workspace/map", name, places, triangles, values, "rad")

        return [
            Scene(title, (painted("margin", margin), *curves, inside, words)),
            Scene(
                title.replace("Workspace", "Singularity"),
                (painted("angle to a singularity", angle), *curves, words),
            ),
        ]

    def _of_all_turns(self, item: OrientationWorkspace, title: str) -> Scene:
        """Return the turns reached about each direction of the z axis, and all margins.

        The margins are in the space of tilt and torsion, tilts as polar coordinates.
        """
        kinematics = self.limited.kinematics
        vertices, triangles = sphere_mesh(COLUMNS, ROWS)
        azimuth, tilt = azimuth_tilt(vertices).T
        torsion = 2.0 * np.pi * np.arange(TORSIONS) / TORSIONS
        angles = np.stack(
            [
                np.repeat(azimuth, TORSIONS),
                np.repeat(tilt, TORSIONS),
                np.tile(torsion, len(vertices)),
            ],
            axis=1,
        )
        inside = self.limited.judge(item, quaternion(from_tilt_torsion(angles))).inside
        reached = 2.0 * np.pi * inside.reshape(-1, TORSIONS).mean(axis=1)
        judged, places = self.samples[item.signs]
        within = judged.inside
        tilts = tilt_torsion(from_quaternion(places[within]))
        flat = tilts[:, 1:2] * np.stack([np.cos(tilts[:, 0]), np.sin(tilts[:, 0])], axis=1)
        seen: list[Primitive] = [
            SphereMap("workspace/map", "turn reached", vertices, triangles, reached, "rad")
        ]
        if np.any(within):
            seen.append(
                Surface(
                    "workspace/margins",
                    "margin of orientations",
                    np.column_stack([flat, tilts[:, 2]]),
                    np.zeros((0, 3), dtype=np.int64),
                    ("tilt to x", "tilt to y", "torsion"),
                    unit="rad",
                    values=judged.margin[within],
                    values_unit="rad",
                )
            )
        size = item.orientations
        words = [
            f"# Orientations of {kinematics.output.name}",
            "",
            f"Mode {label_of(item.signs)}: {'; '.join(kinematics.legs)}.",
            "",
            f"Volume {size.volume:.6g}, error at most {size.error:.2g}, of 8 pi^2 = "
            f"{8.0 * np.pi**2:.6g} for all orientations.",
            "",
            "Sphere: the z axis of the link points there, and about it the link turns by "
            "so much in all.",
        ]
        return Scene(title, (*seen, Text("legend", "Volume", "\n".join(words))))

    def _curves(self, region: Region) -> list[Primitive]:
        """Return the border by the limits that end it, each named on its longest arc."""
        names = self.limited.names
        lines: dict[int, list[Floats]] = {}
        for boundary in region.boundaries:
            for arc in boundary.arcs:
                lines.setdefault(arc.margin, []).append(arc.points)
        curves: list[Primitive] = []
        for tone, (number, arcs) in enumerate(sorted(lines.items()), 1):
            longest = max(
                arcs, key=lambda x: np.sum(np.linalg.norm(np.diff(x, axis=0), axis=1))
            )
            mark = Mark(names[number].partition(" (")[0], longest[len(longest) // 2], tone)
            path = f"workspace/border/{number + 1}"
            curves.append(SphereCurves(path, names[number], arcs, tone, [mark]))
        return curves

    def _words(self, item: DirectionWorkspace) -> str:
        """Return areas and limits as Markdown."""
        region = item.region
        kinematics, names = self.limited.kinematics, self.limited.names
        alike = [
            label_of(other.signs)
            for other in self.workspaces
            if item.signs in (other.signs, other.same_as)
        ]
        lines = [
            f"# Workspace of {kinematics.output.name}",
            "",
            f"Modes {', '.join(alike)}: {'; '.join(kinematics.legs)}.",
            "",
            f"Area {region.area:.9g} sr, error at most {region.error:.2g} sr",
            "",
            "| part | area, sr |",
            "|---|---|",
            *(
                f"| {kind} {number} | {part.area:.9g} |"
                for kind, parts in (("part", region.components), ("hole", region.holes))
                for number, part in enumerate(sure_of(region, parts), 1)
            ),
            "",
            "Bounded by:",
            "",
        ]
        numbers = {arc.margin for boundary in region.boundaries for arc in boundary.arcs}
        return "\n".join([*lines, *(f"- {names[number]}" for number in sorted(numbers))])


def sure_of(region: Region, parts: Sequence[Part]) -> list[Part]:
    """Return the parts larger than what is not resolved, which can be parts of others."""
    return [part for part in parts if part.area > region.unresolved]


def given_poses(text: str, kinematics: ClosedKinematics) -> Floats:
    """Return the poses (k, 3) or (k, 4) that a text says, none of an empty one."""
    if not text:
        return np.zeros((0, 3 if kinematics.points else 4))
    given = text.split("+")
    poses, inputs, _ = read_poses(kinematics, "workspace", given, called="pose")
    if inputs is not None:
        solutions = kinematics.forward(inputs)
        poses = solutions.directions if kinematics.points else solutions.rotations
    assert poses is not None
    places = poses if kinematics.points else quaternion(poses)
    _, first = np.unique(places, axis=0, return_index=True)
    return places[np.sort(first)]


COARSE = 1e-2
"""Relative error of the volume of a set of orientations, if nothing else is asked for."""
FINE = 1e-4
"""Relative error of the area of a set of directions, if nothing else is asked for."""

AREA = "sr or sr rad"
"""The unit of a set of directions, or of orientations."""


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

    name: ClassVar[str] = "workspace"
    version: ClassVar[str] = "1"
    summary: ClassVar[str] = "what an output reaches under constraints, with its area"
    cites: ClassVar[tuple[str, ...]] = (
        "C. Gosselin and J. Angeles, IEEE Trans. Robotics and Automation 6(3), 1990",
        "Z. Chen et al., 2021, doi 10.21203/rs.3.rs-258461",
    )
    reads_samples: ClassVar[bool] = False
    tables: ClassVar[tuple[Table, ...]] = (
        Table(
            "workspace",
            "one row per mode and sample, inside and outside",
            (
                MODE,
                *PLACE,
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
                MODE,
                Column("curve", "", "number of the closed curve", "integer"),
                Column("component", "", "the part of the workspace beside it", "integer"),
                Column("gap", "", "the part of the outside beside it", "integer"),
                Column("arc", "", "number of the smooth arc in its curve", "integer"),
                Column("point", "", "number of the point in its arc", "integer"),
                *DIRECTION,
                *MIRROR,
                Column("constraint", "", "the limit that ends the workspace", "text"),
            ),
        ),
        Table(
            "areas",
            "one row per mode for the whole, and for each part and hole",
            (
                MODE,
                Column("part", "", "whole, component, hole or outside", "text"),
                Column("number", "", "of the part, the largest first", "integer"),
                Column("size", AREA, "area, or volume of all 8 pi^2 orientations"),
                Column("error", AREA, "bound of its error"),
                Column("curves", "", "numbers of the curves around it", "text"),
                *PLACE,
                Column("margin", "rad", "at this sample, well within the part"),
            ),
        ),
    )

    trades: ClassVar[tuple[Sweep, ...]] = (
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
        kinematics = self._limits(mechanism).kinematics
        kinematics.chosen_modes(self.working_mode)
        given_poses(self.pose, kinematics)
        return Needs()

    def compute(self, batch: Batch) -> Mapping[str, TableData]:
        """Return samples, border and areas."""
        rows: dict[str, list[Row]] = {table.name: [] for table in self.tables}
        for item in self._found(batch):
            mode = {"working_mode": label_of(item.signs)}
            rows["workspace"].append(mode | self._samples(batch, item))
            if isinstance(item, DirectionWorkspace):
                rows["boundary"] += [
                    {
                        **mode,
                        "curve": curve,
                        "component": boundary.component,
                        "gap": boundary.gap,
                        "arc": number,
                        "point": np.arange(len(arc.points)),
                        **self._place(batch, arc.points),
                        "constraint": self._limited(batch).names[arc.margin],
                    }
                    for curve, boundary in enumerate(item.region.boundaries)
                    for number, arc in enumerate(boundary.arcs)
                ]
                rows["areas"].append(mode | self._areas(batch, item))
            else:
                rows["areas"].append(mode | self._volume(batch, item))
        return {
            table.name: table.stacked(batch.mechanism, rows[table.name])
            for table in self.tables
        }

    def findings(self, batch: Batch) -> Findings:
        """Return area, parts and limits of each mode, and how the pose fares."""
        limited = self._limited(batch)
        figures: dict[str, Any] = {
            "output": limited.kinematics.output.name,
            "legs": list(limited.kinematics.legs),
            "limits": [bound.name for bound in limited.bounds],
        }
        warnings: list[str] = []
        remarks: list[str] = []
        modes: dict[str, Any] = {}
        for item in self._found(batch):
            label = label_of(item.signs)
            if isinstance(item, DirectionWorkspace):
                modes[label], words = self._of_region(batch, item)
            else:
                modes[label], words = self._of_orientations(batch, item)
            warnings += [f"mode {label}: {text}" for text in words]
        alike: dict[str, list[str]] = {}
        for label, facts in modes.items():
            alike.setdefault(facts.get("same_as", label), []).append(label)
        for first, labels in alike.items():
            name = f"mode{'s' * (len(labels) > 1)} {', '.join(labels)}"
            shared = "each " * (len(labels) > 1)
            remarks.append(f"{name}: {shared}{_in_words(modes[first])}")
        figures["working_modes"] = modes
        if self.pose:
            figures["pose"], words, said = how_poses_fare(
                given_poses(self.pose, limited.kinematics), limited, self._found(batch)
            )
            warnings += words
            remarks += said
        return Findings(figures, tuple(warnings), tuple(remarks))

    def scene(self, batch: Batch) -> tuple[Scene, ...]:
        """Return a page for each set: of directions its border, margin and measures.

        Of orientations how far the link can turn about each direction, and the margin.
        """
        workspaces = self._found(batch)
        samples = {item.signs: self._judged(batch, item) for item in workspaces}
        return WorkspaceScenes(self._limited(batch), workspaces, samples).pages()

    def _limits(self, mechanism: Mechanism) -> Limited:
        """Return the output under the limits of the mechanism and of the parameters."""
        kinematics = closed_kinematics(mechanism, self.output or None)
        wanted = Constraints(
            tuple(map(read_limit, self.limits)),
            tuple(map(read_apart, self.apart)),
            float(np.radians(self.near)),
            self.width,
            self.radius,
        )
        return Limited(kinematics, bounds_of(kinematics, wanted))

    def _limited(self, batch: Batch) -> Limited:
        return batch.once("limited", lambda: self._limits(batch.mechanism))

    def _found(self, batch: Batch) -> Workspaces:
        return batch.once("found", lambda: self._find(batch))

    def _find(self, batch: Batch) -> Workspaces:
        limited = self._limited(batch)
        kinematics, bounds = limited.kinematics, limited.bounds
        modes = kinematics.chosen_modes(self.working_mode)
        if kinematics.points:
            return direction_workspaces(kinematics, bounds, modes, self.tolerance or FINE)
        return orientation_workspaces(kinematics, bounds, modes, self.tolerance or COARSE)

    def _judged(
        self, batch: Batch, item: DirectionWorkspace | OrientationWorkspace
    ) -> tuple[Judged, Floats]:
        """Return the samples of a mode: the vertices, or orientations spread evenly."""

        def make() -> tuple[Judged, Floats]:
            places = (
                item.region.points
                if isinstance(item, DirectionWorkspace)
                else orientation_samples()
            )
            return self._limited(batch).judge(item, places), places

        return batch.once(("judged", item.signs), make)

    def _place(self, batch: Batch, places: Floats) -> Row:
        return place_columns(places, self._limited(batch).kinematics.form)

    def _samples(
        self, batch: Batch, item: DirectionWorkspace | OrientationWorkspace
    ) -> Row:
        judged, places = self._judged(batch, item)
        return {
            **self._place(batch, places),
            "inside": np.where(judged.inside, "yes", "no"),
            "margin": judged.margin,
            "limiting": np.array(self._limited(batch).names)[judged.limiting],
            **input_columns(batch.mechanism, judged.inputs),
            "type_1": judged.type_1,
            "type_2": judged.type_2,
        }

    def _areas(self, batch: Batch, item: DirectionWorkspace) -> Row:
        region = item.region
        whole = (region.area, (), np.full(3, np.nan))
        rows: list[tuple[str, int, float, tuple[int, ...], Floats]] = [("whole", 0, *whole)]
        for number, part in enumerate(region.components):
            rows.append(("component", number, part.area, part.boundaries, part.place))
        for number, part in enumerate(region.gaps):
            kind = "hole" if number else "outside"
            rows.append((kind, number, part.area, part.boundaries, part.place))
        kinds, numbers, sizes, curves, places = zip(*rows, strict=True)
        at = np.array(places)
        finite = np.flatnonzero(np.isfinite(at[:, 0]))
        margin = np.full(len(rows), np.nan)
        if len(finite):
            margin[finite] = self._limited(batch).judge(item, at[finite]).margin
        return {
            "part": kinds,
            "number": numbers,
            "size": sizes,
            "error": region.error,
            "curves": [" ".join(map(str, touching)) for touching in curves],
            **self._place(batch, at),
            "margin": margin,
        }

    def _volume(self, batch: Batch, item: OrientationWorkspace) -> Row:
        orientations = item.orientations
        place = orientations.place[None]
        return {
            "part": "whole",
            "number": 0,
            "size": orientations.volume,
            "error": orientations.error,
            **self._place(batch, place),
            "margin": self._limited(batch).judge(item, place).margin,
        }

    def _of_region(
        self, batch: Batch, item: DirectionWorkspace
    ) -> tuple[dict[str, Any], list[str]]:
        region = item.region
        names = self._limited(batch).names
        numbers = {arc.margin for boundary in region.boundaries for arc in boundary.arcs}
        figures: dict[str, Any] = {
            "area_sr": region.area,
            "error_sr": region.error,
            "components": [part.area for part in sure_of(region, region.components)],
            "holes": [part.area for part in sure_of(region, region.holes)],
            "unresolved_sr": region.unresolved,
            "bounded_by": [names[number] for number in sorted(numbers)],
            "evaluations": region.evaluations,
        }
        if item.same_as is not None:
            figures["same_as"] = label_of(item.same_as)
            return figures, []
        words = []
        if not region.components:
            sets = [" with ".join(names[k] for k in subset) for subset in region.excluding]
            figures["excluding"] = sets
            words.append(
                "the workspace is empty"
                + (f"; no direction keeps to {', nor to '.join(sets)}" if sets else "")
            )
        elif region.error > (self.tolerance or FINE) * region.area:
            words.append(
                f"the area {region.area:.9g} sr is known to {region.error:.3g} sr only; "
                "borders touch, or end at sharp corners"
            )
        return figures, words

    def _of_orientations(
        self, batch: Batch, item: OrientationWorkspace
    ) -> tuple[dict[str, Any], list[str]]:
        orientations = item.orientations
        figures: dict[str, Any] = {
            "volume": orientations.volume,
            "error": orientations.error,
            "fraction": orientations.fraction,
            "evaluations": orientations.evaluations,
        }
        if item.same_as is not None:
            figures["same_as"] = label_of(item.same_as)
            return figures, []
        words = []
        if orientations.depth < 0.0:
            limited = self._limited(batch)
            here = limited.judge(item, orientations.place[None])
            figures["nearest_limit"] = limited.names[int(here.limiting[0])]
            words.append(
                "no orientation was found inside; the best one seen misses "
                f"{figures['nearest_limit']} by {-np.degrees(here.margin[0]):.3g} deg"
            )
        elif orientations.error > (self.tolerance or COARSE) * orientations.volume:
            words.append(
                f"the volume {orientations.volume:.6g} is known to "
                f"{orientations.error:.3g} only"
            )
        return figures, words


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
