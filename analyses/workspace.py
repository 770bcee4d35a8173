"""Workspace: what an output reaches under constraints, its border, area and margins."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, final

import numpy as np
from numpy.typing import NDArray

from spherekit.plugin import (
    INPUTS,
    AbstractAnalysis,
    AnalysisError,
    Batch,
    Column,
    Findings,
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
    listing,
)
from spherekit.plugin.designs import Merit
from spherekit.plugin.rotations import (
    AtDirection,
    AtInputs,
    AtMirror,
    AtOrientation,
    from_quaternion,
    from_tilt_torsion,
    normals_of,
    quaternion,
    tilt_torsion,
)
from spherekit.plugin.workspace import (
    AngleLimit,
    AxesLimit,
    ClosedKinematics,
    Constraints,
    DirectionWorkspace,
    Judged,
    OrientationWorkspace,
    PairLimit,
    Part,
    Region,
    bounds_of,
    chosen_modes,
    closed_kinematics,
    direction_workspaces,
    judge,
    label_of,
    nearest_reachable,
    orientation_samples,
    orientation_workspaces,
)

from .pose_text import read_pose

Floats = NDArray[np.float64]
Row = dict[str, Any]
Workspaces = tuple[DirectionWorkspace, ...] | tuple[OrientationWorkspace, ...]

UNDEFINED = "the output is not determined"
"""Name of a border where no bound is 0."""
POSE = ("x", "y", "z", "w")
COARSE = 1e-2
"""Relative error of the volume of a set of orientations, if nothing else is asked for."""
FINE = 1e-4
"""Relative error of the area of a set of directions, if nothing else is asked for."""

ROWS, COLUMNS, TORSIONS = 24, 48, 36
"""Tilts, azimuths and torsions at which orientations are drawn."""

AREA = "sr or sr rad"
"""The unit of a set of directions, or of orientations."""

MODE = Column("working_mode", "", "signs of the working mode's legs", "text")
PLACES = (
    Column("x", "", "of the direction, or of the unit quaternion xyzw", turns="otherwise"),
    Column("y", "", "of the direction or quaternion", turns="otherwise"),
    Column("z", "", "of the direction or quaternion", turns="otherwise"),
)


@final
@dataclass(frozen=True, kw_only=True)
class WorkspaceAnalysis(AbstractAnalysis):
    """Directions or orientations that an output reaches in a working mode.

    `output` is its name, if several are declared. `mode` is the signs of one mode, such as
    ``+-``, or its number; by default all modes. Angles are in degrees: `limits` of pairs
    are ``PAIR:LOW:HIGH``, beside the stops of the mechanism; `apart` are angles between
    the axes of two pairs, ``PAIR/PAIR:LEAST`` or ``PAIR/PAIR:LEAST:GREATEST``; `near` is
    the least angle to a singularity of type I or II. Links of a `width` on a sphere of a
    `radius`, in the same unit of length, are kept from touching. `tolerance` is the
    relative error of the area or volume, by default 1e-4 of directions and 1e-2 of
    orientations. `pose` is judged: ``name=number+name=number`` of x, y, z or
    azimuth, tilt of a direction; azimuth, tilt, torsion, qx, qy, qz, qw or rx, ry, rz of
    an orientation; phi, gamma; or all driven pairs.
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
                *PLACES,
                Column("w", "", "of the quaternion; empty for directions"),
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
                *PLACES,
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
                *PLACES,
                Column("w", "", "of the quaternion; empty for directions"),
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

    def merits(self, mechanism: Mechanism) -> tuple[Merit, ...]:
        """Return the area, or volume, of the whole workspace in each working mode."""
        del mechanism
        size = Merit(
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
        kinematics = closed_kinematics(mechanism, self.output or None)
        bounds_of(kinematics, self._constraints)
        chosen_modes(kinematics, self.working_mode)
        self._given_pose(kinematics)
        return Needs()

    def compute(self, batch: Batch) -> Mapping[str, TableData]:
        """Return samples, border and areas."""
        tables: dict[str, list[Row]] = {table.name: [] for table in self.tables}
        for item in self._found(batch):
            label = label_of(item.signs)
            judged, places = self._judged(batch, item)
            tables["workspace"].append(self._samples(batch, label, judged, places))
            if isinstance(item, DirectionWorkspace):
                tables["boundary"].append(self._border(batch, label, item.region))
                tables["areas"].append(self._areas(batch, item))
            else:
                tables["areas"].append(self._volume(batch, item))
        blank = {
            table.name: {
                column.name: np.zeros(0) for column in table.of(batch.mechanism).columns
            }
            for table in self.tables
        }
        return {
            name: _stacked(parts) if parts else blank[name]
            for name, parts in tables.items()
        }

    def findings(self, batch: Batch) -> Findings:
        """Return area, parts and limits of each mode, and how the pose fares."""
        kinematics, bounds = self._kinematics(batch), self._bounds(batch)
        figures: dict[str, Any] = {
            "output": kinematics.output.name,
            "legs": list(kinematics.legs),
            "limits": [bound.name for bound in bounds],
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
            figures["pose"], words, said = self._of_pose(batch)
            warnings += words
            remarks += said
        return Findings(figures, tuple(warnings), tuple(remarks))

    def scene(self, batch: Batch) -> tuple[Scene, ...]:
        """Return a page for each set: of directions its border, margin and measures.

        Of orientations how far the link can turn about each direction, and the margin.
        """
        pages = []
        distinct = [item for item in self._found(batch) if item.same_as is None]
        for item in distinct:
            title = (
                "Workspace" if len(distinct) == 1 else f"Workspace {label_of(item.signs)}"
            )
            if isinstance(item, DirectionWorkspace):
                pages += self._pages(batch, item, title)
            else:
                pages.append(self._of_all_turns(batch, item, title))
        return tuple(pages)

    @property
    def _constraints(self) -> Constraints:
        return Constraints(
            tuple(
                PairLimit(pair, low, high)
                for pair, low, high in (_read_limit(text) for text in self.limits)
            ),
            tuple(_read_apart(text) for text in self.apart),
            float(np.radians(self.near)),
            self.width,
            self.radius,
        )

    def _kinematics(self, batch: Batch) -> ClosedKinematics:
        return batch.once(
            "kinematics", lambda: closed_kinematics(batch.mechanism, self.output or None)
        )

    def _bounds(self, batch: Batch) -> tuple[AngleLimit, ...]:
        return batch.once(
            "bounds", lambda: bounds_of(self._kinematics(batch), self._constraints)
        )

    def _found(self, batch: Batch) -> Workspaces:
        return batch.once("found", lambda: self._find(batch))

    def _find(self, batch: Batch) -> Workspaces:
        kinematics, bounds = self._kinematics(batch), self._bounds(batch)
        modes = chosen_modes(kinematics, self.working_mode)
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
            kinematics, bounds = self._kinematics(batch), self._bounds(batch)
            return judge(kinematics, bounds, item.signs, places), places

        return batch.once(("judged", item.signs), make)

    def _samples(self, batch: Batch, label: str, judged: Judged, places: Floats) -> Row:
        n = len(places)
        names = [bound.name for bound in self._bounds(batch)] + [UNDEFINED]
        return {
            "working_mode": np.full(n, label),
            **_coordinates(places),
            "inside": np.where(judged.inside, "yes", "no"),
            "margin": judged.margin,
            "limiting": np.array(names)[judged.limiting],
            **input_columns(batch.mechanism, judged.inputs),
            "type_1": judged.type_1,
            "type_2": judged.type_2,
        }

    def _border(self, batch: Batch, label: str, region: Region) -> Row:
        names = [bound.name for bound in self._bounds(batch)] + [UNDEFINED]
        parts: list[Row] = []
        for curve, boundary in enumerate(region.boundaries):
            for number, arc in enumerate(boundary.arcs):
                n = len(arc.points)
                numbers = {
                    "curve": curve,
                    "component": boundary.component,
                    "gap": boundary.gap,
                    "arc": number,
                }
                parts.append(
                    {
                        "working_mode": np.full(n, label),
                        **{
                            name: np.full(n, limit_number)
                            for name, limit_number in numbers.items()
                        },
                        "point": np.arange(n),
                        **dict(zip(POSE[:3], arc.points.T, strict=True)),
                        "constraint": np.full(n, names[arc.margin]),
                    }
                )
        if not parts:
            columns = self.tables[1].columns
            return {column.name: np.zeros(0) for column in columns}
        return _stacked(parts)

    def _areas(self, batch: Batch, item: DirectionWorkspace) -> Row:
        region, label = item.region, label_of(item.signs)
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
            kinematics, bounds = self._kinematics(batch), self._bounds(batch)
            margin[finite] = judge(kinematics, bounds, item.signs, at[finite]).margin
        return {
            "working_mode": np.full(len(rows), label),
            "part": np.array(kinds),
            "number": np.array(numbers),
            "size": np.array(sizes),
            "error": np.full(len(rows), region.error),
            "curves": np.array([" ".join(map(str, touching)) for touching in curves]),
            **_coordinates(at),
            "margin": margin,
        }

    def _volume(self, batch: Batch, item: OrientationWorkspace) -> Row:
        orientations = item.orientations
        kinematics, bounds = self._kinematics(batch), self._bounds(batch)
        place = orientations.place[None]
        return {
            "working_mode": np.array([label_of(item.signs)]),
            "part": np.array(["whole"]),
            "number": np.array([0]),
            "size": np.array([orientations.volume]),
            "error": np.array([orientations.error]),
            "curves": np.array([""]),
            **_coordinates(place),
            "margin": judge(kinematics, bounds, item.signs, place).margin,
        }

    def _of_region(
        self, batch: Batch, item: DirectionWorkspace
    ) -> tuple[dict[str, Any], list[str]]:
        region = item.region
        names = [bound.name for bound in self._bounds(batch)] + [UNDEFINED]
        numbers = {arc.margin for boundary in region.boundaries for arc in boundary.arcs}
        figures: dict[str, Any] = {
            "area_sr": region.area,
            "error_sr": region.error,
            "components": [part.area for part in _sure(region, region.components)],
            "holes": [part.area for part in _sure(region, region.holes)],
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
            kinematics, bounds = self._kinematics(batch), self._bounds(batch)
            here = judge(kinematics, bounds, item.signs, orientations.place[None])
            figures["nearest_limit"] = bounds[int(here.limiting[0])].name
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

    def _given_pose(self, kinematics: ClosedKinematics) -> Floats:
        """Return the poses (k, 3) or (k, 4) to be judged."""
        size = 3 if kinematics.points else 4
        if not self.pose:
            return np.zeros((0, size))
        where = "workspace: pose"
        names = tuple(item.pair for item in kinematics.mechanism.inputs)
        pose = read_pose(self.pose, names, where)
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
            f'{where}: "{self.pose}" does not say how output {kinematics.output.name} '
            f"is posed; it takes {takes} or all inputs ({listing(names)})"
        )

    def _of_pose(self, batch: Batch) -> tuple[list[dict[str, Any]], list[str], list[str]]:
        """Return how each pose fares in each mode, with the nearest one that is reached.

        And what to warn of, and what to say.
        """
        kinematics, bounds = self._kinematics(batch), self._bounds(batch)
        names = [bound.name for bound in bounds] + [UNDEFINED]
        figures: list[dict[str, Any]] = []
        warnings: list[str] = []
        within: dict[str, list[str]] = {}
        places = self._given_pose(kinematics)
        if not len(places):
            warnings.append("pose: the mechanism does not close at these inputs")
        for place in places:
            told: dict[str, list[str]] = {}
            shown = ", ".join(f"{value:.6g}" for value in place)
            for item in self._found(batch):
                label = label_of(item.signs)
                here = judge(kinematics, bounds, item.signs, place[None])
                row: dict[str, Any] = {
                    "pose": place.tolist(),
                    "working_mode": label,
                    **_fares(here, names),
                }
                figures.append(row)
                if row["inside"] == "yes":
                    margin = f"{np.degrees(row['margin_rad']):.4g} deg"
                    text = f"{margin} from {row['limiting']}, pose ({shown}) is inside"
                    within.setdefault(text, []).append(label)
                    continue
                nearest = nearest_reachable(kinematics, bounds, item, place)
                text = f"by {row['limiting']}"
                if nearest is not None:
                    there, angle = nearest
                    row["nearest"] = there.tolist()
                    row["away_rad"] = angle
                    row["nearest_inputs"] = _numbers(
                        judge(kinematics, bounds, item.signs, there[None]).inputs[0]
                    )
                    offered = ", ".join(f"{value:.6g}" for value in there)
                    text += f"; nearest is ({offered}), {np.degrees(angle):.4g} deg away"
                told.setdefault(text, []).append(label)
            warnings += [
                f"pose ({shown}) is outside in mode {', '.join(labels)}, {text}"
                for text, labels in told.items()
            ]
        said = [f"{text} in mode {', '.join(modes)}" for text, modes in within.items()]
        return figures, warnings, said

    def _pages(self, batch: Batch, item: DirectionWorkspace, title: str) -> list[Scene]:
        """Return the page of the margin and that of the singularity measures."""
        kinematics, bounds, region = (
            self._kinematics(batch),
            self._bounds(batch),
            item.region,
        )
        names = [bound.name for bound in bounds] + [UNDEFINED]
        curves = self._curves(region, names)
        words = Text("legend", "Areas", self._words(batch, item))
        if not len(region.surface_triangles):
            return [Scene(title, (*curves, words))]
        places = region.surface_points
        at = judge(kinematics, bounds, item.signs, places)
        margin = np.maximum(np.nan_to_num(at.margin), 0.0)
        worst = np.fmin(at.type_1, at.type_2)
        angle = np.arcsin(np.clip(np.nan_to_num(worst), 0.0, 1.0))
        marks = self._deepest(batch, item)
        inside = SphereCurves("workspace/deepest", "farthest inside", (), 0, marks)

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

    def _of_all_turns(self, batch: Batch, item: OrientationWorkspace, title: str) -> Scene:
        """Return the turns reached about each direction of the z axis, and all margins.

        The margins are in the space of tilt and torsion, tilts as polar coordinates.
        """
        kinematics, bounds = self._kinematics(batch), self._bounds(batch)
        vertices, triangles, azimuth, tilt = _sphere()
        torsion = 2.0 * np.pi * np.arange(TORSIONS) / TORSIONS
        angles = np.stack(
            [
                np.repeat(azimuth, TORSIONS),
                np.repeat(tilt, TORSIONS),
                np.tile(torsion, len(vertices)),
            ],
            axis=1,
        )
        turned = quaternion(from_tilt_torsion(angles))
        inside = judge(kinematics, bounds, item.signs, turned).inside
        reached = 2.0 * np.pi * inside.reshape(-1, TORSIONS).mean(axis=1)
        judged, places = self._judged(batch, item)
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

    def _curves(self, region: Region, names: Sequence[str]) -> list[Primitive]:
        """Return the border by the limits that end it, each named on its longest arc."""
        lines: dict[int, list[Floats]] = {}
        for boundary in region.boundaries:
            for arc in boundary.arcs:
                lines.setdefault(arc.margin, []).append(arc.points)
        curves: list[Primitive] = []
        for tone, (number, arcs) in enumerate(sorted(lines.items()), 1):
            longest = max(arcs, key=_length)
            short = names[number].partition(" (")[0]
            mark = Mark(short, longest[len(longest) // 2], tone)
            path = f"workspace/border/{number + 1}"
            curves.append(SphereCurves(path, names[number], arcs, tone, [mark]))
        return curves

    def _deepest(self, batch: Batch, item: DirectionWorkspace) -> list[Mark]:
        """Return a mark at the vertex with the largest margin."""
        judged, places = self._judged(batch, item)
        best = int(np.nanargmax(judged.margin))
        return [Mark(f"{np.degrees(judged.margin[best]):.3g} deg", places[best])]

    def _words(self, batch: Batch, item: DirectionWorkspace) -> str:
        """Return areas and limits as Markdown."""
        region = item.region
        kinematics, bounds = self._kinematics(batch), self._bounds(batch)
        names = [bound.name for bound in bounds] + [UNDEFINED]
        alike = [
            label_of(other.signs)
            for other in self._found(batch)
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
                for number, part in enumerate(_sure(region, parts), 1)
            ),
            "",
            "Bounded by:",
            "",
        ]
        numbers = {arc.margin for boundary in region.boundaries for arc in boundary.arcs}
        return "\n".join([*lines, *(f"- {names[number]}" for number in sorted(numbers))])


def _sphere() -> tuple[Floats, NDArray[np.int64], Floats, Floats]:
    """Return vertices and triangles of a sphere, with the azimuth and tilt of each."""
    tilts, turns = (
        np.linspace(0.0, np.pi, ROWS + 1),
        np.linspace(0.0, 2.0 * np.pi, COLUMNS + 1),
    )
    tilt, azimuth = (grid.ravel() for grid in np.meshgrid(tilts, turns, indexing="ij"))
    sine = np.sin(tilt)
    vertices = np.stack(
        [sine * np.cos(azimuth), sine * np.sin(azimuth), np.cos(tilt)], axis=1
    )
    corner = (np.arange(ROWS)[:, None] * (COLUMNS + 1) + np.arange(COLUMNS)).ravel()
    below = corner + COLUMNS + 1
    triangles = np.concatenate(
        [
            np.stack([corner, below, corner + 1], axis=1),
            np.stack([corner + 1, below, below + 1], axis=1),
        ]
    )
    return vertices, triangles, azimuth, tilt


def _in_words(figures: Row) -> str:
    """Return what the findings of a mode say in a line."""
    if "volume" in figures:
        return (
            f"volume {figures['volume']:.6g} +- {figures['error']:.1g} of 8 pi^2 for all "
            "orientations"
        )
    return (
        f"area {figures['area_sr']:.8g} +- {figures['error_sr']:.1g} sr, parts "
        f"{len(figures['components'])}, holes {len(figures['holes'])}, bounded by "
        f"{', '.join(figures['bounded_by']) or 'nothing'}"
    )


def _sure(region: Region, parts: Sequence[Part]) -> list[Part]:
    """Return the parts larger than what is not resolved, which can be parts of others."""
    return [part for part in parts if part.area > region.unresolved]


def _length(points: Floats) -> float:
    return float(np.sum(np.linalg.norm(np.diff(points, axis=0), axis=1)))


def _read_limit(text: str) -> tuple[str, float, float]:
    """Return a pair and its limits in rad from ``PAIR:LOW:HIGH`` in degrees."""
    pair, *limits = text.split(":")
    if len(limits) == 2:
        low, high = (_degrees("limits", text, limit) for limit in limits)
        return pair, low, high
    raise AnalysisError(
        f'workspace: limits: "{text}" is not PAIR:LOW:HIGH, with both in degrees'
    )


def _read_apart(text: str) -> AxesLimit:
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


def _coordinates(places: Floats) -> Row:
    """Return the columns x, y, z, w of places (n, 3) or (n, 4)."""
    rest = np.full(len(places), np.nan)
    return {
        name: places[:, k] if k < places.shape[1] else rest for k, name in enumerate(POSE)
    }


def _fares(judged: Judged, names: Sequence[str]) -> dict[str, Any]:
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


def _stacked(parts: Sequence[Row]) -> Row:
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
