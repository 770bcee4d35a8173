"""The choices of a run that trade speed for accuracy: engines, routes, tolerance."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from spherekit.argument_validation import checked_class
from spherekit.errors import AnalysisError
from spherekit.velocities.pole_request import ROUTES, Route
from spherekit.velocities.row_velocities import RowEngine

Integrator = Literal["auto", "numpy", "compiled"]
"""Integrator of a simulation; ``"auto"`` is the one that is expected to finish first."""

ENGINES: dict[RowEngine, str] = {
    "numpy": "terms of the velocity equations, on NumPy's arrays",
    "compiled": "the same terms, compiled by heyoka",
    "extended": "the same terms in quad precision, 33 digits",
}
"""Descriptions of the engines that evaluate velocities, by name."""


@checked_class(AnalysisError)
@dataclass(frozen=True)
class Setting:
    """One way to compute the quantities that analyses read.

    Ways differ in speed and accuracy, and the command ``trade`` compares them.

    Attributes
    ----------
    engine
        Name of the engine that evaluates the velocity equations at the samples.
    route
        How the engine "numpy" computes poles (axes of relative rotation of two links).

        - "best" solves the velocity equations of the whole mechanism in float64, and again
          in quad precision where float64 leaves too few digits.
        - "equations" computes the same numbers as "best", in the same way. Only the summary
          of the run differs. It counts the rows that were computed in quad precision. On
          the route "equations" all rows count, even those that were computed in float64.
        - "first" and "conditioned" compute one pole after the other, as an intersection of
          two great circles. Each circle usually goes through two poles that are already
          computed. The plan of the poles lists the circles of each pole. "first" takes the
          first two of them. "conditioned" takes the circle with the smallest error bound,
          and the one with which the intersection then has the smallest error bound.
    integrator
        Name of the engine that solves a simulation.
    tolerance
        The tolerance of a simulation, rad. None for other runs, and for a simulation with
        the tolerance of its study.
    """

    engine: RowEngine = "numpy"
    route: Route = "best"
    integrator: Integrator = "auto"
    tolerance: float | None = None

    def __str__(self) -> str:
        parts: list[str] = [self.engine]
        # A tolerance is set only if settings of a simulation are compared.
        if self.tolerance is not None:
            # Four digits, because settings with other tolerances have other names.
            rounded = float(f"{self.tolerance:.3e}")
            text = np.format_float_scientific(rounded, trim="-", exp_digits=2)
            parts = [self.integrator, f"tolerance {text}"]
        elif self.engine == "numpy":
            parts.append(self.route)
        return " ".join(parts)

    def describe(self) -> str:
        """Return a description for users."""
        if self.tolerance is not None:
            return f"integrated by {self.integrator}, tolerance {self.tolerance:g} rad"
        return ROUTES[self.route] if self.engine == "numpy" else ENGINES[self.engine]


ORDINARY = Setting()
"""The default setting. Only with it a kernel may evaluate the samples."""
