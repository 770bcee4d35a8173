"""Eksergian's equation: equivalent inertia, generalised forces, driving torque."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from spherekit.plugin import (
    ASSEMBLY_MODE,
    INPUT,
    RESIDUAL,
    SAMPLE,
    STATUS,
    TIME,
    AbstractAnalysis,
    AnalysisError,
    Batch,
    Column,
    Findings,
    Floats,
    Mechanism,
    Needs,
    Portrait,
    Scene,
    Status,
    Table,
    TableData,
    listing,
)
from spherekit.plugin.designs import FigureOfMerit
from spherekit.plugin.dynamics import (
    CoordinateMotion,
    InverseSolution,
    Loads,
    Timing,
    acting_links,
    balancing,
    need_terms,
    needed_torques,
    of_parts,
    used_links,
    used_pairs,
)

from .common import (
    continue_load_angles,
    describe_largest_torques,
    find_largest_torques,
    plot_series,
    plots_by_mode,
    repeat_rows,
    row_columns,
)

LARGEST = "largest_torque_Nm"

USABLE_RATES = 1e-6
"""Inertia and torque are not given where more than this part of the rates is in doubt."""


@dataclass(frozen=True, kw_only=True)
class Eksergian(AbstractAnalysis):
    """Torque that drives the input as it moves: by its law, or else at 1 rad/s.

    For a motion that follows from its loads, the torque that acts at the input beside
    them. `at` is the pair where the torque acts; by default the input.
    """

    name = "eksergian"
    version = "1"
    summary = "equivalent inertia, loads and driving torque of the input"
    cites = ("R. Di Gregorio, Mechanism and Machine Theory 2024, 105720, eqs. (9) to (21)",)
    rowwise = True
    tables = (
        Table(
            "eksergian",
            "one row per sample and assembly mode",
            (
                SAMPLE,
                ASSEMBLY_MODE,
                TIME,
                INPUT,
                Column("dq", "rad/s", "rate of q"),
                Column("ddq", "rad/s2", "acceleration of q"),
                Column("B", "kg m2", "equivalent inertia"),
                Column("dB_dq", "kg m2/rad", "its derivative by q"),
                Column("Q", "N m", "generalised force of all loads"),
                Column("tau", "N m", "driving torque at the input, or at the pair `at`"),
                RESIDUAL,
                STATUS,
            ),
        ),
        Table(
            "inertia",
            "one row per sample, assembly mode and link with a mass",
            (
                SAMPLE,
                ASSEMBLY_MODE,
                INPUT,
                Column("link", "", "the link", "text"),
                Column("B", "kg m2", "its part of the equivalent inertia"),
                Column("dB_dq", "kg m2/rad", "the derivative of that part by q"),
                STATUS,
            ),
        ),
        Table(
            "loads",
            "one row per sample, assembly mode and load",
            (
                SAMPLE,
                ASSEMBLY_MODE,
                TIME,
                INPUT,
                Column("load", "", "the load", "text"),
                Column("Q", "N m", "its part of the generalised force"),
                Column("power", "W", "its power"),
                STATUS,
            ),
        ),
    )

    at: str = ""

    def merits(self, mechanism: Mechanism) -> tuple[FigureOfMerit, ...]:
        """Return the largest torque and the ends of the equivalent inertia."""
        if not mechanism.masses or len(mechanism.inputs) != 1:
            return ()
        return (
            FigureOfMerit("largest_torque", "max", "abs(torque)", meaning="at the input"),
            FigureOfMerit("rms_torque", "rms", "torque", meaning="at the input"),
            FigureOfMerit("least_inertia", "min", "B"),
            FigureOfMerit("largest_inertia", "max", "B"),
        )

    def needs(self, mechanism: Mechanism) -> Needs:
        """Return rates of the links with mass, and what the loads depend on."""
        need_terms(mechanism)
        if len(mechanism.inputs) > 1:
            raise AnalysisError(
                f"eksergian: {mechanism.name} has {len(mechanism.inputs)} inputs "
                f"({listing(mechanism.input_pairs)}), but the torque is "
                "that of a single one; the analysis dynamics has those of several"
            )
        links = used_links(mechanism) | {mass.link for mass in mechanism.masses}
        pairs = used_pairs(mechanism)
        if self.at and not mechanism.pair(self.at).kind.has_axis:
            raise AnalysisError(
                f"eksergian: at: pair {self.at} is a contact, not an R pair"
            )
        return Needs(
            time=True,
            tracer=bool(Loads(mechanism).friction_components),
            links=acting_links(mechanism),
            derivatives=True,
            link_rates=links,
            rotations=links,
            continued_values=pairs,
            pair_rates=(pairs | {self.at}) - {""},
        )

    def compute(self, batch: Batch) -> Mapping[str, TableData]:
        """Return the tables of torque, of the links' inertia and of the loads."""
        solution = self._found(batch)
        mechanism = batch.mechanism
        timed = row_columns(batch, with_time=True)
        inertia = solution.B_parts
        forces = solution.Q_parts[:, 0]
        return {
            "eksergian": {
                **timed,
                "dq": batch.dq,
                "ddq": batch.ddq,
                "B": solution.B,
                "dB_dq": solution.dB_dq,
                "Q": solution.Q,
                "tau": self._at(batch, solution.tau),
                "residual": batch.residual,
                "status": solution.status,
            },
            "inertia": {
                **repeat_rows(
                    row_columns(batch), [x.link for x in mechanism.masses], "link"
                ),
                "B": inertia.ravel(),
                "dB_dq": solution.dB_parts.ravel(),
                "status": of_parts(inertia, solution.status).ravel(),
            },
            "loads": {
                **repeat_rows(timed, [load.name for load in mechanism.loads], "load"),
                "Q": forces.ravel(),
                "power": solution.power.ravel(),
                "status": of_parts(forces, solution.status).ravel(),
            },
        }

    def _at(self, batch: Batch, torque: Floats) -> Floats:
        """Return what does the same as a torque (n,) at the input where it acts."""
        if not self.at:
            return torque
        with np.errstate(divide="ignore", invalid="ignore"):
            return torque / batch.pair_rate(self.at)

    def _found(self, batch: Batch) -> InverseSolution:
        return batch.once("torque", lambda: _solution(batch))

    def findings(self, batch: Batch) -> Findings:
        """Return the largest torque and the worst conditioning, and where they are."""
        if not np.any(np.isfinite(batch.residual)):
            return Findings()
        torque = np.abs(self._at(batch, self._found(batch).sure_torques[:, 0]))
        worst = int(np.nanargmax(batch.closure_conditioning))
        figures: dict[str, Any] = {
            "largest_conditioning": float(batch.closure_conditioning[worst]),
            "at_q_rad": float(batch.q[worst]),
            "at_assembly_mode": int(batch.assembly_mode[worst]),
        }
        for name, largest in find_largest_torques(batch, torque[:, None], LARGEST).items():
            figures["torque"] = {"pair": self.at or name, **largest}
        return _said(figures)

    def joined(self, before: Findings, now: Findings) -> Findings:
        """Return the worse of both."""
        both = [item.figures for item in (before, now) if item.figures]
        figures = max(both, key=lambda item: item["largest_conditioning"], default={})
        torques = [item["torque"] for item in both if "torque" in item]
        if torques:
            figures = {**figures, "torque": max(torques, key=lambda item: item[LARGEST])}
        return _said(figures)

    def scene(self, batch: Batch) -> tuple[Scene, ...]:
        """Return plots of inertia, its derivative and torque, each with its parts.

        With the phase portrait, where the samples are times.
        """
        solution = self._found(batch)
        mechanism = batch.mechanism
        torques = {"tau": self._at(batch, solution.tau)}
        if batch.timed:
            torques["B ddq"] = solution.B * batch.ddq
        torques["dB/dq dq²/2"] = 0.5 * solution.dB_dq * batch.dq**2
        for k, load in enumerate(mechanism.loads):
            torques[f"against {load.name}"] = -solution.Q_parts[:, 0, k]
        curves = [
            plot_series("torque", label, "driving torque", values, "N m")
            for label, values in torques.items()
        ]
        for group, label, title, unit, whole, parts in (
            ("inertia", "B", "equivalent inertia", "kg m2", solution.B, solution.B_parts),
            (
                "derivative",
                "dB/dq",
                "derivative of the inertia",
                "kg m2/rad",
                solution.dB_dq,
                solution.dB_parts,
            ),
        ):
            curves.append(plot_series(group, label, title, whole, unit, 0))
            for mass, part in zip(mechanism.masses, parts.T, strict=True):
                number = mechanism.link_number[mass.link]
                curves.append(
                    plot_series(group, f"link {mass.link}", title, part, unit, number)
                )
        scenes = plots_by_mode(batch, curves)
        if not batch.timed:
            return scenes
        portraits = (
            Portrait(
                "plots/phase_portrait",
                "phase portrait",
                batch.q[rows],
                batch.dq[rows],
                "q",
                "dq",
                batch.q_range,
                batch.dq_range,
                "rad",
                "rad/s",
            )
            for rows in batch.assembly_mode_rows().values()
        )
        return tuple(
            replace(scene, primitives=(*scene.primitives, portrait))
            for scene, portrait in zip(scenes, portraits, strict=True)
        )


def _said(figures: Mapping[str, Any]) -> Findings:
    """Return the figures, and the largest torque in words."""
    torques = [figures["torque"]] if "torque" in figures else []
    by_pair = {torque["pair"]: torque for torque in torques}
    return Findings(
        figures, (), describe_largest_torques(by_pair, LARGEST, "driving torque")
    )


def _solution(batch: Batch) -> InverseSolution:
    """Return the torque of a batch, from what it has of a motion by the input.

    The motion's status, with ILL_CONDITIONED where the rates of links are not known well
    enough.
    """
    if Loads(batch.mechanism).friction_components:
        return needed_torques(continue_load_angles(batch))
    status = batch.status.copy()
    lost = ~(batch.rates_loss() < USABLE_RATES)
    status[(status == Status.OK) & lost] = Status.ILL_CONDITIONED
    timing = Timing(batch.t, batch.input_rates, batch.input_accelerations)
    rows = batch.sample, batch.assembly_mode, batch.inputs, batch.residual
    return balancing(batch.mechanism, rows, timing, _motion(batch), status)


def _motion(batch: Batch) -> CoordinateMotion:
    """Return what a batch has of a motion by the input; the rest is NaN."""
    mechanism = batch.mechanism
    needs = batch.needs
    n = len(batch)
    variables = len(mechanism.variable_names)
    links = len(mechanism.links)
    values, rates, second = np.full((3, n, variables), np.nan)
    for pair in needs.continued_values:
        number = mechanism.angles[pair]
        values[:, number] = batch.continued_value(pair)
        rates[:, number] = batch.pair_rate(pair)
    turns = np.full((n, links, 3, 3), np.nan)
    w, dw = np.full((2, n, links, 3), np.nan)
    for link in needs.link_rates:
        number = mechanism.link_number[link]
        turns[:, number] = batch.rotation(link)
        w[:, number] = batch.angular_velocity(link)
        dw[:, number] = batch.angular_velocity_dq(link)
    by_two = second[:, None, None], turns, w[:, None], dw[:, None, None]
    return CoordinateMotion(values, rates[:, None], *by_two, batch.status, turns[:, :0])
