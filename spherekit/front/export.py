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
from spherekit.errors import OutputError, SolveError
from spherekit.exchange.mjcf import left_out, mjcf, rigid_bodies
from spherekit.files.atomic import write_text
from spherekit.files.read import AnyMechanism, mechanism_of
from spherekit.files.write import dump
from spherekit.model.mechanism import Mechanism
from spherekit.motion.motion import Tracer

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
    input_pair: str | None = None,
    assembly_mode: int = 0,
    poles: Sequence[str] | None = None,
    tolerance: float | None = None,
    at: float | None = None,
) -> Exported:
    """Write a mechanism for other programs, in the format that the file's ending says.

    Parameters
    ----------
    mechanism
        The mechanism, the name of a shipped one, or the path of a file.
    path
        ``*.npz``: its functions, for use without it (see `load_reduced`); ``*.xml``: a
        MuJoCo model; ``*.toml``: its file.
    input_pair, assembly mode
        The driven pair, by default the first input, and the assembly mode.
    poles, tolerance
        Of functions: only these poles (all by default), and their error relative to the
        largest value of each, 1e-13 by default.
    at
        Of a MuJoCo model: the input (rad) of its pose, by default the start of the range.

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
        return _functions(mechanism, target, input_pair, assembly_mode, poles, tolerance)
    if target.suffix == ".xml":
        return _mujoco(mechanism, target, input_pair, assembly_mode, at)
    dump(mechanism if input_pair is None else mechanism.with_inputs(input_pair), target)
    return Exported(target, "a mechanism file")


def _functions(
    mechanism: Mechanism,
    target: Path,
    input_pair: str | None,
    assembly_mode: int,
    poles: Sequence[str] | None,
    tolerance: float | None,
) -> Exported:
    accuracy = {} if tolerance is None else {"tolerance": tolerance}
    model = online_model(
        mechanism,
        input_pair=input_pair,
        assembly_mode=assembly_mode,
        poles=poles,
        **accuracy,
    )
    model.save(target)
    heading = model.heading
    notes = []
    if mechanism.outputs:
        names = listing(output.name for output in mechanism.outputs)
        notes.append(f"outputs left out: {names}")
    if not mechanism.masses:
        notes.append("no inertia: the mechanism has no masses")
    return Exported(
        target,
        f"{len(heading.functions)} functions of {heading.coordinate}, errors up to "
        f"{model.error:.2g} of the largest value of each",
        tuple(notes),
    )


def _mujoco(
    mechanism: Mechanism,
    target: Path,
    input_pair: str | None,
    assembly_mode: int,
    at: float | None,
) -> Exported:
    tracer = Tracer(mechanism, input_pair, assembly_mode)
    q = tracer.range[0] if at is None else at
    if not np.isfinite(q):
        raise SolveError(f"export: at is {q}, it has to be a finite number of rad")
    where = f"{listing(tracer.inputs)} = {q:.6g} rad ({np.degrees(q):.6g} deg)"
    motion = tracer.at(np.array([q]))
    if motion.failed[0]:
        raise SolveError(
            f"{mechanism.name}: assembly mode {assembly_mode} has no configuration at "
            f"{where}; give "
            "another input to be at"
        )
    made = tracer.mechanism
    write_text(target, mjcf(made, motion.values[0]))
    notes = left_out(rigid_bodies(made, motion.values[0]))
    return Exported(target, f"a MuJoCo model at {where}", notes)
