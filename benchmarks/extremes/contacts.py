"""Contacts of circles that are almost alike, or that almost lose each other."""

from collections.abc import Iterator, Sequence

import mpmath as mp
import numpy as np

from benchmarks.extremes.kinematics import judged
from benchmarks.extremes.parallel import judge_reference_pose
from benchmarks.extremes.reference import DIGITS
from benchmarks.extremes.registry import Row, case, down
from benchmarks.extremes.shapes import cam, point_of
from benchmarks.samples import random_axes
from spherekit.arrays import Floats
from spherekit.mechanism.elements import Input, Pair, PoseGeometry, Profile
from spherekit.mechanism.mechanism import Mechanism

CONTACTS_FAMILY = "contacts"
FRAME_RAD = np.radians(60.0)
"""Arc (rad) between the two pivots."""

CAM_CRANK_RAD = np.radians(10.0)
ROCKER_RAD = np.radians(45.0)
"""Arcs (rad) from the pivots to the centres of the circles."""

FACE_RADIUS_RAD = np.radians(30.0)
"""Radius (rad) of a circle, unless it is the parameter."""

INPUT_RAD = 0.7
"""The input (rad) at which the mechanisms are judged."""


@case(CONTACTS_FAMILY, "difference of the radii, rad", down(1e-1, 1e-12))
def radii_almost_equal(differences: Sequence[float]) -> Iterator[Row]:
    """A circular cam inside a ring that is hardly larger, the ring on the follower.

    The centres are as far apart as the radii differ. The mechanism is given by its pose,
    since no search for modes finds a contact of two such circles.
    """
    for difference in differences:
        yield from judge_reference_pose(_cam_in_ring(difference), difference)


def _cam_in_ring(difference: float) -> Mechanism:
    """Return a cam in a ring, in a pose in which they touch at a random direction.

    `difference` is that of their radii (rad).
    """
    rng = np.random.default_rng(2)
    contact_point, random_axis, *pivots = random_axes(rng, 4)
    normal = np.cross(contact_point, random_axis)
    normal /= np.linalg.norm(normal)
    profiles = []
    for radius in (FACE_RADIUS_RAD, FACE_RADIUS_RAD + difference):
        centre = np.cos(radius) * contact_point + np.sin(radius) * normal
        profiles.append(Profile("circle", _as_vector(centre), radius))
    pairs = (
        Pair("12", "R", ("1", "2")),
        Pair("13", "R", ("1", "3")),
        Pair("23", "Cs", ("2", "3"), (profiles[0], profiles[1]), "internal"),
    )
    first_pivot, second_pivot = pivots
    geometry = PoseGeometry({"12": _as_vector(first_pivot), "13": _as_vector(second_pivot)})
    inputs = (Input("12", -1e-3, 1e-3),)
    return Mechanism("ring", "1", ("1", "2", "3"), pairs, geometry, inputs=inputs)


def _as_vector(vector: Floats) -> tuple[float, float, float]:
    """Return a vector (3,) as a tuple."""
    x, y, z = map(float, vector)
    return x, y, z


def _pivot_to_centre_arc(q: float) -> mp.mpf:
    """Return the arc (rad) from the follower's pivot to the cam's centre, in 90 digits.

    `q` is the input (rad).
    """
    with mp.workdps(DIGITS):
        frame = mp.mpf(FRAME_RAD)
        crank = mp.mpf(CAM_CRANK_RAD)
        sines = mp.sin(frame) * mp.sin(crank)
        cosine = mp.cos(frame) * mp.cos(crank) + sines * mp.cos(mp.mpf(q))
        return mp.acos(cosine)


def _judge_cam(cam_radius: float, face_radius: float, parameter: float) -> Iterator[Row]:
    """Yield the errors of a cam and a follower with these radii (rad)."""
    radii = (cam_radius, face_radius)
    mechanism = cam(FRAME_RAD, CAM_CRANK_RAD, radii, ROCKER_RAD, "external")
    reference, point = point_of(mechanism, parameter, INPUT_RAD)
    yield from judged(reference, [point])


@case(CONTACTS_FAMILY, "radius of the roller, rad", (1.0, 0.3, *down(1e-1, 1e-12)))
def roller_without_radius(radii: Sequence[float]) -> Iterator[Row]:
    """A circular cam and a follower with a roller that shrinks to a point."""
    for radius in radii:
        yield from _judge_cam(FACE_RADIUS_RAD, radius, radius)


@case(CONTACTS_FAMILY, "radius of the cam, rad", down(1e-1, 1e-12))
def cam_without_radius(radii: Sequence[float]) -> Iterator[Row]:
    """A circular cam that shrinks to a point, its centre at the same place."""
    for radius in radii:
        yield from _judge_cam(radius, FACE_RADIUS_RAD, radius)


@case(CONTACTS_FAMILY, "arc left, rad", down(1e-1, 1e-15))
def contact_almost_lost(rests: Sequence[float]) -> Iterator[Row]:
    """A cam and a follower whose circles only just reach each other at this input.

    The four-bar of pivots and centres is nearly stretched: a dead centre of the dyad that
    the contact stands for.
    """
    cam_radius = np.radians(5.0)
    for rest in rests:
        distance = float(_pivot_to_centre_arc(INPUT_RAD))
        roller_radius = distance - ROCKER_RAD - cam_radius + rest
        yield from _judge_cam(cam_radius, roller_radius, rest)
