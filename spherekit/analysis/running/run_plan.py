"""A run made ready: what is evaluated for whom, in blocks of how many samples."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, reduce
from typing import Any, final

from spherekit.analysis.contract import AbstractAnalysis, Needs
from spherekit.analysis.declared import declared
from spherekit.analysis.folder.resource_check import need_memory
from spherekit.analysis.requests import requests_for
from spherekit.analysis.result import MOTION
from spherekit.analysis.running.evaluation import Evaluation
from spherekit.analysis.running.motion_table import motion_table
from spherekit.analysis.running.run_state import identity_of
from spherekit.analysis.running.sampling import EVENTS, Sampling
from spherekit.analysis.running.setting import Setting
from spherekit.analysis.tables import Table
from spherekit.errors import AnalysisError, PluginError
from spherekit.model.mechanism import Mechanism
from spherekit.planning.poles import Plan
from spherekit.rates.request import Request


@final
@dataclass(frozen=True)
class RunPlan:
    """What a run evaluates: `needs` of each of the `analyses`, a request for each input.

    Of `block` samples at once. `refused` says of analyses that break the contract why they
    are not asked.
    """

    course: Sampling
    analyses: tuple[AbstractAnalysis, ...]
    needs: tuple[Needs, ...]
    requests: tuple[Request, ...]
    block: int
    evaluation: Evaluation
    refused: Mapping[str, str] = field(default_factory=dict)

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism, driven as the run drives it."""
        return self.course.tracer.mechanism

    @property
    def plans(self) -> tuple[Plan, ...]:
        """The plan of each input that moves alone."""
        return tuple(item.plan for item in self.requests)

    @property
    def is_single_block(self) -> bool:
        """Whether all samples are evaluated at once."""
        return self.block >= len(self.course)

    @property
    def at_once(self) -> tuple[str, ...]:
        """Names of the analyses that look at all samples at once."""
        return tuple(
            analysis.name
            for analysis in self.analyses
            if analysis.at_once and analysis.name not in self.refused
        )

    @cached_property
    def identity(self) -> dict[str, Any]:
        """What makes the run the one it is, ready for JSON."""
        return identity_of(self.course, self.analyses, self.block, self.evaluation.setting)

    def tables_of(self, analysis: AbstractAnalysis) -> tuple[Table, ...]:
        """Return the tables of an analysis."""
        return tuple(table.of(self.mechanism) for table in analysis.tables)

    @cached_property
    def motion_tables(self) -> tuple[Table, ...]:
        """The table of the motion, and of what happened in a simulation.

        None where no motion is traced.
        """
        if not self.course.tracer.assembly_modes:
            return ()
        table = motion_table(self.course)
        return (table,) if self.course.simulation is None else (table, EVENTS)

    def tables(self, failed: Collection[str] = ()) -> Mapping[str, tuple[Table, ...]]:
        """Return the tables of the motion and of all analyses but those that failed."""
        return {MOTION: self.motion_tables} | {
            analysis.name: self.tables_of(analysis)
            for analysis in self.analyses
            if analysis.name not in failed
        }


def job_of(
    course: Sampling,
    analyses: Sequence[AbstractAnalysis],
    block: int | None,
    setting: Setting,
    all_links: bool,
) -> RunPlan:
    """Return the job of analyses over a course.

    `block` is the samples wanted at once, and `all_links` says whether scenes show all
    links; see `spherekit.run` for the others.

    Raises
    ------
    AnalysisError, EngineError, PlanError
        If an analysis refuses the mechanism, the setting does not apply, or all samples at
        once need more memory than there is.
    """
    mechanism, tracer = course.tracer.mechanism, course.tracer
    own, refused = [], {}
    for analysis in analyses:
        try:
            own.append(declared(analysis, mechanism))
        except PluginError as fault:
            refused[analysis.name] = str(fault)
            own.append(Needs())
    _need_times(course, analyses, own)
    together = reduce(Needs.union, own, Needs())
    wanted = requests_for(mechanism, together, tracer.by_rank)
    evaluation = Evaluation(setting, course, wanted, together, all_links)
    whole = [each.name for each in analyses if each.name not in refused and each.at_once]
    if whole:
        block = len(course)
        need_memory(mechanism, block * len(tracer.assembly_modes), whole)
    block = min(block or tracer.block, len(course))
    return RunPlan(course, tuple(analyses), tuple(own), wanted, block, evaluation, refused)


def _need_times(
    course: Sampling, chosen: Sequence[AbstractAnalysis], own: Sequence[Needs]
) -> None:
    for analysis, what in zip(chosen, own, strict=True):
        if what.time and course.timing is None:
            raise AnalysisError(
                f"{analysis.name}: needs time, but with several inputs nothing says how "
                "they move; give a law for every input, and a duration"
            )
