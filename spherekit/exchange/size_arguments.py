"""Checks that each size of explicit formulas changes the results as it should.

The *sizes* of formulas are numbers of the mechanism file that the user has chosen as
arguments. There are two kinds of faults. The formulas may contain constants that would have
to change with a size but do not; such a size is rejected. And there may be no result that
depends on a size; such a size is called idle.
"""

from collections.abc import Iterable

import numpy as np

from spherekit.arrays import Floats
from spherekit.conventions import Names
from spherekit.designs.design_variables import ACTIONS, DesignVariable, make_design
from spherekit.designs.profile_numbers import (
    list_profiles,
    make_contact_profiles,
    profile_numbers,
)
from spherekit.designs.varied_mechanism import VariedMechanism
from spherekit.errors import DesignError, SpherekitError
from spherekit.exchange.formula_expressions import FormulaFunction, Formulas
from spherekit.mechanism.mechanism import Mechanism
from spherekit.tolerances import EPS
from spherekit.wording import listing

RELATIVE_STEP = 1e-3
"""Relative change of a number that is tried to see its effect; absolute if it is zero.

With a smaller value, rounding hides weak effects. With a larger one, the changed mechanism
may not exist.
"""
MIN_RELATIVE_EFFECT = 1e-11
"""A result whose change is smaller, relative to its scale, counts as unchanged.

With a smaller value, rounding errors count as changes. With a larger one, weak effects are
missed.
"""
MIN_EFFECT_OVER_NOISE = 100.0
"""A result whose change is smaller, relative to its rounding noise, counts as unchanged.

A result such as the sum of two loads that cancel is zero up to rounding. It has no scale.
With a smaller value, rounding errors count as changes. With a larger one, weak effects are
missed.
"""
MOTION_STEP = 0.07
"""Change of the first argument of the motion in a second configuration, in its own unit.

Each further argument changes by about a tenth more than the one before.

With a smaller value, effects that are zero in the first configuration are weak in the
second one. With a larger one, the second configuration is more often beyond the range.
"""
MAX_SECOND_CONFIGURATION_STEPS = 12
"""Most steps of Newton's method that compute the second configuration."""
MAX_SECOND_CONFIGURATION_RESIDUAL = 1e-9
"""A second configuration whose closure residual (rad) is larger is not used."""
NOISE_TRIALS = 16
"""Number of evaluations from which the rounding noise of the results is estimated."""
NOISE_STEP = 32.0 * EPS
"""Largest relative change of all arguments in these evaluations."""
MIN_KINEMATIC_SCALE = 1e-3
"""Smallest scale of a result in one of the `KINEMATIC_UNITS`, in that unit.

It prevents that rounding errors of a result that is zero everywhere count as changes.
"""
KINEMATIC_UNITS = ("rad", "", "1/rad")
"""Units of angles, velocity coefficients and their derivatives."""


def check_sizes_change_no_constants(varied: VariedMechanism) -> None:
    """Check that no constant in explicit formulas would have to change with a size.

    A size is a number of the mechanism file that the user has chosen as an argument of the
    exported formulas. The formulas can have two kinds of sizes as arguments:

    - an arc, an angle, an axis of a pair or a direction of an output,
    - a number of a mass or load.

    All other numbers are constants in the formulas, so sizes of other kinds are refused.
    Examples are the numbers of contact profiles (curves), and the two points by which a
    file may state the axis of a pair (joint). An arc or an angle is refused, too, if the
    numbers of a contact profile depend on it. The message for the user names all refused
    sizes.

    In the formulas, links can replace all contacts (`varied.equivalent_linkage`). No size
    is refused then.

    Parameters
    ----------
    varied
        The mechanism, and the sizes as its `variables`.

    Raises
    ------
    DesignError
        If one of these constants would have to change with a size.
    """
    # The formulas compute the sizes of links that replace contacts from all numbers.
    if varied.equivalent_linkage is not None:
        return
    mechanism = varied.mechanism
    values_before = _profile_numbers(mechanism)
    fixed_keys = []
    for variable in varied.variables:
        # `path[0]` is the table of the file, and `ACTIONS` are the tables of masses and
        # loads.
        is_mass_or_load = variable.path[0] in ACTIONS
        # `is_angle` is true for the first kind: arcs, angles, and the longitudes and
        # latitudes of axes and directions.
        is_fixed = not variable.is_angle and not is_mass_or_load
        # The size is changed a little, to see whether the contact profiles change with it.
        # If no tried change gives a valid mechanism, the result is None and the size is
        # refused.
        if mechanism.has_contacts and not is_fixed:
            values_after = _profile_numbers_after_change(varied, variable)
            is_fixed = values_after is None or not np.array_equal(
                values_before, values_after
            )
        if is_fixed:
            fixed_keys.append(variable.key)
    if fixed_keys:
        raise DesignError(
            f"{mechanism.name}: {listing(fixed_keys)}: cannot be an argument, because "
            f"{'this key changes' if len(fixed_keys) == 1 else 'these keys change'} "
            "profiles of contacts or axes given by points, which the formulas contain as "
            "fixed numbers; export one file for each of its values, or use other keys"
        )


def _profile_numbers(mechanism: Mechanism) -> Floats:
    """Return all numbers of the contact profiles of a mechanism as one array.

    These numbers are constants in the formulas. First come, for each profile, the numbers
    that define the curve: centre, radius, points and coefficients of a series. Then comes,
    for each profile, the arc length of the contact point at which the variable of the
    contact is zero.
    """
    numbers = [profile_numbers(item.profile) for item in list_profiles(mechanism)]
    starts = [track.start for track in make_contact_profiles(mechanism)]
    return np.concatenate([*numbers, starts])


def _profile_numbers_after_change(
    varied: VariedMechanism, variable: DesignVariable
) -> Floats | None:
    """Return the numbers of all contact profiles after one number of the file is changed.

    A profile is a contact curve, which numbers such as a radius define. A comparison with
    the numbers before the change shows whether the profiles depend on the changed number.
    Several changes are tried, because some numbers must be
    whole and some changes are impossible. The result is None if no change gives a valid
    mechanism.

    Parameters
    ----------
    varied
        The mechanism with its file.
    variable
        The number that is changed.
    """
    # Steps are relative to the number. If it is zero, they are relative to 1. Steps of 1
    # are for numbers that must be whole, such as numbers of teeth.
    size = abs(variable.value) or 1.0
    for step in (RELATIVE_STEP * size, -RELATIVE_STEP * size, 1.0, -1.0):
        try:
            changed_design = make_design(
                varied.document, [variable], [variable.value + step]
            )
            return _profile_numbers(changed_design)
        except SpherekitError:
            continue  # the changed file is refused; another step is tried
    return None


def check_arguments(formula_sets: Iterable[Formulas]) -> None:
    """Check that each size changes at least one result of exported formulas.

    Parameters
    ----------
    formula_sets
        One or more sets of formulas with the same sizes (numbers of the mechanism file that
        are arguments). A size has to change a result of at least one set.

    Raises
    ------
    DesignError
        If a size changes no result.
    """
    idle_keys = idle_arguments(formula_sets)
    if idle_keys:
        raise DesignError(
            f"{listing(idle_keys)}: no result that is exported changes with this number; "
            "leave it out, or ask for quantities that depend on it"
        )


def idle_arguments(formula_sets: Iterable[Formulas]) -> Names:
    """Return the file keys of the sizes that change no result in any set of formulas.

    Parameters
    ----------
    formula_sets
        One or more sets of formulas with the same sizes.
    """
    # A size is idle if it is idle in all formulas. The result has the order of the sizes.
    idle_by_formulas = [_idle_arguments(formulas) for formulas in formula_sets]
    common = set.intersection(*map(set, idle_by_formulas))
    return tuple(key for key in idle_by_formulas[0] if key in common)


def _idle_arguments(formulas: Formulas) -> list[str]:
    """Return the file keys of the sizes that change no result of these formulas.

    A size is a number of the mechanism file that is an argument of the formulas. Each size
    in turn is changed by `RELATIVE_STEP` in one configuration of each assembly mode (way to
    assemble the mechanism). In a single configuration an effect can be zero by chance, for
    example that of the stiffness of a spring that is at rest there. A size without effect
    is therefore changed in a second configuration too.
    """
    if not formulas.sizes:
        return []
    motion = _choose_motion(formulas)
    # The numbers that select each mode: signs in closed form, otherwise the pair variables
    # from which Newton's method starts.
    mode_values = _stack_mode_values(formulas)
    idle_rows = _find_idle_rows(formulas, range(len(formulas.sizes)), motion, mode_values)
    if idle_rows:
        # `motion` has an argument of the formulas in each row, such as the inputs and their
        # rates. Each argument gets another step. The ratios of the steps are irrational, so
        # the effects of two changed arguments on a result do not cancel.
        steps = MOTION_STEP * np.exp(0.1 * np.arange(len(motion)))
        second_motion = motion + steps[:, None]
        mode_values = _follow_mode_values(formulas, second_motion, mode_values)
        idle_rows = _find_idle_rows(formulas, idle_rows, second_motion, mode_values)
    return [formulas.sizes[row].key for row in idle_rows]


def _find_idle_rows(
    formulas: Formulas, rows: Iterable[int], motion: Floats, mode_values: Floats
) -> list[int]:
    """Return which sizes change no result in one configuration of each assembly mode.

    The caller tries the returned sizes again in a second configuration, because an effect
    can be zero by chance in a single one.

    Formulas without a closed form contain a step of Newton's method that computes the pair
    variables. The variables after the step and the closure residual count as results.

    Parameters
    ----------
    formulas
        The formulas.
    rows
        Indices of the sizes that are tried, in `formulas.sizes`.
    motion, mode_values
        The configurations, one for each mode. `motion` (arguments, modes) has the inputs
        and the other arguments that describe the motion. `mode_values` (values, modes)
        select the mode: signs in closed form, otherwise pair variables near the
        configuration.
    """
    # `step` has the results of a step of Newton's method. It is empty in closed form.
    evaluate = formulas.numpy_function([*formulas.outputs, *formulas.step])
    values_before = evaluate(motion, mode_values, formulas.size_values)
    noise = _estimate_noise(evaluate, (motion, mode_values, formulas.size_values))
    least_effect = _compute_least_effects(formulas, values_before, noise)
    idle_rows = []
    for row in rows:
        changed_sizes = formulas.size_values.copy()
        changed_sizes[row] += RELATIVE_STEP * (abs(formulas.sizes[row].value) or 1.0)
        values_after = evaluate(motion, mode_values, changed_sizes)
        if not _has_effect(values_before, values_after, least_effect):
            idle_rows.append(row)
    return idle_rows


def _follow_mode_values(formulas: Formulas, motion: Floats, mode_values: Floats) -> Floats:
    """Return the numbers (values, modes) that select each assembly mode after a small step.

    The step changes the arguments of the formulas, such as the inputs and their rates. The
    caller then tests again which sizes (numbers of the mechanism file) change a result.

    The signs that select a mode of formulas in closed form stay. Otherwise pair variables
    select it, and they follow the step by Newton's method. They become NaN for a mode in
    which the loops do not close. The results of this mode are then NaN, and no size counts
    as changing them.

    Parameters
    ----------
    formulas
        The formulas.
    motion
        (arguments, modes) the arguments of the formulas after the step.
    mode_values
        (values, modes) the numbers that select the modes before the step.
    """
    if not formulas.step:
        return mode_values
    take_step = formulas.numpy_function(formulas.step)
    for _ in range(MAX_SECOND_CONFIGURATION_STEPS):
        # The last row is the closure residual before the step.
        # Steps that diverge give infinite variables.
        with np.errstate(invalid="ignore", over="ignore"):
            *variables, residual = take_step(motion, mode_values, formulas.size_values)
        mode_values = np.array(variables)
    return np.where(residual <= MAX_SECOND_CONFIGURATION_RESIDUAL, mode_values, np.nan)


def _choose_motion(formulas: Formulas) -> Floats:
    """Return values of the arguments for one configuration of each assembly mode.

    With these values the caller evaluates the formulas, before and after a change of a
    size. It thus finds the sizes that change no result.

    The configuration of a mode (way to assemble the mechanism) is at the inputs `Mode.at`.
    All other arguments, such as rates and accelerations, get arbitrary values that are not
    zero. Otherwise terms with rates would be zero, and their sizes would have no effect.

    Returns
    -------
    (arguments, modes) the array `motion` that the formulas take. The inputs come first.
    """
    arbitrary_values = 0.3 + 0.1 * np.arange(len(formulas.motion))
    motion = np.tile(arbitrary_values, (len(formulas.modes), 1)).T
    inputs = np.array([mode.at for mode in formulas.modes]).T
    motion[: len(inputs)] = inputs
    return motion


def _stack_mode_values(formulas: Formulas) -> Floats:
    """Return the numbers (values, modes) that select each assembly mode in formulas.

    An assembly mode is one way to assemble the links. The numbers are the signs of the
    dyads (groups of two links) in closed form, otherwise approximate pair variables.
    """
    modes = formulas.modes
    return np.array([mode.values for mode in modes]).T.reshape(-1, len(modes))


def _compute_least_effects(
    formulas: Formulas, values_before: Floats, noise: Floats
) -> Floats:
    """Return the smallest change of each result that cannot be rounding.

    The caller changes one size (number of the mechanism file) after another. The size has
    an effect only if a result changes by more than the smallest change. The rounding error
    is estimated twice: relative to the magnitude of the result, and from its noise. The
    larger estimate counts.

    Parameters
    ----------
    formulas
        The formulas. Formulas without a closed form contain a step of Newton's method,
        `formulas.step`.
    values_before
        (r, modes) values of the r results before a size changes, in one configuration of
        each assembly mode. If there is a step of Newton's method, the variables after it
        and the closure residual follow as further results.
    noise
        (r,) largest change of each result when the last digits of the arguments change.

    Returns
    -------
    (r,) smallest change that counts as an effect, in the unit of the result.
    """
    result_units = list(formulas.results.values())
    # Variables after a step of Newton's method and its residual are angles. Their unit here
    # is the empty text, one of the `KINEMATIC_UNITS` like "rad".
    variable_units = [""] * len(formulas.step)
    units = result_units + variable_units
    # A result that is zero up to rounding has no scale of its own. For angles and velocity
    # coefficients a smallest scale is known, so that rounding errors do not count as
    # effects.
    is_kinematic = [unit in KINEMATIC_UNITS for unit in units]
    min_scale = np.where(is_kinematic, MIN_KINEMATIC_SCALE, 0.0)
    # `nan_to_num` replaces NaN (a missing result) by 0.
    largest_value = np.max(np.abs(np.nan_to_num(values_before)), axis=1)
    scale = np.maximum(largest_value, min_scale)
    return np.maximum(MIN_RELATIVE_EFFECT * scale, MIN_EFFECT_OVER_NOISE * noise)


def _has_effect(values_before: Floats, values_after: Floats, least_effect: Floats) -> bool:
    """Return whether any result has changed by more than rounding.

    The caller changes one size after another, and lists those without effect.

    Parameters
    ----------
    values_before, values_after
        (r, modes) the r results in one configuration of each assembly mode, before and
        after a size changed. A result that is NaN only once has changed. A result that is
        NaN both times has not.
    least_effect
        (r,) the smallest change of each result that is no rounding error.
    """
    is_nan_twice = np.isnan(values_after) & np.isnan(values_before)
    change = np.where(is_nan_twice, 0.0, np.abs(values_after - values_before))
    # The difference from a single NaN is NaN, which counts as infinitely large.
    change = np.nan_to_num(change, nan=np.inf)
    return bool(np.any(change > least_effect[:, None]))


def _estimate_noise(
    evaluate: FormulaFunction, arguments: tuple[Floats, Floats, Floats]
) -> Floats:
    """Estimate by how much rounding errors change each result of formulas.

    The last digits of all arguments are changed at random several times. The random numbers
    are the same in each call.

    Parameters
    ----------
    evaluate
        Function of the arguments that returns the results (r, n) in n configurations.
    arguments
        Three arrays, as `evaluate` takes them: the motion (inputs, rates, loads), the
        mode values (numbers that select the assembly mode) and the sizes.

    Returns
    -------
    (r,) largest change of each result, in its unit; 0 for results that are NaN.
    """
    random = np.random.default_rng(0)
    before = evaluate(*arguments)
    noise = np.zeros(len(before))
    for _ in range(NOISE_TRIALS):
        motion, mode_values, sizes = (
            values * (1.0 + NOISE_STEP * random.uniform(-1.0, 1.0, values.shape))
            for values in arguments
        )
        change = np.abs(evaluate(motion, mode_values, sizes) - before)
        noise = np.maximum(noise, np.max(np.nan_to_num(change), axis=1))
    return noise
