"""Loads and joint limits of a mechanism as MuJoCo states them."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from spherekit.arrays import Floats
from spherekit.errors import EngineError
from spherekit.geometry.vectors import all_finite
from spherekit.mechanism.load import LoadComponent, TorqueCallback, TorqueTable
from spherekit.mechanism.load_expression import Expression
from spherekit.mechanism.load_kinds import (
    Damper,
    Friction,
    Gravity,
    Moment,
    PairTorque,
    PointForce,
    Spring,
)
from spherekit.mechanism.mechanism import Mechanism
from spherekit.symbolic.expression_derivatives import differentiate
from spherekit.symbolic.expression_evaluation import array_function
from spherekit.symbolic.expression_graph import has_variables, iterate_nodes, symbols
from spherekit.symbolic.parsed_expressions import convert_to_graph

Attributes = dict[str, Any]
"""Attributes of an element of MJCF: texts, numbers, or arrays of numbers."""

ActuatorLoad = PairTorque | PointForce | Moment
"""A load that an actuator without control can exert."""


@dataclass(frozen=True)
class MujocoLoads:
    """The loads and joint limits of a mechanism, in the form in which MuJoCo states them.

    Attributes
    ----------
    gravity
        (3,) acceleration (m/s2) in ground axes.
    hinge_attributes
        Springs, dampers, dry friction and limits as attributes of joints, by name of the
        pair (joint). Pairs without any of these are missing.
    actuator_loads
        Other loads, each with the attributes of the actuator (drive) that exerts it in
        MuJoCo. An actuator without a control signal can exert a torque b0 + b1 angle + b2
        rate at a pair, with constants b. It can also exert a constant force or moment on a
        link, at a site (marked point of a body). The names of sites are chosen later. Until
        then, the attributes have the name of the load in place of the name of a site.
    reason_by_omitted_load
        For each load that MuJoCo cannot express, by name, the reason.
    approximations
        Sentences on loads that MuJoCo has in another form.
    """

    gravity: Floats
    hinge_attributes: dict[str, Attributes]
    actuator_loads: list[tuple[ActuatorLoad, Attributes]]
    reason_by_omitted_load: dict[str, str]
    approximations: list[str]

    @property
    def loaded_pairs(self) -> list[str]:
        """Pairs (joints) at which a load or a limit acts.

        The export can replace a pair that closes a loop by a constraint of MuJoCo. No
        torque can act at a constraint, so the pairs returned here have to become joints.
        """
        torque_pairs = [
            load.pair for load, _ in self.actuator_loads if isinstance(load, PairTorque)
        ]
        return [*self.hinge_attributes, *torque_pairs]


@dataclass
class JointSums:
    """Sums of the springs, dampers and dry friction at one pair (joint).

    A joint of MuJoCo can have only one spring, one damper and one dry friction.

    Attributes
    ----------
    stiffness
        Stiffness (N m/rad).
    damping
        Damping constant (N m s/rad).
    dry_friction
        Torque of dry friction (N m).
    weighted_rest
        Sum of stiffness times rest angle (N m) over the springs. Divided by the stiffness,
        this sum is the rest angle of one spring that replaces all springs.
    """

    stiffness: float = 0.0
    damping: float = 0.0
    dry_friction: float = 0.0
    weighted_rest: float = 0.0


def convert_loads(mechanism: Mechanism) -> MujocoLoads:
    """Return the loads and joint limits of a mechanism in the form that MuJoCo has.

    Springs, dampers and dry friction at one pair (joint) are added up, since a joint of
    MuJoCo has only one spring, one damper and one dry friction. Other loads become
    actuators without control if they are constant, or linear in the angle and rate of their
    pair. All others are left out, with a reason.
    """
    gravity = np.zeros(3)
    sums_by_pair = {pair: JointSums() for pair in mechanism.angles}
    actuator_loads: list[tuple[ActuatorLoad, Attributes]] = []
    reason_by_omitted_load: dict[str, str] = {}
    approximations: list[str] = []
    for load in mechanism.loads:
        if isinstance(load, Gravity):
            gravity = gravity + load.acceleration
        elif isinstance(load, Spring):
            sums_by_pair[load.pair].stiffness += load.stiffness
            sums_by_pair[load.pair].weighted_rest += load.stiffness * load.rest
        elif isinstance(load, Damper):
            sums_by_pair[load.pair].damping += load.damping
        elif isinstance(load, Friction):
            sums_by_pair[load.pair].dry_friction += load.torque
            sums_by_pair[load.pair].damping += load.viscous
            approximations.append(
                f"load {load.name}: MuJoCo's dry friction jumps at rest, where the "
                f"file smooths it below {load.speed:g} rad/s"
            )
        elif isinstance(load, PairTorque | PointForce | Moment):
            try:
                actuator_loads.append((load, _actuator_attributes(mechanism, load)))
            except EngineError as error:
                reason_by_omitted_load[load.name] = str(error)
        elif isinstance(load, TorqueTable):
            reason_by_omitted_load[load.name] = "MuJoCo has no tables in time"
        else:
            reason_by_omitted_load[load.name] = f"MuJoCo has no load of kind {load.kind}"

    range_by_pair = {
        joint_limit.pair: (joint_limit.low, joint_limit.high)
        for joint_limit in mechanism.joint_limits
    }
    hinge_attributes: dict[str, Attributes] = {}
    for pair, sums in sums_by_pair.items():
        attributes = {
            "stiffness": sums.stiffness,
            "damping": sums.damping,
            "frictionloss": sums.dry_friction,
            # The rest angle of several springs together.
            "springref": sums.weighted_rest / (sums.stiffness or 1.0),
            "range": range_by_pair.get(pair),
        }
        # Attributes that are zero (or None) are MuJoCo's defaults.
        stated_attributes = {key: value for key, value in attributes.items() if value}
        if stated_attributes:
            hinge_attributes[pair] = stated_attributes
    return MujocoLoads(
        gravity=gravity,
        hinge_attributes=hinge_attributes,
        actuator_loads=actuator_loads,
        reason_by_omitted_load=reason_by_omitted_load,
        approximations=approximations,
    )


def _actuator_attributes(mechanism: Mechanism, load: ActuatorLoad) -> Attributes:
    """Return a load as the attributes of an actuator of MuJoCo.

    The attributes of MuJoCo have these meanings:

    - ``joint``: the pair (joint) at which a torque acts;
    - ``site``: the point of a link at which a force or moment acts;
    - ``refsite``: the site in whose axes the vector of a force or moment is stated, a site
      of the ground. Without ``refsite`` the axes of ``site`` are used;
    - ``gear``: (6,) the vector of the force, then the vector of the moment. The name is
      MuJoCo's;
    - ``biasprm``: three numbers b. MuJoCo multiplies ``gear`` by the magnitude
      b[0] + b[1] length + b[2] rate. At a joint the length is its angle.

    The names of sites are chosen later. Until then, ``site`` and ``refsite`` have the name
    of the load in place of the name of a site.

    Parameters
    ----------
    load
        A torque at a pair, or a force or moment on a link.

    Raises
    ------
    EngineError
        If a torque at a pair is no affine function of the pair's variable and rate, or if
        a force or moment is not constant.
    """
    if isinstance(load, PairTorque):
        (component,) = load.components(mechanism)
        return {"joint": load.pair, "biasprm": _find_torque_factors(component, load.pair)}
    components = load.components(mechanism)
    # The load has one component for each coordinate of its vector.
    vector = [_find_constant(component) for component in components]
    zeros = [0.0] * 3
    gear = [*vector, *zeros] if isinstance(load, PointForce) else [*zeros, *vector]
    attributes: Attributes = {"site": load.name}
    if load.axes == "ground":
        attributes["refsite"] = load.name
    attributes["gear"] = gear
    attributes["biasprm"] = (1.0, 0.0, 0.0)
    return attributes


def _find_constant(component: LoadComponent) -> float:
    """Return the constant magnitude of a component of a load.

    Raises
    ------
    EngineError
        If the magnitude depends on the motion or the time, or is not finite.
    """
    law = _require_motion_law(component, allowed_names=())
    (constant,) = _require_affine_factors(law, variable_names=())
    return constant


def _find_torque_factors(component: LoadComponent, pair: str) -> Floats:
    """Return the factors of a torque c0 + c1 theta + c2 dtheta at a pair.

    They become the parameter `biasprm` of a MuJoCo actuator that exerts the torque.

    Parameters
    ----------
    component
        The torque as a function of variables of the mechanism.
    pair
        The R pair (hinge) at which the torque acts. Its variable is theta (rad).

    Returns
    -------
    (3,) the torque c0 (N m), the factor c1 of the variable (N m/rad), and the factor c2 of
    its rate (N m s/rad).

    Raises
    ------
    EngineError
        If the torque is a function of another form. MuJoCo cannot express it.
    """
    variable_names = (f"theta_{pair}", f"dtheta_{pair}")
    law = _require_motion_law(component, variable_names)
    return _require_affine_factors(law, variable_names)


def _require_motion_law(
    component: LoadComponent, allowed_names: Sequence[str]
) -> Expression:
    """Return the magnitude of a load as an expression that has only allowed variables.

    Loads that MuJoCo cannot express are refused.

    Parameters
    ----------
    component
        One component of the load, such as a coordinate of a force.
    allowed_names
        Names of the variables and rates that the magnitude may contain.

    Raises
    ------
    EngineError
        If the magnitude is a Python function, or depends on the time or other variables.
    """
    law = component.magnitude
    # The type of `magnitude` also allows a `TorqueTable`, which never occurs here. The
    # condition names it only for the type checker.
    if isinstance(law, TorqueCallback | TorqueTable):
        raise EngineError("it is a Python function")
    if "t" in law.names:
        raise EngineError(f"MuJoCo has no loads that change in time: {law.text}")
    if not law.names <= set(allowed_names):
        raise EngineError(f"it depends on other pairs: {law.text}")
    return law


def _require_affine_factors(law: Expression, variable_names: Sequence[str]) -> Floats:
    """Return the factors of an affine function c0 + c1 x1 + c2 x2 + ...

    MuJoCo cannot express a load that is another function of the variables.

    Parameters
    ----------
    law
        The function. Its only variables are x1, x2, ...
    variable_names
        Names of the variables x1, x2, ...

    Returns
    -------
    (1 + variables,) the constant c0, then the factor of each variable.

    Raises
    ------
    EngineError
        If the function is not affine, or a factor is not finite.
    """
    factors = None
    # If the function divides by zero, for example, `factors` stays None.
    with suppress(EngineError), np.errstate(all="ignore"):
        factors = _compute_affine_factors(law, variable_names)
    if factors is None or not all_finite(factors):
        raise EngineError(
            f"it is neither constant nor proportional to an angle or a rate: {law.text}"
        )
    return factors


def _compute_affine_factors(
    law: Expression, variable_names: Sequence[str]
) -> Floats | None:
    """Return the factors of an affine function c0 + c1 x1 + c2 x2 + ..., if it is affine.

    MuJoCo cannot express a load that is another function of the variables.

    Parameters
    ----------
    law
        The function. Its only variables are x1, x2, ...
    variable_names
        Names of the variables x1, x2, ...

    Returns
    -------
    (1 + variables,) the constant c0, then the factor of each variable. None if the function
    is not affine.
    """
    variables = symbols(variable_names)
    # `convert_to_graph` takes two symbols for each variable: the angle, and the angle
    # without whole revolutions. Both symbols are the same here.
    expression_pair_by_name = {
        name: (variable, variable)
        for name, variable in zip(variable_names, variables, strict=True)
    }
    function = convert_to_graph(law, expression_pair_by_name)
    slopes = [differentiate([function], {variable: 1.0})[0] for variable in variables]
    # The function is affine if its derivatives are constant, and it has no jump. A jump is
    # a sign of an expression with variables. Its derivative is zero and does not show it.
    jumps = [node for node in iterate_nodes([function]) if node.operation == "sign"]
    if any(map(has_variables, [*slopes, *jumps])):
        return None
    # Where all variables are zero, the function is c0. The slopes are the other factors.
    evaluate = array_function([function, *slopes], variables)
    zeros = np.zeros((len(variables), 1))
    return evaluate(zeros)[:, 0]
