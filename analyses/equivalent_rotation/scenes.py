"""What the analysis `equivalent_rotation` shows: the mechanism on its way, and in time."""

from collections.abc import Callable, Iterator
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
    AtRotation,
    EndOrientation,
    FixedAxisRotation,
    MidPlaneArchitecture,
    PoseCandidates,
    RotationSamples,
    TimeScaling,
    Trajectory,
    link_axes,
)

DRAWN = 181
"""Points with which the whole rotation is drawn."""
PATH_TONE = 0
LOST_TONE = 2
PLANE_TONES = {0: 1, -1: 4}
ENDS = (0, "start"), (-1, "end")


@dataclass(frozen=True)
class FoundRotation:
    """A rotation with its samples, its schedule in `rows`, or why there is none of these.

    `end` is the orientation that is chosen at the end, or the axis and the angle.
    `place` gives orientations (n, links, 3, 3) in ground axes at values (n, variables);
    `form` is the mechanism's mid-plane symmetric architecture.
    """

    mechanism: Mechanism
    place: Callable[[Floats], Floats]
    output: Output
    start: PoseCandidates
    number: int
    end: EndOrientation | AtRotation
    turn: FixedAxisRotation
    samples: RotationSamples
    form: MidPlaneArchitecture | None
    schedule: TimeScaling | None
    rows: Trajectory | None
    unscheduled: str

    def pages(self, words: str) -> tuple[Scene, ...]:
        """Return the page on which row k is sample k, and one evenly spread over time.

        The words stand beside both.
        """
        samples = self.samples
        rows = self.rows
        lost = np.array(self.turn.crossings)[:, None]
        errors = "error of orientation about the fixed axis"
        parts: list[Primitive] = [
            *self._stage(samples),
            *self._driving("q", "driving angles", samples.inputs, "rad"),
            *self._driving("dq_dtheta", "rates of driving angles by theta", samples.rates),
            InputMarks("marks/lost", "type II", lost, LOST_TONE),
            Series(
                "plots/orientation_error",
                "orientation_error",
                errors,
                samples.orientation_error,
                "rad",
            ),
            Series("plots/drift", "drift of the axis", errors, samples.drift, "rad"),
            Series("plots/type_2", "type_2", "transmission measure", samples.type_2),
            Text("words", "Rotation", words),
        ]
        page = Scene(
            "Equivalent rotation", tuple(parts), (Axis("theta", "rad", samples.theta),)
        )
        if rows is None:
            return (page,)
        step = rows.t[-1] / (len(rows.t) - 1)
        ddq = rows.accelerations
        words += f"\n\nRow k of this page is at k x {step:.6g} s."
        timed = (
            *self._stage(self.turn.at(rows.theta)),
            *self._driving("q", "driving angles in time", rows.inputs, "rad"),
            *self._driving("dq", "driving speeds", rows.rates, "rad/s"),
            *self._driving("ddq", "driving accelerations", ddq, "rad/s2"),
            Text("words", "Rotation", words),
        )
        over = Axis("time", "s", rows.t)
        return page, Scene("Equivalent rotation in time", timed, (over,))

    def _driving(
        self, kind: str, group: str, values: Floats, unit: str = ""
    ) -> list[Series]:
        """Return the plots of values (n, inputs) of the driven pairs."""
        return [
            Series(f"plots/{kind}/{pair}", pair, group, values[:, k], unit)
            for k, pair in enumerate(self.turn.inputs)
        ]

    def _stage(self, samples: RotationSamples) -> Iterator[Primitive]:
        """Yield the links, the axis, arcs of the output, and mid-planes."""
        mechanism = self.mechanism
        placed = self.place(samples.values)
        base = placed[:, mechanism.link_number[self.output.relative_to]]
        yield from link_bodies(mechanism, placed)
        yield Arrow("axis", "axis of the rotation", base @ self.turn.axis, False)
        link = mechanism.link_number[self.output.link]
        directions = link_axes(mechanism)[self.output.link]
        if self.output.direction is not None:
            directions = {self.output.name: np.array(self.output.direction)}
        whole, lost = (
            self.place(self.turn.at(theta).values)[:, link]
            for theta in (np.linspace(0.0, self.turn.angle, DRAWN), self.turn.crossings)
        )
        for name, direction in directions.items():
            path = _finite(whole @ direction)
            if len(path):
                marks = [Mark(word, path[k], PATH_TONE) for k, word in ENDS]
                label = f"arc of {name}"
                yield SphereCurves(f"arc/{name}", label, [path], PATH_TONE, marks)
        if len(lost):
            name = "type II singularity"
            tips = lost @ next(iter(directions.values()))
            marks = [Mark(name, tip, LOST_TONE) for tip in _finite(tips)]
            yield SphereCurves("lost", name, [], LOST_TONE, marks)
        if self.form is not None:
            normals = mid_planes(self.form, samples.orientation)
            moving = np.matvec(base @ self.form.frame, normals)
            finite = _finite(moving)
            for k, name in ENDS if len(finite) else ():
                circle = [_circle(finite[k])]
                label = f"mid-plane, {name}"
                yield SphereCurves(f"mid_plane/{name}", label, circle, PLANE_TONES[k])
            yield GreatCircle("mid_plane/now", "mid-plane", moving)


def _finite(vectors: Floats) -> Floats:
    return vectors[np.isfinite(vectors[:, 0])]


def mid_planes(form: MidPlaneArchitecture, orientations: Floats) -> Floats:
    """Return the mid-planes (n, 3) of orientations (n, 3, 3), NaN where these are."""
    normals = np.full((len(orientations), 3), np.nan)
    finite = np.isfinite(orientations[:, 0, 0])
    normals[finite], _ = form.normals(orientations[finite])
    return normals


def _circle(normal: Floats) -> Floats:
    """Return points (k, 3) of the great circle about a normal (3,)."""
    across = np.linalg.svd(normal[None])[2][1:]
    turn = np.linspace(0.0, 2.0 * np.pi, DRAWN)
    return np.stack([np.cos(turn), np.sin(turn)], axis=1) @ across
