"""How a run's numbers are computed: the choices that trade speed for accuracy."""

from dataclasses import dataclass
from typing import Literal, final

from spherekit.checked import checked_class
from spherekit.errors import AnalysisError
from spherekit.rates.request import (
    ROUTES,
    Route,
)

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
