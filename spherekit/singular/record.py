"""What is found of singularities of one input: types, places, rates, relations."""

from dataclasses import dataclass
from typing import final

from spherekit.motion.crossing import Crossing
from spherekit.singular.conditions import RelationAt
from spherekit.singular.relation import Relation, Type
from spherekit.sphere.rotation import Floats


@final
@dataclass(frozen=True)
class SingularPoint:
    """A singularity of one input and one output, by numbers of links.

    Attributes
    ----------
    type, output
        Its type, and the output (o, s).
    curve, s
        Number of the configuration curve, and the place on it (rad of arc length).
    error
        Bound of the error of s (rad).
    values
        (variables,) rad.
    input_rate, output_rate
        Rates per arc length there; zero to rounding where they vanish.
    input_slope, output_slope
        Their derivatives by s.
    input_turns, output_turns
        Whether the input and the output reverse there: not where they only touch zero.
    double
        Whether what vanishes touches zero only, or vanishes twice too near to part.
    note
        The numbers behind an undecided type, or an empty string.
    relations
        The relation in form i, and in form ii where there is one.
    """

    type: Type
    output: tuple[int, int]
    curve: int
    s: float
    error: float
    values: Floats
    input_rate: float
    output_rate: float
    input_slope: float
    output_slope: float
    input_turns: bool
    output_turns: bool
    double: bool
    note: str
    relations: tuple[RelationAt, ...]

    @property
    def decided(self) -> bool:
        """Whether the type is certain within rounding."""
        return not self.note


@final
@dataclass(frozen=True)
class CrossingPoint:
    """A configuration where curves cross, or one that a curve ends before.

    Attributes
    ----------
    crossing
        The configuration, its freedoms and the directions of its curves; None if it was
        not located.
    ends
        The curves that end there: number of the curve, and whether at its start.
    values
        (variables,) rad: the crossing, or the last node before it.
    note
        Why the loss of rank is not certain within rounding, or an empty string.
    relations
        For each output the relations on each curve through it.
    """

    crossing: Crossing | None
    ends: tuple[tuple[int, bool], ...]
    values: Floats
    note: str
    relations: tuple[tuple[tuple[RelationAt, ...], ...], ...]

    @property
    def decided(self) -> bool:
        """Whether the loss of rank is certain within rounding."""
        return not self.note


@final
@dataclass(frozen=True)
class WholeCurve:
    """A curve on all of which an output or the input stands still: no points on it.

    `type` is I where the output (o, s) rests, II where the input does, SELF_MOTION for
    both.
    """

    type: Type
    output: tuple[int, int]
    curve: int


@final
@dataclass(frozen=True)
class AlongOutput:
    """Rates (n,) per arc length, and relations, of an output at n places of a curve.

    The relations are form i, and form ii where there is one.
    """

    input_rate: Floats
    output_rate: Floats
    relations: tuple[Relation, ...]


@final
@dataclass(frozen=True)
class Singularities:
    """All singularities of a mechanism for one input and some outputs.

    Attributes
    ----------
    input, outputs
        (i, r) and for each output (o, s), numbers of links.
    fourth
        For each output the s of form ii: its own, or another one where that is r; None
        where there is none.
    points
        By output, curve and arc length.
    crossings
        Where curves cross.
    whole
        Curves that are singular throughout.
    everywhere
        The freedoms by rank, to a part in a million, of a mechanism that is singular in
        all its configurations, which has no curves; otherwise None.
    notes
        What holds on whole curves, such as c = d = 0 everywhere.
    gaps
        Where singularities may be missed or invented.
    """

    input: tuple[int, int]
    outputs: tuple[tuple[int, int], ...]
    fourth: tuple[int | None, ...]
    points: tuple[SingularPoint, ...]
    crossings: tuple[CrossingPoint, ...]
    whole: tuple[WholeCurve, ...]
    everywhere: int | None
    notes: tuple[str, ...]
    gaps: tuple[str, ...]
