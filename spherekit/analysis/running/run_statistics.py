"""What the summary says of all samples, counted block by block."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Self, final

import numpy as np
from numpy.typing import NDArray

from spherekit.analysis.batch import Batch, run_status
from spherekit.analysis.running.kernel_columns import UnreadField
from spherekit.analysis.tables import Table, TableData
from spherekit.conventions import STATUS_MEANING, Status
from spherekit.motion.loops import rank_mobility, redundancy
from spherekit.motion.motion import Motion, Tracer
from spherekit.numeric.unread import Interleaved
from spherekit.rates.pole_field import PoleField
from spherekit.sphere.rotation import Floats

CODES = len(Status)


@final
class RunStatistics:
    """Counts and largest errors of the blocks so far; its size does not grow."""

    def __init__(self) -> None:
        self._status: dict[int, NDArray[np.int64]] = {}
        self._poles = np.zeros(CODES, dtype=np.int64)
        self._failed: dict[str, dict[str, NDArray[np.int64]]] = {}
        self._residual: float | None = None
        self._off: float | None = None
        self._error: float | None = None
        self._rate: float | None = None
        self._rate_dq: float | None = None
        self._by_equations = [0, 0]
        self._by_kernel = 0
        self._rank: int | None = None
        self._repeated: dict[str, Any] | None = None

    def state(self) -> dict[str, Any]:
        """Return what was counted, ready for JSON."""
        return {
            "status": [
                [assembly_mode, counts.tolist()]
                for assembly_mode, counts in self._status.items()
            ],
            "poles": self._poles.tolist(),
            "failed": {
                name: {table: counts.tolist() for table, counts in tables.items()}
                for name, tables in self._failed.items()
            },
            "residual": self._residual,
            "configuration": self._off,
            "error": self._error,
            "velocity_coefficient": self._rate,
            "acceleration_coefficient": self._rate_dq,
            "by_equations": self._by_equations,
            "by_kernel": self._by_kernel,
            "rank": self._rank,
            "repeated": self._repeated,
        }

    @classmethod
    def restored(cls, state: Mapping[str, Any]) -> Self:
        """Return the tally that `state` gave."""
        tally = cls()
        tally._status = {
            assembly_mode: np.array(counts) for assembly_mode, counts in state["status"]
        }
        tally._poles = np.array(state["poles"])
        tally._failed = {
            name: {table: np.array(counts) for table, counts in tables.items()}
            for name, tables in state["failed"].items()
        }
        tally._residual, tally._error = state["residual"], state["error"]
        tally._off = state["configuration"]
        tally._rate, tally._rate_dq = (
            state["velocity_coefficient"],
            state["acceleration_coefficient"],
        )
        tally._by_equations = list(state["by_equations"])
        tally._by_kernel = int(state["by_kernel"])
        tally._rank, tally._repeated = state["rank"], state["repeated"]
        return tally

    def add(
        self, tracer: Tracer, motion: Motion, fields: Sequence[PoleField | UnreadField]
    ) -> None:
        """Count a block."""
        status, every = run_status(motion, fields), np.zeros(CODES, dtype=np.int64)
        for number, mode in enumerate(motion.assembly_modes):
            of_mode = status[number * motion.samples : (number + 1) * motion.samples]
            counts = _codes(of_mode)
            every = every + counts
            self._status[mode.number] = counts + self._status.get(mode.number, 0)
        self._residual = _largest(self._residual, motion.residual)
        good = _good(motion.status)
        self._off = _largest(self._off, motion.configuration_error[good])
        for field in fields:
            if field.status is not motion.status:
                good = _good(field.status)
            for codes, often in _counted_once(field.pole_status.values()):
                alike = codes is status and isinstance(good, slice)
                counts = every if alike else _codes(codes[good])
                locked = len(fields) > 1 and counts[Status.NO_POLE] == np.sum(counts)
                if not locked:  # links that other inputs hold together have none
                    self._poles += often * counts
            self._error = _largest_of(self._error, field, "error", good)
            self._rate = _largest_of(self._rate, field, "velocity_coefficient_error", good)
            self._rate_dq = _largest_of(
                self._rate_dq, field, "acceleration_coefficient_error", good
            )
            self._by_equations[0] += int(np.count_nonzero(field.by_equations))
            self._by_equations[1] += len(field.by_equations)
            self._by_kernel += int(np.count_nonzero(field.by_kernel))
        if self._rank is None and np.any(motion.status == Status.OK):
            row = int(np.argmax(motion.status == Status.OK))
            closure = tracer.solver.closure
            tree, (vectors,) = closure.tree, closure.at(motion.values[[row]]).vectors
            self._rank = int(rank_mobility(tree, vectors[None])[0])
            over = redundancy(tree, vectors)
            names = [motion.mechanism.pairs[pair].name for pair in over.pairs]
            self._repeated = {"count": over.count, "pairs": names}

    def add_rows(self, name: str, table: Table, data: TableData, batch: Batch) -> None:
        """Count rows of an analysis' table that failed where the configuration did not.

        What fails of pole axes is counted with these.
        """
        failed = self._failed.setdefault(name, {})
        for column in (c.name for c in table.columns if c.kind == "status"):
            given = data[column]
            parts = given.parts if isinstance(given, Interleaved) else (given,)
            counts = failed.get(table.name, np.zeros(CODES, dtype=np.int64))
            for codes, often in _counted_once(np.asarray(part) for part in parts):
                if table.in_assembly_modes and len(codes) % max(len(batch), 1) == 0:
                    of_rows = codes.reshape(len(batch), -1)
                    codes = of_rows[of_rows != batch.status[:, None]]
                counts = counts + often * _codes(codes)
            counts[Status.OK] = 0
            needs = batch.needs
            if needs.directions | needs.rates | needs.planes:
                counts[[Status.NO_POLE, Status.ILL_CONDITIONED]] = 0
            failed[table.name] = counts

    @property
    def configurations(self) -> int:
        """Rows counted so far."""
        return sum(int(np.sum(counts)) for counts in self._status.values())

    @property
    def solves(self) -> int:
        """How many rows were solved by the velocity equations, for all inputs together."""
        return self._by_equations[0]

    @property
    def rank(self) -> int | None:
        """The mobility by rank at the first sample with a configuration."""
        return self._rank

    @property
    def redundant(self) -> dict[str, Any] | None:
        """The redundant constraints there."""
        return self._repeated

    def of_assembly_mode(self, assembly_mode: int) -> dict[str, int]:
        """Return how many samples of an assembly mode have each status."""
        return _counts(self._status.get(assembly_mode, np.zeros(CODES, dtype=np.int64)))

    def failed_rows(self, name: str) -> dict[str, dict[str, int]]:
        """Return of each table of an analysis how many rows failed by which status."""
        tables = self._failed.get(name, {}).items()
        return {table: _counts(counts) for table, counts in tables if np.any(counts)}

    def statuses(self) -> dict[str, Any]:
        """Return the counts of samples and pole axes, and what their statuses mean."""
        status = np.zeros(CODES, dtype=np.int64) + sum(self._status.values())
        failed = [counts for tables in self._failed.values() for counts in tables.values()]
        met = np.flatnonzero(status + self._poles + sum(failed))
        return {
            "status": _counts(status),
            "pole_status": _counts(self._poles),
            "status_meaning": {
                Status(code).name: STATUS_MEANING[Status(code)] for code in met.tolist()
            },
        }

    def errors(self) -> dict[str, float | None]:
        """Return the largest errors reached."""
        some, every = self._by_equations
        return {
            "largest_closure_residual_rad": self._residual,
            "largest_configuration_error_rad": self._off,
            "largest_direction_error_bound_rad": self._error,
            "largest_velocity_coefficient_error_bound": self._rate,
            "largest_acceleration_coefficient_error_bound": self._rate_dq,
            "fraction_by_velocity_equations": some / every if every else None,
            "fraction_by_kernel": self._by_kernel / every if every else None,
        }


def _good(status: NDArray[np.int8]) -> slice | NDArray[np.bool_]:
    """Return which rows are well: a slice, if all are."""
    held = status == Status.OK
    return slice(None) if np.all(held) else np.asarray(held)


def _codes(status: NDArray[np.int8]) -> NDArray[np.int64]:
    """Return how often each code is there."""
    if not np.any(status != Status.OK):
        counts = np.zeros(CODES, dtype=np.int64)
        counts[Status.OK] = len(status)
        return counts
    return np.bincount(status, minlength=CODES)


def _counts(counts: NDArray[np.int64]) -> dict[str, int]:
    return {code.name: int(counts[code]) for code in Status if counts[code]}


def _counted_once(
    arrays: Iterable[NDArray[Any]],
) -> Iterable[tuple[NDArray[Any], int]]:
    """Return arrays without those that are there again, and how often each is."""
    counted: dict[tuple[int, tuple[int, ...]], tuple[NDArray[Any], int]] = {}
    for array in arrays:
        key = array.__array_interface__["data"][0], array.strides
        counted[key] = array, counted.get(key, (array, 0))[1] + 1
    return counted.values()


def _largest_of(
    so_far: float | None,
    field: PoleField | UnreadField,
    name: str,
    good: slice | NDArray[np.bool_],
) -> float | None:
    """Return the largest error so far, with those of poles at good rows."""
    if isinstance(field, UnreadField):
        return _largest(so_far, np.array([field.largest[name]]))
    for error, _ in _counted_once(getattr(field, name).values()):
        so_far = _largest(so_far, error[good])
    return so_far


def _largest(so_far: float | None, values: Floats) -> float | None:
    if not len(values):
        return so_far
    largest = float(np.max(values))
    if not np.isfinite(largest):
        finite = values[np.isfinite(values)]
        if not len(finite):
            return so_far
        largest = float(np.max(finite))
    return largest if so_far is None else max(so_far, largest)
