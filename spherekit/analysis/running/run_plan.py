"""A run made ready: what is evaluated for whom, in blocks of how many samples."""

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, reduce
from typing import Any, Self, final

from spherekit.analysis.contract import AbstractAnalysis
from spherekit.analysis.declared import declared
from spherekit.analysis.folder.resource_check import need_memory
from spherekit.analysis.needs import Needs
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
from spherekit.planning.inputs import driven_at
from spherekit.planning.poles import Plan
from spherekit.rates.request import Request


@final
@dataclass(frozen=True)
class RunPlan:
    """What a run evaluates: what is `asked`, a request for each input.

    Of `block` samples at once.
    """

    course: Sampling
    asked: "Asked"
    requests: tuple[Request, ...]
    block: int
    evaluation: Evaluation

    @property
    def analyses(self) -> tuple[AbstractAnalysis, ...]:
        """All analyses that are asked for."""
        return self.asked.analyses

    @property
    def needs(self) -> tuple[Needs, ...]:
        """What each of them needs."""
        return self.asked.needs

    @property
    def refused(self) -> Mapping[str, str]:
        """Why those that break the contract are not asked, by name."""
        return self.asked.refused

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
        return self.block >= self.course.total and not self.course.going_on

    @property
    def at_once(self) -> tuple[str, ...]:
        """Names of the analyses that look at all samples at once."""
        return tuple(self.asked.at_once)

    def over(self, course: Sampling) -> "RunPlan":
        """Return it for a course that is known further, or has begun again."""
        made = self.evaluation
        evaluation = Evaluation(made.setting, course, self.requests, made.needs)
        return replace(self, course=course, evaluation=evaluation)

    @property
    def identity(self) -> dict[str, Any]:
        """What makes the run the one it is, ready for JSON."""
        made, at_once = self.evaluation, self.evaluation.at_once
        kernel = None if at_once is None else at_once.kernel.engine
        identity = identity_of(self.course, self.analyses, self.block, made.setting)
        return identity | {"kernel": kernel}

    def tables_of(self, analysis: AbstractAnalysis) -> tuple[Table, ...]:
        """Return the tables of an analysis."""
        return tuple(table.of(self.mechanism) for table in analysis.tables)

    def stored_tables_of(self, analysis: AbstractAnalysis) -> tuple[Table, ...]:
        """Return the tables of an analysis, with the names of assembly modes."""
        return tuple(t.with_names(self.mechanism) for t in self.tables_of(analysis))

    @property
    def names(self) -> Mapping[int, str]:
        """The names of assembly modes, by their numbers."""
        return {m.number: m.name for m in self.course.tracer.assembly_modes if m.name}

    @cached_property
    def motion_tables(self) -> tuple[Table, ...]:
        """The table of the motion, and of what happened in a simulation.

        None where no motion is traced.
        """
        if not self.course.tracer.assembly_modes:
            return ()
        table = motion_table(self.course).with_names(self.mechanism)
        return (
            (table,)
            if self.course.simulation is None
            else (table, EVENTS.of(self.mechanism))
        )

    def tables(self, failed: Collection[str] = ()) -> Mapping[str, tuple[Table, ...]]:
        """Return the tables of the motion and of all analyses but those that failed."""
        return {MOTION: self.motion_tables} | {
            analysis.name: self.stored_tables_of(analysis)
            for analysis in self.analyses
            if analysis.name not in failed
        }


@final
@dataclass(frozen=True)
class Asked:
    """What analyses need of a mechanism, and why those that break the contract do not run.

    All that can be said against them and their parameters has been said.
    """

    analyses: tuple[AbstractAnalysis, ...]
    needs: tuple[Needs, ...]
    refused: Mapping[str, str]

    @classmethod
    def of(cls, analyses: Sequence[AbstractAnalysis], mechanism: Mechanism) -> Self:
        """Ask analyses what they need; errors as `declared`, but for plugins' own.

        Raises `AnalysisError` too where one is asked for twice: its tables have one place.
        """
        mechanism = driven_at(mechanism)
        needs, refused = [], {}
        counts = Counter(analysis.name for analysis in analyses)
        for name, count in counts.items():
            if count > 1:
                raise AnalysisError(
                    f"{name}: is asked for {count} times in one run, whose tables have one "
                    "place; ask once, with lists joined by + (poles:only=31+42), or run "
                    "twice"
                )
        for analysis in analyses:
            try:
                needs.append(declared(analysis, mechanism))
            except PluginError as fault:
                refused[analysis.name] = str(fault)
                needs.append(Needs())
        return cls(tuple(analyses), tuple(needs), refused)

    @property
    def at_once(self) -> list[str]:
        """Names of the analyses that look at all samples at once."""
        return [
            analysis.name
            for analysis in self.analyses
            if analysis.name not in self.refused and analysis.at_once
        ]


def job_of(
    course: Sampling, asked: Asked, block: int | None, setting: Setting, all_links: bool
) -> RunPlan:
    """Return the job of analyses over a course.

    `block` is the samples wanted at once, and `all_links` says whether scenes show all
    links; see `spherekit.run` for the others.

    Raises
    ------
    AnalysisError, EngineError, PlanError
        If the setting does not apply, an analysis needs times and there are none, or all
        samples at once need more memory than there is.
    """
    mechanism, tracer = course.tracer.mechanism, course.tracer
    _need_times(course, asked)
    together = reduce(Needs.union, asked.needs, Needs())
    wanted = requests_for(mechanism, together, tracer.by_rank)
    evaluation = Evaluation(setting, course, wanted, together, all_links)
    if asked.at_once:
        block = course.total
        need_memory(mechanism, block * len(tracer.assembly_modes), asked.at_once)
    block = min(block or evaluation.block, course.total)
    return RunPlan(course, asked, wanted, block, evaluation)


def _need_times(course: Sampling, asked: Asked) -> None:
    for analysis, what in zip(asked.analyses, asked.needs, strict=True):
        if what.time and course.clock is None:
            raise AnalysisError(
                f"{analysis.name}: needs time, but with several inputs nothing says how "
                "they move; give a law for every input, and a duration"
            )
