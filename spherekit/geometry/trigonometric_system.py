"""Equations linear in the cosine and sine of each of up to three angles, all solutions.

The arc between two axes on bodies joined by revolute pairs gives such an equation. All
angles but one are eliminated by resultants; what is left is a trigonometric polynomial of
known degree in that one, whose coefficients are the Fourier transform of exact samples.
(C. W. Wampler, 2004, eliminates the same equations by Sylvester's method.)

A form (c0, c1, c2) stands for c0 + c1 cos + c2 sin, a point (1, cos, sin) for an angle,
real or complex. Of a system of t equations in t angles, `equations` (t, 3, ..., 3) with t
threes, equation k has the value `equations[k]` times the points of all angles. Arrays
(n, t, 3, ..., 3) are n systems that are solved side by side.

Complex rotations: matrices R with R^T R = 1 and complex entries.

Real solutions of trigonometric equations meet and become complex ones; what is to stay
analytic while they do has to be known on both. Products here are bilinear, a . b = sum
a_k b_k without conjugation, so a formula for real unit vectors holds word for word.
"""

from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spherekit.arrays import Array, Bools, Complexes, Floats, Indices
from spherekit.geometry.rotation import all_finite, cross, max_abs

Numbers = NDArray[np.inexact[Any]]

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
STARTED = 0.01
"""The same of what Newton's method starts from."""
BESIDE = 8
"""Of so many neighbouring systems one is solved without another's solutions."""
SAME = 1e-6
"""Solutions whose angles differ by less (rad) are one."""
FLAT = 1e-5
"""Relative determinant below which a solution may be multiple."""
EMPTY = 1e-10
"""An equation with smaller coefficients is none; those of arcs are about 1."""
UNDETERMINED = 1e-5
"""An equation whose part that holds an angle is smaller does not determine it."""
ON_CIRCLE = 1e-6
"""Roots that are nearer to the unit circle (rad) have a real first angle: rounding moves a
simple one by less."""
OFF_CIRCLE = 1e-3
"""Least distance (rad) of a root that is clearly not on the circle. Rounding moves a double
one by less."""
NEWTON_STEPS = 10
STILL = 1e-9
"""Newton's method ends when no angle changed by more than this (rad)."""


def eliminated_degree(involves: Bools) -> int:
    """Return the degree in the first angle of the eliminant, 0 if there is none.

    `involves` (t, t) says which equation (row) has which angle (column) in it. The last two
    equations must have the last angle; of three, the first the second angle and not the
    third.
    """
    if len(involves) == 1:
        return int(involves[0, 0])
    first = involves[0]
    x = involves[:, 0].astype(int)
    if not np.all(involves[-2:, -1]):
        return 0
    if len(involves) == 2:
        return int(2 * np.sum(x))
    if first[2] or not first[1]:
        return 0
    return int(2 * _power(involves) * x[0] + 4 * (x[1] + x[2]))


def _power(involves: Bools) -> int:
    """Return the degree of the resultant in the zeros of the first of three equations."""
    return 2 * int(np.sum(involves[1:, 1])) if len(involves) == 3 else 0


def common_angles(equations: Numbers, involves: Bools) -> tuple[Complexes, str]:
    """Return the solutions of a system of two or three equations in as many angles.

    Angles (k, t) complex, rad: those whose first angle is near the real axis. And why real
    solutions may be missing; empty if none can be.

    Parameters
    ----------
    equations
        (t, 3, ..., 3): equation, then the places of the points of the angles.
    involves
        (t, t) as in `eliminated_degree`, whose result must not be 0.
    """
    with np.errstate(all="ignore"):
        (roots,), (excess,), (problem,) = _roots(equations[None], involves)
        if problem:
            return np.empty((0, len(equations)), dtype=complex), problem
        away = np.abs(np.log(np.abs(roots)))
        roots = roots[away < POLISHED]
        away = away[away < POLISHED]
        angles, good, flat = (x[0] for x in _next_to(equations[None], roots[None], 4))
        kept = np.flatnonzero(good)
        kept = kept[_are_new(angles[kept])]
        angles = angles[kept]
        flat = flat[kept]
        turned = roots[:, None]
        with_roots = np.sum(np.abs(turned / roots - 1.0) < CLUSTER, axis=1)
        near = np.abs(turned / np.exp(1j * angles[:, 0]) - 1.0) < CLUSTER
        lost = (np.sum(near, axis=1) < with_roots) & ~np.any(near & flat, axis=1)
        if len(equations) == 3:
            quadratics = _forms(equations[None], -1j * np.log(roots[None]))[2]
            size = np.linalg.norm(quadratics[0], axis=1) / np.linalg.norm(equations[0])
            lost |= size < UNDETERMINED
        unmatched = np.sum(lost & (away < NEAR_CIRCLE))
    if not excess < EXCESS:
        degree = eliminated_degree(involves)
        problem = f"the eliminant has coefficients {excess:.1g} beyond degree {degree}"
    elif unmatched:
        problem = f"{unmatched} roots of the eliminant lost solutions"
    return angles, problem


def all_angles(equations: Numbers, involves: Bools) -> Complexes:
    """Return all solutions (n, 2 degree, t) of systems, NaN where one is missing.

    Neighbouring systems of three equations should be alike: most are solved by Newton's
    method from the solutions of one beside. From wherever they are reached, as many as
    there are roots are all.
    """
    n, t = equations.shape[:2]
    angles = np.full((n, 2 * eliminated_degree(involves), t), np.nan, dtype=complex)
    with np.errstate(all="ignore"):
        if t == 1:
            return _angle(_zeros(equations[:, 0])[0])[..., None]
        rows = np.arange(n)
        _eliminate(angles, equations, involves, rows[:: BESIDE if t == 3 else 1], 1)
        there, left = (rows[missing == np.isnan(angles[:, 0, 0])] for missing in (0, 1))
        if len(there) and len(left):
            beside = there[np.argmin(np.abs(there - left[:, None]), axis=1)]
            polished, residual, _ = _polished(equations[left], angles[beside])
            _put(angles, left, polished, residual < CLOSED)
        _eliminate(angles, equations, involves, rows[np.isnan(angles[:, 0, 0])], 4)
    return angles


def real_angles(equations: Floats, involves: Bools) -> tuple[Floats, Bools]:
    """Return starting values of the real solutions of systems, and where these are all.

    This takes a third of the time of `all_angles`, but decides only systems whose roots
    are clearly apart, and clearly on or off the unit circle.

    Returns
    -------
    angles, is_clear
        (n, m, t) real angles, NaN where a system has fewer than m, and (n,) whether there
        is one for each real solution. Newton's method has to confirm them, as different
        ones.
    """
    with np.errstate(all="ignore"):
        roots, excess, problems = _roots(equations, involves)
        away = np.abs(np.log(np.abs(roots)))
        is_on = away < ON_CIRCLE
        is_clear = np.all(is_on | (away > OFF_CIRCLE), axis=1) & (excess < EXCESS)
        is_clear &= [not problem for problem in problems]
        order = np.argsort(~is_on, axis=1, kind="stable")
        order = order[:, : np.max(np.sum(is_on, axis=1), initial=0)]
        first = np.angle(np.take_along_axis(roots, order, axis=1))
        first[~np.take_along_axis(is_on, order, axis=1)] = np.nan
        apart = np.abs(np.exp(1j * (first[:, :, None] - first[:, None])) - 1.0)
        apart[:, *np.diag_indices(first.shape[1])] = np.inf
        is_clear &= ~np.any(apart < CLUSTER, axis=(1, 2))
        if equations.shape[1] == 3:
            quadratics = _forms(equations, first)[2]
            size = np.linalg.norm(quadratics, axis=2)
            size /= np.linalg.norm(equations.reshape(len(size), -1), axis=1)[:, None]
            is_clear &= ~np.any(size < UNDETERMINED, axis=1)
        n, k = first.shape
        if not k:
            return np.empty((n, 0, len(involves))), is_clear
        starts = _starts(equations, first.astype(complex))
        count = starts.shape[1] // k
        residual = np.nan_to_num(_residual(equations, starts), nan=np.inf)
        best = np.argmin(residual.reshape(n, k, count), axis=2)[:, :, None, None]
        starts = np.take_along_axis(starts.reshape(n, k, count, -1), best, axis=2)[:, :, 0]
    return starts.real, is_clear


def _eliminate(
    angles: Complexes,
    equations: Numbers,
    involves: Bools,
    rows: Indices,
    most: int,
) -> None:
    """Set the solutions of some systems, from the best starts of each root, so many."""
    if len(rows):
        roots = _roots(equations[rows], involves)[0]
        finite = np.all(np.isfinite(roots) & (roots != 0.0), axis=1)
        rows = rows[finite]
        solutions, good, _ = _next_to(equations[rows], roots[finite], most)
        _put(angles, rows, solutions, good)


def _next_to(
    equations: Numbers, roots: Complexes, most: int
) -> tuple[Complexes, Bools, Bools]:
    """Return solutions (n, m, t) of n systems, from the best starts of roots, so many.

    `roots` are (n, k) of the first angle. With them whether they are solutions of their
    root, and where equations are flat.
    """
    n, k = roots.shape
    starts = _starts(equations, -1j * np.log(roots))
    t = starts.shape[2]
    count = starts.shape[1] // max(k, 1)  # there may be no root
    best = np.argsort(_residual(equations, starts).reshape(n, k, count), axis=2)
    chosen = best[:, :, :most, None]
    starts = np.take_along_axis(starts.reshape(n, k, count, t), chosen, axis=2)
    starts = starts.reshape(n, k * chosen.shape[2], t)
    starts[_residual(equations, starts) > STARTED] = np.nan
    angles, residual, flat = _polished(equations, starts)
    near = np.abs(angles[..., 0] - starts[..., 0]) < CLUSTER
    return angles, (residual < CLOSED) & near, flat


def _put(angles: Complexes, rows: Indices, polished: Complexes, good: Bools) -> None:
    """Set the solutions of systems whose good ones, without copies, are all there are."""
    for row, solutions, fine in zip(rows, polished, good, strict=True):
        new = solutions[fine][_are_new(solutions[fine])]
        if len(new) == angles.shape[1]:
            angles[row] = new


def point(angle: Numbers) -> Numbers:
    """Return (..., 3): 1, cosine and sine of angles (...,)."""
    return np.stack([np.ones_like(angle), np.cos(angle), np.sin(angle)], axis=-1)


def _angle(points: Complexes) -> Complexes:
    """Return angles (...,) of points (..., 3) with any common factor."""
    one, c, s = np.moveaxis(points, -1, 0)
    ahead = (c + 1j * s) / one
    back = (c - 1j * s) / one
    return np.where(np.abs(ahead) > np.abs(back), -1j * np.log(ahead), 1j * np.log(back))


def _zeros(form: Numbers) -> tuple[Complexes, Complexes]:
    """Return both zeros (..., 2, 3) of forms (..., 3), and c1^2 + c2^2 (...,)."""
    c0, c1, c2 = np.moveaxis(form.astype(complex), -1, 0)
    weight = c1 * c1 + c2 * c2
    root = np.sqrt(weight - c0 * c0)
    both = [
        np.stack([weight, -c0 * c1 - way * c2, -c0 * c2 + way * c1], axis=-1)
        for way in (root, -root)
    ]
    return np.stack(both, axis=-2) / weight[..., None, None], weight


def _forms(
    equations: Numbers, first: Numbers
) -> tuple[Complexes, Complexes, Complexes, Complexes]:
    """Return the last two equations at values (n, r) of the first angle.

    Their forms (n, r, s, 2, 3) in the last angle, at the s points (n, r, s, 3) of the
    second that solve the first of three equations, of two at none; and the forms
    (n, r, 3) of that equation in the second angle, with c1^2 + c2^2 (n, r).
    """
    remaining = np.einsum("nkx...,nrx->nrk...", equations, point(first).astype(complex))
    if equations.shape[1] == 2:
        nothing = np.ones((*first.shape, 1, 3), dtype=complex)
        return remaining[:, :, None], nothing, nothing[:, :, 0], nothing[:, :, 0, 0]
    quadratics = remaining[:, :, 0, :, 0]
    seconds, weight = _zeros(quadratics)
    forms = np.einsum("nrkyz,nrsy->nrskz", remaining[:, :, 1:], seconds)
    return forms, seconds, quadratics, weight


def _roots(equations: Numbers, involves: Bools) -> tuple[Complexes, Floats, list[str]]:
    """Return all e^(ix) (n, 2 degree) of the first angle x of systems, and an excess (n,).

    The excess are the coefficients beyond the degree, relative. The last list says why a
    system cannot be solved by them, or nothing.

    The eliminants are sampled at equally spaced values of the first angle. With n = b x c
    for the forms b, c in the last angle, their resultant is n1^2 + n2^2 - n0^2. Its product
    over both zeros (1, C, S) of the form a in the second angle, times (a1^2 + a2^2) to the
    power of its degree in them, is the eliminant.
    """
    degree = eliminated_degree(involves)
    power = _power(involves)
    count = OVERSAMPLING * degree
    places = OFFSET + 2 * np.pi * np.arange(count) / count
    first = np.broadcast_to(places, (len(equations), count))
    forms, _, _, weight = _forms(equations, first)
    normal = np.cross(forms[..., 0, :], forms[..., 1, :])
    resultants = normal[..., 1] ** 2 + normal[..., 2] ** 2 - normal[..., 0] ** 2
    samples = np.prod(resultants, axis=2) * weight**power
    if np.isrealobj(equations):
        samples = samples.real.astype(complex)
    # What the samples could reach by the sizes of their factors.
    sizes = np.prod(np.sum(np.abs(forms) ** 2, axis=4), axis=(2, 3))
    scale = np.max(np.abs(weight) ** power * sizes, axis=1)
    size = np.linalg.norm(equations.reshape(*equations.shape[:2], -1), axis=2)
    held = max_abs(weight, axis=1) > (UNDETERMINED * size[:, 0]) ** 2
    held &= all_finite(samples, 1)
    many = (np.min(size, axis=1) < EMPTY) | ~(max_abs(samples, axis=1) > VANISHING * scale)
    problems = np.select(
        [~held, many],
        [
            "an equation of the elimination does not hold its angle",
            "there are infinitely many complex solutions",
        ],
        "",
    ).tolist()

    spectrum = np.fft.fft(samples, axis=1) / count
    beyond = np.abs(spectrum[:, degree + 1 : count - degree])
    powers = spectrum[:, np.arange(degree, -degree - 1, -1)]
    companions = np.zeros((len(powers), 2 * degree, 2 * degree), dtype=complex)
    companions[:, 1:, :-1] = np.eye(2 * degree - 1)
    companions[:, 0] = -powers[:, 1:] / powers[:, :1]
    good = all_finite(companions, (1, 2))
    roots = np.full((len(powers), 2 * degree), np.nan, dtype=complex)
    roots[good] = np.linalg.eigvals(companions[good]) * np.exp(1j * OFFSET)
    return roots, np.max(beyond, axis=1) / max_abs(spectrum, axis=1), problems


def _starts(equations: Numbers, first: Complexes) -> Complexes:
    """Return angles (n, k, t) near all solutions with values (n, r) of the first angle."""
    forms, seconds, _, _ = _forms(equations, first)
    better = np.argmax(np.linalg.norm(forms[..., 1:], axis=4), axis=3)[..., None, None]
    lasts = _angle(_zeros(np.take_along_axis(forms, better, axis=3)[..., 0, :])[0])
    every = np.broadcast_arrays(first[..., None, None], _angle(seconds)[..., None], lasts)
    if equations.shape[1] == 2:
        every = every[::2]
    return np.stack(every, axis=-1).reshape(len(first), prod(lasts.shape[1:]), len(every))


def _polished(equations: Numbers, angles: Complexes) -> tuple[Complexes, Floats, Bools]:
    """Return what Newton's method makes of angles (n, m, t) of n systems.

    With their relative residual (n, m), and where equations are flat.
    """
    largest = np.inf
    for step in range(NEWTON_STEPS + 1):
        values, matrices = _jets(equations, angles)
        determinant = np.abs(np.linalg.det(matrices))
        if step == NEWTON_STEPS or largest < STILL:
            break
        regular = determinant > 0.0
        change = np.zeros_like(angles)
        right = -values[regular][..., None]
        change[regular] = np.linalg.solve(matrices[regular], right)[..., 0]
        length = np.max(np.abs(change), axis=2, initial=0.0, keepdims=True)
        angles = angles + change * np.minimum(1.0, 0.3 / np.maximum(length, 1e-300))
        largest = np.nanmax(length, initial=0.0)
    reach = np.prod(np.linalg.norm(matrices, axis=2), axis=2)
    return angles, _residual(equations, angles), determinant < FLAT * reach


def _residual(equations: Numbers, angles: Complexes) -> Floats:
    """Return how far (n, m), relative, angles (n, m, t) are from solving n systems."""
    size = np.prod(np.linalg.norm(point(angles), axis=3), axis=2)
    return max_abs(_jets(equations, angles)[0], axis=2) / size


def _are_new(angles: Complexes) -> Bools:
    """Return (n,) which of angles (n, t) are not copies of earlier ones."""
    turns = np.exp(1j * angles)
    copies = np.tril(np.all(np.abs(turns[:, None] / turns - 1.0) < SAME, axis=2), -1)
    return ~np.any(copies, axis=1)


def determinants(equations: Numbers, angles: Complexes) -> Complexes:
    """Return the determinants (n, m) of n systems' derivatives by angles (n, m, t)."""
    return np.linalg.det(_jets(equations, angles)[1])


def _jets(equations: Numbers, angles: Complexes) -> tuple[Complexes, Complexes]:
    """Return values (n, m, t) of n systems at angles (n, m, t), and derivatives (.., t)."""
    t = angles.shape[2]
    points = point(angles)
    rates = np.stack([0.0 * angles, -points[..., 2], points[..., 1]], axis=-1)
    both = np.stack([points, rates], axis=3)
    jets = np.einsum("nkx...,nmax->nmk...a", equations, both[:, :, 0])
    for angle in range(1, t):
        jets = np.einsum("nmkx...,nmax->nmk...a", jets, both[:, :, angle])
    columns = [jets[..., *turned] for turned in np.eye(t, dtype=int)]
    return jets[..., *[0] * t], np.stack(columns, axis=3)


def taking(
    first: Array, second: Array, to_first: Complexes, to_second: Complexes
) -> Complexes:
    """Return the rotations (..., 3, 3) that take two unit vectors (..., 3) to two others.

    Both pairs have the same scalar product; NaN where it is 1 or -1.
    """
    normal = cross(first, second)
    dual = np.stack([cross(second, normal), cross(normal, first), normal], axis=-2)
    there = np.stack([to_first, to_second, cross(to_first, to_second)], axis=-1)
    return there @ dual / np.sum(normal * normal, axis=-1)[..., None, None]
