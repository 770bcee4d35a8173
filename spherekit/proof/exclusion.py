"""All real modes at inputs by excluding the rest of space, whatever complex ones do."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.numeric.turns import wrap
from spherekit.proof.balls import Ball, exact, middle_of, pi
from spherekit.proof.equations import Equations
from spherekit.proof.paving import FIRST, Axis, Paved, paved
from spherekit.proof.roots import Root, root_near
from spherekit.proof.tubes import UP
from spherekit.sphere.rotation import Floats

SMALLEST = 1e-6
MOST_BOXES = 500_000
TRIED = 4
STEPS = 20


@final
@dataclass
class RealModes:
    """Real roots at inputs, and the boxes in which others may be."""

    equations: Equations
    driven: Sequence[Ball]
    roots: list[Root] = field(default_factory=list)

    def excluded(self, smallest: float = SMALLEST, most: int = MOST_BOXES) -> Paved:
        """Return the boxes left of the space of the unknowns."""
        axes = [Axis(exact(FIRST), 2 * pi()) for _ in range(self.equations.unknowns)]
        axes += [Axis(angle, exact(0.0)) for angle in self.driven]
        return paved(self.equations, axes, self._covers, self._look, smallest, most)

    def add(self, near: Sequence[complex]) -> bool:
        """Keep the real root next to an approximation, if there is one that is new."""
        root = root_near(self.equations, self.driven, near)
        if root is None or not root.real:
            return False
        if not all(root.apart(other) for other in self.roots):
            return False
        self.roots.append(root)
        return True

    def _covers(self, centres: Floats, radii: Floats) -> NDArray[np.bool_]:
        out = np.zeros(len(centres), dtype=bool)
        count = self.equations.unknowns
        for root in self.roots:
            middle = np.array([middle_of(ball).real for ball in root.centre])
            apart = wrap(centres[:, :count] - middle)
            reach = np.abs(apart) + radii[:, :count] * UP + 1e-13
            out |= np.all(reach <= root.unique, axis=1)
        return out

    def _look(self, centres: Floats, radii: Floats) -> bool:
        before = len(self.roots)
        count = self.equations.unknowns
        small = np.flatnonzero(np.max(radii, axis=1) < 0.1)
        for row in small[:: max(1, len(small) // TRIED)]:
            place = self._newton(centres[row], count)
            near = place is not None and not self._covers(place[None], 0.0 * place[None])[0]
            if place is not None and near:
                self.add([complex(angle) for angle in place[:count]])
        return len(self.roots) > before

    def _newton(self, place: Floats, count: int) -> Floats | None:
        place = place.copy()
        for _ in range(STEPS):
            turns = np.stack([np.cos(place), np.sin(place)], axis=-1)[None]
            values, slopes = self.equations.real.first(turns)
            change, *_ = np.linalg.lstsq(slopes[0][:, :count], -values[0], rcond=1e-12)
            size = float(np.max(np.abs(change)))
            place[:count] += change * min(1.0, 0.3 / max(size, 1e-300))
            if size < 1e-12:
                return place
        return None
