"""Checks whether an integration step has missed an abrupt change of a load.

A Taylor series uses a load at one point of a step, and a collocation method at the nodes of
the step. A load with a steep function, such as tanh(1000 x), may change in a time that
contains no such point. This happens near zeros and extrema of the argument x
(`spherekit.mechanism.load_expression.Expression.steep_arguments`). Accepted steps are
therefore compared with the equation of motion at evenly spaced places, and at the zeros and
extrema of these arguments. The arguments are evaluated on the motion that the step gives.

A place in a step is a fraction, 0 at its start and 1 at its end.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Floats, Indices
from spherekit.numerics.bracketed_zeros import find_bracketed_zeros

EVEN_PROBES = 17
"""Evenly spaced probes of a step, both ends included.

Smaller: two zeros of an argument between neighbouring probes are missed more easily.
Larger: more time.
"""

END_DISTANCE = 1e-6
"""Distance of two further probes from the ends of a step, as a fraction of the step.

They show extrema beside an end. Larger: extrema nearer to the end are missed. Smaller: the
change of an argument over this distance is lost in rounding.
"""

ProbeFunction = Callable[[Indices, Floats], tuple[Floats, Floats]]
"""A function of indices of steps (n,) and places (n,), which checks the steps there.

A place is a fraction of its step, from 0 to 1. The step is compared with the equation of
motion. The function returns the error (n,) of the step at each place, as a multiple of the
allowed error, and the values (n, arguments) of the steep arguments.
"""


@dataclass(frozen=True)
class ProbePlaces:
    """Places in steps: `steps` (n,) indices of steps and `places` (n,) fractions."""

    steps: Indices
    places: Floats


def find_first_errors(probe: ProbeFunction, step_count: int) -> Floats:
    """Return the first place in each integration step at which its error is too large.

    An integration step can miss an abrupt change of a load, so it is compared with the
    equation of motion at further places (probed). A place is a fraction of a step, from 0
    to 1. A steep argument is the x of a function such as tanh(1000 x) or 1 / x in a load.
    The load may change abruptly where x passes 0, or nearly touches 0 at an extremum. A
    step is probed at three kinds of places:

    - evenly spaced places, and one beside each end of the step,
    - the zeros and extrema of steep arguments,
    - the middle between each two neighbours among these zeros and extrema.

    Parameters
    ----------
    probe
        A function that compares steps with indices (n,) with the equation of motion at
        places (n,). The function returns the errors (n,) of the steps as multiples of the
        allowed error, and the values (n, arguments) of the steep arguments.
    step_count
        Number of the steps.

    Returns
    -------
    (step_count,) places between 0 and 1; infinity for steps without such an error.
    """
    even_places = _list_even_places()
    steps = np.repeat(np.arange(step_count), len(even_places))
    places = np.tile(even_places, step_count)
    errors, argument_rows = probe(steps, places)
    arguments = argument_rows.reshape(step_count, len(even_places), argument_rows.shape[1])

    # Zeros and extrema of the arguments, and the middles between them.
    # Arguments can be infinite, and the difference of two infinities is NaN.
    with np.errstate(invalid="ignore"):
        critical = _find_critical_places(probe, arguments, even_places)
    critical_errors, _ = probe(critical.steps, critical.places)

    steps = np.append(steps, critical.steps)
    places = np.append(places, critical.places)
    errors = np.append(errors, critical_errors)
    is_too_large = ~(errors <= 1.0)  # this includes NaN
    first_places = np.full(step_count, np.inf)
    # The smallest place of each step. A step can occur several times in `steps`.
    np.minimum.at(first_places, steps[is_too_large], places[is_too_large])
    return first_places


def _list_even_places() -> Floats:
    """Return the rising places, fractions of a step, at which all steps are probed.

    Places are fractions of the length of a step. Most are evenly spaced from 0 to 1, and
    two more are right beside the ends. An extremum is found between the outer two of three
    successive places. With the two further places, extrema right at the ends are found.
    """
    return np.sort([*np.linspace(0.0, 1.0, EVEN_PROBES), END_DISTANCE, 1.0 - END_DISTANCE])


def _find_critical_places(
    probe: ProbeFunction, arguments: Floats, even_places: Floats
) -> ProbePlaces:
    """Return places in steps at which a load may change abruptly.

    A place is a fraction of an integration step, from 0 to 1. A steep argument is the x of
    a function such as tanh(1000 x) or 1 / x in a load. The result has the places of zeros
    and extrema of x, and the middles between neighbouring ones. Extrema matter because x
    can touch zero there, or pass zero twice, without a change of sign between two evenly
    spaced places. In the middles, a load can differ from its values at both neighbours.

    Parameters
    ----------
    probe
        A function of the indices of steps (n,) and of places (n,) in them. It returns two
        arrays. The first has the errors of the steps at the places, and is not used here.
        The second has the values (n, arguments) of the steep arguments.
    arguments
        (steps, places, arguments) values of the arguments at evenly spaced places.
    even_places
        (places,) these places, rising.
    """

    def evaluate_arguments(steps: Indices, places: Floats) -> Floats:
        """Return the values (n, arguments) of the steep arguments at n places.

        A steep argument is the x in a load such as tanh(1000 x), which changes abruptly
        near x = 0. `steps` (n,) are the indices of the steps that contain the `places`
        (n,). A place is a fraction of a step, from 0 at its start to 1 at its end.
        """
        _, argument_rows = probe(steps, places)
        return argument_rows

    def evaluate_differences(steps: Indices, places: Floats) -> Floats:
        """Return central differences (n, arguments) of the arguments at n places.

        The differences are zero at extrema of the arguments.
        """
        # Over this distance an argument changes by more than its rounding error.
        small_distance = END_DISTANCE
        after = evaluate_arguments(steps, places + small_distance)
        before = evaluate_arguments(steps, places - small_distance)
        return after - before

    # A change of sign between neighbouring places shows a zero.
    zeros = _find_zeros(
        evaluate_arguments, arguments, low=even_places[:-1], high=even_places[1:]
    )
    # Let a, b and c be the values at three successive places. If the differences b - a and
    # c - b have different signs, there is an extremum between the places of a and c.
    extrema = _find_zeros(
        evaluate_differences,
        np.diff(arguments, axis=1),
        low=even_places[:-2],
        high=even_places[2:],
    )
    return _add_middles(
        ProbePlaces(
            steps=np.concatenate([extrema.steps, zeros.steps]),
            places=np.concatenate([extrema.places, zeros.places]),
        )
    )


def _add_middles(critical: ProbePlaces) -> ProbePlaces:
    """Return the sorted critical places, followed by the middles between neighbours.

    A critical place is a fraction of a step at which a load may jump. A load may jump up at
    one critical place and down at the next. The step may agree with the equation of motion
    at both places, and miss the load between them. So the middle is probed.
    """
    order = np.lexsort((critical.places, critical.steps))
    steps = critical.steps[order]
    places = critical.places[order]
    is_in_step_of_next = steps[1:] == steps[:-1]
    neighbours = np.flatnonzero(is_in_step_of_next)
    middles = 0.5 * (places[neighbours] + places[neighbours + 1])
    return ProbePlaces(np.append(steps, steps[neighbours]), np.append(places, middles))


def _find_zeros(
    evaluate: Callable[[Indices, Floats], Floats], values: Floats, low: Floats, high: Floats
) -> ProbePlaces:
    """Return the zeros of functions that change their sign between neighbouring values.

    A place is a fraction of an integration step, from 0 to 1. The functions were evaluated
    at k + 1 places of each step. Where successive values have different signs, the zero
    between them is computed. A value that is exactly zero has no sign: with the values
    -2, 0, 3 the change of sign is between the first and the third one.

    To find extrema of a quantity, `evaluate` is a central difference of the quantity, and
    `values` are differences between neighbouring places.

    Parameters
    ----------
    evaluate
        A function that returns the values (n, functions) for indices of steps (n,) and
        places (n,).
    values
        (steps, k + 1, functions) values of the functions in the order of rising places, or
        differences.
    low, high
        (k,) places: a change of sign between values j and j + 1 shows a zero between
        `low[j]` and `high[j]`.

    Returns
    -------
    The step and the place of each zero.
    """
    # For each value the index of the last value up to it that is not zero, -1 if all are.
    indices = np.arange(values.shape[1])[:, None]
    last_nonzero = np.maximum.accumulate(np.where(values != 0.0, indices, -1), axis=1)
    # Compare each value but the first one with the last value before it that has a sign.
    value_before = last_nonzero[:, :-1]
    signs = np.sign(values)
    signs_before = np.take_along_axis(signs, np.maximum(value_before, 0), axis=1)
    # For each change of sign: its step and function, and the indices of the values before
    # and after it.
    steps, positions, functions = np.nonzero(signs_before * signs[:, 1:] < 0.0)
    before = value_before[steps, positions, functions]
    after = positions + 1

    def evaluate_changing(places: Floats, changes: Indices) -> Floats:
        """Return the values (n,) of functions that change their sign, at places (n,).

        `changes` (n,) are indices of changes of sign. Each belongs to one step and one
        function, of which the value is taken.
        """
        rows = evaluate(steps[changes], places)
        return rows[np.arange(len(places)), functions[changes]]

    # For extrema, the values are differences between places and not those of `evaluate` at
    # the ends of the bracket. Their sizes only affect how fast the bracket becomes narrow.
    zeros, _ = find_bracketed_zeros(
        evaluate_changing,
        low=low[before],
        high=high[after - 1],
        values_at_low=values[steps, before, functions],
        values_at_high=values[steps, after, functions],
    )
    return ProbePlaces(steps, zeros)
