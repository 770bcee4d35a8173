"""The tables of the analysis `singularities`, filled with one input and with several."""

from spherekit.plugin import ASSEMBLY_MODE, INPUTS, SAMPLE, STATUS, Column, Table

SINGULARITIES = Table(
    "singularities",
    "one row per singularity and output",
    (
        Column("kind", "", "I, II or III", "text"),
        Column("condition", "", "geometric conditions that hold", "text"),
        Column("assembly_mode", "", "assembly modes that it belongs to", "text"),
        INPUTS,
        Column("inside", "", "whether the inputs are in their ranges", "text"),
        Column("output", "", "link relative to link", "text"),
        Column("curve", "", "number of the configuration curve", "integer"),
        Column("s", "rad", "place on it, in its own arc length"),
        Column("error", "rad", "bound of the error of the place"),
        Column("residual", "", "sine by which the condition is missed"),
        Column("turns", "", "what reverses there: input, output, both", "text"),
        Column("double", "", "whether it is only touched", "text"),
        Column("decided", "", "whether the kind is certain", "text"),
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
        Column("output", "", "link relative to link: y'", "text"),
        Column("form", "", "i or ii", "text"),
        Column("c", "", "coefficient of the output rate"),
        Column("d", "", "coefficient of the input rate"),
        Column("velocity_coefficient", "", "y'/q' = d/c, infinite at type II"),
        Column("angle_I", "rad", "angle to type I, 0 there alone"),
        Column("angle_II", "rad", "angle to type II, 0 there alone"),
        Column("output_rate", "", "of y by the arc length of all variables"),
        Column("input_rate", "", "of q by the arc length of all variables"),
        Column("transmission", "rad", "transmission angle of the output's dyad"),
        Column("to_I", "rad", "change of the input to the nearest type I"),
        Column("to_II", "rad", "change of the input to the nearest type II"),
        Column("sigma", "", "least singular value of the passive equations"),
        Column("reciprocal_condition", "", "its part of the greatest one"),
        STATUS,
        Column("moving", "", "the moving input, the others locked", "text"),
        Column("type", "", "regular, I, II, III, loose or branching", "text"),
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
        Column(
            "assembly_modes",
            "",
            "assembly modes of one input in the part",
            "integer",
        ),
    ),
)
