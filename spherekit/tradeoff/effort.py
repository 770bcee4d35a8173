"""What is tried when settings are measured, and how long."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, final

from spherekit.analysis.running.setting import ENGINES, Integrator, Setting
from spherekit.checked import check_fields
from spherekit.dynamics.forward import LEAST
from spherekit.errors import AnalysisError
from spherekit.rates.request import (
    ROUTES,
)

ROUNDS = 5
"""Times every setting is run, each round in another order; the best counts."""


@final
@dataclass(frozen=True)
class Effort:
    """What is tried when settings are measured, and how long.

    `settings` are those to try; by default all that apply to samples, or to a simulation.
    Errors are measured at most at `checked` samples. Each setting is run in so many
    `rounds` for its time, and after `budget` seconds no round begins.
    """

    unused: ClassVar[tuple[str, ...]] = ("tolerance", "verify", "degrees")

    settings: Sequence[Setting] | None = None
    checked: int | None = None
    rounds: int = ROUNDS
    budget: float = 30.0

    def __post_init__(self) -> None:
        check_fields(self, AnalysisError, "trade")


DECADES = range(3, 16)
"""Tolerances of simulations, as negative powers of ten."""


def of_samples() -> list[Setting]:
    """Return the settings for samples of the inputs: routes and engines."""
    every = [Setting(route=route) for route in ROUTES]
    return every + [Setting(engine=engine) for engine in ENGINES if engine != "numpy"]


def of_simulation() -> list[Setting]:
    """Return the settings for simulations: integrators and tolerances."""
    integrators: tuple[Integrator, ...] = ("numpy", "compiled")
    return [
        Setting(integrator=integrator, tolerance=float(f"1e-{decade}"))
        for integrator in integrators
        for decade in DECADES
        if float(f"1e-{decade}") >= LEAST[integrator]
    ]
