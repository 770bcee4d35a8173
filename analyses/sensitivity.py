"""How an output changes with sizes, and what deviations of sizes do to it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

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
from spherekit.plugin.designs import Distribution, Sensitivity, SizeDeviations

from .common import (
    continue_load_angles,
    merge_largest,
    plot_series,
    repeat_rows,
    row_columns,
)

DEG = np.pi / 180.0
EQUAL = 1e-9
"""Shares that differ by less, relative, are equal: sizes mirror each other."""
ROUNDING = 1e-12
"""A quantity whose spread over the deviation of sizes is less does not hang on them."""
BEYOND = 0.1
"""Where the spread of draws is off by this part, the first order is not enough."""
SHOWN = 6
"""Quantities whose derivatives are drawn, and sizes of each."""


@dataclass(frozen=True)
class Spread:
    """Quantities (c, n), their gradients (sizes, c, n), and what deviations do to them.

    `shares` (sizes, c, n) of the variance are those of the sizes, `tolerances` (c, n) by
    the columns of the table.
    """

    sensitivity: Sensitivity
    values: Floats
    gradients: Floats
    shares: Floats
    tolerances: Mapping[str, NDArray[Any]]


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

    name = "sensitivity"
    version = "1"
    summary = "derivatives by sizes, and tolerances of sizes"
    cites = (
        "derived in docs/sensitivity.md: the velocity equations of the loops, with the "
        "rate at which a size opens them on their right side",
    )
    rowwise = True
    tables = (
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

    trades = (
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
        return Needs(
            tracer=True,
            time=len(mechanism.inputs) == 1 or sensitivity.timed,
            continued_values=frozenset(sensitivity.wound),
            links=sensitivity.links,
        )

    def _asked(self, mechanism: Mechanism) -> tuple[Sensitivity, SizeDeviations]:
        sensitivity = Sensitivity(mechanism, _split(self.by), _split(self.of))
        sizes = sensitivity.deviating(self.deviation * DEG, self._singly())
        return sensitivity, SizeDeviations(sizes, self.distribution, self.draws)

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
        made = self._found(batch)
        names = made.sensitivity.quantities
        keys = made.sensitivity.keys
        status = batch.status.copy()
        lost = ~np.all(np.isfinite(made.gradients), axis=(0, 1))
        status[(status == Status.OK) & lost] = Status.ILL_CONDITIONED
        every = [name for name in names for _ in keys]
        return {
            "sensitivity": {
                **repeat_rows(row_columns(batch), every, "quantity"),
                "size": np.tile(np.array(keys), len(names) * len(batch)),
                "value": np.repeat(made.values.T.ravel(), len(keys)),
                "derivative": np.transpose(made.gradients, (2, 1, 0)).ravel(),
                "status": np.repeat(status, len(every)),
            },
            "tolerances": {
                **repeat_rows(row_columns(batch), names, "quantity"),
                **{name: part.T.ravel() for name, part in made.tolerances.items()},
                "status": np.repeat(status, len(names)),
            },
        }

    def _found(self, batch: Batch) -> Spread:
        return batch.once("sensitivity", lambda: self._spread(batch))

    def _spread(self, batch: Batch) -> Spread:
        sensitivity, deviations = self._asked(batch.mechanism)
        samples = _samples(batch, sensitivity)
        configurations = continue_load_angles(batch).values
        with np.errstate(all="ignore"):
            values, gradients = sensitivity.at(samples, configurations)
            failed = batch.status != Status.OK
            values[:, failed] = np.nan
            gradients[~np.isfinite(gradients) | failed] = np.nan
            squares = (gradients * deviations.spread[:, None, None]) ** 2
            variance = np.sum(squares, axis=0)
            shares = np.where(np.sqrt(variance) > self._least, squares / variance, np.nan)
        drawn = np.full((3, *variance.shape), np.nan)
        rows = np.flatnonzero(np.isfinite(values[0]))
        if self.draws and len(rows):
            scattered = sensitivity.scattered(
                samples[rows], configurations[rows], deviations.draws(len(sensitivity.keys))
            )
            drawn[:, :, rows] = _moments(scattered - values[:, rows, None])
        tolerances = {
            "spread": np.sqrt(variance),
            "worst": np.einsum("scn,s->cn", np.abs(gradients), deviations.worst),
            **dict(zip(("drawn_spread", "drawn_worst", "lost"), drawn, strict=True)),
            "matters_most": _most(sensitivity.keys, shares),
            "share": np.max(shares, axis=0),
        }
        return Spread(sensitivity, values, gradients, shares, tolerances)

    def findings(self, batch: Batch) -> Findings:
        """Return the largest spread of each quantity, and what makes most of it."""
        made = self._found(batch)
        sensitivity = made.sensitivity
        off = made.tolerances
        figures = {}
        for k, (name, spread) in enumerate(
            zip(sensitivity.quantities, off["spread"], strict=True)
        ):
            if np.any(np.isfinite(spread)):
                row = np.nanargmax(spread)
                figures[name] = {
                    "spread": float(spread[row]),
                    "q": batch.inputs[row].tolist(),
                    "size": sensitivity.keys[np.argmax(made.shares[:, k, row])],
                }
                if self.draws:
                    figures[name]["drawn"] = float(off["drawn_spread"][k, row])
                    figures[name]["lost"] = float(off["lost"][k, row])
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
        largest = merge_largest(before.figures, now.figures, "spread")
        return replace(self._said(largest, now.remarks[-1]), warnings=now.warnings)

    def _varied(self, keys: Sequence[str]) -> str:
        singly = [part.replace(":", " by ") for part in _split(self.deviations)]
        but = f", but {listing(singly)}" if singly else ""
        return (
            f"every size off by {self.deviation:g} deg{but} ({self.distribution}): "
            f"{listing(keys, SHOWN)}"
        )

    @property
    def _least(self) -> float:
        return ROUNDING * self.deviation * DEG

    def _said(self, figures: Mapping[str, Mapping[str, Any]], varied: str) -> Findings:
        still = [name for name in figures if figures[name]["spread"] <= self._least]
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
        made = self._found(batch)
        keys = made.sensitivity.keys
        curves = []
        squares = made.shares * made.tolerances["spread"] ** 2
        for name, spread in zip(
            made.sensitivity.quantities, made.tolerances["spread"], strict=True
        ):
            title = f"spread of {name}"
            unit = ""
            if _is_angle(name):
                title = "standard deviation"
                unit = "rad"
            curves.append(plot_series("spread", name, title, spread, unit))
        scenes = []
        for mode, rows in batch.assembly_mode_rows().items():
            more = [
                plot_series(
                    f"derivative_{name}",
                    keys[size],
                    f"derivative of {name} by",
                    made.gradients[size, k, rows],
                )
                for k, name in enumerate(made.sensitivity.quantities[:SHOWN])
                for size in _largest(squares[:, k, rows])
            ]
            plain = (replace(one, values=one.values[rows]) for one in curves)
            scenes.append(Scene(mode, (*plain, *more)))
        return tuple(scenes)


def _largest(squares: Floats) -> list[int]:
    """Return the sizes (at most `SHOWN`) with the largest shares, in their order."""
    return sorted(np.argsort(-np.nansum(squares, axis=1), kind="stable")[:SHOWN])


def _most(keys: Sequence[str], shares: Floats) -> NDArray[np.str_]:
    """Return the sizes of the largest shares (sizes, c, n), as (c, n) texts."""
    equal = shares >= np.max(shares, axis=0) * (1.0 - EQUAL)
    order = np.argsort(keys)
    made = np.empty(shares.shape[1:], object)
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
    return np.column_stack(
        (batch.inputs, batch.input_rates, batch.input_accelerations, batch.t)
    )


def _moments(off: Floats) -> Floats:
    """Return standard deviation, largest size and share of NaN of deviations (..., n)."""
    closed = np.isfinite(off)
    count = np.sum(closed, axis=-1)
    with np.errstate(all="ignore"):
        mean = np.nansum(off, axis=-1) / count
        variance = np.nansum(off * off, axis=-1) / count - mean * mean
        spread = np.sqrt(np.maximum(variance, 0.0))
        worst = np.max(np.where(closed, np.abs(off), 0.0), axis=-1)
    return np.stack([spread, worst, 1.0 - count / off.shape[-1]])


def _otherwise(largest: Mapping[str, Any], name: str) -> str:
    """Return what the draws say where the first order is not enough."""
    if "drawn" not in largest:
        return ""
    drawn = largest["drawn"]
    lost = largest["lost"]
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
