"""Time and evaluations of areas of workspaces, against the error that is reached."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from benchmarks.harness import Cell, Section, measure_rounds, median_time
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
"""A function of points that returns margins, which are positive within a region."""

BASE_ARC = np.deg2rad(60.0)
"""Arc (rad) between the two base axes of a spherical five-bar."""

LEG_ARCS = np.deg2rad([[50.0, 70.0], [40.0, 65.0]])
"""Arcs (rad) of both links of each leg of the five-bar."""

ELBOW_LIMITS = np.deg2rad([[20.0, 150.0], [25.0, 140.0]])
"""Smallest and largest angle (rad) between the links of each leg."""

REGION_TOLERANCES = 10.0 ** -np.arange(2, 9)
"""Relative tolerances of the area of the five-bar."""

MECHANISM_TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
QUICK_MECHANISM_TOLERANCES = (1e-4,)
"""Relative tolerances of the areas of shipped mechanisms."""

REFERENCE_TOLERANCE = 1e-10
"""Relative tolerance of the area with which the others are compared."""

SEPARATED_AXES = {
    "five_bar": (("21", "43"), ("51", "43")),
    "two_dof_spm": (("21", "43"), ("61", "54")),
}
"""For each mechanism, pairs of axes that must keep a smallest angle between them."""

MIN_AXIS_ANGLE_RAD = np.radians(10.0)
"""The smallest angle (rad) between these axes."""

JOINT_RANGE_DEG = (-40.0, 100.0)
"""Range of a limited pair."""

GAUSS_POINT_COUNT = 200
"""Number of points of the quadrature that gives the exact area of the five-bar."""

ANNULUS_WIDTHS_RAD = (0.1, 0.05, 0.02, 0.01, 0.005, 0.002)


@dataclass(frozen=True)
class LimitedCase:
    """A mechanism whose workspace ends in cusps.

    Attributes
    ----------
    name
        The mechanism.
    pair
        A pair that is limited to `JOINT_RANGE_DEG`; empty if there is none.
    singularity_distance_deg
        Smallest angle to singularities, 0 if it is not limited.
    """

    name: str
    pair: str
    singularity_distance_deg: float


LIMITED_CASES = (
    LimitedCase("five_bar", "21", 0.0),
    LimitedCase("five_bar", "43", 0.0),
    LimitedCase("five_bar", "", 2.0),
    LimitedCase("two_dof_spm", "21", 0.0),
    LimitedCase("two_dof_spm", "43", 0.0),
    LimitedCase("two_dof_spm", "", 2.0),
)


def run(quick: bool) -> list[Section]:
    """Return the sections."""
    return [
        _measure_accuracy(quick),
        _measure_mechanisms(quick),
        _measure_limited(quick),
        _measure_annuli(quick),
        _measure_orientations(quick),
    ]


@dataclass(frozen=True)
class FiveBarRegion:
    """The directions that a five-bar reaches: two annuli that overlap.

    Attributes
    ----------
    margins
        The margins (n, 4) of directions (n, 3).
    area
        The area (sr).
    """

    margins: Margins
    area: float


def _five_bar_region() -> FiveBarRegion:
    """Return the region of the five-bar, with its area by quadrature of a closed form."""
    axes = np.array([[1.0, 0.0, 0.0], [np.cos(BASE_ARC), np.sin(BASE_ARC), 0.0]])
    # Cosines of the distance of the output from a base axis, by the cosine rule.
    cosine_product = np.cos(LEG_ARCS[:, :1]) * np.cos(LEG_ARCS[:, 1:])
    sine_product = np.sin(LEG_ARCS[:, :1]) * np.sin(LEG_ARCS[:, 1:])
    nearest, farthest = (cosine_product + sine_product * np.cos(ELBOW_LIMITS)).T

    def margins(points: Floats) -> Floats:
        cosines = points @ axes.T
        return np.concatenate([nearest - cosines, cosines - farthest], axis=1)

    def arc_length(z: Floats) -> Floats:
        """Return the part (rad) of circles about the first axis that is in the region.

        The circles are at heights z over the centre.
        """
        radius = np.sqrt(1.0 - z * z) * np.sin(BASE_ARC)
        far_end, near_end = (
            np.arccos(np.clip((limit - z * np.cos(BASE_ARC)) / radius, -1.0, 1.0))
            for limit in (farthest[1], nearest[1])
        )
        return np.asarray(2.0 * (far_end - near_end))

    # The length is not smooth where a circle touches a border of the second annulus.
    limit_angles = np.arccos([nearest[1], farthest[1]])
    touching = np.cos(np.concatenate([BASE_ARC - limit_angles, BASE_ARC + limit_angles]))
    inside = [z for z in touching if farthest[0] < z < nearest[0]]
    heights = np.sort([farthest[0], nearest[0], *inside])
    half_widths = 0.5 * np.diff(heights)
    middles = 0.5 * (heights[1:] + heights[:-1])
    nodes, weights = np.polynomial.legendre.leggauss(GAUSS_POINT_COUNT)
    # The substitution by a sine removes square roots at the ends of the intervals.
    t = 0.5 * np.pi * nodes
    z = middles[:, None] + half_widths[:, None] * np.sin(t)
    z_weights = half_widths[:, None] * (0.5 * np.pi * weights * np.cos(t))
    return FiveBarRegion(margins, float(np.sum(z_weights * arc_length(z))))


def _measure_accuracy(quick: bool) -> Section:
    """Measure the area of the five-bar at several tolerances."""
    five_bar = _five_bar_region()
    rows: list[tuple[Cell, ...]] = []
    for tolerance in REGION_TOLERANCES.tolist():
        find_area = partial(find_region, five_bar.margins, tolerance * five_bar.area)
        times = measure_rounds({"area": find_area}, 3 if quick else 7)
        region = find_area()
        rows.append(
            (
                f"{tolerance:.0e}",
                1e3 * median_time(times, "area"),
                region.evaluations,
                region.calls,
                region.error / five_bar.area,
                abs(region.area - five_bar.area) / five_bar.area,
            )
        )
    return Section(
        "Area of a workspace",
        "The workspace of a spherical five-bar whose elbows have joint limits is the "
        "intersection of two annuli. Its true area, by quadrature of a closed form, is "
        f"{five_bar.area:.6f} sr. Errors are relative.",
        ("tolerance", "ms", "evaluations", "calls", "stated error", "true error"),
        rows,
        "The evaluations that are needed to find the parts of the region already give its "
        "area to 1e-6.",
    )


def _measure_mechanisms(quick: bool) -> Section:
    """Measure the workspaces of shipped mechanisms, with all preparations included."""
    rows: list[tuple[Cell, ...]] = []
    for name, axes in SEPARATED_AXES.items():
        mechanism = load(name)
        constraints = Constraints(
            apart=tuple(
                InterferenceLimit(axis_a, axis_b, MIN_AXIS_ANGLE_RAD)
                for axis_a, axis_b in axes
            )
        )
        reference = _find_workspaces(mechanism, constraints, REFERENCE_TOLERANCE)
        reference_area = reference[0].region.area
        for tolerance in QUICK_MECHANISM_TOLERANCES if quick else MECHANISM_TOLERANCES:
            find = partial(_find_workspaces, mechanism, constraints, tolerance)
            times = measure_rounds({"workspace": find}, 3)
            workspaces = find()
            region = workspaces[0].region
            rows.append(
                (
                    name,
                    f"{tolerance:.0e}",
                    median_time(times, "workspace"),
                    len(workspaces),
                    region.evaluations,
                    region.error / reference_area,
                    abs(region.area - reference_area) / reference_area,
                )
            )
    return Section(
        "Workspaces of mechanisms",
        "Workspaces in all working modes, if the outer axes of driven legs have to be at "
        "least 10 degrees apart. Inputs and transmission measures are computed at every "
        "vertex of the border. The time includes the preparation of the mechanism. Errors "
        "are relative. The last column is the difference from the area for a tolerance of "
        "1e-10.",
        (
            "mechanism",
            "tolerance",
            "s",
            "modes",
            "evaluations",
            "stated error",
            "difference",
        ),
        rows,
        "The goal is a time of at most 2 s for a whole workspace whose area has a relative "
        "error of 1e-4.",
    )


def _find_workspaces(
    mechanism: Mechanism, constraints: Constraints, tolerance: float
) -> tuple[DirectionWorkspace, ...]:
    """Return the workspaces of all modes, and evaluate every vertex of their borders.

    `tolerance` is the relative tolerance of the area.
    """
    kinematics = closed_kinematics(mechanism)
    bounds = bounds_of(kinematics, constraints)
    workspaces = direction_workspaces(kinematics, bounds, kinematics.modes, tolerance)
    for workspace in workspaces:
        judge(kinematics, bounds, workspace.signs, workspace.region.points)
    return workspaces


def _measure_limited(quick: bool) -> Section:
    """Measure workspaces of one mode whose borders touch or nearly coincide."""
    low, high = np.radians(JOINT_RANGE_DEG).tolist()
    rows: list[tuple[Cell, ...]] = []
    for case in LIMITED_CASES[:3] if quick else LIMITED_CASES:
        kinematics = closed_kinematics(load(case.name))
        limits = (JointLimit(case.pair, low, high),) if case.pair else ()
        distance = float(np.radians(case.singularity_distance_deg))
        bounds = bounds_of(kinematics, Constraints(limits, near=distance))
        find = partial(_find_first_region, kinematics, bounds)
        times = measure_rounds({"workspace": find}, 3, clock=time.process_time)
        region = find()
        limit = f"near {case.singularity_distance_deg:g} deg"
        if case.pair:
            limit = f"pair {case.pair}"
        rows.append(
            (
                case.name,
                limit,
                median_time(times, "workspace"),
                region.evaluations,
                region.error / region.area,
            )
        )
    return Section(
        "Workspaces that end in cusps",
        "The workspace in one working mode, with a tolerance of 1e-4. In some rows, a pair "
        "is limited to -40 to 100 deg, and the border of this limit touches the border of "
        "the reach. In the others, the distance from singularities has to be at least a "
        "small angle, and both borders are close to each other over a long distance. Times "
        "are processor times, and errors are relative.",
        ("mechanism", "limit", "s", "evaluations", "stated error"),
        rows,
        "The goal is a time of at most 2 s for each.",
    )


def _find_first_region(
    kinematics: ClosedKinematics, bounds: Sequence[AngleLimit]
) -> Region:
    """Return the region of the first working mode, with its area to 1e-4."""
    (workspace,) = direction_workspaces(kinematics, bounds, kinematics.modes[:1], 1e-4)
    return workspace.region


def _measure_annuli(quick: bool) -> Section:
    """Measure the area of annuli of decreasing width."""
    outer_radius = 0.7
    rows: list[tuple[Cell, ...]] = []
    for width in ANNULUS_WIDTHS_RAD[:3] if quick else ANNULUS_WIDTHS_RAD:
        outer_cosine, inner_cosine = np.cos([outer_radius, outer_radius - width]).tolist()

        def margins(
            points: Floats, outer: float = outer_cosine, inner: float = inner_cosine
        ) -> Floats:
            cosine = points[:, 2]
            return np.stack([cosine - outer, inner - cosine], axis=1)

        exact_area = 2.0 * np.pi * (inner_cosine - outer_cosine)
        find_area = partial(find_region, margins)
        times = measure_rounds({"area": find_area}, 3)
        region = find_area()
        rows.append(
            (
                width,
                1e3 * median_time(times, "area"),
                region.evaluations,
                region.evaluations * width,
                len(region.holes),
                abs(region.area - exact_area),
            )
        )
    return Section(
        "Cost of a narrow region",
        "The area of an annulus with the outer radius 0.7 rad and the given width. The "
        "cost is proportional to the length of the annulus divided by its width.",
        ("width, rad", "ms", "evaluations", "evaluations x width", "holes", "error, sr"),
        rows,
    )


def _measure_orientations(quick: bool) -> Section:
    """Measure the volume of the orientations that tilt one axis by a limited angle."""
    largest_tilt = 0.5
    exact_volume = 4.0 * np.pi**2 * (1.0 - np.cos(largest_tilt))

    def margins(quaternions: Floats) -> Floats:
        tilt_cosine = from_quaternion(quaternions)[:, 2, 2:]
        return np.asarray(tilt_cosine - np.cos(largest_tilt))

    rows: list[tuple[Cell, ...]] = []
    for tolerance in (1e-2, 3e-3) if quick else (1e-2, 3e-3, 1e-3):
        find_volume = partial(find_orientations, margins, tolerance)
        times = measure_rounds({"volume": find_volume}, 3)
        region = find_volume()
        rows.append(
            (
                f"{tolerance:.0e}",
                1e3 * median_time(times, "volume"),
                region.evaluations,
                region.error / exact_volume,
                abs(region.volume - exact_volume) / exact_volume,
            )
        )
    return Section(
        "Volume of orientations",
        "The volume of the set of orientations that tilt one axis by at most 0.5 rad. "
        "Errors are relative.",
        ("tolerance", "ms", "evaluations", "stated error", "true error"),
        rows,
    )
