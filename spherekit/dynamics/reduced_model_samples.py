"""Computes exact values of the functions that a reduced model stores.

`CurveSampler` is for one input: the configuration curve is followed once, and its
coordinate is the input variable q if the input turns fully on a closed curve without dead
centres, otherwise the arc length s. `BoxSampler` is for several inputs: the assembly mode
is computed over a coarse grid of the box of the input ranges.

Configurations between known ones are found by Newton's method, which starts from a
prediction of second order at the nearest known configuration.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.conventions import TURN, Names
from spherekit.dynamics.coordinates import (
    CoordinateMotion,
    continuous_signs,
    determinacy,
    motion_by_arc_length,
    motion_by_variables,
)
from spherekit.dynamics.generalised_forces import Loads
from spherekit.dynamics.inertia import christoffel, inertia
from spherekit.dynamics.reduced_model_functions import FunctionKind, FunctionLabel
from spherekit.dynamics.reduced_model_heading import StoredHeading, StoredLoad
from spherekit.errors import SolveError
from spherekit.files.mechanism_writer import mechanism_hash
from spherekit.geometry.vectors import all_finite, max_abs, nans
from spherekit.mechanism.load import TorqueTable
from spherekit.mechanism.load_expression import Expression
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.pole_plan import Pole, PrimaryPole
from spherekit.planning.pole_planner import plan
from spherekit.positions.angle_unwrapping import unwrap_motion
from spherekit.positions.configuration_curve import ArcCurve
from spherekit.positions.curve_continuation import follow_arc
from spherekit.positions.linearisation import Linearisation
from spherekit.positions.motion import Motion, make_motion
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.status import Status
from spherekit.tolerances import CLOSURE_TOLERANCE, EPS
from spherekit.velocities.pole_sequence import PlannedPoles
from spherekit.version import __version__

PROBED_INPUTS = 24
"""Number of input values at which a configuration of the assembly mode is searched for.

Smaller: a mode that exists in a small part of the range is missed.
"""

MIN_CRANK_RATE = 1e-3
"""Smallest rate of the input along the curve at which q can be the coordinate.

Smaller: functions of q grow steep near places where the input almost stops.
"""

CURVE_NODES = 512
"""Known configurations of a curve, between which Newton's method finds others.

Smaller: its starting points are farther apart. Larger: more memory.
"""

SENSE_SAMPLES = 2**13
"""Points of one lap of the curve at which the sense of each pole axis is stored.

Smaller: an axis that turns fast can be stored in the wrong sense.
"""

MIN_AXIS_COSINE = 0.7
"""Smallest cosine of the angle by which a pole axis may turn between two of the points at
which its sense is stored."""

AXIS_ERROR_ROUNDINGS = 8.0
"""Error of a relative angular velocity, in roundings of the largest angular velocity of any
link. Larger: axes by the plan of the poles are preferred."""

TRUSTED_AXIS_ERROR_RAD = 1e-14
"""Error bound of a pole axis below which the axis of the plan is used without comparison.

An axis with a larger bound is replaced by the direction of the relative angular velocity
if that is known better. Larger: axes are less accurate. Smaller: more comparisons.
"""

MAX_SAMPLER_NEWTON_STEP_RAD = 0.2
"""Largest change of a variable in a step of Newton's method.

Larger: it can leave the assembly mode. Smaller: it can fail where variables move fast.
"""

MAX_PREDICTION_ERROR_RAD = 0.02
"""Largest distance of a configuration from its prediction by the trapezoidal rule.

Larger: configurations of another assembly mode are accepted. Smaller: configurations of
this mode are rejected between nodes that are far apart.
"""

MIN_DETERMINACY = 0.02
"""Smallest value of `coordinates.determinacy` at which inputs may be coordinates.

Smaller: the model reaches nearer to singularities, where its functions are steep.
"""


@dataclass(frozen=True)
class ClosedConfigurations:
    """Configurations at n values of the m inputs of a mechanism, found by Newton's method.

    For each of these configurations, Newton's method starts from a node: the known
    configuration with the nearest inputs.

    Attributes
    ----------
    linearisation
        Result of Newton's method: the pair variables (joint angles), their closure
        residuals (openings of loops), and the loop-closure equations linearised there.
    nodes
        (n,) index of the node of each configuration among the known configurations,
        `Sampler.nodes`.
    steps
        (n, m) difference of the inputs from the inputs of the node, rad. A prediction over
        this step shows whether Newton's method changed the assembly mode.
    """

    linearisation: Linearisation
    nodes: Indices
    steps: Floats


def load_velocity_names(loads: Loads) -> dict[int, str]:
    """Return names for the velocities on which loads work, as a reduced model stores them.

    A load is the sum of one or several components. For example, a force can have three. The
    power of a component is its magnitude times a velocity. For a component that acts on a
    link, the model stores this velocity per unit rate of each coordinate. A component at a
    pair (joint) is left out, because its velocity is the rate of the pair variable. This
    rate follows from the derivatives of the variable, which the model stores anyway.

    Returns
    -------
    Names by the index of the component in `loads.components`. A name is the name of the
    load, followed by x, y or z if the load has several components.
    """
    names = {}
    for component_index, load_index in enumerate(loads.load_of_component):
        if loads.components[component_index].pair:
            continue
        names[component_index] = f"load {loads.names[load_index]}"
        if loads.load_of_component.count(load_index) > 1:
            first_index = loads.load_of_component.index(load_index)
            names[component_index] += f" {'xyz'[component_index - first_index]}"
    return names


class Sampler:
    """Computes the functions of a mechanism that a reduced model stores.

    These functions, such as the inertia, depend on the configuration alone. This base class
    has the common parts of `CurveSampler` (one input) and `BoxSampler` (several inputs).

    Attributes
    ----------
    nodes
        Known configurations with their derivatives with respect to the inputs, from which
        Newton's method finds others.
    driven
        Indices of the inputs among the pair variables.
    by
        Names of the coordinates of the model.
    low, high
        (m,) range of each coordinate, rad.
    rise
        Growth of each pair variable over one period of a curve, rad.
    periodic
        Whether the functions repeat along a closed curve.
    """

    nodes: CoordinateMotion
    driven: list[int]
    by: Names
    low: Floats
    high: Floats
    rise: Floats = np.zeros(0)
    periodic = False

    def __init__(
        self, position_analysis: PositionAnalysis, poles: tuple[Pole, ...]
    ) -> None:
        """Prepare the loop-closure equations and the loads.

        Parameters
        ----------
        position_analysis
            The mechanism with its inputs, and its chosen assembly mode.
        poles
            Pairs of links whose relative motion is stored.
        """
        self.position_analysis = position_analysis
        self.mechanism = position_analysis.mechanism
        self.poles = poles
        self.closure = position_analysis.solver.closure
        self.loads = Loads(self.mechanism)
        # The power of a component of a load is its magnitude times a velocity. The
        # dictionary has the names of the stored velocities, by the index of the component.
        self.load_velocities = load_velocity_names(self.loads)
        self.has_dynamics = bool(self.mechanism.masses or self.mechanism.loads)

    def make_heading(self, assembly_mode: int) -> StoredHeading:
        """Return the heading of the model of an assembly mode (way to assemble the links).

        The model stores functions of the configuration, such as the inertia, as series in
        one or several coordinates. Coordinates (``by``) are the inputs, or the arc length
        of the curve of configurations. The heading describes the model without the series:
        the mechanism, its loads, the poles (axes of relative rotation of two links) and the
        coordinates with their ranges (rad). ``variables`` are the names of all pair
        variables (joint angles), ``angles`` those of the R pairs. Along a closed curve of
        configurations, ``rise`` is the growth of each variable (rad) over one period.
        """
        mechanism = self.mechanism
        return StoredHeading(
            mechanism=mechanism.name,
            mechanism_sha256=mechanism_hash(mechanism),
            made_by=__version__,
            assembly_mode=assembly_mode,
            variables=mechanism.variable_names,
            angles=tuple(mechanism.angles),
            poles=tuple(pole_name(mechanism, pole) for pole in self.poles),
            loads=_describe_loads(self.loads, self.load_velocities),
            inputs=self.position_analysis.inputs,
            by=self.by,
            low=tuple(self.low.tolist()),
            high=tuple(self.high.tolist()),
            rise=tuple(self.rise.tolist()),
            periodic=self.periodic,
        )

    def label_motion_functions(self, heading: StoredHeading) -> list[FunctionLabel]:
        """Return labels of the functions of the motion that the reduced model stores.

        A label has the name, the unit and the kind of a function. Errors of small functions
        are judged relative to larger functions of the same kind. The functions are:

        1. the pair variables (joint angles);
        2. their derivatives with respect to the coordinates of the model;
        3. the inertia and its derivatives (for several coordinates its Christoffel
           symbols), if the mechanism has masses or loads;
        4. the velocities of loads on links. The size of a load times its velocity is its
           power.

        `_evaluate_motion` returns the values of the functions in the same order.

        Parameters
        ----------
        heading
            Description of the model: its variables and coordinates, and the names under
            which derivatives are stored.
        """
        labels = self._label_variables(heading)
        labels += self._label_variable_derivatives(heading)
        if self.has_dynamics:
            labels += self._label_inertia(heading)
        labels += self._label_load_velocities(heading)
        return labels

    def _label_variables(self, heading: StoredHeading) -> list[FunctionLabel]:
        """Return the labels of angles of R pairs and of arcs along contact profiles."""
        labels = []
        for number, variable in enumerate(heading.variables):
            kind = FunctionKind.CONTACT_ARC
            if self._is_angle(number):
                kind = FunctionKind.ANGLE
            labels.append(FunctionLabel(variable, "rad", kind))
        return labels

    def _label_variable_derivatives(self, heading: StoredHeading) -> list[FunctionLabel]:
        """Return labels of all variables' derivatives with respect to each coordinate."""
        labels = []
        for number, variable in enumerate(heading.variables):
            kind = FunctionKind.CONTACT_ARC_DERIVATIVE
            if self._is_angle(number):
                kind = FunctionKind.ANGLE_DERIVATIVE
            for name in heading.by_coordinates(variable):
                labels.append(FunctionLabel(name, "", kind, derivative_of=variable))
        return labels

    def _label_load_velocities(self, heading: StoredHeading) -> list[FunctionLabel]:
        """Return labels of the functions that are velocities of load components.

        A label has the name, unit and kind of a function that the reduced model stores. A
        load may be a sum of components, such as the x, y and z parts of a force. The power
        of a component is its size times its velocity.
        """
        labels = []
        for component, velocity_name in self.load_velocities.items():
            load = self.loads.load_of_component[component]
            unit = self.mechanism.loads[load].velocity_unit
            # The error of a stored function is judged relative to its largest value. A
            # model along a curve has one coordinate. There, the components of a load have
            # a common name `vector`. Their errors are judged relative to the largest value
            # of all these components.
            if heading.is_curve:
                vector = f"load {self.loads.names[load]}"
            else:
                vector = ""
            # There is one function for each coordinate.
            for name in heading.by_coordinates(velocity_name):
                kind = FunctionKind.LOAD_VELOCITY
                labels.append(FunctionLabel(name, unit, kind, vector))
        return labels

    def _is_angle(self, variable: int) -> bool:
        return variable in self.mechanism.angles.values()

    def _label_inertia(self, heading: StoredHeading) -> list[FunctionLabel]:
        """Return the labels of the inertia matrix and of its Christoffel symbols.

        A label has the name, unit and kind of a stored function. The kind determines how
        the error of the function is judged. `heading.velocity_terms` has a list of terms
        for each coordinate, whose sum is the Coriolis and centrifugal torque. Each term is
        a Christoffel symbol of the inertia matrix times two rates, and a constant factor.

        With one coordinate x (a curve) the functions are the inertia B and its derivative
        dB/dx. The only Christoffel symbol, 1/2 dB/dx, follows from this derivative.
        """
        labels = [
            FunctionLabel(name, "kg m2", FunctionKind.INERTIA) for name in heading.inertia
        ]
        if heading.is_curve:
            # One coordinate has one inertia B, and one term with the function dB/dx.
            (inertia_name,) = heading.inertia
            (velocity_terms,) = heading.velocity_terms
            (velocity_term,) = velocity_terms
            inertia_derivative = FunctionLabel(
                velocity_term.function,
                "kg m2/rad",
                FunctionKind.INERTIA_DERIVATIVE,
                derivative_of=inertia_name,
            )
            return [*labels, inertia_derivative]
        for velocity_terms in heading.velocity_terms:
            for term in velocity_terms:
                label = FunctionLabel(term.function, "kg m2", FunctionKind.CHRISTOFFEL)
                labels.append(label)
        return labels

    def _evaluate_motion(
        self, motion: CoordinateMotion, christoffel_factor: float
    ) -> Floats:
        """Return the functions (n, F) of `label_motion_functions` at n configurations.

        The functions are the pair variables (joint angles) and their derivatives, then the
        inertia matrix, its Christoffel symbols, and velocities of load components per unit
        rate of each coordinate. A load component is a moment or a force in one direction.
        The size of a component times its velocity is its power.

        Parameters
        ----------
        motion
            n configurations and their derivatives with respect to m coordinates.
        christoffel_factor
            Factor of the Christoffel symbols in the result. With one coordinate x, the
            inertia matrix is a number B and the only symbol is 1/2 dB/dx. The model stores
            dB/dx, so the factor is 2. With several coordinates the model stores the
            symbols, so the factor is 1.
        """
        functions = [motion.values, _flatten_by_coordinate(motion.rates)]
        if self.has_dynamics:
            masses = inertia(self.mechanism, motion)
            functions.append(_lower_triangles(masses.M))
            # (n, i, j, k) Christoffel symbols, i for the equation of coordinate i. The
            # symbols are symmetric in j and k, so only those with k <= j are stored.
            symbols = christoffel_factor * christoffel(masses.dM)
            functions.append(_lower_triangles(symbols).reshape(len(symbols), -1))
        if self.load_velocities:
            velocities = self.loads.velocities(motion)  # (n, m, load components)
            # Indices of the components that act on links. The velocity of a component at a
            # pair is the rate of the pair variable, which is stored above.
            stored_components = list(self.load_velocities)
            functions.append(_flatten_by_coordinate(velocities[..., stored_components]))
        return np.concatenate(functions, axis=1)

    @cached_property
    def _find_nearest_nodes(self) -> Callable[[Floats], Indices]:
        """A function of inputs (n, m) that returns the index (n,) of the nearest node."""
        from scipy.spatial import cKDTree

        tree = cKDTree(self.nodes.values[:, self.driven])
        return lambda inputs: np.asarray(tree.query(inputs)[1])

    def close_loops(self, inputs: Floats) -> ClosedConfigurations:
        """Return configurations with closed loops at inputs (n, m), rad.

        Each configuration is predicted from the nearest known configuration (its node), by
        a Taylor series of second order in the inputs. Newton's method then closes the
        loops, without changing the inputs.
        """
        nodes = self.nodes

        node_of_row = self._find_nearest_nodes(inputs)
        steps = inputs - nodes.values[node_of_row][:, self.driven]
        # The Taylor series. Letters: n rows of `inputs`, i and k inputs, v pair variables.
        first_order = np.einsum("ni,niv->nv", steps, nodes.rates[node_of_row])
        second_order = np.einsum("ni,nk,nikv->nv", steps, steps, nodes.second[node_of_row])
        values = nodes.values[node_of_row] + first_order + 0.5 * second_order
        values[:, self.driven] = inputs
        with np.errstate(all="ignore"):
            solution = self.closure.solve(
                values, self.driven, longest_step=MAX_SAMPLER_NEWTON_STEP_RAD
            )
        return ClosedConfigurations(solution, node_of_row, steps)


def _flatten_by_coordinate(derivatives: Floats) -> Floats:
    """Return derivatives (n, m, k) of k functions in m coordinates as an array (n, k m).

    The derivatives of one function with respect to all coordinates are next to each other.
    """
    return np.swapaxes(derivatives, 1, 2).reshape(len(derivatives), -1)


def _lower_triangles(matrices: Floats) -> Floats:
    """Return the entries of symmetric matrices (..., m, m) up to the diagonal, by rows."""
    rows, columns = np.tril_indices(matrices.shape[-1])
    return matrices[..., rows, columns]


class CurveSampler(Sampler):
    """Computes the functions that a reduced model of one input stores.

    The functions depend on one coordinate of the configuration curve: the variable q of the
    input, or the arc length s of the curve. The functions are in groups. Group 0 has the
    functions of the motion. Each further group has the five functions of one pole, the axis
    of relative rotation of two links: three components of its unit vector, the velocity
    coefficient and the derivative of this coefficient.

    Attributes
    ----------
    curve
        The configuration curve as a function of its arc length.
    is_by_input
        Whether the coordinate of the functions is the variable q of the input, and not the
        arc length s of the curve.
    input_sense
        1 or -1: whether q grows or falls along the curve. 1 if the coordinate is s.
    lap_length
        Growth of the coordinate (rad) over one lap of a closed curve, or over the whole
        length of an open curve.
    laps_per_period
        Number of laps of a closed curve after which all functions repeat. It is 1, or 2 if
        a pole axis comes back reversed after one lap.
    """

    def __init__(
        self, position_analysis: PositionAnalysis, poles: tuple[Pole, ...]
    ) -> None:
        """Follow the configuration curve, and choose its coordinate and period.

        The curve consists of all configurations that the mechanism with its one input
        reaches.

        Parameters
        ----------
        position_analysis
            The mechanism with its input, and its chosen assembly mode.
        poles
            Pairs of links whose axis of relative rotation is stored.
        """
        super().__init__(position_analysis, poles)
        # `values` is a configuration on the curve.
        self.curve, values = _follow_curve(position_analysis)
        curve = self.curve
        driven = position_analysis.solver.input_variable
        self.driven = [driven]
        self.plan = plan(
            self.mechanism,
            list(poles),
            position_analysis.inputs[0],
            position_analysis.by_rank,
        )
        # The coordinate is the input variable q if the input turns fully on a closed curve
        # and never almost stops, otherwise the arc length s. Near a place where the input
        # almost stops, functions of q would be steep.
        input_rates = curve.nodes.tangents[:, driven]
        # Revolutions of the input in one lap, negative if q falls along the curve. If there
        # are none, the sign is 0 and the following condition fails.
        revolutions = int(curve.winding[driven])
        never_almost_stops = np.all(input_rates * np.sign(revolutions) > MIN_CRANK_RATE)
        self.is_by_input = bool(
            curve.closed
            and never_almost_stops
            and not len(curve.dead_points(driven).places)
        )
        self.input_sense = 1.0
        self.lap_length = curve.length
        if self.is_by_input:
            self.input_sense = float(np.sign(revolutions))
            self.lap_length = abs(revolutions) * TURN
            # The curve passes the configuration `values`, perhaps with whole turns added to
            # the variables. These turns are subtracted from the nodes (the known
            # configurations from which Newton's method starts).
            offset = curve.at(curve.find(values[None])).values[0] - values
            arc_lengths = np.linspace(0.0, curve.length, CURVE_NODES)
            node_values = curve.at(arc_lengths).values - offset
            self.nodes = motion_by_variables(self.closure, node_values, self.driven)
        self.periodic = curve.closed
        # `_store_axis_senses` sets 2 laps if a pole axis comes back reversed after one lap.
        self.laps_per_period = 1
        self._store_axis_senses()
        self.by = ("q" if self.is_by_input else "s",)
        self.low = np.zeros(1)
        self.high = np.array([self.laps_per_period * self.lap_length])
        # Growth of the variables over one period of the model. `curve.rise` is the growth
        # over one lap along the curve, on which q may fall.
        self.rise = curve.rise * self.input_sense * self.laps_per_period

    def label_pole_functions(
        self, pole: str, heading: StoredHeading
    ) -> list[FunctionLabel]:
        """Return the labels (name, unit, kind) of the five stored functions of a pole.

        A pole is the axis about which two links rotate relative to each other. The
        functions are the three components of its unit vector in ground axes, its velocity
        coefficient (relative angular velocity per unit rate of the coordinate), and the
        derivative of this coefficient.

        Parameters
        ----------
        pole
            Name of the pole, LINK/RELATIVE_TO.
        heading
            The heading of the model, which forms the names of derivatives.
        """
        labels: list[FunctionLabel] = []
        for axis in "xyz":
            name = f"pole {pole} {axis}"
            labels.append(
                FunctionLabel(name, "", FunctionKind.POLE_AXIS, vector=f"pole {pole}")
            )
        coefficient = f"rate {pole}"
        labels.append(FunctionLabel(coefficient, "", FunctionKind.VELOCITY_COEFFICIENT))
        derivative = heading.derivative(coefficient)
        kind = FunctionKind.ACCELERATION_COEFFICIENT
        labels.append(FunctionLabel(derivative, "1/rad", kind, derivative_of=coefficient))
        return labels

    def evaluate_groups(self, groups: Sequence[int], x: Floats) -> Floats:
        """Return the values of the functions that a reduced model stores.

        All are functions of the model's only coordinate x, which determines the
        configuration.

        Parameters
        ----------
        groups
            Groups of functions that are computed. Group 0 has the functions of the motion:
            the pair variables v (joint angles), dv/dx, the inertia B, dB/dx, and the
            velocities of loads. The size of a load times its velocity is its power. Group
            k + 1 has the five functions of pole number k (axis of relative rotation of two
            links).
        x
            (n,) values of the coordinate (rad): the input variable q, or the arc length s
            of the curve of configurations.

        Returns
        -------
        (n, F) values of the F functions of these groups, one group after another. The units
        are in the labels (`label_motion_functions`, `label_pole_functions`).
        """
        motion = self._compute_motion(x)
        # Directions of poles are needed only if a group other than 0 is requested.
        directions = self._evaluate_directions(x, motion) if any(groups) else {}
        functions = []
        for group in groups:
            if group == 0:
                # The Christoffel symbol is 1/2 dB/dx, but the model stores dB/dx.
                functions.append(self._evaluate_motion(motion, christoffel_factor=2.0))
            else:
                pole = self.poles[group - 1]
                functions.append(_evaluate_pole(motion, pole, directions[pole]))
        return np.concatenate(functions, axis=1)

    def _compute_motion(self, x: Floats) -> CoordinateMotion:
        """Return configurations with their derivatives d/dx, x the coordinate of the model.

        Parameters
        ----------
        x
            (n,) values of the coordinate (rad): the input variable q, or the arc length s
            of the configuration curve (`is_by_input` says which).
        """
        if self.is_by_input:
            return self._compute_motion_by_input(x)
        return self._compute_motion_by_arc_length(x)

    def _compute_motion_by_input(self, q: Floats) -> CoordinateMotion:
        """Return the motion with derivatives d/dq at input variables q (n,), rad.

        The configurations form a closed curve. The nodes (known configurations from which
        Newton's method starts) cover one lap only. Whole laps are therefore subtracted from
        q first. In each lap, joint angles grow by whole revolutions, which are added
        afterwards.
        """
        (input_variable,) = self.driven
        start_input = self.nodes.values[0, input_variable]
        # The change of q in one lap along the curve: `lap_length` is its size (rad), and
        # `input_sense` is -1 if q decreases along the curve.
        input_change = self.input_sense * self.lap_length
        laps = np.floor((q - start_input) / input_change)
        input_within_lap = q - laps * input_change
        closed = self.close_loops(input_within_lap[:, None])
        # `rise` (variables,) is the growth of the variables over one lap along the curve.
        values = closed.linearisation.values + np.outer(laps, self.curve.rise)
        # Subtraction and addition of laps have rounding errors, so the input is set to q.
        values[:, input_variable] = q
        return motion_by_variables(self.closure, values, self.driven)

    def _compute_motion_by_arc_length(self, s: Floats) -> CoordinateMotion:
        """Return the motion with derivatives d/ds at arc lengths s (n,), rad."""
        points = self.curve.at(s)
        motion = motion_by_arc_length(self.closure, points.values)
        # The unit tangent is computed as a null vector of arbitrary sense, and gets the
        # sense of the stored tangent of the curve.
        return motion.with_senses(np.sign(np.vecdot(motion.rates[:, 0], points.tangents)))

    def _evaluate_directions(
        self, x: Floats, motion: CoordinateMotion
    ) -> dict[Pole, Floats]:
        """Return the unit vectors (n, 3) of the poles in ground axes.

        A pole is the axis of relative rotation of two links. Of its two opposite directions
        one is chosen, so that it does not jump along the curve of configurations. The
        choice follows `stored_directions`, which were computed before at evenly spaced
        places of the curve.

        Parameters
        ----------
        x
            (n,) coordinates along the curve (rad), 0 at its start.
        motion
            The motion at these coordinates.
        """
        directions = self._compute_axes(motion)
        # Index of the nearest stored direction. A lap is one passage along the whole curve,
        # of length `lap_length`. It is divided into `SENSE_SAMPLES` equal parts.
        nearest = np.rint(x / self.lap_length * SENSE_SAMPLES).astype(int)
        # On a closed curve the directions repeat after one lap, or after two laps if an
        # axis is reversed after one.
        if self.periodic:
            nearest %= SENSE_SAMPLES * self.laps_per_period
        for pole, direction in directions.items():
            # An axis that points against the stored direction is reversed. The sense of the
            # axis of a pair (joint) is fixed by the mechanism file, so it is not stored.
            if pole in self.stored_directions:
                cosines = np.vecdot(direction, self.stored_directions[pole][nearest])
                direction[cosines < 0.0] *= -1.0
        return directions

    def _compute_axes(self, motion: CoordinateMotion) -> dict[Pole, Floats]:
        """Return unit vectors (n, 3) along the pole axes in ground axes, in either sense.

        A pole axis is the axis about which one link rotates relative to another one. Each
        of the n rows of the motion has one. There are two methods: the intersection of
        planes, and the direction of the relative angular velocity. The second one is used
        where it is more accurate.

        Raises
        ------
        SolveError
            If the two links of a pole do not move relative to each other somewhere.
        """
        # The first method uses the theorem of Aronhold and Kennedy: the three pole axes of
        # three links lie in a plane. An unknown axis is the intersection of two such
        # planes. `self.plan` says in which order the axes are computed.
        # `planned.errors` has the error bounds of these axes.
        planned = PlannedPoles(self.plan, self._convert_motion(motion))
        axes: dict[Pole, Floats] = {}
        # (n, links, 3) angular velocities per unit rate of the only coordinate (index 0).
        w = motion.w[:, 0]
        max_speeds = np.max(np.linalg.norm(w, axis=2), axis=1)
        for pole in self.poles:
            first, second = pole
            axis = _choose_pole_axis(
                planned.directions[pole].T,
                error_bound=planned.errors[pole],
                relative_w=w[:, second] - w[:, first],
                max_speeds=max_speeds,
            )
            if not all_finite(axis):
                raise SolveError(
                    f"{self.mechanism.name}: pole {pole_name(self.mechanism, pole)} has no "
                    "direction in some configurations of the curve, because the two links "
                    "do not move relative to each other there; leave this pole out"
                )
            axes[pole] = axis
        return axes

    def _convert_motion(self, motion: CoordinateMotion) -> Motion:
        """Return the motion in the form from which pole axes are computed."""
        return replace(
            make_motion(self.position_analysis.solver, motion.values), status=motion.status
        )

    def _store_axis_senses(self) -> None:
        """Choose and store a direction of each pole axis that never jumps on the curve.

        A pole is the axis of relative rotation of two links. An axis that is computed at
        any place of the curve has an arbitrary sense. `_evaluate_directions` gives it the
        sense of the nearest stored direction. If a pair (joint) joins the links, the sense
        is known and no direction is stored.

        At the first sample the sense is chosen. Each later direction has to make an acute
        angle with the one before. This condition gives the right sense only if the axis
        turns little between two samples. An axis may come back reversed after one lap of
        the curve of configurations. The period of the model is then two laps.
        """
        # Evenly spaced places on one lap. The last one is where the next lap starts.
        coordinates = self.lap_length * np.arange(SENSE_SAMPLES + 1) / SENSE_SAMPLES
        motion = self._compute_motion(coordinates)
        axes = self._compute_axes_without_pairs(motion)
        self._check_axis_speeds(axes)  # raises an error if an axis turns too much
        # This vector decides the sense of each axis at the first sample.
        reference = self._choose_reference_direction(motion)
        self.stored_directions: dict[Pole, Floats] = {}
        for pole, axis in axes.items():
            signs = continuous_signs(axis, reference)
            self.stored_directions[pole] = axis * signs[:, None]
        if self.periodic:
            self._store_second_lap()

    def _compute_axes_without_pairs(self, motion: CoordinateMotion) -> dict[Pole, Floats]:
        """Return unit vectors (n, 3) along the poles that are not the axis of a pair.

        A pole is the axis of relative rotation of two links. The vectors are in ground
        axes, in either sense.
        """
        poles_at_pairs = set()
        for step in self.plan.steps:
            # A primary pole is the axis of a pair. Other poles are constructed from these.
            if isinstance(step, PrimaryPole):
                poles_at_pairs.add(step.pole)
        axes = self._compute_axes(motion)
        return {pole: axis for pole, axis in axes.items() if pole not in poles_at_pairs}

    def _choose_reference_direction(self, motion: CoordinateMotion) -> Floats:
        """Return a vector (3,) that decides the sense of an axis at the first sample.

        An axis has two opposite senses. The one on the side of this vector is taken. The
        vector is the sum of the axes of all pairs (joints).
        """
        # Columns of a frame: x, y, and z along the axis of the pair.
        frames = self._convert_motion(motion).frames
        pair_axes = frames[0, :, :, 2]
        return np.sum(pair_axes, axis=0)

    def _store_second_lap(self) -> None:
        """Extend the stored directions to two laps if a pole axis is reversed after one.

        A pole is the axis of relative rotation of two links. `stored_directions` has a
        direction of each pole at points along the closed curve of configurations. A lap is
        one passage around this curve.

        The direction of a reversed axis would jump where the next lap begins. The second
        lap is therefore stored, too. It has the same configurations, but the opposite
        directions of reversed axes. After two laps all directions repeat.
        """
        reversed_poles = []
        for pole, directions in self.stored_directions.items():
            if directions[0] @ directions[-1] < 0.0:
                reversed_poles.append(pole)
        if not reversed_poles:
            return
        self.laps_per_period = 2
        for pole, directions in self.stored_directions.items():
            self.stored_directions[pole] = _append_second_lap(
                directions, is_reversed=pole in reversed_poles
            )

    def _check_axis_speeds(self, axes: Mapping[Pole, Floats]) -> None:
        """Raise `SolveError` if an axis turns too fast between samples to be followed.

        `axes` are samples (n, 3) of the axis of each pole along the curve, in either sense.
        A pole is the axis of relative rotation of two links. The sense of an axis is
        carried on from sample to sample, which is only certain if the axis turns little.
        """
        for axis in axes.values():
            cosines = np.abs(np.vecdot(axis[1:], axis[:-1]))
            if np.min(cosines) < MIN_AXIS_COSINE:
                raise SolveError(
                    f"{self.mechanism.name}: a pole axis turns too fast to be followed; "
                    "request fewer poles"
                )


def _choose_pole_axis(
    constructed_axis: Floats, error_bound: Floats, relative_w: Floats, max_speeds: Floats
) -> Floats:
    """Return unit vectors (n, 3) along a pole axis, each by the more accurate method.

    A pole axis is the axis of relative rotation of two links. The axis is constructed from
    other axes: the three pole axes of any three links lie in one plane, and an unknown axis
    is the intersection of two such planes. The other method takes the direction of the
    relative angular velocity of the links. In each row (configuration), this direction is
    used if its error is smaller. A constructed axis with a negligible error
    (`TRUSTED_AXIS_ERROR_RAD`) stays in any case.

    Parameters
    ----------
    constructed_axis
        (n, 3) the axis by the construction.
    error_bound
        (n,) error bound of the constructed axis, rad. NaN if it is unknown.
    relative_w
        (n, 3) relative angular velocity of the links.
    max_speeds
        (n,) largest angular velocity of any link, from which rounding errors are estimated.
    """
    axis = constructed_axis.copy()
    construction_error = np.nan_to_num(error_bound, nan=np.inf)
    relative_speed = np.linalg.norm(relative_w, axis=1)
    # For links at relative rest, division by zero gives an infinite error.
    with np.errstate(divide="ignore", invalid="ignore"):
        velocity_error = AXIS_ERROR_ROUNDINGS * EPS * max_speeds / relative_speed
        is_better = construction_error > TRUSTED_AXIS_ERROR_RAD
        is_better &= velocity_error < construction_error
        axis[is_better] = relative_w[is_better] / relative_speed[is_better, None]
    return axis


def _append_second_lap(first_lap: Floats, is_reversed: bool) -> Floats:
    """Return the directions of an axis over two laps of a closed curve.

    After one lap some axes have the opposite direction. After two laps the directions of
    all axes repeat. So directions over two laps can be continued periodically.

    Parameters
    ----------
    first_lap
        (k + 1, 3) directions at k + 1 points. The last one is where the second lap starts.
    is_reversed
        Whether the axis has the opposite direction after one lap. All directions of the
        second lap are then opposite to those of the first.

    Returns
    -------
    (2 k + 1, 3) directions. The point between the laps occurs once.
    """
    second_lap = -first_lap if is_reversed else first_lap
    return np.concatenate([first_lap[:-1], second_lap])


class BoxSampler(Sampler):
    """Computes the functions that a reduced model of several inputs stores.

    The ranges of the inputs form a box. The functions depend on the configuration alone,
    and are computed at any inputs in the box.
    """

    def __init__(
        self, position_analysis: PositionAnalysis, poles: tuple[Pole, ...]
    ) -> None:
        """Compute the nodes: configurations of the assembly mode on a grid of inputs.

        To find the configuration at other inputs, `evaluate` starts Newton's method from
        the nearest node.

        Parameters
        ----------
        position_analysis
            The mechanism with its inputs, and its assembly mode (way to assemble the
            links).
        poles
            Couples of two links each, whose axis of relative rotation is stored.
        """
        super().__init__(position_analysis, poles)
        # `by` are the coordinates of the model: the names of the input pairs (joints).
        self.by = position_analysis.inputs
        # Indices of their variables among all pair variables.
        self.driven = [self.mechanism.angles[pair] for pair in self.by]
        self.low, self.high = np.array([item.range for item in self.mechanism.inputs]).T
        self.nodes = _compute_grid_nodes(position_analysis, self.driven)

    def label_functions(self, heading: StoredHeading) -> list[FunctionLabel]:
        """Return the labels of all functions: those of the motion, then those of poles.

        A pole has one label for each component of the relative angular velocity in ground
        axes and for each moving input.
        """
        labels = self.label_motion_functions(heading)
        for pole in heading.poles:
            for axis in "xyz":
                for name in heading.by_coordinates(f"velocity {pole} {axis}"):
                    labels.append(FunctionLabel(name, "", FunctionKind.ANGULAR_VELOCITY))
        return labels

    def evaluate(self, inputs: Floats, function_count: int) -> Floats:
        """Return the values of all stored functions, one column for each function.

        A reduced model stores these functions of its inputs: the pair variables (joint
        angles), the inertia, and velocities of loads and poles, see `label_functions`.

        Parameters
        ----------
        inputs
            (n, m) values of the m inputs, in rad.
        function_count
            Number of the functions, which is the width of the result.

        Returns
        -------
        (n, function_count) values; NaN where the assembly mode does not exist, or is too
        near to a singularity.
        """
        closed = self.close_loops(inputs)
        values = closed.linearisation.values
        # The test of validity uses first derivatives only. Second derivatives are computed
        # in valid rows.
        with np.errstate(all="ignore"):
            motion = motion_by_variables(self.closure, values, self.driven, order=1)
            is_valid = self._is_valid(closed, motion)
        functions = nans((len(inputs), function_count))
        if np.any(is_valid):
            functions[is_valid] = self.evaluate_motion(
                motion_by_variables(self.closure, values[is_valid], self.driven)
            )
        return functions

    def _is_valid(self, closed: ClosedConfigurations, motion: CoordinateMotion) -> Bools:
        """Return a mask (n,) of valid configurations of the assembly mode.

        An assembly mode is one way to assemble the links. In a valid configuration the
        loops are closed, all contacts exist, and no singularity is near. The assembly mode
        is the mode of the node (known configuration) from which Newton's method started.

        Parameters
        ----------
        closed
            Configurations that Newton's method found.
        motion
            The same configurations with their first derivatives with respect to the inputs.
        """
        is_closed = closed.linearisation.closure_residual < CLOSURE_TOLERANCE
        has_contacts = motion.status == Status.OK
        # Near a singularity, variables move fast at unit rates of the inputs.
        # `determinacy` is the reciprocal of the norm of their rates.
        is_regular = determinacy(motion.rates) >= MIN_DETERMINACY
        # A configuration of the same mode is near this prediction from its node.
        prediction = self._predict_by_trapezoidal_rule(closed, motion.rates)
        prediction_error = max_abs(prediction - motion.values, axis=1)
        is_same_mode = prediction_error < MAX_PREDICTION_ERROR_RAD
        return is_closed & has_contacts & is_regular & is_same_mode

    def _predict_by_trapezoidal_rule(
        self, closed: ClosedConfigurations, rates: Floats
    ) -> Floats:
        """Return the pair variables (n, variables) that are predicted from the nodes, rad.

        A node is a known configuration at inputs nearby. The change of a variable from the
        node is the step of the inputs times the mean of its rates at both ends of the step.
        A large difference from the prediction shows that Newton's method changed the
        assembly mode.

        Parameters
        ----------
        closed
            Configurations with their nodes, and the steps of the inputs from these.
        rates
            (n, m, variables) rates of the variables with respect to the inputs in the
            configurations.
        """
        node_rates = self.nodes.rates[closed.nodes]
        # Letters: n row, i input, v variable.
        change = 0.5 * np.einsum("ni,niv->nv", closed.steps, node_rates + rates)
        return self.nodes.values[closed.nodes] + change

    def evaluate_motion(self, motion: CoordinateMotion) -> Floats:
        """Return all functions (n, F), of the motion and of poles, at n configurations."""
        functions = [self._evaluate_motion(motion, christoffel_factor=1.0)]
        for first, second in self.poles:
            relative_w = motion.w[:, :, second] - motion.w[:, :, first]
            functions.append(np.swapaxes(relative_w, 1, 2).reshape(len(relative_w), -1))
        return np.concatenate(functions, axis=1)


def _compute_grid_nodes(
    position_analysis: PositionAnalysis, input_variables: Sequence[int]
) -> CoordinateMotion:
    """Return the regular configurations of an assembly mode on a grid of inputs.

    These are the nodes: known configurations from which Newton's method later finds
    configurations at other inputs. An assembly mode is one way to assemble the links.
    Configurations near singularities are left out, because the functions of a reduced model
    are steep there.

    Parameters
    ----------
    position_analysis
        The mechanism with the grid of its inputs, and its chosen assembly mode.
    input_variables
        Indices of the inputs among the pair variables (joint angles).

    Returns
    -------
    The configurations, with first and second derivatives with respect to the inputs.

    Raises
    ------
    SolveError
        If there is no regular configuration on the grid.
    """
    motion = unwrap_motion(position_analysis.motion(), position_analysis.angle_unwrapping)
    configurations = motion_by_variables(
        position_analysis.solver.closure,
        motion.values[motion.status == Status.OK],
        input_variables,
    )
    # (n, inputs, inputs, variables) second derivatives, not finite at a singularity.
    is_regular = all_finite(configurations.second, (1, 2, 3))
    # Near a singularity, variables move fast at unit rates of the inputs. `determinacy` is
    # the reciprocal of the norm of these rates, so it is small near a singularity.
    is_regular &= determinacy(configurations.rates) >= MIN_DETERMINACY
    if not np.any(is_regular):
        raise SolveError(
            f"{position_analysis.mechanism.name}: the assembly mode has no regular "
            "configuration on a grid over the ranges of the inputs; give another assembly "
            "mode or range"
        )
    return configurations.rows(is_regular)


def _follow_curve(position_analysis: PositionAnalysis) -> tuple[ArcCurve, Floats]:
    """Return the curve of configurations of an assembly mode, and a configuration on it.

    `CurveSampler` takes the samples of a reduced model from this curve. An assembly mode is
    one way to assemble the mechanism at the same inputs. The first configuration is
    searched at evenly spaced inputs; it has to be within the joint limits. The curve
    consists of all configurations that the mechanism with its one input reaches from there.
    The curve is followed in both senses, until it closes or reaches a joint limit.

    Returns
    -------
    curve
        The curve of configurations.
    values
        (variables,) pair variables (joint angles, rad) of the first configuration.

    Raises
    ------
    SolveError
        If no configuration is found within the joint limits.
    """
    mechanism = position_analysis.mechanism
    low, high = position_analysis.range
    # The middles of equal parts of the range.
    fractions = (np.arange(PROBED_INPUTS) + 0.5) / PROBED_INPUTS
    probed_inputs = low + (high - low) * fractions
    # Angles are computed up to whole revolutions. Joint limits can be beyond one
    # revolution, so the angles are unwrapped.
    motion = unwrap_motion(
        position_analysis.at(probed_inputs), position_analysis.angle_unwrapping
    )
    # Joint limits by the index of their pair variable.
    joint_limits = {}
    for limit in mechanism.joint_limits:
        # Only R pairs, which have a single variable, can have limits.
        (variable,) = mechanism.variables_of(mechanism.pair_number[limit.pair])
        joint_limits[variable] = (limit.low, limit.high)
    is_usable = motion.status == Status.OK
    for variable, (lower_limit, upper_limit) in joint_limits.items():
        value = motion.values[:, variable]
        is_usable &= (value > lower_limit) & (value < upper_limit)
    if not np.any(is_usable):
        raise SolveError(
            f"{mechanism.name}: the assembly mode has no configuration within the joint "
            f"limits at any of {PROBED_INPUTS} inputs of its range; give another assembly "
            "mode or range"
        )
    values = motion.values[np.argmax(is_usable)]
    return follow_arc(position_analysis.solver.closure, values, joint_limits), values


def _evaluate_pole(motion: CoordinateMotion, pole: Pole, direction: Floats) -> Floats:
    """Return the five numbers that a reduced model stores for a pole, at n configurations.

    A pole is the axis of relative rotation of two links. The five numbers are functions of
    the model's only coordinate. The model has series that are fitted to their values.

    Parameters
    ----------
    motion
        n configurations and their derivatives with respect to the coordinate.
    pole
        Numbers of the two links.
    direction
        (n, 3) unit vector of the pole axis in ground axes.

    Returns
    -------
    (n, 5) the three components of the direction, the velocity coefficient (angular velocity
    about the pole per unit rate of the coordinate) and its derivative.
    """
    first, second = pole
    # Relative angular velocity per unit rate of the only coordinate (index 0), and its
    # derivative.
    w = motion.w[:, 0, second] - motion.w[:, 0, first]
    dw = motion.dw[:, 0, 0, second] - motion.dw[:, 0, 0, first]
    # w = coefficient * direction. The derivative of a unit vector is normal to the vector,
    # so the part of dw along the direction is the derivative of the coefficient.
    coefficient = np.vecdot(w, direction)
    coefficient_derivative = np.vecdot(dw, direction)
    return np.column_stack([direction, coefficient, coefficient_derivative])


def pole_name(mechanism: Mechanism, pole: Pole) -> str:
    """Return the name of a pole, LINK/RELATIVE_TO."""
    first, second = pole
    return f"{mechanism.links[second]}/{mechanism.links[first]}"


def _describe_loads(
    loads: Loads, load_velocities: Mapping[int, str]
) -> tuple[StoredLoad, ...]:
    """Return the loads of a mechanism as a reduced model stores them.

    A load is a sum of components, such as the x, y and z parts of a force. The power of a
    component is its magnitude times a velocity. For a component at a pair (joint) this is
    the rate of the pair variable. For other components the model stores this velocity.

    Parameters
    ----------
    loads
        The loads of the mechanism.
    load_velocities
        Names of the stored velocities by the index of the component in `loads.components`.
        Components at pairs are not among them.
    """
    stored_loads = []
    for load_index, load in enumerate(loads.mechanism.loads):
        # For each component of the load: the name of the pair variable or stored velocity
        # on which it works, and its magnitude as text.
        works_on = []
        expressions = []
        for component_index, component in enumerate(loads.components):
            if loads.load_of_component[component_index] != load_index:
                continue
            if component_index in load_velocities:
                works_on.append(load_velocities[component_index])
            else:
                # A component at a pair works on the rate of the pair variable.
                works_on.append(f"theta_{component.pair}")
            if isinstance(component.magnitude, Expression):
                expressions.append(component.magnitude.text)
        # A torque table has no expression and is stored as numbers.
        table: tuple[Any, ...] = ()
        if isinstance(load, TorqueTable):
            table = (load.times, load.torques, load.periodic)
        stored_loads.append(
            StoredLoad(load.name, tuple(works_on), tuple(expressions), *table)
        )
    return tuple(stored_loads)
