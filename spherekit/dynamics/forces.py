"""Generalised forces of the loads on a mechanism, load by load.

A load's generalised force is its power per unit rate of the coordinate (Di Gregorio
2024, eq. (12)); reactions at ideal pairs have none. It is a sum of components, each a
magnitude that depends on the pair variables, their rates and the time, times the velocity
it works on, which depends on the configuration only: a torque on the rate of its pair, a
force on the velocity of its point, a moment on the angular velocity of its link.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import Any, final

import numpy as np

from spherekit.dynamics.kinematics import CoordinateMotion
from spherekit.model.dynamics import (
    Damper,
    Friction,
    Gravity,
    Load,
    Moment,
    PairTorque,
    PointForce,
    Spring,
    TorqueTable,
)
from spherekit.model.expression import load_names, parse
from spherekit.model.mechanism import Mechanism
from spherekit.sphere.rotation import Floats, cross

Magnitude = Callable[[Floats, Floats, Floats], Floats]
"""Magnitude (n,) at pair variables and their rates by time (n, variables), time (n,)."""
RowMagnitude = Callable[[Sequence[float]], float]
"""The same at one row of floats, see `Loads.row_magnitudes`."""
Velocity = Callable[[CoordinateMotion], Floats]
"""Velocities (n, components) per unit rate of the coordinate."""


@final
@dataclass(frozen=True)
class _Rule:
    """A load as magnitudes and the velocities, as many, on which they work."""

    magnitudes: tuple[Magnitude, ...]
    row_magnitudes: tuple[RowMagnitude, ...]
    velocities: Velocity


@final
class Loads:
    """The loads of a mechanism, ready to be evaluated at any configurations.

    `names` are those of the loads, `owners` the number of the load of each component.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism
        self.names = tuple(load.name for load in mechanism.loads)
        self._rules = tuple(self._rule(load) for load in mechanism.loads)
        self.owners = [k for k, rule in enumerate(self._rules) for _ in rule.magnitudes]
        self._first = np.array(
            [self.owners.index(k) for k in range(len(self._rules))], dtype=np.intp
        )

    def velocities(self, motion: CoordinateMotion) -> Floats:
        """Return what each component works on (n, components)."""
        found = np.empty((len(motion.values), len(self.owners)))
        at = 0
        for rule in self._rules:
            last = at + len(rule.magnitudes)
            found[:, at:last] = rule.velocities(motion)
            at = last
        return found

    def magnitudes(self, values: Floats, value_rates: Floats, t: Floats) -> Floats:
        """Return the magnitude of each component (n, components), N m or N.

        `values`, `value_rates` (n, variables) are the pair variables and their rates by
        time, `t` (n,) is in s.
        """
        found = np.empty((len(t), len(self.owners)))
        every = (part for rule in self._rules for part in rule.magnitudes)
        for column, magnitude in enumerate(every):
            found[:, column] = magnitude(values, value_rates, t)
        return found

    @property
    def row_magnitudes(self) -> tuple[RowMagnitude, ...]:
        """The magnitude of each component at one sample, for loops.

        Its argument is a row of floats that starts with the variables and their tangents
        (derivatives by the coordinate) and ends with the time and the coordinate's rate.
        """
        return tuple(part for rule in self._rules for part in rule.row_magnitudes)

    def parts(self, motion: CoordinateMotion, speed: Floats, t: Floats) -> Floats:
        """Return each load's generalised force (n, loads).

        Parameters
        ----------
        motion
            n rows with any coordinate.
        speed
            (n,) rate of that coordinate by time.
        t
            (n,) time, s.
        """
        if not self._rules:
            return np.zeros((len(t), 0))
        rates = motion.rates * speed[:, None]
        each = self.magnitudes(motion.values, rates, t) * self.velocities(motion)
        return np.asarray(np.add.reduceat(each, self._first, axis=1))

    def _rule(self, load: Load) -> _Rule:
        if isinstance(load, Gravity):
            return self._gravity(load)
        if isinstance(load, PointForce | Moment):
            return self._on_link(load)
        number, count = self._variable(load.pair), len(self.mechanism.variable_names)

        def velocity(motion: CoordinateMotion) -> Floats:
            return motion.rates[:, [number]]

        if isinstance(load, PairTorque):
            magnitude, of_row = self._expression(load.torque)
            return _Rule((magnitude,), (of_row,), velocity)
        law = _torque(load)
        return _Rule(
            (lambda values, rates, t: law(values[:, number], rates[:, number], t),),
            (lambda row: law(row[number], row[count + number] * row[-1], row[-2]),),
            velocity,
        )

    def _gravity(self, load: Gravity) -> _Rule:
        mechanism = self.mechanism
        links, weights = [], []
        for mass in mechanism.masses:
            if mass.link == mechanism.ground:
                continue
            assert mass.mass is not None and mass.centre is not None
            links.append(mechanism.link_number[mass.link])
            weights.append(mass.mass * np.array(mass.centre))
        moments, g = np.array(weights).reshape(-1, 3), np.array(load.acceleration)

        def power(motion: CoordinateMotion) -> Floats:
            arms = np.einsum("nkij,kj->nki", motion.rotations[:, links], moments)
            fall = cross(motion.w[:, links], arms) @ g
            return np.asarray(np.sum(fall, axis=1, keepdims=True))

        return _Rule((lambda values, rates, t: np.ones(len(t)),), (lambda row: 1.0,), power)

    def _on_link(self, load: PointForce | Moment) -> _Rule:
        link = self.mechanism.link_number[load.link]
        texts = load.force if isinstance(load, PointForce) else load.moment
        point = np.array(load.point) if isinstance(load, PointForce) else None
        components = [self._expression(text) for text in texts]
        return _Rule(
            tuple(magnitude for magnitude, _ in components),
            tuple(of_row for _, of_row in components),
            _velocity(link, point, load.axes == "link"),
        )

    def _expression(self, text: str) -> tuple[Magnitude, RowMagnitude]:
        pairs = [pair.name for pair in self.mechanism.pairs if pair.type == "R"]
        expression = parse(text, load_names(pairs))
        count = len(self.mechanism.variable_names)
        angles = {f"theta_{pair}": self._variable(pair) for pair in pairs}
        rates = {f"dtheta_{pair}": self._variable(pair) for pair in pairs}
        angles, rates = (
            {name: k for name, k in known.items() if name in expression.names}
            for known in (angles, rates)
        )

        def magnitude(values: Floats, value_rates: Floats, t: Floats) -> Floats:
            known = {"t": t}
            known |= {name: values[:, k] for name, k in angles.items()}
            known |= {name: value_rates[:, k] for name, k in rates.items()}
            return expression.evaluate(known)

        read: dict[str, RowMagnitude] = {"t": itemgetter(-2)}
        read |= {name: itemgetter(k) for name, k in angles.items()}
        read |= {name: _rate_at(count + k) for name, k in rates.items()}
        return magnitude, expression.scalar(read)

    def _variable(self, pair: str) -> int:
        mechanism = self.mechanism
        return mechanism.variables_of(mechanism.pair_number[pair])[0]


def _rate_at(column: int) -> RowMagnitude:
    return lambda row: row[column] * row[-1]


def _torque(
    load: Spring | Damper | Friction | TorqueTable,
) -> Callable[[Any, Any, Any], Any]:
    """Return the torque at an angle, its rate and time, arrays or floats alike."""
    if isinstance(load, TorqueTable):
        return lambda angle, rate, t: load.at(t)
    if isinstance(load, Spring):
        return lambda angle, rate, t: -load.stiffness * (angle - load.rest)
    if isinstance(load, Damper):
        return lambda angle, rate, t: -load.damping * rate
    return lambda angle, rate, t: (
        -(load.torque * np.tanh(rate / load.speed) + load.viscous * rate)
    )


def _velocity(link: int, point: Floats | None, in_link: bool) -> Velocity:
    """Return the components of a link's angular velocity, or of a point's velocity."""

    def velocity(motion: CoordinateMotion) -> Floats:
        w, turn = motion.w[:, link], motion.rotations[:, link]
        if in_link:
            w = np.einsum("nji,nj->ni", turn, w)
        if point is None:
            return w
        return cross(w, np.broadcast_to(point, w.shape) if in_link else turn @ point)

    return velocity


def used_pairs(mechanism: Mechanism, loads: Sequence[Load]) -> frozenset[str]:
    """Return the R pairs whose variable or rate some loads depend on."""
    names = [pair.name for pair in mechanism.pairs if pair.type == "R"]
    found: set[str] = set()
    for load in loads:
        texts: Sequence[str] = ()
        if isinstance(load, PairTorque):
            texts = [load.torque]
        elif isinstance(load, PointForce):
            texts = load.force
        elif isinstance(load, Moment):
            texts = load.moment
        if not isinstance(load, Gravity | PointForce | Moment):
            found.add(load.pair)
        for text in texts:
            used = parse(text, load_names(names)).names
            found |= {n for n in names if {f"theta_{n}", f"dtheta_{n}"} & used}
    return frozenset(found)


def used_links(mechanism: Mechanism, loads: Sequence[Load]) -> frozenset[str]:
    """Return the links whose angular velocity or orientation some loads depend on."""
    found: set[str] = set()
    for load in loads:
        if isinstance(load, Gravity):
            found |= {mass.link for mass in mechanism.masses}
        elif isinstance(load, PointForce | Moment):
            found.add(load.link)
    return frozenset(found)
