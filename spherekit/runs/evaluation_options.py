"""How a run's numbers are computed: the choices that trade speed for accuracy."""

from dataclasses import dataclass
from typing import Literal

from spherekit.argument_validation import checked_class
from spherekit.errors import AnalysisError
from spherekit.velocities.pole_evaluation import RowEngine
from spherekit.velocities.pole_request import ROUTES, Route

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

    def describe(self) -> str:
        """Return the setting in words."""
        if self.tolerance is not None:
            return f"integrated by {self.integrator}, tolerance {self.tolerance:g} rad"
        return ROUTES[self.route] if self.engine == "numpy" else ENGINES[self.engine]


ORDINARY = Setting()
"""What a run does unless told otherwise."""
