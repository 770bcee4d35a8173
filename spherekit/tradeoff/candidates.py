"""The settings that are tried."""

from spherekit.analysis.running.setting import ENGINES, Integrator, Setting
from spherekit.dynamics.forward import LEAST
from spherekit.rates.request import (
    ROUTES,
)

NODES = (32, 64, 128, 256, 512, 1024, 4096)
"""Nodes of functions of the input, for each assembly mode."""

SPECTRAL_NODES = (32, 64, 128, 256, 512)

DECADES = range(3, 16)
"""Tolerances of simulations, as negative powers of ten."""


def of_samples() -> list[Setting]:
    """Return the settings for samples of the inputs: routes, engines, representations."""
    every = [Setting(route=route) for route in ROUTES]
    every += [Setting(engine=engine) for engine in ENGINES if engine != "numpy"]
    every += [
        Setting(representation=kind, nodes=nodes)
        for kind in ("linear", "cubic")
        for nodes in NODES
    ]
    every += [Setting(representation="spectral", nodes=nodes) for nodes in SPECTRAL_NODES]
    return every


def of_simulation() -> list[Setting]:
    """Return the settings for simulations: integrators and tolerances."""
    integrators: tuple[Integrator, ...] = ("numpy", "compiled")
    return [
        Setting(integrator=integrator, tolerance=float(f"1e-{decade}"))
        for integrator in integrators
        for decade in DECADES
        if float(f"1e-{decade}") >= LEAST[integrator]
    ]
