"""Three equations linear in the cosine and sine of each of three angles, all solutions.

The arc between two axes on bodies joined by revolute pairs gives such an equation. Two
of the angles are eliminated by resultants; what is left is a trigonometric polynomial of
known degree in the third, whose coefficients are the Fourier transform of exact samples.
(C. W. Wampler, 2004, eliminates the same equations by Sylvester's method.)

A form (c0, c1, c2) stands for c0 + c1 cos + c2 sin, a point (1, cos, sin) for an angle,
real or complex. Equation k has the value `equations[k]` (3, 3, 3) times the points of
the three angles.
"""

from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from spherekit.sphere.rotation import Floats

Numbers = NDArray[np.inexact[Any]]
Complexes = NDArray[np.complex128]
Bools = NDArray[np.bool_]

OFFSET = 0.3183
"""The first sample (rad): sizes in round degrees meet no special place there."""
OVERSAMPLING = 4
"""Samples of the polynomial for each of its degrees; 2 would just determine it."""
EXCESS = 1e-9
"""Largest coefficient allowed beyond the degree, over the largest of all."""
VANISHING = 1e-14
"""A polynomial that is smaller, over what its factors could reach, is zero."""
NEAR_CIRCLE = 0.3
"""Every root with an imaginary part (rad) up to this must lead to a solution."""
POLISHED = 2.0
"""Roots with a larger imaginary part (rad) are counted, but not made solutions."""
CONSISTENT = 1e-3
"""Relative residual below which an eliminated angle is tried with a root."""
MOVED = 1e-3
"""Farthest (rad) that a root moves when it is made a solution."""
CLOSED = 1e-10
"""Largest relative residual of a solution."""
NEWTON_STEPS = 10
STILL = 1e-9
"""Newton's method ends when no angle changed by more than this (rad)."""


@final
@dataclass(frozen=True)
class Solutions:
    """What the elimination of two of three angles found.

    `angles` (k, 3) complex, rad: solutions whose first angle is near the real axis, those
    of multiple roots more than once. `roots` (2 degree,) complex: all values of e^(ix)
    of the first angle x. `excess`: the coefficients beyond the degree, relative. `problem`
    says why real solutions may be missing; empty if none can be.
    """

    angles: Complexes
    roots: Complexes
    excess: float
    problem: str


def eliminated_degree(involves: Bools) -> int:
    """Return the degree in the first angle of the eliminant, 0 if there is none.

    `involves` (3, 3) says which equation (row) has which angle (column) in it. The first
    equation must have the second angle and not the third, the others the third.
    """
    if not (involves[0, 1] and not involves[0, 2] and involves[1, 2] and involves[2, 2]):
        return 0
    x, y = involves[:, 0].astype(int), involves[:, 1].astype(int)
    power = 2 * int(y[1] + y[2])
    return 2 * power * int(x[0]) + 4 * int(x[1] + x[2])


def common_angles(equations: Floats, involves: Bools) -> Solutions:
    """Return the solutions of three equations in three angles.

    Parameters
    ----------
    equations
        (3, 3, 3, 3): equation, then the places of the points of the three angles.
    involves
        (3, 3) as in `eliminated_degree`, whose result must not be 0.

    Notes
    -----
    With n = b x c for the forms b, c in the third angle, their resultant is
    n1^2 + n2^2 - n0^2. Its product over both zeros (1, C, S) of the form a in the second
    angle, times (a1^2 + a2^2) to the power of its degree in them, is the eliminant.
    """
    degree = eliminated_degree(involves)
    power = 2 * int(involves[1, 1]) + 2 * int(involves[2, 1])
    count = OVERSAMPLING * degree
    places = OFFSET + 2 * np.pi * np.arange(count) / count
    steps = _Steps.at(equations, point(places))
    samples = np.prod(steps.resultants, axis=1) * steps.weight**power
    if not np.all(np.isfinite(samples)):
        return _nothing("an equation of the elimination does not hold its angle")
    scales = np.abs(steps.weight) ** power * np.prod(steps.scales, axis=1)
    if not np.max(np.abs(samples)) > VANISHING * np.max(scales):
        return _nothing("the equations have infinitely many complex solutions")
    spectrum = np.fft.fft(samples.real) / count
    largest = np.max(np.abs(spectrum))
    excess = float(np.max(np.abs(spectrum[degree + 1 : count - degree])) / largest)
    powers = np.concatenate([spectrum[degree::-1], spectrum[: -degree - 1 : -1]])
    roots = np.roots(powers) * np.exp(1j * OFFSET)
    angles, unmatched = _solutions(equations, -1j * np.log(roots[roots != 0.0]))
    problem = ""
    if not excess < EXCESS:
        problem = f"the eliminant has coefficients {excess:.1g} beyond degree {degree}"
    elif unmatched:
        problem = f"{unmatched} roots of the eliminant led to no solution"
    return Solutions(angles, roots, excess, problem)


def _nothing(problem: str) -> Solutions:
    empty = np.empty((0, 3), dtype=complex)
    return Solutions(empty, np.empty(0, dtype=complex), np.inf, problem)


def point(angle: Numbers) -> Numbers:
    """Return (..., 3): 1, cosine and sine of angles (...,)."""
    return np.stack([np.ones_like(angle), np.cos(angle), np.sin(angle)], axis=-1)


def _point_rate(angle: Numbers) -> Numbers:
    return np.stack([np.zeros_like(angle), -np.sin(angle), np.cos(angle)], axis=-1)


def _angle(points: Complexes) -> Complexes:
    """Return angles (...,) of points (..., 3) with any common factor."""
    ahead = (points[..., 1] + 1j * points[..., 2]) / points[..., 0]
    back = (points[..., 1] - 1j * points[..., 2]) / points[..., 0]
    return np.where(np.abs(ahead) > np.abs(back), -1j * np.log(ahead), 1j * np.log(back))


def _zeros(form: Complexes) -> tuple[Complexes, Complexes]:
    """Return both zeros (..., 2, 3) of forms (..., 3), and c1^2 + c2^2 (...,)."""
    c0, c1, c2 = np.moveaxis(form, -1, 0)
    weight = c1 * c1 + c2 * c2
    root = np.sqrt(weight - c0 * c0)
    both = [
        np.stack([weight, -c0 * c1 - way * c2, -c0 * c2 + way * c1], axis=-1)
        for way in (root, -root)
    ]
    return np.stack(both, axis=-2) / weight[..., None, None], weight


@final
@dataclass(frozen=True)
class _Steps:
    """The elimination at n values of the first angle, along its last axis but one.

    `seconds` (n, 2, 3) points of the second angle, `forms` (n, 2, 2, 3) of both other
    equations in the third, `resultants` and `scales` (n, 2), `weight` (n,).
    """

    seconds: Complexes
    forms: Complexes
    resultants: Complexes
    scales: Floats
    weight: Complexes

    @staticmethod
    def at(equations: Floats, first: Numbers) -> "_Steps":
        known = np.tensordot(first.astype(complex), equations, axes=(1, 1))
        seconds, weight = _zeros(known[:, 0, :, 0])
        forms = np.einsum("nkyz,nsy->nskz", known[:, 1:], seconds)
        normal = np.cross(forms[:, :, 0], forms[:, :, 1])
        resultants = normal[..., 1] ** 2 + normal[..., 2] ** 2 - normal[..., 0] ** 2
        scales = np.prod(np.sum(np.abs(forms) ** 2, axis=3), axis=2)
        return _Steps(seconds, forms, resultants, scales, weight)


def _solutions(equations: Floats, first: Complexes) -> tuple[Complexes, int]:
    """Return the solutions (k, 3) near first angles (n,), and how many lead to none."""
    near = np.abs(first.imag) < POLISHED
    first = first[near]
    steps = _Steps.at(equations, point(first))
    weights = np.sum(np.abs(steps.forms[..., 1:]) ** 2, axis=3)
    better = np.argmax(weights, axis=2)[..., None, None]
    form = np.take_along_axis(steps.forms, better, axis=2)[:, :, 0]
    other = np.take_along_axis(steps.forms, 1 - better, axis=2)[:, :, 0]
    thirds, _ = _zeros(form)
    misses = np.abs(np.einsum("nstz,nsz->nst", thirds, other))
    size = np.linalg.norm(other, axis=2)[..., None] * np.linalg.norm(thirds, axis=3)
    misses = np.where(np.isfinite(misses), misses / size, np.inf).reshape(len(first), 4)
    least = np.min(misses, axis=1, keepdims=True, initial=np.inf)
    root, place = np.nonzero(misses <= np.maximum(least, CONSISTENT))
    start = np.stack(
        [
            first[root],
            _angle(steps.seconds[root, place // 2]),
            _angle(thirds[root, place // 2, place % 2]),
        ],
        axis=1,
    )
    angles, residual = _polished(equations, start)
    moved = np.abs(angles[:, 0] - start[:, 0])
    good = (residual < CLOSED) & (moved < MOVED)
    led = np.zeros(len(first), dtype=bool)
    led[root[good]] = True
    lost = ~led & (np.abs(first.imag) < NEAR_CIRCLE)
    return angles[good], int(np.sum(lost))


def _polished(equations: Floats, angles: Complexes) -> tuple[Complexes, Floats]:
    """Return angles (n, 3) after Newton's method, and their relative residual (n,)."""
    largest = np.inf
    for step in range(NEWTON_STEPS + 1):
        points = np.moveaxis(point(angles), 1, 0)
        values = _values(equations, points)
        if step == NEWTON_STEPS or largest < STILL:
            break
        rates = np.moveaxis(_point_rate(angles), 1, 0)
        jacobian = np.stack(
            [
                _values(equations, np.where(turned[:, None, None], rates, points))
                for turned in np.eye(3, dtype=bool)
            ],
            axis=2,
        )
        regular = np.abs(np.linalg.det(jacobian)) > 0.0
        right = -values[regular][..., None]
        change = np.zeros_like(angles)
        change[regular] = np.linalg.solve(jacobian[regular], right)[..., 0]
        length = np.max(np.abs(change), axis=1, initial=0.0, keepdims=True)
        angles = angles + change * np.minimum(1.0, 0.3 / np.maximum(length, 1e-300))
        largest = np.max(length, initial=0.0)
    size = np.prod(np.linalg.norm(points, axis=2), axis=0)
    return angles, np.max(np.abs(values), axis=1, initial=0.0) / size


def _values(equations: Floats, points: Numbers) -> Complexes:
    """Return the equations' values (n, 3) at points (3, n, 3) of the three angles."""
    known = np.tensordot(points[0], equations, axes=(1, 1))
    known = np.einsum("nkyz,ny->nkz", known, points[1])
    return np.asarray(np.einsum("nkz,nz->nk", known, points[2]), dtype=complex)
