"""Figures of merit of many designs, in parts that are there whole or not at all."""

import hashlib
import json
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict, dataclass, field
from functools import cached_property
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

import numpy as np
from numpy.typing import NDArray

from spherekit.analysis.contract import AbstractAnalysis
from spherekit.analysis.frames import columns_of_files, frame_of, write_columns
from spherekit.analysis.merit import Merit
from spherekit.conventions import counted, listing
from spherekit.design.conditions import Condition, condition
from spherekit.design.evaluate import Evaluator
from spherekit.design.evaluated import NEVER_CLOSES
from spherekit.design.file_numbers import OK
from spherekit.design.samples import DesignSamples
from spherekit.design.space import DesignSpace
from spherekit.design.table_figures import TableFigures
from spherekit.design.variables import DesignVariable, check_variables, design_variable
from spherekit.engine.row_quantities import row_quantities
from spherekit.errors import DesignError, OutputError
from spherekit.files.atomic import make_folder, write_text
from spherekit.files.document import Document
from spherekit.files.lock import locked
from spherekit.files.plain import as_json
from spherekit.model.mechanism import Mechanism
from spherekit.model.study import Study
from spherekit.progress import Working
from spherekit.sphere.rotation import Floats

if TYPE_CHECKING:
    import pandas as pd

OWN = ("design", "mode", "status", "reason", "closes", "claim", "grashof")
"""Columns that every table may have."""

DEFINITION = "_sweep.json"
"""What readers of a folder of Parquet pass over begins with _ or a point."""
LOCK = ".sweep.lock"

Columns = dict[str, Any]


@final
@dataclass(frozen=True)
class Sweep:
    """Designs of one topology, and the figures of merit that are wanted of each.

    Attributes
    ----------
    mechanism, samples
        The mechanism, and the samples that every design goes through; of figures from
        tables the samples are None, and a `study` says what `analyses` go through.
    document
        The file whose numbers are varied.
    space
        Which designs there are.
    merits
        The figures of merit.
    where
        Conditions on designs and figures; what does not meet them is left out.
    """

    mechanism: Mechanism
    samples: DesignSamples | None
    document: Document
    space: DesignSpace
    merits: tuple[Merit, ...]
    where: tuple[str, ...] = ()
    study: Study | None = None
    analyses: tuple[AbstractAnalysis, ...] = ()
    _kept: dict[str, Evaluator | TableFigures] = field(
        default_factory=dict, repr=False, compare=False
    )

    def __post_init__(self) -> None:
        if not self.merits:
            raise DesignError(
                f"{self.mechanism.name}: no figure of merit is asked for: give --reduce, "
                "or an analysis with figures of its own; quantities of a row: "
                f"{listing(row_quantities(self.mechanism), 40)}"
            )
        check_variables(self.document, self.variables)
        names = [*OWN, *(variable.name for variable in self.variables)]
        names += [merit.name for merit in self.merits]
        double = [name for k, name in enumerate(names) if name in names[:k]]
        if double:
            raise DesignError(
                f'{self.mechanism.name}: two columns would be called "{double[0]}"; give '
                "the figure of merit another name: NAME=REDUCTION(EXPRESSION)"
            )
        _ = self.conditions

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_kept": {}}  # compiled kernels stay in their process

    @cached_property
    def variables(self) -> tuple[DesignVariable, ...]:
        """What is varied."""
        return tuple(design_variable(self.document, v.key) for v in self.space.variations)

    @cached_property
    def conditions(self) -> tuple[Condition, ...]:
        """What designs have to meet."""
        names = [variable.name for variable in self.variables]
        names += ["closes", *(merit.name for merit in self.merits)]
        return tuple(condition(text, names) for text in self.where)

    @property
    def evaluator(self) -> Evaluator | TableFigures:
        """What computes the figures; made once in a process."""
        if "made" in self._kept:
            return self._kept["made"]
        if self.samples is None:
            assert self.study is not None
            self._kept["made"] = TableFigures(
                self.document, self.study, self.variables, self.merits, self.analyses
            )
        else:
            self._kept["made"] = Evaluator(
                self.document,
                self.mechanism,
                self.variables,
                self.merits,
                self.samples,
            )
        return self._kept["made"]

    @property
    def angle(self) -> str:
        """The file's unit of angles, in which all angles of the table are."""
        unit: str = self.document.data["angle_unit"]
        return unit

    @cached_property
    def part_size(self) -> int:
        """Designs in a part."""
        return self.evaluator.part(self.space.count)

    @property
    def parts(self) -> int:
        """How many parts there are."""
        return -(-self.space.count // self.part_size)

    def definition(self) -> dict[str, Any]:
        """Return what the sweep is of, as it stands in its folder."""
        text = json.dumps(as_json(self.document.data), sort_keys=True)
        return {
            "mechanism": self.mechanism.name,
            "file": hashlib.sha256(text.encode()).hexdigest(),
            "input": ", ".join(driven.pair for driven in self.mechanism.inputs),
            "samples": hashlib.sha256(self._sampled).hexdigest(),
            "angle_unit": self.angle,
            "vary": [asdict(variation) for variation in self.space.variations],
            "scheme": self.space.scheme,
            "designs": self.space.count,
            "seed": self.space.seed,
            "merits": [asdict(merit) for merit in self.merits],
            "where": list(self.where),
            "part": self.part_size,
            "columns": list(OWN),
        }

    @property
    def _sampled(self) -> bytes:
        if self.samples is not None:
            return self.samples.rows.tobytes()
        study = self.study
        return repr(study and (study.samples, study.grid, study.path, study.laws)).encode()

    def _unit(self, merit: Merit) -> str:
        evaluator = self.evaluator
        if isinstance(evaluator, TableFigures):
            return merit.unit(evaluator.units[merit.name])
        return merit.unit(row_quantities(self.mechanism))

    def units(self) -> dict[str, str]:
        """Return the unit of every column that has one."""
        made = {
            variable.name: self.angle for variable in self.variables if variable.is_angle
        }
        made |= {merit.name: self._unit(merit) for merit in self.merits}
        return {name: self.angle if unit == "rad" else unit for name, unit in made.items()}

    def part(self, number: int) -> Columns:
        """Return the rows of a part: designs in order, each in its assembly modes."""
        start = number * self.part_size
        designs = self.space.designs(start, start + self.part_size)
        rows = np.arange(start, start + designs.shape[1])
        kept = self._possible(designs)
        made = self.rows(designs[:, kept], rows[kept])
        for requirement in self.conditions:
            if not requirement.names <= self._before:
                holds = requirement.holds(made)
                made = {name: values[holds] for name, values in made.items()}
        return made

    def rows(self, designs: Floats, numbers: NDArray[np.intp]) -> Columns:
        """Return the rows of designs (variables, n), by their numbers, in all modes."""
        classes = self.evaluator.classes(designs)
        evaluated = self.evaluator.at(designs)
        design = evaluated.design
        made: Columns = {"design": numbers[design]}
        for variable, values in zip(self.variables, designs, strict=True):
            made[variable.name] = values[design]
        made |= {
            "mode": evaluated.mode,
            "status": evaluated.status,
            "closes": evaluated.closes,
            "claim": evaluated.claim,
        }
        if classes is not None:
            there = np.isin(evaluated.status, [OK, NEVER_CLOSES])
            made["grashof"] = np.where(there, classes[design], "").astype(object)
        for merit in self.merits:
            values = evaluated.merits[merit.name]
            if self.angle == "deg" and self._unit(merit) == "rad":
                values = np.degrees(values)
            made[merit.name] = values
        made["reason"] = evaluated.reason
        return made

    @cached_property
    def _before(self) -> frozenset[str]:
        return frozenset(variable.name for variable in self.variables)

    def _possible(self, designs: Floats) -> Any:
        """Return which designs meet the conditions on their own numbers."""
        kept = np.ones(designs.shape[1], dtype=bool)
        names = [variable.name for variable in self.variables]
        columns = dict(zip(names, designs, strict=True))
        for requirement in self.conditions:
            if requirement.names <= self._before:
                kept &= np.broadcast_to(requirement.holds(columns), kept.shape)
        return kept

    def write(self, folder: str, number: int) -> int:
        """Write a part where it is not there yet, and return its number."""
        path = part_path(folder, number)
        if not path.exists():
            write_columns(path, self.part(number), {"units": self.units()})
        return number


def part_path(folder: str | os.PathLike[str], number: int) -> Path:
    """Return the path of a part."""
    return Path(folder) / f"part-{number:06d}.parquet"


@final
@dataclass(frozen=True)
class SweepResult:
    """The designs of a sweep with their figures of merit.

    Attributes
    ----------
    sweep
        What was asked.
    folder
        Where its parts are, None where they are in memory.
    computed
        How many parts were computed now; the others were there.
    """

    sweep: Sweep
    folder: Path | None
    computed: int
    _parts: tuple[Columns, ...] = field(default=(), repr=False)

    def frame(self) -> "pd.DataFrame":
        """Return all rows as a pandas frame, with the units of its columns in `attrs`."""
        return frame_of(self._columns(), {"units": self.sweep.units()})

    def _columns(self) -> Columns:
        if self.folder is None:
            parts: Sequence[Columns] = self._parts
            return {name: np.concatenate([p[name] for p in parts]) for name in parts[0]}
        paths = [part_path(self.folder, k) for k in range(self.sweep.parts)]
        return columns_of_files(paths)

    def __repr__(self) -> str:
        space = self.sweep.space
        where = f", in {self.folder}" if self.folder else ""
        return (
            f"SweepResult({self.sweep.mechanism.name}, "
            f"{counted(space.count, 'design')}{where})"
        )


Workers = Callable[[Sweep, str, Sequence[int]], Iterator[int]]
"""Computes parts somewhere, and yields the number of each when it is written."""


def run_sweep(
    sweep: Sweep,
    folder: str | os.PathLike[str] | None = None,
    workers: int = 1,
    resume: bool = True,
    elsewhere: Workers | None = None,
) -> SweepResult:
    """Compute all parts of a sweep.

    Parameters
    ----------
    sweep
        The sweep.
    folder
        Where parts are written; those that are there already are kept. Without it they
        stay in memory.
    workers
        Processes at work.
    resume
        Whether parts of the same sweep that are in the folder may be taken.
    elsewhere
        What computes parts on other machines.

    Raises
    ------
    OutputError
        If the folder holds another sweep, is in use, or cannot be written.
    """
    working = Working(f"{sweep.mechanism.name}: sweep")
    if folder is None:
        parts = []
        for number in range(sweep.parts):
            parts.append(sweep.part(number))
            working.tell(_how_far(sweep, len(parts)))
        return SweepResult(sweep, None, len(parts), tuple(parts))
    place = make_folder(folder)
    lock = locked(place / LOCK)
    if isinstance(lock, str):
        raise OutputError(f"{place}: another sweep is at work in it ({lock})")
    with lock:
        _claim(sweep, place, resume)
        missing = [k for k in range(sweep.parts) if not part_path(place, k).exists()]
        done = sweep.parts - len(missing)
        if elsewhere is not None:
            finished = elsewhere(sweep, str(place.resolve()), missing)
        elif workers > 1 and len(missing) > 1:
            finished = _in_processes(sweep, str(place), missing, workers)
        else:
            finished = (sweep.write(str(place), number) for number in missing)
        for _ in finished:
            done += 1
            working.tell(_how_far(sweep, done))
    return SweepResult(sweep, place, len(missing))


def _how_far(sweep: Sweep, parts: int) -> Callable[[], str]:
    done = min(parts * sweep.part_size, sweep.space.count)
    return lambda: f"{done} of {counted(sweep.space.count, 'design')}"


def _claim(sweep: Sweep, place: Path, resume: bool) -> None:
    """Write the definition, or compare it with that of the parts that are there."""
    path, definition = place / DEFINITION, as_json(sweep.definition())
    if not path.exists() and any(place.glob("part-*.parquet")):
        raise OutputError(
            f"{place}: holds parts of which {DEFINITION} does not say what sweep they are "
            "of; choose another folder, or remove them"
        )
    if path.exists():
        stored = json.loads(path.read_text(encoding="utf-8"))
        if resume and stored == definition:
            return
        if any(place.glob("part-*.parquet")):
            other = [key for key in definition if stored.get(key) != definition[key]]
            raise OutputError(
                f"{place}: holds "
                + (
                    f"another sweep, with other {listing(other)}"
                    if other
                    else "this sweep already"
                )
                + "; choose another folder, or remove this one"
            )
    write_text(path, json.dumps(definition, indent=2) + "\n")


_here: dict[str, Sweep] = {}


def _begin(sweep: Sweep) -> None:
    """Keep the sweep of this process."""
    _here["sweep"] = sweep


def _part(folder: str, number: int) -> int:
    return _here["sweep"].write(folder, number)


def _in_processes(
    sweep: Sweep, folder: str, numbers: Sequence[int], workers: int
) -> Iterator[int]:
    """Yield parts as processes finish them; those of processes that end are made again.

    Raises
    ------
    DesignError
        If a process ends before any part is made.
    """
    left = set(numbers)
    while left:
        before = len(left)
        try:
            for number in _of_pool(sweep, folder, sorted(left), workers):
                left.discard(number)
                yield number
        except BrokenProcessPool:
            if len(left) == before:
                raise DesignError(
                    f"{sweep.mechanism.name}: the system ended a process of the sweep, "
                    "perhaps for want of memory; parts that are written stay, and the same "
                    "command goes on, with --workers 1 in less memory"
                ) from None


def _of_pool(
    sweep: Sweep, folder: str, numbers: Sequence[int], workers: int
) -> Iterator[int]:
    count = min(workers, len(numbers))
    with ProcessPoolExecutor(count, get_context("spawn"), _begin, (sweep,)) as pool:
        futures = [pool.submit(_part, folder, number) for number in numbers]
        try:
            for future in as_completed(futures):
                yield future.result()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
