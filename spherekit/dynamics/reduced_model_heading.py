"""The heading of a reduced model: its functions, loads and coordinates without numbers.

The heading also writes forces and torques as expressions of the stored functions.
"""

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from spherekit.arrays import Bools, Floats
from spherekit.conventions import Names
from spherekit.errors import SolveError
from spherekit.mechanism.load import TorqueTable
from spherekit.mechanism.load_expression import load_names, parse
from spherekit.symbolic.expression_graph import Expr, ExpressionNode, dot, symbols
from spherekit.symbolic.parsed_expressions import convert_to_graph
from spherekit.wording import choices

RANGE_SLACK_RATIO = 1e-12
"""Part of the range by which a coordinate may exceed its ends, because of rounding.

Larger: models are extrapolated. Smaller: computed ends of the range can be refused.
"""


@dataclass(frozen=True)
class StoredFunction:
    """Name, unit and accuracy of a function that a reduced model stores as a series.

    Attributes
    ----------
    name, unit
        Name and unit of the function.
    largest
        Scale of the function, relative to which its error is stated: its largest absolute
        value at many samples. There are three exceptions. The components of a vector share
        the largest of their scales. The scale is at least a small part of the largest scale
        of the functions with which it is compared, such as all inertias
        (`function_scales`). If these functions are zero, too, the scale is 1.
    error
        Largest measured error of the stored series, relative to `largest`.
    """

    name: str
    unit: str
    largest: float
    error: float


@dataclass(frozen=True)
class StoredLoad:
    """A load of a mechanism, as a reduced model stores it.

    A load is the sum of its components, such as the three components of a force. The power
    of a component is its magnitude times a velocity. This velocity is the rate of a pair
    variable (joint angle), or a function that the model stores for this load.

    Attributes
    ----------
    name
        Name of the load.
    works_on
        For each component the name of its velocity: a pair variable, if the velocity is the
        rate of this variable, or a stored function.
    components
        Expressions of the magnitudes in pair variables, their rates and the time. Empty if
        the load is a torque that a table gives.
    times, torques
        The times (s) and the torques (N m) of the table, if there is one.
    repeats
        Whether the table repeats after its last time.
    """

    name: str
    works_on: Names
    components: Names = ()
    times: tuple[float, ...] = ()
    torques: tuple[float, ...] = ()
    repeats: bool = False

    @property
    def table(self) -> TorqueTable | None:
        """The torque as a table, or None if it is given by expressions."""
        if self.components:
            return None
        return TorqueTable(
            name=self.name,
            pair="",  # not needed to look up a torque
            times=self.times,
            torques=self.torques,
            periodic=self.repeats,
        )


class VelocityTerm(NamedTuple):
    """A term of a torque: a factor, times a function, times the rates of two coordinates.

    A reduced model stores the function as a series over its coordinates. The sum of such
    terms is the Coriolis and centrifugal torque.

    Attributes
    ----------
    function
        Name of the stored function, such as a Christoffel symbol.
    factor
        The factor.
    first, second
        Numbers of the two coordinates whose rates are multiplied.
    """

    function: str
    factor: float
    first: int
    second: int


@dataclass(frozen=True)
class StoredHeading:
    """The heading of a reduced model with m coordinates.

    A reduced model has the functions of a mechanism that depend on the configuration alone,
    along the curve of its configurations (m = 1) or over a box of input ranges. The heading
    describes these functions; their series are stored elsewhere.

    Attributes
    ----------
    mechanism
        Name of the mechanism.
    mechanism_sha256
        SHA-256 checksum of the mechanism's file in its canonical form, in radians.
    made_by
        The version of spherekit that made the model.
    assembly_mode
        Number of the assembly mode (one of the ways to assemble the links at the same
        inputs).
    variables
        Names of all pair variables.
    angles
        Names of the R pairs.
    poles
        Names of the stored poles (axes of relative rotation of two links), as
        LINK/RELATIVE_TO.
    loads
        The loads: their magnitudes, and the stored functions by which these are multiplied.
    inputs
        Names of the driven pairs.
    by
        Names of the coordinates. Along a curve the only coordinate is "q", the variable of
        the input, if the input turns fully on a closed curve. Otherwise it is "s", the arc
        length of the curve (rad). Over a box the coordinates are the inputs.
    low, high
        (m,) range of each coordinate, rad.
    rise
        Growth of each variable over a period of a curve. Empty over a box.
    periodic
        Whether a curve is continued periodically beyond its ends.
    covered
        Share (0 to 1) of a box in which the functions are known. In the rest, the assembly
        mode does not exist, or is too near to a singularity.
    groups
        Functions that are stored together: first the functions of the motion, and along a
        curve the functions of each pole, in the order of `poles`.
    """

    mechanism: str
    mechanism_sha256: str
    made_by: str
    assembly_mode: int
    variables: Names
    angles: Names
    poles: Names
    loads: tuple[StoredLoad, ...]
    inputs: Names
    by: Names
    low: tuple[float, ...]
    high: tuple[float, ...]
    rise: tuple[float, ...] = ()
    periodic: bool = False
    covered: float = 1.0
    groups: tuple[tuple[StoredFunction, ...], ...] = ()

    @cached_property
    def is_curve(self) -> bool:
        """Whether the model is along a curve, so that its only coordinate is a number."""
        return bool(self.rise)

    @property
    def functions(self) -> tuple[StoredFunction, ...]:
        """All stored functions."""
        return tuple(chain(*self.groups))

    @property
    def _lower_triangle(self) -> list[tuple[str, str]]:
        """Names of row and column of each element of the inertia matrix up to its diagonal.

        The matrix has a row and a column for each coordinate, and is symmetric. The names
        are listed row by row.
        """
        return [(a, b) for i, a in enumerate(self.by) for b in self.by[: i + 1]]

    @property
    def inertia(self) -> list[str]:
        """Names of the stored elements of the inertia matrix, row by row to its diagonal.

        The matrix is symmetric, so the entries above the diagonal are not stored. Along a
        curve, with one coordinate, the only entry is the inertia B.
        """
        if self.is_curve:
            return ["B"]
        return [f"M {a} {b}" for a, b in self._lower_triangle]

    @property
    def velocity_terms(self) -> list[list[VelocityTerm]]:
        """The Coriolis and centrifugal terms of the torque, listed for each coordinate.

        The torque at coordinate i has the part sum c_i,ab x_a' x_b' over all a and b, with
        the rates x_a' of the coordinates and the Christoffel symbols c_i,ab of the inertia
        matrix. A reduced model stores these symbols as functions. Since c_i,ab = c_i,ba,
        only symbols with b <= a are stored. A term with b < a stands for two equal terms,
        so its factor is 2.
        """
        if self.is_curve:
            # There is one coordinate x, and the only symbol is 1/2 dB/dx with the inertia
            # B. The derivative dB/dx is stored.
            return [[VelocityTerm(self.derivative("B"), 0.5, 0, 0)]]
        names = self.by  # names of the coordinates
        terms_by_coordinate = []
        for name in names:
            terms = []
            for a in range(len(names)):
                for b in range(a + 1):
                    # The name under which the symbol is stored.
                    symbol = f"c {name} {names[a]} {names[b]}"
                    factor = 1.0 if a == b else 2.0
                    terms.append(VelocityTerm(symbol, factor, first=a, second=b))
            terms_by_coordinate.append(terms)
        return terms_by_coordinate

    def derivative(self, name: str) -> str:
        """Return the name of a function's derivative with respect to the coordinate."""
        return f"d({name})/d{self.by[0]}"

    def by_coordinates(self, name: str) -> list[str]:
        """Return the names of the stored functions that give a velocity by coordinates.

        For each coordinate the reduced model stores a function: the velocity while this
        coordinate has the rate 1 and the others rest. The velocity is the sum of these
        functions times the rates of the coordinates. A model along a curve has a single
        coordinate. Otherwise the coordinates are the driven pairs (joints), listed in `by`.

        Parameters
        ----------
        name
            A velocity of a load or a pole, or a pair variable. The velocity of a pair
            variable is its rate, so the functions are its derivatives.
        """
        is_pair_variable = name in self.variables
        if self.is_curve:
            return [self.derivative(name) if is_pair_variable else name]
        if is_pair_variable:
            return [f"d({name})/d(theta_{pair})" for pair in self.by]
        return [f"{name} by {pair}" for pair in self.by]

    def locate_function(self, name: str) -> tuple[int, int]:
        """Return the index of the group of a stored function, and its index in the group.

        The functions of a group share one series, see `groups`.

        Raises
        ------
        SolveError
            If the reduced model does not store this function.
        """
        if name not in self._locations:
            raise self._not_stored("", name, self._locations)
        return self._locations[name]

    @cached_property
    def _locations(self) -> Mapping[str, tuple[int, int]]:
        """Index of the group, and index in this group, by the name of a function."""
        return {
            function.name: (k, column)
            for k, group in enumerate(self.groups)
            for column, function in enumerate(group)
        }

    @cached_property
    def tables(self) -> list[TorqueTable]:
        """The torques that are given by tables."""
        return [load.table for load in self.loads if load.table]

    @cached_property
    def motion_symbols(self) -> list[ExpressionNode]:
        """The symbols in forces and torques that change with the motion or the time.

        All other symbols are stored functions of the configuration. These symbols are the
        rates and accelerations of the coordinates, the time, and the present torques of the
        tables.
        """
        table_torques = [self._table_torque(table.name) for table in self.tables]
        return [*self._rates, *self._accelerations, self._time, *table_torques]

    @cached_property
    def _rates(self) -> list[ExpressionNode]:
        """The symbols of the rates of the coordinates."""
        return symbols([f"rate {coordinate}" for coordinate in self.by])

    @cached_property
    def _accelerations(self) -> list[ExpressionNode]:
        """The symbols of the accelerations of the coordinates."""
        return symbols([f"acceleration {coordinate}" for coordinate in self.by])

    @cached_property
    def _time(self) -> ExpressionNode:
        """The symbol of the time."""
        return symbols(["t"])[0]

    def _table_torque(self, load_name: str) -> ExpressionNode:
        """Return the symbol of the present torque that the table of a load gives."""
        return symbols([f"table {load_name}"])[0]

    @cached_property
    def forces(self) -> list[list[Expr]]:
        """The generalised force of each load at each coordinate, as expressions.

        The first index is the load, the second the coordinate. The power of a component of
        a load is its magnitude times a velocity. The force at a coordinate is therefore the
        magnitude times this velocity per unit rate of the coordinate. The force of the load
        is the sum over its components.
        """
        forces: list[list[Expr]] = []
        for load in self.loads:
            magnitudes = self._load_magnitudes(load)
            velocities = [self._velocity_by_coordinates(name) for name in load.works_on]
            forces_of_load = []
            for i in range(len(self.by)):
                velocities_by_coordinate = [velocity[i] for velocity in velocities]
                forces_of_load.append(dot(magnitudes, velocities_by_coordinate))
            forces.append(forces_of_load)
        return forces

    def _velocity_by_coordinates(self, name: str) -> list[ExpressionNode]:
        """Return a velocity per unit rate of each coordinate, as stored functions.

        `name` is a pair variable, whose rate is the velocity, or a velocity of a load.
        """
        return [self._function_symbol(stored) for stored in self.by_coordinates(name)]

    def _load_magnitudes(self, load: StoredLoad) -> list[Expr]:
        """Return the magnitudes (N m or N) of the components of a load as expressions.

        A component is a torque or force in one direction. If a table states the torque over
        time, there is only this component.
        """
        if load.table is not None:
            return [self._table_torque(load.name)]
        return [self._convert_magnitude(text) for text in load.components]

    def _convert_magnitude(self, text: str) -> Expr:
        """Return the magnitude of a load, a text such as ``-0.2*dtheta_21``, as a graph."""
        law = parse(text, load_names(self.angles))
        nodes_by_name: dict[str, tuple[Expr, Expr]] = {}
        for name in law.names:
            value = self._load_variable(name)
            # `convert_to_graph` accepts a second value of an angle, less whole revolutions.
            # Angles of the model are not reduced, so both values are the same.
            nodes_by_name[name] = (value, value)
        return convert_to_graph(law, nodes_by_name)

    def _load_variable(self, name: str) -> Expr:
        """Return the symbolic expression for a name that a user wrote in a load.

        Names are ``theta_PAIR`` (angle of an R pair), ``dtheta_PAIR`` (its rate), and ``t``
        (time).
        """
        if name == "t":
            return self._time
        if name.startswith("dtheta_"):
            # Chain rule: derivatives of the angle with respect to the coordinates times
            # their rates.
            derivatives = self._velocity_by_coordinates(name.removeprefix("d"))
            return dot(derivatives, self._rates)
        return self._function_symbol(name)

    @cached_property
    def torques(self) -> list[Expr]:
        """The driving torque M x'' + C x' - Q for each coordinate x, as expressions.

        M is the inertia matrix, C x' the products of rates with Christoffel symbols, and Q
        the generalised force of all loads.
        """
        inertia_matrix = self._inertia_matrix
        velocity_torques = self._velocity_torques
        torques: list[Expr] = []
        for i in range(len(self.by)):
            inertia_torque = dot(inertia_matrix[i], self._accelerations)
            load_force = sum((force[i] for force in self.forces), 0.0)
            torques.append(inertia_torque + velocity_torques[i] - load_force)
        return torques

    @property
    def _inertia_matrix(self) -> NDArray[np.object_]:
        """The symmetric inertia matrix (m, m) as symbols of stored functions."""
        size = len(self.by)
        # `inertia` has the names of the entries row by row to the diagonal.
        rows, columns = np.tril_indices(size)
        entries = [self._function_symbol(name) for name in self.inertia]
        matrix = np.empty((size, size), dtype=object)
        matrix[rows, columns] = entries
        matrix[columns, rows] = entries
        return matrix

    @property
    def _velocity_torques(self) -> list[Expr]:
        """The torque at each coordinate that is quadratic in the rates, C x'."""
        velocity_torques: list[Expr] = []
        for terms in self.velocity_terms:
            rate_products = [
                self._rates[term.first] * self._rates[term.second] for term in terms
            ]
            coefficients = [
                term.factor * self._function_symbol(term.function) for term in terms
            ]
            velocity_torques.append(dot(coefficients, rate_products))
        return velocity_torques

    def _function_symbol(self, name: str) -> ExpressionNode:
        """Return the symbol of a stored function; `SolveError` if it is not stored."""
        self.locate_function(name)
        return symbols([name])[0]

    def pole(self, name: str) -> tuple[str, float]:
        """Return the name under which a pole is stored, and its sense.

        A pole is the axis about which one link rotates relative to another one. Its name is
        LINK/RELATIVE_TO. Each pole is stored for one order of the links. The sense is 1.0
        for this order. The sense is -1.0 for the other order, in which velocities have the
        opposite sign.

        Raises
        ------
        SolveError
            If the pole is not stored in either order.
        """
        exchanged = "/".join(reversed(name.split("/")))
        for stored_name, sense in ((name, 1.0), (exchanged, -1.0)):
            if stored_name in self.poles:
                return stored_name, sense
        raise self._not_stored("pole ", name, self.poles)

    def _not_stored(
        self, description: str, name: str, stored: Collection[str]
    ) -> SolveError:
        """Return the error that something is not stored in the model.

        `description` is text before the name, and `stored` has the names that are stored.
        """
        return SolveError(
            f'{self.mechanism}: {description}"{name}" is not stored'
            f"{choices(name, stored, 'Stored')}"
        )

    def reduce_to_range(self, x: float) -> tuple[float, int]:
        """Return the coordinate of a curve within its range, and the number of laps.

        The curve consists of the configurations of a mechanism. If the curve is closed, its
        functions are periodic, and whole laps can be subtracted from the coordinate x
        (rad). If not, the number of laps is 0.

        Raises
        ------
        SolveError
            If the coordinate is not finite, or beyond the ends of a curve that is not
            periodic.
        """
        # A curve has one coordinate, so its range has one lower and one upper end.
        (low,) = self.low
        (high,) = self.high
        period = high - low
        if self.periodic and math.isfinite(x):
            laps = math.floor((x - low) / period)
            return x - laps * period, laps
        # A coordinate that was computed may exceed an end by rounding.
        slack = RANGE_SLACK_RATIO * period
        if low - slack <= x <= high + slack:
            return x, 0
        raise self._domain_error(x)

    def count_laps(self, x: Floats) -> Floats:
        """Return in which lap of a curve of configurations each coordinate is.

        Functions of the coordinate are stored over one lap, from `low` to `high`, which is
        lap 0. The caller subtracts the other laps. On a periodic (closed) curve,
        coordinates beyond the ends are in further laps, with numbers below or above 0. On
        any other curve the number is 0.

        Parameters
        ----------
        x
            (n,) coordinates (rad).

        Returns
        -------
        (n,) whole numbers of laps.

        Raises
        ------
        SolveError
            If a coordinate is not finite, or beyond the ends of a curve that is not
            periodic.
        """
        (low,) = self.low
        (high,) = self.high
        is_valid = self.is_in_domain(x)
        if not np.all(is_valid):
            first_invalid = float(x[~is_valid][0])
            raise self._domain_error(first_invalid)
        if self.periodic:
            return np.floor((x - low) / (high - low))
        return np.zeros(len(x))

    def is_in_domain(self, x: Floats) -> Bools:
        """Return whether coordinates x (n,), rad, are in the domain of a curve.

        They must be finite, and within the range if the curve is not periodic.
        """
        is_valid = np.isfinite(x)
        if not self.periodic:
            (low,) = self.low
            (high,) = self.high
            # A coordinate that was computed may exceed an end by rounding.
            slack = RANGE_SLACK_RATIO * (high - low)
            is_valid &= (x >= low - slack) & (x <= high + slack)
        return is_valid

    def _domain_error(self, x: float) -> SolveError:
        """Return the error for a coordinate x that is outside the domain of a curve."""
        (low,) = self.low
        (high,) = self.high
        allowed = (
            "must be finite"
            if self.periodic
            else f"must be within {low:.9g} to {high:.9g} rad"
        )
        return SolveError(
            f"{self.mechanism}: {self.by[0]} = {x:.9g} is not in the domain of the model; "
            f"the coordinate {allowed}"
        )
