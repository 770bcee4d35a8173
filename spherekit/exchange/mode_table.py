"""Finds the assembly modes of explicit formulas, and compares each with the mechanism.

Exported source code contains a table of assembly modes. Each mode has *places*, the numbers
that select it in the formulas (see `formula_terms`):

- If the formulas are in closed form, they are the sign of each dyad (+1 or -1). This is the
  sign of the triple product of its three axes. An assembly mode of a run has one sign for
  each dyad by definition. If circles in contact are replaced by links between their
  centres, the equivalent linkage has other dyads. Their signs are determined from
  configurations.
- Otherwise they are the variables of all pairs at one input, at which the loops are well
  conditioned. Newton's method starts from them.

The formulas then compute each mode at several inputs. A mode that deviates from the mode of
the mechanism is not written, and a message names the reason.

A *row* of a motion is one configuration: one assembly mode at one sample of the inputs.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Floats, Indices
from spherekit.conventions import Status, listing
from spherekit.design.varied import VariedMechanism
from spherekit.engine.expression_graph import Expr
from spherekit.engine.row_quantities import VariedTerms
from spherekit.errors import EngineError
from spherekit.exchange.formula_terms import Formulas, Mode, ModeTable
from spherekit.model.gears import joints_of
from spherekit.motion.assembly_modes import AssemblyMode
from spherekit.motion.closure import Closure
from spherekit.motion.motion import Motion, PositionAnalysis
from spherekit.motion.traced import traced
from spherekit.numeric.crossings import wrap
from spherekit.sphere.rotation import max_abs

MODE_SAMPLES = 121
"""Number of samples in the ranges of the inputs. The compared inputs are among them."""
FINE_SAMPLES = 6001
"""Number of samples that replace `MODE_SAMPLES` if a mode closes at none of them.

A mode may exist only within a few degrees of the input.
"""
COMPARED_INPUTS = 20
"""Largest number of inputs at which each mode is compared with the mechanism."""
ANGLE_TOLERANCE_RAD = 1e-9
"""Largest difference (rad) of a pair variable between formulas and mechanism.

Ten times the error bound of the variables of the mechanism is added. A larger value accepts
a wrong mode whose links nearly coincide with those of the right one. A smaller value
rejects right modes of long chains because of rounding errors.
"""
MAX_CONFIGURATION_ERROR_RAD = 1e-5
"""Configurations whose error bound (rad) of the variables is larger are not compared."""
MIN_TRIPLE_PRODUCT = 1e-6
"""Triple products of smaller magnitude may have the wrong sign because of rounding."""
START_OFFSET_RAD = 1e-3
"""Distance (rad) from the right variables at which the test of Newton's method starts.

It is divided by the square of the sensitivity of the loops if that exceeds 1. With a larger
value Newton's method may converge to another mode. With a smaller value the test is weaker.
"""
NEWTON_STEPS = 8
"""Number of Newton steps in that test. Fewer steps may not converge."""


@dataclass(frozen=True)
class ModeCandidate:
    """An assembly mode of the mechanism that is written if the formulas give it too.

    Attributes
    ----------
    mode
        The assembly mode.
    motion
        Well conditioned configurations of the mode, n rows in the order of the samples.
    values
        (n, variables) variables (rad) of the pairs in the formulas, in the same
        configurations. If contacts are replaced by links, these are the pairs of the links.
    places
        In closed form the sign (+1 or -1) of each dyad (dyads,), otherwise the variables
        (variables,) (rad) from which Newton's method starts.
    """

    mode: AssemblyMode
    motion: Motion
    values: Floats
    places: Floats

    @property
    def middle_row(self) -> int:
        """The row of `motion` whose inputs are written to the table with the `places`."""
        return len(self.motion) // 2

    @property
    def allowed_difference(self) -> Floats:
        """(n,) largest accepted difference (rad) of a variable in each configuration."""
        return ANGLE_TOLERANCE_RAD + 10.0 * self.motion.configuration_error


class ModeProblem(Exception):
    """Says why one assembly mode cannot be written. Other modes are not affected."""


def compare_modes(
    formulas: Formulas,
    varied: VariedMechanism,
    terms: VariedTerms,
    angles: Sequence[Expr],
    assembly_mode: int | str | None,
) -> ModeTable:
    """Find the assembly modes of a mechanism, and check each with the formulas.

    Parameters
    ----------
    formulas
        The formulas. Their mode table is not read.
    varied, terms
        The mechanism of the formulas, and the terms from which they are built.
    angles
        In closed form the variables (rad) of all R pairs that are not driven, in the order
        of `passive_variables`, as terms of `formulas.variables`. Otherwise not used.
    assembly_mode
        Number or name of the only assembly mode to write. By default all are written.

    Returns
    -------
    The modes that the formulas give correctly, and the reason for each other mode.

    Raises
    ------
    EngineError
        If no mode can be written.
    SolveError
        If the mechanism has no such assembly mode, or cannot be assembled.
    """
    position_analysis = traced(varied.mechanism)
    requested_modes = position_analysis.assembly_modes
    if assembly_mode is not None:
        requested_modes = (requested_modes[position_analysis.place_of(assembly_mode)],)
    sampled_motion = position_analysis.sparse(MODE_SAMPLES)
    candidates: list[ModeCandidate] = []
    left_out: list[str] = []
    for mode in requested_modes:
        try:
            candidates.append(
                _find_candidate(position_analysis, sampled_motion, mode, varied, terms)
            )
        except ModeProblem as problem:
            left_out.append(f"{mode.number} ({mode.title}): {problem}")
    modes: list[Mode] = []
    compared: list[int] = []
    differences: list[float] = [0.0]
    deviations = _compute_deviations(formulas, terms, angles, candidates)
    for candidate, deviation in zip(candidates, deviations, strict=True):
        mode, motion = candidate.mode, candidate.motion
        # The deviation is NaN where the formulas do not close: the mode is then rejected.
        relative_deviation = np.nan_to_num(
            deviation / candidate.allowed_difference, nan=np.inf
        )
        worst_row = int(np.argmax(relative_deviation))
        if relative_deviation[worst_row] > 1.0:
            at = listing(f"{q:.6g}" for q in motion.inputs[worst_row])
            left_out.append(
                f"{mode.number} ({mode.title}): the formulas do not give this mode: at the "
                f"input {at} rad a variable differs by {deviation[worst_row]:.2g} rad"
            )
            continue
        inputs = tuple(motion.inputs[candidate.middle_row].tolist())
        places = tuple(candidate.places.tolist())
        modes.append(Mode(mode.number, mode.title, inputs, places))
        compared.append(len(deviation))
        differences.append(float(np.max(deviation)))
    if not modes:
        raise EngineError(
            f"{varied.mechanism.name}: no assembly mode can be written: "
            f"{'; '.join(left_out)}"
        )
    return ModeTable(tuple(modes), tuple(left_out), min(compared), max(differences))


def passive_variables(terms: VariedTerms) -> dict[str, int]:
    """Return the index of the variable of each R pair that is not driven, by pair name."""
    return {k: v for k, v in terms.mechanism.angles.items() if k not in terms.inputs}


def _find_candidate(
    position_analysis: PositionAnalysis,
    sampled_motion: Motion,
    mode: AssemblyMode,
    varied: VariedMechanism,
    terms: VariedTerms,
) -> ModeCandidate:
    """Choose configurations of an assembly mode, and determine its places.

    Parameters
    ----------
    position_analysis, sampled_motion
        The position analysis of the mechanism, and its motion at `MODE_SAMPLES` samples.
    mode
        The assembly mode.
    varied, terms
        The mechanism of the formulas, and the terms from which they are built.

    Raises
    ------
    ModeProblem
        If the mode is well conditioned at no sample, or a dyad changes its sign within the
        mode.
    """
    motion = _select_well_conditioned_rows(position_analysis, sampled_motion, mode)
    values = motion.values
    if varied.contacts is not None:
        values = varied.contacts.values(values)
    if not terms.closed_form:
        places = values[len(motion) // 2]
    elif varied.contacts is None:
        places = np.array(mode.signs, dtype=float)
    else:
        places = _dyad_signs(terms, values)
    return ModeCandidate(mode, motion, values, places)


def _select_well_conditioned_rows(
    position_analysis: PositionAnalysis, sampled_motion: Motion, mode: AssemblyMode
) -> Motion:
    """Choose configurations at which the formulas are compared with an assembly mode.

    Near a dead centre the variables are inaccurate, and Newton's method may converge to
    another mode. Therefore only the better conditioned half of the configurations is used:
    those whose `sensitivity` is at most the median.

    Parameters
    ----------
    position_analysis
        The position analysis of the mechanism. It computes a finer motion if the mode has
        no accurate row in `sampled_motion` and there is only one input.
    sampled_motion
        The motion of all modes at about `MODE_SAMPLES` samples.
    mode
        The assembly mode.

    Returns
    -------
    At most `COMPARED_INPUTS` rows of the mode, in the order of the samples.

    Raises
    ------
    ModeProblem
        If no sample of the mode is accurate enough to be compared.
    """
    rows = _find_accurate_rows(sampled_motion, mode)
    if not len(rows) and len(position_analysis.inputs) == 1:
        sampled_motion = position_analysis.at(
            np.linspace(*position_analysis.range, FINE_SAMPLES)
        )
        rows = _find_accurate_rows(sampled_motion, mode)
    if not len(rows):
        status_codes = sampled_motion.status[sampled_motion.assembly_mode == mode.number]
        counts = zip(*np.unique(status_codes, return_counts=True), strict=True)
        statuses = listing(f"{count} {Status(int(code)).name}" for code, count in counts)
        raise ModeProblem(
            f"no sample was found at which it is well conditioned ({statuses}); give "
            "ranges of the inputs in which it closes"
        )
    motion = sampled_motion.rows(rows)
    sensitivity = motion.sensitivity
    well_conditioned = np.flatnonzero(sensitivity <= np.median(sensitivity))
    # Choose rows at even distances in the list.
    positions = np.linspace(0, len(well_conditioned) - 1, COMPARED_INPUTS)
    return motion.rows(well_conditioned[np.unique(np.round(positions).astype(int))])


def _find_accurate_rows(sampled_motion: Motion, mode: AssemblyMode) -> Indices:
    """Return the indices of the valid rows of a mode that are accurate enough to compare.

    Valid rows have the status OK. The error bound of their variables must not exceed
    `MAX_CONFIGURATION_ERROR_RAD`.
    """
    is_valid = (sampled_motion.assembly_mode == mode.number) & (
        sampled_motion.status == Status.OK
    )
    rows = np.flatnonzero(is_valid)
    is_accurate = (
        sampled_motion.rows(rows).configuration_error <= MAX_CONFIGURATION_ERROR_RAD
    )
    return np.asarray(rows[is_accurate])


def _dyad_signs(terms: VariedTerms, values: Floats) -> Floats:
    """Return the sign of each dyad of an equivalent linkage in one assembly mode.

    In the equivalent linkage, links between the centres of circles replace contacts. The
    sign of a dyad is that of the triple product of its three axes.

    Parameters
    ----------
    terms
        The terms of the formulas, which are those of the equivalent linkage.
    values
        (n, variables) variables (rad) of the equivalent linkage in n configurations of the
        mode.

    Returns
    -------
    (dyads,) signs +1 or -1, in the order in which the dyads are solved.

    Raises
    ------
    ModeProblem
        If a dyad changes its sign within the mode. This is possible where another dyad
        changes its sign at the same input.
    """
    mechanism = terms.mechanism
    # (n, variables, 3) direction of the axis of each variable
    vectors = Closure.of(mechanism, joints_of(mechanism)).at(values).vectors
    signs: list[float] = []
    for group in terms.structure.assembly.groups:
        axes = vectors[:, [mechanism.variables_of(pair)[0] for pair in group.pairs]]
        triple_products = np.linalg.det(axes)  # (n,)
        # The value of the largest magnitude is farthest from a dead centre of the dyad, so
        # its sign is the most reliable.
        largest = triple_products[np.argmax(np.abs(triple_products))]
        reliable = triple_products[np.abs(triple_products) > MIN_TRIPLE_PRODUCT]
        if np.any(reliable * largest < 0.0):
            pairs = listing(mechanism.names_of(group.pairs))
            raise ModeProblem(
                f"the dyad of pairs {pairs} changes its side within this mode; export "
                "ranges of the inputs in which it does not"
            )
        signs.append(1.0 if largest >= 0.0 else -1.0)
    return np.array(signs)


def _compute_deviations(
    formulas: Formulas,
    terms: VariedTerms,
    angles: Sequence[Expr],
    candidates: Sequence[ModeCandidate],
) -> list[Floats]:
    """Compute the deviation of the formulas from the configurations of all candidates.

    In closed form the formulas compute the variables from the signs of the dyads. Otherwise
    Newton's method starts near each configuration: each variable is moved by an amount so
    small that the method should not converge to another mode.

    Parameters
    ----------
    formulas, terms
        The formulas, and the terms from which they are built.
    angles
        In closed form the variables of the R pairs that are not driven, as terms.
    candidates
        The assembly modes with their configurations.

    Returns
    -------
    For each candidate an array (n,): in each of its n configurations, the largest
    difference (rad) of a variable between formulas and mechanism. It is NaN where the
    formulas do not close.
    """
    if not candidates:
        return []
    counts = [len(candidate.motion) for candidate in candidates]
    # The configurations of all candidates are computed together. Each is one column.
    inputs = np.concatenate([candidate.motion.inputs for candidate in candidates]).T
    expected = np.concatenate([candidate.values for candidate in candidates]).T
    motion = np.zeros((len(formulas.motion), sum(counts)))
    # The inputs come first. The other rows (rates, accelerations, loads) may be zero,
    # because the variables of pairs do not depend on them.
    motion[: len(inputs)] = inputs
    if terms.closed_form:
        places = np.stack([candidate.places for candidate in candidates], axis=1)
        evaluate = formulas.numpy_function(angles)
        computed = evaluate(motion, np.repeat(places, counts, axis=1), formulas.size_values)
        deviation = wrap(computed - expected[[*passive_variables(terms).values()]])
    else:
        sensitivity = np.concatenate(
            [mode_candidate.motion.sensitivity for mode_candidate in candidates]
        )
        offset = START_OFFSET_RAD / np.maximum(1.0, sensitivity**2)
        # The variables are moved in alternating directions.
        directions = np.where(np.arange(len(expected)) % 2, 1.0, -1.0)
        computed = expected + directions[:, None] * offset
        step = formulas.numpy_function(formulas.step)
        for _ in range(NEWTON_STEPS):
            # The last row is the closure residual.
            computed = step(motion, computed, formulas.size_values)[:-1]
        deviation = computed - expected
        # Differences of angles are taken modulo 2 pi. The other variables are arc lengths
        # of profiles.
        angle_rows = [*terms.mechanism.angles.values()]
        deviation[angle_rows] = wrap(deviation[angle_rows])
    largest = max_abs(deviation, axis=0) if len(deviation) else np.zeros(deviation.shape[1])
    return np.split(largest, np.cumsum(counts)[:-1])
