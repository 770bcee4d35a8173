"""Making a mechanism's stored functions: computed once, on its whole curve.

The configuration curve is followed once; B, the loads' geometry, the pair variables, and
pole axes with their coefficients are sampled along it and stored as Chebyshev series
of one coordinate (Di Gregorio 2024, section 4). Where the input turns fully on a
closed curve the coordinate is its variable q, else the curve's arc length s.
"""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import cached_property, partial
from typing import final

import numpy as np

from spherekit.checked import checked
from spherekit.conventions import EPS, Status
from spherekit.dynamics.forces import Loads
from spherekit.dynamics.inertia import inertia
from spherekit.dynamics.kinematics import CoordinateMotion, by_arc_length, by_variables
from spherekit.dynamics.model_metadata import ModelMetadata, StoredFunction
from spherekit.dynamics.stored_loads import own_velocities, stored_loads
from spherekit.dynamics.tabulated import TabulatedModel
from spherekit.errors import SolveError
from spherekit.files.read import AnyMechanism, mechanism_of
from spherekit.files.write import mechanism_hash
from spherekit.model.bearings import need_no_rubbing
from spherekit.model.mechanism import Mechanism
from spherekit.motion.arc_curve import ArcCurve
from spherekit.motion.arc_length import follow_arc
from spherekit.motion.continued import going_on
from spherekit.motion.motion import Motion, Tracer, motion_of
from spherekit.numeric.chebyshev import ROUNDING, PiecewiseChebyshev
from spherekit.planning.plan import plan
from spherekit.planning.poles import CoaxialPole, Pole, PrimaryPole, all_poles, parse_pole
from spherekit.progress import Working
from spherekit.rates.lines import evaluate_lines
from spherekit.sphere.rotation import Floats
from spherekit.version import __version__

PROBED_INPUTS = 24
"""Places in the input's range where a configuration of the assembly mode is looked for."""

FLAT = 1e-3
"""An input whose rate along the curve falls below this is not a crank to count by."""

MARKS = 1024
"""Places along the curve where the sense of each pole axis is noted, at first."""
MOST_MARKS = 2**14

FIRST_CELLS = 16
"""Cells of every stored function at first; fewer could miss a narrow feature."""

LEAST = 0.03
"""A function counts as no smaller than this part of the largest of its kind."""

SURE = 1e-14
"""Pole axes whose error bound is below this are taken from the plan unquestioned."""


@checked(SolveError)
def online_model(
    mechanism: AnyMechanism,
    *,
    input_pair: str | None = None,
    assembly_mode: int = 0,
    poles: Iterable[str] | None = None,
    tolerance: float = 1e-13,
) -> TabulatedModel:
    """Return the stored functions of one assembly mode of a single-DOF mechanism.

    Parameters
    ----------
    mechanism
        Its masses and loads are stored where it has some; its stops end the curve.
    input_pair, assembly mode
        The driven R pair, by default the first input, and the assembly mode.
    poles
        The poles wanted, as ``"3/1"``; all by default.
    tolerance
        Error to reach, relative to the largest value of each function.

    Raises
    ------
    PlanError, SolveError
        If the mechanism has more freedoms than one, there is no such assembly mode or pole,
        a pole axis has no direction somewhere on the curve, or the tolerance is none.
    """
    mechanism = mechanism_of(mechanism)
    if not 1e-15 <= tolerance <= 1e-2:
        raise SolveError(
            f"{mechanism.name}: tolerance is {tolerance:g}, allowed is 1e-15 to 1e-2"
        )
    need_no_rubbing(mechanism, "a stored model has not")
    tracer = Tracer(mechanism, input_pair, assembly_mode)
    made = tracer.mechanism
    links = len(made.links)
    wanted = (
        all_poles(links)
        if poles is None
        else tuple(dict.fromkeys(parse_pole(made, text) for text in poles))
    )
    sampler = _Sampler(tracer, _followed(tracer), wanted)
    size = _sizes(sampler.columns(sampler.spread(MARKS)), sampler)
    fitted, groups, at = [], [], 0
    working, count = Working("fitting functions"), len(size)
    for number, names in enumerate(sampler.groups):
        words = f"{at} of {count}"
        working.tell(words.__str__)
        sizes = size[at : at + len(names)]
        at += len(names)
        fitted.append(
            PiecewiseChebyshev.fit(
                partial(sampler.group, number),
                sampler.low,
                sampler.high,
                tolerance,
                sizes,
                FIRST_CELLS,
                rounding=ROUNDING,
            )
        )
        units = zip(names.items(), sizes, strict=True)
        groups.append(
            tuple(
                StoredFunction(name, unit, float(most), 0.0) for (name, unit), most in units
            )
        )
    heading = ModelMetadata(
        mechanism=made.name,
        mechanism_sha256=mechanism_hash(made),
        made_by=__version__,
        input=tracer.inputs[0],
        assembly_mode=assembly_mode,
        coordinate=sampler.coordinate,
        periodic=sampler.periodic,
        low=sampler.low,
        high=sampler.high,
        variables=made.variable_names,
        angles=tuple(made.angles),
        poles=tuple(pole_name(made, pole) for pole in wanted),
        loads=stored_loads(sampler.loads, lambda name: f"d({name})/d{sampler.coordinate}"),
        rise=tuple(sampler.rise.tolist()),
        groups=tuple(groups),
    )
    return _measured(TabulatedModel(heading, tuple(fitted)), sampler)


def _measured(model: TabulatedModel, sampler: "_Sampler") -> TabulatedModel:
    """Return the model with the errors of its functions, measured midway in all cells.

    Cells are parted unevenly, so the places are others than those sampled or checked.
    """
    groups = []
    for number, fitted in enumerate(model.groups):
        part = 0.5 * (np.sqrt(5.0) - 1.0)
        x = np.concatenate(
            [fitted.edges[:-1] + k * part % 1.0 * np.diff(fitted.edges) for k in (1, 2, 3)]
        )
        x.sort()
        gap = np.max(np.abs(fitted.at(x) - sampler.group(number, x)), axis=0)
        groups.append(
            tuple(
                replace(function, error=float(error) / function.largest)
                for function, error in zip(model.heading.groups[number], gap, strict=True)
            )
        )
    return TabulatedModel(replace(model.heading, groups=tuple(groups)), model.groups)


def _followed(tracer: Tracer) -> tuple[ArcCurve, Floats]:
    """Return the curve of the tracer's assembly mode, and a configuration on it."""
    mechanism = tracer.mechanism
    low, high = tracer.range
    places = low + (high - low) * (np.arange(PROBED_INPUTS) + 0.5) / PROBED_INPUTS
    motion = going_on(tracer.at(places), tracer.solver)
    stops = {
        mechanism.variables_of(mechanism.pair_number[stop.pair])[0]: (stop.low, stop.high)
        for stop in mechanism.stops
    }
    usable = motion.status == Status.OK
    for variable, (least, most) in stops.items():
        value = motion.values[:, variable]
        usable &= (value > least) & (value < most)
    good = np.flatnonzero(usable)
    if not len(good):
        raise SolveError(
            f"{mechanism.name}: the assembly mode has no configuration within the stops "
            f"at any "
            f"of {PROBED_INPUTS} inputs of its range; give another assembly mode or range"
        )
    values = motion.values[good[0]].copy()
    return follow_arc(tracer.solver.closure, values, stops), values


@final
class _Sampler:
    """Every function to be stored, exactly, at any places x (n,) of the coordinate."""

    def __init__(
        self, tracer: Tracer, followed: tuple[ArcCurve, Floats], poles: tuple[Pole, ...]
    ) -> None:
        self.tracer = tracer
        self.mechanism = tracer.mechanism
        self.curve, values = followed
        self.driven = tracer.solver.single
        self.loads = Loads(self.mechanism)
        self.velocities = own_velocities(self.loads)
        self.poles = poles
        self.plan = plan(self.mechanism, list(poles), tracer.inputs[0], tracer.by_rank)
        here = self.curve.at(self.curve.find(values[None]))
        self.offset = here.values[0] - values
        along = self.curve.nodes.tangents[:, self.driven]
        turns = int(self.curve.winding[self.driven])
        self.by_input = (
            self.curve.closed
            and turns != 0
            and bool(np.all(along * np.sign(turns) > FLAT))
            and not len(self.curve.dead_points(self.driven).places)
        )
        self.sense = float(np.sign(turns)) if self.by_input else 1.0
        self.coordinate = "q" if self.by_input else "s"
        self.periodic = self.curve.closed
        self.low = 0.0
        self.lap = abs(turns) * 2.0 * np.pi if self.by_input else self.curve.length
        self.laps = 1
        self._note_senses()

    @property
    def high(self) -> float:
        """Upper end of the coordinate."""
        return self.low + self.laps * self.lap

    @property
    def rise(self) -> Floats:
        """Growth (variables,) of the variables from `low` to `high`."""
        return self.curve.rise * self.sense * self.laps

    def spread(self, count: int, first: float = 0.0) -> Floats:
        """Return places (count,) in rising order, the first that part beyond `low`."""
        if not self.periodic:
            return np.asarray(np.linspace(self.low, self.high, count))
        return self.low + (self.high - self.low) * (np.arange(count) + first) / count

    @cached_property
    def groups(self) -> tuple[dict[str, str], ...]:
        """Names of the columns with their units, group by group."""
        made, x = self.mechanism, self.coordinate
        units = dict.fromkeys(made.variable_names, "rad")
        units |= {f"d({name})/d{x}": "" for name in made.variable_names}
        if made.masses or made.loads:
            units |= {"B": "kg m2", f"d(B)/d{x}": "kg m2/rad"}
        for k, name in self.velocities.items():
            units[name] = made.loads[self.loads.owners[k]].velocity_unit
        every = [units]
        for pole in self.poles:
            name = pole_name(made, pole)
            of_pole = {f"pole {name} {axis}": "" for axis in "xyz"}
            every.append(of_pole | {f"rate {name}": "", f"d(rate {name})/d{x}": "1/rad"})
        return tuple(every)

    def columns(self, x: Floats) -> Floats:
        """Return all functions (n, columns)."""
        motion = self._motion(x)
        parts = [self._of_motion(motion)]
        directions = self._directions(x, motion)
        parts += [_of_pole(motion, pole, directions[pole]) for pole in self.poles]
        return np.concatenate(parts, axis=1)

    def group(self, number: int, x: Floats) -> Floats:
        """Return the functions (n, m) of one group."""
        motion = self._motion(x)
        if number == 0:
            return self._of_motion(motion)
        pole = self.poles[number - 1]
        return _of_pole(motion, pole, self._directions(x, motion)[pole])

    def _of_motion(self, motion: CoordinateMotion) -> Floats:
        made = self.mechanism
        parts = [motion.values, motion.rates[:, 0]]
        if made.masses or made.loads:
            masses = inertia(made, motion)
            parts += [masses.B[:, None], masses.dB[:, None]]
        if self.velocities:
            parts.append(self.loads.velocities(motion)[:, 0, list(self.velocities)])
        return np.concatenate(parts, axis=1)

    def _motion(self, x: Floats) -> CoordinateMotion:
        points = self.curve.at(self._places(x) if self.by_input else x)
        values = points.values - self.offset
        if self.by_input:
            values[:, self.driven] = x
        closure = self.curve.segments.closure
        if self.by_input:
            return by_variables(closure, values, [self.driven])
        motion = by_arc_length(closure, values)
        side = np.sum(motion.rates[:, 0] * points.tangents, axis=1)
        return motion.turned(np.sign(side))

    def _places(self, q: Floats) -> Floats:
        """Return the arc lengths (n,) at which the input has the values q (n,)."""
        curve = self.curve
        nodes = curve.nodes.values[:, self.driven] - self.offset[self.driven]
        laps = np.floor((self.sense * (q - nodes[0])) / self.lap)
        rest = self.sense * (q - nodes[0]) - laps * self.lap
        s = np.interp(rest, self.sense * (nodes - nodes[0]), curve.s)
        for _ in range(8):
            points = curve.at(s)
            miss = points.values[:, self.driven] - self.offset[self.driven] - nodes[0]
            step = (self.sense * rest - miss) / points.tangents[:, self.driven]
            s = s + step
            if np.max(np.abs(step), initial=0.0) < 1e-14 * curve.length:
                break
        return np.asarray(s + laps * curve.length)

    def _directions(self, x: Floats, motion: CoordinateMotion) -> dict[Pole, Floats]:
        """Return the unit vectors (n, 3) of the poles, in the sense that was noted."""
        units = self._lines(motion)
        away = (x - self.low) % (self.high - self.low) if self.periodic else x - self.low
        nearest = np.rint(away / (self.high - self.low) * self.mark_count).astype(int)
        if self.periodic:
            nearest %= self.mark_count
        for pole, unit in units.items():
            if pole in self.marks:
                side = np.sum(unit * self.marks[pole][nearest], axis=1)
                unit[side < 0.0] *= -1.0
        return units

    def _lines(self, motion: CoordinateMotion) -> dict[Pole, Floats]:
        """Return unit vectors along the pole axes, in either sense."""
        lines = evaluate_lines(self.plan, self._as_motion(motion))
        units: dict[Pole, Floats] = {}
        w = motion.w[:, 0]
        size = np.max(np.linalg.norm(w, axis=2), axis=1)
        for pole in self.poles:
            unit = lines.unit[pole].T.copy()
            error = np.nan_to_num(lines.error[pole], nan=np.inf)
            apart = w[:, pole[1]] - w[:, pole[0]]
            length = np.linalg.norm(apart, axis=1)
            with np.errstate(divide="ignore", invalid="ignore"):
                better = (error > SURE) & (8.0 * EPS * size / length < error)
                unit[better] = apart[better] / length[better, None]
            if not np.all(np.isfinite(unit)):
                name = pole_name(self.mechanism, pole)
                raise SolveError(
                    f"{self.mechanism.name}: pole {name} has no direction at places of "
                    "the curve: the two links do not move relative to each other there; "
                    "leave it out"
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
        primary = {
            step.pole
            for step in self.plan.steps
            if isinstance(step, PrimaryPole | CoaxialPole)
        }
        self.marks: Mapping[Pole, Floats] = {}
        self.mark_count = count = MARKS
        while True:
            x = self.low + self.lap * np.arange(count + 1) / count
            motion = self._motion(x)
            home = np.sum(self._as_motion(motion).frames[0, :, :, 2], axis=0)
            senses = {p: u for p, u in self._lines(motion).items() if p not in primary}
            steps = {p: np.sum(u[1:] * u[:-1], axis=1) for p, u in senses.items()}
            least = min((np.min(np.abs(s)) for s in steps.values()), default=1.0)
            if least > 0.7:
                break
            if count >= MOST_MARKS:
                raise SolveError(
                    f"{self.mechanism.name}: a pole axis turns too fast to be followed; "
                    "ask for fewer poles"
                )
            count *= 2
        marks = {}
        for pole, unit in senses.items():
            first = -1.0 if unit[0] @ home < 0.0 else 1.0
            chain = first * np.cumprod(np.append(1.0, np.sign(steps[pole])))
            marks[pole] = unit * chain[:, None]
        if self.periodic:
            back = {p: float(u[0] @ u[-1]) for p, u in marks.items()}
            if any(side < 0.0 for side in back.values()):
                self.laps = 2
                marks = {
                    p: np.concatenate([u[:-1], u * np.sign(back[p])])
                    for p, u in marks.items()
                }
        self.mark_count = count * self.laps
        self.marks = marks


def _of_pole(motion: CoordinateMotion, pole: Pole, unit: Floats) -> Floats:
    """Return direction, coefficient and the coefficient's derivative (n, 5)."""
    first, second = pole
    w = motion.w[:, 0, second] - motion.w[:, 0, first]
    dw = motion.dw[:, 0, 0, second] - motion.dw[:, 0, 0, first]
    rate, change = np.sum(w * unit, axis=1), np.sum(dw * unit, axis=1)
    return np.column_stack([unit, rate, change])


def _sizes(sampled: Floats, sampler: _Sampler) -> Floats:
    """Return the largest value (columns,) of each function, of vectors that of all parts.

    A function counts as no smaller than `LEAST` of the largest of its kind, since those
    that vanish, but for rounding, have no size of their own.
    """
    names = [name for group in sampler.groups for name in group]
    size = np.max(np.abs(sampled), axis=0)
    vectors: dict[str, list[int]] = {}
    kinds: dict[str, list[int]] = {}
    for k, name in enumerate(names):
        stem = name[:-2] if name[-2:] in (" x", " y", " z") else name
        vectors.setdefault(stem, []).append(k)
        kind, *more = stem.split()
        kinds.setdefault(kind if more else stem.partition("_")[0], []).append(k)
    for columns in vectors.values():
        size[columns] = np.max(size[columns])
    for columns in kinds.values():
        size[columns] = np.maximum(size[columns], LEAST * np.max(size[columns]))
    for k, name in enumerate(names):
        if name.startswith("d("):
            function = names.index(name[2 : name.index(")")])
            size[k] = max(size[k], LEAST * size[function])
    size[size == 0.0] = 1.0
    return np.asarray(size)


def pole_name(mechanism: Mechanism, pole: Pole) -> str:
    """Return the name of a pole, LINK/RELATIVE_TO."""
    first, second = pole
    return f"{mechanism.links[second]}/{mechanism.links[first]}"
