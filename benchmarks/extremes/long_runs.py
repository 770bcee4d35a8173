"""Conservative motion over up to ten thousand turns."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from benchmarks.extremes.registry import Row, case
from spherekit.dynamics.forward_dynamics import simulate
from spherekit.dynamics.simulation_start import PoseStart
from spherekit.errors import EngineError
from spherekit.files.mechanism_reader import load
from spherekit.files.study import Start
from spherekit.mechanism.load_kinds import PairTorque
from spherekit.mechanism.mechanism import Mechanism
from spherekit.numerics.angles import wrap

FAMILY = "long runs"
TURNS = "turns of the input"
COUNTS = (10.0, 100.0, 1000.0, 10000.0)
FEW = (10.0, 100.0)
PIECE = 1000.0
STIFF = 5.0


def energies(
    made: Mechanism, dq: float, pace: float, counts: Sequence[float]
) -> Iterator[Row]:
    """Yield the drift of energy and closure over so many turns, `pace` (s) for each.

    In pieces of a thousand turns, each from the end of the one before. The conditioning
    is the number of steps of the integrator: each rounds once.
    """
    rocker = made.variable_names.index("theta_41")
    for count in counts:
        start: Start | PoseStart = Start(0.3, dq)
        left, turns, steps, closure = count, 0.0, 0, 0.0
        energy: list[float] = []
        largest, status = 0.0, "OK"
        while left > 0 and status == "OK":
            try:
                found = simulate(
                    made, start, pace * min(left, PIECE), tolerance=1e-15, engine="compiled"
                )
            except EngineError as fault:
                status = type(fault).__name__
                break
            history = found.at(np.linspace(0.0, found.end.t, 1001))
            height = STIFF * np.cos(history.values[:, rocker]) if made.loads else 0.0
            energy += list(history.kinetic - height)
            largest = max(largest, float(np.max(history.kinetic)))
            closure = max(closure, found.checks.closure)
            steps += found.engine.steps
            turns += float(history.q[-1] - history.q[0]) / (2 * np.pi)
            reached = wrap(history.values[-1]).tolist()
            start = PoseStart(reached, "21", float(history.dq[-1]))
            left -= PIECE
            if found.end.kind != "time":
                status = found.end.kind
        drift = np.ptp(energy) / largest if energy else np.inf
        yield Row(round(turns), "energy", float(steps), float(drift), status)
        yield Row(round(turns), "closure", float(steps), closure, status)


@case(FAMILY, TURNS, COUNTS, FEW)
def crank_with_a_weight(counts: Sequence[float]) -> Iterator[Row]:
    """The paper's four-bar without friction, a weight on its rocker, compiled engine."""
    weight = (PairTorque("weight", "41", f"-{STIFF}*sin(theta_41)"),)
    made = replace(load("four_bar"), loads=weight)
    yield from energies(made, 4.0, 1.4, counts)
