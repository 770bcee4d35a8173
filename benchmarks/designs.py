"""Designs: one kernel for all of a topology beside one analysis for each."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np

import spherekit as sk
from benchmarks.report import Cell, Section
from benchmarks.timing import median, ratio, rounds
from spherekit.analysis.merit import parse_merit
from spherekit.design.evaluate import Evaluator
from spherekit.design.samples import DesignSamples
from spherekit.design.variables import design_variable
from spherekit.files.change import document_of
from spherekit.files.read import read
from spherekit.model.study import Study

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

    def evaluator(self) -> Evaluator:
        """Return what computes the figures."""
        document = document_of(self.name)
        mechanism = read(document)
        return Evaluator(
            document,
            mechanism,
            [design_variable(document, key) for key in self.keys],
            [parse_merit(text, DEG) for text in self.merits],
            DesignSamples.of(Study(self.name, mechanism, samples=self.samples)),
        )

    def designs(self, count: int) -> Any:
        """Return random designs (variables, count) about the file's own."""
        document = document_of(self.name)
        own = np.array([design_variable(document, key).value for key in self.keys])
        rng = np.random.default_rng(1)
        return own[:, None] + self.spread * rng.uniform(-1.0, 1.0, (len(own), count))


ARCS = ("links.1.arc", "links.2.arc", "links.3.arc", "links.4.arc")
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
)


def run(quick: bool) -> list[Section]:
    """Return what a design costs in one kernel, on arrays, and on its own."""
    rows: list[tuple[Cell, ...]] = []
    for case in CASES:
        count = 4096 if quick else 32768
        evaluator, designs = case.evaluator(), case.designs(count)
        few = designs[:, :4]
        changed = [_sizes(case, values) for values in few.T]
        jobs = {
            "kernel": lambda e=evaluator, d=designs: e.at(d),
            "alone": lambda made=changed, c=case: [
                sk.run(each, "poles", samples=c.samples) for each in made
            ],
        }
        times = rounds(jobs, 3, now=time.process_time)
        found = evaluator.at(designs)
        closing = int(np.sum(found.closes > 0.0))
        modes = 2 ** len(evaluator.kernel.places) if evaluator.kernel else 1
        each = median(times, "kernel") / count
        rows.append(
            (
                f"{case.name}, {', '.join(m.split('=')[0] for m in case.merits)}",
                count,
                closing,
                1e6 * each,
                1e9 * each / (modes * case.samples),
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
                "ns a configuration",
                "alone over kernel",
            ),
            rows,
            ratios=("alone over kernel",),
        )
    ]


def _sizes(case: Case, values: Sequence[float]) -> sk.Mechanism:
    mechanism = sk.load(case.name)
    arcs: dict[str, Mapping[str, float]] = {}
    for key, value in zip(case.keys, values, strict=True):
        _, link, *rest = key.split(".")
        leads = rest[1] if len(rest) > 1 else mechanism.geometry.links[link].axes[1]  # type: ignore[union-attr]
        arcs[link] = {**arcs.get(link, {}), leads: float(value)}
    return mechanism.with_sizes(angle_unit="deg", arcs=arcs)
