"""The part of a mechanism that determines the positions of the output links.

Singularities of the output are searched on this part alone. Links that are attached to it
do not affect the output, but multiply the assembly modes and curves to be searched. They
are left out only if they add no dead centre, at which they would stop the input.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from spherekit.geometry.vectors import max_abs
from spherekit.numerics.angles import wrap
from spherekit.planning.submechanism import part_for
from spherekit.positions.configuration_space import EQUAL_CONFIGURATION_RAD
from spherekit.positions.input_turning_points import (
    RUN_COST_S,
    RUN_TIME_S,
    InputTurningPoints,
    find_input_turning_points,
)
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.status import Status

COMPARED_SAMPLES = 9
"""Number of samples at which assembly modes of the part and of the whole are compared.
Larger: modes that agree by chance are distinguished; smaller: faster."""
EQUAL_TURNING_INPUT_RAD = 1e-6
"""Inputs at which modes meet are the same in the part and in the whole if they differ by
less. Larger: other dead centres count as the same; smaller: rounding prevents the use of
the part."""


@dataclass(frozen=True)
class PlacingPart:
    """The part of a mechanism that determines the positions of the output links.

    All other links follow this part without an effect on the output. The part has fewer
    configurations than the whole mechanism, so singularities of the output are searched on
    the part. The part is the whole mechanism if nothing can be left out.

    An assembly mode is one of the ways to assemble the links at the same input. Each mode
    of the whole mechanism contains one mode of the part.

    Attributes
    ----------
    position_analysis
        The position analysis of the part.
    variables
        For each variable of the part, its index in the whole mechanism.
    whole_modes
        By the number of each mode of the part: the modes of the whole mechanism that
        contain it. For example (0, 2) for mode 0 of the part, and (1, 3) for mode 1.
    """

    position_analysis: PositionAnalysis
    variables: list[int]
    whole_modes: dict[int, tuple[int, ...]]


def find_placing_part(whole: PositionAnalysis, links: Iterable[int]) -> PlacingPart:
    """Return the part of a mechanism that determines the positions of some links.

    All links without an effect on these links are left out. The part then has fewer
    configurations, on which the caller searches singularities. If no link can be left out,
    the result is the whole mechanism.

    Parameters
    ----------
    whole
        Position analysis of the whole mechanism, with one input.
    links
        Indices of the links.
    """
    part = _find_smaller_part(whole, links)
    if part is not None:
        return part
    # The part is the whole mechanism. Its variables keep their indices, and each
    # assembly mode (way to assemble the mechanism) of the part is the same mode of the
    # whole.
    variable_count = len(whole.mechanism.variable_owners)
    same_modes: dict[int, tuple[int, ...]] = {}
    for mode in whole.assembly_modes:
        same_modes[mode.number] = (mode.number,)
    return PlacingPart(
        position_analysis=whole,
        variables=list(range(variable_count)),
        whole_modes=same_modes,
    )


def _find_smaller_part(whole: PositionAnalysis, links: Iterable[int]) -> PlacingPart | None:
    """Return the part of a mechanism that places some links, None if it cannot be used.

    The part determines the positions of these links. It has fewer configurations to examine
    than the whole mechanism. It must fulfil two conditions:

    - Each assembly mode (way to assemble the links) of the whole mechanism contains one
      mode of the part. This is tested at some samples of the input.
    - Whole and part have the same dead centres, at which the input turns back. With other
      dead centres, links outside of the part would stop the input where the part alone
      moves on.

    Parameters
    ----------
    whole
        Position analysis of the whole mechanism, with one input.
    links
        Indices of the links.
    """
    mechanism = whole.mechanism
    if whole.by_rank:
        # The mobility does not follow from the numbers of links and pairs. A part is chosen
        # by counting links and pairs, which would fail.
        return None
    part_mechanism = part_for(mechanism, links)
    if part_mechanism is mechanism:
        # All links belong to the part.
        return None
    if whole.solver.gear_phases is not None:
        # Wheels roll on each other. Their phases depend on all wheels.
        return None
    path = np.linspace(*whole.range, COMPARED_SAMPLES)[:, None]
    part = PositionAnalysis(part_mechanism, path=path)
    variables: list[int] = []
    for pair in part_mechanism.pairs:
        number = mechanism.pair_number[pair.name]
        variables += mechanism.variables_of(number)
    # For each mode of the part the modes of the whole that contain it, or None.
    whole_modes = _match_modes(whole, part, variables)
    if whole_modes is None or not _have_same_turning_points(whole, part):
        return None
    return PlacingPart(part, variables, whole_modes)


def _have_same_turning_points(whole: PositionAnalysis, part: PositionAnalysis) -> bool:
    """Return whether the whole mechanism and a part of it have the same dead centres.

    At a dead centre the input turns back. If only the whole mechanism has a dead centre,
    links outside of the part stop the input, and the part alone must not be examined. The
    result is also False if the search may have missed dead centres of the whole.
    """
    whole_points = _find_dead_centres(whole)
    part_points = _find_dead_centres(part)
    # `doubtful` are intervals of the input in which dead centres may have been missed.
    if len(whole_points.doubtful) > 0:
        return False
    whole_inputs = whole_points.turning_inputs
    part_inputs = part_points.turning_inputs
    if len(whole_inputs) != len(part_inputs):
        return False
    differences = np.abs(whole_inputs - part_inputs)
    return bool(np.all(differences < EQUAL_TURNING_INPUT_RAD))


def _find_dead_centres(position_analysis: PositionAnalysis) -> InputTurningPoints:
    """Return the dead centres of a mechanism in one revolution of its input.

    At a dead centre the input turns back while the mechanism moves on.

    The search ends after about `RUN_TIME_S`. There is no search if a value for a group of
    three loops takes longer than `RUN_COST_S`. Intervals of the input in which dead centres
    cannot be excluded are doubtful.
    """
    return find_input_turning_points(
        position_analysis.solver, -np.pi, np.pi, RUN_COST_S, RUN_TIME_S
    )


def _match_modes(
    whole: PositionAnalysis, part: PositionAnalysis, variables: list[int]
) -> dict[int, tuple[int, ...]] | None:
    """Return the assembly modes of the whole mechanism that contain each mode of a part.

    The part has only the links that determine the positions of the output links. It is
    examined in place of the whole mechanism. Its results then apply to the modes of the
    whole that this function finds.

    An assembly mode is a way to assemble the mechanism. A mode of the whole contains a mode
    of the part if the variables of the part have the same values in both. The values are
    compared at those of a few samples at which the mode of the whole has a configuration.

    Parameters
    ----------
    whole, part
        Position analyses.
    variables
        For each variable of the part, its index in the whole mechanism.

    Returns
    -------
    Numbers of modes of the whole by the number of each mode of the part. None if this is
    not possible: a mode of the whole contains no mode of the part, or has no configuration
    at the samples.
    """
    # This motion has the whole mechanism at few samples of the input, in all its modes.
    motion = whole.sparse(COMPARED_SAMPLES)
    sample_count = motion.samples
    # The rows of a motion are mode after mode, and all modes have the same inputs. So the
    # rows of the first mode have the inputs of all samples.
    sampled_inputs = motion.inputs[:sample_count]
    # For each mode of the part: the variables (samples, variables) at the samples.
    part_values = {
        mode.number: part.solver.evaluate(mode, sampled_inputs).values
        for mode in part.assembly_modes
    }
    whole_modes: dict[int, tuple[int, ...]] = dict.fromkeys(part_values, ())
    # Axes: mode of the whole, sample, variable of the part.
    shape = (-1, sample_count, len(variables))
    whole_values = motion.values[:, variables].reshape(shape)
    statuses = motion.status.reshape(-1, sample_count)
    for mode, values, status in zip(
        whole.assembly_modes, whole_values, statuses, strict=True
    ):
        has_configuration = status == Status.OK
        if not np.any(has_configuration):
            return None
        # The first mode of the part that agrees.
        part_number = None
        for number, values_of_part in part_values.items():
            differences = wrap((values_of_part - values)[has_configuration])
            if max_abs(differences) < EQUAL_CONFIGURATION_RAD:
                part_number = number
                break
        if part_number is None:
            return None
        whole_modes[part_number] += (mode.number,)
    return whole_modes
