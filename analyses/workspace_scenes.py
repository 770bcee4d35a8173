"""What the analysis `workspace` shows: borders, margins and turns on the sphere."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import final

import numpy as np

from spherekit.plugin import (
    Floats,
    Mark,
    Primitive,
    Scene,
    SphereCurves,
    SphereMap,
    Surface,
    Text,
)
from spherekit.plugin.rotations import (
    azimuth_tilt,
    from_quaternion,
    from_tilt_torsion,
    quaternion,
    tilt_torsion,
)
from spherekit.plugin.workspace import (
    DirectionWorkspace,
    Judged,
    OrientationWorkspace,
    Part,
    Region,
    label_of,
    sphere_mesh,
)

from .posed_workspace import Limited

ROWS, COLUMNS, TORSIONS = 24, 48, 36
"""Tilts, azimuths and torsions at which orientations are drawn."""


@final
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
        worst = np.fmin(at.type_1, at.type_2)
        angle = np.arcsin(np.clip(np.nan_to_num(worst), 0.0, 1.0))
        marks = self._deepest(item)
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
        turned = quaternion(from_tilt_torsion(angles))
        inside = self.limited.judge(item, turned).inside
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
            longest = max(arcs, key=_length)
            short = names[number].partition(" (")[0]
            mark = Mark(short, longest[len(longest) // 2], tone)
            path = f"workspace/border/{number + 1}"
            curves.append(SphereCurves(path, names[number], arcs, tone, [mark]))
        return curves

    def _deepest(self, item: DirectionWorkspace) -> list[Mark]:
        """Return a mark at the vertex with the largest margin."""
        judged, places = self.samples[item.signs]
        best = int(np.nanargmax(judged.margin))
        return [Mark(f"{np.degrees(judged.margin[best]):.3g} deg", places[best])]

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


def _length(points: Floats) -> float:
    return float(np.sum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
