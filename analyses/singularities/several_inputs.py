"""The half of the analysis `singularities` for mechanisms with several inputs."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from spherekit.plugin import (
    Axis,
    Batch,
    Findings,
    Floats,
    Mark,
    Mechanism,
    Output,
    PlaneCurve,
    Portrait,
    Primitive,
    Scene,
    SphereCurves,
    Surface,
    counted,
    input_columns,
    numbered,
)
from spherekit.plugin.rotations import wrap
from spherekit.plugin.singularities import (
    Aspects,
    Completeness,
    CurveSeen,
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
    mid_plane_loci,
    moved_by_all,
    output_of,
    ranges_of,
    singular_curves,
    singular_surface,
    solver_of,
    what_vanishes,
)

from .scenes import SELF_MOTION, TONES, plane, relation_plots, without_jumps, words_of
from .tables import (
    ASPECTS,
    RELATION,
    SINGULARITIES,
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
PARTS = 8
"""Parts of each way between two nodes of a singular curve that is drawn."""
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


Locus = SingularCurves | SingularSurface
"""What is found of a type: curves of two inputs, surfaces of three."""


@dataclass(frozen=True)
class SeveralInputs:
    """Singularities of the rows of a mechanism with several inputs.

    `slices` is the number of values at which each input is locked to look for singular
    curves, or surfaces where `mesh` (rad) is the length of their triangles' edges; with 0
    there is none, and by default random starts are the seeds of what no dyads cut quickly.
    `input_grid` is the number of values of each input for aspects, by default 11 where an
    output may be free of type I, and `seconds` the processor time that all this may take.
    """

    batch: Batch
    slices: int | None
    mesh: float | None
    input_grid: int | None
    near: float
    seconds: float

    @cached_property
    def at_slices(self) -> int:
        """The number of slices, by default what dyads of two inputs allow."""
        if self.slices is not None:
            return self.slices
        two = len(self.batch.moving_inputs) == 2
        return SLICES if two and self.batch.tracer.assembly.has_closed_form else 0

    @cached_property
    def sides(self) -> tuple[float, int]:
        """The length (rad) of the edges that a mesh is laid with, and halvings.

        0 for no mesh.
        """
        widths = [abs(item.stop - item.start) for item in self.batch.mechanism.inputs]
        longest = min(LONGEST_SIDE, min(widths) / SIDES)
        if self.mesh is None:
            return longest, HALVED
        if not self.mesh:
            return 0.0, 0
        halved = int(np.clip(np.log2(longest / self.mesh), 0, HALVED))
        return self.mesh * 2**halved, halved

    @cached_property
    def points(self) -> Row:
        """The main table: points of singular curves or surfaces, by output."""
        parts: list[Row] = []
        for output in self.batch.mechanism.outputs:
            met = np.zeros((0, len(self.batch.mechanism.variable_names)))
            number = 0
            name = named(self.batch.mechanism, output)
            for locus in self.loci[output.name]:
                if locus.everywhere:
                    told = {"kind": locus.kind, "inside": "yes", "residual": 0.0}
                    told |= {"output": name, "curve": -1, **_claimed(locus.claim)}
                    parts.append(told | {"note": "in every configuration"})
                elif isinstance(locus, SingularSurface):
                    vertices = self._rows(locus.points, output, locus.claim)
                    note = "vertex of a surface"
                    parts.append(vertices | {"curve": locus.component, "note": note})
                else:
                    for curve in locus.curves:
                        whole = self._rows(curve.points, output, locus.claim)
                        note = "closed" if curve.closed else "open"
                        whole |= {"curve": number, "s": curve.s, "note": note}
                        whole |= {"condition": curve.why} if curve.why else {}
                        away = np.abs(wrap(curve.both.values[:, None] - met))
                        fresh = ~np.any(np.max(away, axis=2) < SAME, axis=1)
                        parts.append(whole)
                        if fresh.any():
                            both = self._rows(curve.both.rows(fresh), output, locus.claim)
                            kind = {"kind": "III", "note": "of both types"}
                            parts.append(both | kind | {"curve": number})
                        met = np.concatenate([met, curve.both.values])
                        number += 1
        return SINGULARITIES.stacked(self.batch.mechanism, parts)

    def _rows(self, points: SingularPoints, output: Output, claim: Completeness) -> Row:
        batch = self.batch
        mechanism = self.batch.mechanism
        number = mechanism.link_number
        rest = output_of(mechanism, output.name)
        links = number[output.link], number[output.relative_to]
        motion = batch.tracer.given(points.values)
        return {
            "kind": [RowType(code).label for code in points.type],
            "condition": what_vanishes(motion, rest, points.pointing, batch.tracer.by_rank),
            **input_columns(mechanism, points.inputs),
            **configuration_columns(batch, points.values, links, points.pointing),
            "inside": np.where(points.inside, "yes", "no"),
            "output": named(mechanism, output),
            "residual": points.residual,
            **_claimed(claim),
        }

    @cached_property
    def relation(self) -> Row:
        """c_i w_i = d_i q_i' and nearness of every row, by output and input."""
        parts: list[Row] = []
        batch = self.batch
        for output in batch.mechanism.outputs:
            rows = self.coefficients[output.name]
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
                "type": [RowType(code).label for code in rows.type],
                "group": rows.group,
            }
            by_input = {
                "c": rows.c,
                "d": rows.d,
                "velocity_coefficient": np.vecdot(rows.w, rows.u),
                "output_rate": rows.output_rate,
                "input_rate": rows.input_rate,
            }
            parts += [
                {**whole, "moving": pair, **{name: x[:, k] for name, x in by_input.items()}}
                for k, pair in enumerate(batch.moving_inputs)
            ]
        return RELATION.stacked(batch.mechanism, parts)

    @property
    def aspects(self) -> Row:
        """The configurations over an input grid, with the number of their aspect."""
        parts = self._found[1]
        mechanism = self.batch.mechanism
        if parts is None:
            return ASPECTS.stacked(mechanism)
        rows = {
            "aspect": parts.label,
            **input_columns(mechanism, parts.inputs),
            "sign_II": parts.sign_two[parts.label],
            "sign_I": parts.sign_one[parts.label],
            "assembly_modes": parts.modes[parts.label],
        }
        return ASPECTS.stacked(mechanism, [rows])

    def findings(self) -> Findings:
        """Return curves, aspects and claims, and where rows come near a type."""
        batch = self.batch
        parts = self._found[1]
        figures: dict[str, Any] = {"slices": self.at_slices}
        warnings: list[str] = []
        remarks: list[str] = []
        everywhere: set[str] = set()
        for output in batch.mechanism.outputs:
            name = named(batch.mechanism, output)
            loci = self.loci[output.name]
            always = [locus.kind for locus in loci if locus.everywhere]
            told = [f"{of_type(kind)} in every configuration" for kind in always]
            figures[name] = {"everywhere": sorted(always)}
            everywhere.update(always)
            for locus in loci:
                if not locus.everywhere:
                    counts, words = _in_words(locus)
                    key = locus.kind.replace("-", "_")
                    figures[name] |= {f"{what}_{key}": n for what, n in counts.items()}
                    told.append(f"{words}; {counts['claim']}")
            rows = self.coefficients[output.name]
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
            figures["aspects"] = parts.sizes.tolist()
            figures["aspects_guarantee"] = parts.guarantee
            figures["singular_on_lattice"] = parts.singular
            if parts.note or not (len(parts.sizes) or everywhere):
                remarks.append(
                    f"{counted(len(parts.sizes), 'aspect')}; "
                    f"{counted(parts.singular, 'configuration')} met are singular"
                    + f"; {parts.note}"
                    * bool(parts.note)
                )
        return Findings(figures, tuple(warnings), tuple(remarks))

    @property
    def loci(self) -> dict[str, list[Locus]]:
        """What is found of each output by its name."""
        return self._found[0]

    @cached_property
    def _found(self) -> tuple[dict[str, list[Locus]], Aspects | None]:
        """All that takes of the time: types of outputs, then self-motions, aspects.

        Each takes an even part of the time that is left. What every pair moves has its
        self-motions on the locus of type II.
        """
        mechanism = self.batch.mechanism
        budget = TimeLimit(self.seconds)
        names = [output.name for output in mechanism.outputs]
        input_grid = self.input_grid
        if input_grid is None:
            input_grid = INPUT_GRID if len(mechanism.inputs) <= MOST_INPUTS else 0
        surfaces = len(mechanism.inputs) == MOST_INPUTS and self.sides[0] > 0.0
        sought: list[tuple[LocusName, str]] = []
        if self.slices != 0 and (len(mechanism.inputs) == 2 or surfaces):
            sought = [(kind, name) for name in names for kind in KINDS]
            apart = (name for name in names if not moved_by_all(mechanism, name))
            sought += [(SELF_MOTION, name) for name in apart]
        slices = self.at_slices
        made = None
        if slices and sought:
            share = budget.part(FOR_SLICES, "slices")
            made = cut(solver_of(mechanism), ranges_of(mechanism), slices, share)
        loci: dict[str, list[Locus]] = {name: [] for name in names}
        for number, (kind, name) in enumerate(sought):
            left = len(sought) - number + (input_grid > 0)
            share = budget.part(1.0 / left, f"singularities {of_type(kind)}")
            loci[name].append(self._searched(kind, name, made, share))
        if not input_grid:
            return loci, None
        share = budget.part(1.0, "aspects")
        return loci, aspects(mechanism, input_grid, KINDS, names[0], budget=share)

    def _searched(
        self,
        kind: LocusName,
        output: str,
        made: LockedInputSection | None,
        budget: TimeLimit,
    ) -> Locus:
        """Look for a type: curves of a mid-plane architecture, or as slices find them."""
        mechanism = self.batch.mechanism
        if len(mechanism.inputs) == MOST_INPUTS:
            side, halved = self.sides
            return singular_surface(
                mechanism, kind, output, None, side, halved, 0, made=made, budget=budget
            )
        if made is None and kind != SELF_MOTION:
            curves = mid_plane_loci(mechanism, kind, output, budget)
            if curves is not None:
                return curves
        return singular_curves(mechanism, kind, output, None, 0, made=made, budget=budget)

    @cached_property
    def coefficients(self) -> dict[str, OutputCoefficients]:
        """The rows as each output sees them, by its name."""
        tracer = self.batch.tracer
        mechanism = self.batch.mechanism
        return {
            output.name: coefficients(
                self.batch.motion, output_of(mechanism, output.name), tracer.by_rank
            )
            for output in mechanism.outputs
        }

    def scenes(self) -> tuple[Scene, ...]:
        """Return plots of each mode, curves in the plane of inputs and on the sphere."""
        pages = []
        outputs = self.batch.mechanism.outputs
        surfaces = tuple(
            Surface(
                f"plots/surface/{output.name}/{mesh.kind}",
                f"{words_of(mesh.kind)} of {output.name}",
                mesh.points.inputs,
                mesh.triangles,
                (a, b, c),
                TONES[mesh.kind],
                "rad",
            )
            for output in outputs
            for mesh in self.loci[output.name]
            if isinstance(mesh, SingularSurface) and len(mesh.triangles)
            for a, b, c in [self.batch.moving_inputs]
        )
        if surfaces:
            pages.append(
                Scene("Singular surfaces", surfaces, (Axis("surfaces", "", np.zeros(1)),))
            )
        for number, rows in self.batch.assembly_mode_rows().items():
            parts: list[Primitive] = []
            for output in outputs:
                curves = [
                    locus
                    for locus in self.loci[output.name]
                    if isinstance(locus, SingularCurves) and locus.curves
                ]
                if curves:
                    parts.append(self._plane(output, curves, rows))
                    parts += self._on_sphere(output, curves)
            parts += relation_plots(self.relation, len(self.batch), rows)
            pages.append(Scene(number, tuple(parts)))
        return tuple(pages)

    def _plane(
        self, output: Output, loci: Sequence[SingularCurves], rows: slice
    ) -> Portrait:
        """Return the singular curves in the plane of both inputs."""
        curves = [
            PlaneCurve(
                without_jumps(self._dense(curve).inputs),
                TONES[locus.kind],
                words_of(locus.kind),
            )
            for locus in loci
            for curve in locus.curves
        ]
        first, second = self.batch.moving_inputs
        return plane(
            f"plots/inputs/{output.name}",
            f"singular curves of {output.name} in the inputs",
            self.batch.inputs[rows],
            (first, second),
            curves,
            [m for x in loci for curve in x.curves for m in _marks(curve.both.inputs)],
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


def _marks(places: Floats) -> list[Mark]:
    return [Mark("type III", place, TONES["III"]) for place in places]


def _directions(points: SingularPoints) -> Floats:
    return points.orientation[:, :, 2] if points.pointing is None else points.pointing


def _claimed(claim: Completeness) -> Row:
    """Return what is known of a place on a locus."""
    return {"double": "no", "certain": "yes", "guarantee": claim.guarantee.value}


def _in_words(locus: Locus) -> tuple[dict[str, Any], str]:
    """Return what is found of a type, as figures and in words."""
    if isinstance(locus, SingularSurface):
        what = "surface"
        irregular = locus.irregular
        count = len(locus.nodes)
        figures = {"vertices": count, "irregular": irregular, "claim": locus.guarantee}
        words = f"{count} vertices of surfaces {of_type(locus.kind)}"
    else:
        what = "curve"
        irregular = len(locus.stray)
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
        kinds = set(rows.type[in_mode].tolist()) - {RowType.UNKNOWN}
        if len(kinds) == 1 and kinds != {RowType.REGULAR}:
            modes.setdefault(RowType(kinds.pop()).label, []).append(number)
    return modes


def named(mechanism: Mechanism, output: Output) -> str:
    """Return the links of an output, with its name where another one has these too."""
    links = f"{output.link}/{output.relative_to}"
    every = [f"{o.link}/{o.relative_to}" for o in mechanism.outputs]
    return links if every.count(links) == 1 else f"{links} {output.name}"
