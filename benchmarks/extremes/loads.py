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

FAMILY = "loads"
POWER = "power of ten of the load, N m"
HUGE = (0.0, 100.0, 200.0, 290.0, 300.0, 305.0, 307.0, 308.0)
TINY = (-100.0, -200.0, -300.0, -307.0, -309.0, -315.0, -320.0, -323.0)
NORMAL = sys.float_info.min
"""Below it numbers have fewer digits, and the error is taken over it."""


def loaded(*torques: str) -> Mechanism:
    """Return the paper's four-bar without inertia under torques at its rocker's pair."""
    made = load("four_bar")
    loads = (PairTorque(f"load{k}", "41", torque) for k, torque in enumerate(torques))
    return replace(made, masses=(), loads=tuple(loads))


def forces(powers: Sequence[float]) -> Iterator[Row]:
    """Yield the torque that holds a load of so many powers of ten against 90 digits."""
    for power in powers:
        made = loaded(f"{10.0**power!r}*sin(theta_41)")
        found = inverse_dynamics(made, Polynomial((0.7,)), [0.0], assembly_mode=0)
        reference = Reference(made)
        with mp.workdps(DIGITS):
            start = exact(found.values[0])
            known = truth(reference, reference.closed(start, reference.inputs), False)
            right, condition = _torque(reference, known, mp.mpf(10.0**power))
            error = abs(mp.mpf(float(found.tau[0])) - right) / max(abs(right), NORMAL)
        status = Status(found.status[0]).name
        yield Row(power, "torque", condition, float(error), status)


def _torque(reference: Reference, known: Truth, size: mp.mpf) -> tuple[mp.mpf, float]:
    """Return -size sin(theta_41) d theta_41 / d q, and its relative conditioning."""
    made = reference.mechanism
    rocker = reference.angles.index(made.variable_names.index("theta_41"))
    link = made.link_number["4"]

    joint = revolute(reference.joints[made.pair_number["41"]])
    axis = joint.first[:, 2]

    def at(angles: Exact, rotations: Exact, rates: Exact) -> mp.mpf:
        return -size * mp.sin(angles[rocker]) * (rates[link] @ exact(axis))

    right = at(known.angles, known.rotations, known.rates)
    moved = [at(c["angles"], c["rotations"], c["rates"]) for c in known.changed]
    return right, max(1.0, float(max(abs(x / right - 1) for x in moved) / SMALL))


@case(FAMILY, POWER, HUGE)
def torque_of_a_huge_load(powers: Sequence[float]) -> Iterator[Row]:
    """The torque that holds a load up to 1e308 N m on the rocker of the four-bar."""
    yield from forces(powers)


@case(FAMILY, POWER, TINY)
def torque_of_a_tiny_load(powers: Sequence[float]) -> Iterator[Row]:
    """The same of a load down to the smallest denormal number."""
    yield from forces(powers)


@case(FAMILY, POWER, HUGE)
def loads_that_overflow(powers: Sequence[float]) -> Iterator[Row]:
    """Four such loads at once in the analysis `eksergian`: their sum may be no number.

    The error is 0 where the torque is finite and infinite where it is not.
    """
    for power in powers:
        made = loaded(*[f"4*cos(theta_41)*{10.0**power!r}"] * 4)
        frame = sk.run(made, "eksergian", samples=5).frame()
        row: Any
        for row in frame.itertuples():
            finite = abs(row.tau) < float("inf")
            yield Row(power, "torque", 1.0, 0.0 if finite else float("inf"), row.status)


@case(FAMILY, POWER, HUGE)
def motion_under_a_huge_load(powers: Sequence[float]) -> Iterator[Row]:
    """The four-bar with its inertia let go under such a load for 1 ms.

    Either the simulation balances energy to its tolerance of 1e-9, or it says why it
    ended; the conditioning stands for that tolerance.
    """
    for power in powers:
        made = replace(
            loaded(f"{10.0**power!r}*sin(theta_41)"), masses=load("four_bar").masses
        )
        try:
            found = simulate(made, Start(0.7, 0.0), 1e-3, engine="numpy")
        except SpherekitError as fault:
            yield Row(power, "energy", 1e7, float("inf"), type(fault).__name__)
            continue
        checks = found.checks
        status = "OK" if found.end.kind == "time" else found.end.kind
        yield Row(power, "energy", 1e7, checks.energy / checks.energy_scale, status)
