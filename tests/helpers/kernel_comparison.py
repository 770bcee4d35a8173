"""Compares the rows of a row kernel with rows that are computed without one.

A row kernel is a compiled function that evaluates all columns of many rows at once.
"""

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
    """Motion and poles of the same samples, computed by a row kernel and without one.

    A row kernel is a compiled function that evaluates all columns of many rows at once. A
    row is one sample in one assembly mode (one way to assemble the links). A pole is the
    axis of the relative rotation of two links.

    Attributes
    ----------
    kernel_motion, kernel_fields
        Configurations of all rows by the kernel, and the poles in them. There is one field
        of poles for each input, which moves while the other inputs are locked.
    reference_motion, reference_fields
        The same by the position analysis and the pole evaluation, without a kernel.
    """

    kernel_motion: Motion
    kernel_fields: tuple[PoleField, ...]
    reference_motion: Motion
    reference_fields: tuple[PoleField, ...]


@dataclass
class Differences:
    """Differences between results of a row kernel and those computed without one.

    A row kernel is a compiled function that evaluates all columns of many rows at once. A
    row is one sample in one assembly mode (one way to assemble the links).

    Attributes
    ----------
    share
        Share of the rows (0 to 1) that the kernel certified, because the error bounds that
        it computes are small enough. Other rows were computed as in the reference.
    statuses
        Number of rows, and of poles (axes of the relative rotation of two links) in rows,
        whose status differs. A status says whether a row or pole is OK, or why it has no
        numbers.
    beyond
        Names of the quantities whose difference exceeds the sum of both error bounds.
    """

    share: float
    statuses: int
    beyond: list[str]

    @property
    def are_none(self):
        """Whether no statuses differ and no difference exceeds the error bounds."""
        return self.statuses == 0 and not self.beyond


def evaluate_both_ways(mechanism, **options):
    """Evaluate all poles of a mechanism by a row kernel and without one.

    A row kernel is a compiled function that evaluates all columns of many rows at once. A
    pole is the axis of the relative rotation of two links. The result is the input of
    `find_differences`.

    Parameters
    ----------
    mechanism
        Mechanism that is moved.
    options
        Further fields of `Study` (what is evaluated), such as `samples`.

    Returns
    -------
    KernelAndReference or None
        None if there is no kernel for this mechanism.
    """
    # A kernel is normally used from a minimum number of rows on. Here that number is 0.
    with patch.object(batch_runner, "MIN_KERNEL_ROWS", 0):
        # A search for all assembly modes is not needed for a comparison.
        sampling = make_sampling(Study(mechanism.name, mechanism, search=False, **options))
        position_analysis = sampling.position_analysis
        poles = all_poles(len(mechanism.links))
        # All poles get a direction (`poles`) and a velocity coefficient (`rates`). With
        # `by_rank`, degrees of freedom are those found by the rank of the velocity
        # equations. Their count from links and pairs is too low where constraints repeat
        # each other.
        pole_requests = [
            request(
                position_analysis.mechanism,
                input_pair=pair,
                poles=poles,
                rates=poles,
                by_rank=position_analysis.by_rank,
            )
            for pair in position_analysis.inputs
        ]
        runner = batch_runner.BatchRunner.prepare(
            sampling, pole_requests, is_recorded=False
        )
        if runner is None:
            return None
        # A block is a number of consecutive samples. Here one block has all of them.
        (kernel_motion,) = runner.blocks(len(sampling))
        # Two opposite directions describe the same pole. A `SignContinuation` chooses the
        # one that continues the rows before.
        sign_continuations = [SignContinuation() for _ in pole_requests]
        fields = runner.fields(kernel_motion, sign_continuations)
        kernel_fields = tuple(field.as_arrays for field in fields)
    (reference_motion,) = sampling.blocks(len(sampling))
    reference_fields = tuple(
        evaluate(reference_motion, pole_request) for pole_request in pole_requests
    )
    return KernelAndReference(
        kernel_motion, kernel_fields, reference_motion, reference_fields
    )


def find_differences(evaluations, same_signs=True):
    """Compare a motion and its poles by a row kernel with those of the reference.

    A pole is the axis of the relative rotation of two links. The reference is computed
    without a kernel (a compiled function that evaluates many rows at once).

    Parameters
    ----------
    evaluations
        `KernelAndReference`: the motion and poles of both computations.
    same_signs
        Whether pole directions must also have the same sign. Opposite directions describe
        the same pole.

    Returns
    -------
    `Differences`: the number of statuses that differ, the quantities that differ by more
    than their error bounds, and the share of rows that the kernel certified.
    """
    kernel_motion = evaluations.kernel_motion
    reference_motion = evaluations.reference_motion
    is_ok = (kernel_motion.status == Status.OK) & (reference_motion.status == Status.OK)
    # One field of poles for each input that moves alone. The kernel certifies a row if its
    # error bounds there are small enough.
    certified_shares = [np.mean(field.is_certified) for field in evaluations.kernel_fields]
    differences = Differences(
        share=float(np.mean(certified_shares)),
        statuses=int(np.sum(kernel_motion.status != reference_motion.status)),
        beyond=[],
    )
    _compare_variables(differences, kernel_motion, reference_motion, is_ok)
    _compare_orientations(differences, kernel_motion, reference_motion, is_ok)
    for kernel_field, reference_field in zip(
        evaluations.kernel_fields, evaluations.reference_fields, strict=True
    ):
        differences.statuses += int(np.sum(kernel_field.status != reference_field.status))
        for pole in reference_field.direction:
            _compare_pole(
                differences, kernel_field, reference_field, pole, is_ok, same_signs
            )
    return differences


def _signs_of_kernel_pole(kernel_field, reference_field, pole, same_signs):
    """Return (rows,) the signs by which the results of the kernel for a pole are compared.

    Opposite directions describe the same pole, so a row with opposite directions gets the
    sign -1. With `same_signs` an opposite direction is a difference, and the sign stays 1.
    An exception are rows in which the velocity about the pole is within its error bound:
    rounding decides there which of both directions a computation has.
    """
    if same_signs:
        rate = reference_field.velocity_coefficient[pole]
        rate_bound = reference_field.velocity_coefficient_error[pole]
        may_be_opposite = np.abs(rate) <= rate_bound
    else:
        may_be_opposite = True
    cosine = np.sum(reference_field.direction[pole] * kernel_field.direction[pole], axis=1)
    is_opposite = cosine < 0.0
    return np.where(is_opposite & may_be_opposite, -1.0, 1.0)


def _compare_variables(differences, kernel_motion, reference_motion, is_ok):
    """Add the differences of the pair variables, up to whole revolutions.

    `is_ok` (rows,) says whether both evaluations of the configuration have status OK.
    """
    angle_gaps = kernel_motion.values - reference_motion.values  # (rows, variables), rad
    angle_gaps -= TURN * np.round(angle_gaps / TURN)
    angle_bound = kernel_motion.configuration_error + reference_motion.configuration_error
    largest_gap = np.max(np.abs(angle_gaps), axis=1)
    _compare_with_bound(
        differences, "configurations", largest_gap[is_ok], angle_bound[is_ok]
    )


def _compare_orientations(differences, kernel_motion, reference_motion, is_ok):
    """Add the differences of the rotation matrices of the links.

    `is_ok` (rows,) says whether both evaluations of the configuration have status OK.
    Orientations have no error bound of their own, so a fixed one is taken.
    """
    rotation_gaps = np.abs(kernel_motion.rotations - reference_motion.rotations)
    largest_gap = np.max(rotation_gaps, axis=(1, 2, 3))[is_ok]
    rotation_bound = np.full(len(largest_gap), 1e-9)
    _compare_with_bound(differences, "orientations", largest_gap, rotation_bound)


def _compare_pole(differences, kernel_field, reference_field, pole, is_ok, same_signs):
    """Add the differences of one pole: its statuses, direction and coefficients.

    A pole is the axis of the relative rotation of two links. Its velocity coefficient is
    the angular velocity about it per unit of input speed. A row is one sample in one
    assembly mode (one way to assemble the links).

    Parameters
    ----------
    differences
        `Differences` that are extended.
    kernel_field, reference_field
        Poles by the row kernel (a compiled function that evaluates many rows at once) and
        without it, for the same moving input.
    pole
        Numbers of the two links.
    is_ok
        (rows,) whether the configuration of a row has the status OK in both computations.
    same_signs
        Whether directions must also have the same sign.
    """
    has_other_status = kernel_field.pole_status[pole] != reference_field.pole_status[pole]
    differences.statuses += int(np.sum(has_other_status))

    sign = _signs_of_kernel_pole(kernel_field, reference_field, pole, same_signs)
    for name in ("direction", "velocity_coefficient", "acceleration_coefficient"):
        # A direction is an array (rows, 3), a coefficient an array (rows,).
        kernel_values = getattr(kernel_field, name)[pole]
        reference_values = getattr(reference_field, name)[pole]
        # If the direction is reversed, both coefficients change their sign with it. The
        # transposes have the rows as their last axis, as the signs (rows,) have.
        gaps = kernel_values.T * sign - reference_values.T
        gap_sizes = np.linalg.norm(np.atleast_2d(gaps), axis=0)
        # The components of a direction are all finite or all NaN, so one is enough.
        is_finite = np.isfinite(reference_values.reshape(len(sign), -1)[:, 0])
        if not np.array_equal(is_finite, np.isfinite(gap_sizes)):
            differences.beyond.append(f"{name} {pole}: finite in one evaluation only")
        bound = (
            getattr(kernel_field, f"{name}_error")[pole]
            + getattr(reference_field, f"{name}_error")[pole]
        )
        rows = is_finite & is_ok
        _compare_with_bound(differences, f"{name} {pole}", gap_sizes[rows], bound[rows])


def _compare_with_bound(differences, name, gap_sizes, bound):
    """Add the name of a quantity if one of its gaps (rows,) exceeds its bound (rows,)."""
    with np.errstate(invalid="ignore", divide="ignore"):
        ratios = np.where(gap_sizes > 0.0, gap_sizes / bound, 0.0)
    if not np.all(ratios <= 1.0):
        differences.beyond.append(f"{name}: {np.max(ratios):.3g} of the bound")
