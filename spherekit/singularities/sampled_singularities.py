"""Singularities of a mechanism with one input, and how near the rows of a motion come.

Each row is found on its configuration curve; there everything is regular, also at the
dead centres at which rates by the input are infinite.

The part of a mechanism that places some links, with the assembly modes of the whole.

What hangs on it multiplies assembly modes and curves, and says nothing of the links asked
about unless it stops the input. A group that is left out has no dead centre anywhere.
"""

from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property
from itertools import chain, product

import numpy as np

from spherekit.arrays import Floats, Integers
from spherekit.geometry.triangle import arc
from spherekit.geometry.vectors import all_finite, cross, max_abs, nans
from spherekit.mechanism.pair_frames import link_axes
from spherekit.numerics.angles import wrap
from spherekit.planning.pole_plan import pole_of
from spherekit.planning.submechanism import part_for, placing_groups
from spherekit.positions.configuration_space import (
    SAME_CONFIGURATION,
    Configurations,
    Piece,
)
from spherekit.positions.input_revolutions import (
    in_range,
    into_range,
    turns_in_range,
    whole_periods,
)
from spherekit.positions.input_turning_points import input_turning_points
from spherekit.positions.mode_search import MOST_COST, MOST_TIME
from spherekit.positions.motion import Motion
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.singularities.input_output_relation import Form, Type
from spherekit.singularities.single_freedom import SingleFreedom
from spherekit.status import Status
from spherekit.velocities.transmission import STILL, Transmission, hold

COMPARED = 9
"""Samples at which assembly modes of the part and of the whole are compared."""
SAME_INPUT = 1e-6
"""Inputs (rad) at which modes meet and that differ by less are one."""


def traced_part(
    tracer: PositionAnalysis, links: Iterable[int]
) -> tuple[PositionAnalysis, list[int], dict[int, tuple[int, ...]]]:
    """Return a tracer of the part that places links, by numbers, relative to the input.

    Or of the whole mechanism where nothing can be left out. With it the numbers that its
    variables have in the whole, and those of the assembly modes of the whole by its own.
    """
    whole = tracer.mechanism
    made = whole if tracer.by_rank else part_for(whole, links)
    if made is not whole and tracer.solver.gear_phases is None:
        part = PositionAnalysis(made, path=np.linspace(*tracer.range, COMPARED)[:, None])
        pairs = (whole.pair_number[pair.name] for pair in made.pairs)
        variables = [*chain(*map(whole.variables_of, pairs))]
        modes = _modes(tracer, part, variables)
        if modes is not None:
            dead, inner = (  # what is left out may meet none at any input of a turn
                input_turning_points(solver, -np.pi, np.pi, MOST_COST, MOST_TIME)
                for solver in (tracer.solver, part.solver)
            )
            alike = not len(dead.doubtful) and len(dead.places) == len(inner.places)
            if alike and np.all(np.abs(dead.places - inner.places) < SAME_INPUT):
                return part, variables, modes
    modes = {mode.number: (mode.number,) for mode in tracer.assembly_modes}
    return tracer, [*range(len(whole.variable_owners))], modes


def _modes(
    tracer: PositionAnalysis, part: PositionAnalysis, variables: list[int]
) -> dict[int, tuple[int, ...]] | None:
    """Return the modes of the whole in each of the part, None if one has no place."""
    motion: Motion = tracer.sparse(COMPARED)
    k = motion.samples
    there = {
        mode.number: part.solver.evaluate(mode, motion.inputs[:k]).values
        for mode in part.assembly_modes
    }
    modes: dict[int, tuple[int, ...]] = dict.fromkeys(there, ())
    every = motion.values[:, variables].reshape(-1, k, len(variables))
    for mode, here, status in zip(
        tracer.assembly_modes, every, motion.status.reshape(-1, k), strict=True
    ):
        good = status == Status.OK
        alike = (
            number
            for number, of_part in there.items()
            if max_abs(wrap((of_part - here)[good])) < SAME_CONFIGURATION
        )
        number = next(alike, None) if np.any(good) else None
        if number is None:
            return None
        modes[number] += (mode.number,)
    return modes


NEAR_CROSSING = 1e-4
"""Configurations (rad) that near to a crossing may lie where no curve is followed."""
AT_CROSSING = 1e-8
"""Configurations (rad) that near to it are the crossing, as far as they can be known."""
TOUCHES = 1e-6
"""A piece of a curve holds what is nearer than this to its ends (rad of arc length)."""


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
        tracer: PositionAnalysis,
        outputs: Sequence[tuple[int, int]],
        values: Floats,
        assembly_mode: Integers,
        passed: Floats | None = None,
    ) -> None:
        links = tracer.mechanism.links
        self.whole, self._values = tracer, values
        self.tracer, variables, self._modes = traced_part(tracer, [*chain(*outputs)])
        self._driven = self.tracer.solver.input_variable
        self.configurations: Configurations = self.tracer.configurations
        self.curves = [item.curve for item in self.configurations.curves]
        self.report = SingleFreedom(
            self.tracer, self.curves, [(links[o], links[s]) for o, s in outputs]
        )
        self._place(values[:, variables], assembly_mode)
        self.range: tuple[float, float] = tracer.range
        self._ways: dict[int, tuple[float, float]] | None = None
        if passed is not None:
            self.range = float(np.min(passed)), float(np.max(passed))
            self._ways = self._passed(passed)

    def _place(self, values: Floats, assembly_mode: Integers) -> None:
        """Find the place of each row on its curve."""
        curve, s = np.full(len(values), -1), nans(len(values))
        finite = all_finite(values, 1)
        for elsewhere in (False, True):
            for number, item in enumerate(self.configurations.curves):
                expected = np.isin(assembly_mode, self.modes_of(item.pieces)) != elsewhere
                (todo,) = np.nonzero(finite & (curve < 0) & expected)
                places = item.curve.find(values[todo])
                on = np.isfinite(places)
                curve[todo[on]], s[todo[on]] = number, places[on]
        status = np.where(curve < 0, Status.MODE_LOST, Status.OK)
        crossed = np.zeros(len(curve), dtype=bool)
        for crossing in self.report.crossings:
            wrapped = self.curves[crossing.curve].wrapped(values - crossing.values)
            away = np.where(curve < 0, max_abs(wrapped, axis=1), np.inf)
            status[away < NEAR_CROSSING] = Status.AT_SINGULARITY
            crossed |= (away < AT_CROSSING) & (crossing.crossing is not None)
        self.curve, self.s, self.status, self.crossed = curve, s, status, crossed

    def modes_of(self, pieces: Iterable[Piece]) -> list[int]:
        """Return the numbers of all assembly modes on pieces of curves."""
        numbers = {piece.assembly_mode for piece in pieces}
        return sorted(m for k in numbers if k is not None for m in self._modes[k])

    def met(
        self, places: Sequence[tuple[int, float]], values: Floats, margin: float = 0.0
    ) -> Iterator[tuple[float, list[int], bool]]:
        """Yield the inputs at which a configuration (V,) of places on curves is met.

        With the assembly modes whose pieces of the curves hold or touch it there, and
        whether it is inside: in the range, and passed by a simulation. Of one outside, as
        near to the range as turns allow, one input; and of curves that a simulation does
        not pass. Where the range is of whole periods its end, by a `margin`, is its start.
        """
        first = places[0][0]
        low, high = self.range
        every = turns_in_range(values[[self._driven]], low, high, self._period(first))[0]
        if self._ways is not None and first not in self._ways:
            every = every[:1]
        for q in every.tolist():
            if high - q < margin and self.whole_range(first):
                q = low
            pieces = (piece for place in places for piece in self._touched(*place, q))
            inside = bool(in_range(np.array(q), low, high))
            yield q, self.modes_of(pieces), inside and any(map(self._is_passed, places))

    def _touched(self, curve: int, s: float, q: float) -> Iterator[Piece]:
        """Yield the pieces of a curve that hold or touch a place s at input q."""
        pieces = self.configurations.curves[curve].pieces
        arc = self.curves[curve]
        around = 1 if self.is_simulation else self.whole_range(curve) or np.inf
        away = float(arc.at(s).values[0, self._driven]) - q
        for lap, piece in product((0, 1, -1) if arc.closed else (0,), pieces):
            grown = away + lap * arc.rise[self._driven] + piece.shift
            if round(grown / self._period(curve)) % around == 0:
                place = s + lap * arc.length
                if piece.start - TOUCHES <= place <= piece.stop + TOUCHES:
                    yield piece

    def _is_passed(self, place: tuple[int, float]) -> bool:
        """Return whether a simulation, if it is one, passes a place on a curve."""
        number, s = place
        if self._ways is None or number not in self._ways:
            return self._ways is None
        low, high = self._ways[number]
        curve = self.curves[number]
        lap = curve.length if curve.closed else np.inf
        return bool((s - low + TOUCHES) % lap <= high - low + 2.0 * TOUCHES)

    def input_at(self, curve: int, s: Floats) -> Floats:
        """Return the input (n,) at places s, in the range or as near to it as turns allow.

        Only turns are left out after which the configuration is the same.
        """
        q = self.curves[curve].at(s).values[:, self._driven]
        return into_range(q, *self.range, self._period(curve))

    def _passed(self, q: Floats) -> dict[int, tuple[float, float]]:
        """Return from where to where on curves the rows of a simulation lie."""
        ways = {}
        for number in np.unique(self.curve[self.curve >= 0]).tolist():
            (rows,) = np.nonzero(self.curve == number)
            curve, s = self.curves[number], self.s[rows]
            if curve.closed:
                rise = curve.rise[self._driven] or np.inf
                laps = np.diff(q[rows]) / rise - np.diff(s) / curve.length
                s = s + curve.length * np.append(0.0, np.cumsum(np.round(laps)))
            ways[number] = float(np.min(s)), float(np.max(s))
        return ways

    def whole_range(self, curve: int) -> int:
        """Return of how many whole periods of a curve the range is, 0 if of no number."""
        period = self._period(curve)
        return 0 if self.is_simulation else whole_periods(*self.range, period)

    def _period(self, curve: int) -> float:
        """Return the growth of the input with which a curve's configurations return."""
        return self.curves[curve].returns_after(self._driven, *self.tracer.solver.periods)

    @property
    def is_simulation(self) -> bool:
        """Whether what is inside is what a simulation passes."""
        return self._ways is not None

    def angle(self, kind: Type, curve: int, s: Floats, output: int) -> Floats:
        """Return how far (n,), rad, an output is from type I or II at places of a curve.

        Of type I the angle whose tangent is the size of the velocity coefficient y'/q', of
        type II that whose sine is the transmission. They vanish there and nowhere else; the
        first is NaN where both rates vanish.
        """
        along = self.report.along[curve]
        links = self.report.outputs[output]
        if kind is Type.I:
            of, to = (along.at(s).speeds(pole)[0] for pole in (links, self.report.input))
            return np.where(np.hypot(of, to) > STILL, np.arctan2(of, to), np.nan)
        measure = Transmission(along.curve.closure.tree, (self._driven,), *links)
        return np.arcsin(measure.at(along.at(s).motion.vectors))

    def measures(self) -> dict[tuple[int, Form], dict[str, Floats]]:
        """Return the columns (n,) of each output, by its position, in each form; or NaN.

        ``c`` and ``d`` of c y' = d q'; ``output_rate`` and ``input_rate`` by the arc length
        of all variables; ``distance_I`` and ``distance_II`` (rad), see `angle`;
        ``transmission`` (rad), see `transmission_angles`; ``input_margin_I``,
        ``input_margin_II`` (rad), by how much the input changes along the curve to the
        nearest singularity.
        """
        measured: dict[tuple[int, Form], dict[str, Floats]] = {}
        for number in np.unique(self.curve[self.curve >= 0]).tolist():
            (rows,) = np.nonzero(self.curve == number)
            s = self.s[rows]
            angles = self.transmission_angles(self.curves[number].at(s).values)
            for output, transmission in enumerate(angles):
                q, y, relations = self.report.at(number, s, output)
                here = {"input_rate": q, "output_rate": y, "transmission": transmission}
                for kind in (Type.I, Type.II):
                    here[f"distance_{kind}"] = self.angle(kind, number, s, output)
                    here[f"input_margin_{kind}"] = self._to_nearest(number, output, kind, s)
                for relation in relations:
                    columns = measured.setdefault((output, relation.form), {})
                    here |= {"c": relation.c, "d": relation.d}
                    for name, part in here.items():
                        columns.setdefault(name, nans(len(self.s)))[rows] = part
        return dict(sorted(measured.items()))

    def transmission_angles(self, values: Floats) -> list[Floats]:
        """Return the transmission angle (n,) of each output at configurations (n, V).

        In [0, pi/2], between the great circles of the arcs of the dyad that places it, at
        the pair in its middle. NaN where another group does.
        """
        axes = self.tracer.solver.closure.at(values).axes
        angles = []
        for output in self.report.outputs:
            joining = (
                group
                for group in self.tracer.solver.assembly.groups
                if sum(not links.isdisjoint(output) for links in map(set, group.bodies)) > 1
            )
            dyad = next(joining, None)
            angle = nans(len(values))
            if dyad is not None and dyad.is_dyad:
                near, middle, far = (axes[:, dyad.pairs[k]] for k in dyad.dyad_positions)
                angle = arc(cross(near, middle), cross(middle, far))
            angles.append(np.minimum(angle, np.pi - angle))
        return angles

    def least_dyad_angle(self, values: Floats, output: int) -> Floats:
        """Return the least transmission angle (n,) of the dyads that place an output.

        It vanishes at singularities of type II only, and does not depend on the size of
        the arcs, as the transmission does. NaN if other groups place the output too.

        Parameters
        ----------
        values
            (n, variables) configurations.
        output
            Position of the output.
        """
        solver = self.tracer.solver
        links = frozenset(self.report.outputs[output])
        groups = placing_groups(solver.mechanism, solver.assembly, links)
        least = np.full(len(values), 0.5 * np.pi if groups else np.nan)
        axes = solver.closure.at(values).axes
        for group in groups:
            if not group.is_dyad:
                return nans(len(values))
            near, middle, far = (axes[:, group.pairs[k]] for k in group.dyad_positions)
            angle = arc(cross(near, middle), cross(middle, far))
            least = np.minimum(least, np.minimum(angle, np.pi - angle))
        return least

    @cached_property
    def largest_arc_sine(self) -> float:
        """The largest sine of an arc between two axes of a link.

        Where all arcs are small the mechanism is nearly planar, and the transmission of
        type II is in proportion to it. It is 1 where profiles have a size of their own.
        """
        mechanism = self.tracer.solver.mechanism
        if mechanism.has_contacts:
            return 1.0
        sines = [0.0]
        for axes in link_axes(mechanism).values():
            if not axes:
                continue
            directions = np.array(list(axes.values()))
            for direction in directions:
                sines.extend(np.linalg.norm(np.cross(direction, directions), axis=1))
        return float(max(sines)) or 1.0

    def singular_values(self) -> Floats:
        """Return (2, n) how surely the locked input holds all links, and to what part.

        See `spherekit.velocities.transmission.hold`.
        """
        solver = self.whole.solver
        placed = np.where(self.curve[:, None] >= 0, self._values, np.nan)
        return hold(
            solver.closure.tree, [solver.input_variable], solver.closure.at(placed).vectors
        )

    def output_angle(self, curve: int, output: int, s: Floats) -> Floats:
        """Return (n,) rad at rising s: the variable of the output's R pair on the curve.

        Where no R pair joins its links: how far one has turned about the pole since s[0].
        """
        links = self.report.outputs[output]
        variable = self.tracer.mechanism.angle_between(*links)
        if variable is not None:
            return self.curves[curve].at(s).values[:, variable]
        rate, _ = self.report.along[curve].signed(s, pole_of(*links))
        return np.append(0.0, np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(s)))

    def configuration(self, curve: int, s: float) -> Floats:
        """Return the orientations (links, 3, 3) of all links at a place of a curve."""
        arc = self.curves[curve]
        return arc.closure.at(arc.at(s).values).placed[0]

    def crossing_ends(self, curve: int) -> list[tuple[float, Floats]]:
        """Return where a curve ends at crossings: s, and the crossing (variables,).

        A curve ends a little before; the crossing is on the same turns of the variables.
        """
        arc = self.curves[curve]
        ends = []
        for crossing in self.report.crossings:
            for number, place in crossing.places:
                if number == curve and crossing.output == self.report.outputs[0]:
                    last = arc.nodes.values[0 if place == 0.0 else -1]
                    ends.append((place, last + arc.wrapped(crossing.values - last)))
        return ends

    def _to_nearest(self, number: int, output: int, kind: Type, s: Floats) -> Floats:
        """Return by how much (n,) the input changes from s to the nearest of a type."""
        curve = self.curves[number]
        links = self.report.outputs[output]
        met = [
            (point.s, point.values)
            for point in self.report.points
            if (point.curve, point.output, point.type) == (number, links, kind)
        ]
        met += self.crossing_ends(number)
        places = np.reshape([(s, values[self._driven]) for s, values in met], (-1, 2))
        if curve.closed:
            lap = np.array([curve.length, curve.rise[self._driven]])
            places = np.concatenate([places - lap, places, places + lap])
        places = places[np.argsort(places[:, 0])]
        after = np.searchsorted(places[:, 0], s)
        beside = np.pad(places[:, 1], 1, constant_values=np.nan)[[after, after + 1]]
        return np.fmin.reduce(np.abs(beside - curve.at(s).values[:, self._driven]))
