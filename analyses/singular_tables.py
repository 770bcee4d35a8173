"""The tables of the analysis `singularities`, filled with one input and with several.

What the analysis `singularities` shows, with one input and with several.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from spherekit.plugin import (
    ASSEMBLY_MODE,
    INPUTS,
    SAMPLE,
    STATUS,
    Arrow,
    Axis,
    Batch,
    Column,
    Floats,
    GreatCircle,
    InputMarks,
    Mark,
    Output,
    PlaneCurve,
    Portrait,
    Primitive,
    Scene,
    Series,
    SphereCurves,
    Surface,
    Table,
    Text,
    link_bodies,
    numbered,
)
from spherekit.plugin.motion import PositionAnalysis
from spherekit.plugin.rotations import quaternion, wrap
from spherekit.plugin.singularities import (
    CurveSeen,
    SampledSingularities,
    SingularCurves,
    SingularPoints,
    SingularSurface,
    SixPoles,
    group_signs,
)

from .equivalent_rotation import PLACE, place_columns

SELF_MOTION: Final = "self-motion"
KIND = (
    "I: the output rests though inputs move; II: it moves though they rest; III: both; "
    "self-motion: other links move, and neither does"
)
OUTPUT = Column(
    "output", "", "link relative to link, with its name where others are these", "text"
)
SINGULARITIES = Table(
    "singularities",
    "one row per singularity and output",
    (
        Column("kind", "", KIND, "text"),
        Column("condition", "", "geometric conditions that hold", "text"),
        Column("assembly_mode", "", "assembly modes that it belongs to", "text"),
        INPUTS,
        Column("inside", "", "whether the inputs are in their ranges", "text"),
        OUTPUT,
        *PLACE[:4],
        Column("signs", "", "of its groups; 0 where singular, * of one left out", "text"),
        Column("theta", "rad", "variable of the passive pair", per_passive=True),
        Column("curve", "", "number of the configuration curve", "integer"),
        Column("s", "rad", "place on it, in its own arc length"),
        Column("error", "rad", "bound of the error of the place"),
        Column("residual", "", "sine by which the condition is missed"),
        Column("reversal", "", "what reverses there: input, output, both", "text"),
        Column("double", "", "whether it is only touched", "text"),
        Column("certain", "", "whether the kind is certain", "text"),
        Column("guarantee", "", "what is known of those not listed", "text"),
        Column("note", "", "what coincides, what is in doubt", "text"),
    ),
)
RELATION = Table(
    "relation",
    "c y' = d q' and nearness, one row per sample, assembly mode, output and form",
    (
        SAMPLE,
        ASSEMBLY_MODE,
        INPUTS,
        OUTPUT,
        Column("form", "", "i or ii", "text"),
        Column("c", "", "coefficient of the output rate"),
        Column("d", "", "coefficient of the input rate"),
        Column("velocity_coefficient", "", "y'/q' = d/c, infinite at type II"),
        Column("distance_I", "rad", "angle to type I, 0 there alone"),
        Column("distance_II", "rad", "angle to type II, 0 there alone"),
        Column("output_rate", "", "of y by the arc length of all variables"),
        Column("input_rate", "", "of q by the arc length of all variables"),
        Column("transmission", "rad", "transmission angle of the output's dyad"),
        Column("input_margin_I", "rad", "change of the input to the nearest type I"),
        Column("input_margin_II", "rad", "change of the input to the nearest type II"),
        Column("sigma", "", "least singular value of the passive equations"),
        Column("reciprocal_condition", "", "its part of the greatest one"),
        STATUS,
        Column("moving", "", "the moving input, the others locked", "text"),
        Column("type", "", "regular, I, II, III or self-motion", "text"),
        Column("group", "", "1: of a single-freedom part, 2: of none", "integer"),
    ),
)
ASPECTS = Table(
    "aspects",
    "with several inputs: configurations over an input grid, by parts not singular",
    (
        Column("aspect", "", "number of the part, the largest first", "integer"),
        INPUTS,
        Column("sign_II", "", "sign of the determinant of type II", "integer"),
        Column("sign_I", "", "sign of the determinant of type I", "integer"),
        Column(
            "assembly_modes",
            "",
            "assembly modes of one input in the part",
            "integer",
        ),
    ),
)


def of_type(kind: str) -> str:
    """Return the words for a kind: of type II, of self-motion."""
    return f"of {kind}" if kind == SELF_MOTION else f"of type {kind}"


def angle_of(sizes: Floats) -> Floats:
    """Return (n,) rad: the angle of all motions to those that keep inputs or output."""
    return np.arcsin(np.minimum(sizes, 1.0))


def configuration_columns(
    batch: Batch,
    values: Floats,
    links: tuple[int, int],
    pointing: Floats | None = None,
    part: PositionAnalysis | None = None,
) -> dict[str, Any]:
    """Return passive variables, signs, modes and the output's pose of rows (n, V).

    The pose is the direction `pointing` (n, 3), or the orientation of the first of two
    links in the second. Modes are those with the signs of dyads. Where values and links
    are those of a part, its tracer is given; groups of the rest have the sign ``*``.
    """
    tracer = part or batch.tracer
    mechanism, solver = tracer.mechanism, tracer.solver
    angles = set(mechanism.angles.values())
    driven = solver.driven
    columns: dict[str, Any] = {
        name: wrap(values[:, v]) if v in angles else values[:, v]
        for v, name in enumerate(mechanism.variable_names)
        if v not in driven
    }
    placed = tracer.given(values).rotations
    turned = np.swapaxes(placed[:, links[1]], 1, 2) @ placed[:, links[0]]
    columns |= place_columns(quaternion(turned) if pointing is None else pointing, None)
    signs = group_signs(solver, values)
    names = [set(mechanism.names_of(g.pairs)) for g in solver.assembly.groups]
    every = batch.mechanism.pairs
    groups = [{every[p].name for p in g.pairs} for g in batch.tracer.assembly.groups]
    columns["signs"] = [
        "".join("0+-"[row[names.index(g)]] if g in names else "*" for g in groups)
        for row in signs.tolist()
    ]
    if solver.assembly.has_closed_form and part is None:
        modes = batch.motion.assembly_modes
        shape = len(modes), signs.shape[1]
        of_modes = np.array([mode.signs for mode in modes]).reshape(shape)
        alike = np.all((signs[:, None] == of_modes) | (signs[:, None] == 0), axis=2)
        numbers = np.array([str(mode.number) for mode in modes])
        columns["assembly_mode"] = ["+".join(numbers[row]) for row in alike]
    return columns


Row = Mapping[str, Any]

TONES = {"I": 1, "II": 2, "III": 3, "self-motion": 4}
LINE_TONE = 4
DRAWN = 721
"""Points with which a whole configuration curve is drawn."""
PARTS = 8
"""Parts of each way between two nodes of a singular curve that is drawn."""
_ANGLES = {
    "distance_I": "to type I",
    "distance_II": "to type II",
    "transmission": "transmission angle",
}
_AXES = {"ir": "ir", "or_": "or", "os": "os", "io": "io", "is_": "is", "rs": "rs"}
_COINCIDE = {
    "I": (("io", "os", "is_"), ("ir", "is_", "rs")),
    "II": (("or_", "os", "rs"), ("io", "os", "is_")),
}
"""The axes of the planes that coincide in a type of singularity."""
GALLERY = (
    "Arrows: poles of the input link i, its reference r, the output link o and its "
    "reference s, or the fourth link of form ii. Great circles: the planes that "
    "coincide.\n\n"
    "| sample | type | condition | mode | q, deg | output |\n"
    "|---|---|---|---|---:|---|"
)


def without_jumps(line: Floats) -> Floats:
    """Return points (n, 2) rad with NaN between two where an angle jumps by a turn."""
    jumps = np.max(np.abs(np.diff(line, axis=0)), axis=1) > np.pi
    return np.insert(line, np.flatnonzero(jumps) + 1, np.nan, axis=0)


def plane(
    path: str,
    label: str,
    rows: Floats,
    axes: tuple[str, str],
    curves: Sequence[PlaneCurve],
    marks: Sequence[Mark],
    spanned: Iterable[Floats] = (),
) -> Portrait:
    """Return curves in a plane of angles (rad), with a mark at each of the rows (n, 2).

    The frame spans the curves, and the points (k, 2) to be `spanned`.
    """
    every = [*(curve.points for curve in curves), *spanned] or [np.zeros((1, 2))]
    points = np.concatenate(every)
    (left, low), (right, high) = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
    x, y = (float(left), float(right)), (float(low), float(high))
    return Portrait(
        path, label, rows[:, 0], rows[:, 1], *axes, x, y, "rad", "rad", curves, marks
    )


def relation_plots(relation: Row, count: int, rows: slice) -> list[Primitive]:
    """Return c, d and angles of each output in some of so many rows of a batch."""
    parts: dict[str, Primitive] = {}
    several = len(set(relation["moving"])) > 1
    for start in range(0, len(relation["c"]), count):
        output, form, moving = (relation[k][start] for k in ("output", "form", "moving"))
        by, at = f" by {moving}" * several, slice(start + rows.start, start + rows.stop)
        pair, angles = f"input-output relation, form {form}", f"angles, form {form}"
        series = {name: (name + by, pair, "") for name in ("c", "d")}
        series |= {name: (words, angles, "rad") for name, words in _ANGLES.items()}
        for name, (words, group, unit) in series.items():
            end = words.replace(" ", "_") if group == pair else name
            path = f"plots/{form}/{output.replace('/', '_')}/{end}"
            if np.any(np.isfinite(relation[name][at])):
                label = f"{words}, output {output}"
                parts[path] = Series(path, label, group, relation[name][at], unit)
    return [*parts.values()]


def words_of(kind: str) -> str:
    """Return the words for a kind: type II, self-motion."""
    return kind if kind == SELF_MOTION else f"type {kind}"


@dataclass(frozen=True)
class OneInputScenes:
    """Pages about the singularities of a batch with one input.

    `names` are the outputs; `points` and `relation` the rows of the tables.
    """

    batch: Batch
    sampled: SampledSingularities
    names: Sequence[str]
    points: Row
    relation: Row

    def pages(self) -> tuple[Scene, ...]:
        """Return the page of singularities, if they have places, and one of each mode."""
        pages = []
        for number, rows in self.batch.assembly_mode_rows().items():
            drawn = [self._input_output(output, rows) for output in range(len(self.names))]
            pages.append(
                Scene(
                    number,
                    (
                        *drawn,
                        *relation_plots(self.relation, len(self.batch), rows),
                        *self._marked(rows),
                    ),
                )
            )
        if np.any(np.isfinite(self.points["s"])):
            pages.insert(0, self._gallery())
        return tuple(pages)

    def _marked(self, rows: slice) -> list[Primitive]:
        """Return the inputs at which singularities of an assembly mode are."""
        if self.batch.timed:
            return []
        points, mode = self.points, str(int(self.batch.assembly_mode[rows.start]))
        here = [mode in modes.split("+") for modes in points["assembly_mode"]]
        places: dict[str, list[float]] = {}
        for kind, q in zip(points["kind"][here], points["q"][here], strict=True):
            if kind in TONES:
                places.setdefault(str(kind), []).append(q)
        parts: list[Primitive] = []
        for kind, inputs in places.items():
            q = np.unique([place for place in inputs if np.isfinite(place)])[:, None]
            parts.append(InputMarks(f"marks/{kind}", f"type {kind}", q, TONES[kind]))
        return parts

    def _drawn(self, curve: int, output: int) -> tuple[Floats, Floats]:
        """Return places (k,) along a curve, and the input and the output (k, 2) there."""

        def drawn() -> tuple[Floats, Floats]:
            sampled = self.sampled
            s = np.linspace(0.0, sampled.curves[curve].length * (1.0 - 1e-12), DRAWN)
            q, turned = sampled.input_at(curve, s), sampled.output_angle(curve, output, s)
            return s, np.stack([q, turned], axis=1)

        return self.batch.once(("drawn", curve, output), drawn)

    def _place(self, curve: int, output: int, s: float) -> Floats:
        """Return where a place of a curve is drawn, (2,)."""
        along, line = self._drawn(curve, output)
        return line[int(np.argmin(np.abs(along - s)))]

    def _input_output(self, output: int, rows: slice) -> Portrait:
        """Return the output against the input, all curves drawn, singularities marked."""
        batch, sampled, name = self.batch, self.sampled, self.names[output]
        curves: list[PlaneCurve] = []
        marks: list[Mark] = []
        at = np.full((len(batch), 2), np.nan)
        for number in range(len(sampled.curves)):
            s, line = self._drawn(number, output)
            curves.append(PlaneCurve(without_jumps(line), LINE_TONE))
            (on_curve,) = np.nonzero(sampled.curve == number)
            nearest = np.clip(np.searchsorted(s, sampled.s[on_curve]), 0, DRAWN - 1)
            at[on_curve] = np.stack([batch.q[on_curve], line[nearest, 1]], axis=1)
            for point in sampled.report.points:
                shown = (
                    point.curve == number and point.output == sampled.report.outputs[output]
                )
                if shown:
                    place, kind = self._place(number, output, point.s), str(point.type)
                    if np.all(np.isfinite(place)):
                        marks.append(Mark(f"type {kind}", place, TONES[kind]))
        return plane(
            f"plots/input_output/{name.replace('/', '_')}",
            f"output {name} against the input",
            at[rows],
            (f"input {batch.moving_inputs[0]}", f"output {name}"),
            curves,
            marks,
        )

    def _gallery(self) -> Scene:
        """Return a page on which row k is singularity k, with what coincides there."""
        sampled, every = self.sampled, self.points
        points = {k: v[np.isfinite(every["s"])] for k, v in every.items()}
        n = len(points["kind"])
        outputs = [self.names.index(name) for name in points["output"]]
        places = list(zip(points["curve"].tolist(), points["s"].tolist(), strict=True))
        six = [
            sampled.report.at(curve, np.array([s]), output)[2][-1].poles
            for (curve, s), output in zip(places, outputs, strict=True)
        ]
        turned = np.stack([sampled.configuration(*place) for place in places])
        planes = np.stack([_planes(*at) for at in zip(six, points["kind"], strict=True)])
        parts: list[Primitive] = [*link_bodies(sampled.tracer.mechanism, turned)]
        for name, words in _AXES.items():
            axes = np.concatenate([getattr(poles, name) for poles in six])
            if np.any(np.isfinite(axes)):
                parts.append(Arrow(f"pole/{name}", words, axes, False, path_shown=False))
        for k, words in enumerate(("plane of one triplet", "plane of the other")):
            parts.append(GreatCircle(f"plane/{k}", words, planes[:, k]))
        lines = [GALLERY]
        for k in range(n):
            kind, condition, mode, output = (
                points[name][k] for name in ("kind", "condition", "assembly_mode", "output")
            )
            q = f"{np.degrees(points['q'][k]):.4f}"
            lines.append(f"| {k} | {kind} | {condition} | {mode} | {q} | {output} |")
        lines += ["", "What coincides:", ""]
        for note in dict.fromkeys(note for note in points["note"].tolist() if note):
            (rows,) = np.nonzero(points["note"] == note)
            lines.append(f"- {numbered('sample', rows.tolist())}: {note}")
        parts.append(Text("list", "Singularities", "\n".join(lines)))
        for output in range(len(self.names)):
            at = np.full((n, 2), np.nan)
            for row, (curve, s) in enumerate(places):
                if outputs[row] == output:
                    at[row] = points["q"][row], self._place(curve, output, s)[1]
            whole = self._input_output(output, slice(None))
            parts.append(replace(whole, x=at[:, 0], y=at[:, 1]))
        over = Axis("singularity", "", np.arange(n, dtype=float))
        return Scene("Singularities", tuple(parts), (over,))


def _planes(six: SixPoles, kind: str) -> Floats:
    """Return the normals (2, 3) of the planes that coincide in a type of singularity."""
    planes = np.full((2, 3), np.nan)
    for k, names in enumerate(_COINCIDE["I" if kind == "I" else "II"]):
        vectors = six.stacked(names)[0]
        normals = np.cross(vectors, np.roll(vectors, -1, axis=0))
        sizes = np.nan_to_num(np.linalg.norm(normals, axis=1))
        best = int(np.argmax(sizes))
        if sizes[best] > 0.0:
            planes[k] = normals[best] / sizes[best]
    return planes


@dataclass(frozen=True)
class SeveralScenes:
    """Pages about the singularities of a batch with several inputs, by its outputs.

    `loci` are what is found of each output, curves or surfaces; `relation` has the rows of
    that table.
    """

    batch: Batch
    outputs: Sequence[Output]
    loci: Callable[[Output], Sequence[SingularCurves | SingularSurface]]
    relation: Row

    def pages(self) -> tuple[Scene, ...]:
        """Return plots of each mode, curves in the plane of inputs and on the sphere."""
        every = [(output, locus) for output in self.outputs for locus in self.loci(output)]
        pages = []
        for number, rows in self.batch.assembly_mode_rows().items():
            parts: list[Primitive] = []
            for output in self.outputs:
                curves = [
                    locus
                    for of, locus in every
                    if of is output and isinstance(locus, SingularCurves)
                ]
                if any(of_type.curves for of_type in curves):
                    parts.append(self._plane(output, curves, rows))
                    parts += self._on_sphere(output, curves)
            parts += relation_plots(self.relation, len(self.batch), rows)
            pages.append(Scene(number, tuple(parts)))
        surfaces = tuple(
            self._surface(output, locus)
            for output, locus in every
            if isinstance(locus, SingularSurface) and len(locus.triangles)
        )
        if surfaces:
            step = Axis("surfaces", "", np.zeros(1))
            pages.insert(0, Scene("Singular surfaces", surfaces, (step,)))
        return tuple(pages)

    def _plane(
        self, output: Output, loci: Sequence[SingularCurves], rows: slice
    ) -> Portrait:
        """Return the singular curves in the plane of both inputs."""
        curves: list[PlaneCurve] = []
        marks: list[Mark] = []
        for locus in loci:
            for curve in locus.curves:
                line = without_jumps(self._dense(curve).inputs)
                curves.append(PlaneCurve(line, TONES[locus.kind], words_of(locus.kind)))
                marks += _marks(curve.both.inputs)
        first, second = self.batch.moving_inputs
        return plane(
            f"plots/inputs/{output.name}",
            f"singular curves of {output.name} in the inputs",
            self.batch.inputs[rows],
            (first, second),
            curves,
            marks,
            [self.batch.inputs],
        )

    def _on_sphere(self, output: Output, loci: Sequence[SingularCurves]) -> list[Primitive]:
        """Return the singular curves as what the output points at, in ground axes.

        The third axis of an output without a direction.
        """
        return [
            SphereCurves(
                f"singular/{output.name}/{locus.kind}",
                f"{words_of(locus.kind)} of {output.name}",
                [_directions(self._dense(curve)) for curve in locus.curves],
                TONES[locus.kind],
                [m for curve in locus.curves for m in _marks(_directions(curve.both))],
            )
            for locus in loci
        ]

    def _dense(self, curve: CurveSeen) -> SingularPoints:
        return self.batch.once(("dense", id(curve)), lambda: curve.dense(PARTS))

    def _surface(self, output: Output, mesh: SingularSurface) -> Surface:
        a, b, c = self.batch.moving_inputs
        return Surface(
            f"plots/surface/{output.name}/{mesh.kind}",
            f"{words_of(mesh.kind)} of {output.name}",
            mesh.points.inputs,
            mesh.triangles,
            (a, b, c),
            TONES[mesh.kind],
            "rad",
        )


def _marks(places: Floats) -> list[Mark]:
    return [Mark("type III", place, TONES["III"]) for place in places]


def _directions(points: SingularPoints) -> Floats:
    if points.pointing is not None:
        return points.pointing
    return points.orientation[:, :, 2]
