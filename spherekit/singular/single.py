"""All singularities of single-freedom mechanisms with one input and any outputs.

On a configuration curve the input w_ir and an output w_os, per arc length, are smooth
functions. A zero of the output alone is a type I singularity, of the input alone type II,
of both a self-motion; type III is where curves cross. The coefficients c and d of the
input-output relation vanish there too, and also at places where the four links are badly
chosen: those are found as well and are called apparent.

Places on a curve where relative rates vanish, put together where they agree.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from spherekit.arrays import Bools, Floats
from spherekit.conventions import CLOSURE_TOLERANCE, EPS, Status
from spherekit.errors import PlanError
from spherekit.model.mechanism import Mechanism
from spherekit.motion.arc_curve import ArcCurve
from spherekit.motion.arc_length import SINGULAR
from spherekit.motion.crossing import Crossing, crossing_near
from spherekit.motion.motion import PositionAnalysis
from spherekit.planning.poles import Pole, parse_pole, pole_of
from spherekit.singular.along import AlongCurve, Axis, LinkRates, Plans, rounding_of
from spherekit.singular.record import (
    AlongOutput,
    CrossingPoint,
    RelationAt,
    Singularities,
    SingularPoint,
    WholeCurve,
    judged,
)
from spherekit.singular.relation import (
    FourLinks,
    LinkCount,
    Relation,
    SixPoles,
    Type,
    form_i,
    form_ii,
)
from spherekit.sphere.rotation import cross, max_abs

BESIDE = 100.0
"""Places nearer than this times their error bounds, but not within, are undecided."""
WIDE = 1e-9
"""Places with a larger error bound (rad) are not told apart, nor said to agree."""


@dataclass(frozen=True)
class Roots:
    """Zeros at s (k,), whether each is double, and bounds of the errors of s."""

    s: Floats
    double: Bools
    error: Floats


@dataclass(frozen=True)
class CommonRoots:
    """Zeros of several poles that are one place; None stands for the coplanarity.

    `members` says of which, and whether it is a double one; `spread` (rad) is by how much
    they miss each other.
    """

    s: float
    error: float
    spread: float
    members: dict[Pole | None, bool]


def rate_between(
    along: AlongCurve, links: tuple[int, int], s: Floats
) -> tuple[Floats, Floats]:
    """Return the rate of a link relative to another at s, and its slope, (n,)."""
    w, dw, _ = along.signed(pole_of(*links), s)
    sign = 1.0 if links[0] > links[1] else -1.0
    return sign * w, sign * dw


def located(along: AlongCurve, pole: Pole) -> Roots | None:
    """Return all zeros of the rate of a pole, None if its links move as one."""
    if along.rests(pole):
        return None
    curve, roots = along.curve, along.zeros(pole)
    s = roots.places
    if not len(s):
        return Roots(s, roots.double, s)
    _, slope, rounding = along.signed(pole, s)
    error = place_error(curve, rounding, slope)
    touched = roots.double
    if np.any(touched):
        step = 1e-3 * curve.length
        beside = s[touched] + step
        if not curve.closed:
            beside = np.where(beside > curve.length, beside - 2.0 * step, beside)
        bend = np.maximum(np.abs(along.signed(pole, beside)[1] / step), EPS)
        error[touched] = np.minimum(np.sqrt(2.0 * rounding[touched] / bend), curve.length)
    inside = np.ones(len(s), dtype=bool)
    for why, way in zip(curve.ends, (s, curve.length - s), strict=True):
        if why == Status.AT_SINGULARITY:  # the zero may be that of the crossing
            inside &= way > 4.0 * error
    return Roots(s[inside], touched[inside], error[inside])


def place_error(curve: ArcCurve, error: Floats, slope: Floats) -> Floats:
    """Return bounds (n,) of the errors of simple zeros."""
    steep = np.maximum(np.abs(slope), EPS)
    return np.minimum(error / steep + 16.0 * EPS * curve.length, curve.length)


def groups_of(
    curve: ArcCurve, zeros: Sequence[tuple[Pole | None, Roots]]
) -> list[CommonRoots]:
    """Return zeros put together where they agree within their error bounds."""
    if not zeros:
        return []
    poles = [pole for pole, roots in zeros for _ in roots.s]
    s, error, double = (
        np.concatenate([getattr(roots, name) for _, roots in zeros])
        for name in ("s", "error", "double")
    )
    at_end = curve.closed & (curve.length - s <= 2.0 * error)
    s = np.where(at_end, s - curve.length, s)
    order = np.argsort(s, kind="stable")
    apart = np.diff(s[order]) > error[order][1:] + error[order][:-1]
    groups = []
    for rows in np.split(order, np.flatnonzero(apart) + 1):
        if len(rows):
            best, spread = rows[np.argmin(error[rows])], float(np.ptp(s[rows]))
            members = {poles[row]: bool(double[row]) for row in rows}
            place, off = max(float(s[best]), 0.0), max(float(error[best]), spread)
            groups.append(CommonRoots(place, off, spread, members))
    return groups


def type_of(resting: Iterable[Pole | None], driven: Pole, wanted: Pole) -> Type:
    """Return the type by which of an input's and an output's poles rest."""
    rest = set(resting)
    return {
        (True, True): Type.SELF_MOTION,
        (True, False): Type.II,
        (False, True): Type.I,
        (False, False): Type.APPARENT,
    }[driven in rest, wanted in rest]


def doubts(groups: list[CommonRoots], kinds: list[Type], different: bool) -> list[str]:
    """Return for each group why its type is not certain, or an empty string."""
    notes = [""] * len(groups)

    def undecided(gap: float, error: float) -> str:
        return (
            f"undecided within tolerance: input and output vanish {gap:.3g} rad apart, and "
            f"the places are known to {error:.3g} rad"
        )

    for k, (group, kind) in enumerate(zip(groups, kinds, strict=True)):
        if different and kind == Type.SELF_MOTION and group.error > WIDE:
            notes[k] = undecided(group.spread, group.error)
    for k, (one, other) in enumerate(pairwise(groups)):
        gap, uncertainty = other.s - one.s, one.error + other.error
        both = {kinds[k], kinds[k + 1]}
        if Type.APPARENT not in both and len(both) == 2 and gap < BESIDE * uncertainty:
            notes[k] = notes[k + 1] = undecided(gap, uncertainty)
    return notes


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
        plans: Plans = {}
        self.along = [AlongCurve(tracer, curve, plans) for curve in curves]
        first, second = mechanism.ends[tracer.assembly.input]
        self.input = (second, first) if input is None else ordered_pole(mechanism, input)
        self.outputs = tuple(ordered_pole(mechanism, output) for output in outputs)
        self.links = []
        for output in self.outputs:
            links = FourLinks(*self.input, *output)
            self.links.append((links, self._second_links(links)))

    def _second_links(self, links: FourLinks) -> FourLinks | None:
        """Return the links of form ii, with a fourth one where r and s are one.

        That is the link whose poles with i and o span the surest plane on all curves.
        """
        if links.o in (links.r, links.i):
            return None
        if links.s != links.r:
            return links
        poles = {
            k: (pole_of(links.o, k), pole_of(links.i, k))
            for k in range(len(self.tracer.mechanism.links))
            if k not in links.different
        }
        wanted = [pole for pair in poles.values() for pole in pair]
        axes = [along.axes(along.curve.s, wanted) for along in self.along]

        def sine(k: int) -> float:
            """Return the mean sine of the angle of the poles of a link with o and i."""
            pairs = ([there[pole].unit for pole in poles[k]] for there in axes)
            sines = [np.linalg.norm(cross(*pair), axis=1) for pair in pairs]
            return float(np.mean(np.nan_to_num(np.concatenate([np.zeros(1), *sines]))))

        best = max(poles, key=lambda k: (sine(k), -k), default=None)
        return None if best is None else replace(links, s=best)

    def poles(self, output: int) -> list[Pole]:
        """Return the poles of an output's relations, each once."""
        every = (links.poles for links in self.links[output] if links is not None)
        return list(dict.fromkeys(pole for poles in every for pole in poles))

    def at(self, curve: int, s: Floats, output: int) -> AlongOutput:
        """Return rates and relations of an output at places s (n,) of a curve.

        Rates are by arc length. c and d are NaN where an axis is not known.
        """
        along = self.along[curve]
        q, y = (rate_between(along, k, s)[0] for k in (self.input, self.outputs[output]))
        axes = along.oriented(s, self.poles(output))
        return AlongOutput(q, y, tuple(self._made(output, axes)))

    def _made(self, output: int, axes: dict[Pole, Axis]) -> list[Relation]:
        """Return the relations of form i and, if there is one, form ii."""
        out = []
        for links, make in zip(self.links[output], (form_i, form_ii), strict=True):
            if links is not None:
                six = SixPoles.of(links, lambda a, b: axes[pole_of(a, b)].unit)
                relation = make(links, six)
                if relation is not None:
                    out.append(relation)
        return out

    def _judged(
        self,
        relation: Relation,
        rates: tuple[Floats, Floats],
        axes: dict[Pole, Axis],
        facts: Sequence[Type],
        resting: Sequence[Sequence[Pole]],
    ) -> list[RelationAt]:
        """Return a relation compared with rates of output and input; see `judged`."""
        errors = np.max([axes[pole].error for pole in relation.links.poles], axis=0)
        names = self.tracer.mechanism.links
        return judged(relation, names, rates, errors, facts, resting)

    def report(self) -> Singularities:
        """Return all singularities on all curves."""
        self.notes: list[str] = []
        self.gaps: list[str] = []
        self.whole: list[WholeCurve] = []
        points: list[list[SingularPoint]] = [[] for _ in self.outputs]
        for number, along in enumerate(self.along):
            poles = [pole for k in range(len(self.outputs)) for pole in self.poles(k)]
            along.follow(poles)
            self._note_gaps(number, along, poles)
            places = {pole: located(along, pole) for pole in dict.fromkeys(poles)}
            for output, listed in enumerate(points):
                listed += self._of_output(number, output, places)
        return Singularities(
            self.input,
            self.outputs,
            tuple(None if second is None else second.s for _, second in self.links),
            tuple(point for listed in points for point in listed),
            self._crossings(),
            tuple(self.whole),
            self._everywhere(),
            tuple(self.notes),
            tuple(self.gaps),
        )

    def _note_gaps(self, number: int, along: AlongCurve, poles: list[Pole]) -> None:
        """Note where zeros may be missed: lost axes, and curves that could not go on."""
        names = self.tracer.mechanism.links
        for a, b in dict.fromkeys(poles):
            lost = () if along.rests((a, b)) else along.sense((a, b)).lost
            for low, high in lost:
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
        self, number: int, output: int, places: dict[Pole, Roots | None]
    ) -> list[SingularPoint]:
        """Return the singular points of an output on one curve."""
        along, links = self.along[number], self.outputs[output]
        ends = self.input, links
        driven, wanted = (pole_of(*pair) for pair in ends)
        resting = [pole for pole in (driven, wanted) if places[pole] is None]
        if resting:
            self.whole.append(WholeCurve(type_of(resting, driven, wanted), links, number))
            return []
        roots: list[tuple[Pole | None, Roots]] = [
            (pole, zeros)
            for pole in self.poles(output)
            if (zeros := places[pole]) is not None
        ]
        roots += [(None, more) for more in self._coplanar(number, output, roots)]
        self._note_one_line(number, output)
        groups = groups_of(along.curve, roots)
        if not groups:
            return []
        s = np.array([group.s for group in groups])
        values, axes = along.points(s).values, along.oriented(s, self.poles(output))
        (q, dq), (y, _) = (rate_between(along, pair, s) for pair in ends)
        kinds = [type_of(group.members, driven, wanted) for group in groups]
        made = []
        for relation in self._made(output, axes):
            rates = rate_between(along, relation.output, s)[0], q
            rest = [[p for p in relation.links.poles if p in g.members] for g in groups]
            made.append(self._judged(relation, rates, axes, kinds, rest))
        notes = doubts(groups, kinds, driven != wanted)
        points = []
        for k, (group, kind) in enumerate(zip(groups, kinds, strict=True)):
            relations = tuple(rows[k] for rows in made)
            if kind == Type.APPARENT and all(r.type is None for r in relations):
                continue
            one, other = (group.members.get(pole) for pole in (driven, wanted))
            points.append(
                SingularPoint(
                    kind,
                    links,
                    number,
                    group.s,
                    group.error,
                    values[k],
                    float(q[k]),
                    float(y[k]),
                    float(dq[k]),
                    one is False,
                    other is False,
                    bool(one or other),
                    notes[k],
                    relations,
                )
            )
        return points

    def _coplanar(
        self, number: int, output: int, shown: Sequence[tuple[Pole | None, Roots]]
    ) -> list[Roots]:
        """Return where all six axes of four links lie in one plane, though all turn.

        The determinant of three of their angular velocities vanishes there, and wherever
        two of the links stand still relative to each other, which is known.
        """
        along, out = self.along[number], []
        places = np.concatenate([zero.s for _, zero in shown])
        for links in dict.fromkeys(self.links[output]):
            if links is None or len(links.different) < 4:
                continue
            grid = np.unique(np.concatenate([along.sense(p).s for p in links.poles]))

            def volume(s: Floats, links: FourLinks = links) -> tuple[Floats, Floats]:
                return _volume(along.rates(s), links)

            if max_abs(volume(grid)[0]) < ALWAYS:
                four = ", ".join(self.tracer.mechanism.links[k] for k in links.different)
                self.notes.append(
                    f"curve {number}: the six axes of the links {four} lie in one plane "
                    "everywhere, so c = d = 0 says nothing: the rates tell the types"
                )
                continue
            roots = along.locate(volume, grid)
            near = np.abs(roots.places[:, None] - places)
            if along.curve.closed:
                near = np.minimum(near, along.curve.length - near)
            fresh = np.min(near, axis=1, initial=np.inf) > 1e-6
            s = roots.places[fresh]
            error = place_error(along.curve, rounding_of(along.rates(s)), volume(s)[1])
            out.append(Roots(s, roots.double[fresh], error))
        return out

    def _note_one_line(self, number: int, output: int) -> None:
        """Note relations of three links that turn about one line on a whole curve."""
        along = self.along[number]
        axes = along.axes(along.curve.s, self.poles(output))
        for relation in self._made(output, axes):
            if relation.kind == LinkCount.THREE_LINKS and np.all(np.isnan(relation.c)):
                names = self.tracer.mechanism.links
                three = ", ".join(names[k] for k in relation.links.different)
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
                    if max_abs(curve.wrapped(values - there)) < SAME_CROSSING:
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
            return CrossingPoint(None, tuple(ends), values, note, ())
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
        return CrossingPoint(crossing, tuple(ends), values, "; ".join(notes), relations)

    def _on_curves_through(
        self, along: AlongCurve, crossing: Crossing, output: int
    ) -> tuple[tuple[RelationAt, ...], ...]:
        """Return the relations on each curve through a crossing, by its own motion."""
        count = len(crossing.tangents)
        if not count:
            return ()
        values = np.tile(crossing.values, (count, 1))
        axes, rates = along.leaving(values, crossing.tangents, self.poles(output))

        def rate(a: int, b: int) -> Floats:
            unit = axes[pole_of(a, b)].unit
            return np.sum((rates.w[:, a] - rates.w[:, b]) * unit, axis=1)

        forms = []
        for relation in self._made(output, axes):
            both = rate(*relation.output), rate(*self.input)
            made = self._judged(relation, both, axes, [Type.III] * count, [[]] * count)
            forms.append(
                [
                    replace(at, note=ONE_CURVE)
                    if at.type is None and at.kind != LinkCount.SAME_POLE
                    else at
                    for at in made
                ]
            )
        return tuple(zip(*forms, strict=True))

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
        least = min((solver.freedoms(values, SINGULAR) for values in closed), default=0)
        return least if least > 1 else None


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
    return np.sum(a * normal, axis=1), slope
