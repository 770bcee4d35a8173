"""Loads as expressions of the generalised forces that they exert on the coordinates.

`spherekit.mechanism.load_kinds` explains the loads. Coordinates are the inputs in the
homogeneous form of `spherekit.velocities.coordinate_rates`: their generalised forces are
powers per unit of the homogeneous rates.

If an expression has a kink or a jump, it asks for the sign of a condition. The integration
of a motion changes such signs exactly where the condition passes through zero.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
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
        Rates of all variables by time (rad/s).
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
        """Return the value of a name in the expression of a load, and its reduced value.

        Parameters
        ----------
        name
            "t", "theta_PAIR" or "dtheta_PAIR".

        Returns
        -------
        The full value, and the value reduced by whole revolutions. They differ for angles
        only. Sines of the reduced value keep their digits after many revolutions.
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
    """Return the generalised forces of a load, multiplied by a determinant.

    There is one for each coordinate, an input of the mechanism: the power of the load while
    this input moves at the rate 1 and the others rest, times the determinant of the
    velocity equations. It follows from rates that contain this factor, the homogeneous
    rates, without a division by the determinant, which can vanish.
    """
    return component_forces(load.components(load_state.mechanism), load_state)


def component_forces(
    components: Sequence[LoadComponent], load_state: LoadState
) -> list[Expr]:
    """Return the generalised forces of load components, one for each coordinate.

    A generalised force is the power per unit rate of a coordinate. The coordinates are the
    inputs. Velocities per unit rate of an input are quotients of a homogeneous rate and the
    determinant of the velocity equations. Here the homogeneous rates are used, which have
    no division. The results are therefore the generalised forces times the determinant.

    A component of a load has a magnitude. It acts on the variable of a pair, or on links.
    The list `moments` has its actions on links, each a moment or a force. A force has an
    `arm`: the point at which it acts. Its moment about the centre is the cross product of
    the arm and the force. For a moment `arm` is None. The vector `direction` has components
    along ground or link axes (`axes`).

    Parameters
    ----------
    components
        Components of one load or of several.
    load_state
        Positions and velocities of the mechanism as expressions: for each input the
        homogeneous rates of all variables (`tau`) and angular velocities of all links
        (`w`), and the orientations of all links (`placed`).
    """
    forces: list[Expr] = [0.0] * len(load_state.tau)
    # Moments on one link in the same axes, and forces at the same point, are added.
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
    # The power of a moment is its scalar product with the angular velocity of the link.
    for (link, axes, arm), components_sum in moment_sums.items():
        number = load_state.mechanism.link_number[link]
        # Neither loads on the ground (link 0) nor forces at the centre do work.
        is_force_at_centre = arm is not None and not any(arm)
        if number and not is_force_at_centre:
            orientation = load_state.placed[number]
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

    Parameters
    ----------
    orientation
        Orientation of the link.
    axes
        Axes along which `components` are given: ground axes for "ground", otherwise link
        axes.
    arm
        (3,) the point of the link, in link axes, at which a force acts (m). None for a
        moment.
    components
        (3,) the force or the moment.
    """
    # The moment of a force is the cross product of its arm and the force. The rotation from
    # link axes to ground axes is the product of `basis` (expressions of the variables) and
    # `basis_from_link` (constant).
    if axes != "ground":
        # Arm and components are in link axes. Their product is rotated.
        moment = components if arm is None else cross(vector(list(arm)), components)
        return orientation.basis @ (constants(orientation.basis_from_link) @ moment)
    if arm is None:
        return components
    # The components are in ground axes, so the arm is rotated (`direction`). If a size of
    # the arm varies, its entries are expressions instead of numbers.
    if not all(isinstance(entry, float) for entry in arm):
        return cross(orientation.direction(vector(list(arm))), components)
    # Components of the rotated arm that are 0 or 1 up to rounding become exactly 0 or 1 in
    # the method `direction`, so that products with them are left out. This only makes sense
    # for a unit vector, so the arm is divided by its length before, and multiplied after.
    length = float(np.linalg.norm(arm))
    return cross(orientation.direction(np.array(arm) / length) * length, components)


def expression_value(law: Expression, load_state: LoadState) -> Expr:
    """Return the value of the expression of a load.

    Parameters
    ----------
    law
        The parsed expression.
    load_state
        The moving mechanism.
    """
    values = {name: load_state.named_value(name) for name in law.names}
    return convert_to_graph(law, values, load_state.sign_of_condition)
