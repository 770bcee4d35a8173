"""Which assembly modes the names of a mechanism's file are of."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from spherekit.conventions import listing
from spherekit.model.parts import NamedMode
from spherekit.motion.assembly_modes import AssemblyMode, Solver
from spherekit.motion.guides import ModeOverGrid
from spherekit.numeric.turns import wrap
from spherekit.sphere.rotation import Floats

FAR = np.radians(10.0)
"""A mode that misses a named configuration by more (rad) is another one."""
CLEARLY = 0.5
"""So much nearer than every other mode, as a part, the one meant is."""


def named(
    solver: Solver, assembly_modes: Sequence[AssemblyMode]
) -> tuple[tuple[AssemblyMode, ...], tuple[str, ...]]:
    """Return assembly modes with the names that the file gives them, and what fails.

    A name goes to the mode that comes nearest to its configuration at the inputs of this.
    One whose configuration does not have all inputs is not used.
    """
    names: dict[int, str] = {}
    faults: list[str] = []
    if not assembly_modes:
        return (), ()
    inputs = [item.pair for item in solver.mechanism.inputs]
    for mode in solver.mechanism.modes:
        if not set(inputs) <= set(mode.values):
            continue
        place, why = _place(solver, assembly_modes, mode, inputs)
        if place in names:
            why = f"it is mode {assembly_modes[place].number}, as {names[place]} is"
        if why:
            faults.append(f"modes.{mode.name}: {why}; no mode has this name")
        else:
            names[place] = mode.name
    made = (replace(mode, name=names.get(k, "")) for k, mode in enumerate(assembly_modes))
    return tuple(made), tuple(faults)


def _place(
    solver: Solver,
    assembly_modes: Sequence[AssemblyMode],
    mode: NamedMode,
    inputs: Sequence[str],
) -> tuple[int, str]:
    """Return the place of the mode with a configuration, or -1 and why there is none."""
    if any(isinstance(item.guide, ModeOverGrid) for item in assembly_modes):
        return -1, "modes followed over samples of several inputs have no names"
    order = [solver.mechanism.pairs[pair].name for pair in solver.assembly.inputs]
    q = np.array([[mode.values[pair] for pair in order]])
    at = [solver.evaluate(item, q).values[0] for item in assembly_modes]
    passive = [name for name in mode.values if name not in inputs]
    variables = [solver.mechanism.angles[name] for name in passive]
    wanted = np.array([mode.values[name] for name in passive])
    missed = np.abs(wrap(np.array(at)[:, variables] - wanted))
    off = np.nan_to_num(np.max(missed, axis=1, initial=0.0), nan=np.inf)
    best = int(np.argmin(off))
    others = np.delete(off, best)
    if off[best] < FAR and np.all(off[best] < CLEARLY * others):
        return best, ""
    shown = listing(f"{pair} = {np.degrees(mode.values[pair]):.6g} deg" for pair in inputs)
    there = [
        f"mode {item.number}: {', '.join(_told(values, passive, solver))}"
        for item, values in zip(assembly_modes, at, strict=True)
        if np.all(np.isfinite(values))
    ]
    return -1, f"it is none at {shown}, where there are {listing(there) or 'no modes'}"


def _told(values: Floats, passive: Sequence[str], solver: Solver) -> list[str]:
    """Return the variables of passive pairs in words."""
    angles = solver.mechanism.angles
    return [f"{n} = {np.degrees(wrap(values[angles[n]])):.6g} deg" for n in passive]
