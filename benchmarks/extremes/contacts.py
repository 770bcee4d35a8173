"""Contacts of circles that are almost alike, or that almost lose each other."""

from collections.abc import Iterator, Sequence

import mpmath as mp
import numpy as np

from benchmarks.extremes.kinematics import judged
from benchmarks.extremes.parallel import at_pose
from benchmarks.extremes.reference import DIGITS
from benchmarks.extremes.registry import Row, case, down
from benchmarks.extremes.shapes import cam, point_of
from benchmarks.samples import random_axes
from spherekit.mechanism.elements import Input, Pair, PoseGeometry, Profile
from spherekit.mechanism.mechanism import Mechanism

FAMILY = "contacts"
FRAME, ROCKER = np.radians(60.0), np.radians(45.0)
FACE = np.radians(30.0)


@case(FAMILY, "difference of the radii, rad", down(1e-1, 1e-12))
def radii_almost_equal(differences: Sequence[float]) -> Iterator[Row]:
    """A circular cam inside a ring that is hardly larger, the ring on the follower.

    The centres are as far apart as the radii differ. The mechanism is given by its pose,
    since no search for modes finds a contact of two such circles.
    """
    for difference in differences:
        yield from at_pose(_ring(difference), difference)


def _ring(difference: float) -> Mechanism:
    """Return the cam and ring in a pose in which they touch at random directions."""
    random = np.random.default_rng(2)
    point, across, *axes = random_axes(random, 4)
    across = np.cross(point, across)
    across /= np.linalg.norm(across)
    centres = [
        tuple(map(float, np.cos(radius) * point + np.sin(radius) * across))
        for radius in (FACE, FACE + difference)
    ]
    profiles = (
        Profile("circle", centres[0], FACE),  # type: ignore[arg-type]
        Profile("circle", centres[1], FACE + difference),  # type: ignore[arg-type]
    )
    pairs = (
        Pair("12", "R", ("1", "2")),
        Pair("13", "R", ("1", "3")),
        Pair("23", "Cs", ("2", "3"), profiles, "internal"),
    )
    given = {
        name: tuple(map(float, axis)) for name, axis in zip(("12", "13"), axes, strict=True)
    }
    geometry = PoseGeometry(given)  # type: ignore[arg-type]
    inputs = (Input("12", -1e-3, 1e-3),)
    return Mechanism("ring", "1", ("1", "2", "3"), pairs, geometry, inputs=inputs)


def _gap(frame: float, crank: float, q: float) -> mp.mpf:
    """Return the arc from the follower's pivot to the cam's centre."""
    with mp.workdps(DIGITS):
        f, c = mp.mpf(frame), mp.mpf(crank)
        cosine = mp.cos(f) * mp.cos(c) + mp.sin(f) * mp.sin(c) * mp.cos(mp.mpf(q))
        return mp.acos(cosine)


@case(FAMILY, "radius of the roller, rad", (1.0, 0.3, *down(1e-1, 1e-12)))
def roller_without_radius(radii: Sequence[float]) -> Iterator[Row]:
    """A circular cam and a follower with a roller that shrinks to a point."""
    for radius in radii:
        made = cam(FRAME, np.radians(10.0), (FACE, radius), ROCKER, "external")
        reference, point = point_of(made, radius, 0.7)
        yield from judged(reference, [point])


@case(FAMILY, "radius of the cam, rad", down(1e-1, 1e-12))
def cam_without_radius(radii: Sequence[float]) -> Iterator[Row]:
    """A circular cam that shrinks to a point, its centre at the same place."""
    for radius in radii:
        made = cam(FRAME, np.radians(10.0), (radius, FACE), ROCKER, "external")
        reference, point = point_of(made, radius, 0.7)
        yield from judged(reference, [point])


@case(FAMILY, "arc left, rad", down(1e-1, 1e-15))
def contact_almost_lost(rests: Sequence[float]) -> Iterator[Row]:
    """A cam and a follower whose circles only just reach each other at this input.

    The four-bar of pivots and centres is nearly stretched: a dead centre of the dyad that
    the contact stands for.
    """
    crank = np.radians(10.0)
    for rest in rests:
        face = np.radians(5.0)
        roller = float(_gap(FRAME, crank, 0.7)) - ROCKER - face + rest
        made = cam(FRAME, crank, (face, roller), ROCKER, "external")
        reference, point = point_of(made, rest, 0.7)
        yield from judged(reference, [point])
