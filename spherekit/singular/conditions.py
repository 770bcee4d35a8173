"""Which geometric conditions hold at a singularity: axes parallel, planes coincident.

The names III.1 to III.5 and III.a to III.g are those of R. Di Gregorio's lecture on the
singularity analysis of spherical mechanisms. The conditions of types I and II have no
names there; here they are I.1 to I.3 and II.1 to II.3 in form i, I.a to I.c and II.a to
II.c in form ii, in the order in which the lecture gives them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import final

import numpy as np

from spherekit.singular.relation import Form, FourLinks, LinkCount, Relation, SixPoles
from spherekit.sphere.rotation import Floats, cross

TOLERANCE = 1e-9
"""Sines up to this are taken for zero where the error of the axes is not larger."""
UNDECIDED = 1e3
"""Conditions that miss the tolerance by less than this factor are undecided."""

Parallel = tuple[str, ...]
Plane = tuple[str, str, str]


@final
@dataclass(frozen=True)
class Condition:
    """A geometric condition on the six axes, named as in `SixPoles`.

    `parallel` are sets of axes that are parallel; `planes` are planes that coincide,
    given by three axes each; `coplanar` says that all axes lie in one plane. `rank` is
    larger for the more special ones.
    """

    label: str
    rank: int
    parallel: tuple[Parallel, ...] = ()
    planes: tuple[Plane, Plane] | None = None
    coplanar: bool = False


@final
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
    decided
        Whether the residual is within the tolerance; False where it misses it by less
        than `UNDECIDED`.
    """

    label: str
    words: str
    residual: float
    decided: bool


_IN_1: tuple[Plane, Plane] = (("ir", "is_", "rs"), ("or_", "ir", "io"))
_IN_A: tuple[Plane, Plane] = (("io", "os", "is_"), ("ir", "is_", "rs"))
_OUT: tuple[Plane, Plane] = (("or_", "os", "rs"), ("io", "os", "is_"))

FOUR_LINKS = {
    (Form.I, "I"): (
        Condition("I.2", 2, (("ir", "rs"),)),
        Condition("I.3", 2, (("ir", "io"),)),
        Condition("I.1", 1, planes=_IN_1),
    ),
    (Form.II, "I"): (
        Condition("I.b", 2, (("is_", "ir"),)),
        Condition("I.c", 2, (("is_", "os"),)),
        Condition("I.a", 1, planes=_IN_A),
    ),
    (Form.I, "II"): (
        Condition("II.2", 2, (("os", "rs"),)),
        Condition("II.3", 2, (("os", "io"),)),
        Condition("II.1", 1, planes=_OUT),
    ),
    (Form.II, "II"): (
        Condition("II.b", 2, (("os", "is_"),)),
        Condition("II.c", 2, (("os", "or_"),)),
        Condition("II.a", 1, planes=_OUT),
    ),
    (Form.I, "III"): (
        Condition("III.2", 5, (("rs", "os", "ir"),)),
        Condition("III.3", 5, (("io", "os", "ir"),)),
        Condition("III.4", 4, (("ir", "rs"), ("os", "io"))),
        Condition("III.5", 4, (("ir", "io"), ("os", "rs"))),
        Condition("III.1", 1, coplanar=True),
    ),
    (Form.II, "III"): (
        Condition("III.e", 5, (("is_", "ir", "os"),)),
        Condition("III.f", 5, (("is_", "os", "or_"),)),
        Condition("III.d", 4, (("is_", "ir"), ("os", "or_"))),
        Condition("III.b", 3, (("os", "is_"),), planes=_IN_A),
        Condition("III.c", 3, (("is_", "os"),), planes=_OUT),
        Condition("III.g", 2, (("is_", "os"),)),
        Condition("III.a", 1, coplanar=True),
    ),
}
"""The conditions of four different links, by form and type, the most special first."""


def conditions(
    relation: Relation,
    links: FourLinks,
    poles: SixPoles,
    names: Sequence[str],
    kind: str,
    errors: Floats,
) -> list[tuple[Holding, ...]]:
    """Return for each of n configurations the conditions that hold, most special first.

    Parameters
    ----------
    relation
        The relation that is singular.
    links, poles, names
        Its four links, their six poles and the names of all links of the mechanism.
    kind
        Type of the singularity: ``I``, ``II`` or ``III``.
    errors
        (n,) bounds of the errors of the directions (rad); a condition may be missed by
        ten times as much.
    """
    allowed = np.maximum(TOLERANCE, 10.0 * errors)
    wanted = _conditions_of(relation, links, kind)
    rows: list[list[Holding]] = [[] for _ in range(len(errors))]
    for condition in wanted:
        residual = _residual(condition, poles)
        words = _words(condition, links, names)
        for row in np.flatnonzero(residual <= UNDECIDED * allowed):
            size = float(residual[row])
            holding = Holding(condition.label, words, size, bool(size <= allowed[row]))
            rows[row].append(holding)
    return [_decided_first(row) for row in rows]


def _decided_first(holdings: list[Holding]) -> tuple[Holding, ...]:
    return tuple(sorted(holdings, key=lambda holding: not holding.decided))


def _conditions_of(
    relation: Relation, links: FourLinks, kind: str
) -> tuple[Condition, ...]:
    """Return the conditions of a relation; with three links those of three axes.

    Three axes in a plane leave one condition for each type. With r = s or o = i it is one
    of the lecture's; the others are called by the type alone.
    """
    if relation.kind == LinkCount.FOUR_LINKS:
        return FOUR_LINKS[relation.form, kind]
    if relation.kind == LinkCount.SAME_POLE or not kind:
        return ()
    if relation.form == Form.II:
        out, third, number = "or_", "os" if links.s == links.i else "io", ""
    else:
        out = "os"
        third, number = {
            links.r == links.s: ("io", ".3"),
            links.o == links.i: ("rs", ".2"),
            links.o == links.r: ("is_", ""),
            links.i == links.s: ("or_", ""),
        }[True]
    axes = {"I": ("ir", third), "II": (out, third), "III": (third, out, "ir")}[kind]
    return (Condition(kind + number, 2, (axes,)),)


def _residual(condition: Condition, poles: SixPoles) -> Floats:
    """Return (n,) the largest sine of the angles between what should coincide.

    NaN where an axis is not known.
    """
    parts = []
    for axes in condition.parallel:
        for k, one in enumerate(axes):
            for other in axes[k + 1 :]:
                turn = cross(getattr(poles, one), getattr(poles, other))
                parts.append(np.linalg.norm(turn, axis=-1))
    if condition.planes is not None:
        first, second = condition.planes
        parts.append(_between(_stacked(poles, first), _stacked(poles, second)))
    if condition.coplanar:
        parts.append(_out_of_plane(_stacked(poles, [f.name for f in fields(poles)])))
    return np.asarray(np.max(np.stack(parts), axis=0))


def _stacked(poles: SixPoles, axes: Sequence[str]) -> Floats:
    return np.stack([getattr(poles, axis) for axis in axes], axis=1)


def _between(first: Floats, second: Floats) -> Floats:
    """Return (n,) the sine of the angle between the planes of vectors (n, 3, 3).

    Where one set is parallel it has no plane, and the planes coincide if one plane holds
    all vectors.
    """
    one, sure = _normal(first)
    other, also = _normal(second)
    sine = np.linalg.norm(cross(one, other), axis=-1)
    both = np.concatenate([first, second], axis=1)
    parallel = np.minimum(sure, also) < TOLERANCE
    return np.asarray(np.where(parallel, _out_of_plane(both), sine))


def _normal(vectors: Floats) -> tuple[Floats, Floats]:
    """Return unit normals (n, 3) of three vectors, and the sine of the widest angle."""
    normals = np.asarray(cross(vectors, np.roll(vectors, -1, axis=1)))
    length = np.linalg.norm(normals, axis=-1)
    which = np.argmax(length, axis=1)
    rows = np.arange(len(vectors))
    sine = length[rows, which]
    return normals[rows, which] / np.where(sine > 0.0, sine, 1.0)[:, None], sine


def _out_of_plane(vectors: Floats) -> Floats:
    """Return (n,) the largest sine of the angles of vectors (n, k, 3) to their plane."""
    out = np.full(len(vectors), np.nan)
    finite = np.all(np.isfinite(vectors), axis=(1, 2))
    _, _, right = np.linalg.svd(vectors[finite])
    away = np.einsum("nki,ni->nk", vectors[finite], right[:, -1])
    out[finite] = np.max(np.abs(away), axis=1)
    return out


def _words(condition: Condition, links: FourLinks, names: Sequence[str]) -> str:
    def axis(of: str) -> str:
        a, b = (getattr(links, letter) for letter in of.rstrip("_"))
        return f"{names[a]}/{names[b]}"

    def listed(axes: Sequence[str]) -> str:
        return ", ".join(axis(of) for of in axes[:-1]) + " and " + axis(axes[-1])

    parts = [f"the axes {listed(axes)} are parallel" for axes in condition.parallel]
    if condition.planes is not None:
        first, second = (" ".join(axis(of) for of in axes) for axes in condition.planes)
        parts.insert(0, f"the planes of the axes ({first}) and ({second}) coincide")
    if condition.coplanar:
        parts.append("all six axes lie in one plane")
    return " and ".join(parts)
