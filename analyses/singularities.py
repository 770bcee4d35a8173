"""Singularities: where a mechanism locks or loses control, and how near it comes.

The half of the analysis `singularities` for mechanisms with one input.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from spherekit.plugin import (
    AbstractAnalysis,
    AnalysisError,
    Batch,
    Findings,
    Mechanism,
    Needs,
    Scene,
    Status,
    Sweep,
    Table,
    TableData,
    counted,
    listing,
)
from spherekit.plugin.designs import FigureOfMerit, middle_pairs
from spherekit.plugin.singularities import (
    NearMiss,
    RelationAt,
    SampledSingularities,
    SingularPoint,
    Type,
    grashof,
    near_misses,
    ordered_pole,
    output_of,
)

from .several_singularities import MOST_INPUTS, SeveralInputs, no_aspects
from .singular_tables import (
    ASPECTS,
    RELATION,
    SELF_MOTION,
    SINGULARITIES,
    OneInputScenes,
    configuration_columns,
    of_type,
)
from .singular_words import coming_near, least_angles, places, swings

Row = dict[str, Any]

RESTS = 1e-8
"""A rate by arc length below this is none."""


@dataclass(frozen=True)
class OneInput:
    """Singularities of a mechanism with one input, asked for once in a run.

    `outputs` are the relative motions of interest, as numbers of links; `near` (degrees)
    is the angle to a singularity below which a warning is given.
    """

    outputs: tuple[tuple[int, int], ...]
    near: float

    def points(self, batch: Batch) -> Row:
        """Return the main table: points on curves, then where curves cross."""
        return batch.once(
            "points",
            lambda: SINGULARITIES.stacked(batch.mechanism, self._listed(batch)),
        )

    def relation(self, batch: Batch) -> Row:
        """Return c y' = d q' and nearness of every row, by output and form."""
        return batch.once(
            "relation", lambda: RELATION.stacked(batch.mechanism, self._measured(batch))
        )

    def aspect_rows(self, batch: Batch) -> Row:
        """Return no rows: aspects are those of several inputs."""
        return ASPECTS.stacked(batch.mechanism)

    def scenes(self, batch: Batch) -> tuple[Scene, ...]:
        """Return plots of each assembly mode, and a page of the singularities."""
        return OneInputScenes(
            batch,
            self._found(batch),
            self._names(batch),
            self.points(batch),
            self.relation(batch),
        ).pages()

    def findings(self, batch: Batch) -> Findings:
        """Return how many singularities there are, and where a mode comes near one."""
        sampled = self._found(batch)
        points = self.points(batch)
        inside = points["inside"] == "yes"
        figures: dict[str, Any] = {
            "singularities": _counted(points["kind"][inside]),
            "outside": _counted(points["kind"][~inside]),
            "configuration_curves": len(sampled.curves),
            "guarantee": str(sampled.configurations.claim),
            "checks_failed": list(sampled.configurations.mismatches),
            "notes": [*sampled.report.gaps, *sampled.report.notes],
        }
        if sampled.report.everywhere is not None:
            figures["freedoms_everywhere"] = sampled.report.everywhere
        warnings = [*sampled.report.gaps, *sampled.configurations.mismatches]
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
        names = self._names(batch)
        misses = near_misses(sampled, np.radians(self.near))
        figures["near_misses"] = [_missed(miss, names) for miss in misses]
        warnings += coming_near(misses, points, names, self.near, pair)
        counts = _in_words(figures["singularities"]) or "no singularities"
        beyond = _in_words(figures["outside"])
        if sampled.is_simulation:
            counts += " passed" + f", {beyond} elsewhere" * bool(beyond)
        elif beyond:
            counts += f" in the range of the input, {beyond} outside"
        count = len(sampled.curves)
        remarks = [
            f"{counts} on {count} configuration {'curve' if count == 1 else 'curves'}"
            f"{_part(sampled)}; "
            f"{sampled.configurations.claim}"
        ]
        made = grashof(batch.mechanism)
        if made is not None:
            figures["grashof"] = made.name
            remarks.append(str(made))
        for name in names:
            remarks += places(points, name, pair)
        if sampled.report.everywhere is None:
            remarks += swings(sampled, names)
        remarks += least_angles(sampled, names, pair)
        return Findings(figures, tuple(warnings), tuple(remarks))

    def _found(self, batch: Batch) -> SampledSingularities:
        return batch.once(
            "found",
            lambda: SampledSingularities(
                batch.tracer,
                self.outputs,
                batch.motion.values,
                batch.assembly_mode,
                None if batch.motion.sense is None else batch.q,
            ),
        )

    def _names(self, batch: Batch) -> list[str]:
        sampled = self._found(batch)
        return [_named(sampled.tracer.mechanism, o) for o in sampled.report.outputs]

    def _listed(self, batch: Batch) -> list[Row]:
        """Return rows of points on curves, of where curves cross, and of whole curves."""
        sampled = self._found(batch)
        rows: list[Row] = []
        for point in (*sampled.report.points, *sampled.report.crossings):
            rows += self._rows(batch, point)
        for whole in sampled.report.whole:
            pieces = sampled.configurations.curves[whole.curve].pieces
            rows.append(
                {
                    "kind": str(whole.type),
                    "assembly_mode": _joined(sampled.modes_of(pieces)),
                    "inside": "yes",
                    "output": _named(sampled.tracer.mechanism, whole.output),
                    "curve": whole.curve,
                    "residual": 0.0,
                    "certain": "yes",
                    "note": f"at rest on the whole of curve {whole.curve}",
                }
            )
        claim = sampled.configurations.guarantee.value
        return [{"double": "no", "guarantee": claim, **row} for row in rows]

    def _rows(self, batch: Batch, point: SingularPoint) -> list[Row]:
        """Return a row for each input of the range at which a singularity is met."""
        sampled, ends = self._found(batch), point.places
        part = None if sampled.tracer is batch.tracer else sampled.tracer
        relations: Sequence[RelationAt] = point.relations
        if point.type is Type.III:
            count = 0 if point.crossing is None else len(point.crossing.tangents)
            words = [
                f"{counted(count, 'curve')} cross" if count else "curves end",
                "ends of curves " + _joined(sorted({curve for curve, _ in ends}), ", "),
                point.note,
            ]
        else:
            relations = [at for at in point.relations if at.agrees]
            said = [item.words for at in relations for item in at.conditions]
            words = [point.note, *(said or [at.note for at in point.relations])]
        held = [item for relation in relations for item in relation.conditions]
        labels = dict.fromkeys(h.label + ("" if h.certain else "?") for h in held)
        whole = {
            **configuration_columns(batch, point.values[None], point.output, part=part),
            "kind": str(point.type),
            "certain": "yes" if point.certain else "no",
            "error": point.error,
            "reversal": " and ".join(_turns(point)),
            "double": "yes" if point.double else "no",
            "condition": " ".join(labels),
            "residual": min((h.residual for h in held), default=np.nan),
            "output": _named(sampled.tracer.mechanism, point.output),
            "curve": point.curve,
            "s": point.s,
            "note": "; ".join(dict.fromkeys(filter(None, words))),
        }
        rows = []
        for q in sampled.inputs_of(point.curve, point.values):
            modes = {k for end in ends for k in sampled.assembly_modes_at(*end, q)}
            inside = "yes" if sampled.inside(q, ends) else "no"
            here = {"assembly_mode": _joined(sorted(modes)), "q": q, "inside": inside}
            rows.append({**whole, **here})
        return rows

    def _measured(self, batch: Batch) -> list[Row]:
        sampled = self._found(batch)
        sigma, reciprocal_condition = sampled.singular_values()
        names = self._names(batch)

        status = np.where(batch.status == Status.OK, sampled.status, batch.status)
        rows: list[Row] = []
        for (output, form), columns in sampled.measures().items():
            rates = columns["output_rate"], columns["input_rate"]
            finite, rest = np.isfinite(rates[1]), [np.abs(rate) < RESTS for rate in rates]
            kinds = np.select(
                [sampled.crossed, ~finite, rest[0] & rest[1], *rest],
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
                    "output": names[output],
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
        return rows


def _missed(miss: NearMiss, names: Sequence[str]) -> Row:
    """Return a near miss as the summary has it."""
    return {
        "type": str(miss.type),
        "output": names[miss.output],
        "assembly_modes": list(miss.assembly_modes),
        "q_rad": miss.q,
        "angle_rad": miss.angle,
        "velocity_coefficient": miss.velocity_coefficient,
    }


def _part(sampled: SampledSingularities) -> str:
    """Return of which links curves are, where not of all."""
    links = sampled.tracer.mechanism.links
    left = len(sampled.whole.mechanism.links) - len(links)
    return f" of the links {listing(links)}" if left else ""


def _named(mechanism: Mechanism, links: tuple[int, int]) -> str:
    return "/".join(mechanism.links[k] for k in links)


def _counted(kinds: NDArray[Any]) -> dict[str, int]:
    return {str(kind): int(np.sum(kinds == kind)) for kind in np.unique(kinds)}


def _in_words(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{n} {of_type(kind)}" for kind, n in counts.items())


def _joined(numbers: Iterable[int], sign: str = "+") -> str:
    return sign.join(map(str, numbers))


def _turns(point: SingularPoint) -> list[str]:
    """Return what reverses at a singularity."""
    reversal = []
    if point.input_turns and point.type is not Type.I:
        reversal.append("input")
    if point.output_turns and point.type is not Type.II:
        reversal.append("output")
    return reversal


def _found_with(
    parameter: str, values: tuple[float, ...], inputs: Literal["one", "several"]
) -> Sweep:
    """Return the places of singularities by values of a parameter."""
    kinds = "kind", "output"
    beside = () if parameter in ("samples", "seconds") else (("seconds", 100.0),)
    where = "singularities", "q", kinds
    return Sweep(parameter, values, *where, places=True, beside=beside, inputs=inputs)


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
    tables: ClassVar[tuple[Table, ...]] = (SINGULARITIES, RELATION, ASPECTS)

    trades: ClassVar[tuple[Sweep, ...]] = (
        _found_with("samples", (31, 91, 181, 361, 1441), "one"),
        _found_with("slices", (3, 6, 12, 24), "several"),
        _found_with("mesh", (20.0, 10.0, 5.0, 2.5), "several"),
        _found_with("seconds", (1.0, 3.0, 10.0, 100.0), "several"),
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

    def merits(self, mechanism: Mechanism) -> tuple[FigureOfMerit, ...]:
        """Return the least transmission angle of each dyad, 0 at a type II singularity."""
        return tuple(
            FigureOfMerit(
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
            output_of(mechanism)
            if self.input_grid and len(mechanism.inputs) > MOST_INPUTS:
                raise AnalysisError(
                    f"singularities: input_grid: {no_aspects(mechanism)}; leave it out, or "
                    "give 0"
                )
            number = mechanism.link_number
            outputs = [
                (number[output.link], number[output.relative_to])
                for output in mechanism.outputs
            ]
        else:
            outputs = list(self.outputs(mechanism))
        links = frozenset(link for output in outputs for link in output)
        return Needs(tracer=True, links=links)

    def compute(self, batch: Batch) -> Mapping[str, TableData]:
        """Return the tables of singularities, the relation along the motion, aspects."""
        half = self._half(batch.mechanism)
        rows = half.points(batch), half.relation(batch), half.aspect_rows(batch)
        return {
            table.name: columns for table, columns in zip(self.tables, rows, strict=True)
        }

    def scene(self, batch: Batch) -> tuple[Scene, ...]:
        """Return plots of each assembly mode, and what there is to see of singularities."""
        return self._half(batch.mechanism).scenes(batch)

    def findings(self, batch: Batch) -> Findings:
        """Return how many singularities there are, and where a mode comes near one."""
        return self._half(batch.mechanism).findings(batch)

    def _half(self, mechanism: Mechanism) -> OneInput | SeveralInputs:
        if len(mechanism.inputs) == 1:
            return OneInput(self.outputs(mechanism), self.near)
        side = None if self.mesh is None else float(np.radians(self.mesh))
        return SeveralInputs(self.slices, side, self.input_grid, self.near, self.seconds)


def _ends(mechanism: Mechanism, pair: str) -> tuple[int, int]:
    return mechanism.ends[mechanism.pair_number[pair]]
