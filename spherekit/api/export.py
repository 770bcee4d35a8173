"""Exports a mechanism: source code, stored functions, tables, MuJoCo models, files."""

from collections.abc import Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from spherekit.argument_validation import checked
from spherekit.conventions import AnyPath, Facts, Names
from spherekit.dynamics.reduced_model_maker import reduced_grid_model, reduced_model
from spherekit.errors import OutputError
from spherekit.exchange.coupling_header import header
from spherekit.exchange.coupling_table import CouplingTable, write_csv, write_npz
from spherekit.exchange.coupling_table_maker import coupling_table
from spherekit.exchange.exported_pose import find_pose
from spherekit.exchange.formula_expressions import Formulas, ModeTable, SmoothModes
from spherekit.exchange.formula_maker import formulas, refuse_link_sizes
from spherekit.exchange.latex import latex
from spherekit.exchange.mjcf import MujocoModel
from spherekit.exchange.size_arguments import check_arguments
from spherekit.exchange.source_head import OTHER_CROSSINGS
from spherekit.exchange.source_languages import source
from spherekit.exchange.stored_formulas import reduced_formulas
from spherekit.files.mechanism_reader import AnyMechanism, mechanism_of
from spherekit.files.mechanism_writer import dump
from spherekit.files.study import Crossings
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.sizes import angles_in_radians
from spherekit.planning.assembly_plan import driven_at
from spherekit.positions.mode_meetings import degrees_text
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.quantity import AngleUnit
from spherekit.storage.atomic_write import write_text
from spherekit.wording import counted, listing, numbered

Kind = Literal[
    "c",
    "cpp",
    "js",
    "python",
    "julia",
    "casadi",
    "latex",
    "model",
    "mjcf",
    "coupling",
    "file",
]

SOURCES: Mapping[Kind, Names] = {
    "c": (".c",),
    "cpp": (".hpp",),
    "js": (".mjs", ".js"),
    "python": (".py",),
    "julia": (".jl",),
    "casadi": (".py",),
}
"""Endings of the files of each language of source code."""

SUFFIXES: Mapping[Kind, Names] = {
    **SOURCES,
    "latex": (".tex",),
    "model": (".npz", *dict.fromkeys(chain(*SOURCES.values()))),
    "mjcf": (".xml",),
    "file": (".toml",),
    "coupling": (".csv", ".npz", ".h"),
}
"""Endings of the files of each kind. An ending of several kinds means the first."""

KINDS_OF_ARGUMENT: Mapping[str, tuple[Kind, ...]] = {
    "poles": ("model", "coupling"),
    "tolerance": ("model", "coupling"),
    "pairs": ("coupling",),
    "samples": ("coupling",),
    "at": ("mjcf",),
    "angle_unit": ("mjcf",),
    "quantities": (*SOURCES, "latex"),
    "vary": (*SOURCES, "latex"),
    "assembly_mode": (*SOURCES, "model", "mjcf", "coupling"),
    "crossings": (*SOURCES,),
}
"""The kinds that each argument applies to, for arguments that not all kinds have."""


class Exported(NamedTuple):
    """A file that an export has written, with a description for the user.

    Attributes
    ----------
    path
        Path of the file.
    holds
        Content of the file in words.
    notes
        Sentences on everything that the export leaves out.
    """

    path: Path
    holds: str
    notes: Names = ()


@checked(OutputError)
def export(
    mechanism: AnyMechanism,
    path: AnyPath,
    *,
    to: Kind | None = None,
    input_pair: str | Sequence[str] | None = None,
    assembly_mode: int | str | None = None,
    poles: Sequence[str] | None = None,
    pairs: Sequence[str] | None = None,
    samples: int | Sequence[int] | None = None,
    tolerance: float | None = None,
    at: float | Sequence[float] | None = None,
    angle_unit: AngleUnit = "rad",
    quantities: Sequence[str] | None = None,
    vary: Sequence[str] | None = None,
    crossings: Crossings | None = None,
) -> Exported:
    """Write a mechanism for other programs. The ending of the file states the format.

    Parameters
    ----------
    mechanism
        The mechanism, the name of a shipped one, or the path of a file.
    path
        The file. Its ending says what is written:

        - ``.npz``: a reduced model. It stores functions of the mechanism, such as its
          inertia, and replaces the mechanism in simulation and control (see
          `load_reduced`).
        - ``.csv`` or ``.h``: a coupling table for controllers. It has the variables of
          passive pairs and their rates on a grid of the inputs. The header in C has a
          function that reads the table.
        - ``.c`` (C99), ``.hpp`` (C++), ``.mjs`` or ``.js`` (JavaScript), ``.py`` (NumPy),
          ``.jl`` (Julia): source code that computes quantities of the mechanism, such as
          angles and torques, from its inputs,
        - ``.tex``: the formulas of such quantities in print,
        - ``.xml``: a MuJoCo model,
        - ``.toml``: the mechanism file.
    to
        What to write if several kinds have the ending. ``"coupling"`` writes a coupling
        table as archive ``.npz`` (see `load_coupling`). ``"casadi"`` writes Python that
        makes a function of CasADi. ``"model"`` with the ending of a programming language
        writes a reduced model of one input as source code.
    input_pair
        The driven pairs, by default the inputs of the mechanism.
    assembly_mode
        Number or name of the assembly mode. The default is the first one; source code of
        formulas and a coupling table have all modes by default.
    poles
        For reduced models and coupling tables: the poles (axes of the relative rotation of
        two links) that are stored. By default, a model of one input has all poles. Other
        models and coupling tables have none.
    tolerance
        For reduced models and coupling tables: the error allowed. In a model it is relative
        to the largest value of each function, by default 1e-13 with one input and 1e-11
        with several. In a coupling table it is the error of angles in rad, by default 1e-6.
    pairs
        For coupling tables: the passive pairs that are stored, by default all.
    samples
        For coupling tables: the number of tabulated values along each input, by default as
        many as are needed for the allowed error.
    at
        For MuJoCo models: the inputs of the pose, in `angle_unit`, by default rad. The
        default is the first sample of their ranges at which the assembly mode exists.
    angle_unit
        Unit of `at`, ``"rad"`` or ``"deg"``.
    quantities
        For source code and LaTeX: what is computed, as names or patterns such as
        ``"theta_*"``.
    vary
        For source code and LaTeX: keys of the file such as ``"links.2.arc"``. Their numbers
        become arguments of the formulas.
    crossings
        For source code: how an assembly mode continues where its curve of configurations
        crosses the curve of another mode. A dyad (two links with three R pairs) can be
        assembled in two ways, and its sign selects one of them. With ``"end"``, the
        default, the mode keeps the signs of its dyads. With ``"pass"`` the mode follows the
        smooth curve, so these signs can change at a crossing. The source then has a
        function that gives the signs at an input. ``"pass"`` needs a single input. Both
        values have the same meaning as in `evaluate`.

    Raises
    ------
    OutputError
        If the ending is unknown, an argument has no effect in this format, or the file
        cannot be written.
    SolveError, PlanError, EngineError
        If the mechanism cannot be exported in this format, or has no such assembly mode.

    Examples
    --------
    >>> import spherekit as sk
    >>> made = sk.export("four_bar", "four_bar.npz", poles=["4/1"])
    >>> model = sk.load_reduced(made.path)
    """
    target = Path(path)
    kind = _export_kind(target, to)
    arguments = {
        "poles": poles,
        "tolerance": tolerance,
        "pairs": pairs,
        "samples": samples,
        "at": at,
        "quantities": quantities,
        "vary": vary,
        "crossings": crossings,
    }
    options: Facts = {name: x for name, x in arguments.items() if x is not None}
    stated_names = list(options)
    if assembly_mode is not None:
        stated_names.append("assembly_mode")
    if angle_unit != "rad":
        stated_names.append("angle_unit")
    for name in stated_names:
        if kind not in KINDS_OF_ARGUMENT[name]:
            kinds = [f'"{allowed_kind}"' for allowed_kind in KINDS_OF_ARGUMENT[name]]
            raise OutputError(
                f'export: the option "{name}" does not apply to the kind "{kind}", only '
                f"to the kind{'s' if len(KINDS_OF_ARGUMENT[name]) > 1 else ''} "
                f'{listing(kinds)}; leave "{name}" out'
            )
    if kind in SOURCES:
        return _export_source(mechanism, target, kind, input_pair, assembly_mode, options)
    driven = driven_at(mechanism_of(mechanism), input_pair)
    if kind == "latex":
        write_text(target, latex(driven, quantities, vary or ()))
        return Exported(target, "formulas as LaTeX, of any assembly mode")
    if isinstance(assembly_mode, str):
        analysis = PositionAnalysis(driven, assembly_mode=assembly_mode)
        assembly_mode = analysis.assembly_modes[0].number
    if kind == "model":
        return _export_functions(driven, target, assembly_mode or 0, options)
    if kind == "mjcf":
        inputs_of_pose = None  # rad
        if at is not None:
            inputs_of_pose = np.atleast_1d(angles_in_radians(at, angle_unit)).tolist()
        return _export_mujoco_model(driven, target, assembly_mode or 0, inputs_of_pose)
    if kind == "coupling":
        table = coupling_table(driven, assembly_mode=assembly_mode, **options)
        return _export_coupling_table(table, target)
    dump(driven, target)
    return Exported(target, "a mechanism file")


def _export_kind(target: Path, to: Kind | None) -> Kind:
    """Return the kind of export, such as a source language or a table, for a file name.

    The ending of the file name decides.

    Parameters
    ----------
    target
        The file that will be written.
    to
        The kind that the user requests. None: any kind that has this ending.

    Raises
    ------
    OutputError
        If the kind is unknown, or has other endings.
    """
    if to is not None and to not in SUFFIXES:
        raise OutputError(f'export: to: found "{to}", allowed: {listing(SUFFIXES)}')
    for kind, suffixes in SUFFIXES.items():
        if target.suffix in suffixes and to in (None, kind):
            return kind
    allowed = dict.fromkeys(chain(*SUFFIXES.values())) if to is None else SUFFIXES[to]
    of_kind = "" if to is None else f'of the kind "{to}" '
    raise OutputError(
        f"{target}: an export {of_kind}needs a file name with "
        f"{'one of the endings' if len(allowed) > 1 else 'the ending'} {', '.join(allowed)}"
    )


def _export_source(
    mechanism: AnyMechanism,
    target: Path,
    kind: Kind,
    input_pair: str | Sequence[str] | None,
    assembly_mode: int | str | None,
    options: Facts,
) -> Exported:
    """Write the formulas of a mechanism as source code, for programs without spherekit.

    Parameters
    ----------
    mechanism
        The mechanism, or the name or path of its file.
    target
        The file of source code.
    kind
        Language of the source code.
    input_pair, assembly_mode
        The driven pair or pairs, and the assembly mode (way to assemble the mechanism).
    options
        Further arguments of `export`: the quantities (``quantities``), the numbers that are
        arguments of the source code (``vary``), and ``crossings``.

        ``crossings`` says how a mode continues where its curve of configurations crosses
        the curve of another mode. A dyad (two links with three R pairs) can be assembled in
        two ways, and its sign selects one of them. With "end" the mode keeps the signs of
        its dyads. With "pass" the mode follows the smooth curve, so these signs can change
        at a crossing.
    """
    if options.get("crossings") == "pass":
        # The source stores the inputs at which curves of modes cross. They depend on the
        # sizes of the links, which therefore cannot be arguments.
        refuse_link_sizes(mechanism, options.get("vary", ()))
    formula_set = formulas(
        mechanism, input_pair=input_pair, assembly_mode=assembly_mode, **options
    )
    check_arguments([formula_set])  # each number that varies has to change a result
    write_text(target, source(formula_set, kind))
    notes = _describe_mode_table(formula_set.mode_table)
    return Exported(target, _describe_formulas(formula_set), notes)


def _describe_formulas(formula_set: Formulas) -> str:
    """Return in words what formulas compute, from which arguments, and by which method."""
    method = "by steps of Newton's method" if formula_set.step else "in closed form"
    arguments = listing(
        f"{x.name} ({x.unit})" for x in (*formula_set.motion, *formula_set.sizes)
    )
    return (
        f"{counted(len(formula_set.results), 'result')} as functions of {arguments}, "
        f"{method}: "
        f"{formula_set.operations} operations"
    )


def _describe_mode_table(mode_table: ModeTable) -> Names:
    """Return notes for the user on the assembly modes in exported source code.

    An assembly mode is one of the ways to assemble the mechanism. The source code solves
    the same equations in all modes that it computes. Other modes are left out. A mode that
    is left out is undetermined if these equations depend on each other in the mode. Source
    code for only this mode can use other equations.

    There are up to three kinds of notes:

    - Which modes are left out, for each reason.
    - How to get source code for an undetermined mode.
    - At which inputs the configuration curves of two modes cross. Such a curve consists of
      all configurations of a mode, over the input.
    """
    notes = []
    for reason, names in mode_table.left_out_by_reason().items():
        modes_text = numbered("mode", names)  # such as "modes 1, 3"
        notes.append(f"left out: assembly {modes_text}: {reason}")
    # These modes are among the modes that are left out above.
    undetermined_modes = mode_table.undetermined
    if undetermined_modes:
        first_number = undetermined_modes[0]
        notes.append(
            "a source for a single mode solves equations that determine it, for example "
            f"with --assembly-mode {first_number}, in Python assembly_mode={first_number}"
        )
    # `smooth` is None unless the user asked for modes that follow smooth curves through
    # crossings (option "pass").
    if mode_table.smooth is not None:
        notes.append(_describe_crossings(mode_table.smooth))
    return tuple(notes)


def _describe_crossings(smooth_modes: SmoothModes) -> str:
    """Return a sentence on the inputs at which curves of assembly modes cross.

    An assembly mode is one way to assemble the links. At a crossing, the configuration
    curves of two modes meet, and each mode continues smoothly on its own curve.
    """
    unknown = "" if smooth_modes.are_all_known else f". {OTHER_CROSSINGS}"
    if not smooth_modes.crossings:
        verb = "cross" if smooth_modes.are_all_known else "are known to cross"
        return f"no curves {verb} in the range of the input{unknown}"
    inputs = listing(dict.fromkeys(map(degrees_text, smooth_modes.crossings)))
    return f"modes follow their smooth curves through crossings at {inputs} deg{unknown}"


def _export_coupling_table(table: CouplingTable, target: Path) -> Exported:
    """Write a coupling table to a file, and return notes on its accuracy.

    A coupling table has the variables of passive pairs (joints that are not driven) and
    their rates per unit rate of each input, as functions of the inputs. A program
    interpolates between the nodes of a grid over the inputs. A cell is the box between
    neighbouring nodes. A cell is sure if interpolation in the cell is as accurate as
    required. In other cells the program gets NaN, and a note says how many of them have a
    mode at all corners.

    The ending of `target` selects an archive (.npz), a CSV file, or a C header. The caller
    has checked the ending.
    """
    if target.suffix == ".npz":
        write_npz(table, target)
    elif target.suffix == ".csv":
        write_csv(table, target)
    else:
        write_text(target, header(table))
    sure_count = np.sum(table.sure)
    # (modes, cells) errors. A cell has an error only if the assembly mode exists at all its
    # corners. Otherwise it cannot be interpolated, and its error is NaN.
    cell_count = np.sum(np.isfinite(table.error))
    notes: Names = ()
    if sure_count < cell_count:
        note = (
            f"{cell_count - sure_count} of {cell_count} cells with a mode at all corners "
            f"are not used, because their error may exceed {table.tolerance:g} rad; with "
            "more samples there are fewer of these cells"
        )
        notes = (note,)
    holds = (
        f"a coupling table of {counted(len(table.variables), 'variable')} on "
        f"{'x'.join(map(str, table.count))} nodes in assembly modes "
        f"{listing(table.modes)}; errors measured: {table.angle_error:.2g} rad of angles, "
        f"{table.coefficient_error:.2g} of coefficients"
    )
    return Exported(target, holds, notes)


def _export_functions(
    mechanism: Mechanism, target: Path, assembly_mode: int, options: Facts
) -> Exported:
    """Write a reduced model of a mechanism, as an archive or as source code.

    A reduced model stores inertia, pole axes and pair (joint) variables as functions of the
    inputs. A program can then use these functions without the mechanism.

    Parameters
    ----------
    target
        ``*.npz`` for an archive, or a file of source code.
    assembly_mode
        Number of the assembly mode (way to assemble the mechanism).
    options
        Further arguments of `export`: the poles (axes of relative rotation of two links)
        and the tolerance of the stored functions.
    """
    is_source = target.suffix != ".npz"
    has_several_inputs = len(mechanism.inputs) > 1
    if is_source and has_several_inputs:
        raise OutputError(
            f"{target}: a stored model with several inputs cannot be written as source "
            "code; export the formulas (--to c), or save the model as an archive *.npz"
        )
    # What the model leaves out or does not cover.
    notes = []
    if mechanism.outputs:
        notes.append(f"outputs left out: {listing(x.name for x in mechanism.outputs)}")
    if not mechanism.masses:
        notes.append("no inertia: the mechanism has no masses")
    # A grid model has functions of several inputs. Any other model has functions of one
    # input.
    make_model: Any = reduced_grid_model if has_several_inputs else reduced_model
    model = make_model(mechanism, assembly_mode=assembly_mode, **options)
    # The box has the range of each input along one axis. `covered` is the part of the box
    # in which the functions are known.
    if model.heading.covered < 1.0:
        notes.append(
            f"known in {model.heading.covered:.3g} of the box of the inputs' ranges; "
            "elsewhere the assembly mode does not exist or is near a singularity"
        )
    if is_source:
        kind = _export_kind(target, None)
        write_text(target, source(reduced_formulas(mechanism, model), kind))
    else:
        model.save(target)
    # What the file contains, in words. `by` has the names of the coordinates on which the
    # functions depend.
    holds = (
        f"{len(model.heading.functions)} functions of {listing(model.heading.by)}, errors "
        f"up to {model.error:.2g} of the largest value of each"
    )
    return Exported(target, holds, tuple(notes))


def _export_mujoco_model(
    mechanism: Mechanism,
    target: Path,
    assembly_mode: int,
    at: float | Sequence[float] | None,
) -> Exported:
    """Write a model for the simulator MuJoCo, in one configuration of a mechanism.

    MuJoCo starts a simulation in this configuration.

    Parameters
    ----------
    target
        The file, ``*.xml``.
    assembly_mode
        Number of the assembly mode (way to assemble the mechanism).
    at
        Inputs (rad) of the configuration. None: the first sample at which the mode exists.
    """
    # The mechanism with the inputs that the position analysis uses, and the pair variables
    # (rad) in one configuration. `angles` has the index of the variable of each R pair
    # (revolute joint).
    driven_mechanism, variables = find_pose(mechanism, assembly_mode, at)
    input_texts = []
    for pair in driven_mechanism.input_pairs:
        angle = variables[driven_mechanism.angles[pair]]
        input_texts.append(f"{pair} = {angle:.6g} rad ({np.degrees(angle):.6g} deg)")
    model = MujocoModel(driven_mechanism, variables)
    write_text(target, model.text)
    return Exported(target, f"a MuJoCo model at {listing(input_texts)}", model.notes)
