"""The instantaneous input-output relation c y' = d q' from six pole axes.

Link i turns relative to r (the input), link o relative to s (the output). Of the six
poles of these four links any three that share a link lie in one plane, and a triple
product of three directions removes the two rates that are not wanted.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Literal

import numpy as np

from spherekit.arrays import Floats
from spherekit.geometry.vectors import all_finite, cross, dot
from spherekit.planning.pole_plan import Pole, pole_of

AXES = ("os", "ir", "io", "or_", "is_", "rs")
"""The axes of `SixPoles` in order, by their links: the output's and the input's first."""
ONE_LINE = 1e-12
"""Axes whose sines are all smaller lie on one line and span no plane."""


class Type(StrEnum):
    """What vanishes: the output (I), the input (II), or both.

    Both in a self-motion, in which other links move; III where curves cross.
    """

    I = "I"  # noqa: E741
    II = "II"
    III = "III"
    SELF_MOTION = "self-motion"


Form = Literal["i", "ii"]
"""Which of the two relations: the output is o relative to s (i), or to r (ii)."""


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
    def different(self) -> tuple[int, ...]:
        """The links, each once: three have three poles in a plane, two one pole."""
        return tuple(dict.fromkeys((self.i, self.r, self.o, self.s)))

    def ends(self, axis: str) -> tuple[int, int]:
        """Return the two links of one of `AXES`."""
        a, b = (getattr(self, letter) for letter in axis.rstrip("_"))
        return a, b

    @property
    def poles(self) -> list[Pole]:
        """The poles of the links, each once: the output's and the input's first."""
        return list(dict.fromkeys(pole_of(a, b) for a, b in map(self.ends, AXES) if a != b))


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
    def of(links: FourLinks, direction: Callable[[Pole], Floats]) -> "SixPoles":
        """Return the six vectors from a function of poles, (n, 3)."""
        none = np.full_like(direction(pole_of(links.i, links.r)), np.nan)
        ends = map(links.ends, AXES)
        return SixPoles(*(none if a == b else direction(pole_of(a, b)) for a, b in ends))

    def stacked(self, axes: Sequence[str]) -> Floats:
        """Return some of the vectors, (n, k, 3)."""
        return np.stack([getattr(self, axis) for axis in axes], axis=1)

    def plane(self, axes: Sequence[str]) -> tuple[Floats, Floats]:
        """Return unit normals (n, 3) of three axes, and the sine of their widest angle.

        NaN where they are one line.
        """
        vectors = self.stacked(axes)
        normals = cross(vectors, np.roll(vectors, -1, axis=1))
        length = np.linalg.norm(normals, axis=-1)
        widest = np.arange(len(vectors)), np.argmax(np.nan_to_num(length), axis=1)
        sine = length[widest]
        return normals[widest] / np.where(sine > 0.0, sine, np.nan)[:, None], sine


@dataclass(frozen=True)
class Relation:
    """c y' = d q' at n configurations.

    Attributes
    ----------
    form
        Which relation.
    links, poles
        The links from which it is made, and their poles.
    output
        The links whose relative rate is y': (o, s) in form i, (o, r) in form ii.
    c, d
        (n,), at most 1 in size; 0 where the vectors do not span what they have to.
    """

    form: Form
    links: FourLinks
    poles: SixPoles
    output: tuple[int, int]
    c: Floats
    d: Floats

    def residual(self, output_rate: Floats, input_rate: Floats) -> Floats:
        """Return (n,) by how much rates break the relation, relative to their size."""
        size = np.hypot(output_rate, input_rate)
        gap = np.abs(self.c * output_rate - self.d * input_rate)
        return gap / np.where(size > 0.0, size, 1.0)


def third_axis(form: Form, links: FourLinks) -> tuple[str, float, str]:
    """Return of three links the axis that is that of neither rate.

    With it the sign of d, and what the lecture's names of its conditions end with.
    """
    if form == "ii":
        return "os" if links.s == links.i else "io", 1.0, ""
    return {
        links.r == links.s: ("io", 1.0, ".3"),
        links.o == links.i: ("rs", 1.0, ".2"),
        links.o == links.r: ("is_", -1.0, ""),
        links.i == links.s: ("or_", -1.0, ""),
    }[True]


def relation_of(
    form: Form, links: FourLinks, direction: Callable[[Pole], Floats]
) -> Relation:
    """Return c w_os = d w_ir (form i) or c w_or = d w_ir (form ii), from axes of poles.

    With four links c = u_rs . (u_os x u_io) and d = u_rs . (u_ir x u_io), in form ii
    c = u_or . (u_os x u_is) and d = u_ir . (u_os x u_is) with any link beside the other
    three for s (Di Gregorio 2012). Where links are one, three poles lie in a plane of unit
    normal n, the third one, p, is that of neither rate, u that of the output, and
    c = n . (u x p), d = +-n . (u_ir x p). Where (o, s) is (i, r) nothing is left but
    y' = q' or y' = -q'. There is no form ii where o is r or i.
    """
    i, o = links.i, links.o
    poles = SixPoles.of(links, direction)
    out, reference = ("os", links.s) if form == "i" else ("or_", links.r)
    sign = 1.0
    if len(links.different) == 2:
        one = np.ones(len(poles.ir))
        return Relation(form, links, poles, (o, links.s), one, one if o == i else -one)
    if len(links.different) == 4:
        normal = cross(*((poles.io, poles.rs) if form == "i" else (poles.os, poles.is_)))
    else:
        third, sign, _ = third_axis(form, links)
        normal = _across(poles, out, third)
    c = dot(getattr(poles, out), normal)
    return Relation(form, links, poles, (o, reference), c, sign * dot(poles.ir, normal))


def _across(poles: SixPoles, out: str, third: str) -> Floats:
    """Return vectors (n, 3) at right angles to one of three axes, in their plane.

    The plane is spanned by the surest two of them; NaN where all three lie on one line.
    Its side is continued from row to row, so that it is continuous along a curve.
    """
    normals, size = poles.plane((out, "ir", third))
    normals[~(size > ONE_LINE)] = np.nan
    good = np.flatnonzero(all_finite(normals, 1))
    beside = np.vecdot(normals[good[1:]], normals[good[:-1]])
    signs = np.cumprod(np.append(1.0, np.where(beside < 0.0, -1.0, 1.0)))
    normals[good] *= signs[: len(good), None]
    return cross(getattr(poles, third), normals)
