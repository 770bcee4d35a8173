"""Evaluates reduced models: a mechanism's stored functions, without the mechanism.

`spherekit.dynamics.reduced_model_maker` computes everything that depends on the
configuration alone (Di Gregorio 2024, section 4), along one curve or over a box of several
inputs. This module evaluates the stored functions, for example in control loops. It needs
only NumPy and the standard library.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property, partial
from itertools import chain
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from spherekit.argument_validation import checked
from spherekit.arrays import Floats, SmallIntegers
from spherekit.conventions import AnyPath, Facts, Names
from spherekit.dynamics.reduced_model_heading import (
    StoredFunction,
    StoredHeading,
    StoredLoad,
)
from spherekit.errors import FileError, ModelError, SolveError
from spherekit.geometry.vectors import all_finite
from spherekit.mechanism.load_expression import load_names, parse
from spherekit.mechanism.load_kinds import DRIVE_LOAD_NAME
from spherekit.numerics.chebyshev import PiecewiseChebyshev
from spherekit.numerics.local_polynomials import make_local_polynomials
from spherekit.numerics.tensor_chebyshev import CellSums, TensorChebyshev
from spherekit.numerics.zeros import find_zeros
from spherekit.status import Status
from spherekit.storage.numpy_archive import ArchiveFormat, read_archive, write_archive
from spherekit.symbolic.expression_evaluation import (
    ArrayFunction,
    FloatFunction,
    array_function,
    float_function,
)
from spherekit.symbolic.expression_graph import ExpressionNode, iterate_nodes, symbols
from spherekit.tolerances import EPS
from spherekit.wording import choices, listing

MODEL_FORMAT = ArchiveFormat("spherekit reduced model", 2, "write one with `--to model`")
"""The format of the files of reduced models."""

LAYOUT = (
    "groups[k] lists the functions in the columns of arrays of that number. Along a curve "
    "row c of coefficients_k holds their Chebyshev series from edges_k[c] to "
    "edges_k[c + 1]; a periodic model repeats with the period high - low, in which the "
    "variables grow by rise. Over a box column f of coefficients_k[c] holds the tensor "
    "Chebyshev series of function f between bounds_k[c, 0] and bounds_k[c, 1]; splits_k "
    "are the halvings of the box, (direction, place, next below, next above), where -1 - c "
    "is cell c and 0 is outside the domain"
)
"""Description of the arrays of a model, which is stored in each file of a model."""

ZERO_SEARCH_DIVISIONS = 8
"""Number of parts into which each cell is divided to search for zeros of a variable.

Larger: two zeros that are closer together are both found.
"""

SINGLE_TYPES = (float, int)
"""Types of a single coordinate. A tuple is tested in less time than a union."""

Coordinate = TypeVar("Coordinate", float, Floats)

SingleFunction = Callable[[Any], list[float]]
"""A function of one point that returns the values of some stored functions as a list."""


@dataclass(frozen=True)
class StoredModel:
    """Stored functions of a mechanism in one assembly mode, such as its inertia.

    These functions replace the mechanism, for example in a controller. An assembly mode is
    one way to assemble the links. With one coordinate the functions are stored along the
    curve of configurations, with m coordinates over a box of their ranges.

    A point is a number along a curve, and a sequence (m,) over a box. Most methods take one
    point, which is fast, or many points: an array of any shape along a curve, and an array
    (n, m) over a box.

    If a curve is periodic, coordinates beyond its ends are in further laps. Other models
    are not defined outside their range.

    Attributes
    ----------
    heading
        Names of the functions, loads and ranges.
    groups
        The Chebyshev series of each group of functions in the heading.
    """

    heading: StoredHeading
    groups: tuple[PiecewiseChebyshev | TensorChebyshev, ...]

    def __getstate__(self) -> Facts:
        # Cached functions and their expressions are not pickled.
        return {"heading": replace(self.heading), "groups": self.groups}

    @property
    def error(self) -> float:
        """The greatest error of the stored functions.

        The measured error of each function is relative to its scale
        (`StoredFunction.largest`).
        """
        return max(function.error for function in self.heading.functions)

    def torque(self, x: Any, dx: Any, ddx: Any, t: Any = 0.0) -> Any:
        """Return the torques (N m) that a motion needs while all loads act.

        The torques are M x'' + C x' - Q, with the inertia matrix M, the Coriolis and
        centrifugal torques C x' and the generalised forces Q of all loads. With one
        coordinate, this is B x'' + 1/2 dB/dx x'^2 - Q with the inertia B (Di Gregorio 2024,
        eq. (21)). If the coordinates are the inputs, the torques act at the inputs. If the
        coordinate is the arc length s of the curve of configurations, divide the torque by
        dv/ds of a pair variable v to obtain the torque at this pair.

        Parameters
        ----------
        x, dx, ddx
            Coordinates (rad) and their first and second time derivatives. A model of one
            coordinate is along a curve: a point is a number, and an array of any shape is
            many points. A model of m inputs is over a box of their ranges: a point is a
            sequence (m,), and an array (n, m) is many points.
        t
            Time (s), for loads that depend on time.

        Returns
        -------
        One torque per point along a curve, and m torques per point over a box.

        Raises
        ------
        SolveError
            At a point outside the domain, or if `dx` or `ddx` do not have m columns.
            Torques at many points over a box are NaN at points outside the domain.
        """
        if isinstance(t, SINGLE_TYPES) and self._is_single(x, dx, ddx):
            # Computing with numbers takes less time than with arrays. The stored functions
            # (inertia, its derivatives, load velocities) come first, then the torques.
            configuration_values = self.evaluate_configuration(x)
            return self.torque_from_values(configuration_values, x, dx, ddx, t)
        points = self._flatten_points(x, dx, ddx, t=t)
        # (m, n) torques at all n points.
        torque_rows = self._torque_function(self._arguments(points))
        return self._restore_shape(torque_rows.T, points.shape)

    def forces(self, x: ArrayLike, dx: ArrayLike, t: ArrayLike = 0.0) -> dict[str, Floats]:
        """Return the generalised forces Q (N m) of each load, by the name of the load.

        Parameters
        ----------
        x, dx
            Coordinates of the model (rad) at one or more points, and their time
            derivatives.
        t
            Time (s), for loads that depend on time.

        Returns
        -------
        For each load an array with the shape of `x`. In a model over a box of several
        inputs, the last axis is the coordinate to which a force belongs.
        """
        # The arguments include accelerations, on which forces do not depend. Any array of
        # this shape will do.
        any_accelerations = dx
        points = self._flatten_points(x, dx, any_accelerations, t=t)
        # The heading describes the model, with its loads and its coordinates (`by`).
        loads = self.heading.loads
        force_rows = self._force_function(self._arguments(points))
        # The axes are: load, coordinate, point.
        forces = force_rows.reshape(len(loads), len(self.heading.by), len(points.t))
        return {
            load.name: self._restore_shape(load_forces.T, points.shape)
            for load, load_forces in zip(loads, forces, strict=True)
        }

    def _arguments(self, points: "PointRows") -> Floats:
        """Return the arguments (k, n) of the expressions of forces and torques at n points.

        A point is a value of the m coordinates. The rows are the stored functions of group
        0 (those of the motion), the rates and accelerations of the coordinates, the time,
        and the present torques of the loads given by tables.
        """
        functions = self._evaluate_group(0, points.coordinates)
        rate_rows = [row for rates in points.derivatives for row in rates.T]
        table_torques = [table.at(points.t) for table in self.heading.tables]
        return np.array([*functions.T, *rate_rows, points.t, *table_torques])

    @cached_property
    def _torque_function(self) -> ArrayFunction:
        """Function that returns the driving torques (m, n), N m, at n points.

        There is one torque for each of the m coordinates. The argument is the array (k, n)
        of the method `_arguments`: stored functions, rates, accelerations, times and
        torques of tables at the points.
        """
        return array_function(self.heading.torques, self._symbols)

    @cached_property
    def _force_function(self) -> ArrayFunction:
        """Function that returns the generalised forces (N m) of all loads, (loads * m, n).

        At n points, the rows are the forces of the first load at the m coordinates, then
        the forces of the next load. The argument is the array (k, n) of the method
        `_arguments`: stored functions, rates, accelerations, times and torques of tables at
        the points.
        """
        return array_function([*chain(*self.heading.forces)], self._symbols)

    @property
    def _symbols(self) -> list[ExpressionNode]:
        """The symbols of the rows (k) of the arguments of forces and torques, in order."""
        names = (function.name for function in self.heading.groups[0])
        return [*symbols(names), *self.heading.motion_symbols]

    def value(self, name: str, x: Any) -> Any:
        """Return the values of one stored function at one point or at many points.

        `name` is one of the names in `heading.functions`.

        A point is a coordinate along a curve, or (m,) inputs.
        """
        if self._is_single(x):
            return self._single_function(name)(x)[0]
        return self.functions([name], x)[..., 0]

    def functions(self, names: Sequence[str], x: ArrayLike) -> Floats:
        """Return the values (..., k) of k stored functions at many points.

        Parameters
        ----------
        names
            Names of the functions. All of them must belong to one group (functions whose
            series are stored together): the functions of the motion, or those of one pole
            (axis of the relative rotation of two links).
        x
            The points. Along a curve of configurations each point has one coordinate, and
            the shape of `x` is (...). Over a box of the ranges of m inputs the shape is
            (n, m), or (m,) for one point.

        Raises
        ------
        SolveError
            If a function is not stored, functions belong to different groups, or points
            have a wrong shape or are outside the domain.
        """
        points = self._flatten_points(x)
        # Without names, no function is selected below, so any group will do.
        group = self.heading.locate_function(names[0])[0] if len(names) else 0
        values = self._evaluate_group(group, points.coordinates)
        selected = values[:, self._indices_in_group(names)]
        # `points.shape` is (..., m), the shape of the coordinates before they were
        # flattened; m is 1 on a curve.
        shape_of_points = points.shape[:-1]
        return selected.reshape(*shape_of_points, len(names))

    def inertia(self, x: Any) -> Any:
        """Return the inertia matrix (..., m, m) in kg m2; along a curve the number B."""
        if self.heading.is_curve:
            return self.value("B", x)
        # The entries up to the diagonal are stored, row by row. The matrix is symmetric.
        i, k = np.tril_indices(len(self.heading.by))
        M = np.empty((*np.shape(x), len(self.heading.by)))
        M[..., i, k] = M[..., k, i] = self.functions(self.heading.inertia, x)
        return M

    def inertia_rate(self, x: Coordinate) -> Coordinate:
        """Return dB/dx (kg m2/rad) along a curve."""
        return self.value(self.heading.derivative("B"), x)

    def accelerations(
        self, q: ArrayLike, dq: ArrayLike, torques: ArrayLike, t: float = 0.0
    ) -> Floats:
        """Return the accelerations (..., m) of the m coordinates (rad/s2).

        The accelerations solve M q'' = T - T_0. M is the inertia matrix, T are the torques
        at the inputs, and T_0 the torques that the motion would need without acceleration.

        Parameters
        ----------
        q, dq
            Coordinates (rad) and their rates (rad/s) at one or more points. A model of one
            coordinate is along a curve: a point is a number, and an array (...) is many
            points. A model of m inputs is over a box of their ranges: a point has the shape
            (m,), and an array (n, m) is many points.
        torques
            Torques T (N m) at the coordinates, with the shape of `q`. For one point along a
            curve, the shape (1,) is also possible.
        t
            Time (s), for loads that depend on time.

        Raises
        ------
        SolveError
            If the inertia matrix is singular, or a single point is outside the domain.
        """
        no_accelerations: Any = np.zeros(np.shape(q))
        if self._is_single(q):
            # Numbers take less time than arrays.
            no_accelerations = no_accelerations.tolist()
        needed_torques = self.torque(q, dq, no_accelerations, t)
        accelerating_torques = np.asarray(torques) - needed_torques
        inertia = self.inertia(q)
        if self.heading.is_curve:
            # Numbers become vectors and matrices of one coordinate.
            accelerating_torques = np.reshape(accelerating_torques, (*np.shape(q), 1))
            inertia = np.asarray(inertia)[..., None, None]
        # Points outside the domain of a box have NaN, with which no eigenvalues exist.
        inside = inertia[all_finite(inertia, (-2, -1))]
        if np.any(np.linalg.eigvalsh(inside)[..., 0] <= self._min_inertia):
            raise SolveError(
                f"{self.heading.mechanism}: the inertia matrix is singular, so the "
                "accelerations are not determined"
            )
        return np.linalg.solve(inertia, accelerating_torques[..., None])[..., 0]

    @cached_property
    def _min_inertia(self) -> float:
        """Limit (kg m2) up to which an eigenvalue of the inertia matrix may be zero.

        An eigenvalue of a symmetric matrix (m, m) whose elements have errors up to e has an
        error of at most m e.
        """
        elements = {*self.heading.inertia}
        largest_error = max(
            (function.error + EPS) * function.largest
            for function in self.heading.groups[0]
            if function.name in elements
        )
        return len(self.heading.by) * largest_error

    def status(self, q: ArrayLike) -> SmallIntegers:
        """Return the status (n,) of points: OK, or OUT_OF_REACH outside the domain."""
        if self.heading.is_curve:
            is_inside = self.heading.is_in_domain(np.asarray(q, dtype=float).ravel())
        else:
            points = self._flatten_points(np.atleast_2d(q))
            # Outside the domain of a box all functions are NaN.
            values = self._evaluate_group(0, points.coordinates)
            is_inside = np.isfinite(values[:, 0])
        return np.where(is_inside, Status.OK, Status.OUT_OF_REACH).astype(np.int8)

    def pole(self, name: str, x: ArrayLike) -> Floats:
        """Return the unit vector (3,) or (..., 3) of a pole axis along a curve.

        A pole axis is the instantaneous axis of the motion of one link relative to another
        one. The curve consists of the configurations of a mechanism with one coordinate.
        The components of the vector are in ground axes.

        Parameters
        ----------
        name
            LINK/RELATIVE_TO, such as "3/1". Both orders of the links name the same axis.
        x
            Coordinate of a point of the curve (rad), or coordinates (...) of many points.
        """
        # A pole is stored for one order of its links.
        stored_name, _ = self.heading.pole(name)
        names = [f"pole {stored_name} {axis}" for axis in "xyz"]
        if self._is_single(x):
            # A function for a single point, which takes less time than arrays.
            return np.array(self._single_function(*names)(x))
        return self.functions(names, x)

    def rate(self, name: str, x: Coordinate) -> Coordinate:
        """Return the velocity coefficient of a pole along a curve of configurations.

        The curve consists of the configurations of a mechanism with one coordinate, x. A
        pole is the axis about which two links rotate relative to each other. The velocity
        coefficient is the angular velocity about the pole, per unit rate of the coordinate
        x. The coefficient times the unit vector of the pole is the angular velocity of the
        first link relative to the second, per unit rate of x.

        Parameters
        ----------
        name
            LINK/RELATIVE_TO, such as "3/1".
        x
            Coordinate of a point of the curve (rad), or coordinates (...) of many points.
        """
        # A pole is stored for one order of its links. For the other order, the sense is -1.
        stored_name, sense = self.heading.pole(name)
        return sense * self.value(f"rate {stored_name}", x)

    def rate_derivative(self, name: str, x: Coordinate) -> Coordinate:
        """Return the acceleration coefficient of a pole, the x derivative of `rate`."""
        stored_name, sense = self.heading.pole(name)
        return sense * self.value(self.heading.derivative(f"rate {stored_name}"), x)

    def velocity(self, pole: str, q: ArrayLike) -> Floats:
        """Return the angular velocity of a link relative to another, for each of m inputs.

        This method is for a model over a box, which the ranges of the m inputs form.

        Parameters
        ----------
        pole
            The two links, LINK/RELATIVE_TO, such as "3/1".
        q
            (..., m) inputs, rad.

        Returns
        -------
        (..., m, 3) angular velocities of the first link relative to the second per unit
        rate of each input, in ground axes. Each vector is along the pole (the instantaneous
        axis of rotation) while this input moves alone. Its length is the velocity
        coefficient.
        """
        # A pole is stored for one order of its links. For the other order, the sense is -1.
        stored_name, sense = self.heading.pole(pole)
        # For each component x, y, z the names of the stored functions, one for each input.
        names_by_axis = [
            self.heading.by_coordinates(f"velocity {stored_name} {axis}") for axis in "xyz"
        ]
        # Put the three components of each input next to each other.
        names: list[str] = []
        for names_of_input in zip(*names_by_axis, strict=True):
            names += names_of_input
        return sense * self.functions(names, q).reshape(*np.shape(q), 3)

    def places(self, variable: str, value: float) -> Floats:
        """Return the coordinates (k,) at which a pair variable has a certain value.

        The model has one coordinate, along the curve of configurations: the arc length of
        this curve or the variable of the input. The result is in rising order. On a closed
        curve it covers one lap, and both ends are the same place.

        Parameters
        ----------
        variable
            Name of a pair variable (joint angle), such as "theta_21" for the angle of the R
            pair (revolute joint) 21.
        value
            Value of the variable (rad). Angles that differ from it by whole revolutions
            count as equal.

        Raises
        ------
        SolveError
            If there is no such variable, or the value is not finite.
        """
        heading = self.heading
        # Stored functions are in groups. Group 0 has the functions of the motion.
        series = self.groups[0]
        if variable not in heading.variables:
            raise SolveError(
                f'{heading.mechanism}: "{variable}" is not a pair variable'
                f"{choices(variable, heading.variables, 'Variables')}"
            )
        if not np.isfinite(value):
            raise SolveError(
                f"{heading.mechanism}: the value of {variable} must be finite, found "
                f"{value}"
            )
        # Columns of the variable and of its derivative with respect to the coordinate.
        variable_columns = self._indices_in_group((variable, heading.derivative(variable)))
        assert isinstance(series, PiecewiseChebyshev)
        is_angle = variable in {f"theta_{pair}" for pair in heading.angles}

        def evaluate_distance(x: Floats) -> tuple[Floats, Floats]:
            """Return a number that is 0 where a variable has `value`, and its derivative.

            Number and derivative have the shape (k,), for k coordinates x along the curve
            of configurations. The derivative is with respect to x. Zeros of the number are
            the places that are searched.
            """
            # The variable, and its derivative with respect to x.
            values, rates = series.evaluate(x)[:, variable_columns].T
            half_difference = 0.5 * (values - value)
            if is_angle:
                # The sine of half the difference is zero wherever the angle differs from
                # `value` by a whole number of revolutions.
                sines = np.sin(half_difference)
                return sines, 0.5 * np.cos(half_difference) * rates
            # The variable is the arc length of a contact, which has no revolutions. Any
            # multiple of the difference is zero at the same places.
            return half_difference, 0.5 * rates

        # Zeros are sought between neighbouring positions of this grid, which has several
        # positions in each cell (interval with a series of its own).
        search_grid = series.spread_positions(ZERO_SEARCH_DIVISIONS)
        zeros = find_zeros(evaluate_distance, search_grid)
        if heading.periodic:
            # Both ends of a closed curve are the same configuration.
            zeros = zeros.merge_seam(heading.high[0])
        return zeros.places

    @checked(ModelError)
    def with_torque(self, torque: str | Mapping[str, str]) -> "StoredModel":
        """Return a copy of the model with further loads: torques (N m) at inputs.

        A model has a heading, which lists its inputs, loads and stored functions. The
        functions depend on the configuration, and are stored as Chebyshev series. A torque
        at an input needs no further function. So only the heading changes.

        Parameters
        ----------
        torque
            The torque at the first input: an expression in pair variables (joint angles),
            their rates and the time, in the syntax of mechanism files. Or a mapping: an
            expression for each driven input, by the name of the input.

        Raises
        ------
        ModelError
            If an expression is no text or breaks the grammar, if there is no such input,
            or if an input has such a torque already.
        """
        heading = self.heading
        if isinstance(torque, str):
            torque = {heading.inputs[0]: torque}
        loads = list(heading.loads)
        for pair, text in torque.items():
            if pair not in heading.inputs:
                raise ModelError(
                    f'{heading.mechanism}: torque: "{pair}" is not an input'
                    f"{choices(pair, heading.inputs, 'Inputs')}"
                )
            # With one input the model is along a curve of configurations. The name of the
            # load then need not name the input.
            name = DRIVE_LOAD_NAME if heading.is_curve else f"{DRIVE_LOAD_NAME}_{pair}"
            if any(load.name == name for load in loads):
                raise ModelError(
                    f"{heading.mechanism}: torque: the model already has a "
                    "driving torque; leave this one out"
                )
            try:
                # `parse` only checks the expression here. The load stores the text.
                parse(text, load_names(heading.angles))
            except ModelError as error:
                raise ModelError(
                    f"{heading.mechanism}: torque: in the expression, {error}"
                ) from None
            # The power of the load is the torque times the rate of this variable.
            loads.append(StoredLoad(name, (f"theta_{pair}",), (text,)))
        # `self.groups` are the series of the functions, which stay the same.
        return StoredModel(replace(heading, loads=tuple(loads)), self.groups)

    def save(self, path: AnyPath) -> None:
        """Write the model to a NumPy archive (.npz) that describes itself.

        The model stores functions of the configuration, such as the inertia, from which the
        torques of a motion are computed. The archive has a heading as text, which describes
        them, and arrays with their Chebyshev series.

        The domain of a function is divided into cells, each with its own series. Functions
        with the same cells form a group. Group k has arrays such as "coefficients_k".

        Raises
        ------
        OutputError
            If the file can't be written; an older file is then unchanged.
        """
        array_names = _array_names(self.heading)
        arrays = {
            f"{name}_{k}": getattr(group, name)
            for k, group in enumerate(self.groups)
            for name in array_names
        }
        heading = {**asdict(self.heading), "layout": LAYOUT}
        write_archive(path, MODEL_FORMAT, heading, arrays)

    @cached_property
    def evaluate_configuration(self) -> SingleFunction:
        """Function that returns, at a point, the stored functions on which torques depend.

        These functions depend on the configuration alone, such as the inertia. With one
        coordinate x, the first two values are the inertia B and its derivative dB/dx, which
        simulations use. `torque_from_values` computes the torques from these values and
        from the motion.
        """
        # The first argument of a symbol is its name.
        names = (symbol.arguments[0] for symbol in self._configuration_symbols)
        return self._single_function(*names)

    @cached_property
    def _evaluate_torques(self) -> FloatFunction:
        """Function that returns the torques at one point, as a list of floats.

        A point is a value of the coordinates. The argument is one list: the values of
        `evaluate_configuration`, then the rates, the accelerations, the time, and the
        present torques of the loads that are tables over time.
        """
        heading = self.heading
        return float_function(
            heading.torques, [*self._configuration_symbols, *heading.motion_symbols]
        )

    @cached_property
    def _configuration_symbols(self) -> list[ExpressionNode]:
        """Symbols of the stored functions in the expressions of the torques, each once.

        Stored functions depend on the configuration alone, such as the inertia. The model
        has their Chebyshev series. The torques are expressions of these functions and of
        the motion. `evaluate_configuration` returns the values of the functions in the
        order of these symbols. `_evaluate_torques` takes the values in the same order.
        """
        heading = self.heading
        if heading.is_curve:
            # There is one coordinate x. The inertia B and dB/dx come first, because
            # simulations take the first two values of `evaluate_configuration` as these.
            first_symbols = symbols(["B", heading.derivative("B")])
        else:
            first_symbols = []
        # Symbols come in the order in which they first occur.
        nodes = iterate_nodes([*first_symbols, *heading.torques])
        configuration_symbols = []
        for node in nodes:
            is_symbol = node.operation == "variable"
            # The motion symbols are rates, accelerations, the time, and the present torques
            # of loads that are tables over time. All others are stored functions.
            is_stored_function = node not in heading.motion_symbols
            if is_symbol and is_stored_function:
                configuration_symbols.append(node)
        return configuration_symbols

    def torque_from_values(
        self, configuration_values: list[float], x: Any, dx: Any, ddx: Any, t: Any
    ) -> Any:
        """Return the torques (N m) that a motion needs at one point, while all loads act.

        The torques are those of `torque`, which calls this method. Simulations call it
        directly, because they already have the values of the stored functions at the point.

        Parameters
        ----------
        configuration_values
            The values of `evaluate_configuration` at this point, such as the inertia.
        x, dx, ddx
            Coordinates (rad) and their first and second time derivatives. In a model with
            one coordinate they are numbers. In a model with m coordinates they are
            sequences (m,).
        t
            Time (s), for loads that depend on time.

        Returns
        -------
        One torque if the model has one coordinate, otherwise an array (m,).
        """
        has_one_coordinate = self.heading.is_curve
        rates = (dx, ddx) if has_one_coordinate else (*dx, *ddx)
        # The present torques of loads that are tables over time.
        table_torques = [float(table.at(t)) for table in self.heading.tables]
        try:
            torques = self._evaluate_torques(
                [*configuration_values, *rates, t, *table_torques]
            )
        except (ValueError, ArithmeticError):
            # Python floats raise errors where arrays become infinite or NaN. Arrays of one
            # row give the infinite or NaN result.
            rows = [np.array([argument], dtype=float) for argument in (x, dx, ddx, t)]
            torque_rows = self.torque(*rows)
            return torque_rows[0]
        return torques[0] if has_one_coordinate else np.array(torques)

    @cached_property
    def _single_functions(self) -> dict[Names, SingleFunction]:
        """Cache of the functions that `_single_function` has created.

        A key has the names of some stored functions of the model. The value is a function
        that evaluates them at one point.
        """
        return {}

    def _single_function(self, *names: str) -> SingleFunction:
        """Return a Python function that evaluates some stored functions at one point.

        `names` are the names of these stored functions. All belong to one group (functions
        that share a series). A point is a value of the coordinates.
        """
        if names not in self._single_functions:
            group, _ = self.heading.locate_function(names[0])
            unit_factors = np.eye(len(self.heading.groups[group]))
            factors = unit_factors[:, self._indices_in_group(names)]
            self._single_functions[names] = self.combine_functions(group, factors)
        return self._single_functions[names]

    def _is_single(self, *points: Any) -> bool:
        """Return whether all arguments are one point, and not arrays of many points."""
        if self.heading.is_curve:
            return all(isinstance(x, SINGLE_TYPES) for x in points)
        # Over a box a single point is a sequence of m numbers.
        m = len(self.heading.by)
        try:
            for x in points:
                if not (len(x) == m and isinstance(x[0], SINGLE_TYPES)):
                    return False
        except TypeError:  # a number has no length
            return False
        return True

    def _flatten_points(
        self, coordinates: ArrayLike, *derivatives: ArrayLike, t: ArrayLike = 0.0
    ) -> "PointRows":
        """Return points of the model as rows, one for each point.

        A user may pass one point, or arrays of points with several axes. The stored
        functions take rows only. Coordinates, derivatives and times are broadcast together
        by the rules of NumPy.

        Parameters
        ----------
        coordinates
            The coordinates (rad). A model along a curve has a single coordinate, in any
            shape (...). Otherwise the m inputs are the coordinates, with the shape (n, m),
            or (m,) for one point.
        derivatives
            Rates and accelerations of the coordinates, or none. Each has the same axes as
            the coordinates, or is one number for all.
        t
            Times, s.

        Raises
        ------
        SolveError
            If the array of m inputs, or of their derivatives, has a wrong shape. Also if
            one point of shape (m,) is passed, and is outside the domain. Points in other
            arrays are not compared with the domain here.
        """
        arrays = [np.asarray(x, dtype=float) for x in (coordinates, *derivatives)]
        if self.heading.is_curve:
            # The points of all models get a last axis for coordinates, here m = 1.
            arrays = [array[..., None] for array in arrays]
        else:
            self._check_inputs(arrays[0])
            m = len(self.heading.by)
            for array in arrays[1:]:
                # NumPy would repeat a single rate for all inputs.
                if array.ndim > 0 and array.shape[-1] != m:
                    raise SolveError(
                        f"{self.heading.mechanism}: rates and accelerations must be given "
                        f"as arrays of shape (n, {m}), found the shape {array.shape}"
                    )
        # A last axis of length 1, so that the time is the same for all m coordinates.
        times = np.asarray(t, dtype=float)[..., None]
        shape = np.broadcast_shapes(times.shape, *(array.shape for array in arrays))
        coordinate_rows, *derivative_rows = (
            np.broadcast_to(array, shape).reshape(-1, shape[-1]) for array in arrays
        )
        return PointRows(
            coordinates=coordinate_rows,
            derivatives=derivative_rows,
            t=np.broadcast_to(times, (*shape[:-1], 1)).reshape(-1),
            shape=shape,
        )

    def _check_inputs(self, inputs: Floats) -> None:
        """Raise an error unless inputs have the shape (n, m), or (m,) within the domain.

        This is for a model over a box of m inputs. A single point (m,) outside the domain
        is an error. Many points (n, m) are not compared with the domain here, because the
        stored functions become NaN outside.

        Raises
        ------
        SolveError
            If the inputs have another shape, or the single point is outside the domain.
        """
        # The heading describes the model; its entry `by` has the names of the m
        # coordinates.
        heading = self.heading
        m = len(heading.by)
        if inputs.ndim not in (1, 2) or inputs.shape[-1] != m:
            raise SolveError(
                f"{heading.mechanism}: the inputs {listing(heading.inputs)} must be given "
                f"as an array of shape (n, {m}), found the shape {inputs.shape}"
            )
        if inputs.ndim == 1:
            # This raises the error of a point outside the domain.
            self._find_cell(inputs.tolist())

    def _restore_shape(self, values: Floats, shape: tuple[int, ...]) -> Floats:
        """Return torques or forces in the shape in which the caller passed the points.

        A point has m coordinates, and a value for each of them, such as the torque at an
        input. Along a curve there is a single coordinate, and the caller's array (...) has
        no axis for coordinates.

        Parameters
        ----------
        values
            (n, m) values at the n points, which were flattened to rows.
        shape
            Shape (..., m) of the coordinates of the points before they were flattened.

        Returns
        -------
        The values in this shape, or (...) along a curve.
        """
        if self.heading.is_curve:
            return values.reshape(shape[:-1])
        return values.reshape(shape)

    def _evaluate_group(self, group: int, coordinates: Floats) -> Floats:
        """Return the values (n, F) of the F functions of a group at n points.

        A group is a set of functions of the model whose Chebyshev series are stored
        together.

        Parameters
        ----------
        group
            Index of the group.
        coordinates
            (n, m) coordinates (rad). A model of one coordinate (m = 1) is along a curve of
            configurations. If the curve is periodic, coordinates may be beyond its ends, in
            further laps. A model of several coordinates is over a box of their ranges;
            points outside its domain give NaN.

        Raises
        ------
        SolveError
            If a coordinate is not finite, or beyond the ends of a curve that is not
            periodic.
        """
        series = self.groups[group]
        if isinstance(series, TensorChebyshev):  # over a box of several coordinates
            return series.evaluate(coordinates)
        # Along a curve, whole laps are subtracted from the coordinate. The heading is the
        # description of the model, with the range of the coordinate.
        heading = self.heading
        (low,) = heading.low
        (high,) = heading.high
        x = coordinates[:, 0]
        laps = heading.count_laps(x)
        values = series.evaluate(x - laps * (high - low))
        # The pair variables (joint angles), the first functions of group 0, grow by `rise`
        # in each lap. All other functions are the same in each lap.
        if group == 0:
            values[:, : len(heading.rise)] += laps[:, None] * np.array(heading.rise)
        return values

    def combine_functions(self, group: int, factors: Floats) -> SingleFunction:
        """Return a Python function that computes sums of stored functions at one point.

        Functions of several inputs are stored as series in the cells of a box of input
        ranges. Functions of one coordinate are stored as series along a curve of
        configurations. On a closed curve, pair variables grow by a constant in each lap,
        such as one revolution. All other functions are the same in each lap.

        Parameters
        ----------
        group
            Index of a group of F stored functions, which share one series.
        factors
            (F, K) factors of the functions in each of K sums.

        Returns
        -------
        A function that maps a point to the K sums. A point is the inputs (m,) for a box, or
        the coordinate of a curve. Everything that does not depend on the point is computed
        here once, so that the function takes the least time.
        """
        heading = self.heading
        series = self.groups[group]
        if isinstance(series, TensorChebyshev):  # functions of several inputs
            cell_sums = CellSums(series, factors)
            # Returns the index of the cell in which the inputs (m,) are.
            find_cell = self._find_cell

            def evaluate_in_box(q: Sequence[float]) -> list[float]:
                """Return all sums at one point, the inputs q (m,) in rad."""
                return cell_sums.evaluate(find_cell(q), q).tolist()  # type: ignore[no-any-return]

            return evaluate_in_box
        # Combine the series along the curve. The heading has the scale of each function.
        # The scale of each sum follows from these: the precision of the polynomials of the
        # sum is judged relative to it.
        functions = heading.groups[group]
        largest_values = np.array([function.largest for function in functions])
        scales = largest_values @ np.abs(factors)
        combined = PiecewiseChebyshev(series.edges, series.coefficients @ factors)
        evaluate_in_range = make_local_polynomials(combined, scales)
        # The pair variables are the first functions of group 0, and grow in each lap by
        # `rise`. `growing` has the index and the growth of each sum that grows.
        rise = heading.rise if group == 0 else ()
        growths = (np.array(rise) @ factors[: len(rise)]).tolist()
        growing = [(k, growth) for k, growth in enumerate(growths) if growth]
        (low,) = heading.low
        (high,) = heading.high
        reduce_to_range = heading.reduce_to_range

        def evaluate_on_curve(x: float) -> list[float]:
            """Return all sums at one coordinate x (rad), which may be in another lap."""
            if low <= x < high:
                return evaluate_in_range(x)
            reduced_x, laps = reduce_to_range(x)
            values = evaluate_in_range(reduced_x)
            for k, growth in growing:
                values[k] += laps * growth
            return values

        return evaluate_on_curve

    def _indices_in_group(self, names: Iterable[str]) -> list[int]:
        """Return the indices of stored functions within the group to which they belong.

        The functions of the motion are one group, and those of each pole (axis of the
        relative rotation of two links) are another. The functions of a group share one
        series, which returns the values of all of them. The indices select the wanted
        values.

        Parameters
        ----------
        names
            Names of the functions.

        Raises
        ------
        SolveError
            If the functions do not belong to one group, or one of them is not stored.
        """
        # The index of the group of each function, and its index in the group.
        locations = [self.heading.locate_function(name) for name in names]
        if len({group for group, _ in locations}) > 1:
            raise SolveError(
                f"{self.heading.mechanism}: the functions {listing(names)} are not stored "
                "in one group; evaluate the functions of each pole separately"
            )
        return [index for _, index in locations]

    def _find_cell(self, q: Sequence[float]) -> int:
        """Return the index of the cell of a box that contains a point q (m,), rad.

        The box consists of the ranges of m inputs. The functions of the model are stored as
        series, one for each cell (a smaller box). Together, the cells are the domain of the
        model, which may be a part of the box.

        Raises
        ------
        SolveError
            If the point is outside the domain.
        """
        heading = self.heading
        # A model over a box has a single group of functions, so all have the same cells.
        series = self.groups[0]
        assert isinstance(series, TensorChebyshev)
        for value, low, high in zip(q, heading.low, heading.high, strict=True):
            if not low <= value <= high:
                break
        else:
            # Every coordinate is within its range, so the point is in the box.
            cell = series.find_cell(q)
            # The cell is -1 if the point is in the box, but in none of the cells.
            if cell >= 0:
                return cell
        ranges = zip(heading.by, q, heading.low, heading.high, strict=True)
        values_and_ranges = (
            f"{name} = {x:.9g} ({low:.6g} to {high:.6g})" for name, x, low, high in ranges
        )
        raise SolveError(
            f"{heading.mechanism}: the inputs {listing(values_and_ranges)} rad are not in "
            f"the domain of the model. The domain covers the part {heading.covered:.3g} of "
            f"the box of these ranges; elsewhere assembly mode {heading.assembly_mode} "
            "does not exist or is near a singularity"
        )


@dataclass(frozen=True)
class PointRows:
    """The n points at which a reduced model is evaluated, in rows.

    A reduced model has stored functions of m coordinates.

    Attributes
    ----------
    coordinates
        (n, m) coordinates, rad.
    derivatives
        Rates and accelerations (n, m) of the coordinates, as far as the requested functions
        depend on these. The list can be empty.
    t
        (n,) times, s.
    shape
        The shape (..., m) of the points before they were put in rows, with n points in the
        axes (...). The results get these axes again.
    """

    coordinates: Floats
    derivatives: list[Floats]
    t: Floats
    shape: tuple[int, ...]


@checked(FileError)
def load_reduced(path: AnyPath) -> StoredModel:
    """Return a reduced model from a file that `StoredModel.save` wrote.

    A reduced model has stored functions of a mechanism, such as its inertia, and replaces
    the mechanism in simulation and control.

    Raises
    ------
    FileError
        If the file cannot be read, is no such model or has another version, is cut short,
        or has numbers that are not finite.
    """
    return read_archive(path, MODEL_FORMAT, partial(_construct_model, repr(str(path))))


def _construct_model(
    where: str, header: Mapping[str, Any], arrays: Mapping[str, Floats]
) -> StoredModel:
    """Return the reduced model that is stored in a file, after checking it.

    Parameters
    ----------
    where
        Name of the file, for error messages.
    header
        Values of the fields of `StoredHeading` by their names. Each load and each function
        is a dictionary of its fields. A group is a list of functions that are stored
        together.
    arrays
        The arrays of all groups by their names, such as "coefficients_0" for group 0.
    """
    fields = {name: header[name] for name in StoredHeading.__dataclass_fields__}
    fields["loads"] = tuple(StoredLoad(**load) for load in header["loads"])
    fields["groups"] = tuple(
        tuple(StoredFunction(**item) for item in group) for group in header["groups"]
    )
    heading = StoredHeading(**fields)
    # All numbers of the heading must be finite: the ends of the ranges, `rise` (how much
    # each variable grows over one lap of a closed curve), and size and error of functions.
    numbers = [*heading.low, *heading.high, *heading.rise]
    for function in heading.functions:
        numbers += [function.largest, function.error]
    if not (all_finite(numbers) and np.all(np.less(heading.low, heading.high))):
        raise FileError(
            f"{where}: the header of the file has numbers that are not finite, or ranges "
            "that do not increase; store the model again"
        )
    groups = tuple(
        _construct_series(where, heading, k, arrays) for k in range(len(heading.groups))
    )
    return StoredModel(heading, groups)


def _construct_series(
    where: str, heading: StoredHeading, k: int, arrays: Mapping[str, Floats]
) -> PiecewiseChebyshev | TensorChebyshev:
    """Return the Chebyshev series of one group of functions, after checking its arrays.

    The domain is divided into cells, each with its own coefficients. Along a curve the cell
    c is the interval from edges[c] to edges[c + 1]. Over a box of several coordinates the
    cell c is the box from bounds[c, 0] to bounds[c, 1].

    Parameters
    ----------
    where
        Name of the file, for error messages.
    heading
        The heading of the model, with names and groups of the functions.
    k
        Index of the group.
    arrays
        All arrays of the file. The arrays of this group have names that end in "_k".

    Raises
    ------
    FileError
        If the arrays do not fit the heading, are not finite, or have cells that do not
        rise.
    """
    functions = heading.groups[k]
    coefficients = arrays[f"coefficients_{k}"]
    fault = None
    # Axes of the coefficients: cell, order in each coordinate, function.
    dimension_count = len(heading.by) + 2
    if coefficients.ndim != dimension_count or coefficients.shape[-1] != len(functions):
        fault = (
            f"coefficients_{k} do not fit: {coefficients.shape[-1]} columns for "
            f"{len(functions)} functions"
        )
    elif not all_finite(coefficients):
        column = np.argwhere(~np.isfinite(coefficients))[0, -1]
        fault = f'"{functions[column].name}" has coefficients that are not finite'
    else:
        if heading.is_curve:
            edges = arrays[f"edges_{k}"]
            cell_arrays = [edges]
            cell_starts = edges[:-1]
            cell_stops = edges[1:]
        else:
            # `splits` are the steps by which the box was halved into cells.
            splits = arrays[f"splits_{k}"]
            bounds = arrays[f"bounds_{k}"]
            cell_arrays = [splits, bounds]
            cell_starts, cell_stops = bounds.swapaxes(0, 1)
        has_all_cells = len(cell_starts) == len(coefficients) > 0
        is_rising = np.all(np.less(cell_starts, cell_stops)) and has_all_cells
        # One message for all faults of cells: their number, their order, and numbers that
        # are not finite.
        if not (is_rising and all(all_finite(array) for array in cell_arrays)):
            fault = f"the cells of group {k} are not in increasing order"
    if fault is not None:
        raise FileError(f"{where}: {fault}; store the model again")
    if heading.is_curve:
        return PiecewiseChebyshev(edges, coefficients)
    low = np.array(heading.low)
    high = np.array(heading.high)
    return TensorChebyshev(low, high, splits, bounds, coefficients)


def _array_names(heading: StoredHeading) -> Names:
    """Return the names of the arrays of a group, the coefficients last."""
    if heading.is_curve:
        return "edges", "coefficients"
    return "splits", "bounds", "coefficients"
