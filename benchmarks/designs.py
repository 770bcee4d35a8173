"""Designs: one kernel of a topology beside an analysis, or a peer's model, of each."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any, final

import numpy as np

import spherekit as sk
from benchmarks.harness import Cell, Section, median, ratio, rounds
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

DEG = np.pi / 180.0


@final
@dataclass(frozen=True)
class Case:
    """A mechanism, the sizes that are varied, and the figures of merit."""

    name: str
    keys: tuple[str, ...]
    merits: tuple[str, ...]
    samples: int
    spread: float

    def evaluator(self) -> DesignEvaluator:
        """Return what computes the figures."""
        document = document_of(self.name)
        mechanism = read(document)
        return DesignEvaluator(
            document,
            mechanism,
            [design_variable(document, key) for key in self.keys],
            [parse_merit(text, DEG) for text in self.merits],
            DesignSamples.from_study(Study(self.name, mechanism, samples=self.samples)),
        )

    def design(self, values: Sequence[float]) -> Mechanism:
        """Return the mechanism of one design."""
        document = document_of(self.name)
        own = [design_variable(document, key) for key in self.keys]
        return make_design(document, own, values)

    def designs(self, count: int) -> Any:
        """Return random designs (variables, count) about the file's own."""
        document = document_of(self.name)
        own = np.array([design_variable(document, key).value for key in self.keys])
        rng = np.random.default_rng(1)
        return own[:, None] + self.spread * rng.uniform(-1.0, 1.0, (len(own), count))


ARCS = ("links.1.arc", "links.2.arc", "links.3.arc", "links.4.arc")
POSES = tuple(f"pairs.{pair}.{k}" for pair in "ACDF" for k in ("longitude", "latitude"))
FLIER = tuple(
    f"pairs.{pair}.{k}" for pair in ("14", "23", "68") for k in ("longitude", "latitude")
)
CASES = (
    Case(
        "four_bar",
        ARCS,
        (
            "least=min(transmission_angle_43)",
            "largest=max(abs(rate_41))",
            "swing=swing(theta_41)",
        ),
        361,
        15.0,
    ),
    Case(
        "four_bar",
        ARCS,
        ("torque=max(abs(torque))", "inertia=max(B)"),
        361,
        15.0,
    ),
    Case(
        "stephenson",
        ("links.1.arcs.14", "links.2.arc", "links.3.arcs.35", "links.6.arc"),
        (
            "least=min(transmission_angle_34)",
            "second=min(transmission_angle_56)",
            "largest=max(abs(rate_16))",
        ),
        361,
        5.0,
    ),
    Case(
        "single_flier",
        FLIER,
        ("swing=swing(theta_15)", "largest=max(abs(rate_67))"),
        73,
        5.0,
    ),
    Case(
        "double_butterfly",
        POSES,
        ("swing=swing(theta_B)", "largest=max(abs(rate_B))"),
        73,
        5.0,
    ),
)


def run(quick: bool) -> list[Section]:
    """Return what a design costs in one kernel, on arrays, and on its own."""
    rows: list[tuple[Cell, ...]] = []
    for case in CASES:
        evaluator = case.evaluator()
        count = 4096 if quick else 32768
        if evaluator.tracks_solutions:
            count = MAX_TRACKED_DESIGNS // 12 if quick else MAX_TRACKED_DESIGNS
        designs = case.designs(count)
        changed = [case.design(values) for values in designs[:, :2].T]
        jobs = {
            "kernel": lambda e=evaluator, d=designs: e.at(d),
            "alone": lambda made=changed, c=case: [
                sk.run(each, "poles", samples=c.samples) for each in made
            ],
        }
        closed_form = evaluator.kernel is not None and evaluator.kernel.is_closed_form
        times = rounds(jobs, 3 if closed_form else 1, now=time.process_time)
        found = evaluator.evaluate(designs)
        closing = int(np.sum(found.closes > 0.0))
        each = median(times, "kernel") / count
        rows.append(
            (
                f"{case.name}, {', '.join(m.split('=')[0] for m in case.merits)}",
                count,
                closing,
                1e6 * each,
                1e9 * each * count / (closing * case.samples),
                ratio(times, "alone", "kernel") * count / len(changed),
            )
        )
    return [
        Section(
            "Designs",
            "Figures of merit of random designs in all modes over a turn, in processor "
            "time of one core; beside it `sk.run` of poles of each design on its own.",
            (
                "mechanism and figures",
                "designs",
                "rows that close",
                "us a design",
                "ns a row and sample",
                "alone over kernel",
            ),
            rows,
        ),
        _peers(CASES[0], 100 if quick else 1000),
    ]


def _peers(case: Case, count: int) -> Section:
    """Return what a design costs where a peer makes a model of each."""
    evaluator, designs = case.evaluator(), case.designs(count)
    jobs: dict[str, Callable[[], object]] = {
        "spherekit, both modes, three figures": lambda: evaluator.evaluate(designs),
    }
    (unit,) = jobs
    if find_spec("mujoco") is not None:
        jobs["MuJoCo, one mode: model from XML, mj_forward at each sample"] = _mujoco(
            case, count
        )
    if find_spec("pylinkage") is not None:
        jobs["pylinkage, one mode of the planar limit: linkage, steps"] = _planar(
            case, count
        )
    evaluator.evaluate(designs)
    times = rounds(jobs, 3, now=time.process_time)
    rows = [
        (name, ratio(times, name, unit), 1e6 * median(times, name) / count) for name in jobs
    ]
    return Section(
        "Designs beside peers",
        f"{count} random four-bars at {case.samples} inputs, processor time. MuJoCo "
        "computes the dynamics at each sample and does not close the loop there, so this "
        "is less than positions would take; making the XML is not counted.",
        ("job", f"over {unit}", "us a design"),
        rows,
    )


def _mujoco(case: Case, count: int) -> Callable[[], object]:
    import mujoco

    mechanism = sk.load(case.name)
    values = PositionAnalysis(mechanism, samples=2).motion().values[0]
    text = MujocoModel(mechanism, values, 1e-3).text

    def job() -> None:
        for _ in range(count):
            model: Any = mujoco.MjModel.from_xml_string(text)
            data = mujoco.MjData(model)
            for q in np.linspace(0.0, 2.0 * np.pi, case.samples):
                data.qpos[0] = q
                mujoco.mj_forward(model, data)

    return job


def _planar(case: Case, count: int) -> Callable[[], object]:
    from pylinkage import Crank, Ground, Linkage, RRRDyad

    def job() -> None:
        for _ in range(count):
            left, right = Ground(0.0, 0.0), Ground(4.0, 0.0)
            turn = 2.0 * np.pi / case.samples
            crank = Crank(left, 1.0, angular_velocity=turn, initial_angle=0.0)
            dyad = RRRDyad(crank.output, right, 3.5, 3.0, 2.5, 2.5)
            list(Linkage([left, right, crank, dyad]).step(iterations=case.samples))

    return job
