"""Loads as expressions of the generalised forces that they exert on the coordinates.

`spherekit.mechanism.load_kinds` explains the loads. Coordinates are the inputs in the
homogeneous form of `spherekit.velocities.coordinate_rates`: their generalised forces are
powers per unit of the homogeneous rates.

If an expression has a kink or a jump, it asks for the sign of a condition. The integration
of a motion changes such signs exactly where the condition passes through zero.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import hypot
from operator import add

import numpy as np

from spherekit.conventions import TURN
from spherekit.mechanism.load import Load, LoadComponent, TorqueTable, require_expression
from spherekit.mechanism.load_expression import Expression
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.sizes import Vector
from spherekit.symbolic.expression_graph import Expr, dot
from spherekit.symbolic.parsed_expressions import convert_to_graph
from spherekit.symbolic.vector_algebra import Exprs, constants, cross, vector
from spherekit.velocities.pose_expressions import LinkOrientation


@dataclass(frozen=True)
class LoadState:
    """The state of a moving mechanism on which loads depend, as expressions.

    Homogeneous rates are those per unit rate of one coordinate, times the determinant of
    the velocity equations.

    Attributes
    ----------
    mechanism
        The mechanism with its pairs and links.
    placed
        Orientations of all links.
    tau
        For each coordinate the homogeneous rates of all variables.
    w
        For each coordinate the homogeneous angular velocities (3,) of all links, in ground
        axes.
    variables
        All variables (rad), reduced by whole revolutions.
    revolutions
        Number of whole revolutions by which each variable is reduced.
    rates
        Time derivatives of all variables (rad/s).
    time
        The time (s).
    sign_of_condition
        Returns +1 if an expression is positive, and -1 if it is negative.
    table_torque
        Returns the present torque (N m) of the torque table with a given name.
    """

    mechanism: Mechanism
    placed: Sequence[LinkOrientation]
    tau: Sequence[Sequence[Expr]]
    w: Sequence[Sequence[Exprs]]
    variables: Sequence[Expr]
    revolutions: Sequence[Expr]
    rates: Sequence[Expr]
    time: Expr
    sign_of_condition: Callable[[Expr], Expr]
    table_torque: Callable[[str], Expr]

    def named_value(self, name: str) -> tuple[Expr, Expr]:
        """Return the value of a name in the expression of a load, in two forms.

        Parameters
        ----------
        name
            "t" (time), "theta_PAIR" (angle of a pair) or "dtheta_PAIR" (rate of this
            angle).

        Returns
        -------
        The full value, and the value without whole revolutions. A time or a rate has no
        revolutions, so both values are the same. Sines are computed from the second value,
        which is more accurate after many revolutions.
        """
        kind, _, pair = name.partition("_")
        if kind == "t":
            return self.time, self.time
        variable = self.mechanism.angles[pair]
        if kind == "theta":
            reduced_angle = self.variables[variable]
            return reduced_angle + TURN * self.revolutions[variable], reduced_angle
        return self.rates[variable], self.rates[variable]


def generalised_forces(load: Load, load_state: LoadState) -> list[Expr]:
    """Return the generalised forces of a load at the inputs, multiplied by a determinant.

    There is one force for each coordinate, an input of the mechanism: the power of the
    load while this input moves at the rate 1 and the others rest, times the determinant
    of the velocity equations. The force follows from rates that contain this factor
    (homogeneous rates), without a division by the determinant, which can vanish.
    """
    return component_forces(load.components(load_state.mechanism), load_state)


def component_forces(
    components: Sequence[LoadComponent], load_state: LoadState
) -> list[Expr]:
    """Return the generalised forces of load components, one for each input.

    A generalised force is the power of a load per unit rate of an input. The velocities in
    `load_state` are multiplied by the determinant of the velocity equations, to avoid
    divisions. The results are therefore the generalised forces times the determinant.

    A component of a load has a magnitude. It acts on the variable of a pair (joint), or on
    links. Its actions on links are listed in `moments`. Each of them is a moment, or a
    force that acts at the point `arm` of the link. For a moment `arm` is None. The moment
    or force is the magnitude times the vector `direction`, in ground or link axes (`axes`).
    This function replaces each force by its moment about the centre of the sphere, because
    links rotate about the centre.

    Parameters
    ----------
    components
        Components of one or more loads.
    load_state
        Positions and velocities of the mechanism. For each input, `tau` has the rates of
        all variables and `w` the angular velocities of all links, times the determinant.
    """
    forces: list[Expr] = [0.0] * len(load_state.tau)
    # Moments on one link in the same axes are added, and so are forces at the same point,
    # so that the power of each sum is computed once.
    moment_sums: dict[tuple[str, str, Vector | None], Exprs] = {}
    for component in components:
        law = component.magnitude
        if isinstance(law, TorqueTable):
            magnitude = load_state.table_torque(law.name)
        else:
            magnitude = expression_value(require_expression(law), load_state)
        if component.pair:
            variable = load_state.mechanism.angles[component.pair]
            powers = (magnitude * tau[variable] for tau in load_state.tau)
            forces = [*map(add, forces, powers)]
        for moment in component.moments:
            key = (moment.link, moment.axes, moment.arm)
            scaled = vector([magnitude * part for part in moment.direction])
            moment_sums[key] = moment_sums[key] + scaled if key in moment_sums else scaled
    # The power of a moment about the centre is its scalar product with the angular velocity
    # of the link.
    for (link, axes, arm), components_sum in moment_sums.items():
        number = load_state.mechanism.link_number[link]
        # Neither loads on the ground (link 0) nor forces at the centre do work.
        is_force_at_centre = arm is not None and not any(arm)
        if number and not is_force_at_centre:
            orientation = load_state.placed[number]
            # The moment in ground axes. The moment of a force is the cross product of arm
            # and force.
            moment_vector = _ground_moment(orientation, axes, arm, components_sum)
            powers = (dot(w[number], moment_vector) for w in load_state.w)
            forces = [*map(add, forces, powers)]
    return forces


def steep_arguments(load: Load, load_state: LoadState) -> list[Expr]:
    """Return the arguments of smooth but steep functions in the expressions of a load.

    An example is the argument of a hyperbolic tangent that smooths friction. An integrator
    compares its steps with the loads at zeros and extrema of these arguments. Arguments of
    functions with kinks or jumps are left out, because integration steps end at kinks and
    jumps anyway.
    """
    arguments: list[Expr] = []
    for component in load.components(load_state.mechanism):
        if isinstance(component.magnitude, Expression):
            for argument in component.magnitude.smooth_steep_arguments:
                arguments.append(expression_value(argument, load_state))
    return arguments


def _ground_moment(
    orientation: LinkOrientation, axes: str, arm: Vector | None, components: Exprs
) -> Exprs:
    """Return the moment (3,) of a load on a link about the centre, in ground axes.

    The moment of a force is the cross product of its arm and the force.

    Parameters
    ----------
    orientation
        Orientation of the link.
    axes
        Axes of `components`: "ground" for ground axes, otherwise link axes.
    arm
        (3,) point of the link, in link axes, at which a force acts (m). None for a moment.
    components
        (3,) the force or the moment.
    """
    # Link axes rotate to ground axes by the product of `basis` (expressions of the
    # variables) and `basis_from_link` (constant).
    if axes != "ground":
        # Arm and components are in link axes, and the result is rotated to ground axes.
        moment = components if arm is None else cross(vector(list(arm)), components)
        return orientation.basis @ (constants(orientation.basis_from_link) @ moment)
    if arm is None:
        return components
    # The components are in ground axes, so `direction` rotates the arm to ground axes. The
    # arm contains expressions if its sizes vary between designs.
    if not all(isinstance(entry, float) for entry in arm):
        return cross(orientation.direction(vector(list(arm))), components)
    # An arm of numbers is divided by its length first. `direction` replaces numbers that
    # are 0 or 1 up to rounding by exact values, which shortens products. A tiny arm
    # itself would become 0. `hypot` avoids the squares of tiny components, which could
    # underflow.
    length = hypot(*arm)
    return cross(orientation.direction(np.array(arm) / length) * length, components)


def expression_value(law: Expression, load_state: LoadState) -> Expr:
    """Return the expression of a load, such as a torque, as a function of the motion.

    Parameters
    ----------
    law
        The parsed expression.
    load_state
        The moving mechanism.
    """
    values = {name: load_state.named_value(name) for name in law.names}
    return convert_to_graph(law, values, load_state.sign_of_condition)
