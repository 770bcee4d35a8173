"""All real modes over boxes of inputs, counted system after system.

The equations fall into systems that are solved one after the other. Where as many roots of
a system are proven as there can be, complex ones and those at infinity too, and each is
proven to be real or not, its real ones are all there are; the next system is looked at for
each of them, with their angles as further inputs. Over a box of inputs roots that are
proven to be different at its centre and regular everywhere never meet.
"""

from collections.abc import Sequence

import numpy as np

from spherekit.arrays import Array, Bools, Complexes, Floats, Indices
from spherekit.numerics.angles import wrap
from spherekit.proof.arc_equations import Equations
from spherekit.proof.balls import circle
from spherekit.proof.construction import permanent
from spherekit.proof.homotopy import SEEDS, solutions
from spherekit.proof.root_charts import (
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
from spherekit.proof.tubes import ROUNDING


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
