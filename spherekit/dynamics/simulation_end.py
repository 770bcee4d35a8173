"""The reasons for which simulations end, in words."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from spherekit.dynamics.equation_of_motion import EquationOfMotion
from spherekit.dynamics.inertia import inertia_matrix
from spherekit.dynamics.simulated_path import StatePath
from spherekit.dynamics.simulation_start import Problem
from spherekit.errors import SolveError
from spherekit.number_text import degrees_text

EndKind = Literal[
    "time",
    "joint_limit",
    "off_profile",
    "curvature",
    "singularity",
    "sticking",
    "locking",
    "lift_off",
    "no_inertia",
    "too_fast",
]
"""Kinds of ends. "time" is the end at the requested time."""

TIME_MESSAGE = "the requested time has passed"
CROSSING_MESSAGE = (
    "two configuration curves cross here, so the loads do not determine on which one the "
    'mechanism continues; start beyond the crossing, or set crossings to "pass"'
)
NO_SERIES_MESSAGE = (
    "a load has a value here but no Taylor series, for example because exp overflows in "
    "it; write it with tanh, or use the NumPy engine"
)
JUMP_MESSAGE = (
    "a load jumps or grows without bound here; make the load smooth, or give the time of "
    "the jump in the argument switches"
)
NOISE_MESSAGE = (
    "the noise of the loads, or of rates near a crossing of curves, exceeds the tolerance: "
    "no step is short enough to continue; smooth the loads, or raise the tolerance"
)
LOCKING_MESSAGE = (
    "bearings lock here: their friction increases the reactions that cause it without "
    "bound, so it is not determined for rigid links; give the bearings a smaller "
    "coefficient or radius, or place them farther apart"
)
NO_INERTIA_MESSAGE = (
    "the equivalent inertia goes to zero here: no link with mass moves together with the "
    "input, so its speed would become infinite; give mass to links that move"
)

MAX_VANISHING_INERTIA = 1e-6
"""Largest equivalent inertia, relative to the largest one of the simulation, that counts as
vanishing.

Larger: simulations that fail for another reason are said to end without inertia.
"""


@dataclass(frozen=True)
class SimulationEnd:
    """Time and reason of the end of a simulation.

    Attributes
    ----------
    kind
        Kind of the end: "time" if the requested time is over, otherwise for example
        "joint_limit" or "singularity".
    t
        Time of the end, s.
    message
        The reason in words, for users.
    """

    kind: EndKind
    t: float
    message: str


def joint_limit_end(t: float, pair: str, value: float) -> SimulationEnd:
    """Return the end at a joint limit of a pair whose variable is `value` (rad)."""
    limit = f"{degrees_text(value)} deg ({value:.6g} rad)"
    return SimulationEnd(
        "joint_limit", t, f"pair {pair} reached its joint limit at {limit}"
    )


def too_many_steps_message(steps: int) -> str:
    """Return the message that a number of steps is not enough, with advice."""
    return (
        f"{steps} steps are not enough, because the loads change the speed too fast; "
        "increase the speed that smooths friction, or the tolerance, or simulate a shorter "
        "time"
    )


def no_step_end(
    equation: EquationOfMotion, path: StatePath, t: float, message: str
) -> SimulationEnd:
    """Return the reason why a simulation ends if its next step would become too short.

    The end is "no_inertia" if the smallest principal inertia at the time of the end is tiny
    compared with the largest principal inertia so far. If not, the end is "too_fast" with
    the text `message`.

    Parameters
    ----------
    equation
        The equation of motion.
    path
        The states so far.
    t
        Time of the end, s.
    message
        The reason in words, which is used unless the inertia vanishes.
    """
    # Inertias at the starts of some steps (a limited number, evenly chosen) and at the end.
    step_starts = path.starts[path.checked_steps]
    path_states = path.evaluate(np.append(step_starts, t))
    # A state begins with the pair variables (joint angles). The weights define the
    # coordinates of the inertia matrix: the rate of a coordinate is a weighted sum of the
    # rates of the pair variables.
    motion = equation.compute_motion(
        path_states.states[:, : equation.variable_count], path_states.rate_weights
    )
    # In rows: the starts of steps, then the end. In columns: principal inertias, rising.
    inertias = np.linalg.eigvalsh(inertia_matrix(equation.mechanism, motion))
    if inertias[-1, 0] < MAX_VANISHING_INERTIA * np.max(inertias):
        return SimulationEnd("no_inertia", t, NO_INERTIA_MESSAGE)
    return SimulationEnd("too_fast", t, message)


def make_start_error(problem: Problem, reason: str) -> SolveError:
    """Return the error of a simulation that has not even a first step."""
    return SolveError(
        f"{problem.equation.mechanism.name}: the simulation fails at its start: {reason}"
    )
