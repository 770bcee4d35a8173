"""The instantaneous input-output relation c y' = d q' from six pole axes.

Link i turns relative to r (the input), link o relative to s (the output). Of the six
poles of these four links any three that share a link lie in one plane, and a triple
product of three directions removes the two rates that are not wanted.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import final

import numpy as np

from spherekit.sphere.paths import dot
from spherekit.sphere.rotation import Floats, cross

ONE_LINE = 1e-12
"""Axes whose sines are all smaller lie on one line and span no plane."""


class Form(StrEnum):
    """Which of the two relations: the output is o relative to s (i), or to r (ii)."""

    I = "i"  # noqa: E741
    II = "ii"


class LinkCount(StrEnum):
    """From how many different links a relation is made."""

    FOUR_LINKS = "four links"
    THREE_LINKS = "three links"
    SAME_POLE = "same pole"


@final
@dataclass(frozen=True)
class FourLinks:
    """Numbers of the input link i, its reference r, the output link o, its reference s.

    i and r differ, and so do o and s; others may be the same link.
    """

    i: int
    r: int
    o: int
    s: int

    @property
    def three(self) -> bool:
        """Whether two of the links are one, so that three poles in a plane are left."""
        return len({self.i, self.r, self.o, self.s}) < 4

    def with_s(self, s: int) -> "FourLinks":
        """Return the links with another reference of the output."""
        return FourLinks(self.i, self.r, self.o, s)


@final
@dataclass(frozen=True)
class SixPoles:
    """Unit vectors (n, 3) along the poles of four links, in one set of axes.

    The vector of a pole is the same in both orders of its links, and the rate changes
    its sign: w_ab u_ab, the angular velocity of a relative to b, is -w_ba u_ab. NaN where
    the two links are one.
    """

    os: Floats
    ir: Floats
    io: Floats
    or_: Floats
    is_: Floats
    rs: Floats

    @staticmethod
    def of(links: FourLinks, direction: Callable[[int, int], Floats]) -> "SixPoles":
        """Return the six vectors from a function of two different links, (n, 3)."""
        i, r, o, s = links.i, links.r, links.o, links.s
        nothing = np.full_like(direction(i, r), np.nan)

        def along(a: int, b: int) -> Floats:
            return nothing if a == b else direction(a, b)

        return SixPoles(
            os=along(o, s),
            ir=along(i, r),
            io=along(i, o),
            or_=along(o, r),
            is_=along(i, s),
            rs=along(r, s),
        )


@final
@dataclass(frozen=True)
class Relation:
    """c y' = d q' at n configurations.

    Attributes
    ----------
    form, kind
        Which relation, and from how many links it is made.
    output
        The links whose relative rate is y': (o, s) in form i, (o, r) in form ii.
    c, d
        (n,), at most 1 in size; 0 where the vectors do not span what they have to.
    """

    form: Form
    kind: LinkCount
    output: tuple[int, int]
    c: Floats
    d: Floats

    def residual(self, output_rate: Floats, input_rate: Floats) -> Floats:
        """Return (n,) by how much rates break the relation, relative to their size."""
        size = np.hypot(output_rate, input_rate)
        gap = np.abs(self.c * output_rate - self.d * input_rate)
        return np.asarray(gap / np.where(size > 0.0, size, 1.0))


def form_i(links: FourLinks, poles: SixPoles) -> Relation:
    """Return c w_os = d w_ir.

    With four links c = u_rs . (u_os x u_io) and d = u_rs . (u_ir x u_io) (Di Gregorio
    2012). Where links are one, three poles lie in a plane of unit normal n, the third
    one, p, is that of neither rate, and c = n . (u_os x p), d = +-n . (u_ir x p). Where
    (o, s) is (i, r) nothing is left but y' = q' or y' = -q'.
    """
    output = (links.o, links.s)
    i, r, o, s = links.i, links.r, links.o, links.s
    if not links.three:
        c, d = (dot(poles.rs, cross(u, poles.io)) for u in (poles.os, poles.ir))
        return Relation(Form.I, LinkCount.FOUR_LINKS, output, c, d)
    if {i, r} == {o, s}:
        one = np.ones(len(poles.ir))
        sign = 1.0 if o == i else -1.0
        return Relation(Form.I, LinkCount.SAME_POLE, output, one, sign * one)
    third, sign = {
        r == s: ("io", 1.0),
        o == i: ("rs", 1.0),
        o == r: ("is_", -1.0),
        i == s: ("or_", -1.0),
    }[True]
    return _three_links(Form.I, output, poles, "os", third, sign)


def form_ii(links: FourLinks, poles: SixPoles) -> Relation | None:
    """Return c w_or = d w_ir, or None where o is r, or i and that is the input's rate.

    With four links c = u_or . (u_os x u_is) and d = u_ir . (u_os x u_is) (Di Gregorio
    2012); s is then any link beside the other three, `best_fourth` finds a good one. With
    three links as in `form_i`.
    """
    output = (links.o, links.r)
    if links.o in (links.r, links.i):
        return None
    if links.s == links.i:
        return _three_links(Form.II, output, poles, "or_", "os", 1.0)
    if links.s == links.r:
        return _three_links(Form.II, output, poles, "or_", "io", 1.0)
    normal = cross(poles.os, poles.is_)
    c, d = dot(poles.or_, normal), dot(poles.ir, normal)
    return Relation(Form.II, LinkCount.FOUR_LINKS, output, c, d)


def best_fourth(candidates: Mapping[int, tuple[Floats, Floats]]) -> int | None:
    """Return the link whose poles with i and o span the surest plane on a whole curve.

    Parameters
    ----------
    candidates
        For each link s the unit vectors u_os and u_is, (n, 3). The link taken has the
        greatest mean sine of their angle; NaN rows count as zero.

    None if there is no candidate.
    """
    if not candidates:
        return None
    sines = {
        link: float(np.mean(np.nan_to_num(np.linalg.norm(cross(*pair), axis=-1))))
        for link, pair in candidates.items()
    }
    return max(sines, key=lambda link: (sines[link], -link))


def _three_links(
    form: Form, output: tuple[int, int], poles: SixPoles, out: str, third: str, sign: float
) -> Relation:
    """Return the relation of three poles in a plane, the output's, the input's, a third."""
    y, q, p = getattr(poles, out), poles.ir, getattr(poles, third)
    normal = _plane_normal(y, q, p)
    c, d = dot(normal, cross(y, p)), sign * dot(normal, cross(q, p))
    return Relation(form, LinkCount.THREE_LINKS, output, c, d)


def _plane_normal(a: Floats, b: Floats, c: Floats) -> Floats:
    """Return the unit normal (n, 3) of three vectors in a plane, from the surest two.

    NaN where all three lie on one line. Its side is continued from row to row, so that it
    is continuous along a curve.
    """
    normals = np.stack([cross(a, b), cross(b, c), cross(c, a)])
    length = np.linalg.norm(normals, axis=-1)
    which = np.argmax(np.nan_to_num(length), axis=0)
    rows = np.arange(len(a))
    size = length[which, rows]
    normal = normals[which, rows] / np.where(size > ONE_LINE, size, np.nan)[:, None]
    good = np.flatnonzero(np.all(np.isfinite(normal), axis=1))
    if len(good):
        beside = np.sum(normal[good[1:]] * normal[good[:-1]], axis=1)
        signs = np.cumprod(np.append(1.0, np.where(beside < 0.0, -1.0, 1.0)))
        normal[good] *= signs[:, None]
    return np.asarray(normal)
