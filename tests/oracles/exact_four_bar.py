"""The spherical four-bar of Di Gregorio (2024), Fig. 5, in as many digits as mpmath has.

The formulas are equations (14) and (22) to (26). Arcs (alpha_1, ..., alpha_4) are in rad.
Axes have components in the axes of the frame, whose z axis is the axis of pair 41. Vectors
are tuples of three numbers. With NumPy instead of mpmath, the numbers are arrays.
"""

from typing import NamedTuple

import mpmath as mp


def add(*terms):
    """Return the sum of vectors times numbers. Each term is a tuple (number, vector)."""
    return tuple(sum(k * v[axis] for k, v in terms) for axis in range(3))


def dot(a, b):
    return sum(one * other for one, other in zip(a, b, strict=True))


def cross(a, b):
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def unit(a, maths=mp):
    return add((1 / maths.sqrt(dot(a, a)), a))


class FourBar(NamedTuple):
    """One configuration of the four-bar of Di Gregorio (2024), Fig. 5.

    Attributes
    ----------
    theta
        Angle theta41 of the rocker (rad).
    u
        Unit vectors of the pair axes by their names "41", "21", "32", "43".
    frames
        Axes (i_j, j_j, k_j) of each link by its number.
    maths
        Module with `sqrt`, `sin`, ...: mpmath, or NumPy for arrays.
    """

    theta: mp.mpf
    u: dict
    frames: dict
    maths: object = mp

    def poles(self):
        """Return the secondary pole axes u31 and u42, eq. (22e).

        A pole axis is the line common to the planes of two pairs of primary axes.
        """
        u = self.u
        u31 = cross(cross(u["41"], u["43"]), cross(u["21"], u["32"]))
        u42 = cross(cross(u["21"], u["41"]), cross(u["32"], u["43"]))
        return unit(u31, self.maths), unit(u42, self.maths)

    def coefficients(self):
        """Return the axis u31, and the ratios w31/w21 and w41/w21 of angular velocities.

        u31 is the axis about which link 3 turns relative to link 1, and w31 its rate. The
        formulas are eqs. (26a) and (26b) of Di Gregorio (2024). Eq. (26a) is 0/0 at theta41
        = 0 or pi, where link 3 does not turn relative to link 2. (Eq. (5), as the paper
        prints it, has another sign. Eqs. (26a) and (26b) are right.)
        """
        u = self.u
        u31, u42 = self.poles()

        def ratio(axis, other_axis):
            """Return w / w21 of the rotation about an axis.

            Three links rotate relative to each other about u21, `axis` and `other_axis`
            with w axis = w21 u21 + w_other other_axis. The cross product with the last
            axis removes the last term. As u21, `axis` and `other_axis` lie in one plane,
            both remaining cross products are parallel to its normal. Dot products with
            this normal give numbers.
            """
            normal = cross(axis, u["21"])
            numerator = dot(normal, cross(other_axis, u["21"]))
            return numerator / dot(normal, cross(other_axis, axis))

        return u31, ratio(u31, u["32"]), ratio(u["41"], u42)

    def inertia(self, tensors):
        """Return the parts of links 2, 3 and 4 in the inertia B of the mechanism.

        B is the generalised inertia: the kinetic energy is B w21^2 / 2. The part of link j
        is (w_j / w21)^2 u_j . I_j u_j, and B is the sum of the parts. Link j rotates
        relative to the ground about the axis u_j with the angular velocity w_j, and w21 is
        that of the input link 2. u31 is the axis of link 3.

        Parameters
        ----------
        tensors
            Inertia tensor I_j (3, 3) about the centre of the sphere by number of the link,
            in the axes of the link.
        """
        u31, ratio31, ratio41 = self.coefficients()
        parts = []
        for link, ratio, axis in (
            (2, 1, self.u["21"]),
            (3, ratio31, u31),
            (4, ratio41, self.u["41"]),
        ):
            # Components of the axis u_j along the three axes of its link.
            components = [dot(axis, frame_axis) for frame_axis in self.frames[link]]
            products = [
                components[a] * mp.mpf(tensors[link][a][b]) * components[b]
                for a in range(3)
                for b in range(3)
            ]
            parts.append(ratio**2 * mp.fsum(products))
        return parts


def arcs_of(mechanism):
    """Return the arcs of links 1 to 4 (rad), exactly the float64 numbers of a mechanism."""
    return [mp.mpf(mechanism.geometry.links[link].arcs[0]) for link in "1234"]


def angle(arcs, q, p, maths=mp):
    """Return the angle theta41 of the rocker (rad), Di Gregorio (2024), equation 25.

    It solves a1 sin(theta41) + a2 cos(theta41) + a0 = 0, a quadratic equation of
    tan(theta41 / 2). The sign of the root distinguishes the two assembly modes.

    Parameters
    ----------
    arcs
        (alpha_1, ..., alpha_4), the arcs of frame, crank, coupler and rocker in rad.
    q
        Input angle theta21 (rad).
    p
        Assembly mode, 0 or 1.
    maths
        mpmath, or NumPy for arrays.
    """
    s1, s2, _, s4 = map(maths.sin, arcs)
    c1, c2, c3, c4 = map(maths.cos, arcs)
    a0 = c4 * (maths.cos(q) * s2 * s1 + c1 * c2) - c3
    a1 = maths.sin(q) * s2 * s4
    a2 = s4 * (maths.cos(q) * s2 * c1 - s1 * c2)
    root = maths.sqrt(a1**2 + a2**2 - a0**2)
    return 2 * maths.atan2(-a1 + (-1) ** p * root, a0 - a2)


def frame_of_link(first_axis, second_axis, sine):
    """Return the axes (i, j, k) of a link from its two pair axes and the sine of its arc.

    The third axis k is the first pair axis. The second pair axis is cos(arc) k +
    sin(arc) j, so that j is in the plane of both, on the side of the second one. The vector
    product of both pair axes has the length sin(arc), along -i.
    """
    i = add((1 / sine, cross(second_axis, first_axis)))
    j = cross(first_axis, i)
    return i, j, first_axis


def second_axis_of_link(frame, cosine, sine):
    """Return the second pair axis of a link from its axes (i, j, k) and its arc."""
    _, j, k = frame
    return add((cosine, k), (sine, j))


def four_bar(arcs, q, p, maths=mp):
    """Return the four-bar at an input angle, Di Gregorio (2024), equations 14 and 22.

    This is an independent reference for tests. Link 1 leads from pair axis 41 to axis 21,
    link 2 from 21 to 32, link 3 from 32 to 43, and link 4 from 43 to 41. Link 1 is fixed,
    link 2 turns about axis 21 by q, and link 4 about axis 41 by theta41.

    The axes i, j, k of a link: k is its first pair axis, and j is perpendicular to k, on
    the side of its second pair axis.

    Parameters
    ----------
    arcs
        (alpha_1, ..., alpha_4) in rad.
    q
        Input angle theta21 (rad).
    p
        Assembly mode (way to assemble the links), 0 or 1.
    maths
        mpmath, or NumPy for arrays.
    """
    sin, cos = maths.sin, maths.cos
    s1, s2, s3, s4 = map(sin, arcs)
    c1, c2, _c3, c4 = map(cos, arcs)
    theta41 = angle(arcs, q, p, maths)

    # `add` returns a sum of vectors times numbers.
    frame1 = (1, 0, 0), (0, 1, 0), (0, 0, 1)
    i1, j1, k1 = frame1
    axis41 = k1
    axis21 = second_axis_of_link(frame1, c1, s1)
    # At q = 0 the arc of link 2 leads from axis 21 towards axis 41. This direction, a unit
    # vector, and i1 are perpendicular to axis 21. q turns the direction towards i1.
    towards_axis41 = add((s1, k1), (-c1, j1))
    j2 = add((sin(q), i1), (cos(q), towards_axis41))
    frame2 = (cross(j2, axis21), j2, axis21)
    axis32 = second_axis_of_link(frame2, c2, s2)
    # At theta41 = 0 the arc of link 4 leads from axis 41 away from axis 21, along -j1.
    axis43 = add((c4, k1), (s4 * sin(theta41), i1), (-s4 * cos(theta41), j1))
    frames = {
        1: frame1,
        2: frame2,
        3: frame_of_link(axis32, axis43, s3),
        4: frame_of_link(axis43, axis41, s4),
    }
    axes = {"41": axis41, "21": axis21, "32": axis32, "43": axis43}
    return FourBar(theta41, axes, frames, maths)
