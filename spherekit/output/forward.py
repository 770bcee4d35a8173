"""Forward kinematics of a declared output: its pose at given inputs, in every mode.

The rates come from the velocity equations of the whole mechanism, which hold whatever
its topology, so that they are exact and independent of the inverse kinematics.

Every configuration of a mechanism at given inputs, as poses of its output.

The turns of the inputs at which wheels stand as a posed configuration has them.

With its output held, a mechanism is closed by its wheels in any mesh, and its inputs are
known to whole turns. But a file means one assembly, in which the lengths rolled follow
from the inputs over any number of turns (`spherekit.motion.meshes`): of the others no
input leads to the pose, and half a turn of a carrier is a whole one of its side gear.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice, product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from spherekit.argument_validation import checked
from spherekit.arrays import Bools, Floats, Indices, SmallIntegers
from spherekit.conventions import CLOSURE_TOLERANCE, TURN, Status
from spherekit.errors import SolveError
from spherekit.files.read import AnyMechanism, mechanism_of
from spherekit.model.mechanism import Mechanism, chosen_output
from spherekit.model.parts import Output
from spherekit.motion.assembly_modes import AssemblyMode, Solver, assembled
from spherekit.motion.elimination import assemblies
from spherekit.motion.input_grid import given_path
from spherekit.motion.meshes import (
    MOST_ASSEMBLIES,
    MOST_SORTED,
    MOST_TURNS,
    SAME_RATIO,
    GearPhases,
    whole_turns_apart,
)
from spherekit.motion.motion import Motion
from spherekit.numeric.crossings import wrap
from spherekit.planning.inputs import plan_assembly
from spherekit.planning.wheels import SAME_LENGTH
from spherekit.sphere.rotation import all_finite, max_abs, nans, transpose


def as_assembled(held: Solver, released: Solver, values: Floats) -> Floats | None:
    """Return a configuration of the assembly that a file means, None if there is none.

    Parameters
    ----------
    held
        The mechanism with its output held, whose variables are first those of `released`.
    released
        The mechanism itself, its lengths rolled known at its inputs.
    values
        (variables,) rad of `held`, closed, its wheels in any mesh.

    Returns
    -------
    (variables,) rad with the inputs at the turns that the lengths rolled say: of those
    that differ by whole turns of wheels, the one whose inputs are least in sum.
    """
    meshes = released.meshes
    if meshes is None or not meshes.variables:
        return values
    driven, rolled = list(released.driven), list(meshes.variables)
    lengths = _lengths(held, meshes, values[rolled])
    tried = np.repeat(values[None], len(lengths), axis=0)
    tried[:, rolled] = lengths
    with np.errstate(all="ignore"):
        closed = held.closure.solve(tried, [*held.driven, *rolled], iterations=30)
    best, least = None, np.inf
    for whole in closed.values[closed.gap < CLOSURE_TOLERANCE]:
        q = _turned(meshes, wrap(whole[driven]), whole[rolled])
        if q is not None and np.sum(np.abs(q)) < least - SAME_LENGTH:
            best, least = whole.copy(), np.sum(np.abs(q))
            best[driven] = q
    return best


def _lengths(held: Solver, meshes: GearPhases, lengths: Floats) -> Floats:
    """Return lengths (n, m) whole turns of wheels from some, as inputs can roll them."""
    joints = [held.closure.joints[held.closure.tree.owners[v]] for v in meshes.variables]
    choices = map(whole_turns_apart, joints, map(float, lengths))
    every = np.array(list(islice(product(*choices), MOST_SORTED)))
    ratios = meshes.ratios
    onto = ratios @ np.linalg.pinv(ratios)
    beyond = every - meshes.lengths
    every = every[max_abs(beyond - beyond @ onto.T, axis=1) < SAME_LENGTH]
    return every[np.argsort(np.sum(np.abs(every), axis=1), kind="stable")[:MOST_ASSEMBLIES]]


def _turned(meshes: GearPhases, q: Floats, lengths: Floats) -> Floats | None:
    """Return inputs (k,) whole turns from some that roll the lengths (m,), the least."""
    rolling = max_abs(meshes.ratios, axis=0) > SAME_RATIO
    half = np.minimum(MOST_TURNS, np.ceil(0.5 * np.asarray(meshes.periods) / TURN))
    turns = [range(-k, k + 1) for k in np.where(rolling, half, 0).astype(int).tolist()]
    places = q + TURN * np.array(list(product(*turns)), dtype=float)
    fits = places[max_abs(meshes.rolled(places) - lengths, axis=1) < SAME_LENGTH]
    if not len(fits):
        return None
    return fits[np.argmin(np.sum(np.abs(fits), axis=1))]


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
    solver: Solver, output: Output, inputs: Floats, released: Solver | None = None
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
        told.reduced(every[:, told.driven]),
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
        q = given_path(np.asarray(inputs, dtype=float), len(self.solver.driven)).q
        if not self.solver.assembly.has_closed_form:
            return solved(self.solver, self.output, q)
        modes = self._modes
        values, rotations, status = self._evaluated(q, modes)
        row, mode = np.nonzero(assembled(status).T)
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
        speeds[:, part.free] = -(part.closure_inverse @ at.jacobian[:, :, moved, None])[
            ..., 0
        ]
        w = at.body_rates(speeds)
        rates[good, :, column] = np.matvec(inverse, w[:, link] - w[:, base])
    return rates
