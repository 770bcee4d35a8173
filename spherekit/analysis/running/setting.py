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
Representation = Literal["every", "linear", "cubic", "spectral"]
Integrator = Literal["auto", "numpy", "compiled"]

ENGINES: dict[RateEngine, str] = {
    "numpy": "the plan's great circles or equations, by NumPy",
    "compiled": "expressions in homogeneous rates, compiled by heyoka",
    "extended": "the same expressions in NumPy's longdouble",
}
REPRESENTATIONS: dict[Representation, str] = {
    "every": "every sample is evaluated",
    "linear": "equally spaced nodes, read along straight lines",
    "cubic": "equally spaced nodes with exact slopes, read from Hermite cubics",
    "spectral": "nodes of a Fourier series over a whole turn, else of Chebyshev series",
}


@final
@checked_class(AnalysisError)
@dataclass(frozen=True)
class Setting:
    """One way to compute what analyses read.

    `engine` finds rates: by NumPy along a `route`, or by a kernel that knows no routes.
    `representation` says whether every sample is evaluated, or `nodes` of them for each
    assembly mode, from which the samples are read. `integrator` and `tolerance` (rad) are
    those of a simulation; None leaves the tolerance to the run.
    """

    engine: RateEngine = "numpy"
    route: Route = "best"
    representation: Representation = "every"
    nodes: int = 0
    integrator: Integrator = "auto"
    tolerance: float | None = None

    def __str__(self) -> str:
        parts: list[str] = [self.engine]
        if self.tolerance is not None:
            parts = [self.integrator, f"tolerance {self.tolerance:.0e}"]
        elif self.engine == "numpy":
            parts.append(self.route)
        if self.representation != "every":
            parts.append(f"{self.representation} {self.nodes}")
        return " ".join(parts)

    @property
    def compiles(self) -> bool:
        """Whether something is made ready first, once for many runs."""
        return self.engine != "numpy" or self.integrator == "compiled"

    def describe(self) -> str:
        """Return the setting in words."""
        if self.tolerance is not None:
            return f"integrated by {self.integrator}, tolerance {self.tolerance:g} rad"
        how = ROUTES[self.route] if self.engine == "numpy" else ENGINES[self.engine]
        if self.representation == "every":
            return f"{how}; {REPRESENTATIONS['every']}"
        return f"{how}; {self.nodes} {REPRESENTATIONS[self.representation]}"


ORDINARY = Setting()
"""What a run does unless told otherwise."""
