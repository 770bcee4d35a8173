"""The half of the analysis `singularities` for mechanisms with one input."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from spherekit.plugin import (
    Arrow,
    Axis,
    Batch,
    Findings,
    Floats,
    GreatCircle,
    InputMarks,
    Mark,
    PlaneCurve,
    Portrait,
    Primitive,
    Scene,
    Status,
    Text,
    counted,
    link_bodies,
    listing,
)
from spherekit.plugin.rotations import wrap
from spherekit.plugin.singularities import (
    NearMiss,
    SampledSingularities,
    SingularPoint,
    Type,
    grashof,
    near_misses,
)

from .findings import coming_near, least_angles, places, swings
from .scenes import SELF_MOTION, TONES, plane, relation_plots, without_jumps
from .tables import ASPECTS, RELATION, SINGULARITIES, configuration_columns, of_type

Row = dict[str, Any]

RESTS = 1e-8
"""A rate by arc length below this is none."""
LINE_TONE = 4
DRAWN = 721
"""Points with which a whole configuration curve is drawn."""
AXES = ("ir", "or_", "os", "io", "is_", "rs")
COINCIDE = {
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


@dataclass(frozen=True)
class OneInput:
    """Singularities of the rows of a mechanism with one input.

    `outputs` are the relative motions of interest, as numbers of links; `near` (degrees)
    is the angle to a singularity below which a warning is given.
    """

    batch: Batch
    outputs: tuple[tuple[int, int], ...]
    near: float

    @cached_property
    def sampled(self) -> SampledSingularities:
        """The singularities on all curves, and the rows on these."""
        batch = self.batch
        return SampledSingularities(
            batch.tracer,
            self.outputs,
            batch.motion.values,
            batch.assembly_mode,
            None if batch.motion.sense is None else batch.q,
        )

    @cached_property
    def names(self) -> list[str]:
        """The outputs by names of links."""
        return [self._named(links) for links in self.sampled.report.outputs]

    def _named(self, links: Iterable[int]) -> str:
        return "/".join(self.sampled.tracer.mechanism.links[k] for k in links)

    @cached_property
    def points(self) -> Row:
        """The main table: points on curves, where curves cross, then whole curves."""
        sampled = self.sampled
        certain = {"double": "no", "guarantee": sampled.configurations.guarantee.value}
        rows: list[Row] = []
        for point in (*sampled.report.points, *sampled.report.crossings):
            rows += self._rows(point)
        for whole in sampled.report.resting_curves:
            rows.append(
                {
                    "kind": str(whole.type),
                    "assembly_mode": _joined(
                        sampled.modes_of(sampled.configurations.curves[whole.curve].pieces)
                    ),
                    "inside": "yes",
                    "output": self._named(whole.output),
                    "curve": whole.curve,
                    "residual": 0.0,
                    "certain": "yes",
                    "note": f"at rest on the whole of curve {whole.curve}",
                }
            )
        return SINGULARITIES.stacked(self.batch.mechanism, [certain | row for row in rows])

    def _rows(self, point: SingularPoint) -> list[Row]:
        """Return a row for each input of the range at which a singularity is met."""
        sampled = self.sampled
        ends = point.places
        part = None if sampled.tracer is self.batch.tracer else sampled.tracer
        crossed = point.type is Type.III
        relations = [at for at in point.relations if crossed or at.agrees]
        held = [item for at in relations for item in at.conditions]
        words = [item.words for item in held] or [at.note for at in point.relations]
        if crossed:
            count = 0 if point.crossing is None else len(point.crossing.tangents)
            numbers = sorted({curve for curve, _ in ends})
            words = [
                f"{counted(count, 'curve')} cross" if count else "curves end",
                f"ends of curves {_joined(numbers, ', ')}",
            ]
        notes = [*words, point.note] if crossed else [point.note, *words]
        turns = (
            "input" * (point.input_turns and point.type is not Type.I),
            "output" * (point.output_turns and point.type is not Type.II),
        )
        whole = {
            **configuration_columns(
                self.batch, point.values[None], point.output, part=part
            ),
            "kind": str(point.type),
            "certain": "yes" if point.certain else "no",
            "error": point.error,
            "reversal": " and ".join(filter(None, turns)),
            "double": "yes" if point.double else "no",
            "condition": " ".join(
                dict.fromkeys(h.label + ("" if h.certain else "?") for h in held)
            ),
            "residual": min((h.residual for h in held), default=np.nan),
            "output": self._named(point.output),
            "curve": point.curve,
            "s": point.s,
            "note": "; ".join(dict.fromkeys(filter(None, notes))),
        }
        return [
            {
                **whole,
                "assembly_mode": _joined(modes),
                "q": q,
                "inside": "yes" if inside else "no",
            }
            for q, modes, inside in sampled.met(ends, point.values)
        ]

    @cached_property
    def relation(self) -> Row:
        """C y' = d q' and nearness of every row, by output and form."""
        batch = self.batch
        sampled = self.sampled
        sigma, reciprocal_condition = sampled.singular_values()
        status = np.where(batch.status == Status.OK, sampled.status, batch.status)
        rows: list[Row] = []
        for (output, form), columns in sampled.measures().items():
            rates = columns["output_rate"], columns["input_rate"]
            still, held = (np.abs(rate) < RESTS for rate in rates)
            kinds = np.select(
                [sampled.crossed, np.isnan(rates[1]), still & held, still, held],
                ["III", "", SELF_MOTION, "I", "II"],
                "regular",
            )
            with np.errstate(divide="ignore", invalid="ignore"):
                ratio = rates[0] / rates[1]
            rows.append(
                {
                    **columns,
                    "sample": batch.sample,
                    "assembly_mode": batch.assembly_mode,
                    "q": batch.q,
                    "output": self.names[output],
                    "form": form,
                    "velocity_coefficient": ratio,
                    "sigma": sigma,
                    "reciprocal_condition": reciprocal_condition,
                    "status": status,
                    "moving": batch.moving_inputs[0],
                    "type": kinds,
                    "group": np.isin(kinds, ("I", "II", "III")).astype(np.int64),
                }
            )
        return RELATION.stacked(batch.mechanism, rows)

    @property
    def aspects(self) -> Row:
        """No rows: aspects are those of several inputs."""
        return ASPECTS.stacked(self.batch.mechanism)

    def findings(self) -> Findings:
        """Return how many singularities there are, and where a mode comes near one."""
        sampled = self.sampled
        points = self.points
        names = self.names
        report = sampled.report
        configurations = sampled.configurations
        inside = points["inside"] == "yes"
        curves = counted(len(sampled.curves), "configuration curve")
        here, beyond = (
            dict(sorted(Counter(points["kind"][some].tolist()).items()))
            for some in (inside, ~inside)
        )
        misses = near_misses(sampled, np.radians(self.near))
        figures: dict[str, Any] = {
            "singularities": here,
            "outside": beyond,
            "configuration_curves": len(sampled.curves),
            "guarantee": str(configurations.claim),
            "checks_failed": list(configurations.mismatches),
            "notes": [*report.gaps, *report.notes],
            "near_misses": [_stated(miss, names) for miss in misses],
        }
        warnings = [*report.gaps, *configurations.mismatches]
        if report.everywhere is not None:
            figures["freedoms_everywhere"] = report.everywhere
            warnings.append(
                f"to a part in a million, the mechanism has {report.everywhere} freedoms "
                "in every configuration: it is singular everywhere, and its tables are "
                "empty"
            )
        for name in dict.fromkeys(points["output"][inside & (points["kind"] == "II")]):
            warnings.append(
                f"output {name} meets type II in the range: the locked input does not hold "
                "it there"
            )
        pair = self.batch.moving_inputs[0]
        warnings += coming_near(misses, points, names, self.near, pair)
        counts = _in_words(here) or "no singularities"
        counts += " passed" if sampled.is_simulation else " in the range of the input"
        if beyond:
            counts += f", {_in_words(beyond)} outside"
        links = sampled.tracer.mechanism.links
        if len(links) < len(self.batch.mechanism.links):
            curves += f" of the links {listing(links)}"
        remarks = [f"{counts} on {curves}; {configurations.claim}"]
        made = grashof(self.batch.mechanism)
        if made is not None:
            figures["grashof"] = made.name
            remarks.append(str(made))
        for name in names:
            remarks += places(points, name, pair)
        if report.everywhere is None:
            remarks += swings(sampled, names)
        remarks += least_angles(sampled, names, pair)
        return Findings(figures, tuple(warnings), tuple(remarks))

    def scenes(self) -> tuple[Scene, ...]:
        """Return the page of singularities, if they have places, and one of each mode."""
        pages = [self._gallery()] if np.any(np.isfinite(self.points["s"])) else []
        for number, rows in self.batch.assembly_mode_rows().items():
            drawn = [self._input_output(output, rows) for output in range(len(self.names))]
            plots = relation_plots(self.relation, len(self.batch), rows)
            pages.append(Scene(number, (*drawn, *plots, *self._marked(rows))))
        return tuple(pages)

    def _marked(self, rows: slice) -> list[Primitive]:
        """Return the inputs at which singularities of an assembly mode are."""
        if self.batch.timed:
            return []
        points = self.points
        mode = str(int(self.batch.assembly_mode[rows.start]))
        here = np.array([mode in m.split("+") for m in points["assembly_mode"]], bool)
        here &= np.isfinite(points["q"])
        parts: list[Primitive] = []
        for kind in dict.fromkeys(points["kind"][here].tolist()):
            q = np.unique(points["q"][here & (points["kind"] == kind)])[:, None]
            parts.append(InputMarks(f"marks/{kind}", f"type {kind}", q, TONES[kind]))
        return parts

    @cached_property
    def drawn(self) -> dict[tuple[int, int], Floats]:
        """Inputs and outputs (`DRAWN`, 2) at even places, by curve and output."""
        lines = {}
        sampled = self.sampled
        for number, curve in enumerate(sampled.curves):
            s = np.linspace(0.0, curve.length * (1.0 - 1e-12), DRAWN)
            for output in range(len(self.names)):
                turned = sampled.output_angle(number, output, s)
                links = sampled.report.outputs[output]
                if sampled.tracer.mechanism.angle_between(*links) is not None:
                    turned = wrap(turned)
                line = sampled.input_at(number, s), turned
                lines[number, output] = np.stack(line, axis=1)
        return lines

    def _places(self, curve: int, output: int, s: Floats) -> Floats:
        """Return where places (k,) of a curve are drawn, (k, 2)."""
        parts = s / self.sampled.curves[curve].length
        return self.drawn[curve, output][np.rint(parts * (DRAWN - 1)).astype(int)]

    def _input_output(self, output: int, rows: slice) -> Portrait:
        """Return the output against the input at some rows, with all curves drawn.

        Singularities are marked.
        """
        batch = self.batch
        sampled = self.sampled
        name = self.names[output]
        numbers = range(len(sampled.curves))
        at = np.full((len(batch), 2), np.nan)
        for number in numbers:
            here = sampled.curve == number
            at[here, 0] = batch.q[here]
            at[here, 1] = self._places(number, output, sampled.s[here])[:, 1]
        met = [
            (point.type, self._places(point.curve, output, np.array([point.s]))[0])
            for point in sampled.report.points
            if point.output == sampled.report.outputs[output]
        ]
        return plane(
            f"plots/input_output/{name.replace('/', '_')}",
            f"output {name} against the input",
            at[rows],
            (f"input {batch.moving_inputs[0]}", f"output {name}"),
            [
                PlaneCurve(without_jumps(self.drawn[number, output]), LINE_TONE)
                for number in numbers
            ],
            [
                Mark(f"type {kind}", place, TONES[str(kind)])
                for kind, place in met
                if np.all(np.isfinite(place))
            ],
        )

    def _gallery(self) -> Scene:
        """Return a page on which row k is singularity k, with what coincides there."""
        sampled = self.sampled
        every = self.points
        points = {k: v[np.isfinite(every["s"])] for k, v in every.items()}
        outputs = [self.names.index(name) for name in points["output"]]
        places = [points["curve"].tolist(), points["s"]]
        six = [
            sampled.report.evaluate_relations(curve, s[None], output).relations[-1].poles
            for curve, s, output in zip(*places, outputs, strict=True)
        ]
        turned = np.stack([*map(sampled.configuration, *places)])
        coincide = [COINCIDE["I" if kind == "I" else "II"] for kind in points["kind"]]
        parts: list[Primitive] = [*link_bodies(sampled.tracer.mechanism, turned)]
        for name in AXES:
            axes = np.concatenate([getattr(poles, name) for poles in six])
            if np.any(np.isfinite(axes)):
                words = name.rstrip("_")
                parts.append(Arrow(f"pole/{name}", words, axes, False, path_shown=False))
        for k, which in enumerate(("one triplet", "the other")):
            normals = np.concatenate(
                [poles.plane(two[k])[0] for poles, two in zip(six, coincide, strict=True)]
            )
            parts.append(GreatCircle(f"plane/{k}", f"plane of {which}", normals))
        told = ("kind", "condition", "assembly_mode", "q", "output")
        points["q"] = np.array([f"{q:.4f}" for q in np.degrees(points["q"])])
        rows = zip(*(points[name] for name in told), strict=True)
        lines = [f"| {k} | {' | '.join(texts)} |" for k, texts in enumerate(rows)]
        notes = [f"- sample {k}: {note}" for k, note in enumerate(points["note"]) if note]
        words = "\n".join([GALLERY, *lines, "", "What coincides:", "", *notes])
        parts.append(Text("list", "Singularities", words))
        over = Axis("singularity", "", np.arange(float(len(six))))
        return Scene("Singularities", tuple(parts), (over,))


def _in_words(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{n} {of_type(kind)}" for kind, n in counts.items())


def _joined(numbers: Iterable[int], sign: str = "+") -> str:
    return sign.join(map(str, numbers))


def _stated(miss: NearMiss, names: Sequence[str]) -> dict[str, Any]:
    """Return a near miss as the summary has it."""
    return {
        "type": str(miss.type),
        "output": names[miss.output],
        "assembly_modes": list(miss.assembly_modes),
        "q_rad": miss.q,
        "angle_rad": miss.angle,
        "velocity_coefficient": miss.velocity_coefficient,
    }
