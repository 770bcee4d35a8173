"""What a run evaluates: counts of a request, and seconds by stage while it goes on."""

import time
from collections.abc import Iterator
from contextlib import contextmanager

from spherekit.planning.pole_plan import BlockPoles, LinePole
from spherekit.velocities.pole_request import Request

AXES = "axes and rates"
RECORDING = "recording"
SEARCH = "search"
SIMULATION = "simulation"
TABLES = "tables"
REST = "rest"


def counts_of(wanted: Request) -> dict[str, int]:
    """Return what a request evaluates at each configuration; nothing if it wants none.

    `poles` are all pole axes: `primary`, `secondary` and `irreducible` ones are taken from
    pairs, from two great circles, and from irreducible parts. `great_circles` are all that
    are compared, `link_rates` the bodies whose angular velocity is found;
    `axis_derivatives` and `rate_derivatives` count the axes and the angular velocities that
    are differentiated.
    """
    steps = wanted.plan.steps if wanted.poles else ()
    lines = [step for step in steps if isinstance(step, LinePole)]
    blocks = [step for step in steps if isinstance(step, BlockPoles)]
    irreducible = sum(len(step.poles) for step in blocks)
    primary = len(steps) - len(lines) - len(blocks)
    poles = primary + len(lines) + irreducible
    rates = len(wanted.bodies) if wanted.poles else 0
    return {
        "poles": poles,
        "primary": primary,
        "secondary": len(lines),
        "irreducible": irreducible,
        "great_circles": sum(len(step.via) + len(step.contacts) for step in lines),
        "link_rates": rates,
        "axis_derivatives": poles * wanted.derivatives,
        "rate_derivatives": rates * wanted.derivatives,
    }


class Timer:
    """Seconds that each stage took, by the clock on the wall."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self.before: dict[str, float] = {}
        self._started = time.perf_counter()

    def closed(self) -> dict[str, float]:
        """Return the seconds of all stages until now, with those of none as the rest.

        Those that the same stages took `before`, in a part of the run that was stopped,
        are added.
        """
        rest = time.perf_counter() - self._started - sum(self.seconds.values())
        seconds = self.seconds | {REST: rest}
        return {
            name: self.before.get(name, 0.0) + seconds.get(name, 0.0)
            for name in dict.fromkeys([*self.before, *seconds])
        }

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Add the time of a block to a stage."""
        before = self.seconds.setdefault(name, 0.0)
        started = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = before + time.perf_counter() - started
