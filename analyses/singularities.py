"""Singularities: where a mechanism locks or loses control, and how near it comes."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, final

import numpy as np
from numpy.typing import NDArray

from spherekit.analysis.contract import AbstractAnalysis, Batch, Findings, Needs
from spherekit.analysis.scene import (
    Arrow,
    GreatCircle,
    Mark,
    Portrait,
    Primitive,
    Scene,
    Series,
    Text,
)
from spherekit.analysis.stage import link_bodies
from spherekit.analysis.tables import (
    BRANCH,
    INPUT,
    INPUTS,
    SAMPLE,
    STATUS,
    Column,
    Table,
    TableData,
    input_columns,
)
from spherekit.errors import AnalysisError
from spherekit.model.mechanism import Mechanism
from spherekit.motion.configuration import ConfigurationCurve
from spherekit.singular.nearness import nearness, singular_values
from spherekit.singular.record import AlongOutput, RelationAt, Singularities, Type
from spherekit.singular.relation import Kind, SixPoles
from spherekit.singular.single import SingleFreedom, ordered_pole
from spherekit.sphere.rotation import Floats, cross

Row = dict[str, Any]

TONES = {"I": 1, "II": 2, "III": 3, "apparent": 0}
DRAWN = 721
"""Points with which a whole configuration curve is drawn."""


@final
@dataclass(frozen=True)
class _Single:
    """What is computed once for a mechanism with one input.

    `curve`, `s` (n,) say on which configuration curve a row lies and where, -1 and NaN
    for rows without configuration.
    """

    analysis: SingleFreedom
    report: Singularities
    curves: tuple[ConfigurationCurve, ...]
    curve: NDArray[np.int64]
    s: Floats


@final
@dataclass(frozen=True, kw_only=True)
class SingularityAnalysis(AbstractAnalysis):
    """Singularities of types I, II and III, and the distance from them along the motion.

    `output` lists the relative motions of interest, such as ``41`` or ``4/1``; by default
    the outputs that the mechanism declares. `near` (degrees) is the angle to a singularity
    below which a warning is given.
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
                Column("kind", "", "I, II, III, or apparent: c = d = 0 alone", "text"),
                Column("condition", "", "geometric conditions that hold", "text"),
                Column("branch", "", "assembly modes that it belongs to", "text"),
                INPUTS,
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
            "c y' = d q' and nearness, one row per sample, branch, output and form",
            (
                SAMPLE,
                BRANCH,
                INPUT,
                Column("output", "", "link relative to link: y'", "text"),
                Column("form", "", "i or ii", "text"),
                Column("c", "", "coefficient of the output rate"),
                Column("d", "", "coefficient of the input rate"),
                Column("rate", "", "y'/q' = d/c, infinite at type II"),
                Column("angle_I", "rad", "by which axes or planes miss type I"),
                Column("angle_II", "rad", "by which axes or planes miss type II"),
                Column("output_rate", "", "of y by the arc length of all variables"),
                Column("input_rate", "", "of q by the arc length of all variables"),
                Column("transmission", "rad", "transmission angle"),
                Column("to_I", "rad", "change of the input to the nearest type I"),
                Column("to_II", "rad", "change of the input to the nearest type II"),
                Column("sigma", "", "least singular value of the passive equations"),
                Column("flatness", "", "its part of the greatest one"),
                STATUS,
            ),
        ),
    )

    output: tuple[str, ...] = ()
    near: float = 5.0

    def outputs(self, mechanism: Mechanism) -> tuple[tuple[int, int], ...]:
        """Return the relative motions wanted, as numbers of links."""
        if self.output:
            return tuple(ordered_pole(mechanism, text) for text in self.output)
        number = mechanism.link_number
        if mechanism.outputs:
            declared = [(number[o.link], number[o.relative_to]) for o in mechanism.outputs]
            return tuple(dict.fromkeys(declared))
        driven = {link for item in mechanism.inputs for link in _ends(mechanism, item.pair)}
        beside = [
            next(link for link in ends if link)
            for ends in mechanism.ends
            if 0 in ends and not set(ends) <= driven
        ]
        rest = beside or [k for k in range(1, len(mechanism.links)) if k not in driven]
        return tuple((link, 0) for link in dict.fromkeys(rest))

    def needs(self, mechanism: Mechanism) -> Needs:
        """Return the tracer, whose configuration curves are asked for more points."""
        if not self.near >= 0.0:
            raise AnalysisError(
                f"singularities: near: {self.near:g} is no angle in degrees; 0 or more is"
            )
        self.outputs(mechanism)
        return Needs(tracer=True)

    def compute(self, batch: Batch) -> Mapping[str, TableData]:
        """Return the tables of singularities and of the relation along the motion."""
        single = self._single(batch)
        return {
            "singularities": self._points(batch, single),
            "relation": self._relation(batch, single),
        }

    def scene(self, batch: Batch) -> tuple[Scene, ...]:
        """Return plots of each branch, and a page of the singular configurations."""
        single = self._single(batch)
        pages = [
            Scene(number, tuple(self._plots(batch, single, rows)))
            for number, rows in batch.branch_rows().items()
        ]
        points = self._points(batch, single)
        if len(points["kind"]):
            pages.append(self._gallery(batch, single, points))
        return tuple(pages)

    def findings(self, batch: Batch) -> Findings:
        """Return how many singularities there are, and where a branch comes near one."""
        single = self._single(batch)
        relation = self._relation(batch, single)
        kinds = self._points(batch, single)["kind"]
        figures = {
            "singularities": {
                str(kind): int(np.sum(kinds == kind)) for kind in np.unique(kinds)
            },
            "curves": len(single.curves),
            "notes": list(single.report.notes),
        }
        if single.report.everywhere is not None:
            figures["freedoms_everywhere"] = single.report.everywhere
        warnings = list(single.report.notes)
        for kind, rate in (("I", "output_rate"), ("II", "input_rate")):
            slow = np.abs(relation[rate]) <= np.sin(np.radians(self.near))
            angles = np.where(slow, np.degrees(relation[f"angle_{kind}"]), np.inf)
            for output in dict.fromkeys(relation["output"].tolist()):
                near = (relation["output"] == output) & (angles <= self.near)
                if not np.any(near):
                    continue
                row = np.flatnonzero(near)[np.argmin(angles[near])]
                branches = ", ".join(map(str, np.unique(relation["branch"][near])))
                warnings.append(
                    f"type {kind} of output {output}: branches {branches} come within "
                    f"{self.near:g} deg, nearest {angles[row]:.3g} deg on branch "
                    f"{relation['branch'][row]} at q = {np.degrees(relation['q'][row]):.6g}"
                    " deg"
                )
        return Findings(figures, tuple(warnings))

    def _single(self, batch: Batch) -> _Single:
        return batch.once("single", lambda: self._found(batch))

    def _found(self, batch: Batch) -> _Single:
        curves = batch.tracer.curves
        outputs = self.outputs(batch.mechanism)
        analysis = SingleFreedom(batch.tracer, [item.curve for item in curves], outputs)
        report = analysis.report()
        where = np.full(len(batch), -1)
        s = np.full(len(batch), np.nan)
        known = np.all(np.isfinite(batch.values), axis=1)
        for elsewhere in (False, True):
            for number, item in enumerate(curves):
                own = [piece.branch for piece in item.pieces]
                expected = np.isin(batch.branch, [b for b in own if b is not None])
                (todo,) = np.nonzero(known & (where < 0) & (expected != elsewhere))
                places = item.curve.find(batch.values[todo])
                on = np.isfinite(places)
                where[todo[on]], s[todo[on]] = number, places[on]
        return _Single(analysis, report, curves, where, s)

    def _points(self, batch: Batch, single: _Single) -> Row:
        rows: list[Row] = []
        inputs: list[Floats] = []
        driven = batch.tracer.solver.single
        low = batch.tracer.range[0]
        claim = "component only"

        def add(values: Floats, row: Row) -> None:
            q = low + np.mod(values[driven] - low + 1e-12, 2.0 * np.pi) - 1e-12
            inputs.append(np.array([q]))
            rows.append({**row, "guarantee": claim})

        for point in single.report.points:
            if point.type is Type.APPARENT:
                continue
            turns = [
                word
                for word, turned in (
                    ("input", point.input_turns and point.type is not Type.I),
                    ("output", point.output_turns and point.type is not Type.II),
                )
                if turned
            ]
            held = [item for at in point.relations for item in at.conditions]
            add(
                point.values,
                {
                    "kind": str(point.type),
                    **_conditions(point.relations),
                    "branch": _branches(single.curves[point.curve], point.s),
                    "output": _named(batch.mechanism, point.output),
                    "curve": point.curve,
                    "s": point.s,
                    "error": point.error,
                    "turns": " and ".join(turns),
                    "double": "yes" if point.double else "no",
                    "decided": "yes" if point.decided else "no",
                    "note": "; ".join(
                        filter(None, [point.note, *dict.fromkeys(h.words for h in held)])
                    ),
                },
            )
        for crossing in single.report.crossings:
            curve, at_start = crossing.ends[0]
            own = single.curves[curve]
            place = 0.0 if at_start else own.curve.length
            met = ", ".join(str(number) for number, _ in crossing.ends)
            for output, relations in zip(
                single.report.outputs,
                crossing.relations or [()] * len(single.report.outputs),
                strict=True,
            ):
                flat = tuple(at for branch in relations for at in branch)
                count = 0 if crossing.crossing is None else len(crossing.crossing.tangents)
                words = f"{count} curves cross; ends of curves {met}"
                add(
                    crossing.values,
                    {
                        "kind": "III",
                        **_conditions(flat),
                        "branch": _branches(own, place),
                        "output": _named(batch.mechanism, output),
                        "curve": curve,
                        "s": place,
                        "error": np.nan
                        if crossing.crossing is None
                        else crossing.crossing.error,
                        "turns": "",
                        "double": "no",
                        "decided": "yes" if crossing.decided else "no",
                        "note": "; ".join(filter(None, [words, crossing.note])),
                    },
                )
        names = [c.name for c in self.tables[0].columns]
        values = np.array(inputs).reshape(-1, 1)
        columns = {
            name: _column([row[name] for row in rows], name)
            for name in names
            if name != INPUTS.name
        }
        made = {**columns, **input_columns(batch.mechanism, values)}
        return {name: made[name] for name in names}

    def _relation(self, batch: Batch, single: _Single) -> Row:
        return batch.once("relation", lambda: self._related(batch, single))

    def _related(self, batch: Batch, single: _Single) -> Row:
        n = len(batch)
        sigma, flatness = np.full(n, np.nan), np.full(n, np.nan)
        along: list[dict[tuple[int, int], Row]] = []
        for number, item in enumerate(single.curves):
            (rows,) = np.nonzero(single.curve == number)
            if not len(rows):
                continue
            closure = item.curve.segments.closure
            points = item.curve.at(single.s[rows])
            placed, states = closure.place(points.values)
            vectors = closure.vectors(placed, states)
            driven = [batch.tracer.solver.single]
            sigma[rows], flatness[rows] = singular_values(closure.tree, vectors, driven)
            for output in range(len(single.report.outputs)):
                at = single.analysis.at(number, single.s[rows], output)
                along.append(self._filled(batch, single, number, output, rows, at))
        parts: list[Row] = []
        for output, links in enumerate(single.report.outputs):
            forms = sorted({key[1] for own in along for key in own if key[0] == output})
            for form in forms:
                columns = {name: np.full(n, np.nan) for name in _MEASURED}
                for own in along:
                    found = own.get((output, form))
                    if found is None:
                        continue
                    for name in _MEASURED:
                        columns[name][found["rows"]] = found[name]
                parts.append(
                    {
                        "sample": batch.sample,
                        "branch": batch.branch,
                        "q": batch.q,
                        "output": np.full(n, _named(batch.mechanism, links)),
                        "form": np.full(n, "i" if form == 0 else "ii"),
                        **columns,
                        "sigma": sigma,
                        "flatness": flatness,
                        "status": batch.status,
                    }
                )
        names = [column.name for column in self.tables[1].columns]
        if not parts:
            return {name: np.zeros(0) for name in names}
        return {name: np.concatenate([part[name] for part in parts]) for name in names}

    def _filled(
        self,
        batch: Batch,
        single: _Single,
        number: int,
        output: int,
        rows: NDArray[np.intp],
        at: AlongOutput,
    ) -> dict[tuple[int, int], Row]:
        found = {}
        with np.errstate(divide="ignore", invalid="ignore"):
            rate = at.output_rate / at.input_rate
        to = {
            kind: _to_nearest(batch, single, number, output, kind, at.s)
            for kind in ("I", "II")
        }
        for form, (relation, links, poles) in enumerate(
            zip(at.relations, at.links, at.poles, strict=True)
        ):
            near = nearness(relation, links, poles)
            found[output, form] = {
                "rows": rows,
                "c": relation.c,
                "d": relation.d,
                "rate": rate,
                "angle_I": near.type_i,
                "angle_II": near.type_ii,
                "output_rate": at.output_rate,
                "input_rate": at.input_rate,
                "transmission": near.transmission,
                "to_I": to["I"],
                "to_II": to["II"],
            }
        return found

    def _plots(self, batch: Batch, single: _Single, rows: slice) -> list[Primitive]:
        relation = self._relation(batch, single)
        n = len(batch)
        parts: list[Primitive] = []
        for start in range(0, len(relation["c"]), n):
            output, form = relation["output"][start], relation["form"][start]
            own = slice(start + rows.start, start + rows.stop)
            where = f"plots/{form}/{output.replace('/', '_')}"
            group = f"input-output relation, form {form}"
            for name in ("c", "d"):
                label = f"{name}, output {output}"
                parts.append(Series(f"{where}/{name}", label, group, relation[name][own]))
            for name, words in (
                ("angle_I", "to type I"),
                ("angle_II", "to type II"),
                ("transmission", "transmission angle"),
            ):
                values = np.degrees(relation[name][own])
                if np.any(np.isfinite(values)):
                    label = f"{words}, output {output}"
                    angles = f"angles, form {form}, deg"
                    parts.append(Series(f"{where}/{name}", label, angles, values))
        for output in range(len(single.report.outputs)):
            parts.append(_input_output(batch, single, output, rows))
        return parts

    def _gallery(self, batch: Batch, single: _Single, points: Row) -> Scene:
        """Return a page on which row k is singularity k, with what coincides there."""
        curves = single.curves
        values = np.stack(
            [
                curves[c].curve.at(s).values[0]
                for c, s in zip(points["curve"], points["s"], strict=True)
            ]
        )
        placed, _ = curves[0].curve.segments.closure.place(values)
        mechanism = batch.mechanism
        parts: list[Primitive] = [*link_bodies(mechanism, placed)]
        normals = np.full((len(values), 2, 3), np.nan)
        axes = {name: np.full((len(values), 3), np.nan) for name in _AXES}
        for output, links in enumerate(single.report.outputs):
            own = points["output"] == _named(mechanism, links)
            for number in np.unique(points["curve"][own]):
                (rows,) = np.nonzero(own & (points["curve"] == number))
                at = single.analysis.at(int(number), points["s"][rows], output)
                six, kind = at.poles[-1], at.relations[-1].kind
                for name in _AXES:
                    axes[name][rows] = getattr(six, name)
                if kind is Kind.FOUR_LINKS:
                    for k, row in enumerate(rows):
                        normals[row] = _planes(six, k, points["kind"][row])
        parts += [
            Arrow(f"pole/{name}", words, axes[name], False)
            for name, words in _AXES.items()
            if np.any(np.isfinite(axes[name]))
        ]
        parts += [
            GreatCircle(f"plane/{k}", words, normals[:, k])
            for k, words in enumerate(("plane of one triplet", "plane of the other"))
        ]
        lines = [
            "| sample | kind | condition | branch | q, deg | output | what coincides |"
        ]
        lines.append("|---|---|---|---|---|---|---|")
        for k in range(len(values)):
            lines.append(
                f"| {k} | {points['kind'][k]} | {points['condition'][k]} | "
                f"{points['branch'][k]} | {np.degrees(points['q'][k]):.6f} | "
                f"{points['output'][k]} | {points['note'][k]} |"
            )
        parts.append(Text("list", "Singularities", "\n".join(lines)))
        return Scene("Singularities", tuple(parts), len(values))


_MEASURED = (
    "c",
    "d",
    "rate",
    "angle_I",
    "angle_II",
    "output_rate",
    "input_rate",
    "transmission",
    "to_I",
    "to_II",
)
_AXES = {
    "ir": "input",
    "or_": "output link and r",
    "os": "output",
    "io": "input link and output link",
    "is_": "input link and s",
    "rs": "references",
}


def _ends(mechanism: Mechanism, pair: str) -> tuple[int, int]:
    return mechanism.ends[mechanism.pair_number[pair]]


def _named(mechanism: Mechanism, links: tuple[int, int]) -> str:
    return "/".join(mechanism.links[k] for k in links)


def _column(values: list[Any], name: str) -> NDArray[Any]:
    if name in ("s", "error", "residual"):
        return np.array(values, dtype=float)
    return np.array(values, dtype=np.int64 if name == "curve" else str)


def _conditions(relations: tuple[RelationAt, ...]) -> Row:
    """Return the labels of the conditions that hold, and the least residual of them."""
    held = [item for at in relations for item in at.conditions]
    labels = dict.fromkeys(h.label + ("" if h.decided else "?") for h in held)
    least = min((h.residual for h in held), default=np.nan)
    return {"condition": " ".join(labels), "residual": least}


def _branches(item: ConfigurationCurve, s: float) -> str:
    """Return the branches whose pieces of a curve hold or touch the place s."""
    length = item.curve.length
    slack = 1e-6
    found: list[int] = []
    for piece in item.pieces:
        places = [s, s + length, s - length] if item.curve.closed else [s]
        near = any(piece.start - slack <= p <= piece.stop + slack for p in places)
        if near and piece.branch is not None:
            found.append(piece.branch)
    return "+".join(map(str, sorted(set(found))))


def _to_nearest(
    batch: Batch, single: _Single, number: int, output: int, kind: str, s: Floats
) -> Floats:
    """Return (n,) by how much the input has to move to reach a type of singularity."""
    curve = single.curves[number].curve
    driven = batch.tracer.solver.single
    links = single.report.outputs[output]
    places = [
        point.s
        for point in single.report.points
        if point.curve == number and point.output == links and point.type in (kind, "III")
    ]
    for crossing in single.report.crossings:
        places += [
            0.0 if at_start else curve.length
            for own, at_start in crossing.ends
            if own == number
        ]
    if not places:
        return np.full(len(s), np.nan)
    at = np.sort(np.array(places))
    if curve.closed:
        at = np.concatenate([at - curve.length, at, at + curve.length])
    there = curve.at(at).values[:, driven]
    here = curve.at(s).values[:, driven]
    after = np.searchsorted(at, s)
    ways = []
    for beside in (after - 1, after):
        inside = (beside >= 0) & (beside < len(at))
        way = np.abs(there[np.clip(beside, 0, len(at) - 1)] - here)
        ways.append(np.where(inside, way, np.inf))
    return np.asarray(np.minimum(*ways))


def _planes(six: SixPoles, row: int, kind: str) -> Floats:
    """Return the normals (2, 3) of the planes that coincide in a type of singularity."""
    sets = {
        "I": (("io", "os", "is_"), ("ir", "is_", "rs")),
        "II": (("or_", "os", "rs"), ("io", "os", "is_")),
    }[kind if kind != "III" else "II"]
    found = np.full((2, 3), np.nan)
    for k, names in enumerate(sets):
        vectors = np.stack([getattr(six, name)[row] for name in names])
        normals = cross(vectors, np.roll(vectors, -1, axis=0))
        sizes = np.linalg.norm(normals, axis=1)
        if np.max(np.nan_to_num(sizes)) > 0.0:
            best = int(np.nanargmax(sizes))
            found[k] = normals[best] / sizes[best]
    return found


def _input_output(batch: Batch, single: _Single, output: int, rows: slice) -> Portrait:
    """Return the output against the input, all curves drawn, singularities marked."""
    links = single.report.outputs[output]
    driven = batch.tracer.solver.single
    low = batch.tracer.range[0]
    curves: list[tuple[Floats, int]] = []
    marks: list[Mark] = []
    x, y = np.full(len(batch), np.nan), np.full(len(batch), np.nan)
    for number, item in enumerate(single.curves):
        s = np.linspace(0.0, item.curve.length, DRAWN)
        turned = _turned(batch.mechanism, single, number, output, s)
        q = item.curve.at(s * (1.0 - 1e-15)).values[:, driven]
        q = low + np.mod(q - low, 2.0 * np.pi)
        line = np.degrees(np.stack([q, turned], axis=1))
        jumps = np.max(np.abs(np.diff(line, axis=0, prepend=line[:1])), axis=1) > 180.0
        line[jumps] = np.nan
        curves.append((line, 4))
        (own,) = np.nonzero(single.curve == number)
        x[own] = np.degrees(batch.q[own])
        y[own] = np.degrees(np.interp(single.s[own], s, turned))
        for point in single.report.points:
            if point.curve == number and point.output == links and point.type != "apparent":
                k = int(np.argmin(np.abs(s - point.s)))
                if np.all(np.isfinite(line[k])):
                    marks.append(Mark(str(point.type), line[k], TONES[str(point.type)]))
    every = np.concatenate([line for line, _ in curves]) if curves else np.zeros((1, 2))
    (left, bottom), (right, top) = np.nanmin(every, axis=0), np.nanmax(every, axis=0)
    name = _named(batch.mechanism, links)
    return Portrait(
        f"plots/input_output/{name.replace('/', '_')}",
        f"output {name} against the input",
        x[rows],
        y[rows],
        "input, deg",
        f"output {name}, deg",
        (float(left), float(right)),
        (float(bottom), float(top)),
        curves,
        marks,
    )


def _turned(
    mechanism: Mechanism, single: _Single, number: int, output: int, s: Floats
) -> Floats:
    """Return (n,) rad: the variable of the R pair of two links, or how far one turned."""
    o, ref = single.report.outputs[output]
    curve = single.curves[number].curve
    for pair, ends in zip(mechanism.pairs, mechanism.ends, strict=True):
        if pair.type == "R" and set(ends) == {o, ref}:
            (variable,) = mechanism.variables_of(mechanism.pair_number[pair.name])
            values = curve.at(s * (1.0 - 1e-15)).values[:, variable]
            return np.asarray(np.mod(values + np.pi, 2.0 * np.pi) - np.pi)
    rate = single.analysis.at(number, s, output).output_rate
    steps = 0.5 * (rate[1:] + rate[:-1]) * np.diff(s)
    return np.concatenate([[0.0], np.cumsum(np.nan_to_num(steps))])
