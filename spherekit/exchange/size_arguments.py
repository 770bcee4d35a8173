"""Checks that numbers of a file which are arguments of formulas have their effect there.

A number that the formulas do not follow is refused, and a number with which no result
changes is found.
"""

from collections.abc import Iterable

import numpy as np

from spherekit.arrays import Floats
from spherekit.conventions import Names, listing
from spherekit.design.profile_numbers import numbers_of, profiles_of, tracks_of
from spherekit.design.variables import ACTIONS, DesignVariable, designed
from spherekit.design.varied import VariedMechanism
from spherekit.errors import DesignError, SpherekitError
from spherekit.exchange.formula_terms import Formulas
from spherekit.model.mechanism import Mechanism

STEP = 1e-3
"""By this part of a number, or by so much of zero, it is changed to see its effect."""
LEAST_EFFECT = 1e-11
"""Results that change by a smaller part of their size do not change but for rounding."""
LEAST_SIZE = 1e-3
"""Kinematic results that are smaller everywhere have the size of 1e-3 rad, or 1e-3."""
KINEMATIC_UNITS = ("rad", "", "1/rad")


def check_numbers_are_followed(varied: VariedMechanism) -> None:
    """Raise `DesignError` where the formulas would not follow a number that varies.

    Arcs, angles, axes and directions are terms, and masses, loads and contacts of circles
    are read from the whole file. Everything else stands in the formulas as numbers:
    profiles that are no circles as series, circles whose contacts are not computed as links
    between centres, and P pairs that are given by points.
    """
    if varied.contacts is not None:
        return
    mechanism = varied.mechanism
    before = _profile_numbers(mechanism)
    fixed = []
    for variable in varied.variables:
        is_fixed = variable.slot is None and variable.path[0] not in ACTIONS
        if mechanism.has_contacts and not is_fixed:
            after = _profile_numbers_beside(varied, variable)
            is_fixed = after is None or not np.array_equal(before, after)
        if is_fixed:
            fixed.append(variable.key)
    if fixed:
        raise DesignError(
            f"{mechanism.name}: {listing(fixed)}: formulas hold the profiles of these "
            "contacts, and pairs given by points, as numbers, which do not follow this "
            "one; vary other numbers, and export one file for each size of these"
        )


def _profile_numbers(mechanism: Mechanism) -> Floats:
    """Return all numbers of profiles, and the arc lengths at which variables are zero."""
    numbers = [numbers_of(profile) for profile, _ in profiles_of(mechanism)]
    starts = [track.start for track in tracks_of(mechanism)]
    return np.concatenate([*numbers, starts])


def _profile_numbers_beside(
    varied: VariedMechanism, variable: DesignVariable
) -> Floats | None:
    """Return the same of a mechanism with another number, None if there is no such."""
    size = abs(variable.value) or 1.0
    for step in (STEP * size, -STEP * size, 1.0, -1.0):  # some numbers are whole
        try:
            beside = designed(varied.document, [variable], [variable.value + step])
            return _profile_numbers(beside)
        except SpherekitError:
            continue
    return None


def check_arguments(every: Iterable[Formulas]) -> None:
    """Raise `DesignError` if a size is an argument with which no result changes.

    Parameters
    ----------
    every
        Formulas with the same sizes, of which one at least has to change.
    """
    idle = idle_arguments(every)
    if idle:
        raise DesignError(
            f"{listing(idle)}: no result that is exported changes with this number; leave "
            "it out, or ask for quantities that depend on it"
        )


def idle_arguments(every: Iterable[Formulas]) -> Names:
    """Return the keys of the sizes with which no result of any formulas changes."""
    idle_by_formulas = [_idle_arguments(formulas) for formulas in every]
    common = set.intersection(*map(set, idle_by_formulas))
    return tuple(key for key in idle_by_formulas[0] if key in common)


def _idle_arguments(formulas: Formulas) -> list[str]:
    """Return the keys of the sizes with which no result changes.

    Each size is changed by a small part, at one configuration of each assembly mode, while
    everything moves. Without a closed form a step of Newton's method is a result too, for
    the variables then follow the size.
    """
    sizes, modes = formulas.sizes, formulas.modes
    if not sizes:
        return []
    outputs = [*formulas.outputs, *formulas.step]
    motion = np.tile(0.3 + 0.1 * np.arange(len(formulas.motion)), (len(modes), 1)).T
    inputs = np.array([mode.at for mode in modes]).T
    motion[: len(inputs)] = inputs
    places = np.array([mode.values for mode in modes]).T.reshape(-1, len(modes))
    evaluate = formulas.numpy_function(outputs)
    before = evaluate(motion, places, formulas.size_values)
    units = [*formulas.results.values(), *("" for _ in formulas.step)]
    floor = np.where([unit in KINEMATIC_UNITS for unit in units], LEAST_SIZE, 0.0)
    scale = np.maximum(np.max(np.abs(np.nan_to_num(before)), axis=1), floor)
    idle = []
    for k, size in enumerate(sizes):
        beside = formulas.size_values
        beside[k] += STEP * (abs(size.value) or 1.0)
        after = evaluate(motion, places, beside)
        change = np.where(np.isnan(after) & np.isnan(before), 0.0, np.abs(after - before))
        effect = np.nan_to_num(change, nan=np.inf) > LEAST_EFFECT * scale[:, None]
        if not np.any(effect):
            idle.append(size.key)
    return idle
