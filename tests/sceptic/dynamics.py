"""Simulations against inverse dynamics, and one engine against the other."""

import numpy as np
from sceptic.evidence import Kind, check

import spherekit as sk
from spherekit.errors import EngineError
from spherekit.model.dynamics import DRIVE

UNTIL = 1.5
"""Time (s) that is simulated."""
SPEED = 0.4
"""Rate (rad/s) at the start."""
TOLERANCE = 1e-9
ROWS = 25
TORQUE = "{size} * sin(2*t)"
CLEAR = 1e3
"""Conditioning up to which torques of both problems are compared."""
AGREE = 1e-5
"""Part of the largest torque by which they may differ."""
BALANCED = 1e-7
"""Part of the largest energy that may be missing."""
ALIKE = 1e3
"""How many times their tolerance engines may differ by."""


def _started(evidence):
    """Return a start at a sample well clear of singularities, its mode, and a torque."""
    if not evidence.single or not evidence.mechanism.masses:
        return None
    motion = evidence.motion
    good = np.flatnonzero((motion.status == sk.Status.OK) & (motion.conditioning < 30.0))
    if not len(good):
        return None
    row = int(good[evidence.numbers("start").integers(len(good))])
    size = 1e-3 * float(
        sum(np.trace(np.array(m.tensor)) for m in evidence.mechanism.masses)
    )
    start = sk.Start(float(motion.q[row]), SPEED)
    return start, int(motion.assembly_mode[row]), TORQUE.format(size=f"{1e3 * size:.6g}")


def _simulated(evidence, engine):
    started = _started(evidence)
    if started is None:
        return None
    start, assembly_mode, torque = started
    return sk.simulate(
        evidence.mechanism,
        start,
        UNTIL,
        torque=torque,
        assembly_mode=assembly_mode,
        tolerance=TOLERANCE,
        engine=engine,  # type: ignore[arg-type]
    )


@check("simulation and inverse", "inverse dynamics gives back the torque of a simulation")
def simulation_and_inverse(evidence, notes):
    """Compare the torque at the input with what the inverse problem asks for.

    Its law of the input is the parabola that has the simulated rates at one time.
    """
    found = _simulated(evidence, "numpy")
    if found is None or not found.end.t > 1e-3:
        return
    history = found.at(found.end.t * np.array([0.3, 0.65, 0.95]))
    mechanism = evidence.mechanism.with_inputs(*evidence.tracer.inputs)
    applied = [load.name for load in found.mechanism.loads].index(DRIVE)
    conditioning = evidence.tracer.given(history.values).conditioning
    for k, t in enumerate(history.t):
        q, dq, ddq = (float(x[k]) for x in (history.q, history.dq, history.ddq))
        if not (conditioning[k] < CLEAR and abs(dq) > 1e-2):
            continue
        law = sk.Polynomial((q - dq * t + 0.5 * ddq * t**2, dq - ddq * t, 0.5 * ddq))
        solved = sk.inverse_dynamics(mechanism, law, [t])
        there = evidence.tracer.given(solved.values).rotations
        gap = np.max(np.abs(there - history.rotations[k]), axis=(1, 2, 3))
        for row in np.flatnonzero((gap < 1e-7) & (solved.status == sk.Status.OK)):
            torque, tau = float(history.power[k, applied] / dq), float(solved.tau[row])
            parts = abs(float(solved.B[row] * ddq)) + abs(float(solved.Q[row]))
            scale = max(abs(torque), abs(tau), parts, 1e-12)
            notes.contradiction(
                not abs(tau - torque) < AGREE * scale,
                f"t = {t:.6g} s, q = {q:.9g} rad: the torque is {torque:.9g} N m, inverse "
                f"dynamics says {tau:.9g}",
            )


@check("energy", "a simulation's energy is what its loads have done")
def energy(evidence, notes):
    """Look at the balance of energy that a simulation reports of itself."""
    found = _simulated(evidence, "numpy")
    if found is None:
        return
    checks = found.checks
    notes.contradiction(
        not checks.energy <= BALANCED * max(checks.energy_scale, 1e-12),
        f"{checks.energy:.2e} J of {checks.energy_scale:.2e} J are missing at the "
        f"tolerance {TOLERANCE:g}",
    )


@check("both engines", "the compiled engine and NumPy's end in the same place")
def both_engines(evidence, notes):
    """Compare states of both engines at their tolerance."""
    one = _simulated(evidence, "numpy")
    if one is None:
        return
    try:
        other = _simulated(evidence, "compiled")
    except EngineError:
        return
    last = min(one.end.t, other.end.t)
    t = np.linspace(0.0, last, ROWS)
    first, second = one.at(t), other.at(t)
    conditioning = evidence.tracer.given(first.values).conditioning
    cross = (
        int(np.argmax(~(conditioning < CLEAR))) if np.any(conditioning >= CLEAR) else ROWS
    )
    gap = np.max(np.abs(first.values - second.values), axis=1)[:cross]
    notes.judged(len(gap))
    if len(gap) and np.max(gap) > ALIKE * TOLERANCE:
        k = int(np.argmax(gap))
        notes.found(
            f"at t = {t[k]:.6g} s the engines differ by {gap[k]:.2e} rad at the tolerance "
            f"{TOLERANCE:g}"
        )
    if one.end.kind != other.end.kind:
        notes.found(
            f"NumPy ends at {one.end.t:.6g} s ({one.end.kind}), the compiled engine at "
            f"{other.end.t:.6g} s ({other.end.kind})",
            Kind.CONTRADICTION,
        )
