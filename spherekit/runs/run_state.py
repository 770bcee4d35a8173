"""The state that a run carries from block to block, and stores in its journal."""

import hashlib
from collections import Counter, defaultdict
from collections.abc import Collection, Iterable
from dataclasses import asdict, dataclass, field
from typing import Any, Self

import numpy as np

from spherekit.arrays import Array, Bools, Floats, Indices, Integers, SmallIntegers
from spherekit.conventions import Facts, Names
from spherekit.numerics.lazy_columns import Interleaved
from spherekit.positions.angle_unwrapping import LastAngles
from spherekit.positions.loop_tree import rank_mobility, redundancy
from spherekit.positions.motion import Motion
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.runs.batch import Batch, PoleFields, run_status
from spherekit.runs.contract import Analyses, Findings
from spherekit.runs.kernel_columns import LazyField, largest_errors
from spherekit.runs.motion_overview import MotionOverview
from spherekit.runs.needs import Needs
from spherekit.status import STATUS_MEANING, Status
from spherekit.storage.json_data import as_json
from spherekit.tables.table import (
    ASSEMBLY_MODE,
    SAMPLE,
    Column,
    Table,
    TableData,
    row_count,
)
from spherekit.velocities.direction_signs import SignContinuation

StatusCounts = dict[str, int]
"""How many rows have each status, by the name of the status."""

CLOSURE_RESIDUAL = "largest_closure_residual_rad"
CONFIGURATION_ERROR = "largest_configuration_error_rad"
POLE_ERROR_KEYS = {
    "direction_error": "largest_direction_error_bound_rad",
    "velocity_coefficient_error": "largest_velocity_coefficient_error_bound",
    "acceleration_coefficient_error": "largest_acceleration_coefficient_error_bound",
}
"""Keys of the largest errors in the summary; for poles by the attribute of `PoleField`."""

MODE = "mode"
"""First part of the key ``MODE, mode number, status``: rows of an assembly mode."""

POLES = "poles"
"""First part of the key ``POLES, status``: pole axes, one for each row and pole."""

FAILED = "failed"
"""First part of the key ``FAILED, analysis, table, status``: rows that failed although
their configuration did not."""

ROWS = "rows"
"""First part of the key ``ROWS, analysis, table``: rows of a table."""

EVALUATED = "judged"
"""Key of the number of configurations at which poles were evaluated, for all moving inputs.

Rows without a configuration do not count."""

BY_EQUATIONS = "by_equations"
"""Key of the number of these rows whose velocities were computed by the velocity equations
in quad precision, because float64 leaves too few digits or the user asked for it."""

BY_KERNEL = "by_kernel"
"""Key of the number of these rows that a kernel evaluated."""


@dataclass
class RunState:
    """The state of a run after the blocks (groups of successive samples) that are done.

    The state is stored in the journal (a file in the folder of the run) after each block,
    and restored bit for bit. So a resumed run gives the same results as a run that was not
    stopped. Its size does not grow with the number of samples.

    Attributes
    ----------
    sign_continuations
        For each input that moves while the other inputs are locked: the directions of all
        poles (axes of relative rotation) at the last sample. Directions in the next rows
        get signs that continue these directions without reversal.
    last_angles
        For each assembly mode (way to assemble the mechanism), the pair variables in the
        last row, without jumps of whole revolutions. The next block continues them.
    samples_done
        Number of samples that are evaluated.
    failures
        For each failed analysis, by name: why it failed.
    findings
        Findings of each analysis, by name, in all blocks (groups of samples) so far.
    stage_seconds
        Time that each stage has taken, s.
    counts
        Counted rows and poles, by keys that begin with `MODE`, `POLES` and so on.
    error_maxima
        Largest errors in all rows so far, by their key in the summary.
    mobility_by_rank
        Mobility by the rank of the closure Jacobian, at the first valid configuration.
    redundant_constraints
        Number of redundant constraints at the same configuration, and the pairs that have
        them.
    overview
        Where assembly modes close, and how far outputs move.
    """

    sign_continuations: list[SignContinuation]
    last_angles: LastAngles = field(default_factory=dict)
    samples_done: int = 0
    failures: dict[str, str] = field(default_factory=dict)
    findings: dict[str, Findings] = field(default_factory=dict)
    stage_seconds: dict[str, float] = field(default_factory=dict)
    counts: Counter[Names] = field(default_factory=Counter)
    error_maxima: dict[str, float] = field(default_factory=dict)
    mobility_by_rank: int | None = None
    redundant_constraints: Facts | None = None
    overview: MotionOverview = field(default_factory=MotionOverview)

    def to_journal(self) -> Facts:
        """Return the state of a run ready for JSON, so that the run can be resumed.

        The keys stay the same as in earlier versions, because journals of those versions
        can be resumed, too.
        """
        return {
            "signs": [memory.state() for memory in self.sign_continuations],
            "angles": self.last_angles,
            "done": self.samples_done,
            "failures": self.failures,
            "findings": {name: asdict(item) for name, item in self.findings.items()},
            "seconds": self.stage_seconds,
            # JSON has no tuples as keys, so each entry is a list: the key, then the number.
            "counts": [[*key, number] for key, number in self.counts.items()],
            "largest": self.error_maxima,
            "rank": self.mobility_by_rank,
            "redundant": self.redundant_constraints,
            "overview": self.overview.to_json(),
        }

    @classmethod
    def from_journal(cls, entries: Facts) -> Self:
        """Return the state of a stopped run from its journal, in order to resume the run.

        The next block of samples continues from a part of the state: the last angles with
        their whole revolutions, and the signs of pole directions. A pole direction is an
        axis of relative rotation, and its sign must not jump between blocks. The summary of
        the run needs the rest, such as counted rows, largest errors and the mobility.

        Parameters
        ----------
        entries
            The entries of the journal that `to_journal` has made.
        """
        findings = {
            name: Findings.from_json(item) for name, item in entries["findings"].items()
        }
        # JSON has no tuples as keys, so each count is stored as a list. It has the texts of
        # the key, such as "poles" and a status, and then the number.
        counts: Counter[Names] = Counter()
        for *key, number in entries["counts"]:
            counts[tuple(key)] = number
        return cls(
            sign_continuations=[
                SignContinuation.restored(signs) for signs in entries["signs"]
            ],
            last_angles=entries["angles"],
            samples_done=entries["done"],
            failures=entries["failures"],
            findings=findings,
            stage_seconds=entries["seconds"],
            counts=counts,
            error_maxima=entries["largest"],
            mobility_by_rank=entries["rank"],
            redundant_constraints=entries["redundant"],
            overview=MotionOverview.from_json(entries["overview"]),
        )

    def count_block(
        self,
        position_analysis: PositionAnalysis,
        motion: Motion,
        pole_fields: PoleFields,
    ) -> None:
        """Count the statuses of the rows of a block, and record its largest errors.

        A row is one sample in one assembly mode (way to assemble the mechanism). The counts
        and errors of all blocks are shown in the summary of the run. At the first row with
        a configuration, the mobility and the redundant constraints of the mechanism are
        computed too.

        Parameters
        ----------
        position_analysis
            The solver. Its closure equations give the mobility.
        motion
            The configurations of the block.
        pole_fields
            The poles of the block, for each input that moves while the other inputs are
            locked.
        """
        # (modes, samples): the rows of a mode follow the rows of the mode before.
        status = run_status(motion, pole_fields).reshape(-1, motion.samples)
        for mode, mode_status in zip(motion.assembly_modes, status, strict=True):
            self._count_statuses((MODE, str(mode.number)), mode_status)

        is_assembled = motion.status == Status.OK
        self._note_error(CLOSURE_RESIDUAL, motion.residual)
        # The error of a configuration has a meaning only if its loops are closed.
        self._note_error(CONFIGURATION_ERROR, motion.configuration_error[is_assembled])
        self._count_poles(pole_fields, is_assembled)

        if self.mobility_by_rank is None and np.any(is_assembled):
            closure = position_analysis.solver.closure
            # `argmax` finds the first true value.
            first_configuration = motion.values[[np.argmax(is_assembled)]]
            # (1, variables, 3) relative angular velocity of two links per unit rate of each
            # pair variable. The rank of the velocity equations follows from these vectors.
            vectors = closure.linearise(first_configuration).vectors
            (mobility,) = rank_mobility(closure.tree, vectors)
            self.mobility_by_rank = int(mobility)
            count, pairs = redundancy(closure.tree, vectors[0])
            pair_names = motion.mechanism.names_of(pairs)
            self.redundant_constraints = {"count": count, "pairs": pair_names}

    def _count_poles(self, pole_fields: PoleFields, is_assembled: Bools) -> None:
        """Count the statuses of the poles of a block, and record their error bounds.

        A block has the rows (configurations) of successive samples. A pole is the axis
        about which one link rotates relative to another. Its status says whether it exists
        and could be computed. The rows are also counted by how their velocities were
        computed: by a kernel (compiled functions for many rows), or by velocity equations
        in quad precision. The velocities differ for each moving input, so a row is counted
        once for each input.

        Parameters
        ----------
        pole_fields
            The poles of the block, for each input that moves while the other inputs are
            locked.
        is_assembled
            (n,) rows with a configuration. Only these are counted by how their velocities
            were computed.
        """
        has_several_inputs = len(pole_fields) > 1
        for pole_field in pole_fields:
            # Rows with a configuration and with velocities.
            is_valid = pole_field.status == Status.OK
            # Many poles share one array of status codes (n,), which is counted once.
            for codes, pole_count in _count_shared_arrays(pole_field.pole_status.values()):
                valid_codes = codes[is_valid]
                # With several inputs, locked inputs can fix two links to each other. Such
                # link pairs have no pole in any row, and are not counted.
                is_rigid = has_several_inputs and np.all(valid_codes == Status.NO_POLE)
                if not is_rigid:
                    self._count_statuses((POLES,), valid_codes, pole_count)
            # A `LazyField` computes numbers only when they are read. Its largest errors are
            # stored in it already, so they are taken without computing the numbers.
            if isinstance(pole_field, LazyField):
                errors = pole_field.error_maxima
            else:
                errors = largest_errors(pole_field)
            for attribute, key in POLE_ERROR_KEYS.items():
                self._note_error(key, np.array([errors[attribute]]))
            # Only certified rows, with small error bounds, count as computed by the kernel.
            rows_by_count = {
                EVALUATED: is_assembled,
                BY_EQUATIONS: is_assembled & pole_field.is_quad_precision,
                BY_KERNEL: is_assembled & pole_field.is_certified,
            }
            for name, rows in rows_by_count.items():
                count_key = (name,)  # keys of `counts` are tuples
                self.counts[count_key] += int(np.count_nonzero(rows))

    def _count_statuses(
        self,
        key: Names,
        status: SmallIntegers,
        weight: int = 1,
        ignored: Collection[Status] = (),
    ) -> None:
        """Count how often each status occurs, and add the numbers to the counts of the run.

        Parameters
        ----------
        key
            Beginning of the keys in `counts`; the name of the status is added to it.
        status
            (n,) status codes.
        weight
            Factor of the counts, such as the number of poles that share these codes.
        ignored
            Statuses that are not counted.
        """
        for code in range(np.max(status, initial=-1) + 1):
            count = int(np.count_nonzero(status == code))
            if count and code not in ignored:
                self.counts[*key, Status(code).name] += weight * count

    def _note_error(self, key: str, values: Floats) -> None:
        """Note the largest of finite errors; infinite bounds and NaN are passed over."""
        largest = np.max(values, initial=-np.inf)
        # The mask is slower, and seldom needed.
        if not np.isfinite(largest):
            largest = np.max(values, initial=-np.inf, where=np.isfinite(values))
        if np.isfinite(largest):
            earlier = self.error_maxima.get(key, largest)
            self.error_maxima[key] = float(max(earlier, largest))

    def count_rows(
        self,
        analysis_name: str,
        table: Table,
        data: TableData,
        batch: Batch | None = None,
        has_rows_of_batch: bool = True,
    ) -> None:
        """Count the rows of an analysis table in a block, and the rows that failed.

        A row fails if it has a status other than OK, with two exceptions that are no
        failures of the analysis:

        - The mechanism has no configuration at the sample of the row, or no finite rates.
          The row then has the same status as the row of the motion.
        - A pole (axis of the relative rotation of two links) does not exist or is
          ill-conditioned. `count_block` counts such poles.

        Parameters
        ----------
        analysis_name
            Name of the analysis.
        table, data
            The declared table, and its columns for the block.
        batch
            The samples of the block as the analysis has read them. Its `needs` say what the
            analysis reads, for example poles. None if failed rows are not counted.
        has_rows_of_batch
            Whether the rows belong to the samples of the batch. False for an analysis that
            reads only the mechanism.
        """
        self.counts[ROWS, analysis_name, table.name] += row_count(data)
        if batch is None:
            return
        # OK is ignored, and the statuses of poles if the analysis reads poles.
        ignored = _find_ignored_statuses(batch.needs)
        # Tables in assembly modes (ways to assemble the mechanism) have rows for each
        # configuration. If the configuration failed, the codes of its rows are left out.
        has_configurations = has_rows_of_batch and table.in_assembly_modes
        key = (FAILED, analysis_name, table.name)
        status_columns = [column for column in table.columns if column.kind == "status"]
        for column in status_columns:
            # A table may have a row for each pole of a configuration. Several poles may
            # share one array of codes. It is examined only once, and the counts are
            # multiplied by the number of these poles.
            for codes, pole_count in _status_arrays(data[column.name]):
                counted_codes = codes
                if has_configurations:
                    counted_codes = _omit_failed_configurations(codes, data, column, batch)
                self._count_statuses(key, counted_codes, weight=pole_count, ignored=ignored)

    @property
    def configurations(self) -> int:
        """Number of rows computed so far: samples times assembly modes."""
        return sum(number for key, number in self.counts.items() if key[0] == MODE)

    def status_counts(self, *key_start: str) -> StatusCounts:
        """Return how many rows or poles have each status, by the name of the status.

        A row is one sample of one assembly mode. A status tells whether its computation
        succeeded.

        These keys of `counts` are tuples of texts that end with a status. All keys that
        begin with `key_start` are added up, such as ("mode", "0") for the rows of mode 0.
        """
        counts: StatusCounts = Counter()
        for key, number in self.counts.items():
            if key[: len(key_start)] == key_start:
                counts[key[-1]] += number
        return {code.name: counts[code.name] for code in Status if code.name in counts}

    def failed_rows(self, analysis_name: str) -> dict[str, StatusCounts]:
        """Return how many rows of each table of an analysis failed, by their status."""
        tables = dict.fromkeys(
            key[2] for key in self.counts if key[:2] == (FAILED, analysis_name)
        )
        return {table: self.status_counts(FAILED, analysis_name, table) for table in tables}

    def status_summary(self) -> Facts:
        """Return the statuses of rows and poles for the summary, and their meanings."""
        names = {key[-1] for key in self.counts if key[0] in (MODE, POLES, FAILED)}
        return {
            "status": self.status_counts(MODE),
            "pole_status": self.status_counts(POLES),
            "status_meaning": {
                code.name: STATUS_MEANING[code] for code in Status if code.name in names
            },
        }

    def error_summary(self) -> dict[str, float | None]:
        """Return entries of the summary about the accuracy of a run.

        Returns
        -------
        The largest error of each kind by name, None if no row has one. Two further entries
        tell how velocities were computed. The first is the fraction of configurations at
        which velocity equations were solved in quad precision. The second is the fraction
        that a kernel (compiled functions for many rows) evaluated. The rest was computed in
        float64 without a kernel. The fractions are None if no velocities were computed.
        """
        keys = (CLOSURE_RESIDUAL, CONFIGURATION_ERROR, *POLE_ERROR_KEYS.values())
        errors = {key: self.error_maxima.get(key) for key in keys}
        # The keys of `counts` are tuples. These keys have one element, hence the commas.
        evaluated = self.counts[EVALUATED,]
        fractions: dict[str, float | None] = {
            "fraction_by_velocity_equations": None,
            "fraction_by_kernel": None,
        }
        if evaluated:
            by_equations = self.counts[BY_EQUATIONS,]
            fractions["fraction_by_velocity_equations"] = by_equations / evaluated
            fractions["fraction_by_kernel"] = self.counts[BY_KERNEL,] / evaluated
        return errors | fractions


def _status_arrays(column_values: Any) -> list[tuple[Array, int]]:
    """Return the different arrays of status codes of a column, and how often each occurs.

    A table may have a row for each of several poles at a sample. Such a table has
    `Interleaved` columns, which store an array for each pole. Poles without a separate
    status share one array: the status of the rows. Counting this array only once saves
    time.
    """
    is_interleaved = isinstance(column_values, Interleaved)
    parts = column_values.parts if is_interleaved else (column_values,)
    return _count_shared_arrays(np.asarray(part) for part in parts)


def _find_ignored_statuses(needs: Needs) -> list[Status]:
    """Return the statuses that do not count as failures of an analysis with these needs.

    A pole is the axis of the relative rotation of two links. If the analysis reads poles,
    its rows can have the statuses of poles. `RunState.count_block` counts these separately.
    """
    ignored = [Status.OK]
    if needs.directions | needs.rates | needs.planes:
        ignored += [Status.NO_POLE, Status.ILL_CONDITIONED]
    return ignored


def _omit_failed_configurations(
    codes: Array, data: TableData, column: Column, batch: Batch
) -> Array:
    """Return status codes of table rows, without rows of failed configurations.

    If the mechanism cannot be assembled at a sample, its configuration there has a status
    such as "out of reach". The rows of the analysis at this sample have the same status,
    which is no failure of the analysis. Codes that equal the status of the configuration of
    their row are left out. The caller counts the remaining codes as failures of the
    analysis.

    Parameters
    ----------
    codes
        (n,) status codes of all rows of the table. A table with a row for each of several
        poles (axes of the relative rotation of two links) has `Interleaved` columns, which
        store an array for each pole. `codes` is then the array of one pole.
    data
        Columns of the table.
    column
        The column of the codes.
    batch
        The configurations to which the rows belong.
    """
    if isinstance(data[column.name], Interleaved):
        # The codes of one pole are in the order of the configurations.
        return _select_pole_failures(codes, batch)
    # The columns of the sample and of the assembly mode tell the configuration of each row.
    return _select_table_failures(codes, data, batch)


def _select_pole_failures(codes: Array, batch: Batch) -> Array:
    """Return the status codes of a pole that differ from the codes of its configurations.

    A pole is the axis of the relative rotation of two links. If the mechanism has no
    position at a sample, the pole has the same code as the configuration. This is no
    failure of the analysis, so the code is left out.

    Parameters
    ----------
    codes
        (n,) status codes of one of several poles in a table.
    batch
        The configurations. Usually each code belongs to one configuration, in the same
        order.
    """
    # With another number of codes, it is unknown to which configuration a code belongs. So
    # no code is left out.
    if len(codes) != len(batch):
        return codes
    return codes[codes != batch.status]


def _select_table_failures(codes: Array, data: TableData, batch: Batch) -> Array:
    """Return the codes of failed table rows, without those that equal the configuration's.

    Each row belongs to a configuration: the position of the mechanism at a sample, in an
    assembly mode. If the mechanism has no position there, the row has the same status code
    as the configuration. This is no failure of the analysis, so the code is left out. The
    caller counts the remaining codes as failures of the analysis.

    Parameters
    ----------
    codes
        (n,) status codes of the rows of the table. The rows can be in any order.
    data
        Columns of the table, including the columns of the sample and the assembly mode.
    batch
        The configurations.
    """
    failed = np.flatnonzero(codes != Status.OK)
    batch_status = _find_batch_status(batch, data, failed)
    return codes[failed][codes[failed] != batch_status]


def _find_batch_status(batch: Batch, data: TableData, rows: Indices) -> SmallIntegers:
    """Return the status (k,) of the configurations to which k rows of a table belong.

    Each configuration is the position of the mechanism at one sample in one assembly mode
    (way to assemble the mechanism). The caller compares these codes with the codes of the
    rows, to see which rows failed in the analysis itself.

    Parameters
    ----------
    batch
        The configurations.
    data
        Columns of the table, including the columns of the sample and the assembly mode.
    rows
        (k,) indices of rows of the table.

    Returns
    -------
    Status codes, -1 for rows with a sample or assembly mode that is not in the batch.
    """
    status = np.full(len(rows), -1, dtype=np.int8)
    if not len(rows) or not len(batch):
        return status
    samples = np.asarray(data[SAMPLE.name])[rows]
    modes = np.asarray(data[ASSEMBLY_MODE.name])[rows]
    # One number identifies a sample and an assembly mode together.
    mode_count = 1 + max(np.max(modes), np.max(batch.assembly_mode))
    positions = _find_positions(
        samples * mode_count + modes, batch.sample * mode_count + batch.assembly_mode
    )
    is_in_batch = positions >= 0
    status[is_in_batch] = batch.status[positions[is_in_batch]]
    return status


def _find_positions(wanted: Integers, numbers: Integers) -> Indices:
    """Return where each number (k,) to find is among other numbers, -1 if it is missing.

    The other numbers (n,) are all different, in any order, and there is at least one.
    """
    order = np.argsort(numbers)
    positions_when_sorted = np.searchsorted(numbers[order], wanted)
    # `searchsorted` returns n for a number above all stored numbers. This is reduced to a
    # valid position, and the comparison below finds that the number is missing.
    candidates = order[np.minimum(positions_when_sorted, len(numbers) - 1)]
    return np.where(numbers[candidates] == wanted, candidates, -1)


def _count_shared_arrays(arrays: Iterable[Array]) -> list[tuple[Array, int]]:
    """Return each distinct array once, and how many times it is there.

    The arrays are statuses of poles (axes of relative rotation) at all rows of a motion.
    Many poles share one array, the status of the motion itself. Counting this array only
    once saves time. Arrays are the same if they start at the same address with the same
    strides.
    """
    arrays_by_memory: dict[tuple[int, tuple[int, ...]], list[Array]] = defaultdict(list)
    for array in arrays:
        address = array.__array_interface__["data"][0]
        arrays_by_memory[address, array.strides].append(array)
    return [(same[0], len(same)) for same in arrays_by_memory.values()]


def describe_analyses(analyses: Analyses) -> list[list[Any]]:
    """Return name, version and parameters of each analysis, ready for JSON."""
    return [
        [item.name, item.version, as_json(asdict(item))]  # type: ignore[call-overload]
        for item in analyses
    ]


def hash_array(values: Floats) -> str:
    """Return the SHA-256 of the bits of an array.

    The array is hashed in pieces, so that only one piece is copied at a time.
    """
    digest = hashlib.sha256()
    for start in range(0, len(values), 1 << 16):
        digest.update(values[start : start + (1 << 16)].tobytes())
    return digest.hexdigest()
