"""How far the errors that spherekit states for its rows hold, and how wide they are."""

from dataclasses import dataclass, field
from typing import final

import numpy as np
from mechanism_examples.special_mechanisms import special_mechanism

from spherekit.errors import SpherekitError
from spherekit.geometry.rotation import Floats
from spherekit.planning.pole_plan import all_poles
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.proof.ball_frames import exact_balls
from spherekit.proof.balls import MIN_DIGITS, Digits, centre_floats
from spherekit.proof.decimal_mechanism import read_decimals
from spherekit.proof.reference_rows import exact_direction, exact_field, exact_rows_by_input
from spherekit.status import Status
from spherekit.velocities.pole_evaluation import evaluate
from spherekit.velocities.pole_request import request

TINY = 1e-300


KINDS = ("configurations", "directions", "rates", "derivatives", "direction derivatives")
"""What errors are stated of."""


@final
@dataclass
class Stated:
    """Errors and what is stated for them: of configurations and of the rows of poles.

    Per kind of `KINDS` an error and a bound for each number judged. `rows` (one per
    configuration and input that moves) and `numbers` (poles times rows) that are OK were
    looked at; of the rows `marked` have another status, and `unknown` no reference; `many`
    were judged in 50 digits. `silent` numbers are NaN in rows that are OK.
    """

    error: dict[str, list[Floats]] = field(default_factory=lambda: {k: [] for k in KINDS})
    bound: dict[str, list[Floats]] = field(default_factory=lambda: {k: [] for k in KINDS})
    rows: int = 0
    numbers: int = 0
    marked: int = 0
    unknown: int = 0
    many: int = 0
    silent: int = 0

    def of(self, kind):
        """Return errors (n,) and bounds (n,) of a kind."""
        nothing = [np.empty(0)]
        error, bound = self.error[kind] or nothing, self.bound[kind] or nothing
        return np.concatenate(error), np.concatenate(bound)

    def parts(self, kind):
        """Return (n,) errors over their bounds."""
        error, bound = self.of(kind)
        return error / np.maximum(bound, TINY)

    def add(self, other):
        """Count another one's numbers too."""
        for kind in KINDS:
            self.error[kind] += other.error[kind]
            self.bound[kind] += other.bound[kind]
        for name in ("rows", "numbers", "marked", "unknown", "many", "silent"):
            setattr(self, name, getattr(self, name) + getattr(other, name))


def judge_bounds(made, path, **how):
    """Check that all numbers of rows that are OK have bounds, and keep to them.

    Parameters
    ----------
    made, path
        A mechanism, and its inputs (n, inputs) in rad.
    how
        Options of `stated`.

    Returns
    -------
    Stated
        The errors and bounds, without any if the mechanism can be assembled nowhere.
    """
    try:
        position_analysis = PositionAnalysis(made, path=path)
    except SpherekitError:  # arcs that close nowhere
        return Stated()
    with np.errstate(all="ignore"):
        found = stated(position_analysis, **how)
    assert found.silent == found.unknown == 0
    for kind in KINDS:
        assert np.all(found.parts(kind) <= 1.0), kind
    return found


def judged_special(seed):
    """Return the family of a seed, and what is stated for its mechanism."""
    family, made, path = special_mechanism(seed)
    found = Stated()
    try:
        tracer = PositionAnalysis(made, path=path)
    except SpherekitError:
        return family, found
    with np.errstate(all="ignore"):
        found.add(stated(tracer, as_written=True, every=50))
    return family, found


def stated(tracer, as_written=False, every=0):
    """Return errors and statements of the rows that are OK and have a reference.

    With `as_written` they are judged a second time, by the decimal numbers of a file; of
    `every` so many rows one is judged in 50 digits in any case.
    """
    motion = tracer.motion()
    made = motion.mechanism
    poles = all_poles(len(made.links))
    found = Stated()
    for driven in motion.assembly.inputs:
        wanted = request(
            made, made.pairs[driven].name, poles, poles, by_rank=tracer.by_rank
        )
        poled = evaluate(motion, wanted)
        good = poled.status == Status.OK
        found.marked += int(np.sum(~good))
        found.silent += _silent(poled, good)
        if not np.any(good):
            continue
        found.rows += int(np.sum(good))
        found.numbers += int(np.sum(good)) * len(poles)
        for written in (False, True):
            # Rows by decimals are not those of the float64 numbers.
            judged = good & poled.is_decimal if written else good & ~poled.is_decimal
            judged = good if written and as_written else judged
            if np.any(judged):
                _judge(found, motion, poled, wanted, judged, (driven, written, every))
    return found


def _silent(field, good):
    """Return how many numbers of rows that are OK are missing."""
    count = 0
    for pole, codes in field.pole_status.items():
        known = good & (codes == Status.OK)
        rest = good & (codes == Status.NO_POLE)
        for values in (
            field.velocity_coefficient,
            field.acceleration_coefficient,
            field.velocity_coefficient_error,
            field.acceleration_coefficient_error,
        ):
            count += int(np.sum(~np.isfinite(values[pole]) & known))
        count += int(np.sum(~np.isfinite(field.velocity_coefficient_error[pole]) & rest))
        count += int(np.sum(~np.isfinite(field.direction_error[pole]) & known))
        turned = np.isfinite(field.direction_dq[pole][:, 0])
        count += int(np.sum(turned & ~np.isfinite(field.direction_dq_error[pole])))
    return count


def _judge(found, motion, field, wanted, good, how):
    driven, written, every = how
    errors, bounds, known = _compared(
        motion, field, wanted, good, (driven, written), Digits(MIN_DIGITS)
    )
    doubtful = ~known
    for kind in KINDS:
        beside = errors[kind] > 0.5 * bounds[kind]
        doubtful |= np.any(beside.reshape(-1, len(known)), axis=0)
    if every:
        doubtful[(found.rows + int(written)) % every :: every] = True
    if np.any(doubtful):
        rows = np.zeros(len(motion), dtype=bool)
        rows[np.flatnonzero(good)[doubtful]] = True
        better, _, sure = _compared(
            motion, field, wanted, rows, (driven, written), Digits(50)
        )
        for kind in KINDS:
            errors[kind][..., doubtful] = better[kind]
        known[doubtful] = sure
        found.many += int(np.sum(doubtful))
    found.unknown += int(np.sum(~known))
    for kind in KINDS:
        stands = known & np.isfinite(errors[kind]) & ~np.isnan(bounds[kind])
        found.error[kind].append(errors[kind][stands])
        found.bound[kind].append(bounds[kind][stands])


def _compared(motion, field, wanted, rows, which, numbers):
    """Return errors and bounds by kind, (rows,) or (poles, rows), and which rows stand."""
    driven, written = which
    with numbers.within():
        frames = read_decimals(motion.mechanism).revolute_frames() if written else None
        inputs = exact_balls(motion.inputs[rows])
    (exact,) = exact_rows_by_input(
        motion, rows, (driven,), numbers, inputs=inputs, frames=frames
    )
    given = field.rows(rows)
    nearest = exact_field(exact, wanted, given)
    poles = list(given.direction)
    with numbers.within():
        ways = [
            centre_floats(exact_direction(exact, p, u) - u)
            for p, u in given.direction.items()
        ]
    errors = {
        "configurations": exact.distance,
        "directions": [np.linalg.norm(way, axis=1) for way in ways],
    }
    bounds = {
        "configurations": motion.configuration_error[rows],
        "directions": [given.direction_error[pole] for pole in poles],
    }
    for kind, name in (
        ("rates", "velocity_coefficient"),
        ("derivatives", "acceleration_coefficient"),
    ):
        own, right = getattr(given, name), getattr(nearest, name)
        errors[kind] = [np.abs(own[pole] - right[pole]) for pole in poles]
        bounds[kind] = [getattr(given, f"{name}_error")[pole] for pole in poles]
    own, right = given.direction_dq, nearest.direction_dq
    errors["direction derivatives"] = [
        np.linalg.norm(own[pole] - right[pole], axis=1) for pole in poles
    ]
    bounds["direction derivatives"] = [given.direction_dq_error[pole] for pole in poles]
    rounding = 10.0 * numbers.eps * exact.condition**2  # of the reference itself
    judged = {k: np.maximum(np.array(v) - rounding, 0.0) for k, v in errors.items()}
    stated = {kind: np.array(values) for kind, values in bounds.items()}
    return judged, stated, exact.status == Status.OK
