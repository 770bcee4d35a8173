"""What is found of a singularity: type, place, rates, relations, conditions."""

from dataclasses import dataclass
from enum import StrEnum
from typing import final

from spherekit.motion.crossing import Crossing
from spherekit.singular.conditions import Holding
from spherekit.singular.relation import Form, FourLinks, LinkCount, Relation, SixPoles
from spherekit.sphere.rotation import Floats


class Type(StrEnum):
    """What vanishes: the output (I), the input (II), both, or c and d alone.

    Both in a self-motion, in which other links move; III where curves cross.
    """

    I = "I"  # noqa: E741
    II = "II"
    III = "III"
    SELF_MOTION = "self-motion"
    APPARENT = "apparent"


@final
@dataclass(frozen=True)
class RelationAt:
    """The input-output relation at one singularity.

    Attributes
    ----------
    form, kind
        See `spherekit.singular.relation.Relation`.
    links
        The four links it was made from; those of form ii may have another s.
    output
        The links whose relative rate is its output.
    c, d
        Its coefficients.
    error
        Bound of their rounding error.
    residual
        By how much the rates on the curve break c y' = d q', relative to them.
    type
        What its own coefficients say: I (d = 0), II (c = 0), III (both), or None.
    conditions
        The geometric conditions that hold, the most special first.
    agrees
        Whether `type` is what the rates of its input and output say.
    note
        Why it does not, or an empty string.
    """

    form: Form
    kind: LinkCount
    links: FourLinks
    output: tuple[int, int]
    c: float
    d: float
    error: float
    residual: float
    type: Type | None
    conditions: tuple[Holding, ...]
    agrees: bool
    note: str


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
    decided
        Whether the type is certain within rounding.
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
    decided: bool
    note: str
    relations: tuple[RelationAt, ...]


@final
@dataclass(frozen=True)
class CrossingPoint:
    """A configuration in which curves cross or end: type III for every output.

    Attributes
    ----------
    crossing
        Rank, freedoms and the directions of its curves; None if it was not located.
    ends
        The curves that end there: number of the curve, and whether at its start.
    values
        (variables,) rad: the crossing, or the last node before it.
    decided
        Whether the loss of rank is certain within rounding.
    note
        What is not certain, with numbers, or an empty string.
    relations
        For each output the relations on each curve through it.
    """

    crossing: Crossing | None
    ends: tuple[tuple[int, bool], ...]
    values: Floats
    decided: bool
    note: str
    relations: tuple[tuple[tuple[RelationAt, ...], ...], ...]


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
    """Rates and relations of one output at n places s of a curve.

    `input_rate`, `output_rate` (n,) are per arc length; `relations` are
    form i, and form ii where there is one, with their `links` and `poles`.
    """

    s: Floats
    input_rate: Floats
    output_rate: Floats
    relations: tuple[Relation, ...]
    links: tuple[FourLinks, ...]
    poles: tuple[SixPoles, ...]


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
