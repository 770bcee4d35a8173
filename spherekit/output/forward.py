"""Forward kinematics of a declared output: its pose at given inputs, in every mode.

The rates come from the velocity equations of the whole mechanism, which hold whatever
its topology, so that they are exact and independent of the inverse kinematics.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spherekit.checked import checked
from spherekit.conventions import Status
from spherekit.errors import SolveError
from spherekit.files.read import AnyMechanism, mechanism_of
from spherekit.model.outputs import chosen_output
from spherekit.model.parts import Output
from spherekit.motion.assembly_modes import AssemblyMode, Evaluated, Solver
from spherekit.motion.input_grid import given_path
from spherekit.motion.motion import Motion
from spherekit.numeric.turns import wrap
from spherekit.output.solutions import PoseSolutions, pose_of, solved
from spherekit.planning.assembly import plan_assembly
from spherekit.rates.core import driven_rates
from spherekit.sphere.rotation import Floats, transpose


@final
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
    status: NDArray[np.int8]


@final
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
        self.solver = Solver(mechanism, plan_assembly(mechanism))

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
        q = given_path(np.asarray(inputs, dtype=float), len(self.solver.driven)).q
        if modes is None:
            modes = _signs(len(self.solver.assembly.groups))
        rotations, status = [], []
        for number, signs in enumerate(modes):
            evaluated = self.solver.evaluate(AssemblyMode(number, tuple(signs)), q)
            rotations.append(pose_of(self.mechanism, self.output, evaluated.rotations))
            status.append(evaluated.status)
        turned = np.stack(rotations)
        direction = self.output.direction
        return Forward(
            tuple(tuple(signs) for signs in modes),
            turned,
            None if direction is None else turned @ np.array(direction),
            np.stack(status),
        )

    @checked(SolveError)
    def solutions(self, inputs: ArrayLike) -> PoseSolutions:
        """Return every configuration found at inputs (n, inputs) rad, row by row.

        Raises
        ------
        SolveError
            If the inputs are not finite or not as many as the mechanism has.
        """
        q = given_path(np.asarray(inputs, dtype=float), len(self.solver.driven)).q
        if self.solver.assembly.has_closed_form:
            return self._dyads(q)
        return solved(self.solver, self.output, q)

    def _dyads(self, q: Floats) -> PoseSolutions:
        modes = _signs(len(self.solver.assembly.groups))
        evaluated = [self.solver.evaluate(AssemblyMode(0, signs), q) for signs in modes]
        held = np.stack([_closed(in_mode) for in_mode in evaluated], axis=1)
        row, mode = np.nonzero(held)
        values = np.stack([in_mode.values for in_mode in evaluated], axis=1)[row, mode]
        rotations = np.stack([in_mode.rotations for in_mode in evaluated], axis=1)[
            row, mode
        ]
        turned = pose_of(self.mechanism, self.output, rotations)
        direction = self.output.direction
        return PoseSolutions(
            row,
            wrap(values[:, list(self.solver.driven)]),
            values,
            turned,
            None if direction is None else turned @ np.array(direction),
            tuple(modes[k] for k in mode),
            np.ones(len(q), dtype=bool),
        )


def _signs(groups: int) -> list[tuple[int, ...]]:
    """Return the signs of all modes of so many dyads."""
    return list(product((1, -1), repeat=groups))


def _closed(evaluated: Evaluated) -> NDArray[np.bool_]:
    status = evaluated.status
    return np.asarray((status == Status.OK) | (status == Status.AT_SINGULARITY))


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
    rates = np.full((len(motion), 3, motion.inputs.shape[1]), np.nan)
    inverse = transpose(motion.rotations[good, base])
    for column, pair in enumerate(motion.assembly.inputs):
        w = driven_rates(motion, good, pair).w
        rates[good, :, column] = np.einsum("nij,nj->ni", inverse, w[:, link] - w[:, base])
    return rates
