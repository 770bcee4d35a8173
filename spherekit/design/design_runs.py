"""Designs that are run one by one, beside what a kernel says of all of them at once."""

from collections.abc import Iterator
from dataclasses import replace
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.design.evaluate import SINGLY, Evaluator
from spherekit.design.evaluated import IMPOSSIBLE, Evaluated, evaluated, refused
from spherekit.design.file_numbers import OK
from spherekit.design.table_figures import (
    ASSEMBLY,
    DesignRun,
    RunTable,
    TableFigures,
)
from spherekit.errors import DesignError, SpherekitError
from spherekit.sphere.rotation import Floats

WORKING, OF_RUN = "working", "run"
"""Before the names of modes that are not the assembly modes of the kernel."""


@final
class DesignRuns:
    """Figures and tables of runs, joined mode by mode with the figures of a kernel.

    Runs count assembly modes, kernels name them by the signs of dyads. Where both are the
    same for certain their figures share a row; other modes have rows of their own.
    """

    def __init__(self, runs: TableFigures, kernel_figures: Evaluator | None) -> None:
        self.runs, self.kernel_figures = runs, kernel_figures
        self.names = [merit.name for merit in runs.merits]
        if kernel_figures is not None:
            self.names += [merit.name for merit in kernel_figures.merits]
        if runs.tables:
            self.names.append(ASSEMBLY)

    @property
    def kernel(self) -> None:
        """No kernel has all figures."""

    def classes(self, values: Floats) -> NDArray[np.str_] | None:
        """Return the Grashof classes of designs, where the kernel knows them."""
        figures = self.kernel_figures
        return None if figures is None else figures.classes(values)

    def part(self, count: int) -> int:
        """Return how many of so many designs are taken together."""
        return min(count, SINGLY)

    def at(self, values: Floats) -> Evaluated:
        """Return the figures of merit of designs (variables, n), in the file's units."""
        made = [of_design for of_design, _ in self.runs_of(values)]
        return Evaluated.joined([self.none(), *made], self.names)

    def none(self) -> Evaluated:
        """Return no rows."""
        nothing = np.zeros(0)
        words = nothing.astype(object)
        return Evaluated(
            nothing.astype(np.int64),
            words,
            nothing,
            words,
            words,
            words,
            dict.fromkeys(self.names, nothing),
        )

    def runs_of(self, values: Floats) -> Iterator[tuple[Evaluated, tuple[RunTable, ...]]]:
        """Yield the rows of each design (variables, n), and its tables if it has some."""
        kernel = None
        if self.kernel_figures is not None:
            kernel = self.kernel_figures.at(values)
        for number, design in enumerate(values.T):
            rows = None if kernel is None else _rows(kernel, kernel.design == number)
            run: DesignRun | SpherekitError
            try:
                if rows is not None and np.all(rows.status == IMPOSSIBLE):
                    raise DesignError(rows.reason[0])
                run = self.runs.run(design)
            except SpherekitError as problem:
                run = problem
            made = self._of_run(run) if rows is None else self._with_kernel(rows, run)
            numbers = np.full(len(made.design), number)
            tables = run.tables if isinstance(run, DesignRun) else ()
            yield replace(made, design=numbers), tables

    def _of_run(self, run: DesignRun | SpherekitError) -> Evaluated:
        """Return the rows of a design without a kernel."""
        if not isinstance(run, DesignRun):
            made = refused(run, self.runs.merits)
            return self._complete(made, [float("nan")])
        count = len(run.modes)
        modes = np.array([mode for _, mode in run.modes], dtype=object)
        zeros = np.zeros(count, dtype=np.int64)
        made = evaluated(zeros, modes, run.closes, run.claim, run.figures)
        return self._complete(made, [_number(mode) for mode in run.modes])

    def _with_kernel(self, rows: Evaluated, run: DesignRun | SpherekitError) -> Evaluated:
        """Return the rows of a design from those of the kernel and from its run."""
        count, nan = len(rows.design), float("nan")
        if not isinstance(run, DesignRun):
            lacking = {merit.name: np.full(count, nan) for merit in self.runs.merits}
            rows = replace(rows, merits={**rows.merits, **lacking})
            if np.all(rows.status == OK):
                why = refused(run, ())
                rows = replace(
                    rows,
                    status=np.repeat(why.status, count),
                    reason=np.repeat(why.reason, count),
                )
            return self._complete(rows, [nan] * count)
        place = {mode: self._place(rows, mode, run) for mode in run.modes}
        figures = {name: np.full(count, value) for name, value in run.whole.items()}
        numbers = [nan] * count
        for k, (mode, row) in enumerate(place.items()):
            if row is not None:
                numbers[row] = _number(mode)
                for name, values in run.figures.items():
                    figures[name][row] = values[k]
        joined = replace(rows, merits={**rows.merits, **figures})
        others = [
            k
            for k, (mode, row) in enumerate(place.items())
            if row is None and mode in run.figured
        ]
        made = self._complete(joined, numbers)
        if not others:
            return made
        beside = evaluated(
            np.zeros(len(others), dtype=np.int64),
            np.array([_beside(run.modes[k]) for k in others], dtype=object),
            run.closes[others],
            run.claim,
            {
                **{name: np.full(len(others), nan) for name in rows.merits},
                **{name: values[others] for name, values in run.figures.items()},
            },
        )
        beside = self._complete(beside, [_number(run.modes[k]) for k in others])
        one = replace(made, design=np.zeros(count, dtype=np.int64))
        return Evaluated.joined([one, beside], self.names)

    def _place(self, rows: Evaluated, mode: tuple[str, str], run: DesignRun) -> int | None:
        """Return the row of the kernel that a mode of the run is, None if none is."""
        made = self.kernel_figures
        column, number = mode
        hinged = made is not None and made.numbers is not None and made.numbers.hinged
        if made is None or made.is_followed or hinged or column != ASSEMBLY:
            return None
        label = run.labels[number]
        places = np.flatnonzero(
            np.isin(rows.mode.astype(str), [label, f"{number} {label}"])
        )
        return int(places[0]) if len(places) == 1 else None

    def _complete(self, made: Evaluated, numbers: list[float]) -> Evaluated:
        """Return rows with the numbers of their assembly modes, if tables have these."""
        if not self.runs.tables:
            return made
        return replace(made, merits={**made.merits, ASSEMBLY: np.array(numbers)})


def _number(mode: tuple[str, str]) -> float:
    return float(mode[1]) if mode[0] == ASSEMBLY else float("nan")


def _beside(mode: tuple[str, str]) -> str:
    return f"{OF_RUN if mode[0] == ASSEMBLY else WORKING} {mode[1]}"


def _rows(rows: Evaluated, chosen: NDArray[np.bool_]) -> Evaluated:
    """Return some of the rows."""
    return Evaluated(
        rows.design[chosen],
        rows.mode[chosen],
        rows.closes[chosen],
        rows.status[chosen],
        rows.reason[chosen],
        rows.claim[chosen],
        {name: values[chosen] for name, values in rows.merits.items()},
    )
