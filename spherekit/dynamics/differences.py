"""The direct problem by finite differences of the input, as its source proposes.

Offered to compare with: the scheme is of first order, and ends at dead centres of the
input (Di Gregorio 2024, eqs. (30), (31)).
"""

import time
from dataclasses import replace
from itertools import pairwise

import numpy as np

from spherekit.dynamics.collocation import Step
from spherekit.dynamics.inertia import inertia
from spherekit.dynamics.kinematics import by_variables
from spherekit.dynamics.path import CollocationPath
from spherekit.dynamics.simulation import (
    EngineReport,
    Simulation,
    SimulationEnd,
    cannot_leave,
)
from spherekit.dynamics.start import STANDSTILL, Problem
from spherekit.errors import SolveError
from spherekit.model.bearings import need_no_rubbing
from spherekit.sphere.rotation import Floats

REASON = "the scheme of the source is written with NumPy only"


def by_differences(problem: Problem, step: float) -> Simulation:
    """Return the motion at equal time steps (s), linear in between.

    With D the step, q_1 = q_0 + q'_0 D, and q_{i+1} = (D^2 Q - 1/2 dB/dq (q_i - q_{i-1})^2)
    / B + 2 q_i - q_{i-1}, where Q is taken at q_i and (q_i - q_{i-1}) / D.
    """
    started, count = time.perf_counter(), _steps(problem, step)
    (driven,), closure = problem.driven, problem.equation.closure
    variables = problem.equation.variables
    values, equation = problem.values, problem.equation
    first = float(problem.speed[0] * problem.frame[0, driven])
    before = values[driven] - first * step
    end = SimulationEnd("time", problem.until, "the time asked for is over")
    states: list[Floats] = []
    frames: list[Floats] = []
    work = np.zeros(len(equation.loads.names))
    for number in range(count + 1):
        t, q = number * step, float(values[driven])
        motion = by_variables(closure, values[None], [driven])
        speed = (q - before) / step
        masses = inertia(equation.mechanism, motion)
        B, dB = float(masses.B[0]), float(masses.dB[0])
        seen = replace(motion, values=motion.values + problem.whole)
        forces = equation.loads.parts(seen, np.array([[speed]]), np.array([t]))[0, 0]
        states.append(np.concatenate([values, [np.sqrt(B) * speed], work]))
        frames.append(motion.rates / np.linalg.norm(motion.rates))
        if number == count:
            break
        work = work + step * forces * speed
        after = q + first * step
        if number:
            push = step**2 * float(np.sum(forces)) - 0.5 * dB * (q - before) ** 2
            after = push / B + 2.0 * q - before
        guess = values + motion.rates[0, 0] * (after - q)
        guess[driven] = after
        closed = None
        if np.all(np.isfinite(guess)) and frames[-1][0, 0, driven] > STANDSTILL:
            closed = closure.solve(guess[None], [driven])
        if closed is None or not closed.residual[0] < 1e-12:
            end = SimulationEnd(
                "singularity", t, "the input is at a dead centre, where q' is endless"
            )
            break
        before, values = q, closed.values[0]
    path = [
        (Step(k * step, step, one, (other - one)[None] / step), frames[k])
        for k, (one, other) in enumerate(pairwise(states))
    ]
    if not path:
        raise cannot_leave(problem, end.message)
    gap = closure.at(np.array(states)[:, :variables]).residual
    traced = CollocationPath(
        tuple(path), problem.turns, float(np.max(np.abs(gap), initial=0.0))
    )
    seconds = time.perf_counter() - started
    report = EngineReport("numpy", REASON, 0.0, seconds, len(path))
    return Simulation(equation, problem.driven, traced, (), end, report)


def _steps(problem: Problem, step: float) -> int:
    """Return how many steps there are; `SolveError` where the scheme is none of it."""
    name = problem.equation.mechanism.name
    count = round(problem.until / step) if step > 0.0 else 0
    if count < 1 or abs(count * step - problem.until) > 1e-9 * problem.until:
        raise SolveError(
            f"{name}: step is {step:g} s, but the time {problem.until:g} s must be a whole "
            "number of steps"
        )
    if problem.equation.freedoms > 1:
        raise SolveError(
            f"{name}: the scheme of the source is of one input; leave scheme out"
        )
    need_no_rubbing(problem.equation.mechanism, "the scheme of the source does not know")
    return count
