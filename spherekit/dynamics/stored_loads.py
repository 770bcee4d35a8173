"""Loads as stored models keep them: their magnitudes, and the functions they work on."""

from collections.abc import Callable

from spherekit.dynamics.forces import Loads
from spherekit.dynamics.model_metadata import StoredLoad
from spherekit.model.expression import Expression
from spherekit.model.torque_table import TorqueTable


def own_velocities(loads: Loads) -> dict[int, str]:
    """Return the names of velocities of components that no pair's rate is, by number."""
    owners, names = loads.owners, {}
    for k, part in enumerate(loads.components):
        if not part.pair:
            name = f"load {loads.names[owners[k]]}"
            axis = f" {'xyz'[k - owners.index(owners[k])]}"
            names[k] = name + axis * (owners.count(owners[k]) > 1)
    return names


def stored_loads(loads: Loads, rate: Callable[[str], str]) -> tuple[StoredLoad, ...]:
    """Return what magnitudes of loads depend on besides the configuration.

    `rate` names the stored rate of a pair's variable, by the variable's name.
    """
    velocities, stored = own_velocities(loads), []
    for number, load in enumerate(loads.mechanism.loads):
        parts = {
            k: part for k, part in enumerate(loads.components) if loads.owners[k] == number
        }
        works_on = tuple(
            velocities.get(k, rate(f"theta_{part.pair}")) for k, part in parts.items()
        )
        if isinstance(load, TorqueTable):
            table = load.times, load.torques, load.periodic
            stored.append(StoredLoad(load.name, works_on, (), *table))
            continue
        laws = [part.magnitude for part in parts.values()]
        texts = tuple(law.text for law in laws if isinstance(law, Expression))
        stored.append(StoredLoad(load.name, works_on, texts))
    return tuple(stored)
