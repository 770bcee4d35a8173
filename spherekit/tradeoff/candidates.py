"""The settings that are tried."""

from spherekit.analysis.running.setting import ENGINES, Integrator, Setting
from spherekit.dynamics.forward import LEAST
from spherekit.rates.request import (
    ROUTES,
)

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
