"""Stored functions: their errors at random places, and the time of one evaluation."""

import time
from collections.abc import Callable

import numpy as np

from benchmarks.report import Cell, Section
from spherekit.dynamics.inertia import inertia
from spherekit.dynamics.kinematics import by_arc_length
from spherekit.dynamics.offline import online_model
from spherekit.dynamics.online import OnlineModel
from spherekit.files.read import load
from spherekit.motion.motion import Tracer
from spherekit.planning.poles import parse_pole
from spherekit.rates.field import evaluate
from spherekit.rates.request import request

CASES = (("four_bar", 0), ("four_bar", 1), ("stephenson", 0))


def run(quick: bool) -> list[Section]:
    """Return the section."""
    rows: list[tuple[Cell, ...]] = []
    for name, branch in CASES:
        started = time.perf_counter()
        model = online_model(load(name), branch=branch)
        seconds = time.perf_counter() - started
        worst, where = _worst(model, name, branch, 5_000 if quick else 100_000)
        calls: list[Callable[[], object]] = [lambda m=model: m.pole("3/1", 0.3)]  # type: ignore[misc]
        if model.heading.loads:
            calls.append(lambda m=model: m.torque(0.3, 1.0, 0.2, 0.1))  # type: ignore[misc]
        times = [_times(call) for call in calls]
        pole, torque = times[0], times[1] if len(times) > 1 else (None, None)
        cells = sum(len(group.coefficients) for group in model.groups)
        own = (name, branch, len(model.heading.functions), cells, seconds)
        rows.append((*own, model.error, worst, where, *pole, *torque))
    return [
        Section(
            "Stored functions",
            "Every function of `spherekit export --to model`: the error the model measured "
            "itself, and the largest difference from the motion's plan and the inverse "
            f"problem at {5_000 if quick else 100_000} random inputs, each relative to its "
            "function's largest value; times of single calls from Python.",
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
                "torque, us, fastest",
                "median",
            ),
            rows,
        )
    ]


def _times(call: Callable[[], object]) -> tuple[float, float]:
    call()
    found = []
    for _ in range(40):
        started = time.perf_counter()
        for _ in range(500):
            call()
        found.append((time.perf_counter() - started) / 500)
    return 1e6 * min(found), 1e6 * float(np.median(found))


def _worst(model: OnlineModel, name: str, branch: int, count: int) -> tuple[float, str]:
    """Return the largest error of all functions, and whose it is."""
    mechanism = load(name)
    tracer = Tracer(mechanism, branch=branch)
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
            note(f"rate {text}", field.rate[pole] * side, model.rate(text, q))
            change = model.rate_derivative(text, q)
            note(f"its derivative {text}", field.rate_dq[pole] * side, change)
        single = tracer.solver.single
        exact = by_arc_length(tracer.solver.closure, motion.values).by_variable(single)
        for number, variable in enumerate(mechanism.variable_names):
            turned = 2.0 * np.sin(
                0.5 * (motion.values[:, number] - model.value(variable, q))
            )
            note(variable, np.ones(len(q)), 1.0 + turned)
            slope = model.value(f"d({variable})/dq", q)
            note(f"its derivative {variable}", exact.rates[:, number], slope)
        if mechanism.masses:
            masses = inertia(mechanism, exact)
            note("B", masses.B, model.inertia(q))
            note("dB/dq", masses.dB, model.inertia_rate(q))
    sizes = {key: size if size > 1e-9 else 1.0 for key, size in largest.items()}
    where = max(errors, key=lambda key: errors[key] / sizes[key])
    return errors[where] / sizes[where], where
