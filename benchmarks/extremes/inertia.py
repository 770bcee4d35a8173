"""Inertia of links that differs by up to 24 orders of magnitude."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import mpmath as mp
import numpy as np

from benchmarks.extremes.reference import (
    DIGITS,
    SMALL,
    Exact,
    Reference,
    Truth,
    exact,
    truth,
)
from benchmarks.extremes.registry import Row, case
from spherekit.dynamics.forward_dynamics import simulate
from spherekit.dynamics.inverse_dynamics import inverse_dynamics
from spherekit.files.mechanism_reader import load
from spherekit.files.study import Start
from spherekit.files.time_law import Polynomial
from spherekit.mechanism.inertia import Tensor
from spherekit.mechanism.load_kinds import PairTorque
from spherekit.mechanism.mechanism import Mechanism
from spherekit.status import Status

FAMILY = "inertia"
RATIO = "inertia of one link over the others"
RATIOS = tuple(10.0**k for k in range(-12, 13, 2))
LAW = Polynomial((0.7, 1.5, 0.8))
"""Variable, rate and acceleration of the input at t = 0: 0.7, 1.5 and 1.6."""
Q, DQ, DDQ = 0.7, 1.5, 1.6


def scaled(made: Mechanism, link: str, ratio: float) -> Mechanism:
    """Return a mechanism without loads, the inertia of one link times a ratio."""
    masses = tuple(
        replace(mass, tensor=_times(mass.tensor, ratio)) if mass.link == link else mass
        for mass in made.masses
    )
    return replace(made, masses=masses, loads=())


def _times(tensor: Tensor, ratio: float) -> Tensor:
    (a, b, c), (d, e, f), (g, h, i) = (ratio * np.array(tensor)).tolist()
    return (a, b, c), (d, e, f), (g, h, i)


def torques(made: Mechanism, ratio: float) -> Iterator[Row]:
    """Yield inertia, its derivative and the torque of a mechanism against 90 digits."""
    found = inverse_dynamics(made, LAW, [0.0])
    reference = Reference(made)
    with mp.workdps(DIGITS):
        start = exact(found.values[0])
        known = truth(reference, reference.closed(start, reference.inputs))
        right, conditions = _inertias(made, known)
        status = Status(found.status[0]).name
        given = (found.B[0], found.dB_dq[0], found.tau[0])
        names = ("B", "dB/dq", "torque")
        for name, value, is_, condition in zip(
            names, given, right, conditions, strict=True
        ):
            error = float(abs((mp.mpf(float(value)) - is_) / is_))
            yield Row(ratio, name, condition, error, status)


def _inertias(made: Mechanism, known: Truth) -> tuple[list[Exact], list[float]]:
    """Return B, dB/dq and the torque, and their conditioning relative to themselves."""
    random = np.random.default_rng(7)
    assert known.derivatives is not None
    right = _of(made, known.rotations, known.rates, known.derivatives, None)
    condition = [1.0, 1.0, 1.0]
    for changed in known.changed:
        there = (changed["rotations"], changed["rates"], changed["derivatives"])
        other = _of(made, *there, random)
        for k, (one, moved) in enumerate(zip(right, other, strict=True)):
            condition[k] = max(condition[k], float(abs((moved - one) / one) / SMALL))
    return right, condition


def _of(
    made: Mechanism,
    rotations: Exact,
    w: Exact,
    dw: Exact,
    random: np.random.Generator | None,
) -> list[Exact]:
    """Return B, dB/dq and the torque, of tensors changed at random if `random` is given."""
    inertia = slope = mp.mpf(0)
    for mass in made.masses:
        link = made.link_number[mass.link]
        tensor = exact(np.array(mass.tensor))
        if random is not None:
            parts = random.uniform(-1, 1, (3, 3))
            tensor = tensor * (1 + SMALL * exact(parts + parts.T) / 2)
        whole = rotations[link] @ tensor @ rotations[link].T
        inertia += w[link] @ whole @ w[link]
        slope += 2 * (dw[link] @ whole @ w[link])
    rate, second = mp.mpf(DQ), mp.mpf(2) * mp.mpf(LAW.coefficients[2])
    return [inertia, slope, inertia * second + slope * rate * rate / 2]


@case(FAMILY, RATIO, RATIOS)
def inertia_of_the_coupler(ratios: Sequence[float]) -> Iterator[Row]:
    """The paper's four-bar, the tensor of its coupler scaled."""
    for ratio in ratios:
        yield from torques(scaled(load("four_bar"), "3", ratio), ratio)


@case(FAMILY, RATIO, RATIOS)
def inertia_of_the_rocker(ratios: Sequence[float]) -> Iterator[Row]:
    """The paper's four-bar, the tensor of its rocker scaled."""
    for ratio in ratios:
        yield from torques(scaled(load("four_bar"), "4", ratio), ratio)


@case(FAMILY, RATIO, RATIOS)
def energy_of_a_motion(ratios: Sequence[float]) -> Iterator[Row]:
    """The same with a weight on the rocker for 2 s: kinetic and potential energy.

    The conditioning is the number of steps of the integrator: each rounds once.
    """
    weight = (PairTorque("weight", "41", "-5*sin(theta_41)"),)
    for ratio in ratios:
        made = replace(scaled(load("four_bar"), "4", ratio), loads=weight)
        found = simulate(made, Start(Q, DQ), 2.0, tolerance=1e-13, engine="numpy")
        history = found.at(np.linspace(0.0, found.end.t, 41))
        angle = history.values[:, made.variable_names.index("theta_41")]
        energy = history.kinetic - 5.0 * np.cos(angle)
        drift = np.max(np.abs(energy - energy[0])) / np.max(history.kinetic)
        status = "OK" if found.end.kind == "time" else found.end.kind
        yield Row(ratio, "energy", float(found.engine.steps), float(drift), status)
