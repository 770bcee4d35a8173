"""Telling closed configurations apart."""

from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import EPS
from spherekit.motion.closure import Closure
from spherekit.motion.pairs import penetrates, rolled_lengths
from spherekit.sphere.rotation import Floats

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


@final
class Distinct:
    """Closed configurations of one group at one sample that are pairwise different.

    `values` are the variables of each. Where the loops close to second order only, at a
    dead centre, a small gap is far from the solution: what is left of the gap and the
    smallest singular value say how far, and others within that distance are the same.
    So are configurations that differ by whole turns of rolling wheels. The first 64 are
    kept.
    """

    def __init__(self, closure: Closure) -> None:
        self.closure = closure
        self.values: list[Floats] = []
        self._poses: list[tuple[Floats, float]] = []
        self._loose = 0
        self._rolling = rolled_lengths(closure.joints)

    def add(self, values: Floats) -> NDArray[np.intp]:
        """Add those of closed configurations (n, variables) that are new.

        Those that have rolled least come first; those whose contacts do not exist are
        left out. Returns the place (n,) in `values` of each, -1 for those left out.
        """
        places = np.full(len(values), -1, dtype=np.intp)
        if not len(values):
            return places
        at = self.closure.at(values)
        placed, states = at.placed, at.states
        exists = np.all(states.inside, axis=1) & ~penetrates(self.closure.joints, states)
        sizes = np.linalg.svd(at.jacobian, compute_uv=False)
        least, loose = sizes[:, -1], sizes[:, -1] < LOOSE * sizes[:, 0]
        error = np.maximum(at.gap, EPS) / np.maximum(least, EPS)
        tolerance = np.clip(SPREAD * error, SAME_MODE, SAME_DEAD_CENTRE)
        rolled = [variable for variable, _ in self._rolling]
        order = np.argsort(np.sum(np.abs(values[:, rolled]), axis=1), kind="stable")
        left = order[exists[order]]
        for number, (pose, other) in enumerate(self._poses):
            near = self._near(number, values[left], placed[left], pose)
            same = near <= np.maximum(tolerance[left], other)
            places[left[same]] = number
            left = left[~same]
        while len(left) and len(self.values) < MOST_MODES:
            number, row = len(self.values), left[0]
            if loose[row] and self._loose == MOST_LOOSE:
                left = left[1:]
                continue
            self._loose += int(loose[row])
            self.values.append(values[row])
            self._poses.append((placed[row], tolerance[row]))
            near = self._near(number, values[left], placed[left], placed[row])
            same = near <= np.maximum(tolerance[left], tolerance[row])
            same[0] = True
            places[left[same]] = number
            left = left[~same]
        return places

    def _near(self, number: int, values: Floats, placed: Floats, pose: Floats) -> Floats:
        """Return how far (n,) configurations are from that of a number, 0 a turn later."""
        away = np.max(np.abs(placed - pose), axis=(1, 2, 3), initial=0.0)
        if self._rolling:
            mode = self.values[number]
            again = [self._meshes_again(one, mode) for one in values]
            away[np.array(again, dtype=bool)] = 0.0
        return np.asarray(away)

    def _meshes_again(self, one: Floats, other: Floats) -> bool:
        """Return whether two configurations differ by whole turns of rolling wheels."""
        shifted = False
        for variable, joint in self._rolling:
            way = one[variable] - other[variable]
            turns = [way / lap for lap in joint.laps]
            least = min((abs(turn - round(turn)) for turn in turns), default=abs(way))
            if least > SAME_MODE:
                return False
            shifted |= abs(way) > SAME_MODE
        return shifted
