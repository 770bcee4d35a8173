"""Time and accuracy of forward dynamics by the compiled engine."""

import numpy as np

from benchmarks.harness import Cell, Section
from spherekit.arrays import Floats
from spherekit.dynamics.forward_dynamics import simulate
from spherekit.dynamics.reference_simulation import reference_simulation
from spherekit.dynamics.simulation import Simulation
from spherekit.files.mechanism_reader import load
from spherekit.files.study import Start
from spherekit.symbolic.compiler import available, heyoka
from spherekit.velocities.function_cache import FUNCTION_CACHE

START = Start(0.3, 1.0)
"""Angle (rad) and rate (rad/s) of the input at time 0."""

DURATION = 10.0
"""Duration of the simulation (s)."""

TORQUE = "10*sin(2*t)"
"""Torque on the input (N m)."""

SIMULATION_TOLERANCES = (1e-9, 1e-12, 1e-13, 1e-14, 1e-15)
QUICK_SIMULATION_TOLERANCES = (1e-9, 1e-13)
"""Relative tolerances of the integration."""

SIMULATION_REPETITIONS = 9
"""Number of simulations with the same compiled code, for the median of the times."""


def run(quick: bool) -> list[Section]:
    """Return the section; without heyoka it says that nothing was measured."""
    if not available():
        text = "heyoka is not installed; nothing was measured."
        return [Section("Compiled engine", text, (), ())]
    module = heyoka()
    threads = module.get_nthreads()
    module.set_nthreads(1)
    try:
        return [_measure_dynamics(quick)]
    finally:
        module.set_nthreads(threads)


def _simulate(tolerance: float, compact: bool) -> Simulation:
    """Simulate the four-bar with the loads of its file and a torque on the input."""
    return simulate(
        load("four_bar"),
        START,
        DURATION,
        torque=TORQUE,
        tolerance=tolerance,
        engine="compiled",
        compact=compact,
    )


def _reference_angles(times: Floats) -> Floats:
    """Return the input (times,) rad of a simulation in ball arithmetic."""
    reference = reference_simulation("four_bar", START, DURATION, torque=TORQUE)
    values, *_ = reference.at(times)
    return np.array(values[:, load("four_bar").angles["21"]], dtype=float)


def _measure_dynamics(quick: bool) -> Section:
    """Measure simulations at several tolerances, by compact and by full code."""
    times = np.linspace(0.0, DURATION, 101)
    reference_angles = _reference_angles(times)
    rows: list[tuple[Cell, ...]] = []
    for compact in (True, False):
        for tolerance in QUICK_SIMULATION_TOLERANCES if quick else SIMULATION_TOLERANCES:
            # The first simulation compiles again, so that its time is known.
            FUNCTION_CACHE.clear()
            first = _simulate(tolerance, compact)
            seconds = [
                _simulate(tolerance, compact).engine.seconds
                for _ in range(SIMULATION_REPETITIONS)
            ]
            rows.append(
                (
                    "compact" if compact else "full",
                    tolerance,
                    float(np.max(np.abs(first.at(times).q - reference_angles))),
                    1e3 * float(np.median(seconds)),
                    1e3 * min(seconds),
                    first.engine.compile_seconds,
                    first.engine.steps,
                    first.checks.energy,
                    first.checks.closure,
                )
            )
    return Section(
        "Compiled forward dynamics",
        "The four-bar of the paper with q(0) = 0.3, q'(0) = 1, the loads of Table 2 and "
        "a torque 10 sin 2t on link 2, over 10 s. The error is the largest error of q at "
        "101 times, compared with a reference simulation in ball arithmetic. The "
        "engine uses at most 1e-12 as the tolerance of a step, so rows with larger "
        "tolerances have the same steps. heyoka keeps compiled code on disk, so a second "
        "process compiles faster.",
        (
            "mode",
            "tolerance",
            "error of q, rad",
            "solved in, ms",
            "fastest, ms",
            "compiled in, s",
            "steps",
            "energy less work, J",
            "closure, rad",
        ),
        rows,
    )
