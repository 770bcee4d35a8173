"""Geometric conditions that hold at a singularity: parallel axes, coincident planes.

The names III.1 to III.5 and III.a to III.g are those of R. Di Gregorio's lecture on the
singularity analysis of spherical mechanisms. The conditions of types I and II have no
names there; here they are I.1 to I.3 and II.1 to II.3 in form i, I.a to I.c and II.a to
II.c in form ii, in the order in which the lecture gives them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Bools, Floats
from spherekit.geometry.vectors import cross, max_abs
from spherekit.planning.pole_plan import Pole, pole_of
from spherekit.singularities.input_output_relation import (
    AXES,
    Form,
    FourLinks,
    Relation,
    Type,
    third_axis,
)
from spherekit.singularities.tangent_space import decompose

TOLERANCE = 1e-9
"""Sines up to this are taken for zero where the error of the axes is not larger."""


UNDECIDED = 1e3
"""Conditions that miss the tolerance by less than this factor are undecided."""


@dataclass(frozen=True)
class Holding:
    """A condition that holds at a configuration.

    Attributes
    ----------
    label
        Its name, such as ``III.4``.
    words
        What coincides, with the names of the links.
    residual
        The largest sine of the angles between what should coincide.
    certain
        Whether the residual is within the tolerance; False where it misses it by less
        than `UNDECIDED`.
    """

    label: str
    words: str
    residual: float
    certain: bool


IN_1 = "ir is_ rs = or_ ir io"


IN_A = "io os is_ = ir is_ rs"


OUT = "or_ os rs = io os is_"


IN_ONE_PLANE = ""


FOUR_LINKS = {
    ("i", "I"): {"I.2": "ir || rs", "I.3": "ir || io", "I.1": IN_1},
    ("ii", "I"): {"I.b": "is_ || ir", "I.c": "is_ || os", "I.a": IN_A},
    ("i", "II"): {"II.2": "os || rs", "II.3": "os || io", "II.1": OUT},
    ("ii", "II"): {"II.b": "os || is_", "II.c": "os || or_", "II.a": OUT},
    ("i", "III"): {
        "III.2": "rs || os || ir",
        "III.3": "io || os || ir",
        "III.4": "ir || rs, os || io",
        "III.5": "ir || io, os || rs",
        "III.1": IN_ONE_PLANE,
    },
    ("ii", "III"): {
        "III.e": "is_ || ir || os",
        "III.f": "is_ || os || or_",
        "III.d": "is_ || ir, os || or_",
        "III.b": f"{IN_A}, os || is_",
        "III.c": f"{OUT}, is_ || os",
        "III.g": "is_ || os",
        "III.a": IN_ONE_PLANE,
    },
}
"""The conditions of four different links, by form and type, the most special first.

Axes are named as in `SixPoles`: they are parallel (||), planes of three coincide (=), or
all lie in one plane.
"""


def _sine(said: str, relation: Relation) -> Floats:
    """Return (n,) the largest sine of the angles between what should coincide.

    NaN where an axis is not known. Where one of two sets of axes is parallel it has no
    plane, and the planes coincide if one plane holds all axes.
    """
    poles = relation.poles
    if "=" in said:
        one, other = (side.split() for side in said.split("="))
        first, sure = poles.plane(one)
        second, also = poles.plane(other)
        sine = np.linalg.norm(cross(first, second), axis=-1)
        both = _out_of_plane(poles.stacked([*one, *other]))
        return np.where(np.minimum(sure, also) < TOLERANCE, both, sine)
    if said == IN_ONE_PLANE:
        return _out_of_plane(poles.stacked(AXES))
    vectors = poles.stacked(said.split(" || "))
    turn = cross(vectors[:, :, None], vectors[:, None])
    return np.max(np.linalg.norm(turn, axis=-1), axis=(1, 2))


def _words(said: str, links: FourLinks, names: Sequence[str]) -> str:
    """Return what coincides, with the names of the links."""
    sides = [
        ["/".join(names[end] for end in links.ends(axis)) for axis in side.split()]
        for side in said.replace(" ||", "").split("=")
    ]
    if len(sides) == 2:
        first, second = map(" ".join, sides)
        return f"the planes of the axes ({first}) and ({second}) coincide"
    if said == IN_ONE_PLANE:
        return "all six axes lie in one plane"
    *others, last = sides[0]
    return f"the axes {', '.join(others)} and {last} are parallel"


def conditions(
    relation: Relation, names: Sequence[str], kind: str, allowed: Floats
) -> list[tuple[Holding, ...]]:
    """Return for each of n configurations the conditions that hold, most special first.

    Parameters
    ----------
    relation
        The relation that is singular.
    names
        The names of all links of the mechanism.
    kind
        Type of the singularity: ``I``, ``II`` or ``III``.
    allowed
        (n,) by how much a condition may be missed (rad).
    """
    rows: list[list[Holding]] = [[] for _ in allowed]
    form, links = relation.form, relation.links
    listed = FOUR_LINKS[form, kind] if len(links.different) == 4 else {}
    if len(links.different) == 3:
        # Three axes in a plane leave one condition for each type. With r = s or o = i it
        # is one of the lecture's; the others are called by the type alone.
        third, _, number = third_axis(form, links)
        out = "os" if form == "i" else "or_"
        axes = {"I": ("ir", third), "II": (out, third), "III": (third, out, "ir")}[kind]
        listed = {kind + number: " || ".join(axes)}
    for label, said in listed.items():
        parts = said.split(", ")
        residual = np.max([_sine(part, relation) for part in parts], axis=0)
        words = " and ".join(_words(part, links, names) for part in parts)
        for row, (size, most) in enumerate(zip(residual.tolist(), allowed, strict=True)):
            if size <= UNDECIDED * most:
                rows[row].append(Holding(label, words, size, bool(size <= most)))
    return [tuple(sorted(row, key=lambda holding: not holding.certain)) for row in rows]


def _out_of_plane(vectors: Floats) -> Floats:
    """Return (n,) the largest sine of the angles of vectors (n, k, 3) to their plane."""
    right = decompose(vectors).right
    return max_abs(np.einsum("nki,ni->nk", vectors, right[:, -1]), axis=1)


@dataclass(frozen=True)
class RelationAt:
    """The input-output relation at one singularity.

    Attributes
    ----------
    form
        See `Relation`.
    c, d
        Its coefficients.
    residual
        By how much the rates on the curve break c y' = d q', relative to them.
    type
        What its own coefficients say: I (d = 0), II (c = 0), III (both), or None.
    conditions
        The geometric conditions that hold, the most special first.
    note
        Why `type` is not what the rates of its input and output say, or an empty string.
    """

    form: Form
    c: float
    d: float
    residual: float
    type: Type | None
    conditions: tuple[Holding, ...]
    note: str

    @property
    def agrees(self) -> bool:
        """Whether `type` is what the rates of its input and output say."""
        return not self.note


TOLD = {(True, True): Type.III, (True, False): Type.II, (False, True): Type.I}
"""The type by whether c and d vanish."""


def judged(
    relation: Relation,
    names: Sequence[str],
    rates: tuple[Floats, Floats],
    errors: Floats,
    facts: Sequence[Type],
    resting: Mapping[Pole, Bools],
) -> list[RelationAt]:
    """Return a relation at n configurations, compared with what the rates say.

    `rates` are those of its output and input, (n,) each, `errors` (n,) bounds of those of
    its axes, of which conditions may be missed by ten times as much, `facts` the types by
    the rates, and `resting` (n,) says which poles rest.
    """
    allowed = np.maximum(TOLERANCE, 10.0 * errors)
    vanishing = np.abs([relation.c, relation.d]) <= allowed
    types = [TOLD.get((c, d)) for c, d in vanishing.T.tolist()]
    told = {kind for kind in types if kind}
    held = {kind: conditions(relation, names, kind, allowed) for kind in told}
    links, other = relation.links, pole_of(*relation.output)
    sizes = np.transpose([relation.c, relation.d, relation.residual(*rates)]).tolist()
    out = []
    for k, (kind, given) in enumerate(zip(types, facts, strict=True)):
        fact = Type.III if given == Type.SELF_MOTION else given
        still = [
            f"{names[a]} and {names[b]}"
            for a, b in links.poles
            if resting[a, b][k] and (a, b) != other
        ]
        said = "" if kind == fact else _disagreement(kind, fact, links, still)
        holding = held[kind][k] if kind else ()
        c, d, gap = sizes[k]
        out.append(RelationAt(relation.form, c, d, gap, kind, holding, said))
    return out


def _disagreement(
    kind: Type | None, fact: Type, links: FourLinks, still: Sequence[str]
) -> str:
    """Return why the coefficients say something else than the rates."""
    if len(links.different) == 2:
        return "the output is the input, and c and d are constant"
    if kind == Type.III:
        cause = "the six axes of the chosen links lie in one plane"
        if still:
            cause = f"links {', '.join(still)} stand still relative to each other"
        return (
            f"c = d = 0, but the rates say type {fact}: {cause}; a relation of other links "
            "decides"
        )
    if fact == Type.III and kind is None:
        return (
            "input and output stand still together while other links move; c and d do not "
            "vanish, and y'/q' = d/c stays finite"
        )
    told = "nothing vanishes" if kind is None else f"type {kind}"
    return (
        f"c and d say: {told}; the rates: type {fact}; a coefficient nearly vanishes, or "
        "is not known well enough"
    )
