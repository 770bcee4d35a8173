"""Loads near the largest and the smallest numbers there are."""

import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import mpmath as mp

import spherekit as sk
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
from spherekit.errors import SpherekitError
from spherekit.files.mechanism_reader import load
from spherekit.files.study import Start
from spherekit.files.time_law import Polynomial
from spherekit.mechanism.joint import revolute
from spherekit.mechanism.load_kinds import PairTorque
from spherekit.mechanism.mechanism import Mechanism
from spherekit.status import Status

LOADS_FAMILY = "loads"
POWER = "power of ten of the load, N m"
HUGE = (0.0, 100.0, 200.0, 290.0, 300.0, 305.0, 307.0, 308.0)
TINY = (-100.0, -200.0, -300.0, -307.0, -309.0, -315.0, -320.0, -323.0)
SMALLEST_NORMAL = sys.float_info.min
"""Smallest number with all digits. Errors of smaller torques are taken relative to it."""

INPUT_RAD = 0.7
"""The input (rad) at which torques are computed."""

ENERGY_CONDITIONING = 1e7
"""Conditioning of the energy of a simulation: its tolerance 1e-9 over roundoff."""


def four_bar_with_torques(*torques: str) -> Mechanism:
    """Return the paper's four-bar without inertia, with torques at its rocker's pair."""
    loads = tuple(PairTorque(f"load{k}", "41", torque) for k, torque in enumerate(torques))
    return replace(load("four_bar"), masses=(), loads=loads)


def judge_holding_torques(powers: Sequence[float]) -> Iterator[Row]:
    """Yield the errors of the torque that holds a load of so many powers of ten (N m)."""
    for power in powers:
        mechanism = four_bar_with_torques(f"{10.0**power!r}*sin(theta_41)")
        dynamics = inverse_dynamics(
            mechanism, Polynomial((INPUT_RAD,)), [0.0], assembly_mode=0
        )
        reference = Reference(mechanism)
        with mp.workdps(DIGITS):
            start = exact(dynamics.values[0])
            configuration = reference.closed(start, reference.inputs)
            kinematics = truth(reference, configuration, derivatives=False)
            amplitude = mp.mpf(10.0**power)
            torque, conditioning = _true_torque(reference, kinematics, amplitude)
            size = max(abs(torque), SMALLEST_NORMAL)
            error = abs(mp.mpf(float(dynamics.tau[0])) - torque) / size
        status = Status(dynamics.status[0]).name
        yield Row(power, "torque", conditioning, float(error), status)


def _true_torque(
    reference: Reference, kinematics: Truth, amplitude: mp.mpf
) -> tuple[mp.mpf, float]:
    """Return the holding torque of the input in 90 digits, and its conditioning.

    Parameters
    ----------
    reference
        The four-bar.
    kinematics
        Its configuration and rates.
    amplitude
        Factor A (N m) of the load A sin(theta_41).

    Returns
    -------
    torque
        -A sin(theta_41) d theta_41 / d q (N m).
    conditioning
        Its conditioning relative to itself.
    """
    mechanism = reference.mechanism
    rocker_angle = reference.angles.index(mechanism.variable_names.index("theta_41"))
    rocker = mechanism.link_number["4"]
    joint = revolute(reference.joints[mechanism.pair_number["41"]])
    rocker_axis = exact(joint.first[:, 2])

    def holding_torque(angles: Exact, rates: Exact) -> mp.mpf:
        return -amplitude * mp.sin(angles[rocker_angle]) * (rates[rocker] @ rocker_axis)

    torque = holding_torque(kinematics.angles, kinematics.rates)
    changes = [
        abs(holding_torque(changed["angles"], changed["rates"]) / torque - 1)
        for changed in kinematics.changed
    ]
    return torque, max(1.0, float(max(changes) / SMALL))


@case(LOADS_FAMILY, POWER, HUGE)
def torque_of_a_huge_load(powers: Sequence[float]) -> Iterator[Row]:
    """The torque that holds a load up to 1e308 N m on the rocker of the four-bar."""
    yield from judge_holding_torques(powers)


@case(LOADS_FAMILY, POWER, TINY)
def torque_of_a_tiny_load(powers: Sequence[float]) -> Iterator[Row]:
    """The same of a load down to the smallest denormal number."""
    yield from judge_holding_torques(powers)


@case(LOADS_FAMILY, POWER, HUGE)
def loads_that_overflow(powers: Sequence[float]) -> Iterator[Row]:
    """Four such loads at once in the analysis `eksergian`: their sum may be no number.

    The error is 0 where the torque is finite and infinite where it is not.
    """
    for power in powers:
        mechanism = four_bar_with_torques(*[f"4*cos(theta_41)*{10.0**power!r}"] * 4)
        frame = sk.run(mechanism, "eksergian", samples=5).frame()
        row: Any
        for row in frame.itertuples():
            error = 0.0 if abs(row.tau) < float("inf") else float("inf")
            yield Row(power, "torque", 1.0, error, row.status)


@case(LOADS_FAMILY, POWER, HUGE)
def motion_under_a_huge_load(powers: Sequence[float]) -> Iterator[Row]:
    """The four-bar with its inertia let go under such a load for 1 ms.

    Either the simulation balances energy to its tolerance of 1e-9, or it says why it
    ended; the conditioning stands for that tolerance.
    """
    for power in powers:
        mechanism = replace(
            four_bar_with_torques(f"{10.0**power!r}*sin(theta_41)"),
            masses=load("four_bar").masses,
        )
        try:
            simulation = simulate(mechanism, Start(INPUT_RAD, 0.0), 1e-3, engine="numpy")
        except SpherekitError as fault:
            yield Row(
                power, "energy", ENERGY_CONDITIONING, float("inf"), type(fault).__name__
            )
            continue
        checks = simulation.checks
        error = checks.energy / checks.energy_scale
        status = "OK" if simulation.end.kind == "time" else simulation.end.kind
        yield Row(power, "energy", ENERGY_CONDITIONING, error, status)
