"""Inertia tensors of links that differ by up to 24 orders of magnitude."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import final

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

INERTIA_FAMILY = "inertia"
RATIO = "inertia of one link over the others"
RATIOS = tuple(10.0**k for k in range(-12, 13, 2))
INPUT_ANGLE = 0.7
INPUT_RATE = 1.5
"""Angle (rad) and rate (rad/s) of the input at time 0."""

LAW = Polynomial((INPUT_ANGLE, INPUT_RATE, 0.8))
"""Time law of the input (rad). Its acceleration is 1.6 rad/s2."""


@final
@dataclass(frozen=True)
class InertiaTruth:
    """Equivalent inertia, its derivative and the torque of the input.

    Attributes
    ----------
    values
        The three numbers in 90 digits, in SI units.
    conditioning
        Their conditioning, relative to their own size.
    """

    values: list[Exact]
    conditioning: list[float]


def scale_inertia(mechanism: Mechanism, link: str, ratio: float) -> Mechanism:
    """Return a mechanism without loads, in which one inertia tensor is scaled.

    Parameters
    ----------
    mechanism
        A mechanism with masses.
    link
        Name of the link.
    ratio
        Factor of its tensor.
    """
    masses = tuple(
        replace(mass, tensor=_scale_tensor(mass.tensor, ratio))
        if mass.link == link
        else mass
        for mass in mechanism.masses
    )
    return replace(mechanism, masses=masses, loads=())


def _scale_tensor(tensor: Tensor, ratio: float) -> Tensor:
    """Return a tensor times a factor."""
    (a, b, c), (d, e, f), (g, h, i) = (ratio * np.array(tensor)).tolist()
    return (a, b, c), (d, e, f), (g, h, i)


def judge_inertia(mechanism: Mechanism, ratio: float) -> Iterator[Row]:
    """Yield the errors of inertia, its derivative and the torque; `ratio` is the parameter.

    The mechanism moves by `LAW`, at time 0.
    """
    dynamics = inverse_dynamics(mechanism, LAW, [0.0])
    reference = Reference(mechanism)
    with mp.workdps(DIGITS):
        start = exact(dynamics.values[0])
        kinematics = truth(reference, reference.closed(start, reference.inputs))
        inertia_truth = _true_inertia(mechanism, kinematics)
        status = Status(dynamics.status[0]).name
        computed = {
            "B": dynamics.B[0],
            "dB/dq": dynamics.dB_dq[0],
            "torque": dynamics.tau[0],
        }
        for (name, value), true_value, conditioning in zip(
            computed.items(), inertia_truth.values, inertia_truth.conditioning, strict=True
        ):
            error = float(abs((mp.mpf(float(value)) - true_value) / true_value))
            yield Row(ratio, name, conditioning, error, status)


def _true_inertia(mechanism: Mechanism, kinematics: Truth) -> InertiaTruth:
    """Return inertia, derivative and torque in 90 digits, with their conditioning.

    The conditioning is that of the kinematic data and of the inertia tensors together.
    """
    rng = np.random.default_rng(7)
    assert kinematics.derivatives is not None
    values = _inertia_and_torque(
        mechanism, kinematics.rotations, kinematics.rates, kinematics.derivatives, None
    )
    conditioning = [1.0, 1.0, 1.0]
    for changed in kinematics.changed:
        changed_values = _inertia_and_torque(
            mechanism, changed["rotations"], changed["rates"], changed["derivatives"], rng
        )
        for k, (value, changed_value) in enumerate(
            zip(values, changed_values, strict=True)
        ):
            change = float(abs((changed_value - value) / value) / SMALL)
            conditioning[k] = max(conditioning[k], change)
    return InertiaTruth(values, conditioning)


def _inertia_and_torque(
    mechanism: Mechanism,
    rotations: Exact,
    link_rates: Exact,
    link_rate_derivatives: Exact,
    rng: np.random.Generator | None,
) -> list[Exact]:
    """Return B, dB/dq and the torque of the input.

    Parameters
    ----------
    mechanism
        The mechanism.
    rotations
        (links, 3, 3) rotations from link axes to ground axes.
    link_rates, link_rate_derivatives
        (links, 3) angular velocities by the input, and their derivatives, in ground axes.
    rng
        Changes the tensors at random by `SMALL`; None leaves them as they are.
    """
    inertia = mp.mpf(0)
    inertia_derivative = mp.mpf(0)
    for mass in mechanism.masses:
        link = mechanism.link_number[mass.link]
        tensor = exact(np.array(mass.tensor))
        if rng is not None:
            factors = rng.uniform(-1, 1, (3, 3))
            # The change keeps the tensor symmetric.
            tensor = tensor * (1 + SMALL * exact(factors + factors.T) / 2)
        ground_tensor = rotations[link] @ tensor @ rotations[link].T
        w = link_rates[link]
        inertia += w @ ground_tensor @ w
        inertia_derivative += 2 * (link_rate_derivatives[link] @ ground_tensor @ w)
    rate = mp.mpf(INPUT_RATE)
    acceleration = mp.mpf(2) * mp.mpf(LAW.coefficients[2])
    torque = inertia * acceleration + inertia_derivative * rate * rate / 2
    return [inertia, inertia_derivative, torque]


@case(INERTIA_FAMILY, RATIO, RATIOS)
def inertia_of_the_coupler(ratios: Sequence[float]) -> Iterator[Row]:
    """The paper's four-bar, the tensor of its coupler scaled."""
    for ratio in ratios:
        yield from judge_inertia(scale_inertia(load("four_bar"), "3", ratio), ratio)


@case(INERTIA_FAMILY, RATIO, RATIOS)
def inertia_of_the_rocker(ratios: Sequence[float]) -> Iterator[Row]:
    """The paper's four-bar, the tensor of its rocker scaled."""
    for ratio in ratios:
        yield from judge_inertia(scale_inertia(load("four_bar"), "4", ratio), ratio)


@case(INERTIA_FAMILY, RATIO, RATIOS)
def energy_of_a_motion(ratios: Sequence[float]) -> Iterator[Row]:
    """The same with a weight on the rocker for 2 s: kinetic and potential energy.

    The conditioning is the number of steps of the integrator: each rounds once.
    """
    weight_moment = 5.0
    weight = (PairTorque("weight", "41", f"-{weight_moment:g}*sin(theta_41)"),)
    for ratio in ratios:
        mechanism = replace(scale_inertia(load("four_bar"), "4", ratio), loads=weight)
        start = Start(INPUT_ANGLE, INPUT_RATE)
        simulation = simulate(mechanism, start, 2.0, tolerance=1e-13, engine="numpy")
        history = simulation.at(np.linspace(0.0, simulation.end.t, 41))
        rocker_angle = history.values[:, mechanism.variable_names.index("theta_41")]
        energy = history.kinetic - weight_moment * np.cos(rocker_angle)
        drift = np.max(np.abs(energy - energy[0])) / np.max(history.kinetic)
        status = "OK" if simulation.end.kind == "time" else simulation.end.kind
        steps = float(simulation.engine.steps)
        yield Row(ratio, "energy", steps, float(drift), status)
