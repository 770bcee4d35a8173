"""Geometric conditions at a singularity: parallel axes and coincident planes.

The rate y' of the output and the rate q' of the input satisfy a relation c y' = d q'. The
output link turns relative to its own reference link in form "i" of this relation, and
relative to the reference link of the input in form "ii". A singularity has type I if d = 0,
type II if c = 0, and type III if both vanish. Geometric conditions say when they vanish.

The names III.1 to III.5 (form "i") and III.a to III.g (form "ii") are those of R. Di
Gregorio's lecture on the singularity analysis of spherical mechanisms. The conditions of
types I and II have no names there. Here they are I.1 to I.3 and II.1 to II.3 in form "i",
I.a to I.c and II.a to II.c in form "ii", in the order in which the lecture gives them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Bools, Floats
from spherekit.geometry.vectors import cross, max_abs
from spherekit.planning.pole_plan import Pole, pole_of
from spherekit.singularities.input_output_relation import (
    LINKS_OF_AXIS,
    Form,
    FourLinks,
    Relation,
    SixPoles,
    Type,
    find_third_axis,
)
from spherekit.singularities.tangent_space import decompose

VANISHING_SINE = 1e-9
"""Sines up to this are taken for zero, unless the error of the axes is larger. Larger:
conditions are reported that are not quite fulfilled; smaller: rounding hides some."""
UNDECIDED_FACTOR = 1e3
"""Conditions that miss by more than the tolerance, but by less than this factor times it,
are reported as uncertain. Larger: more conditions are reported."""
AXIS_ERROR_FACTOR = 10.0
"""A condition may be missed by this multiple of the error bound of the axes, because it
combines several axes. Larger: more conditions are reported beside crossings."""


@dataclass(frozen=True)
class FulfilledCondition:
    """A geometric condition that is fulfilled at a singular configuration.

    The condition says that axes of relative rotation of links are parallel, or that planes
    coincide that each contain two of these axes.

    Attributes
    ----------
    label
        Name of the condition, such as ``III.4``: the type of singularity, and a number or
        letter. The names of type III are those of R. Di Gregorio's lecture on
        singularities.
    words
        The condition in words, with the names of the links.
    residual
        The largest sine of the angles between the axes or planes: 0 if the condition is
        fulfilled exactly.
    certain
        Whether the residual is within the tolerance, which follows from the error bounds of
        the axes. If the residual is larger, but at most `UNDECIDED_FACTOR` times the
        tolerance, the condition is reported as uncertain.
    """

    label: str
    words: str
    residual: float
    certain: bool


@dataclass(frozen=True)
class ParallelAxes:
    """The condition that some of the pole axes of four links are parallel.

    `find_conditions` tests it at singularities. It is fulfilled if its sine is zero, up to
    a tolerance.

    The pole axis of two links is the axis about which they rotate relative to each other.
    The four links are the input link i and its reference r, and the output link o and its
    reference s. `axes` are names of fields of `SixPoles`, such as "os" for the pole axis of
    the links o and s. Where the name is a word of Python, an underscore follows ("is_").
    """

    axes: tuple[str, ...]

    def sine(self, poles: SixPoles) -> Floats:
        """Return the largest sine (n,) between two of the axes, NaN if one is unknown."""
        vectors = poles.stacked(self.axes)  # (n, axes, 3)
        # The length of the vector product of two unit vectors is the sine of their angle.
        products = cross(vectors[:, :, None], vectors[:, None])
        return np.max(np.linalg.norm(products, axis=-1), axis=(1, 2))

    def describe(self, links: FourLinks, names: Sequence[str]) -> str:
        """Return the condition in words, with the names of all links."""
        *others, last = _axis_names(self.axes, links, names)
        return f"the axes {', '.join(others)} and {last} are parallel"


@dataclass(frozen=True)
class CoincidentPlanes:
    """The condition that two planes through pole axes of links coincide.

    The pole axis of two links is the axis about which they rotate relative to each other.
    The input link i, the output link o and their reference links r and s have six pole
    axes. By the theorem of Aronhold and Kennedy, the three pole axes of any three of these
    links are in one plane. If the two planes of this condition coincide, the mechanism is
    singular.

    Attributes
    ----------
    first, second
        Names of the three axes in each plane, such as "os" for the axis of links o and s.
    """

    first: tuple[str, ...]
    second: tuple[str, ...]

    def sine(self, poles: SixPoles) -> Floats:
        """Return how far (n,) the two planes are from coinciding, as the sine of an angle.

        `find_conditions` compares it with a tolerance, and so tells users why a
        configuration is singular.

        In general the angle is that between the planes. But if the three axes of one plane
        are parallel, they determine no plane. In this case one plane is fitted to the axes
        of both planes. The angle is then the largest angle between one of these axes and
        the fitted plane.

        If one axis of a plane is unknown, the other two determine the plane. The result is
        NaN if they are parallel or unknown, too.

        Parameters
        ----------
        poles
            The six pole axes at n configurations.
        """
        # For each plane its normal, and the largest sine between two of its axes. This sine
        # vanishes if all its axes are parallel.
        first_normal, first_largest_sine = poles.plane(self.first)
        second_normal, second_largest_sine = poles.plane(self.second)
        smaller_sine = np.minimum(first_largest_sine, second_largest_sine)
        has_parallel_axes = smaller_sine < VANISHING_SINE
        sine_between_planes = np.linalg.norm(cross(first_normal, second_normal), axis=-1)
        all_axes = poles.stacked([*self.first, *self.second])
        sine_to_common_plane = _sine_to_best_plane(all_axes)
        return np.where(has_parallel_axes, sine_to_common_plane, sine_between_planes)

    def describe(self, links: FourLinks, names: Sequence[str]) -> str:
        """Return the condition in words, with the names of all links."""
        first = " ".join(_axis_names(self.first, links, names))
        second = " ".join(_axis_names(self.second, links, names))
        return f"the planes of the axes ({first}) and ({second}) coincide"


@dataclass(frozen=True)
class AllAxesCoplanar:
    """The condition that all axes of `SixPoles` are in one plane."""

    def sine(self, poles: SixPoles) -> Floats:
        """Return the largest sine (n,) to the plane, NaN if an axis is unknown."""
        return _sine_to_best_plane(poles.stacked(tuple(LINKS_OF_AXIS)))

    def describe(self, links: FourLinks, names: Sequence[str]) -> str:
        """Return the condition in words."""
        return "all six axes lie in one plane"


Condition = ParallelAxes | CoincidentPlanes | AllAxesCoplanar
"""One geometric condition."""

INPUT_PLANES_FORM_I = CoincidentPlanes(("ir", "is_", "rs"), ("or_", "ir", "io"))
"""Planes that coincide at type I in form i."""
INPUT_PLANES_FORM_II = CoincidentPlanes(("io", "os", "is_"), ("ir", "is_", "rs"))
"""Planes that coincide at type I in form ii."""
OUTPUT_PLANES = CoincidentPlanes(("or_", "os", "rs"), ("io", "os", "is_"))
"""Planes that coincide at type II in both forms."""

FOUR_LINKS: Mapping[tuple[Form, str], Mapping[str, tuple[Condition, ...]]] = {
    ("i", "I"): {
        "I.2": (ParallelAxes(("ir", "rs")),),
        "I.3": (ParallelAxes(("ir", "io")),),
        "I.1": (INPUT_PLANES_FORM_I,),
    },
    ("ii", "I"): {
        "I.b": (ParallelAxes(("is_", "ir")),),
        "I.c": (ParallelAxes(("is_", "os")),),
        "I.a": (INPUT_PLANES_FORM_II,),
    },
    ("i", "II"): {
        "II.2": (ParallelAxes(("os", "rs")),),
        "II.3": (ParallelAxes(("os", "io")),),
        "II.1": (OUTPUT_PLANES,),
    },
    ("ii", "II"): {
        "II.b": (ParallelAxes(("os", "is_")),),
        "II.c": (ParallelAxes(("os", "or_")),),
        "II.a": (OUTPUT_PLANES,),
    },
    ("i", "III"): {
        "III.2": (ParallelAxes(("rs", "os", "ir")),),
        "III.3": (ParallelAxes(("io", "os", "ir")),),
        "III.4": (ParallelAxes(("ir", "rs")), ParallelAxes(("os", "io"))),
        "III.5": (ParallelAxes(("ir", "io")), ParallelAxes(("os", "rs"))),
        "III.1": (AllAxesCoplanar(),),
    },
    ("ii", "III"): {
        "III.e": (ParallelAxes(("is_", "ir", "os")),),
        "III.f": (ParallelAxes(("is_", "os", "or_")),),
        "III.d": (ParallelAxes(("is_", "ir")), ParallelAxes(("os", "or_"))),
        "III.b": (INPUT_PLANES_FORM_II, ParallelAxes(("os", "is_"))),
        "III.c": (OUTPUT_PLANES, ParallelAxes(("is_", "os"))),
        "III.g": (ParallelAxes(("is_", "os")),),
        "III.a": (AllAxesCoplanar(),),
    },
}
"""The conditions of four different links, by form and type, the most special ones first.
All conditions of a label have to be fulfilled."""


def _axis_names(axes: Sequence[str], links: FourLinks, names: Sequence[str]) -> list[str]:
    """Return names of axes for users, such as ``4/1``, with the names of the two links."""
    return ["/".join(names[link] for link in links.ends(axis)) for axis in axes]


def _sine_to_best_plane(vectors: Floats) -> Floats:
    """Return the largest sine (n,) of the angles of unit vectors (n, k, 3) to a plane.

    The plane passes through the origin, with the least sum of squared distances of the k
    vectors. Small sines show that axes are nearly coplanar.
    """
    normals = decompose(vectors).right[:, -1]
    return max_abs(np.einsum("nki,ni->nk", vectors, normals), axis=1)


def find_conditions(
    relation: Relation, names: Sequence[str], kind: str, tolerances: Floats
) -> list[tuple[FulfilledCondition, ...]]:
    """Return the geometric conditions that are fulfilled at each of n configurations.

    The relation c y' = d q' connects the rate y' of the output and the rate q' of the
    input. Its coefficients c and d follow from pole axes (axes of relative rotation of two
    links). A condition says that some of these axes are parallel, or that planes through
    them coincide. Then c (type II), d (type I) or both (type III) vanish. The sine of a
    condition is that of the angle between these axes or planes.

    Parameters
    ----------
    relation
        The relation, with its pole axes at n configurations.
    names
        The names of all links of the mechanism.
    kind
        Type of the singularity: ``I``, ``II`` or ``III``.
    tolerances
        (n,) a condition is certainly fulfilled if its sine is at most this.

    Returns
    -------
    For each configuration the certain conditions, then the uncertain ones. A condition is
    uncertain if its sine is between the tolerance and `UNDECIDED_FACTOR` times the
    tolerance.
    """
    conditions_by_row: list[list[FulfilledCondition]] = [[] for _ in tolerances]
    for label, conditions in _possible_conditions(relation, kind).items():
        # A label, such as "III.4", can name two conditions that have to be fulfilled
        # together. So the largest of their sines counts.
        sines = [condition.sine(relation.poles) for condition in conditions]
        largest_sines = np.max(sines, axis=0).tolist()
        words = " and ".join(
            condition.describe(relation.links, names) for condition in conditions
        )
        for row, (sine, tolerance) in enumerate(
            zip(largest_sines, tolerances, strict=True)
        ):
            if sine <= UNDECIDED_FACTOR * tolerance:
                is_certain = bool(sine <= tolerance)
                conditions_by_row[row].append(
                    FulfilledCondition(label, words, sine, is_certain)
                )
    sorted_conditions = []
    for row_conditions in conditions_by_row:
        certain = [condition for condition in row_conditions if condition.certain]
        uncertain = [condition for condition in row_conditions if not condition.certain]
        sorted_conditions.append((*certain, *uncertain))
    return sorted_conditions


def _possible_conditions(
    relation: Relation, kind: str
) -> Mapping[str, tuple[Condition, ...]]:
    """Return the geometric conditions under which a singularity has a certain type.

    In the relation c y' = d q', q' is the rate of the input link i relative to its
    reference link r. y' is the rate of the output link o: relative to its reference link s
    in form "i", and relative to r in form "ii". Type I means d = 0, type II c = 0, and type
    III both. Conditions say that axes of relative rotation of these links are parallel, or
    that planes through such axes coincide.

    Parameters
    ----------
    relation, kind
        The relation, and the type: ``I``, ``II`` or ``III``.

    Returns
    -------
    Conditions by a label, such as "III.4". All conditions of a label have to be fulfilled.
    """
    # Some of the links i, r, o and s may be the same link.
    link_count = len(relation.links.different)
    if link_count == 4:
        return FOUR_LINKS[relation.form, kind]
    if link_count == 3:
        return _condition_of_three_links(relation, kind)
    # With two links, input and output are the same rotation. c and d never vanish.
    return {}


def _condition_of_three_links(
    relation: Relation, kind: str
) -> dict[str, tuple[Condition, ...]]:
    """Return the condition of a type of singularity for a relation of three links.

    The input is the rotation of link i relative to its reference link r. The output is the
    rotation of link o: relative to its reference link s in form "i", and relative to r in
    form "ii". Two of the links i, r, o and s are the same. Any two of the three different
    links have a pole axis (axis of relative rotation): the axis of the input, the axis of
    the output, and a third one.

    Type I means that the axis of the input and the third axis are parallel. Type II means
    that the axis of the output and the third axis are parallel. Type III means that all
    three are parallel. All axes pass through the common centre, so parallel axes are one
    line. The conditions follow from the formulas for c and d in `ThirdAxis`.

    Parameters
    ----------
    relation
        The relation c y' = d q' between the rates of output and input.
    kind
        The type: I, II or III.

    Returns
    -------
    The condition, by its label. A label such as "II.3" has the type and a number. In some
    cases the label is only the type.
    """
    # The name of a pole axis has the letters of its two links.
    input_axis = "ir"
    if relation.form == "i":
        output_axis = "os"
    else:
        # The underscore follows because "or" is a word of Python.
        output_axis = "or_"
    third = find_third_axis(relation.form, relation.links)
    parallel_axes_by_kind = {
        "I": (input_axis, third.name),
        "II": (output_axis, third.name),
        "III": (third.name, output_axis, input_axis),
    }
    condition = ParallelAxes(parallel_axes_by_kind[kind])
    return {kind + third.label_suffix: (condition,)}


@dataclass(frozen=True)
class RelationAt:
    """The input-output relation c y' = d q' at one singularity.

    q' is the rate of the input: the rate of link i relative to its reference link r. y' is
    a rate of the output link o. The relation has two forms, which differ in the link
    relative to which y' is counted.

    Attributes
    ----------
    form
        "i" if y' is the rate of link o relative to its own reference link s. "ii" if y' is
        the rate of link o relative to the reference link r of the input.
    c, d
        The coefficients, which follow from the directions of pole axes (axes of relative
        rotation of two links) alone.
    residual
        Size of the difference c y' - d q', relative to the size of the rates y' and q'.
    type
        The type of the singularity according to the coefficients: I (d = 0), II (c = 0),
        III (both), or None if neither vanishes or if they are unknown (NaN).
    conditions
        The geometric conditions of this type that are fulfilled: parallel axes, planes that
        coincide.
    note
        Why the rates give another type than `type`; empty if they give the same. By the
        rates, the type is I if the output rests, II if the input rests, and III if both
        rest. The output is here that of the mechanism: the rotation of link o relative to
        its own reference link. In form "ii", y' can be the rate of another rotation.
    """

    form: Form
    c: float
    d: float
    residual: float
    type: Type | None
    conditions: tuple[FulfilledCondition, ...]
    note: str

    @property
    def agrees(self) -> bool:
        """Whether `type` is the type according to the rates of input and output."""
        return not self.note


UNKNOWN_COEFFICIENTS_NOTE = (
    "c and d are unknown: a pole axis is unknown, or the axes of three links are one line"
)
"""Note of a relation whose c or d is NaN."""
TYPE_OF_VANISHING = {
    (True, True): Type.III,
    (True, False): Type.II,
    (False, True): Type.I,
}
"""The type of a singularity, by whether c vanishes and whether d vanishes."""


def compare_with_rates(
    relation: Relation,
    names: Sequence[str],
    output_rate: Floats,
    input_rate: Floats,
    axis_errors: Floats,
    output: tuple[int, int],
    types_by_rates: Sequence[Type],
    is_resting: Mapping[Pole, Bools],
) -> list[RelationAt]:
    """Return a relation c y' = d q' at n singularities, compared with the rates.

    y' is the rate of the output and q' the rate of the input. c and d follow from pole
    axes. The relation has one of two forms. In form "i", y' is the rate of the output link
    relative to its own reference link. In form "ii", y' is its rate relative to the
    reference link of the input.

    The type of a singularity can be decided in two ways. According to the relation, it is
    type I if d = 0, and type II if c = 0. According to the rates, it is type I if the
    output rests (y' = 0), and type II if the input rests (q' = 0). A note explains the
    difference if the two types differ.

    Parameters
    ----------
    relation
        The relation at n configurations.
    names
        The names of all links of the mechanism.
    output_rate, input_rate
        (n,) rates y' and q' of the relation.
    axis_errors
        (n,) error bounds (rad) of the pole axes.
    output
        Output link and its own reference link, which define the singularities. In form
        "ii", y' is in general not their relative rate.
    types_by_rates
        Type of each singularity according to the rates of `output` and of the input.
    is_resting
        (n,) for each pole whether its two links rest relative to each other.
    """
    tolerances = np.maximum(VANISHING_SINE, AXIS_ERROR_FACTOR * axis_errors)
    c_vanishes = np.abs(relation.c) <= tolerances
    d_vanishes = np.abs(relation.d) <= tolerances
    # The type is None where neither c nor d vanishes, and where they are NaN.
    types_by_coefficients = [
        TYPE_OF_VANISHING.get((c_is_zero, d_is_zero))
        for c_is_zero, d_is_zero in zip(
            c_vanishes.tolist(), d_vanishes.tolist(), strict=True
        )
    ]
    conditions_by_type = {
        kind: find_conditions(relation, names, kind, tolerances)
        for kind in set(types_by_coefficients)
        if kind is not None
    }
    residuals = relation.residual(output_rate, input_rate).tolist()
    links = relation.links
    input_pole = pole_of(links.i, links.r)
    output_pole = pole_of(*relation.output)
    is_other_output = output_pole != pole_of(*output)
    is_known = np.isfinite(relation.c) & np.isfinite(relation.d)
    relations = []
    for row, kind in enumerate(types_by_coefficients):
        type_by_rates = types_by_rates[row]
        if type_by_rates == Type.SELF_MOTION:
            # In a self-motion input and output rest, which is compared with c = d = 0.
            type_by_rates = Type.III
        # The type by the rates of the input and of the relation's own output.
        input_rests = types_by_rates[row] in (Type.II, Type.SELF_MOTION)
        own_type = TYPE_OF_VANISHING.get((input_rests, bool(is_resting[output_pole][row])))
        # At a crossing of curves, all forms are compared with type III.
        has_own_type = is_other_output and types_by_rates[row] != Type.III
        note = ""
        if kind != type_by_rates and not is_known[row]:
            note = UNKNOWN_COEFFICIENTS_NOTE
        elif kind != type_by_rates and has_own_type and kind == own_type:
            moving, reference = (names[link] for link in relation.output)
            note = (
                f"y' is the rate of {moving}/{reference} in form {relation.form}, which is "
                "not the output; c and d agree with this rate"
            )
        elif kind != type_by_rates:
            # If only input or output rests, only one coefficient vanishes. So their links
            # are not the cause of c = d = 0.
            resting_links = [
                f"{names[a]} and {names[b]}"
                for a, b in links.poles
                if is_resting[a, b][row] and (a, b) not in (input_pole, output_pole)
            ]
            note = _explain_disagreement(kind, type_by_rates, links, resting_links)
        relations.append(
            RelationAt(
                form=relation.form,
                c=relation.c[row].item(),
                d=relation.d[row].item(),
                residual=residuals[row],
                type=kind,
                conditions=() if kind is None else conditions_by_type[kind][row],
                note=note,
            )
        )
    return relations


def _explain_disagreement(
    kind: Type | None,
    type_by_rates: Type,
    links: FourLinks,
    resting_links: Sequence[str],
) -> str:
    """Return why a relation and the rates give different types of a singularity.

    The result is the note of the relation in the report (`RelationAt.note`).

    The relation is c y' = d q'. y' is the rate of the output and q' the rate of the input.
    Each is the relative rate of two links. c and d are triple products of the pole axes
    (axes of relative rotation) of these links. There are two ways to decide the type:

    - By the coefficients: type I if d = 0, type II if c = 0, type III if both are 0.
    - By the rates: type I if y' = 0, type II if q' = 0, type III if both are 0.

    If c = d = 0, the relation holds for any rates and cannot decide the type. A relation
    with other links has to decide.

    Parameters
    ----------
    kind, type_by_rates
        The type according to the coefficients, None if no coefficient vanishes, and the
        type according to the rates.
    links
        The links of the relation.
    resting_links
        Pairs of links that rest relative to each other, such as ``3 and 4``. They are named
        as the cause if c = d = 0.
    """
    # Input and output are the relative rotation of the same two links, so y' is q' or -q'.
    # Then c and d are 1 or -1. They never vanish, even where y' and q' do.
    if len(links.different) == 2:
        return "the output is the input, and c and d are constant"
    if kind == Type.III:
        cause = _explain_vanishing_coefficients(resting_links)
        return (
            f"c = d = 0, but the rates give type {type_by_rates}: {cause}; a relation of "
            "other links decides"
        )
    if type_by_rates == Type.III and kind is None:
        return (
            "input and output stand still together while other links move; c and d do not "
            "vanish, and y'/q' = d/c stays finite"
        )
    vanishing = "nothing vanishes" if kind is None else f"type {kind}"
    return (
        f"c and d give: {vanishing}; the rates give type {type_by_rates}; a coefficient "
        "nearly vanishes, or is not known accurately enough"
    )


def _explain_vanishing_coefficients(resting_links: Sequence[str]) -> str:
    """Return why both coefficients of an input-output relation vanish, as a phrase.

    The coefficients follow from the six pole axes (axes of relative rotation) of any two of
    four links. The coefficients vanish if all six axes are in one plane. If some of the
    links rest relative to each other, the phrase names these links as the cause.

    Parameters
    ----------
    resting_links
        Pairs of links that rest relative to each other. ``3 and 4`` is one such pair.
    """
    if resting_links:
        return f"links {', '.join(resting_links)} stand still relative to each other"
    return "the six axes of the chosen links lie in one plane"
