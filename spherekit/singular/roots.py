"""Places on a curve where relative rates vanish, put together where they agree."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import EPS, Status
from spherekit.motion.arc_curve import ArcCurve
from spherekit.planning.poles import Pole, pole_of
from spherekit.singular.along import AlongCurve
from spherekit.singular.record import Type
from spherekit.singular.relation import FourLinks
from spherekit.sphere.rotation import Floats


@final
@dataclass(frozen=True)
class Roots:
    """Zeros at s (k,), whether each is double, and bounds of the errors of s.

    `always` says that the links move as one on the whole curve; then there are no others.
    """

    s: Floats
    double: NDArray[np.bool_]
    error: Floats
    always: bool = False


@final
@dataclass(frozen=True)
class CommonRoots:
    """Zeros of several poles that are one place; None stands for the coplanarity."""

    s: float
    error: float
    spread: float
    members: dict[Pole | None, bool]

    def double(self, pole: Pole) -> bool | None:
        """Return whether the rate of a pole has a double zero, None if it has none."""
        return self.members.get(pole)

    def kind(self, driven: Pole, wanted: Pole) -> Type:
        """Return the type for an input and an output."""
        still, resting = driven in self.members, wanted in self.members
        if still:
            return Type.SELF_MOTION if resting else Type.II
        return Type.I if resting else Type.APPARENT

    def resting(self, links: FourLinks) -> list[tuple[int, int]]:
        """Return the pairs of four links that stand still relative to each other."""
        return [pole for pole in poles_of(links) if pole in self.members]


def poles_of(links: FourLinks) -> list[Pole]:
    """Return the poles of four links, each once: the output's and the input's first."""
    i, r, o, s = links.i, links.r, links.o, links.s
    pairs = [(o, s), (i, r), (i, o), (o, r), (i, s), (r, s)]
    return list(dict.fromkeys(pole_of(a, b) for a, b in pairs if a != b))


def located(along: AlongCurve, pole: Pole) -> Roots:
    """Return all zeros of the rate of a pole with bounds of their errors."""
    if along.rests(pole):
        return Roots(np.zeros(0), np.zeros(0, dtype=bool), np.zeros(0), True)
    roots = along.zeros(pole)
    s = roots.places
    if not len(s):
        return Roots(s, roots.double, s)
    rate = along.signed(pole, s)
    error = place_error(along.curve, rate.error, rate.dw)
    if np.any(roots.double):
        step = 1e-3 * along.curve.length
        beside = s[roots.double] + step
        if not along.curve.closed:
            beside = np.where(beside > along.curve.length, beside - 2.0 * step, beside)
        bend = along.signed(pole, beside).dw / step
        touched = np.sqrt(2.0 * rate.error[roots.double] / np.maximum(np.abs(bend), EPS))
        error[roots.double] = np.minimum(touched, along.curve.length)
    inside = _inside(along.curve, s, error)
    return Roots(s[inside], roots.double[inside], error[inside])


def _inside(curve: ArcCurve, s: Floats, error: Floats) -> NDArray[np.bool_]:
    """Return which places (n,) are not those of a crossing of curves at an end."""
    inside = np.ones(len(s), dtype=bool)
    for why, way in zip(curve.ends, (s, curve.length - s), strict=True):
        if why == Status.AT_SINGULARITY:
            inside &= way > 4.0 * error
    return inside


def place_error(curve: ArcCurve, error: Floats, slope: Floats) -> Floats:
    """Return bounds (n,) of the errors of simple zeros."""
    steep = np.maximum(np.abs(slope), EPS)
    return np.asarray(np.minimum(error / steep + 16.0 * EPS * curve.length, curve.length))


def groups_of(
    curve: ArcCurve, zeros: Sequence[tuple[Pole | None, Roots]]
) -> list[CommonRoots]:
    """Return zeros put together where they agree within their error bounds."""
    every = [
        (float(s), float(error), pole, bool(double))
        for pole, places in zeros
        for s, error, double in zip(places.s, places.error, places.double, strict=True)
    ]
    if curve.closed:
        every = [
            (
                s - curve.length if curve.length - s <= 2.0 * error else s,
                error,
                pole,
                double,
            )
            for s, error, pole, double in every
        ]
    every.sort(key=lambda entry: entry[0])
    groups: list[list[tuple[float, float, Pole | None, bool]]] = []
    for root in every:
        if groups and root[0] - groups[-1][-1][0] <= root[1] + groups[-1][-1][1]:
            groups[-1].append(root)
        else:
            groups.append([root])
    out = []
    for group in groups:
        best = min(group, key=lambda entry: entry[1])
        place = max(best[0], 0.0)
        spread = group[-1][0] - group[0][0]
        members = {pole: double for _, _, pole, double in group}
        out.append(CommonRoots(place, max(best[1], spread), spread, members))
    return out
