"""What is found of singularities of one input: types, places, rates, relations."""

from dataclasses import dataclass

from spherekit.arrays import Floats
from spherekit.positions.curve_crossing import Crossing
from spherekit.singularities.geometric_conditions import RelationAt
from spherekit.singularities.input_output_relation import Type


@dataclass(frozen=True)
class SingularPoint:
    """A singularity of one input and one output, by numbers of links.

    Attributes
    ----------
    type, output
        Its type, and the output (o, s). III where curves cross, or end before a loss of
        rank.
    places
        The numbers of the configuration curves, each with the place on it (rad of arc
        length): where curves cross several, the ends of these. NaN where an output or the
        input stands still on the whole curve.
    error
        Bound of the error of the place (rad).
    values
        (variables,) rad; where curves end at no located crossing those of the last node.
    input_turns, output_turns
        Whether the input and the output reverse there: not where they only touch zero.
    double
        Whether what vanishes touches zero only, or vanishes twice too near to part.
    note
        Why the type, or the loss of rank, is not certain within rounding, or an empty
        string.
    relations
        The relation in form i, and in form ii where there is one; of a crossing those on
        each curve through it.
    crossing
        The crossing of curves, its freedoms and the directions of its curves; None if it
        is none or was not located.
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
        """The number of its first curve."""
        return self.places[0][0]

    @property
    def s(self) -> float:
        """The place on that (rad)."""
        return self.places[0][1]

    @property
    def certain(self) -> bool:
        """Whether the type is certain within rounding."""
        return not self.note
