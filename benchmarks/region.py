"""Areas of regions: time and evaluations against the error reached, and the feature."""

import time
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from benchmarks.harness import Cell, Section, median, rounds
from spherekit import load
from spherekit.arrays import Floats
from spherekit.geometry.direction_region import Region, find_region
from spherekit.geometry.orientation_region import find_orientations
from spherekit.geometry.rotation import from_quaternion
from spherekit.mechanism.load_kinds import JointLimit
from spherekit.mechanism.mechanism import Mechanism
from spherekit.outputs.output_kinematics import ClosedKinematics
from spherekit.outputs.pose_constraints import (
    AngleLimit,
    Constraints,
    InterferenceLimit,
    bounds_of,
)
from spherekit.outputs.pose_solver import closed_kinematics
from spherekit.outputs.workspace import DirectionWorkspace, direction_workspaces, judge

Margins = Callable[[Floats], Floats]

BASE = np.deg2rad(60.0)
LEGS = np.deg2rad([[50.0, 70.0], [40.0, 65.0]])
ELBOWS = np.deg2rad([[20.0, 150.0], [25.0, 140.0]])
"""A spherical five-bar: arc of its base, of both links of each leg, limits of the angle
between these."""
TOLERANCES = 10.0 ** -np.arange(2, 9)
RULES = {
    "five_bar": (("21", "43"), ("51", "43")),
    "two_dof_spm": (("21", "43"), ("61", "54")),
}
"""Mechanisms, and the axes that the rule keeps apart."""
LIMITED: tuple[tuple[str, str, float], ...] = (
    ("five_bar", "21", 0.0),
    ("five_bar", "43", 0.0),
    ("five_bar", "", 2.0),
    ("two_dof_spm", "21", 0.0),
    ("two_dof_spm", "43", 0.0),
    ("two_dof_spm", "", 2.0),
)
"""Mechanisms with a pair that keeps to -40 to 100 deg, or a least angle (deg) to
singularities."""
WIDTHS = (0.1, 0.05, 0.02, 0.01, 0.005, 0.002)


def run(quick: bool) -> list[Section]:
    """Return the sections."""
    return [
        _accuracy(quick),
        _mechanisms(quick),
        _limited(quick),
        _features(quick),
        _orientations(quick),
    ]


def _five_bar() -> tuple[Margins, float]:
    """Return the margins of a five-bar, annuli about its axes, and the area they leave."""
    axes = np.array([[1.0, 0.0, 0.0], [np.cos(BASE), np.sin(BASE), 0.0]])
    straight = np.cos(LEGS[:, :1]) * np.cos(LEGS[:, 1:])
    folded = np.sin(LEGS[:, :1]) * np.sin(LEGS[:, 1:])
    near, far = (straight + folded * np.cos(ELBOWS)).T

    def margins(points: Floats) -> Floats:
        cosine = points @ axes.T
        return np.concatenate([near - cosine, cosine - far], axis=1)

    def width(z: Floats) -> Floats:
        """Return how long the region is on circles about the first axis, at height z."""
        side = np.sqrt(1.0 - z * z) * np.sin(BASE)
        ends = [(limit - z * np.cos(BASE)) / side for limit in (far[1], near[1])]
        out, inner = (np.arccos(np.clip(end, -1.0, 1.0)) for end in ends)
        return np.asarray(2.0 * (out - inner))

    limits = np.arccos([near[1], far[1]])
    angles = np.concatenate([BASE - limits, BASE + limits])
    inside = [z for z in np.cos(angles) if far[0] < z < near[0]]
    places = np.sort([far[0], near[0], *inside])
    half, middle = 0.5 * np.diff(places), 0.5 * (places[1:] + places[:-1])
    nodes, weights = np.polynomial.legendre.leggauss(200)
    t = 0.5 * np.pi * nodes
    z = middle[:, None] + half[:, None] * np.sin(t)
    share = half[:, None] * (0.5 * np.pi * weights * np.cos(t))
    return margins, float(np.sum(share * width(z)))


def _accuracy(quick: bool) -> Section:
    margins, exact = _five_bar()
    rows: list[tuple[Cell, ...]] = []
    for tolerance in TOLERANCES:

        def job(tolerance: float = float(tolerance)) -> Region:
            return find_region(margins, tolerance * exact)

        times = rounds({"area": job}, 3 if quick else 7)
        region = job()
        error = abs(region.area - exact) / exact
        claimed = region.error / exact
        sizes = region.evaluations, region.calls
        rows.append(
            (f"{tolerance:.0e}", 1e3 * median(times, "area"), *sizes, claimed, error)
        )
    return Section(
        "Area of a workspace",
        "A spherical five-bar with limits of its elbows: two annuli that overlap, area "
        f"{exact:.6f} sr by quadrature in closed form. Errors are relative.",
        ("asked for", "ms", "evaluations", "calls", "error stated", "error"),
        rows,
        "What it takes to see the parts of the region gives its area to 1e-6 at once.",
    )


def _mechanisms(quick: bool) -> Section:
    """Time whole workspaces, from the mechanism on, at tolerances from 1e-2 to 1e-6."""
    rows: list[tuple[Cell, ...]] = []
    ten = np.radians(10.0)
    for name, axes in RULES.items():
        mechanism = load(name)
        wanted = Constraints(apart=tuple(InterferenceLimit(*pair, ten) for pair in axes))
        exact = _found(mechanism, wanted, 1e-10)[0].region.area
        for tolerance in (1e-4,) if quick else (1e-2, 1e-3, 1e-4, 1e-5, 1e-6):

            def job(
                mechanism: Mechanism = mechanism,
                wanted: Constraints = wanted,
                tolerance: float = tolerance,
            ) -> tuple[DirectionWorkspace, ...]:
                return _found(mechanism, wanted, tolerance)

            times = rounds({"workspace": job}, 3)
            modes = job()
            region = modes[0].region
            found = len(modes), region.evaluations
            claimed, error = region.error / exact, abs(region.area - exact) / exact
            label = f"{tolerance:.0e}"
            rows.append((name, label, median(times, "workspace"), *found, claimed, error))
    return Section(
        "Workspaces of mechanisms",
        "All working modes under the rule that the outer axes of a driven leg are 10 "
        "degrees apart at least, with inputs and measures at every vertex, from the "
        "mechanism on. Errors are relative; the last column is the difference to a "
        "tolerance of 1e-10.",
        ("mechanism", "asked for", "s", "modes", "evaluations", "error stated", "change"),
        rows,
        "Whole workspaces with the area to 1e-4 are to take 2 s at most.",
    )


def _limited(quick: bool) -> Section:
    """Time one mode's workspace to 1e-4 where borders touch or run side by side."""
    rows: list[tuple[Cell, ...]] = []
    for name, pair, near in LIMITED[:3] if quick else LIMITED:
        kinematics = closed_kinematics(load(name))
        low, high = np.radians([-40.0, 100.0])
        limits = (JointLimit(pair, float(low), float(high)),) if pair else ()
        bounds = bounds_of(kinematics, Constraints(limits, near=float(np.radians(near))))

        def job(
            kinematics: ClosedKinematics = kinematics, bounds: Sequence[AngleLimit] = bounds
        ) -> Region:
            (found,) = direction_workspaces(kinematics, bounds, kinematics.modes[:1], 1e-4)
            return found.region

        times = rounds({"workspace": job}, 3, now=time.process_time)
        region = job()
        what = f"pair {pair}" if pair else f"near {near:g} deg"
        stated = region.error / region.area
        rows.append((name, what, median(times, "workspace"), region.evaluations, stated))
    return Section(
        "Workspaces that end in cusps",
        "One working mode to 1e-4 with a pair limited to -40 to 100 deg, which touches the "
        "border of the reach, or kept from singularities by a small angle, where both "
        "borders run side by side. Processor time; errors are relative.",
        ("mechanism", "limit", "s", "evaluations", "error stated"),
        rows,
        "Each is to take 2 s at most.",
    )


def _found(
    mechanism: Mechanism, wanted: Constraints, tolerance: float
) -> tuple[DirectionWorkspace, ...]:
    """Return the workspaces of all modes, having judged every vertex."""
    kinematics = closed_kinematics(mechanism)
    bounds = bounds_of(kinematics, wanted)
    found = direction_workspaces(kinematics, bounds, kinematics.modes, tolerance)
    for item in found:
        judge(kinematics, bounds, item.signs, item.region.points)
    return found


def _features(quick: bool) -> Section:
    rows: list[tuple[Cell, ...]] = []
    for width in WIDTHS[:3] if quick else WIDTHS:
        limits = np.cos([0.7, 0.7 - width])

        def margins(points: Floats, limits: Sequence[float] = tuple(limits)) -> Floats:
            cosine = points[:, 2]
            return np.stack([cosine - limits[0], limits[1] - cosine], axis=1)

        exact = 2.0 * np.pi * (limits[1] - limits[0])
        job = partial(find_region, margins)
        times = rounds({"area": job}, 3)
        region = job()
        error = abs(region.area - exact)
        per = region.evaluations * width
        found = len(region.holes)
        rows.append(
            (width, 1e3 * median(times, "area"), region.evaluations, per, found, error)
        )
    return Section(
        "Cost of a narrow region",
        "An annulus of outer radius 0.7 rad and the width given: the cost follows its "
        "length over its width, not its area.",
        ("width, rad", "ms", "evaluations", "times width", "holes found", "error, sr"),
        rows,
    )


def _orientations(quick: bool) -> Section:
    angle = 0.5
    exact = 4.0 * np.pi**2 * (1.0 - np.cos(angle))

    def margins(quaternions: Floats) -> Floats:
        return np.asarray(from_quaternion(quaternions)[:, 2, 2:] - np.cos(angle))

    rows: list[tuple[Cell, ...]] = []
    for tolerance in (1e-2, 3e-3) if quick else (1e-2, 3e-3, 1e-3):
        job = partial(find_orientations, margins, tolerance)
        times = rounds({"volume": job}, 3)
        found = job()
        error = abs(found.volume - exact) / exact
        claimed = found.error / exact
        time = 1e3 * median(times, "volume")
        rows.append((f"{tolerance:.0e}", time, found.evaluations, claimed, error))
    return Section(
        "Volume of orientations",
        "Orientations that tilt one axis by at most 0.5 rad. Errors are relative.",
        ("asked for", "ms", "evaluations", "error stated", "error"),
        rows,
    )
