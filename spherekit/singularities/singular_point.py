"""One singularity of a mechanism with one input: type, position, rates and relations."""

from dataclasses import dataclass

from spherekit.arrays import Floats
from spherekit.positions.curve_crossing import Crossing
from spherekit.singularities.geometric_conditions import RelationAt
from spherekit.singularities.input_output_relation import Type


@dataclass(frozen=True)
class SingularPoint:
    """A singularity of one input and one output, which are given by indices of links.

    Attributes
    ----------
    type
        Its type: I, the output rests; II, the input rests; self-motion, both rest while
        other links move; III, curves of configurations cross, or end because the closure
        equations lose rank.
    output
        The output (o, s): link o relative to link s.
    places
        Where the point is: the index of a configuration curve, and the arc length on it
        (rad). A crossing of curves has an item for each curve end there. The arc length is
        NaN if an output or the input stands still on the whole curve.
    error
        Bound of the error of the arc length (rad). For a crossing, the last step of
        Newton's method (rad). NaN if there is neither.
    values
        (variables,) the configuration (rad), NaN for a whole curve. A crossing that was not
        located has the configuration of the last computed point of a curve that ends there.
    input_turns, output_turns
        Whether the input and the output reverse at the singularity. A motion does not
        reverse if its rate only touches zero.
    double
        Whether a vanishing rate only touches zero, or has two zeros that cannot be
        separated.
    note
        Why the type, or the loss of rank, is not certain within rounding, or an empty
        string.
    relations
        The relation c y' = d q' between the rate y' of the output and the rate q' of the
        input, where c and d follow from pole axes. In form i the output link moves relative
        to its own reference link, in form ii (if it exists) relative to the reference link
        of the input. A crossing has the relations of each curve through it.
    crossing
        The crossing of curves, with its freedoms and the directions of its curves; None
        if there is no crossing or if it was not located.
    """

    type: Type
    output: tuple[int, int]
    places: tuple[tuple[int, float], ...]
    error: float
    values: Floats
    input_turns: bool = False
    output_turns: bool = False
    double: bool = False
    note: str = ""
    relations: tuple[RelationAt, ...] = ()
    crossing: Crossing | None = None

    @property
    def curve(self) -> int:
        """The index of the first curve in `places`."""
        number, _ = self.places[0]
        return number

    @property
    def s(self) -> float:
        """The arc length (rad) on the first curve in `places`."""
        _, arc_length = self.places[0]
        return arc_length

    @property
    def certain(self) -> bool:
        """Whether the type is certain within rounding."""
        return not self.note
