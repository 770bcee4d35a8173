"""Arcs of links, radii of cams and half angles of cones from nothing to half a turn."""

from collections.abc import Iterator, Sequence

import numpy as np

from benchmarks.extremes.kinematics import judged
from benchmarks.extremes.registry import Row, case
from benchmarks.extremes.shapes import four_bar, point_of
from spherekit.geometry.rotation import about_z

ARCS_FAMILY = "arcs"
DEGREES = "arc, deg"
SMALL_ARCS = (1e-9, 1e-7, 1e-5, 1e-3, 1e-1, 1.0, 10.0, 40.0)
ARCS = (*SMALL_ARCS, *(180.0 - arc for arc in reversed(SMALL_ARCS)))
"""Arcs (deg) from nothing to half a revolution."""

INPUT_RAD = 0.7
"""The input (rad) at which the mechanisms are judged."""

BASE_RAD = np.radians(60.0)
CRANK_RAD = np.radians(40.0)
"""Arcs (rad) of frame and crank, unless they are the parameter."""


@case(ARCS_FAMILY, DEGREES, ARCS)
def arc_of_the_crank(arcs: Sequence[float]) -> Iterator[Row]:
    """A four-bar with a crank of any arc; near 180 deg its outer axis is turned round."""
    for arc in arcs:
        coupler = np.radians(110.0 if arc > 90.0 else 70.0)
        mechanism = four_bar((BASE_RAD, np.radians(arc), coupler, np.radians(40.0)))
        reference, point = point_of(mechanism, arc, INPUT_RAD)
        yield from judged(reference, [point])


@case(ARCS_FAMILY, DEGREES, ARCS)
def arc_of_the_frame(arcs: Sequence[float]) -> Iterator[Row]:
    """A four-bar with a frame of any arc: its fixed axes nearly coaxial, or opposite."""
    for arc in arcs:
        rocker = np.radians(130.0 if arc > 90.0 else 50.0)
        mechanism = four_bar((np.radians(arc), CRANK_RAD, np.radians(45.0), rocker))
        reference, point = point_of(mechanism, arc, INPUT_RAD)
        yield from judged(reference, [point])


@case(ARCS_FAMILY, DEGREES, ARCS)
def arc_of_the_coupler(arcs: Sequence[float]) -> Iterator[Row]:
    """A four-bar with a coupler of any arc, its rocker as long as the gap it closes."""
    for arc in arcs:
        gap = _gap()
        rocker = np.pi - gap if arc > 90.0 else gap
        mechanism = four_bar((BASE_RAD, CRANK_RAD, np.radians(arc), rocker))
        reference, point = point_of(mechanism, arc, INPUT_RAD)
        yield from judged(reference, [point])


def _gap() -> float:
    """Return the arc (rad) from the crank's outer axis to the rocker's pivot.

    The rocker's pivot is the z axis of the ground, and the crank's pivot is in the y-z
    plane.
    """
    crank_pivot = np.array([0.0, np.sin(BASE_RAD), np.cos(BASE_RAD)])
    towards_rocker = np.array([0.0, -np.cos(BASE_RAD), np.sin(BASE_RAD)])
    across = np.cross(crank_pivot, towards_rocker)
    x, y, _ = about_z(INPUT_RAD)[:, 0]
    direction = x * towards_rocker + y * across
    outer_axis = np.cos(CRANK_RAD) * crank_pivot + np.sin(CRANK_RAD) * direction
    return float(np.arccos(outer_axis[2]))
