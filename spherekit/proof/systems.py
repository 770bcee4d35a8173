"""All real modes over boxes of inputs, counted system after system.

The equations fall into systems that are solved one after the other. Where as many roots of
a system are proven as there can be, complex ones and those at infinity too, and each is
proven to be real or not, its real ones are all there are; the next system is looked at for
each of them, with their angles as further inputs. Over a box of inputs roots that are
proven to be different at its centre and regular everywhere never meet.

Approximations of all solutions of a system at an input, by a homotopy.

Nothing here is proven: what is found is certified elsewhere, and counted there against
the number of solutions that the equations can have at most. The start equations are
products of linear factors of the same degrees, so they have just that number of solutions
(A. Sommese and C. Wampler, The Numerical Solution of Systems of Polynomials, 2005,
chapter 8), and the way from them to the equations of the mechanism avoids singular
systems but for unlucky random numbers.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import reduce
from itertools import permutations, product

import numpy as np

from spherekit.arrays import Array, Bools, Complexes, Floats, Indices
from spherekit.numeric.crossings import wrap
from spherekit.proof.balls import circle
from spherekit.proof.charts import (
    ChartRoots,
    Polynomials,
    applied,
    are_apart,
    are_real,
    inverses,
    polished,
    roots_of_one,
    tubes,
    values_at,
)
from spherekit.proof.construction import permanent
from spherekit.proof.equations import Equations
from spherekit.proof.tubes import ROUNDING

MOST_STEPS = 600
FIRST_STEP, LEAST_STEP, LARGEST_STEP, LONGER = 0.02, 1e-7, 0.1, 1.2
TRUSTED = 3e-3
"""Largest correction of a predicted point, over its size: a neighbour's is farther."""
NEARLY = 0.9
"""Ways that come so far are of use: Newton's method in more digits goes on from there."""
SEEDS = 4
"""Ways tried: of four one nearly always misses nothing."""


@np.errstate(all="ignore")
def modes_near(equations: Equations, driven: Floats, seed: int) -> Complexes:
    """Return approximations (n, unknowns) rad of the complex modes at an input.

    `driven` (inputs, 2) are the cosines and sines of the inputs. Some may be missing, and
    some may come twice.
    """
    every = range(equations.unknowns)
    made = System(equations, every, every).at(driven[None])
    angles = -1j * np.log(solutions(made, seed).points)
    return angles[np.all(np.isfinite(angles), axis=1)]


@np.errstate(all="ignore")
def solutions(made: Polynomials, seed: int) -> ChartRoots:
    """Return approximations of a system's solutions at one input, infinite ones too.

    The ways from all solutions of products of lines, at t = 0, are followed; those are left
    out that do not come near.
    """
    ends, z = _product_of_lines(made, np.random.default_rng(seed))
    points = ChartRoots.of(z, np.zeros(len(z), dtype=np.intp))
    t, step = np.zeros(len(z)), np.full(len(z), FIRST_STEP)
    for _ in range(MOST_STEPS):
        going = np.flatnonzero((t < 1.0) & (step >= LEAST_STEP))
        if not len(going):
            break
        start = points.take(going)
        length = np.minimum(step[going], 1.0 - t[going])
        there, ahead = t[going], start
        for part in (0.5, 1.0):
            _, first, by_t = _at(ends, ahead, there)
            there, way = t[going] + part * length, applied(inverses(first), by_t)
            ahead = replace(start, z=start.z - part * length[:, None] * way)
        size, off = 1.0 + np.max(np.abs(ahead.z), axis=1), []
        for _ in range(3):
            values, first, _ = _at(ends, ahead, there)
            change = applied(inverses(first), values)
            ahead = replace(ahead, z=ahead.z - change)
            off.append(np.nan_to_num(np.max(np.abs(change), axis=1), nan=np.inf) / size)
        good = (off[0] < TRUSTED) & (off[-1] < 1e-8)
        kept, failed = going[good], going[~good]
        moved = ahead.take(good).moved(ahead.z[good])
        points.z[kept], points.inverse[kept], t[kept] = moved.z, moved.inverse, there[good]
        step[kept] = np.minimum(LONGER * step[kept], LARGEST_STEP)
        step[failed] = 0.5 * length[~good]
    # a way that ends short of its goal leads to a double solution, or nearly
    return points.take((t > NEARLY) & np.all(np.isfinite(points.z), axis=1))


Ends = list[Complexes]
"""Coefficients (1, 2, sizes) of each equation at t = 0 and at t = 1."""


def _product_of_lines(
    made: Polynomials, generator: np.random.Generator
) -> tuple[Ends, Complexes]:
    """Return equations that lead from products of lines to a system, and where from."""
    roots = [
        [generator.normal(size=(2, size - 1)).T @ (1.0, 1j) for size in v.shape[1:]]
        for v in made.values
    ]
    ends: Ends = []
    for row, goal in zip(roots, made.values, strict=True):
        lines = [np.atleast_1d(np.poly(values))[::-1] for values in row]
        start = reduce(np.multiply.outer, lines) * np.exp(2j * np.pi * generator.random())
        scale = np.linalg.norm(start) / np.linalg.norm(goal)
        ends.append(np.stack([start[None], scale * goal], axis=1))
    # each equation gives another unknown its value
    starts = [
        np.array(values)[np.argsort(order)]
        for order in permutations(range(len(roots)))
        for values in product(*(row[k] for row, k in zip(roots, order, strict=True)))
    ]
    return ends, np.array(starts, dtype=complex).reshape(-1, len(roots))


def _at(
    ends: Ends, points: ChartRoots, t: Floats
) -> tuple[Complexes, Complexes, Complexes]:
    """Return values (n, k), derivatives by z (n, k, k), and by t (n, k)."""
    here, first = (points.derivatives(ends, order) for order in (0, 1))
    parts = np.stack([1.0 - t, t], axis=1)
    slopes = np.einsum("nkle,ne->nkl", first, parts)
    return applied(here, parts), slopes, here[..., 1] - here[..., 0]


NEAR = 1.0
"""Squared distance, as points of circles, of known roots that others are followed from."""
MOST_KNOWN = 128


class System:
    """Equations `rows` of a mechanism, to be solved for some `unknowns`, by number.

    `given` are all other variables. `solved` has angles of these and all `bound` solutions
    there can be then, complex ones and those at infinity too.
    """

    def __init__(
        self, equations: Equations, rows: Sequence[int], unknowns: Sequence[int]
    ) -> None:
        self.equations, self.rows, self.unknowns = equations, rows, unknowns
        self.given = [v for v in range(equations.variables) if v not in unknowns]
        self.degrees = equations.degrees[np.ix_(rows, [*unknowns, *self.given])]
        self.bound = permanent(2 * self.degrees[:, : len(unknowns)])
        self.solved: list[tuple[Floats, ChartRoots]] = []

    def at(self, turns: Array) -> Polynomials:
        """Return the polynomials at cosines and sines (m, given, 2), each rounded once."""
        real, rows = self.equations.real, self.rows
        made = [real.powers(row, self.unknowns, turns) for row in rows]
        largest = [max(np.max(np.abs(array), initial=0.0) for array in two) for two in made]
        error = real.error[rows] * np.max(self.degrees, axis=1, initial=1)
        error += ROUNDING * np.add(1.0, largest)
        values, slopes = zip(*made, strict=True)
        return Polynomials(values, slopes, error, self.equations.bound[rows], self.degrees)

    def proven(
        self, modes: Array, centres: Floats, turns: Floats, half: Floats
    ) -> tuple[Indices, Bools, Bools, tuple[Floats, Floats, Floats]]:
        """Return what is proven of the roots for all modes, over boxes of each.

        The mode of each root; for which modes all are proven, real or not, and different;
        which roots are real. Then what `_angles` says of them. Boxes have their centres,
        turns and half widths.
        """
        bound, still = self.bound, 0.0 * centres
        inputs = centres, turns, still[..., None] + np.eye(centres.shape[1]), still
        given, turns, moving, off = (
            np.concatenate([modes[name], values], axis=1)[:, self.given]
            for name, values in zip(("angle", "turn", "rates", "off"), inputs, strict=True)
        )
        made = self.at(turns)
        near = roots_of_one(made) if len(self.unknowns) == 1 else self._near(given)
        roots, ended = polished(made, near)
        good, radius, unique, width, reach, rates = tubes(made, roots, half, moving, off)
        for k in np.flatnonzero(are_apart(roots, radius, ended, bound)):
            self.solved.append((given[k], roots.take(slice(k * bound, (k + 1) * bound))))
        del self.solved[:-MOST_KNOWN]
        real, off_circle = are_real(roots, radius, unique)
        apart = are_apart(roots, radius, good & (real | off_circle), bound)
        angles = _angles(roots, half[roots.row], width, reach, rates)
        return roots.row, apart, real, angles

    def _near(self, given: Floats) -> ChartRoots:
        """Return the roots known nearest to what is given (n, given), moved to there.

        Where none are near they are found anew.
        """
        start, origins = given.copy(), []
        at = circle([place for place, _ in self.solved])
        for place in start:
            gaps = np.sum((at - circle(place)) ** 2, axis=(1, 2)) if len(at) else [np.inf]
            near = np.argmin(gaps)
            if gaps[near] < NEAR:
                place[:], roots = self.solved[near]
                origins.append(roots.points)
            else:
                origins.append(self._found(self.at(circle(place)[None])))
        row = np.repeat(np.arange(len(given)), self.bound)
        roots = ChartRoots.of(np.concatenate(origins), row)
        _, first, by_given = values_at(self.at(circle(start)), roots)
        ways = wrap(given - start)[roots.row]
        rates = np.nan_to_num(-inverses(first) @ by_given)
        return roots.moved(roots.z + applied(rates, ways))

    def _found(self, made: Polynomials) -> Complexes:
        """Return all roots at what is given as points, zeros if some are lost."""
        for seed in range(SEEDS):
            roots, good = polished(made, solutions(made, seed))
            roots = roots.take(good)
            (gap,) = roots.gaps(len(roots.z))
            roots = roots.take(~np.any(np.tril(gap < 1e-7, -1), axis=1))
            if len(roots.z) == self.bound:
                return roots.points
        return np.zeros((self.bound, len(self.unknowns)), dtype=complex)


def systems_of(equations: Equations) -> list[System]:
    """Return the systems of a mechanism, each to be solved after those before it."""
    return [System(equations, *two) for two in equations.construction.systems]


@np.errstate(all="ignore")
def counted(
    systems: Sequence[System], centres: Floats, turns: Floats, half: Floats
) -> tuple[Bools, Indices]:
    """Return over which boxes of the inputs (m, inputs) all is proven, and the modes.

    Those are the numbers of real ones. `turns` (m, inputs, 2) are the cosines and sines
    of the exact centres, next to which `centres` are. Roots are followed from those
    known nearest.
    """
    m, inputs = centres.shape
    good, angles = np.ones(m, dtype=bool), (systems[0].equations.unknowns,)
    # modes of the systems so far, over the box of a number: angles (rad) of all
    # unknowns at its centre, zero where not known yet, how they move with the inputs,
    # and by how much more at most
    modes = np.zeros(
        m,
        [
            ("row", np.intp),
            ("angle", float, angles),
            ("turn", float, (*angles, 2)),
            ("rates", float, (*angles, inputs)),
            ("off", float, angles),
        ],
    )
    modes["row"] = np.arange(m)
    for system in systems:
        modes = modes[good[modes["row"]]]
        if not len(modes):
            break
        boxes = (values[modes["row"]] for values in (centres, turns, half))
        row, apart, real, columns = system.proven(modes, *boxes)
        good[modes["row"][~apart]] = False
        (kept,) = np.nonzero(real & good[modes["row"]][row])
        modes = modes[row[kept]]
        for name, column in zip(("angle", "rates", "off"), columns, strict=True):
            modes[name][:, system.unknowns] = column[kept]
        modes["turn"][:, system.unknowns] = circle(columns[0][kept])
    return good, np.bincount(modes["row"], minlength=m)


def _angles(
    roots: ChartRoots, half: Floats, width: Floats, reach: Floats, rates: Complexes
) -> tuple[Floats, Floats, Floats]:
    """Return angles (n, k) of roots, of which the real ones are of use, rates, and off.

    At the centre, by the inputs, and how far they go from that over boxes.
    """
    size = np.abs(roots.z)
    sense = np.where(roots.inverse, -1, 1)
    rates = rates / (1j * sense * roots.z)[:, :, None]
    # log(1 + w) is off from w by at most this
    w = reach / size
    off = 0.5 * w**2 / (1.0 - w) + width[:, None] / size
    off = 1.05 * off + np.abs(size - 1.0) + 1e-15 * applied(np.abs(rates), half) + 1e-13
    off = np.where(w < 0.5, off, np.inf)
    return sense * np.angle(roots.z), rates.real, off
