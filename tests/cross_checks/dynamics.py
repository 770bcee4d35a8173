"""Simulations against inverse dynamics."""

import numpy as np
from cross_checks.evidence import check

import spherekit as sk
from spherekit.mechanism.load_kinds import DRIVE_LOAD_NAME

UNTIL, SPEED, TOLERANCE = 1.5, 0.4, 1e-9
"""The time (s) that is simulated, the rate (rad/s) at the start, and the tolerance."""
CLEAR = 1e3
"""Conditioning up to which torques of both problems are compared."""
AGREE = 1e-5
"""Part of the largest torque by which they may differ."""


@check("simulation and inverse", "inverse dynamics gives back the torque of a simulation")
def simulation_and_inverse(evidence, notes):
    """Compare the torque at the input with what the inverse problem asks for.

    Its law of the input is the parabola that has the simulated rates at one time.
    """
    motion, masses = evidence.motion, evidence.mechanism.masses
    good = np.flatnonzero((motion.status == sk.Status.OK) & (motion.conditioning < 30.0))
    if not evidence.single or not masses or not len(good):
        return
    row = int(good[evidence.numbers("start").integers(len(good))])
    size = float(sum(np.trace(np.array(mass.tensor)) for mass in masses))
    found = sk.simulate(
        evidence.mechanism,
        sk.Start(float(motion.q[row]), SPEED),
        UNTIL,
        torque=f"{size:.6g} * sin(2*t)",
        assembly_mode=int(motion.assembly_mode[row]),
        tolerance=TOLERANCE,
        engine="numpy",
    )
    if not found.end.t > 1e-3:
        return
    history = found.at(found.end.t * np.array([0.3, 0.65, 0.95]))
    mechanism = evidence.mechanism.with_inputs(*evidence.tracer.inputs)
    applied = [load.name for load in found.mechanism.loads].index(DRIVE_LOAD_NAME)
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
