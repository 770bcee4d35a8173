"""All singularities of single-freedom mechanisms with one input and any outputs.

On a configuration curve the input w_ir and an output w_os, per arc length, are smooth
functions. A zero of the output alone is a type I singularity, of the input alone type II,
of both a self-motion; type III is where curves cross. The coefficients c and d of the
input-output relation vanish there too, and also at places where the four links are badly
chosen, which are no singularities.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import cache, cached_property
from itertools import chain, pairwise, product

import numpy as np

from spherekit.arrays import Floats
from spherekit.errors import PlanError
from spherekit.geometry.vectors import cross, max_abs, nans
from spherekit.planning.pole_plan import Plan, Pole, ordered_pole, pole_of
from spherekit.planning.pole_planner import plan
from spherekit.positions.configuration_curve import ArcCurve
from spherekit.positions.curve_continuation import CROSSING_RECIPROCAL_CONDITION
from spherekit.positions.curve_crossing import Crossing, find_crossing
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.singularities.curve_velocities import AT_REST, AlongCurve, LinkMotion
from spherekit.singularities.geometric_conditions import TOLD, RelationAt, judged
from spherekit.singularities.input_output_relation import (
    Form,
    FourLinks,
    Relation,
    Type,
    relation_of,
)
from spherekit.singularities.singular_point import SingularPoint
from spherekit.status import Status
from spherekit.tolerances import CLOSURE_TOLERANCE

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
"""Relations with smaller coefficients on most of a curve vanish everywhere."""
SAMPLED = 9
"""Configurations at which a mechanism without curves is asked for its freedoms."""
TYPES = {**TOLD, (True, True): Type.SELF_MOTION}
"""The type by whether the input rests, and whether the output does."""


class SingleFreedom:
    """The singularities of one input and some outputs along given curves.

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

    Attributes
    ----------
    input, outputs
        (i, r) and for each output (o, s), numbers of links.
    links
        For each output those of form i, and if there is one of form ii, with s its own or
        another one where that is r.

    Raises
    ------
    PlanError
        If the mechanism has several inputs, a link is unknown, or two are one.
    """

    def __init__(
        self,
        tracer: PositionAnalysis,
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

        @cache
        def plan_of(poles: tuple[Pole, ...]) -> Plan | None:
            """Return the plan for some poles; None where counting freedoms gives none."""
            try:
                return plan(mechanism, poles, None, tracer.by_rank)
            except PlanError:
                return None

        self.along = [AlongCurve(tracer, curve, plan_of) for curve in curves]
        first, second = mechanism.ends[tracer.assembly.input]
        self.input = (second, first) if input is None else ordered_pole(mechanism, input)
        self.outputs = tuple(ordered_pole(mechanism, output) for output in outputs)
        self.links: list[dict[Form, FourLinks]] = []
        for output in self.outputs:
            links = FourLinks(*self.input, *output)
            self.links.append({"i": links, **self._second_links(links)})

    def _second_links(self, links: FourLinks) -> dict[Form, FourLinks]:
        """Return the links of form ii if there is one, a fourth one where r and s are one.

        That is the link whose poles with i and o span the surest plane on all curves.
        """
        others = [
            k for k in range(len(self.tracer.mechanism.links)) if k not in links.different
        ]
        if links.o in (links.r, links.i) or (links.s == links.r and not others):
            return {}
        if links.s != links.r:
            return {"ii": links}
        pairs = [(pole_of(links.o, k), pole_of(links.i, k)) for k in others]
        sines = np.zeros(len(others))
        for along in self.along:
            axes, _ = along.axes(along.curve.s, [*chain(*pairs)])
            turns = [cross(axes[one], axes[other]) for one, other in pairs]
            sines += np.nansum(np.linalg.norm(turns, axis=2), axis=1)
        return {"ii": replace(links, s=others[int(np.argmax(sines))])}

    def poles(self, output: int) -> list[Pole]:
        """Return the poles of an output's relations, each once."""
        return list(
            dict.fromkeys(chain(*(links.poles for links in self.links[output].values())))
        )

    def at(
        self, curve: int, s: Floats, output: int
    ) -> tuple[Floats, Floats, list[Relation]]:
        """Return the rates of input and output (n,) at places of a curve, and relations.

        Rates are by arc length; the relations are form i, and form ii where there is one.
        c and d are NaN where an axis is not known.
        """
        along = self.along[curve]
        ends = (self.input, self.outputs[output])
        axes = along.oriented(s, self.poles(output))
        q, y = (_rate(along.at(s), axes, links) for links in ends)
        return q, y, self._made(output, axes)

    def _made(self, output: int, axes: dict[Pole, Floats]) -> list[Relation]:
        """Return the relations of form i and, if there is one, form ii."""
        return [
            relation_of(form, links, axes.__getitem__)
            for form, links in self.links[output].items()
        ]

    @cached_property
    def _every(self) -> list[SingularPoint]:
        """What is singular on curves, by output, curve and arc length."""
        return [
            point
            for output in range(len(self.outputs))
            for number in range(len(self.along))
            for point in self._on_curve(number, output)
        ]

    @property
    def points(self) -> list[SingularPoint]:
        """All singularities on curves, by output, curve and arc length."""
        return [point for point in self._every if np.isfinite(point.s)]

    @property
    def whole(self) -> list[SingularPoint]:
        """What stands still on whole curves: no points of that output are on them."""
        return [point for point in self._every if np.isnan(point.s)]

    @property
    def gaps(self) -> list[str]:
        """Where singularities may be missed."""
        return [
            f"curve {number} was not followed to its end; singularities beyond are not "
            "known"
            for number, along in enumerate(self.along)
            if Status.MODE_LOST in along.curve.ends
        ]

    def _on_curve(self, number: int, output: int) -> list[SingularPoint]:
        """Return the singular points of an output on one curve, or that all of it is."""
        along = self.along[number]
        ends = (self.input, self.outputs[output])
        zeros = [along.zeros(pole_of(*pair)) for pair in ends]
        resting = zeros[0] is None, zeros[1] is None
        if any(resting):
            none = nans(along.curve.nodes.values.shape[1])
            return [
                SingularPoint(TYPES[resting], ends[1], ((number, np.nan),), np.nan, none)
            ]
        places = common_zeros(along, [pole_of(*pair) for pair in ends])
        (s, error, _), double = places[:3].tolist(), places[3:]
        types = [TYPES[moves] for moves in zip(*(~np.isnan(double)).tolist(), strict=True)]
        there = along.at(places[0])
        return [
            SingularPoint(kind, ends[1], ((number, place),), *row)
            for kind, place, *row in zip(
                types,
                s,
                error,
                there.values,
                *(double == 0.0).tolist(),
                np.any(double == 1.0, axis=0).tolist(),
                doubts(places, types, ends[0] != ends[1]),
                self._judged(output, there, types),
                strict=True,
            )
        ]

    def _judged(
        self, output: int, there: LinkMotion, facts: Sequence[Type]
    ) -> list[tuple[RelationAt, ...]]:
        """Return an output's relations at n configurations, compared with the rates."""
        forms = []
        names = self.tracer.mechanism.links
        poles = tuple(self.poles(output))
        units, bounds = there.axes(poles, self.along[0].plan_of(poles))
        still = {pole: there.speeds(pole)[0] <= AT_REST * there.rounding for pole in poles}
        for relation in self._made(output, units):
            errors = np.max([bounds[pole] for pole in relation.links.poles], axis=0)
            rates = _rate(there, units, relation.output), _rate(there, units, self.input)
            forms.append(judged(relation, names, rates, errors, facts, still))
        return list(zip(*forms, strict=True))

    @cached_property
    def notes(self) -> list[str]:
        """What never says anything on a curve: axes in one plane, or on one line."""
        names, notes = self.tracer.mechanism.links, []
        resting = {(point.curve, point.output) for point in self.whole}
        for (output, pair), (number, along) in product(
            enumerate(self.outputs), enumerate(self.along)
        ):
            if (number, pair) in resting:
                continue
            axes, _ = along.axes(along.curve.s, self.poles(output))
            for relation in self._made(output, axes):
                if np.median(np.nan_to_num(np.hypot(relation.c, relation.d))) < ALWAYS:
                    links = relation.links.different
                    are = "lie in one plane" if len(links) == 4 else "are one line"
                    notes.append(
                        f"curve {number}: the axes of the links "
                        f"{', '.join(names[k] for k in links)} {are} everywhere, so form "
                        f"{relation.form} says nothing: the rates tell the types"
                    )
        return notes

    @cached_property
    def crossings(self) -> list[SingularPoint]:
        """The configurations at which curves end because rank is lost, for each output."""
        crossings: list[tuple[Crossing | None, Floats, list[tuple[int, float]]]] = []
        for number, along in enumerate(self.along):
            curve = along.curve
            for place, node, why in zip(
                (0.0, curve.length), (0, -1), curve.ends, strict=True
            ):
                if why != Status.AT_SINGULARITY:
                    continue
                last = curve.nodes.values[node]
                crossing = find_crossing(curve.closure, last)
                values = last if crossing is None else crossing.values
                for _, there, ends in crossings:
                    if max_abs(curve.wrapped(values - there)) < SAME_CROSSING:
                        ends.append((number, place))
                        break
                else:
                    crossings.append((crossing, values, [(number, place)]))
        return [
            SingularPoint(
                Type.III,
                links,
                tuple(ends),
                np.nan if crossing is None else crossing.error,
                values,
                note=_crossing_doubts(crossing),
                relations=self._on_curves_through(crossing, output),
                crossing=crossing,
            )
            for crossing, values, ends in crossings
            for output, links in enumerate(self.outputs)
        ]

    def _on_curves_through(
        self, crossing: Crossing | None, output: int
    ) -> tuple[RelationAt, ...]:
        """Return the relations on each curve through a crossing, by its own motion."""
        if crossing is None:
            return ()
        tangents = crossing.tangents
        values = np.tile(crossing.values, (len(tangents), 1))
        there = LinkMotion(self.tracer, values, tangents, np.full_like(tangents, np.nan))
        return tuple(
            replace(at, note=ONE_CURVE)
            if at.type is None and {*self.outputs[output]} != {*self.input}
            else at
            for rows in self._judged(output, there, [Type.III] * len(tangents))
            for at in rows
        )

    @cached_property
    def everywhere(self) -> int | None:
        """The freedoms of a mechanism that nowhere has just one, to a part in a million.

        None of all others. Rank counts as lost where it is for following curves.
        Asked for at configurations of its assembly modes, and where all variables are zero
        if the loops close there: the reference pose.
        """
        if self.along:
            return None
        solver = self.tracer.solver
        motion = self.tracer.sparse(SAMPLED)
        reference = np.zeros((1, motion.values.shape[1]))
        closed = motion.values[~motion.failed]
        if solver.closure.at(reference).gap[0] < CLOSURE_TOLERANCE:
            closed = np.concatenate([reference, closed])
        least = min(
            (
                solver.compute_mobility(values, CROSSING_RECIPROCAL_CONDITION)
                for values in closed
            ),
            default=0,
        )
        return least if least > 1 else None


def common_zeros(along: AlongCurve, poles: Sequence[Pole]) -> Floats:
    """Return where at least one of two poles' links rest, as one where they agree.

    For each of n places, in order (5, n): s, a bound of its error, by what (rad) the two
    zeros miss each other, and for either pole 1 where its zero is double, 0 where it is
    not, and NaN where its links do not rest.
    """
    none = [[np.nan], [np.nan], [np.inf]]
    one, two = (
        np.hstack([np.stack(roots), none]) for pole in poles if (roots := along.zeros(pole))
    )
    gap = np.abs(one[0][:, None] - two[0])
    if along.curve.closed:
        gap = np.minimum(gap, along.curve.length - gap)
    met = gap <= one[2][:, None] + two[2]
    met[:-1, -1], met[-1, :-1] = ~met[:-1].any(axis=1), ~met[:, :-1].any(axis=0)
    rows, columns = np.nonzero(met)
    one = one[:, rows]
    two = two[:, columns]
    spread = np.nan_to_num(gap[met])
    s, _, error = np.where(one[2] <= two[2], one, two)
    places = np.stack([s, np.maximum(error, spread), spread, one[1], two[1]])
    return places[:, np.argsort(s, kind="stable")]


def doubts(places: Floats, types: Sequence[Type], different: bool) -> list[str]:
    """Return for each of the places of `common_zeros` why its type is not certain."""
    s, error, spread = places[:3].tolist()
    notes = [""] * len(types)

    def undecided(gap: float, error: float) -> str:
        return (
            f"undecided within tolerance: input and output vanish {gap:.3g} rad apart, and "
            f"the places are known to {error:.3g} rad"
        )

    for k, kind in enumerate(types):
        if different and kind == Type.SELF_MOTION and error[k] > WIDE:
            notes[k] = undecided(spread[k], error[k])
    for k, (one, other) in enumerate(pairwise(types)):
        gap, both = s[k + 1] - s[k], error[k] + error[k + 1]
        if one != other and gap < BESIDE * both:
            notes[k] = notes[k + 1] = undecided(gap, both)
    return notes


def _rate(there: LinkMotion, axes: dict[Pole, Floats], links: tuple[int, int]) -> Floats:
    """Return the rate (n,) of a link relative to another, by the axis of their pole."""
    w, _ = there.relative(*links[::-1])
    return np.vecdot(w, axes[pole_of(*links)])


def _crossing_doubts(crossing: Crossing | None) -> str:
    """Return why the loss of rank at the end of curves is not certain, or nothing."""
    if crossing is None:
        return (
            "the curve ends where the closure equations lose rank, but the configuration "
            "was not located: the loss is of higher order"
        )
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
    return "; ".join(notes)
