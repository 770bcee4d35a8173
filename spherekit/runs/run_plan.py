"""The summary of a run: what was run, how far it came, what it found and what it took.

And what is said of rows that were verified in many digits.

A run made ready: what is evaluated for whom, of which part, in which blocks.
"""

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property, reduce

from spherekit.conventions import Facts
from spherekit.errors import AnalysisError, PluginError
from spherekit.files.mechanism_writer import mechanism_hash
from spherekit.files.study import Study
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.assembly_plan import driven_at
from spherekit.planning.pole_plan import Plan
from spherekit.planning.submechanism import part_for
from spherekit.positions.angle_unwrapping import LastAngles
from spherekit.positions.motion import Motion
from spherekit.runs.analysis_requests import requests_for
from spherekit.runs.batch_runner import BatchRunner
from spherekit.runs.contract import AbstractAnalysis, Analyses
from spherekit.runs.declaration_checks import declared
from spherekit.runs.evaluation_options import ORDINARY, Setting
from spherekit.runs.needs import Needs
from spherekit.runs.result_checks import computed
from spherekit.runs.run_folder import StoredParts, code_identity, need_memory
from spherekit.runs.run_result import MOTION
from spherekit.runs.run_state import RunState, digest, identities_of
from spherekit.runs.sampled_poles import evaluate_sample
from spherekit.runs.sampling import EVENTS, Sampling
from spherekit.runs.table_scenes import Angles, Batch, Fields, run_status
from spherekit.symbolic.compiler import heyoka
from spherekit.tables.table import (
    ASSEMBLY_MODE,
    INPUTS,
    RESIDUAL,
    SAMPLE,
    STATUS,
    TIME,
    Column,
    Table,
    TableArrays,
    TableData,
    input_columns,
)
from spherekit.tables.table_rows import InMemory, JoinedBlocks
from spherekit.velocities.direction_signs import SignContinuation
from spherekit.velocities.pole_evaluation import evaluate
from spherekit.velocities.pole_request import Request

Read = tuple[Motion, Fields, Angles]
"""A motion, its poles for each input, and the variables that go on, by pair."""


@dataclass(frozen=True)
class RunPlan:
    """What a run evaluates: analyses with their needs, a request for each input.

    By a `setting`; the motion is that of a `source`, of `block` samples at once. Analyses
    that break the contract are `refused`, and not asked.
    """

    course: Sampling
    analyses: Analyses
    needs: Sequence[Needs]
    refused: Mapping[str, str]
    requests: tuple[Request, ...]
    setting: Setting
    source: BatchRunner | Sampling
    block: int
    at_once: list[str]
    """Names of the analyses that look at all samples at once."""
    most_poles: int | None = None
    """How many poles are evaluated, if only the size of tables is measured."""

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

    def read(self, motions: Iterable[Motion]) -> Iterator[Read]:
        """Yield motions that follow each other with what analyses read of them."""
        signs = [SignContinuation() for _ in self.requests]
        last = LastAngles()
        for motion in motions:
            yield motion, self.fields(motion, signs), self.angles(motion, last)

    def fields(self, motion: Motion, memories: Sequence[SignContinuation]) -> Fields:
        """Return the poles of a block of the source for each input that moves."""
        if isinstance(self.source, BatchRunner) and id(motion) in self.source.unread:
            return self.source.fields(motion, memories)
        if self.most_poles is not None:
            return tuple(
                evaluate_sample(motion, item, self.most_poles)
                for item in self.requests
                if item.poles
            )
        return tuple(
            evaluate(motion, item, memory, self.setting.route, self.setting.engine)
            for item, memory in zip(self.requests, memories, strict=True)
            if item.poles
        )

    def angles(self, motion: Motion, last: LastAngles) -> Angles:
        """Return the variables that go on, by pair, at a block of the source."""
        names = frozenset[str]().union(*(needs.continued_values for needs in self.needs))
        return self.course.angles(motion, sorted(names), last) if names else {}

    def batch(
        self,
        analysis: AbstractAnalysis,
        motion: Motion,
        fields: Fields,
        angles: Angles,
    ) -> Batch:
        """Return what an analysis may read of a block."""
        course = self.course
        return Batch(
            self.mechanism,
            self.plans,
            self.needs[self.analyses.index(analysis)],
            motion,
            fields,
            angles,
            course.timed,
            course.tracer,
            course.extents,
        )

    def given(self, analysis: AbstractAnalysis, batch: Batch) -> dict[str, TableData]:
        """Return the tables that an analysis gives; see `computed` for what it raises."""
        return computed(analysis, self.tables_of(analysis), batch)

    def collected(
        self, analysis: AbstractAnalysis, batches: Iterable[Batch]
    ) -> dict[str, TableArrays]:
        """Return the tables that an analysis gives of successive batches, in memory."""
        given = [self.given(analysis, batch) for batch in batches]
        return {
            table.name: JoinedBlocks([tables[table.name] for tables in given], table)
            for table in self.tables_of(analysis)
        }

    def hand_over(
        self,
        name: str,
        table: Table,
        rows: TableData,
        standing: RunState,
        store: StoredParts | InMemory | None,
        batch: Batch | None = None,
    ) -> None:
        """Store and count rows of a block, with the names of assembly modes."""
        if store is not None:
            stored = table.with_names(self.mechanism)
            names = {x.number: x.name for x in self.course.tracer.assembly_modes if x.name}
            store.add(name, stored, stored.named(rows, names))
        # Rows of an analysis that reads no samples are not those of the batch.
        by_sample = all(x.reads_samples for x in self.analyses if x.name == name)
        standing.add_rows(name, table, rows, batch, by_sample)

    @cached_property
    def identity(self) -> Facts:
        """What makes the run the one it is, ready for JSON.

        Two runs with the same identity give the same bits on one machine.
        """
        course = self.course
        source = self.source
        simulation = course.simulation
        timing = course.timing
        return code_identity() | {
            "mechanism": self.mechanism.name,
            "mechanism_hash": mechanism_hash(self.mechanism),
            "inputs": course.tracer.inputs,
            "samples": "x".join(map(str, course.shape)),
            "assembly_modes": [[m.number, m.label] for m in course.tracer.assembly_modes],
            # Work of earlier versions has no such key.
            **({"crossings": "pass"} if course.tracer.crossings == "pass" else {}),
            "analyses": identities_of(self.analyses),
            "engine": None if simulation is None else simulation.engine.name,
            "tolerance": course.tolerance,
            "setting": asdict(self.setting),
            "over_time": course.timed,
            "input_values": digest(course.inputs),
            "times": [] if timing is None else [digest(x) for x in vars(timing).values()],
            "samples_in_a_block": self.block,
            "kernel": source.kernel.engine if isinstance(source, BatchRunner) else None,
        }

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
        events = [] if self.course.simulation is None else [EVENTS.of(self.mechanism)]
        return motion_table(self.course), *events

    def tables(self, failed: Collection[str] = ()) -> Mapping[str, tuple[Table, ...]]:
        """Return the tables of the motion and of all analyses but those that failed.

        With the names of assembly modes.
        """
        plain = {MOTION: self.motion_tables} | {
            analysis.name: self.tables_of(analysis)
            for analysis in self.analyses
            if analysis.name not in failed
        }
        return {
            name: tuple(table.with_names(self.mechanism) for table in tables)
            for name, tables in plain.items()
        }


Asked = tuple[Sequence[Needs], Mapping[str, str]]
"""What each analysis needs, and by name why those that break the contract go."""


def needs_of_each(analyses: Analyses, mechanism: Mechanism) -> Asked:
    """Return what each analysis needs, and by name why those that break the contract go.

    All that can be said against them and their parameters has been said then. Errors as
    `declared`, but for plugins' own; `AnalysisError` too where one is asked for twice: its
    tables have one place.
    """
    mechanism = driven_at(mechanism)
    needs = []
    refused = {}
    for name, count in Counter(analysis.name for analysis in analyses).items():
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
    return needs, refused


def job_of(
    course: Sampling,
    analyses: Analyses,
    asked: Asked,
    block: int | None = None,
    setting: Setting = ORDINARY,
    all_links: bool = False,
) -> RunPlan:
    """Return the job of analyses over a course; `asked` is what `needs_of_each` gives.

    A kernel may stand in for the best route at every sample.

    `block` is the samples wanted at once, and `all_links` says whether scenes show all
    links; see `spherekit.run` for the others.

    Raises
    ------
    AnalysisError, EngineError, PlanError
        If the setting does not apply, an analysis needs times and there are none, or all
        samples at once need more memory than there is.
    """
    tracer = course.tracer
    needs, refused = asked
    for analysis, what in zip(analyses, needs, strict=True):
        if what.time and course.timing is None:
            raise AnalysisError(
                f"{analysis.name}: needs time, but with several inputs nothing says how "
                "they move; give a law for every input, and a duration"
            )
    together = reduce(Needs.union, needs, Needs())
    wanted = requests_for(tracer.mechanism, together, tracer.by_rank)
    source: BatchRunner | Sampling = course
    if setting.engine == "compiled":
        heyoka()
    if setting == ORDINARY:
        moving = [item for item in wanted if item.poles]
        ahead = not together.tracer
        source = (
            BatchRunner.of(
                course,
                moving,
                all_links,
                ahead,
                together.time or all_links or course.timed,
                bool(together.rotations),
            )
            or course
        )
    whole = [x.name for x in analyses if x.name not in refused and x.at_once]
    if whole:
        block = len(course)
        need_memory(tracer.mechanism, block * len(tracer.assembly_modes), whole)
    block = min(block or source.block, len(course))
    return RunPlan(course, analyses, *asked, wanted, setting, source, block, whole)


def motion_table(course: Sampling) -> Table:
    """Return the table of the configurations of a course."""
    mechanism = course.tracer.mechanism
    variables = [
        Column(name, "rad", f"variable of pair {pair}")
        for name, pair in zip(
            mechanism.variable_names,
            mechanism.names_of(mechanism.variable_owners),
            strict=True,
        )
    ]
    return Table(
        MOTION,
        "the configurations: one row per sample and assembly mode",
        (
            SAMPLE,
            ASSEMBLY_MODE,
            *([TIME] if course.timed else []),
            INPUTS,
            *variables,
            RESIDUAL,
            STATUS,
        ),
    ).of(mechanism)


def motion_rows(course: Sampling, motion: Motion, fields: Fields) -> TableArrays:
    """Return the rows of a block of a course whose poles were found."""
    mechanism = course.tracer.mechanism
    return {
        "sample": motion.sample,
        "assembly_mode": motion.assembly_mode,
        **({"t": motion.timing.t} if course.timed and motion.timing else {}),
        **input_columns(mechanism, motion.inputs),
        **dict(zip(mechanism.variable_names, motion.values.T, strict=True)),
        "residual": motion.residual,
        "status": run_status(motion, fields),
    }


def links_of(mechanism: Mechanism, needs: Needs) -> frozenset[int]:
    """Return the numbers of the links whose placement something declared depends on."""
    poles = needs.directions | needs.rates | needs.planes | needs.turns
    pairs = needs.pair_values | needs.continued_values | needs.pair_rates
    ends = (mechanism.pair(pair).links for pair in pairs)
    names = needs.rotations.union(needs.link_rates, *ends)
    return needs.links.union(*poles, (mechanism.link_number[name] for name in names))


def needed_part(study: Study, analyses: Analyses) -> Mechanism:
    """Return the mechanism of a study without what no analysis needs.

    Raises
    ------
    AnalysisError
        If an analysis does not declare what it reads, so that it may read anything, or
        the motion follows from loads on all links.
    PlanError
        If there is not one freedom for each input.
    """
    mechanism = study.mechanism
    if study.start is not None:
        raise AnalysisError(
            f"{mechanism.name}: a motion that follows from loads needs all links; run it "
            "without only_needed (--only-needed)"
        )
    wanted: frozenset[int] = frozenset()
    for analysis in analyses:
        try:
            needs = declared(analysis, mechanism)
        except PluginError:
            continue  # the run says so
        links = links_of(mechanism, needs)
        if not (needs.links if needs.tracer else links):
            raise AnalysisError(
                f"{analysis.name}: looks at the whole mechanism, so no part of it can be "
                "left out; run it without only_needed (--only-needed)"
            )
        wanted |= links
    return part_for(mechanism, wanted)


def left_out(whole: Mechanism, part: Mechanism) -> Facts:
    """Return what a part lacks, with the fingerprint of the whole, ready for JSON."""
    return {
        "mechanism_hash": mechanism_hash(whole),
        "left_out_links": [link for link in whole.links if link not in part.links],
        "left_out_pairs": [p.name for p in whole.pairs if p.name not in part.pair_number],
    }
