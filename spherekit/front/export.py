"""Mechanisms for other programs: stored functions, MuJoCo models, mechanism files."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import final

import numpy as np

from spherekit.checked import checked
from spherekit.conventions import listing
from spherekit.dynamics.tabulate import online_model
from spherekit.dynamics.tabulate_grid import grid_model
from spherekit.errors import OutputError
from spherekit.exchange.mjcf import mjcf
from spherekit.exchange.posed import posed
from spherekit.files.atomic import write_text
from spherekit.files.read import AnyMechanism, mechanism_of
from spherekit.files.write import dump
from spherekit.model.mechanism import Mechanism
from spherekit.planning.inputs import driven_at

SUFFIXES = (".npz", ".xml", ".toml")


@final
@dataclass(frozen=True)
class Exported:
    """A file that was written: what it holds, and `notes` on what it leaves out."""

    path: Path
    holds: str
    notes: tuple[str, ...] = ()


@checked(OutputError)
def export(
    mechanism: AnyMechanism,
    path: str | os.PathLike[str],
    *,
    input_pair: str | Sequence[str] | None = None,
    assembly_mode: int = 0,
    poles: Sequence[str] | None = None,
    tolerance: float | None = None,
    at: float | Sequence[float] | None = None,
) -> Exported:
    """Write a mechanism for other programs, in the format that the file's ending says.

    Parameters
    ----------
    mechanism
        The mechanism, the name of a shipped one, or the path of a file.
    path
        ``*.npz``: its functions, for use without it (see `load_reduced`); ``*.xml``: a
        MuJoCo model; ``*.toml``: its file.
    input_pair, assembly_mode
        The driven pairs, by default the inputs of the mechanism, and the assembly mode.
    poles, tolerance
        Of functions: only these poles (by default all, of several inputs none), and their
        error relative to the largest value of each, 1e-13 (of several inputs 1e-11) by
        default.
    at
        Of a MuJoCo model: the inputs (rad) of its pose, by default the first on the way
        through their ranges at which there is one.

    Raises
    ------
    OutputError
        If the ending is unknown, an argument does nothing there, or nothing can be written.
    SolveError, PlanError, EngineError
        If the mechanism cannot be exported so, or has no such assembly mode.

    Examples
    --------
    >>> import spherekit as sk
    >>> made = sk.export("four_bar", "four_bar.npz", poles=["4/1"])
    >>> model = sk.load_reduced(made.path)
    """
    target = Path(path)
    if target.suffix not in SUFFIXES:
        raise OutputError(
            f"{target}: exported are files named *{', *'.join(SUFFIXES)}; give it one of "
            "these endings"
        )
    for name, value, suffix in (
        ("poles", poles, ".npz"),
        ("tolerance", tolerance, ".npz"),
        ("at", at, ".xml"),
    ):
        if value is not None and target.suffix != suffix:
            raise OutputError(f"export: {name} does nothing but for *{suffix}")
    mechanism = mechanism_of(mechanism)
    if target.suffix == ".npz":
        made = driven_at(mechanism, input_pair)
        return _functions(made, target, assembly_mode, poles, tolerance)
    if target.suffix == ".xml":
        return _mujoco(mechanism, target, input_pair, assembly_mode, at)
    dump(driven_at(mechanism, input_pair), target)
    return Exported(target, "a mechanism file")


def _functions(
    mechanism: Mechanism,
    target: Path,
    assembly_mode: int,
    poles: Sequence[str] | None,
    tolerance: float | None,
) -> Exported:
    notes = []
    if mechanism.outputs:
        names = listing(output.name for output in mechanism.outputs)
        notes.append(f"outputs left out: {names}")
    if not mechanism.masses:
        notes.append("no inertia: the mechanism has no masses")
    if len(mechanism.inputs) > 1:
        grid = grid_model(
            mechanism,
            assembly_mode=assembly_mode,
            poles=poles or (),
            tolerance=1e-11 if tolerance is None else tolerance,
        )
        grid.save(target)
        count, of = len(grid.heading.functions), listing(grid.heading.inputs)
        error = grid.error
        if grid.heading.covered < 1.0:
            notes.append(
                f"known in {grid.heading.covered:.3g} of the box of the inputs' ranges; "
                "elsewhere the assembly mode does not exist or is near a singularity"
            )
    else:
        model = online_model(
            mechanism,
            assembly_mode=assembly_mode,
            poles=poles,
            tolerance=1e-13 if tolerance is None else tolerance,
        )
        model.save(target)
        count, of = len(model.heading.functions), model.heading.coordinate
        error = model.error
    holds = (
        f"{count} functions of {of}, errors up to {error:.2g} of the largest value of each"
    )
    return Exported(target, holds, tuple(notes))


def _mujoco(
    mechanism: Mechanism,
    target: Path,
    input_pair: str | Sequence[str] | None,
    assembly_mode: int,
    at: float | Sequence[float] | None,
) -> Exported:
    made, values = posed(mechanism, input_pair, assembly_mode, at)
    where = listing(
        f"{item.pair} = {values[made.angles[item.pair]]:.6g} rad "
        f"({np.degrees(values[made.angles[item.pair]]):.6g} deg)"
        for item in made.inputs
    )
    model = mjcf(made, values)
    write_text(target, model.text)
    return Exported(target, f"a MuJoCo model at {where}", model.notes)
