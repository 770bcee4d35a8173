"""The formulas of a mechanism of dyads as a LaTeX document, as printed in a paper."""

import fnmatch
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import groupby, product
from typing import Any

import numpy as np

from spherekit.arrays import Floats
from spherekit.designs.design_variables import design_variable
from spherekit.errors import EngineError
from spherekit.escaping import latex_text
from spherekit.exchange.latex_formulas import Formulas
from spherekit.exchange.latex_text import text_of
from spherekit.files.number_change import document_of
from spherekit.mechanism.changed_axes import restated
from spherekit.mechanism.elements import LinkSizes, PoseGeometry
from spherekit.mechanism.locking import sizes_by_frames
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.pair_frames import link_axes, pair_frames, reference_frame
from spherekit.planning.plan_text import as_text
from spherekit.positions.motion_cache import assembly_by_count_or_rank
from spherekit.symbolic.expression_graph import Expr
from spherekit.wording import listing, nearest

HEAD = r"""\documentclass[a4paper]{article}
\usepackage{amsmath}
\allowdisplaybreaks
\begin{document}
"""
NOTATION = r"""
The axes of link $j$ are $\mathbf{i}_j$, $\mathbf{j}_j$ and $\mathbf{k}_j$: $\mathbf{k}_j$
is its first axis, and $\mathbf{j}_j$ leads from there toward the second. At the axis
$\mathbf{u}_{ik}$ of a pair $\mathbf{t}^j_{ik}$ is the tangent to the arc of link $j$, and
$\mathbf{z}_{ik}$ is where that of the pair's second link is at the angle 0.
"""
SAID = {
    "Positions": r"""The links of a dyad follow from three axes: the middle one is at given
arcs from two that are known, on the side that the sign $s_k$ says.""",
    "Velocity coefficients": r"""Per unit rate of the input link $j$ turns by
$\mathbf{w}_j = m_{jf} \, \mathbf{u}_{jf}$ against the ground $f$. The poles of three links
lie on one great circle (Aronhold and Kennedy); where two of them meet a ratio is 0/0, with
a finite limit.""",
    "Acceleration coefficients": r"""Axes of pairs turn with their links; poles and
coefficients change with them.""",
    "Coefficients between moving links": "They are seen along the poles.",
    "Equation of motion": r"""$\mathbf{x}_j$ is $\mathbf{w}_j$ along the axes of link $j$;
as these turn with the link, its derivative is that of the vector along them.""",
}
POLES = r"""Each pole is where two great circles meet, case (a): $\mathbf{n}_{ij|k}$ is at
right angles to the plane of $\mathbf{u}_{ik}$ and $\mathbf{u}_{jk}$."""


LONGEST = 230
"""Characters in a row of LaTeX, about a line of a page."""


def latex(
    mechanism: Mechanism, quantities: Sequence[str] | None = None, vary: Sequence[str] = ()
) -> str:
    """Return the formulas of a mechanism of R pairs and dyads as a LaTeX document.

    Sizes, inertia tensors and the signs of the assembly mode are symbols, with their values
    in tables; arcs and angles of 0, 90 and 180 degrees are put in.

    Parameters
    ----------
    mechanism
        The mechanism, its inputs joined to the ground.
    quantities
        What is wanted, by the names of
        `spherekit.velocities.row_quantities.row_quantities`; vectors also without their
        components. By default the angles of pairs, poles, coefficients of links against the
        ground and, where there are masses, torques.
    vary
        Keys of sizes and masses in the mechanism's file, ``links.2.arc``, that stay symbols
        whatever their values.

    Raises
    ------
    EngineError
        If positions or poles have no closed form, a quantity is not written as LaTeX, a key
        is that of a load, or no quantity depends on its number.
    FileError, DesignError
        If there is no number of a key.
    """
    for group in assembly_by_count_or_rank(mechanism).groups:
        if not group.is_dyad:
            links = (mechanism.links[x] for body in group.bodies[1:] for x in body)
            raise EngineError(
                f"{mechanism.name}: the {group.kind} of links {listing(links)} has no "
                "closed form, so no formula of it can be printed; choose an input from "
                "which all links follow by dyads, or export to a language that solves it"
            )
    free = _free(mechanism, vary)
    made, ground = _by_sizes(mechanism)
    formulas = Formulas(made, ground, free)
    text = "\n".join(_document(formulas, _wanted(formulas, quantities)))
    idle = [
        x for slot, x in free.items() if formulas.free_terms.get(slot) not in formulas.given
    ]
    if idle:
        raise EngineError(
            f"{mechanism.name}: {listing(idle)}: no quantity that is printed depends on "
            "this number; leave it out, or ask for quantities that depend on it"
        )
    return text


def _wanted(formulas: Formulas, names: Sequence[str] | None) -> list[Expr]:
    """Return the terms of quantities, by names or patterns."""
    table, mechanism = formulas.quantities, formulas.mechanism
    if names is None:
        names = [name for name in table if name.startswith(("theta_", "pole_", "torque"))]
        names += [
            f"{kind}_coefficient_{link}_{mechanism.ground}{end}"
            for end, link, kind in product(
                formulas.ends, mechanism.links[1:], ("velocity", "acceleration")
            )
        ]
    wanted: list[Expr] = []
    for name in names:
        matching = fnmatch.filter(table, name) or fnmatch.filter(
            table, name.rpartition("_")[0]
        )
        if not matching:
            raise EngineError(
                f'{mechanism.name}: "{name}" is not written as LaTeX'
                f"{nearest(name, table) or ';'} there are {listing(table)}"
            )
        wanted += (term for one in matching for term in table[one])
    return wanted


def _document(formulas: Formulas, wanted: Sequence[Expr]) -> Iterator[str]:
    lines = formulas.needed(wanted)
    mechanism, index = formulas.mechanism, formulas.index
    yield HEAD + rf"\section*{{The spherical mechanism {latex_text(mechanism.name)}}}"
    links = (
        name if name == link else f"{name} is {latex_text(link)}"
        for name, link in zip(index, mechanism.links, strict=True)
    )
    yield f"Links: {listing(links)}; the first is the ground. Pairs, axes and angles:"
    pairs = zip(mechanism.pairs, formulas.pair_axes, formulas.angles, strict=True)
    yield _table(
        (latex_text(x.name), _dollars(axis), _dollars(angle)) for x, axis, angle in pairs
    )
    yield NOTATION
    said = formulas.given.items()
    yield _table((_dollars(x), meaning, value) for x, (meaning, value) in said)
    for pair, plan in zip(mechanism.names_of(formulas.inputs), formulas.plans, strict=True):
        moving = latex_text(pair)
        yield f"Poles while {moving} moves: x those of pairs, I, II, ... by passes."
        table = as_text(plan).replace("■", "-")
        yield f"\\begin{{verbatim}}\n{table}\n\\end{{verbatim}}"
    for section, of in groupby(lines.items(), lambda item: item[1].section):
        yield f"\\section*{{{section}}}\n{SAID.get(section, POLES)}"
        rows = (f"{text_of(left)} &= {_right(formula.rows)}" for left, formula in of)
        yield "\\begin{align}\n" + " \\\\\n".join(rows) + "\n\\end{align}"
    if formulas.left_out:
        friction = latex_text(listing(formulas.left_out))
        yield f"Friction of {friction} follows from reactions and is left out."
    yield "\\end{document}\n"


def _dollars(term: Expr) -> str:
    return f"${text_of(term)}$"


def _right(rows: Sequence[Expr]) -> str:
    if len(rows) == 1:
        return _broken(text_of(rows[0]))
    column = r" \\ ".join(map(text_of, rows))
    return rf"\begin{{pmatrix}} {column} \end{{pmatrix}}"


def _broken(text: str) -> str:
    """Return a sum as rows of ``align`` that are not too long."""
    rows, before = [""], ""
    for part in re.split(r"(?= [+-] )", text):
        inside = before.count("{") - before.count("}") + before.count(r"\left")
        if inside == before.count(r"\right") and len(rows[-1] + part) > LONGEST:
            rows.append("")
        rows[-1] += part
        before += part
    return " \\nonumber \\\\\n&\\quad {}".join(rows)


def _table(rows: Iterable[Sequence[str]]) -> str:
    body = " \\\\\n".join(map(" & ".join, rows))
    table = f"\\begin{{tabular}}{{lll}}\n{body}\n\\end{{tabular}}"
    return f"\\begin{{center}}\n{table}\n\\end{{center}}"


def _free(mechanism: Mechanism, keys: Sequence[str]) -> dict[Any, str]:
    """Return the keys of the sizes, and of the links whose masses they name."""
    document, free = document_of(mechanism), dict[Any, str]()
    for key in keys:
        variable = design_variable(document, key)
        table, name, *_ = variable.path
        weighed = table == "mass" and not mechanism.loads
        slot = ("mass", name) if weighed else variable.slot
        if slot is None or slot[0] not in ("mass", "arcs", "angles", "zeros"):
            raise EngineError(
                f"{mechanism.name}: {key} is a number in LaTeX, not a symbol; vary arcs, "
                "angles, zeros, or masses where there are no loads, or export to another "
                "language"
            )
        free[slot] = key
    return free


def _by_sizes(mechanism: Mechanism) -> tuple[Mechanism, Floats]:
    """Return a mechanism by arcs and angles, and (3, 3) the axes of its ground as given."""
    if not isinstance(mechanism.geometry, PoseGeometry):
        return mechanism, np.eye(3)
    sizes, turns = {}, {}
    for link, axes in link_axes(mechanism).items():
        x, y, z = reference_frame(axes, next(iter(axes))).T
        turns[link] = turn = np.stack([-y, x, z])
        x, y, z = turn @ np.transpose([*axes.values()])
        arcs, angles = np.arctan2(np.hypot(x, y), z), np.arctan2(-x, y)
        sizes[link] = LinkSizes(tuple(axes), (*arcs[1:].tolist(),), (*angles[2:].tolist(),))
    ground, pairs = turns[mechanism.ground], mechanism.pairs
    first, second = (
        {pair.name: turns[pair.links[end]] @ frames[pair.name] for pair in pairs}
        for end, frames in enumerate(pair_frames(mechanism))
    )
    geometry = sizes_by_frames(pairs, (first, second), sizes)
    parts = restated(mechanism, turns=turns, ground=ground)
    return replace(mechanism, geometry=geometry, **parts), ground.T
