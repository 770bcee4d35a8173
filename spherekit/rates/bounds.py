"""Bounds of the errors of poles: of directions, coefficients and their derivatives."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import EPS, USABLE_DIRECTION
from spherekit.planning.poles import Pole
from spherekit.rates.core import Equations
from spherekit.rates.lines import Lines
from spherekit.rates.vectors import dot, norm
from spherekit.sphere.rotation import Floats


@final
@dataclass(frozen=True)
class Bounds:
    """Bounds (n,) of the errors of directions (rad), of rates and of their derivatives."""

    direction: dict[Pole, Floats]
    rate: dict[Pole, Floats]
    rate_dq: dict[Pole, Floats]


def mended_and_bounded(
    poles: Iterable[Pole],
    pairs: Mapping[Pole, int],
    lines: Lines,
    rates: tuple[Mapping[int, Floats], Mapping[int, Floats]],
    weak: NDArray[np.bool_],
    solved: Equations,
) -> Bounds:
    """Return what poles of bodies are off by, and mend the directions of `weak` rows.

    Those come from the relative angular velocity where it is the better source. `pairs` are
    the poles that are axes of pairs, `rates` w and dw (3, n) of bodies, however found: what
    they differ by from the solution of the velocity equations is part of their error.
    """
    n = len(weak)
    poles = list(poles)
    found = Bounds(*({pole: np.full(n, np.nan) for pole in poles} for _ in range(3)))
    # Great circles turn in proportion to the axes that they are drawn through.
    tilt = solved.motion.orientation_error / EPS
    for rows, part in solved.parts():
        errors, (more, more_bent) = part.errors, part.second_order
        for pole in poles:
            i, j = pole
            (v, own), (dv, own_dv) = (
                _relative(pole, rows, *each)
                for each in zip(rates, (part.w, part.dw), strict=True)
            )
            size, swing = (
                norm(each[:, i].T) + norm(each[:, j].T) for each in (part.w, part.dw)
            )
            length = np.maximum(norm(v), EPS * EPS)
            unit = lines.unit[pole][:, rows]
            drawn = np.nan_to_num(lines.error[pole][rows], nan=1.0)
            given = drawn
            if pole not in pairs:
                turned = errors.turned_between(i, j)
                slack = errors.slip * turned + norm(v - own) + EPS * size
                doubt = np.fmin(slack / length, 1.0)
                better = weak[rows] & (doubt < drawn)
                unit[:, better] = v[:, better] / length[better]
                given = np.where(better, doubt, drawn)
            rate, change, across = errors.along(i, j, unit)
            if pole in pairs:
                direction = errors.of_axis(pairs[pole])
            else:
                drift = np.fmin(drawn * tilt[rows], (across + more) / length)
                direction = given + drift
            rate += np.abs(dot(unit, v - own)) + errors.numbers * size + more
            rate += np.fmin(direction, 1.0) ** 2 * length
            change += (
                np.abs(dot(unit, dv - own_dv)) + errors.numbers * (size + swing) + more_bent
            )
            change += direction * norm(dv)
            bad = ~(direction < USABLE_DIRECTION)
            if np.any(bad):
                _, all_w, all_dw = errors.of_vectors(i, j)
                rate[bad] = (norm(v) + all_w + errors.numbers * size)[bad]
                change[bad] = (norm(dv) + all_dw + errors.numbers * (size + swing))[bad]
            lines.error[pole][rows] = given
            found.direction[pole][rows] = direction
            found.rate[pole][rows], found.rate_dq[pole][rows] = rate, change
    return found


def _relative(
    pole: Pole, rows: slice, given: Mapping[int, Floats], own: Floats
) -> tuple[Floats, Floats]:
    """Return rates (3, n) of a pole's links as they were given, and from the equations."""
    i, j = pole
    solved = (own[:, j] - own[:, i]).T
    known = i in given and j in given
    return (given[j] - given[i])[:, rows] if known else solved, solved
