"""The heading of a reduced model: its functions, loads and coordinates without numbers.

The heading also writes forces and torques as expressions of the stored functions.
"""

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import chain

import numpy as np

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
    """Name, unit and accuracy of a function that a reduced model stores.

    Attributes
    ----------
    name, unit
        Name and unit of the function.
    largest
        Largest absolute value of the function. The components of a vector share one value.
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

    A load is the sum of its components. The power of a component is its magnitude times a
    velocity: the rate of a pair variable, or a velocity that is stored for this load.

    Attributes
    ----------
    name
        Name of the load.
    works_on
        For each component the name of this pair variable, or of this stored velocity.
    components
        Expressions of the magnitudes in pair variables, their rates and the time. Empty if
        the torque is given by a table.
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
        return TorqueTable(self.name, "", self.times, self.torques, self.repeats)


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
        The loads, as magnitudes times stored functions.
    inputs
        Names of the driven pairs.
    by
        The coordinates. Along a curve it is "q", the variable of the input, if the input
        turns fully on a closed curve. Otherwise it is "s", the arc length of the curve
        (rad). Over a box they are the inputs.
    low, high
        (m,) range of each coordinate, rad.
    rise
        Growth of each variable over a period of a curve. Empty over a box.
    periodic
        Whether a curve is continued periodically beyond its ends.
    covered
        Share of a box in which the functions are known. In the rest, the assembly mode does
        not exist, or is too near to a singularity.
    groups
        Functions that are stored together: first those of the motion, then for each pole of
        a curve its functions, in the order of `poles`.
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
        """Row and column of each entry of the inertia matrix up to its diagonal.

        Rows and columns are named by the coordinates. The matrix is symmetric, so the other
        entries are the same. The entries are listed row by row.
        """
        return [(a, b) for i, a in enumerate(self.by) for b in self.by[: i + 1]]

    @property
    def inertia(self) -> list[str]:
        """Names of the stored entries of the inertia matrix, row by row to its diagonal.

        Along a curve, with one coordinate, the only entry is the inertia B.
        """
        if self.is_curve:
            return ["B"]
        return [f"M {a} {b}" for a, b in self._lower_triangle]

    @property
    def christoffel(self) -> list[dict[str, float]]:
        """Names and factors of the stored Christoffel symbols, for each coordinate.

        Christoffel symbols c_i,ab are derivatives of the inertia matrix. With the rates
        x_a' of the coordinates, they give the part of the torque at coordinate i that is
        quadratic in the rates: the sum of c_i,ab x_a' x_b' over all a and b. Because c_i,ab
        = c_i,ba, only the symbols with b up to a are stored. The factor of a symbol is 1.0
        if a is b, and 2.0 otherwise, because the symbol stands for two terms of the sum.

        Along a curve there is one coordinate x, and the only symbol is 1/2 dB/dx with the
        inertia B. The derivative dB/dx is stored, so its factor is 0.5.
        """
        if self.is_curve:
            return [{self.derivative("B"): 0.5}]
        return [
            {
                f"c {coordinate} {a} {b}": 1.0 if a == b else 2.0
                for a, b in self._lower_triangle
            }
            for coordinate in self.by
        ]

    def derivative(self, name: str) -> str:
        """Return the name of the derivative of a function by the only coordinate."""
        return f"d({name})/d{self.by[0]}"

    def by_coordinates(self, name: str) -> list[str]:
        """Return the names under which derivatives by each coordinate are stored.

        Parameters
        ----------
        name
            A pair variable, or a velocity of a load. Such a velocity is a rate already:
            its value per unit rate of each coordinate is stored.
        """
        if name not in self.variables:
            return [name] if self.is_curve else [f"{name} by {pair}" for pair in self.by]
        if self.is_curve:
            return [self.derivative(name)]
        return [f"d({name})/d(theta_{pair})" for pair in self.by]

    def locate_function(self, name: str) -> tuple[int, int]:
        """Return the index of the group of a function, and its index within the group.

        The functions of a group are stored together, see `groups`.

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
        """The index of the group and the index within it, by the name of a function."""
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
        """The symbols in `forces` and `torques` that are not stored functions.

        These are the rates and the accelerations of the coordinates, the time, and the
        present torques of the `tables`.
        """
        coordinate_names = [
            f"{quantity} {coordinate}"
            for quantity in ("rate", "acceleration")
            for coordinate in self.by
        ]
        table_names = [f"table {table.name}" for table in self.tables]
        return symbols([*coordinate_names, "t", *table_names])

    @cached_property
    def forces(self) -> list[list[Expr]]:
        """The generalised forces of each load by each coordinate, as expressions.

        A load is a sum of components. The force of a load by a coordinate is therefore a
        sum over its components: the magnitude times the velocity on which the component
        works, per unit rate of the coordinate. Angles, velocities and derivatives in these
        expressions are symbols of functions that the model stores.
        """
        names = load_names(self.angles)
        # `by` are the names of the coordinates.
        coordinate_count = len(self.by)
        # `motion_symbols` are the rates, then the accelerations of all coordinates, then
        # the time.
        rates = self.motion_symbols[:coordinate_count]
        time = self.motion_symbols[2 * coordinate_count]

        def named_value(name: str) -> Expr:
            """Return the value of a name in the expression of a load.

            Names are ``theta_PAIR`` (angle of an R pair), ``dtheta_PAIR`` (its rate), and
            ``t`` (time).
            """
            if name.startswith("dtheta_"):
                # The chain rule: derivatives of the angle by the coordinates times rates.
                # `by_coordinates` returns the names of the derivatives.
                angle_name = name.removeprefix("d")
                derivatives = self.by_coordinates(angle_name)
                return dot(map(self._function_symbol, derivatives), rates)
            return time if name == "t" else self._function_symbol(name)

        forces: list[list[Expr]] = []
        for load in self.loads:
            magnitudes: list[Expr] = []
            for text in load.components:
                law = parse(text, names)
                # `convert_to_graph` takes two values for each name: the second one replaces
                # it in sines and cosines. Here both are the same.
                values = {}
                for name in law.names:
                    value = named_value(name)
                    values[name] = (value, value)
                magnitudes.append(convert_to_graph(law, values))
            # A load without expressions is a torque that a table gives over time. Its
            # present value is one symbol.
            if not magnitudes:
                magnitudes = [*symbols([f"table {load.name}"])]
            # Row: component of the load; column: the velocity on which it works, per unit
            # rate of a coordinate.
            velocities = [
                [self._function_symbol(name) for name in self.by_coordinates(variable)]
                for variable in load.works_on
            ]
            velocities_by_coordinate = zip(*velocities, strict=True)
            forces.append([dot(magnitudes, column) for column in velocities_by_coordinate])
        return forces

    @cached_property
    def torques(self) -> list[Expr]:
        """The driving torque M x'' + C x' - Q for each coordinate, as expressions.

        M is the inertia matrix, C x' the products of rates with Christoffel symbols, and Q
        the generalised force of all loads. The entries of M and the Christoffel symbols are
        symbols of functions that the model stores.
        """
        coordinate_count = len(self.by)
        # `motion_symbols` starts with the rates, then the accelerations of the coordinates.
        rates = self.motion_symbols[:coordinate_count]
        accelerations = self.motion_symbols[coordinate_count : 2 * coordinate_count]
        # Symmetric matrices are stored row by row to their diagonals. `self.inertia` has
        # the names of the entries of M in this order.
        first, second = np.tril_indices(coordinate_count)
        rate_products = [rates[a] * rates[b] for a, b in zip(first, second, strict=True)]
        M = np.empty((coordinate_count, coordinate_count), dtype=object)
        M[first, second] = M[second, first] = list(map(self._function_symbol, self.inertia))
        torques: list[Expr] = []
        for i, factor_by_symbol in enumerate(self.christoffel):
            # The Christoffel symbols of coordinate i, in the order of `rate_products`. The
            # factor of a symbol off the diagonal is 2, because it stands for two entries.
            symbols_of_row = [
                factor * self._function_symbol(name)
                for name, factor in factor_by_symbol.items()
            ]
            inertia_torque = dot(M[i], accelerations) + dot(symbols_of_row, rate_products)
            load_force = sum((force[i] for force in self.forces), 0.0)
            torques.append(inertia_torque - load_force)
        return torques

    def _function_symbol(self, name: str) -> ExpressionNode:
        """Return the symbol of a stored function; `SolveError` if it is not stored."""
        self.locate_function(name)
        return symbols([name])[0]

    def pole(self, name: str) -> tuple[str, float]:
        """Return the name under which a pole is stored, and its sense.

        A pole is the axis about which one link rotates relative to another one. Its name is
        LINK/RELATIVE_TO. The sense is 1.0, or -1.0 if the pole is stored with the two links
        exchanged, so that its velocities have the opposite sign.

        Raises
        ------
        SolveError
            If it is not stored.
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

        If the curve is periodic, whole laps are subtracted from the coordinate x (rad). The
        second value is the number of these laps, otherwise 0.

        Raises
        ------
        SolveError
            If the coordinate is not finite, or beyond the ends of a curve that is not
            periodic.
        """
        (low,) = self.low
        (high,) = self.high
        period = high - low
        if self.periodic and math.isfinite(x):
            laps = math.floor((x - low) / period)
            return x - laps * period, laps
        slack = RANGE_SLACK_RATIO * period
        if low - slack <= x <= high + slack:
            return x, 0
        allowed = (
            "must be finite"
            if self.periodic
            else f"must be within {low:.9g} to {high:.9g} rad"
        )
        raise SolveError(
            f"{self.mechanism}: {self.by[0]} = {x:.9g} is not in the domain of the model; "
            f"the coordinate {allowed}"
        )
