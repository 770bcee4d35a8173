"""Inverse kinematics of outputs: cost for each pose, with reach and measures."""

import time
from collections.abc import Callable
from functools import partial

import numpy as np

from benchmarks.harness import Cell, Section, median, rounds
from spherekit.arrays import Floats
from spherekit.files.mechanism_reader import load
from spherekit.geometry.mirror import upward
from spherekit.geometry.rotation import from_quaternion
from spherekit.geometry.tilt_torsion import azimuth_tilt, euler_zyz
from spherekit.outputs.dyad_chain import Signs
from spherekit.outputs.inverse_kinematics import InverseKinematics
from spherekit.outputs.mid_plane_symmetry import mid_plane_form
from spherekit.positions.assembly_mode import AssemblyMode

MECHANISMS = ("three_rrr", "agile_eye", "five_bar")
BAR, OFF = "two_dof_spm", (1e-6, 1e-3, 1e-2)
POSES, FEW = 1_000_000, 50_000
WHOLE = 5000
"""Poses of the comparison with the positions of all links."""


def run(quick: bool) -> list[Section]:
    """Return the costs of shipped mechanisms with closed form."""
    count = FEW if quick else POSES
    rows: list[tuple[Cell, ...]] = []
    for name in MECHANISMS:
        kinematics = InverseKinematics(load(name))
        poses = random_poses(kinematics, count)
        one = kinematics.modes[0]
        few = poses[:WHOLE]
        pointing = kinematics.wrist.points
        coordinates = azimuth_tilt(few) if pointing else euler_zyz(few)
        jobs: dict[str, Callable[[], object]] = {
            "one": partial(kinematics.at, poses, [one]),
            "all": partial(kinematics.at, poses),
            "measure": partial(_measure, kinematics, poses[:FEW], one),
            "links": partial(kinematics.solver.evaluate, AssemblyMode(0, one), coordinates),
        }
        times = rounds(jobs, 3 if quick else 5)
        found = kinematics.at(poses)
        modes = len(kinematics.modes)
        single, every = median(times, "one") / count, median(times, "all") / count
        whole = median(times, "links") / WHOLE
        held = median(times, "measure") / min(count, FEW)
        rows.append(
            (
                name,
                "direction" if pointing else "orientation",
                modes,
                float(np.mean(np.isfinite(found.inputs[..., 0]))),
                1e9 * single,
                1e9 * every,
                1e9 * every / modes,
                held / single,
                whole / single,
            )
        )
    return [
        Section(
            "Inverse kinematics",
            f"{count} random poses of the output, with margin of reach, status and the "
            "measures of type I; medians, one core. The last columns compare with these "
            "and the measure of type II, which is computed when it is read, and with the "
            "positions of all links in the same mode.",
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
            rows,
        ),
        _with_bar(quick),
        _mid_plane(quick),
    ]


def _with_bar(quick: bool) -> Section:
    """Return the cost of a mechanism whose output turns until a bar closes."""
    kinematics = InverseKinematics(load(BAR))
    seeds = random_poses(kinematics, 8 if quick else 64)
    clock = time.perf_counter()
    found = kinematics.solutions(seeds)
    searched = (time.perf_counter() - clock) / len(seeds)
    assert found.directions is not None
    row, count = 0, FEW if quick else POSES // 5
    rows: list[tuple[Cell, ...]] = []
    for off in OFF:
        spread = np.random.default_rng(2).normal(size=(count, 3)) * off
        near = found.rotations[row]
        directions = found.directions[row] + spread
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        mode = found.signs[row]
        job = {"at": lambda d=directions, n=near, m=mode: kinematics.at(d, [m], near=n)}
        times = rounds(job, 3)
        inverse = kinematics.at(directions, [mode], near=near)
        held = float(np.mean(np.isfinite(inverse.inputs[0, :, 0])))
        rows.append((off, held, 1e6 * median(times, "at") / count))
    return Section(
        "Inverse kinematics with a bar",
        f"{BAR}: {count} directions about one whose solution is known, closed by Newton's "
        "method from there, one mode. Every solution of a direction, from all turns "
        f"sampled, takes {1e3 * searched:.0f} ms: {len(found.row) / len(seeds):.0f} for "
        "each direction on average.",
        ("directions off by, rad", "part closed", "us per pose"),
        rows,
    )


def _mid_plane(quick: bool) -> Section:
    """Return the cost of the closed forms of the mechanism of Chen et al. 2021."""
    form = mid_plane_form(load(BAR))
    plane = form.plane
    count = FEW if quick else POSES
    normals = np.random.default_rng(1).normal(size=(count, 3))
    normals = upward(normals / np.linalg.norm(normals, axis=1, keepdims=True))
    inputs = np.nan_to_num(plane.solutions(normals)[-1, 1])
    driven = list(plane.driven)

    def margins() -> tuple[Floats, Floats]:
        heights = np.abs(normals @ plane.axes[driven].T)
        folds = 2.0 * np.arcsin(np.clip(heights, 0.0, 1.0))
        return folds - np.radians(10.0), 2.0 * plane.arcs[driven] - folds

    jobs = {
        "inputs in all four modes": lambda: plane.solutions(normals),
        "margins of folding and stretching": margins,
        "mid-planes at given inputs": lambda: plane.normals(inputs),
    }
    times = rounds(jobs, 3 if quick else 7, now=time.process_time)
    rows: list[tuple[Cell, ...]] = [
        (name, 1e9 * median(times, name) / count, 1e6 * median(times, name) / count)
        for name in jobs
    ]
    return Section(
        "Inverse kinematics of a mid-plane",
        f"{BAR} in its closed form: {count} mid-planes spread over the half sphere; "
        "medians of processor time, one core.",
        ("what", "ns per pose", "s per 1e6 poses"),
        rows,
    )


def random_poses(kinematics: InverseKinematics, count: int) -> np.ndarray:
    """Return random directions or orientations, uniform and the same every time."""
    random = np.random.default_rng(1)
    size = 3 if kinematics.wrist.points else 4
    drawn = random.normal(size=(count, size))
    drawn /= np.linalg.norm(drawn, axis=1, keepdims=True)
    return drawn if size == 3 else from_quaternion(drawn)


def _measure(kinematics: InverseKinematics, poses: Floats, mode: Signs) -> Floats:
    return kinematics.at(poses, [mode]).type_2
