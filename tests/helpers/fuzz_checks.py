"""Evaluates random mechanisms and compares their rows with the velocity equations.

The promise is: no row or pole with status OK holds a wrong value, and every row that fails
holds NaN. The velocity equations (`oracles.velocity_equations`) are solved by a singular
value decomposition for the angular velocities of all links, without poles.
"""

import warnings
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

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
"""Deviation (rad, or relative to the largest rate) that is allowed in any case."""
BOUND_FACTOR = 10.0
"""A direction may deviate by this multiple of its own error bound."""
ROUNDING_FACTOR = 100.0
"""A value may deviate by this multiple of the rounding unit times the condition number."""
PERTURBATION_FACTOR = 10.0
"""A value may deviate by this multiple of its change in a perturbed configuration."""
MISFIT_FACTOR = 10.0
"""A direction may deviate by this multiple of the misfit of the reference motion."""
MIN_SINGULAR_VALUE_RATIO = 1e-13
"""Below this ratio of smallest to largest singular value the motion is not determined."""
NEARLY_SINGULAR_RATIO = 1e-3
"""Below this ratio of singular values a perturbed configuration is evaluated too."""
MAX_GAP_RAD = 1e-10
"""Largest gap (rad) of a pair, and largest error (rad) of an input, in a solved row."""
MOST_LINKS_BY_RANK = 7
"""Largest number of links of a mechanism that is tried by rank.

If the count of the degrees of freedom refuses a mechanism, its mobility may still follow
from the rank of its equations. This takes long for many links.
"""


@dataclass
class Tally:
    """Counts of the statuses of many random mechanisms, and the faults in their results.

    A fault is a wrong number that is called OK, or a number in a failed row. A row is one
    sample in one assembly mode.

    Attributes
    ----------
    mechanisms
        Number of mechanisms by outcome: evaluated, refused (with the reason), or fault.
    rows, poles
        Number of rows, and of poles (axes of relative rotation) in rows, by their status.
    wrong
        Faults in words, with the seed.
    worst
        Largest deviation by kind of quantity, in well-conditioned rows.
    """

    mechanisms: Counter[str] = field(default_factory=Counter)
    rows: Counter[str] = field(default_factory=Counter)
    poles: Counter[str] = field(default_factory=Counter)
    wrong: list[str] = field(default_factory=list)
    worst: dict[str, float] = field(default_factory=dict)

    def note(self, kind, deviation):
        """Store a deviation if it is the largest of its kind."""
        self.worst[kind] = max(self.worst.get(kind, 0.0), deviation)


def check_random_mechanisms(seeds):
    """Evaluate the random mechanisms of these seeds and return the `Tally` of them."""
    tally = Tally()
    for seed in seeds:
        try:
            _check_seed(seed, tally)
        except Exception as error:  # an error that is no refusal is a fault
            tally.mechanisms["fault"] += 1
            tally.wrong.append(f"seed {seed}: {type(error).__name__}: {error}")
    return tally


def _check_seed(seed, tally):
    """Evaluate the random mechanism of a seed for each of its inputs, and note its faults.

    A mechanism may be refused with a `SpherekitError`, which is no fault. `CountError`: the
    number of degrees of freedom is not that of the inputs. Other kinds of `PlanError`: some
    part is rigid, loose or over-constrained.

    Parameters
    ----------
    seed
        Seed of the random mechanism.
    tally
        `Tally` that counts mechanisms by their outcome, and collects faults.
    """
    _, mechanism = random_mechanism(seed)
    fields = {}
    try:
        # `plan_assembly` counts the degrees of freedom from links and pairs. It raises a
        # `CountError` if they are not as many as the inputs. `PositionAnalysis` would then
        # examine the rank of the velocity equations, which is slow for many links. The plan
        # itself is not needed here.
        if len(mechanism.links) > MOST_LINKS_BY_RANK:
            plan_assembly(mechanism)
        with warnings.catch_warnings():
            # A warning of NumPy (division by zero, invalid value) is an error.
            warnings.simplefilter("error", RuntimeWarning)
            position_analysis = PositionAnalysis(
                mechanism, search=False, samples=SAMPLES, assembly_mode=0
            )
            motion = position_analysis.motion()
            poles = all_poles(len(mechanism.links))
            for pair in motion.assembly.inputs:
                # Directions (`poles`) and velocity coefficients (`rates`) of all poles, the
                # axes of relative rotation. `by_rank` is true if the degrees of freedom
                # follow from the rank of the velocity equations, not from counting.
                pole_request = request(
                    position_analysis.mechanism,
                    mechanism.pairs[pair].name,
                    poles=poles,
                    rates=poles,
                    by_rank=position_analysis.by_rank,
                )
                fields[pair] = evaluate(motion, pole_request)
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
    for pair, pole_field in fields.items():
        for fault in find_faults(motion, pole_field, pair, tally):
            tally.wrong.append(f"seed {seed}: input {mechanism.pairs[pair].name}: {fault}")


def find_faults(motion, field, moving_input, tally):
    """Return the faults of a pole field in words, and count its rows and poles.

    A pole is the axis of the relative rotation of two links. A row is one sample in one
    assembly mode (way to assemble the links). The reference are angular velocities of all
    links by least squares (`link_rates`), without poles.

    First, velocities are compared as if the configuration were exact. Near a singularity,
    where the velocity equations are badly conditioned, a small error of the configuration
    changes them much. A row there that fails is compared again with this change allowed.

    Parameters
    ----------
    motion, field
        Motion of a mechanism, and its poles while one input moves.
    moving_input
        Number of the input pair that moves; all other inputs are locked.
    tally
        `Tally` that counts statuses and deviations.
    """
    faults = _find_numbers_in_failed_rows(motion, field)
    for code in field.status:
        tally.rows[Status(code).name] += 1
    is_evaluated = ~motion.failed
    if not np.any(is_evaluated):
        return faults
    rows = np.flatnonzero(is_evaluated)
    reference = link_rates(
        motion.mechanism, motion.rotations[rows], motion.assembly.inputs, moving_input
    )
    # Loops must be closed. The negated comparison also reports gaps that are NaN.
    for k in np.flatnonzero(~(reference.gaps < MAX_GAP_RAD)).tolist():
        faults.append(f"row {rows[k]}: a pair misses by {reference.gaps[k]:.1e}")
    faults += _find_wrong_inputs(motion, rows)
    for k, row in enumerate(rows.tolist()):
        if field.status[row] != Status.OK:
            # At a dead centre of the input, poles have directions without velocities. The
            # free matrix has the velocity equations without this input.
            faults += _find_wrong_directions(field, row, reference.free_matrix[k], tally)
            continue
        reference_row = ReferenceRow(
            row,
            reference.w[k],
            reference.dw[k],
            reference.singular_values[k],
            reference.residuals[k],
        )
        row_faults = _find_faults_of_row(field, reference_row, NO_CHANGE, tally)
        if row_faults and reference_row.is_nearly_singular:
            # The change of the velocities by the error of the configuration.
            change = _find_change_by_position_error(motion, row, moving_input)
            row_faults = _find_faults_of_row(field, reference_row, change, tally)
        faults += row_faults
    return faults


@dataclass(frozen=True)
class ReferenceRow:
    """Reference of one row: angular velocities of all links, by the velocity equations.

    A row is one sample in one assembly mode (way to assemble the links).

    Attributes
    ----------
    row
        Number of the row.
    w, dw
        (links, 3) angular velocities per rate of the input, and their derivatives by the
        input.
    singular_values
        Singular values of the velocity equations, largest first.
    residual
        Residual of their least-squares solution.
    """

    row: int
    w: Any
    dw: Any
    singular_values: Any
    residual: float

    @property
    def is_nearly_singular(self):
        """Whether the velocity equations are badly conditioned."""
        least_regular = NEARLY_SINGULAR_RATIO * self.singular_values[0]
        return self.singular_values[-1] < least_regular


@dataclass(frozen=True)
class RateChange:
    """Change of angular velocities w and of their derivatives dw (largest component).

    It is caused by the error of the configuration.
    """

    w: float
    dw: float


NO_CHANGE = RateChange(w=0.0, dw=0.0)
"""Change of the velocities if the configuration is exact."""


def _find_change_by_position_error(motion, row, moving_input):
    """Return how much w and dw change if the links of a row turn by the position error.

    w and dw are the angular velocities of the links and their derivatives by the input. The
    configuration is only known up to the position error, so w and dw cannot be more
    accurate than this. The result is the largest change among seven random small rotations
    of all links.
    """
    random = np.random.default_rng(0)
    error_rad = max(
        EPS, float(motion.residual[row]), float(motion.configuration_error[row])
    )
    rotations = motion.rotations[row][None]
    small_turns = error_rad * random.normal(size=(8, *rotations.shape[1:2], 3))
    small_turns[0] = 0.0  # the first configuration is the unperturbed one
    small_turns[:, 0] = 0.0  # the ground stays
    # A small rotation changes each column of a rotation matrix by a cross product. For this
    # the columns are put into the last but one axis.
    columns = np.swapaxes(rotations, 2, 3)
    changes = np.cross(small_turns[:, :, None], columns).swapaxes(2, 3)
    rates = link_rates(
        motion.mechanism, rotations + changes, motion.assembly.inputs, moving_input
    )
    w_change = np.max(np.abs(rates.w - rates.w[0]))
    dw_change = np.max(np.abs(rates.dw - rates.dw[0]))
    return RateChange(float(w_change), float(dw_change))


def _find_numbers_in_failed_rows(motion, field):
    """Return faults: numbers in failed rows, and NaN in rows that are OK.

    Configurations and pole directions must be NaN where the position analysis failed.
    Angular velocities and their derivatives must be NaN where the status is not OK.
    """
    has_failed = motion.failed
    has_no_rates = field.status != Status.OK
    quantities = [
        ("values", motion.values, has_failed),
        ("rotations", motion.rotations, has_failed),
    ]
    for pole, values in field.direction.items():
        quantities.append((f"direction {pole}", values, has_failed))
    for pole, values in field.velocity_coefficient.items():
        quantities.append((f"rate {pole}", values, has_no_rates))
    for pole, values in field.acceleration_coefficient.items():
        quantities.append((f"acceleration_coefficient {pole}", values, has_no_rates))
    for link, values in field.w.items():
        quantities.append((f"w {link}", values, has_no_rates))
    for link, values in field.dw.items():
        quantities.append((f"dw {link}", values, has_no_rates))
    faults = []
    for name, values, must_be_nan in quantities:
        if np.any(np.isfinite(values[must_be_nan])):
            faults.append(f"{name}: a failed row holds a number")
        # Poles may be NaN in rows that are OK: links at rest have none.
        is_never_nan = name.startswith(("w ", "dw ", "values"))
        if is_never_nan and not np.all(np.isfinite(values[~must_be_nan])):
            faults.append(f"{name}: a row that is OK holds NaN")
    return faults


def _find_wrong_inputs(motion, rows):
    """Return faults: rows whose links are not turned by the input angle of the row.

    `rows` are the numbers of rows that were solved. The angle of an input is computed here
    from the rotations of its two links.
    """
    faults = []
    for column, pair in enumerate(motion.assembly.inputs):
        joint = revolute(motion.joints[pair])
        first_link, second_link = motion.mechanism.ends[pair]
        # Frames of the pair in ground axes; columns x, y, z with z along the axis. The
        # angle of the pair turns x of the first link to x of the second one.
        first_frames = motion.rotations[rows, first_link] @ joint.first
        second_frames = motion.rotations[rows, second_link] @ joint.second
        second_x = second_frames[:, :, 0]
        cosine = np.sum(second_x * first_frames[:, :, 0], axis=1)
        sine = np.sum(second_x * first_frames[:, :, 1], axis=1)
        gap = np.arctan2(sine, cosine) - motion.inputs[rows, column]
        # Angles that differ by whole turns are the same.
        gap = np.abs(np.remainder(gap + np.pi, 2 * np.pi) - np.pi)
        # The negated comparison also reports a gap that is NaN.
        for k in np.flatnonzero(~(gap < MAX_GAP_RAD)):
            faults.append(f"row {rows[k]}: input off by {gap[k]:.1e}")
    return faults


def _find_faults_of_row(field, reference_row, allowed_change, tally):
    """Return the faults of a row with status OK: rates, poles and their derivatives.

    Parameters
    ----------
    field
        Pole field.
    reference_row
        `ReferenceRow` of the row.
    allowed_change
        `RateChange` of w and dw by the error of the configuration, which is allowed.
    tally
        `Tally` that counts statuses and deviations.
    """
    row = reference_row.row
    w = reference_row.w
    dw = reference_row.dw
    residual = reference_row.residual
    flatness = reference_row.singular_values[-1] / reference_row.singular_values[0]
    if flatness < MIN_SINGULAR_VALUE_RATIO:
        return [f"row {row}: OK, but the motion is not determined ({flatness:.1e})"]
    w_scale = max(1.0, float(np.max(np.linalg.norm(w, axis=1))))
    dw_scale = max(w_scale**2, float(np.max(np.linalg.norm(dw, axis=1))))
    least_limit = max(TOLERANCE, ROUNDING_FACTOR * EPS / flatness)
    if not residual < w_scale * least_limit:
        return [f"row {row}: OK, but the pairs cannot move so ({residual:.1e})"]
    w_limit = max(least_limit, PERTURBATION_FACTOR * allowed_change.w / w_scale)
    dw_limit = max(least_limit, PERTURBATION_FACTOR * allowed_change.dw / dw_scale)
    faults = []

    def compare(name, deviation, limit):
        if not deviation <= limit:
            faults.append(
                f"row {row}: {name} off by {deviation:.1e}, allowed {limit:.1e}, flat "
                f"{flatness:.1e}, quad precision {bool(field.is_quad_precision[row])}"
            )
        elif flatness > 1e-6:
            tally.note(name.split(" ")[0], deviation)

    for link in field.w:
        compare(f"w {link}", _length(field.w[link][row] - w[link]) / w_scale, w_limit)
        compare(f"dw {link}", _length(field.dw[link][row] - dw[link]) / dw_scale, dw_limit)
    for pole in field.direction:
        first, second = pole
        relative_w = w[second] - w[first]
        relative_dw = dw[second] - dw[first]
        relative_rate = _length(relative_w)
        status = Status(field.pole_status[pole][row])
        direction = field.direction[pole][row]
        direction_error = field.direction_error[pole][row]
        tally.poles[status.name] += 1
        if status == Status.NO_POLE:
            compare(f"standing {pole}", relative_rate / w_scale, max(1e-6, w_limit))
        elif status == Status.ILL_CONDITIONED:
            if np.any(np.isfinite(direction)):
                faults.append(f"row {row}: {pole} is ill-conditioned, but given")
        elif status == Status.OK:
            if not np.all(np.isfinite(direction)):
                faults.append(f"row {row}: {pole} is OK, but not a number")
                continue
            rate_vector = field.velocity_coefficient[pole][row] * direction
            compare(f"rate {pole}", _length(rate_vector - relative_w) / w_scale, w_limit)
            deviation = _length(np.cross(direction, relative_w)) / w_scale
            limit = max(w_limit, BOUND_FACTOR * direction_error * relative_rate / w_scale)
            compare(f"direction {pole}", deviation, limit)
            deviation = field.acceleration_coefficient[pole][row] - relative_dw @ direction
            # A direction may deviate by its bound, and the derivative with it.
            limit = dw_limit + BOUND_FACTOR * direction_error
            compare(f"acceleration_coefficient {pole}", abs(deviation) / dw_scale, limit)
            compare(f"length {pole}", abs(_length(direction) - 1.0), 1e-12)
        else:
            faults.append(f"row {row}: {pole} is {status.name}, its row is OK")
    return faults


def _find_wrong_directions(field, row, free_matrix, tally):
    """Return faults of pole directions at a dead centre of one input.

    A pole is the axis of the relative rotation of two links. At a dead centre the input
    stands still while links move, so only directions are evaluated. The reference is the
    motion with the input free. It is the last right singular vector of the velocity
    equations without this input.

    The deviation is the length of the cross product of the direction with the relative
    angular velocity of the reference. It may be as large as the largest of four limits:

    - `TOLERANCE`;
    - `ROUNDING_FACTOR` times the rounding error, which grows if a second motion is nearly
      possible;
    - `MISFIT_FACTOR` times the misfit, by which the reference violates the equations;
    - `BOUND_FACTOR` times the error bound that spherekit states for the direction, times
      the length of the relative angular velocity.

    Parameters
    ----------
    field, row
        Poles, and number of the row at the dead centre.
    free_matrix
        (rows, 3 links - 3) velocity equations without those of the moving input.
    tally
        `Tally` that counts the poles.
    """
    _, singular_values, right_vectors = np.linalg.svd(free_matrix)
    # With fewer equations than unknowns, several motions are possible. The gap of 0 then
    # makes the limit so large that nothing is reported.
    has_all_values = len(singular_values) == free_matrix.shape[1]
    if has_all_values:
        # Zero if two independent motions satisfy all equations.
        gap = singular_values[-2] / singular_values[0]
        # Zero if one motion satisfies all equations.
        motion_misfit = singular_values[-1] / singular_values[-2]
    else:
        gap = 0.0
        motion_misfit = 0.0
    w = np.concatenate([np.zeros(3), right_vectors[-1]]).reshape(-1, 3)
    faults = []
    for pole, directions in field.direction.items():
        direction = directions[row]
        if not np.all(np.isfinite(direction)):
            continue
        relative_w = w[pole[1]] - w[pole[0]]
        tally.poles["direction alone"] += 1
        error_bound = field.direction_error[pole][row]
        limit = max(
            TOLERANCE,
            ROUNDING_FACTOR * EPS / max(gap, EPS),
            MISFIT_FACTOR * motion_misfit,
        )
        limit = max(limit, BOUND_FACTOR * error_bound * _length(relative_w))
        # The cross product of parallel vectors is zero.
        deviation = _length(np.cross(direction, relative_w))
        if not deviation <= limit:
            faults.append(
                f"row {row}: direction alone {pole} off by {deviation:.1e}, allowed "
                f"{limit:.1e}, gap {gap:.1e}"
            )
    return faults


def _length(vector):
    return float(np.linalg.norm(vector))
