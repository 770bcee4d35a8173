"""`spherekit page`: a mechanism as one HTML file that any browser opens and moves."""

from argparse import Namespace
from pathlib import Path

from spherekit.cli.main import note
from spherekit.cli.study import INPUT, LOCK, with_locks

PAGE = (
    INPUT
    + LOCK
    + """
FILE
    path or shipped name
-o, --output X
    file to write (default: NAME.html)
--vary [KEY ...]
    numbers of the file that have sliders, such as links.2.arc (default: all arcs and
    angles of links, or the axes of a reference pose)
--quantities [NAME ...]
    what has curves, names or patterns such as theta_* (default: velocity coefficients of
    outputs, transmission angles and, with masses, driving torques)
--crossings {end,pass}
    where curves of configurations cross, modes keep the signs of dyads (end, the default),
    or follow the smooth curve through the crossing (pass)

examples:
  # a page to send to a colleague, who opens it with a double click
  spherekit page four_bar -o four_bar.html
  # other curves, and one slider
  spherekit page stephenson --quantities "theta_*" --vary links.2.arc
"""
)


def execute(options: Namespace) -> int:
    """Write the page and say what it holds."""
    from spherekit.api.page import page
    from spherekit.files.mechanism_reader import load

    file, locks = options.file, options.lock
    made = page(
        with_locks(load(file), locks, file) if locks else file,
        options.output or f"{Path(file).stem}.html",
        vary=options.vary,
        quantities=options.quantities,
        input_pair=options.input,
        crossings=options.crossings or "end",
    )
    note(options, *(f"{made.path}: {text}" for text in (made.holds, *made.notes)))
    return 0
