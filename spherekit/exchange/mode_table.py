"""The assembly modes that a source names, each compared with the mechanism before.

Formulas in closed form name a mode by the sides of its dyads. The side of a dyad is the
sign of the triple product of its three axes, and an assembly mode of a run has one sign for
each dyad by definition. No sample has to be read for these signs. Only where circles in
contact are computed as links between their centres, the dyads of these links have to be
read from configurations, and only those far from a dead centre of the dyad count.

Formulas without a closed form start from the variables of all pairs at one input, where
the loops are well conditioned.

Every mode is then computed by the formulas themselves at several inputs. A mode that
differs from the mechanism's is not written, and a sentence says so.
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
"""Samples over the ranges of the inputs from which those of a mode are chosen."""
FINE_SAMPLES = 6001
"""The same where a mode closes at none of these: modes may end within a few degrees."""
COMPARED_INPUTS = 20
"""Inputs at which each mode is compared with the mechanism."""
ANGLE_TOLERANCE_RAD = 1e-9
"""Pair variables that differ by more, beside ten times what the mechanism's own may be off
by, are those of another mode. Larger: a wrong mode is written where links of two modes
nearly coincide. Smaller: rounding of long chains forbids modes that are right."""
MAX_CONFIGURATION_ERROR_RAD = 1e-5
"""Configurations whose variables may be off by more are not compared."""
CLEAR_TRIPLE_PRODUCT = 1e-6
"""Triple products below this may have either sign by rounding."""
START_OFFSET_RAD = 1e-3
"""Variables are moved by this, over the square of the loops' sensitivity, before Newton's
steps have to lead back."""
NEWTON_STEPS = 8


@dataclass(frozen=True)
class ModeCandidate:
    """An assembly mode that may be written.

    Attributes
    ----------
    mode
        The assembly mode.
    motion
        Well conditioned rows (n,) of it, in the order of the samples.
    values
        (n, variables) rad, the variables of the formulas' pairs there.
    places
        The signs (dyads,) of the mode, or the variables (variables,) to start from.
    """

    mode: AssemblyMode
    motion: Motion
    values: Floats
    places: Floats

    @property
    def middle(self) -> int:
        """The row at whose inputs the mode is said to be known."""
        return len(self.motion) // 2

    @property
    def allowed_difference(self) -> Floats:
        """(n,) rad, by how much variables of the formulas may differ."""
        return ANGLE_TOLERANCE_RAD + 10.0 * self.motion.configuration_error


class ModeProblem(Exception):
    """Why an assembly mode cannot be written."""


def compare_modes(
    formulas: Formulas,
    varied: VariedMechanism,
    terms: VariedTerms,
    angles: Sequence[Expr],
    assembly_mode: int | str | None,
) -> ModeTable:
    """Return the assembly modes of formulas, each compared with the mechanism.

    Parameters
    ----------
    formulas
        The formulas, whose own mode table is not read.
    varied, terms
        The mechanism that they are of, and the terms in which they are written.
    angles
        In closed form the variables of all R pairs that are not driven, in the order of
        `passive_variables`, as terms of `formulas.variables`.
    assembly_mode
        Number or name of the only assembly mode wanted, by default all.

    Raises
    ------
    EngineError
        If no mode can be written.
    SolveError
        If there is no such assembly mode, or the mechanism cannot be assembled.
    """
    tracer = traced(varied.mechanism)
    wanted = tracer.assembly_modes
    if assembly_mode is not None:
        wanted = (wanted[tracer.place_of(assembly_mode)],)
    sampled = tracer.sparse(MODE_SAMPLES)
    candidates: list[ModeCandidate] = []
    left_out: list[str] = []
    for mode in wanted:
        try:
            candidates.append(_find_candidate(tracer, sampled, mode, varied, terms))
        except ModeProblem as problem:
            left_out.append(f"{mode.number} ({mode.title}): {problem}")
    modes: list[Mode] = []
    compared: list[int] = []
    differences: list[float] = [0.0]
    off_by_mode = _differences(formulas, terms, angles, candidates)
    for candidate, off in zip(candidates, off_by_mode, strict=True):
        mode, motion = candidate.mode, candidate.motion
        excess = np.nan_to_num(off / candidate.allowed_difference, nan=np.inf)
        worst = int(np.argmax(excess))
        if excess[worst] > 1.0:
            at = listing(f"{q:.6g}" for q in motion.inputs[worst])
            left_out.append(
                f"{mode.number} ({mode.title}): the formulas do not give this mode: at the "
                f"input {at} rad a variable differs by {off[worst]:.2g} rad"
            )
            continue
        inputs = tuple(motion.inputs[candidate.middle].tolist())
        places = tuple(candidate.places.tolist())
        modes.append(Mode(mode.number, mode.title, inputs, places))
        compared.append(len(off))
        differences.append(float(np.max(off)))
    if not modes:
        raise EngineError(
            f"{varied.mechanism.name}: no assembly mode can be written: "
            f"{'; '.join(left_out)}"
        )
    return ModeTable(tuple(modes), tuple(left_out), min(compared), max(differences))


def passive_variables(terms: VariedTerms) -> dict[str, int]:
    """Return the numbers of the variables of passive R pairs, by the names of the pairs."""
    return {k: v for k, v in terms.mechanism.angles.items() if k not in terms.inputs}


def _find_candidate(
    tracer: PositionAnalysis,
    sampled: Motion,
    mode: AssemblyMode,
    varied: VariedMechanism,
    terms: VariedTerms,
) -> ModeCandidate:
    """Return an assembly mode with its configurations and its places.

    Raises
    ------
    ModeProblem
        If the mode has no regular sample, or no one sign for each dyad.
    """
    motion = _regular_rows(tracer, sampled, mode)
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


def _regular_rows(tracer: PositionAnalysis, sampled: Motion, mode: AssemblyMode) -> Motion:
    """Return rows of an assembly mode at which it is well conditioned.

    Near a dead centre variables lose digits, and Newton's method is led astray. So the
    better conditioned half of the samples is used.
    """
    rows = _known_rows(sampled, mode)
    if not len(rows) and len(tracer.inputs) == 1:
        sampled = tracer.at(np.linspace(*tracer.range, FINE_SAMPLES))
        rows = _known_rows(sampled, mode)
    if not len(rows):
        codes = sampled.status[sampled.assembly_mode == mode.number]
        counts = zip(*np.unique(codes, return_counts=True), strict=True)
        statuses = listing(f"{count} {Status(int(code)).name}" for code, count in counts)
        raise ModeProblem(
            f"no sample was found at which it is well conditioned ({statuses}); give "
            "ranges of the inputs in which it closes"
        )
    motion = sampled.rows(rows)
    sensitivity = motion.sensitivity
    better = np.flatnonzero(sensitivity <= np.median(sensitivity))
    spread = np.linspace(0, len(better) - 1, COMPARED_INPUTS)
    return motion.rows(better[np.unique(np.round(spread).astype(int))])


def _known_rows(sampled: Motion, mode: AssemblyMode) -> Indices:
    """Return the numbers of a mode's rows that are known well enough to be compared."""
    is_regular = (sampled.assembly_mode == mode.number) & (sampled.status == Status.OK)
    rows = np.flatnonzero(is_regular)
    is_known = sampled.rows(rows).configuration_error <= MAX_CONFIGURATION_ERROR_RAD
    return np.asarray(rows[is_known])


def _dyad_signs(terms: VariedTerms, values: Floats) -> Floats:
    """Return the sides (dyads,) of dyads in solving order.

    `values` (n, variables) are configurations of one mode of the mechanism in which links
    between centres take the place of contacts.

    Raises
    ------
    ModeProblem
        If a dyad changes its side within the mode. That is possible where another dyad
        changes its side at the same input.
    """
    mechanism = terms.mechanism
    vectors = Closure.of(mechanism, joints_of(mechanism)).at(values).vectors
    signs: list[float] = []
    for group in terms.structure.assembly.groups:
        axes = vectors[:, [mechanism.variables_of(pair)[0] for pair in group.pairs]]
        triple_products = np.linalg.det(axes)
        largest = triple_products[np.argmax(np.abs(triple_products))]
        clear = triple_products[np.abs(triple_products) > CLEAR_TRIPLE_PRODUCT]
        if np.any(clear * largest < 0.0):
            pairs = listing(mechanism.names_of(group.pairs))
            raise ModeProblem(
                f"the dyad of pairs {pairs} changes its side within this mode; export "
                "ranges of the inputs in which it does not"
            )
        signs.append(1.0 if largest >= 0.0 else -1.0)
    return np.array(signs)


def _differences(
    formulas: Formulas,
    terms: VariedTerms,
    angles: Sequence[Expr],
    candidates: Sequence[ModeCandidate],
) -> list[Floats]:
    """Return for each candidate (n,) rad, the largest difference of a variable in each row.

    It is NaN where the formulas do not close. In closed form the variables follow from the
    signs. Without a closed form Newton's steps start beside the configurations: each
    variable is moved, by so little that the steps can lead to no other mode.
    """
    if not candidates:
        return []
    counts = [len(candidate.motion) for candidate in candidates]
    inputs = np.concatenate([candidate.motion.inputs for candidate in candidates]).T
    expected = np.concatenate([candidate.values for candidate in candidates]).T
    motion = np.zeros((len(formulas.motion), sum(counts)))
    motion[: len(inputs)] = inputs  # rates, accelerations and loads do not move the pairs
    if terms.closed_form:
        places = np.stack([candidate.places for candidate in candidates], axis=1)
        evaluate = formulas.numpy_function(angles)
        computed = evaluate(motion, np.repeat(places, counts, axis=1), formulas.size_values)
        off = wrap(computed - expected[[*passive_variables(terms).values()]])
    else:
        sensitivity = np.concatenate([one.motion.sensitivity for one in candidates])
        offset = START_OFFSET_RAD / np.maximum(1.0, sensitivity**2)
        senses = np.where(np.arange(len(expected)) % 2, 1.0, -1.0)
        computed = expected + senses[:, None] * offset
        step = formulas.numpy_function(formulas.step)
        for _ in range(NEWTON_STEPS):
            computed = step(motion, computed, formulas.size_values)[:-1]
        off = computed - expected
        turning = [*terms.mechanism.angles.values()]  # others are arc lengths of profiles
        off[turning] = wrap(off[turning])
    largest = max_abs(off, axis=0) if len(off) else np.zeros(off.shape[1])
    return np.split(largest, np.cumsum(counts)[:-1])
