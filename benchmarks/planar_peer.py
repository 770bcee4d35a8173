"""Positions of tiny spherical four-bars beside pylinkage, which solves planar ones.

On a sphere that is large against the links, a spherical linkage is a planar one: angles
differ by the square of the links' size.
"""

from collections.abc import Callable
from dataclasses import replace
from importlib.util import find_spec
from typing import Any

import numpy as np

from benchmarks.report import Cell, Section
from benchmarks.timing import median, ratio, rounds
from spherekit.files.read import load
from spherekit.model.mechanism import Mechanism
from spherekit.model.parts import SizeGeometry
from spherekit.motion.motion import Tracer

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

LENGTHS = {"1": 4.0, "2": 1.0, "3": 3.5, "4": 3.0}
"""Frame, crank, coupler and rocker of a planar crank-rocker; arcs are so many sizes."""

SAMPLES = 1000


def run(quick: bool) -> list[Section]:
    """Return the agreement and the times; nothing without pylinkage."""
    text = "A crank-rocker of lengths 4, 1, 3.5, 3 and the same as arcs in units of a size."
    if find_spec("pylinkage") is None:
        return [Section("Planar peer", f"{text} pylinkage is not installed.", (), ())]
    agreement: list[tuple[Cell, ...]] = []
    before = None
    for size in (1e-2, 1e-3, 1e-4):
        error = _difference(_four_bar(size), size)
        agreement.append((size, error, error / size**2, before and before / error))
        before = error
    return [
        Section(
            "Planar peer: agreement",
            f"{text} Largest difference of the rocker's angle over a turn of the crank, "
            "rad; a hundredth of it is expected for a tenth of the size.",
            ("size, rad", "difference", "over the size squared", "times the last"),
            agreement,
        ),
        _times(3 if quick else 7),
    ]


def _four_bar(size: float) -> Mechanism:
    made = load("four_bar")
    assert isinstance(made.geometry, SizeGeometry)
    links = {
        link: replace(own, arcs=(size * LENGTHS[link],))
        for link, own in made.geometry.links.items()
    }
    return replace(made, geometry=SizeGeometry(links), masses=(), loads=())


def _turn(about: Floats, first: Floats, second: Floats) -> Floats:
    """Return the angles (n,) from one direction to another about axes, all (n, 3)."""
    normal = np.cross(about, first)
    along = np.sum(normal * np.cross(about, second), axis=1)
    return np.asarray(np.arctan2(np.sum(normal * second, axis=1), along))


def _difference(made: Mechanism, size: float) -> float:
    """Return the largest difference of the rocker's angles (rad) over both modes."""
    motion = Tracer(made, samples=SAMPLES).motion()
    number = made.pair_number
    largest = 0.0
    for assembly_mode in motion.assembly_modes:
        rows = motion.assembly_mode == assembly_mode.number
        ground, crank, moving, rocker = (
            motion.axes[rows, number[name]] for name in ("41", "21", "32", "43")
        )
        driven = np.unwrap(_turn(crank, ground, moving))
        angle = _turn(ground, crank, rocker)
        place = 3.0 * np.array([-np.cos(angle[0]), -np.sin(angle[0])]) + [4.0, 0.0]
        linkage = _planar(driven[0], driven[1] - driven[0], (place[0], place[1]))
        track = [coords[-1] for coords in linkage.step(iterations=SAMPLES)]
        x, y = np.array(track, dtype=float).T
        planar = np.arctan2(-y, 4.0 - x)
        miss = np.angle(np.exp(1j * (planar - angle)))
        largest = max(largest, float(np.max(np.abs(miss))))
    return largest


def _planar(start: float, step: float, place: tuple[float, float]) -> Any:
    """Return the planar linkage before its first step, its rocker's end near a place."""
    from pylinkage import Crank, Ground, Linkage, RRRDyad

    left, right = Ground(0.0, 0.0), Ground(LENGTHS["1"], 0.0)
    crank = Crank(left, LENGTHS["2"], angular_velocity=step, initial_angle=start - step)
    dyad = RRRDyad(crank.output, right, LENGTHS["3"], LENGTHS["4"], *place)
    return Linkage([left, right, crank, dyad])


def _times(repeats: int) -> Section:
    tracer = Tracer(_four_bar(1e-3), samples=SAMPLES, assembly_mode=0)
    inputs = [q[None] for q in tracer.input_grid.q]
    linkage = _planar(0.0, 2.0 * np.pi / SAMPLES, (2.5, 2.5))
    jobs: dict[str, Callable[[], object]] = {
        "pylinkage, step by step": lambda: list(linkage.step(iterations=SAMPLES)),
        "spherekit, one sample a call": lambda: [tracer.at(q) for q in inputs],
        "spherekit, all at once": tracer.motion,
    }
    unit = next(iter(jobs))
    if find_spec("numba") is not None:
        jobs["pylinkage, compiled"] = lambda: linkage.step_fast(iterations=SAMPLES)
    times = rounds(jobs, repeats)
    rows = [
        (name, ratio(times, name, unit), 1e6 * median(times, name) / SAMPLES)
        for name in jobs
    ]
    return Section(
        "Planar peer: positions",
        f"{SAMPLES} samples over a turn of the crank, one mode. spherekit finds "
        "orientations of all links, status and closure residual, pylinkage two points.",
        ("job", f"over {unit}", "us per sample"),
        rows,
        ratios=(f"over {unit}",),
    )
