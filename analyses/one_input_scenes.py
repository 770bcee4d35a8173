"""What the analysis `singularities` shows of a mechanism with one input."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, final

import numpy as np

from spherekit.plugin import (
    Arrow,
    Axis,
    Batch,
    Floats,
    GreatCircle,
    InputMarks,
    Mark,
    PlaneCurve,
    Portrait,
    Primitive,
    Scene,
    Series,
    Text,
    link_bodies,
    numbered,
)
from spherekit.plugin.singularities import SampledSingularities, SixPoles, Type

from .singular_planes import TONES, plane, without_jumps

Row = Mapping[str, Any]

LINE_TONE = 4
DRAWN = 721
"""Points with which a whole configuration curve is drawn."""
_ANGLES = {
    "angle_I": "to type I",
    "angle_II": "to type II",
    "transmission": "transmission angle",
}
_AXES = {"ir": "ir", "or_": "or", "os": "os", "io": "io", "is_": "is", "rs": "rs"}


@final
@dataclass(frozen=True)
class OneInputScenes:
    """Pages about the singularities of a batch.

    `names` are the outputs; `points` and `relation` the rows of the tables.
    """

    batch: Batch
    sampled: SampledSingularities
    names: Sequence[str]
    points: Row
    relation: Row

    def pages(self) -> tuple[Scene, ...]:
        """Return the page of singularities, if they have places, and one of each mode."""
        pages = [
            Scene(number, tuple(self._plots(rows)))
            for number, rows in self.batch.assembly_mode_rows().items()
        ]
        if np.any(np.isfinite(self.points["s"])):
            pages.insert(0, self._gallery())
        return tuple(pages)

    def _plots(self, rows: slice) -> list[Primitive]:
        relation, n = self.relation, len(self.batch)
        parts: list[Primitive] = []
        for start in range(0, len(relation["c"]), n):
            output, form = relation["output"][start], relation["form"][start]
            shown = slice(start + rows.start, start + rows.stop)
            where = f"plots/{form}/{output.replace('/', '_')}"
            group = f"input-output relation, form {form}"
            for name in ("c", "d"):
                label = f"{name}, output {output}"
                parts.append(Series(f"{where}/{name}", label, group, relation[name][shown]))
            for name, words in _ANGLES.items():
                values = relation[name][shown]
                if np.any(np.isfinite(values)):
                    label = f"{words}, output {output}"
                    angles = f"angles, form {form}"
                    parts.append(Series(f"{where}/{name}", label, angles, values, "rad"))
        drawn = [self._input_output(output, rows) for output in range(len(self.names))]
        return [*drawn, *parts, *self._marked(rows)]

    def _marked(self, rows: slice) -> list[Primitive]:
        """Return the inputs at which singularities of an assembly mode are."""
        if self.batch.timed:
            return []
        points = self.points
        mode = str(int(self.batch.assembly_mode[rows.start]))
        here = np.array(
            [mode in modes.split("+") for modes in points["assembly_mode"]], bool
        )
        parts: list[Primitive] = []
        for kind in dict.fromkeys(points["kind"][here].tolist()):
            q = points["q"][here & (points["kind"] == kind)]
            q = np.unique(q[np.isfinite(q)])[:, None]
            if kind in TONES:
                parts.append(InputMarks(f"marks/{kind}", f"type {kind}", q, TONES[kind]))
        return parts

    def _input_output(self, output: int, rows: slice) -> Portrait:
        """Return the output against the input, all curves drawn, singularities marked."""
        batch, sampled = self.batch, self.sampled
        links = sampled.report.outputs[output]
        curves: list[PlaneCurve] = []
        marks: list[Mark] = []
        x, y = np.full(len(batch), np.nan), np.full(len(batch), np.nan)
        for number in range(len(sampled.curves)):
            s, line = _drawn(sampled, number, output)
            curves.append(PlaneCurve(without_jumps(line), LINE_TONE))
            (on_curve,) = np.nonzero(sampled.curve == number)
            nearest = np.clip(np.searchsorted(s, sampled.s[on_curve]), 0, DRAWN - 1)
            x[on_curve], y[on_curve] = batch.q[on_curve], line[nearest, 1]
            for point in sampled.report.points:
                if point.curve == number and point.output == links:
                    place = line[int(np.argmin(np.abs(s - point.s)))]
                    if point.type is not Type.APPARENT and np.all(np.isfinite(place)):
                        kind = str(point.type)
                        marks.append(Mark(f"type {kind}", place, TONES[kind]))
        name = self.names[output]
        return plane(
            f"plots/input_output/{name.replace('/', '_')}",
            f"output {name} against the input",
            np.stack([x, y], axis=1)[rows],
            (f"input {batch.moving_inputs[0]}", f"output {name}"),
            curves,
            marks,
        )

    def _gallery(self) -> Scene:
        """Return a page on which row k is singularity k, with what coincides there."""
        sampled, every, names = self.sampled, self.points, self.names
        points = {k: v[np.isfinite(every["s"])] for k, v in every.items()}
        n = len(points["kind"])
        places = list(zip(points["curve"].tolist(), points["s"].tolist(), strict=True))
        turned = np.stack([sampled.configuration(*place) for place in places])
        planes = np.full((n, 2, 3), np.nan)
        axes = {name: np.full((n, 3), np.nan) for name in _AXES}
        for k, (curve, s) in enumerate(places):
            at = sampled.at(curve, np.array([s]), names.index(points["output"][k]))
            if at.poles:
                for name in _AXES:
                    axes[name][k] = getattr(at.poles[-1], name)[0]
                planes[k] = _planes(at.poles[-1], points["kind"][k])
        parts: list[Primitive] = [
            *link_bodies(sampled.tracer.mechanism, turned),
            *(
                Arrow(f"pole/{name}", words, axes[name], False, path_shown=False)
                for name, words in _AXES.items()
                if np.any(np.isfinite(axes[name]))
            ),
            *(
                GreatCircle(f"plane/{k}", words, planes[:, k])
                for k, words in enumerate(("plane of one triplet", "plane of the other"))
            ),
        ]
        lines = [
            "Arrows: poles of the input link i, its reference r, the output link o and its "
            "reference s, or the fourth link of form ii. Great circles: the planes that "
            "coincide.",
            "",
            "| sample | type | condition | mode | q, deg | output |",
            "|---|---|---|---|---:|---|",
        ]
        for k in range(n):
            lines.append(
                f"| {k} | {points['kind'][k]} | {points['condition'][k]} | "
                f"{points['assembly_mode'][k]} | {np.degrees(points['q'][k]):.4f} | "
                f"{points['output'][k]} |"
            )
        lines += ["", "What coincides:", ""]
        for note in dict.fromkeys(note for note in points["note"].tolist() if note):
            (rows,) = np.nonzero(points["note"] == note)
            lines.append(f"- {numbered('sample', rows.tolist())}: {note}")
        parts.append(Text("list", "Singularities", "\n".join(lines)))
        for output in range(len(names)):
            whole = self._input_output(output, slice(None))
            here = points["output"] == names[output]
            x = np.where(here, points["q"], np.nan)
            y = np.full(n, np.nan)
            for row in np.flatnonzero(here).tolist():
                curve, s = places[row]
                along, line = _drawn(sampled, curve, output)
                y[row] = line[int(np.argmin(np.abs(along - s))), 1]
            parts.append(replace(whole, x=x, y=y))
        over = Axis("singularity", "", np.arange(n, dtype=float))
        return Scene("Singularities", tuple(parts), (over,))


def _drawn(sampled: SampledSingularities, curve: int, output: int) -> tuple[Floats, Floats]:
    """Return places (k,) along a curve, and the input and the output (k, 2) there."""
    s = np.linspace(0.0, sampled.curves[curve].length * (1.0 - 1e-12), DRAWN)
    q, turned = sampled.input_at(curve, s), sampled.output_angle(curve, output, s)
    return s, np.stack([q, turned], axis=1)


def _planes(six: SixPoles, kind: str) -> Floats:
    """Return the normals (2, 3) of the planes that coincide in a type of singularity."""
    triplets = {
        "I": (("io", "os", "is_"), ("ir", "is_", "rs")),
        "II": (("or_", "os", "rs"), ("io", "os", "is_")),
    }["I" if kind == "I" else "II"]
    planes = np.full((2, 3), np.nan)
    for k, names in enumerate(triplets):
        vectors = np.stack([getattr(six, name)[0] for name in names])
        normals = np.cross(vectors, np.roll(vectors, -1, axis=0))
        sizes = np.nan_to_num(np.linalg.norm(normals, axis=1))
        best = int(np.argmax(sizes))
        if sizes[best] > 0.0:
            planes[k] = normals[best] / sizes[best]
    return planes
