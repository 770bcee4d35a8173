"""Singularities: where a mechanism locks or loses control, and how near it comes."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, final

import numpy as np
from numpy.typing import NDArray

from spherekit.plugin import (
    ASSEMBLY_MODE,
    INPUTS,
    SAMPLE,
    STATUS,
    AbstractAnalysis,
    AnalysisError,
    Arrow,
    Axis,
    Batch,
    Column,
    Findings,
    GreatCircle,
    InputMarks,
    Mark,
    Mechanism,
    Needs,
    PlaneCurve,
    Portrait,
    Primitive,
    Scene,
    Series,
    Status,
    Table,
    TableData,
    Text,
    counted,
    link_bodies,
    numbered,
)
from spherekit.plugin.designs import Merit, middle_pairs
from spherekit.plugin.singularities import (
    RelationAt,
    RelationMeasures,
    SampledSingularities,
    SingularPoint,
    SixPoles,
    Type,
    grashof,
    ordered_pole,
)

from .several_singularities import MOST_INPUTS, SeveralInputs, no_aspects
from .singular_words import least_transmission, places, swings

Floats = NDArray[np.float64]

Row = dict[str, Any]

LINE_TONE = 4
TONES = {"I": 1, "II": 2, "III": 3, "apparent": 0}
NUMBERED = ("I", "II", "III")
RESTS = 1e-8
"""A rate by arc length below this is none."""
SAYS_NOTHING = 1e-12
"""Where c and d are smaller, or none, axes coincide that say nothing of the rates."""
DRAWN = 721
"""Points with which a whole configuration curve is drawn."""


@final
@dataclass(frozen=True, kw_only=True)
class SingularityAnalysis(AbstractAnalysis):
    """Singularities of types I, II and III, and the distance from them along the motion.

    `near` (degrees) is the angle to a singularity below which a warning is given. With one
    input `output` lists the relative motions of interest, such as ``41`` or ``4/1``; by
    default the outputs that the mechanism declares.

    With several inputs the outputs are those declared. Singular curves of two inputs and
    surfaces of three are looked for on `slices` values of each, 0 for none: by default 12
    if there are two inputs and all groups are dyads, else from random starts, since each
    slice then costs seconds to minutes. `mesh` is the length of the edges of surfaces
    (degrees), 0 for none, by default a sixteenth of the narrowest range. Aspects are found
    over `input_grid` values of each input, 0 for none, by default 11 of at most three
    inputs, as an output of more can always rest. All that ends after `seconds` of
    processor time with what it has.
    """

    name: ClassVar[str] = "singularities"
    version: ClassVar[str] = "1"
    summary: ClassVar[str] = "singularities of types I, II, III, and how near they are"
    cites: ClassVar[tuple[str, ...]] = (
        "R. Di Gregorio, Proc. IMechE C 227(8), 2013, 1830-1840",
        "R. Di Gregorio, J. Mechanisms and Robotics 7(3), 2015, 031008",
    )
    tables: ClassVar[tuple[Table, ...]] = (
        Table(
            "singularities",
            "one row per singularity and output",
            (
                Column("kind", "", "I, II or III", "text"),
                Column("condition", "", "geometric conditions that hold", "text"),
                Column("assembly_mode", "", "assembly modes that it belongs to", "text"),
                INPUTS,
                Column("inside", "", "whether the inputs are in their ranges", "text"),
                Column("output", "", "link relative to link", "text"),
                Column("curve", "", "number of the configuration curve", "integer"),
                Column("s", "rad", "place on it, in its own arc length"),
                Column("error", "rad", "bound of the error of the place"),
                Column("residual", "", "sine by which the condition is missed"),
                Column("turns", "", "what reverses there: input, output, both", "text"),
                Column("double", "", "whether it is only touched", "text"),
                Column("decided", "", "whether the kind is certain", "text"),
                Column("guarantee", "", "what is known of those not listed", "text"),
                Column("note", "", "what coincides, what is in doubt", "text"),
            ),
        ),
        Table(
            "relation",
            "c y' = d q' and nearness, one row per sample, assembly mode, output and form",
            (
                SAMPLE,
                ASSEMBLY_MODE,
                INPUTS,
                Column("output", "", "link relative to link: y'", "text"),
                Column("form", "", "i or ii", "text"),
                Column("c", "", "coefficient of the output rate"),
                Column("d", "", "coefficient of the input rate"),
                Column("velocity_coefficient", "", "y'/q' = d/c, infinite at type II"),
                Column("angle_I", "rad", "by which axes or planes miss type I"),
                Column("angle_II", "rad", "by which axes or planes miss type II"),
                Column("output_rate", "", "of y by the arc length of all variables"),
                Column("input_rate", "", "of q by the arc length of all variables"),
                Column("transmission", "rad", "transmission angle of the output's dyad"),
                Column("to_I", "rad", "change of the input to the nearest type I"),
                Column("to_II", "rad", "change of the input to the nearest type II"),
                Column("sigma", "", "least singular value of the passive equations"),
                Column("reciprocal_condition", "", "its part of the greatest one"),
                STATUS,
                Column("moving", "", "the moving input, the others locked", "text"),
                Column("type", "", "regular, I, II, III, loose or branching", "text"),
                Column("group", "", "1: of a single-freedom part, 2: of none", "integer"),
            ),
        ),
        Table(
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
        ),
    )

    output: tuple[str, ...] = ()
    near: float = 5.0
    slices: int | None = None
    mesh: float | None = None
    input_grid: int | None = None
    seconds: float = 50.0

    def outputs(self, mechanism: Mechanism) -> tuple[tuple[int, int], ...]:
        """Return the relative motions wanted, as numbers of links."""
        if self.output:
            return tuple(ordered_pole(mechanism, text) for text in self.output)
        number = mechanism.link_number
        moved = [set(_ends(mechanism, item.pair)) for item in mechanism.inputs]
        declared = [(number[o.link], number[o.relative_to]) for o in mechanism.outputs]
        others = [links for links in declared if set(links) not in moved]
        if others:
            return tuple(dict.fromkeys(others))
        driven = set().union(*moved)
        beside = [
            next(link for link in ends if link)
            for ends in mechanism.ends
            if 0 in ends and not set(ends) <= driven
        ]
        rest = beside or [k for k in range(1, len(mechanism.links)) if k not in driven]
        return tuple((link, 0) for link in dict.fromkeys(rest))

    def merits(self, mechanism: Mechanism) -> tuple[Merit, ...]:
        """Return the least transmission angle of each dyad, 0 at a type II singularity."""
        return tuple(
            Merit(
                f"least_transmission_angle_{pair}",
                "min",
                f"transmission_angle_{pair}",
                meaning=f"least angle between the arcs at pair {pair}, 0 at type II",
            )
            for pair in middle_pairs(mechanism)
        )

    def needs(self, mechanism: Mechanism) -> Needs:
        """Return the tracer, whose configuration curves are asked for more points."""
        if not self.near >= 0.0:
            raise AnalysisError(
                f"singularities: near: {self.near:g} is not an angle in degrees; 0 or "
                f"more is"
            )
        for name, value in (
            ("slices", self.slices),
            ("mesh", self.mesh),
            ("input_grid", self.input_grid),
            ("seconds", self.seconds),
        ):
            if value is not None and not value >= 0:
                raise AnalysisError(
                    f"singularities: {name}: {value:g} is negative; 0 leaves it out"
                )
        if len(mechanism.inputs) > 1:
            if self.output:
                raise AnalysisError(
                    "singularities: output: with several inputs the outputs are those that "
                    "the mechanism declares as [outputs.NAME]"
                )
            self._several.outputs(mechanism)
            if self.input_grid and len(mechanism.inputs) > MOST_INPUTS:
                raise AnalysisError(
                    f"singularities: input_grid: {no_aspects(mechanism)}; leave it out, or "
                    "give 0"
                )
        else:
            self.outputs(mechanism)
        return Needs(tracer=True)

    def compute(self, batch: Batch) -> Mapping[str, TableData]:
        """Return the tables of singularities and of the relation along the motion."""
        several = self._several
        if len(batch.moving_inputs) > 1:
            tables = [
                several.points(batch),
                several.relation(batch),
                several.aspect_rows(batch),
            ]
        else:
            tables = [self._points(batch), self._relation(batch), {}]
        data = {}
        for table, rows in zip(self.tables, tables, strict=True):
            columns = table.of(batch.mechanism).columns
            data[table.name] = {
                column.name: rows.get(column.name, np.zeros(0, dtype=_DTYPES[column.kind]))
                for column in columns
            }
        return data

    def scene(self, batch: Batch) -> tuple[Scene, ...]:
        """Return plots of each assembly mode, and what there is to see of singularities."""
        if len(batch.moving_inputs) > 1:
            return self._several.scenes(batch)
        pages = [
            Scene(number, tuple(self._plots(batch, rows)))
            for number, rows in batch.assembly_mode_rows().items()
        ]
        if np.any(np.isfinite(self._points(batch)["s"])):
            pages.insert(0, self._gallery(batch))
        return tuple(pages)

    def findings(self, batch: Batch) -> Findings:
        """Return how many singularities there are, and where a mode comes near one."""
        if len(batch.moving_inputs) > 1:
            return self._several.findings(batch)
        sampled = self._found(batch)
        relation = self._relation(batch)
        points = self._points(batch)
        inside = points["inside"] == "yes"
        figures: dict[str, Any] = {
            "singularities": _counted(points["kind"][inside]),
            "outside": _counted(points["kind"][~inside]),
            "configuration_curves": len(sampled.curves),
            "guarantee": str(sampled.configurations.claim),
            "checks_failed": list(sampled.configurations.mismatches),
            "notes": list(sampled.report.notes),
        }
        if sampled.report.everywhere is not None:
            figures["freedoms_everywhere"] = sampled.report.everywhere
        warnings = [*sampled.report.notes, *sampled.configurations.mismatches]
        if sampled.report.everywhere is not None:
            warnings.append(
                f"to a part in a million, the mechanism has {sampled.report.everywhere} "
                "freedoms in every configuration: it is singular everywhere, and its "
                "tables are empty"
            )
        for name in dict.fromkeys(points["output"][inside & (points["kind"] == "II")]):
            warnings.append(
                f"output {name} meets type II in the range: the locked input does not hold "
                "it there"
            )
        pair = batch.moving_inputs[0]
        names = [_named(batch.mechanism, links) for links in sampled.report.outputs]
        for kind, rate in (("I", "output_rate"), ("II", "input_rate")):
            slow = np.abs(relation[rate]) <= np.sin(np.radians(self.near))
            slow &= np.fmax(np.abs(relation["c"]), np.abs(relation["d"])) > SAYS_NOTHING
            angles = np.where(slow, np.degrees(relation[f"angle_{kind}"]), np.inf)
            for output in dict.fromkeys(relation["output"].tolist()):
                near = (relation["output"] == output) & (angles <= self.near)
                near &= ~np.isin(relation["assembly_mode"], _met(points, kind, output))
                if not np.any(near):
                    continue
                row = np.flatnonzero(near)[np.argmin(angles[near])]
                numbers = np.unique(relation["assembly_mode"][near])
                one, assembly_modes = len(numbers) == 1, numbered("assembly mode", numbers)
                warnings.append(
                    f"{assembly_modes} of output {output} come{'s' * one} within "
                    f"{self.near:g} deg of type {kind} without meeting it, nearest "
                    f"{angles[row]:.3g} deg in mode {relation['assembly_mode'][row]} at "
                    f"{pair} = {np.degrees(relation['q'][row]):.6g} deg"
                )
        counts = _in_words(figures["singularities"]) or "no singularities"
        beyond = _in_words(figures["outside"])
        if beyond:
            counts += f" in the range of the input, {beyond} outside"
        count = len(sampled.curves)
        remarks = [
            f"{counts} on {count} configuration {'curve' if count == 1 else 'curves'}; "
            f"{sampled.configurations.claim}"
        ]
        made = grashof(batch.mechanism)
        if made is not None:
            figures["grashof"] = made.name
            remarks.append(str(made))
        for name in names:
            remarks += places(sampled, points, name, pair)
        if sampled.report.everywhere is None:
            remarks += swings(sampled, names)
        remarks += least_transmission(sampled, points, relation, pair)
        return Findings(figures, tuple(warnings), tuple(remarks))

    @property
    def _several(self) -> SeveralInputs:
        side = None if self.mesh is None else float(np.radians(self.mesh))
        return SeveralInputs(self.slices, side, self.input_grid, self.near, self.seconds)

    def _found(self, batch: Batch) -> SampledSingularities:
        return batch.once(
            "found",
            lambda: SampledSingularities(
                batch.tracer,
                self.outputs(batch.mechanism),
                batch.motion.values,
                batch.assembly_mode,
            ),
        )

    def _points(self, batch: Batch) -> Row:
        return batch.once("points", lambda: self._listed(batch))

    def _listed(self, batch: Batch) -> Row:
        """Return the main table: points on curves, then where curves cross."""
        sampled = self._found(batch)
        claim = sampled.configurations.guarantee.value
        rows: list[Row] = []
        for point in sampled.report.points:
            if point.type is Type.APPARENT:
                continue
            agreeing = [at for at in point.relations if at.agrees]
            words = [item.words for at in agreeing for item in at.conditions]
            words = words or [at.note for at in point.relations]
            rows += [
                {
                    "kind": str(point.type),
                    **_conditions(agreeing),
                    **_placed(sampled, [(point.curve, point.s)], q),
                    "output": _named(batch.mechanism, point.output),
                    "curve": point.curve,
                    "s": point.s,
                    "error": point.error,
                    "turns": " and ".join(_turns(point)),
                    "double": "yes" if point.double else "no",
                    "decided": "yes" if point.decided else "no",
                    "guarantee": claim,
                    "note": "; ".join(filter(None, [point.note, *dict.fromkeys(words)])),
                }
                for q in sampled.inputs_of(point.curve, point.values)
            ]
        for crossing in sampled.report.crossings:
            ends = [
                (curve, 0.0 if at_start else sampled.curves[curve].length)
                for curve, at_start in crossing.ends
            ]
            met = crossing.crossing
            count = 0 if met is None else len(met.tangents)
            words = [
                f"{counted(count, 'curve')} cross" if count else "curves end",
                "ends of curves " + _joined(sorted({curve for curve, _ in ends}), ", "),
                crossing.note,
            ]
            curve, s = ends[0]
            for output, links in enumerate(sampled.report.outputs):
                on_assembly_modes = crossing.relations[output] if crossing.relations else ()
                rows += [
                    {
                        "kind": "III",
                        **_conditions(
                            [at for relations in on_assembly_modes for at in relations]
                        ),
                        **_placed(sampled, ends, q),
                        "output": _named(batch.mechanism, links),
                        "curve": curve,
                        "s": s,
                        "error": np.nan if met is None else met.error,
                        "turns": "",
                        "double": "no",
                        "decided": "yes" if crossing.decided else "no",
                        "guarantee": claim,
                        "note": "; ".join(filter(None, words)),
                    }
                    for q in sampled.inputs_of(curve, crossing.values)
                ]
        for whole in sampled.report.whole:
            pieces = sampled.configurations.curves[whole.curve].pieces
            rows.append(
                {
                    "kind": str(whole.type),
                    "condition": "",
                    "assembly_mode": _joined(
                        sorted(
                            {p.assembly_mode for p in pieces if p.assembly_mode is not None}
                        )
                    ),
                    "q": np.nan,
                    "inside": "yes",
                    "output": _named(batch.mechanism, whole.output),
                    "curve": whole.curve,
                    "s": np.nan,
                    "error": np.nan,
                    "residual": 0.0,
                    "turns": "",
                    "double": "no",
                    "decided": "yes",
                    "guarantee": claim,
                    "note": f"at rest on the whole of curve {whole.curve}",
                }
            )
        return {
            column.name: np.array(
                [row[column.name] for row in rows], dtype=_DTYPES[column.kind]
            )
            for column in self.tables[0].columns
        }

    def _relation(self, batch: Batch) -> Row:
        return batch.once("relation", lambda: self._measured(batch))

    def _measured(self, batch: Batch) -> Row:
        sampled = self._found(batch)
        sigma, reciprocal_condition = sampled.singular_values()
        n = len(batch)

        def ratio(measures: RelationMeasures) -> Floats:
            with np.errstate(divide="ignore", invalid="ignore"):
                return np.asarray(measures.output_rate / measures.input_rate)

        status = np.where(batch.status == Status.OK, sampled.status, batch.status)

        def kinds(measures: RelationMeasures) -> NDArray[Any]:
            finite = np.isfinite(measures.input_rate)
            rest = [np.abs(r) < RESTS for r in (measures.output_rate, measures.input_rate)]
            return np.select(
                [sampled.crossed, ~finite, rest[0] & rest[1], *rest],
                ["III", "", "III", "I", "II"],
                "regular",
            )

        parts: list[Row] = [
            {
                "sample": batch.sample,
                "assembly_mode": batch.assembly_mode,
                "q": batch.q,
                "output": np.full(
                    n, _named(batch.mechanism, sampled.report.outputs[measures.output])
                ),
                "form": np.full(n, str(measures.form)),
                "c": measures.c,
                "d": measures.d,
                "velocity_coefficient": ratio(measures),
                "output_rate": measures.output_rate,
                "input_rate": measures.input_rate,
                "angle_I": measures.type_i,
                "angle_II": measures.type_ii,
                "transmission": measures.transmission,
                "to_I": measures.to_i,
                "to_II": measures.to_ii,
                "sigma": sigma,
                "reciprocal_condition": reciprocal_condition,
                "status": status,
                "moving": np.full(n, batch.moving_inputs[0]),
                "type": kinds(measures),
                "group": (kinds(measures) != "regular").astype(np.int64),
            }
            for measures in sampled.measures()
        ]
        return {
            column.name: np.concatenate([part[column.name] for part in parts])
            if parts
            else np.zeros(0, dtype=_DTYPES[column.kind])
            for column in self.tables[1].columns
        }

    def _plots(self, batch: Batch, rows: slice) -> list[Primitive]:
        relation, n = self._relation(batch), len(batch)
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
        outputs = range(len(self._found(batch).report.outputs))
        drawn = [self._input_output(batch, output, rows) for output in outputs]
        return [*drawn, *parts, *self._marked(batch, rows)]

    def _marked(self, batch: Batch, rows: slice) -> list[Primitive]:
        """Return the inputs at which singularities of an assembly mode are."""
        if batch.timed:
            return []
        points = self._points(batch)
        mode = str(int(batch.assembly_mode[rows.start]))
        here = np.array(
            [mode in modes.split("+") for modes in points["assembly_mode"]], bool
        )
        parts: list[Primitive] = []
        for kind in dict.fromkeys(points["kind"][here].tolist()):
            q = points["q"][here & (points["kind"] == kind)]
            q = np.unique(q[np.isfinite(q)])[:, None]
            if kind in NUMBERED:
                parts.append(InputMarks(f"marks/{kind}", f"type {kind}", q, TONES[kind]))
        return parts

    def _input_output(self, batch: Batch, output: int, rows: slice) -> Portrait:
        """Return the output against the input, all curves drawn, singularities marked."""
        sampled = self._found(batch)
        links = sampled.report.outputs[output]
        curves: list[PlaneCurve] = []
        marks: list[Mark] = []
        x, y = np.full(len(batch), np.nan), np.full(len(batch), np.nan)
        for number in range(len(sampled.curves)):
            s, line = _drawn(sampled, number, output)
            jumps = np.max(np.abs(np.diff(line, axis=0)), axis=1) > np.pi
            broken = np.insert(line, np.flatnonzero(jumps) + 1, np.nan, axis=0)
            curves.append(PlaneCurve(broken, LINE_TONE))
            (on_curve,) = np.nonzero(sampled.curve == number)
            nearest = np.clip(np.searchsorted(s, sampled.s[on_curve]), 0, DRAWN - 1)
            x[on_curve], y[on_curve] = batch.q[on_curve], line[nearest, 1]
            for point in sampled.report.points:
                if point.curve == number and point.output == links:
                    place = line[int(np.argmin(np.abs(s - point.s)))]
                    if point.type is not Type.APPARENT and np.all(np.isfinite(place)):
                        kind = str(point.type)
                        marks.append(Mark(f"type {kind}", place, TONES[kind]))
        lines = [curve.points for curve in curves]
        every = np.concatenate(lines or [np.zeros((1, 2))])
        (left, low), (right, high) = np.nanmin(every, axis=0), np.nanmax(every, axis=0)
        name = _named(batch.mechanism, links)
        return Portrait(
            f"plots/input_output/{name.replace('/', '_')}",
            f"output {name} against the input",
            x[rows],
            y[rows],
            f"input {batch.moving_inputs[0]}",
            f"output {name}",
            (float(left), float(right)),
            (float(low), float(high)),
            "rad",
            "rad",
            curves,
            marks,
        )

    def _gallery(self, batch: Batch) -> Scene:
        """Return a page on which row k is singularity k, with what coincides there."""
        sampled, every = self._found(batch), self._points(batch)
        points = {k: v[np.isfinite(every["s"])] for k, v in every.items()}
        n = len(points["kind"])
        places = list(zip(points["curve"].tolist(), points["s"].tolist(), strict=True))
        turned = np.stack([sampled.configuration(*place) for place in places])
        planes = np.full((n, 2, 3), np.nan)
        axes = {name: np.full((n, 3), np.nan) for name in _AXES}
        names = [_named(batch.mechanism, links) for links in sampled.report.outputs]
        for k, (curve, s) in enumerate(places):
            at = sampled.at(curve, np.array([s]), names.index(points["output"][k]))
            if at.poles:
                for name in _AXES:
                    axes[name][k] = getattr(at.poles[-1], name)[0]
                planes[k] = _planes(at.poles[-1], points["kind"][k])
        parts: list[Primitive] = [
            *link_bodies(batch.mechanism, turned),
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
        for output in range(len(sampled.report.outputs)):
            whole = self._input_output(batch, output, slice(0, len(batch)))
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


_ANGLES = {
    "angle_I": "to type I",
    "angle_II": "to type II",
    "transmission": "transmission angle",
}
_AXES = {"ir": "ir", "or_": "or", "os": "os", "io": "io", "is_": "is", "rs": "rs"}
_DTYPES: Mapping[str, Any] = {
    "number": float,
    "integer": np.int64,
    "text": str,
    "status": np.int8,
}


def _drawn(sampled: SampledSingularities, curve: int, output: int) -> tuple[Floats, Floats]:
    """Return places (k,) along a curve, and the input and the output (k, 2) there."""
    s = np.linspace(0.0, sampled.curves[curve].length * (1.0 - 1e-12), DRAWN)
    q, turned = sampled.input_at(curve, s), sampled.output_angle(curve, output, s)
    return s, np.stack([q, turned], axis=1)


def _ends(mechanism: Mechanism, pair: str) -> tuple[int, int]:
    return mechanism.ends[mechanism.pair_number[pair]]


def _named(mechanism: Mechanism, links: tuple[int, int]) -> str:
    return "/".join(mechanism.links[k] for k in links)


def _counted(kinds: NDArray[Any]) -> dict[str, int]:
    return {str(kind): int(np.sum(kinds == kind)) for kind in np.unique(kinds)}


def _in_words(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{n} of type {kind}" for kind, n in counts.items())


def _met(points: Row, kind: str, output: str) -> list[int]:
    """Return the assembly modes in which an output meets a type of singularity."""
    here = (points["kind"] == kind) & (points["output"] == output)
    here &= points["inside"] == "yes"
    return [
        int(k) for modes in points["assembly_mode"][here] for k in modes.split("+") if k
    ]


def _joined(numbers: Iterable[int], sign: str = "+") -> str:
    return sign.join(map(str, numbers))


def _placed(
    sampled: SampledSingularities, ends: Iterable[tuple[int, float]], q: float
) -> Row:
    """Return the input of a singularity on curves, its modes, whether in the range."""
    assembly_modes = {
        b for curve, s in ends for b in sampled.assembly_modes_at(curve, s, q)
    }
    return {
        "assembly_mode": _joined(sorted(assembly_modes)),
        "q": q,
        "inside": "yes" if sampled.inside(q) else "no",
    }


def _turns(point: SingularPoint) -> list[str]:
    """Return what reverses at a singularity."""
    turns = []
    if point.input_turns and point.type is not Type.I:
        turns.append("input")
    if point.output_turns and point.type is not Type.II:
        turns.append("output")
    return turns


def _conditions(relations: Iterable[RelationAt]) -> Row:
    """Return the labels of the conditions that hold, and the least residual of them."""
    held = [item for at in relations for item in at.conditions]
    labels = dict.fromkeys(h.label + ("" if h.decided else "?") for h in held)
    least = min((h.residual for h in held), default=np.nan)
    return {"condition": " ".join(labels), "residual": least}


def _planes(six: SixPoles, kind: str) -> Floats:
    """Return the normals (2, 3) of the planes that coincide in a type of singularity."""
    triplets = {
        "I": (("io", "os", "is_"), ("ir", "is_", "rs")),
        "II": (("or_", "os", "rs"), ("io", "os", "is_")),
    }[kind if kind != "III" else "II"]
    planes = np.full((2, 3), np.nan)
    for k, names in enumerate(triplets):
        vectors = np.stack([getattr(six, name)[0] for name in names])
        normals = np.cross(vectors, np.roll(vectors, -1, axis=0))
        sizes = np.nan_to_num(np.linalg.norm(normals, axis=1))
        best = int(np.argmax(sizes))
        if sizes[best] > 0.0:
            planes[k] = normals[best] / sizes[best]
    return planes
