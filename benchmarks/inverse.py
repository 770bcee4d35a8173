"""Time of inverse kinematics for each pose of an output."""

import time
from functools import partial

import numpy as np

from benchmarks.harness import Cell, Job, Section, measure_rounds, median_time
from spherekit.arrays import Floats
from spherekit.files.mechanism_reader import load
from spherekit.geometry.mirror import upward
from spherekit.geometry.rotation import from_quaternion
from spherekit.geometry.tilt_torsion import azimuth_tilt, euler_zyz
from spherekit.outputs.dyad_chain import Signs
from spherekit.outputs.inverse_kinematics import InverseKinematics
from spherekit.outputs.mid_plane_symmetry import mid_plane_form
from spherekit.positions.assembly_mode import AssemblyMode

INVERSE_MECHANISMS = ("three_rrr", "agile_eye", "five_bar")
"""Mechanisms with closed form."""

BAR_MECHANISM = "two_dof_spm"
"""Mechanism whose output is a direction.

The output link can rotate about this direction. The angle of this rotation is found from
the condition that a bar between two links keeps its length.
"""

DIRECTION_DEVIATIONS_RAD = (1e-6, 1e-3, 1e-2)
"""Standard deviations (rad) of directions from one whose solution is known."""

POSE_COUNT = 1_000_000
QUICK_POSE_COUNT = 50_000
"""Number of poses in a quick benchmark. It is also the number of poses at which the measure
of type II singularities is evaluated."""

ALL_LINKS_POSE_COUNT = 5000
"""Number of poses for which the positions of all links are computed."""


def run(quick: bool) -> list[Section]:
    """Return the times of inverse kinematics by closed forms and by other methods."""
    pose_count = QUICK_POSE_COUNT if quick else POSE_COUNT
    return [
        Section(
            "Inverse kinematics",
            f"The time to compute the inputs at {pose_count} random poses of the output. "
            "It includes the margin of reach of each pose, its status and the measures of "
            "type I singularities. The times are medians on one core. The last two columns "
            "are the times of longer computations, divided by the time of one mode. The "
            "first one also computes the measure of type II, which is otherwise computed "
            "only when it is read. The second one computes the positions of all links.",
            (
                "mechanism",
                "output",
                "working modes",
                "part in reach",
                "one mode, ns per pose",
                "all modes, ns per pose",
                "ns per pose and mode",
                "with the measure of type II over inputs only",
                "all links over inputs only",
            ),
            [_measure_closed_form(name, pose_count, quick) for name in INVERSE_MECHANISMS],
        ),
        _measure_bar(quick),
        _measure_mid_plane(quick),
    ]


def _measure_closed_form(name: str, pose_count: int, quick: bool) -> tuple[Cell, ...]:
    """Return a table row with the times of a pose in one working mode and in all modes."""
    kinematics = InverseKinematics(load(name))
    poses = random_poses(kinematics, pose_count)
    mode = kinematics.modes[0]
    few_poses = poses[:ALL_LINKS_POSE_COUNT]
    is_pointing = kinematics.wrist.points
    # Angles by which the solver of all links is driven.
    pose_angles = azimuth_tilt(few_poses) if is_pointing else euler_zyz(few_poses)
    jobs: dict[str, Job] = {
        "one mode": partial(kinematics.at, poses, [mode]),
        "all modes": partial(kinematics.at, poses),
        "type II": partial(_type_2_measure, kinematics, poses[:QUICK_POSE_COUNT], mode),
        "links": partial(kinematics.solver.evaluate, AssemblyMode(0, mode), pose_angles),
    }
    times = measure_rounds(jobs, 3 if quick else 5)
    inverse = kinematics.at(poses)
    mode_count = len(kinematics.modes)
    one_mode_seconds = median_time(times, "one mode") / pose_count
    all_modes_seconds = median_time(times, "all modes") / pose_count
    links_seconds = median_time(times, "links") / ALL_LINKS_POSE_COUNT
    type_2_seconds = median_time(times, "type II") / min(pose_count, QUICK_POSE_COUNT)
    return (
        name,
        "direction" if is_pointing else "orientation",
        mode_count,
        float(np.mean(np.isfinite(inverse.inputs[..., 0]))),
        1e9 * one_mode_seconds,
        1e9 * all_modes_seconds,
        1e9 * all_modes_seconds / mode_count,
        type_2_seconds / one_mode_seconds,
        links_seconds / one_mode_seconds,
    )


def _measure_bar(quick: bool) -> Section:
    """Measure inverse kinematics in which a rotation of the output closes a bar."""
    kinematics = InverseKinematics(load(BAR_MECHANISM))
    searched_poses = random_poses(kinematics, 8 if quick else 64)
    started = time.perf_counter()
    solutions = kinematics.solutions(searched_poses)
    search_seconds = (time.perf_counter() - started) / len(searched_poses)
    assert solutions.directions is not None
    known_direction = solutions.directions[0]
    known_rotation = solutions.rotations[0]
    mode = solutions.signs[0]
    count = QUICK_POSE_COUNT if quick else POSE_COUNT // 5
    rows: list[tuple[Cell, ...]] = []
    for deviation in DIRECTION_DEVIATIONS_RAD:
        noise = np.random.default_rng(2).normal(size=(count, 3)) * deviation
        directions = known_direction + noise
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        solve = partial(kinematics.at, directions, [mode], near=known_rotation)
        times = measure_rounds({"solve": solve}, 3)
        inverse = solve()
        closed_fraction = float(np.mean(np.isfinite(inverse.inputs[0, :, 0])))
        microseconds = 1e6 * median_time(times, "solve") / count
        rows.append((deviation, closed_fraction, microseconds))
    solution_count = len(solutions.row) / len(searched_poses)
    return Section(
        "Inverse kinematics with a bar",
        f"The inputs of the wrist `{BAR_MECHANISM}` at {count} directions near one whose "
        "solution is known. Newton's method starts from this solution, in one mode. A "
        f"search of all solutions of a direction takes {1e3 * search_seconds:.0f} ms; a "
        f"direction has {solution_count:.0f} solutions on average.",
        ("distance of directions, rad", "share closed", "us per pose"),
        rows,
    )


def _measure_mid_plane(quick: bool) -> Section:
    """Measure the closed forms of the mechanism of Chen et al. 2021."""
    plane = mid_plane_form(load(BAR_MECHANISM)).plane
    count = QUICK_POSE_COUNT if quick else POSE_COUNT
    normals = np.random.default_rng(1).normal(size=(count, 3))
    normals = upward(normals / np.linalg.norm(normals, axis=1, keepdims=True))
    inputs = np.nan_to_num(plane.solutions(normals)[-1, 1])
    driven = list(plane.driven)

    def compute_margins() -> tuple[Floats, Floats]:
        """Return the margins (rad) of folding to 10 degrees and of stretching."""
        heights = np.abs(normals @ plane.axes[driven].T)
        fold_angles = 2.0 * np.arcsin(np.clip(heights, 0.0, 1.0))
        return fold_angles - np.radians(10.0), 2.0 * plane.arcs[driven] - fold_angles

    jobs: dict[str, Job] = {
        "inputs in all four modes": lambda: plane.solutions(normals),
        "margins of folding and stretching": compute_margins,
        "mid-planes at given inputs": lambda: plane.normals(inputs),
    }
    times = measure_rounds(jobs, 3 if quick else 7, clock=time.process_time)
    rows: list[tuple[Cell, ...]] = []
    for name in jobs:
        seconds = median_time(times, name) / count
        rows.append((name, 1e9 * seconds, 1e6 * seconds))
    return Section(
        "Inverse kinematics of a mid-plane",
        f"The inverse kinematics of the wrist `{BAR_MECHANISM}` in closed form, for "
        f"{count} mid-planes that are distributed over the hemisphere. The times are "
        "medians of processor time on one core.",
        ("quantity", "ns per pose", "s per 1e6 poses"),
        rows,
    )


def random_poses(kinematics: InverseKinematics, count: int) -> Floats:
    """Return uniformly distributed poses of the output, the same ones every time.

    They are directions (count, 3), or orientations (count, 3, 3).
    """
    rng = np.random.default_rng(1)
    size = 3 if kinematics.wrist.points else 4
    unit_vectors = rng.normal(size=(count, size))
    unit_vectors /= np.linalg.norm(unit_vectors, axis=1, keepdims=True)
    return unit_vectors if size == 3 else from_quaternion(unit_vectors)


def _type_2_measure(kinematics: InverseKinematics, poses: Floats, mode: Signs) -> Floats:
    """Return the measure of type II singularities of poses in a working mode."""
    return kinematics.at(poses, [mode]).type_2
