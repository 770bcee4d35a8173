"""The formulas of a mechanism of dyads as a LaTeX document, like those in a paper."""

import fnmatch
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import groupby, product
from typing import Any

import numpy as np

from spherekit.arrays import Floats
from spherekit.designs.design_variables import design_variable
from spherekit.errors import EngineError
from spherekit.escaping import latex_text
from spherekit.exchange.latex_formulas import LatexFormulas
from spherekit.exchange.latex_text import latex_of
from spherekit.files.number_change import document_of
from spherekit.mechanism.changed_axes import redescribe
from spherekit.mechanism.elements import LinkSizes, PoseGeometry
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.pair_frames import link_axes, pair_frames, reference_frame
from spherekit.mechanism.sizes_from_frames import sizes_from_frames
from spherekit.planning.plan_text import as_text
from spherekit.planning.pole_plan import SELF_MARK
from spherekit.positions.motion_cache import assembly_by_count_or_rank
from spherekit.symbolic.expression_graph import Expr
from spherekit.wording import listing, nearest

DOCUMENT_HEAD = r"""\documentclass[a4paper]{article}
\usepackage{amsmath}
\allowdisplaybreaks
\begin{document}
"""
NOTATION = r"""
The axes of link $j$ are $\mathbf{i}_j$, $\mathbf{j}_j$ and $\mathbf{k}_j$: $\mathbf{k}_j$
is its first axis, and $\mathbf{j}_j$ leads from there toward the second. At the axis
$\mathbf{u}_{ik}$ of a pair $\mathbf{t}^j_{ik}$ is the tangent to the arc of link $j$, and
$\mathbf{z}_{ik}$ is where that of the pair's second link is at the angle 0. The formulas
give the angles of passive pairs from $-\pi$ to $\pi$, without whole revolutions.
"""
SECTION_INTRODUCTIONS = {
    "Positions": r"""The links of a dyad follow from three axes. Two of them are known. The
middle one is at given arcs from these, on the side that the sign $s_k$ states.""",
    "Velocity coefficients": r"""While the input turns at unit rate, link $j$ turns at the
angular velocity $\mathbf{w}_j = m_{jf} \, \mathbf{u}_{jf}$ relative to the ground $f$. The
poles of three links lie on one great circle (Aronhold and Kennedy); if two of them
coincide, a ratio is 0/0 and has a finite limit.""",
    "Acceleration coefficients": r"""Axes of pairs turn with their links; poles and
coefficients change with them.""",
    "Coefficients between moving links": "They are seen along the poles.",
    "Equation of motion": r"""$\mathbf{x}_j$ is $\mathbf{w}_j$ along the axes of link $j$;
as these turn with the link, its derivative is that of the vector along them.""",
}
POLE_INTRODUCTION = (
    r"Each pole is where two great circles intersect, case (a): $\mathbf{n}_{ij|k}$ is at"
    "\n"
    r"right angles to the plane of $\mathbf{u}_{ik}$ and $\mathbf{u}_{jk}$."
)


ROW_BREAK = " \\nonumber \\\\\n&\\quad {}"
"""LaTeX between two rows of a long sum: the second row has no number and is indented.

Braces with nothing in them are an empty term, so that LaTeX sets the plus or minus sign
behind it as an operation between two terms.
"""

MAX_ROW_CHARACTERS = 230
"""Number of characters of LaTeX after which a sum continues in a new row.

Larger: rows may be wider than a page; smaller: formulas take more rows.
"""


def latex(
    mechanism: Mechanism, quantities: Sequence[str] | None = None, vary: Sequence[str] = ()
) -> str:
    """Return the formulas of a mechanism of R pairs and dyads as a LaTeX document.

    R pairs are revolute joints. A dyad is two links that three pairs join to each other and
    to links with known positions. Sizes, inertia tensors and the signs of the assembly mode
    are symbols, with their values in tables. Arcs and angles of 0, 90 and 180 degrees are
    inserted as numbers.

    Parameters
    ----------
    mechanism
        The mechanism. Each input has to join a link to the ground, or to a link that other
        inputs join to the ground.
    quantities
        The quantities to print, by the names or patterns of
        `spherekit.velocities.row_quantities.row_quantities`; vectors also without their
        components. By default the angles of pairs, poles, coefficients of links relative to
        the ground and, if there are masses, torques.
    vary
        Keys of sizes and masses in the file of the mechanism, such as ``links.2.arc``, that
        stay symbols whatever their values.

    Raises
    ------
    EngineError
        If positions or poles have no closed form, the formulas cannot place a link, a
        quantity is not written as LaTeX, a key belongs to a number that is never a symbol
        (such as those of loads), or no quantity depends on the number of a key.
    FileError, DesignError
        If the file has no number of a key.
    """
    # The groups are sets of links that close their loops together. Only groups of two links
    # (dyads) have formulas in closed form.
    for group in assembly_by_count_or_rank(mechanism).groups:
        if not group.is_dyad:
            links = [mechanism.links[link] for body in group.bodies[1:] for link in body]
            raise EngineError(
                f"{mechanism.name}: the {group.kind} of links {listing(links)} has no "
                "closed form, so no formula of it can be printed; choose an input from "
                "which all links follow by dyads, or export to a language that solves it"
            )
    key_by_size = _find_free_sizes(mechanism, vary)
    # Formulas contain arcs and angles of links. If the file gives the axes of the pairs in
    # a reference pose instead, links are described by arcs and angles first. Each link then
    # has new axes; `ground_axes` are the axes of the ground.
    sized_mechanism, ground_axes = _convert_to_sizes(mechanism)
    latex_formulas = LatexFormulas(sized_mechanism, ground_axes, key_by_size)
    expressions = _select_expressions(latex_formulas, quantities)
    text = "\n".join(_document_lines(latex_formulas, expressions))

    # `symbol_meanings` has only symbols that printed formulas use. Find the numbers of
    # `vary` that have no such symbol.
    used_symbols = latex_formulas.formula_list.symbol_meanings
    unused_keys = []
    for size, key in key_by_size.items():
        symbol = latex_formulas.free_symbols.get(size)
        if symbol not in used_symbols:
            unused_keys.append(key)
    if unused_keys:
        raise EngineError(
            f"{mechanism.name}: {listing(unused_keys)}: no quantity that is printed "
            "depends on this number; leave it out, or ask for quantities that depend on it"
        )
    return text


def _select_expressions(
    latex_formulas: LatexFormulas, names: Sequence[str] | None
) -> list[Expr]:
    """Return the expressions of the quantities that are to be printed.

    Parameters
    ----------
    latex_formulas
        The formulas of the mechanism.
    names
        Names of quantities, or patterns such as ``theta_*``. The name of a component, such
        as ``axis_21_x``, stands for the whole vector. By default the angles of
        pairs (``theta_``), poles (axes of relative rotation of two links), torques, and
        the velocity and acceleration coefficients of links relative to the ground.

    Raises
    ------
    EngineError
        If a name matches no quantity.
    """
    quantities = latex_formulas.formula_list.quantities
    mechanism = latex_formulas.mechanism
    if names is None:
        usual_prefixes = ("theta_", "pole_", "torque")
        names = [name for name in quantities if name.startswith(usual_prefixes)]
        # With several inputs, the suffix names the input that moves while the others are
        # locked.
        names += [
            f"{kind}_coefficient_{link}_{mechanism.ground}{suffix}"
            for suffix, link, kind in product(
                latex_formulas.input_suffixes,
                mechanism.links[1:],  # all links but the ground
                ("velocity", "acceleration"),
            )
        ]
    # The quantities by their names and by the names of their components.
    quantities_by_name: dict[str, list[str]] = {}
    for quantity in quantities:
        components = _name_components(quantity, latex_formulas.input_suffixes)
        for quantity_name in (quantity, *components):
            quantities_by_name.setdefault(quantity_name, []).append(quantity)
    expressions: list[Expr] = []
    for name in names:
        matching_names = dict.fromkeys(
            quantity
            for quantity_name in fnmatch.filter(quantities_by_name, name)
            for quantity in quantities_by_name[quantity_name]
        )
        if not matching_names:
            # Text such as '; did you mean "theta_21"?', empty if no name is similar.
            suggestion = nearest(name, quantities)
            separator = suggestion if suggestion else "."
            raise EngineError(
                f'{mechanism.name}: "{name}" cannot be exported as LaTeX'
                f"{separator} Available: {listing(quantities)}"
            )
        for matching_name in matching_names:
            expressions += quantities[matching_name]
    return expressions


def _name_components(quantity: str, input_suffixes: Sequence[str]) -> list[str]:
    """Return the names of the components of a quantity; none if it is a number.

    The names are those of `spherekit.velocities.row_quantities.row_quantities`, such as
    ``pole_3_1_x_by_21`` for the vector ``pole_3_1_by_21``.

    Parameters
    ----------
    quantity
        Name of the quantity.
    input_suffixes
        For each input the end of the names of its poles and velocities, such as
        ``_by_21``; only an empty text if there is a single input.
    """
    if quantity.startswith("orientation_"):
        return [f"{quantity}_{row}{column}" for row, column in product("xyz", repeat=2)]
    if quantity.startswith("axis_"):
        return [f"{quantity}_{axis}" for axis in "xyz"]
    if quantity.startswith(("pole_", "angular_velocity_")):
        # A name can end with several of the suffixes. For the pairs "a" and "b_by_a", the
        # suffix "_by_b_by_a" ends with "_by_a". The longest one is taken.
        suffix = max(filter(quantity.endswith, input_suffixes), key=len)
        return [f"{quantity.removesuffix(suffix)}_{axis}{suffix}" for axis in "xyz"]
    return []


def _document_lines(
    latex_formulas: LatexFormulas, expressions: Sequence[Expr]
) -> Iterator[str]:
    """Yield the parts of the LaTeX document, each of one or more lines.

    Parameters
    ----------
    expressions
        Expressions of the quantities to print. Only formulas that they need are printed.
    """
    formula_list = latex_formulas.formula_list
    formulas = formula_list.select_required(expressions)
    mechanism = latex_formulas.mechanism

    # The heading, the links and the pairs with their symbols.
    yield DOCUMENT_HEAD + (
        rf"\section*{{The spherical mechanism {latex_text(mechanism.name)}}}"
    )
    link_texts: list[str] = []
    for label, link in zip(formula_list.link_labels, mechanism.links, strict=True):
        link_texts.append(label if label == link else f"{label} is {latex_text(link)}")
    links = ", ".join(link_texts)
    yield f"Links: {links}; the first is the ground. Pairs, axes and angles:"
    positions = latex_formulas.positions
    pair_rows = [
        (latex_text(pair.name), _math(axis), _math(angle))
        for pair, axis, angle in zip(
            mechanism.pairs, positions.pair_axes, positions.pair_angles, strict=True
        )
    ]
    yield _format_table(pair_rows)

    # Notation: symbols with their meanings and values, then the plan of the poles.
    yield NOTATION
    symbol_rows = [
        (_math(term), meaning, value)
        for term, (meaning, value) in formula_list.symbol_meanings.items()
    ]
    yield _format_table(symbol_rows)
    for pair_name, pole_plan in zip(
        mechanism.names_of(latex_formulas.inputs), latex_formulas.pole_plans, strict=True
    ):
        yield (
            f"Poles while {latex_text(pair_name)} moves: x those of pairs, I, II, ... by "
            "passes."
        )
        # The document has ASCII characters only.
        pole_table = as_text(pole_plan).replace(SELF_MARK, "-")
        yield f"\\begin{{verbatim}}\n{pole_table}\n\\end{{verbatim}}"

    # The formulas. An item is a symbol with its formula; successive items of one section
    # share a heading.
    for section, items in groupby(formulas.items(), lambda item: item[1].section):
        introduction = SECTION_INTRODUCTIONS.get(section, POLE_INTRODUCTION)
        yield f"\\section*{{{section}}}\n{introduction}"
        rows = [
            f"{latex_of(term)} &= {_format_right_side(formula.rows)}"
            for term, formula in items
        ]
        yield "\\begin{align}\n" + " \\\\\n".join(rows) + "\n\\end{align}"
    if latex_formulas.omitted_loads:
        friction = latex_text(", ".join(latex_formulas.omitted_loads))
        yield f"Friction of {friction} depends on reactions and is left out."
    yield "\\end{document}\n"


def _math(expression: Expr) -> str:
    """Return an expression as LaTeX within a text."""
    return f"${latex_of(expression)}$"


def _format_right_side(rows: Sequence[Expr]) -> str:
    """Return one expression, or the components of a vector as a column."""
    if len(rows) == 1:
        return _break_sum(latex_of(rows[0]))
    column = r" \\ ".join(map(latex_of, rows))
    return rf"\begin{{pmatrix}} {column} \end{{pmatrix}}"


def _break_sum(text: str) -> str:
    """Break a long sum in LaTeX into rows of the environment ``align``.

    A row can end only before a plus or minus sign outside all brackets and braces. A row
    ends at such a sign if the next summand would make the row longer than
    `MAX_ROW_CHARACTERS`.
    """
    summands = [""]
    open_count = 0  # braces and brackets that are open behind the last piece
    for piece in re.split(r"(?= [+-] )", text):
        if open_count == 0:
            summands.append("")
        summands[-1] += piece
        open_count += piece.count("{") - piece.count("}")
        open_count += piece.count(r"\left") - piece.count(r"\right")
    rows = [""]
    for summand in summands:
        if rows[-1] and len(rows[-1] + summand) > MAX_ROW_CHARACTERS:
            rows.append("")
        rows[-1] += summand
    return ROW_BREAK.join(rows)


def _format_table(rows: Iterable[Sequence[str]]) -> str:
    """Return a centred table of three columns."""
    body = " \\\\\n".join(map(" & ".join, rows))
    table = f"\\begin{{tabular}}{{lll}}\n{body}\n\\end{{tabular}}"
    return f"\\begin{{center}}\n{table}\n\\end{{center}}"


def _find_free_sizes(mechanism: Mechanism, keys: Sequence[str]) -> dict[Any, str]:
    """Find the numbers of a mechanism file that remain symbols in the printed formulas.

    Arcs and angles of 0, 90 and 180 degrees are otherwise printed as numbers. Only arcs,
    angles, zeros (see below) and, without loads, masses can remain symbols.

    Parameters
    ----------
    mechanism
        The mechanism.
    keys
        Keys of these numbers in the mechanism file, such as ``links.2.arc`` or
        ``mass.3.mass``.

    Returns
    -------
    The key of each number, by its kind and owner: ("arcs", (link, pair)), ("angles", (link,
    pair)), ("zeros", pair) or ("mass", link). A zero is the angle at which the variable of
    a pair (joint) is 0.
    """
    document = document_of(mechanism)
    key_by_size: dict[Any, str] = {}
    for key in keys:
        variable = design_variable(document, key)
        table, name, *_ = variable.path
        # The kind and owner of an angle of a link, pair or output. None for other numbers.
        size: tuple[str, Any] | None = variable.geometric_angle
        # Masses can't be symbols if there are loads: gravity depends on the mass alone, but
        # only the inertia tensor has a symbol.
        if table == "mass" and not mechanism.loads:
            # Mass, centre and tensor of a link belong to the symbol of its inertia tensor.
            size = ("mass", name)
        if size is None or size[0] not in ("mass", "arcs", "angles", "zeros"):
            raise EngineError(
                f"{mechanism.name}: {key} is a number in LaTeX, not a symbol; vary "
                "arcs, angles, zeros, or (without loads) masses, or export to another "
                "language"
            )
        key_by_size[size] = key
    return key_by_size


def _convert_to_sizes(mechanism: Mechanism) -> tuple[Mechanism, Floats]:
    """Return a mechanism described by the sizes of its links, and the axes of its ground.

    A mechanism file states either sizes (arcs and angles of each link) or the axes of the
    pairs (joints) in one reference pose. Printed formulas need sizes.

    Returns
    -------
    mechanism
        The mechanism itself if its file states sizes. Otherwise each link has new axes: the
        first pair axis of the link is z, and the second is in the half-plane x = 0, y > 0.
    ground_axes
        (3, 3) matrix with the axes i, j, k of the ground in its columns, in the axes of the
        file. The identity if the file states sizes.
    """
    if not isinstance(mechanism.geometry, PoseGeometry):
        return mechanism, np.eye(3)
    axes_by_link = link_axes(mechanism)
    # Each rotation leads from the old axes of a link to its new ones.
    rotation_by_link = {link: _find_new_frame(axes) for link, axes in axes_by_link.items()}
    sizes_by_link = {
        link: _measure_link_sizes(axes, rotation_by_link[link])
        for link, axes in axes_by_link.items()
    }
    # Each pair has one frame in its first link and one in its second link. z is the axis of
    # the pair. The variable of the pair is zero if the x axes of both frames coincide.
    old_frames_in_first, old_frames_in_second = pair_frames(mechanism)
    frames_in_first: dict[str, Floats] = {}
    frames_in_second: dict[str, Floats] = {}
    for pair in mechanism.pairs:
        name = pair.name
        first_link, second_link = pair.links
        frames_in_first[name] = rotation_by_link[first_link] @ old_frames_in_first[name]
        frames_in_second[name] = rotation_by_link[second_link] @ old_frames_in_second[name]
    geometry = sizes_from_frames(
        mechanism.pairs, (frames_in_first, frames_in_second), sizes_by_link
    )
    # Vectors and tensors of outputs, masses and loads are rotated to the new axes, too.
    ground_rotation = rotation_by_link[mechanism.ground]
    redescribed_parts = redescribe(
        mechanism, rotations=rotation_by_link, ground_rotation=ground_rotation
    )
    sized_mechanism = replace(mechanism, geometry=geometry, **redescribed_parts)
    # The rows of the rotation are the new axes of the ground in the axes of the file.
    return sized_mechanism, ground_rotation.T


def _find_new_frame(axes: Mapping[str, Floats]) -> Floats:
    """Return the frame of a link with its first pair axis (joint axis) as z axis.

    The second pair axis is in the half-plane x = 0, y > 0. The caller measures the sizes of
    the link in this frame, since the mechanism file has only axes in a pose.

    Parameters
    ----------
    axes
        (3,) unit vector of each pair axis of the link, in the order of the file.

    Returns
    -------
    (3, 3) matrix with the x, y and z axes of the frame in its rows. The matrix rotates
    vectors to this frame.
    """
    first_name = next(iter(axes))
    # Unit vectors: towards the second pair axis, at right angles to it, and along the first
    # pair axis. The three vectors form a right-handed frame.
    toward, across, first = reference_frame(axes, first_name).T
    return np.stack([-across, toward, first])


def _measure_link_sizes(axes: Mapping[str, Floats], rotation: Floats) -> LinkSizes:
    """Return the sizes of a link: arcs and angles between its pair axes (joint axes).

    Parameters
    ----------
    axes
        (3,) unit vector of each pair axis of the link, in the order of the file.
    rotation
        (3, 3) rotation to the frame with the first pair axis as z, and the second in the
        half-plane x = 0, y > 0.
    """
    # Polar coordinates of each axis: the arc from the first axis, z, and the angle about z.
    # The angle is counted from y, the side of the second axis, towards -x.
    x, y, z = rotation @ np.transpose([*axes.values()])
    arcs = np.arctan2(np.hypot(x, y), z)
    angles = np.arctan2(-x, y)
    # The first axis has neither arc nor angle, and the second has no angle.
    return LinkSizes(tuple(axes), tuple(arcs[1:].tolist()), tuple(angles[2:].tolist()))
