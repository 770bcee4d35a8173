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
CLUSTER = 3e-3
"""Roots and solutions nearer than this (rad) belong together: rounding of multiple ones."""
CLOSED = 1e-10
"""Largest relative residual of a solution."""
SAME = 1e-6
"""Solutions whose angles differ by less (rad) are one."""
FLAT = 1e-5
"""Relative determinant below which a solution may be multiple."""
UNDETERMINED = 1e-5
"""An equation whose part that holds an angle is smaller does not determine it."""
NEWTON_STEPS = 10
STILL = 1e-9
"""Newton's method ends when no angle changed by more than this (rad)."""


@final
@dataclass(frozen=True)
class AngleSolutions:
    """What the elimination of two of three angles found.

    `angles` (k, 3) complex, rad: solutions whose first angle is near the real axis, or
    as far from it as was asked for.
    `roots` (2 degree,) complex: all values of e^(ix) of the first angle x. `excess`: the
    coefficients beyond the degree, relative. `problem` says why real solutions may be
    missing; empty if none can be.
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


def common_angles(
    equations: Floats, involves: Bools, farthest: float = POLISHED
) -> AngleSolutions:
    """Return the solutions of three equations in three angles.

    Parameters
    ----------
    equations
        (3, 3, 3, 3): equation, then the places of the points of the three angles.
    involves
        (3, 3) as in `eliminated_degree`, whose result must not be 0.
    farthest
        Largest imaginary part (rad) of a root that is made solutions.

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
    held = np.max(np.abs(steps.weight)) > UNDETERMINED**2 * np.sum(equations[0] ** 2)
    if not held or not np.all(np.isfinite(samples)):
        return _nothing("an equation of the elimination does not hold its angle")
    scales = np.abs(steps.weight) ** power * np.prod(steps.scales, axis=1)
    if not np.max(np.abs(samples)) > VANISHING * np.max(scales):
        return _nothing("the equations have infinitely many complex solutions")
    spectrum = np.fft.fft(samples.real) / count
    largest = np.max(np.abs(spectrum))
    excess = float(np.max(np.abs(spectrum[degree + 1 : count - degree])) / largest)
    powers = np.concatenate([spectrum[degree::-1], spectrum[: -degree - 1 : -1]])
    roots = np.roots(powers) * np.exp(1j * OFFSET)
    angles, unmatched = _solutions(equations, roots, farthest)
    problem = ""
    if not excess < EXCESS:
        problem = f"the eliminant has coefficients {excess:.1g} beyond degree {degree}"
    elif unmatched:
        problem = f"{unmatched} roots of the eliminant lost solutions"
    return AngleSolutions(angles, roots, excess, problem)


def _nothing(problem: str) -> AngleSolutions:
    empty = np.empty((0, 3), dtype=complex)
    return AngleSolutions(empty, np.empty(0, dtype=complex), np.inf, problem)


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

    `quadratics` (n, 3) is the first equation's form in the second angle, `seconds`
    (n, 2, 3) its zeros as points of the second angle, `forms` (n, 2, 2, 3) of both other
    equations in the third, `resultants` and `scales` (n, 2), `weight` (n,).
    """

    quadratics: Complexes
    seconds: Complexes
    forms: Complexes
    resultants: Complexes
    scales: Floats
    weight: Complexes

    @staticmethod
    def at(equations: Floats, first: Numbers) -> "_Steps":
        remaining = np.tensordot(first.astype(complex), equations, axes=(1, 1))
        seconds, weight = _zeros(remaining[:, 0, :, 0])
        forms = np.einsum("nkyz,nsy->nskz", remaining[:, 1:], seconds)
        normal = np.cross(forms[:, :, 0], forms[:, :, 1])
        resultants = normal[..., 1] ** 2 + normal[..., 2] ** 2 - normal[..., 0] ** 2
        scales = np.prod(np.sum(np.abs(forms) ** 2, axis=3), axis=2)
        return _Steps(remaining[:, 0, :, 0], seconds, forms, resultants, scales, weight)


def _solutions(
    equations: Floats, roots: Complexes, farthest: float
) -> tuple[Complexes, int]:
    """Return solutions (k, 3) that roots (n,) lead to, and how many roots lost some."""
    first = -1j * np.log(roots[roots != 0.0])
    first = first[np.abs(first.imag) < farthest]
    steps = _Steps.at(equations, point(first))
    sizes = np.linalg.norm(steps.forms[..., 1:], axis=3)
    better = np.argmax(sizes, axis=2)[..., None, None]
    thirds, _ = _zeros(np.take_along_axis(steps.forms, better, axis=2)[:, :, 0])
    seconds = np.broadcast_to(steps.seconds[:, :, None], thirds.shape)
    every = [np.broadcast_to(first[:, None, None], thirds.shape[:3])]
    every += [_angle(seconds), _angle(thirds)]
    start = np.stack(every, axis=3).reshape(-1, 3)
    held = np.all(np.isfinite(start), axis=1)
    solutions = _polished(equations, start[held])
    good = solutions.residual < CLOSED
    good &= np.abs(solutions.angles[:, 0] - start[held, 0]) < CLUSTER
    angles, flat = solutions.angles[good], solutions.flat[good]
    new = _are_new(angles)
    angles, flat = angles[new], flat[new]
    turned = np.exp(1j * first)[:, None]
    with_roots = np.sum(np.abs(turned / turned.T - 1.0) < CLUSTER, axis=1)
    near = np.abs(turned / np.exp(1j * angles[:, 0]) - 1.0) < CLUSTER
    short = (np.sum(near, axis=1) < with_roots) & ~np.any(near & flat, axis=1)
    size = np.linalg.norm(steps.quadratics, axis=1) / np.linalg.norm(equations[0])
    vague = size < UNDETERMINED
    lost = ~np.any(near, axis=1) | short | vague
    return angles, int(np.sum(lost & (np.abs(first.imag) < NEAR_CIRCLE)))


@final
@dataclass(frozen=True)
class _Polished:
    """Angles (n, 3), their relative residual (n,), whether the equations are flat (n,)."""

    angles: Complexes
    residual: Floats
    flat: Bools


def _polished(equations: Floats, angles: Complexes) -> _Polished:
    """Return what Newton's method makes of angles (n, 3)."""
    largest = np.inf
    for step in range(NEWTON_STEPS + 1):
        points = np.moveaxis(point(angles), 1, 0)
        values = _values(equations, points)
        jacobian = _jacobian(equations, angles)
        determinant = np.abs(np.linalg.det(jacobian))
        if step == NEWTON_STEPS or largest < STILL:
            break
        regular = determinant > 0.0
        right = -values[regular][..., None]
        change = np.zeros_like(angles)
        change[regular] = np.linalg.solve(jacobian[regular], right)[..., 0]
        length = np.max(np.abs(change), axis=1, initial=0.0, keepdims=True)
        angles = angles + change * np.minimum(1.0, 0.3 / np.maximum(length, 1e-300))
        largest = np.max(length, initial=0.0)
    size = np.prod(np.linalg.norm(points, axis=2), axis=0)
    residual = np.max(np.abs(values), axis=1, initial=0.0) / size
    reach = np.prod(np.linalg.norm(jacobian, axis=1), axis=1)
    return _Polished(angles, residual, determinant < FLAT * reach)


def followed(equations: Floats, angles: Complexes) -> Complexes:
    """Return the solutions that Newton's method reaches from angles (n, 3), all distinct.

    As many as the equations have are all of them, wherever the angles came from.
    """
    solutions = _polished(equations, angles)
    reached = solutions.angles[solutions.residual < CLOSED]
    return np.asarray(reached[_are_new(reached)])


def _are_new(angles: Complexes) -> Bools:
    """Return (n,) which of angles (n, 3) are not copies of earlier ones."""
    turns = np.exp(1j * angles)
    apart = np.abs(turns[:, None] / turns - 1.0)
    copies = np.tril(np.all(apart < SAME, axis=2), -1)
    return np.asarray(~np.any(copies, axis=1))


def determinants(equations: Floats, angles: Complexes) -> Complexes:
    """Return the determinants (n,) of the equations' derivatives by angles (n, 3)."""
    return np.asarray(np.linalg.det(_jacobian(equations, angles)))


def _jacobian(equations: Floats, angles: Complexes) -> Complexes:
    """Return the derivatives (n, 3, 3) of the equations by the angles (n, 3)."""
    points = np.moveaxis(point(angles), 1, 0)
    rates = np.moveaxis(_point_rate(angles), 1, 0)
    columns = [
        _values(equations, np.where(turned[:, None, None], rates, points))
        for turned in np.eye(3, dtype=bool)
    ]
    return np.stack(columns, axis=2)


def _values(equations: Floats, points: Numbers) -> Complexes:
    """Return the equations' values (n, 3) at points (3, n, 3) of the three angles."""
    values = np.tensordot(points[0], equations, axes=(1, 1))
    values = np.einsum("nkyz,ny->nkz", values, points[1])
    return np.asarray(np.einsum("nkz,nz->nk", values, points[2]), dtype=complex)
