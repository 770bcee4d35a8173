"""The instantaneous input-output relation c y' = d q' from six pole axes.

Link i turns relative to r (the input), link o relative to s (the output). The pole axes of
any three links are in one plane (Aronhold and Kennedy). A triple product of three of the
six axes therefore eliminates the two rates that belong neither to the input nor to the
output.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Literal

import numpy as np

from spherekit.arrays import Floats
from spherekit.geometry.vectors import all_finite, cross, dot
from spherekit.planning.pole_plan import Pole, pole_of

LINKS_OF_AXIS = {
    "os": ("o", "s"),
    "ir": ("i", "r"),
    "io": ("i", "o"),
    "or_": ("o", "r"),
    "is_": ("i", "s"),
    "rs": ("r", "s"),
}
"""For each field of `SixPoles`, the two fields of `FourLinks` whose pole axis it has.
The pole of the output comes first, then the pole of the input."""
ONE_LINE_SINE = 1e-12
"""Axes are on one line and span no plane if the sine of the angle between any two is
smaller. Larger: more relations are not determined; smaller: a plane is determined by
rounding."""


SIGN_OF_D_FOR_DIFFERENCE = 1.0
"""Sign in the formula of d if the third rotation is output minus input; see `ThirdAxis`."""
SIGN_OF_D_FOR_SUM = -1.0
"""Sign in the formula of d if the third rotation is output plus input."""


class Type(StrEnum):
    """What rests at a singularity: the output (I), the input (II), or both.

    In a self-motion other links move while input and output rest. At type III curves of
    configurations cross, and input and output can rest.
    """

    I = "I"  # noqa: E741
    II = "II"
    III = "III"
    SELF_MOTION = "self-motion"


Form = Literal["i", "ii"]
"""Which of the two relations: the output is o relative to s (i), or to r (ii)."""


@dataclass(frozen=True)
class FourLinks:
    """Indices of the four links whose relative rotations are an input and an output.

    The input is the rotation of link i relative to r, the output the rotation of link o
    relative to s. Input and output may share one link or both links.

    Attributes
    ----------
    i, r
        The input link and its reference link.
    o, s
        The output link and its reference link.
    """

    i: int
    r: int
    o: int
    s: int

    @property
    def different(self) -> tuple[int, ...]:
        """The links of input and output (i, r, o, s), each listed once.

        i is the input link, r its reference link, o the output link, s its reference link.
        These are two, three or four links, because input and output may share links.
        """
        return tuple(dict.fromkeys((self.i, self.r, self.o, self.s)))

    def ends(self, axis: str) -> tuple[int, int]:
        """Return the indices of the two links that belong to an axis, such as "os"."""
        first, second = LINKS_OF_AXIS[axis]
        return getattr(self, first), getattr(self, second)

    @property
    def poles(self) -> list[Pole]:
        """The poles (axes of relative rotation) of any two different links, each once.

        The poles belong to the input link, the output link and their two reference
        links. The pole of the output comes first, then the pole of the input.
        """
        poles: list[Pole] = []
        # The names "os" (axis of the output), "ir" (axis of the input), and four others.
        for axis in LINKS_OF_AXIS:
            first, second = self.ends(axis)
            if first != second and pole_of(first, second) not in poles:
                poles.append(pole_of(first, second))
        return poles


@dataclass(frozen=True)
class SixPoles:
    """Unit vectors (n, 3) along the six pole axes of four links, in common axes.

    Geometric conditions of singularities compare these axes, or planes through them.

    The pole axis of two links is the axis about which they rotate relative to each other.
    The links are i, r (input and its reference), o, s (output and its reference). The field
    `os` is the axis of links o and s, and so on. `or_` and `is_` have an underscore,
    because "or" and "is" are words of Python. A vector is NaN if both of its links are the
    same link.
    """

    os: Floats
    ir: Floats
    io: Floats
    or_: Floats
    is_: Floats
    rs: Floats

    def stacked(self, axes: Sequence[str]) -> Floats:
        """Return some of the vectors as an array (n, k, 3), by their k field names."""
        return np.stack([getattr(self, axis) for axis in axes], axis=1)

    def plane(self, axes: Sequence[str]) -> tuple[Floats, Floats]:
        """Return the plane through the three pole axes of three links.

        A pole axis is the axis about which two links rotate relative to each other. The
        three pole axes of three links are always in one plane. The two axes with the
        largest sine between them determine the plane most accurately.

        Parameters
        ----------
        axes
            Names of three fields of this object, such as "os" for the axis of links o and
            s.

        Returns
        -------
        normals
            (n, 3) unit normals, NaN if the axes lie on one line.
        sine
            (n,) the largest sine of the angle between two of the axes.
        """
        vectors = self.stacked(axes)  # (n, 3 axes, 3)
        # The vector products of each axis with the next one.
        products = cross(vectors, np.roll(vectors, -1, axis=1))
        sines = np.linalg.norm(products, axis=-1)
        rows = np.arange(len(vectors))
        best_product = np.argmax(np.nan_to_num(sines), axis=1)
        sine = sines[rows, best_product]
        divisor = np.where(sine > 0.0, sine, np.nan)[:, None]
        return products[rows, best_product] / divisor, sine


def make_six_poles(links: FourLinks, pole_axis: Callable[[Pole], Floats]) -> SixPoles:
    """Return the axes of relative rotation of any two of four links.

    The links are the input link i, its reference link r, the output link o and its
    reference link s. There are six axes: the field "os", for example, has the axis about
    which link o turns relative to s. A field is NaN if both links are the same link.

    Parameters
    ----------
    links
        The four links.
    pole_axis
        Function that returns the unit vectors (n, 3) along the axis of a pole (two links).
    """
    # The axis of the input always exists, so its array shows the shape (n, 3) of all axes.
    input_axis = pole_axis(pole_of(links.i, links.r))
    no_axis = np.full_like(input_axis, np.nan)
    # By the name of the field, such as "os" for the links o and s.
    vectors = {}
    for axis in LINKS_OF_AXIS:
        first, second = links.ends(axis)
        is_one_link = first == second
        vectors[axis] = no_axis if is_one_link else pole_axis(pole_of(first, second))
    return SixPoles(**vectors)


@dataclass(frozen=True)
class Relation:
    """The relation c y' = d q' between the rates of output and input, at n configurations.

    The coefficients c and d follow from the pole axes of four links i, r, o and s alone.
    The pole axis of two links is the axis about which they rotate relative to each other.
    The relation has two forms:

    - Form "i": q' is the rate of i relative to r (input), y' the rate of o relative to
      s (output). Some of the four links may be the same link.
    - Form "ii": q' is the same, but y' is the rate of o relative to r. Here s is an
      auxiliary link, whose pole axes are used to compute c and d.

    Attributes
    ----------
    form
        "i" or "ii".
    links, poles
        The four links, and the six pole axes of any two of these links.
    output
        The links whose relative rate is y': (o, s) in form i, (o, r) in form ii.
    c, d
        (n,) coefficients, at most 1 in size. If the four links are different, both are 0
        where all axes are in one plane. If only three links are different, their three
        axes are always in one plane, and c and d are sines of angles in it. Both are NaN
        where all axes are on one line, because the plane is not unique there.
    """

    form: Form
    links: FourLinks
    poles: SixPoles
    output: tuple[int, int]
    c: Floats
    d: Floats

    def residual(self, output_rate: Floats, input_rate: Floats) -> Floats:
        """Return by how much rates violate c y' = d q', relative to their size.

        Parameters
        ----------
        output_rate, input_rate
            (n,) rates y' of the output and q' of the input, with respect to any common
            parameter.
        """
        size = np.hypot(output_rate, input_rate)
        difference = np.abs(self.c * output_rate - self.d * input_rate)
        # If both rates are zero, the relation holds, and the result is 0.
        divisor = np.where(size > 0.0, size, 1.0)
        return difference / divisor


@dataclass(frozen=True)
class ThirdAxis:
    """The third pole axis of the relation c y' = d q' between the rates of three links.

    Input and output are rotations of a moving link relative to a reference link, with the
    rates q' and y' about the pole axes u_q and u_y. If input and output share a link, there
    are three links and a third relative rotation. It has the rate r' about the axis p, and
    this rotation is the difference or the sum of the other two:

    - Difference, y' u_y - q' u_q = r' p: input and output have the same moving link, or the
      same reference link. Then c = n . (u_y x p) and d = n . (u_q x p).
    - Sum, y' u_y + q' u_q = r' p: the shared link is the moving link of one of them and the
      reference link of the other. Then c = n . (u_y x p) and d = -n . (u_q x p).

    The formulas follow from the vector product of each equation with p, which eliminates
    r', and the scalar product with n, the unit normal of the plane of all three axes.

    Attributes
    ----------
    name
        Name of the third axis among the fields of `SixPoles`, such as "io" for the pole
        axis of the links i and o.
    sign_of_d
        1 or -1, the sign in the formula of d.
    label_suffix
        End of the label of a singularity condition. The label "II.3", for example, consists
        of the type of the singularity, "II", and the suffix ".3". The suffix is the number
        of a case in R. Di Gregorio's lecture on the singularity analysis of spherical
        mechanisms:

        - ".2": input and output have the same moving link.
        - ".3": input and output have the same reference link.
        - Empty: the shared link is the moving link of one and the reference link of the
          other. The suffix is also empty for every relation of the form "ii" (see
          `Relation`).
    """

    name: str
    sign_of_d: float
    label_suffix: str


def find_third_axis(form: Form, links: FourLinks) -> ThirdAxis:
    """Return the third axis of the input-output relation if three links are different.

    The relation is c y' = d q', with the rates y' of the output and q' of the input. Its
    coefficients c and d, and the conditions for singularities, need the third axis.

    The input is the rotation of link i relative to r. The output is the rotation of link o:
    relative to s in form "i", and relative to r in form "ii". If both share a link, there
    are three different links. Any two of these rotate relative to each other about an axis.
    So there is a third axis besides those of the input and the output.

    Parameters
    ----------
    form
        Which rotation is the output: "i" or "ii".
    links
        The indices of the links i, r, o and s.
    """
    if form == "ii":
        # Input and output share the link r. The third axis is that of o and i.
        return _third_axis_of_shared_reference(links)
    # Input and output share a link: one of i and r is one of o and s. The third axis is
    # that of the other two links.
    return _third_axis_of_shared_link(links)


def _third_axis_of_shared_reference(links: FourLinks) -> ThirdAxis:
    """Return the third axis if output o and input i both rotate relative to r (form ii).

    The third axis belongs to the rotation of o relative to i, which is the difference of
    output and input. If s and i are the same link, "os" and "io" are the same axis.
    """
    name = "os" if links.s == links.i else "io"
    return ThirdAxis(name, SIGN_OF_D_FOR_DIFFERENCE, label_suffix="")


def _third_axis_of_shared_link(links: FourLinks) -> ThirdAxis:
    """Return the third axis of rotation if two of the links i, r, o, s are the same.

    The output is the rotation of o relative to s, the input the rotation of i relative
    to r. If both share a link, there are three different links. The two links that are not
    shared rotate relative to each other about the third axis. This rotation is the sum or
    the difference of output and input.

    The third axis occurs in the relation c y' = d q' between the rates y' of the output and
    q' of the input. The result has the sign of d, which `ThirdAxis` derives.

    The result also has the end of the label of a condition for a singularity, such as ".2"
    in the label "II.2". The end is the number of the case in R. Di Gregorio's lecture on
    singularities. Two cases have no number.
    """
    # The name of an axis has the letters of its two links. "or_" and "is_" have an
    # underscore, because "or" and "is" are words of Python.
    if links.i == links.s:
        # The output is o relative to i, the input is i relative to r. The sum is o relative
        # to r.
        return ThirdAxis("or_", SIGN_OF_D_FOR_SUM, label_suffix="")
    if links.o == links.r:
        # The output is r relative to s, the input is i relative to r. The sum is i relative
        # to s.
        return ThirdAxis("is_", SIGN_OF_D_FOR_SUM, label_suffix="")
    if links.o == links.i:
        # The same link, relative to s and relative to r. The difference is r relative to s.
        return ThirdAxis("rs", SIGN_OF_D_FOR_DIFFERENCE, label_suffix=".2")
    # The case r = s: o and i, both relative to r. The difference is o relative to i.
    return ThirdAxis("io", SIGN_OF_D_FOR_DIFFERENCE, label_suffix=".3")


def make_relation(
    form: Form, links: FourLinks, pole_axis: Callable[[Pole], Floats]
) -> Relation:
    """Return the relation c y' = d q' between the rates of output and input.

    Two links a and b rotate relative to each other about their pole axis, the unit vector
    u_ab. The angular velocity of a relative to b is w_ab u_ab. There are up to four links:

    - i and r, the input link and its reference. The rate of the input is q' = w_ir.
    - o and s, the output link and its reference. The rate of the output is y' = w_os in
      form i. In form ii the output is seen from r, so y' = w_or, and s is an auxiliary
      link, by whose pole axes c and d are computed. Form ii needs a link o other than r
      and i.

    Both coefficients follow from a sum of angular velocities. Its scalar product with a
    vector that is perpendicular to the other pole axes leaves only y' and q':

    - Four different links, form i: w_os u_os = w_oi u_io + w_ir u_ir + w_rs u_rs. The
      product with u_io x u_rs gives c = u_os . (u_io x u_rs) and d = u_ir . (u_io x u_rs).
    - Four different links, form ii: w_or u_or = w_os u_os + w_si u_is + w_ir u_ir. The
      product with u_os x u_is gives c = u_or . (u_os x u_is) and d = u_ir . (u_os x u_is).
      Here s can be any fourth link (Di Gregorio 2012).
    - Three links, because input and output share one. The pole axes are the axis u of the
      output, u_ir, and a third one, p. They are in one plane with the unit normal n. The
      third angular velocity is y' u - q' u_ir or y' u + q' u_ir, along p. The product with
      p x n, which is perpendicular to p, gives c = u . (p x n) and d = +-u_ir . (p x n).
      The sign is + for the difference: for example, o and i relative to the same reference.
      It is - for the sum: for example, o relative to i, and i relative to r.
    - Two links, in form i only: w_os = w_ir or w_os = -w_ir.

    Parameters
    ----------
    form, links
        The form of the relation, and the links i, r, o and s.
    pole_axis
        Function that returns the unit vectors (n, 3) along the pole axis of two links.
    """
    poles = make_six_poles(links, pole_axis)
    if form == "i":
        output_axis = poles.os
        output_name = "os"
        output_links = (links.o, links.s)
    else:
        output_axis = poles.or_
        output_name = "or_"
        output_links = (links.o, links.r)
    if len(links.different) == 2:
        # The same motion (o = i and s = r), or the reverse one (o = r and s = i).
        ones = np.ones(len(poles.ir))
        d = ones if links.o == links.i else -ones
        return Relation(form, links, poles, output_links, ones, d)
    # The vector `normal` is perpendicular to all axes but those of output and input.
    sign_of_d = 1.0
    if len(links.different) == 3:
        third_axis = find_third_axis(form, links)
        sign_of_d = third_axis.sign_of_d
        normal = _normal_to_third_axis(poles, output_name, third_axis.name)
    elif form == "i":
        normal = cross(poles.io, poles.rs)
    else:
        normal = cross(poles.os, poles.is_)
    c = dot(output_axis, normal)
    d = sign_of_d * dot(poles.ir, normal)
    return Relation(form, links, poles, output_links, c, d)


def _normal_to_third_axis(poles: SixPoles, output_name: str, third_name: str) -> Floats:
    """Return unit vectors in the plane of three axes, at right angles to the third axis.

    The axes belong to the relative rotations of three links: the output (rate y', axis
    u_y), the input (rate q', axis u_q) and a third rotation (rate r', axis p). The third
    angular velocity is the difference or the sum of the other two: y' u_y -+ q' u_q = r' p.

    A vector v of the result is perpendicular to p. The scalar product of this equation with
    v is therefore y' (u_y . v) -+ q' (u_q . v) = 0. So the caller gets the coefficients of
    the relation c y' = d q' as c = u_y . v and d = +-u_q . v.

    Parameters
    ----------
    poles
        The axes. The axis of the output, the axis of the input and the third axis are
        in one plane.
    output_name, third_name
        Field names of the axes of the output and of the third one.

    Returns
    -------
    (n, 3) unit vectors, NaN if all three axes are on one line. Along a curve of
    configurations they are continuous if the third axis is continuous.
    """
    # "ir" is the axis of the input, the rotation of link i relative to r. `sine` is the
    # largest sine of the angle between two of the axes.
    normals, sine = poles.plane((output_name, "ir", third_name))
    has_plane = sine > ONE_LINE_SINE
    normals[~has_plane] = np.nan
    third_axis = getattr(poles, third_name)
    # The normals of the plane get signs with which none is opposite to the one before. The
    # cross product of the third axis and a normal lies in the plane and is perpendicular to
    # the third axis.
    return cross(third_axis, _with_continuous_signs(normals))


def _with_continuous_signs(vectors: Floats) -> Floats:
    """Return vectors (n, 3) with signs, so that none is opposite to the row before.

    Rows with NaN are skipped: the next row is compared with the last one without NaN.
    """
    rows = np.flatnonzero(all_finite(vectors, 1))
    cosines = np.vecdot(vectors[rows[1:]], vectors[rows[:-1]])
    # Neighbours are compared before any sign is changed. So a reversal changes all later
    # rows, and the sign of a row is the product of all signs up to that row.
    signs = np.ones(len(rows))
    signs[1:] = np.where(cosines < 0.0, -1.0, 1.0)
    continuous = vectors.copy()
    continuous[rows] *= np.cumprod(signs)[:, None]
    return continuous
