"""The compiled engine: forward dynamics."""

import numpy as np

from benchmarks.harness import Cell, Section
from spherekit.dynamics.forward_dynamics import simulate
from spherekit.dynamics.reference_simulation import reference_simulation
from spherekit.dynamics.simulation import Simulation
from spherekit.files.mechanism_reader import load
from spherekit.files.study import Start
from spherekit.symbolic.compiler import available, heyoka
from spherekit.velocities.function_cache import FUNCTION_CACHE

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


def run(quick: bool) -> list[Section]:
    """Return the sections, or one that says why there are none."""
    if not available():
        text = "heyoka is not installed; nothing was measured."
        return [Section("Compiled engine", text, (), ())]
    module = heyoka()
    threads = module.get_nthreads()
    module.set_nthreads(1)
    try:
        return [_dynamics(quick)]
    finally:
        module.set_nthreads(threads)


def _paper(tolerance: float, compact: bool) -> Simulation:
    return simulate(
        load("four_bar"),
        Start(0.3, 1.0),
        10.0,
        torque="10*sin(2*t)",
        tolerance=tolerance,
        engine="compiled",
        compact=compact,
    )


def _exact(times: Floats) -> Floats:
    """Return q in many digits, in balls."""
    start = Start(0.3, 1.0)
    exact = reference_simulation("four_bar", start, 10.0, torque="10*sin(2*t)")
    values, *_ = exact.at(times)
    return np.array(values[:, load("four_bar").angles["21"]], dtype=float)


def _dynamics(quick: bool) -> Section:
    times = np.linspace(0.0, 10.0, 101)
    exact = _exact(times)
    tolerances = (1e-9, 1e-13) if quick else (1e-9, 1e-12, 1e-13, 1e-14, 1e-15)
    rows: list[tuple[Cell, ...]] = []
    for compact in (True, False):
        for tolerance in tolerances:
            FUNCTION_CACHE.clear()
            first = _paper(tolerance, compact)
            seconds = [_paper(tolerance, compact).engine.seconds for _ in range(9)]
            rows.append(
                (
                    "compact" if compact else "full",
                    tolerance,
                    float(np.max(np.abs(first.at(times).q - exact))),
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
        "The paper's four-bar, q(0) = 0.3, q'(0) = 1, loads of its Table 2 and a torque "
        "10 sin 2t on link 2, 10 s. The error is the largest of q at 101 times against a "
        "reference simulation in balls. Tolerances above 1e-12 run as 1e-12. heyoka keeps "
        "compiled code on disk, so a second process compiles in less.",
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
