"""Time of computing figures of merit for many designs of a mechanism.

One compiled kernel for all designs is compared with a run of each design, and with other
programs (peers).
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from typing import Any, final

import numpy as np

import spherekit as sk
from benchmarks.harness import (
    Cell,
    Job,
    Section,
    measure_rounds,
    median_ratio,
    median_time,
)
from spherekit.arrays import Floats
from spherekit.designs.design_evaluation import MAX_TRACKED_DESIGNS, DesignEvaluator
from spherekit.designs.design_variables import design_variable, make_design
from spherekit.designs.figures_of_merit import DesignSamples
from spherekit.exchange.mjcf import MujocoModel
from spherekit.files.mechanism_reader import read
from spherekit.files.number_change import document_of
from spherekit.files.study import Study
from spherekit.mechanism.mechanism import Mechanism
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.runs.figure_of_merit import parse_merit

RADIANS_PER_DEGREE = np.pi / 180.0

RUN_DESIGNS = 2
"""Number of designs that are run one by one, for the time of a run."""


@final
@dataclass(frozen=True)
class DesignCase:
    """A shipped mechanism with random designs.

    Attributes
    ----------
    name
        Name of the mechanism.
    keys
        Keys of the numbers of its file that vary.
    merits
        The figures of merit, as users write them.
    samples
        Number of samples of the input.
    spread
        Largest deviation of a number from that of the file, in its unit.
    """

    name: str
    keys: tuple[str, ...]
    merits: tuple[str, ...]
    samples: int
    spread: float

    def make_evaluator(self) -> DesignEvaluator:
        """Return the object that computes the figures of merit."""
        document = document_of(self.name)
        mechanism = read(document)
        return DesignEvaluator(
            document,
            mechanism,
            [design_variable(document, key) for key in self.keys],
            [parse_merit(text, "deg") for text in self.merits],
            DesignSamples.from_study(Study(self.name, mechanism, samples=self.samples)),
        )

    def make_mechanism(self, values: Sequence[float]) -> Mechanism:
        """Return the mechanism of a design with these values (variables,)."""
        document = document_of(self.name)
        variables = [design_variable(document, key) for key in self.keys]
        return make_design(document, variables, values)

    def draw_designs(self, count: int) -> Floats:
        """Return random designs (variables, count) near that of the mechanism file."""
        document = document_of(self.name)
        nominal = np.array([design_variable(document, key).value for key in self.keys])
        rng = np.random.default_rng(1)
        deviations = rng.uniform(-1.0, 1.0, (len(nominal), count))
        return np.asarray(nominal[:, None] + self.spread * deviations)


ARC_SIZES = ("links.1.arc", "links.2.arc", "links.3.arc", "links.4.arc")
"""All sizes of the four-bar."""

BUTTERFLY_AXES = tuple(
    f"pairs.{pair}.{angle}" for pair in "ACDF" for angle in ("longitude", "latitude")
)
"""Directions of four axes of the double butterfly."""

FLIER_AXES = tuple(
    f"pairs.{pair}.{angle}"
    for pair in ("14", "23", "68")
    for angle in ("longitude", "latitude")
)
"""Directions of three axes of the single flier."""

DESIGN_CASES = (
    DesignCase(
        "four_bar",
        ARC_SIZES,
        (
            "least=min(transmission_angle_43)",
            "largest=max(abs(rate_41))",
            "swing=swing(theta_41)",
        ),
        samples=361,
        spread=15.0,
    ),
    DesignCase(
        "four_bar",
        ARC_SIZES,
        ("torque=max(abs(torque))", "inertia=max(B)"),
        samples=361,
        spread=15.0,
    ),
    DesignCase(
        "stephenson",
        ("links.1.arcs.14", "links.2.arc", "links.3.arcs.35", "links.6.arc"),
        (
            "least=min(transmission_angle_34)",
            "second=min(transmission_angle_56)",
            "largest=max(abs(rate_16))",
        ),
        samples=361,
        spread=5.0,
    ),
    DesignCase(
        "single_flier",
        FLIER_AXES,
        ("swing=swing(theta_15)", "largest=max(abs(rate_67))"),
        samples=73,
        spread=5.0,
    ),
    DesignCase(
        "double_butterfly",
        BUTTERFLY_AXES,
        ("swing=swing(theta_B)", "largest=max(abs(rate_B))"),
        samples=73,
        spread=5.0,
    ),
)


def run(quick: bool) -> list[Section]:
    """Return the times of a design by one kernel, by a run, and by other programs."""
    return [
        Section(
            "Designs",
            "Figures of merit of random designs, in all modes over a full turn. Times are "
            "processor times on one core, with one kernel for all designs. The column "
            "`alone over kernel` is the time of a separate `sk.run` with the poles of each "
            "design, divided by the time of the kernel.",
            (
                "mechanism and figures",
                "designs",
                "rows that close",
                "us per design",
                "ns per row and sample",
                "alone over kernel",
            ),
            [_measure_case(case, quick) for case in DESIGN_CASES],
        ),
        _measure_peers(DESIGN_CASES[0], 100 if quick else 1000),
    ]


def _measure_case(case: DesignCase, quick: bool) -> tuple[Cell, ...]:
    """Return a table row that compares one kernel for all designs with a run of each."""
    evaluator = case.make_evaluator()
    count = 4096 if quick else 32768
    if evaluator.tracks_solutions:
        count = MAX_TRACKED_DESIGNS // 12 if quick else MAX_TRACKED_DESIGNS
    designs = case.draw_designs(count)
    mechanisms = [case.make_mechanism(values) for values in designs[:, :RUN_DESIGNS].T]

    def run_each_design() -> None:
        for mechanism in mechanisms:
            sk.run(mechanism, "poles", samples=case.samples)

    jobs: dict[str, Job] = {
        "kernel": partial(evaluator.evaluate, designs),
        "runs": run_each_design,
    }
    is_closed_form = evaluator.kernel is not None and evaluator.kernel.is_closed_form
    times = measure_rounds(jobs, 3 if is_closed_form else 1, clock=time.process_time)
    closing_rows = int(np.sum(evaluator.evaluate(designs).closes > 0.0))
    seconds = median_time(times, "kernel")
    merit_names = [merit.split("=")[0] for merit in case.merits]
    return (
        f"{case.name}, {', '.join(merit_names)}",
        count,
        closing_rows,
        1e6 * seconds / count,
        1e9 * seconds / (closing_rows * case.samples),
        median_ratio(times, "runs", "kernel") * count / len(mechanisms),
    )


def _measure_peers(case: DesignCase, count: int) -> Section:
    """Return the times of `count` designs of a case in spherekit and in other programs."""
    evaluator = case.make_evaluator()
    designs = case.draw_designs(count)
    own_name = "spherekit, both modes, three figures"
    jobs: dict[str, Job] = {own_name: partial(evaluator.evaluate, designs)}
    if find_spec("mujoco") is not None:
        name = "MuJoCo, one mode: model from XML, mj_forward at each sample"
        jobs[name] = _mujoco_job(case, count)
    if find_spec("pylinkage") is not None:
        name = "pylinkage, one mode of the planar limit: linkage, steps"
        jobs[name] = _pylinkage_job(case, count)
    evaluator.evaluate(designs)
    times = measure_rounds(jobs, 3, clock=time.process_time)
    rows = [
        (name, median_ratio(times, name, own_name), 1e6 * median_time(times, name) / count)
        for name in jobs
    ]
    return Section(
        "Designs beside peers",
        f"{count} random four-bars at {case.samples} inputs. Times are processor times. "
        "MuJoCo computes the dynamics at each sample and does not close the loop, so "
        "computing positions would take longer. The time in which the XML is written is "
        "not counted.",
        ("job", f"time over {own_name}", "us per design"),
        rows,
    )


def _mujoco_job(case: DesignCase, count: int) -> Job:
    """Return a job that makes `count` MuJoCo models and evaluates them at all samples.

    The job is timed beside the evaluation of `count` designs by spherekit. All models have
    the sizes of the mechanism's file. The XML text of the model is written beforehand.
    """
    import mujoco

    mechanism = sk.load(case.name)
    values = PositionAnalysis(mechanism, samples=2).motion().values[0]
    # The model needs the time step of an integrator, which is not used here.
    timestep_s = 1e-3
    text = MujocoModel(mechanism, values, timestep_s).text

    def evaluate_models() -> None:
        for _ in range(count):
            model: Any = mujoco.MjModel.from_xml_string(text)
            data = mujoco.MjData(model)
            for q in np.linspace(0.0, 2.0 * np.pi, case.samples):
                data.qpos[0] = q
                mujoco.mj_forward(model, data)

    return evaluate_models


def _pylinkage_job(case: DesignCase, count: int) -> Job:
    """Return a job that makes `count` planar four-bars and moves them by all samples.

    The job is timed beside the evaluation of `count` designs by spherekit. All four-bars
    have the same lengths.
    """
    from pylinkage import Crank, Ground, Linkage, RRRDyad

    def move_linkages() -> None:
        for _ in range(count):
            crank_ground = Ground(0.0, 0.0)
            rocker_ground = Ground(4.0, 0.0)
            angle_per_step = 2.0 * np.pi / case.samples
            crank = Crank(
                crank_ground, 1.0, angular_velocity=angle_per_step, initial_angle=0.0
            )
            dyad = RRRDyad(crank.output, rocker_ground, 3.5, 3.0, 2.5, 2.5)
            linkage = Linkage([crank_ground, rocker_ground, crank, dyad])
            list(linkage.step(iterations=case.samples))

    return move_linkages
