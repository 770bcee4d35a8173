"""Simulations against inverse dynamics."""

import numpy as np
from cross_checks.evidence import check

import spherekit as sk
from spherekit.mechanism.load_kinds import DRIVE_LOAD_NAME

DURATION_S = 1.5
SPEED = 0.4
"""Rate (rad/s) of the input at the start."""
TOLERANCE = 1e-9
"""Tolerance of the simulation."""
CLEAR = 1e3
"""Conditioning up to which torques of both problems are compared."""
AGREE = 1e-5
"""Part of the largest torque by which they may differ."""


@check("simulation and inverse", "inverse dynamics gives back the torque of a simulation")
def simulation_and_inverse(evidence, notes):
    """Compare the torque that drives a simulation with the result of inverse dynamics.

    At three times, the law of the input for inverse dynamics is the parabola with the
    simulated angle, rate and acceleration. Only mechanisms with one input and with masses
    are compared.

    Parameters
    ----------
    evidence, notes
        `Evidence`, which has the mechanism and runs its analyses when their results are
        first used; and `Notes`, which collect the findings.
    """
    motion = evidence.motion
    masses = evidence.mechanism.masses
    # The simulation starts at a random row that is far from a singular configuration: its
    # condition number is small.
    is_startable = (motion.status == sk.Status.OK) & (motion.conditioning < 30.0)
    rows = np.flatnonzero(is_startable)
    if not evidence.has_one_input or not masses or not len(rows):
        return
    start_row = int(rows[evidence.random_generator("start").integers(len(rows))])
    # A torque of the size of the inertia (kg m^2) gives accelerations of about 1 rad/s^2.
    torque_size = float(sum(np.trace(np.array(mass.tensor)) for mass in masses))
    simulation = sk.simulate(
        evidence.mechanism,
        sk.Start(float(motion.q[start_row]), SPEED),
        DURATION_S,
        torque=f"{torque_size:.6g} * sin(2*t)",
        assembly_mode=int(motion.assembly_mode[start_row]),
        tolerance=TOLERANCE,
        engine="numpy",
    )
    if not simulation.end.t > 1e-3:  # it stopped at once, at a dead centre
        return
    history = simulation.at(simulation.end.t * np.array([0.3, 0.65, 0.95]))
    mechanism = evidence.mechanism.with_inputs(*evidence.position_analysis.inputs)
    load_names = [load.name for load in simulation.mechanism.loads]
    # The driving torque is one of the loads of the simulated mechanism.
    drive = load_names.index(DRIVE_LOAD_NAME)
    conditioning = evidence.position_analysis.given(history.values).conditioning
    for k, t in enumerate(history.t):
        q = float(history.q[k])
        dq = float(history.dq[k])
        ddq = float(history.ddq[k])
        # Torques near a singular configuration are large and have few digits. The driving
        # torque is its power divided by the rate, so a slow input is left out.
        if not (conditioning[k] < CLEAR and abs(dq) > 1e-2):
            continue
        law = sk.Polynomial((q - dq * t + 0.5 * ddq * t**2, dq - ddq * t, 0.5 * ddq))
        solution = sk.inverse_dynamics(mechanism, law, [t])
        # Only the assembly mode that is simulated has the same orientations.
        rotations = evidence.position_analysis.given(solution.values).rotations
        gap = np.max(np.abs(rotations - history.rotations[k]), axis=(1, 2, 3))
        for row in np.flatnonzero((gap < 1e-7) & (solution.status == sk.Status.OK)):
            torque = float(history.power[k, drive] / dq)
            tau = float(solution.tau[row])
            terms = abs(float(solution.B[row] * ddq)) + abs(float(solution.Q[row]))
            scale = max(abs(torque), abs(tau), terms, 1e-12)
            notes.add_contradiction_if(
                not abs(tau - torque) < AGREE * scale,
                f"t = {t:.6g} s, q = {q:.9g} rad: the torque is {torque:.9g} N m, inverse "
                f"dynamics says {tau:.9g}",
            )
