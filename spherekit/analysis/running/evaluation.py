"""Configurations and poles of a course, block after block, by a setting.

How a run's numbers are computed: the choices that trade speed for accuracy.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from spherekit.analysis.batch import Needs
from spherekit.analysis.running.kernel_columns import LazyField
from spherekit.analysis.running.rows_at_once import BatchRunner
from spherekit.analysis.running.sampling import Sampling
from spherekit.argument_validation import checked_class
from spherekit.arrays import Floats
from spherekit.engine.compiler import heyoka
from spherekit.engine.fields import RowEngine, evaluate
from spherekit.errors import AnalysisError
from spherekit.motion.motion import AngleUnwrapping, Motion
from spherekit.rates.request import (
    ROUTES,
    PoleField,
    Request,
    Route,
    SignContinuation,
)

Integrator = Literal["auto", "numpy", "compiled"]

ENGINES: dict[RowEngine, str] = {
    "numpy": "terms of the velocity equations, on NumPy's arrays",
    "compiled": "the same terms, compiled by heyoka",
    "extended": "the same terms in quad precision, 33 digits",
}


@checked_class(AnalysisError)
@dataclass(frozen=True)
class Setting:
    """One way to compute what analyses read.

    `engine` runs the terms of rates; NumPy takes a `route` too.
    `integrator` and `tolerance` (rad) are those of a simulation; None leaves the tolerance
    to the run.
    """

    engine: RowEngine = "numpy"
    route: Route = "best"
    integrator: Integrator = "auto"
    tolerance: float | None = None

    def __str__(self) -> str:
        parts: list[str] = [self.engine]
        if self.tolerance is not None:
            parts = [self.integrator, f"tolerance {self.tolerance:.0e}"]
        elif self.engine == "numpy":
            parts.append(self.route)
        return " ".join(parts)

    @property
    def compiles(self) -> bool:
        """Whether something is made ready first, once for many runs."""
        return self.engine != "numpy" or self.integrator == "compiled"

    def describe(self) -> str:
        """Return the setting in words."""
        if self.tolerance is not None:
            return f"integrated by {self.integrator}, tolerance {self.tolerance:g} rad"
        return ROUTES[self.route] if self.engine == "numpy" else ENGINES[self.engine]


ORDINARY = Setting()
"""What a run does unless told otherwise."""


ORDINARY_WAY = ORDINARY.engine, ORDINARY.route
"""What a kernel may stand in for: the best route at every sample."""


class Evaluation:
    """What a run evaluates, and how.

    Parameters
    ----------
    setting
        The way to compute.
    course
        The samples.
    requests, needs
        What is wanted of the poles for each input, and what analyses read.
    all_links
        Whether scenes show all links.

    Attributes
    ----------
    blocks
        Gives the motion in blocks of so many successive samples, from a first one on.
    motion_at
        Gives the motion at some samples, by their numbers in rising order.

    Raises
    ------
    AnalysisError, EngineError, PlanError
        If the setting does not apply to the mechanism or the course; says why.
    """

    def __init__(
        self,
        setting: Setting,
        course: Sampling,
        requests: Sequence[Request],
        needs: Needs,
        all_links: bool = False,
    ) -> None:
        self.setting, self.course = setting, course
        self.requests = tuple(item for item in requests if item.poles)
        self.needs = needs
        if setting.engine == "compiled":
            heyoka()
        self.at_once: BatchRunner | None = None
        if (setting.engine, setting.route) == ORDINARY_WAY:
            ahead = not needs.tracer
            timed = needs.time or all_links or course.timed
            self.at_once = BatchRunner.of(course, self.requests, all_links, ahead, timed)

        self._source: BatchRunner | Sampling = self.at_once or course
        self.blocks, self.motion_at = self._source.blocks, self._source.motion_at

    @property
    def block(self) -> int:
        """Samples in a block, as many as are quick together."""
        return self._source.block

    def fields(
        self, motion: Motion, memories: Sequence[SignContinuation]
    ) -> tuple[PoleField | LazyField, ...]:
        """Return the poles of a block of `blocks` for each input that moves."""
        if self.at_once is not None and self.at_once.has_found(motion):
            return self.at_once.fields(motion, memories)
        setting = self.setting
        return tuple(
            evaluate(motion, item, memory, setting.route, setting.engine)
            for item, memory in zip(self.requests, memories, strict=False)
        )

    def angles(self, motion: Motion, memory: AngleUnwrapping) -> Mapping[str, Floats]:
        """Return the variables that go on, by pair, at a block of `blocks`."""
        return self.course.angles(motion, sorted(self.needs.continued_values), memory)
