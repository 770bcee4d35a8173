"""The summary of a run: what was run, how far it came, what it found and what it took.

And what is said of rows that were verified in many digits.

A run made ready: what is evaluated for whom, of which part, in which blocks.
"""

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property, reduce
from typing import Any, NamedTuple

import numpy as np

from spherekit.analysis.batch import Angles, Batch, Fields, Needs, run_status
from spherekit.analysis.computed import computed
from spherekit.analysis.contract import AbstractAnalysis, Analyses, Findings
from spherekit.analysis.declared import declared
from spherekit.analysis.folder import StoredParts, code_identity, need_memory
from spherekit.analysis.result import MOTION, stems
from spherekit.analysis.rows import InMemory, JoinedBlocks
from spherekit.analysis.running.cost import RECORDING, Timer, counts_of
from spherekit.analysis.running.evaluation import ORDINARY, Setting
from spherekit.analysis.running.rows_at_once import BatchRunner
from spherekit.analysis.running.run_state import (
    BY_EQUATIONS,
    MODE,
    ROWS,
    RunState,
    digest,
    identities_of,
)
from spherekit.analysis.running.sampled_poles import evaluate_sample
from spherekit.analysis.running.sampling import EVENTS, Sampling
from spherekit.analysis.study import requests_for
from spherekit.analysis.tables import (
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
from spherekit.conventions import CLOSURE_TOLERANCE, Facts, listing
from spherekit.engine.compiler import heyoka
from spherekit.engine.fields import evaluate
from spherekit.errors import AnalysisError, PluginError
from spherekit.files.write import mechanism_hash
from spherekit.model.mechanism import Mechanism
from spherekit.model.study import Study
from spherekit.motion.motion import LastAngles, Motion
from spherekit.planning.inputs import driven_at, graph_mobility
from spherekit.planning.part import part_for
from spherekit.planning.poles import Plan
from spherekit.rates.request import Request, SignContinuation
from spherekit.version import __version__

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


def with_counts(texts: Iterable[str]) -> list[str]:
    """Return each text once, in order, with a count if it is said several times."""
    return [
        text if count == 1 else f"{text} ({count} times)"
        for text, count in Counter(texts).items()
    ]


def summary_of(job: RunPlan, standing: RunState) -> Facts:
    """Return what is to be said of a run that is done, ready for JSON."""
    course, mechanism, findings = job.course, job.mechanism, standing.findings
    tracer = course.tracer
    told = {
        kind: [
            f"{name}: {text}"
            for name, item in findings.items()
            for text in with_counts(getattr(item, kind))
        ]
        for kind in ("remarks", "warnings")
    }
    return {
        "spherekit": __version__,
        "numpy": np.__version__,
        "mechanism": mechanism.name,
        "mechanism_hash": mechanism_hash(mechanism),
        "inputs": dict(zip(tracer.inputs, course.extents[0].T.tolist(), strict=True)),
        "inputs_unit": "rad",
        "sampling": "x".join(map(str, course.shape)),
        **course.summary(),
        "samples": standing.done,
        "samples_in_a_block": job.block,
        "mobility": {"graph": graph_mobility(mechanism), "rank": standing.rank},
        "redundant_constraints": standing.redundant,
        "groups": [group.kind for group in tracer.assembly.groups],
        "plans": {
            mechanism.pairs[plan.input].name: {
                "passes": max(plan.rounds.values(), default=0),
                "poles": len(plan.rounds),
                "irreducible_parts": [[*map(plan.name, x.links)] for x in plan.blocks],
            }
            for plan in job.plans
        },
        "assembly_modes": [
            {
                "number": item.number,
                "mode": item.label,
                **({"name": item.name} if item.name else {}),
                "status": standing.counted(MODE, str(item.number)),
            }
            for item in tracer.assembly_modes
        ],
        "search": tracer.search,
        "crossings": tracer.crossings,
        "mode_meetings": _mode_meetings(course),
        **standing.statuses(),
        "closure_tolerance_rad": CLOSURE_TOLERANCE,
        "errors_reached": standing.errors(),
        "analyses": [
            {
                "name": analysis.name,
                "version": analysis.version,
                "parameters": asdict(analysis),  # type: ignore[call-overload]
                "failed": analysis.name in standing.failures,
                "failed_rows": standing.failed_rows(analysis.name),
                "cites": analysis.cites,
                "findings": dict(findings.get(analysis.name, Findings()).figures),
            }
            for analysis in job.analyses
        ],
        "remarks": told["remarks"],
        "warnings": [*course.warnings, *told["warnings"]],
    }


def _mode_meetings(course: Sampling) -> list[Facts]:
    """Return where curves of modes cross, ready for JSON; simulations have events."""
    if course.simulation is not None:
        return []
    tracer = course.tracer
    meetings = zip(tracer.mode_meetings, tracer.meeting_sentences, strict=True)
    return [{**meeting.facts, "sentence": sentence} for meeting, sentence in meetings]


def actual_cost(job: RunPlan, standing: RunState, ledger: Timer, recorder: Any) -> Facts:
    """Return what was evaluated, made and logged, ready for JSON.

    A recorder that counts is finished. Bytes of tables are added when files are written.
    """
    logged = {}
    if hasattr(recorder, "finish"):
        with ledger.stage(RECORDING):
            recorder.finish()
        logged = {"recording": recorder.cost}
    simulation = job.course.simulation
    per_input = {
        job.mechanism.pairs[item.plan.input].name: counts_of(item) for item in job.requests
    }
    return {
        "configurations": standing.configurations,
        "each_configuration": per_input,
        **{
            name: standing.configurations * sum(item[name] for item in per_input.values())
            for name in ("poles", "axis_derivatives", "link_rates")
        },
        "velocity_equation_solves": standing.counts[BY_EQUATIONS,],
        "tables": {
            stem: {
                "rows": standing.counts[ROWS, name, table.name],
                "columns": len(table.columns),
            }
            for stem, (name, table) in stems(job.tables(standing.failures)).items()
        },
        **logged,
        "seconds": ledger.closed(),
        **({} if simulation is None else {"simulate": asdict(simulation.engine)}),
    }


class Bounded(NamedTuple):
    """A quantity of poles with an error bound, in words, and the name of the bound.

    It is that of an attribute of `PoleField`.
    """

    words: str
    bound: str


BOUNDED = {
    "directions": Bounded("pole directions", "error"),
    "rates": Bounded("rates", "velocity_coefficient_error"),
    "rate_derivatives": Bounded("derivatives of rates", "acceleration_coefficient_error"),
    "direction_derivatives": Bounded(
        "derivatives of pole directions", "direction_dq_error"
    ),
}
"""What has an error bound, by its name in a verdict."""


def told(verdict: Facts) -> list[str]:
    """Return a verdict in lines for people."""
    if "problem" in verdict:
        return [f"not verified: {verdict['problem']}"]
    if not verdict["rows"]:
        return ["verified: no row has a configuration and finite rates"]
    lines = [
        f"verified {verdict['rows']} rows in {verdict['digits']} digits "
        f"({verdict['seconds']:.1f} s): configurations within "
        f"{verdict['largest_distance_rad']:.1e} rad, conditioning up to "
        f"{verdict['largest_condition']:.1e}"
    ]
    variables = [item for item in verdict["columns"] if item["table"] == MOTION]
    shown = sorted(variables, key=lambda item: item["deviation"])[-1:]
    shown += [item for item in verdict["columns"] if item["table"] != MOTION]
    lines += [
        f"  {item['table']}.{item['column']}: off by {item['deviation']:.1e}"
        f"{' ' * bool(item['unit'])}{item['unit']} at {_place(item)} "
        f"({item['in_roundings']:.2g} roundings)"
        for item in shown
        if item["deviation"]
    ]
    for name, quantity in BOUNDED.items():
        judged = verdict[name]
        if judged["count"]:
            lines.append(
                f"  {judged['within_bound']} of {judged['count']} {quantity.words} "
                f"lie within their error bound; nearest to it {judged['error']:.1e}, "
                f"{judged['over_bound']:.2g} of the bound, at {_place(judged)}"
            )
    lines += [
        f"  no reference at {_place(row)}: {row['status']}"
        for row in verdict["without_reference"]
    ]
    worst = verdict["worst"]
    lines.append(
        f"  worst row: {_place(worst)}: {worst['column']} = {worst['value']!r}, "
        f"in {verdict['digits']} digits {worst['reference']!r}"
    )
    if verdict["not_verified"]:
        lines.append(
            "  not verified, as they failed or find configurations of their own: "
            + ", ".join(verdict["not_verified"])
        )
    return lines


def faults(verdict: Facts) -> list[str]:
    """Return what of a verdict is wrong beyond rounding, in sentences."""
    sentences = []
    if "problem" in verdict:
        sentences.append(f"verify: no row was verified: {verdict['problem']}")
    if verdict.get("beyond"):
        sentences.append(
            f"verify: {listing(verdict['beyond'])} deviate by more than rounding from "
            f"their values in {verdict['digits']} digits"
        )
    for name, quantity in BOUNDED.items():
        judged = verdict.get(name)
        if judged and judged["within_bound"] < judged["count"]:
            sentences.append(
                f"verify: {judged['count'] - judged['within_bound']} of "
                f"{judged['count']} {quantity.words} are off by more than their error bound"
            )
    if verdict.get("without_reference"):
        places = listing(
            f"{_place(row)} ({row['status']})" for row in verdict["without_reference"]
        )
        sentences.append(f"verify: no solution in many digits belongs to {places}")
    return sentences


def _place(item: Facts) -> str:
    subject = "".join(f", {key} {name}" for key, name in item.get("subject", {}).items())
    return f"sample {item['sample']}, assembly mode {item['assembly_mode']}{subject}"
