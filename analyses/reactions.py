"""What the pairs transmit: moments about the centre, forces, and whether contacts press."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import compress
from typing import Any

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
from spherekit.plugin.designs import FigureOfMerit
from spherekit.plugin.dynamics import (
    Bearings,
    Reactions,
    need_terms,
    reactions,
    used_pairs,
)

from .common import (
    continue_load_angles,
    plot_series,
    plots_by_mode,
    repeat_rows,
    row_columns,
)

ROUNDING = 1e-13
"""Loads of bearings that are a smaller part of the couples beside them are zero."""
SAME = 1e-9
"""Figures less apart than this part are the same: the first is named."""


@dataclass(frozen=True, kw_only=True)
class ReactionAnalysis(AbstractAnalysis):
    """The moment about the centre that every pair transmits while the inputs move.

    By their laws, or from the motion itself, as in the analysis `dynamics`. Forces through
    the centre, and what bearings carry, as far as the file determines them.
    """

    name = "reactions"
    version = "2"
    summary = "what the pairs and bearings carry, and contacts that lift off"
    rowwise = True
    tables = (
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
                    "zero direction of an R pair in the second link, with which it turns, "
                    "or the tangent of a contact",
                ),
                Column("moment_y", "N m", "about the direction across it, or the normal"),
                Column("moment_z", "N m", "about the axis, or the point of a contact"),
                Column(
                    "moment_x_first",
                    "N m",
                    "of an R pair: about its zero direction in the first link instead",
                ),
                Column("moment_y_first", "N m", "about the direction across that one"),
                Column("transverse_moment", "N m", "its part across the axis or the point"),
                Column(
                    "contact_torque",
                    "N m",
                    "force of a contact along its normal, times the radius: above 0 it "
                    "presses",
                ),
                Column("traction", "N m", "that along its tangent, on the second link"),
                Column(
                    "force_x",
                    "N",
                    "force of its first link on the second, in the same axes: of an R pair "
                    "through the centre, of a contact at its point",
                ),
                Column("force_y", "N", "likewise"),
                Column("force_z", "N", "likewise: of an R pair along the axis"),
                Column("force_x_first", "N", "along the axes of moment_x_first"),
                Column("force_y_first", "N", "and moment_y_first"),
                STATUS,
            ),
        ),
        Table(
            "bearings",
            "one row per sample, assembly mode and bearing that the file places",
            (
                SAMPLE,
                ASSEMBLY_MODE,
                TIME,
                INPUTS,
                Column("load", "", "the load that places it", "text"),
                Column("pair", "", "the pair", "text"),
                Column("position", "m", "its distance from the centre along the axis"),
                Column("couple_force", "N", "force across the axis of the couple alone"),
                Column("radial", "N", "that with the force through the centre"),
                Column("axial", "N", "force along the axis, on the second link"),
                STATUS,
            ),
        ),
    )

    def merits(self, mechanism: Mechanism) -> tuple[FigureOfMerit, ...]:
        """Return the largest moment that each R pair transmits across its axis."""
        return tuple(
            FigureOfMerit(
                f"largest_reaction_{pair}",
                "max",
                "transverse_moment",
                table="reactions.reactions",
                meaning=f"N m, the largest moment across the axis of {pair}",
                only=(("pair", pair),),
            )
            for pair in mechanism.angles
        )

    def needs(self, mechanism: Mechanism) -> Needs:
        """Return the motion in time, with the variables that loads see."""
        need_terms(mechanism)
        return Needs(time=True, tracer=True, continued_values=used_pairs(mechanism))

    def compute(self, batch: Batch) -> Mapping[str, TableData]:
        """Return the table of reactions."""
        result = self._found(batch)
        names = [pair.name for pair in batch.mechanism.pairs]
        both = result.moments, result.forces
        moments, forces = (x.reshape(-1, 3) for x in both)
        first, held = (result.in_first(x).reshape(-1, 2) for x in both)
        return {
            "reactions": {
                **repeat_rows(row_columns(batch, with_time=True), names, "pair"),
                **{f"moment_{axis}": moments[:, k] for k, axis in enumerate("xyz")},
                **{f"moment_{axis}_first": first[:, k] for k, axis in enumerate("xy")},
                "transverse_moment": result.across.ravel(),
                "contact_torque": result.push.ravel(),
                "traction": result.traction.ravel(),
                **{f"force_{axis}": forces[:, k] for k, axis in enumerate("xyz")},
                **{f"force_{axis}_first": held[:, k] for k, axis in enumerate("xy")},
                "status": result.status.ravel(),
            },
            "bearings": _bearing_rows(batch, result),
        }

    def _found(self, batch: Batch) -> Reactions:
        return batch.once("reactions", lambda: reactions(continue_load_angles(batch)))

    def findings(self, batch: Batch) -> Findings:
        """Return the largest moments and loads, contacts that pull, and what is open."""
        result = self._found(batch)
        pairs: dict[str, Any] = {}
        for k, pair in enumerate(batch.mechanism.pairs):
            lifted = result.status[:, k] == Status.LIFT_OFF
            pairs[pair.name] = {
                **_peaks(batch, largest_transverse_moment_Nm=result.across[:, k]),
                "rows_that_lift_off": int(np.count_nonzero(lifted)),
                "is_open": bool(np.any(result.is_open[:, k])),
                "force_is_open": bool(np.any(result.open_forces[:, k])),
            }
        more = result.lacking
        slides = np.any(result.slides, axis=0)
        figures = {
            "pairs": pairs,
            "bearings": {
                _named(load, at): _peaks(
                    batch,
                    largest_couple_force_N=couple,
                    largest_radial_N=radial,
                    largest_axial_N=np.abs(axial),
                )
                for load, at, couple, radial, axial in _bearing_loads(
                    batch.mechanism, result
                )
            },
            "forces_need": {
                "centres_of_mass": list(more.centres),
                "distances_of_contacts": list(more.distances),
                "floating_pairs": list(more.floating),
                "repeated_constraints": not more.enough,
                "wanted": more.wanted,
                "pressure_angles": [
                    pair.name
                    for pair in batch.mechanism.pairs
                    if pair.rolls and pair.pressure_angle is None
                ],
            },
            "links_that_slide": [*compress(batch.mechanism.links, slides)],
            "asks_for_forces": any(x.axial is not None for x in _placed(batch.mechanism)),
            "largest_unbalanced_Nm": _largest(result.unbalanced),
        }
        return _said(figures)

    def joined(self, before: Findings, now: Findings) -> Findings:
        """Return the larger figures of both."""
        return _said(_joined(before.figures, now.figures))

    def scene(self, batch: Batch) -> tuple[Scene, ...]:
        """Return plots of the moments across all axes, and of what contacts press with."""
        result = self._found(batch)
        curves = []
        for k, pair in enumerate(batch.mechanism.pairs):
            title = "moment across the axis"
            moment = result.across[:, k]
            curves.append(plot_series("transverse_moment", pair.name, title, moment, "N m"))
            if not pair.kind.has_axis:
                title = "push of contacts, times the radius"
                moment = result.push[:, k]
                curves.append(
                    plot_series("contact_torque", pair.name, title, moment, "N m")
                )
        for load, at, couple, radial, axial in _bearing_loads(batch.mechanism, result):
            label = _named(load, at)
            whole = np.any(np.isfinite(radial))
            title = "radial load of bearings" if whole else "load of bearings by the couple"
            curves.append(
                plot_series("radial", label, title, radial if whole else couple, "N")
            )
            if np.any(np.isfinite(axial)):
                curves.append(
                    plot_series("axial", label, "axial load of bearings", axial, "N")
                )
        return plots_by_mode(batch, curves)


def _placed(mechanism: Mechanism) -> list[Bearings]:
    return [load for load in mechanism.loads if isinstance(load, Bearings)]


def _bearing_loads(
    mechanism: Mechanism, result: Reactions
) -> list[tuple[Bearings, float, Floats, Floats, Floats]]:
    """Return what places each bearing, where (m), and its load (n,) N.

    That of the couple, with the force through the centre, and along the axis.
    """
    return [
        (load, at, couple, np.hypot(force[0], force[1]), force[2])
        for load in _placed(mechanism)
        for at, couple, force in zip(
            load.positions,
            result.couples[load.name].T,
            np.moveaxis(result.on_bearings[load.name], 0, 2),
            strict=True,
        )
    ]


def _named(load: Bearings, at: float) -> str:
    return f"{load.name} at {at:g} m"


def _bearing_rows(batch: Batch, result: Reactions) -> TableData:
    bearings = _bearing_loads(batch.mechanism, result)
    n = len(batch)
    pairs = [load.pair for load, *_ in bearings]
    numbers = [batch.mechanism.pair_number[pair] for pair in pairs]
    timed = row_columns(batch, with_time=True)
    return {
        **repeat_rows(timed, [load.name for load, *_ in bearings], "load"),
        "pair": np.tile(np.array(pairs, dtype=str), n),
        "position": np.tile([float(at) for _, at, *_ in bearings], n),
        **{
            name: np.reshape([bearing[k] for bearing in bearings], (-1, n)).T.ravel()
            for k, name in enumerate(("couple_force", "radial", "axial"), 2)
        },
        "status": result.status[:, numbers].ravel(),
    }


def _largest(values: Floats) -> float | None:
    finite = values[np.isfinite(values)]
    return float(np.max(finite)) if len(finite) else None


def _peaks(batch: Batch, **values: Floats) -> dict[str, Any]:
    """Return the largest of each, and at which sample and assembly mode it is."""
    made: dict[str, Any] = {"at": {}}
    for name, column in values.items():
        made[name] = largest = _largest(column)
        if largest is not None:
            row = np.argmax(column >= largest * (1.0 - SAME))
            made["at"][name] = [int(batch.sample[row]), int(batch.assembly_mode[row])]
    return made


def _joined(one: Any, other: Any, key: str = "") -> Any:
    """Return the figures of two blocks of rows as those of both."""
    if isinstance(one, Mapping):
        made = {
            name: _joined(x, other[name], name) for name, x in one.items() if name != "at"
        }
        if "at" in one:
            more = {name: at for name, at in one["at"].items() if made[name] == one[name]}
            made["at"] = other["at"] | more
        return made
    if isinstance(one, bool | list):
        return one or other
    if key.startswith("rows_"):
        return one + other
    return max((x for x in (one, other) if x is not None), default=None)


def _said(figures: Mapping[str, Any]) -> Findings:
    pairs = figures["pairs"]
    warnings = [
        f"contact {name} would have to pull in "
        f"{counted(facts['rows_that_lift_off'], 'row')}: it "
        "lifts off there (LIFT_OFF)"
        for name, facts in pairs.items()
        if facts["rows_that_lift_off"]
    ]
    remarks = []
    loose = [name for name, facts in pairs.items() if facts["is_open"]]
    if loose:
        meshes = [x for x in figures["forces_need"]["pressure_angles"] if x in loose]
        hint = f"; teeth at {listing(meshes)} would have a pressure_angle" if meshes else ""
        remarks.append(
            "redundant constraints leave open how reactions are shared among the pairs "
            f"{listing(loose)}; what is open is left empty{hint}"
        )
    for key, unit, what in (
        ("largest_transverse_moment_Nm", "N m", "moment across an axis or a contact"),
        ("largest_radial_N", "N", "radial load of a bearing"),
        ("largest_axial_N", "N", "axial load of a bearing"),
    ):
        facts = pairs if key in next(iter(pairs.values())) else figures["bearings"]
        given = {name: x[key] for name, x in facts.items() if x[key] is not None}
        if given and (facts is pairs or len(given) == len(facts)):
            name = max(given, key=lambda one: given[one])
            where = f"in pair {name}" if facts is pairs else f"({name})"
            beside = max(x.get("largest_couple_force_N") or 0.0 for x in facts.values())
            if given[name] <= ROUNDING * beside:
                remarks.append(f"{what}: zero in every row, to rounding")
                continue
            sample, mode = facts[name]["at"][key]
            remarks.append(
                f"largest {what}: {given[name]:.6g} {unit} {where} at sample {sample} of "
                f"assembly mode {mode}"
            )
    (warnings if figures["asks_for_forces"] else remarks).extend(_on_forces(figures))
    return Findings(figures, tuple(warnings), tuple(remarks))


def _on_forces(figures: Mapping[str, Any]) -> list[str]:
    """Return what is to be said of forces through the centre that are not determined."""
    if figures["links_that_slide"]:
        return [
            "so many pairs float that none holds the links "
            f"{listing(figures['links_that_slide'])} in the centre of the sphere: no "
            "force is determined; let a pair take axial force there (axial)"
        ]
    pairs = figures["pairs"]
    loose = [name for name, facts in pairs.items() if facts["force_is_open"]]
    if not loose:
        return []
    return [
        f"forces through the centre are open in the pairs {listing(loose)}; a file that "
        f"says {listing(figures['forces_need']['wanted'])} determines them"
    ]
