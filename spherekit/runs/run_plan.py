"""The plan of a run: its analyses with their needs, the poles to evaluate, and the blocks.

`make_run_plan` prepares a run over a `Sampling`. `extract_needed_part` reduces the
mechanism to the links that the analyses need.
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
from spherekit.runs.analysis_requests import plan_requests
from spherekit.runs.batch import Batch, ContinuedAngles, PoleFields, run_status
from spherekit.runs.batch_runner import BatchRunner
from spherekit.runs.contract import AbstractAnalysis, Analyses
from spherekit.runs.declaration_checks import check_needs
from spherekit.runs.evaluation_options import ORDINARY, Setting
from spherekit.runs.needs import Needs
from spherekit.runs.overview_plan import OverviewPlan
from spherekit.runs.resource_checks import need_memory
from spherekit.runs.result_checks import compute_checked_tables
from spherekit.runs.run_identity import code_identity
from spherekit.runs.run_result import MOTION, tables_by_file_stem
from spherekit.runs.run_state import RunState, describe_analyses, hash_array
from spherekit.runs.sampled_poles import evaluate_sample
from spherekit.runs.sampling import EVENTS, Sampling
from spherekit.runs.table_store import TableStore
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
from spherekit.tables.table_rows import JoinedBlocks
from spherekit.velocities.direction_signs import SignContinuation
from spherekit.velocities.pole_evaluation import evaluate
from spherekit.velocities.pole_request import Request

EvaluatedBlock = tuple[Motion, PoleFields, ContinuedAngles]
"""The motion of a block, its poles for each moving input, and its continued angles."""


@dataclass(frozen=True)
class DeclaredNeeds:
    """The quantities that each analysis of a run reads (its needs).

    Attributes
    ----------
    needs
        The needs of each analysis, in the order of the analyses.
    refused
        For each analysis that breaks the contract of plugins, by name: why it is not run.
    """

    needs: Sequence[Needs]
    refused: Mapping[str, str]


@dataclass(frozen=True)
class RunPlan:
    """What a run evaluates, and in which blocks of samples.

    A pole is the axis about which one link rotates relative to another.

    Attributes
    ----------
    sampling
        The samples and the assembly modes.
    analyses
        The analyses to run.
    needs
        The needs of each analysis.
    refused
        For each analysis that is not run, by name: the reason.
    requests
        The poles (axes of relative rotation of two links) to evaluate, for each input that
        moves while the other inputs are locked.
    setting
        How velocities are computed.
    source
        Computes the motion of blocks. A `BatchRunner` is faster for many samples.
    block_size
        Number of samples in a block (samples that are evaluated together).
    whole_analyses
        Names of the analyses that read all samples at once. There is one block then.
    max_poles
        Number of poles that are evaluated, if a run only measures the size of its tables.
        The tables then have the right size, and wrong numbers. None for all poles.
    """

    sampling: Sampling
    analyses: Analyses
    needs: Sequence[Needs]
    refused: Mapping[str, str]
    requests: tuple[Request, ...]
    setting: Setting
    source: BatchRunner | Sampling
    block_size: int
    whole_analyses: list[str]
    max_poles: int | None = None

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism, with the inputs of the run."""
        return self.sampling.position_analysis.mechanism

    @property
    def plans(self) -> tuple[Plan, ...]:
        """The plan of the poles for each input that moves."""
        return tuple(request.plan for request in self.requests)

    @cached_property
    def overview_plan(self) -> OverviewPlan:
        """What the overview of the motion examines."""
        return OverviewPlan(self.sampling)

    @property
    def is_single_block(self) -> bool:
        """Whether all samples are evaluated in one block."""
        return self.block_size >= len(self.sampling)

    def evaluate_blocks(self, motions: Iterable[Motion]) -> Iterator[EvaluatedBlock]:
        """Evaluate successive blocks, beginning with the first block of a run."""
        sign_continuations = [SignContinuation() for _ in self.requests]
        last_angles = LastAngles()
        for motion in motions:
            pole_fields = self.evaluate_poles(motion, sign_continuations)
            yield motion, pole_fields, self.continue_angles(motion, last_angles)

    def evaluate_poles(
        self, motion: Motion, sign_continuations: Sequence[SignContinuation]
    ) -> PoleFields:
        """Evaluate the poles of a block (group of samples), for each moving input.

        A pole is the axis about which one link rotates relative to another. Inputs for
        which no poles are requested are left out.

        Parameters
        ----------
        motion
            The configurations of the block.
        sign_continuations
            For each input, the last pole directions of the previous block. The signs of
            directions continue from there. They are updated in place.
        """
        source = self.source
        if isinstance(source, BatchRunner) and source.has_pending_poles(motion):
            # A kernel (compiled functions for many rows) has computed the motion. The
            # kernel computes the poles when they are read.
            return source.fields(motion, sign_continuations)
        if self.max_poles is not None:
            # The run only measures the size of its tables, so numbers need not be right.
            # Only few poles are evaluated, and all other poles get similar values.
            return self._fill_in_poles(motion, self.max_poles)
        return self._evaluate_all_poles(motion, sign_continuations)

    def _fill_in_poles(self, motion: Motion, max_poles: int) -> PoleFields:
        """Return placeholder values of poles, for a run that only measures its table sizes.

        A pole is the axis about which one link rotates relative to another.

        The values need not be right, but must take as many bytes as the right values. About
        `max_poles` poles are evaluated. The other poles get similar, not equal values,
        because a table file stores equal values only once.
        """
        return tuple(
            evaluate_sample(motion, request, max_poles)
            for request in self.requests
            if request.poles
        )

    def _evaluate_all_poles(
        self, motion: Motion, sign_continuations: Sequence[SignContinuation]
    ) -> PoleFields:
        """Evaluate the requested poles of a block of samples.

        A pole is the axis about which one link rotates relative to another. If there are
        several inputs, each input in turn moves while the other inputs are locked. Each
        input has its own poles. The `setting` selects the method ("route": velocity
        equations or great circles) and the engine (NumPy, compiled code or quad precision).

        Parameters
        ----------
        motion
            The configurations of the block.
        sign_continuations
            For each input, the last pole directions of the previous block. The signs of
            directions continue from there. They are updated in place.

        Returns
        -------
        The directions and rates of poles, one field for each input with requested poles.
        """
        # `requests` and `sign_continuations` have an item for every input. Inputs without
        # requested poles are left out.
        return tuple(
            evaluate(
                motion,
                request,
                sign_continuation,
                self.setting.route,
                self.setting.engine,
            )
            for request, sign_continuation in zip(
                self.requests, sign_continuations, strict=True
            )
            if request.poles
        )

    def continue_angles(self, motion: Motion, last_angles: LastAngles) -> ContinuedAngles:
        """Return the pair variables that analyses read without jumps of whole revolutions.

        The variables are arrays in rad by pair, with a value for each of the n
        configurations of the motion. `last_angles` has the variables at the end of the
        previous block, and is updated in place.
        """
        pairs = frozenset[str]().union(*(needs.continued_values for needs in self.needs))
        if not pairs:
            return {}
        return self.sampling.continue_angles(motion, sorted(pairs), last_angles)

    def make_batch(
        self,
        analysis: AbstractAnalysis,
        motion: Motion,
        pole_fields: PoleFields,
        continued_angles: ContinuedAngles,
    ) -> Batch:
        """Return the part of a block of samples that an analysis may read.

        A pole is the axis about which one link rotates relative to another.

        Parameters
        ----------
        analysis
            The analysis, which may read only the quantities that it has declared as needs.
        motion
            The configurations of the block.
        pole_fields
            The poles of the block. With several inputs, poles belong to motions in which
            one input moves while all other inputs are locked: one field for each moving
            input.
        continued_angles
            Variables (rad) without jumps of whole revolutions, by pair.
        """
        sampling = self.sampling
        return Batch(
            mechanism=self.mechanism,
            # For each moving input, the steps in which poles follow from other poles.
            plans=self.plans,
            needs=self.needs[self.analyses.index(analysis)],
            _motion=motion,
            _pole_fields=pole_fields,
            _angles=continued_angles,
            # Whether the samples are times, and not values of inputs.
            timed=sampling.is_over_time,
            simulated=sampling.simulation is not None,
            _position_analysis=sampling.position_analysis,
            # The least and greatest inputs and rates of the whole run. Plots use them, so
            # that their axes are the same in all blocks.
            _run_extents=sampling.extents,
        )

    def compute_tables(
        self, analysis: AbstractAnalysis, batch: Batch
    ) -> dict[str, TableData]:
        """Return the tables of an analysis for a block of samples, after checking them.

        Their columns must be the columns that the analysis declares. `batch` has the
        results of the run at these samples.

        Errors raised by `compute_checked_tables`.
        """
        return compute_checked_tables(analysis, self.tables_of(analysis), batch)

    def join_tables(
        self, analysis: AbstractAnalysis, batches: Iterable[Batch]
    ) -> dict[str, TableArrays]:
        """Compute the tables of successive batches, and return them joined, in memory."""
        tables_by_batch = [self.compute_tables(analysis, batch) for batch in batches]
        return {
            table.name: JoinedBlocks(
                [tables[table.name] for tables in tables_by_batch], table
            )
            for table in self.tables_of(analysis)
        }

    def append_rows(
        self,
        analysis_name: str,
        table: Table,
        rows: TableData,
        run_state: RunState,
        table_store: TableStore | None,
        batch: Batch | None = None,
    ) -> None:
        """Store the rows of a table for a block of samples, and count them.

        Failed rows are counted as failures of the analysis, with the exceptions that
        `RunState.count_rows` lists.

        Parameters
        ----------
        analysis_name
            Name of the analysis, or `MOTION` for the configurations and events of the run.
        table
            A table that the analysis, or the motion, has declared.
        rows
            The columns of this table for the block of samples.
        run_state
            The state of the run, in which rows and failed rows are counted in place.
        table_store
            Receives the rows. None if no rows are stored.
        batch
            The samples of the block as the analysis has read them. Their status shows
            which configurations do not exist. None if failures are not counted.
        """
        if table_store is not None:
            mode_names = {
                mode.number: mode.name
                for mode in self.sampling.position_analysis.assembly_modes
                if mode.name
            }
            # If assembly modes (ways to assemble the mechanism) have names, a column with
            # these names is added: first to the declared table, then to its rows.
            stored_table = table.with_names(self.mechanism)
            stored_rows = stored_table.named(rows, mode_names)
            table_store.add(analysis_name, stored_table, stored_rows)
        # Rows of an analysis that reads only the mechanism belong to no samples.
        names_without_samples = [
            analysis.name for analysis in self.analyses if not analysis.reads_samples
        ]
        has_rows_of_batch = analysis_name not in names_without_samples
        run_state.count_rows(
            analysis_name,
            table,
            rows,
            batch=batch,
            has_rows_of_batch=has_rows_of_batch,
        )

    @cached_property
    def identity(self) -> Facts:
        """Everything on which the results of the run depend, as data that JSON can store.

        Runs with the same identity give the same results, bit for bit, on one machine. A
        stopped run is resumed only by a run with the same identity. Long arrays are
        represented by checksums.
        """
        sampling = self.sampling
        position_analysis = sampling.position_analysis
        simulation = sampling.simulation
        timing = sampling.timing
        source = self.source
        modes = position_analysis.assembly_modes
        identity = code_identity() | {
            "mechanism": self.mechanism.name,
            "mechanism_hash": mechanism_hash(self.mechanism),
            "inputs": position_analysis.inputs,
            "samples": "x".join(map(str, sampling.shape)),
            "assembly_modes": [[mode.number, mode.label] for mode in modes],
        }
        # With the setting "pass", an assembly mode (way to assemble the mechanism) follows
        # its smooth curve where curves of configurations cross. The default has no key, so
        # that runs of earlier versions can be resumed.
        if position_analysis.crossings == "pass":
            identity["crossings"] = "pass"
        # `timing` has the times of the samples, and the rates of the inputs.
        time_checksums = []
        if timing is not None:
            time_checksums = [hash_array(values) for values in vars(timing).values()]
        return identity | {
            "analyses": describe_analyses(self.analyses),
            "engine": None if simulation is None else simulation.engine.name,
            "tolerance": sampling.tolerance,  # of a simulation
            # The way to compute the quantities: names of engines and of the route (the
            # way to compute poles), and a tolerance.
            "setting": asdict(self.setting),
            "over_time": sampling.is_over_time,
            "input_values": hash_array(sampling.inputs),
            "times": time_checksums,
            "samples_in_a_block": self.block_size,
            # Only a `BatchRunner` has a kernel (compiled functions for many rows).
            "kernel": source.kernel.engine if isinstance(source, BatchRunner) else None,
        }

    def tables_of(self, analysis: AbstractAnalysis) -> tuple[Table, ...]:
        """Return the tables of an analysis, with the columns that it computes.

        These are the declared columns, without columns that the parameters do not request.
        A column that is declared for every input becomes one column for each input of the
        mechanism.
        """
        return tuple(table.of(self.mechanism) for table in analysis.requested_tables())

    @cached_property
    def motion_tables(self) -> tuple[Table, ...]:
        """The table of configurations, and for a simulation the table of its events.

        Empty if the run computes no motion.
        """
        if not self.sampling.position_analysis.assembly_modes:
            return ()
        if self.sampling.simulation is None:
            return (motion_table(self.sampling),)
        return (motion_table(self.sampling), EVENTS.of(self.mechanism))

    def tables(self, failed: Collection[str] = ()) -> Mapping[str, tuple[Table, ...]]:
        """Return the declarations of the tables of a run, by name of the analysis.

        A declaration has the columns of a table with their units, but no rows. The run
        itself has tables of configurations and events, under the name `MOTION`. If the
        mechanism has names for assembly modes (ways to assemble the mechanism), tables get
        a column for them. The runner makes the result with the declarations.

        Parameters
        ----------
        failed
            Names of failed analyses, which are left out.
        """
        declared_tables = {MOTION: self.motion_tables} | {
            analysis.name: self.tables_of(analysis)
            for analysis in self.analyses
            if analysis.name not in failed
        }
        return {
            name: tuple(table.with_names(self.mechanism) for table in tables)
            for name, tables in declared_tables.items()
        }


def collect_needs(analyses: Analyses, mechanism: Mechanism) -> DeclaredNeeds:
    """Ask each analysis for its needs (the quantities that it reads), and check them.

    An analysis can be a plugin by other people. If a plugin is faulty, the run continues
    with the other analyses, and the result has the reason.

    Raises
    ------
    AnalysisError
        If a parameter does not fit the mechanism, if two analyses have the same name, or if
        two tables would be stored in files of the same name.
    PlanError
        If the mechanism has no pair that can be driven.
    """
    # Analyses rely on a mechanism with inputs. `driven_at` raises the `PlanError` if no
    # pair can be driven.
    mechanism = driven_at(mechanism)
    # The tables of an analysis are stored under its name, so it can occur only once.
    for name, count in Counter(analysis.name for analysis in analyses).items():
        if count > 1:
            raise AnalysisError(
                f"{name}: the analysis is requested {count} times in one run, but a run "
                "can have its tables only once; request it once, with values joined by + "
                "(poles:only=31+42), or use two runs"
            )
    needs = []
    reason_by_refused_analysis = {}
    for analysis in analyses:
        try:
            needs.append(check_needs(analysis, mechanism))
        except PluginError as error:
            reason_by_refused_analysis[analysis.name] = str(error)
            # The list needs an entry for each analysis, here an empty one.
            needs.append(Needs())
    _refuse_equal_file_stems(
        [item for item in analyses if item.name not in reason_by_refused_analysis]
    )
    return DeclaredNeeds(needs, reason_by_refused_analysis)


def _refuse_equal_file_stems(analyses: Analyses) -> None:
    """Raise `AnalysisError` if tables of two analyses have the same file name.

    Each table is written to a separate file, so one file would replace the other. The first
    table of an analysis ``a`` is in the file ``a``. Its other tables have the name of the
    table at the end, such as ``a_b`` for the table ``b``. This is also the name of the
    first table of an analysis ``a_b``.
    """
    # The run itself writes a table of the events of a simulation. Its file name is taken.
    owner_by_stem = {f"{MOTION}_{EVENTS.name}": "the run itself"}
    for analysis in analyses:
        tables = {analysis.name: analysis.requested_tables()}
        for stem in tables_by_file_stem(tables):
            owner = owner_by_stem.setdefault(stem, analysis.name)
            if owner != analysis.name:
                raise AnalysisError(
                    f"{analysis.name}: its table {stem!r} has the name of a table of "
                    f"{owner}; rename the analysis or its table, or use two runs"
                )


def _missing_time_sentence(sampling: Sampling) -> str:
    """Return why samples of several inputs have no times, and what the user can do.

    The text is the rest of an error message that begins with the name of an analysis. This
    analysis needs times. The samples are on a grid, or at values that the user listed.
    """
    if len(sampling.shape) > 1:
        size = "x".join(map(str, sampling.shape))
        return (
            f"needs samples along a path, not on a grid ({size}), because samples on a "
            "grid have no times; give a single number of samples (such as --samples "
            f"{sampling.shape[0]}), or a law for every input, and a duration; the analysis "
            "statics computes holding torques on a grid"
        )
    return (
        "needs a motion in time, but listed values of several inputs have no times (only "
        "a single input passes listed values at constant speed); leave out the values to "
        "move all inputs together through their ranges at constant speed, or give a law "
        "for every input, and a duration"
    )


def make_run_plan(
    sampling: Sampling,
    analyses: Analyses,
    declared_needs: DeclaredNeeds,
    block_size: int | None = None,
    setting: Setting = ORDINARY,
    shows_all_links: bool = False,
) -> RunPlan:
    """Prepare a run of analyses over samples.

    Parameters
    ----------
    sampling
        The samples and the assembly modes.
    analyses
        The analyses to run.
    declared_needs
        Their needs, from `collect_needs`.
    block_size
        Number of samples that are evaluated together (a block). By default the source of
        the motion (`source` of the plan) chooses the number. If an analysis reads all
        samples at once, there is one block.
    setting
        How velocities are computed. With the ordinary setting, a kernel (compiled functions
        for many rows at once) may be used.
    shows_all_links
        Whether the run is recorded or verified, so that rotations of all links are read.

    Raises
    ------
    AnalysisError, EngineError, PlanError
        If the setting does not apply, if an analysis needs times and the samples have none,
        or if all samples at once need more memory than there is.
    """
    position_analysis = sampling.position_analysis
    for analysis, needs in zip(analyses, declared_needs.needs, strict=True):
        if needs.time and sampling.timing is None:
            raise AnalysisError(f"{analysis.name}: {_missing_time_sentence(sampling)}")
    all_needs = reduce(Needs.union, declared_needs.needs, Needs())
    requests = plan_requests(
        position_analysis.mechanism, all_needs, position_analysis.by_rank
    )
    if setting.engine == "compiled":
        heyoka()  # raises EngineError if it is not installed

    source: BatchRunner | Sampling = sampling
    if setting == ORDINARY:
        batch_runner = BatchRunner.prepare(
            sampling,
            [request for request in requests if request.poles],
            is_recorded=shows_all_links,
            # The next block is usually computed in another thread. This is not allowed if
            # an analysis uses the position analysis itself (`tracer`) at the same time.
            looks_ahead=not all_needs.tracer,
            needs_timing=all_needs.time or shows_all_links or sampling.is_over_time,
            reads_frames=bool(all_needs.rotations),
        )
        source = batch_runner or sampling

    whole_analyses = [
        analysis.name
        for analysis in analyses
        if analysis.name not in declared_needs.refused and analysis.at_once
    ]
    if whole_analyses:
        block_size = len(sampling)
        row_count = block_size * len(position_analysis.assembly_modes)
        need_memory(position_analysis.mechanism, row_count, whole_analyses)
    return RunPlan(
        sampling=sampling,
        analyses=analyses,
        needs=declared_needs.needs,
        refused=declared_needs.refused,
        requests=requests,
        setting=setting,
        source=source,
        block_size=min(block_size or source.block_size, len(sampling)),
        whole_analyses=whole_analyses,
    )


def motion_table(sampling: Sampling) -> Table:
    """Return the declaration of the table of configurations of a run.

    It has a column for each variable of a pair, and one for the time if the samples are
    times.
    """
    mechanism = sampling.position_analysis.mechanism
    variables = [
        Column(name, "rad", meaning)
        for name, meaning in zip(
            mechanism.variable_names, mechanism.variable_meanings, strict=True
        )
    ]
    # `Table.of` replaces the placeholder `INPUTS` by one column for each input.
    return Table(
        MOTION,
        "the configurations: one row per sample and assembly mode",
        (
            SAMPLE,
            ASSEMBLY_MODE,
            *([TIME] if sampling.is_over_time else []),
            INPUTS,
            *variables,
            RESIDUAL,
            STATUS,
        ),
    ).of(mechanism)


def motion_rows(sampling: Sampling, motion: Motion, pole_fields: PoleFields) -> TableArrays:
    """Return the columns of the table of configurations for a block of samples.

    `motion_table` declares the columns. The status of a row is its first failure: of the
    configuration, else of the velocities while each input in turn moves (`pole_fields`).
    The residual says how far the loops of links are from being closed.
    """
    mechanism = sampling.position_analysis.mechanism
    times = {}
    # Samples that are values of the inputs may have times of an assumed motion with
    # constant speed. These times are not in the table.
    if sampling.is_over_time and motion.timing:
        times = {"t": motion.timing.t}
    return {
        "sample": motion.sample,
        "assembly_mode": motion.assembly_mode,
        **times,
        **input_columns(mechanism, motion.inputs),
        **dict(zip(mechanism.variable_names, motion.values.T, strict=True)),
        "residual": motion.residual,
        "status": run_status(motion, pole_fields),
    }


def links_of(mechanism: Mechanism, needs: Needs) -> frozenset[int]:
    """Return indices of links with configurations on which the declared needs depend."""
    poles = needs.directions | needs.rates | needs.planes | needs.turns
    pairs = needs.pair_values | needs.continued_values | needs.pair_rates
    link_names = set(needs.rotations | needs.link_rates)
    for pair in pairs:
        link_names.update(mechanism.pair(pair).links)
    return needs.links.union(*poles, (mechanism.link_number[name] for name in link_names))


def extract_needed_part(study: Study, analyses: Analyses) -> Mechanism:
    """Return the mechanism of a study without the groups of links that no analysis needs.

    A smaller mechanism is computed faster. A group consists of links with positions that
    are found together. A group is left out if no link that an analysis reads depends on it.

    Raises
    ------
    AnalysisError
        If an analysis reads the whole mechanism, or the motion follows from loads, which
        can act on any link.
    PlanError
        If an input is a contact, or if no pairs connect some links to the ground.
    """
    mechanism = study.mechanism
    # Only a motion that follows from loads has a start (initial state).
    if study.start is not None:
        raise AnalysisError(
            f"{mechanism.name}: a motion that follows from loads needs all links; run it "
            "without only_needed (--only-needed)"
        )
    needed_links: frozenset[int] = frozenset()
    for analysis in analyses:
        try:
            needs = check_needs(analysis, mechanism)
        except PluginError:
            # The analysis is faulty. The run will not compute it, and reports the error.
            continue
        # All links on which the quantities in the needs depend.
        read_links = links_of(mechanism, needs)
        if needs.tracer:
            # The analysis computes further configurations itself. It reads all links in
            # them, unless it declares which ones.
            declares_links = bool(needs.links)
            reads_whole = not declares_links
        else:
            # If the analysis reads no quantity of a link, it reads the mechanism itself.
            reads_whole = not read_links
        if reads_whole:
            raise AnalysisError(
                f"{analysis.name}: needs the whole mechanism, so no part of it can be left "
                "out; run it without only_needed (--only-needed)"
            )
        needed_links |= read_links
    return part_for(mechanism, needed_links)


def describe_left_out(whole: Mechanism, part: Mechanism) -> Facts:
    """Return the links and pairs that a part lacks, and the hash of the whole, for JSON."""
    return {
        "mechanism_hash": mechanism_hash(whole),
        "left_out_links": [link for link in whole.links if link not in part.links],
        "left_out_pairs": [
            pair.name for pair in whole.pairs if pair.name not in part.pair_number
        ],
    }
