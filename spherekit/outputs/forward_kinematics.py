"""Forward kinematics of a declared output: its pose at given inputs, in every mode.

The rates come from the velocity equations of the whole mechanism, which hold whatever
its topology, so that they are exact and independent of the inverse kinematics.

Every configuration of a mechanism at given inputs, as poses of its output.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from spherekit.argument_validation import checked
from spherekit.arrays import Bools, Floats, Indices, SmallIntegers
from spherekit.errors import SolveError
from spherekit.files.mechanism_reader import AnyMechanism, mechanism_of
from spherekit.geometry.rotation import transpose
from spherekit.geometry.vectors import all_finite, nans
from spherekit.mechanism.elements import Output
from spherekit.mechanism.mechanism import Mechanism, chosen_output
from spherekit.numerics.angles import wrap
from spherekit.outputs.wheel_revolutions import as_assembled
from spherekit.planning.assembly_plan import plan_assembly
from spherekit.positions.assembly_enumeration import assemblies
from spherekit.positions.assembly_mode import AssemblyMode, has_configuration
from spherekit.positions.input_grid import make_path
from spherekit.positions.motion import Motion
from spherekit.positions.position_solver import PositionSolver
from spherekit.status import Status


@dataclass(frozen=True)
class PoseSolutions:
    """Every configuration found at some poses or inputs, a row for each.

    `row` (k,) is the number of the pose or of the inputs given; `inputs` (k, inputs) rad;
    `values` (k, variables) rad of all pairs of the mechanism; `rotations` (k, 3, 3) the
    orientations of the output link seen from its other link, `directions` (k, 3) what it
    points at, None if it declares no direction; `signs` those of the dyads, 0 for
    irreducible groups, in solving order; `complete` (rows,) whether no solution can be
    missing.
    """

    row: Indices
    inputs: Floats
    values: Floats
    rotations: Floats
    directions: Floats | None
    signs: tuple[tuple[int, ...], ...]
    complete: Bools


def pose_of(mechanism: Mechanism, output: Output, rotations: Floats) -> Floats:
    """Return the orientations (..., 3, 3) of an output from those of all links."""
    base = mechanism.link_number[output.relative_to]
    link = mechanism.link_number[output.link]
    return transpose(rotations[..., base, :, :]) @ rotations[..., link, :, :]


def pointed(output: Output, turned: Floats) -> Floats | None:
    """Return what an output of orientations (..., 3, 3) points at, None if nothing."""
    return None if output.direction is None else turned @ np.array(output.direction)


def solved(
    solver: PositionSolver,
    output: Output,
    inputs: Floats,
    released: PositionSolver | None = None,
) -> PoseSolutions:
    """Return every configuration of a mechanism at inputs (n, inputs), row by row.

    Where `solver` holds the output, `released` is that of the mechanism itself, whose
    variables come first; those and its inputs are told. Inputs are in (-pi, pi] unless
    wheels count their turns.
    """
    told = solver if released is None else released
    row, values, signs = [], [], []
    complete = np.ones(len(inputs), dtype=bool)
    for number, q in enumerate(inputs):
        if not all_finite(q):
            continue
        here = assemblies(solver, q)
        complete[number] = here.is_complete
        for mode, closed in zip(here.signs, here.values, strict=True):
            configuration = (
                closed if released is None else as_assembled(solver, released, closed)
            )
            if configuration is None:
                continue
            row.append(number)
            values.append(configuration)
            signs.append(mode)
    every = np.array(values).reshape(-1, len(solver.mechanism.variable_owners))
    turned = pose_of(solver.mechanism, output, solver.closure.at(every).placed)
    return PoseSolutions(
        np.array(row, dtype=np.intp),
        told.reduce_inputs(every[:, told.driven]),
        every[:, : len(told.mechanism.variable_owners)],
        turned,
        pointed(output, turned),
        tuple(signs),
        complete,
    )


@dataclass(frozen=True)
class Forward:
    """Poses of an output at n inputs in m assembly modes of dyads.

    `rotations` (m, n, 3, 3) from axes of the output link to those of the link it is seen
    from; `directions` (m, n, 3) what it points at there, None if it declares none;
    `status` (m, n) values of `Status`; failed rows are NaN.
    """

    modes: tuple[tuple[int, ...], ...]
    rotations: Floats
    directions: Floats | None
    status: SmallIntegers


class ForwardKinematics:
    """The forward kinematics of one declared output, with any number of inputs.

    Raises
    ------
    ModelError, PlanError
        If the output is not declared, or there is not one freedom for each input.
    """

    @checked(SolveError)
    def __init__(self, mechanism: AnyMechanism, output: str | None = None) -> None:
        self.mechanism = mechanism = mechanism_of(mechanism)
        self.output = chosen_output(mechanism, output)
        self.solver = PositionSolver(mechanism, plan_assembly(mechanism))

    @checked(SolveError)
    def at(
        self, inputs: ArrayLike, modes: Sequence[tuple[int, ...]] | None = None
    ) -> Forward:
        """Return the poses at inputs (n, inputs) rad; modes are signs of the dyads.

        Raises
        ------
        SolveError
            If groups are irreducible (ask for `solutions`), or the inputs are not finite
            or not as many as the mechanism has.
        """
        if not self.solver.assembly.has_closed_form:
            kinds = ", ".join(group.kind for group in self.solver.assembly.groups)
            raise SolveError(
                f"{self.mechanism.name}: its groups are {kinds}; ask for `solutions` row "
                "by row, or trace the mechanism along a path"
            )
        q = make_path(np.asarray(inputs, dtype=float), len(self.solver.driven)).q
        signs = self._modes if modes is None else tuple(map(tuple, modes))
        _, rotations, status = self._evaluated(q, signs)
        turned = pose_of(self.mechanism, self.output, rotations)
        return Forward(signs, turned, pointed(self.output, turned), status)

    @property
    def _modes(self) -> tuple[tuple[int, ...], ...]:
        """The signs of all modes of dyads."""
        return tuple(product((1, -1), repeat=len(self.solver.assembly.groups)))

    def _evaluated(self, q: Floats, modes: Sequence[tuple[int, ...]]) -> list[Any]:
        """Return variables, rotations of links and status (m, n, ...) at inputs."""
        made = [self.solver.evaluate(AssemblyMode(0, signs), q) for signs in modes]
        return [
            np.stack([getattr(mode, part) for mode in made])
            for part in ("values", "rotations", "status")
        ]

    @checked(SolveError)
    def solutions(self, inputs: ArrayLike) -> PoseSolutions:
        """Return every configuration found at inputs (n, inputs) rad, row by row.

        Raises
        ------
        SolveError
            If the inputs are not finite or not as many as the mechanism has.
        """
        q = make_path(np.asarray(inputs, dtype=float), len(self.solver.driven)).q
        if not self.solver.assembly.has_closed_form:
            return solved(self.solver, self.output, q)
        modes = self._modes
        values, rotations, status = self._evaluated(q, modes)
        row, mode = np.nonzero(has_configuration(status).T)
        turned = pose_of(self.mechanism, self.output, rotations[mode, row])
        return PoseSolutions(
            row,
            wrap(values[mode, row][:, self.solver.driven]),
            values[mode, row],
            turned,
            pointed(self.output, turned),
            tuple(modes[k] for k in mode),
            np.ones(len(q), dtype=bool),
        )


def output_rates(motion: Motion, output: Output) -> Floats:
    """Return the output's angular velocity (n, 3, inputs) per unit rate of each input.

    That of its link relative to the link it is seen from, in axes of the latter; the
    Jacobian of an orientation. NaN in rows that failed and where the inputs do not
    determine the motion. From the velocity equations of all loops.
    """
    mechanism = motion.mechanism
    link = mechanism.link_number[output.link]
    base = mechanism.link_number[output.relative_to]
    good = motion.status == Status.OK
    rates = nans((len(motion), 3, motion.inputs.shape[1]))
    inverse = transpose(motion.rotations[good, base])
    part = motion.rows(good)
    at = part.linearisation
    for column, pair in enumerate(motion.assembly.inputs):
        (moved,) = mechanism.variables_of(pair)
        speeds = np.zeros_like(part.values)
        speeds[:, moved] = 1.0
        speeds[:, part.passive_variables] = -(
            part.closure_inverse @ at.jacobian[:, :, moved, None]
        )[..., 0]
        w = at.body_rates(speeds)
        rates[good, :, column] = np.matvec(inverse, w[:, link] - w[:, base])
    return rates
