"""How far a run is, what it carries from block to block, and what its summary counts."""

import hashlib
from collections import Counter, defaultdict
from collections.abc import Collection, Iterable
from dataclasses import asdict, dataclass, field
from typing import Any, Self

import numpy as np

from spherekit.arrays import Array, Floats, SmallIntegers
from spherekit.conventions import Facts, Names
from spherekit.numerics.lazy_columns import Interleaved
from spherekit.positions.angle_unwrapping import LastAngles
from spherekit.positions.linearisation import rank_mobility, redundancy
from spherekit.positions.motion import Motion
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.runs.contract import Analyses, Findings
from spherekit.runs.kernel_columns import LazyField, largest_errors
from spherekit.runs.table_scenes import Batch, Fields, run_status
from spherekit.status import STATUS_MEANING, Status
from spherekit.storage.json_data import as_json
from spherekit.tables.table import Table, TableData, row_count
from spherekit.velocities.direction_signs import SignContinuation

Counts = dict[str, int]
"""How often each status is there, by its name."""

RESIDUAL = "largest_closure_residual_rad"
OFF = "largest_configuration_error_rad"
BOUNDS = {
    "error": "largest_direction_error_bound_rad",
    "velocity_coefficient_error": "largest_velocity_coefficient_error_bound",
    "acceleration_coefficient_error": "largest_acceleration_coefficient_error_bound",
}
"""What the summary calls the largest of bounds of poles."""

MODE = "mode"
POLES = "poles"
FAILED = "failed"
ROWS = "rows"
JUDGED = "judged"
BY_EQUATIONS = "by_equations"
BY_KERNEL = "by_kernel"
"""What is counted: rows by `MODE` and status, `POLES` by status, rows of tables by
analysis, table and status where they `FAILED`, `ROWS` of tables, and rows of fields that
were judged, solved by the velocity equations, and given by a kernel."""


@dataclass
class RunState:
    """What continues: samples done, memories, counts, largest errors, results.

    `signs` has a memory for each input, `angles` that of the variables that go on.
    `seconds` is what each stage took. `counts` do not grow with the samples; `rank` is the
    mobility by rank at the first sample with a configuration, `redundant` the redundant
    constraints there. All of it goes to a journal and comes back bit for bit.
    """

    signs: list[SignContinuation]
    angles: LastAngles = field(default_factory=dict)
    done: int = 0
    failures: dict[str, str] = field(default_factory=dict)
    findings: dict[str, Findings] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    counts: Counter[Names] = field(default_factory=Counter)
    largest: dict[str, float] = field(default_factory=dict)
    rank: int | None = None
    redundant: Facts | None = None

    def state(self) -> Facts:
        """Return it ready for JSON."""
        return vars(self) | {
            "signs": [memory.state() for memory in self.signs],
            "findings": {name: asdict(item) for name, item in self.findings.items()},
            "counts": [[*key, number] for key, number in self.counts.items()],
        }

    @classmethod
    def restored(cls, state: Facts) -> Self:
        """Return the standing that `state` gave."""
        changed = {
            "signs": [SignContinuation.restored(memory) for memory in state["signs"]],
            "findings": {
                name: Findings(
                    item["figures"], tuple(item["warnings"]), tuple(item["remarks"])
                )
                for name, item in state["findings"].items()
            },
            "counts": Counter({tuple(key): n for *key, n in state["counts"]}),
        }
        return cls(**state | changed)

    def add(
        self,
        tracer: PositionAnalysis,
        motion: Motion,
        fields: Fields,
    ) -> None:
        """Count a block."""
        status = run_status(motion, fields)
        for mode, of_mode in zip(
            motion.assembly_modes, status.reshape(-1, motion.samples), strict=True
        ):
            self._count((MODE, str(mode.number)), of_mode)
        self._note(RESIDUAL, motion.residual)
        closed = motion.status == Status.OK
        self._note(OFF, motion.configuration_error[closed])
        good = closed
        for poles in fields:
            if poles.status is not motion.status:
                good = poles.status == Status.OK
            for codes, often in _counted_once(poles.pole_status.values()):
                some = codes[good]
                if len(fields) == 1 or np.any(some != Status.NO_POLE):
                    # Links that other inputs hold together have none.
                    self._count((POLES,), some, often)
            errors = (
                poles.largest if isinstance(poles, LazyField) else largest_errors(poles)
            )
            for name, largest in BOUNDS.items():
                self._note(largest, np.array([errors[name]]))
            self.counts[JUDGED,] += len(poles.by_equations)
            self.counts[BY_EQUATIONS,] += int(np.count_nonzero(poles.by_equations))
            self.counts[BY_KERNEL,] += int(np.count_nonzero(poles.by_kernel))
        if self.rank is None and np.any(closed):
            closure = tracer.solver.closure
            vectors = closure.at(motion.values[[np.argmax(closed)]]).vectors
            self.rank = int(rank_mobility(closure.tree, vectors)[0])
            count, pairs = redundancy(closure.tree, vectors[0])
            self.redundant = {"count": count, "pairs": motion.mechanism.names_of(pairs)}

    def _count(
        self,
        key: Names,
        status: SmallIntegers,
        often: int = 1,
        but: Collection[Status] = (),
    ) -> None:
        """Count how often each code is there, but for some."""
        for code in range(np.max(status, initial=-1) + 1):
            n = int(np.count_nonzero(status == code))
            if n and code not in but:
                self.counts[*key, Status(code).name] += often * n

    def _note(self, name: str, values: Floats) -> None:
        """Keep the largest finite number; what is infinite counts as none."""
        largest = np.max(values, initial=-np.inf)
        if not np.isfinite(largest):
            largest = np.max(values, initial=-np.inf, where=np.isfinite(values))
        if np.isfinite(largest):
            self.largest[name] = float(max(self.largest.get(name, largest), largest))

    def add_rows(
        self,
        name: str,
        table: Table,
        data: TableData,
        batch: Batch | None = None,
        by_sample: bool = True,
    ) -> None:
        """Count the rows of a block of a table.

        With a `batch`, rows that failed where the configuration did not are counted too.
        Failures of pole axes are counted with the poles. Without `by_sample` the rows are
        not those of the samples of the batch, even if the table names samples, since the
        analysis has read none.
        """
        self.counts[ROWS, name, table.name] += row_count(data)
        if batch is None:
            return
        needs = batch.needs
        passed_over = [Status.OK]
        if needs.directions | needs.rates | needs.planes:
            passed_over += [Status.NO_POLE, Status.ILL_CONDITIONED]
        for column in (c.name for c in table.columns if c.kind == "status"):
            given = data[column]
            parts = given.parts if isinstance(given, Interleaved) else (given,)
            for codes, often in _counted_once(np.asarray(part) for part in parts):
                of_samples = by_sample and table.in_assembly_modes and len(batch) > 0
                if of_samples and len(codes) % len(batch) == 0:
                    of_rows = codes.reshape(len(batch), -1)
                    codes = of_rows[of_rows != batch.status[:, None]]
                self._count((FAILED, name, table.name), codes, often, passed_over)

    @property
    def configurations(self) -> int:
        """Rows counted so far."""
        return sum(n for key, n in self.counts.items() if key[0] == MODE)

    def counted(self, *key: str) -> Counts:
        """Return how often each status is there of what a key begins with."""
        counts: Counts = Counter()
        for names, number in self.counts.items():
            if names[: len(key)] == key:
                counts[names[-1]] += number
        return {code.name: counts[code.name] for code in Status if code.name in counts}

    def failed_rows(self, name: str) -> dict[str, Counts]:
        """Return of each table of an analysis how many rows failed by which status."""
        return {
            table: self.counted(FAILED, name, table)
            for table in dict.fromkeys(k[2] for k in self.counts if k[:2] == (FAILED, name))
        }

    def statuses(self) -> Facts:
        """Return the counts of samples and pole axes, and what their statuses mean."""
        met = {key[-1] for key in self.counts if key[0] in (MODE, POLES, FAILED)}
        return {
            "status": self.counted(MODE),
            "pole_status": self.counted(POLES),
            "status_meaning": {
                code.name: STATUS_MEANING[code] for code in Status if code.name in met
            },
        }

    def errors(self) -> dict[str, float | None]:
        """Return the largest errors reached."""
        every = self.counts[JUDGED,]
        return {
            **{name: self.largest.get(name) for name in (RESIDUAL, OFF, *BOUNDS.values())},
            **{
                name: self.counts[key,] / every if every else None
                for name, key in (
                    ("fraction_by_velocity_equations", BY_EQUATIONS),
                    ("fraction_by_kernel", BY_KERNEL),
                )
            },
        }


def _counted_once(arrays: Iterable[Array]) -> Iterable[tuple[Array, int]]:
    """Return arrays without those that are there again, and how often each is."""
    alike: dict[tuple[int, tuple[int, ...]], list[Array]] = defaultdict(list)
    for array in arrays:
        alike[array.__array_interface__["data"][0], array.strides].append(array)
    return [(same[0], len(same)) for same in alike.values()]


def identities_of(analyses: Analyses) -> list[list[Any]]:
    """Return names, versions and parameters of analyses, ready for JSON."""
    return [
        [item.name, item.version, as_json(asdict(item))]  # type: ignore[call-overload]
        for item in analyses
    ]


def digest(values: Floats) -> str:
    """Return the SHA-256 of an array's bits, piece by piece."""
    digest = hashlib.sha256()
    for start in range(0, len(values), 1 << 16):
        digest.update(values[start : start + (1 << 16)].tobytes())
    return digest.hexdigest()
