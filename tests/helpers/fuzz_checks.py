"""Random mechanisms against the velocity equations: no wrong value without a status."""

import warnings
from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from mechanism_examples.random_mechanisms import random_mechanism
from oracles.velocity_equations import link_rates

from spherekit.errors import CountError, PlanError, SpherekitError
from spherekit.mechanism.joint import revolute
from spherekit.planning.assembly_plan import plan_assembly
from spherekit.planning.pole_plan import all_poles
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.status import Status
from spherekit.tolerances import EPS
from spherekit.velocities.pole_evaluation import evaluate
from spherekit.velocities.pole_request import request

SAMPLES = 3
TOLERANCE = 1e-9
"""Deviation (rad, or relative to the largest rate) that is right without a bound."""
BOUND = 10.0
"""How many times its own reported bound a direction may deviate."""
CONDITIONED = 100.0
"""How many times roundoff times conditioning a value may deviate."""
SPREAD = 10.0
"""How many times as much as it changes when links turn by their misses."""
DETERMINED = 1e-13
"""Singular values below this part of the largest leave a motion undetermined."""
LIMBER = 1e-3
"""Flatter equations may make a value uncertain by more than the above."""
CLOSED = 1e-10
"""Largest miss of a pair (rad) that is closed."""
MOST_LINKS_BY_RANK = 7
"""Mechanisms of more links that the count of freedoms refuses are not tried by rank."""


@dataclass
class Tally:
    """What became of the rows of many mechanisms."""

    mechanisms: Counter[str] = field(default_factory=Counter)
    rows: Counter[str] = field(default_factory=Counter)
    poles: Counter[str] = field(default_factory=Counter)
    wrong: list[str] = field(default_factory=list)
    worst: dict[str, float] = field(default_factory=dict)

    def note(self, what, deviation):
        """Keep the largest deviation of a kind."""
        self.worst[what] = max(self.worst.get(what, 0.0), deviation)


def sweep(seeds):
    """Return what became of the mechanisms of these seeds."""
    tally = Tally()
    for seed in seeds:
        try:
            _judge_seed(seed, tally)
        except Exception as error:  # whatever is not a refusal is to be found here
            tally.mechanisms["fault"] += 1
            tally.wrong.append(f"seed {seed}: {type(error).__name__}: {error}")
    return tally


def _judge_seed(seed, tally):
    _, made = random_mechanism(seed)
    try:
        if len(made.links) > MOST_LINKS_BY_RANK:
            plan_assembly(made)
        with warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)
            tracer = PositionAnalysis(made, search=False, samples=SAMPLES, assembly_mode=0)
            motion = tracer.motion()
            poles = all_poles(len(made.links))
            fields = {}
            for pair in motion.assembly.inputs:
                given = tracer.mechanism, made.pairs[pair].name, poles, poles
                wanted = request(*given, by_rank=tracer.by_rank)
                fields[pair] = evaluate(motion, wanted)
    except CountError:
        tally.mechanisms["refused: count"] += 1
        return
    except PlanError:
        tally.mechanisms["refused: plan"] += 1
        return
    except SpherekitError as error:
        tally.mechanisms[f"refused: {type(error).__name__}"] += 1
        return
    tally.mechanisms["evaluated"] += 1
    for pair, found in fields.items():
        faults = judge(motion, found, pair, tally)
        tally.wrong += [f"seed {seed}: input {made.pairs[pair].name}: {x}" for x in faults]


def judge(motion, found, moved, tally):
    """Return what is wrong with a field, in words, and count its rows and poles."""
    made = motion.mechanism
    faults = _not_nan(motion, found)
    held = ~motion.failed
    for name in (Status(code).name for code in found.status):
        tally.rows[name] += 1
    if not np.any(held):
        return faults
    rows = np.flatnonzero(held)
    w, dw, values, over, free, missed = link_rates(
        made, motion.rotations[held], motion.assembly.inputs, moved
    )
    for k in np.flatnonzero(~(missed < CLOSED)).tolist():
        faults.append(f"row {rows[k]}: a pair misses by {missed[k]:.1e}")
    faults += _inputs_differ(motion, rows)
    for k, row in enumerate(rows.tolist()):
        if found.status[row] == Status.OK:
            least = (0.0, 0.0)
            here = _judge_row(found, row, w[k], dw[k], values[k], over[k], least, tally)
            if here and values[k, -1] < LIMBER * values[k, 0]:
                least = _spread(motion, row, moved)
                here = _judge_row(found, row, w[k], dw[k], values[k], over[k], least, tally)
            faults += here
        else:
            faults += _judge_directions(found, row, free[k], tally)
    return faults


def _spread(motion, row, moved):
    """Return how much w and dw change while links turn as little as variables are off.

    The configuration is known no better than that, whatever is computed from it: rows in
    more digits close the loops first.
    """
    random = np.random.default_rng(0)
    size = max(EPS, float(motion.residual[row]), float(motion.configuration_error[row]))
    exact = motion.rotations[row][None]
    noise = size * random.normal(size=(8, *exact.shape[1:2], 3))
    noise[0] = noise[:, 0] = 0.0
    turned = exact + np.cross(noise[:, :, None], np.swapaxes(exact, 2, 3)).swapaxes(2, 3)
    w, dw, *_ = link_rates(motion.mechanism, turned, motion.assembly.inputs, moved)
    return float(np.max(np.abs(w - w[0]))), float(np.max(np.abs(dw - dw[0])))


def _not_nan(motion, found):
    """Return which failed rows hold a number."""
    faults = []
    failed, unknown = motion.failed, found.status != Status.OK
    for name, values, empty in (
        ("values", motion.values, failed),
        ("rotations", motion.rotations, failed),
        *((f"direction {p}", v, failed) for p, v in found.direction.items()),
        *((f"rate {p}", v, unknown) for p, v in found.velocity_coefficient.items()),
        *(
            (f"acceleration_coefficient {p}", v, unknown)
            for p, v in found.acceleration_coefficient.items()
        ),
        *((f"w {k}", v, unknown) for k, v in found.w.items()),
        *((f"dw {k}", v, unknown) for k, v in found.dw.items()),
    ):
        if np.any(np.isfinite(values[empty])):
            faults.append(f"{name}: a failed row holds a number")
        if name.startswith(("w ", "dw ", "values")) and not np.all(
            np.isfinite(values[~empty])
        ):
            faults.append(f"{name}: a row that is OK holds NaN")
    return faults


def _inputs_differ(motion, rows):
    """Return which rows are not at the input that they say."""
    faults = []
    for column, pair in enumerate(motion.assembly.inputs):
        joint = revolute(motion.joints[pair])
        a, b = motion.mechanism.ends[pair]
        first = motion.rotations[rows, a] @ joint.first
        second = motion.rotations[rows, b] @ joint.second
        along, across = (np.sum(second[:, :, 0] * first[:, :, k], axis=1) for k in (0, 1))
        miss = np.arctan2(across, along) - motion.inputs[rows, column]
        miss = np.abs(np.remainder(miss + np.pi, 2 * np.pi) - np.pi)
        faults += [
            f"row {rows[k]}: input off by {miss[k]:.1e}"
            for k in np.flatnonzero(~(miss < CLOSED))
        ]
    return faults


def _judge_row(found, row, w, dw, values, over, spread, tally):
    flat = values[-1] / values[0]
    if flat < DETERMINED:
        return [f"row {row}: OK, but the motion is not determined ({flat:.1e})"]
    scale = max(1.0, float(np.max(np.linalg.norm(w, axis=1))))
    if not over < scale * max(TOLERANCE, CONDITIONED * EPS / flat):
        return [f"row {row}: OK, but the pairs cannot move so ({over:.1e})"]
    faults = []
    steep = max(scale**2, float(np.max(np.linalg.norm(dw, axis=1))))
    least = max(TOLERANCE, CONDITIONED * EPS / flat)
    allowed = max(least, SPREAD * spread[0] / scale)
    allowed_rate = max(least, SPREAD * spread[1] / steep)

    def compare(what, deviation, limit):
        if not deviation <= limit:
            faults.append(
                f"row {row}: {what} off by {deviation:.1e}, allowed {limit:.1e}, flat "
                f"{flat:.1e}, equations {bool(found.is_quad_precision[row])}"
            )
        elif flat > 1e-6:
            tally.note(what.split(" ")[0], deviation)

    for link in found.w:
        compare(f"w {link}", _length(found.w[link][row] - w[link]) / scale, allowed)
        compare(f"dw {link}", _length(found.dw[link][row] - dw[link]) / steep, allowed_rate)
    for pole in found.direction:
        i, j = pole
        vector, change = w[j] - w[i], dw[j] - dw[i]
        size = _length(vector)
        status = Status(found.pole_status[pole][row])
        direction, rate = found.direction[pole][row], found.velocity_coefficient[pole][row]
        tally.poles[status.name] += 1
        if status == Status.NO_POLE:
            compare(f"standing {pole}", size / scale, max(1e-6, allowed))
        elif status == Status.ILL_CONDITIONED:
            if np.any(np.isfinite(direction)):
                faults.append(f"row {row}: {pole} is ill-conditioned, but given")
        elif status == Status.OK:
            if not np.all(np.isfinite(direction)):
                faults.append(f"row {row}: {pole} is OK, but not a number")
                continue
            compare(f"rate {pole}", _length(rate * direction - vector) / scale, allowed)
            across = _length(np.cross(direction, vector)) / scale
            bound = found.direction_error[pole][row] * BOUND * size / scale
            compare(f"direction {pole}", across, max(allowed, bound))
            along = found.acceleration_coefficient[pole][row] - change @ direction
            # A direction may deviate by its bound, and the derivative with it.
            limit = allowed_rate + BOUND * found.direction_error[pole][row]
            compare(f"acceleration_coefficient {pole}", abs(along) / steep, limit)
            length = _length(direction)
            compare(f"length {pole}", abs(length - 1.0), 1e-12)
        else:
            faults.append(f"row {row}: {pole} is {status.name}, its row is OK")
    return faults


def _judge_directions(found, row, free, tally):
    """Judge the directions at a dead centre, where only the motion's scale is unknown."""
    _, values, right = np.linalg.svd(free)
    full = len(values) == free.shape[1]
    gap = values[-2] / values[0] if full else 0.0
    # Loops that close in one place only have no exact motion, but this close to one.
    unsolved = values[-1] / values[-2] if full else 0.0
    faults = []
    w = np.concatenate([np.zeros(3), right[-1]]).reshape(-1, 3)
    for pole, directions in found.direction.items():
        direction = directions[row]
        if not np.all(np.isfinite(direction)):
            continue
        vector = w[pole[1]] - w[pole[0]]
        tally.poles["direction alone"] += 1
        limit = max(TOLERANCE, CONDITIONED * EPS / max(gap, EPS), SPREAD * unsolved)
        limit = max(limit, BOUND * found.direction_error[pole][row] * _length(vector))
        across = _length(np.cross(direction, vector))
        if not across <= limit:
            faults.append(
                f"row {row}: direction alone {pole} off by {across:.1e}, allowed "
                f"{limit:.1e}, gap {gap:.1e}"
            )
    return faults


def _length(vector):
    return float(np.linalg.norm(vector))
