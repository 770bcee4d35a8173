"""What a conformance check found: one named line for each thing that it looks at.

An analysis asked for the samples of one mechanism, in blocks, on data made hostile.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from spherekit.errors import PluginError, SpherekitError
from spherekit.files.study import Study
from spherekit.mechanism.mechanism import Mechanism
from spherekit.positions.motion import Motion
from spherekit.runs.analysis_faults import convert_plugin_errors
from spherekit.runs.batch import Batch
from spherekit.runs.contract import AbstractAnalysis, Findings
from spherekit.runs.result_checks import compute_findings
from spherekit.runs.run_plan import RunPlan, collect_needs, make_run_plan
from spherekit.runs.sampling import Sampling, make_sampling
from spherekit.status import Status
from spherekit.tables.table import TableArrays

Verdict = Literal["holds", "FAILS", "not checked"]


@dataclass(frozen=True)
class Line:
    """One check: what it asks, whether that holds, and what was seen."""

    name: str
    verdict: Verdict
    note: str = ""

    def __str__(self) -> str:
        return f"{self.name:12s} {self.verdict:12s} {self.note}".rstrip()


@dataclass(frozen=True)
class Report:
    """The lines of a conformance check, in the order in which they were looked at."""

    analysis: str
    lines: tuple[Line, ...]

    @property
    def failing(self) -> tuple[Line, ...]:
        """The lines that do not hold."""
        return tuple(line for line in self.lines if line.verdict == "FAILS")

    def __iter__(self) -> Iterator[Line]:
        return iter(self.lines)

    def __getitem__(self, name: str) -> Line:
        return {line.name: line for line in self.lines}[name]

    def __str__(self) -> str:
        return "\n".join([f"conformance of {self.analysis}:", *map(str, self.lines)])


Change = Callable[[Motion], Motion]
Tables = Mapping[str, TableArrays]


def _kept(motion: Motion) -> Motion:
    return motion


@dataclass(frozen=True)
class ConformanceCase:
    """An analysis and what it is tried on: `samples` of each input's range."""

    analysis: AbstractAnalysis
    mechanism: Mechanism
    samples: int

    @cached_property
    def sampling(self) -> Sampling:
        """The samples, with the assembly modes."""
        return make_sampling(
            Study(self.mechanism.name, self.mechanism, samples=self.samples)
        )

    @cached_property
    def run_plan(self) -> RunPlan:
        """The run made ready.

        Raises
        ------
        PluginError
            If the analysis breaks the contract.
        """
        declared_needs = collect_needs(
            [self.analysis], self.sampling.position_analysis.mechanism
        )
        run_plan = make_run_plan(self.sampling, [self.analysis], declared_needs)
        for fault in run_plan.refused.values():
            raise PluginError(fault)
        return run_plan

    @cached_property
    def faults(self) -> dict[str, SpherekitError]:
        """What the analysis raises for all samples at once, by the method asked."""
        made: dict[str, SpherekitError] = {}
        for method in ("compute", "findings", "scene"):
            try:
                (batch,) = self.batches(len(self.sampling))
                with convert_plugin_errors(self.analysis.name, method):
                    getattr(self.analysis, method)(batch)
            except SpherekitError as fault:
                made[method] = fault
        return made

    @cached_property
    def whole(self) -> tuple[Tables, Findings]:
        """What the analysis gives for all samples at once."""
        return self.given(len(self.sampling))

    def batches(
        self, size: int, change: Change = _kept, shown: Change = _kept
    ) -> list[Batch]:
        """Return the batches of a run in blocks of a size.

        `change` changes the motion that poles and angles follow from, `shown` what the
        analysis then sees of it.
        """
        run_plan = self.run_plan
        made = [
            run_plan.make_batch(self.analysis, shown(motion), fields, angles)
            for motion, fields, angles in run_plan.evaluate_blocks(
                map(change, run_plan.source.blocks(size))
            )
        ]
        return made if self.analysis.reads_samples else made[:1]

    def given(
        self, size: int, change: Change = _kept, shown: Change = _kept
    ) -> tuple[Tables, Findings]:
        """Return tables and findings of a run in blocks of a size.

        Raises
        ------
        SpherekitError
            See `spherekit.runs.result_checks`.
        """
        findings = None
        batches = self.batches(size, change, shown)
        tables = self.run_plan.join_tables(self.analysis, batches)
        for batch in batches:
            findings = compute_findings(self.analysis, batch, findings)
        assert findings is not None
        return tables, findings

    def only_declared(self, motion: Motion) -> Motion:
        """Return a motion with NaN for what the analysis has not declared.

        For orientations of links, and variables of pairs.
        """
        needs = self.run_plan.needs[0]
        mechanism = motion.mechanism
        links = [mechanism.link_number[name] for name in needs.rotations]
        pairs = [mechanism.pair_number[name] for name in needs.pair_values]
        kept = [v for pair in pairs for v in mechanism.variables_of(pair)]
        rotations = np.full_like(motion.rotations, np.nan)
        values = np.full_like(motion.values, np.nan)
        rotations[:, links] = motion.rotations[:, links]
        values[:, kept] = motion.values[:, kept]
        made = replace(motion, placed=rotations, values=values)
        vars(made).update(
            rotations=rotations,
            linearisation=motion.linearisation,  # this follows from all, and the next
            conditioning=motion.conditioning,
        )
        return made


def failed_at(row: int) -> Change:
    """Return what makes a row of a motion one without a configuration."""

    def change(motion: Motion) -> Motion:
        values = motion.values.copy()
        placed = motion.rotations.copy()
        residual = motion.residual.copy()
        status = motion.status.copy()
        for numbers in (values, placed, residual):
            numbers[row] = np.nan
        status[row] = Status.OUT_OF_REACH
        return replace(
            motion, values=values, placed=placed, residual=residual, status=status
        )

    return change
