"""Reductions: the ways in which values at samples become one figure of merit.

Each way is one entry of `REDUCTION_BY_NAME`, with its meaning, the number that it gives and
the derivatives of this number. A new reduction needs an entry here, and its name in the
help of ``--reduce`` in `cli/sweep.py`, which loads no other module.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Floats
from spherekit.geometry.vectors import nans
from spherekit.numerics.angle_swings import find_widest_swings

SMALLEST_RMS = 1e-300
"""Smallest root mean square by which its derivatives are divided.

It avoids 0 / 0 for values that are all zero. Their derivatives are then zero.
"""


@dataclass(frozen=True)
class SampledValues:
    """Values of a quantity at k samples, before their reduction to one number.

    A reduction computes one number (a figure of merit) for each assembly mode. Examples are
    the maximum of the values, and the input at which the maximum occurs.

    Attributes
    ----------
    q
        (k,) the input (rad) at each sample, which is reported as the place of an extreme.
        With several inputs, the user names one of them for this purpose.
    values
        (k, n) the values in n assembly modes (ways to assemble the mechanism). NaN where a
        mode cannot be assembled.
    is_closed_path
        Whether the samples are a path that ends where it began. The inputs of the last
        sample then equal the inputs of the first sample, apart from whole revolutions. Only
        the reduction to a swing uses this fact. A mean counts both samples.
    """

    q: Floats
    values: Floats
    is_closed_path: bool = False


@dataclass(frozen=True)
class Reduction:
    """A way in which the values of a quantity at samples become one number.

    Examples are the maximum, and the input at which the maximum occurs.

    Attributes
    ----------
    meaning
        Its meaning in a few words.
    reduce
        Function that returns the reduced value (n,) of each mode. It ignores NaN, and
        returns NaN if all values are NaN. Infinite values count. Only the swing, the range
        of an angle with whole turns counted, treats them like NaN.
    weights
        Function that returns the derivatives (k,) of the number with respect to the values
        at the k samples, for a single mode. Its arguments are the values and the number.
        None if the number is the input of a sample, which small changes of the values do
        not change.
    returns_input
        Whether the number is an input (rad) and not a value of the quantity.
    needs_point
        Whether the number is the value at inputs that the user states, as in
        ``at(theta_41, 30)``.
    """

    meaning: str
    reduce: Callable[[SampledValues], Floats]
    weights: Callable[[SampledValues, float], Floats] | None = None
    returns_input: bool = False
    needs_point: bool = False


def reduce_samples(
    reduction: str, q: Floats, values: Floats, is_closed_path: bool = False
) -> Floats:
    """Reduce the values of a quantity at samples to one number (n,) for each assembly mode.

    For example, the maximum of all values is computed.

    Parameters
    ----------
    reduction
        Name of the reduction, a key of `REDUCTION_BY_NAME`.
    q
        (k,) the input (rad) at each of k samples.
    values
        (k, n) the values in n assembly modes, NaN where a mode cannot be assembled.
    is_closed_path
        Whether the last sample repeats the first one, full revolutions of the inputs later.

    Returns
    -------
    (n,) numbers, NaN if all values are NaN.
    """
    if not len(values):
        return nans(values.shape[1])
    with np.errstate(all="ignore"):
        samples = SampledValues(q, values, is_closed_path)
        return REDUCTION_BY_NAME[reduction].reduce(samples)


def sample_weights(
    reduction: str, values: Floats, figure: float, is_closed_path: bool
) -> Floats | None:
    """Return the derivatives of a reduced number with respect to the values at the samples.

    For example, the derivative of a largest value is 1 at the sample where it occurs, and 0
    at all other samples.

    Parameters
    ----------
    reduction
        Name of the reduction, a key of `REDUCTION_BY_NAME`.
    values
        (k,) values, NaN where the mechanism cannot be assembled.
    figure
        The reduced number. Some derivatives depend on the reduced number, such as the
        derivatives of the root of the mean square.
    is_closed_path
        Whether the last sample repeats the first one, full revolutions of the inputs later.

    Returns
    -------
    (k,) derivatives, zero at samples that do not count. None if the reduced number is an
    input, such as the input at which the value is smallest (``"argmin"``).
    """
    weights = REDUCTION_BY_NAME[reduction].weights
    if weights is None:
        return None
    if not np.any(np.isfinite(values)):
        return np.zeros(len(values))
    # No function of `weights` reads the inputs, so they are NaN.
    no_inputs = nans(len(values))
    # `SampledValues` has a column for each assembly mode (way to assemble the mechanism).
    # Here there is one mode.
    values_by_mode = values[:, None]
    return weights(SampledValues(no_inputs, values_by_mode, is_closed_path), figure)


def _least(samples: SampledValues) -> Floats:
    # fmin ignores NaN.
    return np.asarray(np.fmin.reduce(samples.values))


def _greatest(samples: SampledValues) -> Floats:
    return np.asarray(np.fmax.reduce(samples.values))


def _range(samples: SampledValues) -> Floats:
    return _greatest(samples) - _least(samples)


def _sum(samples: SampledValues) -> Floats:
    # An infinite value counts. Without it, the finite sum would look correct.
    is_known = ~np.isnan(samples.values)
    total = np.sum(samples.values, axis=0, where=is_known)
    return np.where(np.any(is_known, axis=0), total, np.nan)


def _mean(samples: SampledValues) -> Floats:
    is_known = ~np.isnan(samples.values)
    total = np.sum(samples.values, axis=0, where=is_known)
    return np.asarray(total / np.sum(is_known, axis=0))


def _root_mean_square(samples: SampledValues) -> Floats:
    is_known = ~np.isnan(samples.values)
    total = np.sum(samples.values * samples.values, axis=0, where=is_known)
    return np.sqrt(total / np.sum(is_known, axis=0))


def _swing(samples: SampledValues) -> Floats:
    return find_widest_swings(samples.values, samples.is_closed_path).swing


def _only_value(samples: SampledValues) -> Floats:
    # A figure at given inputs has a single sample.
    return samples.values[-1]


def _input_at_least(samples: SampledValues) -> Floats:
    # `nan_to_num` also makes infinite values finite, so NaN is larger than each of them.
    row = np.argmin(np.nan_to_num(samples.values, nan=np.inf), axis=0)
    has_value = np.any(~np.isnan(samples.values), axis=0)
    return np.where(has_value, samples.q[row], np.nan)


def _input_at_greatest(samples: SampledValues) -> Floats:
    # The largest value is the smallest one with the sign changed.
    return _input_at_least(SampledValues(samples.q, -samples.values))


def _least_weights(samples: SampledValues, figure: float) -> Floats:
    weights = np.zeros(len(samples.values))
    weights[np.nanargmin(samples.values)] = 1.0
    return weights


def _greatest_weights(samples: SampledValues, figure: float) -> Floats:
    weights = np.zeros(len(samples.values))
    weights[np.nanargmax(samples.values)] = 1.0
    return weights


def _range_weights(samples: SampledValues, figure: float) -> Floats:
    return _greatest_weights(samples, figure) - _least_weights(samples, figure)


def _sum_weights(samples: SampledValues, figure: float) -> Floats:
    return np.isfinite(samples.values[:, 0]).astype(float)


def _mean_weights(samples: SampledValues, figure: float) -> Floats:
    is_finite = np.isfinite(samples.values[:, 0])
    return np.where(is_finite, 1.0 / np.sum(is_finite), 0.0)


def _root_mean_square_weights(samples: SampledValues, figure: float) -> Floats:
    values = np.nan_to_num(samples.values[:, 0])
    return _mean_weights(samples, figure) * (values / max(figure, SMALLEST_RMS))


def _swing_weights(samples: SampledValues, figure: float) -> Floats:
    swings = find_widest_swings(samples.values, samples.is_closed_path)
    weights = np.zeros(len(samples.values))
    weights[swings.high_sample] += 1.0
    weights[swings.low_sample] -= 1.0
    return weights


REDUCTION_BY_NAME: Mapping[str, Reduction] = {
    "min": Reduction("the least value", _least, _least_weights),
    "max": Reduction("the greatest value", _greatest, _greatest_weights),
    "mean": Reduction("the mean over the rows", _mean, _mean_weights),
    "rms": Reduction(
        "the root of the mean square", _root_mean_square, _root_mean_square_weights
    ),
    "range": Reduction("the greatest value less the least", _range, _range_weights),
    "swing": Reduction(
        "the range of an angle that is followed over whole turns", _swing, _swing_weights
    ),
    "sum": Reduction("the sum over the rows", _sum, _sum_weights),
    "argmin": Reduction(
        "the input at which it is least", _input_at_least, returns_input=True
    ),
    "argmax": Reduction(
        "the input at which it is greatest", _input_at_greatest, returns_input=True
    ),
    "at": Reduction(
        "the value at an input: at(EXPRESSION, Q); at several: at(EXPRESSION, Q, Q)",
        _only_value,
        _mean_weights,
        needs_point=True,
    ),
}
"""All reductions by the names that figures of merit use. Rows that fail are left out."""

REDUCTIONS: Mapping[str, str] = {
    name: reduction.meaning for name, reduction in REDUCTION_BY_NAME.items()
}
"""Meanings of the reductions by their names."""
