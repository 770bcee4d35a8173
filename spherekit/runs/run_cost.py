"""The cost of a run: numbers of evaluated poles and rates, and the time of each stage."""

import time
from collections.abc import Iterator
from contextlib import contextmanager

from spherekit.planning.pole_plan import BlockPoles, LinePole
from spherekit.velocities.pole_request import Request

AXES = "axes and rates"
RECORDING = "recording"
SEARCH_STAGE = "search"
SIMULATION = "simulation"
TABLES = "tables"
REST = "rest"
"""Names of stages of a run, under which the summary lists their times."""


def count_evaluations(request: Request) -> dict[str, int]:
    """Count what a run evaluates at each configuration while one input moves.

    The counts show the user what a run costs. A request is the list of quantities to
    evaluate. A pole is the axis about which one link rotates relative to another. All
    counts are zero if no poles are requested.

    Returns
    -------
    dict
        - ``poles``: pole axes, of three kinds: ``primary`` (axes and contact lines of
          pairs), ``secondary`` (intersections of two great circles) or ``irreducible``
          (solved from the velocity equations of a part that great circles cannot resolve).
        - ``great_circles``: circles that are compared for secondary poles.
        - ``link_rates``: links with computed angular velocities.
        - ``axis_derivatives``, ``rate_derivatives``: axes and angular velocities with a
          computed derivative with respect to the input.
    """
    # Each step of the plan computes one pole, or all poles of an irreducible part.
    steps = request.plan.steps if request.poles else ()
    circle_steps = [step for step in steps if isinstance(step, LinePole)]
    irreducible_steps = [step for step in steps if isinstance(step, BlockPoles)]

    primary_count = len(steps) - len(circle_steps) - len(irreducible_steps)
    irreducible_count = sum(len(step.poles) for step in irreducible_steps)
    pole_count = primary_count + len(circle_steps) + irreducible_count
    link_count = len(request.bodies) if request.poles else 0
    # A secondary pole lies on one great circle for each third link (`via`), and on one for
    # each contact of its two links. The flag `derivatives` counts as 0 or 1.
    return {
        "poles": pole_count,
        "primary": primary_count,
        "secondary": len(circle_steps),
        "irreducible": irreducible_count,
        "great_circles": sum(len(step.via) + len(step.contacts) for step in circle_steps),
        "link_rates": link_count,
        "axis_derivatives": pole_count * request.derivatives,
        "rate_derivatives": link_count * request.derivatives,
    }


class Timer:
    """Measures the wall-clock time in seconds of each stage of a run.

    A stage is a kind of work, such as ``"positions"``. Its times in all blocks of samples
    are added up.

    Attributes
    ----------
    seconds
        Time of each stage in this process, by name of the stage.
    earlier_seconds
        Time of each stage before a resumed run was stopped, by name of the stage.
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self.earlier_seconds: dict[str, float] = {}
        self._start_time = time.perf_counter()

    def total_seconds(self) -> dict[str, float]:
        """Return the time of each stage so far, with the earlier part of a resumed run.

        Time that belongs to no stage is listed under `REST`.
        """
        # `self.seconds` and `elapsed` have only the time of this process.
        elapsed = time.perf_counter() - self._start_time
        seconds = self.seconds | {REST: elapsed - sum(self.seconds.values())}
        return {
            name: self.earlier_seconds.get(name, 0.0) + seconds.get(name, 0.0)
            for name in dict.fromkeys([*self.earlier_seconds, *seconds])
        }

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Add the time that the body of a `with` statement takes to a stage."""
        seconds_before = self.seconds.setdefault(name, 0.0)
        start_time = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = seconds_before + time.perf_counter() - start_time
