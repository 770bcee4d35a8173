"""What the analysis `singularities` shows of a mechanism with several inputs."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import final

import numpy as np

from spherekit.plugin import (
    Axis,
    Batch,
    Floats,
    Mark,
    Output,
    PlaneCurve,
    Portrait,
    Primitive,
    Scene,
    Series,
    SphereCurves,
    Surface,
)
from spherekit.plugin.singularities import (
    CurveSeen,
    OutputCoefficients,
    SingularCurves,
    SingularPoints,
    SingularSurface,
)

from .singular_planes import TONES, plane, without_jumps
from .singular_tables import SELF_MOTION

DRAWN = 8
"""Parts of each way between two nodes of a curve that is drawn."""


@final
@dataclass(frozen=True)
class SeveralScenes:
    """Pages about the singularities of a batch, of what is found for each output."""

    batch: Batch
    outputs: Sequence[Output]
    curves: Callable[[Output], Sequence[SingularCurves]]
    surfaces: Callable[[Output], Sequence[SingularSurface]]
    coefficients: Callable[[Output], OutputCoefficients]

    def pages(self) -> tuple[Scene, ...]:
        """Return plots of each mode, curves in the plane of inputs and on the sphere."""
        pages = []
        for number, rows in self.batch.assembly_mode_rows().items():
            parts: list[Primitive] = []
            for output in self.outputs:
                if any(of_type.curves for of_type in self.curves(output)):
                    parts.append(self._plane(output, rows))
                    parts += self._on_sphere(output)
                parts += self._plots(output, rows)
            pages.append(Scene(number, tuple(parts)))
        surfaces = tuple(
            _surface(self.batch, output, mesh)
            for output in self.outputs
            for mesh in self.surfaces(output)
            if len(mesh.triangles)
        )
        if surfaces:
            step = Axis("surfaces", "", np.zeros(1))
            pages.insert(0, Scene("Singular surfaces", surfaces, (step,)))
        return tuple(pages)

    def _plots(self, output: Output, rows: slice) -> list[Primitive]:
        of_output = self.coefficients(output)
        parts: list[Primitive] = []
        for moved, pair in enumerate(self.batch.moving_inputs):
            for name, values in (("c", of_output.c), ("d", of_output.d)):
                where = f"plots/relation/{output.name}/{pair}/{name}"
                if not np.any(np.isfinite(values)):
                    continue
                label = f"{name} by {pair}"
                group = f"input-output relation of {output.name}"
                parts.append(Series(where, label, group, values[rows, moved]))
        for kind, sizes in (("I", of_output.type_one), ("II", of_output.type_two)):
            where = f"plots/angles/{output.name}/{kind}"
            values = angle_of(sizes)[rows]
            group = f"angles of {output.name}"
            parts.append(Series(where, f"to type {kind}", group, values, "rad"))
        return parts

    def _plane(self, output: Output, rows: slice) -> Portrait:
        """Return the singular curves in the plane of both inputs."""
        curves: list[PlaneCurve] = []
        marks: list[Mark] = []
        for of_type in self.curves(output):
            for curve in of_type.curves:
                line = without_jumps(self._drawn(curve).inputs)
                curves.append(PlaneCurve(line, TONES[of_type.kind], _words(of_type.kind)))
                both = curve.both.inputs
                marks += [Mark("type III", place, TONES["III"]) for place in both]
        first, second = self.batch.moving_inputs
        return plane(
            f"plots/inputs/{output.name}",
            f"singular curves of {output.name} in the inputs",
            self.batch.inputs[rows],
            (first, second),
            curves,
            marks,
            spanned=self.batch.inputs,
        )

    def _on_sphere(self, output: Output) -> list[Primitive]:
        """Return the singular curves as what the output points at, in ground axes.

        The third axis of an output without a direction.
        """
        parts: list[Primitive] = []
        for of_type in self.curves(output):
            lines, marks = [], []
            for curve in of_type.curves:
                lines.append(_directions(self._drawn(curve)))
                marks += [
                    Mark("type III", place, TONES["III"])
                    for place in _directions(curve.both)
                ]
            parts.append(
                SphereCurves(
                    f"singular/{output.name}/{of_type.kind}",
                    f"{_words(of_type.kind)} of {output.name}",
                    lines,
                    TONES[of_type.kind],
                    marks,
                )
            )
        return parts

    def _drawn(self, curve: CurveSeen) -> SingularPoints:
        return self.batch.once(("drawn", id(curve)), lambda: curve.dense(DRAWN))


def angle_of(sizes: Floats) -> Floats:
    """Return (n,) rad: the angle of all motions to those that keep inputs or output."""
    return np.asarray(np.arcsin(np.minimum(sizes, 1.0)))


def _words(kind: str) -> str:
    return kind if kind == SELF_MOTION else f"type {kind}"


def _directions(points: SingularPoints) -> Floats:
    if points.pointing is not None:
        return points.pointing
    return points.orientation[:, :, 2]


def _surface(batch: Batch, output: Output, mesh: SingularSurface) -> Surface:
    a, b, c = batch.moving_inputs
    return Surface(
        f"plots/surface/{output.name}/{mesh.kind}",
        f"{_words(mesh.kind)} of {output.name}",
        mesh.points.inputs,
        mesh.triangles,
        (a, b, c),
        TONES[mesh.kind],
        "rad",
    )
