"""The tables of the analysis `singularities`, filled with one input and with several."""

from typing import Any

import numpy as np

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
from spherekit.plugin.singularities import (
    group_signs,
)

from ..common import PLACE, place_columns
from .scenes import words_of

KIND = (
    "I: the output rests though inputs move; II: it moves though they rest; III: both; "
    "self-motion: other links move, and neither does"
)
OUTPUT = Column(
    "output", "", "link relative to link, with its name where others are these", "text"
)
SINGULARITIES = Table(
    "singularities",
    "one row per singularity and output",
    (
        Column("kind", "", KIND, "text"),
        Column("condition", "", "geometric conditions that hold", "text"),
        Column("assembly_mode", "", "assembly modes that it belongs to", "text"),
        INPUTS,
        Column("inside", "", "whether the inputs are in their ranges", "text"),
        OUTPUT,
        *PLACE[:4],
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


def of_type(kind: str) -> str:
    """Return the words for a kind: of type II, of self-motion."""
    return f"of {words_of(kind)}"


def angle_of(sizes: Floats) -> Floats:
    """Return (n,) rad: the angle of all motions to those that keep inputs or output."""
    return np.arcsin(np.minimum(sizes, 1.0))


def configuration_columns(
    batch: Batch,
    values: Floats,
    links: tuple[int, int],
    pointing: Floats | None = None,
    part: PositionAnalysis | None = None,
) -> dict[str, Any]:
    """Return passive variables, signs, modes and the output's pose of rows (n, V).

    The pose is the direction `pointing` (n, 3), or the orientation of the first of two
    links in the second. Modes are those with the signs of dyads. Where values and links
    are those of a part, its tracer is given; groups of the rest have the sign ``*``.
    """
    tracer = part or batch.tracer
    mechanism = tracer.mechanism
    solver = tracer.solver
    angles = set(mechanism.angles.values())
    columns: dict[str, Any] = {
        name: wrap(values[:, v]) if v in angles else values[:, v]
        for v, name in enumerate(mechanism.variable_names)
        if v not in solver.driven
    }
    placed = tracer.given(values).rotations
    turned = np.swapaxes(placed[:, links[1]], 1, 2) @ placed[:, links[0]]
    columns |= place_columns(quaternion(turned) if pointing is None else pointing, None)
    signs = group_signs(solver, values)
    names = [set(mechanism.names_of(g.pairs)) for g in solver.assembly.groups]
    every = batch.tracer.assembly.groups
    groups = [set(batch.mechanism.names_of(g.pairs)) for g in every]
    columns["signs"] = [
        "".join("0+-"[row[names.index(g)]] if g in names else "*" for g in groups)
        for row in signs.tolist()
    ]
    if solver.assembly.has_closed_form and part is None:
        modes = batch.motion.assembly_modes
        of_modes = np.reshape([x.signs for x in modes], (len(modes), signs.shape[1]))
        alike = np.all((signs[:, None] == of_modes) | (signs[:, None] == 0), axis=2)
        numbers = np.array([str(mode.number) for mode in modes])
        columns["assembly_mode"] = ["+".join(numbers[row]) for row in alike]
    return columns
