"""Approximations of all complex modes at an input by elimination, system after system.

Nothing here is proven, as in `homotopy`, which is slower and for all structures. In
z = e^(i angle) the equations are polynomials. They fall into systems that are solved one
after the other: of one unknown by the roots of a polynomial, of two by a resultant that
is an eigenvalue problem, of three by `sphere.trigonometric`.
"""

from itertools import combinations, permutations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spherekit.proof.construction import Construction
from spherekit.proof.equations import FloatEquations
from spherekit.sphere.rotation import Floats
from spherekit.sphere.trigonometric import common_angles, eliminated_degree

Complexes = NDArray[np.complex128]
MOST_AT_ONCE = 3
"""Unknowns of the largest system that is solved."""
FARTHEST = 1e8
"""Points e^(i angle), or their inverses, that are larger are taken to be infinite."""


def eliminated(equations: FloatEquations, driven: Floats) -> Complexes | None:
    """Return approximations (n, unknowns) rad of the complex modes, None if too hard.

    `driven` (inputs, 2) are the cosines and sines of the inputs. Some may be missing.
    """
    made = equations.equations.construction
    systems = systems_of(made)
    if systems is None or max(len(unknowns) for _, unknowns in systems) > MOST_AT_ONCE:
        return None
    angles = np.zeros((1, made.unknowns), dtype=complex)
    with np.errstate(all="ignore"):
        for number, (rows, unknowns) in enumerate(systems):
            grown = []
            for before in angles:
                points = solved(equations, driven, before, rows, unknowns, number > 0)
                if points is None:
                    return None
                size = np.abs(points)
                finite = np.all((size < FARTHEST) & (size > 1.0 / FARTHEST), axis=1)
                solutions = -1j * np.log(points[finite])
                further = np.repeat(before[None], len(solutions), axis=0)
                further[:, unknowns] = solutions
                grown.append(further)
            angles = np.concatenate(grown)
    return angles[np.all(np.isfinite(angles), axis=1)]


def systems_of(made: Construction) -> list[tuple[list[int], list[int]]] | None:
    """Return equations and unknowns of systems to be solved one after the other."""
    used = made.degrees[:, : made.unknowns] > 0
    left = set(range(len(used)))
    determined: set[int] = set()
    systems = []
    while left:
        for size in range(1, len(left) + 1):
            system = _system(used, sorted(left), determined, size)
            if system is not None:
                break
        else:
            return None
        systems.append(system)
        left -= set(system[0])
        determined |= set(system[1])
    return systems


def _system(
    used: NDArray[np.bool_], left: list[int], determined: set[int], size: int
) -> tuple[list[int], list[int]] | None:
    for rows in combinations(left, size):
        unknowns = (
            set(np.flatnonzero(np.any(used[list(rows)], axis=0)).tolist()) - determined
        )
        if len(unknowns) == size:
            return list(rows), sorted(unknowns)
    return None


def solved(
    equations: FloatEquations,
    driven: NDArray[Any],
    before: Complexes,
    rows: list[int],
    unknowns: list[int],
    may_be_complex: bool,
) -> Complexes | None:
    """Return e^(i angle) (n, unknowns) of the solutions of one system, infinite ones too.

    `before` (unknowns,) are the angles of systems before; None if this one is too hard.
    """
    degrees = equations.equations.construction.degrees[np.ix_(rows, unknowns)]
    largest = np.max(degrees, axis=0)
    if len(rows) > MOST_AT_ONCE:
        return None
    spectra = _spectra(equations, driven, before, rows, unknowns, largest)
    if len(rows) == 1:
        points = np.roots(_cut(spectra[0], degrees[0])[::-1])
        infinite = np.full(2 * int(degrees[0, 0]) - len(points), np.inf)
        return np.concatenate([points, infinite]).astype(complex)[:, None]
    if len(rows) == 2:
        return _two(spectra, degrees)
    if may_be_complex or np.any(degrees > 1):
        return None
    angles = _three(spectra, degrees > 0)
    return None if angles is None else np.asarray(np.exp(1j * angles))


def _spectra(
    equations: FloatEquations,
    driven: Floats,
    before: Complexes,
    rows: list[int],
    unknowns: list[int],
    largest: NDArray[np.intp],
) -> Complexes:
    """Return the coefficients (rows, ...) of e^(i angles) from -`largest` to it."""
    counts = 2 * largest + 1
    grids = np.meshgrid(*(2 * np.pi * np.arange(n) / n for n in counts), indexing="ij")
    angles = np.repeat(before[None], grids[0].size, axis=0)
    for column, grid in zip(unknowns, grids, strict=True):
        angles[:, column] = grid.ravel()
    turns = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    given = np.broadcast_to(driven, (len(angles), *driven.shape))
    jets = equations.at(np.concatenate([turns, given], axis=1), 0)
    values = np.stack([jets[row][()].reshape(counts) for row in rows])
    axes = tuple(range(1, len(counts) + 1))
    return np.asarray(
        np.fft.fftshift(np.fft.fftn(values, axes=axes), axes=axes) / np.prod(counts)
    )


def _cut(spectrum: Complexes, degrees: NDArray[np.intp]) -> Complexes:
    """Return a spectrum without the outer terms that an equation has not."""
    cuts = [(n - 1) // 2 - int(m) for n, m in zip(spectrum.shape, degrees, strict=True)]
    return spectrum[
        tuple(slice(c, n - c) for c, n in zip(cuts, spectrum.shape, strict=True))
    ]


def _two(spectra: Complexes, degrees: NDArray[np.intp]) -> Complexes:
    """Return e^(i angle) (n, 2) of two equations by Sylvester's matrix in the second."""
    from scipy.linalg import eig

    power = 2 * int(np.max(degrees[:, 0]))
    f, g = (
        _cut(spectrum, np.array([power // 2, degree]))
        for spectrum, degree in zip(spectra, degrees[:, 1], strict=True)
    )
    m, n = f.shape[1] - 1, g.shape[1] - 1
    size = m + n
    sylvester = np.zeros((power + 1, size, size), dtype=complex)
    for row in range(n):
        sylvester[:, row, row : row + m + 1] = f
    for row in range(m):
        sylvester[:, n + row, row : row + n + 1] = g
    whole = size * power
    left, right = np.eye(whole, dtype=complex), np.eye(whole, dtype=complex)
    left[:-size] = np.eye(whole, k=size)[:-size]
    left[-size:] = -np.concatenate(list(sylvester[:-1]), axis=1)
    right[-size:, -size:] = sylvester[-1]
    (over, under), vectors = eig(left, right, homogeneous_eigvals=True)
    powers = vectors[:size]
    # of the ratios of neighbouring powers those of the largest entries are best
    best = np.argmax(np.abs(powers[1:]) + np.abs(powers[:-1]), axis=0)
    columns = np.arange(whole)
    second = powers[1:][best, columns] / powers[:-1][best, columns]
    points = np.stack([over / under, second], axis=1)
    return np.asarray(points[~np.any(np.isnan(points), axis=1)])


def _three(spectra: Complexes, involves: NDArray[np.bool_]) -> Complexes | None:
    """Return the angles (n, 3) of three equations of the first degree."""
    forms = spectra
    for axis in (1, 2, 3):
        if forms.shape[axis] == 1:
            return None
        minus, zero, plus = np.moveaxis(forms, axis, 0)
        forms = np.stack([zero, plus + minus, 1j * (plus - minus)], axis=axis)
    best: tuple[int, tuple[int, ...], tuple[int, ...]] | None = None
    for rows in permutations(range(3)):
        for columns in permutations(range(3)):
            degree = eliminated_degree(involves[np.ix_(rows, columns)])
            if degree and (best is None or degree < best[0]):
                best = degree, rows, columns
    if best is None:
        return None
    _, rows, columns = best
    ordered = np.transpose(forms[list(rows)].real, [0, *(1 + c for c in columns)])
    angles = common_angles(ordered, involves[np.ix_(rows, columns)], np.inf).angles
    out = np.empty_like(angles)
    out[:, list(columns)] = angles
    return out
