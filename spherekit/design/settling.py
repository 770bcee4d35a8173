"""Descents of a sizing until no design nearby, nor one from other starts, is better."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from spherekit.design.descent import Descent
from spherekit.design.held_modes import HeldMode
from spherekit.sphere.rotation import Floats

BEATEN = 1e-6
"""Part of the width of each objective along a front by less than which none is beaten."""
ENOUGH = 0.1 * BEATEN
"""Part of it by less than which a descent goes on no more."""
ROUNDS = 12
"""Most times that a descent is taken up again."""
OTHERS = 3
"""Other starts from which a point is attacked, those that come nearest to beating it."""
BESIDE = 0.1
"""Starts nearer than this part of every range lead to the same place."""


@final
@dataclass(frozen=True)
class End:
    """Where a descent ended: mode, place in units of the ranges, objectives and figures."""

    mode: HeldMode
    x: Floats
    wanted: Floats
    columns: Floats


@final
class Settling:
    """Descents to where a sizing's objectives no longer fall.

    Parameters
    ----------
    descent
        The sizing's descents.
    modes, places, wanted
        Rows that are tried as other starts: modes (n,), places (n, variables) and
        objectives (n, k).
    """

    def __init__(
        self, descent: Descent, modes: NDArray[Any], places: Floats, wanted: Floats
    ) -> None:
        self.descent = descent
        self.modes, self.places, self.wanted = modes, places, wanted
        widths = np.ptp(wanted, axis=0)
        several = (widths > 0.0) & (wanted.shape[1] > 1)
        least = np.min(np.abs(wanted), axis=0)
        self.size = np.where(several, widths, np.where(least > 0.0, least, 1.0))

    @property
    def tolerance(self) -> Floats:
        """By how much of each objective (k,) a design has to be better to beat another."""
        return BEATEN * self.size

    def down(self, mode: HeldMode, x: Floats) -> End:
        """Return where descents from x end for good, those of one objective and of all."""
        descent = self.descent
        for _ in range(ROUNDS):
            before = descent.wanted(x, mode)
            x = descent.go(x, mode)
            mode = descent.moved(x, mode)
            here = descent.wanted(x, mode)
            x, _ = descent.towards(x, mode, here, self.size, ENOUGH)
            mode = descent.moved(x, mode)
            gain = (before - descent.wanted(x, mode)) / self.size
            if not np.max(gain) > ENOUGH:
                break
        return self.here(mode, x)

    def here(self, mode: HeldMode, x: Floats) -> End:
        """Return a place as the end of a descent."""
        columns, _, _ = self.descent.at(x, mode)
        return End(mode, x, self.descent.wanted(x, mode), columns)

    def attacked(self, end: End, ends: Sequence[End]) -> End:
        """Return what is left where a design, also from other starts, beats an end."""
        for _ in range(ROUNDS):
            for start in self._others(end, ends):
                x, missed = self.descent.towards(
                    start, end.mode, end.wanted, self.size, ENOUGH
                )
                if missed < -BEATEN:
                    end = self.down(end.mode, x)
                    break
            else:
                break
        return end

    def _others(self, end: End, ends: Sequence[End]) -> Iterator[Floats]:
        """Yield places apart from an end, those that come nearest to beating it first."""
        rows = self.modes == end.mode.label
        others = [other for other in ends if other.mode.goes_on_in(end.mode)]
        places = np.concatenate([self.places[rows], *([other.x] for other in others)])
        wanted = np.concatenate([self.wanted[rows], *([other.wanted] for other in others)])
        missed = np.max((wanted - end.wanted) / self.size, axis=1)
        taken = [end.x]
        for k in np.argsort(missed, kind="stable"):
            if len(taken) > OTHERS:
                return
            if all(np.max(np.abs(places[k] - place)) >= BESIDE for place in taken):
                taken.append(places[k])
                yield places[k]


def unbeaten(ends: Sequence[End], tolerance: Floats) -> list[End]:
    """Return the ends that none of their mode beats within a tolerance (k,).

    One beats another that is less in an objective by more than the tolerance, and in
    none greater by more.
    """

    def beats(one: End, other: End) -> bool:
        less = other.wanted - one.wanted
        return bool(np.all(less >= -tolerance) and np.any(less > tolerance))

    return [
        end
        for end in ends
        if not any(other.mode.goes_on_in(end.mode) and beats(other, end) for other in ends)
    ]
