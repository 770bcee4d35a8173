"""A simulation while it is solved: what is known of it, piece by piece."""

from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np

from spherekit.dynamics.simulation import Simulation


@final
@dataclass(frozen=True)
class Solved:
    """A simulation as far as it is solved.

    `run` is what solves it: where another follows, what was given so far is superseded.
    `made` gives the motion before the time `until` (s), all of it if that is infinite.
    """

    run: object
    made: Callable[[], Simulation]
    until: float = np.inf

    @cached_property
    def motion(self) -> Simulation:
        """The motion so far."""
        return self.made()


Solving = Generator[Solved, None, Solved]
"""Gives piece after piece, each longer or of another run, and returns the whole."""


def whole(run: object, motion: Simulation) -> Solved:
    """Return a simulation that is solved to its end."""
    return Solved(run, lambda: motion)


def with_whole(pieces: Solving) -> Iterator[Solved]:
    """Yield the pieces of a simulation, the whole last."""
    yield (yield from pieces)


def last(pieces: Solving) -> Solved:
    """Return the whole of a simulation."""
    while True:
        try:
            next(pieces)
        except StopIteration as done:
            return done.value  # type: ignore[no-any-return]
