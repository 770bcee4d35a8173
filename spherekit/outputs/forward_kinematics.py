"""Forward kinematics of a declared output: its poses at given inputs, in every mode.

Every configuration of the mechanism at the inputs gives a pose. The rates of the output
come from the velocity equations of all loops, which apply to every mechanism. They are
therefore independent of the inverse kinematics.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from spherekit.argument_validation import checked
from spherekit.arrays import Bools, Floats, Indices, SmallIntegers
from spherekit.errors import SolveError
from spherekit.files.mechanism_reader import AnyMechanism, mechanism_of
from spherekit.geometry.rotation import transpose
from spherekit.geometry.vectors import all_finite, nans
from spherekit.mechanism.elements import Output
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.output_choice import chosen_output
from spherekit.numerics.angles import wrap
from spherekit.outputs.wheel_revolutions import find_assembled_configuration
from spherekit.planning.assembly_plan import plan_assembly
from spherekit.positions.assembly_enumeration import enumerate_assemblies
from spherekit.positions.assembly_mode import AssemblyMode
from spherekit.positions.input_grid import make_path
from spherekit.positions.motion import Motion
from spherekit.positions.position_solver import PositionSolver
from spherekit.status import Status
from spherekit.wording import counted, listing


@dataclass(frozen=True)
class PoseSolutions:
    """All configurations of a mechanism at some poses of its output, or at some inputs.

    Each of the k rows is one configuration. The configurations of one pose are in
    successive rows.
    A dyad is a group of two links that can be placed in two ways, which its sign 1 or -1
    distinguishes.

    Attributes
    ----------
    row
        (k,) index of the pose, or of the set of inputs, to which the configuration belongs.
    inputs
        (k, inputs) values of the inputs (rad).
    values
        (k, variables) values of all pair variables of the mechanism (rad).
    rotations
        (k, 3, 3) orientations of the output link, seen from the link that the output is
        relative to.
    directions
        (k, 3) directions in which the output points. None if the output is an orientation
        without such a direction.
    signs
        k tuples, one for each configuration: the sign (1 or -1) of each dyad, 0 for groups
        that are no dyads. Groups are in the order in which they are placed.
    complete
        (n,) for each of the n poses or sets of inputs, whether it is certain that no
        configuration is missing.
    """

    row: Indices
    inputs: Floats
    values: Floats
    rotations: Floats
    directions: Floats | None
    signs: tuple[tuple[int, ...], ...]
    complete: Bools


def output_orientations(mechanism: Mechanism, output: Output, rotations: Floats) -> Floats:
    """Return orientations (..., 3, 3) of the output link, seen from its reference link.

    An output is the motion of one link relative to another link, its reference.

    Parameters
    ----------
    mechanism, output
        The mechanism and its output.
    rotations
        (..., links, 3, 3) rotations from the axes of all links to those of the ground.
    """
    base = mechanism.link_number[output.relative_to]
    link = mechanism.link_number[output.link]
    return transpose(rotations[..., base, :, :]) @ rotations[..., link, :, :]


def output_directions(output: Output, orientations: Floats) -> Floats | None:
    """Return the directions (..., 3) in which an output points, from its orientations.

    The orientations are rotation matrices (..., 3, 3) from axes of the output link. None is
    returned if the output has no direction.
    """
    if output.direction is None:
        return None
    return orientations @ np.array(output.direction)


def find_configurations(
    solver: PositionSolver,
    output: Output,
    inputs: Floats,
    released: PositionSolver | None = None,
) -> PoseSolutions:
    """Return every configuration of a mechanism at some inputs, row by row.

    For inverse kinematics, `solver` belongs to the mechanism with additional, virtual links
    that fix the output in a pose. The coordinates of the pose are the inputs of this
    extended mechanism.

    Parameters
    ----------
    solver
        Solver of the mechanism, or of the mechanism with its output held.
    output
        The output whose poses are returned.
    inputs
        (n, inputs) inputs of `solver` (rad). Rows that are not finite are left out.
    released
        If `solver` belongs to the mechanism with a fixed output, the solver of the
        mechanism itself. Its variables are the first ones of `solver`. Only these variables
        and the inputs of the mechanism itself are returned.

    Returns
    -------
    The configurations. Their inputs are reduced by whole periods, to (-period / 2,
    period / 2]. The period of an input is the change after which all configurations repeat:
    one revolution, or several if wheels roll on each other. An input without a known period
    is not reduced.
    """
    released_solver = solver if released is None else released
    # One entry for each configuration: row of the inputs, variables, signs of the dyads.
    row: list[int] = []
    values: list[Floats] = []
    signs: list[tuple[int, ...]] = []
    complete = np.ones(len(inputs), dtype=bool)
    for number, q in enumerate(inputs):
        if not all_finite(q):
            continue
        solutions = enumerate_assemblies(solver, q)
        complete[number] = solutions.is_complete
        for mode, closed_values in zip(solutions.signs, solutions.values, strict=True):
            if released is None:
                configuration: Floats | None = closed_values
            else:
                # With the output held, wheels close in any mesh of their teeth. The wheels
                # are turned by whole revolutions until they mesh as in the file. If that is
                # impossible, the result is None.
                configuration = find_assembled_configuration(
                    solver, released, closed_values
                )
            if configuration is None:
                continue
            row.append(number)
            values.append(configuration)
            signs.append(mode)
    variable_count = len(solver.mechanism.variable_owners)
    all_values = np.array(values).reshape(-1, variable_count)
    link_rotations = solver.closure.linearise(all_values).rotations
    orientations = output_orientations(solver.mechanism, output, link_rotations)
    return PoseSolutions(
        row=np.array(row, dtype=np.intp),
        inputs=released_solver.reduce_inputs(all_values[:, released_solver.driven]),
        values=all_values[:, : len(released_solver.mechanism.variable_owners)],
        rotations=orientations,
        directions=output_directions(output, orientations),
        signs=tuple(signs),
        complete=complete,
    )


@dataclass(frozen=True)
class Forward:
    """Poses of an output at n inputs, in m assembly modes of a mechanism of dyads.

    A dyad is a group of two links that can be placed in two ways, which its sign 1 or -1
    distinguishes. An assembly mode is a choice of these signs.

    Attributes
    ----------
    modes
        The signs of the dyads in each of the m modes.
    rotations
        (m, n, 3, 3) from axes of the output link to those of the link from which it is
        seen.
    directions
        (m, n, 3) directions at which the output points; None if it declares no direction.
    status
        (m, n) values of `Status`. Poses whose status is a failure are NaN.
    """

    modes: tuple[tuple[int, ...], ...]
    rotations: Floats
    directions: Floats | None
    status: SmallIntegers


@dataclass(frozen=True)
class DyadConfigurations:
    """Configurations of a mechanism of dyads at n inputs in m assembly modes.

    A dyad is a group of two links that can be placed in two ways. An assembly mode is a
    choice of one way for each dyad.

    Attributes
    ----------
    values
        (m, n, variables) pair variables (rad).
    rotations
        (m, n, links, 3, 3) rotations from link axes to ground axes.
    status
        (m, n) values of `Status`.
    """

    values: Floats
    rotations: Floats
    status: SmallIntegers


class ForwardKinematics:
    """The forward kinematics of an output: its poses at given inputs.

    The method `at` returns the poses for mechanisms of dyads (groups of two links). The
    method `solutions` returns them for any mechanism.

    Attributes
    ----------
    mechanism
        The mechanism.
    output
        The declared output: a link, or a direction in a link, that is observed.
    solver
        Position solver of the mechanism.

    Raises
    ------
    ModelError, PlanError
        If the output is not declared, or if the mechanism does not have as many degrees of
        freedom as inputs.
    """

    @checked(SolveError)
    def __init__(self, mechanism: AnyMechanism, output: str | None = None) -> None:
        """Choose the output and plan how the links are placed."""
        self.mechanism = mechanism = mechanism_of(mechanism)
        self.output = chosen_output(mechanism, output)
        self.solver = PositionSolver(mechanism, plan_assembly(mechanism))

    @checked(SolveError)
    def at(
        self, inputs: ArrayLike, modes: Sequence[tuple[int, ...]] | None = None
    ) -> Forward:
        """Return the poses of the output at some inputs, in several assembly modes at once.

        Parameters
        ----------
        inputs
            (n, inputs) values of the inputs (rad).
        modes
            The requested modes, each with the sign, 1 or -1, of every dyad (a group of two
            links that can be placed in two ways); all modes by default.

        Returns
        -------
        Orientations (modes, n, 3, 3) of the output link. If the output has a direction (a
        unit vector that is fixed in its link), also this direction (modes, n, 3).

        Raises
        ------
        SolveError
            If a group of links is no dyad (the method `solutions` has no such limit), if a
            mode does not have one sign for each dyad, or if the inputs are not finite or
            not as many as the mechanism has.
        """
        # Links are placed in groups, the smallest sets that are rigid when the inputs are
        # locked. Only groups that are dyads have a closed form.
        if not self.solver.assembly.has_closed_form:
            groups = self.solver.assembly.groups
            kinds = listing(dict.fromkeys(group.kind for group in groups))
            raise SolveError(
                f"{self.mechanism.name}: this method needs a mechanism of dyads only, but "
                f"found groups of the kind {kinds}; call `solutions` instead, or trace the "
                "mechanism along a path"
            )
        # `make_path` checks the number of inputs, and that they are finite.
        q = make_path(np.asarray(inputs, dtype=float), len(self.solver.driven)).q
        signs = self._modes if modes is None else tuple(map(tuple, modes))
        dyad_count = len(self.solver.assembly.groups)
        is_valid = [len(mode) == dyad_count and set(mode) <= {1, -1} for mode in signs]
        if not (signs and all(is_valid)):
            raise SolveError(
                f"modes: found {[list(map(int, mode)) for mode in signs]}, expected at "
                "least one mode, which has 1 or -1 for each of "
                f"{counted(dyad_count, 'dyad')}"
            )
        configurations = self._evaluate(q, signs)
        orientations = output_orientations(
            self.mechanism, self.output, configurations.rotations
        )
        return Forward(
            modes=signs,
            rotations=orientations,
            directions=output_directions(self.output, orientations),
            status=configurations.status,
        )

    @property
    def _modes(self) -> tuple[tuple[int, ...], ...]:
        """The signs of all modes of dyads."""
        return tuple(product((1, -1), repeat=len(self.solver.assembly.groups)))

    def _evaluate(self, q: Floats, modes: Sequence[tuple[int, ...]]) -> DyadConfigurations:
        """Return the configurations at inputs (n, inputs) rad in some modes of dyads.

        A dyad is two links that can be assembled in two ways; its sign is one of these
        ways. A mode consists of the signs of all dyads.
        """
        results = [
            self.solver.evaluate(AssemblyMode(number=0, signs=signs), q) for signs in modes
        ]
        return DyadConfigurations(
            values=np.stack([result.values for result in results]),
            rotations=np.stack([result.rotations for result in results]),
            status=np.stack([result.status for result in results]),
        )

    @checked(SolveError)
    def solutions(self, inputs: ArrayLike) -> PoseSolutions:
        """Return every configuration found at some inputs, for any mechanism.

        Mechanisms of dyads (groups of two links and three R pairs) are computed in closed
        form. Others are solved for one set of inputs after another. The attribute
        `complete` of the result says for which inputs it is certain that no configuration
        is missing.

        The returned inputs are reduced by whole periods, to (-period / 2, period / 2]. The
        period of an input is the change after which all configurations repeat. Without
        wheels it is one revolution. If wheels roll on each other, it can be several
        revolutions. An input without a known period is not reduced.

        Parameters
        ----------
        inputs
            (n, inputs) values of the inputs (rad).

        Raises
        ------
        SolveError
            If the inputs are not finite or not as many as the mechanism has.
        """
        q = np.asarray(inputs, dtype=float)
        if q.shape == (0, len(self.solver.driven)):  # there are no inputs
            return find_configurations(self.solver, self.output, q)
        # `make_path` checks the number of inputs, and that they are finite.
        q = make_path(q, len(self.solver.driven)).q
        if not self.solver.assembly.has_closed_form:
            return find_configurations(self.solver, self.output, q)
        # A mode is a tuple of signs, one for each dyad.
        configurations = self._evaluate(q, self._modes)
        # Failed samples are NaN, and so are those whose pair variables are not determined.
        is_found = all_finite(configurations.values, 2)
        # A mode that is out of reach certainly has no configuration at the inputs.
        is_absent = configurations.status == Status.OUT_OF_REACH
        # `T` changes the axes from (modes, n) to (n, modes), so that all modes of one set
        # of inputs follow each other.
        row, mode = np.nonzero(is_found.T)
        values = configurations.values[mode, row]
        orientations = output_orientations(
            self.mechanism, self.output, configurations.rotations[mode, row]
        )
        modes = self._modes
        return PoseSolutions(
            row=row,
            inputs=wrap(values[:, self.solver.driven]),
            values=values,
            rotations=orientations,
            directions=output_directions(self.output, orientations),
            signs=tuple(modes[k] for k in mode),
            complete=np.all(is_found | is_absent, axis=0),
        )


def output_rates(motion: Motion, output: Output) -> Floats:
    """Return the output's angular velocity per unit rate of each input (the Jacobian).

    One input moves while the others are locked. The rates of the passive (not driven)
    variables follow from the velocity equations of all loops, J_passive rates = -J_input.
    Here J is the derivative of the loop closure equations with respect to the variables.
    J_passive has the columns of the passive variables, and J_input has the column of the
    moving input.

    Parameters
    ----------
    motion
        n configurations of the mechanism.
    output
        The output.

    Returns
    -------
    (n, 3, inputs) angular velocity (rad/s) of the output link relative to the link that the
    output is relative to, in the axes of the latter. NaN for configurations that failed and
    where the inputs do not determine the motion.
    """
    mechanism = motion.mechanism
    link = mechanism.link_number[output.link]
    base = mechanism.link_number[output.relative_to]
    is_ok = motion.status == Status.OK
    rates = nans((len(motion), 3, motion.inputs.shape[1]))
    # Vectors are computed in ground axes and then turned to the axes of the base, the
    # reference link of the output.
    ground_to_base = transpose(motion.rotations[is_ok, base])
    part = motion.rows(is_ok)
    linearisation = part.linearisation
    for column, pair in enumerate(motion.assembly.inputs):
        (moving_variable,) = mechanism.variables_of(pair)
        variable_rates = np.zeros_like(part.values)
        variable_rates[:, moving_variable] = 1.0
        input_column = linearisation.jacobian[:, :, moving_variable, None]
        # `closure_inverse` is a left inverse of J_passive.
        passive_rates = -(part.closure_inverse @ input_column)[..., 0]
        variable_rates[:, part.passive_variables] = passive_rates
        angular_velocities = linearisation.body_rates(variable_rates)
        relative = angular_velocities[:, link] - angular_velocities[:, base]
        rates[is_ok, :, column] = np.matvec(ground_to_base, relative)
    return rates
