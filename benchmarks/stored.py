"""Stored functions: their errors at random places, and the time of one evaluation."""

import math
import time
from collections.abc import Callable
from statistics import median

import numpy as np

from benchmarks.harness import Cell, Section
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

CALLS = 20
"""Calls in a round; more would outlast the turn that a busy machine gives a process."""

CASES = (("four_bar", 0), ("four_bar", 1), ("stephenson", 0))


def run(quick: bool) -> list[Section]:
    """Return the section."""
    rows: list[tuple[Cell, ...]] = []
    places = 5_000 if quick else 100_000
    for name, assembly_mode in CASES:
        started = time.perf_counter()
        model = reduced_model(_stored(name), assembly_mode=assembly_mode)
        seconds = time.perf_counter() - started
        worst, where = _worst(model, name, assembly_mode, places)
        cells = sum(len(group.coefficients) for group in model.groups)
        own = (name, assembly_mode, len(model.heading.functions), cells, seconds)
        rows.append((*own, model.error, worst, where, *_times(model, quick)))
    return [
        Section(
            "Stored functions",
            "Every function of `spherekit export --to model`: the error the model measured "
            "itself, and the largest difference from the motion's plan and the inverse "
            f"problem at {places} random inputs, each relative to its function's largest "
            "value; times of single calls from Python at random inputs, in rounds of "
            f"{CALLS} calls that alternate with rounds of as many calls of `math.sin`, and "
            "the median of the ratios to those.",
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
            rows,
        ),
        _several(quick),
    ]


def _stored(name: str) -> Mechanism:
    """Return a shipped mechanism, but for bearings that rub, which no model stores."""
    made = load(name)
    return made.with_loads(without=[x.name for x in made.loads if isinstance(x, Bearings)])


def _several(quick: bool) -> Section:
    """Return the section of models of several inputs."""
    rows: list[tuple[Cell, ...]] = []
    for name in ("two_dof_spm", "bevel_differential", *(() if quick else ("five_bar",))):
        made = load(name)
        links = [link for link in made.links if link != made.ground]
        for link in links:
            made = made.with_mass(link, np.diag([0.02, 0.03, 0.015]).tolist())
        pairs = [item.pair for item in made.inputs]
        made = made.with_loads(*(Damper(f"oil_{pair}", pair, 0.1) for pair in pairs))
        started = time.process_time()
        model = reduced_grid_model(made)
        seconds = time.process_time() - started
        (cells,) = model.groups
        assert isinstance(cells, TensorChebyshev)
        row = cells.bounds[0].mean(axis=0).tolist()
        rates = [0.3] * len(row)
        model.torque(row, rates, rates)
        ratios, times = [], []
        for _ in range(200 if quick else 5000):
            started = time.perf_counter()
            for _ in range(CALLS):
                math.sin(0.3)
            between = time.perf_counter()
            for _ in range(CALLS):
                model.torque(row, rates, rates)
            times.append(1e6 * (time.perf_counter() - between) / CALLS)
            ratios.append(times[-1] * CALLS / (1e6 * (between - started)))
        figures = (len(cells.bounds), seconds, model.heading.covered, model.error)
        rows.append((name, *figures, min(times), median(times), median(ratios)))
    return Section(
        "Stored functions of several inputs",
        "Each shipped mechanism with masses on all links and a damper at each input: the "
        "part of the box of the inputs' ranges that is stored, the error the model "
        "measured at random places of it, relative to each function's largest value, and "
        "the time of single calls from Python for the torques at all inputs.",
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


def _times(model: StoredModel, quick: bool) -> list[float | None]:
    """Return the fastest and the median time (us) of each call, and in calls of a sine."""
    places = np.random.default_rng(3).uniform(0.0, 2.0 * np.pi, CALLS).tolist()
    calls: list[Callable[[float], object]] = [
        lambda x: math.sin(x),
        lambda x: model.pole("3/1", x),
    ]
    if model.heading.loads:
        calls.append(lambda x: model.torque(x, 1.0, 0.2, 0.1))
    for call in calls:
        call(0.3)
    found = np.empty((200 if quick else 5000, len(calls)))
    for row in found:
        for number, call in enumerate(calls):
            started = time.perf_counter()
            for x in places:
                call(x)
            row[number] = 1e6 * (time.perf_counter() - started) / CALLS
    parts: list[float | None] = []
    for own in found.T[1:]:
        ratio = float(np.median(own / found[:, 0]))
        parts += [float(np.min(own)), float(np.median(own)), ratio]
    return parts + [None] * (6 - len(parts))


def _worst(
    model: StoredModel, name: str, assembly_mode: int, count: int
) -> tuple[float, str]:
    """Return the largest error of all functions, and whose it is."""
    mechanism = _stored(name)
    tracer = PositionAnalysis(mechanism, assembly_mode=assembly_mode)
    x = np.sort(np.random.default_rng(11).uniform(0.0, 2.0 * np.pi, count))
    poles = {text: parse_pole(mechanism, text) for text in model.heading.poles}
    wanted = request(mechanism, tracer.inputs[0], poles.values(), poles.values())
    errors: dict[str, float] = {}
    largest: dict[str, float] = {}

    def note(key: str, want: np.ndarray, found: np.ndarray) -> None:
        errors[key] = max(errors.get(key, 0.0), float(np.max(np.abs(want - found))))
        largest[key] = max(largest.get(key, 0.0), float(np.max(np.abs(want))))

    for q in np.array_split(x, max(1, count // 5000)):
        motion = tracer.at(q)
        field = evaluate(motion, wanted)
        for text, pole in poles.items():
            found = model.pole(text, q)
            side = np.sign(np.sum(field.direction[pole] * found, axis=1))
            note(f"pole {text}", field.direction[pole] * side[:, None], found)
            note(
                f"rate {text}", field.velocity_coefficient[pole] * side, model.rate(text, q)
            )
            change = model.rate_derivative(text, q)
            note(
                f"its derivative {text}",
                field.acceleration_coefficient[pole] * side,
                change,
            )
        single = tracer.solver.input_variable
        exact = motion_by_variables(tracer.solver.closure, motion.values, [single])
        for number, variable in enumerate(mechanism.variable_names):
            turned = 2.0 * np.sin(
                0.5 * (motion.values[:, number] - model.value(variable, q))
            )
            note(variable, np.ones(len(q)), 1.0 + turned)
            slope = model.value(f"d({variable})/dq", q)
            note(f"its derivative {variable}", exact.rates[:, 0, number], slope)
        if mechanism.masses:
            masses = inertia(mechanism, exact)
            note("B", masses.B, model.inertia(q))
            note("dB/dq", masses.dB, model.inertia_rate(q))
    sizes = {key: size if size > 1e-9 else 1.0 for key, size in largest.items()}
    where = max(errors, key=lambda key: errors[key] / sizes[key])
    return errors[where] / sizes[where], where
