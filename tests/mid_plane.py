"""The third paper's mechanism for any arcs, and Jacobians of its closed form."""

from dataclasses import replace

import numpy as np

import spherekit as sk
from spherekit.model.gears import link_axes
from spherekit.sphere.rotation import cross, mirror_angles, normals_of


def mid_plane_mechanism(alphas):
    """Return the mechanism with the arcs alpha_1 to alpha_8 (rad) of Fig. 2."""
    a1, a2, a3, a4, a5, a6, a7, a8 = map(float, alphas)
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
    made = sk.load("two_dof_spm").with_sizes(angle_unit="rad", arcs=arcs)
    (pointer,) = made.outputs
    direction = tuple(link_axes(made)["4"]["74"].tolist())
    return replace(made, outputs=(replace(pointer, direction=direction),))


def driven_variables(form):
    return [form.legs[k].base for k in form.plane.driven]


def folds_of(plane, normals):
    """Return the angles (n, legs) rad between base and tip axes."""
    sine = np.abs(normals @ plane.axes.T)
    return 2.0 * np.arcsin(np.clip(sine, 0.0, 1.0))


def slopes(plane, normals, modes):
    """Return the derivatives (n, 2, 3) of the normals by each driven reading.

    The normal stays a unit vector across both driven elbows.
    """
    elbows, root = plane.elbows(normals, modes)
    driven = list(plane.driven)
    first, second = elbows[:, driven[0]], elbows[:, driven[1]]
    volume = np.sum(cross(first, second) * normals, axis=1)
    pushed = -plane.senses[driven] * root[:, driven] / volume[:, None]
    ways = np.stack([cross(second, normals), cross(normals, first)], axis=1)
    return pushed[..., None] * ways


def forward_jacobian(plane, normals, modes):
    """Return d(phi, gamma) / d(driven readings), (n, 2, 2)."""
    moved, half = slopes(plane, normals, modes), mirror_angles(normals)
    turned = -2.0 * moved[..., 0] / np.cos(0.5 * half.phi)[:, None]
    tilted = 2.0 * moved[..., 1] / np.cos(0.5 * half.gamma)[:, None]
    return np.stack([turned, tilted], axis=1)


def rates_at_base(plane, normals, slopes, modes):
    """Return the derivatives (n, legs) of the readings: elbow . n = 0 differentiated."""
    elbows, root = plane.elbows(normals, modes)
    return -plane.senses * np.einsum("nlk,nk->nl", elbows, slopes) / root


def inverse_jacobian(plane, phi, gamma, modes):
    """Return d(driven readings) / d(phi, gamma), (n, 2, 2), at angles (n,) rad.

    The paper's eq. (23) is the same for omega instead of gamma.
    """
    normals = normals_of(phi, gamma)
    x, y, z = normals.T
    turn_x, turn_y = -0.5 * np.cos(0.5 * phi), 0.5 * np.cos(0.5 * gamma)
    columns = []
    for slope in (
        np.stack([turn_x, 0.0 * x, -x * turn_x / z], axis=1),
        np.stack([0.0 * x, turn_y, -y * turn_y / z], axis=1),
    ):
        first = rates_at_base(plane, normals, slope, modes)
        columns.append(first[:, list(plane.driven)])
    return np.stack(columns, axis=2)
