"""What the analysis `equivalent_rotation` shows: the mechanism on its way, and in time."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from spherekit.plugin import (
    Arrow,
    Axis,
    Floats,
    GreatCircle,
    InputMarks,
    Mark,
    Mechanism,
    Output,
    Primitive,
    Scene,
    Series,
    SphereCurves,
    Text,
    link_bodies,
)
from spherekit.plugin.rotations import (
    FixedAxisRotation,
    MidPlaneArchitecture,
    RotationSamples,
    Trajectory,
    link_axes,
)

DRAWN = 181
"""Points with which the whole rotation is drawn."""
PATH_TONE, LOST_TONE = 0, 2
PLANE_TONES = {0: 1, -1: 4}


@dataclass(frozen=True)
class RotationScenes:
    """Pages about a rotation.

    `place` gives orientations (n, links, 3, 3) in ground axes at values (n, variables);
    `form` is the mechanism's mid-plane symmetric architecture, `words` stand beside the
    pages.
    """

    mechanism: Mechanism
    place: Callable[[Floats], Floats]
    output: Output
    turn: FixedAxisRotation
    form: MidPlaneArchitecture | None
    words: str

    def rotation(self, samples: RotationSamples) -> Scene:
        """Return the page on which row k is sample k."""
        parts = self._stage(samples)
        parts += self._driving("q", "driving angles", samples.inputs, "rad")
        words = "rates of driving angles by theta"
        parts += self._driving("dq_dtheta", words, samples.rates, "")
        lost = np.array(self.turn.crossings)[:, None]
        if len(lost):
            parts.append(InputMarks("marks/lost", "type II", lost, LOST_TONE))
        for label, values in (
            ("orientation_error", samples.orientation_error),
            ("drift of the axis", samples.drift),
        ):
            path = f"plots/{label.split()[0]}"
            group = "error of orientation about the fixed axis"
            parts.append(Series(path, label, group, values, "rad"))
        parts.append(
            Series("plots/type_2", "type_2", "transmission measure", samples.type_2)
        )
        parts.append(Text("words", "Rotation", self.words))
        over = Axis("theta", "rad", samples.theta)
        return Scene("Equivalent rotation", tuple(parts), (over,))

    def schedule(self, rows: Trajectory) -> Scene:
        """Return the page on which rows are evenly spread over the duration."""
        parts = self._stage(self.turn.at(rows.theta))
        parts += self._driving("q", "driving angles in time", rows.inputs, "rad")
        parts += self._driving("dq", "driving speeds", rows.rates, "rad/s")
        parts += self._driving("ddq", "driving accelerations", rows.accelerations, "rad/s2")
        step = rows.t[-1] / (len(rows.t) - 1)
        words = f"{self.words}\n\nRow k of this page is at k x {step:.6g} s."
        parts.append(Text("words", "Rotation", words))
        over = Axis("time", "s", rows.t)
        return Scene("Equivalent rotation in time", tuple(parts), (over,))

    def _driving(self, kind: str, group: str, values: Floats, unit: str) -> list[Series]:
        """Return the plots of values (n, inputs) of the driven pairs."""
        return [
            Series(f"plots/{kind}/{pair}", pair, group, values[:, k], unit)
            for k, pair in enumerate(self.turn.inputs)
        ]

    def _stage(self, samples: RotationSamples) -> list[Primitive]:
        """Return the links, the axis, arcs of the output, and mid-planes."""
        mechanism, placed = self.mechanism, self.place(samples.values)
        base = placed[:, mechanism.link_number[self.output.relative_to]]
        parts: list[Primitive] = [*link_bodies(mechanism, placed)]
        parts.append(Arrow("axis", "axis of the rotation", base @ self.turn.axis, False))
        every = self.place(self.turn.at(np.linspace(0.0, self.turn.angle, DRAWN)).values)
        link = mechanism.link_number[self.output.link]
        for name, direction in self._directions():
            path = every[:, link] @ direction
            finite = path[np.isfinite(path[:, 0])]
            if len(finite):
                marks = [
                    Mark("start", finite[0], PATH_TONE),
                    Mark("end", finite[-1], PATH_TONE),
                ]
                parts.append(
                    SphereCurves(
                        f"arc/{name}", f"arc of {name}", [finite], PATH_TONE, marks
                    )
                )
        if self.turn.crossings:
            lost = self.turn.at(np.array(self.turn.crossings)).values
            tips = self.place(lost)[:, link] @ self._directions()[0][1]
            name, finite = "type II singularity", tips[np.isfinite(tips[:, 0])]
            marks = [Mark(name, tip, LOST_TONE) for tip in finite]
            parts.append(SphereCurves("lost", name, [], LOST_TONE, marks))
        if self.form is not None:
            normals = mid_planes(self.form, samples.orientation)
            moving = np.einsum("nij,nj->ni", base @ self.form.frame, normals)
            finite = moving[np.isfinite(moving[:, 0])]
            for k, name in ((0, "start"), (-1, "end")) if len(finite) else ():
                circle = _circle(finite[k])
                label = f"mid-plane, {name}"
                parts.append(
                    SphereCurves(f"mid_plane/{name}", label, [circle], PLANE_TONES[k])
                )
            parts.append(GreatCircle("mid_plane/now", "mid-plane", moving))
        return parts

    def _directions(self) -> list[tuple[str, Floats]]:
        """Return what of the output link draws arcs: its direction, or all its axes."""
        if self.output.direction is not None:
            return [(self.output.name, np.array(self.output.direction))]
        return list(link_axes(self.mechanism)[self.output.link].items())


def mid_planes(form: MidPlaneArchitecture, orientations: Floats) -> Floats:
    """Return the mid-planes (n, 3) of orientations (n, 3, 3), NaN where these are."""
    normals = np.full((len(orientations), 3), np.nan)
    finite = np.isfinite(orientations[:, 0, 0])
    normals[finite], _ = form.normals(orientations[finite])
    return normals


def _circle(normal: Floats) -> Floats:
    """Return points (k, 3) of the great circle about a normal (3,)."""
    across = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
    across /= np.linalg.norm(across)
    turn = np.linspace(0.0, 2.0 * np.pi, DRAWN)[:, None]
    return np.cos(turn) * across + np.sin(turn) * np.cross(normal, across)
