"""Errors of reduced models at random inputs, and the time of one evaluation."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from statistics import median

import numpy as np

from benchmarks.harness import Cell, Section
from spherekit.arrays import Floats
from spherekit.dynamics.coordinates import motion_by_variables
from spherekit.dynamics.inertia import inertia
from spherekit.dynamics.reduced_model import StoredModel
from spherekit.dynamics.reduced_model_maker import reduced_grid_model, reduced_model
from spherekit.files.mechanism_reader import load
from spherekit.mechanism.friction import Bearings
from spherekit.mechanism.load_kinds import Damper
from spherekit.mechanism.mechanism import Mechanism
from spherekit.numerics.tensor_chebyshev import TensorChebyshev
from spherekit.planning.pole_plan import parse_pole
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.velocities.pole_evaluation import evaluate
from spherekit.velocities.pole_request import request

CALLS_PER_ROUND = 20
"""Number of calls in a round.

Larger: a round would outlast the time slice that a busy machine gives a process. Smaller:
the resolution of the clock matters.
"""

ROUNDS = 5000
QUICK_ROUNDS = 200
"""Number of rounds in a quick benchmark. The median over the rounds is the result."""

STORED_CASES = (("four_bar", 0), ("four_bar", 1), ("stephenson", 0))
"""Mechanisms with one input, and assembly modes."""

GRID_MECHANISMS = ("two_dof_spm", "bevel_differential", "five_bar")
QUICK_GRID_MECHANISMS = GRID_MECHANISMS[:2]
"""Mechanisms with several inputs."""

INPUTS_PER_BLOCK = 5000
"""Number of random inputs at which errors are computed together."""

ZERO_FUNCTION = 1e-9
"""A function whose values are at most this size counts as zero. Its error is absolute."""


@dataclass(frozen=True)
class CallTimes:
    """Times of single calls of a function, in rounds that alternate with rounds of a sine.

    Attributes
    ----------
    fastest, median
        Times (us) of a call.
    in_sines
        Median of the ratios to the time of a call of `math.sin`.
    """

    fastest: float
    median: float
    in_sines: float


def run(quick: bool) -> list[Section]:
    """Return the errors and times of models with one input and with several."""
    input_count = 5_000 if quick else 100_000
    return [
        Section(
            "Stored functions",
            "All functions of `spherekit export --to model`. The own error is the estimate "
            "that is stored with the model. The largest error is the difference from "
            f"direct computation at {input_count} random inputs. Both are relative to the "
            "largest value of the function. Times are those of single calls from Python at "
            f"random inputs, in rounds of {CALLS_PER_ROUND} calls. They alternate with "
            "rounds of `math.sin`; `in sines` is the median of the ratios of both times.",
            (
                "mechanism",
                "mode",
                "functions",
                "cells",
                "made in, s",
                "own error",
                "largest error",
                "of",
                "pole, us, fastest",
                "median",
                "in sines",
                "torque, us, fastest",
                "median",
                "in sines",
            ),
            [
                _measure_model(name, assembly_mode, input_count, quick)
                for name, assembly_mode in STORED_CASES
            ],
        ),
        _measure_grid_models(quick),
    ]


def _measure_model(
    name: str, assembly_mode: int, input_count: int, quick: bool
) -> tuple[Cell, ...]:
    """Return a table row with the errors of a model of one input and the times of calls."""
    mechanism = _load_without_bearings(name)
    started = time.perf_counter()
    model = reduced_model(mechanism, assembly_mode=assembly_mode)
    seconds = time.perf_counter() - started
    errors = FunctionErrors()
    _compare_with_motion(errors, model, mechanism, assembly_mode, input_count)
    worst_function = errors.worst_function()
    return (
        name,
        assembly_mode,
        len(model.heading.functions),
        sum(len(group.coefficients) for group in model.groups),
        seconds,
        model.error,
        errors.relative_error(worst_function),
        worst_function,
        *_measure_calls(model, quick),
    )


def _load_without_bearings(name: str) -> Mechanism:
    """Return a shipped mechanism without bearing friction, which models cannot store."""
    mechanism = load(name)
    bearings = [load.name for load in mechanism.loads if isinstance(load, Bearings)]
    return mechanism.with_loads(without=bearings)


def _measure_grid_models(quick: bool) -> Section:
    """Measure models of mechanisms with several inputs."""
    rows: list[tuple[Cell, ...]] = []
    for name in QUICK_GRID_MECHANISMS if quick else GRID_MECHANISMS:
        mechanism = load(name)
        for link in mechanism.links:
            if link != mechanism.ground:
                tensor = np.diag([0.02, 0.03, 0.015]).tolist()
                mechanism = mechanism.with_mass(link, tensor)
        input_pairs = [item.pair for item in mechanism.inputs]
        dampers = [Damper(f"oil_{pair}", pair, 0.1) for pair in input_pairs]
        mechanism = mechanism.with_loads(*dampers)
        started = time.process_time()
        model = reduced_grid_model(mechanism)
        seconds = time.process_time() - started
        (cells,) = model.groups
        assert isinstance(cells, TensorChebyshev)
        # The torques are evaluated in the middle of the first cell.
        q = cells.bounds[0].mean(axis=0).tolist()
        rates = [0.3] * len(q)
        model.torque(q, rates, rates)
        call_times = _measure_torque_calls(model, q, rates, quick)
        rows.append(
            (
                name,
                len(cells.bounds),
                seconds,
                model.heading.covered,
                model.error,
                call_times.fastest,
                call_times.median,
                call_times.in_sines,
            )
        )
    return Section(
        "Stored functions of several inputs",
        "Shipped mechanisms with masses on all links and a damper at each input. "
        "`stored` is the stored share of the box of the ranges of the inputs. The own "
        "error is measured by the model at random inputs, relative to the largest value "
        "of each function. Times are those of single calls from Python for the torques "
        "at all inputs.",
        (
            "mechanism",
            "cells",
            "made in, s",
            "stored",
            "own error",
            "torques, us, fastest",
            "median",
            "in sines",
        ),
        rows,
    )


def _measure_torque_calls(
    model: StoredModel, q: list[float], rates: list[float], quick: bool
) -> CallTimes:
    """Return the times of a call of a model that computes the torques.

    Parameters
    ----------
    model
        A model with several inputs.
    q
        The inputs (rad).
    rates
        Their rates (rad/s), which are also taken as accelerations (rad/s2).
    quick
        Whether there are fewer rounds.
    """
    sine_ratios = []
    microseconds = []
    for _ in range(QUICK_ROUNDS if quick else ROUNDS):
        start = time.perf_counter()
        for _ in range(CALLS_PER_ROUND):
            math.sin(0.3)
        middle = time.perf_counter()
        for _ in range(CALLS_PER_ROUND):
            model.torque(q, rates, rates)
        end = time.perf_counter()
        microseconds.append(1e6 * (end - middle) / CALLS_PER_ROUND)
        sine_ratios.append((end - middle) / (middle - start))
    return CallTimes(min(microseconds), median(microseconds), median(sine_ratios))


def _measure_calls(model: StoredModel, quick: bool) -> tuple[Cell, ...]:
    """Return the times (us) of a pole and of a torque at random inputs.

    Returns
    -------
    For each of both the fastest time, the median, and the median in calls of a sine. The
    times of the torque are None if the model has no loads.
    """
    inputs = np.random.default_rng(3).uniform(0.0, 2.0 * np.pi, CALLS_PER_ROUND).tolist()
    calls: list[Callable[[float], object]] = [
        lambda q: math.sin(q),
        lambda q: model.pole("3/1", q),
    ]
    if model.heading.loads:
        calls.append(lambda q: model.torque(q, 1.0, 0.2, 0.1))
    for call in calls:
        call(0.3)
    microseconds = np.empty((QUICK_ROUNDS if quick else ROUNDS, len(calls)))
    for round_times in microseconds:
        for number, call in enumerate(calls):
            started = time.perf_counter()
            for q in inputs:
                call(q)
            seconds = time.perf_counter() - started
            round_times[number] = 1e6 * seconds / CALLS_PER_ROUND
    cells: list[Cell] = []
    sine_times = microseconds[:, 0]
    for call_times in microseconds.T[1:]:
        cells.append(float(np.min(call_times)))
        cells.append(float(np.median(call_times)))
        cells.append(float(np.median(call_times / sine_times)))
    if not model.heading.loads:
        cells += [None] * 3
    return tuple(cells)


class FunctionErrors:
    """Largest errors of functions of a model, each with the largest value of the function.

    Functions are known by their names in the table.
    """

    def __init__(self) -> None:
        self._largest_errors: dict[str, float] = {}
        self._largest_values: dict[str, float] = {}

    def note(self, name: str, expected: Floats, values: Floats) -> None:
        """Compare values of a function with expected ones of the same shape."""
        error = float(np.max(np.abs(expected - values)))
        value = float(np.max(np.abs(expected)))
        self._largest_errors[name] = max(self._largest_errors.get(name, 0.0), error)
        self._largest_values[name] = max(self._largest_values.get(name, 0.0), value)

    def relative_error(self, name: str) -> float:
        """Return the largest error of a function relative to its largest value."""
        value = self._largest_values[name]
        return self._largest_errors[name] / (value if value > ZERO_FUNCTION else 1.0)

    def worst_function(self) -> str:
        """Return the name of the function with the largest relative error."""
        return max(self._largest_errors, key=self.relative_error)


def _compare_with_motion(
    errors: FunctionErrors,
    model: StoredModel,
    mechanism: Mechanism,
    assembly_mode: int,
    input_count: int,
) -> None:
    """Compare all functions of a model with the analysis of the mechanism.

    Parameters
    ----------
    errors
        Notes the errors.
    model
        The model.
    mechanism
        The mechanism of which it is a model.
    assembly_mode
        Number of the assembly mode.
    input_count
        Number of random inputs.
    """
    position_analysis = PositionAnalysis(mechanism, assembly_mode=assembly_mode)
    inputs = np.sort(np.random.default_rng(11).uniform(0.0, 2.0 * np.pi, input_count))
    poles = {text: parse_pole(mechanism, text) for text in model.heading.poles}
    pole_request = request(
        mechanism, position_analysis.inputs[0], poles.values(), poles.values()
    )
    for q in np.array_split(inputs, max(1, input_count // INPUTS_PER_BLOCK)):
        motion = position_analysis.at(q)
        field = evaluate(motion, pole_request)
        for text, pole in poles.items():
            direction = model.pole(text, q)
            # An axis and its opposite are the same; coefficients change their signs too.
            sign = np.sign(np.sum(field.direction[pole] * direction, axis=1))
            rate = field.velocity_coefficient[pole] * sign
            rate_derivative = field.acceleration_coefficient[pole] * sign
            errors.note(f"pole {text}", field.direction[pole] * sign[:, None], direction)
            errors.note(f"rate {text}", rate, model.rate(text, q))
            errors.note(
                f"its derivative {text}", rate_derivative, model.rate_derivative(text, q)
            )
        input_variable = position_analysis.solver.input_variable
        exact = motion_by_variables(
            position_analysis.solver.closure, motion.values, [input_variable]
        )
        for number, variable in enumerate(mechanism.variable_names):
            difference = motion.values[:, number] - model.value(variable, q)
            # The chord of the difference leaves out whole revolutions. Angles are compared
            # with 1 rad.
            chord = 2.0 * np.sin(0.5 * difference)
            errors.note(variable, np.ones(len(q)), 1.0 + chord)
            slope = model.value(f"d({variable})/dq", q)
            errors.note(f"its derivative {variable}", exact.rates[:, 0, number], slope)
        if mechanism.masses:
            equivalent = inertia(mechanism, exact)
            errors.note("B", equivalent.B, model.inertia(q))
            errors.note("dB/dq", equivalent.dB, model.inertia_rate(q))
