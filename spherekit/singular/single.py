"""All singularities of single-freedom mechanisms with one input and any outputs.

On a configuration curve the input w_ir and an output w_os, per arc length, are smooth
functions. A zero of the output alone is a type I singularity, of the input alone type II,
of both a self-motion; type III is where curves cross. The coefficients c and d of the
input-output relation vanish there too, and also at places where the four links are badly
chosen: those are found as well and are called apparent.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import final

import numpy as np

from spherekit.conventions import CLOSURE_TOLERANCE, Status
from spherekit.errors import PlanError
from spherekit.model.mechanism import Mechanism
from spherekit.motion.arc_curve import ArcCurve
from spherekit.motion.arc_length import SINGULAR
from spherekit.motion.crossing import Crossing, crossing_near
from spherekit.motion.motion import Tracer
from spherekit.planning.poles import Pole, parse_pole, pole_of
from spherekit.rates.core import LinkRates
from spherekit.singular.along import AlongCurve, Plans, rounding_of
from spherekit.singular.output_relations import OutputRelations, axes_error, rate_between
from spherekit.singular.record import (
    AlongOutput,
    CrossingPoint,
    RelationAt,
    Singularities,
    SingularPoint,
    Type,
    WholeCurve,
)
from spherekit.singular.relation import (
    FourLinks,
    LinkCount,
)
from spherekit.singular.roots import (
    CommonRoots,
    Roots,
    groups_of,
    located,
    place_error,
    poles_of,
)
from spherekit.sphere.rotation import Floats, cross

BESIDE = 100.0
"""Places nearer than this times their error bounds, but not within, are undecided."""
WIDE = 1e-9
"""Places with a larger error bound (rad) are not told apart, nor said to agree."""
DECIDED_MISS = 1e-14
"""A crossing that is missed by more (rad) may be none: rounding of sizes decides."""
SAME_CROSSING = 1e-7
"""Crossings whose variables differ by less (rad) are one."""
ONE_CURVE = (
    "c and d are those of this curve: its motion says where the third pole is, which the "
    "configuration leaves open"
)
ALWAYS = 1e-12
"""Triple products that never exceed this on a curve vanish everywhere."""
SAMPLED = 9
"""Configurations at which a mechanism without curves is asked for its freedoms."""


@final
class SingleFreedom:
    """The singularity analysis of one input and some outputs along given curves.

    Parameters
    ----------
    tracer
        A mechanism with one freedom.
    curves
        Its configuration curves.
    outputs
        Relative motions (o, s): numbers or names of links, or text such as ``"4/1"``.
    input
        The input (i, r) in the same way; by default the second link of the driven pair
        relative to the first.

    Raises
    ------
    PlanError
        If the mechanism has several inputs, a link is unknown, or two are one.
    """

    def __init__(
        self,
        tracer: Tracer,
        curves: Sequence[ArcCurve],
        outputs: Iterable[str | tuple[int | str, int | str]],
        input: str | tuple[int | str, int | str] | None = None,
    ) -> None:
        mechanism = tracer.mechanism
        if len(tracer.inputs) != 1:
            raise PlanError(
                f"{mechanism.name}: it has {len(tracer.inputs)} inputs; the relation of "
                "one input and one output is that of a mechanism with a single freedom"
            )
        self.tracer = tracer
        plans: Plans = {}
        self.along = [AlongCurve(tracer, curve, plans) for curve in curves]
        first, second = mechanism.ends[tracer.assembly.input]
        self.input = (second, first) if input is None else ordered_pole(mechanism, input)
        self.outputs = tuple(ordered_pole(mechanism, output) for output in outputs)
        self.relations = OutputRelations(mechanism, self.along, self.input, self.outputs)

    def report(self) -> Singularities:
        """Return all singularities on all curves."""
        self.notes: list[str] = []
        self.gaps: list[str] = []
        self.whole: list[WholeCurve] = []
        points: list[list[SingularPoint]] = [[] for _ in self.outputs]
        for number, along in enumerate(self.along):
            for of_output, new in zip(points, self._on_curve(number, along), strict=True):
                of_output += new
        return Singularities(
            self.input,
            self.outputs,
            tuple(
                None if links is None else links.s for links in self.relations.second_links
            ),
            tuple(point for listed in points for point in listed),
            self._crossings(),
            tuple(self.whole),
            self._everywhere(),
            tuple(self.notes),
            tuple(self.gaps),
        )

    def at(self, curve: int, s: Floats, output: int) -> AlongOutput:
        """Return rates and relations of an output at places s (n,) of a curve.

        See `OutputRelations.at`.
        """
        return self.relations.at(self.along[curve], s, output)

    def _on_curve(self, number: int, along: AlongCurve) -> list[list[SingularPoint]]:
        """Return the singular points of each output on one curve."""
        every = [self.relations.poles(output) for output in range(len(self.outputs))]
        along.follow([pole for poles in every for pole in poles])
        self._note_gaps(number, along, [pole for poles in every for pole in poles])
        places: dict[Pole, Roots] = {}
        for pole in dict.fromkeys(pole for poles in every for pole in poles):
            places[pole] = located(along, pole)
        return [
            self._of_output(number, along, output, places)
            for output in range(len(self.outputs))
        ]

    def _note_gaps(self, number: int, along: AlongCurve, poles: list[Pole]) -> None:
        """Note where zeros may be missed: lost axes, and curves that could not go on."""
        names = self.tracer.mechanism.links
        for a, b in dict.fromkeys(poles):
            if along.rests((a, b)):
                continue
            for low, high in along.sense((a, b)).lost:
                self.gaps.append(
                    f"curve {number}: the axis {names[b]}/{names[a]} turns too fast to be "
                    f"followed from s = {low:.6g} to {high:.6g} rad; zeros of its rate "
                    "there may be missed or invented"
                )
        if Status.MODE_LOST in along.curve.ends:
            self.gaps.append(
                f"curve {number} was not followed to its end; singularities beyond are "
                "not known"
            )

    def _of_output(
        self, number: int, along: AlongCurve, output: int, places: dict[Pole, Roots]
    ) -> list[SingularPoint]:
        driven, wanted = pole_of(*self.input), pole_of(*self.outputs[output])
        roots: list[tuple[Pole | None, Roots]] = [
            (pole, places[pole]) for pole in self.relations.poles(output)
        ]
        still, resting = places[driven].always, places[wanted].always
        if still or resting:
            kind = (Type.SELF_MOTION if resting else Type.II) if still else Type.I
            self.whole.append(WholeCurve(kind, self.outputs[output], number))
            return []
        roots += [(None, more) for more in self._coplanar(number, along, output, roots)]
        self._note_one_line(number, along, output)
        groups = groups_of(along.curve, roots)
        if not groups:
            return []
        s = np.array([group.s for group in groups])
        points = along.points(s)
        axes = along.oriented(s, self.relations.poles(output))
        links = self.relations.first_links[output]
        q, dq = rate_between(along, links.i, links.r, s)
        y, dy = rate_between(along, links.o, links.s, s)
        kinds = [group.kind(driven, wanted) for group in groups]
        made = self.relations.at_groups(output, axes, along, s, groups)
        notes = _doubts(groups, driven, wanted)
        singular_points = []
        for k, (group, kind) in enumerate(zip(groups, kinds, strict=True)):
            relations = tuple(rows[k] for rows in made)
            if kind == Type.APPARENT and all(r.type is None for r in relations):
                continue
            one, other = group.double(driven), group.double(wanted)
            singular_points.append(
                SingularPoint(
                    type=kind,
                    output=self.outputs[output],
                    curve=number,
                    s=group.s,
                    error=group.error,
                    values=points.values[k],
                    input_rate=float(q[k]),
                    output_rate=float(y[k]),
                    input_slope=float(dq[k]),
                    output_slope=float(dy[k]),
                    input_turns=one is False,
                    output_turns=other is False,
                    double=bool(one or other),
                    decided=not notes[k],
                    note=notes[k],
                    relations=relations,
                )
            )
        return singular_points

    def _coplanar(
        self,
        number: int,
        along: AlongCurve,
        output: int,
        shown: Sequence[tuple[Pole | None, Roots]],
    ) -> list[Roots]:
        """Return where all six axes of four links lie in one plane, though all turn.

        The determinant of three of their angular velocities vanishes there, and wherever
        two of the links stand still relative to each other, which is known.
        """
        out = []
        for links in dict.fromkeys(
            [self.relations.first_links[output], self.relations.second_links[output]]
        ):
            if links is None or links.three:
                continue
            grid = np.unique(np.concatenate([along.sense(p).s for p in poles_of(links)]))

            def function(s: Floats, links: FourLinks = links) -> tuple[Floats, Floats]:
                return _volume(along.rates(s), links)

            value, _ = function(grid)
            if np.max(np.abs(value)) < ALWAYS:
                names = self.tracer.mechanism.links
                four = ", ".join(names[k] for k in (links.i, links.r, links.o, links.s))
                self.notes.append(
                    f"curve {number}: the six axes of the links {four} lie in one plane "
                    "everywhere, so c = d = 0 says nothing: the rates tell the types"
                )
                continue
            roots = along.locate(function, grid)
            others = np.concatenate([zero.s for _, zero in shown])
            if len(others):
                near = np.abs(roots.places[:, None] - others)
                if along.curve.closed:
                    near = np.minimum(near, along.curve.length - near)
                fresh = np.min(near, axis=1) > 1e-6
            else:
                fresh = np.ones(len(roots.places), dtype=bool)
            s = roots.places[fresh]
            rates = along.rates(s)
            _, slope = _volume(rates, links)
            error = place_error(along.curve, rounding_of(rates), slope)
            out.append(Roots(s, roots.double[fresh], error))
        return out

    def _note_one_line(self, number: int, along: AlongCurve, output: int) -> None:
        """Note relations of three links that turn about one line on a whole curve."""
        names = self.tracer.mechanism.links
        axes = along.axes(along.curve.s, self.relations.poles(output))
        for links, _, relation in self.relations.made(output, axes):
            if relation.kind == LinkCount.THREE_LINKS and np.all(np.isnan(relation.c)):
                three = ", ".join(
                    names[k] for k in dict.fromkeys((links.i, links.r, links.o, links.s))
                )
                self.notes.append(
                    f"curve {number}: the axes of the links {three} are one line "
                    f"everywhere, so form {relation.form} says nothing: the rates tell the "
                    "types"
                )

    def _crossings(self) -> tuple[CrossingPoint, ...]:
        """Return the configurations at which curves end because rank is lost."""
        crossings: list[tuple[Crossing | None, Floats, list[tuple[int, bool]]]] = []
        for number, along in enumerate(self.along):
            curve = along.curve
            for at_start, why in zip((True, False), curve.ends, strict=True):
                if why != Status.AT_SINGULARITY:
                    continue
                last = curve.nodes.values[0 if at_start else -1]
                crossing = crossing_near(along.closure, last)
                values = last if crossing is None else crossing.values
                for _, there, ends in crossings:
                    if np.max(np.abs(curve.wrapped(values - there))) < SAME_CROSSING:
                        ends.append((number, at_start))
                        break
                else:
                    crossings.append((crossing, values, [(number, at_start)]))
        return tuple(self._crossing(*entry) for entry in crossings)

    def _crossing(
        self, crossing: Crossing | None, values: Floats, ends: list[tuple[int, bool]]
    ) -> CrossingPoint:
        if crossing is None:
            note = (
                "the curve ends where the closure equations lose rank, but the "
                "configuration was not located: the loss is of higher order"
            )
            return CrossingPoint(None, tuple(ends), values, False, note, ())
        notes = []
        if crossing.miss > DECIDED_MISS:
            notes.append(
                f"undecided within tolerance: the loops miss the crossing by "
                f"{crossing.miss:.3g} rad, so two curves may pass each other instead"
            )
        if not crossing.resolved:
            notes.append(
                f"terms of second order do not tell how many curves there are among the "
                f"{crossing.freedoms} freedoms"
            )
        along = self.along[ends[0][0]]
        relations = tuple(
            self._on_curves_through(along, crossing, output)
            for output in range(len(self.outputs))
        )
        return CrossingPoint(
            crossing, tuple(ends), values, not notes, "; ".join(notes), relations
        )

    def _on_curves_through(
        self, along: AlongCurve, crossing: Crossing, output: int
    ) -> tuple[tuple[RelationAt, ...], ...]:
        """Return the relations on each curve through a crossing, by its own motion."""
        count = len(crossing.tangents)
        if not count:
            return ()
        values = np.tile(crossing.values, (count, 1))
        axes, rates = along.leaving(values, crossing.tangents, self.relations.poles(output))
        curves: list[list[RelationAt]] = [[] for _ in range(count)]
        for links, six, relation in self.relations.made(output, axes):
            q, y = (
                np.sum((rates.w[:, a] - rates.w[:, b]) * axes[pole_of(a, b)].unit, axis=1)
                for a, b in ((links.i, links.r), relation.output)
            )
            errors = axes_error(links, axes)
            judged = self.relations.judged(
                links, six, relation, q, y, errors, [Type.III] * count, [[]] * count
            )
            for relations, relation_at in zip(curves, judged, strict=True):
                if relation_at.type is None and relation_at.kind != LinkCount.SAME_POLE:
                    relation_at = replace(relation_at, note=ONE_CURVE)
                relations.append(relation_at)
        return tuple(tuple(relations) for relations in curves)

    def _everywhere(self) -> int | None:
        """Return the freedoms of a mechanism that nowhere has just one, if it is one.

        Rank counts as lost where it is for following curves.
        Asked for at configurations of its assembly modes, and where all variables are zero
        if the loops close there: the reference pose.
        """
        if self.along:
            return None
        solver, motion = self.tracer.solver, self.tracer.sparse(SAMPLED)
        reference = np.zeros((1, motion.values.shape[1]))
        closed = motion.values[~motion.failed]
        if solver.closure.at(reference).gap[0] < CLOSURE_TOLERANCE:
            closed = np.concatenate([reference, closed])
        freedoms = [solver.freedoms(values, SINGULAR) for values in closed]
        return min(freedoms) if freedoms and min(freedoms) > 1 else None


def ordered_pole(
    mechanism: Mechanism, pole: str | tuple[int | str, int | str]
) -> tuple[int, int]:
    """Return two links, the first relative to the second, by their numbers.

    Raises
    ------
    PlanError
        If a link is unknown or they are one.
    """
    names = mechanism.links
    if isinstance(pole, str):
        a, b = parse_pole(mechanism, pole)
        plain = pole.replace("/", "")
        return (a, b) if names[a] + names[b] == plain else (b, a)
    words = [names[k] if isinstance(k, int) and 0 <= k < len(names) else k for k in pole]
    return ordered_pole(mechanism, "/".join(str(word) for word in words))


def _volume(rates: LinkRates, links: FourLinks) -> tuple[Floats, Floats]:
    """Return (n,) the triple product of three relative rates of four links, and slope."""
    (a, da), (b, db), (c, dc) = (
        rates.relative(links.r, link) for link in (links.i, links.o, links.s)
    )
    normal = cross(b, c)
    slope = np.sum(da * normal, axis=1)
    slope += np.sum(a * (cross(db, c) + cross(b, dc)), axis=1)
    return np.asarray(np.sum(a * normal, axis=1)), slope


def _doubts(groups: list[CommonRoots], driven: Pole, wanted: Pole) -> list[str]:
    """Return for each group why its type is not certain, or an empty string."""
    notes = [""] * len(groups)
    for k, group in enumerate(groups):
        both = driven in group.members and wanted in group.members and driven != wanted
        if both and group.error > WIDE:
            notes[k] = (
                f"undecided within tolerance: input and output vanish {group.spread:.3g} "
                f"rad apart, and the places are known to {group.error:.3g} rad"
            )
    for k, (one, other) in enumerate(pairwise(groups)):
        kinds = {one.kind(driven, wanted), other.kind(driven, wanted)}
        gap, uncertainty = other.s - one.s, one.error + other.error
        if Type.APPARENT not in kinds and len(kinds) == 2 and gap < BESIDE * uncertainty:
            notes[k] = notes[k + 1] = (
                f"undecided within tolerance: input and output vanish {gap:.3g} rad "
                f"apart, and the places are known to {uncertainty:.3g} rad"
            )
    return notes
