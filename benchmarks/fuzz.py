"""Random mechanisms against the velocity equations: no wrong value without a status.

`python -m benchmarks.fuzz 0 100000` judges the mechanisms of these seeds and prints every
wrong one, so that a sweep can be divided, stopped and gone on with.
"""

import argparse
import sys
import time
import warnings
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from benchmarks.random_mechanisms import random_mechanism
from benchmarks.report import Section
from benchmarks.samples import link_rates
from spherekit.conventions import EPS, Status
from spherekit.errors import CountError, PlanError, SpherekitError
from spherekit.model.joints import revolute
from spherekit.motion.motion import Motion, Tracer
from spherekit.planning.assembly import plan_assembly
from spherekit.planning.poles import all_poles
from spherekit.rates.field import evaluate
from spherekit.rates.pole_field import PoleField
from spherekit.rates.request import request

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

    def note(self, what: str, deviation: float) -> None:
        """Keep the largest deviation of a kind."""
        self.worst[what] = max(self.worst.get(what, 0.0), deviation)


def run(quick: bool) -> list[Section]:
    """Return what became of the mechanisms of the first seeds."""
    count = 200 if quick else 3000
    started = time.perf_counter()
    tally = sweep(range(count))
    seconds = time.perf_counter() - started
    kinds = [("mechanisms", tally.mechanisms), ("rows", tally.rows), ("poles", tally.poles)]
    rows = [
        (what, name, number) for what, counted in kinds for name, number in counted.items()
    ]
    return [
        Section(
            "Random mechanisms against the velocity equations",
            f"The mechanisms of the seeds 0 to {count - 1}, {SAMPLES} samples each: dyads, "
            "triads, eight-bars, random chains, contacts and graphs of any kind, half of "
            "them with axes made parallel, opposite, coplanar or special. Every pole, "
            "coefficient and derivative is compared with the velocity equations and their "
            f"derivative, solved by least squares; it is right within {TOLERANCE:g}, "
            f"{BOUND:g} times its bound or {CONDITIONED:g} times roundoff times the "
            "condition of the equations.",
            ("of", "are", "number"),
            rows,
            f"{len(tally.wrong)} wrong values without a status, "
            f"{1e3 * seconds / count:.0f} ms a mechanism.",
        )
    ]


def sweep(seeds: Iterable[int]) -> Tally:
    """Return what became of the mechanisms of these seeds."""
    tally = Tally()
    for seed in seeds:
        try:
            _judge_seed(seed, tally)
        except Exception as error:  # whatever is not a refusal is to be found here
            tally.mechanisms["fault"] += 1
            tally.wrong.append(f"seed {seed}: {type(error).__name__}: {error}")
    return tally


def _judge_seed(seed: int, tally: Tally) -> None:
    _, made = random_mechanism(seed)
    try:
        if len(made.links) > MOST_LINKS_BY_RANK:
            plan_assembly(made)
        with warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)
            tracer = Tracer(made, search=False, samples=SAMPLES, assembly_mode=0)
            motion = tracer.motion()
            poles = all_poles(len(made.links))
            fields = {
                pair: evaluate(
                    motion,
                    request(
                        tracer.mechanism,
                        made.pairs[pair].name,
                        poles,
                        poles,
                        by_rank=tracer.by_rank,
                    ),
                )
                for pair in motion.assembly.inputs
            }
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


def judge(motion: Motion, found: PoleField, moved: int, tally: Tally) -> list[str]:
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


def _spread(motion: Motion, row: int, moved: int) -> tuple[float, float]:
    """Return how much w and dw change while links turn as little as pairs miss.

    The configuration is known no better than that, whatever is computed from it.
    """
    random = np.random.default_rng(0)
    size = max(EPS, float(motion.residual[row]))
    exact = motion.rotations[row][None]
    noise = size * random.normal(size=(8, *exact.shape[1:2], 3))
    noise[0] = noise[:, 0] = 0.0
    turned = exact + np.cross(noise[:, :, None], np.swapaxes(exact, 2, 3)).swapaxes(2, 3)
    w, dw, *_ = link_rates(motion.mechanism, turned, motion.assembly.inputs, moved)
    return float(np.max(np.abs(w - w[0]))), float(np.max(np.abs(dw - dw[0])))


def _not_nan(motion: Motion, found: PoleField) -> list[str]:
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


def _inputs_differ(motion: Motion, rows: Any) -> list[str]:
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


def _judge_row(
    found: PoleField,
    row: int,
    w: Any,
    dw: Any,
    values: Any,
    over: float,
    spread: tuple[float, float],
    tally: Tally,
) -> list[str]:
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

    def compare(what: str, deviation: float, limit: float) -> None:
        if not deviation <= limit:
            faults.append(
                f"row {row}: {what} off by {deviation:.1e}, allowed {limit:.1e}, flat "
                f"{flat:.1e}, equations {bool(found.by_equations[row])}"
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
            bound = found.error[pole][row] * BOUND * size / scale
            compare(f"direction {pole}", across, max(allowed, bound))
            along = found.acceleration_coefficient[pole][row] - change @ direction
            # A direction may deviate by its bound, and the derivative with it.
            limit = allowed_rate + BOUND * found.error[pole][row]
            compare(f"acceleration_coefficient {pole}", abs(along) / steep, limit)
            length = _length(direction)
            compare(f"length {pole}", abs(length - 1.0), 1e-12)
        else:
            faults.append(f"row {row}: {pole} is {status.name}, its row is OK")
    return faults


def _judge_directions(found: PoleField, row: int, free: Any, tally: Tally) -> list[str]:
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
        limit = max(limit, BOUND * found.error[pole][row] * _length(vector))
        across = _length(np.cross(direction, vector))
        if not across <= limit:
            faults.append(
                f"row {row}: direction alone {pole} off by {across:.1e}, allowed "
                f"{limit:.1e}, gap {gap:.1e}"
            )
    return faults


def _length(vector: Any) -> float:
    return float(np.linalg.norm(vector))


def main() -> int:
    """Judge the mechanisms of a range of seeds."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.fuzz")
    parser.add_argument("first", type=int, help="the first seed")
    parser.add_argument("last", type=int, help="the seed after the last one")
    options = parser.parse_args()
    started = time.process_time()
    total = Tally()
    for first in range(options.first, options.last, 500):
        last = min(first + 500, options.last)
        part = sweep(range(first, last))
        for kept, new in (
            (total.mechanisms, part.mechanisms),
            (total.rows, part.rows),
            (total.poles, part.poles),
        ):
            kept.update(new)
        total.wrong += part.wrong
        for what, deviation in part.worst.items():
            total.note(what, deviation)
        print(f"seeds {first} to {last - 1}: {len(part.wrong)} wrong", file=sys.stderr)
        for fault in part.wrong:
            print(fault, flush=True)
    seconds = time.process_time() - started
    print(f"{seconds:.0f} s of processor time")
    for counted in (total.mechanisms, total.rows, total.poles):
        print(", ".join(f"{name}: {count}" for name, count in sorted(counted.items())))
    print(", ".join(f"{name}: {x:.1e}" for name, x in sorted(total.worst.items())))
    print(f"{len(total.wrong)} wrong values without a status")
    return 1 if total.wrong else 0


if __name__ == "__main__":
    sys.exit(main())
