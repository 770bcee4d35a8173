"""The names that a mechanism file gives to assembly modes."""

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from spherekit.arrays import Floats
from spherekit.conventions import Names
from spherekit.geometry.vectors import all_finite
from spherekit.numerics.angles import wrap
from spherekit.positions.assembly_mode import AssemblyMode
from spherekit.positions.mode_predictor import ModeOverGrid
from spherekit.positions.position_solver import PositionSolver
from spherekit.wording import listing, numbered

MAX_NAME_DEVIATION_RAD = np.radians(10.0)
"""Largest deviation of the angles of a mode from the stated angles of its name.

Larger: a name whose angles are wrong is given to some mode all the same. Smaller: angles
that were read off a drawing have to be more accurate.
"""
MAX_DEVIATION_RATIO = 0.5
"""Largest deviation of the named mode, relative to the deviation of every other mode.

Larger: the name is accepted where two modes fit nearly as well. Smaller: names are refused
where modes are close to each other.
"""


class NamedModes(NamedTuple):
    """Assembly modes with the names that the mechanism file gives them.

    Attributes
    ----------
    assembly_modes
        The modes with their names.
    unused_names
        A sentence for each name in the file that no mode has.
    """

    assembly_modes: tuple[AssemblyMode, ...]
    unused_names: Names


def assign_mode_names(
    solver: PositionSolver,
    assembly_modes: Sequence[AssemblyMode],
    sampled_inputs: Floats,
) -> NamedModes:
    """Return the assembly modes of a mechanism with the names that its file gives them.

    An assembly mode is one way to assemble the mechanism. For each name the file lists a
    configuration: values of all inputs and of some other pairs. The mode nearest to this
    configuration receives the name.

    Parameters
    ----------
    solver
        The mechanism. `mechanism.modes` has the values (rad) of pairs for each name.
    assembly_modes
        All its modes.
    sampled_inputs
        (n, inputs) the samples of the inputs (rad) over which the modes are known.
    """
    # Names by the index of their mode, and sentences about names that no mode has.
    names: dict[int, str] = {}
    unused_names: list[str] = []
    if not assembly_modes:
        return NamedModes((), ())
    inputs = solver.mechanism.input_pairs
    for name, angles_by_pair in solver.mechanism.modes.items():
        # `reason` says why the name fits no mode; it is empty if it fits mode `index`.
        missing_inputs = [pair for pair in inputs if pair not in angles_by_pair]
        if missing_inputs:
            index, reason = -1, f"it has no value of {numbered('input', missing_inputs)}"
        else:
            index, reason = _find_named_mode(
                solver, assembly_modes, angles_by_pair, sampled_inputs
            )
        if not reason and index in names:
            reason = (
                f"it is mode {assembly_modes[index].number}, which already has the name "
                f"{names[index]}"
            )
        if reason:
            unused_names.append(f"modes.{name}: {reason}; no mode has this name")
        else:
            names[index] = name
    return NamedModes(
        tuple(
            mode._replace(name=names.get(index, ""))
            for index, mode in enumerate(assembly_modes)
        ),
        tuple(unused_names),
    )


def _find_named_mode(
    solver: PositionSolver,
    assembly_modes: Sequence[AssemblyMode],
    angles_by_pair: Mapping[str, float],
    sampled_inputs: Floats,
) -> tuple[int, str]:
    """Find the mode that a name in the mechanism file means.

    The file states angles of the mode. The mode must be near to these angles, and clearly
    nearer than all other modes.

    Parameters
    ----------
    solver
        The mechanism.
    assembly_modes
        Its modes.
    angles_by_pair
        Angles (rad) of all inputs and of some other pairs, by their names.
    sampled_inputs
        (n, inputs) the samples of the inputs (rad) over which the modes are known.

    Returns
    -------
    index
        Index of the mode in `assembly_modes`, or -1.
    reason
        Why no mode has these angles, for a message on the name; empty if one has them.
    """
    # A mode that is known only at the samples of a grid (`ModeOverGrid`) cannot be
    # evaluated at the stated inputs.
    if any(isinstance(mode.guide, ModeOverGrid) for mode in assembly_modes):
        return -1, "modes followed over samples of several inputs have no names"
    inputs = solver.mechanism.input_pairs
    # The solver has the inputs in the order of the assembly plan.
    input_order = solver.mechanism.names_of(solver.assembly.inputs)
    values = np.zeros(len(solver.mechanism.variable_owners))
    driven = list(solver.driven)
    values[driven] = [angles_by_pair[pair] for pair in input_order]
    # The configurations repeat after a period of an input. A mode is known near the samples
    # only, and can pass to other signs at each crossing of curves.
    q = solver.shift_near_samples(values, sampled_inputs)[:, driven]
    passive_pairs = [pair for pair in angles_by_pair if pair not in inputs]
    variables = [solver.mechanism.angles[pair] for pair in passive_pairs]
    configurations = np.array(
        [solver.evaluate(mode, q).values[0] for mode in assembly_modes]
    )
    angles_of_modes = configurations[:, variables]
    stated_angles = [angles_by_pair[pair] for pair in passive_pairs]
    differences = np.abs(wrap(angles_of_modes - stated_angles))
    # A mode that has no configuration at these inputs is infinitely far away.
    exists = all_finite(configurations, 1)
    deviations = np.where(exists, np.max(differences, axis=1, initial=0.0), np.inf)
    # The best mode must be near, and much nearer than all others.
    best = int(np.argmin(deviations))
    other_deviations = np.delete(deviations, best)
    # If there is no other mode, only the absolute limit applies.
    relative_limit = MAX_DEVIATION_RATIO * np.min(other_deviations, initial=np.inf)
    limit = min(MAX_NAME_DEVIATION_RAD, float(relative_limit))
    if deviations[best] < limit:
        return best, ""
    existing_modes = [
        f"mode {mode.number}: {', '.join(_format_angles(passive_pairs, wrap(angles)))}"
        for mode, angles, has_angles in zip(
            assembly_modes, angles_of_modes, exists, strict=True
        )
        if has_angles
    ]
    stated_inputs = _format_angles(inputs, (angles_by_pair[pair] for pair in inputs))
    return -1, (
        f"no mode has these angles at {listing(stated_inputs)}, where there are "
        f"{listing(existing_modes) or 'no known modes'}"
    )


def _format_angles(pairs: Iterable[str], angles: Iterable[float]) -> list[str]:
    """Return texts such as ``21 = 40 deg`` for angles in rad."""
    return [
        f"{pair} = {angle:.6g} deg"
        for pair, angle in zip(pairs, np.degrees([*angles]), strict=True)
    ]
