"""The half of the analysis `singularities` for mechanisms with several inputs."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from spherekit.plugin import (
    Axis,
    Batch,
    Findings,
    Mark,
    Mechanism,
    Output,
    PlaneCurve,
    Portrait,
    Primitive,
    Scene,
    Series,
    SphereCurves,
    Surface,
    counted,
    input_columns,
    numbered,
)
from spherekit.plugin.singularities import (
    Aspects,
    Budget,
    Claim,
    CurveSeen,
    Cut,
    OutputCoefficients,
    RowType,
    SingularCurves,
    SingularPoints,
    SingularSurface,
    TypeName,
    aspects,
    coefficients,
    cut,
    mid_plane_loci,
    output_of,
    ranges_of,
    singular_curves,
    singular_surface,
    solver_of,
)

Floats = NDArray[np.float64]
Row = dict[str, Any]

KINDS: tuple[TypeName, ...] = ("II", "I")
FOR_SLICES = 0.4
"""Part of the time that slices may take."""
VANISHES = 1e-8
"""A coefficient or triple product below this vanishes."""
SAME = 1e-6
"""Points of type III whose variables differ by less (rad) are one, met on two curves."""
SLICES = 12
"""Values of each input at which dyads are cut by default."""
SIDES = 4.0
"""Edges that a mesh is laid with along the narrowest range of an input, and the longest."""
HALVED = 2
"""How often edges are halved afterwards, with vertices on the surface."""
LONGEST_SIDE = np.radians(15.0)
DRAWN = 8
"""Parts of each way between two nodes of a curve that is drawn."""
TONES = {"I": 1, "II": 2, "III": 3}
_WORDS = {"loose": "loose", "branching": "branching"}
NAMES = {
    RowType.REGULAR: "regular",
    RowType.LOOSE: "loose",
    RowType.BRANCHING: "branching",
    RowType.UNKNOWN: "",
}


MOST_INPUTS = 3
"""The freedoms that an output has at most."""
INPUT_GRID = 11
"""Values of each input for aspects, unless told."""


def no_aspects(mechanism: Mechanism) -> str:
    """Return why a mechanism of more than three inputs has none."""
    return (
        f"with {len(mechanism.inputs)} inputs an output can always rest: it has "
        f"{MOST_INPUTS} freedoms at most, so no part is free of type I"
    )


@final
@dataclass(frozen=True)
class SeveralInputs:
    """Singularities of a mechanism with several inputs, asked for once in a run.

    `slices` is the number of values at which each input is locked to look for singular
    curves, or surfaces where `mesh` (rad) is the length of their triangles' edges; with 0
    there is none, and by default random starts are the seeds of what no dyads cut quickly.
    `input_grid` is the number of values of each input for aspects, by default 11 where an
    output may be free of type I, and `seconds` the processor time that all this may take.
    """

    slices: int | None
    mesh: float | None
    input_grid: int | None
    near: float
    seconds: float

    def input_grid_of(self, mechanism: Mechanism) -> int:
        """Return the number of values of each input for aspects, 0 for none."""
        if self.input_grid is not None:
            return self.input_grid
        return INPUT_GRID if len(mechanism.inputs) <= MOST_INPUTS else 0

    def slices_of(self, batch: Batch) -> int:
        """Return the number of slices, by default what dyads of two inputs allow."""
        if self.slices is not None:
            return self.slices
        two = len(batch.moving_inputs) == 2
        return SLICES if two and batch.tracer.assembly.has_closed_form else 0

    def side_of(self, batch: Batch) -> tuple[float, int]:
        """Return the length (rad) of the edges that a mesh is laid with, and halvings.

        0 for no mesh.
        """
        widths = [item.stop - item.start for item in batch.mechanism.inputs]
        longest = float(min(LONGEST_SIDE, min(widths) / SIDES))
        if self.mesh is None:
            return longest, HALVED
        if not self.mesh:
            return 0.0, 0
        halved = int(np.clip(np.log2(longest / self.mesh), 0, HALVED))
        return self.mesh * 2**halved, halved

    def outputs(self, mechanism: Mechanism) -> tuple[Output, ...]:
        """Return the outputs that the mechanism declares."""
        output_of(mechanism)
        return mechanism.outputs

    def points(self, batch: Batch) -> Row:
        """Return the main table: points of singular curves or surfaces, by output."""
        parts: list[Row] = []
        for output in self.outputs(batch.mechanism):
            met = np.zeros((0, len(batch.mechanism.variable_names)))
            curves = [
                (traced, of_type.claim)
                for of_type in self._curves(batch, output)
                for traced in of_type.curves
            ]
            for number, (curve, claim) in enumerate(curves):
                notes = "closed" if curve.closed else "open"
                where = number, curve.s
                made = _rows(batch, curve.points, output, *where, notes, claim)
                if curve.why:
                    made["condition"] = np.full(len(curve.points.values), curve.why)
                parts.append(made)
                where = number, np.full(len(curve.both.values), np.nan)
                both = _rows(batch, curve.both, output, *where, "of both types", claim)
                both["kind"][:] = "III"
                away = curve.both.values[:, None] - met
                lap = np.abs(away - 2.0 * np.pi * np.round(away / (2.0 * np.pi)))
                fresh = ~np.any(np.max(lap, axis=2) < SAME, axis=1)
                parts.append({name: column[fresh] for name, column in both.items()})
                met = np.concatenate([met, curve.both.values])
            for mesh in self._surfaces(batch, output):
                s = np.full(len(mesh.points.values), np.nan)
                words = "vertex of a surface"
                made = _rows(batch, mesh.points, output, 0, s, words, mesh.claim)
                made["curve"] = mesh.component.astype(np.int64)
                parts.append(made)
        return _stacked(parts)

    def relation(self, batch: Batch) -> Row:
        """Return c_i w_i = d_i q_i' and nearness of every row, by output and input."""
        parts: list[Row] = []
        n = len(batch)
        for output in self.outputs(batch.mechanism):
            of_output = self._coefficients(batch, output)
            kinds = np.array([_type(code) for code in of_output.type.tolist()], dtype=str)
            for moved, pair in enumerate(batch.moving_inputs):
                w, u = of_output.w[:, moved], of_output.u[:, moved]
                parts.append(
                    {
                        "sample": batch.sample,
                        "assembly_mode": batch.assembly_mode,
                        **input_columns(batch.mechanism, batch.inputs),
                        "output": np.full(n, _named(output)),
                        "form": np.full(n, "i"),
                        "c": of_output.c[:, moved],
                        "d": of_output.d[:, moved],
                        "velocity_coefficient": np.sum(w * u, axis=1),
                        "output_rate": of_output.output_rate[:, moved],
                        "input_rate": of_output.input_rate[:, moved],
                        "angle_I": _angle(of_output.type_one),
                        "angle_II": _angle(of_output.type_two),
                        "transmission": np.full(n, np.nan),
                        "to_I": np.full(n, np.nan),
                        "to_II": np.full(n, np.nan),
                        "sigma": of_output.hold,
                        "reciprocal_condition": of_output.reciprocal_condition,
                        "status": batch.status,
                        "moving": np.full(n, pair),
                        "type": kinds,
                        "group": of_output.group.astype(np.int64),
                    }
                )
        return _stacked(parts)

    def aspect_rows(self, batch: Batch) -> Row:
        """Return the configurations over an input grid, with the number of their aspect."""
        aspect_set = self._aspects(batch)
        if aspect_set is None:
            return {}
        two = aspect_set.sign_two[aspect_set.label].astype(np.int64)
        one = aspect_set.sign_one[aspect_set.label].astype(np.int64)
        return {
            "aspect": aspect_set.label.astype(np.int64),
            **input_columns(batch.mechanism, aspect_set.inputs),
            "sign_II": two,
            "sign_I": one,
            "assembly_modes": aspect_set.modes[aspect_set.label].astype(np.int64),
        }

    def findings(self, batch: Batch) -> Findings:
        """Return curves, aspects and claims, and where rows come near a type."""
        figures: dict[str, Any] = {"slices": self.slices_of(batch)}
        warnings: list[str] = []
        remarks: list[str] = []
        for output in self.outputs(batch.mechanism):
            name = _named(output)
            of_output: dict[str, Any] = {}
            for of_type in self._curves(batch, output):
                met = [curve for curve in of_type.curves if np.any(curve.points.inside)]
                of_output[f"curves_{of_type.kind}"] = len(met)
                of_output[f"curves_outside_{of_type.kind}"] = len(of_type.curves) - len(met)
                of_output[f"claim_{of_type.kind}"] = str(of_type.claim)
                beyond = len(of_type.curves) - len(met)
                words = f"{counted(len(met), 'curve')} of type {of_type.kind}"
                words += f" and {beyond} outside the ranges" if beyond else ""
                words += _irregular(len(of_type.stray), "curve")
                remarks.append(f"output {name}: {words}; {of_type.claim}")
            for mesh in self._surfaces(batch, output):
                of_output[f"vertices_{mesh.kind}"] = len(mesh.points.values)
                of_output[f"irregular_{mesh.kind}"] = mesh.irregular
                of_output[f"claim_{mesh.kind}"] = mesh.guarantee
                count = len(mesh.points.values)
                words = f"{count} vertices of surfaces of type {mesh.kind}"
                words += _irregular(mesh.irregular, "surface")
                remarks.append(f"output {name}: {words}; {mesh.guarantee}")
            figures[name] = of_output
            rows = self._coefficients(batch, output)
            remarks += _throughout(batch, rows, name)
            for kind, sizes in (("I", rows.type_one), ("II", rows.type_two)):
                angles = np.degrees(_angle(sizes))
                near = angles <= self.near
                if np.any(near):
                    row = int(np.nanargmin(angles))
                    place = ", ".join(f"{q:.6g}" for q in np.degrees(batch.inputs[row]))
                    assembly_modes = numbered(
                        "assembly mode", np.unique(batch.assembly_mode[near])
                    )
                    warnings.append(
                        f"type {kind} of output {name} comes within {self.near:g} deg of "
                        f"{assembly_modes}, nearest {angles[row]:.3g} deg on assembly mode "
                        f"{batch.assembly_mode[row]} at inputs {place} deg"
                    )
        parts = self._aspects(batch)
        if self.input_grid is None and len(batch.mechanism.inputs) > MOST_INPUTS:
            remarks.append(f"no aspects: {no_aspects(batch.mechanism)}")
        if parts is not None:
            figures["aspects"] = [int(size) for size in parts.sizes]
            figures["aspects_guarantee"] = parts.guarantee
            figures["singular_on_lattice"] = parts.singular
            if parts.note or not len(parts.sizes):
                words = counted(len(parts.sizes), "aspect")
                if parts.singular:
                    words += (
                        f"; {counted(parts.singular, 'configuration')} met are singular"
                    )
                remarks.append("; ".join(filter(None, [words, parts.note])))
        return Findings(figures, tuple(warnings), tuple(remarks))

    def scenes(self, batch: Batch) -> tuple[Scene, ...]:
        """Return plots of each mode, curves in the plane of inputs and on the sphere."""
        pages = []
        for number, rows in batch.assembly_mode_rows().items():
            parts: list[Primitive] = []
            for output in self.outputs(batch.mechanism):
                if any(of_type.curves for of_type in self._curves(batch, output)):
                    parts.append(self._plane(batch, output, rows))
                    parts += self._on_sphere(batch, output)
                parts += self._plots(batch, output, rows)
            pages.append(Scene(number, tuple(parts)))
        surfaces = tuple(
            _surface(batch, output, mesh)
            for output in self.outputs(batch.mechanism)
            for mesh in self._surfaces(batch, output)
            if len(mesh.triangles)
        )
        if surfaces:
            step = Axis("surfaces", "", np.zeros(1))
            pages.insert(0, Scene("Singular surfaces", surfaces, (step,)))
        return tuple(pages)

    def _plots(self, batch: Batch, output: Output, rows: slice) -> list[Primitive]:
        of_output = self._coefficients(batch, output)
        parts: list[Primitive] = []
        for moved, pair in enumerate(batch.moving_inputs):
            for name, values in (("c", of_output.c), ("d", of_output.d)):
                where = f"plots/relation/{output.name}/{pair}/{name}"
                if not np.any(np.isfinite(values)):
                    continue
                label = f"{name} by {pair}"
                group = f"input-output relation of {output.name}"
                parts.append(Series(where, label, group, values[rows, moved]))
        for kind, sizes in (("I", of_output.type_one), ("II", of_output.type_two)):
            where = f"plots/angles/{output.name}/{kind}"
            values = _angle(sizes)[rows]
            group = f"angles of {output.name}"
            parts.append(Series(where, f"to type {kind}", group, values, "rad"))
        return parts

    def _plane(self, batch: Batch, output: Output, rows: slice) -> Portrait:
        """Return the singular curves in the plane of both inputs."""
        curves: list[PlaneCurve] = []
        marks: list[Mark] = []
        for of_type in self._curves(batch, output):
            for curve in of_type.curves:
                line = self._drawn(batch, curve).inputs.copy()
                jumps = np.abs(np.diff(line, axis=0, prepend=line[:1])) > np.pi
                line[np.any(jumps, axis=1)] = np.nan
                curves.append(PlaneCurve(line, TONES[of_type.kind], f"type {of_type.kind}"))
                both = curve.both.inputs
                marks += [Mark("type III", place, TONES["III"]) for place in both]
        here = batch.inputs
        every = np.concatenate([here, *(curve.points for curve in curves)])
        (left, bottom), (right, top) = np.nanmin(every, axis=0), np.nanmax(every, axis=0)
        first, second = batch.moving_inputs
        return Portrait(
            f"plots/inputs/{output.name}",
            f"singular curves of {output.name} in the inputs",
            here[rows, 0],
            here[rows, 1],
            first,
            second,
            (float(left), float(right)),
            (float(bottom), float(top)),
            "rad",
            "rad",
            curves,
            marks,
        )

    def _on_sphere(self, batch: Batch, output: Output) -> list[Primitive]:
        """Return the singular curves as what the output points at, in ground axes.

        The third axis of an output without a direction.
        """
        parts: list[Primitive] = []
        for of_type in self._curves(batch, output):
            lines, marks = [], []
            for curve in of_type.curves:
                lines.append(_directions(self._drawn(batch, curve)))
                marks += [
                    Mark("type III", place, TONES["III"])
                    for place in _directions(curve.both)
                ]
            parts.append(
                SphereCurves(
                    f"singular/{output.name}/{of_type.kind}",
                    f"type {of_type.kind} of {output.name}",
                    lines,
                    TONES[of_type.kind],
                    marks,
                )
            )
        return parts

    def _cut(self, batch: Batch) -> Cut | None:
        """Return the slices for curves or surfaces of both types and all outputs."""
        slices = self.slices_of(batch)
        if not slices:
            return None
        return batch.once(
            "cut",
            lambda: cut(
                solver_of(batch.mechanism),
                ranges_of(batch.mechanism),
                slices,
                self._budget(batch).part(FOR_SLICES, "slices"),
            ),
        )

    def _budget(self, batch: Batch) -> Budget:
        """Return the time of all searches, which runs from the first one on."""
        return batch.once("budget", lambda: Budget(self.seconds))

    def _share(self, batch: Batch, kind: TypeName, output: str, what: str) -> Budget:
        """Return the budget of one set of curves or surfaces: an even part of what is left.

        The sets are found in the order of outputs and types, the aspects last.
        """
        names = [other.name for other in self.outputs(batch.mechanism)]
        grid = self.input_grid_of(batch.mechanism)
        sets = len(KINDS) * len(names) + (grid > 0)
        done = len(KINDS) * names.index(output) + KINDS.index(kind)
        return self._budget(batch).part(1.0 / (sets - done), f"{what} of type {kind}")

    def _curves(self, batch: Batch, output: Output) -> Sequence[SingularCurves]:
        if len(batch.moving_inputs) != 2 or self.slices == 0:
            return ()
        return batch.once(
            ("curves", output.name),
            lambda: tuple(self._curves_of(batch, kind, output.name) for kind in KINDS),
        )

    def _curves_of(self, batch: Batch, kind: TypeName, output: str) -> SingularCurves:
        """Return the curves of a type: of a mid-plane architecture, or as slices find."""
        made = self._cut(batch)
        budget = self._share(batch, kind, output, "curves")
        if made is None:
            curves = mid_plane_loci(batch.mechanism, kind, output, budget)
            if curves is not None:
                return curves
        return singular_curves(
            batch.mechanism, kind, output, slices_of_each=0, made=made, budget=budget
        )

    def _drawn(self, batch: Batch, curve: CurveSeen) -> SingularPoints:
        return batch.once(("drawn", id(curve)), lambda: curve.dense(DRAWN))

    def _surfaces(self, batch: Batch, output: Output) -> Sequence[SingularSurface]:
        side, halved = self.side_of(batch)
        if len(batch.moving_inputs) != 3 or self.slices == 0 or not side:
            return ()
        return batch.once(
            ("surfaces", output.name),
            lambda: tuple(
                singular_surface(
                    batch.mechanism,
                    kind,
                    output.name,
                    side=side,
                    halved=halved,
                    slices_of_each=0,
                    made=self._cut(batch),
                    budget=self._share(batch, kind, output.name, "surfaces"),
                )
                for kind in KINDS
            ),
        )

    def _aspects(self, batch: Batch) -> Aspects | None:
        input_grid = self.input_grid_of(batch.mechanism)
        if not input_grid:
            return None
        name = self.outputs(batch.mechanism)[0].name
        return batch.once(
            "aspects",
            lambda: aspects(
                batch.mechanism,
                input_grid,
                ("I", "II"),
                name,
                budget=self._budget(batch).part(1.0, "aspects"),
            ),
        )

    def _coefficients(self, batch: Batch, output: Output) -> OutputCoefficients:
        return batch.once(
            ("coefficients", output.name),
            lambda: coefficients(
                batch.motion,
                output_of(batch.mechanism, output.name),
                by_rank=batch.tracer.by_rank,
            ),
        )


def _conditions(batch: Batch, points: SingularPoints, output: Output) -> NDArray[Any]:
    """Return (n,) text: which c_i and d_i vanish, which u_i are coplanar.

    Or which u_i is the direction that counts, which then rests though its link turns.
    Where none of these says it, what else does.
    """
    if not len(points.values):
        return np.zeros(0, dtype=str)
    motion = batch.tracer.given(points.values)
    rest = output_of(batch.mechanism, output.name)
    at = coefficients(motion, rest, by_rank=batch.tracer.by_rank)
    pairs = batch.moving_inputs
    # At a singularity the plan's axes may be unknown; the rates vanish with c and d.
    c = np.where(np.isfinite(at.c), at.c, at.input_rate)
    d = np.where(np.isfinite(at.d), at.d, at.output_rate)
    u = np.where(np.isfinite(at.u), at.u, at.alone)
    words: list[list[str]] = [[] for _ in points.values]

    def note(sizes: Floats, text: Callable[[int], str]) -> None:
        for row, which in zip(*np.nonzero(sizes < VANISHES), strict=True):
            words[row].append(text(which))

    note(np.abs(c), lambda k: f"c_{pairs[k]}=0")
    note(np.abs(d), lambda k: f"d_{pairs[k]}=0")
    if points.pointing is not None:
        turned = motion.rotations[:, rest.relative_to]
        direction = np.einsum("nij,nj->ni", turned, points.pointing)
        off = np.linalg.norm(np.cross(u, direction[:, None]), axis=2)
        note(off, lambda k: f"u_{pairs[k]} along the direction")
    triples = [", ".join(pairs[k] for k in three) for three in at.triplets]
    volumes = [np.abs(np.linalg.det(u[:, list(three)])) for three in at.triplets]
    if volumes:
        note(np.stack(volumes, axis=1), lambda k: f"u of {triples[k]} coplanar")
    two = list(combinations(range(len(pairs)), 2))
    named = [f"u_{pairs[j]} and u_{pairs[k]}" for j, k in two]
    crossed = np.stack([np.cross(u[:, j], u[:, k]) for j, k in two], axis=1)
    parallel = np.linalg.norm(crossed, axis=2)
    others = [(parallel, "{} along one line")]
    if points.pointing is not None:
        flat = np.abs(np.einsum("npi,ni->np", crossed, direction))
        others.append((flat, "{} coplanar with the direction"))
    for sizes, text in others:
        for row in np.flatnonzero(np.any(sizes < VANISHES, axis=1)).tolist():
            if not words[row]:
                near = np.flatnonzero(sizes[row] < VANISHES)
                words[row] += [text.format(named[k]) for k in near]
    for row, row_words in enumerate(words):
        if row_words:
            continue
        if at.reciprocal_condition[row] < VANISHES:
            row_words.append("the loops lose rank")
        elif not np.all(np.isfinite(u[row])):
            row_words.append("pole axes not known")
        else:
            least = f"{np.min(np.abs([c[row], d[row]])):.1e}"
            row_words.append(f"motions alone: no c, d below {least}")
    return np.array([" ".join(listed) for listed in words], dtype=str)


def _irregular(count: int, what: str) -> str:
    """Return in words how many singular configurations lie on no regular part."""
    if not count:
        return ""
    return (
        f"; {counted(count, 'configuration')} met are singular where the locus is not a "
        f"regular {what}, "
        "and not listed"
    )


def _throughout(batch: Batch, rows: OutputCoefficients, name: str) -> list[str]:
    """Return in words which assembly modes are singular in every row that is known."""
    modes: dict[str, list[int]] = {}
    for number, in_mode in batch.assembly_mode_rows().items():
        kinds = set(rows.type[in_mode].tolist()) - {int(RowType.UNKNOWN)}
        if len(kinds) == 1 and kinds != {int(RowType.REGULAR)}:
            modes.setdefault(_type(kinds.pop()), []).append(number)
    return [
        f"output {name}: {_WORDS.get(kind, f'of type {kind}')} in every row of "
        + numbered("assembly mode", numbers)
        for kind, numbers in modes.items()
    ]


def _rows(
    batch: Batch,
    points: SingularPoints,
    output: Output,
    curve: int,
    s: Floats,
    note: str,
    claim: Claim,
) -> Row:
    n = len(points.values)
    return {
        "kind": np.full(n, points.kind, dtype="<U8"),
        "condition": _conditions(batch, points, output),
        "assembly_mode": np.full(n, ""),
        **input_columns(batch.mechanism, points.inputs),
        "inside": np.where(points.inside, "yes", "no"),
        "output": np.full(n, _named(output)),
        "curve": np.full(n, curve),
        "s": s,
        "error": np.full(n, np.nan),
        "residual": points.residual,
        "turns": np.full(n, ""),
        "double": np.full(n, "no"),
        "decided": np.full(n, "yes"),
        "guarantee": np.full(n, claim.guarantee.value),
        "note": np.full(n, note),
    }


def _stacked(parts: list[Row]) -> Row:
    if not parts:
        return {}
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _angle(sizes: Floats) -> Floats:
    """Return (n,) rad: the angle of all motions to those that keep inputs or output."""
    return np.asarray(np.arcsin(np.minimum(sizes, 1.0)))


def _named(output: Output) -> str:
    return f"{output.link}/{output.relative_to}"


def _type(code: int) -> str:
    kind = RowType(code)
    return NAMES.get(kind, kind.name)


def _directions(points: SingularPoints) -> Floats:
    if points.pointing is not None:
        return points.pointing
    return points.orientation[:, :, 2]


def _surface(batch: Batch, output: Output, mesh: SingularSurface) -> Surface:
    a, b, c = batch.moving_inputs
    return Surface(
        f"plots/surface/{output.name}/{mesh.kind}",
        f"type {mesh.kind} of {output.name}",
        mesh.points.inputs,
        mesh.triangles,
        (a, b, c),
        TONES[mesh.kind],
        "rad",
    )
