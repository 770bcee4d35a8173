"""Generalised forces of the loads on a mechanism, load by load, at rows of a motion.

A load consists of components. Each has a magnitude, given by an expression, a function or a
table, and works on the rate of a pair or on the angular velocities of links. The kinds of
loads are in `spherekit.mechanism.load_kinds`; the same loads as symbolic expressions are in
`spherekit.velocities.load_expressions`.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Floats
from spherekit.dynamics.coordinates import CoordinateMotion
from spherekit.geometry.vectors import cross
from spherekit.mechanism.friction import sliding_rate_name
from spherekit.mechanism.load import LoadComponent, TorqueCallback, TorqueTable
from spherekit.mechanism.load_dependence import find_steep_arguments
from spherekit.mechanism.load_expression import Expression
from spherekit.mechanism.mechanism import Mechanism


@dataclass(frozen=True)
class UnitWrench:
    """Moment and force on a link by a load component of magnitude 1, in ground axes.

    A load component is a part of a load with one magnitude and one direction. A vector has
    the shape (n, 3) for n configurations, or (3,) if it is the same in all.

    Attributes
    ----------
    link
        Number of the link.
    moment
        Moment about the centre of the sphere per unit of the magnitude, including the
        moment of the force.
    force
        Force per unit of the magnitude; 0 if the component is a couple.
    """

    link: int
    moment: Floats
    force: Floats


class Loads:
    """The loads of a mechanism, ready to be evaluated at any configurations.

    A load consists of components, which each have a magnitude (N m or N) and a direction. A
    component acts at a pair, or on links.

    Attributes
    ----------
    names
        Names of the loads.
    components
        Components of all loads, one load after the other.
    load_of_component
        Index of the load that each component belongs to.
    steep_arguments
        Arguments at whose zeros and extrema loads may change abruptly, see
        `spherekit.mechanism.load_dependence.find_steep_arguments`.
    friction_components
        Indices of the components whose friction follows from reactions.
    friction_coefficients
        (k,) friction (N m) of each of these components per unit of the load that the pair
        carries. This load is a force (N) on a bearing or a moment (N m) at a contact.
    needs_step_probes
        Whether loads may change abruptly within an integration step: they have steep
        arguments, or are arbitrary Python functions.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        """List the components of all loads, and find which of them are friction.

        A component is a part of a load: a magnitude that depends on the motion, and the
        pair (joint) or the links on which it acts. A force on a link has three components,
        for example. Components of one load follow one another in all lists.
        """
        self.mechanism = mechanism
        self.names = tuple(load.name for load in mechanism.loads)
        components: list[LoadComponent] = []
        self.load_of_component: list[int] = []
        for load_index, load in enumerate(mechanism.loads):
            load_components = load.components(mechanism)
            components += load_components
            self.load_of_component += [load_index] * len(load_components)
        self.components = tuple(components)
        # Indices of the components whose friction is a coefficient times the load of a
        # bearing or contact, and these coefficients.
        self.friction_components: list[int] = []
        coefficients: list[float] = []
        for index, component in enumerate(self.components):
            friction = component.bearing_friction
            if friction is not None and friction.friction_coefficient > 0.0:
                self.friction_components.append(index)
                coefficients.append(friction.friction_coefficient)
        self.friction_coefficients = np.array(coefficients)
        # Arguments of steep functions in loads, such as x in tanh(1000 x). The load changes
        # abruptly where x passes through zero.
        self.steep_arguments = find_steep_arguments(mechanism)
        has_python_functions = any(
            isinstance(component.magnitude, TorqueCallback) for component in self.components
        )
        # Steep functions and arbitrary Python functions can change between the times at
        # which an integration step evaluates them. Steps are then tested at more times.
        self.needs_step_probes = bool(self.steep_arguments) or has_python_functions
        # Index of the first component of each load. Every load has at least one.
        self._first_components = np.unique(self.load_of_component, return_index=True)[1]

    def velocities(self, motion: CoordinateMotion) -> Floats:
        """Return the velocities on which the components of all loads do work.

        Generalised forces are computed from them. A component of a load, such as one
        component of a force on a link, does work on the rate of a pair (joint) or on the
        angular velocities of links.

        Returns
        -------
        (n, m, components) velocity per unit rate of each of m coordinates, at n rows.
        The power of a component is its magnitude times this velocity times the rate.
        """
        velocities = np.zeros((*motion.rates.shape[:2], len(self.components)))
        for index, component in enumerate(self.components):
            if component.pair:
                velocities[..., index] = self._pair_rate(motion.rates, component.pair)
            # The method yields nothing for a component that acts at a pair.
            for wrench in self.unit_wrenches(component, motion.rotations):
                # All links rotate about the centre, so a force on a link does work only by
                # its moment about the centre.
                work = motion.w[:, :, wrench.link] @ wrench.moment[..., None]
                velocities[..., index] += work[..., 0]
        return velocities

    def unit_wrenches(
        self, component: LoadComponent, rotations: Floats
    ) -> Iterator[UnitWrench]:
        """Yield the moments and forces on links by a load component of magnitude 1.

        A load component is a part of a load with one magnitude and one direction. Moments
        are about the centre of the sphere. Both vectors are in ground axes: (n, 3) if they
        turn with a link, or (3,) if they are the same in all n rows (configurations). A
        component that acts at a pair (joint) yields nothing.

        Parameters
        ----------
        component
            A component of a load.
        rotations
            (n, links, 3, 3) rotations from link axes to ground axes.
        """
        for link_moment in component.moments:
            link = self.mechanism.link_number[link_moment.link]
            rotation = rotations[:, link]
            # The direction is given in link axes or in ground axes.
            direction = np.array(link_moment.direction)
            if link_moment.axes == "link":
                direction = rotation @ direction
            # Without an arm the component is a couple. With an arm it is a force at a point
            # of the link. The arm is the vector from the centre to this point, always in
            # link axes.
            if link_moment.arm is None:
                yield UnitWrench(link, moment=direction, force=0.0 * direction)
            else:
                moment = cross(rotation @ link_moment.arm, direction)
                yield UnitWrench(link, moment, force=direction)

    def _pair_rate(self, rates: Floats, pair: str) -> Floats:
        """Return the rate (...) at which a pair turns (R pair) or slides (contact).

        `rates` (..., variables) are the rates of all variables. The variables of a contact
        are arcs along its two profiles, and it slides at the difference of their rates.
        """
        # An R pair has only one variable, so `second` is empty.
        first, *second = self.mechanism.variables_of(self.mechanism.pair_number[pair])
        return rates[..., first] - np.sum(rates[..., second], axis=-1)

    def evaluate_magnitudes(
        self, motion: CoordinateMotion, speed: Floats, t: Floats, carried: Floats | None
    ) -> Floats:
        """Return the magnitude of each component of each load.

        Magnitudes follow laws (expressions, functions or tables). Friction of a bearing or
        contact is its law, times the coefficient of friction, times the load that the
        bearing or contact carries.

        Parameters
        ----------
        motion
            Configurations in n rows, and their derivatives with respect to m coordinates.
        speed
            (n, m) time derivatives of these coordinates.
        t
            (n,) times, s.
        carried
            (n, k) load carried by the bearing or contact of each of the k components in
            `friction_components`: a force (N) on a bearing, a moment (N m) at a contact.
            None: friction is left out.

        Returns
        -------
        (n, components) N m for moments and torques, N for forces.
        """
        laws = [component.magnitude for component in self.components]
        magnitudes = self.evaluate_laws(laws, motion, speed, t)
        loads_carried = 0.0 if carried is None else carried
        magnitudes[:, self.friction_components] *= (
            self.friction_coefficients * loads_carried
        )
        return magnitudes

    def evaluate_laws(
        self,
        laws: Sequence[Expression | TorqueCallback | TorqueTable],
        motion: CoordinateMotion,
        speed: Floats,
        t: Floats,
    ) -> Floats:
        """Return the values (n, laws) of laws, which give the magnitudes of loads.

        A load consists of components, for example the three components of a force. Each has
        a magnitude. A law is the expression, Python function or table from which the
        magnitude follows. For friction of a bearing or contact, the value of the law still
        has to be multiplied by the coefficient of friction and the carried load.

        Parameters
        ----------
        laws
            Laws of components, or other expressions of the same variables, such as
            `steep_arguments`.
        motion
            Configurations in n rows, and their derivatives with respect to m coordinates.
        speed
            (n, m) time derivatives of these coordinates.
        t
            (n,) times, s.
        """
        # Laws can depend on the time, the angles and rates of R pairs (revolute joints),
        # and the sliding rates of contacts with friction.
        values_by_name = {"t": t}
        variable_of_pair = self.mechanism.angles
        rates = rates_by_time(motion, speed)
        for pair, variable in variable_of_pair.items():
            values_by_name[f"theta_{pair}"] = motion.values[:, variable]
            values_by_name[f"dtheta_{pair}"] = rates[:, variable]
        for index in self.friction_components:
            pair = self.components[index].pair
            if pair not in variable_of_pair:
                values_by_name[sliding_rate_name(pair)] = self._pair_rate(rates, pair)
        results = np.empty((len(t), len(laws)))
        for column, law in enumerate(laws):
            if isinstance(law, TorqueTable):
                results[:, column] = law.at(t)
            else:
                arguments = {name: values_by_name[name] for name in law.names}
                results[:, column] = law.evaluate(arguments)
        return results

    def evaluate_forces(
        self,
        motion: CoordinateMotion,
        speed: Floats,
        t: Floats,
        carried: Floats | None = None,
    ) -> Floats:
        """Return the generalised forces (n, m, loads) of all loads, N m.

        A generalised force is the power of the load per unit rate of one coordinate. A load
        is the sum of its components, such as the three components of a force.

        Parameters
        ----------
        motion
            Configurations in n rows, and their derivatives with respect to m coordinates.
        speed
            (n, m) time derivatives of these coordinates.
        t
            (n,) times, s.
        carried
            (n, k) reactions that cause friction, for the k components in
            `friction_components`. For a bearing this is a force (N), for a contact the
            moment (N m) of its normal force about the centre of the sphere. None: friction
            is left out.
        """
        # (n, components) N m or N.
        magnitudes = self.evaluate_magnitudes(motion, speed, t, carried)
        # (n, m, components) velocities on which the components do work, such as the rate of
        # a pair, per unit rate of each coordinate.
        velocities = self.velocities(motion)
        # (n, m, components) power of each component per unit rate of each coordinate.
        component_forces = magnitudes[:, None] * velocities
        # The components of each load follow one another. Add them, load by load.
        return np.add.reduceat(component_forces, self._first_components, axis=2)


def rates_by_time(motion: CoordinateMotion, speed: Floats) -> Floats:
    """Return the time derivatives (n, variables) of all pair variables.

    `speed` (n, m) are the time derivatives of the m coordinates, and `motion` has the
    derivatives of the pair variables with respect to these coordinates.
    """
    return (speed[:, None] @ motion.rates)[:, 0]
