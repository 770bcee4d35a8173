"""Conservative motion over up to ten thousand revolutions."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from benchmarks.extremes.registry import Row, case
from spherekit.arrays import Floats
from spherekit.dynamics.forward_dynamics import simulate
from spherekit.dynamics.simulation_start import PoseStart
from spherekit.errors import EngineError
from spherekit.files.mechanism_reader import load
from spherekit.files.study import Start
from spherekit.mechanism.load_kinds import PairTorque
from spherekit.mechanism.mechanism import Mechanism
from spherekit.numerics.angles import wrap

LONG_RUNS_FAMILY = "long runs"
INPUT_TURNS = "turns of the input"
INPUT_TURN_COUNTS = (10.0, 100.0, 1000.0, 10000.0)
QUICK_INPUT_TURN_COUNTS = (10.0, 100.0)

MAX_SIMULATED_TURNS = 1000.0
"""Largest number of revolutions in one simulation; longer motions are continued."""

WEIGHT_MOMENT = 5.0
"""Largest moment (N m) of the weight on the rocker."""

HISTORY_SAMPLES = 1001
"""Number of times in a simulation at which the energy is computed."""


def judge_energy(
    mechanism: Mechanism, rate: float, seconds_per_turn: float, counts: Sequence[float]
) -> Iterator[Row]:
    """Yield the drift of energy, and the closure residual, over many revolutions.

    The conditioning is the number of steps of the integrator, because each rounds once.

    Parameters
    ----------
    mechanism
        A four-bar without friction, perhaps with a weight on its rocker.
    rate
        Rate (rad/s) of the input at the start.
    seconds_per_turn
        Approximate time (s) of a revolution.
    counts
        Numbers of revolutions.
    """
    rocker = mechanism.variable_names.index("theta_41")
    for count in counts:
        start: Start | PoseStart = Start(0.3, rate)
        remaining_turns = count
        turns = 0.0
        steps = 0
        largest_residual = 0.0
        largest_kinetic = 0.0
        energies: list[float] = []
        status = "OK"
        while remaining_turns > 0 and status == "OK":
            duration = seconds_per_turn * min(remaining_turns, MAX_SIMULATED_TURNS)
            try:
                simulation = simulate(
                    mechanism, start, duration, tolerance=1e-15, engine="compiled"
                )
            except EngineError as fault:
                status = type(fault).__name__
                break
            history = simulation.at(np.linspace(0.0, simulation.end.t, HISTORY_SAMPLES))
            potential: Floats | float = 0.0
            if mechanism.loads:
                potential = WEIGHT_MOMENT * np.cos(history.values[:, rocker])
            energies += list(history.kinetic - potential)
            largest_kinetic = max(largest_kinetic, float(np.max(history.kinetic)))
            largest_residual = max(largest_residual, simulation.checks.closure)
            steps += simulation.engine.steps
            turns += float(history.q[-1] - history.q[0]) / (2 * np.pi)
            # The next simulation starts from the end of this one.
            end_values = wrap(history.values[-1]).tolist()
            start = PoseStart(end_values, "21", float(history.dq[-1]))
            remaining_turns -= MAX_SIMULATED_TURNS
            if simulation.end.kind != "time":
                status = simulation.end.kind
        drift = np.ptp(energies) / largest_kinetic if energies else np.inf
        yield Row(round(turns), "energy", float(steps), float(drift), status)
        yield Row(round(turns), "closure", float(steps), largest_residual, status)


@case(LONG_RUNS_FAMILY, INPUT_TURNS, INPUT_TURN_COUNTS, QUICK_INPUT_TURN_COUNTS)
def crank_with_a_weight(counts: Sequence[float]) -> Iterator[Row]:
    """The paper's four-bar without friction, a weight on its rocker, compiled engine."""
    weight = (PairTorque("weight", "41", f"-{WEIGHT_MOMENT}*sin(theta_41)"),)
    mechanism = replace(load("four_bar"), loads=weight)
    yield from judge_energy(mechanism, 4.0, 1.4, counts)
