"""The third paper's mechanism for any arcs, and angles of its legs."""

from dataclasses import replace

import numpy as np

import spherekit as sk
from spherekit.mechanism.pair_frames import link_axes


def mid_plane_mechanism(alphas):
    """Return the shipped two-degree-of-freedom mechanism with other arcs.

    Base and end effector mirror each other in a mid-plane (Z. Chen et al., 2021, Fig. 2).
    Three legs of two links join the base (link 1) to the end effector (link 4): links 2 and
    3, 6 and 5, 8 and 7. The elbow of a leg is the axis between its two links. The further
    links 9, 10 and 11 keep the three elbows in the mid-plane; each is joined to a leg at
    the elbow. The output is the direction of axis 74, about which links 7 and 4 turn.

    Parameters
    ----------
    alphas
        (8,) arcs alpha_1 to alpha_8 (rad) of links 1 to 8, between the axes of the link.
    """
    a1, a2, a3, a4, a5, a6, a7, a8 = map(float, alphas)
    # By link: the arcs from its first axis to its further axes.
    # - Links 1 and 4 have the axes of the first, second and third leg. That of the third
    #   leg is in the middle between the other two.
    # - Links 2, 6 and 8 have the axis on the base, the elbow, and the axis of their joint
    #   with link 9, 10 or 11. This is the elbow too, so both arcs are equal.
    arcs = {
        "1": (a1, 0.5 * a1),
        "2": (a2, a2),
        "3": a3,
        "4": (a4, 0.5 * a4),
        "5": a5,
        "6": (a6, a6),
        "7": a7,
        "8": (a8, a8),
    }
    mechanism = sk.load("two_dof_spm").with_sizes(angle_unit="rad", arcs=arcs)
    (pointer,) = mechanism.outputs
    # The direction is stored in the frame of link 4, where it depends on the arcs.
    direction = tuple(link_axes(mechanism)["4"]["74"].tolist())
    return replace(mechanism, outputs=(replace(pointer, direction=direction),))


def driven_variables(form):
    return [form.legs[k][0] for k in form.plane.driven]


def fold_angles(plane, normals):
    """Return the angles (n, legs) rad between base and tip axes."""
    sine = np.abs(normals @ plane.axes.T)
    return 2.0 * np.arcsin(np.clip(sine, 0.0, 1.0))
