"""Chooses how the configurations at poses of an output are computed.

If the mechanism has a closed form, this is used. Otherwise the output is held in the pose,
and the position solver places the links group by group (`GraphKinematics`).
"""

from collections.abc import Sequence

import numpy as np

from spherekit.arrays import Floats
from spherekit.errors import ModelError, SolveError
from spherekit.geometry.vectors import nans
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.output_choice import chosen_output
from spherekit.outputs.dyad_chain import invert_jacobian
from spherekit.outputs.dyad_solver import DyadKinematics, geared_kinematics
from spherekit.outputs.inverse_kinematics import InverseKinematics
from spherekit.outputs.mid_plane_solver import MidPlaneKinematics
from spherekit.outputs.mid_plane_symmetry import mid_plane_form
from spherekit.outputs.output_kinematics import (
    ClosedKinematics,
    InverseRows,
    OutputKinematics,
)
from spherekit.outputs.pose_constraints import measure_joint_margins
from spherekit.outputs.virtual_output import COORDINATES
from spherekit.positions.assembly_mode import label_of


def output_kinematics(
    mechanism: Mechanism, output: str | None = None, graph: bool = False
) -> OutputKinematics:
    """Return an output with the method that solves its poses.

    The methods are tried in this order:

    1. If the mechanism consists of dyads (groups of two links and three R pairs), a closed
       form gives all configurations at a pose.
    2. Two special architectures have a closed form: dyads that wheels drive, and mechanisms
       in which base and output link are mirror images of each other. The latter gives only
       configurations with this symmetry. The option `graph` skips both.
    3. Otherwise the output is held in each pose, and the position solver places all links
       group by group.

    If there are not two or three inputs, no inputs can be computed from a given pose. The
    result then computes only poses from given inputs.

    Parameters
    ----------
    mechanism, output
        The mechanism, and the name of its output if there are several.
    graph
        Whether the position solver is used for every mechanism that does not consist of
        dyads alone.

    Raises
    ------
    ModelError
        If the output is unknown.
    PlanError
        If the direction (or orientation) of the output link cannot be prescribed freely, or
        if the mechanism does not have as many degrees of freedom as inputs.
    """
    # A pose has two coordinates (direction) or three (orientation). A pose determines the
    # inputs only if their number is the same. Otherwise poses are orientations (`points` is
    # False).
    if len(mechanism.inputs) not in COORDINATES:
        return OutputKinematics(mechanism, chosen_output(mechanism, output), points=False)
    inverse = InverseKinematics(mechanism, output)
    if inverse.has_closed_form:  # the mechanism consists of dyads
        return DyadKinematics(inverse)
    if graph:
        return GraphKinematics(inverse)
    try:
        return _find_special_form(inverse)
    except SolveError:  # there is no closed form
        return GraphKinematics(inverse)


def closed_kinematics(mechanism: Mechanism, output: str | None = None) -> ClosedKinematics:
    """Return the kinematics of an output, which must have a closed form.

    A closed form computes all configurations at a pose of the output directly, without a
    search that needs a start.

    Parameters
    ----------
    mechanism, output
        The mechanism, and the name of its output if there are several.

    Raises
    ------
    ModelError, PlanError
        If the output is unknown, or if its pose cannot be prescribed freely.
    SolveError
        If the mechanism has no closed form.
    """
    inverse = InverseKinematics(mechanism, output)
    if inverse.has_closed_form:  # the mechanism consists of dyads
        return DyadKinematics(inverse)
    return _find_special_form(inverse)


def _find_special_form(inverse: InverseKinematics) -> ClosedKinematics:
    """Return the closed form of an output in a mechanism of a special kind.

    `output_kinematics` takes the position solver instead if there is no closed form.

    Two special kinds of mechanisms are tried in this order:

    1. Mechanisms in which wheels drive dyads (groups of two links and three revolute
       joints).
    2. Mechanisms in which base and output link are mirror images of each other about a
       plane (mid-plane symmetric architecture).

    Raises
    ------
    SolveError
        If the mechanism is of neither kind. The message says why the second kind does not
        apply.
    """
    # The mechanism of the user, without virtual links that hold the output.
    mechanism = inverse.own
    output = inverse.wrist.output
    # The closed form, or None if the mechanism is not of the first kind.
    geared = geared_kinematics(mechanism, output)
    if geared is not None:
        return geared
    try:
        form = mid_plane_form(mechanism, output.name)
    except ModelError as problem:
        raise inverse.no_closed_form(
            f"a closed form needs dyads only or mid-plane symmetry, but {problem}"
        ) from None
    return MidPlaneKinematics(mechanism, output, form)


class GraphKinematics(OutputKinematics):
    """An output whose poses are solved row by row, by the position solver.

    This works for mechanisms without a closed form. The output is fixed in a pose, and the
    links are placed group by group, in the order that the graph of links and pairs (joints)
    gives.

    Parameters
    ----------
    inverse
        Inverse kinematics of the output.
    """

    def __init__(self, inverse: InverseKinematics) -> None:
        """Keep the inverse kinematics, and find out whether there is a mid-plane."""
        super().__init__(inverse.own, inverse.wrist.output, inverse.wrist.points)
        self.kinematics = inverse
        self.modes = inverse.modes
        self.legs = inverse.legs
        try:
            self.form = mid_plane_form(self.mechanism, self.output.name)
        except ModelError:
            self.form = None

    def inverse(
        self, poses: Floats, modes: Sequence[str], pairs: Sequence[int] = ()
    ) -> InverseRows:
        """Return the inputs and measures of every configuration at some poses, in rows.

        A row is one configuration at one pose. A configuration beyond a joint limit has the
        status OUT_OF_REACH. A pose without a configuration has one row with this status.

        Parameters
        ----------
        poses
            (n, 3) directions at which the output points if there are two inputs, or
            (n, 3, 3) rotations if there are three.
        modes
            Labels of the working modes (ways to assemble the mechanism at a pose) that are
            returned.
        pairs
            Numbers of the pairs whose variables are returned.
        """
        solutions = self.kinematics.solutions(poses)
        # The last label, "", is for poses without a solution.
        labels = np.array([*map(label_of, solutions.signs), ""])
        chosen = np.flatnonzero(np.isin(labels[:-1], modes))
        unsolved_poses = np.setdiff1d(np.arange(len(poses)), solutions.row[chosen])
        # Number of the solution of each row; the index -1 selects the empty row that is
        # appended below.
        solution = np.append(chosen, np.full(len(unsolved_poses), -1))
        is_solved = solution >= 0

        def select(array: Floats) -> Floats:
            """Return the rows of an array (solutions, ...), NaN for unsolved poses."""
            return np.concatenate([array, nans((1, *array.shape[1:]))])[solution]

        values = select(solutions.values)
        # `turns` returns the angular velocity of the output per unit rate of each input.
        output_rates = nans((len(values), 3, len(self.mechanism.inputs)))
        output_rates[is_solved] = self.turns(values[is_solved])
        # If poses are directions (`points`), only the angular velocity at right angles to
        # them counts.
        directions = None
        if self.points and solutions.directions is not None:
            directions = select(solutions.directions)
        input_rates = invert_jacobian(output_rates, directions)
        # The number of the first variable of each pair asked for.
        variables = [self.mechanism.variable_owners.index(pair) for pair in pairs]
        # The margin is the angle to the nearest joint limit. The reach of the legs is not
        # known here. Without joint limits the margin is unknown (NaN), and the number of
        # the limit is -1.
        limits, joint_margins = measure_joint_margins(self.mechanism, values)
        margin = nans(len(values))
        limiting = np.full(len(values), -1)
        if limits:
            margin = np.min(joint_margins, axis=1)
            limiting = np.where(np.isnan(margin), -1, np.argmin(joint_margins, axis=1))
        rows = InverseRows(
            pose=np.append(solutions.row[chosen], unsolved_poses),
            mode=labels[solution],
            inputs=select(solutions.inputs),
            status=np.zeros(len(solution), dtype=np.int8),
            # A negative margin makes `with_status` set the status OUT_OF_REACH.
            margin=np.where(is_solved, margin, -np.inf),
            limiting=limiting,
            # Measures that are 0 where an input moves and the output rests (type I), and
            # where the output can move with the inputs locked (type II).
            type_1=input_rates.type_1,
            type_2=self.type_2(values),
            rates=input_rates.rates,
            values=values[:, variables],
            limits=limits,
        )
        # `concatenate` sorts the rows by pose.
        return InverseRows.concatenate([rows.with_status()])
