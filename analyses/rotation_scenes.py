"""What the analysis `equivalent_rotation` shows: the mechanism on its way, and in time."""

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.analysis.scene import (
    Arrow,
    GreatCircle,
    Mark,
    Portrait,
    Primitive,
    Scene,
    Series,
    SphereCurves,
    Text,
)
from spherekit.analysis.stage import link_bodies
from spherekit.guidance.form import MidPlaneForm
from spherekit.guidance.rotation import FixedAxisRotation, RotationSamples
from spherekit.guidance.schedule import Timetable
from spherekit.model.geometry import link_axes
from spherekit.model.mechanism import Output
from spherekit.motion.branches import Solver

Floats = NDArray[np.float64]

DRAWN = 181
"""Points with which the whole rotation is drawn."""
PATH_TONE, START_TONE, LOST_TONE = 4, 0, 2


@final
@dataclass(frozen=True)
class RotationScenes:
    """Pages about a rotation; `form` is None where it is followed on the graph."""

    solver: Solver
    output: Output
    turn: FixedAxisRotation
    form: MidPlaneForm | None
    words: str

    def rotation(self, samples: RotationSamples) -> Scene:
        """Return the page on which row k is sample k."""
        placed = self._placed(samples.values)
        parts = self._stage(placed, samples.orientation)
        for group, values in (
            ("driving angles, deg", np.degrees(samples.inputs)),
            ("rates of driving angles by theta", samples.rates),
        ):
            for k, name in enumerate(self.turn.inputs):
                path = f"plots/{group.split()[0]}/{name}"
                parts.append(Series(path, name, group, values[:, k]))
        parts += self._portraits(samples.theta, samples.inputs)
        for label, values in (
            ("departure", np.degrees(samples.departure)),
            ("drift of the axis", np.degrees(samples.drift)),
        ):
            path = f"plots/{label.split()[0]}"
            parts.append(Series(path, label, "off the fixed axis, deg", values))
        parts.append(
            Series("plots/control", "control", "hold by the inputs", samples.control)
        )
        parts.append(Text("words", "Rotation", self.words))
        return Scene("Equivalent rotation", tuple(parts), len(samples.theta))

    def schedule(self, rows: Timetable) -> Scene:
        """Return the page on which rows are evenly spread over the duration."""
        found = self.turn.at(rows.theta)
        placed = self._placed(found.values)
        parts = self._stage(placed, found.orientation)
        for name, what, unit, values in (
            ("q", "driving angles", "deg", rows.inputs),
            ("dq", "driving speeds", "deg/s", rows.rates),
            ("ddq", "driving accelerations", "deg/s2", rows.accelerations),
        ):
            shown = np.degrees(values)
            low, high = float(np.nanmin(shown)), float(np.nanmax(shown))
            lines = [
                (np.stack([rows.t, column], axis=1), k + 1)
                for k, column in enumerate(shown.T)
            ]
            for k, input_name in enumerate(rows.names):
                parts.append(
                    Portrait(
                        f"plots/{name}/{input_name}",
                        f"{what}, mark on {input_name}",
                        rows.t,
                        shown[:, k],
                        "t, s",
                        unit,
                        (0.0, float(rows.t[-1])),
                        (low, high),
                        lines,
                        [
                            Mark(other, line[len(line) // 2], tone)
                            for other, (line, tone) in zip(rows.names, lines, strict=True)
                        ],
                    )
                )
        parts.append(Text("words", "Rotation", self.words))
        return Scene("Equivalent rotation in time", tuple(parts), len(rows.t))

    def _placed(self, values: Floats) -> Floats:
        """Return orientations (n, links, 3, 3) in ground axes."""
        placed, _ = self.solver.closure.place(values)
        return placed

    def _stage(self, placed: Floats, orientation: Floats) -> list[Primitive]:
        """Return the links, the axis, arcs of the output, and mid-planes."""
        mechanism = self.solver.mechanism
        base = placed[:, mechanism.link_number[self.output.relative_to]]
        parts: list[Primitive] = [*link_bodies(mechanism, placed)]
        parts.append(Arrow("axis", "axis of the rotation", base @ self.turn.axis, False))
        whole = self.turn.at(np.linspace(0.0, self.turn.angle, DRAWN))
        every = self._placed(whole.values)
        link = mechanism.link_number[self.output.link]
        for name, direction in self._directions():
            path = every[:, link] @ direction
            known = path[np.isfinite(path[:, 0])]
            if len(known):
                marks = [
                    Mark("start", known[0], START_TONE),
                    Mark("end", known[-1], START_TONE),
                ]
                parts.append(
                    SphereCurves(f"arc/{name}", f"arc of {name}", [known], PATH_TONE, marks)
                )
        if self.turn.crossings:
            lost = self.turn.at(np.array(self.turn.crossings)).values
            tips = self._placed(lost)[:, link] @ self._directions()[0][1]
            marks = [Mark("no control", tip, LOST_TONE) for tip in tips if tip[0] == tip[0]]
            parts.append(SphereCurves("lost", "no control", [], LOST_TONE, marks))
        if self.form is not None:
            normals, _ = self.form.normals(orientation)
            moving = np.einsum("nij,nj->ni", base @ self.form.frame, normals)
            first, last = moving[:1], moving[-1:]
            for name, own in (("start", first), ("end", last)):
                fixed = np.repeat(own, len(moving), axis=0)
                parts.append(GreatCircle(f"mid_plane/{name}", f"mid-plane, {name}", fixed))
            parts.append(GreatCircle("mid_plane/now", "mid-plane", moving))
        return parts

    def _directions(self) -> list[tuple[str, Floats]]:
        """Return what of the output link draws arcs: its direction, or all its axes."""
        if self.output.direction is not None:
            return [(self.output.name, np.array(self.output.direction))]
        return list(link_axes(self.solver.mechanism)[self.output.link].items())

    def _portraits(self, theta: Floats, inputs: Floats) -> list[Primitive]:
        """Return each driving angle over theta, with the places without control."""
        whole = self.turn.at(np.linspace(0.0, self.turn.angle, DRAWN))
        lost = np.array(self.turn.crossings)
        at = self.turn.at(lost).inputs if len(lost) else np.zeros((0, inputs.shape[1]))
        x = np.degrees(whole.theta)
        parts: list[Primitive] = []
        for k, name in enumerate(self.turn.inputs):
            y = np.degrees(whole.inputs[:, k])
            parts.append(
                Portrait(
                    f"plots/driving/{name}",
                    f"driving angle {name}",
                    np.degrees(theta),
                    np.degrees(inputs[:, k]),
                    "theta, deg",
                    f"{name}, deg",
                    (0.0, float(x[-1])),
                    (float(np.nanmin(y)), float(np.nanmax(y))),
                    [(np.stack([x, y], axis=1), PATH_TONE)],
                    [
                        Mark("no control", np.degrees([t, q]), LOST_TONE)
                        for t, q in zip(lost, at[:, k], strict=True)
                    ],
                )
            )
        return parts
