"""What the pairs transmit: moments about the centre, and whether contacts press."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, final

import numpy as np

from spherekit.plugin import (
    ASSEMBLY_MODE,
    INPUTS,
    SAMPLE,
    STATUS,
    TIME,
    AbstractAnalysis,
    Batch,
    Column,
    Findings,
    Floats,
    Mechanism,
    Needs,
    Scene,
    Status,
    Table,
    TableData,
    counted,
    listing,
)
from spherekit.plugin.dynamics import Reactions, need_terms, reactions, used_pairs

from .of_rows import as_loads_see, curve, plotted, repeated, row_columns


@final
@dataclass(frozen=True, kw_only=True)
class ReactionAnalysis(AbstractAnalysis):
    """The moment about the centre that every pair transmits while the inputs move.

    By their laws, or from the motion itself, as in the analysis `dynamics`. Forces through
    the centre are not determined in a spherical mechanism.
    """

    name: ClassVar[str] = "reactions"
    version: ClassVar[str] = "1"
    summary: ClassVar[str] = "moments that the pairs transmit, and contacts that lift off"
    rowwise: ClassVar[bool] = True
    tables: ClassVar[tuple[Table, ...]] = (
        Table(
            "reactions",
            "one row per sample, assembly mode and pair",
            (
                SAMPLE,
                ASSEMBLY_MODE,
                TIME,
                INPUTS,
                Column("pair", "", "the pair", "text"),
                Column(
                    "moment_x",
                    "N m",
                    "moment of its first link on the second about the centre: about the "
                    "zero direction, or the tangent of a contact",
                ),
                Column("moment_y", "N m", "about the direction across, or the normal"),
                Column("moment_z", "N m", "about the axis, or the point of a contact"),
                Column("across", "N m", "its part across the axis or the point"),
                Column(
                    "push",
                    "N m",
                    "force of a contact along its normal, times the radius: above 0 it "
                    "presses",
                ),
                Column("traction", "N m", "that along its tangent, on the second link"),
                Column(
                    "bearing",
                    "N",
                    "force across the axis on each bearing that the file places",
                ),
                STATUS,
            ),
        ),
    )

    def needs(self, mechanism: Mechanism) -> Needs:
        """Return the motion in time, with the variables that loads see."""
        need_terms(mechanism)
        return Needs(time=True, tracer=True, continued_values=used_pairs(mechanism))

    def compute(self, batch: Batch) -> Mapping[str, TableData]:
        """Return the table of reactions."""
        result = self._found(batch)
        names = [pair.name for pair in batch.mechanism.pairs]
        moments = result.moments.reshape(-1, 3)
        return {
            "reactions": {
                **repeated(row_columns(batch, timed=True), names, "pair"),
                **{f"moment_{axis}": moments[:, k] for k, axis in enumerate("xyz")},
                "across": result.across.ravel(),
                "push": result.push.ravel(),
                "traction": result.traction.ravel(),
                "bearing": result.bearing.ravel(),
                "status": result.status.ravel(),
            }
        }

    def _found(self, batch: Batch) -> Reactions:
        return batch.once("reactions", lambda: reactions(as_loads_see(batch)))

    def findings(self, batch: Batch) -> Findings:
        """Return the largest moment of each pair, contacts that pull, and what is open."""
        result = self._found(batch)
        pairs: dict[str, Any] = {}
        for k, pair in enumerate(batch.mechanism.pairs):
            across = result.across[:, k]
            lifted = int(np.count_nonzero(result.status[:, k] == Status.LIFT_OFF))
            pairs[pair.name] = {
                "largest_across_Nm": _largest(across),
                "rows_that_lift_off": lifted,
                "is_open": bool(np.any(result.is_open[:, k])),
            }
        return _said(pairs, _largest(result.unbalanced))

    def joined(self, before: Findings, now: Findings) -> Findings:
        """Return the larger moments of both."""
        pairs = {}
        for name, one in before.figures["pairs"].items():
            other = now.figures["pairs"][name]
            pairs[name] = {
                "largest_across_Nm": _more(
                    one["largest_across_Nm"], other["largest_across_Nm"]
                ),
                "rows_that_lift_off": one["rows_that_lift_off"]
                + other["rows_that_lift_off"],
                "is_open": one["is_open"] or other["is_open"],
            }
        left = [item.figures["largest_unbalanced_Nm"] for item in (before, now)]
        return _said(pairs, _more(*left))

    def scene(self, batch: Batch) -> tuple[Scene, ...]:
        """Return plots of the moments across all axes, and of what contacts press with."""
        result = self._found(batch)
        curves = []
        for k, pair in enumerate(batch.mechanism.pairs):
            title, across = "moment across the axis", result.across[:, k]
            curves.append(curve("across", pair.name, title, across, "N m"))
            if not pair.kind.has_axis:
                title, push = "push of contacts, times the radius", result.push[:, k]
                curves.append(curve("push", pair.name, title, push, "N m"))
        return plotted(batch, curves)


def _largest(values: Floats) -> float | None:
    finite = values[np.isfinite(values)]
    return float(np.max(finite)) if len(finite) else None


def _more(one: float | None, other: float | None) -> float | None:
    given = [x for x in (one, other) if x is not None]
    return max(given) if given else None


def _said(pairs: Mapping[str, Any], unbalanced: float | None) -> Findings:
    warnings = [
        f"contact {name} would have to pull in "
        f"{counted(facts['rows_that_lift_off'], 'row')}: it "
        "lifts off there (LIFT_OFF)"
        for name, facts in pairs.items()
        if facts["rows_that_lift_off"]
    ]
    loose = [name for name, facts in pairs.items() if facts["is_open"]]
    if loose:
        warnings.append(
            "redundant constraints leave open how reactions are shared among the pairs "
            f"{listing(loose)}; what is open is left empty"
        )
    largest = {
        name: facts["largest_across_Nm"]
        for name, facts in pairs.items()
        if facts["largest_across_Nm"] is not None
    }
    remarks = []
    if largest:
        name = max(largest, key=lambda pair: largest[pair])
        remarks.append(
            f"largest moment across an axis: {largest[name]:.6g} N m in pair {name}"
        )
    figures = {"pairs": dict(pairs), "largest_unbalanced_Nm": unbalanced}
    return Findings(figures, tuple(warnings), tuple(remarks))
