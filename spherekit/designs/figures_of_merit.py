"""Figures of merit of designs in their assembly modes, computed by a kernel.

A kernel is a function that evaluates quantities of many designs at many samples of the
inputs at once. A figure of merit reduces these quantities to one number.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from spherekit.arrays import Array, Bools, Floats, Indices, Integers
from spherekit.conventions import Names
from spherekit.designs.design_kernel import DesignKernel, RedundantKernel
from spherekit.designs.design_variables import OK, reason_of
from spherekit.designs.profile_numbers import evaluate_profile_columns
from spherekit.errors import (
    DesignError,
    FileError,
    ModelError,
    PlanError,
    SolveError,
    SpherekitError,
)
from spherekit.files.study import Crossings, Study
from spherekit.files.time_law import ConstantSpeed
from spherekit.geometry.vectors import all_finite, max_abs, nans
from spherekit.mechanism.joint import ContactProfile
from spherekit.mechanism.mechanism import Mechanism
from spherekit.numerics.angles import return_after_revolutions
from spherekit.numerics.array_rows import ArrayRows
from spherekit.planning.assembly_plan import driven_at
from spherekit.positions.input_grid import InputGrid, make_input_grid
from spherekit.positions.timing import evaluate_time_laws
from spherekit.runs.figure_of_merit import FigureOfMerit
from spherekit.runs.reductions import REDUCTION_BY_NAME, reduce_samples
from spherekit.runs.sampling import check_time
from spherekit.velocities.load_numbers import LOAD_DEPENDENT_PREFIXES
from spherekit.velocities.row_quantities import row_quantities, sample_names
from spherekit.wording import counted, listing

DESIGNS_PER_BLOCK = 4096
"""Number of designs, times samples, that are evaluated together.

Larger: intermediate values do not fit the cache of the processor. Smaller: more calls.
"""

POINT_TOLERANCE_RAD = 1e-9
"""Inputs (rad) that differ by less belong to the same sample."""

MOVING = ("kinetic_energy", *LOAD_DEPENDENT_PREFIXES)
"""Beginnings of the names of quantities that depend on rates of the inputs or the time."""

INERTIAL = ("B", "dB_dq", "kinetic_energy", *LOAD_DEPENDENT_PREFIXES)
"""Beginnings of the names of quantities that depend on masses or loads."""

NEVER_CLOSES = "NEVER_CLOSES"
"""Status of a design that closes at no sample."""

IMPOSSIBLE = "IMPOSSIBLE"
"""Status of a design with invalid numbers, or with another mobility than in the file."""

DESIGN_FAILED = "FAILED"
"""Status of a design of which an analysis failed, although the design may be possible."""

NEVER_CLOSES_REASON = "does not close at any sample"
"""Text in the column `reason` that belongs to the status `NEVER_CLOSES`."""


@dataclass(frozen=True)
class DesignSamples:
    """Samples of the inputs at which all designs are evaluated.

    Attributes
    ----------
    inputs
        Names of the driven pairs.
    rows
        (samples, 3 * inputs + 1) the inputs (rad), their rates (rad/s) and accelerations
        (rad/s2), and the time (s).
    shape
        Number of samples along a path, or along each axis of a grid.
    crossings
        How an assembly mode continues where its curve of configurations crosses that of
        another mode. With ``"end"`` it keeps the signs of its dyads. A dyad is two links
        with three R pairs, and its sign is one of two ways to assemble it. With ``"pass"``
        the mode follows the smooth curve.
    search
        Whether modes other than that of the reference pose are searched. Without a
        reference pose they are always searched.
    follows_laws
        Whether inputs follow time laws that the study states.
    """

    inputs: Names
    rows: Floats
    shape: tuple[int, ...]
    crossings: Crossings = "end"
    search: bool = True
    follows_laws: bool = False

    @staticmethod
    def from_study(study: Study) -> "DesignSamples":
        """Return the samples of the inputs at which all designs of a study are evaluated.

        A design is one choice of the sizes of a mechanism. A study states the samples in
        one of three ways:

        - a duration: inputs follow time laws, and the samples are at equally spaced times;
        - a path: a list of the inputs at every sample;
        - neither: inputs run over the ranges that the mechanism states for them.

        Inputs without a time law move at 1 rad/s. On a path they have the rate +1 rad/s.
        Otherwise they move from the start of their range in its sense, up or down.

        Raises
        ------
        DesignError
            If the study is a simulation.
        SolveError
            If a range is empty, or the samples do not fit the number of inputs.
        """
        # Without names of other inputs, `driven_at` returns the same mechanism. It raises
        # an error if an input is a contact pair, because only R pairs can be driven.
        mechanism = driven_at(study.mechanism)
        # Only the study of a simulation has a start, from which the mechanism moves freely.
        if study.start is not None:
            raise DesignError(
                f"{study.name}: designs are compared at samples of the inputs, not along "
                "a simulation; leave the start out, so that the inputs are driven"
            )
        # An error is raised if time laws, duration and samples contradict each other.
        check_time(study)
        if study.duration is not None:
            samples = DesignSamples._sample_times(mechanism, study, study.duration)
        elif study.path is not None:
            samples = DesignSamples._sample_path(mechanism, study)
        else:
            samples = DesignSamples._sample_ranges(mechanism, study)
        # Also store how assembly modes (ways to assemble the mechanism) continue where
        # their curves of configurations cross, and whether all modes are searched.
        return replace(samples, crossings=study.crossings, search=study.search)

    @staticmethod
    def _sample_times(
        mechanism: Mechanism, study: Study, duration: float
    ) -> "DesignSamples":
        """Return samples of the inputs at equally spaced times.

        The inputs follow their time laws (prescribed motions). Inputs without a law move at
        1 rad/s.

        Parameters
        ----------
        mechanism
            The mechanism with its inputs: start and sense of each.
        study
            The number of samples, and the time laws.
        duration
            Time (s) of the last sample. The first one is at time 0.
        """
        assert isinstance(study.samples, int)
        names = mechanism.input_pairs
        t = np.linspace(0.0, duration, study.samples)
        default_laws = {
            driven.pair: ConstantSpeed(driven.sense, driven.start)
            for driven in mechanism.inputs
        }
        q, timing = evaluate_time_laws(names, {**default_laws, **study.laws}, t)
        # A row has the inputs (rad), their rates, their accelerations and the time.
        rows = np.column_stack([q, timing.dq, timing.ddq, t])
        return DesignSamples(names, rows, shape=(len(t),), follows_laws=bool(study.laws))

    @staticmethod
    def _sample_path(mechanism: Mechanism, study: Study) -> "DesignSamples":
        """Return samples at values of the inputs that a study lists (a path).

        A path has neither rates nor times, but figures of merit (numbers that rate a
        design) may contain them. By convention, all inputs increase at the rate 1 rad/s.
        The time is the first input (rad), less its value at time zero, divided by 1 rad/s.
        `_inputs_at_time_zero_of_path` states at which inputs the time is zero.

        Parameters
        ----------
        mechanism
            The mechanism with its inputs.
        study
            The study, with the path.
        """
        input_grid = make_input_grid(mechanism, study.samples, study.grid, study.path)
        names = mechanism.input_pairs
        return DesignSamples.at_unit_speed(
            names,
            input_grid.q,
            q_at_time_zero=_inputs_at_time_zero_of_path(input_grid.q),
            sense=np.ones(len(names)),
            shape=input_grid.shape,
        )

    @staticmethod
    def _sample_ranges(mechanism: Mechanism, study: Study) -> "DesignSamples":
        """Return samples over the ranges of the inputs, a grid if there are several inputs.

        Each input moves from the start of its range, up (sense 1) or down (sense -1), at 1
        rad/s. At time zero the input is at the start.
        """
        input_grid = make_input_grid(mechanism, study.samples, study.grid, study.path)
        return DesignSamples.at_unit_speed(
            mechanism.input_pairs,
            input_grid.q,
            q_at_time_zero=np.array([driven.start for driven in mechanism.inputs]),
            sense=np.array([driven.sense for driven in mechanism.inputs]),
            shape=input_grid.shape,
        )

    @staticmethod
    def at_unit_speed(
        inputs: Names,
        q: Floats,
        q_at_time_zero: Floats,
        sense: Floats,
        shape: tuple[int, ...] | None = None,
    ) -> "DesignSamples":
        """Return samples at which every input has the rate 1, -1 or 0 rad/s.

        These rates are a convention for samples without a time law (prescribed motion).
        Accelerations are 0. The time of a sample is the change of the first input since
        time 0, divided by its rate, or 0 if the rate is 0.

        Parameters
        ----------
        inputs
            Names of the driven pairs.
        q
            (n, inputs) inputs (rad) at the samples.
        q_at_time_zero
            (inputs,) inputs (rad) at time 0.
        sense
            (inputs,) 1 for inputs that increase, -1 for inputs that decrease, 0 for rest.
        shape
            Number of samples along each axis of a grid. By default the samples form a path.
        """
        rates = np.broadcast_to(sense, q.shape)
        time = (q[:, 0] - q_at_time_zero[0]) * sense[0]
        # A row has the inputs, their rates, their accelerations and the time.
        rows = np.column_stack([q, rates, np.zeros_like(q), time])
        return DesignSamples(inputs, rows, shape or (len(q),))

    @property
    def is_closed_path(self) -> bool:
        """Whether the samples are a path that ends, after revolutions, where it started."""
        first, last = self.rows[[0, -1], : len(self.inputs)]
        return len(self.shape) == 1 and return_after_revolutions(first, last)

    @property
    def input_grid(self) -> InputGrid:
        """The inputs (rad) with their neighbours."""
        return InputGrid(self.rows[:, : len(self.inputs)], self.shape)


@dataclass(frozen=True)
class DesignTable(ArrayRows):
    """Figures of merit of designs: a row for each assembly mode in which the loops close.

    An assembly mode is one way to assemble the links. A design that closes in no mode has
    one row without figures.

    Attributes
    ----------
    design
        (n,) index of the design among those that were evaluated together.
    mode
        (n,) label of the assembly mode, empty if the design closes in none.
    is_working_mode
        (n,) whether `mode` is the label of a working mode (way to assemble the links at a
        fixed pose of the output) instead.
    closes
        (n,) fraction of the samples at which the design closes in this mode.
    status
        (n,) `OK`, `NEVER_CLOSES`, `IMPOSSIBLE` or `DESIGN_FAILED`.
    reason
        (n,) why there are no figures, empty if there are.
    claim
        (n,) what is guaranteed about the modes of the design, see `Guarantee`.
    merits
        The figures of merit (n,) by name, in rad and SI units.
    """

    design: Integers
    mode: NDArray[np.object_]
    is_working_mode: Bools
    closes: Floats
    status: NDArray[np.object_]
    reason: NDArray[np.object_]
    claim: NDArray[np.object_]
    merits: Mapping[str, Floats]

    @staticmethod
    def from_columns(
        design: Any,
        merits: Mapping[str, Floats] | Sequence[str],
        mode: Any = "",
        is_working_mode: Any = False,
        closes: Any = 0.0,
        status: Any = OK,
        reason: Any = "",
        claim: Any = "",
    ) -> "DesignTable":
        """Return a table of designs, with one row for each assembly mode of a design.

        A design is one choice of sizes, and an assembly mode is one way to assemble the
        mechanism. Each argument is a column (n,), or one value for all rows.

        Parameters
        ----------
        design
            (n,) index of the design of each row.
        merits
            The figures of merit (numbers that rate a design), as columns by name. If only
            their names are given, all figures are NaN.
        mode
            Label of the assembly mode.
        is_working_mode
            Whether `mode` is instead the label of a working mode (way to assemble the links
            at a fixed pose of the output).
        closes
            Fraction of the samples of the inputs at which the mechanism can be assembled.
        status, reason
            Whether the figures could be computed, and the reason if not.
        claim
            Text that says whether an assembly mode may have been missed.
        """
        numbers = np.asarray(design, np.int64)
        if not isinstance(merits, Mapping):
            merits = {name: nans(len(numbers)) for name in merits}

        def as_column(values: Any, kind: type = object) -> Array:
            return np.broadcast_to(np.asarray(values, kind), len(numbers))

        return DesignTable(
            design=numbers,
            mode=as_column(mode),
            is_working_mode=as_column(is_working_mode, bool),
            closes=as_column(closes, float),
            status=as_column(status),
            reason=as_column(reason),
            claim=as_column(claim),
            merits=merits,
        )

    @staticmethod
    def join_by_design(
        parts: "Sequence[DesignTable]", names: Sequence[str]
    ) -> "DesignTable":
        """Join several tables of designs, and sort the rows by design.

        Rows of the same design stay in their order.

        Parameters
        ----------
        parts
            The tables; there may be none.
        names
            Names of the figures of merit (numbers that rate a design) in all tables.
        """
        # The table without rows has the columns, in case there are no parts.
        table = DesignTable.concatenate([DesignTable.from_columns([], names), *parts])
        return table.rows(np.argsort(table.design, kind="stable"))


def _profile_columns_of_modes(profiles: Sequence[ContactProfile], values: Floats) -> Floats:
    """Return the numbers that describe contact profiles in n modes, at r samples.

    Nine numbers, called columns, describe a profile at the point of contact: the tangent
    (3), the point (3), the geodesic curvature and its first two derivatives. A kernel
    (compiled function) gets them as arguments.

    Parameters
    ----------
    profiles
        The profiles (curves along which links touch) of all contacts.
    values
        (variables, r, n) pair variables (rad).

    Returns
    -------
    (columns, r, n) the nine numbers of the first profile, then those of the second, and so
    on.
    """
    variable_count, sample_count, mode_count = values.shape
    # The called function has one axis for samples and modes.
    configurations = values.reshape(variable_count, -1).T
    columns = evaluate_profile_columns(profiles, configurations)
    return columns.reshape(-1, sample_count, mode_count)


def _evaluate_all_modes(
    kernel: "DesignKernel | RedundantKernel", arguments: Floats
) -> Floats:
    """Return the outputs (k, r, n) of a kernel for arguments (a, r, n).

    `arguments` has a values for each of r samples and n modes, and the result has k. The
    kernel (a function of many configurations) takes samples and modes as one axis.
    """
    argument_count, sample_count, mode_count = arguments.shape
    outputs = kernel.evaluate(arguments.reshape(argument_count, -1))
    return outputs.reshape(-1, sample_count, mode_count)


def _inputs_at_time_zero_of_path(q: Floats) -> Floats:
    """Return the inputs (inputs,) in rad at time zero, for samples on a path.

    A path has no times, but figures of merit (numbers that rate a design) may contain the
    time. By convention the time is the first input, less its value at time zero, divided by
    1 rad/s. A single input has its smallest value at time zero, so that no time is
    negative. With several inputs, time zero is at the first sample.

    Parameters
    ----------
    q
        (n, inputs) inputs (rad) at the samples.
    """
    has_one_input = q.shape[1] == 1
    return np.asarray(np.min(q, axis=0) if has_one_input else q[0])


def failed_design(problem: SpherekitError, names: Sequence[str]) -> DesignTable:
    """Return the table row of a design for which the evaluation ended in an error.

    The status in the row is the kind of failure, and the reason is the message.

    Parameters
    ----------
    problem
        The error. If the file, the mechanism or its number of degrees of freedom is wrong,
        the design is impossible. If the position solver failed, it cannot be assembled.
        Otherwise an analysis failed.
    names
        Names of the figures of merit (numbers that rate a design), which are NaN in the
        row.
    """
    status = DESIGN_FAILED
    if isinstance(problem, FileError | ModelError | PlanError):
        status = IMPOSSIBLE
    elif isinstance(problem, SolveError):
        status = NEVER_CLOSES
    # The table has one row, for the design with the index 0.
    return DesignTable.from_columns(
        design=[0], merits=names, status=status, reason=reason_of(problem)
    )


class QuantitiesOfModes(NamedTuple):
    """Values of named quantities in n assembly modes at r samples or other inputs.

    Attributes
    ----------
    by_name
        (r, n) values of each quantity.
    closed
        (r, n) whether the mechanism can be assembled.
    """

    by_name: dict[str, Floats]
    closed: Bools


class KernelFigures:
    """Figures of merit, each computed from quantities of a kernel at all samples.

    A kernel is a function that evaluates quantities of many designs at once. A figure is a
    reduction, such as the maximum, of an expression of these quantities over the samples.

    Parameters
    ----------
    mechanism
        The mechanism of the file.
    merits
        The figures of merit.
    samples
        The samples over which the outputs of the kernel are reduced.

    Attributes
    ----------
    names
        Names of the figures of merit.
    expressions
        The expression of each figure. It depends on the numbers of a sample
        (`sample_names`) and on the `columns`.
    sample_names
        Names of the numbers of a sample, see the function `sample_names`.
    columns
        Names of the quantities that the kernel computes.
    points
        (points, 3 * inputs + 1) further samples, for the figures at given inputs.
    rows
        (samples + points, 3 * inputs + 1) the samples, followed by the points. A row has
        the inputs (rad), their rates, their accelerations, and the time.

    Raises
    ------
    DesignError
        If a figure refers to inputs that the mechanism does not have, or needs the motion
        at a point that is not exactly one sample of the time laws.
    AnalysisError
        If an expression contains a name that is not a quantity.
    """

    def __init__(
        self, mechanism: Mechanism, merits: Sequence[FigureOfMerit], samples: DesignSamples
    ) -> None:
        """Read the figures of merit and list the quantities that they need.

        A figure of merit is a number that rates a design. It reduces an expression of
        quantities at all samples of the inputs to one number, such as the maximum. Some
        figures are evaluated at one point instead, which is a value of each input. An
        example is ``at(theta_41, 0.5)``.

        Parameters
        ----------
        mechanism
            The mechanism, for the names of its quantities.
        merits
            The figures of merit, as expressions and reductions.
        samples
            The inputs at which the designs are evaluated.

        Raises
        ------
        DesignError
            If a figure refers to inputs that do not exist. If the inputs follow time laws,
            also if a figure needs rates, accelerations or the time at a point, and not
            exactly one sample has the inputs of this point.
        AnalysisError
            If a figure refers to quantities that do not exist.
        """
        self.merits = merits
        self.inputs = samples.inputs
        self.samples = samples
        self.names = [merit.name for merit in merits]
        quantities = row_quantities(mechanism.with_inputs(*self.inputs))
        self._check_inputs(mechanism)
        self.expressions = [merit.parsed(quantities) for merit in merits]
        used_names = set[str]().union(*(item.names for item in self.expressions))
        # A sample has the inputs, their rates and accelerations, and the time. A kernel
        # (function for many designs) computes all other quantities, the `columns`.
        self.sample_names = sample_names(self.inputs)
        self.columns = sorted(used_names.difference(self.sample_names))

        # Further samples at the points of figures such as ``at(theta_41, 0.5)``. Their
        # rates and times are a convention. If the inputs follow time laws, the samples of
        # these laws state them.
        self.points = self._samples_at_points()
        if samples.follows_laws:
            self._take_motion_of_laws(mechanism)
        self.rows = np.concatenate([samples.rows, self.points])

    def _samples_at_points(self) -> Floats:
        """Return further samples for figures of merit that are evaluated at certain inputs.

        A figure of merit (number that rates a design) such as "at(theta_41, 0.5)" states a
        point: a value of each input. Its expression may also contain rates, accelerations
        and the time, which the point does not state. These are a convention:

        - The rate of each input (rad/s) is the sign (1, -1 or 0) of its rate at the first
          sample. Accelerations are 0.
        - The time is that of the first sample, plus the time that the first input takes
          from there to the point. This time is its change divided by its rate, or 0 if the
          rate is 0.

        Returns
        -------
        (points, 3 * inputs + 1) inputs, rates, accelerations and time.
        """
        count = len(self.inputs)
        points = sorted({merit.point for merit in self.merits if merit.point})
        # A sample begins with the inputs (rad), followed by their rates.
        first_row = self.samples.rows[0]
        start_inputs = first_row[:count]
        start_rates = first_row[count : 2 * count]
        rows = DesignSamples.at_unit_speed(
            self.inputs,
            q=np.reshape(points, (-1, count)),
            q_at_time_zero=start_inputs,
            sense=np.sign(start_rates),
        ).rows
        # The first sample of a path may have another time than 0.
        rows[:, -1] += first_row[-1]
        return rows

    def _take_motion_of_laws(self, mechanism: Mechanism) -> None:
        """Give the points the motion that the time laws of the inputs state there.

        A figure of merit (number that rates a design) can be evaluated at a point: a value
        of each input. If exactly one sample has these inputs, the point gets the rates,
        accelerations and time of this sample. Otherwise the motion at the point is not
        known, and the point keeps the values of `_samples_at_points`, which are a
        convention. A `DesignError` is raised if a figure at such a point depends on the
        motion.
        """
        count = len(self.inputs)
        motion_names = self.sample_names[count:]
        samples = self.samples.rows
        for point in self.points:
            distances = max_abs(samples[:, :count] - point[:count], axis=1)
            motions = samples[distances <= POINT_TOLERANCE_RAD, count:]
            if len(motions) == 1:
                point[count:] = motions[0]
                continue
            for merit, expression in zip(self.merits, self.expressions, strict=True):
                if merit.point == tuple(point[:count]) and any(
                    name in motion_names or name.startswith(MOVING)
                    for name in expression.names
                ):
                    reason = "several samples have" if len(motions) else "no sample has"
                    raise DesignError(
                        f"{mechanism.name}: {merit.name}: the inputs follow time laws, and "
                        f"{reason} the inputs {listing(f'{q:.6g}' for q in merit.point)} "
                        "rad, so their rates and the time there are not known; state the "
                        "inputs of one sample"
                    )

    def _check_inputs(self, mechanism: Mechanism) -> None:
        """Raise `DesignError` if a figure of merit does not fit the inputs and samples.

        A figure of merit is a number that rates a design, such as the maximum of a
        quantity.
        """
        count = len(self.inputs)
        for merit in self.merits:
            # "at(theta_41, 0.5, 0.2)" is the value of theta_41 at the inputs 0.5 and 0.2,
            # which are `merit.point`. "argmin(theta_41, 21)" is the value of the input at
            # pair 21 for which theta_41 is smallest. `merit.place` is the name "21".
            fault = ""
            if merit.point and len(merit.point) != count:
                fault = (
                    f'the reduction "at" needs {counted(count, "value")}, one for each '
                    f"driven pair ({listing(self.inputs)}), but {len(merit.point)} "
                    f"{'was' if len(merit.point) == 1 else 'were'} given; write "
                    f"at({', '.join([merit.expression, *['Q'] * count])})"
                )
            elif (
                REDUCTION_BY_NAME[merit.reduction].returns_input
                and count > 1
                and not merit.place
            ):
                fault = (
                    f"there are {counted(count, 'input')}; name the input whose value "
                    "you need, such as "
                    f"{merit.reduction}({merit.expression}, {self.inputs[0]})"
                )
            elif merit.place not in ("", *self.inputs):
                fault = (
                    f"the second argument of {merit.reduction} has to name a driven pair, "
                    f"found {merit.place}. Driven pairs: {listing(self.inputs)}"
                )
            # The reduction "swing" adds up the changes of an angle from sample to sample.
            # Samples of a grid have no order.
            if merit.reduction == "swing" and len(self.samples.shape) > 1:
                fault = (
                    'the reduction "swing" needs samples along a path, but the samples '
                    'form a grid; use the reduction "range" of the sine or cosine of the '
                    "angle"
                )
            if fault:
                raise DesignError(f"{mechanism.name}: {merit.name}: {fault}")

    def select_rows(self, merit: FigureOfMerit) -> Indices:
        """Return the indices of the samples from which a figure of merit is computed.

        They are indices of `rows`, which has all samples and then further points. A figure
        such as ``at(theta_41, 0.5)`` uses one point, and any other figure all samples.
        """
        sample_count = len(self.samples.rows)
        if not merit.point:
            return np.arange(sample_count)
        is_point = np.all(self.points[:, : len(self.inputs)] == merit.point, axis=1)
        return sample_count + np.flatnonzero(is_point)

    def reduce_values(self, merit: FigureOfMerit, values: Floats) -> Floats:
        """Reduce the values of an expression to one figure of merit, such as their maximum.

        A figure of merit is a number that rates a design.

        Parameters
        ----------
        merit
            The figure of merit, with the expression and the reduction.
        values
            (rows, n) values of the expression for n designs, at the samples of this figure.

        Returns
        -------
        (n,) the figure of each design.
        """
        # Some reductions need an input at the samples. For example, "argmin" returns the
        # input at which the expression is smallest. `place` is the name of this input. If
        # the user names none, the first one is used.
        input_index = self.inputs.index(merit.place) if merit.place else 0
        # `select_rows` returns the rows of this figure: all samples, or one point.
        q = self.rows[self.select_rows(merit), input_index]
        # The reduction "swing" is the difference of the largest and the smallest angle,
        # with full revolutions counted. It needs to know whether the path of samples
        # returns to its start. The angle may then swing on from the last sample to the
        # first one.
        is_closed_path = self.samples.is_closed_path
        return reduce_samples(merit.reduction, q, values, is_closed_path)

    def evaluate_modes(
        self,
        kernel: DesignKernel | RedundantKernel,
        prepared: Floats,
        position_arguments: Floats,
        revolution_offsets: Floats,
        labels: Any,
        claim: str,
        profiles: Sequence[ContactProfile] = (),
    ) -> DesignTable:
        """Evaluate the figures of n modes, each of which is an assembly mode of a design.

        The kernel computes the quantities at all samples and points, block by block. Points
        are additional sets of inputs, which figures such as ``at(theta_41, 0.5)`` state.
        The expressions of the figures are evaluated from the quantities and then reduced
        over the samples, or taken at the point of the figure.

        Parameters
        ----------
        kernel
            Computes the quantities (`columns`) on which the figures depend.
        prepared
            (k, n) what ``kernel.prepare`` returns for the designs.
        position_arguments
            (w, samples + points, n) signs of dyads, or pair variables (rad), NaN at samples
            where a mode does not close.
        revolution_offsets
            (unwrapped pairs, samples + points, n) multiples of 2 pi (rad) to be added to
            angles of pairs on whose whole revolutions loads depend.
        labels
            (n,) labels of the modes, or one label for all.
        claim
            What is guaranteed about the modes.
        profiles
            The profiles of all contacts if they are not circles, otherwise empty.

        Returns
        -------
        A row for each mode that closes at a sample. The column `design` has the index of
        the mode, from 0 to n - 1.
        """
        mode_count = prepared.shape[1]
        row_count = len(self.rows)
        values = np.empty((len(self.merits), row_count, mode_count))
        closed = np.empty((row_count, mode_count), bool)
        rows_per_block = max(1, DESIGNS_PER_BLOCK // max(1, mode_count))
        with np.errstate(all="ignore"):
            for start in range(0, row_count, rows_per_block) if mode_count else ():
                block = slice(start, start + rows_per_block)
                quantities = self._compute_quantities(
                    kernel,
                    self.rows[block],
                    prepared,
                    position_arguments[:, block],
                    revolution_offsets[:, block],
                    profiles,
                )
                closed[block] = quantities.closed
                for merit_values, expression in zip(values, self.expressions, strict=True):
                    arguments_by_name = {
                        name: quantities.by_name[name] for name in expression.names
                    }
                    merit_values[block] = expression.evaluate(arguments_by_name)
            values[:, ~closed] = np.nan
            # The fraction of samples at which a mode closes; points do not count. Modes
            # that close at no sample have no row.
            closes = np.mean(closed[: len(self.samples.rows)], axis=0)
            chosen = np.flatnonzero(closes)
            merits = {
                merit.name: self.reduce_values(
                    merit, merit_values[self.select_rows(merit)]
                )[chosen]
                for merit, merit_values in zip(self.merits, values, strict=True)
            }
        chosen_labels = np.broadcast_to(np.asarray(labels, object), mode_count)[chosen]
        return DesignTable.from_columns(
            chosen, merits, mode=chosen_labels, closes=closes[chosen], claim=claim
        )

    def _compute_quantities(
        self,
        kernel: DesignKernel | RedundantKernel,
        rows: Floats,
        prepared: Floats,
        position_arguments: Floats,
        revolution_offsets: Floats,
        profiles: Sequence[ContactProfile],
    ) -> QuantitiesOfModes:
        """Return quantities, such as angles, of n modes of designs at some samples.

        A design is one choice of sizes, and a mode is one way to assemble one design. A
        kernel (function for many designs) computes the quantities. Figures of merit
        (numbers that rate a design) are computed from them later.

        Parameters
        ----------
        kernel
            Computes the quantities whose names are in `columns`.
        rows
            (r, 3 * inputs + 1) samples: inputs, rates, accelerations, and the time.
        prepared
            (k, n) numbers that follow from the sizes of the design of each mode, computed
            by ``kernel.prepare``.
        position_arguments
            (w, r, n) w numbers that determine the positions of links: signs of dyads
            (groups of two links that can be assembled in two ways), or pair variables
            (rad).
        revolution_offsets
            (pairs, r, n) multiples of 2 pi (rad) to be added to the angles of those pairs
            on whose whole revolutions loads depend.
        profiles
            The profiles (curves) of all contacts if they are not circles, otherwise empty.

        Returns
        -------
        The quantities by name, each (r, n), and whether the mechanism can be assembled.
        """
        sample_count, mode_count = len(rows), prepared.shape[1]
        # The kernel needs arrays (quantities, samples, modes). The samples do not depend on
        # the mode, so they are repeated for each mode. The numbers of a design do not
        # depend on the sample, so they are repeated for each sample.
        samples = np.repeat(rows.T[:, :, np.newaxis], mode_count, axis=2)
        design_numbers = np.repeat(prepared[:, np.newaxis], sample_count, axis=1)
        arguments = [samples, position_arguments]
        if profiles:
            # Here `position_arguments` are the pair variables, from which the points of
            # contact follow.
            arguments.append(_profile_columns_of_modes(profiles, position_arguments))
        arguments += [revolution_offsets, design_numbers]
        outputs = _evaluate_all_modes(kernel, np.concatenate(arguments))
        # `reaches` are negative where a dyad is too short or too long to close.
        reaches, kernel_columns = np.split(outputs, [kernel.reach_count])
        dyads_close = np.all(reaches >= 0.0, axis=0)
        # If a configuration was not found, all its arguments are NaN. So the first argument
        # tells.
        has_positions = all_finite(position_arguments[:1], axis=0)
        # `sample_names` are the names of the inputs, their rates and so on.
        by_name = dict(zip(self.sample_names, samples, strict=True))
        by_name |= zip(self.columns, kernel_columns, strict=True)
        return QuantitiesOfModes(by_name, has_positions & dyads_close)
