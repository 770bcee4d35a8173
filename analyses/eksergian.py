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
    FigureOfMerit,
    Findings,
    Floats,
    Mechanism,
    Needs,
    Portrait,
    Scene,
    Series,
    Status,
    Table,
    TableData,
    listing,
)
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
    merge_largest_torques,
    plot_series,
    plots_by_mode,
    repeat_rows,
    row_columns,
)

ZERO_TORQUE_RATIO = 1e-12
"""Ratio of the driving torque to the largest inertia and load torque of a block of
rows, up to which the torque is reported as 0. Larger: small torques are hidden;
smaller: errors are reported."""

LARGEST_CONDITIONING = "largest_conditioning"
"""Key of the largest condition number in the summary."""
LARGEST_DRIVING_TORQUE = "largest_torque_Nm"
"""Key of the largest torque in the summary."""
MAX_RATES_LOSS = 1e-6
"""Rows in which a larger part of the rates is lost by cancellation are ILL_CONDITIONED and
have no inertia and torque. Larger: less accurate torques are given."""
MAX_DEAD_CENTRE_RATE = 1e-9
"""Rate of the pair `at`, per unit rate of the input, up to which the row is a dead centre
of the pair and has no torque. Larger: rows farther from dead centres have no torque;
smaller: rounding errors are reported as torques."""


@dataclass(frozen=True, kw_only=True)
class Eksergian(AbstractAnalysis):
    """Torque that drives the input while the input moves by its law, or else at 1 rad/s.

    For a motion that follows from its loads, the torque is the one that acts at the
    input in addition to the loads.

    Parameters
    ----------
    at
        R pair at which the driving torque acts. By default the input.
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
                Column(
                    "dq",
                    "rad/s",
                    "angular velocity of the driven pair, the time derivative of q",
                ),
                Column("ddq", "rad/s2", "angular acceleration of the driven pair"),
                Column(
                    "B",
                    "kg m2",
                    "equivalent inertia: moment of inertia of the "
                    "whole mechanism, as felt at the input",
                ),
                Column(
                    "dB_dq",
                    "kg m2/rad",
                    "derivative of the equivalent inertia B with respect to q",
                ),
                Column(
                    "Q",
                    "N m",
                    "generalised force: power of all loads per unit "
                    "angular velocity of the input",
                ),
                Column(
                    "tau",
                    "N m",
                    "driving torque at the input, or at the pair that the parameter "
                    "`at` names; empty at dead centres of this pair",
                ),
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
                Column("link", "", "name of the link", "text"),
                Column(
                    "B",
                    "kg m2",
                    "contribution of the link to the equivalent inertia of the mechanism",
                ),
                Column(
                    "dB_dq",
                    "kg m2/rad",
                    "derivative of the contribution B with respect to q",
                ),
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
                Column("load", "", "name of the load in the mechanism file", "text"),
                Column(
                    "Q",
                    "N m",
                    "generalised force: power of the load per unit "
                    "angular velocity of the input",
                ),
                Column("power", "W", "power of the load"),
                STATUS,
            ),
        ),
    )

    at: str = ""

    def merits(self, mechanism: Mechanism) -> tuple[FigureOfMerit, ...]:
        """Return the figures of merit: largest torques and extreme inertias.

        Figures of merit are numbers by which designs are compared. The equivalent inertia
        is twice the kinetic energy at unit rate of the input. Only mechanisms with one
        input and masses have these figures. The driving torque acts at the pair `at`, or by
        default at the input.

        Raises
        ------
        ModelError
            If the mechanism has no pair `at`.
        AnalysisError
            If the pair `at` is a contact, and not an R pair (revolute joint).
        """
        if not mechanism.masses or len(mechanism.inputs) != 1:
            return ()
        self._check_torque_pair(mechanism)
        # `torque` is the torque at the input. `rate_P` is the rate of the pair P per unit
        # rate of the input. A torque at P with the same power is their quotient.
        torque = f"torque/rate_{self.at}" if self.at else "torque"
        return (
            FigureOfMerit(
                "largest_torque", "max", f"abs({torque})", meaning="largest driving torque"
            ),
            FigureOfMerit(
                "rms_torque",
                "rms",
                torque,
                meaning="root mean square of the driving torque",
            ),
            FigureOfMerit("least_inertia", "min", "B", meaning="least equivalent inertia"),
            FigureOfMerit(
                "largest_inertia", "max", "B", meaning="largest equivalent inertia"
            ),
        )

    def needs(self, mechanism: Mechanism) -> Needs:
        """Return the quantities of a motion that this analysis reads.

        The quantities are:

        - the time of each row, and the rates and accelerations of the input;
        - orientations and angular velocities of the links that have mass or on whose motion
          loads depend, and the derivatives of these velocities with respect to the
          input;
        - variables and rates of the pairs (joints) with loads. The angles have no jumps of
          whole revolutions, because springs count revolutions;
        - the rate of the pair at which the torque acts;
        - the position analysis of the run (field `tracer` of `Needs`), if there is friction
          of bearings or contacts. The forces in the pairs, which cause the friction, are
          computed from the position analysis.

        Raises
        ------
        ModelError
            If the mechanism has neither masses nor loads, or no pair has the name `at`.
        AnalysisError
            If the mechanism has several inputs, or `at` is no R pair (revolute joint).
        """
        # This call raises the `ModelError` if there are neither masses nor loads.
        need_terms(mechanism)
        if len(mechanism.inputs) > 1:
            raise AnalysisError(
                f"eksergian: {mechanism.name} has {len(mechanism.inputs)} inputs "
                f"({listing(mechanism.input_pairs)}), but this analysis computes the "
                "torque of a single input; use the analysis dynamics for several"
            )
        # Names of the links that have mass, or on whose motion loads depend.
        link_names = used_links(mechanism) | {mass.link for mass in mechanism.masses}
        # Pairs at which loads act, or on which the loads depend.
        load_pairs = used_pairs(mechanism)
        torque_pairs = frozenset([self.at] if self.at else [])
        self._check_torque_pair(mechanism)
        has_friction = bool(Loads(mechanism).friction_components)
        return Needs(
            time=True,
            tracer=has_friction,
            # The links of `link_names`, and the two links of each pair in `load_pairs`.
            links=acting_links(mechanism),
            derivatives=True,
            link_rates=link_names,
            rotations=link_names,
            continued_values=load_pairs,
            pair_rates=load_pairs | torque_pairs,
        )

    def _check_torque_pair(self, mechanism: Mechanism) -> None:
        """Raise an error if `at` is given, but is no R pair (revolute joint).

        Raises
        ------
        ModelError
            If the mechanism has no pair `at`.
        AnalysisError
            If the pair `at` is a contact.
        """
        # A pair is an R pair, which has an axis, or a contact.
        if self.at and not mechanism.pair(self.at).kind.has_axis:
            raise AnalysisError(
                f'eksergian: at: pair "{self.at}" is a contact pair; name an R pair'
            )

    def compute(self, batch: Batch) -> Mapping[str, TableData]:
        """Return the tables of torque, of the links' inertia and of the loads.

        The batch has n rows. For each row the first table has one row, the second table one
        row for each link with mass, and the third table one row for each load.

        The equation of motion is ``B ddq + B' dq^2 / 2 = Q + tau`` (Eksergian). The input q
        has the rate `dq` and the acceleration `ddq`. `B` is the equivalent inertia, twice
        the kinetic energy at unit rate of q, and B' its derivative with respect to q. `Q`
        is the generalised force of all loads, and `tau` the driving torque.
        """
        solution = self._inverse_solution(batch)
        mechanism = batch.mechanism
        row_identity = row_columns(batch, with_time=True)
        mass_links = [mass.link for mass in mechanism.masses]
        load_names = [load.name for load in mechanism.loads]
        # (n, links with mass) parts of the inertia, and (n, loads) parts of the force at
        # the only input (number 0).
        inertia_parts = solution.B_parts
        force_parts = solution.Q_parts[:, 0]
        # The option `at` can name another pair than the input.
        torque = self._torque_at_pair(batch, solution.tau)
        status = solution.status.copy()
        # At its dead centre this pair is at rest, so a torque at it has no power. The
        # torque is then NaN, although the solution is OK.
        is_dead_centre = (status == Status.OK) & np.isnan(torque)
        status[is_dead_centre] = Status.AT_SINGULARITY
        # `of_parts` returns OK for each finite part, and the status of the row for others.
        return {
            "eksergian": {
                **row_identity,
                "dq": batch.dq,
                "ddq": batch.ddq,
                "B": solution.B,
                "dB_dq": solution.dB_dq,
                "Q": solution.Q,
                "tau": torque,
                # Rotation (rad) by which a loop of links fails to close.
                "residual": batch.residual,
                "status": status,
            },
            "inertia": {
                **repeat_rows(row_columns(batch), mass_links, "link"),
                "B": inertia_parts.ravel(),
                "dB_dq": solution.dB_parts.ravel(),
                "status": of_parts(inertia_parts, solution.status).ravel(),
            },
            "loads": {
                **repeat_rows(row_identity, load_names, "load"),
                "Q": force_parts.ravel(),
                "power": solution.power.ravel(),
                "status": of_parts(force_parts, solution.status).ravel(),
            },
        }

    def _torque_at_pair(self, batch: Batch, torque: Floats) -> Floats:
        """Return the torque (n,) at the pair `at`, equivalent to a torque at the input.

        `torque` (n,) is the torque at the input (N m). Both torques have the same power, so
        `torque` is divided by the rate of the pair per unit rate of the input. The result
        is NaN at dead centres of the pair. Without `at` the torque is returned unchanged.
        """
        if not self.at:
            return torque
        rate = batch.pair_rate(self.at)
        is_dead_centre = np.abs(rate) <= MAX_DEAD_CENTRE_RATE
        return torque / np.where(is_dead_centre, np.nan, rate)

    def _inverse_solution(self, batch: Batch) -> InverseSolution:
        """Return inertia, loads and driving torque of a batch, which are computed once.

        The driving torque is the torque that the known motion needs.
        """
        return batch.once("torque", lambda: _solve_torque(batch))

    def _torque_without_rounding_errors(self, batch: Batch) -> Floats:
        """Return the driving torque (n,) at the only input, 0 where it is a rounding error.

        In a simulation without a motor the loads alone cause the motion, so the driving
        torque is zero up to rounding. The torque is a sum of three terms, B ddq +
        dB/dq dq^2 / 2 - Q. B is the equivalent inertia of the mechanism at the input q. Q
        is the generalised force of all loads at the input. A torque counts as a rounding
        error in two cases: if it is small compared with the terms of its own row, or if it
        is small compared with the largest sum of |B ddq| and |Q| in any row.
        """
        solution = self._inverse_solution(batch)
        # The first case is done in `sure_torques`, the second one below.
        torque = solution.sure_torques[:, 0].copy()
        load_size = np.abs(solution.Q)
        inertia_size = np.abs(solution.B * batch.ddq)
        terms = load_size + inertia_size
        largest_term = np.max(terms, initial=0.0, where=np.isfinite(terms))
        is_rounding = np.abs(torque) <= ZERO_TORQUE_RATIO * largest_term
        torque[is_rounding] = 0.0
        return torque

    def findings(self, batch: Batch) -> Findings:
        """Return the largest torque and the worst conditioning, and where they occur.

        The conditioning is the condition number of the equations that close the loops, with
        a locked input. The torque is at the input, or at the pair that the option `at`
        names.
        """
        # Rounding errors become 0 here, because the next step divides by the rate of the
        # pair `at`. The division could make a rounding error large.
        input_torque = self._torque_without_rounding_errors(batch)
        torque = self._torque_at_pair(batch, input_torque)
        summary: dict[str, Any] = {}
        has_configurations = np.any(np.isfinite(batch.residual))
        if has_configurations:
            worst_row = int(np.nanargmax(batch.closure_conditioning))
            summary = {
                LARGEST_CONDITIONING: float(batch.closure_conditioning[worst_row]),
                "at_q_rad": float(batch.q[worst_row]),
                "at_assembly_mode": int(batch.assembly_mode[worst_row]),
            }
        # The largest torque by the name of the only input.
        largest_by_input = find_largest_torques(
            batch, torque[:, None], LARGEST_DRIVING_TORQUE
        )
        for input_pair, largest in largest_by_input.items():
            summary["torque"] = {"pair": self.at or input_pair, **largest}
        return _make_findings(summary)

    def joined(self, before: Findings, now: Findings) -> Findings:
        """Return the worse conditioning and the larger torque of two findings.

        A run is computed in blocks of samples. The findings of all earlier blocks are
        joined with those of the next one. The conditioning is the condition number of the
        equations that close the loops.
        """
        # Findings without any configuration have no conditioning.
        summaries = [
            findings.figures
            for findings in (before, now)
            if LARGEST_CONDITIONING in findings.figures
        ]
        worst = max(
            summaries, key=lambda summary: summary[LARGEST_CONDITIONING], default={}
        )
        # Both findings have one record, of their largest torque. The function keeps the
        # larger of two records with the same name, so both get the same name.
        torques = merge_largest_torques(
            {"torque": before.figures["torque"]},
            {"torque": now.figures["torque"]},
            LARGEST_DRIVING_TORQUE,
        )
        return _make_findings({**worst, **torques})

    def scene(self, batch: Batch) -> tuple[Scene, ...]:
        """Return a page with plots for each assembly mode (way to assemble the links).

        The plots show the equivalent inertia (that of all links, reduced to the input),
        with the part of each link, and the derivative of the inertia with respect to the
        input. A further plot shows the driving torque, with the parts due to inertia and to
        each load. If the samples are times, there is a phase portrait: the rate of the
        input against the input.
        """
        solution = self._inverse_solution(batch)
        scenes = plots_by_mode(
            batch, [*self._torque_plots(batch), *_inertia_plots(batch, solution)]
        )
        if not batch.timed:
            return scenes
        portraits = [
            Portrait(
                "plots/phase_portrait",
                "phase portrait",
                x=batch.q[rows],
                y=batch.dq[rows],
                x_label="q",
                y_label="dq",
                x_range=batch.q_range,
                y_range=batch.dq_range,
                x_unit="rad",
                y_unit="rad/s",
            )
            for rows in batch.assembly_mode_rows().values()
        ]
        return tuple(
            replace(scene, primitives=(*scene.primitives, portrait))
            for scene, portrait in zip(scenes, portraits, strict=True)
        )

    def _torque_plots(self, batch: Batch) -> list[Series]:
        """Return plots of the driving torque and of its parts: inertia and loads.

        All of them are torques at the input, or at the pair that the option `at` names. The
        part of a load is the torque that balances the load. So its sign is opposite to that
        of the generalised force.
        """
        solution = self._inverse_solution(batch)
        torques = {"tau": solution.tau}
        if batch.timed:
            torques["B ddq"] = solution.B * batch.ddq
        torques["dB/dq dq²/2"] = 0.5 * solution.dB_dq * batch.dq**2
        for number, load in enumerate(batch.mechanism.loads):
            torques[f"against {load.name}"] = -solution.Q_parts[:, 0, number]
        return [
            plot_series(
                "torque",
                label,
                "driving torque",
                self._torque_at_pair(batch, values),
                "N m",
            )
            for label, values in torques.items()
        ]


def _inertia_plots(batch: Batch, solution: InverseSolution) -> list[Series]:
    """Return plots of the equivalent inertia B and its derivative dB/dq, with their parts.

    B is twice the kinetic energy at unit rate of the input q. Each link with mass has a
    part.

    Parameters
    ----------
    batch
        The n rows of a motion.
    solution
        B and dB/dq (n,) of the whole mechanism, and their parts (n, links with mass).
    """
    mechanism = batch.mechanism
    # The last argument of `plot_series` is the number of a link, whose colour the curve
    # gets. The curve of the whole mechanism has the colour of the ground, link 0.
    title = "equivalent inertia"
    plots = [plot_series("inertia", "B", title, solution.B, "kg m2", 0)]
    for mass, part in zip(mechanism.masses, solution.B_parts.T, strict=True):
        link = mechanism.link_number[mass.link]
        label = f"link {mass.link}"
        plots.append(plot_series("inertia", label, title, part, "kg m2", link))
    title = "derivative of the inertia"
    unit = "kg m2/rad"
    plots.append(plot_series("derivative", "dB/dq", title, solution.dB_dq, unit, 0))
    for mass, part in zip(mechanism.masses, solution.dB_parts.T, strict=True):
        link = mechanism.link_number[mass.link]
        label = f"link {mass.link}"
        plots.append(plot_series("derivative", label, title, part, unit, link))
    return plots


def _make_findings(summary: Mapping[str, Any]) -> Findings:
    """Return the findings with a sentence about the largest torque."""
    records = {summary["torque"]["pair"]: summary["torque"]}
    remarks = describe_largest_torques(records, LARGEST_DRIVING_TORQUE, "driving torque")
    return Findings(summary, (), remarks)


def _solve_torque(batch: Batch) -> InverseSolution:
    """Return inertia, loads and driving torque for the rows of a batch.

    A row is the configuration at one sample in one assembly mode (way to assemble the
    links). There are two cases:

    - Some friction is proportional to the forces in the pairs (joints). These forces depend
      on the motion of all links. The batch has the rates of some links only, so all rates
      are computed from the configurations.
    - Without such friction, only the links and pairs with masses or loads matter. The batch
      has their motion. Rows with inaccurate rates get the status ILL_CONDITIONED.
    """
    # `friction_components` lists the pairs with such friction.
    if Loads(batch.mechanism).friction_components:
        # The motion in which angles of pairs with loads have no jumps of 2 pi, because
        # springs count whole revolutions.
        motion = continue_load_angles(batch)
        # The torques that balance inertia, loads and friction.
        return needed_torques(motion)
    status = batch.status.copy()
    # `rates_loss` is the relative error bound of the rates. The comparison is negated so
    # that NaN counts as inaccurate.
    is_inaccurate = ~(batch.rates_loss() < MAX_RATES_LOSS)
    status[(status == Status.OK) & is_inaccurate] = Status.ILL_CONDITIONED
    timing = Timing(batch.t, batch.input_rates, batch.input_accelerations)
    # The rows, and by how much the loops fail to close (rad).
    rows = (batch.sample, batch.assembly_mode, batch.inputs, batch.residual)
    # The motion of the links and pairs with masses or loads, with angles without jumps.
    motion_by_input = _coordinate_motion(batch)
    # `balancing` returns the torques that balance inertia and loads.
    return balancing(batch.mechanism, rows, timing, motion_by_input, status)


def _coordinate_motion(batch: Batch) -> CoordinateMotion:
    """Return the configurations of a batch and their derivatives with respect to the input.

    The result has the variables and links on which loads and masses depend. All other
    variables and links are NaN. The second derivatives of the pair variables are not needed
    and are NaN.
    """
    mechanism = batch.mechanism
    needs = batch.needs
    row_count = len(batch)
    variable_count = len(mechanism.variable_names)
    link_count = len(mechanism.links)
    values, rates, second_derivatives = np.full((3, row_count, variable_count), np.nan)
    for pair in needs.continued_values:
        variable = mechanism.angles[pair]
        # The angle without jumps of whole revolutions.
        values[:, variable] = batch.continued_value(pair)
        rates[:, variable] = batch.pair_rate(pair)
    rotations = np.full((row_count, link_count, 3, 3), np.nan)
    w, dw = np.full((2, row_count, link_count, 3), np.nan)
    for name in needs.link_rates:
        link = mechanism.link_number[name]
        rotations[:, link] = batch.rotation(name)
        w[:, link] = batch.angular_velocity(name)
        dw[:, link] = batch.angular_velocity_dq(name)
    # The axes attached to each pair (n, pairs, 3, 3) are only needed for friction of
    # bearings and contacts. `_solve_torque` calls this function only without it.
    no_frames = rotations[:, :0]
    # First and second derivatives have one and two axes of inputs, each of length 1.
    return CoordinateMotion(
        values=values,
        rates=rates[:, None],
        second=second_derivatives[:, None, None],
        rotations=rotations,
        w=w[:, None],
        dw=dw[:, None, None],
        status=batch.status,
        frames=no_frames,
    )
