"""The tables of the analysis `singularities`, filled with one input and with several."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from spherekit.plugin import (
    ASSEMBLY_MODE,
    INPUTS,
    SAMPLE,
    STATUS,
    Batch,
    Column,
    Floats,
    Table,
)
from spherekit.plugin.motion import PositionAnalysis
from spherekit.plugin.rotations import quaternion, wrap
from spherekit.plugin.singularities import group_signs

from ..common import POSE_COLUMNS, direction_or_quaternion_columns
from .scenes import name_kind

KIND_MEANING = (
    "I: the output rests though inputs move; II: it moves though they rest; III: both; "
    "self-motion: other links move, and neither does"
)
"""Explanation of the column of kinds."""
OUTPUT = Column(
    "output", "", "link relative to link, with its name where others are these", "text"
)
SINGULARITIES = Table(
    "singularities",
    "one row per singularity and output",
    (
        Column("kind", "", KIND_MEANING, "text"),
        Column("condition", "", "geometric conditions that hold", "text"),
        Column("assembly_mode", "", "assembly modes that it belongs to", "text"),
        INPUTS,
        Column("inside", "", "whether the inputs are in their ranges", "text"),
        OUTPUT,
        *POSE_COLUMNS[:4],
        Column("signs", "", "of its groups; 0 where singular, * of one left out", "text"),
        Column("theta", "rad", "variable of the passive pair", per_passive=True),
        Column("curve", "", "number of the configuration curve", "integer"),
        Column("s", "rad", "place on it, in its own arc length"),
        Column("error", "rad", "bound of the error of the place"),
        Column("residual", "", "sine by which the condition is missed"),
        Column("reversal", "", "what reverses there: input, output, both", "text"),
        Column("double", "", "whether it is only touched", "text"),
        Column("certain", "", "whether the kind is certain", "text"),
        Column("guarantee", "", "what is known of those not listed", "text"),
        Column("note", "", "what coincides, what is in doubt", "text"),
    ),
)
RELATION = Table(
    "relation",
    "c y' = d q' and nearness, one row per sample, assembly mode, output and form",
    (
        SAMPLE,
        ASSEMBLY_MODE,
        INPUTS,
        OUTPUT,
        Column("form", "", "i or ii", "text"),
        Column("c", "", "coefficient of the output rate"),
        Column("d", "", "coefficient of the input rate"),
        Column("velocity_coefficient", "", "y'/q' = d/c, infinite at type II"),
        Column("distance_I", "rad", "angle to type I, 0 there alone"),
        Column(
            "distance_II",
            "rad",
            "angle to type II, 0 there alone; proportional to the size of short arcs",
        ),
        Column("output_rate", "", "of y by the arc length of all variables"),
        Column("input_rate", "", "of q by the arc length of all variables"),
        Column("transmission", "rad", "transmission angle of the output's dyad"),
        Column("input_margin_I", "rad", "change of the input to the nearest type I"),
        Column("input_margin_II", "rad", "change of the input to the nearest type II"),
        Column("sigma", "", "least singular value of the passive equations"),
        Column("reciprocal_condition", "", "its part of the greatest one"),
        STATUS,
        Column("moving", "", "the moving input, the others locked", "text"),
        Column("type", "", "regular, I, II, III or self-motion", "text"),
        Column("group", "", "1: of a single-freedom part, 2: of none", "integer"),
    ),
)
ASPECTS = Table(
    "aspects",
    "with several inputs: configurations over an input grid, by parts not singular",
    (
        Column("aspect", "", "number of the part, the largest first", "integer"),
        INPUTS,
        Column("sign_II", "", "sign of the determinant of type II", "integer"),
        Column("sign_I", "", "sign of the determinant of type I", "integer"),
        Column("assembly_modes", "", "assembly modes of one input in the part", "integer"),
    ),
)


def of_kind(kind: str) -> str:
    """Return a kind in words with "of", such as ``of type II`` or ``of self-motion``."""
    return f"of {name_kind(kind)}"


def angle_from_sine(sines: Floats) -> Floats:
    """Return the angles (n,) in rad of sines (n,) that may exceed 1 by rounding."""
    return np.arcsin(np.minimum(sines, 1.0))


def configuration_columns(
    batch: Batch,
    values: Floats,
    links: tuple[int, int],
    pointing: Floats | None = None,
    part: PositionAnalysis | None = None,
) -> dict[str, Any]:
    """Return the columns of configurations: variables, pose, signs of groups and modes.

    A group is a set of links that is assembled at once, such as a dyad (two links between
    two known axes). A dyad can be assembled in two ways, which its sign distinguishes: the
    sign of the triple product of its three axes.

    Parameters
    ----------
    batch
        The rows of the run, with the position analysis of the whole mechanism.
    values
        (n, variables) configurations (rad).
    links
        Numbers of the output link and of its reference link.
    pointing
        (n, 3) output directions in axes of the reference link. Without them the pose is
        the orientation of the output link in the reference link.
    part
        Position analysis of a part of the mechanism, if values and links are those of the
        part. Otherwise they are those of the whole mechanism.

    Returns
    -------
    Columns (n,) by name. If all groups are dyads, the column of assembly modes has the
    modes of the whole mechanism with the signs of the configuration. For a part, or with
    larger groups, there is no such column. The column of signs has ``*`` for each group
    that is not in the part.
    """
    whole_position_analysis = batch.tracer
    position_analysis = part or whole_position_analysis
    mechanism = position_analysis.mechanism
    solver = position_analysis.solver
    # Numbers of the variables that are angles of R pairs; others are not wrapped.
    angles = set(mechanism.angles.values())
    columns: dict[str, Any] = {}
    for variable, name in enumerate(mechanism.variable_names):
        if variable not in solver.driven:
            column = values[:, variable]
            columns[name] = wrap(column) if variable in angles else column

    link, reference_link = links
    # Orientations (n, links, 3, 3) of all links at the given values of the variables.
    rotations = position_analysis.given(values).rotations
    orientation = np.swapaxes(rotations[:, reference_link], 1, 2) @ rotations[:, link]
    pose = quaternion(orientation) if pointing is None else pointing
    # The table of singularities has no columns for the angles of mid-planes.
    columns |= direction_or_quaternion_columns(pose, architecture=None)

    signs = group_signs(solver, values)
    columns["signs"] = _format_signs(batch, position_analysis, signs)
    # `has_closed_form` states that every group is a dyad. Only then do the signs determine
    # the assembly mode.
    if solver.assembly.has_closed_form and part is None:
        columns["assembly_mode"] = _format_modes(batch, signs)
    return columns


def _format_signs(
    batch: Batch, position_analysis: PositionAnalysis, signs: NDArray[np.int8]
) -> list[str]:
    """Return the signs of the groups of the whole mechanism as text, one for each row.

    A group is a set of links that is assembled at once, such as a dyad (two links that can
    be assembled in two ways). Its sign is that of a determinant of its axes, which tells
    the two ways apart. A text has one character for each group: + or -, 0 if the group is
    singular, * if it is not in the part of the mechanism to which `signs` belong.

    Parameters
    ----------
    batch
        The rows of the run, with the position analysis of the whole mechanism.
    position_analysis
        The position analysis of the whole mechanism or of a part.
    signs
        (n, groups) signs 1 or -1 of the groups of `position_analysis`, 0 for a singular
        group.
    """
    # A part numbers its links and pairs anew. The names of the pairs that close a group are
    # the same in the part and in the whole mechanism, and identify the group.
    groups = [
        set(position_analysis.mechanism.names_of(group.pairs))
        for group in position_analysis.solver.assembly.groups
    ]
    whole_position_analysis = batch.tracer
    groups_of_whole = [
        set(batch.mechanism.names_of(group.pairs))
        for group in whole_position_analysis.assembly.groups
    ]
    text_of_sign = {0: "0", 1: "+", -1: "-"}
    texts = []
    for row in signs.tolist():
        text = ""
        for group in groups_of_whole:
            is_in_part = group in groups
            text += text_of_sign[row[groups.index(group)]] if is_in_part else "*"
        texts.append(text)
    return texts


def _format_modes(batch: Batch, signs: NDArray[np.int8]) -> list[str]:
    """Return for each row the numbers of the assembly modes with its signs, as ``0+2``.

    An assembly mode is a sign for each group of links. A singular group, with the sign 0,
    agrees with modes of both signs.

    Parameters
    ----------
    batch
        The rows of the run, with their assembly modes.
    signs
        (n, groups) 1, -1 or 0.
    """
    modes = batch.motion.assembly_modes
    mode_signs = np.reshape([mode.signs for mode in modes], (len(modes), signs.shape[1]))
    # Axes: row, mode, group.
    agrees = (signs[:, None] == mode_signs) | (signs[:, None] == 0)
    belongs = np.all(agrees, axis=2)
    numbers = np.array([str(mode.number) for mode in modes])
    return ["+".join(numbers[row]) for row in belongs]
