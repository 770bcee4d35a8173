"""Configurations and poles of a course, block after block, by a setting.

How a run's numbers are computed: the choices that trade speed for accuracy.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, final

import numpy as np
from numpy.typing import NDArray

from spherekit.analysis.batch import Needs
from spherekit.analysis.running.kernel_columns import UnreadField
from spherekit.analysis.running.rows_at_once import RowsAtOnce
from spherekit.analysis.running.sampling import Sampling
from spherekit.checked import checked_class
from spherekit.conventions import Status
from spherekit.engine.kernels import Kernel, kernel
from spherekit.errors import AnalysisError
from spherekit.motion.motion import AngleMemory, Motion
from spherekit.rates.core import LinkRates
from spherekit.rates.field import evaluate, field_of_rates
from spherekit.rates.request import (
    ROUTES,
    PoleField,
    Request,
    Route,
    SignMemory,
)
from spherekit.sphere.rotation import Floats

RateEngine = Literal["numpy", "compiled", "extended"]
Integrator = Literal["auto", "numpy", "compiled"]

ENGINES: dict[RateEngine, str] = {
    "numpy": "the plan's great circles or equations, by NumPy",
    "compiled": "expressions in homogeneous rates, compiled by heyoka",
    "extended": "the same expressions in NumPy's longdouble",
}


@final
@checked_class(AnalysisError)
@dataclass(frozen=True)
class Setting:
    """One way to compute what analyses read.

    `engine` finds rates: by NumPy along a `route`, or by a kernel that knows no routes.
    `integrator` and `tolerance` (rad) are those of a simulation; None leaves the tolerance
    to the run.
    """

    engine: RateEngine = "numpy"
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


@final
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
        if setting.engine != "numpy":
            _ = self._kernel
        self.at_once: RowsAtOnce | None = None
        if (setting.engine, setting.route) == ORDINARY_WAY:
            ahead = not needs.tracer
            timed = needs.time or all_links or course.timed
            self.at_once = RowsAtOnce.of(course, self.requests, all_links, ahead, timed)

    @cached_property
    def _kernel(self) -> Kernel:
        """The kernel of rates of all links."""
        mechanism = self.course.tracer.mechanism
        if len(mechanism.inputs) > 1:
            raise AnalysisError(
                f"{mechanism.name}: a kernel finds rates by one input, and there are "
                f"{len(mechanism.inputs)}"
            )
        extended = self.setting.engine == "extended"
        derivatives = any(item.derivatives for item in self.requests)
        return kernel(
            mechanism,
            self.course.tracer.inputs[0],
            [],
            links=range(1, len(mechanism.links)),
            derivatives=int(derivatives),
            with_tangent=True,
            engine="numpy" if extended else "compiled",
            number=np.longdouble if extended else float,
        )

    @property
    def block(self) -> int:
        """Samples in a block, as many as are quick together."""
        if self.at_once is not None:
            return self.at_once.block
        return self.course.tracer.block

    def blocks(self, size: int, first: int = 0) -> Iterator[Motion]:
        """Yield the motion from sample `first` on in blocks of successive samples."""
        if self.at_once is not None:
            yield from self.at_once.blocks(size, first)
            return
        yield from self.course.blocks(size, first)

    def motion_at(self, rows: NDArray[np.intp]) -> Motion:
        """Return the motion at some samples, by their numbers in rising order."""
        course = self.course
        if self.at_once is not None:
            return self.at_once.motion_at(rows)
        if course.simulation is not None:
            return course.simulated(rows)
        motion = course.tracer.samples(rows)
        timing = course.timing
        if timing is not None:
            timing = timing.rows(rows).repeated(len(motion.assembly_modes))
        return replace(motion, timing=timing)

    def fields(
        self, motion: Motion, memories: Sequence[SignMemory]
    ) -> tuple[PoleField | UnreadField, ...]:
        """Return the poles of a block of `blocks` for each input that moves."""
        if self.at_once is not None and self.at_once.has_found(motion):
            return self.at_once.fields(motion, memories)
        pairs = zip(self.requests, memories, strict=False)
        if self.setting.engine == "numpy":
            return tuple(
                evaluate(motion, item, memory, self.setting.route) for item, memory in pairs
            )
        rates = self._link_rates(motion)
        return tuple(field_of_rates(motion, item, rates, memory) for item, memory in pairs)

    def angles(self, motion: Motion, memory: AngleMemory) -> Mapping[str, Floats]:
        """Return the variables that go on, by pair, at a block of `blocks`."""
        return self.course.angles(motion, sorted(self.needs.continued_values), memory)

    def _link_rates(self, motion: Motion) -> LinkRates:
        """Return the rates that the kernel finds, in float64.

        `reciprocal_condition` is the reciprocal size of all variables' rates per unit rate
        of the input: 0 at its dead centres.
        """
        made = self._kernel
        number = np.longdouble if self.setting.engine == "extended" else float
        rates = made.values(motion.values.T.astype(number))
        n, links = len(motion), len(motion.mechanism.links)
        w, dw = np.zeros((n, links, 3)), np.zeros((n, links, 3))
        for link in rates.w:
            w[:, link] = rates.w[link]
            dw[:, link] = rates.dw.get(link, np.nan)
        assert rates.tangent is not None
        size = np.sqrt(np.sum(rates.tangent**2, axis=1)).astype(float)
        ok = motion.status == Status.OK
        with np.errstate(divide="ignore", invalid="ignore"):
            return LinkRates(w, dw, np.where(ok, 1.0 / size, np.nan))
