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
    "I: the output is at rest while inputs move; II: the output moves while the inputs are "
    "at rest; III: both; self-motion: other links move while inputs and output are at rest"
)
"""Explanation of the column of kinds."""
OUTPUT = Column(
    "output",
    "",
    "link and reference link of the output, such as 4/1; also the name of the output "
    "if several outputs have these links",
    "text",
)
SINGULARITIES = Table(
    "singularities",
    "one row per singularity and output",
    (
        Column("kind", "", KIND_MEANING, "text"),
        Column(
            "condition",
            "",
            "geometric conditions that the singularity satisfies, such as three axes "
            "in one plane; ? marks uncertain conditions",
            "text",
        ),
        Column(
            "assembly_mode",
            "",
            "numbers of the assembly modes in which the singularity occurs",
            "text",
        ),
        INPUTS,
        Column(
            "inside", "", "yes if the inputs are within their ranges, otherwise no", "text"
        ),
        OUTPUT,
        *POSE_COLUMNS[:4],
        Column(
            "signs",
            "",
            "one sign for each group of links that are assembled together, such as a dyad: "
            "+ or -, the sign of a determinant; it differs between the two ways to "
            "assemble a dyad; 0: the determinant is zero (the group is singular here); *: "
            "the group does not affect the output",
            "text",
        ),
        Column(
            "theta",
            "rad",
            "variable of a passive pair (not driven): angle, or arc length at a contact",
            per_passive=True,
        ),
        Column(
            "curve",
            "",
            "number of the configuration curve on which the singularity lies; with several "
            "inputs, of the singular curve or surface",
            "integer",
        ),
        Column(
            "s",
            "rad",
            "position of the singularity on its curve, "
            "as an arc length in the space of all pair variables",
        ),
        Column("error", "rad", "upper bound of the error of the arc length s"),
        Column(
            "residual",
            "",
            "sine of the angle by which the configuration deviates from the geometric "
            "condition",
        ),
        Column(
            "reversal",
            "",
            "motion that reverses at the singularity: input, output or both; empty if "
            "neither reverses",
            "text",
        ),
        Column(
            "double",
            "",
            "yes if the velocity that is zero here has the same sign on both sides of the "
            "singularity, otherwise no",
            "text",
        ),
        Column(
            "certain",
            "",
            "yes if the kind of the singularity is certain despite rounding errors, "
            "otherwise no",
            "text",
        ),
        Column(
            "guarantee",
            "",
            "whether singularities may be missing from the table: complete (none, but "
            "this is not proven), complete to a box size (only those that fit into a small "
            "box of angles, whose size is in the summary), component only (those that are "
            "not connected with known configurations) or sampled (those to which no sample "
            "and no random start led)",
            "text",
        ),
        Column(
            "note",
            "",
            "remarks, such as which curves cross here, the geometric conditions in words, "
            "or why the kind of the singularity is uncertain",
            "text",
        ),
    ),
)
RELATION = Table(
    "relation",
    "relation c y' = d q' of the rates y' of the output and q' of the input, and nearness "
    "of singularities: one row per sample, assembly mode, output and form; with several "
    "inputs also per moving input",
    (
        SAMPLE,
        ASSEMBLY_MODE,
        INPUTS,
        OUTPUT,
        Column(
            "form",
            "",
            "i or ii: form of the relation c y' = d q'. In form i, y' is the rate of the "
            "output link relative to the reference link of the output; in form ii, "
            "relative to the reference link of the input",
            "text",
        ),
        Column(
            "c",
            "",
            "coefficient of the rate y' of the output in c y' = d q', where q' is the rate "
            "of the input; 0 at a type II singularity",
        ),
        Column(
            "d",
            "",
            "coefficient of the rate q' of the input in c y' = d q', where y' is the rate "
            "of the output; 0 at a type I singularity",
        ),
        Column(
            "velocity_coefficient",
            "",
            "rate of the output per unit rate of the input. In form i it is d/c; the row "
            "of form ii repeats this value. At a type II singularity it is infinite with "
            "one input, and empty with several inputs",
        ),
        Column(
            "distance_I",
            "rad",
            "distance from type I singularities: an angle that is 0 only at these "
            "singularities; with one input, its tangent is the size of y'/q'",
        ),
        Column(
            "distance_II",
            "rad",
            "distance from type II singularities: an angle that is 0 only at these "
            "singularities. Its sine is a transmission measure (how well the locked inputs "
            "hold the output). In mechanisms with short arcs the angle is small "
            "everywhere, because it is then proportional to the arcs",
        ),
        Column(
            "output_rate",
            "",
            "derivative of the output with respect to the arc length of the "
            "configuration curve in the space of all pair variables",
        ),
        Column(
            "input_rate",
            "",
            "derivative of the input with respect to the arc length of the "
            "configuration curve in the space of all pair variables",
        ),
        Column(
            "transmission",
            "rad",
            "transmission angle of the dyad (two links joined by a pair) that "
            "determines the motion of the output; empty if there is no such dyad",
        ),
        Column(
            "input_margin_I",
            "rad",
            "absolute difference between the input in this row and at the nearest type I "
            "singularity of the same configuration curve; empty if there is none, and with "
            "several inputs",
        ),
        Column(
            "input_margin_II",
            "rad",
            "absolute difference between the input in this row and at the nearest type II "
            "singularity of the same configuration curve; empty if there is none, and with "
            "several inputs",
        ),
        Column(
            "sigma",
            "",
            "smallest singular value of the matrix of the loop equations with all inputs "
            "locked; 0 if a link can still move",
        ),
        Column(
            "reciprocal_condition",
            "",
            "ratio of the smallest to the largest singular value of the matrix of the loop "
            "equations with all inputs locked",
        ),
        STATUS,
        Column(
            "moving", "", "driven pair that moves while the other inputs are locked", "text"
        ),
        Column(
            "type",
            "",
            "type of the singularity in this row (I, II, III, self-motion), or regular",
            "text",
        ),
        Column(
            "group",
            "",
            "in a row of type I, II or III: 1 if the configuration is singular for the "
            "motion of a single input while the other inputs are locked, 2 if it is "
            "singular only for a combined motion of several inputs; in other rows: 0",
            "integer",
        ),
    ),
)
ASPECTS = Table(
    "aspects",
    "with several inputs: one row per configuration over an input grid, with the number of "
    "its aspect (a connected set of configurations without singularities)",
    (
        Column(
            "aspect",
            "",
            "number of the aspect (a set of configurations that is "
            "connected without singularities), from 0 for the "
            "largest one",
            "integer",
        ),
        INPUTS,
        Column(
            "sign_II",
            "",
            "sign of the determinant that is 0 at singularities of type II",
            "integer",
        ),
        Column(
            "sign_I",
            "",
            "sign of the determinant that is 0 at singularities of type I",
            "integer",
        ),
        Column(
            "assembly_modes",
            "",
            "largest number of configurations (assembly modes) that this aspect has at the "
            "same values of the inputs",
            "integer",
        ),
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
    two known axes). A dyad can be assembled in two ways, which differ in the sign of
    the triple product of its three axes.

    Parameters
    ----------
    batch
        The rows of the run, with the position analysis of the whole mechanism.
    values
        (n, variables) configurations (rad).
    links
        Indices of the output link and of its reference link.
    pointing
        (n, 3) output directions in axes of the reference link. Without them the pose is
        the orientation of the output link in the reference link.
    part
        Position analysis of a part of the mechanism, if `values` and `links` belong to
        the part. Otherwise they belong to the whole mechanism.

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
    # Indices of the variables that are angles of R pairs; others are not wrapped.
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
    # Without an architecture there are no columns for angles of mid-planes.
    columns |= direction_or_quaternion_columns(pose, architecture=None)

    signs = group_signs(solver, values)
    columns["signs"] = _format_signs(batch, position_analysis, signs)
    # `has_closed_form` states that every group is a dyad. The signs determine the assembly
    # mode only in this case.
    if solver.assembly.has_closed_form and part is None:
        columns["assembly_mode"] = _format_modes(batch, signs)
    return columns


def _format_signs(
    batch: Batch, position_analysis: PositionAnalysis, signs: NDArray[np.int8]
) -> list[str]:
    """Return the signs of the groups of the whole mechanism as text, one for each row.

    A group is a set of links that are assembled together, such as a dyad (two links joined
    by a pair). The sign of a group is the sign of a determinant. For a dyad it is the
    determinant of the axes, whose sign differs between the two ways to assemble the dyad.
    For a larger group it is the determinant of the velocity equations. A text has one
    character for each group: + or -, or 0 if the determinant is zero (singular). Groups
    outside of the part of the mechanism to which `signs` belong have the character *.

    Parameters
    ----------
    batch
        The rows (configurations) of the run, with the position analysis of the whole
        mechanism.
    position_analysis
        The position analysis of the whole mechanism or of a part.
    signs
        (n, groups) signs 1 or -1 of the groups of `position_analysis`, 0 for a singular
        group.
    """
    # A group is identified by the names of its pairs (joints), which are the same in a
    # part and in the whole mechanism.
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
            if group in groups:
                sign = row[groups.index(group)]
                text += text_of_sign[sign]
            else:
                text += "*"
        texts.append(text)
    return texts


def _format_modes(batch: Batch, signs: NDArray[np.int8]) -> list[str]:
    """Return, for each row, the numbers of the modes with the signs of the row, as ``0+2``.

    An assembly mode is one way to assemble the links. An assembly mode has a sign for each
    group of links. At a singularity a sign is 0, and modes with either sign meet.

    Parameters
    ----------
    batch
        The rows of the run, with their assembly modes.
    signs
        (n, groups) 1, -1 or 0.
    """
    modes = batch.motion.assembly_modes
    group_count = signs.shape[1]
    # (modes, groups)
    mode_signs = np.reshape([mode.signs for mode in modes], (len(modes), group_count))
    # (rows, modes, groups) whether a group has the sign of the mode. The sign 0 fits
    # both signs.
    row_signs = signs[:, None]
    agrees = (row_signs == mode_signs) | (row_signs == 0)
    belongs = np.all(agrees, axis=2)  # (rows, modes) whether all groups agree
    numbers = np.array([str(mode.number) for mode in modes])
    return ["+".join(numbers[modes_of_row]) for modes_of_row in belongs]
