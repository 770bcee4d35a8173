"""Sizes that make an objective small while conditions hold: search, then descent."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, final

import numpy as np

from spherekit.conventions import counted
from spherekit.design.conditions import Condition
from spherekit.design.evaluate import DEG
from spherekit.design.gradients import FigureGradients, with_derivatives
from spherekit.design.sweep import Columns, Sweep
from spherekit.design.variables import designed
from spherekit.engine.arrays import ArrayFunction
from spherekit.engine.design_kernel import row_quantities
from spherekit.errors import DesignError, ModelError
from spherekit.model.expression import parse
from spherekit.model.mechanism import Mechanism
from spherekit.progress import Working
from spherekit.sphere.rotation import Floats

if TYPE_CHECKING:
    import pandas as pd

MATCH = "match"
"""The figure of precision points."""
STEPS = 200
"""Most steps of a descent."""
MOST = 32
"""Best rows of a part that are kept for each descent."""
BESIDE = 0.1
"""Rows nearer than this part of every range lead to the same place."""
SLACK = 1e-9
"""A condition that is missed by less, of its size, holds."""


@final
@dataclass(frozen=True)
class Sizing:
    """What sizes are wanted: an objective, and conditions, of figures of a sweep.

    Attributes
    ----------
    sweep
        The designs that are looked at first, their figures, and the conditions.
    minimise
        The objective, an expression of figures and varied numbers.
    matched
        Names of the figures that precision points are missed by.
    """

    sweep: Sweep
    minimise: str
    matched: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        _ = self.objective

    @cached_property
    def names(self) -> list[str]:
        """What objective and conditions may be of."""
        names = [variable.name for variable in self.sweep.variables]
        names += [merit.name for merit in self.sweep.merits]
        return [*names, MATCH] if self.matched else names

    @cached_property
    def objective(self) -> Any:
        """The parsed objective."""
        try:
            return parse(self.minimise, self.names)
        except ModelError as problem:
            raise DesignError(f"minimise: {problem}") from None

    def with_match(self, columns: Columns) -> Columns:
        """Return columns with the figure of the precision points, if there are some."""
        if not self.matched:
            return columns
        missed = np.array([columns[name] for name in self.matched])
        return {**columns, MATCH: np.sqrt(np.mean(missed * missed, axis=0))}


@final
@dataclass(frozen=True)
class Sized:
    """Designs that a sizing found, best first; one for each assembly mode and valley.

    Attributes
    ----------
    sizing
        What was wanted.
    values
        (n, variables), in the file's units.
    modes
        (n,) assembly modes, as the signs of their dyads.
    objective
        (n,) what was to be small.
    figures
        Figures (n,) by name, in the file's unit of angles.
    explored, feasible
        How many designs were looked at first, and in how many rows conditions held.
    before
        The best objective among these.
    """

    sizing: Sizing
    values: Floats
    modes: tuple[str, ...]
    objective: Floats
    figures: Mapping[str, Floats]
    explored: int
    feasible: int
    before: float
    _kept: dict[str, Any] = field(default_factory=dict, repr=False, compare=False)

    def mechanism(self, number: int = 0) -> Mechanism:
        """Return the mechanism of a design, the best by default."""
        sweep = self.sizing.sweep
        return designed(sweep.document, sweep.variables, self.values[number])

    def frame(self) -> "pd.DataFrame":
        """Return the designs as a pandas frame."""
        from spherekit.analysis.frames import frame_of

        names = [variable.name for variable in self.sizing.sweep.variables]
        columns = {"mode": np.array(self.modes, dtype=object), "objective": self.objective}
        columns |= dict(zip(names, self.values.T, strict=True))
        return frame_of(columns | dict(self.figures), {"units": self.sizing.sweep.units()})

    def __repr__(self) -> str:
        best = f"{self.objective[0]:.6g}" if len(self.objective) else "none"
        return f"Sized({counted(len(self.objective), 'design')}, best {best})"


@final
class _Descent:
    """Descents of a sizing in units of the ranges of its variables."""

    def __init__(self, sizing: Sizing) -> None:
        self.sizing = sizing
        sweep = self.sweep = sizing.sweep
        self.figures = FigureGradients(sweep.evaluator)
        self.low = np.array([each.low for each in sweep.space.variations])
        self.width = np.array([each.high for each in sweep.space.variations]) - self.low
        self.objective = with_derivatives(sizing.objective, sizing.names)
        self.conditions = [
            (each, self._slack(each))
            for each in sweep.conditions
            if "closes" not in each.names
        ]
        radians = DEG if sweep.angle == "deg" else 1.0
        known = row_quantities(sweep.mechanism)
        self.in_rad = np.array([radians if v.is_angle else 1.0 for v in sweep.variables])
        units = [merit.unit(known) == "rad" for merit in sweep.merits]
        self.figure_unit = np.where(units, radians, 1.0)
        self._last: tuple[bytes, Any] | None = None

    def _slack(self, condition: Condition) -> tuple[ArrayFunction, ArrayFunction]:
        return tuple(  # type: ignore[return-value]
            with_derivatives(each, self.sizing.names)
            for each in (condition.left, condition.right)
        )

    def at(self, x: Floats, signs: Sequence[float]) -> tuple[Floats, Floats, float]:
        """Return varied numbers and figures (k,), their gradients by x, what closes."""
        key = x.tobytes() + np.array(signs).tobytes()
        if self._last is None or self._last[0] != key:
            values = self.low + self.width * x
            found, slopes, closes = self.figures.at(values * self.in_rad, signs)
            found = found / self.figure_unit
            slopes = slopes * (self.in_rad * self.width) / self.figure_unit[:, None]
            columns = np.concatenate([values, found])
            gradient = np.concatenate([np.diag(self.width), slopes])
            if self.sizing.matched:
                names = self.sizing.names
                rows = [names.index(name) for name in self.sizing.matched]
                missed = columns[rows]
                size = np.sqrt(np.mean(missed**2))
                slope = np.mean(missed[:, None] * gradient[rows], axis=0)
                columns = np.append(columns, size)
                gradient = np.vstack([gradient, slope / max(size, 1e-300)])
            self._last = key, (columns, gradient, closes)
        made: tuple[Floats, Floats, float] = self._last[1]
        return made

    def value(
        self, function: ArrayFunction, x: Floats, signs: Sequence[float]
    ) -> tuple[float, Floats]:
        """Return an expression of varied numbers and figures, and its gradient by x."""
        columns, gradient, _ = self.at(x, signs)
        found = function(columns[:, None])[:, 0]
        return float(found[0]), found[1:] @ np.nan_to_num(gradient)

    def go(self, x: Floats, signs: Sequence[float]) -> Floats:
        """Return where a descent from x ends."""
        from scipy.optimize import minimize

        closes = self.at(x, signs)[2]

        def objective(y: Floats) -> tuple[float, Floats]:
            value, slope = self.value(self.objective, y, signs)
            if not np.isfinite(value):
                return 1e6, np.zeros_like(y)
            return value, slope

        def slack(y: Floats) -> Floats:
            made = [self.at(y, signs)[2] - closes]
            for each, (left, right) in self.conditions:
                sense = 1.0 if each.sign.startswith("<") else -1.0
                ends = [self.value(side, y, signs)[0] for side in (right, left)]
                made.append(sense * (ends[0] - ends[1]))
            return np.asarray(np.nan_to_num(np.array(made), nan=-1e6))

        def slopes(y: Floats) -> Floats:
            made = [np.zeros_like(y)]
            for each, (left, right) in self.conditions:
                sense = 1.0 if each.sign.startswith("<") else -1.0
                ends = [self.value(side, y, signs)[1] for side in (right, left)]
                made.append(sense * (ends[0] - ends[1]))
            return np.array(made)

        found = minimize(  # type: ignore[call-overload]
            objective,
            x,
            jac=True,
            method="SLSQP",
            bounds=[(0.0, 1.0)] * len(x),
            constraints=[{"type": "ineq", "fun": slack, "jac": slopes}],
            options={"maxiter": STEPS, "ftol": 1e-14},
        )
        ends: Floats = np.clip(found.x, 0.0, 1.0)
        better = objective(ends)[0] <= objective(x)[0]
        holds = bool(np.all(slack(ends) >= -SLACK * (1.0 + np.abs(slack(x)))))
        return ends if better and holds else x


def size(sizing: Sizing, starts: int = 12) -> Sized:
    """Return the best designs of a sizing: a sweep, then descents from its best rows.

    Descents follow exact gradients (SciPy's SLSQP); each keeps to its assembly mode, and
    to inputs at which it closes.

    Raises
    ------
    DesignError
        If no design meets the conditions.
    EngineError
        If there is no kernel of the mechanism's designs.
    """
    sweep = sizing.sweep
    evaluator = sweep.evaluator
    if evaluator.differing or not (evaluator.kernel and evaluator.kernel.closed_form):
        raise DesignError(
            f"{sweep.mechanism.name}: sizing follows gradients by sizes of mechanisms "
            "whose groups are all dyads, with masses given by tensors; sweep it instead"
        )
    working = Working(f"{sweep.mechanism.name}: sizing")
    rows = []
    for number in range(sweep.parts):
        rows.append(_best(sizing, sweep.part(number), MOST * starts))
        done = min((number + 1) * sweep.part_size, sweep.space.count)
        working.tell(lambda done=done: f"{done} designs looked at")  # type: ignore[misc]
    merged = {name: np.concatenate([each[name] for each in rows]) for name in rows[0]}
    feasible = int(np.sum([each["feasible"][0] for each in rows if len(each["feasible"])]))
    descent = _Descent(sizing)
    order = _spread(merged, descent, starts)
    if not len(order):
        raise DesignError(
            f"{sweep.mechanism.name}: none of {counted(sweep.space.count, 'design')} meets "
            "the conditions; widen ranges, relax conditions, or look at more with --designs"
        )
    ends = []
    for k, row in enumerate(order):
        values = np.array([merged[v.name][row] for v in sweep.variables])
        mode = str(merged["mode"][row])
        signs = [1.0 if letter == "+" else -1.0 for letter in mode]
        x = descent.go((values - descent.low) / descent.width, signs)
        columns, _, _ = descent.at(x, signs)
        ends.append((descent.value(descent.objective, x, signs)[0], x, mode, columns))
        working.tell(lambda k=k: f"{k + 1} of {counted(len(order), 'descent')}")  # type: ignore[misc]
    kept = _apart(ends)
    names = [merit.name for merit in sweep.merits] + [MATCH] * bool(sizing.matched)
    first = len(sweep.variables)
    return Sized(
        sizing,
        np.array([descent.low + descent.width * x for _, x, _, _ in kept]),
        tuple(mode for _, _, mode, _ in kept),
        np.array([value for value, *_ in kept]),
        {
            name: np.array([columns[first + k] for *_, columns in kept])
            for k, name in enumerate(names)
        },
        sweep.space.count,
        feasible,
        float(merged["objective"][order[0]]),
    )


def _spread(rows: Columns, descent: _Descent, count: int) -> list[int]:
    """Return the best rows that are not beside a better one of the same mode."""
    names = [variable.name for variable in descent.sweep.variables]
    places = np.stack([rows[name] for name in names], axis=1)
    unit = (places - descent.low) / descent.width
    chosen: list[int] = []
    for row in np.argsort(rows["objective"], kind="stable").tolist():
        beside = any(
            rows["mode"][row] == rows["mode"][other]
            and np.max(np.abs(unit[row] - unit[other])) < BESIDE
            for other in chosen
        )
        if not beside and len(chosen) < count:
            chosen.append(row)
    return chosen


def _best(sizing: Sizing, columns: Columns, count: int) -> Columns:
    """Return the rows of a part with the least objective, and how many are feasible."""
    rows = sizing.with_match(columns)
    rows["objective"] = np.broadcast_to(
        sizing.objective.evaluate({name: rows[name] for name in sizing.objective.names}),
        rows["design"].shape,
    )
    good = np.flatnonzero((rows["status"] == "OK") & np.isfinite(rows["objective"]))
    rows["feasible"] = np.full(len(rows["design"]), len(good))
    chosen = good[np.argsort(rows["objective"][good], kind="stable")[:count]]
    return {name: np.asarray(values)[chosen] for name, values in rows.items()}


def _apart(ends: Sequence[tuple[float, Floats, str, Floats]]) -> list[Any]:
    """Return ends of descents in order, those that came to the same place once."""
    kept: list[Any] = []
    for end in sorted(ends, key=lambda each: each[0]):
        if not any(
            end[2] == known[2] and np.max(np.abs(end[1] - known[1])) < 1e-3
            for known in kept
        ):
            kept.append(end)
    return kept
