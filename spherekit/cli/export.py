"""`spherekit export`: a mechanism for other programs."""

from argparse import Namespace

from spherekit.cli.main import note
from spherekit.cli.study import INPUT, LOCK, with_locks

PAGE = (
    INPUT
    + LOCK
    + """
FILE
    path or shipped name
--to {c,cpp,js,python,julia,casadi,latex,model,mjcf,coupling} !
    c, cpp, js, python, julia, casadi: its formulas as source; latex: in print; model: its
    functions for use without it (.npz, or source); mjcf: a MuJoCo model; coupling: a
    table for controllers (.csv, .npz or .h)
-o, --output X
    file to write (default: NAME.c, NAME.npz and so on)
--quantities [NAME ...]
    sources, latex: what they compute, names or patterns such as theta_* (default: angles,
    coefficients of links, transmission angles, inertia and driving torque)
--vary [KEY ...]
    sources, latex: numbers of the file that are arguments, such as links.2.arc
--assembly-mode N-or-NAME
    assembly mode, by number or name (default: 0; sources and coupling: all)
--crossings {end,pass}
    sources: where curves of configurations cross, modes keep the signs of dyads (end, the
    default), or follow the smooth curve through the crossing (pass)
--poles [POLE ...]
    model, coupling: only these poles, as 3/1 (default: all; coupling, and model of
    several inputs: none)
--pairs [PAIR ...]
    coupling: only these passive pairs (default: all)
--samples N[xM...]
    coupling: nodes along each input (default: as many as --tol needs)
--tol T
    model: error of every function, relative to its largest value (default: 1e-13, of
    several inputs 1e-11); coupling: error of angles, rad (default: 1e-6)
--at Q[,Q...]
    mjcf: inputs of the pose, in the angle_unit of the file (default: the first on the
    way through their ranges)

examples:
  # the formulas of all angles and coefficients as C, a size being an argument
  spherekit export four_bar --to c --vary links.2.arc
  # functions for use without the mechanism
  spherekit export four_bar --to model -o four_bar.npz
  # a MuJoCo model, posed at 30 deg
  spherekit export four_bar --to mjcf --at 30
  # a table for a controller, in C
  spherekit export four_bar --to coupling --pairs 41 -o four_bar.h
"""
)


def execute(options: Namespace) -> int:
    """Write the file and say what it holds."""
    from spherekit.api.export import SUFFIXES, export
    from spherekit.files.angle_units import to_radians
    from spherekit.files.mechanism_reader import angle_unit_of, load

    stated = load(options.file)
    mechanism = with_locks(stated, options.lock, options.file)
    unit = angle_unit_of(options.file)
    made = export(
        options.file if mechanism is stated else mechanism,
        options.output or f"{mechanism.name}{SUFFIXES[options.to][0]}",
        to=options.to,
        input_pair=options.input,
        assembly_mode=options.assembly_mode,
        poles=options.poles,
        pairs=options.pairs,
        samples=options.samples,
        tolerance=options.tol,
        quantities=options.quantities,
        vary=options.vary,
        crossings=options.crossings,
        at=options.at and tuple(to_radians(angle, unit) for angle in options.at),
    )
    note(options, *(f"{made.path}: {text}" for text in (made.holds, *made.notes)))
    return 0
