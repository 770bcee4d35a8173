"""Bounds of the errors of poles: of directions, coefficients and their derivatives."""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import EPS, USABLE_DIRECTION
from spherekit.model.geometry import SAME_AXIS
from spherekit.planning.poles import Pole
from spherekit.rates.core import Equations
from spherekit.rates.vectors import dot, norm
from spherekit.sphere.rotation import Floats


@final
@dataclass(frozen=True)
class Bounds:
    """Bounds (n,) of the errors of directions (rad), of rates and of their derivatives."""

    direction: dict[Pole, Floats]
    rate: dict[Pole, Floats]
    acceleration_coefficient: dict[Pole, Floats]


def mended_and_bounded(
    poles: Iterable[Pole],
    axes: tuple[Mapping[Pole, int], Collection[Pole]],
    units: Mapping[Pole, Floats],
    drawn_errors: Mapping[Pole, Floats],
    rates: tuple[Mapping[int, Floats], Mapping[int, Floats]],
    weak: NDArray[np.bool_],
    solved: Equations,
) -> Bounds:
    """Return what poles of bodies are off by, and mend the directions of `weak` rows.

    Of unit vectors `units` (3, n) with the errors that they are `drawn_errors` (n,) by.
    Those come from the relative angular velocity where it is the better source. `axes` are
    the poles that are axes of pairs, and which of them are so but for the rounding of axes
    that links have in common; `rates` w and dw (3, n) of bodies, however found: what
    they differ by from the solution of the velocity equations is part of their error.
    """
    n = len(weak)
    pairs, rounded = axes
    poles = list(poles)
    bounds = Bounds(*({pole: np.full(n, np.nan) for pole in poles} for _ in range(3)))
    # Great circles turn in proportion to the axes that they are drawn through.
    tilt = solved.motion.orientation_error / EPS
    for rows, part, errors in solved.parts():
        if not len(rows):
            continue
        more, more_bent = part.second_order
        solved_w, solved_dw = (
            np.ascontiguousarray(array.transpose(1, 2, 0)) for array in (part.w, part.dw)
        )
        sizes, swings = ([norm(link) for link in links] for links in (solved_w, solved_dw))
        for pole in poles:
            i, j = pole
            size, swing = sizes[i] + sizes[j], swings[i] + swings[j]
            v, off = _relative(pole, rows, rates[0], solved_w)
            dv, off_bent = _relative(pole, rows, rates[1], solved_dw)
            length = np.maximum(norm(v), EPS * EPS)
            unit = units[pole][:, rows]
            drawn = np.nan_to_num(drawn_errors[pole][rows], nan=1.0)
            given = drawn
            if pole not in pairs and np.any(weak[rows]):
                slack = errors.slip * errors.sizes(i, j)[0] + norm(off) + EPS * size
                doubt = np.fmin(slack / length, 1.0)
                better = weak[rows] & (doubt < drawn)
                unit[:, better] = v[:, better] / length[better]
                given = np.where(better, doubt, drawn)
                units[pole][:, rows], drawn_errors[pole][rows] = unit, given
            rate, change, across = errors.along(i, j, unit)
            if pole in pairs:
                direction = errors.of_axis(pairs[pole])
                if pole in rounded:
                    apart = 1.0 + SAME_AXIS / errors.numbers
                    direction = direction + errors.slip * apart / length
            else:
                drift = np.fmin(drawn * tilt[rows], (across + more) / length)
                direction = given + drift
            rate += np.abs(dot(unit, off)) + errors.numbers * size + more
            rate += np.fmin(direction, 1.0) ** 2 * length
            change += np.abs(dot(unit, off_bent)) + errors.numbers * (size + swing)
            change += more_bent + direction * norm(dv)
            bad = ~(direction < USABLE_DIRECTION)
            if np.any(bad):
                _, all_w, all_dw = errors.off(*errors.sizes(i, j))
                rate[bad] = (norm(v) + all_w + errors.numbers * size)[bad]
                all_dw += norm(dv) + errors.numbers * (size + swing)
                change[bad] = all_dw[bad]
            bounds.direction[pole][rows] = direction
            bounds.rate[pole][rows], bounds.acceleration_coefficient[pole][rows] = (
                rate,
                change,
            )
    return bounds


def _relative(
    pole: Pole, rows: NDArray[np.intp], given: Mapping[int, Floats], solved_links: Floats
) -> tuple[Floats, Floats]:
    """Return rates (3, n) of a pole's links as they were given, and what they are off by.

    That is against the solution `solved_links` (links, 3, n) of the equations.
    """
    i, j = pole
    solved = solved_links[j] - solved_links[i]
    if i not in given or j not in given:
        return solved, np.zeros_like(solved)
    v = (given[j] - given[i])[:, rows]
    return v, v - solved
