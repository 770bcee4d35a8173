"""Places on a curve where relative rates vanish, put together where they agree."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import EPS, Status
from spherekit.motion.arc_curve import ArcCurve
from spherekit.planning.poles import Pole, pole_of
from spherekit.singular.along import AlongCurve
from spherekit.singular.relation import Type
from spherekit.sphere.rotation import Floats

BESIDE = 100.0
"""Places nearer than this times their error bounds, but not within, are undecided."""
WIDE = 1e-9
"""Places with a larger error bound (rad) are not told apart, nor said to agree."""


@final
@dataclass(frozen=True)
class Roots:
    """Zeros at s (k,), whether each is double, and bounds of the errors of s."""

    s: Floats
    double: NDArray[np.bool_]
    error: Floats


@final
@dataclass(frozen=True)
class CommonRoots:
    """Zeros of several poles that are one place; None stands for the coplanarity.

    `members` says of which, and whether it is a double one; `spread` (rad) is by how much
    they miss each other.
    """

    s: float
    error: float
    spread: float
    members: dict[Pole | None, bool]


def rate_between(
    along: AlongCurve, links: tuple[int, int], s: Floats
) -> tuple[Floats, Floats]:
    """Return the rate of a link relative to another at s, and its slope, (n,)."""
    w, dw, _ = along.signed(pole_of(*links), s)
    sign = 1.0 if links[0] > links[1] else -1.0
    return sign * w, sign * dw


def located(along: AlongCurve, pole: Pole) -> Roots | None:
    """Return all zeros of the rate of a pole, None if its links move as one."""
    if along.rests(pole):
        return None
    curve, roots = along.curve, along.zeros(pole)
    s = roots.places
    if not len(s):
        return Roots(s, roots.double, s)
    _, slope, rounding = along.signed(pole, s)
    error = place_error(curve, rounding, slope)
    touched = roots.double
    if np.any(touched):
        step = 1e-3 * curve.length
        beside = s[touched] + step
        if not curve.closed:
            beside = np.where(beside > curve.length, beside - 2.0 * step, beside)
        bend = np.maximum(np.abs(along.signed(pole, beside)[1] / step), EPS)
        error[touched] = np.minimum(np.sqrt(2.0 * rounding[touched] / bend), curve.length)
    inside = np.ones(len(s), dtype=bool)
    for why, way in zip(curve.ends, (s, curve.length - s), strict=True):
        if why == Status.AT_SINGULARITY:  # the zero may be that of the crossing
            inside &= way > 4.0 * error
    return Roots(s[inside], touched[inside], error[inside])


def place_error(curve: ArcCurve, error: Floats, slope: Floats) -> Floats:
    """Return bounds (n,) of the errors of simple zeros."""
    steep = np.maximum(np.abs(slope), EPS)
    return np.minimum(error / steep + 16.0 * EPS * curve.length, curve.length)


def groups_of(
    curve: ArcCurve, zeros: Sequence[tuple[Pole | None, Roots]]
) -> list[CommonRoots]:
    """Return zeros put together where they agree within their error bounds."""
    every: list[tuple[float, float, Pole | None, bool]] = []
    for pole, roots in zeros:
        start = curve.closed & (curve.length - roots.s <= 2.0 * roots.error)
        places = np.where(start, roots.s - curve.length, roots.s), roots.error, roots.double
        rows = zip(*(array.tolist() for array in places), strict=True)
        every += [(s, error, pole, double) for s, error, double in rows]
    every.sort(key=lambda root: root[0])
    groups: list[list[tuple[float, float, Pole | None, bool]]] = []
    for root in every:
        if groups and root[0] - groups[-1][-1][0] <= root[1] + groups[-1][-1][1]:
            groups[-1].append(root)
        else:
            groups.append([root])
    out = []
    for group in groups:
        s, error, *_ = min(group, key=lambda root: root[1])
        spread = group[-1][0] - group[0][0]
        members = {pole: double for _, _, pole, double in group}
        out.append(CommonRoots(max(s, 0.0), max(error, spread), spread, members))
    return out


def type_of(resting: Iterable[Pole | None], driven: Pole, wanted: Pole) -> Type:
    """Return the type by which of an input's and an output's poles rest."""
    rest = set(resting)
    return {
        (True, True): Type.SELF_MOTION,
        (True, False): Type.II,
        (False, True): Type.I,
        (False, False): Type.APPARENT,
    }[driven in rest, wanted in rest]


def doubts(groups: list[CommonRoots], kinds: list[Type], different: bool) -> list[str]:
    """Return for each group why its type is not certain, or an empty string."""
    notes = [""] * len(groups)
    for k, (group, kind) in enumerate(zip(groups, kinds, strict=True)):
        if different and kind == Type.SELF_MOTION and group.error > WIDE:
            notes[k] = (
                f"undecided within tolerance: input and output vanish {group.spread:.3g} "
                f"rad apart, and the places are known to {group.error:.3g} rad"
            )
    for k, (one, other) in enumerate(pairwise(groups)):
        gap, uncertainty = other.s - one.s, one.error + other.error
        both = {kinds[k], kinds[k + 1]}
        if Type.APPARENT not in both and len(both) == 2 and gap < BESIDE * uncertainty:
            notes[k] = notes[k + 1] = (
                f"undecided within tolerance: input and output vanish {gap:.3g} rad "
                f"apart, and the places are known to {uncertainty:.3g} rad"
            )
    return notes
