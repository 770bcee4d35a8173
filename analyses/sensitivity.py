"""How an output changes with sizes, and what deviations of sizes do to it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, final

import numpy as np
from numpy.typing import NDArray

from spherekit.plugin import (
    ASSEMBLY_MODE,
    INPUTS,
    SAMPLE,
    AbstractAnalysis,
    AnalysisError,
    Batch,
    Column,
    Findings,
    Floats,
    Mechanism,
    Needs,
    Scene,
    Status,
    Sweep,
    Table,
    TableData,
    listing,
)
from spherekit.plugin.designs import Deviations, Distribution, Sensitivity

from .of_rows import curve, largest_of, repeated, row_columns

DEG = np.pi / 180.0
EQUAL = 1e-9
"""Shares that differ by less, relative, are equal: sizes mirror each other."""
ROUNDING = 1e-12
"""A quantity whose spread over the deviation of sizes is less does not hang on them."""
BEYOND = 0.1
"""Where the spread of draws is off by this part, the first order is not enough."""
SHOWN = 6
"""Quantities whose derivatives are drawn, and sizes of each."""


@final
@dataclass(frozen=True)
class Spread:
    """What deviations do to quantities (c, n): to first order, and by draws."""

    spread: Floats
    worst: Floats
    drawn_spread: Floats
    drawn_worst: Floats
    lost: Floats
    shares: Floats


@final
@dataclass(frozen=True, kw_only=True)
class SensitivityAnalysis(AbstractAnalysis):
    """Exact derivatives of quantities by sizes, and what deviating sizes do to them.

    `of` lists quantities such as ``theta_41+velocity_coefficient_4_1``, by default the
    angles of the outputs; `by` lists sizes by their keys in the file, such as
    ``links.2.arc+links.3.arc``, or numbers of masses and loads, by default all arcs and
    angles. `deviation` (degrees) is
    the standard deviation of a ``normal`` `distribution`, or the largest one of a
    ``uniform`` one, of every size; `deviations` has those of single numbers, such as
    ``links.3.arc:0.02+mass.4.mass:0.01``, in degrees or in the unit of the number, and
    masses and loads that it does not name are exact. `draws` mechanisms are drawn beside
    the first order, at each row; 0 for none.
    """

    name: ClassVar[str] = "sensitivity"
    version: ClassVar[str] = "1"
    summary: ClassVar[str] = "derivatives by sizes, and tolerances of sizes"
    cites: ClassVar[tuple[str, ...]] = (
        "derived in docs/sensitivity.md: the velocity equations of the loops, with the "
        "rate at which a size opens them on their right side",
    )
    rowwise: ClassVar[bool] = True
    tables: ClassVar[tuple[Table, ...]] = (
        Table(
            "sensitivity",
            "one row per sample, assembly mode, quantity and size",
            (
                SAMPLE,
                ASSEMBLY_MODE,
                INPUTS,
                Column("quantity", "", "what changes", "text"),
                Column(
                    "size",
                    "",
                    "the size that changes it, a key of the file",
                    "text",
                    turns="otherwise",
                ),
                Column("value", "", "the quantity, rad and SI"),
                Column("derivative", "", "by the size, per rad or unit, the inputs held"),
                Column("status", "", "what became of the row", "status"),
            ),
        ),
        Table(
            "tolerances",
            "one row per sample, assembly mode and quantity: what deviations of sizes do",
            (
                SAMPLE,
                ASSEMBLY_MODE,
                INPUTS,
                Column("quantity", "", "what deviates, rad and SI", "text"),
                Column("spread", "", "standard deviation, to first order"),
                Column("worst", "", "worst case, to first order"),
                Column("drawn_spread", "", "standard deviation of the draws", scale="none"),
                Column("drawn_worst", "", "largest deviation of a draw", scale="none"),
                Column("lost", "", "share of draws that cannot be or close", scale="none"),
                Column(
                    "matters_most",
                    "",
                    "the size with the largest share, all where they are equal",
                    "text",
                    turns="otherwise",
                ),
                Column("share", "", "its share of the variance, to first order"),
                Column("status", "", "what became of the row", "status"),
            ),
        ),
    )

    trades: ClassVar[tuple[Sweep, ...]] = (
        Sweep(
            "draws",
            (16, 64, 256, 1024, 8192),
            "tolerances",
            "drawn_spread",
            ("sample", "assembly_mode", "quantity"),
        ),
    )

    of: str = ""
    by: str = ""
    deviation: float = 0.1
    deviations: str = ""
    distribution: Distribution = "normal"
    draws: int = 64

    def needs(self, mechanism: Mechanism) -> Needs:
        """Return configurations with their times; refuse what has no derivative."""
        sensitivity, _ = self._asked(mechanism)
        timed = len(mechanism.inputs) == 1 or sensitivity.timed
        wound = frozenset(sensitivity.wound)
        return Needs(
            tracer=True, time=timed, continued_values=wound, links=sensitivity.links
        )

    def _asked(self, mechanism: Mechanism) -> tuple[Sensitivity, Deviations]:
        sensitivity = Sensitivity(mechanism, _split(self.by), _split(self.of))
        sizes = sensitivity.deviating(self.deviation * DEG, self._singly())
        return sensitivity, Deviations(sizes, self.distribution, self.draws)

    def _singly(self) -> dict[str, float]:
        """Return the deviations of single numbers by their keys."""
        made = {}
        for part in _split(self.deviations):
            key, _, number = part.rpartition(":")
            try:
                made[key] = float(number)
            except ValueError:
                raise AnalysisError(
                    f'deviations: "{part}": write KEY:DEVIATION, such as links.3.arc:0.02'
                ) from None
        return made

    def compute(self, batch: Batch) -> Mapping[str, TableData]:
        """Return derivatives and tolerances of the rows of a batch."""
        sensitivity, deviations = self._asked(batch.mechanism)
        values, gradients = self._found(batch, sensitivity)
        spread = self._spread(batch, sensitivity, deviations)
        names, keys = sensitivity.quantities, sensitivity.keys
        status = batch.status.copy()
        lost = ~np.all(np.isfinite(gradients), axis=(0, 1))
        status[(status == Status.OK) & lost] = Status.ILL_CONDITIONED
        entries, every = len(names) * len(keys), [n for n in names for _ in keys]
        return {
            "sensitivity": {
                **repeated(row_columns(batch), every, "quantity"),
                "size": np.tile(np.array(keys), len(names) * len(batch)),
                "value": np.repeat(values.T.ravel(), len(keys)),
                "derivative": np.transpose(gradients, (2, 1, 0)).ravel(),
                "status": np.repeat(status, entries),
            },
            "tolerances": {
                **repeated(row_columns(batch), names, "quantity"),
                "spread": spread.spread.T.ravel(),
                "worst": spread.worst.T.ravel(),
                "drawn_spread": spread.drawn_spread.T.ravel(),
                "drawn_worst": spread.drawn_worst.T.ravel(),
                "lost": spread.lost.T.ravel(),
                "matters_most": _most(keys, spread.shares).T.ravel(),
                "share": np.max(spread.shares, axis=0).T.ravel(),
                "status": np.repeat(status, len(names)),
            },
        }

    def _found(self, batch: Batch, sensitivity: Sensitivity) -> tuple[Floats, Floats]:
        def make() -> tuple[Floats, Floats]:
            with np.errstate(all="ignore"):
                values, gradients = sensitivity.at(
                    _samples(batch, sensitivity), _configurations(batch, sensitivity)
                )
            failed = batch.status != Status.OK
            values[:, failed] = np.nan
            gradients[:, :, failed] = np.nan
            gradients[~np.isfinite(gradients)] = np.nan
            return values, gradients

        return batch.once("sensitivity", make)

    def _spread(
        self,
        batch: Batch,
        sensitivity: Sensitivity,
        deviations: Deviations,
    ) -> Spread:
        return batch.once("spread", lambda: self._spread_of(batch, sensitivity, deviations))

    def _spread_of(
        self,
        batch: Batch,
        sensitivity: Sensitivity,
        deviations: Deviations,
    ) -> Spread:
        values, gradients = self._found(batch, sensitivity)
        squares = (gradients * deviations.spread[:, None, None]) ** 2
        variance = np.sum(squares, axis=0)
        drawn = np.full((3, *variance.shape), np.nan)
        rows = np.flatnonzero(np.isfinite(values[0]))
        if self.draws and len(rows):
            scattered = sensitivity.scattered(
                _samples(batch, sensitivity)[rows],
                _configurations(batch, sensitivity)[rows],
                deviations.draws(len(sensitivity.keys)),
            )
            drawn[:, :, rows] = _moments(scattered - values[:, rows, None])
        with np.errstate(all="ignore"):
            return Spread(
                np.sqrt(variance),
                np.einsum("scn,s->cn", np.abs(gradients), deviations.worst),
                drawn[0],
                drawn[1],
                drawn[2],
                squares / variance,
            )

    def findings(self, batch: Batch) -> Findings:
        """Return the largest spread of each quantity, and what makes most of it."""
        sensitivity, deviations = self._asked(batch.mechanism)
        made = self._spread(batch, sensitivity, deviations)
        figures = {}
        for k, name in enumerate(sensitivity.quantities):
            if np.any(np.isfinite(made.spread[k])):
                row = int(np.nanargmax(made.spread[k]))
                figures[name] = {
                    "spread": float(made.spread[k, row]),
                    "q": batch.inputs[row].tolist(),
                    "size": sensitivity.keys[int(np.argmax(made.shares[:, k, row]))],
                }
                if self.draws:
                    figures[name]["drawn"] = float(made.drawn_spread[k, row])
                    figures[name]["lost"] = float(made.lost[k, row])
        said = self._said(figures, self._varied(sensitivity.keys))
        if not sensitivity.left_out or self.by:
            return said
        words = (
            f"sizes of {listing(f'links.{x}' for x in sensitivity.left_out)} are left out: "
            "two of its axes are on one line, and what opens an arc of 0 has no derivative"
        )
        return replace(said, warnings=(words,))

    def joined(self, before: Findings, now: Findings) -> Findings:
        """Return the largest spreads of all blocks."""
        largest = largest_of(before.figures, now.figures, "spread")
        said = self._said(largest, now.remarks[-1])
        return replace(said, warnings=now.warnings)

    def _varied(self, keys: Sequence[str]) -> str:
        singly = [f"{part.replace(':', ' by ')}" for part in _split(self.deviations)]
        but = f", but {listing(singly)}" if singly else ""
        return (
            f"every size off by {self.deviation:g} deg{but} ({self.distribution}): "
            f"{listing(keys, SHOWN)}"
        )

    def _said(self, figures: Mapping[str, Mapping[str, Any]], varied: str) -> Findings:
        least = ROUNDING * self.deviation * DEG
        still = [name for name in figures if figures[name]["spread"] <= least]
        remarks = [
            f"{name}: standard deviation up to {_size(largest['spread'], name)}"
            f"{_otherwise(largest, name)}, at the sample q = "
            f"{listing(f'{q:.4g}' for q in np.degrees(largest['q']))} deg, most of it from "
            f"{largest['size']}"
            for name, largest in figures.items()
            if name not in still
        ]
        if still:
            remarks.append(f"{listing(still)}: changed by none of the sizes varied")
        return Findings(figures=figures, remarks=(*remarks, varied))

    def scene(self, batch: Batch) -> tuple[Scene, ...]:
        """Return the spread of each quantity, and the derivatives that make most of it."""
        sensitivity, deviations = self._asked(batch.mechanism)
        _, gradients = self._found(batch, sensitivity)
        squares = (gradients * deviations.spread[:, None, None]) ** 2
        spread = np.sqrt(np.sum(squares, axis=0))
        keys = sensitivity.keys
        return tuple(
            Scene(
                mode,
                (
                    *(
                        curve("spread", name, "standard deviation", spread[k, rows], "rad")
                        if _is_angle(name)
                        else curve("spread", name, f"spread of {name}", spread[k, rows])
                        for k, name in enumerate(sensitivity.quantities)
                    ),
                    *(
                        curve(
                            f"derivative_{name}",
                            keys[size],
                            f"derivative of {name} by",
                            gradients[size, k, rows],
                        )
                        for k, name in enumerate(sensitivity.quantities[:SHOWN])
                        for size in _largest(squares[:, k, rows])
                    ),
                ),
            )
            for mode, rows in batch.assembly_mode_rows().items()
        )


def _largest(squares: Floats) -> list[int]:
    """Return the sizes (at most `SHOWN`) with the largest shares, in their order."""
    shares = np.nansum(squares, axis=1)
    return sorted(np.argsort(-shares, kind="stable")[:SHOWN].tolist())


def _most(keys: Sequence[str], shares: Floats) -> NDArray[np.str_]:
    """Return the sizes of the largest shares (sizes, c, n), as (c, n) texts."""
    equal = shares >= np.max(shares, axis=0) * (1.0 - EQUAL)
    order = np.argsort(keys)
    made = np.empty(shares.shape[1:], dtype=object)
    for place in np.ndindex(made.shape):
        made[place] = "+".join(keys[k] for k in order if equal[(k, *place)])
    return made.astype(str)


def _is_angle(name: str) -> bool:
    return name.startswith(("theta_", "transmission_angle_"))


def _split(text: str) -> tuple[str, ...]:
    return tuple(part for part in text.split("+") if part)


def _samples(batch: Batch, sensitivity: Sensitivity) -> Floats:
    if batch.inputs.shape[1] > 1 and not sensitivity.timed:
        return sensitivity.at_rest(batch.inputs)
    motion = batch.inputs, batch.input_rates, batch.input_accelerations, batch.t[:, None]
    return np.concatenate(motion, axis=1)


def _configurations(batch: Batch, sensitivity: Sensitivity) -> Floats:
    """Return the variables (n, v), with their turns where loads count these."""
    values = batch.motion.values.copy()
    for pair in sensitivity.wound:
        (variable,) = batch.mechanism.variables_of(batch.mechanism.pair_number[pair])
        values[:, variable] = batch.continued_value(pair)
    return values


def _moments(off: Floats) -> Floats:
    """Return standard deviation, largest size and share of NaN of deviations (..., n)."""
    closed = np.isfinite(off)
    count = np.sum(closed, axis=-1)
    with np.errstate(all="ignore"):
        mean = np.nansum(off, axis=-1) / count
        square = np.nansum(off * off, axis=-1) / count
        spread = np.sqrt(np.maximum(square - mean * mean, 0.0))
        worst = np.max(np.where(closed, np.abs(off), 0.0), axis=-1)
    return np.stack([spread, worst, 1.0 - count / off.shape[-1]])


def _otherwise(largest: Mapping[str, Any], name: str) -> str:
    """Return what the draws say where the first order is not enough."""
    if "drawn" not in largest:
        return ""
    drawn, lost = largest["drawn"], largest["lost"]
    if abs(drawn - largest["spread"]) < BEYOND * largest["spread"] and not lost:
        return ""
    if lost == 1.0:
        return " to first order (none of the draws can be assembled)"
    words = f" to first order (of the draws {_size(drawn, name)}"
    return words + (f", {lost:.0%} of them cannot be assembled)" if lost else ")")


def _size(value: float, name: str) -> str:
    if _is_angle(name):
        return f"{np.degrees(value):.3g} deg"
    return f"{value:.3g}"
