"""Every function that a stored model keeps, exactly, at any places of its coordinates.

Of one input the configuration curve is followed once, and its coordinate is the variable q
of the input where that turns fully on a closed curve, else the curve's arc length s. Of
several inputs the assembly mode is followed over a coarse grid of the box of their ranges.
Configurations between are found by Newton's method from the nearest known one, predicted to
the second order.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from spherekit.arrays import Floats, Indices
from spherekit.conventions import TURN, Names
from spherekit.dynamics.coordinates import (
    CoordinateMotion,
    by_arc_length,
    by_variables,
    christoffel,
    continued,
    determined,
    inertia,
)
from spherekit.dynamics.reduced_model_archive import StoredHeading, StoredLoad
from spherekit.dynamics.transmitted_forces import Loads
from spherekit.errors import SolveError
from spherekit.files.mechanism_writer import mechanism_hash
from spherekit.geometry.rotation import all_finite, max_abs, nans
from spherekit.mechanism.load import TorqueTable
from spherekit.mechanism.load_expression import Expression
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.pole_plan import Pole, PrimaryPole
from spherekit.planning.pole_planner import plan
from spherekit.positions.configuration_curve import ArcCurve
from spherekit.positions.curve_continuation import follow_arc
from spherekit.positions.linearisation import Linearisation
from spherekit.positions.motion import Motion, PositionAnalysis, going_on, motion_of
from spherekit.status import Status
from spherekit.tolerances import CLOSURE_TOLERANCE, EPS
from spherekit.velocities.pole_sequence import PlannedPoles
from spherekit.version import __version__

PROBED_INPUTS = 24
"""Places in the input's range where a configuration of the assembly mode is looked for."""

FLAT = 1e-3
"""An input whose rate along the curve falls below this is not a crank to count by."""

CURVE_NODES = 512
"""Known configurations of a curve, between which Newton's method finds others."""

MARKS = 2**13
"""Places along the curve where the sense of each pole axis is noted."""

SURE_AXES = 1e-14
"""Pole axes whose error bound is below this are taken from the plan unquestioned."""

TRUST = 0.2
"""Largest change (rad) of a variable in a step of Newton's method."""

APART = 0.02
"""A configuration farther (rad) than this from where the trapezoidal rule leads from the
nearest known one is not of the same mode."""

SURE = 0.02
"""Inputs that determine the motion less surely than this are too near a singularity."""


def own_velocities(loads: Loads) -> dict[int, str]:
    """Return the names of velocities of components that no pair's rate is, by number."""
    owners, names = loads.owners, {}
    for k, owner in enumerate(owners):
        if not loads.components[k].pair:
            names[k] = f"load {loads.names[owner]}"
            if owners.count(owner) > 1:
                names[k] += f" {'xyz'[k - owners.index(owner)]}"
    return names


class Sampler:
    """Every function to be stored, exactly, at any places of the coordinates.

    `nodes` is the motion at configurations by the inputs, whose variables are `driven`;
    `by`, `low`, `high`, `rise` and `periodic` are those of the heading.
    """

    nodes: CoordinateMotion
    driven: list[int]
    by: Names
    low: Floats
    high: Floats
    rise: Floats = np.zeros(0)
    periodic = False

    def __init__(self, tracer: PositionAnalysis, poles: tuple[Pole, ...]) -> None:
        self.tracer, self.mechanism, self.poles = tracer, tracer.mechanism, poles
        self.closure = tracer.solver.closure
        self.loads = Loads(self.mechanism)
        self.velocities = own_velocities(self.loads)
        self.heavy = bool(self.mechanism.masses or self.mechanism.loads)

    def heading(self, assembly_mode: int) -> StoredHeading:
        """Return the heading of a model of an assembly mode, without its functions."""
        made = self.mechanism
        low, high, rise = (tuple(x.tolist()) for x in (self.low, self.high, self.rise))
        return StoredHeading(
            made.name,
            mechanism_hash(made),
            __version__,
            assembly_mode,
            made.variable_names,
            tuple(made.angles),
            tuple(pole_name(made, pole) for pole in self.poles),
            _stored_loads(self.loads, self.velocities),
            self.tracer.inputs,
            self.by,
            low,
            high,
            rise,
            self.periodic,
        )

    def names(self, heading: StoredHeading) -> dict[str, str]:
        """Return the names of what the motion needs, with their units."""
        made = self.mechanism
        units = dict.fromkeys(made.variable_names, "rad")
        for name in made.variable_names:
            units |= dict.fromkeys(heading.by_coordinates(name), "")
        if self.heavy:
            units |= dict.fromkeys(heading.inertia, "kg m2")
            for symbols in heading.christoffel:
                units |= dict.fromkeys(symbols, "kg m2" + "/rad" * heading.alone)
        for k, name in self.velocities.items():
            unit = made.loads[self.loads.owners[k]].velocity_unit
            units |= dict.fromkeys(heading.by_coordinates(name), unit)
        return units

    def of_motion(self, motion: CoordinateMotion, bend: float) -> Floats:
        """Return the values (n, F) of these, at rows of a motion by the coordinates.

        Christoffel symbols times `bend`.
        """
        n, m = motion.rates.shape[:2]
        parts = [motion.values, np.swapaxes(motion.rates, 1, 2).reshape(n, -1)]
        if self.heavy:
            masses, (rows, columns) = inertia(self.mechanism, motion), np.tril_indices(m)
            symbols = bend * christoffel(masses.dM)[:, :, rows, columns]
            parts += [masses.M[:, rows, columns], symbols.reshape(n, -1)]
        if self.velocities:
            works = self.loads.velocities(motion)[..., list(self.velocities)]
            parts.append(np.swapaxes(works, 1, 2).reshape(n, -1))
        return np.concatenate(parts, axis=1)

    @cached_property
    def _nearest(self) -> Callable[[Floats], Indices]:
        from scipy.spatial import cKDTree

        tree = cKDTree(self.nodes.values[:, self.driven])
        return lambda q: np.asarray(tree.query(q)[1])

    def closed(self, q: Floats) -> tuple[Linearisation, Indices, Floats]:
        """Return closed configurations at inputs (n, m), which known one each is from.

        And the step (n, m) from that.
        """
        nodes, near = self.nodes, self._nearest(q)
        step = q - nodes.values[near][:, self.driven]
        ahead = np.einsum("ni,niv->nv", step, nodes.rates[near])
        bend = np.einsum("ni,nk,nikv->nv", step, step, nodes.second[near])
        values = nodes.values[near] + ahead + 0.5 * bend
        values[:, self.driven] = q
        with np.errstate(all="ignore"):
            return self.closure.solve(values, self.driven, trust=TRUST), near, step


class AlongCurve(Sampler):
    """These along the whole curve of one input, and all that is asked of its poles."""

    def __init__(self, tracer: PositionAnalysis, poles: tuple[Pole, ...]) -> None:
        super().__init__(tracer, poles)
        self.curve, values = _followed(tracer)
        curve, driven = self.curve, tracer.solver.single
        self.driven = [driven]
        self.plan = plan(self.mechanism, list(poles), tracer.inputs[0], tracer.by_rank)
        along, turns = curve.nodes.tangents[:, driven], int(curve.winding[driven])
        self.by_input = bool(
            curve.closed
            and np.all(along * np.sign(turns) > FLAT)
            and not len(curve.dead_points(driven).places)
        )
        self.sense, self.lap = 1.0, curve.length
        if self.by_input:
            self.sense, self.lap = float(np.sign(turns)), abs(turns) * TURN
            offset = curve.at(curve.find(values[None])).values[0] - values
            every = curve.at(np.linspace(0.0, curve.length, CURVE_NODES)).values - offset
            self.nodes = by_variables(self.closure, every, self.driven)
        self.periodic, self.laps = curve.closed, 1
        self._note_senses()
        self.by, self.low = ("q" if self.by_input else "s",), np.zeros(1)
        self.high = np.array([self.laps * self.lap])
        self.rise = curve.rise * self.sense * self.laps

    def columns(self, groups: Sequence[int], x: Floats) -> Floats:
        """Return the functions (n, F) of some groups: that of the motion, or of poles."""
        motion, parts = self._motion(x), []
        directions = self._directions(x, motion) if any(groups) else {}
        for number in groups:
            if number:
                pole = self.poles[number - 1]
                parts.append(_of_pole(motion, pole, directions[pole]))
            else:
                parts.append(self.of_motion(motion, 2.0))
        return np.concatenate(parts, axis=1)

    def _motion(self, x: Floats) -> CoordinateMotion:
        if self.by_input:
            sense, lap = self.sense, self.lap
            laps = np.floor(sense * (x - self.nodes.values[0, self.driven]) / lap)
            solution, *_ = self.closed((x - sense * laps * lap)[:, None])
            values = solution.values + np.outer(laps, self.curve.rise)
            values[:, self.driven[0]] = x
            return by_variables(self.closure, values, self.driven)
        points = self.curve.at(x)
        motion = by_arc_length(self.closure, points.values)
        return motion.turned(np.sign(np.vecdot(motion.rates[:, 0], points.tangents)))

    def _directions(self, x: Floats, motion: CoordinateMotion) -> dict[Pole, Floats]:
        """Return the unit vectors (n, 3) of the poles, in the sense that was noted."""
        units = self._lines(motion)
        nearest = np.rint(x / self.lap * MARKS).astype(int)
        if self.periodic:
            nearest %= MARKS * self.laps
        for pole, unit in units.items():
            if pole in self.marks:
                side = np.vecdot(unit, self.marks[pole][nearest])
                unit[side < 0.0] *= -1.0
        return units

    def _lines(self, motion: CoordinateMotion) -> dict[Pole, Floats]:
        """Return unit vectors along the pole axes, in either sense."""
        planned = PlannedPoles(self.plan, self._as_motion(motion))
        units: dict[Pole, Floats] = {}
        w = motion.w[:, 0]
        size = np.max(np.linalg.norm(w, axis=2), axis=1)
        for pole in self.poles:
            unit = planned.unit[pole].T.copy()
            error = np.nan_to_num(planned.error[pole], nan=np.inf)
            apart = w[:, pole[1]] - w[:, pole[0]]
            length = np.linalg.norm(apart, axis=1)
            with np.errstate(divide="ignore", invalid="ignore"):
                better = (error > SURE_AXES) & (8.0 * EPS * size / length < error)
                unit[better] = apart[better] / length[better, None]
            if not all_finite(unit):
                raise SolveError(
                    f"{self.mechanism.name}: pole {pole_name(self.mechanism, pole)} has no "
                    "direction at places of the curve: the two links do not move relative "
                    "to each other there; leave it out"
                )
            units[pole] = unit
        return units

    def _as_motion(self, motion: CoordinateMotion) -> Motion:
        return replace(motion_of(self.tracer.solver, motion.values), status=motion.status)

    def _note_senses(self) -> None:
        """Note the sense of every secondary axis along the curve.

        The first looks to the side where the sum of all pair axes lies; axes that come
        back reversed make the period two laps.
        """
        primary = {step.pole for step in self.plan.steps if isinstance(step, PrimaryPole)}
        motion = self._motion(self.lap * np.arange(MARKS + 1) / MARKS)
        home = np.sum(self._as_motion(motion).frames[0, :, :, 2], axis=0)
        senses = {p: u for p, u in self._lines(motion).items() if p not in primary}
        steps = [np.abs(np.vecdot(u[1:], u[:-1])) for u in senses.values()]
        if np.min(steps, initial=1.0) < 0.7:
            raise SolveError(
                f"{self.mechanism.name}: a pole axis turns too fast to be followed; "
                "ask for fewer poles"
            )
        marks = {p: u * continued(u, home)[:, None] for p, u in senses.items()}
        back = {p: np.sign(u[0] @ u[-1]) for p, u in marks.items()}
        if self.periodic and -1.0 in back.values():
            self.laps = 2
            marks = {p: np.concatenate([u[:-1], u * back[p]]) for p, u in marks.items()}
        self.marks = marks


class OverBox(Sampler):
    """These over the ranges of several inputs."""

    def __init__(self, tracer: PositionAnalysis, poles: tuple[Pole, ...]) -> None:
        super().__init__(tracer, poles)
        self.driven = [self.mechanism.angles[pair] for pair in tracer.inputs]
        self.low, self.high = np.array([item.range for item in self.mechanism.inputs]).T
        self.by = tracer.inputs
        motion = going_on(tracer.motion(), tracer.solver)
        values = motion.values[motion.status == Status.OK]
        nodes = by_variables(self.closure, values, self.driven)
        sure = all_finite(nodes.second, (1, 2, 3))
        sure &= determined(nodes.rates) >= SURE
        if not np.any(sure):
            raise SolveError(
                f"{self.mechanism.name}: the assembly mode has no regular configuration on "
                "a grid over the ranges of the inputs; give another assembly mode or range"
            )
        self.nodes = nodes.rows(sure)

    def at(self, q: Floats, count: int) -> Floats:
        """Return all functions (n, count) at inputs (n, m), NaN where the mode is not."""
        solution, near, step = self.closed(q)
        values, nodes = solution.values, self.nodes
        with np.errstate(all="ignore"):
            moving = by_variables(self.closure, values, self.driven, order=1)
            both = nodes.rates[near] + moving.rates
            led = nodes.values[near] + 0.5 * np.einsum("ni,niv->nv", step, both)
            good = solution.gap < CLOSURE_TOLERANCE
            good &= max_abs(led - values, axis=1) < APART
            good &= (determined(moving.rates) >= SURE) & (moving.status == Status.OK)
        functions = nans((len(q), count))
        functions[good] = self.columns(
            by_variables(self.closure, values[good], self.driven)
        )
        return functions

    def columns(self, motion: CoordinateMotion) -> Floats:
        """Return all functions (n, F) of a motion by the inputs."""
        parts = [self.of_motion(motion, 1.0)]
        for first, second in self.poles:
            w = motion.w[:, :, second] - motion.w[:, :, first]
            parts.append(np.swapaxes(w, 1, 2).reshape(len(w), -1))
        return np.concatenate(parts, axis=1)


def _followed(tracer: PositionAnalysis) -> tuple[ArcCurve, Floats]:
    """Return the curve of the tracer's assembly mode, and a configuration on it."""
    mechanism = tracer.mechanism
    low, high = tracer.range
    places = low + (high - low) * (np.arange(PROBED_INPUTS) + 0.5) / PROBED_INPUTS
    motion = going_on(tracer.at(places), tracer.solver)
    stops = {
        mechanism.variables_of(mechanism.pair_number[stop.pair])[0]: (stop.low, stop.high)
        for stop in mechanism.joint_limits
    }
    usable = motion.status == Status.OK
    for variable, (least, most) in stops.items():
        value = motion.values[:, variable]
        usable &= (value > least) & (value < most)
    if not np.any(usable):
        raise SolveError(
            f"{mechanism.name}: the assembly mode has no configuration within the joint "
            f"limits at any of {PROBED_INPUTS} inputs of its range; give another assembly "
            "mode or range"
        )
    values = motion.values[np.argmax(usable)]
    return follow_arc(tracer.solver.closure, values, stops), values


def _of_pole(motion: CoordinateMotion, pole: Pole, unit: Floats) -> Floats:
    """Return direction, coefficient and the coefficient's derivative (n, 5)."""
    first, second = pole
    w = motion.w[:, 0, second] - motion.w[:, 0, first]
    dw = motion.dw[:, 0, 0, second] - motion.dw[:, 0, 0, first]
    return np.column_stack([unit, np.vecdot(w, unit), np.vecdot(dw, unit)])


def pole_name(mechanism: Mechanism, pole: Pole) -> str:
    """Return the name of a pole, LINK/RELATIVE_TO."""
    first, second = pole
    return f"{mechanism.links[second]}/{mechanism.links[first]}"


def _stored_loads(loads: Loads, velocities: Mapping[int, str]) -> tuple[StoredLoad, ...]:
    """Return what magnitudes of loads depend on besides the configuration."""
    stored = []
    for number, load in enumerate(loads.mechanism.loads):
        works_on, texts = [], []
        for k, part in enumerate(loads.components):
            if loads.owners[k] == number:
                works_on.append(velocities.get(k, f"theta_{part.pair}"))
                if isinstance(part.magnitude, Expression):
                    texts.append(part.magnitude.text)
        table: tuple[Any, ...] = ()
        if isinstance(load, TorqueTable):
            table = load.times, load.torques, load.periodic
        stored.append(StoredLoad(load.name, tuple(works_on), tuple(texts), *table))
    return tuple(stored)
