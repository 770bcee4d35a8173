"""Mechanisms that are made for the extremes, and their configurations in 90 digits."""

from collections.abc import Sequence

import mpmath as mp
import numpy as np

from benchmarks.extremes.kinematics import Point
from benchmarks.extremes.reference import DIGITS, Reference, exact
from spherekit.conventions import TURN
from spherekit.mechanism.elements import Input, LinkSizes, Pair, Profile, SizeGeometry
from spherekit.mechanism.mechanism import Mechanism
from spherekit.positions.position_analysis import PositionAnalysis


def four_bar(arcs: Sequence[float]) -> Mechanism:
    """Return the four-bar with these arcs (rad) of frame, crank, coupler and rocker."""
    frame, crank, coupler, rocker = map(float, arcs)
    links_of_pair = {
        "21": ("1", "2"),
        "32": ("2", "3"),
        "43": ("3", "4"),
        "41": ("1", "4"),
    }
    sizes = {
        "1": LinkSizes(("41", "21"), (frame,)),
        "2": LinkSizes(("21", "32"), (crank,)),
        "3": LinkSizes(("32", "43"), (coupler,)),
        "4": LinkSizes(("43", "41"), (rocker,)),
    }
    pairs = tuple(Pair(name, "R", links) for name, links in links_of_pair.items())
    links = ("1", "2", "3", "4")
    geometry = SizeGeometry(sizes)
    return Mechanism(
        "four_bar", "1", links, pairs, geometry, inputs=(Input("21", 0.0, TURN),)
    )


def cam(
    frame: float, crank: float, radii: tuple[float, float], rocker: float, contact: str
) -> Mechanism:
    """Return an eccentric circular cam and a follower with a circular face.

    Parameters
    ----------
    frame
        Arc (rad) between the two pivots.
    crank, rocker
        Arcs (rad) from the pivots to the centres of the circles.
    radii
        Radii (rad) of the cam and of the face.
    contact
        ``"external"`` or ``"internal"``.
    """
    profiles = tuple(
        Profile("circle", (0.0, float(np.sin(arc)), float(np.cos(arc))), radius)
        for arc, radius in zip((crank, rocker), radii, strict=True)
    )
    pairs = (
        Pair("12", "R", ("1", "2")),
        Pair("13", "R", ("1", "3")),
        Pair("23", "Cs", ("2", "3"), (profiles[0], profiles[1]), contact),  # type: ignore[arg-type]
    )
    sizes = {
        "1": LinkSizes(("12", "13"), (frame,)),
        "2": LinkSizes(("12",)),
        "3": LinkSizes(("13",)),
    }
    inputs = (Input("12", 0.0, TURN),)
    return Mechanism("cam", "1", ("1", "2", "3"), pairs, SizeGeometry(sizes), inputs=inputs)


def point_of(
    mechanism: Mechanism, parameter: float, q: float, search: bool = True
) -> tuple[Reference, Point]:
    """Return a mechanism in 90 digits, with the first mode of spherekit at an input.

    The configuration of spherekit is only the start of Newton's method in 90 digits. It
    decides which of the modes is meant.

    Parameters
    ----------
    mechanism
        A mechanism with one input.
    parameter
        Value of the parameter of the case.
    q
        The input (rad).
    search
        Whether all assembly modes are searched.
    """
    motion = PositionAnalysis(mechanism, path=np.array([q]), search=search).motion()
    row = int(np.flatnonzero(~motion.failed)[0])
    reference = Reference(mechanism)
    with mp.workdps(DIGITS):
        near = reference.closed(exact(motion.values[row]), reference.inputs)
    return reference, Point(parameter, [q], near)
