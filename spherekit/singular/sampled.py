"""Singularities of a mechanism with one input, and how near the rows of a motion come.

Each row is found on its configuration curve; there everything is regular, also at the
dead centres at which rates by the input are infinite.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import cast, final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import Status
from spherekit.motion.configuration import Configurations, Piece
from spherekit.motion.motion import Tracer
from spherekit.motion.turns import in_range, into_range, turns_in_range, whole_periods
from spherekit.numeric.turns import wrap
from spherekit.planning.assembly import Assembly, Group
from spherekit.rates.transmission import STILL, Transmission, hold
from spherekit.singular.output_relations import rate_between
from spherekit.singular.record import AlongOutput, Singularities, Type
from spherekit.singular.relation import Form
from spherekit.singular.single import SingleFreedom
from spherekit.singular.traced_part import TracedPart
from spherekit.sphere.rotation import Floats, cross

NEAR_CROSSING = 1e-4
"""Configurations (rad) that near to a crossing may lie where no curve is followed."""
AT_CROSSING = 1e-8
"""Configurations (rad) that near to it are the crossing, as far as they can be known."""
ALIKE = 10
"""Rows whose variables (rad) agree to so many places are one configuration."""
TOUCHES = 1e-6
"""A piece of a curve holds what is nearer than this to its ends (rad of arc length)."""


@final
@dataclass(frozen=True)
class RelationMeasures:
    """The relation c y' = d q' of one output in one form at n rows; NaN where unknown.

    Attributes
    ----------
    output, form
        Position of the output, and which relation.
    c, d
        (n,) its coefficients.
    input_rate, output_rate
        (n,) of q and y by the arc length of all variables.
    type_i, type_ii
        (n,) rad, see `SampledSingularities.angle`.
    transmission
        (n,) rad, the transmission angle of the dyad that places the output: in [0, pi/2],
        between the great circles of its arcs at the pair in its middle. NaN where another
        group places it.
    to_i, to_ii
        (n,) rad: change of the input along the curve to the nearest singularity.
    """

    output: int
    form: Form
    c: Floats
    d: Floats
    input_rate: Floats
    output_rate: Floats
    type_i: Floats
    type_ii: Floats
    transmission: Floats
    to_i: Floats
    to_ii: Floats


@final
class SampledSingularities:
    """The singularities on all configuration curves, and measures at given rows.

    Parameters
    ----------
    tracer
        A mechanism with one freedom.
    outputs
        Relative motions (o, s), numbers of links.
    values, assembly mode
        Configurations (n, variables) of the rows in rad, NaN for none, and their assembly
        mode.
    passed
        The inputs (n,) rad of rows that are a simulation: then what lies between them, on
        the curves where these rows do, is inside, and the range is what they pass.

    Attributes
    ----------
    tracer, whole
        That of the part on which the outputs depend, and the given one. The report's
        numbers of links and the curves' variables are those of the part.
    configurations, report
        All curves, and the singularities on them.
    curve, s
        (n,) the number of the curve of each row, -1 without one, and the place on it.
    status
        (n,) OK on a curve, AT_SINGULARITY so near to a crossing of curves that none is
        followed there, MODE_LOST elsewhere.
    crossed
        (n,) whether the row is such a crossing itself, where every rate may vanish.
    """

    def __init__(
        self,
        tracer: Tracer,
        outputs: Sequence[tuple[int, int]],
        values: Floats,
        assembly_mode: NDArray[np.int64],
        passed: Floats | None = None,
    ) -> None:
        links = tracer.mechanism.links
        self.whole, self._values = tracer, values
        self._part = TracedPart.of(tracer, [link for output in outputs for link in output])
        self.tracer = self._part.tracer
        number = self.tracer.mechanism.link_number
        self.configurations: Configurations = self.tracer.configurations
        self.curves = [item.curve for item in self.configurations.curves]
        named = [(number[links[o]], number[links[s]]) for o, s in outputs]
        self.analysis = SingleFreedom(self.tracer, self.curves, named)
        self.report: Singularities = self.analysis.report()
        self._place(values[:, list(self._part.variables)], assembly_mode)
        status = np.where(self._curve < 0, Status.MODE_LOST, Status.OK)
        crossed = np.zeros(len(self._curve), dtype=bool)
        for crossing in self.report.crossings:
            (lost,) = np.nonzero(self._curve < 0)
            curve = self.curves[crossing.ends[0][0]]
            away = curve.wrapped(self._distinct[lost] - crossing.values)
            far = np.max(np.abs(away), axis=1)
            status[lost[far < NEAR_CROSSING]] = Status.AT_SINGULARITY
            if crossing.crossing is not None:
                crossed[lost[far < AT_CROSSING]] = True
        self.curve, self.s = self._curve[self._row], self._s[self._row]
        self.status, self.crossed = status[self._row], crossed[self._row]
        self.range: tuple[float, float] = tracer.range
        self._ways: dict[int, tuple[float, float]] | None = None
        if passed is not None:
            self.range = float(np.min(passed)), float(np.max(passed))
            self._ways = self._passed(passed)

    def _place(self, values: Floats, assembly_mode: NDArray[np.int64]) -> None:
        """Find the place of each row on its curve; those alike in the part only once."""
        n = len(values)
        first, self._row = np.arange(n), np.arange(n)
        if self.tracer is not self.whole:
            _, first, row = np.unique(
                values.round(ALIKE), axis=0, return_index=True, return_inverse=True
            )
            self._row = row.reshape(-1)
        self._distinct, assembly_mode = values[first], assembly_mode[first]
        self._curve = np.full(len(first), -1)
        self._s = np.full(len(first), np.nan)
        finite = np.all(np.isfinite(self._distinct), axis=1)
        for elsewhere in (False, True):
            for number, item in enumerate(self.configurations.curves):
                expected = np.isin(assembly_mode, self.modes_of(item.pieces)) != elsewhere
                (todo,) = np.nonzero(finite & (self._curve < 0) & expected)
                places = item.curve.find(self._distinct[todo])
                on = np.isfinite(places)
                self._curve[todo[on]], self._s[todo[on]] = number, places[on]

    def modes_of(self, pieces: Iterable[Piece]) -> list[int]:
        """Return the numbers of all assembly modes on pieces of curves."""
        numbers = {piece.assembly_mode for piece in pieces} - {None}
        return sorted(
            mode for number in numbers for mode in self._part.modes[cast(int, number)]
        )

    def assembly_modes_at(self, curve: int, s: float, q: float) -> tuple[int, ...]:
        """Return the modes whose pieces of a curve hold or touch a place s at input q.

        Where the range is of whole periods its end is its start.
        """
        item = self.configurations.curves[curve]
        arc_curve, driven = item.curve, self.tracer.solver.single
        period, whole = self._period(curve), self.whole_range(curve)
        there = float(arc_curve.at(s).values[0, driven])
        touching: list[Piece] = []
        for lap in (0, 1, -1) if arc_curve.closed else (0,):
            place, there_again = (
                s + lap * arc_curve.length,
                there + lap * arc_curve.rise[driven],
            )
            for piece in item.pieces:
                touched = piece.start - TOUCHES <= place <= piece.stop + TOUCHES
                if not touched:
                    continue
                turns = round((there_again + piece.shift - q) / period)
                met = turns == 0 or self._ways is not None
                if met or (whole and turns % whole == 0):
                    touching.append(piece)
        return tuple(self.modes_of(touching))

    def at(self, curve: int, s: Floats, output: int) -> AlongOutput:
        """Return rates and relations of an output at places s (n,) of a curve."""
        return self.analysis.at(curve, s, output)

    def input_at(self, curve: int, s: Floats) -> Floats:
        """Return the input (n,) at places s, in the range or as near to it as turns allow.

        Only turns are left out after which the configuration is the same.
        """
        q = self.curves[curve].at(s).values[:, self.tracer.solver.single]
        return into_range(q, *self.range, self._period(curve))

    def _passed(self, q: Floats) -> dict[int, tuple[float, float]]:
        """Return from where to where on curves the rows of a simulation lie."""
        ways, driven = {}, self.tracer.solver.single
        for number in np.unique(self.curve[self.curve >= 0]).tolist():
            (rows,) = np.nonzero(self.curve == number)
            curve, s = self.curves[number], self.s[rows]
            if curve.closed:
                rise = curve.rise[driven]
                ahead = np.diff(q[rows]) / rise if rise else np.zeros(len(rows) - 1)
                steps = np.diff(s) / curve.length
                laps = np.cumsum(np.round(ahead - steps))
                s = s + curve.length * np.concatenate([[0.0], laps])
            ways[number] = float(np.min(s)), float(np.max(s))
        return ways

    def inputs_of(self, curve: int, values: Floats) -> Floats:
        """Return the inputs (k,) of the range at which a configuration (V,) is met.

        It is one of a curve. One outside, as near to the range as turns allow, if there is
        none; one alone of a curve that a simulation does not pass.
        """
        q = values[[self.tracer.solver.single]]
        every = turns_in_range(q, *self.range, self._period(curve))[0]
        return every[:1] if self._ways is not None and curve not in self._ways else every

    def whole_range(self, curve: int) -> int:
        """Return of how many whole periods of a curve the range is, 0 if of no number."""
        if self._ways is not None:
            return 0
        return whole_periods(*self.range, self._period(curve))

    def angle(self, kind: Type, curve: int, s: Floats, output: int) -> Floats:
        """Return how far (n,), rad, an output is from type I or II at places of a curve.

        Of type I the angle whose tangent is the size of the velocity coefficient y'/q', of
        type II that whose sine is the transmission. They vanish there and nowhere else; the
        first is NaN where both rates vanish.
        """
        along, (o, r) = self.analysis.along[curve], self.report.outputs[output]
        if kind is Type.I:
            rates = along.rates(s)
            of, to = (
                np.linalg.norm(rates.relative(*pole)[0], axis=1)
                for pole in ((r, o), self.report.input)
            )
            angle = np.asarray(np.arctan2(of, to))
            return np.where(np.hypot(of, to) > STILL, angle, np.nan)
        tree, held = along.closure.tree, (self.tracer.solver.single,)
        return np.asarray(np.arcsin(Transmission(tree, held, o, r).at(along.vectors(s))))

    def _period(self, curve: int) -> float:
        """Return the growth of the input with which a curve's configurations return."""
        solver = self.tracer.solver
        return self.curves[curve].returns_after(solver.single, *solver.periods)

    @property
    def is_simulation(self) -> bool:
        """Whether what is inside is what a simulation passes."""
        return self._ways is not None

    def inside(self, q: float, ends: Iterable[tuple[int, float]]) -> bool:
        """Return whether an input is in the range, and one of places on curves passed."""
        if not in_range(np.array(q), *self.range):
            return False
        return self._ways is None or any(self._is_passed(*end) for end in ends)

    def _is_passed(self, number: int, s: float) -> bool:
        assert self._ways is not None
        if number not in self._ways:
            return False
        low, high = self._ways[number]
        curve = self.curves[number]
        if curve.closed:
            s = low - TOUCHES + (s - low + TOUCHES) % curve.length
        return low - TOUCHES <= s <= high + TOUCHES

    def measures(self) -> list[RelationMeasures]:
        """Return the measures of every output in each form."""
        n = len(self._s)
        measured: dict[tuple[int, Form], dict[str, Floats]] = {}
        for number in range(len(self.curves)):
            (rows,) = np.nonzero(self._curve == number)
            if not len(rows):
                continue
            s = self._s[rows]
            angles = self.transmission_angles(self.curves[number].at(s).values)
            for output in range(len(self.report.outputs)):
                at = self.at(number, s, output)
                rates = {
                    "input_rate": at.input_rate,
                    "output_rate": at.output_rate,
                    "type_i": self.angle(Type.I, number, s, output),
                    "type_ii": self.angle(Type.II, number, s, output),
                    "transmission": angles[output],
                    "to_i": self._to_nearest(number, output, Type.I, s),
                    "to_ii": self._to_nearest(number, output, Type.II, s),
                }
                for relation in at.relations:
                    columns = measured.setdefault((output, relation.form), {})
                    for name, part in {
                        **rates,
                        "c": relation.c,
                        "d": relation.d,
                    }.items():
                        columns.setdefault(name, np.full(n, np.nan))[rows] = part
        return [
            RelationMeasures(
                output, form, **{name: part[self._row] for name, part in columns.items()}
            )
            for (output, form), columns in sorted(measured.items())
        ]

    def transmission_angles(self, values: Floats) -> list[Floats]:
        """Return the transmission angle (n,) of each output at configurations (n, V)."""
        axes = self.tracer.solver.closure.at(values).axes
        angles = []
        for output in self.report.outputs:
            dyad = _dyad_of(output, self.tracer.solver.assembly)
            if dyad is None:
                angles.append(np.full(len(values), np.nan))
                continue
            near, middle, far = (axes[:, dyad.pairs[place]] for place in dyad.dyad_places)
            one, other = cross(near, middle), cross(middle, far)
            sine = np.linalg.norm(cross(one, other), axis=1)
            angles.append(np.arctan2(sine, np.abs(np.sum(one * other, axis=1))))
        return angles

    def singular_values(self) -> tuple[Floats, Floats]:
        """Return (n,) how surely the locked input holds all links, and that of the best.

        See `spherekit.rates.transmission.hold`.
        """
        smallest = np.full(len(self.s), np.nan)
        ratio = smallest.copy()
        (rows,) = np.nonzero(self.curve >= 0)
        solver = self.whole.solver
        vectors = solver.closure.at(self._values[rows]).vectors
        smallest[rows], ratio[rows] = hold(solver.closure.tree, [solver.single], vectors)
        return smallest, ratio

    def output_angle(self, curve: int, output: int, s: Floats) -> Floats:
        """Return (n,) rad at rising s: the variable of the output's R pair in (-pi, pi].

        Where no R pair joins its links: how far one has turned about the pole since s[0].
        """
        variable = self.tracer.mechanism.angle_between(*self.report.outputs[output])
        if variable is not None:
            return wrap(self.curves[curve].at(s).values[:, variable])
        links = self.report.outputs[output]
        rate, _ = rate_between(self.analysis.along[curve], *links, s)
        steps = 0.5 * (rate[1:] + rate[:-1]) * np.diff(s)
        return np.concatenate([[0.0], np.cumsum(steps)])

    def configuration(self, curve: int, s: float) -> Floats:
        """Return the orientations (links, 3, 3) of all links at a place of a curve."""
        arc_curve = self.curves[curve]
        return np.asarray(arc_curve.segments.closure.at(arc_curve.at([s]).values).placed[0])

    def crossing_ends(self, curve: int) -> list[tuple[float, Floats]]:
        """Return where a curve ends at crossings: s, and the crossing (variables,).

        A curve ends a little before; the crossing is on the same turns of the variables.
        """
        followed = self.curves[curve]
        ends = []
        for crossing in self.report.crossings:
            for number, at_start in crossing.ends:
                if number == curve:
                    last = followed.nodes.values[0 if at_start else -1]
                    values = last + followed.wrapped(crossing.values - last)
                    ends.append((0.0 if at_start else followed.length, values))
        return ends

    def _to_nearest(self, number: int, output: int, kind: Type, s: Floats) -> Floats:
        curve, driven = self.curves[number], self.tracer.solver.single
        links = self.report.outputs[output]
        places = [
            point.s
            for point in self.report.points
            if point.curve == number and point.output == links and point.type is kind
        ]
        inputs = list(curve.at(places).values[:, driven]) if places else []
        for s_end, values in self.crossing_ends(number):
            places.append(s_end)
            inputs.append(values[driven])
        if not places:
            return np.full(len(s), np.nan)
        order = np.argsort(places)
        at, there = np.array(places)[order], np.array(inputs)[order]
        if curve.closed:
            rise = curve.rise[driven]
            at = np.concatenate([at - curve.length, at, at + curve.length])
            there = np.concatenate([there - rise, there, there + rise])
        here = curve.at(s).values[:, driven]
        after = np.searchsorted(at, s)
        ways = []
        for beside in (after - 1, after):
            inside = (beside >= 0) & (beside < len(at))
            way = np.abs(there[np.clip(beside, 0, len(at) - 1)] - here)
            ways.append(np.where(inside, way, np.inf))
        return np.asarray(np.minimum(*ways))


def _dyad_of(output: tuple[int, int], assembly: Assembly) -> Group | None:
    """Return the dyad that joins the two links of an output, None if it is no dyad."""
    for group in assembly.groups:
        places = {
            place
            for place, links in enumerate(group.bodies)
            if any(link in links for link in output)
        }
        if len(places) > 1:
            return group if group.is_dyad else None
    return None
