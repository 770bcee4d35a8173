"""The spherical four-bar of Di Gregorio (2024), Fig. 5, in as many digits as mpmath has.

Arcs (alpha_1, ..., alpha_4) in rad, axes in the frame's, z along the axis of pair 41;
equations (14), (22) to (26). Vectors are tuples of three numbers. With NumPy instead of
mpmath the numbers are arrays; see closed_forms.py.
"""

from typing import NamedTuple

import mpmath as mp


def add(*terms):
    """Return the sum of vectors times numbers, given as (number, vector)."""
    return tuple(sum(k * v[axis] for k, v in terms) for axis in range(3))


def dot(a, b):
    return sum(one * other for one, other in zip(a, b, strict=True))


def cross(a, b):
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def unit(a, maths=mp):
    return add((1 / maths.sqrt(dot(a, a)), a))


class FourBar(NamedTuple):
    """One configuration: theta41, the axes u by names, and the frames of the links."""

    theta: mp.mpf
    u: dict
    frames: dict
    maths: object = mp

    def poles(self):
        """Return the secondary pole axes 31 and 42, eq. (22e)."""
        u, x = self.u, cross
        u31 = unit(x(x(u["41"], u["43"]), x(u["21"], u["32"])), self.maths)
        return u31, unit(x(x(u["21"], u["41"]), x(u["32"], u["43"])), self.maths)

    def coefficients(self):
        """Return the axis u31, and w31 and w41 over w21, eqs. (26a), (26b).

        Eq. (26a) is 0/0 where link 3 does not turn relative to link 2, at theta41 = 0 or
        pi, although the limit is finite. (Eq. (5) as printed differs in sign from (26a),
        (26b), which hold.)
        """
        u, x = self.u, cross
        u31, u42 = self.poles()

        def ratio(j1, j2):
            side = x(j1, u["21"])
            return dot(side, x(j2, u["21"])) / dot(side, x(j2, j1))

        return u31, ratio(u31, u["32"]), ratio(u["41"], u42)

    def inertia(self, tensors):
        """Return what each link adds to the equivalent inertia, tensors by numbers."""
        u31, w31, w41 = self.coefficients()
        found = []
        for j, w, u in ((2, 1, self.u["21"]), (3, w31, u31), (4, w41, self.u["41"])):
            along = [dot(u, axis) for axis in self.frames[j]]
            parts = [
                along[a] * mp.mpf(tensors[j][a][b]) * along[b]
                for a in range(3)
                for b in range(3)
            ]
            found.append(w**2 * mp.fsum(parts))
        return found


def arcs_of(made):
    """The arcs of a four-bar's links, as the float64 numbers they are."""
    return [mp.mpf(made.geometry.links[link].arcs[0]) for link in "1234"]


def angle(arcs, q, p, maths=mp):
    """Return theta41 by eq. (25), p 0 or 1."""
    (s1, s2, _, s4), (c1, c2, c3, c4) = map(maths.sin, arcs), map(maths.cos, arcs)
    a0 = c4 * (maths.cos(q) * s2 * s1 + c1 * c2) - c3
    a1 = maths.sin(q) * s2 * s4
    a2 = s4 * (maths.cos(q) * s2 * c1 - s1 * c2)
    root = maths.sqrt(a1**2 + a2**2 - a0**2)
    return 2 * maths.atan2(-a1 + (-1) ** p * root, a0 - a2)


def four_bar(arcs, q, p, maths=mp):
    """Return the four-bar at an input; link j lies from k_j towards j_j."""
    sin, cos = maths.sin, maths.cos
    (s1, s2, s3, s4), (c1, c2, _, c4) = map(sin, arcs), map(cos, arcs)
    theta = angle(arcs, q, p, maths)
    i1, j1, k1 = (1, 0, 0), (0, 1, 0), (0, 0, 1)
    k2 = add((s1, j1), (c1, k1))
    j2 = add((sin(q), i1), (cos(q) * s1, k1), (-cos(q) * c1, j1))
    k3 = add((c2, k2), (s2, j2))
    k4 = add((c4, k1), (s4 * sin(theta), i1), (-s4 * cos(theta), j1))
    i3, i4 = add((1 / s3, cross(k4, k3))), add((1 / s4, cross(k1, k4)))
    frames = {
        1: (i1, j1, k1),
        2: (cross(j2, k2), j2, k2),
        3: (i3, cross(k3, i3), k3),
        4: (i4, cross(k4, i4), k4),
    }
    return FourBar(theta, {"41": k1, "21": k2, "32": k3, "43": k4}, frames, maths)
