"""Arcs of links, radii of cams and half angles of cones from nothing to half a turn."""

from collections.abc import Iterator, Sequence

import numpy as np

from benchmarks.extremes.kinematics import judged
from benchmarks.extremes.registry import Row, case
from benchmarks.extremes.shapes import four_bar, point_of
from spherekit.geometry.rotation import about_z

FAMILY = "arcs"
DEGREES = "arc, deg"
SMALL = (1e-9, 1e-7, 1e-5, 1e-3, 1e-1, 1.0, 10.0, 40.0)
ARCS = (*SMALL, *(180.0 - arc for arc in reversed(SMALL)))
Q = 0.7
BASE, CRANK = np.radians(60.0), np.radians(40.0)


@case(FAMILY, DEGREES, ARCS)
def arc_of_the_crank(arcs: Sequence[float]) -> Iterator[Row]:
    """A four-bar with a crank of any arc; near 180 deg its outer axis is turned round."""
    for arc in arcs:
        folded = arc > 90.0
        coupler = np.radians(110.0 if folded else 70.0)
        made = four_bar((BASE, np.radians(arc), coupler, np.radians(40.0)))
        reference, point = point_of(made, arc, Q)
        yield from judged(reference, [point])


@case(FAMILY, DEGREES, ARCS)
def arc_of_the_frame(arcs: Sequence[float]) -> Iterator[Row]:
    """A four-bar with a frame of any arc: its fixed axes nearly coaxial, or opposite."""
    for arc in arcs:
        rocker = np.radians(130.0 if arc > 90.0 else 50.0)
        made = four_bar((np.radians(arc), CRANK, np.radians(45.0), rocker))
        reference, point = point_of(made, arc, Q)
        yield from judged(reference, [point])


@case(FAMILY, DEGREES, ARCS)
def arc_of_the_coupler(arcs: Sequence[float]) -> Iterator[Row]:
    """A four-bar with a coupler of any arc, its rocker as long as the gap it closes."""
    for arc in arcs:
        gap = _gap()
        rocker = np.pi - gap if arc > 90.0 else gap
        made = four_bar((BASE, CRANK, np.radians(arc), rocker))
        reference, point = point_of(made, arc, Q)
        yield from judged(reference, [point])


def _gap() -> float:
    """Return the arc (rad) from the crank's outer axis to the rocker's pivot."""
    axis = np.array([0.0, np.sin(BASE), np.cos(BASE)])
    toward = np.array([0.0, -np.cos(BASE), np.sin(BASE)])
    across = np.cross(axis, toward)
    x, y, _ = about_z(Q)[:, 0]
    tip = np.cos(CRANK) * axis + np.sin(CRANK) * (x * toward + y * across)
    return float(np.arccos(tip[2]))
