"""The inertia of a mechanism in its coordinates, link by link, and the equation it is in.

With the inertia matrix M(q), its Christoffel symbols and the generalised forces Q of all
loads, M q'' + C q' = Q + tau, where C_ij = sum of c_ijk q'_k and
c_ijk = 1/2 (dM_ij/dq_k + dM_ik/dq_j - dM_jk/dq_i): so M' - 2 C is skew. Of one coordinate
it is Eksergian's, B q'' + 1/2 dB/dq q'^2 = Q + tau (Di Gregorio 2024, eq. (9)).

Every function that a stored model keeps, exactly, at any places of its coordinates.

Of one input the configuration curve is followed once, and its coordinate is the variable q
of the input where that turns fully on a closed curve, else the curve's arc length s. Of
several inputs the assembly mode is followed over a coarse grid of the box of their ranges;
configurations between are found by Newton's method from the nearest of it, predicted to
the second order.

The equation of motion in any number of coordinates, solved for the driving torques.

With the inertia matrix M(q), its Christoffel symbols and the generalised forces Q of all
loads, M q'' + C q' = Q + tau, where C_ij = sum of c_ijk q'_k and
c_ijk = 1/2 (dM_ij/dq_k + dM_ik/dq_j - dM_jk/dq_i): so M' - 2 C is skew. Of one coordinate
it is Eksergian's, B q'' + 1/2 dB/dq q'^2 = Q + tau (Di Gregorio 2024, eq. (9)).
"""

from abc import ABC
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import CLOSURE_TOLERANCE, EPS, Status, listing
from spherekit.dynamics.forces import Loads
from spherekit.dynamics.kinematics import (
    CoordinateMotion,
    by_arc_length,
    by_variables,
    determined,
)
from spherekit.dynamics.stored_model import (
    StoredHeading,
)
from spherekit.errors import ModelError, SolveError
from spherekit.model.mechanism import Mechanism
from spherekit.motion.arc_curve import ArcCurve
from spherekit.motion.arc_length import follow_arc
from spherekit.motion.loops import left_inverse
from spherekit.motion.motion import Motion, Tracer, going_on, motion_of
from spherekit.planning.plan import plan
from spherekit.planning.poles import CoaxialPole, Pole, PrimaryPole
from spherekit.rates.field import PlannedPoles
from spherekit.sphere.rotation import Floats, cross

ROUNDED = 1e-14
"""Moments of inertia that are a smaller part of the largest are rounding."""
ROUGHLY = 1e-6
"""Rates of pairs below this are left out where those that move are named."""
STILL = 1e-9
"""Links that turn slower than this part of the fastest stand still but for rounding."""


@final
@dataclass(frozen=True)
class Inertia:
    """Each link's part of the inertia matrix M and of its derivatives.

    `M_parts` (n, masses, m, m) kg m2 per product of units of the m coordinates;
    `dM_parts` (n, masses, m, m, m) at [i, j, k] the derivative of M_ij by coordinate k; in
    the order of the mechanism's masses. The matrix of one coordinate is the equivalent
    inertia B.
    """

    M_parts: Floats
    dM_parts: Floats

    @property
    def M(self) -> Floats:
        """(n, m, m) inertia matrix."""
        return np.asarray(np.sum(self.M_parts, axis=1))

    @property
    def dM(self) -> Floats:
        """(n, m, m, m) its derivatives, by the last axis."""
        return np.asarray(np.sum(self.dM_parts, axis=1))

    @property
    def B_parts(self) -> Floats:
        """(n, masses) parts of the equivalent inertia, of a single coordinate."""
        return self.M_parts[:, :, 0, 0]

    @property
    def dB_parts(self) -> Floats:
        """(n, masses) their derivatives by that coordinate."""
        return self.dM_parts[:, :, 0, 0, 0]

    @property
    def B(self) -> Floats:
        """(n,) equivalent inertia."""
        return np.asarray(np.sum(self.B_parts, axis=1))

    @property
    def dB(self) -> Floats:
        """(n,) derivative of the equivalent inertia by the coordinate."""
        return np.asarray(np.sum(self.dB_parts, axis=1))


def inertia(mechanism: Mechanism, motion: CoordinateMotion) -> Inertia:
    """Return the inertia matrix and its derivatives at every row of a motion.

    Notes
    -----
    With I the tensor of a link about the centre, turned to ground axes, and w_i its angular
    velocity per unit rate of coordinate i, M_ij is the sum of w_i . I w_j (Di Gregorio
    2024, eqs. (14), (15), of one coordinate). I turns with the link: I_k is
    [w_k] I - I [w_k], with [w] the matrix of the cross product, so that

        w_i . I_k w_j = (w_i x w_k) . I w_j + (I w_i) . (w_j x w_k),

    which is zero for i = j = k, and dB = 2 sum w . I dw of one coordinate is eq. (19) there
    without its derivatives of rotations.
    """
    tensors, w = _in_links(mechanism, motion, motion.w)
    _, dw = _in_links(mechanism, motion, motion.dw)
    momentum = _momentum(tensors, w)
    half = np.einsum("nika,njlka->nkijl", momentum, dw)
    across = cross(w[:, :, None], w[:, None])
    half += np.einsum("nika,njlka->nkijl", momentum, across)
    return Inertia(_products(momentum, w), half + np.swapaxes(half, 2, 3))


def inertia_matrix(mechanism: Mechanism, motion: CoordinateMotion) -> Floats:
    """Return M (n, m, m) alone, which needs the motion to the first order only."""
    tensors, w = _in_links(mechanism, motion, motion.w)
    return np.asarray(np.sum(_products(_momentum(tensors, w), w), axis=1))


def equivalent_inertia(mechanism: Mechanism, motion: CoordinateMotion) -> Floats:
    """Return B (n,) of a single coordinate alone."""
    return inertia_matrix(mechanism, motion)[:, 0, 0]


def _in_links(
    mechanism: Mechanism, motion: CoordinateMotion, vectors: Floats
) -> tuple[Floats, Floats]:
    """Return the tensors (masses, 3, 3), and vectors (n, ..., masses, 3) in link axes."""
    links = [mechanism.link_number[mass.link] for mass in mechanism.masses]
    tensors = np.array([mass.tensor for mass in mechanism.masses]).reshape(-1, 3, 3)
    turns = motion.rotations[:, links]
    return tensors, np.einsum("nkji,n...kj->n...ki", turns, vectors[..., links, :])


def _momentum(tensors: Floats, w: Floats) -> Floats:
    return np.asarray(np.einsum("kij,n...kj->n...ki", tensors, w))


def _products(momentum: Floats, w: Floats) -> Floats:
    return np.asarray(np.einsum("nika,njka->nkij", momentum, w))


def need_inertia(mechanism: Mechanism) -> None:
    """Raise `ModelError` unless some moving link has inertia."""
    moving = [m for m in mechanism.masses if m.link != mechanism.ground]
    if not any(np.any(np.array(mass.tensor) != 0.0) for mass in moving):
        raise ModelError(
            f"{mechanism.name}: mass: no moving link has inertia, so loads would "
            "accelerate it endlessly; give at least one [mass.LINK]"
        )


def need_moving_inertia(mechanism: Mechanism, motion: CoordinateMotion) -> None:
    """Raise `SolveError` where links with mass stand still while others move."""
    inertias, ways = np.linalg.eigh(inertia_matrix(mechanism, motion)[0])
    least = float(inertias[0])
    if len(inertias) > 1 and least < ROUNDED * inertias[-1]:
        rates = np.abs(ways[:, 0] @ motion.rates[0])
        pairs = [name for name, v in mechanism.angles.items() if rates[v] > ROUGHLY]
        raise SolveError(
            f"{mechanism.name}: at the start pairs {listing(pairs)} can turn together so "
            "that no link with mass moves, so loads would accelerate them endlessly; give "
            "mass to links that move then, or lock a pair"
        )
    moving = [mass for mass in mechanism.masses if mass.link != mechanism.ground]
    sizes = [np.linalg.norm(mass.tensor, 2) for mass in moving]
    fastest = np.max(np.sum(motion.w[0] ** 2, axis=-1))
    if not (STILL**2 * float(np.sum(sizes)) * fastest < least):
        raise SolveError(
            f"{mechanism.name}: at the start no link with mass moves (less than {STILL:g} "
            "of the fastest), so loads would accelerate the others endlessly; give mass to "
            "links that move, or start elsewhere"
        )


def christoffel(dM: Floats) -> Floats:
    """Return c (n, m, m, m) from the derivatives of M (n, m, m, m)."""
    skew = np.swapaxes(dM, 2, 3) - np.moveaxis(dM, 3, 1)
    return np.asarray(0.5 * (dM + skew))


def coriolis(dM: Floats, rates: Floats) -> Floats:
    """Return C (n, m, m) from the derivatives of M (n, m, m, m) at rates (n, m)."""
    return np.asarray((christoffel(dM) @ rates[:, None, :, None])[..., 0])


def driving_torques(M: Floats, dM: Floats, Q: Floats, dq: Floats, ddq: Floats) -> Floats:
    """Return tau (n, m) = M q'' + C q' - Q, N m.

    The torques at the pairs of the coordinates, `M` (n, m, m), `dM` (n, m, m, m); `Q`
    (n, m) is of all other loads.
    """
    needed = (M @ ddq[..., None] + coriolis(dM, dq) @ dq[..., None])[..., 0]
    return np.asarray(needed - Q)


PROBED_INPUTS = 24
"""Places in the input's range where a configuration of the assembly mode is looked for."""

FLAT = 1e-3
"""An input whose rate along the curve falls below this is not a crank to count by."""

MARKS = 1024
"""Places along the curve where the sense of each pole axis is noted, at first."""
MOST_MARKS = 2**14


SURE_AXES = 1e-14
"""Pole axes whose error bound is below this are taken from the plan unquestioned."""


NEWTON_STEPS = 8

TRUST = 0.2
"""Largest change (rad) of a variable in a step."""

APART = 0.02
"""A configuration farther (rad) than this from where the trapezoidal rule leads from the
nearest known one is not of the same mode."""

SURE = 0.02
"""Inputs that determine the motion less surely than this are too near a singularity."""


def own_velocities(loads: Loads) -> dict[int, str]:
    """Return the names of velocities of components that no pair's rate is, by number."""
    owners, names = loads.owners, {}
    for k, part in enumerate(loads.components):
        if not part.pair:
            name = f"load {loads.names[owners[k]]}"
            axis = f" {'xyz'[k - owners.index(owners[k])]}"
            names[k] = name + axis * (owners.count(owners[k]) > 1)
    return names


class Sampler(ABC):
    """Every function to be stored, exactly, at any places of the coordinates."""

    bend: float
    """What Christoffel symbols are stored as, times themselves, in this unit."""
    unit: str

    def __init__(self, tracer: Tracer, poles: tuple[Pole, ...]) -> None:
        self.tracer, self.mechanism, self.poles = tracer, tracer.mechanism, poles
        self.closure = tracer.solver.closure
        self.loads = Loads(self.mechanism)
        self.velocities = own_velocities(self.loads)
        self.heavy = bool(self.mechanism.masses or self.mechanism.loads)

    def names(self, heading: StoredHeading) -> dict[str, str]:
        """Return the names of what the motion needs, with their units."""
        made = self.mechanism
        units = dict.fromkeys(made.variable_names, "rad")
        for name in made.variable_names:
            units |= dict.fromkeys(heading.by_coordinates(name), "")
        if self.heavy:
            units |= dict.fromkeys(heading.inertia, "kg m2")
            for symbols in heading.christoffel:
                units |= dict.fromkeys(symbols, self.unit)
        for k, name in self.velocities.items():
            unit = made.loads[self.loads.owners[k]].velocity_unit
            units |= dict.fromkeys(heading.by_coordinates(name), unit)
        return units

    def of_motion(self, motion: CoordinateMotion) -> Floats:
        """Return the values (n, F) of these, at rows of a motion by the coordinates."""
        n, m = motion.rates.shape[:2]
        parts = [motion.values, np.swapaxes(motion.rates, 1, 2).reshape(n, -1)]
        if self.heavy:
            masses, (rows, columns) = inertia(self.mechanism, motion), np.tril_indices(m)
            symbols = self.bend * christoffel(masses.dM)[:, :, rows, columns]
            parts += [masses.M[:, rows, columns], symbols.reshape(n, -1)]
        if self.velocities:
            works = self.loads.velocities(motion)[..., list(self.velocities)]
            parts.append(np.swapaxes(works, 1, 2).reshape(n, -1))
        return np.concatenate(parts, axis=1)


@final
class AlongCurve(Sampler):
    """These along the whole curve of one input, and all that is asked of its poles."""

    bend, unit = 2.0, "kg m2/rad"

    def __init__(self, tracer: Tracer, poles: tuple[Pole, ...]) -> None:
        super().__init__(tracer, poles)
        self.curve, values = _followed(tracer)
        self.driven = tracer.solver.single
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
        self.lap = abs(turns) * 2.0 * np.pi if self.by_input else self.curve.length
        self.low, self.laps = 0.0, 1
        self._note_senses()
        self.high = self.laps * self.lap
        self.rise = self.curve.rise * self.sense * self.laps

    def rate(self, variable: str) -> str:
        """Return the name of what loads at a pair work on, by that of its variable."""
        return f"d({variable})/d{self.coordinate}"

    def spread(self, count: int) -> Floats:
        """Return places (count,) over all of the coordinate, in rising order."""
        return np.linspace(self.low, self.high, count, endpoint=not self.periodic)

    def columns(self, groups: Iterable[int], x: Floats) -> Floats:
        """Return the functions (n, F) of some groups: that of the motion, or of poles."""
        motion, parts = self._motion(x), []
        directions: Mapping[Pole, Floats] = {}
        for number in groups:
            if number and not directions:
                directions = self._directions(x, motion)
            if number:
                pole = self.poles[number - 1]
                parts.append(_of_pole(motion, pole, directions[pole]))
            else:
                parts.append(self.of_motion(motion))
        return np.concatenate(parts, axis=1)

    def _motion(self, x: Floats) -> CoordinateMotion:
        points = self.curve.at(self._places(x) if self.by_input else x)
        values = points.values - self.offset
        if self.by_input:
            values[:, self.driven] = x
            return by_variables(self.closure, values, [self.driven])
        motion = by_arc_length(self.closure, values)
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
        length = self.laps * self.lap
        away = (x - self.low) % length if self.periodic else x - self.low
        nearest = np.rint(away / length * self.mark_count).astype(int)
        if self.periodic:
            nearest %= self.mark_count
        for pole, unit in units.items():
            if pole in self.marks:
                side = np.sum(unit * self.marks[pole][nearest], axis=1)
                unit[side < 0.0] *= -1.0
        return units

    def _lines(self, motion: CoordinateMotion) -> dict[Pole, Floats]:
        """Return unit vectors along the pole axes, in either sense."""
        planned = PlannedPoles(self.plan, self._as_motion(motion))
        units: dict[Pole, Floats] = {}
        w = motion.w[:, 0]
        size = np.max(np.linalg.norm(w, axis=2), axis=1)
        for pole in self.poles:
            unit = planned.unit[pole][0].T.copy()
            error = np.nan_to_num(planned.error[pole], nan=np.inf)
            apart = w[:, pole[1]] - w[:, pole[0]]
            length = np.linalg.norm(apart, axis=1)
            with np.errstate(divide="ignore", invalid="ignore"):
                better = (error > SURE_AXES) & (8.0 * EPS * size / length < error)
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


@final
class OverBox(Sampler):
    """These over the ranges of several inputs."""

    bend, unit = 1.0, "kg m2"

    def __init__(self, tracer: Tracer, poles: tuple[Pole, ...]) -> None:
        super().__init__(tracer, poles)
        self.driven = [self.mechanism.angles[pair] for pair in tracer.inputs]
        self.low, self.high = np.array([item.range for item in self.mechanism.inputs]).T
        motion = going_on(tracer.motion(), tracer.solver)
        values = motion.values[motion.status == Status.OK]
        nodes = by_variables(self.closure, values, self.driven)
        sure = np.all(np.isfinite(nodes.second), axis=(1, 2, 3))
        sure &= determined(nodes.rates) >= SURE
        if not np.any(sure):
            raise SolveError(
                f"{self.mechanism.name}: the assembly mode has no regular configuration on "
                "a grid over the ranges of the inputs; give another assembly mode or range"
            )
        self.known = by_variables(self.closure, values[sure], self.driven)

    def rate(self, variable: str) -> str:
        """Return the name of what loads at a pair work on: of each input its rate."""
        return variable

    def at(self, q: Floats, count: int) -> Floats:
        """Return all functions (n, count) at inputs (n, m), NaN where the mode is not."""
        values, good = self._closed(q)
        functions = np.full((len(q), count), np.nan)
        if np.any(good):
            motion = by_variables(self.closure, values[good], self.driven)
            functions[good] = self.columns(motion)
        return functions

    def columns(self, motion: CoordinateMotion) -> Floats:
        """Return all functions (n, F) of a motion by the inputs."""
        parts = [self.of_motion(motion)]
        for first, second in self.poles:
            w = motion.w[:, :, second] - motion.w[:, :, first]
            parts.append(np.swapaxes(w, 1, 2).reshape(len(w), -1))
        return np.concatenate(parts, axis=1)

    def _closed(self, q: Floats) -> tuple[Floats, NDArray[np.bool_]]:
        """Return closed configurations (n, variables) of the mode, and which are."""
        from scipy.spatial import cKDTree

        nodes, driven = self.known, self.driven
        near = cKDTree(nodes.values[:, driven]).query(q)[1]
        step = q - nodes.values[near][:, driven]
        ahead = np.einsum("ni,niv->nv", step, nodes.rates[near])
        bend = np.einsum("ni,nk,nikv->nv", step, step, nodes.second[near])
        values = nodes.values[near] + ahead + 0.5 * bend
        values[:, driven] = q
        free = np.setdiff1d(np.arange(values.shape[1]), driven)
        with np.errstate(all="ignore"):
            rows = np.arange(len(q))
            for _ in range(NEWTON_STEPS):
                at = self.closure.at(values[rows])
                inverse = left_inverse(at.jacobian[:, :, free])
                change = -(inverse @ at.residual[..., None])[..., 0]
                size = np.max(np.abs(change), axis=1, initial=0.0)
                change *= np.minimum(1.0, TRUST / np.maximum(size, 1e-300))[:, None]
                values[np.ix_(rows, free)] += change
                rows = rows[size > 1e-14]
                if not len(rows):
                    break
            moving = by_variables(self.closure, values, driven, order=1)
            both = nodes.rates[near] + moving.rates
            led = nodes.values[near] + 0.5 * np.einsum("ni,niv->nv", step, both)
            good = self.closure.at(values).gap < CLOSURE_TOLERANCE
            good &= np.max(np.abs(led - values), axis=1) < APART
            good &= determined(moving.rates) >= SURE
        good &= moving.status == Status.OK
        return values, good


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
            f"at any of {PROBED_INPUTS} inputs of its range; give another assembly mode or "
            "range"
        )
    values = motion.values[good[0]].copy()
    return follow_arc(tracer.solver.closure, values, stops), values


def _of_pole(motion: CoordinateMotion, pole: Pole, unit: Floats) -> Floats:
    """Return direction, coefficient and the coefficient's derivative (n, 5)."""
    first, second = pole
    w = motion.w[:, 0, second] - motion.w[:, 0, first]
    dw = motion.dw[:, 0, 0, second] - motion.dw[:, 0, 0, first]
    rate, change = np.sum(w * unit, axis=1), np.sum(dw * unit, axis=1)
    return np.column_stack([unit, rate, change])


def pole_name(mechanism: Mechanism, pole: Pole) -> str:
    """Return the name of a pole, LINK/RELATIVE_TO."""
    first, second = pole
    return f"{mechanism.links[second]}/{mechanism.links[first]}"
