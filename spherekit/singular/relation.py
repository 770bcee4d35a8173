"""The instantaneous input-output relation c y' = d q' from six pole axes.

Link i turns relative to r (the input), link o relative to s (the output). Of the six
poles of these four links any three that share a link lie in one plane, and a triple
product of three directions removes the two rates that are not wanted.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from spherekit.arrays import Floats
from spherekit.planning.poles import Pole, pole_of
from spherekit.sphere.paths import dot
from spherekit.sphere.rotation import all_finite, cross

AXES = ("os", "ir", "io", "or_", "is_", "rs")
"""The axes of `SixPoles` by their links: the output's and the input's first."""
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


class Form(StrEnum):
    """Which of the two relations: the output is o relative to s (i), or to r (ii)."""

    I = "i"  # noqa: E741
    II = "ii"


class LinkCount(StrEnum):
    """From how many different links a relation is made."""

    FOUR_LINKS = "four links"
    THREE_LINKS = "three links"
    SAME_POLE = "same pole"


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
        """The links, each once: three leave three poles in a plane."""
        return tuple(dict.fromkeys((self.i, self.r, self.o, self.s)))

    def ends(self, axis: str) -> tuple[int, int]:
        """Return the two links of one of `AXES`."""
        a, b = (getattr(self, letter) for letter in axis.rstrip("_"))
        return a, b

    @property
    def poles(self) -> list[Pole]:
        """The poles of the links, each once: the output's and the input's first."""
        pairs = map(self.ends, AXES)
        return list(dict.fromkeys(pole_of(a, b) for a, b in pairs if a != b))


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
        none = np.full_like(direction(links.i, links.r), np.nan)
        ends = {axis: links.ends(axis) for axis in AXES}
        return SixPoles(
            **{axis: none if a == b else direction(a, b) for axis, (a, b) in ends.items()}
        )

    def stacked(self, axes: Sequence[str]) -> Floats:
        """Return some of the vectors, (n, k, 3)."""
        return np.stack([getattr(self, axis) for axis in axes], axis=1)


@dataclass(frozen=True)
class Relation:
    """c y' = d q' at n configurations.

    Attributes
    ----------
    form, kind
        Which relation, and from how many links it is made.
    links, poles
        These links, and their poles.
    output
        The links whose relative rate is y': (o, s) in form i, (o, r) in form ii.
    c, d
        (n,), at most 1 in size; 0 where the vectors do not span what they have to.
    """

    form: Form
    kind: LinkCount
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


def form_i(links: FourLinks, poles: SixPoles) -> Relation:
    """Return c w_os = d w_ir.

    With four links c = u_rs . (u_os x u_io) and d = u_rs . (u_ir x u_io) (Di Gregorio
    2012). Where links are one, three poles lie in a plane of unit normal n, the third
    one, p, is that of neither rate, and c = n . (u_os x p), d = +-n . (u_ir x p). Where
    (o, s) is (i, r) nothing is left but y' = q' or y' = -q'.
    """
    i, r, o, s = links.i, links.r, links.o, links.s
    if {i, r} == {o, s}:
        one = np.ones(len(poles.ir))
        sign = 1.0 if o == i else -1.0
        return Relation(Form.I, LinkCount.SAME_POLE, links, poles, (o, s), one, sign * one)
    if len(links.different) == 4:
        return _made(Form.I, links, poles, cross(poles.io, poles.rs))
    third, sign = {
        r == s: ("io", 1.0),
        o == i: ("rs", 1.0),
        o == r: ("is_", -1.0),
        i == s: ("or_", -1.0),
    }[True]
    return _made(Form.I, links, poles, _across(poles, "os", third), sign)


def form_ii(links: FourLinks, poles: SixPoles) -> Relation | None:
    """Return c w_or = d w_ir, or None where o is r, or i and that is the input's rate.

    With four links c = u_or . (u_os x u_is) and d = u_ir . (u_os x u_is) (Di Gregorio
    2012); s is then any link beside the other three. With three links as in `form_i`.
    """
    if links.o in (links.r, links.i):
        return None
    if len(links.different) == 4:
        return _made(Form.II, links, poles, cross(poles.os, poles.is_))
    third = "os" if links.s == links.i else "io"
    return _made(Form.II, links, poles, _across(poles, "or_", third))


def _made(
    form: Form, links: FourLinks, poles: SixPoles, normal: Floats, sign: float = 1.0
) -> Relation:
    """Return the relation by vectors (n, 3) at right angles to both other poles."""
    kind = (LinkCount.THREE_LINKS, LinkCount.FOUR_LINKS)[len(links.different) - 3]
    output, y = {
        Form.I: ((links.o, links.s), poles.os),
        Form.II: ((links.o, links.r), poles.or_),
    }[form]
    c, d = dot(y, normal), sign * dot(poles.ir, normal)
    return Relation(form, kind, links, poles, output, c, d)


def _across(poles: SixPoles, out: str, third: str) -> Floats:
    """Return vectors (n, 3) at right angles to one of three axes, in their plane.

    The plane is spanned by the surest two of them; NaN where all three lie on one line.
    Its side is continued from row to row, so that it is continuous along a curve.
    """
    vectors = poles.stacked((out, "ir", third))
    normals, size = plane_normal(vectors)
    normals[~(size > ONE_LINE)] = np.nan
    good = np.flatnonzero(all_finite(normals, 1))
    beside = np.sum(normals[good[1:]] * normals[good[:-1]], axis=1)
    signs = np.cumprod(np.append(1.0, np.where(beside < 0.0, -1.0, 1.0)))
    normals[good] *= signs[: len(good), None]
    return cross(vectors[:, 2], normals)


def plane_normal(vectors: Floats) -> tuple[Floats, Floats]:
    """Return unit normals (n, 3) of three vectors, and the sine of the widest angle."""
    normals = cross(vectors, np.roll(vectors, -1, axis=1))
    length = np.linalg.norm(normals, axis=-1)
    widest = np.arange(len(vectors)), np.argmax(np.nan_to_num(length), axis=1)
    sine = length[widest]
    return normals[widest] / np.where(sine > 0.0, sine, 1.0)[:, None], sine
