"""A mechanism at given inputs: configurations, pole axes and coefficients by name."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache, partial
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from spherekit.argument_validation import checked
from spherekit.arrays import Floats, Integers, SmallIntegers
from spherekit.conventions import Facts, Names
from spherekit.dynamics.configurations_at_inputs import analysis_covering, shift_into_range
from spherekit.errors import SolveError
from spherekit.files.mechanism_reader import AnyMechanism, mechanism_of
from spherekit.files.study import Crossings
from spherekit.geometry.vectors import all_finite
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.sizes import angles_in_radians
from spherekit.numerics.angles import wrap
from spherekit.planning.assembly_plan import driven_at
from spherekit.planning.pole_plan import Pole, all_poles, ordered_pole, parse_pole
from spherekit.positions.assembly_mode import AssemblyMode
from spherekit.positions.motion import Motion
from spherekit.positions.motion_cache import position_analysis_of
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.quantity import AngleUnit
from spherekit.runs.analysis_requests import plan_requests
from spherekit.runs.batch import Batch
from spherekit.runs.needs import Needs
from spherekit.status import Status
from spherekit.tables.table import (
    ASSEMBLY_MODE,
    INPUTS,
    RESIDUAL,
    SAMPLE,
    STATUS,
    Column,
    Table,
    input_columns,
)
from spherekit.tables.table_files import to_frame
from spherekit.velocities.direction_signs import signs_by_axis_sums
from spherekit.velocities.input_columns import InputColumns
from spherekit.velocities.pole_evaluation import evaluate as evaluate_poles
from spherekit.velocities.pole_evaluation import make_certified_field
from spherekit.velocities.pole_request import MechanismKey, Request
from spherekit.velocities.row_kernel import REFERENCES, EvaluatedRow, RowKernel, row_kernel
from spherekit.wording import counted, listing

TABLE = Table(
    "poles",
    "one row per sample, assembly mode, moving input and pole",
    (
        SAMPLE,
        ASSEMBLY_MODE,
        INPUTS,
        Column("link", "", "link whose motion is described", "text"),
        Column("relative_to", "", "link relative to which the motion is described", "text"),
        Column(
            "moving", "", "driven pair that moves while the other inputs are locked", "text"
        ),
        Column(
            "ux", "", "x component of the unit vector u along the pole axis, in ground axes"
        ),
        Column(
            "uy", "", "y component of the unit vector u along the pole axis, in ground axes"
        ),
        Column(
            "uz", "", "z component of the unit vector u along the pole axis, in ground axes"
        ),
        Column(
            "velocity_coefficient",
            "",
            "velocity coefficient k: angular velocity of `link` relative to "
            "`relative_to` about the pole axis u, divided by the rate of the input",
        ),
        Column(
            "acceleration_coefficient",
            "1/rad",
            "derivative of the velocity coefficient with respect to the input",
        ),
        Column(
            "error_bound",
            "rad",
            "upper bound of the angular error of the pole axis u",
            scale="none",
        ),
        Column(
            "velocity_coefficient_error_bound",
            "",
            "upper bound of the error of the velocity coefficient",
            scale="none",
        ),
        Column(
            "acceleration_coefficient_error_bound",
            "1/rad",
            "upper bound of the error of the acceleration coefficient",
            scale="none",
        ),
        Column(
            "direction_dq_error_bound",
            "1/rad",
            "upper bound of the error of du/dq, the derivative of the pole axis u with "
            "respect to the input q: length of its difference from the exact vector",
            scale="none",
        ),
        RESIDUAL,
        STATUS,
    ),
)


@dataclass(frozen=True)
class Kinematics:
    """Configurations of a mechanism at given inputs, with poles and coefficients.

    A row is one input in one assembly mode (way to assemble the links). Rows are ordered by
    assembly mode, and within a mode by input. The shapes below have n rows as their first
    axis. The result for one input in one assembly mode, such as ``sk.evaluate("four_bar",
    0.7, assembly_mode=0)``, is a single configuration: its arrays do not have this axis, so
    that a coefficient is a number, a direction has the shape (3,) and a rotation (3, 3).

    A pole is the axis of the relative rotation of two links, and is named by them,
    ``"3/1"``. A coefficient is the rate of a quantity per unit rate of the input `moving`,
    while the other inputs are locked; with one input `moving` may be left out. The sense of
    a pole axis, and with it the sign of its coefficient, is continuous along the rows of an
    assembly mode. In the first row, the pole axis has a positive component along the sum of
    the unit vectors to all axes and contact points. The pole axis of two links that a pair
    joins is the axis of the pair, with its sign.

    Angles are in rad, vectors in ground axes. Rows that failed hold NaN, and `status` has
    the reason. Methods that end in `error_bound` return bounds of the errors, as the
    columns of these names do in the table `poles`.

    With several inputs and groups of links that are no dyads (two links with three R
    pairs), each mode is followed from row to row by verified steps. If a mode has no
    configuration at an input, its number may denote another mode at later inputs. If every
    mode has a configuration at every input, `spherekit.run` at the same inputs gives the
    modes the same numbers as this object. At other inputs its numbers can differ.

    `search` says how the modes were found, and whether there may be others.
    """

    mechanism: Mechanism
    poles: Names
    _read: Callable[[], Batch] = field(repr=False)
    search: str = ""
    _is_single: bool = field(default=False, repr=False)

    @cached_property
    def _batch(self) -> Batch:
        return self._read()

    def __getstate__(self) -> Facts:
        return {**vars(self), "_batch": self._batch, "_read": None}

    @property
    def _motion(self) -> Motion:
        return self._batch.motion

    def _drop_axis_if_single(self, values: Any) -> Any:
        """Return an array without its axis of rows if this is a single configuration."""
        return values[0] if self._is_single else values

    def __len__(self) -> int:
        return len(self._batch)

    def __repr__(self) -> str:
        modes = len(set(self._batch.assembly_mode))
        return (
            f"<Kinematics of {self.mechanism.name}: {counted(len(self), 'row')} in "
            f"{counted(modes, 'assembly mode')}, {np.sum(self._motion.failed)} failed; "
            f"{counted(len(self.poles), 'pole')} while "
            f"{' or '.join(self.input_pairs)} moves>"
        )

    @property
    def input_pairs(self) -> Names:
        """Names of the driven pairs, in the order of the columns of `inputs`."""
        return self._batch.moving_inputs

    @property
    def q(self) -> Floats:
        """(n,) rad, the only input; `SolveError` if there are several, see `inputs`."""
        return self._drop_axis_if_single(self._batch.q)

    @property
    def inputs(self) -> Floats:
        """(n, inputs) rad, the inputs; an only input is shifted by periods to its range."""
        return self._drop_axis_if_single(self._batch.inputs)

    @property
    def sample(self) -> Integers:
        """(n,) index, from 0, of the input of each row."""
        return self._drop_axis_if_single(self._batch.sample)

    @property
    def assembly_mode(self) -> Integers:
        """(n,) number of the assembly mode of each row."""
        return self._drop_axis_if_single(self._batch.assembly_mode)

    @property
    def status(self) -> SmallIntegers:
        """(n,) codes of `spherekit.Status`."""
        return self._drop_axis_if_single(self._batch.status)

    @property
    def residual(self) -> Floats:
        """(n,) rad, the closure residual of the loops."""
        return self._drop_axis_if_single(self._batch.residual)

    @checked(SolveError)
    def variable(self, name: str) -> Floats:
        """Return a pair variable, such as the angle of a joint (rad), in all rows.

        A row is one input in one assembly mode. The result is an array (n,), or a number if
        a single configuration was requested. `name` is the name of the variable or of its
        pair (joint).

        Raises
        ------
        SolveError
            If there is no variable or pair of this name, or if the pair has two variables.
        """
        names = self.mechanism.variable_names
        if name in names:
            variable = names.index(name)
        else:
            variable = self._variable_of_pair(name)
        return self._drop_axis_if_single(self._motion.values[:, variable])

    @checked(SolveError)
    def variable_coefficient(self, pair: str, moving: str | None = None) -> Floats:
        """Return the rate (n,) of a joint's variable per unit rate of the input.

        Each of the n rows is one sample of the inputs in one assembly mode. With several
        inputs, `moving` is the driven pair that moves while the others are locked.

        Raises
        ------
        SolveError
            If there is no such pair or input, or the pair has two variables.
        """
        self._variable_of_pair(pair)  # raises an error if there is not one
        return self._drop_axis_if_single(self._batch.pair_rate(pair, self._moving(moving)))

    @checked(SolveError)
    def rotation(self, link: str) -> Floats:
        """Return the rotations (n, 3, 3) from link axes to ground axes."""
        return self._drop_axis_if_single(self._batch.rotation(self._link(link)))

    @checked(SolveError)
    def angular_velocity(self, link: str, moving: str | None = None) -> Floats:
        """Return the angular velocity (n, 3) of a link per unit rate of the input.

        The n rows are the inputs in each assembly mode. The velocity is relative to the
        ground and in ground axes. `moving` is the input that moves while the others are
        locked.
        """
        velocity = self._batch.angular_velocity(self._link(link), self._moving(moving))
        return self._drop_axis_if_single(velocity)

    @checked(SolveError)
    def angular_velocity_dq(self, link: str, moving: str | None = None) -> Floats:
        """Return the input derivative (n, 3), 1/rad, of `angular_velocity`."""
        velocity = self._batch.angular_velocity_dq(self._link(link), self._moving(moving))
        return self._drop_axis_if_single(velocity)

    @checked(SolveError)
    def direction(self, pole: str, moving: str | None = None) -> Floats:
        """Return unit vectors (n, 3) along the pole axis of two links."""
        return self._drop_axis_if_single(
            self._batch.direction(*self._pole(pole), self._moving(moving))
        )

    @checked(SolveError)
    def velocity_coefficient(self, pole: str, moving: str | None = None) -> Floats:
        """Return the relative angular rate (n,) of two links per unit rate of the input.

        `pole` names the two links, such as ``"4/1"``. The coefficient times the axis
        `direction` is the angular velocity of the first link relative to the second. The
        coefficient of ``"1/4"`` is therefore the negative of the coefficient of ``"4/1"``.
        """
        coefficient = self._batch.velocity_coefficient
        values = coefficient(*self._pole(pole), self._moving(moving))
        return self._of_first_link(pole, values)

    @checked(SolveError)
    def acceleration_coefficient(self, pole: str, moving: str | None = None) -> Floats:
        """Return the input derivative (n,), 1/rad, of the velocity coefficient."""
        coefficient = self._batch.acceleration_coefficient
        values = coefficient(*self._pole(pole), self._moving(moving))
        return self._of_first_link(pole, values)

    @checked(SolveError)
    def direction_dq(self, pole: str, moving: str | None = None) -> Floats:
        """Return the derivative (n, 3), 1/rad, of `direction` with respect to the input.

        `direction` is the unit vector of the axis about which the two links of `pole`
        rotate relative to each other.

        The derivative is NaN in rows in which the links hardly rotate relative to each
        other. In these rows, fewer than six digits of the derivative would be correct.
        """
        return self._drop_axis_if_single(
            self._batch.direction_dq(*self._pole(pole), self._moving(moving))
        )

    @property
    def configuration_error(self) -> Floats:
        """(n,) rad, a bound of the error of all pair variables; infinite where unknown."""
        return self._drop_axis_if_single(self._motion.configuration_error)

    @checked(SolveError)
    def error_bound(self, pole: str, moving: str | None = None) -> Floats:
        """Return a bound (n,) of the error of `direction`, rad."""
        return self._drop_axis_if_single(
            self._batch.error_bound(*self._pole(pole), self._moving(moving))
        )

    @checked(SolveError)
    def velocity_coefficient_error_bound(
        self, pole: str, moving: str | None = None
    ) -> Floats:
        """Return a bound (n,) of the error of `velocity_coefficient`."""
        links = self._pole(pole)
        return self._drop_axis_if_single(
            self._batch.velocity_coefficient_error_bound(*links, self._moving(moving))
        )

    @checked(SolveError)
    def acceleration_coefficient_error_bound(
        self, pole: str, moving: str | None = None
    ) -> Floats:
        """Return a bound (n,) of the error of `acceleration_coefficient`, 1/rad."""
        links = self._pole(pole)
        bounds = self._batch.acceleration_coefficient_error_bound(
            *links, self._moving(moving)
        )
        return self._drop_axis_if_single(bounds)

    @checked(SolveError)
    def direction_dq_error_bound(self, pole: str, moving: str | None = None) -> Floats:
        """Return a bound (n,) of the error of `direction_dq`, 1/rad.

        `direction_dq` is the derivative of the direction of a pole axis with respect to the
        input. The bound limits the length of the difference from the exact derivative.
        """
        links = self._pole(pole)
        return self._drop_axis_if_single(
            self._batch.direction_dq_error_bound(*links, self._moving(moving))
        )

    @checked(SolveError)
    def frame(self, degrees: bool = False) -> Any:
        """Return a pandas frame with a row for each configuration, moving input and pole.

        A pole is the axis about which one link rotates relative to another. One input
        moves, and all others are locked. A row has the pole axis of two links and their
        coefficients of velocity and acceleration. These are the relative angular velocity
        of the links per unit rate of the moving input, and its derivative with respect to
        this input.

        Parameters
        ----------
        degrees
            Whether inputs are in degrees. Coefficients are per rad in any case.
        """
        batch = self._batch
        poles = [self._pole(pole) for pole in self.poles]
        # A request is a row of the frame at each configuration. It consists of the indices
        # of the two links of a pole, and of the moving input.
        requested = [
            (*pole, moving) for moving in range(len(self.input_pairs)) for pole in poles
        ]
        # In all columns, the rows are the requests at the first configuration, then the
        # requests at the second, and so on. `pole_columns` makes all columns but the error
        # bounds and the inputs, which are added below.
        data: Facts = batch.pole_columns(requested)
        # The error bounds.
        make_column = batch.of_poles(requested)
        for column in TABLE.columns:
            if column.name.endswith("error_bound"):
                # None: a bound is a single number, not a component of a vector.
                data[column.name] = make_column(column.name, None)
        # The inputs (n,), repeated for each request at the same configuration.
        for name, values in input_columns(self.mechanism, batch.inputs).items():
            data[name] = batch.interleaved([values] * len(requested))
        # The declared columns of the table, including one for each input.
        table = TABLE.of(self.mechanism)
        columns = {column.name: data[column.name] for column in table.columns}
        return to_frame(table, columns, degrees)

    def _link(self, name: str) -> str:
        """Return the name of a link, or raise an error with the nearest name."""
        return self.mechanism.links[self.mechanism.link(name)]

    def _variable_of_pair(self, pair: str) -> int:
        """Return the index of the only variable of a pair, or raise an error."""
        number = self.mechanism.pair_number[self.mechanism.pair(pair).name]
        variables = self.mechanism.variables_of(number)
        if len(variables) > 1:
            names = listing(self.mechanism.variable_names[number] for number in variables)
            raise SolveError(
                f"{self.mechanism.name}: pair {pair} has two variables; request one of "
                f"{names}"
            )
        return variables[0]

    def _pole(self, text: str) -> Pole:
        """Return the indices of the links of an evaluated pole, or raise an error."""
        pole = parse_pole(self.mechanism, text)
        name = _pole_text(self.mechanism, pole)
        if name not in self.poles:
            raise SolveError(
                f"{self.mechanism.name}: pole {name} was not evaluated; add it to the "
                f"argument poles. Evaluated poles: {listing(self.poles) or 'none'}"
            )
        return pole

    def _of_first_link(self, text: str, values: Floats) -> Floats:
        """Return coefficients with the sign for the order in which a user named two links.

        A velocity coefficient is the angular velocity of one link relative to another, per
        unit rate of the input. An acceleration coefficient is its derivative. Both change
        their signs if the two links are exchanged, since the direction of the pole axis
        stays (Di Gregorio 2024, eq. 1). In `values` the link with the larger index moves
        relative to the other link.

        Parameters
        ----------
        text
            The two links: ``"4/1"`` is link 4 relative to link 1.
        values
            (n,) coefficients at n configurations.
        """
        # The indices of the two links, in the order of the text.
        moving_link, reference_link = ordered_pole(self.mechanism, text)
        has_order_of_values = moving_link > reference_link
        if not has_order_of_values:
            # The difference avoids -0.0, which would be printed with a sign.
            values = 0.0 - values
        # If n is 1 and the user asked for one input in one mode, return a number.
        return self._drop_axis_if_single(values)

    def _moving(self, name: str | None) -> int:
        """Return the index of the moving input; an only input needs no name."""
        inputs = self.input_pairs
        if name in inputs:
            return inputs.index(name)
        if name is None and len(inputs) == 1:
            return 0
        raise SolveError(
            f"{self.mechanism.name}: moving: found {name!r}, expected the name of the "
            f"input that moves. Inputs: {listing(inputs)}"
        )


@checked(SolveError)
def evaluate(
    mechanism: AnyMechanism,
    inputs: ArrayLike,
    *,
    poles: Sequence[str] | None = None,
    input_pair: str | Sequence[str] | None = None,
    assembly_mode: int | str | None = None,
    crossings: Crossings = "end",
    angle_unit: AngleUnit = "rad",
) -> Kinematics:
    """Return a mechanism's configurations, pole axes and coefficients at given inputs.

    The arrays of the result have a row for each input in each assembly mode. If `inputs` is
    one number (with several inputs, one number for each) and `assembly_mode` is given, the
    result is a single configuration and its arrays have no axis of rows: a coefficient is
    a number. An array of one input, ``[0.7]``, keeps the axis.

    Parameters
    ----------
    mechanism
        The mechanism, the name of a shipped one, or the path of a file.
    inputs
        Values of the inputs in `angle_unit`. With one input: a number, or an array (n,).
        With several inputs: an array (inputs,) or (n, inputs).
    poles
        The poles (axes of the relative rotation of two links) to compute, such as ``["3/1",
        "4/1"]``; by default all.
    input_pair
        The driven pairs, by default the inputs of the mechanism.
    assembly_mode
        The only assembly mode to compute: the number that `run` gives it, or its name in
        the file. By default all modes are computed. There is an exception: if the mechanism
        has several inputs and an Assur group (links that are placed together) larger than a
        dyad, modes are numbered from the inputs of this call only. `run` may then number
        them in another way.
    crossings
        How an assembly mode continues where its curve of configurations crosses the curve
        of another mode. A dyad (two links with three R pairs) can be assembled in two ways,
        and its sign selects one of them. With ``"end"`` the mode keeps the signs of its
        dyads. With ``"pass"`` the mode follows the smooth curve, so these signs can change
        at a crossing. ``"pass"`` needs a single input.
    angle_unit
        Unit of `inputs`, ``"rad"`` or ``"deg"``. The result is in rad.

    Raises
    ------
    SolveError, PlanError, ModelError
        If the number of degrees of freedom is not the number of inputs, a name is unknown,
        or inputs are not finite numbers. Inputs that the mechanism cannot reach raise no
        error. Their rows have a status instead.

    Examples
    --------
    >>> import numpy as np
    >>> import spherekit as sk
    >>> here = sk.evaluate("four_bar", 0.7, assembly_mode=0)
    >>> round(float(here.velocity_coefficient("4/1")), 4), here.direction("3/1").shape
    (-0.7657, (3,))
    >>> turn = sk.evaluate("four_bar", np.linspace(0.0, 2.0 * np.pi, 50), assembly_mode=0)
    >>> turn.q.shape, turn.direction("3/1").shape, len(turn.frame()) == 50 * 6
    ((50,), (50, 3), True)

    The frame of pandas, ``turn.frame()``, has a row for each of the 50 inputs and each of
    the 6 poles of four links.

    With a plotting library: ``plt.plot(turn.q, turn.velocity_coefficient("4/1"))``.
    """
    # The modes are searched once and cached, so that a further call with the same
    # arguments takes little time. Keys of the cache are compared, hence the tuples.
    evaluate_inputs = _prepare_evaluation(
        MechanismKey(mechanism_of(mechanism)),
        None if poles is None else tuple(poles),
        input_pair if input_pair is None or isinstance(input_pair, str) else (*input_pair,),
        assembly_mode,
        crossings,
    )
    return evaluate_inputs(angles_in_radians(inputs, angle_unit))


@lru_cache(maxsize=32)
def _prepare_evaluation(
    mechanism_key: MechanismKey,
    poles: Sequence[str] | None,
    input_pair: str | Sequence[str] | None,
    assembly_mode: int | str | None,
    crossings: Crossings,
) -> Callable[[Floats], Kinematics]:
    """Return a function that evaluates a mechanism at inputs.

    The assembly modes are searched and the expressions are made once. Further calls with
    the same arguments return the same function from a cache.

    Parameters
    ----------
    mechanism_key
        The mechanism, as a key that a cache can compare.
    poles, input_pair, assembly_mode, crossings
        As in `evaluate`.
    """
    # Everything that is evaluated: the requested poles, and all pairs and links.
    mechanism = driven_at(mechanism_key.mechanism, input_pair)
    if poles is None:
        poles_to_evaluate = all_poles(len(mechanism.links))
    else:
        parsed_poles = [parse_pole(mechanism, text) for text in poles]
        poles_to_evaluate = tuple(dict.fromkeys(parsed_poles))
    pole_names = tuple(_pole_text(mechanism, pole) for pole in poles_to_evaluate)
    pairs = frozenset(mechanism.pair_number)
    links = frozenset(mechanism.links)
    needs = Needs(
        directions=frozenset(poles_to_evaluate),
        rates=frozenset(poles_to_evaluate),
        derivatives=True,
        turns=frozenset(poles_to_evaluate),
        pair_values=pairs,
        pair_rates=pairs,
        rotations=links,
        link_rates=links,
        tracer=True,
    )
    # With one input the modes are numbered along its range, so they are searched once. With
    # several inputs they are numbered along the inputs of each call.
    range_analysis = None
    if crossings == "pass":
        # With several inputs this raises an error that says why it is not possible.
        range_analysis = PositionAnalysis(mechanism, crossings=crossings)
    elif len(mechanism.inputs) == 1:
        range_analysis = position_analysis_of(mechanism)
    evaluate_row = None
    if range_analysis is not None and assembly_mode is not None:
        mode_index = range_analysis.find_mode_index(assembly_mode)
        evaluate_row = _single_row_evaluator(mechanism, range_analysis, mode_index, needs)

    def evaluate_inputs(q: Floats) -> Kinematics:
        """Return the kinematics of the requested assembly mode, or of all modes.

        With one input, `range_analysis` has the assembly modes over its range, and
        `evaluate_row` is a fast function for one mode at one value of it, if there is one.
        With several inputs `range_analysis` and `evaluate_row` are None. `needs` are the
        quantities that are evaluated, such as pole axes and rates of links, and
        `pole_names` the names of the poles.

        Parameters
        ----------
        q
            Inputs (rad). With one input, a number or (n,) values. With several, (inputs,)
            values or (n, inputs).
        """
        # One number for each input, and one mode: a single configuration.
        is_single = assembly_mode is not None and q.ndim == (len(mechanism.inputs) > 1)
        # The fast function returns None if float64 may give too few digits at this input.
        has_one_row = q.size == 1 and q.ndim < 2
        if range_analysis is not None and evaluate_row is not None and has_one_row:
            read_batch = evaluate_row(q.item())
            if read_batch is not None:
                search = range_analysis.search
                return Kinematics(mechanism, pole_names, read_batch, search, is_single)
        # Otherwise compute the configurations of all modes at all inputs, and keep the rows
        # of the requested mode. With several inputs, the modes are searched at the inputs q
        # of this call.
        if range_analysis is not None:
            q = np.atleast_1d(q)
            position_analysis = range_analysis
            # Inputs are shifted by whole turns into the range of the input. If gear wheels
            # make the configuration depend on the number of turns, this is not possible,
            # and a new analysis over a range that contains the inputs is made.
            if all_finite(q):
                position_analysis = analysis_covering(range_analysis, q)
                q = shift_into_range(position_analysis, q)
            motion = position_analysis.at(q)
        else:
            path = q[None] if q.ndim == 1 else q
            # `independent`: the rows of q may be far apart and are no samples of a motion.
            position_analysis = PositionAnalysis(mechanism, path=path, independent=True)
            motion = position_analysis.motion()
        if assembly_mode is not None:
            mode_index = position_analysis.find_mode_index(assembly_mode)
            number = position_analysis.assembly_modes[mode_index].number
            motion = motion.rows(motion.assembly_mode == number)
        # Each input that moves has a plan by which its poles are constructed. `by_rank` is
        # True for overconstrained mechanisms. Counting links and pairs gives a wrong
        # mobility for these, so it follows from the rank of the velocity equations.
        requests = plan_requests(
            position_analysis.mechanism, needs, position_analysis.by_rank
        )
        # The batch (all values with their error bounds) is made when it is first read.
        read_batch = partial(
            Batch,
            mechanism,
            tuple(request.plan for request in requests),
            needs,
            motion,
            tuple(evaluate_poles(motion, request) for request in requests),
        )
        search = position_analysis.search
        return Kinematics(mechanism, pole_names, read_batch, search, is_single)

    return evaluate_inputs


def _single_row_evaluator(
    mechanism: Mechanism, position_analysis: PositionAnalysis, mode_index: int, needs: Needs
) -> Callable[[float], Callable[[], Batch] | None] | None:
    """Return a fast function that evaluates one mode at one input, or None.

    The result is None if there is no fast function, for example for mechanisms with
    contacts.

    The fast function evaluates expressions with plain floats. It returns the values in the
    form of another function, which converts them to the arrays of a `Batch` when they are
    read. This conversion takes longer than the evaluation. If float64 may give too few
    digits, the fast function returns None. The row then has to be evaluated in the ordinary
    way.

    Parameters
    ----------
    mechanism
        The mechanism, with one input.
    position_analysis
        Its position analysis over the range of the input.
    mode_index
        Index of the mode in `position_analysis`.
    needs
        The quantities to evaluate.
    """
    # There is one request for each input, so here there is only one. It lists the poles
    # and velocities to compute. `by_rank` is how degrees of freedom are counted.
    (request,) = plan_requests(
        position_analysis.mechanism, needs, position_analysis.by_rank
    )
    mode = position_analysis.assembly_modes[mode_index]
    # The kernel (set of functions for one row) eliminates variables from the loop
    # equations, in an order without division by small numbers. It finds this order with a
    # few known configurations. Other modes may need another order, so the known
    # configurations are taken from this mode.
    few_configurations = position_analysis.sparse(REFERENCES)
    reference_motion = few_configurations.rows(
        few_configurations.assembly_mode == mode.number
    )
    kernel = row_kernel(reference_motion, [request], "numpy")
    # A kernel that certifies rows proves that their error bounds are small enough. Other
    # rows need further checks, which take long.
    if kernel is None or not kernel.can_certify_rows or mechanism.has_contacts:
        return None
    # A known row. Each evaluation replaces its input and its configuration.
    row_template = replace(
        reference_motion.rows(slice(0, 1)),
        sample=np.zeros(1, dtype=int),
        assembly_mode=np.array([mode.number]),
        status=np.zeros(1, dtype=np.int8),  # 0: OK
        placed=None,  # no orientations of the links
    )
    evaluator = _SingleRowEvaluator(
        mechanism,
        position_analysis,
        mode,
        needs,
        request,
        kernel,
        position_analysis.range,
        row_template,
    )
    return evaluator.evaluate_row


@dataclass(frozen=True)
class _SingleRowEvaluator:
    """Evaluates a mechanism in one assembly mode, quickly, at one input at a time.

    An assembly mode is one way to assemble the mechanism.

    Attributes
    ----------
    mechanism
        The mechanism, with one input.
    position_analysis
        Its position analysis over the range of the input.
    mode
        The assembly mode.
    needs
        The requested quantities.
    request
        The poles (axes of relative rotation of two links) and links to evaluate.
    kernel
        Compiled functions that compute a configuration and its poles.
    input_range
        The least and the greatest input (rad) of the position analysis.
    row_template
        One configuration of the mode. Results copy its fields that do not depend on the
        input.
    """

    mechanism: Mechanism
    position_analysis: PositionAnalysis
    mode: AssemblyMode
    needs: Needs
    request: Request
    kernel: RowKernel
    input_range: tuple[float, float]
    row_template: Motion

    def evaluate_row(self, q: float) -> Callable[[], Batch] | None:
        """Evaluate one input q (rad) quickly; return a function that makes the full result.

        The full result is a batch: arrays with the configuration at q, its poles (axes of
        relative rotation) and error bounds. Making arrays takes longer than the evaluation.
        So the caller calls the returned function only if it needs the arrays.

        The result is None if q cannot be evaluated quickly. The caller then evaluates q in
        the ordinary, slower way.
        """
        low, high = self.input_range
        is_in_range = low <= q <= high
        if isfinite(q) and not is_in_range:
            # Configurations are computed in the range only. They are the same after whole
            # revolutions of the input (or another period). So q is shifted by these into
            # the range, or as close to it as possible.
            q = shift_into_range(self.position_analysis, np.array([q])).item()
        # The kernel is the function that computes the configuration. Its arguments are q
        # and signs that select the assembly mode, or an estimate of the configuration.
        arguments = self._kernel_arguments(q)
        if arguments is None:
            # There is no estimate, for example if the assembly mode does not exist at q.
            return None
        evaluated_row = self.kernel.evaluate_row(arguments)
        if evaluated_row is None:
            # The numbers of the kernel (float64) may have too few correct digits.
            return None
        return partial(self._make_batch, q, evaluated_row)

    def _kernel_arguments(self, q: float) -> list[float] | None:
        """Return the numbers from which the kernel computes the configuration at q (rad).

        The kernel is the object whose functions compute a configuration and its poles.

        A mechanism of dyads (groups of two links) has a closed form. A dyad can be
        assembled in two ways, and a sign (1 or -1) selects one. The numbers are then q and
        the sign of each dyad.

        Otherwise they are all pair variables (rad), predicted from known configurations of
        the mode. Newton's method starts there. The result is None if the mode does not
        exist at q.
        """
        # The functions for many inputs get an array with a single input.
        inputs = np.array([[q]])
        if self.kernel.has_closed_form:
            signs_of_dyads = self.mode.signs_along(inputs)[:, 0]
            return [q, *signs_of_dyads.astype(float).tolist()]
        # Without a closed form, `guide` interpolates between known configurations of the
        # mode. With one input, `guide` does not use the numbers of samples (`rows`).
        assert self.mode.guide is not None
        prediction = self.mode.guide.predict(inputs, rows=None)
        # Where the mode does not exist, the status is not OK.
        if prediction.status[0] != Status.OK:
            return None
        predicted_variables: list[float] = prediction.values[0].tolist()
        return predicted_variables

    def _make_batch(self, q: float, evaluated_row: EvaluatedRow) -> Batch:
        """Return the batch of one configuration at an input q (rad).

        A batch has arrays for several configurations (rows), their pole axes, rates and
        error bounds. This batch has one row. Making it converts plain floats to the arrays
        that `Kinematics` reads, the object that the user gets for one or many inputs.

        Parameters
        ----------
        q
            The input (rad).
        evaluated_row
            The numbers of the configuration at q, as plain floats.
        """
        values = np.array([evaluated_row.variables])
        # The input keeps its value q. The variables of all other pairs (passive ones) are
        # reduced to (-pi, pi].
        passive_variables = list(self.kernel.passive_variables)
        values[:, passive_variables] = wrap(values[:, passive_variables])
        # The template is another configuration of the same mode. Its input, its variables
        # and its closure residual are replaced, and its other fields are kept.
        row = replace(
            self.row_template,
            inputs=np.array([[q]]),
            values=values,
            residual=np.array([evaluated_row.residual]),
        )
        # (columns, 1) poles, rates and error bounds. `column_layout` says which column has
        # which quantity. There is one layout for each input, and only one input.
        columns = np.array(evaluated_row.columns)[:, None]
        (column_layout,) = self.kernel.input_columns
        # A pole axis has two opposite directions. By convention the chosen one has a
        # positive scalar product with the sum of the axis vectors of all pairs. This call
        # changes `columns`.
        _orient_poles(column_layout, columns, evaluated_row.axis_sum)
        # The kernel has checked that the error bounds are small enough.
        field = make_certified_field(column_layout, columns, row, self.request)
        return Batch(self.mechanism, (self.request.plan,), self.needs, row, (field,))


def _orient_poles(
    column_layout: InputColumns, columns: Floats, axis_sum: Sequence[float]
) -> None:
    """Choose one of the two directions of each pole axis of one configuration.

    A pole axis has two opposite unit vectors. The chosen one has a scalar product with
    `axis_sum` that is not negative. So the choice depends on this configuration only.

    Parameters
    ----------
    column_layout
        Says which column has which quantity.
    columns
        (columns, 1) the poles and their rates. The numbers that change their sign with the
        direction are changed here.
    axis_sum
        (3,) sum of the axis vectors of all pairs.
    """
    # (components, poles, 1): the first three components are the direction. The array is a
    # view, so changing it changes `columns`.
    reversible_columns = column_layout.reversible_columns(columns)
    directions = reversible_columns[:3]
    # `signs_by_axis_sums` takes a sum for each assembly mode (way to assemble the links).
    # Here there is one configuration, so the indices of row and mode are 0.
    find_signs = signs_by_axis_sums(np.array([axis_sum]))
    reversible_columns *= find_signs(directions, 0, 0)


def _pole_text(mechanism: Mechanism, pole: Pole) -> str:
    """Return the name of a pole by its two links, such as ``3/1``."""
    return "/".join(mechanism.links[link] for link in reversed(pole))
