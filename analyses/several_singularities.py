"""The half of the analysis `singularities` for mechanisms with several inputs."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from spherekit.plugin import (
    Batch,
    Findings,
    Mechanism,
    Output,
    Scene,
    counted,
    input_columns,
    numbered,
)
from spherekit.plugin.rotations import wrap
from spherekit.plugin.singularities import (
    Aspects,
    Completeness,
    LockedInputSection,
    LocusName,
    OutputCoefficients,
    RowType,
    SingularCurves,
    SingularPoints,
    SingularSurface,
    TimeLimit,
    aspects,
    coefficients,
    cut,
    locus_key,
    mid_plane_loci,
    output_of,
    ranges_of,
    singular_curves,
    singular_surface,
    solver_of,
    what_vanishes,
)

from .singular_tables import (
    ASPECTS,
    RELATION,
    SELF_MOTION,
    SINGULARITIES,
    SeveralScenes,
    angle_of,
    configuration_columns,
    of_type,
)

Row = dict[str, Any]

KINDS: tuple[LocusName, ...] = ("II", "I")
FOR_SLICES = 0.4
"""Part of the time that slices may take."""
SAME = 1e-6
"""Points of type III whose variables differ by less (rad) are one, met on two curves."""
ROUNDED = 9
"""Places of an angle in degrees: further ones are rounding."""
SLICES = 12
"""Values of each input at which dyads are cut by default."""
SIDES = 4.0
"""Edges that a mesh is laid with along the narrowest range of an input, and the longest."""
HALVED = 2
"""How often edges are halved afterwards, with vertices on the surface."""
LONGEST_SIDE = np.radians(15.0)
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


Loci = dict[str, list[SingularCurves | SingularSurface]]
"""What is found of each output: curves of two inputs, surfaces of three."""


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

    def slices_of(self, batch: Batch) -> int:
        """Return the number of slices, by default what dyads of two inputs allow."""
        if self.slices is not None:
            return self.slices
        two = len(batch.moving_inputs) == 2
        return SLICES if two and batch.tracer.assembly.has_closed_form else 0

    def side_of(self, mechanism: Mechanism) -> tuple[float, int]:
        """Return the length (rad) of the edges that a mesh is laid with, and halvings.

        0 for no mesh.
        """
        widths = [abs(item.stop - item.start) for item in mechanism.inputs]
        longest = float(min(LONGEST_SIDE, min(widths) / SIDES))
        if self.mesh is None:
            return longest, HALVED
        if not self.mesh:
            return 0.0, 0
        halved = int(np.clip(np.log2(longest / self.mesh), 0, HALVED))
        return self.mesh * 2**halved, halved

    def points(self, batch: Batch) -> Row:
        """Return the main table: points of singular curves or surfaces, by output."""
        parts: list[Row] = []
        for output in batch.mechanism.outputs:
            met = np.zeros((0, len(batch.mechanism.variable_names)))
            loci = self._found(batch)[0][output.name]
            parts += [_everywhere(batch, x, output) for x in loci if x.everywhere]
            number = 0
            for locus in loci:
                if isinstance(locus, SingularSurface):
                    vertices = _rows(batch, locus.points, output, locus.claim)
                    vertices |= {"curve": locus.component, "note": "vertex of a surface"}
                    parts.append(vertices)
                    continue
                for curve in locus.curves:
                    whole = _rows(batch, curve.points, output, locus.claim)
                    whole |= {"curve": number, "s": curve.s}
                    whole["note"] = "closed" if curve.closed else "open"
                    if curve.why:
                        whole["condition"] = curve.why
                    away = np.abs(wrap(curve.both.values[:, None] - met))
                    fresh = ~np.any(np.max(away, axis=2) < SAME, axis=1)
                    both = _rows(batch, curve.both.rows(fresh), output, locus.claim)
                    both |= {"kind": "III", "curve": number, "note": "of both types"}
                    parts += [whole, both]
                    met = np.concatenate([met, curve.both.values])
                    number += 1
        return SINGULARITIES.stacked(batch.mechanism, parts)

    def relation(self, batch: Batch) -> Row:
        """Return c_i w_i = d_i q_i' and nearness of every row, by output and input."""
        return batch.once(
            "relation", lambda: RELATION.stacked(batch.mechanism, self._related(batch))
        )

    def _related(self, batch: Batch) -> list[Row]:
        parts: list[Row] = []
        for output in batch.mechanism.outputs:
            rows = self._coefficients(batch, output)
            whole = {
                "sample": batch.sample,
                "assembly_mode": batch.assembly_mode,
                **input_columns(batch.mechanism, batch.inputs),
                "output": named(batch.mechanism, output),
                "form": "i",
                "distance_I": angle_of(rows.type_one),
                "distance_II": angle_of(rows.type_two),
                "sigma": rows.hold,
                "reciprocal_condition": rows.reciprocal_condition,
                "status": batch.status,
                "type": np.array(types_of(rows.type), dtype=str),
                "group": rows.group,
            }
            speed = np.sum(rows.w * rows.u, axis=2)
            by_input = {
                "c": rows.c,
                "d": rows.d,
                "velocity_coefficient": speed,
                "output_rate": rows.output_rate,
                "input_rate": rows.input_rate,
            }
            parts += [
                {**whole, "moving": pair, **{name: x[:, k] for name, x in by_input.items()}}
                for k, pair in enumerate(batch.moving_inputs)
            ]
        return parts

    def aspect_rows(self, batch: Batch) -> Row:
        """Return the configurations over an input grid, with the number of their aspect."""
        _, parts = self._found(batch)
        if parts is None:
            return ASPECTS.stacked(batch.mechanism)
        rows = {
            "aspect": parts.label,
            **input_columns(batch.mechanism, parts.inputs),
            "sign_II": parts.sign_two[parts.label],
            "sign_I": parts.sign_one[parts.label],
            "assembly_modes": parts.modes[parts.label],
        }
        return ASPECTS.stacked(batch.mechanism, [rows])

    def findings(self, batch: Batch) -> Findings:
        """Return curves, aspects and claims, and where rows come near a type."""
        figures: dict[str, Any] = {"slices": self.slices_of(batch)}
        warnings: list[str] = []
        remarks: list[str] = []
        everywhere: set[str] = set()
        by_output, parts = self._found(batch)
        for output in batch.mechanism.outputs:
            name, loci = named(batch.mechanism, output), by_output[output.name]
            always = [str(locus.kind) for locus in loci if locus.everywhere]
            told = [f"{of_type(kind)} in every configuration" for kind in always]
            figures[name] = {"everywhere": sorted(always)}
            everywhere |= set(always)
            for locus in loci:
                if not locus.everywhere:
                    counts, words = _in_words(locus)
                    key = locus.kind.replace("-", "_")
                    figures[name] |= {f"{what}_{key}": n for what, n in counts.items()}
                    told.append(f"{words}; {counts['claim']}")
            rows = self._coefficients(batch, output)
            throughout = {} if always else _throughout(batch, rows)
            told += [
                f"{of_type(kind)} in every row of " + numbered("assembly mode", numbers)
                for kind, numbers in throughout.items()
            ]
            remarks += [f"output {name}: {words}" for words in told]
            for kind, sizes in (("I", rows.type_one), ("II", rows.type_two)):
                told_already = np.isin(batch.assembly_mode, throughout.get(kind, []))
                angles = np.where(told_already, np.nan, np.degrees(angle_of(sizes)))
                near = angles <= self.near
                if kind not in always and np.any(near):
                    row = int(np.nanargmin(angles))
                    place = ", ".join(f"{q:.6g}" for q in np.degrees(batch.inputs[row]))
                    modes = numbered("assembly mode", np.unique(batch.assembly_mode[near]))
                    warnings.append(
                        f"type {kind} of output {name} comes within {self.near:g} deg of "
                        f"{modes}, nearest sample {round(angles[row], ROUNDED) + 0.0:.3g} "
                        f"deg on assembly mode {batch.assembly_mode[row]} at inputs "
                        f"{place} deg"
                    )
        if self.input_grid is None and len(batch.mechanism.inputs) > MOST_INPUTS:
            remarks.append(f"no aspects: {no_aspects(batch.mechanism)}")
        if parts is not None:
            figures["aspects"] = [int(size) for size in parts.sizes]
            figures["aspects_guarantee"] = parts.guarantee
            figures["singular_on_lattice"] = parts.singular
            if parts.note or not (len(parts.sizes) or everywhere):
                words = counted(len(parts.sizes), "aspect")
                if parts.singular:
                    words += (
                        f"; {counted(parts.singular, 'configuration')} met are singular"
                    )
                remarks.append("; ".join(filter(None, [words, parts.note])))
        return Findings(figures, tuple(warnings), tuple(remarks))

    def scenes(self, batch: Batch) -> tuple[Scene, ...]:
        """Return plots of each mode, curves in the plane of inputs and on the sphere."""
        return SeveralScenes(
            batch,
            batch.mechanism.outputs,
            lambda output: self._found(batch)[0][output.name],
            self.relation(batch),
        ).pages()

    def _found(self, batch: Batch) -> tuple[Loci, Aspects | None]:
        return batch.once("found", lambda: self._find(batch))

    def _find(self, batch: Batch) -> tuple[Loci, Aspects | None]:
        """Find all that takes of the time: types of outputs, then self-motions, aspects.

        Each takes an even part of the time that is left. Curves are looked for once for all
        that share their locus; what every pair moves has its self-motions on the locus of
        type II.
        """
        mechanism, budget = batch.mechanism, TimeLimit(self.seconds)
        names = [output.name for output in mechanism.outputs]
        input_grid = self.input_grid
        if input_grid is None:
            input_grid = INPUT_GRID if len(mechanism.inputs) <= MOST_INPUTS else 0
        surfaces = len(mechanism.inputs) == MOST_INPUTS and self.side_of(mechanism)[0] > 0.0
        sought: list[tuple[LocusName, str]] = []
        if self.slices != 0 and (len(mechanism.inputs) == 2 or surfaces):
            sought = [(kind, name) for name in names for kind in KINDS]
            sought += [
                (SELF_MOTION, name)
                for name in names
                if locus_key(mechanism, "II", name)
                != locus_key(mechanism, SELF_MOTION, name)
            ]
        slices, made = self.slices_of(batch), None
        if slices and sought:
            solver, ranges = solver_of(mechanism), ranges_of(mechanism)
            made = cut(solver, ranges, slices, budget.part(FOR_SLICES, "slices"))
        loci: Loci = {name: [] for name in names}
        by_key: dict[tuple[object, ...], SingularCurves | SingularSurface] = {}
        for number, (kind, name) in enumerate(sought):
            key = (kind, name) if surfaces else locus_key(mechanism, kind, name)
            shared = by_key.get(key)
            if isinstance(shared, SingularCurves) and shared.traced:
                loci[name].append(shared.seen_by(mechanism, kind, name))
                continue
            if shared is None:
                left = len(sought) - number + (input_grid > 0)
                what = f"{'surfaces' if surfaces else 'curves'} {of_type(kind)}"
                share = budget.part(1.0 / left, what)
                shared = by_key[key] = self._searched(mechanism, kind, name, made, share)
            loci[name].append(shared)
        if not input_grid:
            return loci, None
        share = budget.part(1.0, "aspects")
        return loci, aspects(mechanism, input_grid, ("I", "II"), names[0], budget=share)

    def _searched(
        self,
        mechanism: Mechanism,
        kind: LocusName,
        output: str,
        made: LockedInputSection | None,
        budget: TimeLimit,
    ) -> SingularCurves | SingularSurface:
        """Look for a type: curves of a mid-plane architecture, or as slices find them."""
        if len(mechanism.inputs) == MOST_INPUTS:
            side, halved = self.side_of(mechanism)
            return singular_surface(
                mechanism,
                kind,
                output,
                side=side,
                halved=halved,
                slices_of_each=0,
                made=made,
                budget=budget,
            )
        if made is None and kind != SELF_MOTION:
            curves = mid_plane_loci(mechanism, kind, output, budget)
            if curves is not None:
                return curves
        return singular_curves(
            mechanism, kind, output, slices_of_each=0, made=made, budget=budget
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


def _in_words(locus: SingularCurves | SingularSurface) -> tuple[dict[str, Any], str]:
    """Return what is found of a type, as figures and in words."""
    if isinstance(locus, SingularSurface):
        what, count, irregular = "surface", len(locus.points.values), locus.irregular
        figures = {"vertices": count, "irregular": irregular, "claim": locus.guarantee}
        words = f"{count} vertices of surfaces {of_type(locus.kind)}"
    else:
        what, irregular = "curve", len(locus.stray)
        count = sum(bool(np.any(curve.points.inside)) for curve in locus.curves)
        beyond = len(locus.curves) - count
        figures = {"curves": count, "curves_outside": beyond, "claim": str(locus.claim)}
        words = f"{counted(count, 'curve')} {of_type(locus.kind)}"
        words += f" and {beyond} outside the ranges" if beyond else ""
    if irregular:
        words += (
            f"; {counted(irregular, 'configuration')} met are singular where the locus is "
            f"not a regular {what}, and not listed"
        )
    return figures, words


def _throughout(batch: Batch, rows: OutputCoefficients) -> dict[str, list[int]]:
    """Return by type which assembly modes are singular in every row that is known."""
    modes: dict[str, list[int]] = {}
    for number, in_mode in batch.assembly_mode_rows().items():
        kinds = set(rows.type[in_mode].tolist()) - {int(RowType.UNKNOWN)}
        if len(kinds) == 1 and kinds != {int(RowType.REGULAR)}:
            modes.setdefault(types_of([kinds.pop()])[0], []).append(number)
    return modes


def _everywhere(
    batch: Batch, locus: SingularCurves | SingularSurface, output: Output
) -> Row:
    """Return the row of an output that is of a type in every configuration."""
    return {
        "kind": locus.kind,
        "inside": "yes",
        "output": named(batch.mechanism, output),
        "residual": 0.0,
        "double": "no",
        "certain": "yes",
        "guarantee": locus.claim.guarantee.value,
        "curve": -1,
        "note": "in every configuration",
    }


def _rows(batch: Batch, points: SingularPoints, output: Output, claim: Completeness) -> Row:
    number = batch.mechanism.link_number
    links = number[output.link], number[output.relative_to]
    return {
        "kind": types_of(points.type),
        "condition": _conditions(batch, points, output),
        **input_columns(batch.mechanism, points.inputs),
        **configuration_columns(batch, points.values, links, points.pointing),
        "inside": np.where(points.inside, "yes", "no"),
        "output": named(batch.mechanism, output),
        "residual": points.residual,
        "double": "no",
        "certain": "yes",
        "guarantee": claim.guarantee.value,
    }


def _conditions(batch: Batch, points: SingularPoints, output: Output) -> list[str]:
    """Return in words what makes configurations (n,) singular."""
    motion = batch.tracer.given(points.values)
    rest = output_of(batch.mechanism, output.name)
    return what_vanishes(motion, rest, points.pointing, batch.tracer.by_rank)


def named(mechanism: Mechanism, output: Output) -> str:
    """Return the links of an output, with its name where another one has these too."""
    links = f"{output.link}/{output.relative_to}"
    alike = [o for o in mechanism.outputs if f"{o.link}/{o.relative_to}" == links]
    return links if len(alike) == 1 else f"{links} {output.name}"


def types_of(codes: Iterable[int]) -> list[str]:
    """Return the labels of `RowType`s."""
    return [RowType(code).label for code in codes]
