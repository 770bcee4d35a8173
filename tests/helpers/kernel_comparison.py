"""Rows that a kernel gives at once, and the same rows found one by one with care."""

from dataclasses import dataclass
from unittest.mock import patch

import numpy as np

from spherekit.files.study import Study
from spherekit.planning.pole_plan import all_poles
from spherekit.positions.motion import Motion
from spherekit.runs import batch_runner
from spherekit.runs.sampling import make_sampling
from spherekit.status import Status
from spherekit.velocities.direction_signs import SignContinuation
from spherekit.velocities.pole_evaluation import evaluate
from spherekit.velocities.pole_field import PoleField
from spherekit.velocities.pole_request import request

TURN = 2.0 * np.pi


@dataclass(frozen=True)
class KernelAndReference:
    """A motion and its poles for each input, by a kernel and with care."""

    quick: Motion
    by_kernel: tuple[PoleField, ...]
    careful: Motion
    with_care: tuple[PoleField, ...]


@dataclass
class Differences:
    """What differs: statuses, and the names of what is beyond the bounds of both.

    `share` of the rows is by the kernel.
    """

    share: float
    statuses: int
    beyond: list[str]

    @property
    def none(self):
        """Whether nothing differs."""
        return not self.statuses and not self.beyond


def evaluate_both_ways(made, **options):
    """Return all poles both ways, None where there is no kernel; see `Study`."""
    with patch.object(batch_runner, "MIN_KERNEL_ROWS", 0):
        course = make_sampling(Study(made.name, made, search=False, **options))
        tracer = course.position_analysis
        every = all_poles(len(made.links))
        wanted = [
            request(tracer.mechanism, pair, every, every, by_rank=tracer.by_rank)
            for pair in tracer.inputs
        ]
        quick = batch_runner.BatchRunner.prepare(course, wanted, is_recorded=False)
        if quick is None:
            return None
        (motion,) = quick.blocks(len(course))
        fields = quick.fields(motion, [SignContinuation() for _ in wanted])
        found = tuple(field.as_arrays for field in fields)
    (careful,) = course.blocks(len(course))
    return KernelAndReference(
        motion, found, careful, tuple(evaluate(careful, x) for x in wanted)
    )


def find_differences(ways, same_signs=True):
    """Return what differs; senses of directions are not compared without `same_signs`."""
    quick, careful = ways.quick, ways.careful
    share = float(np.mean([np.mean(field.is_certified) for field in ways.by_kernel]))
    found = Differences(share, int(np.sum(quick.status != careful.status)), [])
    good = (quick.status == Status.OK) & (careful.status == Status.OK)
    apart = quick.values - careful.values
    apart -= TURN * np.round(apart / TURN)
    off = quick.configuration_error + careful.configuration_error
    _judge(found, "configurations", np.max(np.abs(apart), axis=1)[good], off[good])
    turned = np.max(np.abs(quick.rotations - careful.rotations), axis=(1, 2, 3))
    _judge(found, "orientations", turned[good], np.full(len(off), 1e-9)[good])
    for one, other in zip(ways.by_kernel, ways.with_care, strict=True):
        found.statuses += int(np.sum(one.status != other.status))
        for pole in other.direction:
            _compare_pole(found, one, other, pole, good, same_signs)
    return found


def _compare_pole(found, quick, careful, pole, good, same_signs):
    found.statuses += int(np.sum(quick.pole_status[pole] != careful.pole_status[pole]))
    bound = careful.velocity_coefficient_error[pole]
    # Of what stands still the sign is rounding.
    stands = np.abs(careful.velocity_coefficient[pole]) <= bound
    stands |= not same_signs
    sense = np.sum(careful.direction[pole] * quick.direction[pole], axis=1)
    sense = np.where(stands & (sense < 0.0), -1.0, 1.0)
    for name, errors in (
        ("direction", "direction_error"),
        ("velocity_coefficient", "velocity_coefficient_error"),
        ("acceleration_coefficient", "acceleration_coefficient_error"),
    ):
        one, other = (getattr(field, name)[pole] for field in (quick, careful))
        known = np.isfinite(other.reshape(len(other), -1)[:, 0])
        size = np.linalg.norm(np.atleast_2d(one.T * sense - other.T), axis=0)
        allowed = getattr(quick, errors)[pole] + getattr(careful, errors)[pole]
        if not np.array_equal(known, np.isfinite(size)):
            found.beyond.append(f"{name} {pole}: known one way only")
        judged = known & good
        _judge(found, f"{name} {pole}", size[judged], allowed[judged])


def _judge(found, what, size, allowed):
    with np.errstate(invalid="ignore", divide="ignore"):
        part = np.where(size > 0.0, size / allowed, 0.0)
    if not np.all(part <= 1.0):
        found.beyond.append(f"{what}: {np.max(part):.3g} of what is allowed")
