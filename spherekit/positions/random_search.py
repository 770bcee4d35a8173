"""Searching closed configurations from random starts: no proof of all, but a count.

Every start goes down the sum of the squared gaps by Levenberg and Marquardt's method. How
often the starts met each of the things found says when to stop, and what the search is
worth: what is met as often as the rarest of them would hardly have been missed.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.geometry.vectors import max_abs
from spherekit.numerics.least_squares import minimize_squares
from spherekit.positions.loop_closure import Closure
from spherekit.positions.pair_states import has_penetration, list_rolling_variables
from spherekit.progress import ProgressReporter
from spherekit.tolerances import CLOSURE_TOLERANCE, EPS
from spherekit.wording import counted

SEED = 20240616
"""The random starts are the same ones every time."""
STARTS = 192
"""Random starts of one round."""
LEAST_ROUNDS = 2
"""Rounds of a search at least, and twice as many until none that closes is given up."""
MOST_ROUNDS = 32
MOST_WORK = 5e6
"""Most starts of a search, each times the square of the number of variables."""
ENOUGH = 8
"""A search ends when its starts met everything found so often."""
DOUBT = 0.01
"""Probability with which a search misses what the stated share of starts leads to."""

CLOSE = 1e-6
"""Root of the sum of squared gaps (rad) from which Newton's method ends the way."""
POLISHING_STEPS = 40
"""Newton steps at the end; a double solution halves its error in each."""
SAME_MODE = 1e-6
"""Closed configurations whose rotation matrices differ by less are one."""
SAME_DEAD_CENTRE = 1e-3
"""The same where rounding is felt most: solutions that are multiple."""
MOST_MODES = 64
"""Configurations of one group that are kept; where it can move there is no end of them."""
MOST_LOOSE = 4
"""Of configurations in which the group can move, or nearly so, no more are kept."""
LOOSE = 1e-9
"""Smallest singular value, over the largest, of those."""
SPREAD = 8.0
"""Copies of one solution differ by less than this times their first-order error."""


@dataclass
class SearchStatistics:
    """How many random starts were made, and how often they met each of the things found.

    `variables` is the number of unknowns of a start, `least` that of rounds made at least.
    """

    variables: int
    least: int = LEAST_ROUNDS
    starts: int = 0
    counts: Counter[int] = field(default_factory=Counter)

    def add(self, starts: int, met: Indices, total: int) -> None:
        """Count starts; `met` are the numbers, below `total`, of what they led to."""
        self.starts += starts
        self.counts.update(dict.fromkeys(range(total), 0))
        self.counts.update(met[met >= 0].tolist())

    @property
    def closed(self) -> int:
        """Number of starts that led to something."""
        return self.counts.total()

    @property
    def goes_on(self) -> bool:
        """Whether more starts are to be made."""
        rounds = self.starts / STARTS
        if rounds < self.least:
            return True
        if rounds >= MOST_ROUNDS or self.starts * self.variables**2 > MOST_WORK:
            return False
        if not self.closed:
            return rounds < 2 * self.least
        return min(self.counts.values()) < ENOUGH

    @property
    def share(self) -> float:
        """Share of starts that must lead to what is missed with probability `DOUBT`."""
        return 1.0 - DOUBT ** (1.0 / max(self.starts, 1))

    def words(self, things: str) -> str:
        """Return what the search is worth, `things` what it closes on, in the plural."""
        made = f"{self.starts} random starts"
        if not self.closed:
            made += ", none closed"
        else:
            often = [*self.counts.values()]
            met = counted(len(often), things.removesuffix("s"))
            made += f", {self.closed} closed on {met}, on "
            if min(often) > 1:
                made += f"each at least {min(often)} times"
            else:
                made += (
                    f"{sum(count <= 1 for count in often)} of them at most once, so that "
                    f"about {often.count(1) / self.closed:.1%} of further ones would close "
                    "on another"
                )
        return (
            f"{made}; any that {self.share:.2%} of starts lead to would have been met with "
            f"{1.0 - DOUBT:.0%} probability"
        )


def damped(
    closure: Closure,
    values: Floats,
    held: Sequence[int] = (),
    low: Floats | float = -np.inf,
    high: Floats | float = np.inf,
) -> tuple[Floats, Bools]:
    """Go down the sum of squared gaps from starts; return where that leads.

    Parameters
    ----------
    values
        (n, variables) starts.
    held
        Numbers of the variables that are not changed.
    low, high
        (variables,) limits that variables do not leave, none by default.

    Returns
    -------
    values, near
        (n, variables), and (n,) whether the gaps are so small that Newton's method
        closes them.
    """
    free = [v for v in range(values.shape[1]) if v not in held]
    least, most = (np.broadcast_to(x, values.shape[1])[free] for x in (low, high))
    values = values.copy()

    def gaps(some: Floats, rows: Indices) -> tuple[Floats, Floats]:
        whole = values[rows]
        whole[:, free] = some
        at = closure.take(rows).at(whole)
        return at.residual.copy(), at.jacobian[:, :, free]

    values[:, free], squares = minimize_squares(gaps, values[:, free], least, most, CLOSE)
    return values, squares < CLOSE**2


class Distinct:
    """Closed configurations of one group at one sample that are pairwise different.

    `values` are the variables of each. Where the loops close to second order only, at a
    dead centre, a small gap is far from the solution: what is left of the gap and the
    smallest singular value say how far, and others within that distance are the same.
    So are configurations that differ by whole turns of rolling wheels. The first 64 are
    kept; `is_truncated` says whether others were left out for that.
    """

    def __init__(self, closure: Closure) -> None:
        self.closure = closure
        self.values: list[Floats] = []
        self._poses, self._tolerances = list[Floats](), list[float]()
        self._loose = 0
        self.is_truncated = False
        self._rolling = list_rolling_variables(closure.joints)
        self._rolled = [variable for variable, _ in self._rolling]

    def add(self, values: Floats) -> Indices:
        """Add those of closed configurations (n, variables) that are new.

        Those that have rolled least come first; those whose contacts do not exist are
        left out. Returns the place (n,) in `values` of each, -1 for those left out.
        """
        places = np.full(len(values), -1, dtype=np.intp)
        at = self.closure.at(values)
        placed, states = at.placed, at.states
        exists = np.all(states.inside, axis=1) & ~has_penetration(
            self.closure.joints, states
        )
        sizes = np.linalg.svd(at.jacobian, compute_uv=False)
        least, loose = sizes[:, -1], sizes[:, -1] < LOOSE * sizes[:, 0]
        error = np.maximum(at.gap, EPS) / np.maximum(least, EPS)
        tolerance = np.clip(SPREAD * error, SAME_MODE, SAME_DEAD_CENTRE)
        order = np.argsort(np.sum(np.abs(values[:, self._rolled]), axis=1), kind="stable")
        for row in order[exists[order]].tolist():
            same = np.flatnonzero(
                self._away(values[row], placed[row])
                <= np.maximum(tolerance[row], self._tolerances)
            )
            if len(same):
                places[row] = same[0]
            elif len(self.values) < MOST_MODES and not (
                loose[row] and self._loose == MOST_LOOSE
            ):
                places[row] = len(self.values)
                self._loose += loose[row]
                self.values.append(values[row])
                self._poses.append(placed[row])
                self._tolerances.append(tolerance[row])
            else:
                self.is_truncated = True
        return places

    def _away(self, values: Floats, placed: Floats) -> Floats:
        """Return how far (k,) a configuration is from those kept, 0 a turn later."""
        poses = np.array(self._poses).reshape(-1, *placed.shape)
        way = np.abs(values - np.array(self.values).reshape(-1, len(values)))
        again = np.ones(len(way), dtype=bool)
        for variable, joint in self._rolling:
            turns = way[:, variable] / np.array(joint.closed_lengths)[:, None]
            apart = np.min(np.abs(turns - np.round(turns)), axis=0, initial=np.inf)
            again &= np.minimum(apart, way[:, variable]) <= SAME_MODE
        again &= np.any(way[:, self._rolled] > SAME_MODE, axis=1)
        return np.where(again, 0.0, max_abs(poses - placed, axis=(1, 2, 3)))


def search(
    closure: Closure, distinct: Distinct, given: Floats | None = None
) -> SearchStatistics:
    """Add the configurations to `distinct` that starts of a single sample lead to.

    The first starts are those `given` (n, variables), the others random. Returns how
    often the random ones met each configuration.
    """
    random = np.random.default_rng(SEED)
    low, high = starting_range(closure)
    if given is not None:
        distinct.add(_closed(closure, given))
    census = SearchStatistics(len(low))
    working = ProgressReporter("searching the modes of a group at an input")
    while census.goes_on and len(distinct.values) < MOST_MODES:
        values, near = damped(closure, random.uniform(low, high, (STARTS, len(low))))
        met = distinct.add(_closed(closure, values[near]))
        census.add(STARTS, met, len(distinct.values))
        working.tell(lambda: census.words("modes"))
    return census


def _closed(closure: Closure, values: Floats) -> Floats:
    """Return the configurations (k, variables) that Newton's method closes."""
    if not len(values):
        return values
    at = closure.solve(values, iterations=POLISHING_STEPS)
    return at.values[at.gap < CLOSURE_TOLERANCE]


def starting_range(closure: Closure) -> tuple[Floats, Floats]:
    """Return the limits (variables,) between which random starts are drawn."""
    every = [limits for joint in closure.joints for limits in joint.start_ranges]
    low, high = np.array(every).T
    if closure.locks is not None:
        variables, places = closure.locks
        low[variables] = high[variables] = places[0]
    return low, high
