"""Repeats a simulation in many digits, to measure the errors of other simulations."""

import numpy as np

from spherekit.argument_validation import checked
from spherekit.arrays import Floats
from spherekit.dynamics.forward_dynamics import MIN_TOLERANCE_BY_ENGINE, simulate
from spherekit.dynamics.simulation import Simulation
from spherekit.errors import EngineError, SolveError
from spherekit.files.mechanism_reader import AnyMechanism, mechanism_of
from spherekit.files.study import Start, StartGiven, read_start
from spherekit.mechanism.friction import check_no_reaction_friction
from spherekit.proof.balls import MIN_DIGITS, Digits
from spherekit.proof.reference_motion import ExactSimulation
from spherekit.quantity import AngleUnit
from spherekit.wording import listing

REFERENCE_END_KINDS = ("time", "joint_limit", "sticking")
"""The kinds of ends that a reference simulation finds by itself."""


@checked(SolveError)
def reference_simulation(
    mechanism: AnyMechanism,
    start: StartGiven,
    until: float,
    *,
    torque: str | None = None,
    input_pair: str | None = None,
    assembly_mode: int = 0,
    arithmetic: Digits | None = None,
    angle_unit: AngleUnit = "rad",
) -> ExactSimulation:
    """Return the motion of a mechanism with one input under its loads, in many digits.

    The result serves to measure the errors of simulations in float64. The motion is first
    simulated in float64 with the smallest tolerance. An iteration in many digits then
    refines it.

    Parameters
    ----------
    mechanism
        A mechanism with masses. Its loads act, and its joint limits end the motion.
    start
        Input variable (rad) and its rate (rad/s) at time 0. In a text, a number without a
        unit is in the unit of the mechanism's file.
    until
        Time (s) at which to end.
    torque
        Expression of the driving torque (N m) at the input, such as ``"10*sin(2*t)"``. By
        default the input turns freely.
    input_pair
        Name of the driven R pair, by default the input in the file.
    assembly_mode
        Number of the assembly mode (way to assemble the links) at the start.
    arithmetic
        The arithmetic, such as `Digits(n)` with n digits. By default it has 20 digits.
    angle_unit
        Unit of the numbers of a mapping `start`, ``"rad"`` or ``"deg"`` (and per s). A
        `Start` and the result are in rad.

    Raises
    ------
    ModelError, SolveError
        If something is missing or impossible.
    EngineError
        If the motion ends at a singularity, or changes too fast.
    """
    mechanism = mechanism_of(mechanism)
    start = read_start(start, mechanism, angle_unit)
    simulation = simulate(
        mechanism,
        start,
        until,
        torque=torque,
        input_pair=input_pair,
        assembly_mode=assembly_mode,
        tolerance=MIN_TOLERANCE_BY_ENGINE["numpy"],
    )
    return refined(simulation, start, until, arithmetic)


def refined(
    simulation: Simulation, start: Start, until: float, arithmetic: Digits | None = None
) -> ExactSimulation:
    """Return a simulation in many digits, with the same start, loads and joint limits.

    Parameters
    ----------
    simulation
        A simulation in float64 with the smallest tolerance, from which the iteration in
        many digits starts.
    start
        Angle (rad) and rate (rad/s) of the input at the start of this simulation, taken as
        exact numbers.
    until
        Time (s) at which the reference ends.
    arithmetic
        The number of digits, as in `reference_simulation`.

    Raises
    ------
    EngineError
        If the simulation ended in a way that depends on tolerances, or no step of the
        reference is short enough.
    """
    mechanism = simulation.mechanism
    end = simulation.end
    if end.kind not in REFERENCE_END_KINDS:
        raise EngineError(
            f"{mechanism.name}: the simulation ended at {end.t:.6g} s ({end.message}); a "
            f"reference can be computed only for simulations that end by "
            f"{listing(REFERENCE_END_KINDS)}; request a shorter time"
        )
    if len(mechanism.inputs) > 1:
        raise EngineError(
            f"{mechanism.name}: a reference in extended precision needs a mechanism with "
            f"one input, not {len(mechanism.inputs)}"
        )
    check_no_reaction_friction(mechanism, "a reference in extended precision")
    (q,), (dq,) = start.each(mechanism.input_pairs)

    def approximate_motion(t: Floats) -> tuple[Floats, Floats]:
        """Return the approximate motion in float64, from which the iteration starts.

        The result has the values and rates (n, variables) of the pair variables at times
        (n,), s. After the end of the simulation the variables are extrapolated at constant
        rates.
        """
        path_states = simulation.path.evaluate(np.clip(t, 0.0, end.t))
        rates = path_states.rates[:, : simulation.equation.variable_count]
        time_after_end = np.maximum(t - end.t, 0.0)[:, None]
        return path_states.values + rates * time_after_end, rates

    reference = ExactSimulation(
        arithmetic=arithmetic or Digits(MIN_DIGITS),
        mechanism=mechanism,
        driven=simulation.driven[0],
        q=float(q),
        dq=float(dq),
        until=until,
        float_solution=approximate_motion,
    )
    if reference.kind != end.kind:
        raise EngineError(
            f"{mechanism.name}: the reference ends by {reference.kind} at "
            f"{float(reference.end):.6g} s, the simulation by {end.kind} at {end.t:.6g} s"
        )
    return reference
